"""Steiner's formula: areas of offset faces, and the mean and Gauss curvature of a face.

The area of a face with normal n is a quadratic form of its corners, A = 1/2 sum det(p_i, p_i+1, n).
Its polar form is the mixed area A(P, Q) of two parallel polygons, and

    A(P + d Q) = A(P) + 2 d A(P, Q) + d^2 A(Q) = (1 - 2 d H + d^2 K) A(P)

with H = -A(P, Q)/A(P) and K = A(Q)/A(P), where Q is the face of the Gauss image.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.distances import same_topology
from pqmesh.vectors import Floats, cross, dot, norm


class FaceCurvatures(NamedTuple):
    """Curvatures of the faces of a mesh with respect to a Gauss image.

    Attributes
    ----------
    mean : (F,), 1/model unit
        Positive where the mesh bends towards its normals.
    gauss : (F,), 1/model unit squared
    """

    mean: Floats
    gauss: Floats


def mixed_areas(mesh: PolyMesh, first: PolyMesh, second: PolyMesh) -> Floats:
    """Mixed areas A(P, Q) of corresponding faces, signed by the normals of `mesh`, shape (F,).

    Parameters
    ----------
    mesh : PolyMesh
        Planar; its normals are those of both others.
    first, second : PolyMesh
        Parallel to it. The mixed area of a face with itself is its area.

    References: [pottmann2007]; theory of mixed areas [schneider1993].

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> mixed_areas(cube(), cube(), cube().with_vertices(3.0 * cube().vertices))
    array([12., 12., 12., 12., 12., 12.])
    """
    same_topology(mesh, first)
    same_topology(mesh, second)
    topology = mesh.topology
    starts = topology.offsets[:-1]
    points = []
    for other in (first, second):
        # From a corner of the face, so that far-away origins cost no digits.
        base = other.vertices[topology.indices[starts]][topology.corner_faces]
        points.append(other.vertices[topology.indices] - base)
    p, q = points
    following = topology.corner_next
    products = cross(p, q[following]) + cross(q, p[following])
    sums = np.add.reduceat(products, starts, axis=0)
    return np.asarray(0.25 * dot(sums, mesh.face_normals))


def face_curvatures(mesh: PolyMesh, image: PolyMesh) -> FaceCurvatures:
    """Mean and Gauss curvature of every face from mixed areas.

    Parameters
    ----------
    mesh : PolyMesh
        Planar, faces with area.
    image : PolyMesh
        Its Gauss image: the vectors of a vertex, edge or face offset as vertices.

    Raises
    ------
    MeshError
        When a face has no area.

    References: [pottmann2007]; errata page, E10.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> ball = cube().with_vertices(2.0 * cube().vertices)
    >>> found = face_curvatures(ball, cube())
    >>> float(found.mean[0]), float(found.gauss[0])
    (-0.5, 0.25)
    """
    area = mixed_areas(mesh, mesh, mesh)
    empty = np.flatnonzero(area <= 1e-14 * norm(mesh.face_area_vectors).max())
    if len(empty):
        raise MeshError(
            f"Faces must have area to have curvature; face {empty[0]} has {area[empty[0]]:.3g} "
            f"({len(empty)} such faces). Remove or mend it."
        )
    mixed, own = mixed_areas(mesh, mesh, image), mixed_areas(mesh, image, image)
    return FaceCurvatures(np.asarray(-mixed / area), np.asarray(own / area))


def offset_areas(mesh: PolyMesh, image: PolyMesh, distance: float) -> Floats:
    """Signed face areas of the offset mesh + distance * image, by Steiner's formula, shape (F,).

    Negative where the offset face has turned over.
    """
    own = mixed_areas(mesh, mesh, mesh)
    twice = 2.0 * mixed_areas(mesh, mesh, image)
    return np.asarray(own + distance * (twice + distance * mixed_areas(mesh, image, image)))


def area_range(mesh: PolyMesh, image: PolyMesh) -> tuple[float, float]:
    """Distances between which no face has lost its area: (low <= 0, high >= 0), model unit.

    Never smaller than `valid_range` of the edges on convex faces; the limit of a stack is the
    smaller of the two.
    """
    mean, gauss = face_curvatures(mesh, image)
    # Roots of 1 - 2 d H + d^2 K, written for 1/d so that K = 0 needs no case of its own.
    inner = mean**2 - gauss
    real = inner >= 0.0
    root = np.sqrt(np.where(real, inner, 0.0))
    inverse = np.concatenate([(mean + root)[real], (mean - root)[real]])
    low = 1.0 / inverse[inverse < 0].min() if (inverse < 0).any() else -np.inf
    high = 1.0 / inverse[inverse > 0].max() if (inverse > 0).any() else np.inf
    return float(low), float(high)
