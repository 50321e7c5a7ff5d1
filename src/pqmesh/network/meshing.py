"""From a curve network to the quad mesh that the optimiser starts with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.mesh.measure import corner_angles
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.network.curves import CurveNetwork
from pqmesh.network.quads import cells, filled, manifold_part, touching
from pqmesh.network.walker import Inside
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, Indices, Mask, dot, norm, unit

# A quad is left out when a corner is outside this range, or an edge is shorter than this share
# of the median edge: the network is not usable there.
CORNER_RANGE = np.radians([15.0, 165.0])
LEAST_EDGE = 0.05


@dataclass(frozen=True, eq=False)
class NetworkMesh:
    """A quad mesh of network crossings.

    Attributes
    ----------
    mesh : QuadMesh
        Normals follow X_u x X_v of the surface.
    uv : (V, 2)
        Parameters of its vertices.
    unusable : int
        Quads left out because the network degenerates there.
    separate : int
        Usable quads of the region left out because they hang together with the largest piece by
        no edge.
    """

    mesh: QuadMesh
    uv: Floats
    unusable: int
    separate: int


def quads_from_network(network: CurveNetwork, inside: Inside | None = None) -> NetworkMesh:
    """All-quad mesh of the network's cells that reach into the region.

    Rows and columns are filled until the mesh is row- and column-convex where the surface
    allows, since a boundary side between two re-entrant corners costs the parallel boundary
    edges of the offsets. Where the network falls apart, its largest piece is taken.

    Raises
    ------
    NetworkError
        When no usable quad reaches into the region.
    """
    quads = cells(network.found, *network.families)
    surface = network.surface
    usable = _usable(network, quads)
    chosen = usable.copy()
    if inside is not None and len(quads):
        chosen &= touching(quads, network.found.uv, surface.domain, inside)
    wanted = int(chosen.sum())
    chosen = filled(quads, chosen, usable)
    kept = manifold_part(quads, chosen)
    if not kept.any():
        raise NetworkError(
            f"The network must have at least one usable quad in the region; its "
            f"{len(network.found)} crossings give {len(quads)} quads, {int(usable.sum())} usable, "
            f"{wanted} in the region. Choose a shorter edge length."
        )
    faces = quads[kept]
    used, corners = np.unique(faces, return_inverse=True)
    mesh = QuadMesh.of(network.points[used], corners.reshape(-1, 4))
    separate = int((chosen & ~kept).sum())
    return NetworkMesh(mesh, network.found.uv[used], int((~usable).sum()), separate)


def _usable(network: CurveNetwork, quads: Indices) -> Mask:
    """Quads of sound shape, facing as the surface does."""
    if not len(quads):
        return np.zeros(0, dtype=np.bool_)
    points = network.points[quads]
    normals = shape_data(network.surface.jet(network.found.uv[quads[:, 0]])).normal
    soup = PolyMesh.of(points.reshape(-1, 3), np.arange(quads.size).reshape(-1, 4))
    angles = corner_angles(soup).reshape(-1, 4)
    good = ((angles > CORNER_RANGE[0]) & (angles < CORNER_RANGE[1])).all(axis=1)
    good &= dot(unit(soup.face_area_vectors), normals) > 0.5
    edges = norm(points - np.roll(points, -1, axis=1))
    good &= edges.min(axis=1) > LEAST_EDGE * np.median(edges)
    return np.asarray(good)
