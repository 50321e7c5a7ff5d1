"""Vertical faces, which have no plan to cut: sections in their own plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.fabricate.crossings import Crossing, Section
from pqmesh.fabricate.walls import Walls, edge_sides
from pqmesh.vectors import Floats


class Upright(Section):
    """Section in the plane of a vertical face: along it, and up.

    The prism cuts the plane in upright strips, which take the place of the outline.
    """

    def __init__(
        self,
        plan: Section,
        xy: dict[int, Floats],
        walls: Walls,
        sources: list[int],
        frame: tuple[Floats, Floats],
    ) -> None:
        super().__init__(plan.nodes, xy, walls)
        self.plan, self.sources = plan, sources
        self.center, self.along = frame

    def flat(self, points: Floats) -> Floats:
        """Coordinates along and up, (k, 2)."""
        away = points - self.center
        return np.stack([away[:, :2] @ self.along, away[:, 2]], axis=1)

    def node_on(self, crossing: Crossing, before: Crossing | None, edge: int) -> int:
        """The node that neighbours use for this edge and wall, or else a new one."""
        low, high = crossing.pair
        for known in self.plan.crossings(low, high):
            if known.wall == self.sources[crossing.wall]:
                return known.node
        return super().node_on(crossing, before, edge)


@dataclass(frozen=True)
class _Strip:
    """Part of a line inside the outline, with the walls at its ends."""

    low: float
    high: float
    walls: tuple[int, int]


def upright_section(plan: Section, corners: list[int], center: Floats, normal: Floats) -> Upright:
    """Section of a vertical face with its normal towards the viewer."""
    flat = np.array([-normal[1], normal[0]])
    size = float(np.linalg.norm(flat))
    along = flat / size if size > 0 else np.array([1.0, 0.0])
    points = plan.nodes.at(corners)
    heights = points[:, 2] - center[2]
    low, high = float(heights.min()), float(heights.max())
    margin = high - low + float(np.ptp(points[:, :2], axis=0).max()) + 1.0
    rings, sources = [], []
    for strip in _strips(center[:2], along, plan.walls):
        bottom, top = low - margin, high + margin
        ring = [[strip.low, bottom], [strip.high, bottom], [strip.high, top], [strip.low, top]]
        rings.append(np.array(ring))
        sources += [-1, strip.walls[1], -1, strip.walls[0]]
    if not rings:
        rings, sources = [np.array([[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]) * 1e6 * margin], [-1] * 3
    section = Upright(plan, {}, Walls.of_rings(rings), sources, (center, along))
    section.xy.update(zip(corners, section.flat(points), strict=True))
    return section


def _strips(origin: Floats, along: Floats, walls: Walls) -> list[_Strip]:
    """Where a line in plan runs inside the outline."""
    first = edge_sides(origin, origin + along, walls.starts)
    second = edge_sides(origin, origin + along, walls.ends)
    numbers = np.flatnonzero(first != second)
    away = walls.starts[numbers] - origin
    step = walls.ends[numbers] - walls.starts[numbers]
    across = along[0] * step[:, 1] - along[1] * step[:, 0]
    where = (away[:, 0] * step[:, 1] - away[:, 1] * step[:, 0]) / across
    order = np.argsort(where, kind="stable")
    return [
        _Strip(float(where[a]), float(where[b]), (int(numbers[a]), int(numbers[b])))
        for a, b in zip(order[0::2], order[1::2], strict=True)
        if where[a] < where[b]
    ]
