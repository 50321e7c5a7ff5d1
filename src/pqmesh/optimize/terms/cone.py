"""Term: a common cone at vertices of valence above 4, its axis an unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.measure import common_vectors
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm


@dataclass(frozen=True, eq=False)
class Cone:
    """n_f . w - 1 for every face f at an interior vertex of valence above 4.

    w is a row of the block `axes`: the move of the vertex when all its faces move by 1. Three
    faces always touch a cone, and four have their balance of angles (`Conicality`).

    References: theory of conical vertices of any valence, errata page, E15.
    """

    stencils: Mapping[str, Indices]

    @classmethod
    def on(cls, mesh: QuadMesh) -> Cone:
        """One element for each face at each such vertex."""
        corners, axes, count = [np.empty((0, 4), np.int64)], [np.empty((0, 1), np.int64)], 0
        for star in mesh.topology.stars():
            n, k = star.faces.shape
            if k > 4:
                corners.append(mesh.faces[star.faces].reshape(-1, 4))
                axes.append(np.repeat(count + np.arange(n), k)[:, None])
                count += n
        return cls({"vertices": np.concatenate(corners), "axes": np.concatenate(axes)})

    @staticmethod
    def start_axes(mesh: QuadMesh) -> Floats:
        """Least-squares vectors w of the mesh, in the row order of `on`, shape (n, 3)."""
        parts = [
            common_vectors(mesh.face_normals[star.faces])
            for star in mesh.topology.stars()
            if star.faces.shape[1] > 4
        ]
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, 1) and Jacobian (m, 1, 5, 3)."""
        a, b, c, d, axis = np.moveaxis(rows, 1, 0)
        first, second = c - a, d - b
        area = cross(first, second)
        length = np.maximum(norm(area), TINY)[:, None]
        normal = area / length
        along = dot(normal, axis)
        # d(n.w) = (w - (n.w) n) . d(area) / |area|, and area is bilinear in the diagonals.
        slope = (axis - along[:, None] * normal) / length
        by_first, by_second = cross(second, slope), cross(slope, first)
        jacobian = np.stack([-by_first, -by_second, by_first, by_second, normal], axis=1)
        return (along - 1.0)[:, None], jacobian[:, None]
