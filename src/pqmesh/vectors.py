"""Rows of 3-vectors: array names, read-only copies, and the few products the field needs."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]

TINY = float(np.finfo(np.float64).tiny)


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
