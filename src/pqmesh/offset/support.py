"""Geometric support structure: a flat web on every edge, between two layers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Indices, angle, cross, dot, norm, unit


@dataclass(frozen=True, eq=False)
class SupportStructure:
    """A quad over each edge, from one layer to another; all at a node share its axis.

    Attributes
    ----------
    quads : (E, 4, 3), model unit
        Lower layer i, j, then upper layer j, i, for each edge (i, j).
    edges : (E, 2)
    twist : (E,), radians
        Angle between the planes spanned by the edge and the node axes at its two ends.
    """

    quads: Floats
    edges: Indices
    twist: Floats

    @property
    def depths(self) -> Floats:
        """Distance of the upper from the lower side of each web, shape (E,), model unit.

        One number for all webs where the mesh has edge offsets: beams of one depth.
        """
        a, b, _, d = np.moveaxis(self.quads, 1, 0)
        return norm(cross(unit(b - a), d - a))

    @property
    def planarity_deviation(self) -> Floats:
        """Distance of the diagonals of each web, shape (E,), model unit."""
        a, b, c, d = np.moveaxis(self.quads, 1, 0)
        normal = cross(c - a, d - b)
        length = np.maximum(norm(normal), TINY)
        return np.asarray(np.abs(dot(b - a, normal)) / length)


def support_structure(
    mesh: PolyMesh, axes: Floats, lower: PolyMesh, upper: PolyMesh
) -> SupportStructure:
    """Webs between two layers of a mesh with given node axes (V, 3)."""
    i, j = mesh.edges[:, 0], mesh.edges[:, 1]
    quads = np.stack(
        [lower.vertices[i], lower.vertices[j], upper.vertices[j], upper.vertices[i]], axis=1
    )
    return SupportStructure(quads, mesh.edges, twist(mesh, axes))


def twist(mesh: PolyMesh, axes: Floats) -> Floats:
    """Angle between the planes (edge, axis) at the two ends of each edge, (E,), radians.

    References: torsion-free nodes [pottmann2007].
    """
    first = cross(mesh.edge_vectors, unit(axes[mesh.edges[:, 0]]))
    second = cross(mesh.edge_vectors, unit(axes[mesh.edges[:, 1]]))
    return angle(first, second)
