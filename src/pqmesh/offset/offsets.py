"""Offset meshes, what they achieve, and how far they go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.vectors import (
    OffsetVectors,
    face_offset_vectors,
    parallel_offset_vectors,
    vertex_offset_vectors,
)
from pqmesh.vectors import Floats, cross, dot, norm, unit

# Lines at an angle of a smaller sine have no common perpendicular to speak of.
PARALLEL_LINES = 1e-6


@dataclass(frozen=True, eq=False)
class Layer:
    """An offset mesh with its figures.

    Attributes
    ----------
    mesh : QuadMesh
        Same topology object as the base: combinatorially equivalent, parallel edges.
    distance : float, model unit
        Signed, along the face normals.
    kind : 'face', 'vertex', 'edge' or 'parallel'
    distance_error_max : float, model unit
        Largest deviation from the distance: of face planes, of vertices, or of edges' lines.
    parallel_error_max, parallel_error_boundary_max : float
        Largest sine between an edge and its offset, interior and boundary edges apart.
    planarity_max : float
        Of the offset mesh, diagonal distance over mean diagonal.
    first_reversed_edge_distance : float or None, model unit
        Distance on this side at which the first edge shrinks to a point; None when none does.
    """

    mesh: QuadMesh
    distance: float
    kind: str
    distance_error_max: float
    parallel_error_max: float
    parallel_error_boundary_max: float
    planarity_max: float
    first_reversed_edge_distance: float | None


def face_offset(mesh: QuadMesh, distance: float) -> QuadMesh:
    """Parallel mesh whose face planes lie at a constant signed distance.

    Exact for conical meshes; elsewhere the least-squares point of each star's shifted planes,
    and `face_distance` tells how far the distance varies.

    Parameters
    ----------
    mesh : QuadMesh
        Oriented; normals decide the sign of `distance`.
    distance : float, model unit
        Along the face normals; negative goes to the other side.

    References: [thesis] theorem 3.1.1 (3) with erratum E10; [pottmann2007].

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> bool(np.ptp(face_distance(roof, face_offset(roof, 0.2))) < 1e-12)
    True
    """
    return mesh.with_vertices(mesh.vertices + distance * face_offset_vectors(mesh).vectors)


def vertex_offset(mesh: QuadMesh, distance: float) -> QuadMesh:
    """Parallel mesh whose vertices lie at a constant distance; exact for circular meshes.

    Parameters
    ----------
    mesh : QuadMesh
    distance : float, model unit
        Positive goes to the side of the vertex normals.

    References: [thesis] theorem 3.1.1 (1), section 3.2; errata page, E8, E10, E13.
    """
    return mesh.with_vertices(mesh.vertices + distance * vertex_offset_vectors(mesh).vectors)


def offset_vectors(mesh: QuadMesh, kind: str) -> OffsetVectors:
    """Offset vectors suited to a mesh of the given kind: planar, conical or circular."""
    if kind == "conical":
        return face_offset_vectors(mesh)
    if kind == "circular":
        return vertex_offset_vectors(mesh)
    return parallel_offset_vectors(mesh)


def offset_layer(mesh: QuadMesh, vectors: OffsetVectors, distance: float) -> Layer:
    """Layer at a signed distance along given offset vectors, measured."""
    moved = mesh.with_vertices(mesh.vertices + distance * vectors.vectors)
    if vectors.kind == "vertex":
        reached = np.abs(vertex_distance(mesh, moved) - abs(distance))
    elif vectors.kind == "edge":
        reached = np.abs(edge_distance(mesh, moved) - abs(distance))
    else:
        reached = np.abs(face_distance(mesh, moved) - distance)
    sines = parallel_error(mesh, moved)
    outer = mesh.topology.is_boundary_edge
    low, high = valid_range(mesh, vectors.vectors)
    bound = high if distance >= 0 else low
    return Layer(
        mesh=moved,
        distance=distance,
        kind=vectors.kind,
        distance_error_max=float(reached.max()),
        parallel_error_max=float(sines[~outer].max(initial=0.0)),
        parallel_error_boundary_max=float(sines[outer].max(initial=0.0)),
        planarity_max=float(planarity(moved).max()),
        first_reversed_edge_distance=float(bound) if np.isfinite(bound) else None,
    )


# --- distances ------------------------------------------------------------------------------


def face_distance(mesh: QuadMesh, other: QuadMesh) -> Floats:
    """Signed distances n_f . (v' - v) at the corners of each face, shape (F, 4), model unit.

    For parallel meshes the four agree: the distance d_f of the carrier planes.

    References: [thesis] definition 2.3.1; signed, errata page, E7.
    """
    moves = other.vertices - mesh.vertices
    return dot(moves[mesh.faces], mesh.face_normals[:, None])


def vertex_distance(mesh: QuadMesh, other: QuadMesh) -> Floats:
    """Distances of corresponding vertices, shape (V,), model unit."""
    return norm(other.vertices - mesh.vertices)


def edge_distance(mesh: QuadMesh, other: QuadMesh) -> Floats:
    """Distances d_e of the carrier lines of corresponding edges, shape (E,), model unit.

    For parallel lines that of a point of one from the other; where they enclose an angle whose
    sine exceeds 1e-6, the length of their common perpendicular.

    References: [thesis] definition 2.3.1; lines, not segments, errata page, E7.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> bool(np.allclose(edge_distance(cube(), cube().with_vertices(2 * cube().vertices)), 2**0.5))
    True
    """
    first, second = unit(mesh.edge_vectors), unit(other.edge_vectors)
    moves = other.vertices - mesh.vertices
    i, j = mesh.edges[:, 0], mesh.edges[:, 1]
    # The mean of the moves at both ends favours neither, should the lines be skew by a little.
    between = 0.5 * (moves[i] + moves[j])
    normal = cross(first, second)
    sine = norm(normal)
    skew = sine > PARALLEL_LINES
    common = np.abs(dot(between, normal)) / np.where(skew, sine, 1.0)
    return np.where(skew, common, norm(cross(between, first)))


def parallel_error(mesh: QuadMesh, other: QuadMesh) -> Floats:
    """Sine between corresponding edges, shape (E,)."""
    product = norm(cross(mesh.edge_vectors, other.edge_vectors))
    return np.asarray(product / np.maximum(mesh.edge_lengths * other.edge_lengths, 1e-300))


def edge_factors(mesh: QuadMesh, vectors: Floats) -> Floats:
    """Change kappa_e of each edge per unit of offset, e(d) = (1 + d kappa_e) e; shape (E,)."""
    i, j = mesh.edges[:, 0], mesh.edges[:, 1]
    return np.asarray(dot(vectors[j] - vectors[i], mesh.edge_vectors) / mesh.edge_lengths**2)


def valid_range(mesh: QuadMesh, vectors: Floats) -> tuple[float, float]:
    """Offset distances between which no edge reverses: (low <= 0, high >= 0), model unit.

    Edges turn at the focal set of the surface; self-intersection further apart is not judged.
    """
    factors = edge_factors(mesh, vectors)
    low = -1.0 / factors[factors > 0].max() if (factors > 0).any() else -np.inf
    high = -1.0 / factors[factors < 0].min() if (factors < 0).any() else np.inf
    return float(low), float(high)
