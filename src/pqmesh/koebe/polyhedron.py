"""Koebe polyhedra: any polyhedral graph as a solid whose edges touch the unit sphere."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array

from pqmesh.errors import MeshError
from pqmesh.koebe.functional import log_radii
from pqmesh.koebe.layout import Rounds, centred, contacts, plane_pattern
from pqmesh.koebe.polish import polished
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, dot, norm

# Contact worse than this means that circles are too small for double precision.
CONTACT = 1e-9
# Edges whose contact is sent to infinity, one after the other, until the layout is precise enough.
MOST_TRIES = 4


def koebe_polyhedron(topology: Topology) -> PolyMesh:
    """Convex polyhedron of given combinatorics whose edges all touch the unit sphere.

    It exists for every polyhedral graph and is unique up to Moebius maps of the sphere. The one
    returned has the mean of its points of contact at the origin, which lies inside; a rotation is
    all that is left open. Normals point outwards: the orientation of the topology decides between
    the solid and its mirror image. The result is a `QuadMesh` when all faces are quads.

    Parameters
    ----------
    topology : Topology
        Of the sphere, 3-connected; faces of any length.

    Raises
    ------
    MeshError
        When the topology has a boundary, several pieces or holes, or is not 3-connected; or
        when its circles get too small for double precision.

    References: [bobenkospringborn2004], [springborn2005].

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> solid = koebe_polyhedron(cube().topology)
    >>> bool(np.allclose(solid.edge_lengths, 2.0**0.5))
    True
    """
    check_polyhedral(topology)
    rounds = Rounds.of(topology)
    edge = _edge_of_largest(topology)
    for _ in range(MOST_TRIES):
        logs = _radii_beside(topology, rounds, edge)
        circles, error = _on_sphere(topology, rounds, logs)
        if error < CONTACT:
            break
        edge = _edge_of_middle(topology, logs)
    if not error < CONTACT:
        raise MeshError(
            f"The circles must be large enough for double precision; contact stays at "
            f"{error:.3g}. Use a graph whose valences are more even."
        )
    circles = centred(circles, contacts(circles, topology.edges))
    vertices = circles[: topology.n_vertices]
    kind = QuadMesh if topology.is_quad else PolyMesh
    return kind(vertices[:, :3] / vertices[:, 3:], topology)


def tangency_deviation(mesh: PolyMesh) -> Floats:
    """Distance of each edge's line from the origin, less 1; shape (E,).

    Zero on all edges of a planar mesh: a Koebe mesh.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> bool(np.allclose(tangency_deviation(cube()), 2.0**0.5 - 1.0))
    True
    """
    along = mesh.edge_vectors / mesh.edge_lengths[:, None]
    foot = mesh.vertices[mesh.edges[:, 0]]
    return np.asarray(norm(foot - dot(foot, along)[:, None] * along) - 1.0)


def contact_points(mesh: PolyMesh) -> Floats:
    """Foot of the perpendicular from the origin to each edge's line, shape (E, 3).

    On a Koebe mesh these lie on the unit sphere, those of a face on one circle.
    """
    along = mesh.edge_vectors / mesh.edge_lengths[:, None]
    foot = mesh.vertices[mesh.edges[:, 0]]
    return np.asarray(foot - dot(foot, along)[:, None] * along)


def check_polyhedral(topology: Topology) -> None:
    """Refuse what is not the graph of a convex polyhedron, by the first reason found.

    On the sphere, 3-connected means: three edges or more at each vertex, and two faces share
    nothing, a vertex or an edge.

    References: theorem of Steinitz [ziegler1995].
    """
    open_edges = np.flatnonzero(topology.is_boundary_edge)
    if len(open_edges):
        a, b = topology.edges[open_edges[0]]
        raise MeshError(
            f"A polyhedron must be closed; edge {a}-{b} has one face ({len(open_edges)} such "
            f"edges). Close the mesh, or use koebe_disc for a disc."
        )
    pieces = int(topology.components.max()) + 1
    if pieces > 1:
        raise MeshError(f"A polyhedron must be one piece; found {pieces}. Take them one by one.")
    if topology.euler_characteristic != 2:
        raise MeshError(
            f"A polyhedron must have V - E + F = 2; found {topology.euler_characteristic}, that is "
            f"{1 - topology.euler_characteristic // 2} handles. Only meshes of sphere type have a "
            f"Koebe polyhedron."
        )
    thin = np.flatnonzero(topology.valence < 3)
    if len(thin):
        raise MeshError(
            f"A vertex of a polyhedron must have three edges; vertex {thin[0]} has "
            f"{topology.valence[thin[0]]} ({len(thin)} such vertices). Dissolve it."
        )
    _check_shared(topology)


def _check_shared(topology: Topology) -> None:
    """Refuse two faces that share more than a vertex or an edge."""
    shape = (topology.n_faces, topology.n_vertices)
    entries = (np.ones(len(topology.indices)), (topology.corner_faces, topology.indices))
    matrix = coo_array(entries, shape=shape).tocsr()
    shared = (matrix @ matrix.T).tocoo()
    pairs = np.column_stack([shared.row, shared.col])
    several = (pairs[:, 0] < pairs[:, 1]) & (shared.data > 1.5)
    size = np.int64(topology.n_faces)
    keys = np.sort(topology.edge_faces, axis=1) @ np.array([size, 1])
    pairs, counts = pairs[several], shared.data[several]
    proper = (counts < 2.5) & np.isin(pairs @ np.array([size, 1]), keys)
    if not proper.all():
        first = int(np.flatnonzero(~proper)[0])
        a, b = pairs[first].tolist()
        common = np.intersect1d(topology.face(a), topology.face(b)).tolist()
        raise MeshError(
            f"Two faces of a polyhedron must share nothing, a vertex or an edge; faces {a} and {b} "
            f"share the vertices {common}, so that the graph is not 3-connected. Merge these faces "
            f"or add edges."
        )


def _edge_of_largest(topology: Topology) -> int:
    """Edge whose point of contact goes to infinity: the one with the largest valences and faces.

    Their circles are the largest, and as lines they leave the others more alike.
    """
    weight = topology.valence[topology.edges].sum(axis=1)
    weight = weight + topology.face_sizes[topology.edge_faces].sum(axis=1)
    return int(weight.argmax())


def _edge_of_middle(topology: Topology, logs: Floats) -> int:
    """Edge whose circles are of the middle size in the plane, by logarithms.

    With its contact at infinity the largest and the smallest circles come to lie on the same side
    of the range, which is so cut in half.
    """
    known = np.where(np.isfinite(logs), logs, logs[np.isfinite(logs)].max())
    around = np.column_stack([topology.edges, topology.n_vertices + topology.edge_faces])
    middle = 0.5 * (known.min() + known.max())
    return int(np.abs(known[around].mean(axis=1) - middle).argmin())


def _radii_beside(topology: Topology, rounds: Rounds, edge: int) -> Floats:
    """Logarithms of all radii, infinite for the four circles of an edge, which are lines."""
    count = topology.n_vertices + topology.n_faces
    lines = np.concatenate([topology.edges[edge], topology.n_vertices + topology.edge_faces[edge]])
    inner = np.setdiff1d(np.arange(count), lines)
    number = np.full(count, -1, dtype=np.int64)
    number[inner] = np.arange(len(inner))
    pairs = number[rounds.corners]
    beside = (pairs >= 0).sum(axis=1) == 1
    # Seen from a circle, the kite with a line opens by pi.
    cut = np.bincount(pairs[beside].max(axis=1), minlength=len(inner))
    angles = np.asarray(np.pi * (2.0 - cut), dtype=np.float64)
    logs = np.full(count, np.inf)
    logs[inner] = log_radii(pairs[(pairs >= 0).all(axis=1)], angles)
    return logs


def _on_sphere(topology: Topology, rounds: Rounds, logs: Floats) -> tuple[Floats, float]:
    """Circles on the sphere in exact contact, and the error that remains."""
    pattern = plane_pattern(rounds, np.exp(logs)).centred(topology.edges)
    return polished(pattern.lifted(), rounds.corners, topology.edges)
