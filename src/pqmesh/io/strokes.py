"""Lines and curves of drawings as polylines, fine enough to look smooth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from pqmesh.errors import FormatError
from pqmesh.vectors import Floats

# Polylines keep this close to their curve, in shares of the extent of the drawing,
CHORD = 1e-4
# and turn by no more than this at a point where the curve is smooth.
TURN = np.radians(5.0)
LEVELS = 14
SHORTEST = 1e-6


class Curve(NamedTuple):
    """A piece of a drawing.

    Attributes
    ----------
    point_at : callable
        Points (k, 2) of parameters (k,).
    breaks : (b,)
        Parameters between which the curve is smooth.
    is_straight : bool
        True when it runs straight from break to break.
    """

    point_at: Callable[[Floats], Floats]
    breaks: Floats
    is_straight: bool = False


class Drawing(NamedTuple):
    """The curves that were selected in a file.

    Attributes
    ----------
    strokes : list of list of Curve
        Curves that run on into each other, in the unit of the file.
    metres : float or None
        Metres in that unit; None when the file does not say.
    """

    strokes: list[list[Curve]]
    metres: float | None


def polyline(points: Floats) -> Curve:
    """The curve that runs straight from point to point."""
    points = np.asarray(points, dtype=np.float64)[:, :2]
    breaks = np.arange(float(len(points)))

    def point_at(t: Floats) -> Floats:
        i = np.clip(t.astype(np.int64), 0, max(len(points) - 2, 0))
        share = (t - i)[:, None]
        end = points[np.minimum(i + 1, len(points) - 1)]
        return np.asarray((1.0 - share) * points[i] + share * end)

    return Curve(point_at, breaks, True)


def flattened(strokes: Sequence[Sequence[Curve]]) -> list[Floats]:
    """Polylines (k, 2) of the strokes, open or closed as these are.

    Raises
    ------
    FormatError
        When a coordinate is not finite.

    Examples
    --------
    >>> ring = Curve(lambda t: np.stack([np.cos(t), np.sin(t)], axis=1), np.array([0, 2 * np.pi]))
    >>> line = flattened([[ring]])[0]
    >>> bool(np.hypot(*(0.5 * (line[1:] + line[:-1])).T).min() > 1 - 2e-4)
    True
    """
    curves = [curve for stroke in strokes for curve in stroke]
    coarse = [_coarse(curve) for curve in curves]
    points = [curve.point_at(t) for curve, t in zip(curves, coarse, strict=True)]
    whole = np.concatenate(points) if points else np.zeros((1, 2))
    if not np.isfinite(whole).all() or np.abs(whole).max() > 1e150:
        raise FormatError("Coordinates must be finite; one is not. Mend the drawing.")
    extent = float(np.ptp(whole, axis=0).max())
    lines = iter(
        line if curve.is_straight else _refined(curve, t, line, extent)
        for curve, t, line in zip(curves, coarse, points, strict=True)
    )
    return [np.concatenate([next(lines) for _ in stroke]) for stroke in strokes if stroke]


def _coarse(curve: Curve) -> Floats:
    """Breaks, with seven parameters between any two of a curve that is not straight."""
    breaks = np.asarray(curve.breaks, dtype=np.float64)
    if curve.is_straight:
        return breaks
    steps = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0, 1, 9)[:-1]
    return np.append(steps.ravel(), breaks[-1])


def _refined(curve: Curve, t: Floats, line: Floats, extent: float) -> Floats:
    """The line with points added where a chord leaves the curve or turns much."""
    fresh = np.ones(len(t) - 1, dtype=np.bool_)
    for _ in range(LEVELS):
        at = np.flatnonzero(fresh)
        if len(at) == 0:
            break
        half = 0.5 * (t[at] + t[at + 1])
        middle = curve.point_at(half)
        first, second = middle - line[at], line[at + 1] - middle
        cross = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        inner = (first * second).sum(axis=1)
        chord = np.hypot(*(first + second).T)
        # Arcs of a closed curve may have no chord at all.
        away = np.where(chord > 0, np.abs(cross) / np.maximum(chord, 1e-300), np.hypot(*first.T))
        # The turn between two halves is half that between whole chords.
        bent = np.abs(np.arctan2(cross, inner)) > 0.5 * TURN
        long = np.hypot(*first.T) + np.hypot(*second.T) > SHORTEST * extent
        split = long & (bent | (away > CHORD * extent))
        where = at[split] + 1
        t, line = np.insert(t, where, half[split]), np.insert(line, where, middle[split], axis=0)
        new = np.zeros(len(t) - 1, dtype=np.bool_)
        places = where + np.arange(len(where))
        new[places - 1] = new[places] = True
        fresh = new
    return line
