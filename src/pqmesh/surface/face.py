"""One face: a surface with the loops that bound it in the parameter plane."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pqmesh.surface.base import Domain, Surface
from pqmesh.vectors import TINY, Floats, Indices, Mask

# Samples of each face in each direction.
SAMPLES = 48
# Points on each side of a loop that is the rectangle of a domain.
SIDE = 96


@dataclass(frozen=True, eq=False)
class Patch:
    """A parametric surface with the loops that bound its face in the parameter plane.

    Attributes
    ----------
    surface : Surface
    loops : tuple of (n, 2)
        Outer loop and holes, not closed by repetition; none for the whole domain.
    name : str
    """

    surface: Surface
    loops: tuple[Floats, ...] = ()
    name: str = ""

    @cached_property
    def rings(self) -> tuple[Floats, ...]:
        """The loops, or the rectangle of the domain when there are none."""
        square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        domain = self.surface.domain
        return self.loops or (square * domain.size + domain.low,)

    def plan_rings(self) -> tuple[Floats, ...]:
        """Loops of the face in plan, the outer one first, (n, 2) each."""
        loops = self.loops or (_bounds(self.surface.domain),)
        domain = self.surface.domain
        # Loops may run on over a periodic bound.
        turned = [np.where(domain.periodic, domain.reduce(loop), loop) for loop in loops]
        return tuple(self.surface.jet(loop).point[:, :2] for loop in turned)

    def contains(self, uv: Floats) -> Mask:
        """Truth for parameters (N, 2) inside the face: even-odd over its loops."""
        if not self.loops:
            return self.surface.domain.inside(uv, 1e-12)
        inside = np.zeros(len(uv), dtype=np.bool_)
        for loop in self.loops:
            inside ^= even_odd(loop, uv)
        return inside

    def rim_distance(self, uv: Floats) -> Floats:
        """Distance of parameters (N, 2) from the loops, in domain sizes."""
        size = self.surface.domain.size
        gaps = [ring_distance(ring / size, uv / size) for ring in self.rings]
        return np.asarray(np.min(gaps, axis=0))

    def outside(self, uv: Floats) -> Floats:
        """How far parameters lie outside the face, in domain sizes; 0 inside. Shape (N,)."""
        distance = np.zeros(len(uv))
        beyond = np.flatnonzero(~self.contains(uv))
        if len(beyond):
            distance[beyond] = self.rim_distance(uv[beyond])
        return distance

    def samples(self) -> tuple[Floats, Floats]:
        """Parameters (M, 2) inside the face, on a grid over its outer loop, and the grid's step."""
        ring = self.rings[0]
        low, size = ring.min(axis=0), np.ptp(ring, axis=0)
        uv = Domain((0.0, 1.0), (0.0, 1.0)).grid(SAMPLES, SAMPLES).reshape(-1, 2) * size + low
        return uv[self.contains(uv)], size / SAMPLES


def _bounds(domain: Domain) -> Floats:
    """The bounds of a domain as a dense ring."""
    share = np.arange(SIDE) / SIDE
    zero, one = np.zeros(SIDE), np.ones(SIDE)
    sides = [(share, zero), (one, share), (1.0 - share, one), (zero, 1.0 - share)]
    square = np.concatenate([np.column_stack(side) for side in sides])
    return np.asarray(domain.low + square * domain.size)


# Points times edges handled at once.
_BLOCK = 1_000_000
# Rings of up to so many sides are compared side by side, longer ones by those that are near.
SHORT = 64


