"""Faults of a start mesh: its broken faces, and what the valid faces around say of them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Topology
from pqmesh.optimize.guard import BENT_BACK, NO_AREA, least_sines
from pqmesh.vectors import TINY, Floats, Mask, dot, norm, unit

# An edge below this share of the longest of its face has collapsed.
COLLAPSED = 1e-4
# Rounds in which normals and sizes spread from valid faces into what is broken.
ROUNDS = 12


def broken_faces(mesh: PolyMesh) -> Mask:
    """Faces (F,) that are folded, darts or crossed, without area, or have a collapsed edge.

    Re-entrant corners of polygons with more than four corners are no fault (`least_sines`).

    Examples
    --------
    >>> dart = PolyMesh.of([[0, 0, 0], [1, 0, 0], [0.2, 0.2, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> broken_faces(dart)
    array([ True])
    """
    topology = mesh.topology
    lengths = mesh.edge_lengths[topology.face_edges]
    longest = np.maximum.reduceat(lengths, topology.offsets[:-1])
    shortest = np.minimum.reduceat(lengths, topology.offsets[:-1])
    flat = norm(mesh.face_area_vectors) <= NO_AREA * longest**2
    return np.asarray(
        (least_sines(mesh) < BENT_BACK) | flat | (shortest < COLLAPSED * longest), dtype=np.bool_
    )


# --- what surrounds the faults ----------------------------------------------------------------


class Surround(NamedTuple):
    """What valid faces say of the broken ones.

    Attributes
    ----------
    normals : (F, 3)
        Of valid faces their own.
    sizes : (V,)
        Square of a typical edge.
    umbrellas : (V, 3), model unit
        A vertex less the mean of its neighbours.
    """

    normals: Floats
    sizes: Floats
    umbrellas: Floats


def faulty(mesh: PolyMesh) -> Mask:
    """Broken faces, and those beside them that lie on their backs."""
    fault = broken_faces(mesh)
    if not fault.any():
        return fault
    topology = mesh.topology
    suspect = faces_touching(topology, corners_of(topology, fault))
    # Judged by the faces behind them, where these meet at a corner.
    around = face_means(topology, _vertex_sums(topology, mesh.face_normals, ~suspect))
    return np.asarray(fault | (suspect & (dot(around, mesh.face_normals) < 0)))


def surroundings(mesh: PolyMesh, fault: Mask) -> Surround:
    """Normals, sizes and umbrellas spread from what is valid."""
    topology = mesh.topology
    links = _links(topology)
    sums = _vertex_sums(topology, mesh.face_normals, ~fault)
    spread = unit(_spread(links, sums, norm(sums) > 0))
    means = face_means(topology, spread)
    # A piece all of whose faces are broken has its own word only.
    means = np.where(norm(means)[:, None] > TINY, unit(means), mesh.face_normals)
    normals = np.where(fault[:, None], means, mesh.face_normals)
    # What is beside a fault is stretched: better to ask those behind it, where there are any.
    beside = faces_touching(topology, corners_of(topology, fault))
    asked = fault if beside.all() else beside
    # Square of the edge of a regular face of the same area.
    size = topology.face_sizes
    squares = 4.0 * np.tan(np.pi / size) / size * norm(mesh.face_area_vectors)
    content = np.column_stack([squares, np.ones(topology.n_faces)])
    totals = _vertex_sums(topology, content, ~asked)
    means = _spread(links, totals / np.maximum(totals[:, 1:], 1.0), totals[:, 1] > 0)
    ends = topology.edges.ravel()
    own = np.bincount(ends, np.repeat(mesh.edge_lengths, 2)) / np.bincount(ends)
    sizes = np.where(means[:, 0] > TINY, means[:, 0], own**2)
    everywhere = np.ones(topology.n_vertices, dtype=np.bool_)
    umbrellas = mesh.vertices - umbrella_means(topology, everywhere) @ mesh.vertices
    rim = topology.is_boundary_vertex
    clean = ~corners_of(topology, asked)
    inside = _spread(links, umbrellas, clean & ~rim)
    along = np.where(clean[:, None], umbrellas, 0.0)
    return Surround(normals, sizes, np.where(rim[:, None], along, inside))


def _vertex_sums(topology: Topology, values: Floats, faces: Mask) -> Floats:
    """Sums over the chosen faces at each vertex, (V, n)."""
    chosen = faces[topology.corner_faces]
    sums = np.zeros((topology.n_vertices, values.shape[1]))
    np.add.at(sums, topology.indices[chosen], values[topology.corner_faces[chosen]])
    return sums


def face_means(topology: Topology, values: Floats) -> Floats:
    """Means over the corners of each face, (F, n)."""
    sums = np.add.reduceat(values[topology.indices], topology.offsets[:-1], axis=0)
    return np.asarray(sums / topology.face_sizes[:, None])


def _spread(links: Any, values: Floats, known: Mask) -> Floats:
    """Values of the known vertices, carried on to the others as means of neighbours."""
    values = np.where(known[:, None], values, 0.0)
    for _ in range(ROUNDS):
        if known.all():
            break
        count = links @ known.astype(np.float64)
        fresh = ~known & (count > 0)
        values[fresh] = (links @ values)[fresh] / count[fresh, None]
        known = known | fresh
    return values


def _links(topology: Topology) -> Any:
    """Adjacency of the vertices along edges, sparse (V, V)."""
    n, (low, high) = topology.n_vertices, topology.edges.T
    rows, columns = np.concatenate([low, high]), np.concatenate([high, low])
    return csr_array(coo_array((np.ones(len(rows)), (rows, columns)), shape=(n, n)))


def umbrella_means(topology: Topology, chosen: Mask) -> Any:
    """Mean of the neighbours, sparse (V, V): along the boundary for a boundary vertex."""
    n, rim = topology.n_vertices, topology.is_boundary_vertex
    edges = np.concatenate([topology.edges, topology.edges[:, ::-1]])
    outer = np.concatenate([topology.is_boundary_edge] * 2)
    kept = chosen[edges[:, 0]] & (outer | ~rim[edges[:, 0]])
    rows, columns = edges[kept].T
    count = np.bincount(rows, minlength=n)
    return csr_array(coo_array((1.0 / count[rows], (rows, columns)), shape=(n, n)))


def corners_of(topology: Topology, faces: Mask) -> Mask:
    """Vertices (V,) of the faces."""
    found = np.zeros(topology.n_vertices, dtype=np.bool_)
    found[topology.indices[faces[topology.corner_faces]]] = True
    return found


def faces_touching(topology: Topology, vertices: Mask) -> Mask:
    """Faces (F,) with such a vertex."""
    return np.asarray(np.logical_or.reduceat(vertices[topology.indices], topology.offsets[:-1]))
