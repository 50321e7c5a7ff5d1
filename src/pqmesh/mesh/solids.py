"""Closed quad meshes whose faces touch the unit sphere: conical at vertices of any valence."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from pqmesh.errors import MeshError
from pqmesh.mesh.planes import plane_meetings
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.vectors import Floats, Indices, cross, unit

GOLDEN = (1.0 + 5.0**0.5) / 2.0
# Hull facets closer than this are one facet: points on a sphere, coordinates below 1.
FACET_DIGITS = 9


def sphere_tangent_mesh(contacts: ArrayLike) -> PolyMesh:
    """Convex mesh whose face planes touch the unit sphere in the given points.

    The polar dual of the convex hull of the contacts: face i touches at contact i, normals
    point outwards. Conical at every vertex with the axis through the origin; its face offset
    by d is the scaling by 1 + d.

    Parameters
    ----------
    contacts : (n, 3)
        Scaled to length 1. The origin must lie inside their hull.

    Raises
    ------
    MeshError
        When all contacts lie in a closed half-space: the planes bound no solid.

    References: theory: [pottmann2007].

    Examples
    --------
    >>> sphere_tangent_mesh(np.vstack([np.eye(3), -np.eye(3)])).topology
    Topology(8 vertices, 12 edges, 6 faces)
    """
    points = unit(np.asarray(contacts, dtype=np.float64))
    hull = ConvexHull(points)
    if hull.equations[:, 3].max() > -(10.0**-FACET_DIGITS):
        raise MeshError(
            "The contacts must surround the origin; they lie in one half of the sphere. Add "
            "contacts on the other side."
        )
    facets: dict[tuple[float, ...], set[int]] = {}
    for simplex, equation in zip(hull.simplices, hull.equations, strict=True):
        key = tuple((np.round(equation, FACET_DIGITS) + 0.0).tolist())
        facets.setdefault(key, set()).update(simplex.tolist())
    planes = np.column_stack([points, np.ones(len(points))])
    members = sorted(sorted(facet) for facet in facets.values())
    meetings = [plane_meetings(planes[None, facet]) for facet in members]
    corners = np.concatenate([meeting.points for meeting in meetings])
    faces: list[list[int]] = []
    for index, contact in enumerate(points):
        around = np.array([k for k, facet in enumerate(members) if index in facet])
        faces.append(around[_turn(contact, corners[around])].tolist())
    return PolyMesh.of(corners, faces)


def cube() -> QuadMesh:
    """Cube (+-1, +-1, +-1): valence 3, faces at distance 1.

    Examples
    --------
    >>> cube()
    QuadMesh(Topology(8 vertices, 12 edges, 6 faces))
    """
    return _quads(np.vstack([np.eye(3), -np.eye(3)]))


def rhombic_dodecahedron() -> QuadMesh:
    """12 rhombi, valences 3 and 4: polar dual of the cuboctahedron.

    Examples
    --------
    >>> rhombic_dodecahedron()
    QuadMesh(Topology(14 vertices, 24 edges, 12 faces))
    """
    return _quads(_signed([(1, 1, 0), (0, 1, 1), (1, 0, 1)]))


def deltoidal_icositetrahedron() -> QuadMesh:
    """24 kites, valences 3 and 4: polar dual of the rhombicuboctahedron.

    Examples
    --------
    >>> deltoidal_icositetrahedron()
    QuadMesh(Topology(26 vertices, 48 edges, 24 faces))
    """
    long = 1.0 + 2.0**0.5
    return _quads(_signed([(long, 1, 1), (1, long, 1), (1, 1, long)]))


def rhombic_triacontahedron() -> QuadMesh:
    """30 rhombi, valences 3 and 5: polar dual of the icosidodecahedron.

    Examples
    --------
    >>> rhombic_triacontahedron()
    QuadMesh(Topology(32 vertices, 60 edges, 30 faces))
    """
    axes = [(2.0 * GOLDEN, 0, 0), (1, GOLDEN, GOLDEN**2)]
    return _quads(_signed([np.roll(row, k) for row in axes for k in range(3)]))


def deltoidal_hexecontahedron() -> QuadMesh:
    """60 kites, valences 3, 4 and 5: polar dual of the rhombicosidodecahedron.

    Examples
    --------
    >>> deltoidal_hexecontahedron()
    QuadMesh(Topology(62 vertices, 120 edges, 60 faces))
    """
    axes = [(1, 1, GOLDEN**3), (GOLDEN**2, GOLDEN, 2.0 * GOLDEN), (2.0 + GOLDEN, 0, GOLDEN**2)]
    return _quads(_signed([np.roll(row, k) for row in axes for k in range(3)]))


def trapezohedron(n: int) -> QuadMesh:
    """2n kites, two vertices of valence n: polar dual of the uniform n-antiprism, n >= 3.

    Examples
    --------
    >>> trapezohedron(5)
    QuadMesh(Topology(12 vertices, 20 edges, 10 faces))
    """
    if n < 3:
        raise MeshError(f"A trapezohedron needs n >= 3; found {n}. Give a larger n.")
    turns = np.arange(2 * n) * np.pi / n
    # All edges of the antiprism are as long as the sides of its two n-gons.
    height = np.sqrt(np.sin(np.pi / n) ** 2 - np.sin(np.pi / (2 * n)) ** 2)
    heights = np.where(np.arange(2 * n) % 2 == 0, height, -height)
    return _quads(np.column_stack([np.cos(turns), np.sin(turns), heights]))


def _quads(contacts: ArrayLike) -> QuadMesh:
    """Mesh of the contacts as a QuadMesh."""
    mesh = sphere_tangent_mesh(contacts)
    return QuadMesh(mesh.vertices, mesh.topology)


def _signed(rows: Sequence[ArrayLike]) -> Floats:
    """All sign changes of the rows, each once, in a fixed order."""
    found: dict[tuple[float, ...], None] = {}
    for row in rows:
        for signs in itertools.product((1.0, -1.0), repeat=3):
            found[tuple((np.asarray(row) * signs + 0.0).tolist())] = None
    return np.array(list(found))


def _turn(axis: Floats, points: Floats) -> Indices:
    """Order of points counterclockwise about an axis, seen from its tip."""
    across = unit(cross(axis, np.eye(3)[np.argmin(np.abs(axis))]))
    up = cross(axis, across)
    return np.argsort(np.arctan2(points @ up, points @ across))
