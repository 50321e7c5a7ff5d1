"""Terms of the joint optimisation of a mesh (block `vertices`) and its Gauss image (`image`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, norm


@dataclass(frozen=True, eq=False)
class EdgeParallel:
    """Cross product of each edge with its image, over the mean edges of both meshes.

    Attributes
    ----------
    area : float
        Product of the two mean edges.
    """

    stencils: Mapping[str, Indices]
    area: float

    @classmethod
    def on(cls, mesh: QuadMesh, image: QuadMesh) -> EdgeParallel:
        """One element for each edge."""
        area = mesh.mean_edge_length * image.mean_edge_length
        return cls({"vertices": mesh.edges, "image": mesh.edges}, area)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (E, 3) and Jacobian (E, 3, 4, 3)."""
        edge, other = rows[:, 1] - rows[:, 0], rows[:, 3] - rows[:, 2]
        by_edge, by_other = -_turning(other), _turning(edge)
        jacobian = np.stack([-by_edge, by_edge, -by_other, by_other], axis=2)
        return cross(edge, other) / self.area, jacobian / self.area


@dataclass(frozen=True, eq=False)
class Tangency:
    """Distance of each image edge's line from the origin less 1, over the image's mean edge.

    References: Koebe mesh as Gauss image of edge offsets, errata page, E10 and E18.
    """

    stencils: Mapping[str, Indices]
    length: float

    @classmethod
    def on(cls, image: QuadMesh) -> Tangency:
        """One element for each edge."""
        return cls({"image": image.edges}, image.mean_edge_length)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (E, 1) and Jacobian (E, 1, 2, 3)."""
        a, b = rows[:, 0], rows[:, 1]
        edge, moment = b - a, cross(a, b)
        size = np.maximum(norm(moment), TINY)[:, None]
        long = np.maximum(norm(edge), TINY)[:, None]
        normal, distance = moment / size, size / long
        stretch = distance * edge / long**2
        by_a = cross(b, normal) / long + stretch
        by_b = cross(normal, a) / long - stretch
        jacobian = np.stack([by_a, by_b], axis=1)[:, None]
        return (distance - 1.0) / self.length, jacobian / self.length


def _turning(a: Floats) -> Floats:
    """Matrices (n, 3, 3) of b -> a x b."""
    x, y, z = a.T
    zero = np.zeros(len(a))
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
