"""Terms: every face flat. Quads by their diagonals, polygons by the heights of their corners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm


@dataclass(frozen=True, eq=False)
class Planarity:
    """Signed distance of each quad's diagonals over the mean edge length.

    The gradient follows from the closest points of the two diagonals' lines: moving a corner
    changes the distance by the corner's share in its diagonal's closest point.

    References: distance of diagonals as the planarity measure of the field [thesis E2].
    """

    stencils: Mapping[str, Indices]
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh) -> Planarity:
        """One element for each quad."""
        return cls({"vertices": corners_of_size(mesh, 4)}, mesh.mean_edge_length)

    def residual(self, rows: Floats) -> Floats:
        """Residuals (F, 1) alone."""
        a, b, c, d = np.moveaxis(rows, 1, 0)
        normal = cross(c - a, d - b)
        length = norm(normal)
        return (dot(b - a, normal) / np.where(length > TINY, length, 1.0))[:, None] / self.length

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (F, 1) and Jacobian (F, 1, 4, 3)."""
        a, b, c, d = np.moveaxis(rows, 1, 0)
        first, second, between = c - a, d - b, b - a
        normal = cross(first, second)
        length = norm(normal)
        normal = normal / np.where(length > TINY, length, 1.0)[:, None]
        # Closest points a + s first and b + t second.
        square = np.where(length > TINY, length, 1.0) ** 2
        s = dot(between, _reciprocal(first, second)) / square
        t = -dot(between, _reciprocal(second, first)) / square
        shares = np.stack([-(1.0 - s), 1.0 - t, -s, t], axis=1)
        jacobian = shares[:, None, :, None] * normal[:, None, None, :]
        return dot(between, normal)[:, None] / self.length, jacobian / self.length


@dataclass(frozen=True, eq=False)
class PolygonPlanarity:
    """Warps of each polygon of k > 4 corners over the mean edge length: k - 3 residuals.

    The heights h of the corners along the area vector always satisfy three equations,
    sum h = 0 and sum h_i (q_i+1 - q_i-1) = 0 with q across the vector, so a polygon has k - 3 ways
    to be out of plane. They are taken as the real Fourier coefficients of the heights with
    frequencies 2 to k - 2: orthonormal, so that no corner counts more than another, and
    independent on every face that is convex seen along its area vector (its first Fourier
    coefficient there cannot vanish, the discrete case of the theorem of Radó, Kneser and Choquet).
    Distances of diagonals of quads of corners are as many equations but worse conditioned the
    more corners there are. For a quad the one coefficient is the distance of its diagonals.
    """

    stencils: Mapping[str, Indices]
    modes: Floats
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, size: int = 5) -> PolygonPlanarity:
        """One element for each face with so many corners."""
        rows = corners_of_size(mesh, size)
        return cls({"vertices": rows}, warp_modes(size), mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, k - 3) and Jacobian (m, k - 3, k, 3)."""
        area, by_corner = area_vectors(rows)
        length = norm(area)
        safe = np.where(length > TINY, length, 1.0)[:, None]
        normal = area / safe
        out = rows - rows[:, :1]
        moments = np.einsum("rk,mki->mri", self.modes, out)
        value = np.einsum("mri,mi->mr", moments, normal)
        # d(normal) = what of d(area) lies across the normal, over the length.
        turning = (moments - value[..., None] * normal[:, None]) / safe[:, None]
        jacobian = self.modes[None, :, :, None] * normal[:, None, None]
        jacobian = jacobian + cross(by_corner[:, None], turning[:, :, None])
        return value / self.length, jacobian / self.length


def warp_modes(size: int) -> Floats:
    """Orthonormal Fourier vectors of frequencies 2 to size - 2, shape (size - 3, size)."""
    turn = 2.0 * np.pi * np.arange(size) / size
    rows = []
    for frequency in range(2, (size + 1) // 2):
        rows += [np.cos(frequency * turn), np.sin(frequency * turn)]
    rows = [np.sqrt(2.0 / size) * row for row in rows]
    if size % 2 == 0:
        rows.append((-1.0) ** np.arange(size) / np.sqrt(size))
    return np.array(rows).reshape(size - 3, size)


def area_vectors(rows: Floats) -> tuple[Floats, Floats]:
    """Vector areas (m, 3) of polygons (m, k, 3), and half chords e (m, k, 3) over each corner.

    Moving corner i by d changes the area by d x e_i.
    """
    chords = 0.5 * (np.roll(rows, -1, axis=1) - np.roll(rows, 1, axis=1))
    return 0.5 * cross(rows - rows[:, :1], chords).sum(axis=1), chords


def corners_of_size(mesh: PolyMesh, size: int) -> Indices:
    """Corners (n, size) of the faces with so many of them."""
    for _, corners in mesh.topology.face_groups:
        if corners.shape[1] == size:
            return corners
    return np.empty((0, size), dtype=np.int64)


def _reciprocal(p: Floats, q: Floats) -> Floats:
    """Q x (p x q) = p |q|^2 - q (p.q): part of p across q, times |q|^2."""
    return np.asarray(p * dot(q, q)[:, None] - q * dot(p, q)[:, None])
