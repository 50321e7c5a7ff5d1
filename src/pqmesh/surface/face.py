"""One face: a surface with the loops that bound it in the parameter plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pqmesh.surface.base import Domain, Surface
from pqmesh.vectors import TINY, Floats, Mask

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


def even_odd(ring: Floats, points: Floats) -> Mask:
    """Truth for points (N, 2) inside a ring (n, 2)."""
    x0, y0 = ring.T
    x1, y1 = np.roll(ring, -1, axis=0).T
    level = np.where(y1 == y0, 1.0, y1 - y0)
    low, high = np.minimum(y0, y1), np.maximum(y0, y1)
    inside = np.zeros(len(points), dtype=np.bool_)
    step = max(_BLOCK // len(ring), 1)
    for first in range(0, len(points), step):
        x, y = points[first : first + step, :1], points[first : first + step, 1:2]
        crosses = (y >= low) & (y < high) & (x < x0 + (y - y0) * (x1 - x0) / level)
        inside[first : first + step] = crosses.sum(axis=1) % 2 == 1
    return inside


def ring_distance(ring: Floats, points: Floats) -> Floats:
    """Distance of points (N, 2) to a closed polyline."""
    along = np.roll(ring, -1, axis=0) - ring
    square = np.maximum((along**2).sum(axis=1), TINY)
    best = np.empty(len(points))
    step = max(_BLOCK // len(ring), 1)
    for first in range(0, len(points), step):
        offset = points[first : first + step, None] - ring
        share = np.clip((offset * along).sum(axis=2) / square, 0.0, 1.0)
        gap = offset - share[..., None] * along
        best[first : first + step] = np.sqrt((gap**2).sum(axis=2)).min(axis=1)
    return best
