"""Ways that part a polygon through a hole in it."""

from __future__ import annotations

import itertools

import numpy as np

from pqmesh.fabricate.tidy import distance_to_segment
from pqmesh.fabricate.walls import interior_point, turn_signs
from pqmesh.vectors import Floats

Way = tuple[int, int, list[Floats]]


def segments_cross(a: Floats, b: Floats, c: Floats, d: Floats, *, touching: bool = False) -> bool:
    """Whether plan segments ab and cd cross, exactly; with `touching`, whether they meet."""
    turns = turn_signs(np.array([a, a, c, c]), np.array([b, b, d, d]), np.array([c, d, a, b]))
    first, second = int(turns[0] * turns[1]), int(turns[2] * turns[3])
    if touching and not turns.any():
        # On one line: they meet when their boxes do.
        low, high = (
            np.maximum(np.minimum(a, b), np.minimum(c, d)),
            np.minimum(np.maximum(a, b), np.maximum(c, d)),
        )
        return bool((low <= high).all())
    return first <= 0 and second <= 0 if touching else first < 0 and second < 0


def way_through(polygon: Floats, hole: Floats, gap: float = 0.0) -> Way | None:
    """Corners i < j of a polygon (n, 2) and the points between, through the inside of a hole.

    The way meets the hole at two of its corners where it can, so that no short sides arise:
    i - corner - inside - corner - j; else it goes straight, i - inside - j, as it always can
    from three corners of a triangle or a quad at least. Corners that are not neighbours come
    first, then short ways.

    Parameters
    ----------
    polygon : (n, 2), model unit
        Simple.
    hole : (k, 2)
        Simple, in the polygon; may touch it.
    gap : float, model unit
        Corners of the hole that lie as near as this to the polygon are not used.

    Examples
    --------
    >>> square = np.array([[0.0, 0], [4, 0], [4, 4], [0, 4]])
    >>> i, j, points = way_through(square, 0.5 * square + 0.5)
    >>> i, j, np.array(points).tolist()
    (0, 2, [[0.5, 0.5], [1.5, 1.5], [2.5, 2.5]])
    """
    middle = interior_point(hole)
    gates = [
        gate
        for corner in range(len(polygon))
        if (gate := _gate(polygon, corner, hole, middle)) and _margin(polygon, hole[gate[1]]) > gap
    ]
    ways: list[tuple[bool, float, Way]] = []
    for (i, p, reach_p), (j, q, reach_q) in itertools.combinations(gates, 2):
        if p == q or segments_cross(polygon[i], hole[p], polygon[j], hole[q], touching=True):
            continue
        ways.append(
            (_adjacent(polygon, i, j), reach_p + reach_q, (i, j, [hole[p], middle, hole[q]]))
        )
    if not any(not adjacent for adjacent, _, _ in ways):
        seen = [i for i in range(len(polygon)) if _is_free(polygon, i, middle)]
        reach = np.linalg.norm(polygon - middle, axis=1)
        for i, j in itertools.combinations(seen, 2):
            ways.append((_adjacent(polygon, i, j), float(reach[i] + reach[j]), (i, j, [middle])))
    return min(ways, key=lambda way: way[:2])[2] if ways else None


def _margin(polygon: Floats, place: Floats) -> float:
    """Distance of a place from the sides of a polygon."""
    return float(distance_to_segment(place, polygon, np.roll(polygon, -1, axis=0)).min())


def _adjacent(polygon: Floats, i: int, j: int) -> bool:
    return (j - i) % len(polygon) in (1, len(polygon) - 1)


def _gate(
    polygon: Floats, corner: int, hole: Floats, middle: Floats
) -> tuple[int, int, float] | None:
    """The nearest corner of the hole that a corner and the middle both see, with its distance."""
    reach = np.linalg.norm(hole - polygon[corner], axis=1)
    for k in np.argsort(reach, kind="stable")[:8].tolist():
        if reach[k] == 0 or not _is_free(polygon, corner, hole[k]):
            continue
        if _is_free(hole, k, polygon[corner]) and _is_free(hole, k, middle):
            return corner, k, float(reach[k])
    return None


def _is_free(polygon: Floats, corner: int, place: Floats) -> bool:
    """Whether the way from a place to a corner of a polygon meets none of its other sides."""
    n = len(polygon)
    beside = polygon[[corner - 1, (corner + 1) % n]]
    if not turn_signs(polygon[corner], place, beside).all():
        return False
    return not any(
        segments_cross(polygon[k], polygon[(k + 1) % n], polygon[corner], place, touching=True)
        for k in range(n)
        if corner not in (k, (k + 1) % n)
    )
