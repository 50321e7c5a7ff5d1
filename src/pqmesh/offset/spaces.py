"""Which offsets a mesh has, how many, and the best one: by kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array

from pqmesh.errors import MeshError
from pqmesh.linear import low_spectrum
from pqmesh.mesh.measure import circularity_defect, common_vectors, fitted_cones, planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Stars
from pqmesh.offset.distances import KINDS
from pqmesh.offset.parallel import ZERO_BAND, ZERO_FLOOR, check_edges
from pqmesh.offset.vectors import (
    least_squares,
    reflections_from_root,
    starts_by_closing,
    vertex_offset_vectors,
)
from pqmesh.vectors import Floats, Indices, Mask, cross, dot, norm

# Normals closer together than this (radians) are one plane: the edge between them is flat.
FLAT_EDGE = 1e-7
# A start vector of reflections that meets an edge at less than this sine collapses it.
COLLAPSED = 1e-6
# Normals whose singular values fall below this share leave a vertex free to slide.
RANK = 1e-10


@dataclass(frozen=True, eq=False)
class OffsetSpace:
    """The offsets of one kind that a mesh has.

    Attributes
    ----------
    kind : 'vertex', 'edge' or 'face'
    exists : bool
        Whether the mesh has an offset of the kind, to the tolerance.
    family_dimension : int or None
        Dimension of the family of Gauss images; None when there is none.
    vectors : (V, 3)
        The best candidate as offset vectors s, so that M + d s is the offset at d; for a mesh
        without offset the one that comes nearest.
    error : float
        Largest deviation of its distance for each unit of offset: of |s| from 1, or of n_f . s;
        for vertices the gap that reflections leave, where it is larger.
    parallel_error, parallel_error_boundary : float
        How far the ends of an edge move apart across the edge for each unit of offset, inner and
        boundary edges apart.
    """

    kind: str
    exists: bool
    family_dimension: int | None
    vectors: Floats
    error: float
    parallel_error: float
    parallel_error_boundary: float


def offset_space(mesh: QuadMesh, kind: str, tolerance: float = 1e-6) -> OffsetSpace:
    """Offsets of a kind that a mesh has, their number of parameters and the best of them.

    Parameters
    ----------
    mesh : QuadMesh
        Without zero edges; for vertices in one piece.
    kind : str
        One of `SPACES`.
    tolerance : float
        Dimensionless; judges planarity and spread / theta (faces), planarity and balance of the
        faces (vertices).

    Raises
    ------
    MeshError
        For an unknown kind, an edge without length, or several pieces with kind 'vertex'.

    References: [thesis] theorem 3.1.1, sections 3.2 and 4.1; errata page, E10, E13 and E14.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> offset_space(roof, "face").family_dimension, offset_space(roof, "vertex").family_dimension
    (4, 2)
    """
    if kind not in SPACES:
        known = ", ".join(kind for kind in KINDS if kind in SPACES)
        raise MeshError(
            f"The kind of an offset must be one of {known}; found {kind!r}. Choose one."
        )
    check_edges(mesh)
    return SPACES[kind](mesh, tolerance)


# --- faces ------------------------------------------------------------------------------------


def face_offset_space(mesh: QuadMesh, tolerance: float) -> OffsetSpace:
    """Vectors s with n_f . s = 1 at every corner, and edges as parallel as can be.

    The condition leaves a vertex free along the directions that all its planes contain: where
    one or two planes meet on the boundary, and at vertices whose faces lie in one or two planes.
    Edges between different planes are parallel by themselves; every other edge asks for one
    linear equation of the slides of its ends. The family are the solutions of that system, in
    least squares: where its equations contradict each other (a side between two re-entrant
    corners) the face offset exists all the same, but a boundary edge stays unparallel.
    """
    cones = fitted_cones(mesh)
    flatness = float(planarity(mesh).max())
    exists = flatness <= tolerance and bool((cones.relative_spread <= tolerance).all())
    vectors, rows, directions = _touching_vectors(mesh, max(RANK, ZERO_BAND * flatness))
    edges = _unforced_edges(mesh)
    slides, dimension = _slides(mesh, vectors, rows, directions, edges, flatness)
    vectors = vectors + slides
    topology = mesh.topology
    normals = mesh.face_normals[topology.corner_faces]
    error = np.abs(dot(vectors[topology.indices], normals) - 1.0).max()
    return OffsetSpace(
        "face",
        exists,
        dimension if exists else None,
        vectors,
        float(error),
        *_turned(mesh, vectors),
    )


def _touching_vectors(mesh: QuadMesh, rank: float) -> tuple[Floats, Indices, Floats]:
    """Shortest s with n_f . s = 1 for all vertices; free directions (r, 3) and their vertices."""
    vectors = np.zeros((mesh.topology.n_vertices, 3))
    rows, directions = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    for is_boundary in (False, True):
        for star in mesh.topology.stars(boundary=is_boundary):
            found, free, axes = _star_freedom(mesh, star, rank)
            vectors[star.vertices] = found
            place, which = np.nonzero(free)
            rows.append(star.vertices[place])
            directions.append(axes[place, which])
    number = np.concatenate(rows)
    order = np.argsort(number, kind="stable")
    return vectors, number[order], np.concatenate(directions)[order]


def _star_freedom(mesh: QuadMesh, star: Stars, rank: float) -> tuple[Floats, Mask, Floats]:
    """Shortest vectors (n, 3), and which (n, 3) of the axes (n, 3, 3) leave all planes alone."""
    normals = mesh.face_normals[star.faces]
    missing = max(3 - normals.shape[1], 0)
    padded = np.concatenate([normals, np.zeros((len(normals), missing, 3))], axis=1)
    _, values, axes = np.linalg.svd(padded, full_matrices=False)
    return common_vectors(normals, rank), values <= rank * values[:, :1], axes


def _unforced_edges(mesh: QuadMesh) -> Indices:
    """Edges that planes do not force to stay parallel: boundary edges and flat ones."""
    topology = mesh.topology
    left, right = topology.edge_faces.T
    sine = norm(cross(mesh.face_normals[left], mesh.face_normals[right]))
    return np.flatnonzero(topology.is_boundary_edge | (sine < FLAT_EDGE))


def _slides(
    mesh: QuadMesh,
    vectors: Floats,
    rows: Indices,
    directions: Floats,
    edges: Indices,
    flatness: float,
) -> tuple[Floats, int]:
    """Smallest slides (V, 3) that make the edges parallel, and the dimension of all of them."""
    moves = np.zeros_like(vectors)
    if not len(rows):
        return moves, 0
    ends = mesh.edges[edges]
    face = mesh.topology.edge_faces[edges].max(axis=1)
    length = mesh.edge_lengths[edges][:, None]
    across = cross(mesh.face_normals[face], mesh.edge_vectors[edges] / length)
    across = across * (mesh.mean_edge_length / length)
    gap = dot(across, vectors[ends[:, 1]] - vectors[ends[:, 0]])
    first, last = np.searchsorted(rows, ends), np.searchsorted(rows, ends, side="right")
    entries = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
    for end, sign in ((0, -1.0), (1, 1.0)):
        for step in range(3):
            edge = np.flatnonzero(first[:, end] + step < last[:, end])
            column = first[edge, end] + step
            entries.append((edge, column, sign * dot(across[edge], directions[column])))
    edge, column, value = (np.concatenate(part) for part in zip(*entries, strict=True))
    matrix = coo_array((value, (edge, column)), (len(ends), len(rows)))
    amounts = least_squares(matrix, -gap)
    np.add.at(moves, rows, amounts[:, None] * directions)
    band = max(ZERO_BAND * flatness, ZERO_FLOOR)
    values = low_spectrum(matrix, band, 4).values
    return moves, int(np.count_nonzero(values <= band))


def _turned(mesh: QuadMesh, vectors: Floats) -> tuple[float, float]:
    """Largest move of one end of an edge against the other, across it: inner and boundary."""
    low, high = mesh.edges.T
    along = mesh.edge_vectors / mesh.edge_lengths[:, None]
    across = norm(cross(along, vectors[high] - vectors[low]))
    outer = mesh.topology.is_boundary_edge
    return float(across[~outer].max(initial=0.0)), float(across[outer].max(initial=0.0))


# --- vertices ---------------------------------------------------------------------------------


def vertex_offset_space(mesh: QuadMesh, tolerance: float) -> OffsetSpace:
    """Unit vectors s that each edge reflects into each other: the offsets of circular meshes.

    One unit vector at a vertex gives all others, and every loop of reflections must keep it: it
    lies in the common fixed space of these loops, so the family is a sphere of dimension 2, 1 or
    0. Starts at right angles to an edge collapse the edge of the image; a family in which every
    start does so is no offset (a prism over a quad without circumcircle).
    """
    best = vertex_offset_vectors(mesh, tolerance)
    maps, links, reflections = reflections_from_root(mesh)
    values, basis = starts_by_closing(maps, links, reflections)
    fixed = basis[:, values <= tolerance**2 * max(len(links), 1)]
    along = mesh.edge_vectors / mesh.edge_lengths[:, None]
    seen = np.einsum("eba,eb->ea", maps[links[:, 0]], along) @ fixed
    is_alive = bool(fixed.size) and bool((norm(seen) > COLLAPSED).all())
    is_circular = (
        float(planarity(mesh).max()) <= tolerance
        and float(np.abs(circularity_defect(mesh)).max()) <= tolerance
    )
    exists = is_circular and is_alive
    length = np.abs(norm(best.vectors) - 1.0).max()
    return OffsetSpace(
        "vertex",
        exists,
        fixed.shape[1] - 1 if exists else None,
        best.vectors,
        max(float(length), best.error),
        *_turned(mesh, best.vectors),
    )


# Kind -> its space; the edges of an offset at constant distance are entered by their own module.
SPACES: dict[str, Callable[[QuadMesh, float], OffsetSpace]] = {
    "vertex": vertex_offset_space,
    "face": face_offset_space,
}
