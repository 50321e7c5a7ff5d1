"""Oriented planes (n, h), n . x = h: those of a mesh's faces, and the meshes planes span."""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Topology, drop_unused
from pqmesh.vectors import Floats, dot

MeshT = TypeVar("MeshT", bound=PolyMesh)

# Directions in which the normals vary less than this say nothing about the meeting point.
RANK_TOLERANCE = 1e-10


class Meetings(NamedTuple):
    """Where sets of planes meet, in the least-squares sense.

    Attributes
    ----------
    points : (n, 3), model unit
        Minimise sum (n_f . x - h_f)^2; where the planes leave freedom, the one nearest to the
        guess.
    misfit : (n,), model unit
        Largest distance of the point from its planes.
    condition : (n,)
        Largest over smallest singular value of the normals, infinite where they leave
        freedom. An error e of the planes moves the point by up to condition * e.
    """

    points: Floats
    misfit: Floats
    condition: Floats


def face_planes(mesh: PolyMesh) -> Floats:
    """Oriented planes of the faces, rows (n, h) with n . x = h, shape (F, 4).

    The normal is the unit vector area, the plane runs through the mean of the corners: the
    plane of the face when it is flat, and for a quad the one halfway between its diagonals.

    Examples
    --------
    >>> face_planes(PolyMesh.of([[0, 0, 2], [1, 0, 2], [1, 1, 2], [0, 1, 2]], [[0, 1, 2, 3]]))
    array([[0., 0., 1., 2.]])
    """
    normals = mesh.face_normals
    return np.column_stack([normals, dot(normals, mesh.face_centers)])


def plane_meetings(planes: Floats, near: Floats | None = None) -> Meetings:
    """Least-squares common points of n sets of k planes.

    Parameters
    ----------
    planes : (n, k, 4)
        Rows (n, h) with unit n.
    near : (n, 3), model unit
        Guess, by default the origin. It decides where the planes do not, and saves digits when
        all is far from the origin.

    Examples
    --------
    >>> walls = np.array([[[1.0, 0, 0, 2], [0, 1, 0, 3], [0, 0, 1, 4]]])
    >>> plane_meetings(walls).points.round(12)
    array([[2., 3., 4.]])
    """
    normals = planes[..., :3]
    guess = np.zeros((len(planes), 3)) if near is None else near
    heights = planes[..., 3] - np.einsum("nki,ni->nk", normals, guess)
    u, s, vt = np.linalg.svd(normals, full_matrices=False)
    keep = s > RANK_TOLERANCE * s[:, :1]
    weights = np.where(keep, np.einsum("nkr,nk->nr", u, heights) / np.where(keep, s, 1.0), 0.0)
    steps = np.einsum("nr,nri->ni", weights, vt)
    misfit = np.abs(np.einsum("nki,ni->nk", normals, steps) - heights).max(axis=1)
    determined = keep.all(axis=1) & (s.shape[1] == 3)
    condition = np.where(determined, s[:, 0] / np.where(determined, s[:, -1], 1.0), np.inf)
    return Meetings(np.asarray(guess + steps), np.asarray(misfit), np.asarray(condition))


def mesh_from_planes(mesh: MeshT, planes: Floats) -> MeshT:
    """The mesh with its vertices moved to where their faces' planes meet.

    A vertex whose planes leave freedom (boundary, flat or cylindrical) goes to the nearest
    point allowed. Exact when the planes at every vertex have a common point.

    Parameters
    ----------
    mesh : PolyMesh
        Combinatorics and guess.
    planes : (F, 4)
        One for each face.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> planes = face_planes(cube()) + np.array([0.0, 0.0, 0.0, 1.0])
    >>> bool(np.allclose(mesh_from_planes(cube(), planes).vertices, 2.0 * cube().vertices))
    True
    """
    points = mesh.vertices.copy()
    for boundary in (False, True):
        for star in mesh.topology.stars(boundary=boundary):
            meetings = plane_meetings(planes[star.faces], points[star.vertices])
            points[star.vertices] = meetings.points
    return mesh.with_vertices(points)


def dual_mesh(topology: Topology, planes: Floats, near: Floats | None = None) -> PolyMesh:
    """Mesh with a face in the plane of each interior vertex, a vertex for each face.

    Faces of `topology` without an interior vertex have no part in it. New faces come in the
    order of the interior vertices, new vertices in that of the faces, and the orientation
    stays.

    Parameters
    ----------
    topology : Topology
    planes : (V, 4)
        One for each vertex, boundary included: those of a face meet in the new vertex.
    near : (F, 3), model unit
        Guess of the new vertices, by default the origin.

    Raises
    ------
    MeshError
        When there is no interior vertex, or the planes of a face leave their common point
        open (parallel to one line); names the face.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> corners = cube().vertices / 3**0.5
    >>> dual_mesh(cube().topology, np.column_stack([corners, np.ones(8)])).topology
    Topology(6 vertices, 12 edges, 8 faces)
    """
    stars = {
        vertex: row
        for star in topology.stars()
        for vertex, row in zip(star.vertices.tolist(), star.faces.tolist(), strict=True)
    }
    if not stars:
        raise MeshError(
            "A dual mesh needs an interior vertex; all vertices lie on the boundary. Extend the "
            "mesh by a row of faces."
        )
    points = np.empty((topology.n_faces, 3))
    condition = np.empty(topology.n_faces)
    for chosen, corners in topology.face_groups:
        guess = None if near is None else near[chosen]
        points[chosen], _, condition[chosen] = plane_meetings(planes[corners], guess)
    faces, used = drop_unused([stars[vertex] for vertex in sorted(stars)], topology.n_faces)
    open_points = used[~np.isfinite(condition[used])]
    if len(open_points):
        raise MeshError(
            f"The planes around a face must meet in one point; those of face {open_points[0]} are "
            f"parallel to one line ({len(open_points)} such faces). Choose planes whose normals "
            f"span space."
        )
    return PolyMesh.of(points[used], faces)
