"""Lie sphere geometry: points, oriented spheres and oriented planes on one quadric.

An oriented sphere is a row (p, r), a point one with r = 0, an oriented plane a row (n, h). A sphere
and a plane are in oriented contact when n . p - r = h: r > 0 goes with normals that point inwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from pqmesh.errors import MeshError
from pqmesh.vectors import Floats, Mask, read_only

T = TypeVar("T")

# Scalar products of signature (4, 2) on Lie coordinates and (3, 1) on spheres (p, r).
LIE = read_only(np.diag([-1.0, 1.0, 1.0, 1.0, 1.0, -1.0]))
LORENTZ = read_only(np.diag([1.0, 1.0, 1.0, -1.0]))
# The point of the quadric that is in contact with every plane.
IMPROPER_POINT = read_only([1.0, -1.0, 0.0, 0.0, 0.0, 0.0])
# Rounding of a product of matrices with entries of size 1; grows with the square of the entries.
GROUP_TOLERANCE = 1e-12


# --- coordinates ----------------------------------------------------------------------------


def lie_coordinates(spheres: ArrayLike) -> Floats:
    """Lie coordinates of oriented spheres, scaled to x1 + x2 = 1.

    Parameters
    ----------
    spheres : (N, 4) or (N, 3), model unit
        Rows (p, r); rows (p,) are points.

    Returns
    -------
    (N, 6)
        Rows ((1 + p^2 - r^2)/2, (1 - p^2 + r^2)/2, p, r), with Lie product 0 on themselves.

    References: [thesis] section 5.1; errata page, E19, E20.

    Examples
    --------
    >>> lie_coordinates([[1.0, 2.0, 3.0, 5.0]])
    array([[-5.,  6.,  1.,  2.,  3.,  5.]])
    """
    rows = np.asarray(spheres, dtype=np.float64)
    if rows.shape[-1] == 3:
        rows = np.concatenate([rows, np.zeros((*rows.shape[:-1], 1))], axis=-1)
    square = lorentz_product(rows, rows)[..., None]
    return np.concatenate([0.5 * (1.0 + square), 0.5 * (1.0 - square), rows], axis=-1)


def lie_coordinates_of_planes(planes: ArrayLike) -> Floats:
    """Lie coordinates (h, -h, n, 1) of oriented planes (n, h), shape (N, 4) -> (N, 6).

    Examples
    --------
    >>> lie_coordinates_of_planes([[0.0, 0.0, 1.0, 2.0]])
    array([[ 2., -2.,  0.,  0.,  1.,  1.]])
    """
    rows = np.asarray(planes, dtype=np.float64)
    height = rows[..., 3:]
    return np.concatenate([height, -height, rows[..., :3], np.ones_like(height)], axis=-1)


def is_plane(coordinates: Floats, tolerance: float = GROUP_TOLERANCE) -> Mask:
    """Truth for rows (N, 6) with x1 + x2 = 0: planes and the improper point."""
    size = np.abs(coordinates).max(axis=-1)
    return np.asarray(np.abs(coordinates[..., 0] + coordinates[..., 1]) <= tolerance * size)


def spheres_of(coordinates: Floats) -> Floats:
    """Oriented spheres (p, r) of homogeneous Lie coordinates, shape (N, 6) -> (N, 4).

    Raises
    ------
    MeshError
        When a row is a plane or the improper point; names it.

    Examples
    --------
    >>> spheres_of(np.array([[-10.0, 12.0, 2.0, 4.0, 6.0, 10.0]]))
    array([[1., 2., 3., 5.]])
    """
    wrong = np.flatnonzero(is_plane(coordinates))
    if len(wrong):
        raise MeshError(
            f"Lie coordinates of a sphere must have x1 + x2 other than 0; row {wrong[0]} is a "
            f"plane or the improper point ({len(wrong)} such rows). Read it with planes_of."
        )
    return np.asarray(coordinates[..., 2:] / (coordinates[..., :1] + coordinates[..., 1:2]))


def planes_of(coordinates: Floats) -> Floats:
    """Oriented planes (n, h) of homogeneous Lie coordinates, shape (N, 6) -> (N, 4).

    Raises
    ------
    MeshError
        When a row is a sphere or the improper point; names it.

    Examples
    --------
    >>> planes_of(np.array([[-4.0, 4.0, 0.0, 0.0, -2.0, -2.0]]))
    array([[0., 0., 1., 2.]])
    """
    size = np.abs(coordinates).max(axis=-1)
    improper = np.abs(coordinates[..., 5]) <= GROUP_TOLERANCE * size
    wrong = np.flatnonzero(~is_plane(coordinates) | improper)
    if len(wrong):
        raise MeshError(
            f"Lie coordinates of a plane must have x1 + x2 = 0 and x6 other than 0; row "
            f"{wrong[0]} is {coordinates[wrong[0]].tolist()} ({len(wrong)} such rows). Read "
            f"spheres with spheres_of; the improper point is neither."
        )
    height = 0.5 * (coordinates[..., 0:1] - coordinates[..., 1:2])
    rows = np.concatenate([coordinates[..., 2:5], height], axis=-1)
    return np.asarray(rows / coordinates[..., 5:] + 0.0)


# --- products -------------------------------------------------------------------------------


def lie_product(x: Floats, y: Floats) -> Floats:
    """Products of signature (4, 2) of Lie coordinates (..., 6); 0 is oriented contact.

    Sphere and plane: n . p - h - r. Two spheres: half the negative square of their tangential
    distance.

    Examples
    --------
    >>> unit_sphere = lie_coordinates([0.0, 0.0, 0.0, -1.0])
    >>> float(lie_product(unit_sphere, lie_coordinates_of_planes([0.0, 0.0, 1.0, 1.0])))
    0.0
    """
    return np.asarray(np.einsum("...i,ij,...j->...", x, LIE, y))


def lorentz_product(a: Floats, b: Floats) -> Floats:
    """Products p . q - r s of rows (p, r) and (q, s), shape (..., 4); model unit squared."""
    return np.asarray(np.einsum("...i,...i->...", a[..., :3], b[..., :3]) - a[..., 3] * b[..., 3])


def is_in_contact(x: Floats, y: Floats, tolerance: float = 1e-9) -> Mask:
    """Truth where Lie coordinates (..., 6) are in oriented contact: they share a tangent plane.

    Parameters
    ----------
    tolerance : float
        On the product, over the product of the lengths of both rows.
    """
    size = np.linalg.norm(x, axis=-1) * np.linalg.norm(y, axis=-1)
    return np.asarray(np.abs(lie_product(x, y)) <= tolerance * size)


def tangential_distance(spheres: Floats, others: Floats) -> Floats:
    """Length of common tangents between contact points, model unit; NaN where there is none.

    Two oriented spheres have common tangent planes exactly when their difference is spacelike
    (a cone or cylinder of them) or lightlike (one plane, distance 0).

    Parameters
    ----------
    spheres, others : (..., 4), model unit

    References: [thesis] lemma 5.3.2; errata page, E27.

    Examples
    --------
    >>> first = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
    >>> tangential_distance(first, np.array([[5.0, 0.0, 0.0, 4.0], [1.0, 0.0, 0.0, 4.0]]))
    array([ 4., nan])
    """
    gap = spheres - others
    square = lorentz_product(gap, gap)
    # Rounding of the difference must not turn spheres in contact into ones without a plane.
    slack = 1e-14 * sum(np.einsum("...i,...i->...", rows, rows) for rows in (spheres, others))
    return np.where(square >= -slack, np.sqrt(np.maximum(square, 0.0)), np.nan)


# --- the group ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class LieTransform:
    """A Lie sphere transformation: keeps oriented contact; A and -A are the same.

    Parameters
    ----------
    matrix : (6, 6)
        A with A' L A = L, where L = diag(-1, 1, 1, 1, 1, -1).

    Raises
    ------
    MeshError
        When the matrix does not keep the Lie product; names the error.

    References: [thesis] corollary 5.2.2; errata page, E21, E22.

    Examples
    --------
    >>> turned = LieTransform(np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]))
    >>> spheres_of(turned.on(lie_coordinates([[1.0, 2.0, 3.0, 5.0]])))
    array([[ 1.,  2.,  3., -5.]])
    >>> turned.is_moebius, turned.is_laguerre, (turned @ turned).is_same(turned.inverse)
    (True, True, False)
    """

    matrix: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", checked_matrix(self.matrix, LIE, "Lie"))

    @classmethod
    def random(cls, rng: np.random.Generator, size: float = 0.5) -> Self:
        """Exponential of a random element of the Lie algebra, with entries of about `size`."""
        square = size * rng.normal(size=(6, 6))
        return cls(expm(LIE @ (square - square.T)))

    def __matmul__(self, other: LieTransform) -> Self:
        """First `other`, then this one."""
        return trusted(type(self), matrix=self.matrix @ other.matrix)

    @cached_property
    def inverse(self) -> Self:
        """The transformation that undoes this one: L A' L."""
        return trusted(type(self), matrix=LIE @ self.matrix.T @ LIE)

    def on(self, coordinates: Floats) -> Floats:
        """Images of Lie coordinates, shape (N, 6), not rescaled."""
        return np.asarray(coordinates @ self.matrix.T)

    def is_same(self, other: LieTransform, tolerance: float = 1e-9) -> bool:
        """Whether both act alike: the matrices agree up to sign."""
        gap = min(float(np.abs(self.matrix - s * other.matrix).max()) for s in (1.0, -1.0))
        return gap <= tolerance * float(np.abs(self.matrix).max())

    @cached_property
    def is_laguerre(self) -> bool:
        """Whether planes go to planes: the improper point is fixed."""
        image = self.matrix @ IMPROPER_POINT
        return bool(np.abs(image - image[0] * IMPROPER_POINT).max() <= self._slack)

    @cached_property
    def is_moebius(self) -> bool:
        """Whether points go to points: radius 0 stays radius 0."""
        last = np.concatenate([self.matrix[5, :5], self.matrix[:5, 5]])
        return bool(np.abs(last).max() <= self._slack)

    @property
    def _slack(self) -> float:
        """Rounding that a chain of products may have left."""
        return 1e3 * GROUP_TOLERANCE * float(np.abs(self.matrix).max()) ** 2


