"""Quad meshes that are exactly planar, circular or conical by construction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from pqmesh.errors import MeshError
from pqmesh.mesh.planes import dual_mesh
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, Indices, dot, unit

Closed = tuple[bool, bool]


# --- grids ----------------------------------------------------------------------------------


def grid_faces(m: int, n: int, closed: Closed = (False, False)) -> Indices:
    """Faces of an m x n grid of quads, shape (m*n, 4).

    Vertex (i, j) has number i * columns + j; face (i, j) runs (i, j), (i+1, j), (i+1, j+1),
    (i, j+1), so that its normal is (step in i) x (step in j).

    Parameters
    ----------
    m, n : int
        Number of faces along i and along j.
    closed : (bool, bool)
        True joins the last row (column) to the first: then there are as many vertices as
        faces in that direction, and at least 3.

    Examples
    --------
    >>> grid_faces(1, 2).tolist()
    [[0, 3, 4, 1], [1, 4, 5, 2]]
    >>> Topology(grid_faces(3, 4, closed=(True, True)), 12).euler_characteristic
    0
    """
    for name, count, joined in (("m", m, closed[0]), ("n", n, closed[1])):
        kind, least = ("A closed", 3) if joined else ("An open", 1)
        if count < least:
            raise MeshError(
                f"{kind} grid direction needs at least {least} faces; {name} is {count}. Give more."
            )
    rows, columns = m + (not closed[0]), n + (not closed[1])
    i, j = (index.ravel() for index in np.indices((m, n)))
    along, beside = (i + 1) % rows, (j + 1) % columns
    return np.stack(
        [i * columns + j, along * columns + j, along * columns + beside, i * columns + beside],
        axis=1,
    ).astype(np.int64)


def grid_mesh(points: ArrayLike, closed: Closed = (False, False)) -> QuadMesh:
    """Quad mesh of an array of points, shape (rows, columns, 3), joined as `grid_faces`.

    Examples
    --------
    >>> grid_mesh(np.zeros((3, 4, 3)))
    QuadMesh(Topology(12 vertices, 17 edges, 6 faces))
    """
    array = np.asarray(points, dtype=np.float64)
    rows, columns = array.shape[:2]
    faces = grid_faces(rows - (not closed[0]), columns - (not closed[1]), closed)
    return QuadMesh.of(array.reshape(-1, 3), faces)


# --- planar and circular --------------------------------------------------------------------


def translational_mesh(first: ArrayLike, second: ArrayLike) -> QuadMesh:
    """Mesh a_i + b_j of two polylines (k, 3) and (l, 3): its faces are parallelograms.

    Planar always; circular exactly when all edges of one are perpendicular to those of the
    other (rectangles).

    References: [thesis] section 2.1.

    Examples
    --------
    >>> roof = translational_mesh([[0, 0, 0], [1, 0, 1], [2, 0, 1]], [[0, 0, 0], [0, 1, 0.5]])
    >>> roof.vertices[-1]
    array([2. , 1. , 1.5])
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    return grid_mesh(a[:, None] + b[None, :])


def rotational_mesh(
    profile: ArrayLike, angles: ArrayLike, *, closed: bool = False, closed_profile: bool = False
) -> QuadMesh:
    """Mesh of revolution about the z axis: isosceles trapezoids, so circular.

    Vertex (i, j) is (r_i cos t_j, r_i sin t_j, z_i) and has number i * len(angles) + j.
    Normals point away from the axis where z rises along the profile and the angles rise.
    Conical exactly when the angles are equally spaced, or at vertices where the profile is
    straight or vertical on both sides.

    Parameters
    ----------
    profile : (k, 2), model unit
        Radii r > 0 and heights z.
    angles : (l,), radians
    closed : bool
        Join the last meridian to the first.
    closed_profile : bool
        Join the last parallel circle to the first: a torus when both are closed.

    References: [thesis] section 3.2; theory: [pottmann2007].

    Examples
    --------
    >>> rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], np.arange(4) * 0.3)
    QuadMesh(Topology(12 vertices, 17 edges, 6 faces))
    """
    curve = np.asarray(profile, dtype=np.float64)
    turns = np.asarray(angles, dtype=np.float64)
    radius, height = curve[:, :1], curve[:, 1:]
    points = np.stack(
        [radius * np.cos(turns), radius * np.sin(turns), height + 0.0 * turns], axis=-1
    )
    faces = grid_faces(
        len(curve) - (not closed_profile), len(turns) - (not closed), (closed_profile, closed)
    )
    return QuadMesh.of(points.reshape(-1, 3), faces[:, ::-1])


