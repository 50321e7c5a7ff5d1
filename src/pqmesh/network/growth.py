"""Lines of both families at whole heights over a probe, and whatever the region still lacks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import NetworkError
from pqmesh.network.crossings import crossings
from pqmesh.network.lines import Lines, joined, selected
from pqmesh.network.marks import Marks, one_per_level, served, wanted_marks
from pqmesh.network.numbering import Crossed, Heights, Numbered, even_heights
from pqmesh.network.patch import Patch, line_points, line_samples
from pqmesh.network.walker import Limits
from pqmesh.vectors import Mask

# Every round adds lines for some marks and strikes those marks out.
_ROUNDS = 12
# A later line nearer than this to earlier ones, in panels and in the median, is not wanted: it
# would split a strip in two.
_CROWDED = 0.5

_Families = tuple[Lines, Lines]


@dataclass(frozen=True, eq=False)
class Growth:
    """What stays fixed while a network grows.

    Attributes
    ----------
    patch : Patch
    spacing : (float, float), model unit
        Wanted mean distance of neighbouring lines of each family.
    limits : Limits
    most_lines : int
        Refuse beyond this many lines in a family.
    """

    patch: Patch
    spacing: tuple[float, float]
    limits: Limits
    most_lines: int

    def grown(self, probe: _Families) -> _Families:
        """Both families, spaced by the probe's lines."""
        rows = self._over_probe(probe)
        tried: tuple[set[tuple[int, int]], set[tuple[int, int]]] = (set(), set())
        for _ in range(_ROUNDS):
            families = (rows[0].lines, rows[1].lines)
            found = crossings(self.patch.surface, *families)
            chosen = []
            for family in (0, 1):
                crossed = Crossed(families[1 - family], found, family)
                marks = self._lacking(rows[family], crossed)
                names = list(zip(marks.level.tolist(), marks.rail.tolist(), strict=True))
                fresh = np.array([name not in tried[family] for name in names], dtype=np.bool_)
                tried[family].update(names)
                chosen.append(marks.only(fresh))
            if not any(map(len, chosen)):
                break
            rows = self._extended(rows, chosen, families)
        return rows[0].lines, rows[1].lines

    def _over_probe(self, probe: _Families) -> list[Numbered]:
        """Lines at whole heights wherever the probe's lines ask for one."""
        found = crossings(self.patch.surface, *probe)
        marks, rows = [], []
        for family in (0, 1):
            crossed = Crossed(probe[1 - family], found, family)
            heights = self._heights(crossed, len(probe[family]))
            marks.append(wanted_marks(self.patch, crossed, heights, self.spacing[family]))
            self._limit(len(np.unique(marks[family].level)))
            nothing = np.empty(0, dtype=np.int64)
            none = selected(probe[family], nothing)
            rows.append(Numbered(none, nothing, round(heights.period), none))
        for _ in range(_ROUNDS):
            chosen = []
            for family in (0, 1):
                pick = one_per_level(self.patch, probe[1 - family], marks[family])
                chosen.append(marks[family].only(pick))
                marks[family] = marks[family].only(np.delete(np.arange(len(marks[family])), pick))
            if not any(map(len, chosen)):
                break
            rows = self._extended(rows, chosen, probe)
            met = (
                crossings(self.patch.surface, rows[0].lines, probe[1]),
                crossings(self.patch.surface, probe[0], rows[1].lines),
            )
            for family in (0, 1):
                crossed = Crossed(probe[1 - family], met[family], family)
                done = served(self.patch, crossed, marks[family], rows[family])
                marks[family] = marks[family].only(~done)
        return rows

    def _heights(self, crossed: Crossed, count: int) -> Heights:
        """Heights of a family in panels; around a ring they are stretched to a whole number."""
        raw = even_heights(crossed, self.patch.inside(crossed.found.uv), count)
        spacing = self.spacing[crossed.family]
        if not raw.period:
            return Heights(raw.of / spacing, 0.0)
        period = max(round(raw.period / spacing), 3)
        return Heights(raw.of * (period / raw.period), float(period))

    def _lacking(self, row: Numbered, crossed: Crossed) -> Marks:
        """Marks of the network itself that no line serves, one of each height."""
        heights = Heights(row.levels.astype(np.float64), float(row.period))
        marks = wanted_marks(self.patch, crossed, heights, self.spacing[crossed.family])
        marks = marks.only(~served(self.patch, crossed, marks, row))
        return marks.only(one_per_level(self.patch, crossed.rails, marks))

    def _extended(
        self, rows: list[Numbered], marks: list[Marks], families: _Families
    ) -> list[Numbered]:
        """The rows with lines through marks on the lines of the other family."""
        seeds = [
            self.patch.seeds_on(families[1 - family], marks[family].rail, marks[family].arc)
            for family in (0, 1)
        ]
        more = self.patch.traced((seeds[0], seeds[1]), self.limits)
        result = []
        for family in (0, 1):
            row, new = rows[family], more[family]
            apart = self._apart(row.lines, new, self.spacing[family])
            real = np.flatnonzero(apart)
            levels = np.concatenate([row.levels, marks[family].level[real]])
            self._limit(len(levels))
            lines = joined([row.lines, selected(new, real)])
            shadows = joined([row.shadows, selected(new, np.flatnonzero(~apart))])
            result.append(Numbered(lines, levels, row.period, shadows))
        return result

    def _apart(self, old: Lines, new: Lines, spacing: float) -> Mask:
        """New lines that keep their distance from those before them; the first ones all do."""
        apart = np.diff(new.start) > 0
        if not len(old.arc) or not len(new.arc):
            return apart
        uv, owner = line_samples(self.patch.surface, new)
        points = self.patch.surface.jet(uv).point
        within = self.patch.inside(uv)
        sines = self.patch.sines(uv)
        trees = [cKDTree(line_points(self.patch.surface, old))]
        for line in np.flatnonzero(apart):
            mine = owner == line
            chosen = mine & within if (mine & within).any() else mine
            distance = np.min(np.stack([tree.query(points[chosen])[0] for tree in trees]), axis=0)
            apart[line] = np.median(distance / sines[chosen]) > _CROWDED * spacing
            if apart[line]:
                trees.append(cKDTree(points[mine]))
        return apart

    def _limit(self, count: int) -> None:
        if count > self.most_lines:
            raise NetworkError(
                f"A network may have up to {self.most_lines} lines in a family; panels of "
                f"{self.spacing[1]:g} x {self.spacing[0]:g} on a region of size "
                f"{self.patch.size:.3g} need more. Choose longer edges, or raise the limit."
            )
