"""Term: a common cone at vertices of valence above 4, its axis an unknown."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.measure import common_vectors
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.terms.planarity import area_vectors
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm

NONE = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Cone:
    """n_f . w / L - 1 for every face f at an interior vertex of valence above 4.

    w is a row of the block `axes`: the move of the vertex when all its faces move by a mean edge L,
    so that it is as large as coordinates of vertices in any unit. Three faces always touch a cone,
    and four have their balance of angles (`Conicality`).

    References: theory of conical vertices of any valence, errata page, E15.
    """

    stencils: Mapping[str, Indices]
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, size: int = 4, also: Indices = NONE) -> Cone:
        """One element for each face of so many corners at each such vertex, and at others named."""
        corners, axes, count = [np.empty((0, size), np.int64)], [np.empty((0, 1), np.int64)], 0
        topology = mesh.topology
        for vertices, around in _with_axes(mesh, also):
            n, k = around.shape
            faces, axis = around.ravel(), np.repeat(count + np.arange(n), k)
            chosen = topology.face_sizes[faces] == size
            corners.append(
                topology.indices[topology.offsets[faces[chosen]][:, None] + np.arange(size)]
            )
            axes.append(axis[chosen][:, None])
            count += len(vertices)
        stencils = {"vertices": np.concatenate(corners), "axes": np.concatenate(axes)}
        return cls(stencils, mesh.mean_edge_length)

    @staticmethod
    def vertices(mesh: PolyMesh, also: Indices = NONE) -> Indices:
        """The vertices with an axis, in the row order of the block `axes`."""
        return np.concatenate([NONE, *(found for found, _ in _with_axes(mesh, also))])

    @staticmethod
    def start_axes(mesh: PolyMesh, also: Indices = NONE) -> Floats:
        """Least-squares vectors w of the mesh, in the row order of `on`, shape (n, 3)."""
        parts = [common_vectors(mesh.face_normals[around]) for _, around in _with_axes(mesh, also)]
        return mesh.mean_edge_length * np.concatenate([np.empty((0, 3)), *parts])

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, 1) and Jacobian (m, 1, k + 1, 3) of faces of k corners."""
        axis = rows[:, -1] / self.length
        area, chords = area_vectors(rows[:, :-1])
        length = np.maximum(norm(area), TINY)[:, None]
        normal = area / length
        along = dot(normal, axis)
        # d(n.w) = (w - (n.w) n) . d(area) / |area|.
        slope = (axis - along[:, None] * normal) / length
        by_axis = normal[:, None] / self.length
        jacobian = np.concatenate([cross(chords, slope[:, None]), by_axis], axis=1)
        return (along - 1.0)[:, None], jacobian[:, None]


def _with_axes(mesh: PolyMesh, also: Indices) -> Iterator[tuple[Indices, Indices]]:
    """Inner vertices (n,) of valence above 4, then those named; the faces (n, k) around them."""
    stars = list(mesh.topology.stars())
    for star in stars:
        if star.faces.shape[1] > 4:
            yield star.vertices, star.faces
    for star in stars:
        chosen = np.isin(star.vertices, also)
        if star.faces.shape[1] <= 4 and chosen.any():
            yield star.vertices[chosen], star.faces[chosen]
