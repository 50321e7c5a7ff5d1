"""Loops of a cut made into simple polygons: no double or straight points, no necks, no threads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pqmesh.fabricate.crossings import Nodes
from pqmesh.vectors import Floats, Mask, cross, dot, norm


class Tidied(NamedTuple):
    """Simple polygons, and the first hole that touches its outer loop, if there is one."""

    loops: list[list[int]]
    hole: list[int] | None


def tidied(loop: list[int], nodes: Nodes, normal: Floats) -> Tidied:
    """Simple polygons of a closed walk, each counterclockwise about the normal.

    Takes away points that double another, straight points that are no vertex, and threads and
    pieces thinner than the snap; takes a walk apart where it touches itself. Moves nothing.
    """
    waiting, result = [loop], []
    while waiting:
        current = _smoothed(waiting.pop(), nodes)
        if len(current) < 3 or is_thin(nodes.at(current), nodes.snap):
            continue
        current = _with_touching(current, nodes)
        parts = _parted(current)
        if len(parts) > 1:
            waiting += parts
        elif float(area_vector(nodes.at(current)) @ normal) < 0:
            return Tidied([], current)
        else:
            result.append(current)
    return Tidied(result, None)


def area_vector(points: Floats) -> Floats:
    """Vector area of a polygon (k, 3)."""
    away = points - points[0]
    products = cross(away, np.roll(away, -1, axis=0))
    return np.asarray(0.5 * products.sum(axis=0))


def area_vectors(polygons: Sequence[Floats]) -> Floats:
    """Vector areas of polygons, (P, 3), all at once."""
    sizes = np.array([len(points) for points in polygons])
    first = np.cumsum(sizes) - sizes
    points = np.concatenate(polygons)
    away = points - np.repeat(points[first], sizes, axis=0)
    after = np.arange(1, len(points) + 1)
    after[first + sizes - 1] = first
    return np.asarray(0.5 * np.add.reduceat(cross(away, away[after]), first, axis=0))


def is_thin(points: Floats, width: float) -> bool:
    """Whether a polygon is narrower than a width, on average over its length."""
    extent = float(norm(np.ptp(points, axis=0)))
    return 2.0 * float(norm(area_vector(points))) <= width * extent


def distance_to_segment(point: Floats, starts: Floats, ends: Floats) -> Floats:
    """Distances of points from segments, row by row or broadcast."""
    step = ends - starts
    square = dot(step, step)
    share = dot(point - starts, step) / np.where(square > 0, square, 1.0)
    foot = starts + np.clip(share, 0.0, 1.0)[..., None] * step
    return norm(point - foot)


def _smoothed(loop: list[int], nodes: Nodes) -> list[int]:
    """Loop without double points, straight points that are no vertex, and threads."""
    loop = list(loop)
    while len(loop) >= 3:
        points = nodes.at(loop)
        before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
        double = np.flatnonzero(norm(after - points) < nodes.snap)
        if len(double):
            first, second = int(double[0]), (int(double[0]) + 1) % len(loop)
            del loop[second if _rank(loop[first], nodes) <= _rank(loop[second], nodes) else first]
            continue
        is_vertex = np.array([number < nodes.n_vertices for number in loop])
        gone = _straight(points, before, after, nodes.snap) & ~is_vertex
        gone |= _tips(points, before, after, nodes.snap)
        if not gone.any():
            return loop
        del loop[int(np.argmax(gone))]
    return loop


def _rank(number: int, nodes: Nodes) -> int:
    """Which of two double points stays: vertices, then points on mesh edges."""
    if number < nodes.n_vertices:
        return 0
    return 1 if nodes.edge[number] >= 0 else 2


def _straight(points: Floats, before: Floats, after: Floats, snap: float) -> Mask:
    return np.asarray(distance_to_segment(points, before, after) < snap)


def _tips(points: Floats, before: Floats, after: Floats, snap: float) -> Mask:
    """Ends of threads: the shorter side lies on the longer one."""
    first, second = norm(before - points), norm(after - points)
    short = np.where((first < second)[:, None], before, after)
    long = np.where((first < second)[:, None], after, before)
    return np.asarray(distance_to_segment(short, points, long) < snap)


def _with_touching(loop: list[int], nodes: Nodes) -> list[int]:
    """Loop with a node set into every side of it that the node touches."""
    points = nodes.at(loop)
    n = len(loop)
    ends = np.roll(points, -1, axis=0)
    gaps = distance_to_segment(points[:, None], points[None], ends[None])
    number = np.arange(n)
    gaps[number, number] = gaps[number, number - 1] = np.inf
    result: list[int] = []
    for side in range(n):
        result.append(loop[side])
        own = (loop[side], loop[(side + 1) % n])
        touching = [k for k in np.flatnonzero(gaps[:, side] < nodes.snap) if loop[k] not in own]
        touching.sort(key=lambda k: float(norm(points[k] - points[side])))
        result += [loop[k] for k in touching]
    return result


def _parted(loop: list[int]) -> list[list[int]]:
    """Loop taken apart at the first node that it visits twice."""
    place: dict[int, int] = {}
    for k, number in enumerate(loop):
        if number in place:
            first = place[number]
            return [loop[first:k], loop[k:] + loop[:first]]
        place[number] = k
    return [loop]