def even_odd(ring: Floats, points: Floats) -> Mask:
    """Truth for points (N, 2) inside a ring (n, 2)."""
    x0, y0 = ring.T
    x1, y1 = np.roll(ring, -1, axis=0).T
    level = np.where(y1 == y0, 1.0, y1 - y0)
    if len(ring) <= SHORT and len(ring) * len(points) <= _BLOCK:
        x, y = points[:, :1], points[:, 1:2]
        crosses = (y >= np.minimum(y0, y1)) & (y < np.maximum(y0, y1))
        crosses &= x < x0 + (y - y0) * (x1 - x0) / level
        return np.asarray(crosses.sum(axis=1) % 2 == 1)
    # Points from below to above: those on the levels of a side are neighbours in this order.
    order = np.argsort(points[:, 1], kind="stable")
    heights = points[order, 1]
    first = np.searchsorted(heights, np.minimum(y0, y1))
    counts = np.searchsorted(heights, np.maximum(y0, y1)) - first
    crossed = np.zeros(len(points), dtype=np.int64)
    for sides in _blocks(counts):
        side = np.repeat(sides, counts[sides])
        skip = np.cumsum(counts[sides]) - counts[sides]
        row = order[np.arange(len(side)) + np.repeat(first[sides] - skip, counts[sides])]
        x, y = points[row, 0], points[row, 1]
        left = x < x0[side] + (y - y0[side]) * (x1[side] - x0[side]) / level[side]
        crossed += np.bincount(row[left], minlength=len(points))
    return np.asarray(crossed % 2 == 1)


def _blocks(counts: Indices) -> Iterator[Indices]:
    """Runs of sides that have about a block of points together."""
    total = np.cumsum(counts)
    ends = np.searchsorted(total, np.arange(_BLOCK, total[-1] + _BLOCK, _BLOCK)) + 1
    begin = 0
    for end in ends.tolist():
        if end > begin:
            yield np.arange(begin, min(end, len(counts)))
        begin = end


def ring_distance(ring: Floats, points: Floats) -> Floats:
    """Distance of points (N, 2) to a closed polyline."""
    along = np.roll(ring, -1, axis=0) - ring
    square = np.maximum((along**2).sum(axis=1), TINY)
    best = np.full(len(points), np.inf)
    if len(ring) <= SHORT:
        step = _BLOCK // len(ring)
        for first in range(0, len(points), step):
            here = slice(first, first + step)
            best[here] = _square_gaps(points[here], ring, along, square)
        return np.asarray(np.sqrt(best))
    runs = _runs(len(ring))
    step, pairs = max(_BLOCK // len(ring), 1), max(_BLOCK // runs.shape[1], 1)
    for first in range(0, len(points), step):
        row, run = _near_runs(ring, runs, points[first : first + step])
        row += first
        for part in range(0, len(row), pairs):
            rows, side = row[part : part + pairs], runs[run[part : part + pairs]]
            gaps = _square_gaps(points[rows], ring[side], along[side], square[side])
            np.minimum.at(best, rows, gaps)
    return np.asarray(np.sqrt(best))


def _square_gaps(points: Floats, starts: Floats, along: Floats, square: Floats) -> Floats:
    """Squared distances of points (k, 2) to the nearest of sides ([k,] n, 2)."""
    offset = points[:, None] - starts
    share = np.clip((offset * along).sum(axis=2) / square, 0.0, 1.0)
    gap = offset - share[..., None] * along
    return np.asarray((gap**2).sum(axis=2).min(axis=1))


def _runs(n: int) -> Indices:
    """Sides of a ring in runs of equal length; the last side may repeat."""
    length = int(n**0.5)
    count = -(-n // length)
    return np.minimum(np.arange(count * length), n - 1).reshape(count, length)


def _near_runs(ring: Floats, runs: Indices, points: Floats) -> tuple[Indices, Indices]:
    """Pairs of points and runs among which each point's nearest side is."""
    corners = ring[np.concatenate([runs, (runs[:, -1:] + 1) % len(ring)], axis=1)]
    centre = 0.5 * (corners.min(axis=1) + corners.max(axis=1))
    radius = np.sqrt(((corners - centre[:, None]) ** 2).sum(axis=2).max(axis=1))
    away = np.sqrt(((points[:, None] - centre) ** 2).sum(axis=2))
    bound = (away + radius).min(axis=1, keepdims=True)
    # Written so that what is not a number stays.
    row, run = np.nonzero(~(away - radius > bound * (1.0 + 1e-9)))
    return row, run
