"""The discrete Gauss image of an offset pair, and how it lies to the unit sphere.

S = (offset - mesh)/d is parallel to the mesh. For every parallel pair, offset or not,

    d_v = |d| |s_i|,    d_e = |d| dist(0, line of the edge of S),    d_f = d (n_f . s_i),

so a distance is constant |d| exactly when S has its vertices on the sphere, the lines of its edges
tangent to it, or the planes of its faces tangent to it with the normals of the mesh outwards.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.distances import KINDS, face_distance, same_topology
from pqmesh.vectors import Floats, cross, norm, unit

MeshT = TypeVar("MeshT", bound=PolyMesh)


def gauss_image(mesh: MeshT, offset: PolyMesh, distance: float) -> MeshT:
    """Discrete Gauss image S = (offset - mesh)/d, a mesh parallel to both.

    Parameters
    ----------
    mesh, offset : PolyMesh
        On the same topology.
    distance : float, model unit
        Signed, not zero: positive where the offset lies on the side of the normals.

    References: [thesis] definition 3.1.1 with the sign of the errata page, E9.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> larger = cube().with_vertices(1.5 * cube().vertices)
    >>> bool(np.allclose(gauss_image(cube(), larger, 0.5).vertices, cube().vertices))
    True
    """
    same_topology(mesh, offset)
    if distance == 0.0 or not np.isfinite(distance):
        raise MeshError(
            f"A Gauss image needs an offset at some distance; found {distance:g}. Give the signed "
            f"distance of the two meshes."
        )
    return mesh.with_vertices((offset.vertices - mesh.vertices) / distance)


def sphere_deviation(mesh: PolyMesh, image: PolyMesh, kind: str) -> Floats:
    """How far a Gauss image is from the unit sphere, in the way of a kind of offset.

    Parameters
    ----------
    mesh : PolyMesh
        Its edges and normals say which lines and which side of the planes are meant, so that
        edges of the image may have length 0.
    image : PolyMesh
        Parallel to the mesh.
    kind : 'vertex', 'edge' or 'face'

    Returns
    -------
    (V,), (E,) or as `face_distance`
        |s| - 1; distance of the edge's line from the origin minus 1; n_f . s - 1. For an offset
        M + d S this is the error of the distance for each unit of |d|.

    References: [thesis] theorem 3.1.1 as corrected in the errata page, E10.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> float(sphere_deviation(cube(), cube(), "face").max())
    0.0
    """
    same_topology(mesh, image)
    if kind == "vertex":
        return np.asarray(norm(image.vertices) - 1.0)
    if kind == "edge":
        middle = 0.5 * image.vertices[mesh.edges].sum(axis=1)
        return np.asarray(norm(cross(unit(mesh.edge_vectors), middle)) - 1.0)
    if kind == "face":
        moved = mesh.with_vertices(mesh.vertices + image.vertices)
        return np.asarray(face_distance(mesh, moved) - 1.0)
    raise MeshError(
        f"The kind of an offset must be one of {', '.join(KINDS)}; found {kind!r}. Choose one."
    )


def touches_sphere(mesh: PolyMesh, image: PolyMesh, kind: str, tolerance: float = 1e-9) -> bool:
    """Whether a Gauss image lies on the unit sphere, or touches it, to the tolerance.

    References: [thesis] theorem 3.1.1; errata page, E10.
    """
    return bool(np.abs(sphere_deviation(mesh, image, kind)).max() <= tolerance)
