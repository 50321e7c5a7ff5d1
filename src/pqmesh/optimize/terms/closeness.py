"""Terms that follow a surface: closeness to it, and a bound for the distance from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.problem import Blocks
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats, Indices, dot, norm, unit

# Below this share of the mean edge the way from a foot point is rounding.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Closeness:
    """Distance of each vertex to the tangent plane at its foot point, over the mean edge.

    The foot points are true closest points of the reference, refreshed as the vertices move.
    """

    stencils: Mapping[str, Indices]
    reference: Reference
    feet: Floats
    normals: Floats
    length: float

    @classmethod
    def on(cls, mesh: QuadMesh, reference: Reference) -> Closeness:
        """One element for each vertex."""
        rows = np.arange(mesh.topology.n_vertices)[:, None]
        feet, normals, reference = reference.closest(mesh.vertices)
        return cls({"vertices": rows}, reference, feet, normals, mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (V, 1) and Jacobian (V, 1, 1, 3)."""
        distance = dot(rows[:, 0] - self.feet, self.normals)
        return distance[:, None] / self.length, self.normals[:, None, None] / self.length

    def refreshed(self, blocks: Blocks) -> Closeness:
        """The term with the foot points of the current vertices."""
        feet, normals, reference = self.reference.closest(blocks["vertices"])
        return replace(self, reference=reference, feet=feet, normals=normals)


@dataclass(frozen=True, eq=False)
class Within:
    """Distance of vertices to a surface, over the mean edge, to be bounded by a slack.

    To first order: along the way from the foot point to the vertex, which beyond the rim of the
    surface is not its normal. A vertex on the surface has no such way and takes the normal; an
    inequality asks nothing of it there.
    """

    stencils: Mapping[str, Indices]
    reference: Reference
    feet: Floats
    ways: Floats
    length: float

    @classmethod
    def on(cls, mesh: QuadMesh, reference: Reference) -> Self:
        """One element for each vertex."""
        rows = np.arange(mesh.topology.n_vertices)[:, None]
        nothing = np.zeros_like(mesh.vertices)
        term = cls({"vertices": rows}, reference, nothing, nothing, mesh.mean_edge_length)
        return term.refreshed({"vertices": mesh.vertices})

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 1) and Jacobian (n, 1, 1, 3)."""
        distance = dot(rows[:, 0] - self.feet, self.ways)
        return distance[:, None] / self.length, self.ways[:, None, None] / self.length

    def refreshed(self, blocks: Blocks) -> Self:
        """The term with the foot points of the current vertices."""
        points = blocks["vertices"]
        feet, normals, reference = self.reference.closest(points)
        away = points - feet
        clear = norm(away) > SAME * self.length
        ways = np.where(clear[:, None], unit(away), normals)
        return replace(self, reference=reference, feet=feet, ways=ways)
