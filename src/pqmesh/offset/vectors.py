"""Offset vectors: how far and where each vertex moves when the offset distance is 1."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from pqmesh.errors import MeshError
from pqmesh.linear import SymmetricPattern
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.slides import parallel_slides, touching_vectors
from pqmesh.vectors import Floats, Indices, dot, norm, unit

# A loop of reflections that turns a vector by less than this closes.
CLOSING = 1e-9
# Weights of the face distance and of standing still, against parallel edges: small enough for
# quick convergence, each well above the rounding of the one before.
SOFT, TRACE = 1e-6, 1e-12


@dataclass(frozen=True, eq=False)
class OffsetVectors:
    """Vectors s with offset vertices v + d s: the discrete Gauss image of the offset pair.

    Attributes
    ----------
    kind : 'face', 'vertex', 'edge' or 'parallel'
        What stays constant: face, vertex or edge distance, or nothing but parallelism.
    vectors : (V, 3)
    error : float
        Largest deviation of the distance per unit of offset.
    """

    kind: str
    vectors: Floats
    error: float

    @property
    def axes(self) -> Floats:
        """Unit node axes, shape (V, 3)."""
        return unit(self.vectors)


# --- face offsets ---------------------------------------------------------------------------


def face_offset_vectors(mesh: PolyMesh) -> OffsetVectors:
    """Vectors w with n_f . w = 1 for every face at a vertex, edges parallel.

    Interior vertices have one such vector when the mesh is conical (least squares elsewhere).
    Where planes leave freedom, at the boundary and at vertices with flat edges, it is spent on
    parallel edges, one linear equation each, by least squares, and what is left over on the
    shortest vectors (`slides`). Sides between two re-entrant corners (holes, notches) are
    over-determined, so a parallel error may remain there.

    References: [pottmann2007]; errata page, E10 and E14; theory of boundary offsets.

    Examples
    --------
    >>> box = PolyMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> face_offset_vectors(box).vectors[0]
    array([0., 0., 1.])
    """
    touching = touching_vectors(mesh)
    vectors = touching.vectors + parallel_slides(mesh, touching)[0]
    topology = mesh.topology
    along = dot(vectors[topology.indices], mesh.face_normals[topology.corner_faces])
    return OffsetVectors("face", vectors, float(np.abs(along - 1.0).max()))


# --- vertex offsets -------------------------------------------------------------------------


def vertex_offset_vectors(mesh: PolyMesh, tolerance: float = CLOSING) -> OffsetVectors:
    """Unit vectors s with s_j = s_i - 2 (s_i . u) u along every edge: offsets of circular meshes.

    The reflections are chained over a spanning tree; the free start vector is the one whose
    images come nearest to the vertex normals among those that every loop maps to themselves.
    `error` is the largest gap over an edge: rounding error on circular discs, of order 1 where
    faces are not circular or a loop around a hole does not close. A loop of reflections closes
    when it turns vectors by less than the tolerance.

    References: [thesis] section 3.2; errata page, E13.
    """
    maps, links, reflections = reflections_from_root(mesh)
    i, j = links[:, 0], links[:, 1]
    values, basis = starts_by_closing(maps, links, reflections)
    kept = values <= tolerance**2 * max(len(links), 1)
    if not kept.any():
        kept = values == values.min()
    target = np.einsum("nji,nj->i", maps, mesh.vertex_normals)
    start = basis[:, kept] @ (basis[:, kept].T @ target)
    if norm(start) < 1e-12 * len(maps):
        start = basis[:, int(np.flatnonzero(kept)[0])]
    start = start / norm(start)
    vectors = np.einsum("nij,j->ni", maps, start)
    if dot(vectors, mesh.vertex_normals).sum() < 0:
        vectors = -vectors
    mirrored = np.einsum("nij,nj->ni", reflections, vectors[i])
    gap = float(norm(mirrored - vectors[j]).max(initial=0.0))
    return OffsetVectors("vertex", vectors, gap)


def starts_by_closing(maps: Floats, links: Indices, reflections: Floats) -> tuple[Floats, Floats]:
    """Start directions by how well the loops of reflections close.

    Parameters
    ----------
    maps, links, reflections
        From `reflections_from_root`.

    Returns
    -------
    (3,), (3, 3)
        Sums of squares, rising, by which all loops together move a start; and the starts as
        orthonormal columns. Those of value 0 give vertex offsets.
    """
    i, j = links[:, 0], links[:, 1]
    # Around each link that is not in the tree: R_j' * reflection * R_i must keep the start.
    loops = np.einsum("nba,nbc,ncd->nad", maps[j], reflections, maps[i]) - np.eye(3)
    values, basis = np.linalg.eigh(np.einsum("nba,nbc->ac", loops, loops))
    return values, basis


def reflections_from_root(mesh: PolyMesh) -> tuple[Floats, Indices, Floats]:
    """Products of the edges' reflections from vertex 0 to each vertex; edges, their reflections.

    Returns
    -------
    (V, 3, 3), (E, 2), (E, 3, 3)

    Raises
    ------
    MeshError
        For a mesh in several pieces.
    """
    n = mesh.topology.n_vertices
    edges = mesh.edges
    u = mesh.edge_vectors / mesh.edge_lengths[:, None]
    reflections = np.eye(3) - 2.0 * u[:, :, None] * u[:, None, :]
    place = {(a, b): k for k, (a, b) in enumerate(edges.tolist())}
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    maps = np.tile(np.eye(3), (n, 1, 1))
    order, before = breadth_first_order(graph, 0, directed=False)
    if len(order) < n:
        raise MeshError(
            f"A vertex offset needs a mesh in one piece; only {len(order)} of {n} vertices hang "
            f"together with vertex 0. Split the mesh into its pieces."
        )
    for vertex in order[1:].tolist():
        parent = int(before[vertex])
        edge = place[min(vertex, parent), max(vertex, parent)]
        maps[vertex] = reflections[edge] @ maps[parent]
    return maps, edges, reflections


# --- parallel meshes ------------------------------------------------------------------------


def parallel_offset_vectors(mesh: PolyMesh, *, rounds: int = 40) -> OffsetVectors:
    """Member s of P(M) nearest to n_f . s = 1: what a planar mesh offers as an offset.

    Equality-constrained least squares by multipliers on one factorisation; edges stay parallel
    to rounding error where the faces are planar, and `error` tells how far the face distance
    varies, to about 1e-8.

    References: [thesis] section 2.2; errata page, E5.
    """
    n = mesh.topology.n_vertices
    u = mesh.edge_vectors / mesh.edge_lengths[:, None]
    # e x (s_j - s_i) = 0 as the projection across e, in units of the edge length.
    across = (np.eye(3) - u[:, :, None] * u[:, None, :]) / mesh.edge_lengths[:, None, None]
    corners, faces = mesh.topology.indices, mesh.topology.corner_faces
    normals = mesh.face_normals[faces]
    three = np.arange(3)
    links = 3 * mesh.edges[:, :, None] + three
    links = links.reshape(len(links), 6)
    stiff = np.concatenate([-across, across], axis=2) * mesh.mean_edge_length
    soft_columns = 3 * corners[:, None] + three
    blocks = [(stiff, links, 1.0), (normals[:, None, :], soft_columns, SOFT)]
    rows = [np.repeat(columns, columns.shape[1], axis=1).ravel() for _, columns, _ in blocks]
    cols = [np.tile(columns, (1, columns.shape[1])).ravel() for _, columns, _ in blocks]
    # A trace, taken about the last s, keeps rounding out of the moves that no face sees.
    diagonal = np.arange(3 * n)
    pattern = SymmetricPattern(
        np.concatenate([*rows, diagonal]), np.concatenate([*cols, diagonal]), 3 * n
    )
    local = [
        scale * np.einsum("mra,mrb->mab", matrix, matrix).ravel() for matrix, _, scale in blocks
    ]
    values = pattern.values(np.concatenate([*local, np.full(3 * n, TRACE)]))
    factor = pattern.factor(values)
    ones = SOFT * np.bincount(soft_columns.ravel(), normals.ravel(), minlength=3 * n)
    forces, s = np.zeros((len(links), 3)), np.zeros(3 * n)
    for _ in range(rounds):
        pull = np.einsum("mra,mr->ma", stiff, forces)
        held = np.bincount(links.ravel(), pull.ravel(), minlength=3 * n)
        s = factor.solve(np.asarray(ones - held + TRACE * s, dtype=np.float64))
        forces = forces + np.einsum("mra,ma->mr", stiff, s[links])
    vectors = s.reshape(-1, 3)
    error = float(np.abs(dot(vectors[corners], normals) - 1.0).max())
    return OffsetVectors("parallel", vectors, error)
