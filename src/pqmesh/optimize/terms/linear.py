"""Terms that are linear in the unknowns: holding edges, smoothness and places."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices


@dataclass(frozen=True, eq=False)
class Combination:
    """Weighted sums of k rows, compared with target vectors, over the mean edge length.

    Attributes
    ----------
    coefficients : (k,)
    targets : (m, 3), model unit
    length : float, model unit
    """

    stencils: Mapping[str, Indices]
    coefficients: Floats
    targets: Floats
    length: float

    @property
    def is_linear(self) -> bool:
        """The Jacobian is the coefficients."""
        return True

    def residual(self, rows: Floats) -> Floats:
        """Residuals (m, 3) alone."""
        return (np.tensordot(rows, self.coefficients, (1, 0)) - self.targets) / self.length

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, 3) and Jacobian (m, 3, k, 3)."""
        block = np.einsum("k,ij->ikj", self.coefficients, np.eye(3)) / self.length
        return self.residual(rows), np.broadcast_to(block, (len(rows), *block.shape))


def held_edges(mesh: PolyMesh) -> Combination:
    """Edge vectors stay as they are in the given mesh: panels keep size and direction."""
    return _relative(mesh, mesh.edges, np.array([-1.0, 1.0]))


def fairness(mesh: PolyMesh) -> Combination:
    """Second differences along mesh polylines stay as they are: no new wiggles, no shrinking."""
    return _relative(mesh, mesh.topology.straight_triples, np.array([1.0, -2.0, 1.0]))


def anchor(mesh: PolyMesh, vertices: Indices | None = None) -> Combination:
    """Vertices, or some of them, stay where they are."""
    rows = np.arange(mesh.topology.n_vertices) if vertices is None else vertices
    return _relative(mesh, rows[:, None], np.array([1.0]))


def _relative(mesh: PolyMesh, rows: Indices, coefficients: Floats) -> Combination:
    targets = np.einsum("k,mki->mi", coefficients, mesh.vertices[rows])
    return Combination({"vertices": rows}, coefficients, targets, mesh.mean_edge_length)
