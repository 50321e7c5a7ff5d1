"""Offset meshes, what they achieve, and how far they go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.distances import (
    edge_distance,
    edge_factors,
    face_distance,
    parallel_error,
    valid_range,
    vertex_distance,
)
from pqmesh.offset.vectors import (
    OffsetVectors,
    face_offset_vectors,
    parallel_offset_vectors,
    vertex_offset_vectors,
)

__all__ = [
    "Layer",
    "edge_factors",
    "face_distance",
    "face_offset",
    "offset_layer",
    "offset_stack",
    "offset_vectors",
    "parallel_error",
    "valid_range",
    "vertex_distance",
    "vertex_offset",
]


MeshT = TypeVar("MeshT", bound=PolyMesh)


@dataclass(frozen=True, eq=False)
class Layer(Generic[MeshT]):
    """An offset mesh with its figures.

    Attributes
    ----------
    mesh : PolyMesh or QuadMesh
        As the base. Same topology object as the base: combinatorially equivalent, parallel edges.
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

    mesh: MeshT
    distance: float
    kind: str
    distance_error_max: float
    parallel_error_max: float
    parallel_error_boundary_max: float
    planarity_max: float
    first_reversed_edge_distance: float | None


def face_offset(mesh: MeshT, distance: float) -> MeshT:
    """Parallel mesh whose face planes lie at a constant signed distance.

    Exact for conical meshes; elsewhere the least-squares point of each star's shifted planes,
    and `face_distance` tells how far the distance varies.

    Parameters
    ----------
    mesh : PolyMesh
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


def vertex_offset(mesh: MeshT, distance: float) -> MeshT:
    """Parallel mesh whose vertices lie at a constant distance; exact for circular meshes.

    Parameters
    ----------
    mesh : PolyMesh
    distance : float, model unit
        Positive goes to the side of the vertex normals.

    References: [thesis] theorem 3.1.1 (1), section 3.2; errata page, E8, E10, E13.
    """
    return mesh.with_vertices(mesh.vertices + distance * vertex_offset_vectors(mesh).vectors)


def offset_vectors(mesh: PolyMesh, kind: str) -> OffsetVectors:
    """Offset vectors suited to a kind of mesh: face offsets where it is conical and circular."""
    makers = {
        "planar": parallel_offset_vectors,
        "conical": face_offset_vectors,
        "circular": vertex_offset_vectors,
        "conical-circular": face_offset_vectors,
    }
    if kind not in makers:
        raise MeshError(
            f"The kind of a mesh must be one of {', '.join(makers)}; found {kind!r}. Choose one."
        )
    return makers[kind](mesh)


def offset_layer(mesh: MeshT, vectors: OffsetVectors, distance: float) -> Layer[MeshT]:
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


def offset_stack(
    mesh: MeshT, vectors: OffsetVectors, distances: Sequence[float]
) -> tuple[Layer[MeshT], ...]:
    """Layers at several signed distances along the same offset vectors, in the order given.

    Any two of them are offsets of each other, at the difference of their distances.

    Parameters
    ----------
    mesh : PolyMesh
    vectors : OffsetVectors
    distances : sequence of float, model unit
        Each at most once, between the distances at which the first edges reverse.

    Raises
    ------
    MeshError
        For a distance given twice, or one beyond `valid_range`.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> stack = offset_stack(roof, face_offset_vectors(roof), [-0.1, 0.0, 0.2])
    >>> [round(float(face_distance(stack[0].mesh, layer.mesh).max()), 9) for layer in stack]
    [0.0, 0.1, 0.3]
    """
    low, high = valid_range(mesh, vectors.vectors)
    values = [float(distance) for distance in distances]
    for distance in values:
        if values.count(distance) > 1:
            raise MeshError(
                f"The layers of a stack must differ; distance {distance:g} was given "
                f"{values.count(distance)} times. Give each once."
            )
        if not low < distance < high:
            raise MeshError(
                f"A layer must lie where no edge is reversed, between {low:.6g} and {high:.6g}; "
                f"found {distance:g}. Give a smaller distance."
            )
    return tuple(offset_layer(mesh, vectors, distance) for distance in values)
