"""Circles of faces: the direct test of circular meshes beside the balance of angles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, cross, dot, norm, unit

# Corners in line to this share of the size of a face have no circle but a line.
STRAIGHT = 1e-12


class Circles(NamedTuple):
    """Circle nearest to the corners of each face, in its plane.

    Attributes
    ----------
    centers : (F, 3), model unit
    axes : (F, 3)
        Unit normals of the faces.
    radii : (F,), model unit
        Infinite where the corners lie on a line.
    deviation : (F,), model unit
        Largest distance of a corner from the circle, out of the plane included: 0 for a face of
        a circular mesh.
    """

    centers: Floats
    axes: Floats
    radii: Floats
    deviation: Floats


def fitted_circles(mesh: PolyMesh) -> Circles:
    """Circles through the corners of faces of any length, in least squares.

    Exact where the corners lie on a circle, in any order: crossed quads have a circle as well,
    `circle_deviation` tells them apart. Elsewhere the circle makes the sum of squares of the
    powers of the corners smallest.

    References: [thesis] definition 3.2.1; errata page, E12.

    Examples
    --------
    >>> square = PolyMesh.of([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2, 3]])
    >>> circle = fitted_circles(square)
    >>> float(circle.radii[0]), float(circle.deviation[0])
    (1.0, 0.0)
    """
    topology = mesh.topology
    faces, starts = topology.corner_faces, topology.offsets[:-1]
    normals, middle = mesh.face_normals, mesh.face_centers
    out = mesh.vertices[topology.indices] - middle[faces]
    first = unit(out[starts] - dot(out[starts], normals)[:, None] * normals)
    second = cross(normals, first)
    x, y, z = dot(out, first[faces]), dot(out, second[faces]), dot(out, normals[faces])

    def moments(values: Floats) -> Floats:
        return np.asarray(np.add.reduceat(values, starts) / topology.face_sizes)

    # Power of a corner x^2 + y^2 - 2 a x - 2 b y - c; the corners have their mean at 0.
    square = x * x + y * y
    xx, xy, yy = moments(x * x), moments(x * y), moments(y * y)
    determinant = xx * yy - xy * xy
    straight = determinant <= STRAIGHT * (xx + yy) ** 2
    safe = np.where(straight, 1.0, 2.0 * determinant)
    qx, qy = moments(square * x), moments(square * y)
    a, b = (qx * yy - qy * xy) / safe, (qy * xx - qx * xy) / safe
    radii = np.sqrt(np.maximum(a * a + b * b + xx + yy, TINY))
    centers = middle + a[:, None] * first + b[:, None] * second
    height = norm(np.stack([x - a[faces], y - b[faces], 0.0 * z], axis=-1)) - radii[faces]
    deviation = np.maximum.reduceat(np.hypot(height, z), starts)
    return Circles(
        centers,
        normals,
        np.where(straight, np.inf, radii),
        np.where(straight, np.maximum.reduceat(np.abs(z), starts), deviation),
    )