def mirror_mesh(polyline: ArrayLike, mirrors: ArrayLike) -> QuadMesh:
    """Mesh of a polyline (k, 3) reflected in one mirror after the other: circular.

    Each face is an isosceles trapezoid, whatever the polyline and the mirrors, so the class
    contains the discrete Monge and moulding surfaces. Where the polyline crosses a mirror the
    face is crossed, and `measure.nonconvex_faces` names it.

    Parameters
    ----------
    polyline : (k, 3), model unit
    mirrors : (l, 4)
        Planes (n, h); polyline j+1 is polyline j reflected in mirror j.

    Examples
    --------
    >>> mesh = mirror_mesh([[0, 0, 0], [0, 1, 0]], [[1, 0, 0, 1], [1, 0, 0.2, 3]])
    >>> mesh.vertices[1]
    array([2., 0., 0.])
    """
    copies = [np.asarray(polyline, dtype=np.float64)]
    for mirror in _planes(mirrors):
        points = copies[-1]
        copies.append(points - 2.0 * (points @ mirror[:3] - mirror[3])[:, None] * mirror[:3])
    return grid_mesh(np.stack(copies, axis=1))


def stereographic_mesh(x: ArrayLike, y: ArrayLike) -> QuadMesh:
    """Rectangle grid (x_i, y_j) laid on the unit sphere from its north pole: circular.

    Vertices on the sphere, normals outwards.

    References: [thesis] section 5.4.

    Examples
    --------
    >>> stereographic_mesh([-1, 0, 1], [-1, 0, 1]).vertices[4]
    array([ 0.,  0., -1.])
    """
    a, b = np.meshgrid(np.asarray(x, np.float64), np.asarray(y, np.float64), indexing="ij")
    square = a**2 + b**2
    points = np.stack([2.0 * a, 2.0 * b, square - 1.0], axis=-1) / (square + 1.0)[..., None]
    return grid_mesh(points).reversed()


# --- conical --------------------------------------------------------------------------------


def mirror_plane_mesh(strip: ArrayLike, mirrors: ArrayLike) -> QuadMesh:
    """Mesh whose face planes are a strip of planes reflected in one mirror after another.

    The dual of `mirror_mesh`: conical, because two planes and their mirror images meet in a
    point of the mirror and touch a cone of revolution. With k planes and l mirrors there are
    (k - 2) x (l - 1) faces.

    Parameters
    ----------
    strip : (k, 4)
        Oriented planes (n, h), k >= 3.
    mirrors : (l, 4)
        l >= 2.

    Examples
    --------
    >>> strip = [[1, 0.2, z, 2 + 0.1 * z * z] for z in (-0.6, -0.1, 0.3, 0.8)]
    >>> mirrors = [[-0.5, 1, 0, 0], [-1, 1, 0, 0], [-1.5, 1, 0, 0]]
    >>> mirror_plane_mesh(strip, mirrors)
    QuadMesh(Topology(9 vertices, 12 edges, 4 faces))
    """
    copies = [_planes(strip)]
    for mirror in _planes(mirrors):
        planes = copies[-1]
        slope = 2.0 * (planes[:, :3] @ mirror[:3])
        # The image of n.x = h under x -> x - 2(m.x - k)m, with its side kept.
        copies.append(planes - slope[:, None] * mirror)
    return tangent_plane_mesh(np.stack(copies, axis=1))


