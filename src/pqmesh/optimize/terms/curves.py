"""Terms that keep vertices on curves: given polylines, or the boundary of the start mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.polylines import Polylines
from pqmesh.optimize.problem import Blocks
from pqmesh.vectors import TINY, Floats, Indices, Mask, dot

# A vertex that went to and fro between two segments so often stays at the kink between them.
MOST_RETURNS = 2


@dataclass(frozen=True, eq=False)
class OnCurve:
    """Way from the nearest point of a polyline to each vertex, over the mean edge.

    Each vertex knows its segment and slides along it freely; beyond the segment's end the way
    leads back to that end. So a residual of zero means on the polyline, and while the segment
    stays the residual is the way to a convex set: Newton's method has one target. `refreshed`
    steps to neighboring segments that have come nearer. Where the best place is a kink, a vertex
    would go to and fro between its two segments without end; after two returns it stays there.

    Attributes
    ----------
    curves : Polylines
    segments : (n,)
        Segment of each vertex.
    left : (n,)
        Segment that each vertex was on before that, -1 at first.
    returns : (n,)
        How often it came back to the segment it had left.
    """

    stencils: Mapping[str, Indices]
    curves: Polylines
    segments: Indices
    left: Indices
    returns: Indices
    length: float

    @classmethod
    def on(cls, mesh: QuadMesh, vertices: Indices, curves: list[Floats]) -> Self:
        """Elements for the given vertices; each goes to its nearest point of all the polylines."""
        lines = Polylines.of(curves)
        return cls._started(mesh, vertices, lines, lines.nearest(mesh.vertices[vertices]))

    @classmethod
    def _started(
        cls, mesh: QuadMesh, vertices: Indices, curves: Polylines, segments: Indices
    ) -> Self:
        unknown, none = np.full(len(vertices), -1), np.zeros(len(vertices), dtype=np.int64)
        stencils = {"vertices": vertices[:, None]}
        return cls(stencils, curves, segments, unknown, none, mesh.mean_edge_length)

    @property
    def pinned(self) -> Mask:
        """Vertices (n,) that stay at the kink between the segment they are on and the last one."""
        return np.asarray(self.returns >= MOST_RETURNS)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 3) and Jacobian (n, 3, 1, 3)."""
        points = rows[:, 0]
        along = self.curves.ends[self.segments] - self.curves.starts[self.segments]
        feet, beyond = self.curves.feet(points, self.segments)
        feet = np.where(self.pinned[:, None], self._kinks(), feet)
        free = along[:, :, None] * along[:, None, :]
        free = free / np.maximum(dot(along, along), TINY)[:, None, None]
        held = self.pinned | beyond.any(axis=1)
        jacobian = np.eye(3) - np.where(held[:, None, None], 0.0, free)
        return (points - feet) / self.length, jacobian[:, :, None] / self.length

    def refreshed(self, blocks: Blocks) -> Self:
        """The term with the segments of the current vertices."""
        points = blocks["vertices"][self.stencils["vertices"][:, 0]]
        segments = self.curves.walked(points, self.segments)
        went = (segments != self.segments) & ~self.pinned
        beside = (segments == self.curves.before[self.segments]) | (
            segments == self.curves.after[self.segments]
        )
        returns = self.returns + (went & beside & (segments == self.left))
        left = np.where(went, self.segments, self.left)
        segments = np.where(went, segments, self.segments)
        return replace(self, segments=segments, left=left, returns=returns)

    def _kinks(self) -> Floats:
        """The end of each vertex's segment that its last one meets."""
        at_start = self.curves.before[self.segments] == self.left
        starts, ends = self.curves.starts[self.segments], self.curves.ends[self.segments]
        return np.where(at_start[:, None], starts, ends)


class Gliding(OnCurve):
    """Boundary vertices on the boundary curve of the start mesh.

    Corners of the boundary are to be fixed beside this term.
    """

    @classmethod
    def on(cls, mesh: QuadMesh, vertices: Indices) -> Self:  # type: ignore[override]
        """Elements for the given boundary vertices, each on the segment that leaves it."""
        loops = mesh.topology.boundary_loops
        curves = Polylines.of([mesh.vertices[np.append(loop, loop[:1])] for loop in loops])
        place = np.full(mesh.topology.n_vertices, -1)
        around = np.concatenate(loops)
        place[around] = np.arange(len(around))
        return cls._started(mesh, vertices, curves, place[vertices])
