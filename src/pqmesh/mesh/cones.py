"""The tangent cone of a vertex: apex, axis, half angle; types of vertices; classes of signs."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import FLAT_VERTEX, PARALLEL_DIAGONALS, common_vectors, star_angles
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Stars
from pqmesh.vectors import Floats, Indices, Mask, cross, dot, norm, unit

# Signs of the four normals -> signs of the four angles whose sum is 0, or 2 pi for the second:
# unit vectors e_i n_i lie on a circle exactly when the angles satisfy it.
ANGLE_IDENTITIES = {
    "++++": (np.array([1.0, -1.0, 1.0, -1.0]), 0.0),
    "+-+-": (np.array([1.0, 1.0, 1.0, 1.0]), 2.0 * np.pi),
    "+--+": (np.array([1.0, 1.0, -1.0, -1.0]), 0.0),
    "++--": (np.array([1.0, -1.0, -1.0, 1.0]), 0.0),
}
METHODS = ("least squares", "bisectors")


class VertexType(StrEnum):
    """Shape of the faces around an interior vertex, from the turns of consecutive edges.

    A turn is the sign of det(p_i-1, p_i, p_i+1) for the edge p_i between its neighbours: whether
    the mesh bends down or up across it.
    """

    ELLIPTIC = "elliptic"  # all edges bend one way
    SADDLE = "saddle"  # four changes of sign
    MONKEY = "monkey saddle"  # six or more
    CROSSED = "crossed"  # two changes: 3 to 1, whose normals' image crosses itself, or 2 to 2
    FLAT_EDGE = "flat edge"  # an edge between faces of one plane
    FLAT = "flat"  # all faces in one plane


class VertexCones(NamedTuple):
    """Cones of revolution that touch the oriented planes of all faces at a vertex.

    Attributes
    ----------
    vertices : (n,)
        Interior vertices, rising.
    apex : (n, 3), model unit
    axis : (n, 3)
        Unit vectors, on the side of the normals.
    half_angle : (n,), radians
        Between the axis and the generators: pi/2 at a flat vertex.
    deviation : (n,), radians
        Largest difference between the angle of a face plane with the axis and the half angle:
        0 at a conical vertex.
    """

    vertices: Indices
    apex: Floats
    axis: Floats
    half_angle: Floats
    deviation: Floats


def vertex_cones(mesh: PolyMesh, method: str = "least squares") -> VertexCones:
    """Tangent cones of all interior vertices.

    Parameters
    ----------
    mesh : PolyMesh
    method : 'least squares' or 'bisectors'
        The least-squares solution of n_f . w = 1; or the line common to the bisector planes of
        the edges, each of which contains the edge and the sum of the normals of its two faces.
        Both are the same at a conical vertex; elsewhere they spread the error differently.

    References: [thesis] section 4.1 with the bisector planes of the errata page, E17.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> cones = vertex_cones(cube(), "bisectors")
    >>> np.degrees(cones.half_angle[0]).round(6), cones.deviation.max() < 1e-15
    (np.float64(35.26439), np.True_)
    """
    if method not in METHODS:
        raise MeshError(
            f"The method of a cone must be one of {', '.join(METHODS)}; found {method!r}. "
            f"Choose one."
        )
    parts = []
    for star in mesh.topology.stars():
        normals = mesh.face_normals[star.faces]
        if method == "bisectors":
            axis = _bisector_axes(mesh, star, normals)
        else:
            axis = unit(common_vectors(normals))
        # The angle of a plane with the axis is that beyond a right angle of its normal.
        across = norm(cross(normals, axis[:, None]))
        along = dot(normals, axis[:, None])
        angles = np.arctan2(along, across)
        half = angles.mean(axis=1)
        off = np.abs(angles - half[:, None]).max(axis=1)
        parts.append((star.vertices, mesh.vertices[star.vertices], axis, half, off))
    if not parts:
        none = np.empty(0)
        return VertexCones(
            np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)), none, none
        )
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(columns[0])
    return VertexCones(*[column[order] for column in columns])


def _bisector_axes(mesh: PolyMesh, star: Stars, normals: Floats) -> Floats:
    """Lines common to the bisector planes: across the differences of neighbouring normals."""
    before = np.roll(normals, 1, axis=1)
    differences = normals - before
    size = norm(differences)
    # A flat edge has no bisector plane of its own: the planes on its sides are one.
    bent = size > PARALLEL_DIAGONALS
    planes = np.where(bent[..., None], differences / np.where(bent, size, 1.0)[..., None], 0.0)
    _, values, lines = np.linalg.svd(planes, full_matrices=False)
    axis = lines[:, -1]
    # One plane or two: of the axes that touch both alike, the one halfway between them.
    vague = values[:, 1] <= PARALLEL_DIAGONALS * np.maximum(values[:, 0], PARALLEL_DIAGONALS)
    axis = np.where(vague[:, None], unit(normals.sum(axis=1)), axis)
    return np.asarray(axis * np.where(dot(axis, normals.sum(axis=1)) < 0, -1.0, 1.0)[:, None])


# --- types ------------------------------------------------------------------------------------


def vertex_types(mesh: PolyMesh, tolerance: float = FLAT_VERTEX) -> dict[int, VertexType]:
    """Type of each interior vertex, of any valence, by vertex number.

    Boundary vertices have none: their faces do not close around them.

    Parameters
    ----------
    mesh : PolyMesh
        Planar faces.
    tolerance : float, radians
        Faces whose normals differ by less lie in one plane.

    References: errata page, E15.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> vertex_types(cube())[0].value
    'elliptic'
    """
    found: dict[int, VertexType] = {}
    for star in mesh.topology.stars():
        turns, flat = _edge_turns(mesh, star, tolerance)
        changes = np.count_nonzero(turns != np.roll(turns, 1, axis=1), axis=1)
        for vertex, level, change in zip(star.vertices.tolist(), flat, changes, strict=True):
            found[vertex] = _type_of(level, int(change))
    return dict(sorted(found.items()))


def _type_of(flat: Mask, changes: int) -> VertexType:
    """Type by which edges are flat and how often the turn changes sign around the vertex."""
    if flat.all():
        return VertexType.FLAT
    if flat.any():
        return VertexType.FLAT_EDGE
    if changes == 0:
        return VertexType.ELLIPTIC
    if changes == 2:
        return VertexType.CROSSED
    return VertexType.SADDLE if changes == 4 else VertexType.MONKEY


def _edge_turns(mesh: PolyMesh, star: Stars, tolerance: float) -> tuple[Floats, Mask]:
    """Signs with which the mesh bends across each edge of a star, and which edges are flat."""
    spokes = unit(mesh.vertices[star.neighbors] - mesh.vertices[star.vertices][:, None])
    normals = mesh.face_normals[star.faces]
    # Face i lies after spoke i, so the edge of spoke i is between faces i-1 and i. The sine of
    # the angle of the normals about the edge has the sign of the determinant where corners are
    # below pi, and is right at reflex corners too.
    turn = dot(cross(np.roll(normals, 1, axis=1), normals), spokes)
    return np.sign(turn), norm(np.roll(normals, 1, axis=1) - normals) < tolerance


# --- classes of signs -------------------------------------------------------------------------


def sign_class_residuals(mesh: PolyMesh) -> tuple[Indices, dict[str, Floats]]:
    """Residuals of the four angle identities at interior vertices of valence 4, radians.

    Four unit vectors e_i n_i with signs e lie on a circle exactly when one identity between the
    four angles holds. Only the class ++++ is an oriented cone and gives an offset; +-+- are the
    vertices that fold from flat paper, +--+ and ++-- are folded vertices without offset.

    Returns
    -------
    (n,), and signs -> (n,)

    References: errata page, E15 and E26.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> vertices, residuals = sign_class_residuals(roof)
    >>> vertices.tolist(), bool((abs(residuals["++++"]) < 1e-12).all())
    ([6, 7, 8], True)
    """
    for star in mesh.topology.stars():
        if star.neighbors.shape[1] == 4:
            angles = star_angles(mesh, star)
            return star.vertices, {
                name: np.asarray(angles @ signs - total)
                for name, (signs, total) in ANGLE_IDENTITIES.items()
            }
    return np.empty(0, dtype=np.int64), {name: np.empty(0) for name in ANGLE_IDENTITIES}
