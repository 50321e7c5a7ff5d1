"""Term: edges of the mesh parallel to those of an image, or to the differences of node axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.terms.cone import Cone
from pqmesh.vectors import Floats, Indices, cross


@dataclass(frozen=True, eq=False)
class EdgeParallel:
    """Cross product of edges with their images, over the mean edges of both.

    Attributes
    ----------
    area : float
        Product of the two mean edges.

    References: parallel meshes, [thesis] definition 3.3.1.
    """

    stencils: Mapping[str, Indices]
    area: float

    @classmethod
    def on(cls, mesh: PolyMesh, image: PolyMesh) -> EdgeParallel:
        """One element for each edge; the block `image` has the vertices of the image."""
        area = mesh.mean_edge_length * image.mean_edge_length
        return cls({"vertices": mesh.edges, "image": mesh.edges}, area)

    @classmethod
    def between_axes(cls, mesh: PolyMesh, edges: Indices) -> EdgeParallel:
        """One element for each of some edges (n,): the axes of its ends lie in a plane with it.

        When faces of two planes meet at an edge it is so by itself. Where both faces lie in one
        plane the axes may be any that touch it, and the beam between them would be twisted.
        """
        ends = mesh.edges[edges]
        vertices = Cone.vertices(mesh, np.unique(ends))
        row = np.full(mesh.topology.n_vertices, -1)
        row[vertices] = np.arange(len(vertices))
        return cls({"vertices": ends, "axes": row[ends]}, mesh.mean_edge_length**2)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (E, 3) and Jacobian (E, 3, 4, 3)."""
        edge, other = rows[:, 1] - rows[:, 0], rows[:, 3] - rows[:, 2]
        by_edge, by_other = -_turning(other), _turning(edge)
        jacobian = np.stack([-by_edge, by_edge, -by_other, by_other], axis=2)
        return cross(edge, other) / self.area, jacobian / self.area


def _turning(a: Floats) -> Floats:
    """Matrices (n, 3, 3) of b -> a x b."""
    x, y, z = a.T
    zero = np.zeros(len(a))
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
