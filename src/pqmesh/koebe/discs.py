"""Koebe meshes on discs: all edges touch the unit sphere, the boundary is prescribed.

In the plane the circles of the vertices touch along the edges, so that the centres of the boundary
circles are the corners of a polygon. Prescribed at each boundary vertex is either

- the angle of that polygon, the sum of the kites' angles at the circle, or
- the radius of the circle, up to one factor for all.

With angles only they must sum to (B - 2) pi for B boundary vertices, as in every polygon; one
radius or more sets this free. In both cases every set of circles must want less than pi for each
corner of the mesh that touches it; radii alone can always be met on quad discs whose interior
vertices have at least four edges. The pattern is then unique. Counting: B radii, and three for the
place of the plane pattern, give 2m + 2n + 3 on a grid of m x n faces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.koebe.functional import log_radii
from pqmesh.koebe.layout import PlanePattern, Rounds, plane_pattern
from pqmesh.koebe.polish import polished
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, cross, dot, norm, unit


def koebe_disc(
    topology: Topology,
    *,
    angles: ArrayLike | None = None,
    radii: ArrayLike | None = None,
    reach: float = 0.5,
) -> PolyMesh:
    """Mesh of a disc whose edges touch the unit sphere, around the point (0, 0, 1).

    Normals point outwards where the topology is counterclockwise seen from outside. The result is
    a `QuadMesh` when all faces are quads.

    Parameters
    ----------
    topology : Topology
        A disc; faces of any length.
    angles : (V,), radians, optional
        Angle of the boundary polygon at boundary vertices, nan where the radius is given.
    radii : (V,), optional
        Radius in the plane at boundary vertices, nan where the angle is given. Only ratios count.
    reach : float
        Largest distance in the plane of a point of contact from their mean: the tangent of half
        the angle that the mesh reaches on the sphere. 1 is half of the sphere.

    Raises
    ------
    MeshError
        When the topology is no disc, a boundary vertex has no value or two, the pattern does not
        exist (circles are numbered as the vertices, then as the faces), or a circle comes out
        larger than half of the sphere.

    References: [bobenkospringborn2004].

    Examples
    --------
    A rectangle of equal circles.

    >>> from pqmesh.mesh.exact import grid_faces
    >>> grid = Topology(grid_faces(2, 2), 9)
    >>> corners = np.where(grid.valence == 2, np.pi / 2, np.pi)
    >>> mesh = koebe_disc(grid, angles=np.where(grid.is_boundary_vertex, corners, np.nan))
    >>> bool(np.ptp(np.linalg.norm(mesh.vertices[[0, 2, 6, 8]], axis=1)) < 1e-12)
    True
    """
    if not reach > 0.0:
        raise MeshError(f"The reach must be positive; found {reach}. 1 is half of the sphere.")
    rounds, pattern = _pattern(topology, angles, radii)
    plane = pattern.contacts(topology.edges)
    scale = reach / float(np.abs(plane - plane.mean()).max())
    circles = pattern.moved(scale, -scale * complex(plane.mean())).lifted()
    circles, _ = polished(circles, rounds.corners, topology.edges)
    vertices = circles[: topology.n_vertices]
    behind = np.flatnonzero(vertices[:, 3] <= 1e-9 * norm(vertices[:, :3]))
    if len(behind):
        raise MeshError(
            f"The circles must be smaller than half of the sphere; that of vertex {behind[0]} is "
            f"not ({len(behind)} such circles). Choose a smaller reach than {reach:g}."
        )
    kind = QuadMesh if topology.is_quad else PolyMesh
    return kind(vertices[:, :3] / vertices[:, 3:], topology)


def planar_radii(mesh: PolyMesh) -> Floats:
    """Radii in the plane of a Koebe mesh's vertex circles, seen from (0, 0, -1); shape (V,).

    What `koebe_disc` takes at the boundary to give the same mesh, up to a Moebius map.
    """
    square = np.einsum("ni,ni->n", mesh.vertices, mesh.vertices) - 1.0
    return np.asarray(np.sqrt(np.maximum(square, 0.0)) / (mesh.vertices[:, 2] + 1.0))


def _pattern(
    topology: Topology, angles: ArrayLike | None, radii: ArrayLike | None
) -> tuple[Rounds, PlanePattern]:
    """Circles in the plane with given boundary data, and who is whose neighbour."""
    given, known = _boundary_data(topology, angles, radii)
    rounds = Rounds.of(topology)
    logs = log_radii(
        rounds.corners,
        np.concatenate([given, np.full(topology.n_faces, 2.0 * np.pi)]),
        np.concatenate([known, np.full(topology.n_faces, np.nan)]),
    )
    return rounds, plane_pattern(rounds, np.exp(logs))


def _boundary_data(
    topology: Topology, angles: ArrayLike | None, radii: ArrayLike | None
) -> tuple[Floats, Floats]:
    """Angles (V,) with 2 pi inside, and logarithms of given radii (V,), nan where not given."""
    if len(topology.boundary_loops) != 1 or topology.euler_characteristic != 1:
        raise MeshError(
            f"A disc must be one piece with one boundary and V - E + F = 1; found "
            f"{len(topology.boundary_loops)} boundaries and {topology.euler_characteristic}. Cut "
            f"the mesh open, or use koebe_polyhedron for a closed one."
        )
    n, outer = topology.n_vertices, topology.is_boundary_vertex
    rows = []
    for name, values in (("angles", angles), ("radii", radii)):
        row = np.full(n, np.nan) if values is None else np.array(values, dtype=np.float64)
        if row.shape != (n,):
            raise MeshError(
                f"The {name} must have shape ({n},), one for each vertex; found {row.shape}. Put "
                f"nan where none is given."
            )
        row = np.where(outer, row, np.nan)
        wrong = np.flatnonzero(~np.isnan(row) & ~((row > 0) & (row < np.inf)))
        if len(wrong):
            raise MeshError(
                f"The {name} must be positive; vertex {wrong[0]} has {row[wrong[0]]}. Change it."
            )
        rows.append(row)
    count = (~np.isnan(rows)).sum(axis=0)
    bad = np.flatnonzero(outer & (count != 1))
    if len(bad):
        raise MeshError(
            f"Each boundary vertex must have an angle or a radius; vertex {bad[0]} has "
            f"{'both' if count[bad[0]] else 'none'} ({len(bad)} such vertices). Give one."
        )
    return np.where(outer, rows[0], 2.0 * np.pi), np.log(rows[1])


def koebe_near(topology: Topology, normals: Floats) -> Floats:
    """Vertices of a Koebe mesh on a disc near given unit vectors, (V, 3).

    The radii at the boundary are taken from the vectors' distances, seen in the plane; then the
    whole is brought near to them by a similarity of the plane. The vectors may run around the
    sphere in either sense.

    Raises
    ------
    MeshError
        When the topology is no disc, or no pattern has these radii.
    """
    turn = _upright(normals)
    places = normals @ turn.T
    if _is_clockwise(topology, places):
        # The Gauss image of a saddle runs the other way round; its mirror image does not.
        turn = np.diag([1.0, -1.0, 1.0]) @ turn
        places = normals @ turn.T
    wanted = (places[:, 0] + 1j * places[:, 1]) / (1.0 + places[:, 2])
    i, j = topology.edges[topology.is_boundary_edge].T
    length, size = np.abs(wanted[i] - wanted[j]), topology.n_vertices
    radii = np.full(size, np.nan)
    ends = np.concatenate([i, j])
    sums = np.bincount(ends, np.tile(length, 2), size)[ends]
    radii[ends] = 0.5 * sums / np.bincount(ends, minlength=size)[ends]
    rounds, pattern = _pattern(topology, None, radii)
    centre, target = pattern.centre[:size], wanted.mean()
    middle = centre.mean()
    factor = np.vdot(centre - middle, wanted - target) / np.vdot(centre - middle, centre - middle)
    circles = pattern.moved(complex(factor), complex(target - factor * middle)).lifted()
    circles, _ = polished(circles, rounds.corners, topology.edges)
    return np.asarray(circles[:size, :3] / circles[:size, 3:] @ turn)


def exact_image(image: QuadMesh) -> tuple[QuadMesh, float]:
    """The Koebe mesh next to one that nearly is, and its largest error of contact.

    Raises
    ------
    MeshError
        When a vertex lies inside the sphere or a face outside.
    """
    points, planes, topology = image.vertices, face_planes(image), image.topology
    out, inside = dot(points, points) - 1.0, 1.0 - planes[:, 3] ** 2
    for name, values in (("vertex", out), ("face", inside)):
        bad = np.flatnonzero(values <= 0.0)
        if len(bad):
            raise MeshError(
                f"Vertices must lie outside of the unit sphere and faces cut it; {name} {bad[0]} "
                f"does not ({len(bad)} such). Start nearer to a Koebe mesh."
            )
    circles = np.concatenate(
        [
            np.column_stack([points, np.ones(len(points))]) / np.sqrt(out)[:, None],
            planes / np.sqrt(inside)[:, None],
        ]
    )
    corners = np.column_stack([topology.indices, topology.n_vertices + topology.corner_faces])
    circles, error = polished(circles, corners, topology.edges)
    poles = circles[: topology.n_vertices]
    return image.with_vertices(poles[:, :3] / poles[:, 3:]), error


def _upright(normals: Floats) -> Floats:
    """Rotation (3, 3) that brings the mean of unit vectors to the z axis."""
    axis = unit(normals.mean(axis=0))
    first = unit(cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    return np.stack([first, cross(axis, first), axis])


def _is_clockwise(topology: Topology, places: Floats) -> bool:
    """Whether faces run clockwise in plan, by their total area."""
    return bool(PolyMesh(places, topology).face_area_vectors[:, 2].sum() < 0)
