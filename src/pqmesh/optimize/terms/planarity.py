"""Term: every quad flat."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
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
    def on(cls, mesh: QuadMesh) -> Planarity:
        """One element for each face."""
        return cls({"vertices": mesh.faces}, mesh.mean_edge_length)

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


def _reciprocal(p: Floats, q: Floats) -> Floats:
    """Q x (p x q) = p |q|^2 - q (p.q): part of p across q, times |q|^2."""
    return np.asarray(p * dot(q, q)[:, None] - q * dot(p, q)[:, None])
