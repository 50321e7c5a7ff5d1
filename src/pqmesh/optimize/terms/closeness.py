"""Terms that follow a reference: closeness to a surface, gliding along a boundary curve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.optimize.problem import Blocks
from pqmesh.surface.reference import Reference
from pqmesh.vectors import TINY, Floats, Indices, dot, norm, unit

# Foot points are looked for again once a vertex has moved by this much, in mean edges: the tangent
# plane then leaves the surface by at most half its square times the curvature.
STALE = 0.01


@dataclass(frozen=True, eq=False)
class Closeness:
    """Distance of each vertex to the tangent plane at its foot point, over the mean edge.

    The foot points are true closest points of the reference, refreshed as the vertices move.
    """

    stencils: Mapping[str, Indices]
    reference: Reference
    at: Floats
    feet: Floats
    normals: Floats
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, reference: Reference) -> Closeness:
        """One element for each vertex."""
        rows = np.arange(mesh.topology.n_vertices)[:, None]
        at = mesh.vertices
        feet, normals, reference = reference.closest(at)
        return cls({"vertices": rows}, reference, at, feet, normals, mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (V, 1) and Jacobian (V, 1, 1, 3)."""
        distance = dot(rows[:, 0] - self.feet, self.normals)
        return distance[:, None] / self.length, self.normals[:, None, None] / self.length

    def refreshed(self, blocks: Blocks) -> Closeness:
        """The term with the foot points of the current vertices; itself where they hardly moved."""
        at = blocks["vertices"]
        if norm(at - self.at).max(initial=0.0) < STALE * self.length:
            return self
        feet, normals, reference = self.reference.closest(at)
        return replace(self, reference=reference, at=at, feet=feet, normals=normals)


@dataclass(frozen=True, eq=False)
class Gliding:
    """Distance of boundary vertices to the boundary curve of the start mesh, over the mean edge.

    Two residuals across the curve's tangent at the nearest point. Corners of the boundary are
    to be fixed beside this term.
    """

    stencils: Mapping[str, Indices]
    segments: Floats
    feet: Floats
    across: Floats
    length: float

    @classmethod
    def on(cls, mesh: QuadMesh, vertices: Indices) -> Gliding:
        """Elements for the given boundary vertices; the curve is the whole boundary."""
        loops = mesh.topology.boundary_loops
        starts = np.concatenate([mesh.vertices[loop] for loop in loops])
        ends = np.concatenate([mesh.vertices[np.roll(loop, -1)] for loop in loops])
        segments = np.stack([starts, ends], axis=1)
        feet, across = _on_segments(segments, mesh.vertices[vertices])
        return cls({"vertices": vertices[:, None]}, segments, feet, across, mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 2) and Jacobian (n, 2, 1, 3)."""
        offset = rows[:, 0] - self.feet
        value = np.einsum("nri,ni->nr", self.across, offset)
        return value / self.length, self.across[:, :, None] / self.length

    def refreshed(self, blocks: Blocks) -> Gliding:
        """The term with the nearest points of the current vertices."""
        points = blocks["vertices"][self.stencils["vertices"][:, 0]]
        feet, across = _on_segments(self.segments, points)
        return replace(self, feet=feet, across=across)


def _on_segments(segments: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Nearest points on a set of segments, and two unit vectors across the tangent there."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    square = np.maximum(dot(along, along), TINY)
    feet, tangents = np.empty_like(points), np.empty_like(points)
    for row, point in enumerate(points):
        share = np.clip(dot(point - start, along) / square, 0.0, 1.0)
        places = start + share[:, None] * along
        best = int(norm(places - point).argmin())
        feet[row], tangents[row] = places[best], along[best]
    tangents = unit(tangents)
    helper = np.eye(3)[np.abs(tangents).argmin(axis=1)]
    first = unit(np.cross(tangents, helper))
    return feet, np.stack([first, np.cross(tangents, first)], axis=1)
