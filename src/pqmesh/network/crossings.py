"""True intersections of two families of traced lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.network.lines import Lines
from pqmesh.surface.base import Surface
from pqmesh.vectors import Floats, Indices, norm

# Chords stand in for the curves while candidates are sought; this much beyond their ends
# still counts, since a curve bulges off its chord.
_CHORD_SLACK = 0.05


@dataclass(frozen=True, eq=False)
class Crossings:
    """N points where a line of family a meets a line of family b.

    Attributes
    ----------
    lines : (N, 2)
        Line of each family.
    arcs : (N, 2)
        Arc length along each.
    uv : (N, 2)
        Parameters inside the domain.
    side : (N,)
        +1 where b crosses a from right to left in the parameter plane, else -1.
    """

    lines: Indices
    arcs: Floats
    uv: Floats
    side: Floats

    def __len__(self) -> int:
        return len(self.lines)

    def order_along(self, family: int) -> Indices:
        """Crossings sorted by line of the family and by arc length along it."""
        return np.lexsort((self.arcs[:, family], self.lines[:, family]))

    @cached_property
    def sequences(self) -> tuple[list[Indices], list[Indices]]:
        """For each family and line that has any: its crossings in order, keyed by position."""
        found = []
        for family in (0, 1):
            order = self.order_along(family)
            lines = self.lines[order, family]
            cuts = np.flatnonzero(np.diff(lines)) + 1
            found.append(np.split(order, cuts) if len(order) else [])
        return found[0], found[1]


def crossings(surface: Surface, a: Lines, b: Lines) -> Crossings:
    """All crossings of two bundles of lines, to rounding error of their dense output.

    Chords of the segments give candidates; Newton's method on the curves themselves gives the
    points.
    """
    first, second = _candidates(surface, a, b)
    t, s, shift = _chord_parameters(surface, a, b, first, second)
    near = (t > -_CHORD_SLACK) & (t < 1 + _CHORD_SLACK)
    near &= (s > -_CHORD_SLACK) & (s < 1 + _CHORD_SLACK)
    first, second, shift, t, s = first[near], second[near], shift[near], t[near], s[near]
    for _ in range(6):
        gap = b.at(second, s) + shift - a.at(first, t)
        along, across = a.slope(first, t), b.slope(second, s)
        determinant = _det(along, -across)
        safe = np.where(np.abs(determinant) > 0, determinant, 1.0)
        t = np.clip(t + _det(gap, -across) / safe, -0.5, 1.5)
        s = np.clip(s + _det(along, gap) / safe, -0.5, 1.5)
    gap = norm((b.at(second, s) + shift - a.at(first, t)) / surface.domain.size)
    kept = (np.abs(t - 0.5) <= 0.5 + 1e-7) & (np.abs(s - 0.5) <= 0.5 + 1e-7) & (gap < 1e-9)
    first, second, t, s = first[kept], second[kept], t[kept], s[kept]
    along, across = a.slope(first, t), b.slope(second, s)
    found = Crossings(
        np.stack([a.line_of[first], b.line_of[second]], 1),
        np.stack([a.arc[first] + t * a.length[first], b.arc[second] + s * b.length[second]], 1),
        surface.domain.reduce(a.at(first, t)),
        np.sign(_det(along, across)),
    )
    return _distinct(found, a, b)


def _candidates(surface: Surface, a: Lines, b: Lines) -> tuple[Indices, Indices]:
    """Pairs of segments near enough in space to cross."""
    trees, reach = [], 0.0
    for lines in (a, b):
        middle = lines.at(np.arange(len(lines.arc)), np.full(len(lines.arc), 0.5))
        trees.append(cKDTree(surface.jet(surface.domain.reduce(middle)).point))
        reach += 0.55 * float(lines.length.max(initial=0.0))
    pairs = trees[0].sparse_distance_matrix(trees[1], reach, output_type="coo_matrix")
    return pairs.row.astype(np.int64), pairs.col.astype(np.int64)


def _chord_parameters(
    surface: Surface, a: Lines, b: Lines, first: Indices, second: Indices
) -> tuple[Floats, Floats, Floats]:
    """Fractions where the chords' lines meet, and the period shift of the second chord."""
    zero, one = np.zeros(len(first)), np.ones(len(first))
    p, q = a.at(first, zero), b.at(second, zero)
    r, w = a.at(first, one) - p, b.at(second, one) - q
    period = np.where(np.array(surface.domain.periodic), surface.domain.size, np.inf)
    turns = np.round((p - q) / period)
    shift = np.where(np.isfinite(period), turns * np.where(np.isfinite(period), period, 0.0), 0.0)
    gap = q + shift - p
    determinant = _det(r, -w)
    safe = np.where(np.abs(determinant) > 0, determinant, 1e-300)
    with np.errstate(over="ignore", invalid="ignore"):
        return _det(gap, -w) / safe, _det(r, gap) / safe, shift


def _distinct(found: Crossings, a: Lines, b: Lines) -> Crossings:
    """Crossings once each: those at a joint are found from both sides."""
    if not len(found):
        return found
    order = np.lexsort((found.arcs[:, 0], found.lines[:, 1], found.lines[:, 0]))
    lines, arcs = found.lines[order], found.arcs[order]
    reach = 1e-5 * max(float(a.length.max()), float(b.length.max()))
    again = (lines[1:] == lines[:-1]).all(axis=1) & (arcs[1:, 0] - arcs[:-1, 0] < reach)
    kept = order[np.concatenate([[True], ~again])]
    # A closed line's start is its end: keep the crossing at the start.
    for family, bundle in enumerate((a, b)):
        line = found.lines[kept, family]
        total = bundle.total[line]
        at_end = bundle.closed[line] & (found.arcs[kept, family] > total - reach)
        at_start = bundle.closed[line] & (found.arcs[kept, family] < reach)
        twins = {tuple(pair) for pair in found.lines[kept[at_start]].tolist()}
        double = [tuple(pair) in twins for pair in found.lines[kept[at_end]].tolist()]
        kept = np.delete(kept, np.flatnonzero(at_end)[np.array(double, dtype=bool)])
    return Crossings(found.lines[kept], found.arcs[kept], found.uv[kept], found.side[kept])


def _det(a: Floats, b: Floats) -> Floats:
    """Determinants of pairs of plane vectors."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
