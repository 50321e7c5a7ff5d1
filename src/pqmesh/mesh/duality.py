"""Contact elements: circular meshes that belong to a conical mesh, the way back from `exact`.

A contact element is a point with a plane through it. The vertices of a circular mesh with normals
propagated by reflection are contact elements whose planes form a conical mesh
(`contact_element_mesh`); the faces of a conical mesh carry points that reflect into each other, and
these are the vertices of a circular mesh (`contact_point_mesh`). Either way has two parameters.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import PARALLEL_DIAGONALS
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import drop_unused
from pqmesh.vectors import Floats, Indices, cross, dot, norm, unit


def propagated_points(mesh: PolyMesh, start: ArrayLike, root: int = 0) -> tuple[Floats, float]:
    """Points in the face planes, each the mirror image of its neighbours', and their gap.

    The mirror of an edge is the plane through it that reflects one of its faces' planes into the
    other, normal to normal. It contains the axes at both ends of the edge when the mesh is
    conical, so that the points around an interior vertex close, on a circle about the axis.

    Parameters
    ----------
    mesh : PolyMesh
        Conical and connected over its edges.
    start : (3,), model unit
        Point of face `root`; it is put into the plane of the face.
    root : int

    Returns
    -------
    (F, 3), float, model unit
        The gap is the largest distance of a point from the image of a neighbour: rounding error
        on conical discs, more where vertices are not conical or a loop does not close.

    Raises
    ------
    MeshError
        For a mesh in several pieces.
    """
    topology = mesh.topology
    inner = np.flatnonzero(~topology.is_boundary_edge)
    left, right = topology.edge_faces[inner].T
    base = mesh.vertices[topology.edges[inner, 0]]
    mirrors = _mirrors(mesh, inner)
    size = topology.n_faces
    graph = coo_array((np.arange(1, len(inner) + 1), (left, right)), shape=(size, size)).tocsr()
    order, before = breadth_first_order(graph, root, directed=False)
    if len(order) < size:
        missing = np.setdiff1d(np.arange(size), order)[0]
        raise MeshError(
            f"The mesh must be connected; face {missing} cannot be reached from face {root}. Give "
            f"one connected piece."
        )
    number = {(a, b): k for k, (a, b) in enumerate(zip(left.tolist(), right.tolist(), strict=True))}
    points = np.empty((size, 3))
    normal = mesh.face_normals[root]
    first = np.asarray(start, dtype=np.float64)
    points[root] = first - ((first - mesh.face_centers[root]) @ normal) * normal
    for face in order[1:].tolist():
        parent = int(before[face])
        edge = number.get((parent, face), number.get((face, parent), -1))
        point, mirror = points[parent], mirrors[edge]
        points[face] = point - 2.0 * ((point - base[edge]) @ mirror) * mirror
    image = points[left] - 2.0 * dot(points[left] - base, mirrors)[:, None] * mirrors
    return points, float(norm(image - points[right]).max(initial=0.0))


def contact_point_mesh(mesh: PolyMesh, start: ArrayLike, root: int = 0) -> PolyMesh:
    """Circular mesh of contact points of a simply connected conical mesh.

    It has a vertex in each face and a face for each interior vertex, whose corners lie on a
    circle about the axis of the vertex. All starts in the plane of one face give the 2-parameter
    family of circular meshes that belong to a conical mesh.

    Parameters
    ----------
    mesh : PolyMesh
        Conical, simply connected, with an interior vertex.
    start : (3,), model unit
        Point of face `root`; it is put into the plane of the face.
    root : int

    Raises
    ------
    MeshError
        For several pieces, or a mesh without interior vertex.

    References: theory: [pottmann2007], [bobenkosuris].

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.4, 2]], 0.3 * np.arange(5))
    >>> contact_point_mesh(roof, roof.face_centers[0]).topology
    Topology(12 vertices, 17 edges, 6 faces)
    """
    faces = {
        vertex: row
        for star in mesh.topology.stars()
        for vertex, row in zip(star.vertices.tolist(), star.faces.tolist(), strict=True)
    }
    if not faces:
        raise MeshError(
            "A mesh of contact points needs an interior vertex; all vertices lie on the boundary. "
            "Extend the mesh by a row of faces."
        )
    points, _ = propagated_points(mesh, start, root)
    kept, used = drop_unused([faces[vertex] for vertex in sorted(faces)], len(points))
    return PolyMesh.of(points[used], kept)


def _mirrors(mesh: PolyMesh, inner: Indices) -> Floats:
    """Unit normals of the mirrors of inner edges, shape (n, 3)."""
    left, right = mesh.topology.edge_faces[inner].T
    difference = mesh.face_normals[right] - mesh.face_normals[left]
    # Between faces of one plane the mirror stands upright on it, along the edge.
    upright = cross(mesh.face_normals[left], unit(mesh.edge_vectors[inner]))
    is_flat = norm(difference) <= PARALLEL_DIAGONALS
    return np.where(is_flat[:, None], upright, unit(difference))
