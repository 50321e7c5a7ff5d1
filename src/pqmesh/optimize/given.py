"""Values that a user gives for a constraint, checked: numbers, points, directions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import SpecError
from pqmesh.vectors import Floats

# Squares of squares of larger coordinates leave the range of doubles.
LARGEST = 1e50


def whole_numbers(values: Any, name: str) -> tuple[int, ...]:
    """A non-empty tuple of whole numbers."""
    numbers = np.asarray(list(values))
    if not numbers.size or numbers.ndim != 1 or not np.issubdtype(numbers.dtype, np.integer):
        raise SpecError(
            f"A list of {name} must be whole numbers, at least one; found {list(values)!r:.80}. "
            f"Mend it."
        )
    return tuple(numbers.tolist())


def finite_points(values: ArrayLike, name: str, least: int = 1) -> Floats:
    """Points (n, 3), finite, at least so many."""
    try:
        points = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < least:
        raise SpecError(
            f"{name} must be at least {least} points of 3 coordinates; found "
            f"{_shown(values)}. Write [x, y, z] for each."
        )
    bad = np.flatnonzero(~(np.abs(points) <= LARGEST).all(axis=1))
    if len(bad):
        raise SpecError(
            f"{name} must have finite coordinates below {LARGEST:g}; point {bad[0]} is "
            f"{points[bad[0]].tolist()}. Mend it."
        )
    return points


def frozen_points(points: Floats) -> tuple[tuple[float, ...], ...]:
    """Points as a value that compares and never changes."""
    return tuple(map(tuple, points.tolist()))


def above_zero(value: float, name: str) -> None:
    """Refuse what is not a finite number above 0."""
    if not 0 < value < math.inf:
        raise SpecError(f"{name} must be a finite number above 0; found {value:g}. Mend it.")


def finite_point(value: Any, name: str) -> tuple[float, ...]:
    """One point as a value."""
    return frozen_points(finite_points([value], name))[0]


def direction(value: Any, name: str) -> tuple[float, ...]:
    """A direction as a value; it has a length."""
    found = finite_point(value, name)
    if max(map(abs, found)) < 1.0 / LARGEST:
        raise SpecError(f"{name} must have a length above 0; found {found}. Give a direction.")
    return found


def _shown(values: Any) -> str:
    """A value in a message of one line."""
    text = repr(values.tolist() if isinstance(values, np.ndarray) else values)
    return text if len(text) <= 80 else text[:77] + "..."
