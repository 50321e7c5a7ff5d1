"""The part of a surface that a network is to cover: a plan outline with holes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.network.walker import Inside
from pqmesh.surface.base import Domain, Surface
from pqmesh.surface.plan import even_odd, ring_distance
from pqmesh.vectors import Floats, Mask, read_only

# A region in which fewer of the samples fall is sampled again around itself, so many times.
FEWEST, CLOSER = 0.01, 8


@dataclass(frozen=True, eq=False)
class PlanOutline:
    """Polygon in plan (x, y), with holes; covers what stands above it.

    Parameters
    ----------
    polygon : (n, 2), model unit
        At least three corners, in either direction, not closed by repetition.
    holes : sequence of (m, 2)

    Raises
    ------
    SpecError
        When a ring has fewer than three corners, is not finite or encloses no area.

    Examples
    --------
    >>> square = PlanOutline([[0, 0], [2, 0], [2, 2], [0, 2]])
    >>> square.contains(np.array([[1.0, 1.0, 5.0], [3.0, 1.0, 0.0]]))
    array([ True, False])
    >>> square.area
    4.0
    """

    polygon: Floats
    holes: tuple[Floats, ...] = ()
    rings: tuple[Floats, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rings = tuple(
            _ring(points, name)
            for name, points in [
                ("polygon", self.polygon),
                *[(f"hole {i}", hole) for i, hole in enumerate(self.holes)],
            ]
        )
        object.__setattr__(self, "polygon", rings[0])
        object.__setattr__(self, "holes", rings[1:])
        object.__setattr__(self, "rings", rings)

    @property
    def area(self) -> float:
        """Area in plan, holes taken off."""
        return abs(_signed_area(self.rings[0])) - sum(abs(_signed_area(r)) for r in self.rings[1:])

    def contains(self, points: Floats) -> Mask:
        """Truth for points (N, 2) or (N, 3): inside by the even-odd rule."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for ring in self.rings:
            inside ^= even_odd(ring, points[:, :2])
        return inside

    def near(self, points: Floats, reach: float) -> Mask:
        """Truth for points (N, 2) or (N, 3) inside, or within a plan distance of a ring."""
        close = self.contains(points)
        beyond = np.flatnonzero(~close)
        for ring in self.rings:
            close[beyond] |= ring_distance(ring, points[beyond, :2]) <= reach
        return close

    def on(self, surface: Surface, reach: float = 0.0) -> Inside:
        """The predicate over parameters that the network asks for, wider by a plan distance."""
        if reach == 0.0:
            return lambda uv: self.contains(surface.jet(uv).point)
        return lambda uv: self.near(surface.jet(uv).point, reach)


def region_samples(
    surface: Surface, inside: Inside | None, outline: PlanOutline | None, n: int
) -> tuple[Floats, float]:
    """Parameters (N, 2) of samples in a region, and the share of the parameters for each.

    They are the centres of n x n cells: of the whole domain, or of a smaller one around an
    outline into which few of those would fall.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> pin = PlanOutline([[0.1, 0.1], [0.101, 0.1], [0.101, 0.102], [0.1, 0.102]])
    >>> sheet = graph_surface("x*y", (-1, 1), (-1, 1))
    >>> uv, cell = region_samples(sheet, pin.on(sheet), pin, 40)
    >>> len(uv) >= 16, bool(abs(len(uv) * cell / 2e-6 - 1) < 0.1)
    (True, True)
    """
    domain = surface.domain
    for _ in range(CLOSER):
        uv = domain.grid(n, n).reshape(-1, 2)
        chosen = np.ones(len(uv), dtype=np.bool_) if inside is None else inside(uv)
        if outline is None or chosen.sum() >= FEWEST * len(uv):
            break
        plan = surface.jet(uv).point[:, :2].reshape(n, n, 2)
        pace = max(float(np.hypot(*np.diff(plan, axis=k).T).max()) for k in (0, 1))
        near = uv[outline.near(plan.reshape(-1, 2), pace)]
        if not len(near):
            break
        cell = domain.size / n
        low = np.maximum(near.min(axis=0) - cell, domain.low)
        high = np.minimum(near.max(axis=0) + cell, domain.low + domain.size)
        if np.prod(high - low) > 0.9 * np.prod(domain.size):
            break
        domain = Domain((low[0], high[0]), (low[1], high[1]))
    return uv[chosen], float(np.prod(domain.size)) / len(uv)


def _ring(points: Floats, name: str) -> Floats:
    """A checked ring."""
    ring = read_only(points)
    if ring.ndim != 2 or ring.shape[1] != 2 or len(ring) < 3:
        raise SpecError(
            f"An outline ring must be at least three points [x, y]; the {name} has shape "
            f"{ring.shape}. Give a list of pairs."
        )
    if not np.isfinite(ring).all():
        raise SpecError(f"An outline must be finite; the {name} is not. Mend its coordinates.")
    if abs(_signed_area(ring)) <= 1e-12 * float(np.ptp(ring, axis=0).max()) ** 2:
        raise SpecError(f"An outline must enclose area; the {name} has none. Mend its corners.")
    return ring


def _signed_area(ring: Floats) -> float:
    """Area, positive counterclockwise."""
    base = ring - ring[0]
    following = np.roll(base, -1, axis=0)
    return 0.5 * float(np.sum(base[:, 0] * following[:, 1] - base[:, 1] * following[:, 0]))
