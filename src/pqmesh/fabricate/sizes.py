"""Sizes of flat panels: the smallest rectangle of stock that each is cut from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pqmesh.vectors import TINY, Floats, cross, dot, norm, unit


class PanelSize(NamedTuple):
    """Size of one flat polygon, model unit.

    Attributes
    ----------
    area : float
    perimeter : float
    width, height : float
        Sides of the smallest rectangle around it, width >= height.
    """

    area: float
    perimeter: float
    width: float
    height: float

    @property
    def waste(self) -> float:
        """Share of the stock rectangle that is cut away."""
        return 1.0 - self.area / (self.width * self.height)


def panel_size(polygon: Floats) -> PanelSize:
    """Size of a flat polygon (k, 3).

    The smallest rectangle around a polygon has a side along an edge of its convex hull
    (Freeman and Shapira 1975), so every pair of corners is tried that may be such an edge.

    Examples
    --------
    >>> triangle = np.array([[0, 0, 0], [4.0, 0, 0], [0, 3.0, 0]])
    >>> size = panel_size(triangle)
    >>> round(size.width * size.height, 12), round(size.waste, 12)
    (12.0, 0.5)
    """
    base = polygon - polygon[0]
    following = np.roll(base, -1, axis=0)
    area_vector = 0.5 * cross(base, following).sum(axis=0)
    area = float(norm(area_vector))
    normal = area_vector / max(area, TINY)
    pairs = (base[:, None] - base[None, :]).reshape(-1, 3)
    along = unit(pairs[norm(pairs) > 1e-12 * float(norm(base).max())])
    across = cross(np.broadcast_to(normal, along.shape), along)
    widths = np.ptp(base @ along.T, axis=0)
    heights = np.ptp(base @ across.T, axis=0)
    best = int((widths * heights).argmin())
    pair = (float(widths[best]), float(heights[best]))
    perimeter = float(np.sqrt(dot(following - base, following - base)).sum())
    return PanelSize(area, perimeter, max(pair), min(pair))


def panel_sizes(polygons: Sequence[Floats]) -> list[PanelSize]:
    """Sizes of many polygons."""
    return [panel_size(polygon) for polygon in polygons]
