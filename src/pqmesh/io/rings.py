"""Closed rings of the strokes of a drawing: joined end to end, simple, nested once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import SpecError
from pqmesh.network.region import PlanOutline
from pqmesh.vectors import Floats, Indices, Mask

# Ends closer than this share of the drawing's extent are one point.
JOIN = 1e-5
SAME = 1e-9
# Pairs of segments looked at side by side.
BLOCK = 2_000_000


def outline_from_strokes(strokes: Sequence[Floats]) -> PlanOutline:
    """The outline that polylines draw: the largest ring, and the rings inside it as holes.

    Parameters
    ----------
    strokes : sequence of (k, 2)
        Closed ones repeat their first point; open ones are joined end to end.

    Raises
    ------
    SpecError
        When a ring is open, a point, or meets itself or another; when a ring lies outside the
        largest one or inside a hole. Names the place, in the coordinates of the strokes.

    Examples
    --------
    >>> corner = np.array([[0.0, 0], [4, 0], [4, 4]])
    >>> rest = np.array([[0.0, 0], [0, 4], [4, 4]])
    >>> hole = np.array([[1.0, 1], [2, 1], [2, 2], [1, 1]])
    >>> outline_from_strokes([corner, hole, rest]).area
    15.5
    """
    if not strokes:
        raise SpecError("An outline must have lines; found none. Draw one closed curve.")
    points = np.concatenate(strokes)
    extent = float(np.ptp(points, axis=0).max())
    if not extent > SAME * float(np.abs(points).max()):
        raise SpecError(
            f"An outline must enclose area; all of it lies at the point {_place(points[0])}. "
            f"Select a closed curve."
        )
    rings = [_checked(ring, extent) for ring in _joined(strokes, extent)]
    _refuse_crossing(rings, extent)
    rings.sort(key=lambda ring: -abs(_area(ring)))
    outline = PlanOutline(rings[0])
    for i, hole in enumerate(rings[1:], start=1):
        if not outline.contains(hole[:1])[0]:
            raise SpecError(
                f"Holes must lie inside the outline; the one at {_place(hole[0])} lies outside "
                f"the largest ring. Remove it, or select one outline."
            )
        for other in rings[1:i]:
            if PlanOutline(other).contains(hole[:1])[0]:
                raise SpecError(
                    f"Holes must lie side by side; the one at {_place(hole[0])} lies inside "
                    f"another. Remove one of them."
                )
    return PlanOutline(rings[0], tuple(rings[1:]))


def _joined(strokes: Sequence[Floats], extent: float) -> list[Floats]:
    """Rings without repetition: closed strokes as they are, open ones end to end."""
    near = JOIN * extent
    rings, pieces = [], []
    for stroke in strokes:
        closed = np.hypot(*(stroke[-1] - stroke[0])) <= near
        if closed and (len(stroke) > 2 or np.ptp(stroke, axis=0).max() <= near):
            rings.append(stroke[:-1] if len(stroke) > 1 else stroke)
        else:
            pieces.append(stroke)
    return rings + _chains(pieces, near)


def _chains(pieces: list[Floats], near: float) -> list[Floats]:
    """Rings of open pieces; end 2i is the start of piece i, 2i + 1 its end."""
    if not pieces:
        return []
    ends = np.array([end for piece in pieces for end in (piece[0], piece[-1])])
    partner = _partners(ends, near)
    free = set(range(len(pieces)))
    rings = []
    while free:
        first = min(free)
        parts, at = [], 2 * first
        while at // 2 in free:
            free.remove(at // 2)
            piece = pieces[at // 2]
            parts.append((piece if at % 2 == 0 else piece[::-1])[:-1])
            at = int(partner[at ^ 1])
        rings.append(np.concatenate(parts))
    return rings


def _partners(ends: Floats, near: float) -> Indices:
    """The one other end at the place of each end."""
    tree = cKDTree(ends)
    groups: list[list[int]] = list(np.asarray(tree.query_ball_point(ends, near), dtype=object))
    partner = np.zeros(len(ends), dtype=np.int64)
    for i, group in enumerate(groups):
        others = [j for j in group if j != i]
        if not others:
            gap = float(np.asarray(tree.query(ends[i], k=2)[0])[1])
            raise SpecError(
                f"An outline must be closed; it is open at {_place(ends[i])}, where the nearest "
                f"other end is {gap:.3g} away. Close it there."
            )
        if len(others) > 1:
            raise SpecError(
                f"An outline must run on in one way; at {_place(ends[i])} {len(others) + 1} ends "
                f"meet. Remove lines that are drawn twice or do not belong to it."
            )
        partner[i] = others[0]
    return partner


def _checked(ring: Floats, extent: float) -> Floats:
    """The ring without repeated points, refused when it has no area."""
    step = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    clean = np.asarray(ring[step > SAME * extent])
    size = float(np.ptp(ring, axis=0).max())
    if len(clean) < 3 or size <= JOIN * extent:
        what = "is a point" if size <= JOIN * extent else "runs back on itself"
        raise SpecError(
            f"An outline must enclose area; the ring at {_place(ring[0])} {what}. Remove it."
        )
    return clean


def _refuse_crossing(rings: list[Floats], extent: float) -> None:
    """Refuse rings that cross or touch themselves or each other; names the first place."""
    start = np.concatenate(rings)
    end = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    owner = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    following = np.concatenate(
        [
            np.roll(np.arange(len(ring)), -1) + base
            for ring, base in zip(rings, np.cumsum([0, *map(len, rings)]), strict=False)
        ]
    )
    _refuse_spike(start, end, following)
    # Segments sorted by their left ends: only those that begin before one ends can meet it.
    slack = SAME * extent
    low, high = np.minimum(start, end) - slack, np.maximum(start, end) + slack
    order = np.argsort(low[:, 0], kind="stable")
    last = np.searchsorted(low[order, 0], high[order, 0], side="right")
    counts = last - np.arange(len(order)) - 1
    begin = 0
    while begin < len(order):
        stop = begin + 1
        stop += int(np.searchsorted(np.cumsum(counts[begin + 1 :]), BLOCK))
        stop = min(stop, len(order))
        rows = np.arange(begin, stop)
        a = np.repeat(rows, counts[rows])
        skip = np.concatenate([[0], np.cumsum(counts[rows])])[:-1]
        b = a + 1 + np.arange(len(a)) - np.repeat(skip, counts[rows])
        i, j = order[a], order[b]
        keep = (low[i, 1] <= high[j, 1]) & (low[j, 1] <= high[i, 1])
        keep &= (following[i] != j) & (following[j] != i)
        i, j = i[keep], j[keep]
        met = np.flatnonzero(_meet(start[i], end[i], start[j], end[j], slack))
        if len(met):
            first, second = int(i[met[0]]), int(j[met[0]])
            place = _crossing(start[first], end[first], start[second], end[second])
            whom = "itself" if owner[first] == owner[second] else "another ring"
            raise SpecError(
                f"An outline must not cross or touch itself or its holes; one ring meets {whom} "
                f"at {_place(place)}. Mend it there."
            )
        begin = stop


def _refuse_spike(start: Floats, end: Floats, following: Indices) -> None:
    """Refuse a corner where the ring turns back onto itself."""
    a, b = end - start, (end - start)[following]
    lengths = np.hypot(*a.T) * np.hypot(*b.T)
    back = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) <= SAME * lengths
    back &= (a * b).sum(axis=1) < 0.0
    if back.any():
        place = end[int(np.argmax(back))]
        raise SpecError(
            f"An outline must not cross or touch itself or its holes; one ring turns back onto "
            f"itself at {_place(place)}. Mend it there."
        )


def _meet(a: Floats, b: Floats, c: Floats, d: Floats, slack: float) -> Mask:
    """Whether segments ab and cd, whose boxes meet, have a point in common within slack."""
    return np.asarray(
        (_side(a, b, c, slack) * _side(a, b, d, slack) <= 0)
        & (_side(c, d, a, slack) * _side(c, d, b, slack) <= 0)
    )


def _side(a: Floats, b: Floats, p: Floats, slack: float) -> Floats:
    """On which side of the line ab each point is: 1, -1, or 0 within slack."""
    line, over = b - a, p - a
    away = (line[:, 0] * over[:, 1] - line[:, 1] * over[:, 0]) / np.hypot(*line.T)
    return np.asarray(np.where(np.abs(away) <= slack, 0.0, np.sign(away)))


def _crossing(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """A point where two segments meet: the crossing, or a common end."""
    one, two = b - a, d - c
    area = float(one[0] * two[1] - one[1] * two[0])
    if abs(area) <= SAME * float(np.hypot(*one) * np.hypot(*two)):
        ends = np.array([c, d]) if _between(a, b, c) or _between(a, b, d) else np.array([a, a])
        return np.asarray(ends[0] if _between(a, b, ends[0]) else ends[1])
    over = c - a
    return np.asarray(a + (over[0] * two[1] - over[1] * two[0]) / area * one)


def _between(a: Floats, b: Floats, p: Floats) -> bool:
    return float((p - a) @ (b - a)) >= 0.0 and float((p - b) @ (a - b)) >= 0.0


def _area(ring: Floats) -> float:
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _place(point: Floats) -> str:
    return f"({point[0]:.9g}, {point[1]:.9g})"