def trusted(kind: type[T], **values: Any) -> T:
    """A value of the group from others of it, without the check at the door.

    A product carries the rounding of its factors, which may be larger than it is itself.
    """
    made = object.__new__(kind)
    for name, value in values.items():
        kept = read_only(value) if isinstance(value, np.ndarray) else value
        object.__setattr__(made, name, kept)
    return made


def checked_matrix(matrix: ArrayLike, metric: Floats, name: str) -> Floats:
    """A read-only matrix that keeps a metric J, A' J A = J.

    The tolerance is 1e-12 times the square of the largest entry, which is cosh(rapidity) in a
    Lorentz matrix: products of such entries carry that rounding.

    Raises
    ------
    MeshError
        When its shape is wrong, an entry is not finite, or the metric is not kept.
    """
    n = len(metric)
    array = read_only(matrix)
    if array.shape != (n, n) or not np.isfinite(array).all():
        found = f"shape {array.shape}" if array.shape != (n, n) else "entries that are not finite"
        raise MeshError(
            f"The matrix of a {name} transformation must have shape ({n}, {n}) and finite "
            f"entries; found {found}. Give {n} rows of {n} numbers."
        )
    error = np.abs(array.T @ metric @ array - metric)
    largest = float(np.abs(array).max())
    if not error.max() <= GROUP_TOLERANCE * max(largest, 1.0) ** 2:
        i, j = np.unravel_index(int(error.argmax()), error.shape)
        signs = ", ".join(f"{int(s)}" for s in np.diag(metric))
        raise MeshError(
            f"The matrix T of a {name} transformation must keep J = diag({signs}), T'JT = J; "
            f"entry ({i}, {j}) is off by {error.max():.3g}. Make it of rotations, boosts and "
            f"reflections, with all 16 digits."
        )
    return array
