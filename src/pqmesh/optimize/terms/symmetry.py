"""Term: vertices that a rigid motion or a reflection maps onto each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices


@dataclass(frozen=True, eq=False)
class Symmetry:
    """Way from the image of one vertex to another vertex, over the mean edge.

    The map is x -> p + R (x - p) with an orthogonal matrix R.

    Attributes
    ----------
    matrix : (3, 3)
        R.
    point : (3,), model unit
        p, a point that stays.
    """

    stencils: Mapping[str, Indices]
    matrix: Floats
    point: Floats
    length: float

    @classmethod
    def on(cls, mesh: PolyMesh, pairs: Indices, matrix: Floats, point: Floats) -> Self:
        """One element for each pair (i, j) of different vertices, j to be the image of i."""
        return cls({"vertices": pairs}, matrix, point, mesh.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 3) and Jacobian (n, 3, 2, 3)."""
        away = rows - self.point
        value = away[:, 1] - away[:, 0] @ self.matrix.T
        block = np.stack([-self.matrix, np.eye(3)], axis=1) / self.length
        return value / self.length, np.broadcast_to(block, (len(rows), 3, 2, 3))
