"""Term: a common cone at vertices of valence above 4, its axis an unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.measure import common_vectors
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.terms.planarity import area_vectors
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
    def on(cls, mesh: PolyMesh, size: int = 4) -> Cone:
        """One element for each face of so many corners at each such vertex."""
        corners, axes, count = [np.empty((0, size), np.int64)], [np.empty((0, 1), np.int64)], 0
        topology = mesh.topology
        for star in topology.stars():
            n, k = star.faces.shape
            if k > 4:
                faces, axis = star.faces.ravel(), np.repeat(count + np.arange(n), k)
                chosen = topology.face_sizes[faces] == size
                corners.append(
                    topology.indices[topology.offsets[faces[chosen]][:, None] + np.arange(size)]
                )
                axes.append(axis[chosen][:, None])
                count += n
        return cls({"vertices": np.concatenate(corners), "axes": np.concatenate(axes)})

    @staticmethod
    def start_axes(mesh: PolyMesh) -> Floats:
        """Least-squares vectors w of the mesh, in the row order of `on`, shape (n, 3)."""
        parts = [
            common_vectors(mesh.face_normals[star.faces])
            for star in mesh.topology.stars()
            if star.faces.shape[1] > 4
        ]
        return np.concatenate(parts) if parts else np.empty((0, 3))

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, 1) and Jacobian (m, 1, k + 1, 3) of faces of k corners."""
        axis = rows[:, -1]
        area, chords = area_vectors(rows[:, :-1])
        length = np.maximum(norm(area), TINY)[:, None]
        normal = area / length
        along = dot(normal, axis)
        # d(n.w) = (w - (n.w) n) . d(area) / |area|.
        slope = (axis - along[:, None] * normal) / length
        jacobian = np.concatenate([cross(chords, slope[:, None]), normal[:, None]], axis=1)
        return (along - 1.0)[:, None], jacobian[:, None]
