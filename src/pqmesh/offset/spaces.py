"""Which offsets a mesh has, how many, and the best one: by kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import circularity_defect, fitted_cones, planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.slides import parallel_slides, touching_vectors
from pqmesh.offset.parallel import ZERO_BAND, ZERO_FLOOR, check_edges
from pqmesh.offset.vectors import (
    reflections_from_root,
    starts_by_closing,
    vertex_offset_vectors,
)
from pqmesh.spectrum import low_spectrum
from pqmesh.vectors import Floats, cross, dot, norm

# A start vector of reflections that meets an edge at less than this sine collapses it.
COLLAPSED = 1e-6


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


def offset_space(mesh: PolyMesh, kind: str, tolerance: float = 1e-6) -> OffsetSpace:
    """Offsets of a kind that a mesh has, their number of parameters and the best of them.

    Parameters
    ----------
    mesh : PolyMesh
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
        raise MeshError(
            f"The kind of an offset must be one of {', '.join(SPACES)}; found {kind!r}. Choose "
            f"one; for edges there is edge_offset_space."
        )
    check_edges(mesh)
    return SPACES[kind](mesh, tolerance)


# --- faces ------------------------------------------------------------------------------------


def face_offset_space(mesh: PolyMesh, tolerance: float) -> OffsetSpace:
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
    touching = touching_vectors(mesh)
    slides, matrix = parallel_slides(mesh, touching)
    vectors = touching.vectors + slides
    dimension = _free_slides(matrix, flatness) if exists else None
    topology = mesh.topology
    normals = mesh.face_normals[topology.corner_faces]
    error = np.abs(dot(vectors[topology.indices], normals) - 1.0).max()
    return OffsetSpace(
        "face",
        exists,
        dimension,
        vectors,
        float(error),
        *turned_edges(mesh, vectors),
    )


def _free_slides(matrix: Any, flatness: float) -> int:
    """Number of ways the vertices can slide on their planes with all edges parallel."""
    if not matrix.shape[1]:
        return 0
    band = max(ZERO_BAND * flatness, ZERO_FLOOR)
    return int(np.count_nonzero(low_spectrum(matrix, band, 4).values <= band))


def turned_edges(mesh: PolyMesh, vectors: Floats) -> tuple[float, float]:
    """Largest move of one end of an edge against the other, across it: inner and boundary."""
    low, high = mesh.edges.T
    along = mesh.edge_vectors / mesh.edge_lengths[:, None]
    across = norm(cross(along, vectors[high] - vectors[low]))
    outer = mesh.topology.is_boundary_edge
    return float(across[~outer].max(initial=0.0)), float(across[outer].max(initial=0.0))


# --- vertices ---------------------------------------------------------------------------------


def vertex_offset_space(mesh: PolyMesh, tolerance: float) -> OffsetSpace:
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
        *turned_edges(mesh, best.vectors),
    )


# Kind -> its space; that of edges comes a stage later, as `koebe.edge_offset.edge_offset_space`.
SPACES: dict[str, Callable[[PolyMesh, float], OffsetSpace]] = {
    "vertex": vertex_offset_space,
    "face": face_offset_space,
}