def tangent_plane_mesh(planes: ArrayLike, closed: Closed = (False, False)) -> QuadMesh:
    """Mesh with one face in each inner plane of a grid of planes.

    Exact (each 2 x 2 block of planes has a common point) for tangent planes of a torus or a
    Dupin cyclide at any values of its curvature parameters, and conical there; elsewhere the
    vertices are least-squares points and the faces only nearly lie in their planes.

    Parameters
    ----------
    planes : (m, n, 4)
        Oriented planes (n, h) with n along (step in i) x (step in j).
    closed : (bool, bool)
        Directions in which the grid closes.

    Raises
    ------
    MeshError
        When four neighbouring planes are parallel to one line.

    References: theory: [pottmann2007].

    Examples
    --------
    >>> u, v = np.meshgrid(np.arange(4) * 0.3, np.arange(4) * 0.4, indexing="ij")
    >>> normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=-1)
    >>> heights = 3.0 * np.cos(v)[..., None] + 1.0
    >>> tangent_plane_mesh(np.concatenate([normals, heights], axis=-1))
    QuadMesh(Topology(9 vertices, 12 edges, 4 faces))
    """
    grid = np.asarray(planes, dtype=np.float64)
    rows, columns = grid.shape[:2]
    faces = grid_faces(rows - (not closed[0]), columns - (not closed[1]), closed)
    mesh = dual_mesh(Topology(faces, rows * columns), _planes(grid.reshape(-1, 4)))
    return QuadMesh(mesh.vertices, mesh.topology)


def contact_element_mesh(mesh: QuadMesh, start: ArrayLike) -> QuadMesh:
    """Conical mesh of the contact planes of a simply connected circular mesh.

    Each vertex carries the plane through it whose normal comes from `start` at vertex 0 by
    `propagated_normals`; the planes at a face meet in a new vertex, those of an interior
    vertex span a new face. All starts give the 2-parameter family of conical meshes that
    belong to one circular mesh.

    Parameters
    ----------
    mesh : QuadMesh
        Circular, simply connected, with at least one interior vertex, valences 4 inside.
    start : (3,)
        Direction of the normal at vertex 0.

    References: theory: [pottmann2007].

    Examples
    --------
    >>> ball = stereographic_mesh([-0.5, -0.2, 0.1, 0.5], [-0.4, 0.0, 0.3, 0.5])
    >>> contact_element_mesh(ball, [0.1, 0.2, -1.0])
    QuadMesh(Topology(9 vertices, 12 edges, 4 faces))
    """
    normals = propagated_normals(mesh, start)
    planes = np.column_stack([normals, dot(normals, mesh.vertices)])
    dual = dual_mesh(mesh.topology, planes, mesh.face_centers)
    return QuadMesh(dual.vertices, dual.topology)


def propagated_normals(mesh: QuadMesh, start: ArrayLike, root: int = 0) -> Floats:
    """Unit normals at the vertices, each the mirror image of its neighbour's, shape (V, 3).

    Reflection in the bisecting plane of each edge, s_j = s_i - 2 (s_i . u) u, carries `start`
    from `root` along a breadth-first tree. The result does not depend on the path when the
    mesh is circular and simply connected; it is then a Gauss image of exact vertex offsets.

    Parameters
    ----------
    mesh : QuadMesh
        Connected, without edges of length 0.
    start : (3,)
    root : int
        Vertex that receives `start`.

    References: [thesis] section 3.2; errata page, E13.

    Examples
    --------
    >>> box = translational_mesh([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 1, 0]])
    >>> propagated_normals(box, [0.6, 0.0, 0.8])[2]
    array([-0.6,  0. ,  0.8])
    """
    low, high = mesh.edges.T
    size = mesh.topology.n_vertices
    graph = coo_array((np.ones(len(low)), (low, high)), shape=(size, size)).tocsr()
    order, before = breadth_first_order(graph, root, directed=False)
    if len(order) < size:
        missing = np.setdiff1d(np.arange(size), order)[0]
        raise MeshError(
            f"The mesh must be connected; vertex {missing} cannot be reached from vertex {root}. "
            f"Give one connected piece."
        )
    normals = np.empty((size, 3))
    normals[root] = unit(np.asarray(start, dtype=np.float64))
    steps = unit(mesh.vertices[order[1:]] - mesh.vertices[before[order[1:]]])
    for vertex, step in zip(order[1:], steps, strict=True):
        normal = normals[before[vertex]]
        normals[vertex] = normal - 2.0 * (normal @ step) * step
    return normals


def _planes(rows: ArrayLike) -> Floats:
    """Planes (n, h) scaled to unit normals, shape (k, 4)."""
    planes = np.asarray(rows, dtype=np.float64)
    return np.asarray(planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True))
