"""Terms that keep vertices on curves: given polylines, or the boundary of the start mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.polylines import Polylines
from pqmesh.optimize.problem import Blocks
from pqmesh.vectors import TINY, Floats, Indices, Mask, dot, norm

# A vertex that went to and fro between two segments so often, or stood beyond an end so often
# while it was this near to the curve (in mean edges), stays at that kink or end.
MOST_RETURNS, NEAR = 2, 1e-4


@dataclass(frozen=True, eq=False)
class OnCurve:
    """Way from the nearest point of a polyline to each vertex, over the mean edge.

    Each vertex knows its segment and slides along it freely; beyond the segment's end the way
    leads back to that end. So a residual of zero means on the polyline, and while the segment
    stays the residual is the way to a convex set: Newton's method has one target. `refreshed`
    steps to neighboring segments that have come nearer. Where the best place is a kink, a vertex
    would go to and fro between its two segments without end; it stays there at last.

    Attributes
    ----------
    curves : Polylines
    segments : (n,)
        Segment of each vertex.
    left : (n,)
        Segment that each vertex was on before that, -1 at first.
    kinks : (n, 3), model unit
        Kink or end that each vertex came back to last.
    returns : (n,)
        How often it came back.
    """

    stencils: Mapping[str, Indices]
    curves: Polylines
    segments: Indices
    left: Indices
    kinks: Floats
    returns: Indices
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, vertices: Indices, curves: list[Floats]) -> Self:
        """Elements for the given vertices; each goes to its nearest point of all the polylines."""
        lines = Polylines.of(curves)
        return cls._started(mesh, vertices, lines, lines.nearest(mesh.vertices[vertices]))

    @classmethod
    def _started(
        cls, mesh: PolyMesh, vertices: Indices, curves: Polylines, segments: Indices
    ) -> Self:
        unknown, none = np.full(len(vertices), -1), np.zeros(len(vertices), dtype=np.int64)
        kinks = np.zeros((len(vertices), 3))
        stencils = {"vertices": vertices[:, None]}
        return cls(stencils, curves, segments, unknown, kinks, none, mesh.mean_edge_length)

    @property
    def pinned(self) -> Mask:
        """Vertices (n,) that stay at a kink or an end."""
        return np.asarray(self.returns >= MOST_RETURNS)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 3) and Jacobian (n, 3, 1, 3)."""
        points, pinned = rows[:, 0], self.pinned
        along = self.curves.ends[self.segments] - self.curves.starts[self.segments]
        feet, beyond = self.curves.feet(points, self.segments)
        feet = np.where(pinned[:, None], self.kinks, feet)
        free = along[:, :, None] * along[:, None, :]
        free = free / np.maximum(dot(along, along), TINY)[:, None, None]
        held = pinned | beyond.any(axis=1)
        jacobian = np.eye(3) - np.where(held[:, None, None], 0.0, free)
        return (points - feet) / self.length, jacobian[:, :, None] / self.length

    def refreshed(self, blocks: Blocks) -> Self:
        """The term with the segments of the current vertices."""
        points = blocks["vertices"][self.stencils["vertices"][:, 0]]
        segments = np.where(self.pinned, self.segments, self.curves.walked(points, self.segments))
        went = segments != self.segments
        before, after = self.curves.before[segments], self.curves.after[segments]
        back = (
            went & (segments == self.left) & ((self.segments == before) | (self.segments == after))
        )
        starts, ends = self.curves.starts[segments], self.curves.ends[segments]
        kinks = np.where((self.segments == before)[:, None], starts, ends)
        feet, beyond = self.curves.feet(points, segments)
        stands = ~went & beyond.any(axis=1) & (norm(points - feet) < NEAR * self.length)
        kinks = np.where(stands[:, None], feet, np.where(back[:, None], kinks, self.kinks))
        same = (kinks == self.kinks).all(axis=1)
        returns = np.where(back | stands, np.where(same, self.returns, 0) + 1, self.returns)
        kinks = np.where(self.pinned[:, None], self.kinks, kinks)
        returns = np.where(self.pinned, self.returns, returns)
        left = np.where(went, self.segments, self.left)
        return replace(self, segments=segments, left=left, kinks=kinks, returns=returns)


class Gliding(OnCurve):
    """Boundary vertices on the boundary curve of the start mesh.

    Corners of the boundary are to be fixed beside this term.
    """

    @classmethod
    def on(cls, mesh: PolyMesh, vertices: Indices) -> Self:  # type: ignore[override]
        """Elements for the given boundary vertices, each on the segment that leaves it."""
        loops = mesh.topology.boundary_loops
        curves = Polylines.of([mesh.vertices[np.append(loop, loop[:1])] for loop in loops])
        place = np.full(mesh.topology.n_vertices, -1)
        around = np.concatenate(loops)
        place[around] = np.arange(len(around))
        return cls._started(mesh, vertices, curves, place[vertices])
