"""Terms that follow a surface: closeness to it, and a bound for the distance from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.problem import Blocks
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats, Indices, dot, norm, unit

# Vertices nearer than this share of a bound to their last foot point are left alone.
WELL_WITHIN = 0.9

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
class Within:
    """Distance of vertices to a surface, over the mean edge, to be bounded.

    The true distance, not that to a tangent plane: beyond the rim of the surface, and where a
    vertex slides along, the bound holds all the same. Foot points are sought anew only where the
    last one is not near enough to show that the vertex is well within.

    Attributes
    ----------
    feet : (V, 3)
        Foot points of the vertices at the last refresh.
    distance : float, model unit
        The bound; residuals well below it may be larger than the distance is.
    """

    stencils: Mapping[str, Indices]
    reference: Reference
    feet: Floats
    distance: float
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, reference: Reference, distance: float) -> Self:
        """One element for each vertex."""
        rows = np.arange(mesh.topology.n_vertices)[:, None]
        feet, _, reference = reference.closest(mesh.vertices)
        return cls({"vertices": rows}, reference, feet, distance, mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (V, 1) and Jacobian (V, 1, 1, 3)."""
        points, feet = rows[:, 0], self.feet
        near = norm(points - feet) <= WELL_WITHIN * self.distance
        if not near.all():
            found, _, _ = self.reference.closest(points)
            feet = np.where(near[:, None], feet, found)
        away = points - feet
        return norm(away)[:, None] / self.length, unit(away)[:, None, None] / self.length

    def refreshed(self, blocks: Blocks) -> Self:
        """The term with the foot points of the current vertices."""
        feet, _, reference = self.reference.closest(blocks["vertices"])
        return replace(self, reference=reference, feet=feet)
