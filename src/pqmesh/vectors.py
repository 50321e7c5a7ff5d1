"""Rows of 3-vectors: array names, read-only copies, and the few products the field needs."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]

TINY = float(np.finfo(np.float64).tiny)
# Geometry that lies farther from the origin than this many of its extents is moved there.
FAR = 10.0


def read_only(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """Contiguous copy that refuses to be written to."""
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def dot(a: Floats, b: Floats) -> Floats:
    """Inner products of the rows of two (..., 3) arrays."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def cross(a: Floats, b: Floats) -> Floats:
    """Cross products of the rows; about four times faster than `numpy.cross` on long arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def norm(a: Floats) -> Floats:
    """Lengths of the rows."""
    return np.sqrt(dot(a, a))


def unit(a: Floats) -> Floats:
    """Rows scaled to length 1; a zero row stays zero."""
    length = norm(a)
    return np.asarray(a / np.where(length > TINY, length, 1.0)[..., None])


def angle(a: Floats, b: Floats) -> Floats:
    """Angles between the rows in [0, pi], by atan2: full accuracy near 0 and pi."""
    return np.asarray(np.arctan2(norm(cross(a, b)), dot(a, b)))


def far_origin(points: Floats) -> Floats:
    """Whole numbers near the middle of far-away points, zero for near ones.

    Products of coordinates of 5e8 keep eight digits; taking a whole number off loses none.
    """
    if not np.isfinite(points).all():
        return np.zeros(3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * low + 0.5 * high
    far = float(np.abs(middle).max()) > FAR * float((high - low).max())
    return np.round(middle) + 0.0 if far else np.zeros(3)
