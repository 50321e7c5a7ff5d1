"""Koebe meshes, and meshes with edge offsets, in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import grid_mesh, rotational_mesh
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats


def rotational_koebe(n: int, start: float, rows: int) -> QuadMesh:
    """Koebe mesh of revolution about the z axis, n faces around.

    Vertex (i, j) has radius sech t / cos(pi/n) and height tanh t, with t = start + 2ih and
    cosh h = 1 / cos(pi/n). Normals point outwards.

    Parameters
    ----------
    n : int
        At least 3.
    start : float
        Mercator coordinate of the first row, 0 at the equator.
    rows : int
        Rows of vertices, at least 2.

    References: theory: [pottmann2007].

    Examples
    --------
    >>> rotational_koebe(12, -1.0, 3).vertices[0].round(6)
    array([ 0.670915, 0. , -0.761594])
    """
    t, _ = _mercator(n, start, rows)
    profile = np.column_stack([1.0 / (np.cosh(t) * np.cos(np.pi / n)), np.tanh(t)])
    return rotational_mesh(profile, 2.0 * np.pi * np.arange(n) / n, closed=True)


def discrete_catenoid(n: int, start: float, rows: int) -> QuadMesh:
    """Discrete catenoid, parallel to `rotational_koebe` of the same numbers.

    Radius cos(pi/n) cosh t, height -2i sin(pi/n): a discrete minimal surface with exact edge
    offsets, which tends to the catenoid as n grows. Rows run downwards, so that edges along the
    meridians are opposite to those of its Gauss image.

    References: theory: [bobenko2006].

    Examples
    --------
    >>> discrete_catenoid(12, -1.0, 3).vertices[12].round(6)
    array([ 1.074739, 0. , -0.517638])
    """
    t, angle = _mercator(n, start, rows)
    profile = np.column_stack([np.cos(angle) * np.cosh(t), -2.0 * np.sin(angle) * np.arange(rows)])
    image = rotational_koebe(n, start, rows)
    mesh = rotational_mesh(profile, 2.0 * np.pi * np.arange(n) / n, closed=True)
    return QuadMesh(mesh.vertices, image.topology)


def square_koebe(rows: int, columns: int, spacing: float, shift: ArrayLike = (0, 0)) -> QuadMesh:
    """Koebe mesh of a square grid of equal circles in the plane, laid on the sphere.

    The circles have radius spacing/2 and centres shift + spacing (i, j). Normals point outwards.

    Parameters
    ----------
    rows, columns : int
        Vertices in both directions, at least 2.
    spacing : float
    shift : (2,)

    Raises
    ------
    MeshError
        When a circle is half of the sphere or larger: 1 + p^2 must exceed r^2.

    Examples
    --------
    >>> square_koebe(2, 2, 0.2, (0.2, 0.4)).vertices[0].round(6)
    array([0.336134, 0.672269, 0.680672])
    """
    i, j = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    x, y = np.asarray(shift, np.float64)[:, None, None] + spacing * np.stack([i, j])
    power = x**2 + y**2 - 0.25 * spacing**2
    if power.min() <= -1.0:
        raise MeshError(
            f"The circles must be smaller than half of the sphere; at spacing {spacing:g} one is "
            f"not. Choose a smaller spacing."
        )
    points = np.stack([2.0 * x, 2.0 * y, 1.0 - power], axis=-1) / (1.0 + power)[..., None]
    return grid_mesh(points)


def _mercator(n: int, start: float, rows: int) -> tuple[Floats, float]:
    """Mercator coordinates of the rows, and half the angle between columns."""
    if n < 3 or rows < 2:
        raise MeshError(
            f"A mesh of revolution needs 3 columns and 2 rows or more; found {n} and {rows}. Give "
            f"more."
        )
    angle = np.pi / n
    return start + 2.0 * np.arccosh(1.0 / np.cos(angle)) * np.arange(rows), float(angle)
