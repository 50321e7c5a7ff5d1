"""Terms of the joint optimisation of a mesh (block `vertices`) and its Gauss image (`image`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, norm


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
