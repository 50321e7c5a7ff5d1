"""A coarse network that passes everywhere in the region: it shows how far lines lie apart."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.network.lines import Lines, joined
from pqmesh.network.patch import Patch, Seeds, line_points
from pqmesh.network.walker import Limits
from pqmesh.vectors import Floats, Mask, norm

# Every round serves its own sample at least; more than this only refine a ragged rest.
_ROUNDS = 12
# Share of the samples that may stay far from lines: what lacks there is found at the end.
_REST = 0.003
_SAME = 1e-9
# Probe lines that need steps shorter than this share of what they may take wave within a panel.
LEAST_STEP, MANY_STEPS = 0.12, 2000


def probe_lines(patch: Patch, spacing: Floats, limits: Limits) -> tuple[Lines, Lines]:
    """Coarse lines of both families, no sample farther from either than about `spacing`, (2,).

    Each round traces the two lines through the sample farthest from any line, sets seeds at
    equal steps along both, and traces those: one line crosses its whole other family.
    """
    cover = _Cover(patch, spacing)
    for _ in range(_ROUNDS):
        worst = cover.worst()
        if worst is None:
            break
        uv, directions = patch.uv[worst : worst + 1], patch.directions[worst : worst + 1]
        cross_lines = patch.traced(((uv, directions[:, 0]), (uv, directions[:, 1])), limits)
        seeds = [cover.seeds(worst, family, cross_lines[1 - family]) for family in (0, 1)]
        cover.add(patch.traced((seeds[0], seeds[1]), limits))
        cover.distance[worst] = 0.0
        if cover.is_rough(limits.step):
            break
    return joined(cover.parts[0]), joined(cover.parts[1])


def _first_least(values: Floats) -> int:
    """Place of the first value that is the least but for rounding: no choice hangs on that."""
    least = float(values.min())
    return int(np.argmax(values <= least + _SAME * abs(least)))


class _Cover:
    """Lines traced so far, and the distance of every sample from each family.

    Distances are measured along the other family, as panels are.
    """

    def __init__(self, patch: Patch, spacing: Floats) -> None:
        self.patch, self.spacing = patch, spacing
        self.parts: tuple[list[Lines], list[Lines]] = ([], [])
        self.distance = np.full((len(patch.uv), 2), np.inf)
        self.distance[patch.weak] = 0.0
        self.sines = patch.sines(patch.uv)
        self.trees: list[list[cKDTree]] = [[], []]

    def worst(self) -> int | None:
        """The sample in greatest need of a line; the most central one to begin with."""
        need = (self.distance / self.spacing).max(axis=1)
        if np.isinf(need).any():
            clear = np.isinf(need) & self.patch.clear
            clear = clear if clear.any() else np.isinf(need)
            away = norm(self.patch.points - self.patch.points.mean(axis=0))
            return _first_least(np.where(clear, away, np.inf))
        worst = _first_least(-need)
        return worst if (need > 1.0).mean() > _REST else None

    def is_rough(self, step: float) -> bool:
        """Whether lines can be followed by tiny steps only: more of them would take for ever."""
        lengths = np.concatenate([lines.length for part in self.parts for lines in part])
        return bool(len(lengths) > MANY_STEPS and np.median(lengths) < LEAST_STEP * step)

    def seeds(self, worst: int, family: int, rail: Lines) -> Seeds:
        """Seeds of a family at equal steps along a line of the other one, where lines lack."""
        spacing, total = float(self.spacing[family]), float(rail.total[0])
        uv = self.patch.uv[worst : worst + 1]
        start = self.patch.directions[worst : worst + 1, family]
        if total > 0.0:
            aside = norm(rail.joints(0) - uv)
            here = float(np.append(rail.arc, total)[aside.argmin()])
            if rail.closed[0]:
                count = max(round(total / spacing), 3)
                arcs = total / count * np.arange(1.0, count)
            else:
                steps = np.arange(-(here // spacing), (total - here) // spacing + 1.0)
                arcs = here + spacing * steps[steps != 0]
            line = np.zeros(len(arcs), dtype=np.int64)
            if len(arcs):
                more = self.patch.seeds_on(rail, line, arcs)
                kept = self._near_region(more[0], arcs, spacing)
                uv = np.concatenate([uv, more[0][kept]])
                start = np.concatenate([start, more[1][kept]])
        free = self._free(family, uv)
        return uv[free], start[free]

    def _near_region(self, uv: Floats, arcs: Floats, spacing: float) -> Mask:
        """Places in the region, and one step beyond."""
        within = self.patch.inside(uv)
        reached = np.searchsorted(arcs, arcs[within])
        near = within.copy()
        for aside in (-1, 1):
            near[np.clip(reached + aside, 0, len(arcs) - 1)] = True
        return near

    def _free(self, family: int, uv: Floats) -> Mask:
        """Places at least half a step from every line of the family."""
        points = self.patch.surface.jet(uv).point
        free = np.ones(len(uv), dtype=np.bool_)
        apart = 0.5 * self.spacing[family] * self.patch.sines(uv)
        for tree in self.trees[family]:
            free &= tree.query(points)[0] > apart
        return free

    def add(self, lines: tuple[Lines, Lines]) -> None:
        """Take lines in, and measure from them."""
        for family, part in enumerate(lines):
            self.parts[family].append(part)
            if not len(part.arc):
                continue
            tree = cKDTree(line_points(self.patch.surface, part))
            self.trees[family].append(tree)
            column = self.distance[:, family]
            np.minimum(column, tree.query(self.patch.points)[0] / self.sines, out=column)
