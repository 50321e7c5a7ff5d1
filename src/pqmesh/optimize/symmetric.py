"""Which vertex of a mesh is the image of which under a reflection or a rotation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import SpecError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices, unit


class Partners(NamedTuple):
    """Vertices that a map takes to each other.

    Attributes
    ----------
    pairs : (m, 2)
        Vertex and image, enough of them that the rest follows from the map's order.
    own : (n,)
        Vertices that are their own images.
    """

    pairs: Indices
    own: Indices


def reflection(normal: tuple[float, ...]) -> Floats:
    """Matrix (3, 3) of the reflection in the plane across a direction."""
    n = unit(np.asarray(normal))
    return np.asarray(np.eye(3) - 2.0 * np.outer(n, n))


def rotation(direction: tuple[float, ...], order: int) -> Floats:
    """Matrix (3, 3) of the rotation about a direction by a full turn over the order."""
    d, angle = unit(np.asarray(direction)), 2.0 * np.pi / order
    across = np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])
    turned = np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across
    return np.asarray(turned)


def partners(
    mesh: PolyMesh, matrix: Floats, point: Floats, order: int, tolerance: float, name: str
) -> Partners:
    """Partners under x -> p + R (x - p), by the positions of the vertices.

    Parameters
    ----------
    mesh : PolyMesh
    matrix : (3, 3)
        R.
    point : (3,)
        p.
    order : int
        R to this power is the identity.
    tolerance : float, model unit
        How far from an image its vertex may lie.
    name : str
        What the map is called in messages.

    Raises
    ------
    SpecError
        For the first vertex whose image has no vertex near it, for two vertices that have one
        image, and where partners do not close after `order` steps.
    """
    images = point + (mesh.vertices - point) @ matrix.T
    gaps, image = map(np.asarray, cKDTree(mesh.vertices).query(images))
    lost = np.flatnonzero(gaps > tolerance)
    if len(lost):
        vertex = int(lost[0])
        raise SpecError(
            f"The start of a symmetric mesh must be nearly so; the {name} takes vertex {vertex} to "
            f"({', '.join(f'{x:.6g}' for x in images[vertex])}), and the nearest vertex lies "
            f"{gaps[vertex]:.4g} away ({len(lost)} such vertices, {tolerance:.4g} is allowed). "
            f"Check plane or axis, or raise the tolerance."
        )
    count = np.bincount(image, minlength=len(image))
    if (count > 1).any():
        shared = int(np.flatnonzero(count > 1)[0])
        first, second = np.flatnonzero(image == shared)[:2]
        raise SpecError(
            f"The {name} must take different vertices to different ones; it takes {first} and "
            f"{second} near vertex {shared}. Lower the tolerance."
        )
    own = np.flatnonzero(image == np.arange(len(image)))
    # Of each orbit, all steps but the one that closes it at its lowest vertex.
    lowest, following = np.arange(len(image)), image.copy()
    for _ in range(order - 1):
        lowest = np.minimum(lowest, following)
        following = image[following]
    if (following != np.arange(len(image))).any():
        vertex = int(np.flatnonzero(following != np.arange(len(image)))[0])
        raise SpecError(
            f"The {name}, {order} times over, must bring every vertex back; it takes vertex "
            f"{vertex} to vertex {following[vertex]}. Lower the tolerance."
        )
    start = np.flatnonzero(image != lowest)
    return Partners(np.column_stack([start, image[start]]), own)
