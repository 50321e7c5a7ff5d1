"""Terms of flatness at large: vertices on given planes, polylines each in a plane of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices, cross, dot, norm, unit


@dataclass(frozen=True, eq=False)
class OnPlanes:
    """Signed distance of vertices from given planes, over the mean edge.

    Attributes
    ----------
    points, normals : (n, 3)
        A point and the unit normal of each element's plane.
    """

    stencils: Mapping[str, Indices]
    points: Floats
    normals: Floats
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, vertices: Indices, point: ArrayLike, normal: ArrayLike) -> Self:
        """One element for each vertex; one plane for all of them, or one row for each."""
        shape = (len(vertices), 3)
        points = np.broadcast_to(np.asarray(point, dtype=np.float64), shape)
        normals = np.broadcast_to(unit(np.asarray(normal, dtype=np.float64)), shape)
        return cls({"vertices": vertices[:, None]}, points, normals, mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 1) and Jacobian (n, 1, 1, 3)."""
        distance = dot(rows[:, 0] - self.points, self.normals)
        return distance[:, None] / self.length, self.normals[:, None, None] / self.length


@dataclass(frozen=True, eq=False)
class PlanarPolyline:
    """Distance of each point of a polyline from a plane of its own, over the mean edge.

    The plane is an unknown: a row u of the block `planes`, which stands for the points x with
    u . (x - o) = D L, where o lies at the distance D, the extent of the polyline, before the
    plane fitted at the start, and L is the mean edge. So u is L times the normal at first, a
    length like the vertices. A plane fitted anew at each step would not do: the points would be
    held in the plane of the step before, and the first one would stay for good.

    Attributes
    ----------
    origins : (n, 3), model unit
        o of each element's polyline.
    reach : (n,), model unit
        D of each element's polyline.
    """

    stencils: Mapping[str, Indices]
    origins: Floats
    reach: Floats
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, polylines: list[Indices], block: str = "planes") -> Self:
        """One element for each different vertex of each polyline.

        Parameters
        ----------
        mesh : PolyMesh
        polylines : list of vertex lists
        block : str
            Name of the block of unknown planes, whose start is `start_planes`.
        """
        chains = [np.unique(chain) for chain in polylines]
        fits = [_fitted(mesh.vertices[chain]) for chain in polylines]
        owner = np.repeat(np.arange(len(chains)), [len(chain) for chain in chains])
        origins = np.array([center - extent * normal for center, normal, extent in fits])
        reach = np.array([extent for _, _, extent in fits])
        stencils = {"vertices": np.concatenate(chains)[:, None], block: owner[:, None]}
        return cls(stencils, origins[owner], reach[owner], mesh.mean_edge_length)

    @staticmethod
    def start_planes(mesh: PolyMesh, polylines: list[Indices]) -> Floats:
        """Fitted planes of the polylines as rows u, shape (len(polylines), 3)."""
        fits = [_fitted(mesh.vertices[chain]) for chain in polylines]
        return mesh.mean_edge_length * np.array([normal for _, normal, _ in fits])

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 1) and Jacobian (n, 1, 2, 3)."""
        away, plane = rows[:, 0] - self.origins, rows[:, 1]
        value = dot(away, plane) / self.length - self.reach
        jacobian = np.stack([plane, away], axis=1) / self.length**2
        return value[:, None] / self.length, jacobian[:, None]


def _fitted(points: Floats) -> tuple[Floats, Floats, float]:
    """Center, unit normal of the best plane, and extent of the points of a polyline.

    The normal looks to the side from which the polyline, closed by its chord, runs
    counterclockwise: the same whatever the coordinates.
    """
    center = points.mean(axis=0)
    away = points - center
    normal = np.linalg.svd(away)[2][2]
    turn = cross(away, np.roll(away, -1, axis=0)).sum(axis=0)
    side = -1.0 if turn @ normal < 0 else 1.0
    return center, side * normal, float(norm(away).max())
