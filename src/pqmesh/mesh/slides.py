"""Slides: what planes at given distances leave free at a vertex, spent on parallel edges.

The planes n_f . s = 1 of the faces at a vertex leave it free along the directions that all of them
contain: in a plane where one face ends, along a line where two planes meet, and at inner vertices
whose faces lie in one or two planes. An edge between two different planes stays parallel whatever
its ends do. Every other edge, on the boundary or between faces of one plane, asks for one linear
equation of the slides of its ends.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array

from pqmesh.linear import SymmetricPattern
from pqmesh.mesh.measure import common_vectors, planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Stars
from pqmesh.vectors import TINY, Floats, Indices, Mask, cross, dot, norm

# Normals closer together than this (radians) are one plane: the edge between them is flat.
FLAT_EDGE = 1e-7
# Normals with a relative singular value below this leave a direction free; where faces are out
# of plane, so many times their planarity does.
FREE, NOISE, EPSILON = 1e-10, 10.0, float(np.finfo(np.float64).eps)
# Ridge of a least-squares solution over its largest diagonal entry, and the most rounds without.
RIDGE, ROUNDS, CLOSED = 1e-8, 60, 1e-15


class Touching(NamedTuple):
    """Vectors with n_f . s = 1 for all faces at each vertex, and what they leave free.

    Attributes
    ----------
    vectors : (V, 3)
        The shortest ones, in least squares where a vertex is not conical.
    vertices : (r,)
        Of each free direction, rising: none, one, two or all three at a vertex.
    directions : (r, 3)
        Orthonormal at each vertex.
    """

    vectors: Floats
    vertices: Indices
    directions: Floats


def touching_vectors(mesh: PolyMesh) -> Touching:
    """Shortest vectors that touch the planes of all faces at each vertex, and the freedom left.

    References: theory of face offsets [pottmann2007]; errata page, E14.

    Examples
    --------
    >>> box = PolyMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> found = touching_vectors(box)
    >>> found.vectors[0], found.vertices.tolist()
    (array([0., 0., 1.]), [0, 0, 1, 1, 2, 2, 3, 3])
    """
    rank = max(FREE, NOISE * float(planarity(mesh).max()))
    vectors = np.zeros((mesh.topology.n_vertices, 3))
    vertices, directions = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for is_boundary in (False, True):
        for star in mesh.topology.stars(boundary=is_boundary):
            vectors[star.vertices], free, axes = _star_freedom(mesh, star, rank)
            place, which = np.nonzero(free)
            vertices.append(star.vertices[place])
            directions.append(axes[place, which])
    number = np.concatenate(vertices)
    order = np.argsort(number, kind="stable")
    return Touching(vectors, number[order], np.concatenate(directions)[order])


def _star_freedom(mesh: PolyMesh, star: Stars, rank: float) -> tuple[Floats, Mask, Floats]:
    """Shortest vectors (n, 3), and which (n, 3) of the axes (n, 3, 3) leave all planes alone."""
    normals = mesh.face_normals[star.faces]
    missing = max(3 - normals.shape[1], 0)
    padded = np.concatenate([normals, np.zeros((len(normals), missing, 3))], axis=1)
    _, values, axes = np.linalg.svd(padded, full_matrices=False)
    return common_vectors(normals, rank), values <= rank * values[:, :1], axes


def parallel_slides(mesh: PolyMesh, touching: Touching) -> tuple[Floats, Any]:
    """Smallest slides that make edges as parallel as can be, and their equations.

    Parameters
    ----------
    mesh : PolyMesh
        Without zero edges.
    touching : Touching

    Returns
    -------
    (V, 3), sparse (n, r)
        The matrix takes the amounts of the free directions to the turns of the edges that planes
        do not keep parallel: its null space are the families of offsets.
    """
    matrix, gap = edge_equations(mesh, touching, _unforced_edges(mesh))
    slides = np.zeros_like(touching.vectors)
    if matrix.nnz:
        amounts = least_squares(matrix, -gap)
        np.add.at(slides, touching.vertices, amounts[:, None] * touching.directions)
    return slides, matrix


def edge_equations(mesh: PolyMesh, touching: Touching, edges: Indices) -> tuple[coo_array, Floats]:
    """Turn of some edges (n,) by the free directions, sparse (n, r), and by the vectors, (n,).

    Sines over lengths in mean edges: an edge stays parallel where both together are 0.
    """
    vectors, vertices, directions = touching
    ends = mesh.edges[edges]
    face = mesh.topology.edge_faces[edges].max(axis=1)
    length = mesh.edge_lengths[edges][:, None]
    across = cross(mesh.face_normals[face], mesh.edge_vectors[edges] / length)
    across = across * (mesh.mean_edge_length / length)
    gap = dot(across, vectors[ends[:, 1]] - vectors[ends[:, 0]])
    first = np.searchsorted(vertices, ends)
    last = np.searchsorted(vertices, ends, side="right")
    entries = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
    for end, sign in ((0, -1.0), (1, 1.0)):
        for step in range(3):
            edge = np.flatnonzero(first[:, end] + step < last[:, end])
            column = first[edge, end] + step
            entries.append((edge, column, sign * dot(across[edge], directions[column])))
    edge, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    return coo_array((value, (edge, column)), (len(ends), len(vertices))), gap


def _unforced_edges(mesh: PolyMesh) -> Indices:
    """Edges that planes do not force to stay parallel: boundary edges and flat ones."""
    return np.flatnonzero(mesh.topology.is_boundary_edge | (fold_sines(mesh) < FLAT_EDGE))


def fold_sines(mesh: PolyMesh) -> Floats:
    """Sine of the angle between the normals on both sides of each edge, (E,)."""
    left, right = mesh.topology.edge_faces.T
    return norm(cross(mesh.face_normals[left], mesh.face_normals[right]))


def least_squares(matrix: coo_array, target: Floats) -> Floats:
    """Shortest least-squares solution x of a sparse matrix.

    Conjugate gradients on the normal equations, whose factor with a small ridge leaves them few
    rounds: singular values that the ridge hides are found as well. Rounds that solve for the
    remainder with the ridge then leave no rounding of the normal equations in the result.
    """
    rows = matrix.tocsr()
    normal = (rows.T @ rows).tocoo()
    size = rows.shape[1]
    diagonal = np.arange(size)
    pattern = SymmetricPattern(
        np.concatenate([normal.row, diagonal]), np.concatenate([normal.col, diagonal]), size
    )
    ridge = np.full(size, RIDGE * max(float(normal.diagonal().max(initial=0.0)), TINY))
    factor = pattern.factor(pattern.values(np.concatenate([normal.data, ridge])))
    x, left = np.zeros(size), target
    step, before = np.zeros(size), np.inf
    for _ in range(ROUNDS):
        slope = np.asarray(rows.T @ left)
        downhill = factor.solve(slope)
        product = float(slope @ downhill)
        step, before = downhill + product / before * step, product
        change = rows @ step
        square = float(change @ change)
        # Beyond this, rounding leads along what the matrix does not see.
        if not product**2 > EPSILON * square * float(left @ left):
            break
        x, left = x + product / square * step, left - product / square * change
    for _ in range(ROUNDS):
        step = factor.solve(np.asarray(rows.T @ (target - rows @ x)))
        x = x + step
        if norm(step) <= CLOSED * norm(x):
            break
    return x
