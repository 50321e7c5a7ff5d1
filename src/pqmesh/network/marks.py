"""Places on rails where the lines of a family ought to cross: whole heights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.network.lines import Lines, joined
from pqmesh.network.numbering import Crossed, Heights, Numbered, Pieces, pieces
from pqmesh.network.patch import Patch, line_points
from pqmesh.vectors import Floats, Indices, Mask, norm

# A mark is served by a line that passes within this many panels of it ...
_SERVED = 0.6
# ... or, where the line bears the mark's own height, within this many.
_SERVED_BY_NAME = 1.5
_TINY = 1e-6
# Panels at the end of a rail count as no narrower and no wider than this, in wanted edges.
_LAST = (0.4, 2.5)
# Heights from here on are no heights but mere numbers.
_NAMELESS = 10**9


@dataclass(frozen=True, eq=False)
class Marks:
    """n wanted crossings: height, rail, arc length on it, arc length of a panel there."""

    level: Indices
    rail: Indices
    arc: Floats
    panel: Floats

    def __len__(self) -> int:
        return len(self.level)

    def only(self, which: Indices | Mask) -> Marks:
        """Some of the marks."""
        return Marks(self.level[which], self.rail[which], self.arc[which], self.panel[which])


class _Ruler(NamedTuple):
    """Pieces of rails, how the heights rise along each, which way along each rail they rise."""

    parts: Pieces
    rise: Floats
    sign: Floats
    edge: float


def wanted_marks(patch: Patch, crossed: Crossed, heights: Heights, edge: float) -> Marks:
    """Marks of a family that the region needs: those with a point of it within a panel.

    Between crossings the height is interpolated. Past the last crossing of a rail the panels
    go from the last one there to the wanted edge, half of the way in each step.
    """
    parts = pieces(crossed)
    sign = _rail_signs(crossed, parts, heights)
    rise = heights.rise(parts.p, parts.q, sign[parts.rail] * parts.length / edge)
    ruler = _Ruler(parts, rise, sign, edge)
    tails = _beyond(crossed, heights.of, ruler)
    marks = _together([_between(ruler, heights.of[parts.p]), _unnumbered(ruler), *tails])
    if heights.period:
        level = np.mod(marks.level, round(heights.period))
        marks = replace(marks, level=np.where(marks.level < _NAMELESS, level, marks.level))
    return marks.only(_needed(patch, crossed, marks, edge))


def _together(parts: list[Marks]) -> Marks:
    """All marks of several lists."""
    return Marks(
        np.concatenate([part.level for part in parts]),
        np.concatenate([part.rail for part in parts]),
        np.concatenate([part.arc for part in parts]),
        np.concatenate([part.panel for part in parts]),
    )


def _rail_signs(crossed: Crossed, parts: Pieces, heights: Heights) -> Floats:
    """+1 for rails along which the heights rise, -1 for the others."""
    rails, found, family = crossed
    votes = heights.rise(parts.p, parts.q, np.zeros(len(parts.p)))
    sign = np.sign(np.bincount(parts.rail, votes, minlength=len(rails)))
    # Rails with a single crossing follow the rails that cross the same line.
    line, rail = found.lines[:, family], found.lines[:, 1 - family]
    line_sign = np.sign(np.bincount(line, sign[rail] * found.side))
    guess = np.sign(np.bincount(rail, line_sign[line] * found.side, minlength=len(rails)))
    sign = np.where(sign == 0, guess, sign)
    return np.where(sign == 0, 1.0, sign)


def _between(ruler: _Ruler, low: Floats) -> Marks:
    """Whole heights between neighbouring crossings, of which the first has height `low`."""
    parts, rise = ruler.parts, ruler.rise
    bottom, top = np.minimum(low, low + rise), np.maximum(low, low + rise)
    first = np.floor(bottom + _TINY).astype(np.int64) + 1
    count = np.floor(top + _TINY).astype(np.int64) - first + 1
    piece, step = _counted(np.where(_sound(ruler), count, 0))
    level = first[piece] + step
    arc = parts.begin[piece] + (level - low[piece]) / rise[piece] * parts.length[piece]
    return Marks(level, parts.rail[piece], arc, parts.length[piece] / np.abs(rise[piece]))


def _counted(count: Indices) -> tuple[Indices, Indices]:
    """For counts 2, 0, 3: rows 0 0 2 2 2 and steps 0 1 0 1 2."""
    count = np.maximum(count, 0)
    row = np.repeat(np.arange(len(count)), count)
    return row, np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)


def _sound(ruler: _Ruler) -> Mask:
    """Pieces on which the numbering makes sense: it rises, neither too fast nor too slowly."""
    rise = ruler.rise * ruler.sign[ruler.parts.rail]
    panels = ruler.parts.length / ruler.edge
    return np.asarray((rise > 0) & (rise < 2.0 * panels + 2.0) & (panels < 4.0 * rise))


def _unnumbered(ruler: _Ruler) -> Marks:
    """Even marks on wide pieces without a sound numbering, on the rail that has most of them.

    Around umbilics and on spirals no numbering fits; there each mark gets a height of its own.
    """
    parts = ruler.parts
    count = np.maximum(np.round(parts.length / ruler.edge).astype(np.int64) - 1, 0)
    count[_sound(ruler)] = 0
    if count.any():
        count[parts.rail != np.bincount(parts.rail, count).argmax()] = 0
    piece, step = _counted(count)
    panel = parts.length[piece] / (count[piece] + 1)
    arc = parts.begin[piece] + (step + 1) * panel
    return Marks(_NAMELESS + np.arange(len(step)), parts.rail[piece], arc, panel)


def _beyond(crossed: Crossed, heights: Floats, ruler: _Ruler) -> list[Marks]:
    """Whole heights past the first and the last crossing of rails that are no ring."""
    rails, found, family = crossed
    parts, edge = ruler.parts, ruler.edge
    panel = parts.length / np.maximum(np.abs(ruler.rise), 1e-3)
    panel = np.clip(panel, _LAST[0] * edge, _LAST[1] * edge)
    after = dict(zip(parts.i.tolist(), panel.tolist(), strict=True))
    before = dict(zip(parts.j.tolist(), panel.tolist(), strict=True))
    rings = set(parts.rail[parts.wraps].tolist())
    result = []
    for sequence in found.sequences[1 - family]:
        rail = int(found.lines[sequence[0], 1 - family])
        if rail in rings:
            continue
        total = float(rails.total[rail])
        for end, known, out in ((sequence[0], after, -1.0), (sequence[-1], before, 1.0)):
            arc, height = float(found.arcs[end, 1 - family]), heights[found.lines[end, family]]
            way = out * ruler.sign[rail]
            room = total if rails.closed[rail] else total - arc if out > 0 else arc
            first = known.get(int(end), edge) / edge
            count, offset, size = _tail(way * height, first, room / edge)
            level = (way * count).astype(np.int64)
            row = np.full(len(level), rail)
            result.append(Marks(level, row, arc + out * edge * offset, edge * size))
    return result


def _tail(height: float, panel: float, room: float) -> tuple[Floats, Floats, Floats]:
    """Whole heights from a height upwards, their distances, and panels; lengths in edges."""
    count = int(room / _LAST[0]) + 2
    sizes = panel ** (0.5 ** np.arange(1.0, count + 1.0))
    start = np.ceil(height - _TINY)
    distance = (start - height) * sizes[0] + np.concatenate([[0.0], np.cumsum(sizes[1:])])
    kept = distance <= room + _TINY
    return (start + np.arange(count))[kept], distance[kept], sizes[kept]


def _needed(patch: Patch, crossed: Crossed, marks: Marks, across: float) -> Mask:
    """Marks with a point of the region within a panel."""
    uv, along = patch.on(crossed.rails, marks.rail, marks.arc)
    jet = patch.surface.jet(uv)
    axes = patch.axes(uv, along, crossed.family)
    # A region smaller than a panel slips through the grid of 5 x 5 points around a mark.
    needed = np.asarray(cKDTree(patch.points).query(jet.point)[0] < marks.panel)
    for a in np.linspace(-1.0, 1.0, 5):
        for b in np.linspace(-1.0, 1.0, 5):
            rest = np.flatnonzero(~needed)
            aside = uv[rest] + a * marks.panel[rest, None] * axes[rest, 0]
            aside += b * across * axes[rest, 1]
            needed[rest] = patch.inside(patch.surface.domain.reduce(aside))
    return needed


def served(patch: Patch, crossed: Crossed, marks: Marks, row: Numbered) -> Mask:
    """Marks near a line, or on a rail that the line of that height crosses not much farther on."""
    if not len(row.lines.arc) or not len(marks):
        return np.zeros(len(marks), dtype=np.bool_)
    rails, found, family = crossed
    uv, _ = patch.on(rails, marks.rail, marks.arc)
    aside = cKDTree(line_points(patch.surface, joined([row.lines, row.shadows]))).query(
        patch.surface.jet(uv).point
    )[0]
    line, rail = found.lines[:, family], found.lines[:, 1 - family]
    arc = found.arcs[:, 1 - family]
    # Closed rails: crossings again a turn earlier and later.
    turn = np.where(rails.closed[rail], rails.total[rail], 0.0)
    again = np.flatnonzero(turn > 0)
    arc = np.concatenate([arc, arc[again] - turn[again], arc[again] + turn[again]])
    rail, line = (np.concatenate([ids, ids[again], ids[again]]) for ids in (rail, line))
    names = np.unique(np.concatenate([row.levels, marks.level]), return_inverse=True)[1].reshape(-1)
    n = len(names)
    mine, wanted = rail * n + names[line], marks.rail * n + names[len(row.levels) :]
    along = _distance(mine, arc, wanted, marks.arc)
    aside = aside / patch.sines(uv)
    return np.asarray((aside < _SERVED * marks.panel) | (along < _SERVED_BY_NAME * marks.panel))


def _distance(group: Indices, arc: Floats, wanted_group: Indices, wanted: Floats) -> Floats:
    """Distance of each wanted place from the nearest arc of its group."""
    order = np.lexsort((arc, group))
    group, arc = group[order], arc[order]
    # Arcs shifted group by group onto one axis, far enough apart.
    low = float(min(arc.min(initial=0.0), wanted.min(initial=0.0)))
    reach = 4.0 * (float(max(arc.max(initial=0.0), wanted.max(initial=0.0))) - low + 1.0)
    groups = np.unique(np.concatenate([group, wanted_group]))
    axis = np.searchsorted(groups, group) * reach + arc - low
    at = np.searchsorted(groups, wanted_group) * reach + wanted - low
    place = np.searchsorted(axis, at)
    fence = np.concatenate([[-np.inf], axis, [np.inf]])
    return np.asarray(np.minimum(at - fence[place], fence[place + 1] - at))


def one_per_level(patch: Patch, rails: Lines, marks: Marks) -> Indices:
    """Of each height the mark nearest to the middle of its marks."""
    uv, _ = patch.on(rails, marks.rail, marks.arc)
    points = patch.surface.jet(uv).point
    _, level = np.unique(marks.level, return_inverse=True)
    level = level.reshape(-1)
    count = np.bincount(level)
    middle = np.stack([np.bincount(level, points[:, i]) / count for i in range(3)], axis=1)
    # Of two marks both are as near: which is taken must not hang on rounding.
    away = np.round(norm(points - middle[level]) / patch.size, 9)
    order = np.lexsort((away, level))
    return order[np.flatnonzero(np.diff(level[order], prepend=-1))]
