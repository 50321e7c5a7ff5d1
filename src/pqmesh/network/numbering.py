"""Where the lines of a family stand across it: a height for each, rising evenly.

Pieces of the other family's lines between neighbouring crossings are measured. A line's height
is the number of mean panels between it and a first line; where the family closes to a ring, the
heights repeat after a whole number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from pqmesh.network.crossings import Crossings
from pqmesh.network.lines import Lines
from pqmesh.vectors import Floats, Indices, Mask

# Weight of a piece outside the region, which only carries the heights on.
_OUTSIDE = 1e-3


class Crossed(NamedTuple):
    """Lines of one family as rails, and where the lines of the given other family cross them."""

    rails: Lines
    found: Crossings
    family: int


@dataclass(frozen=True, eq=False)
class Numbered:
    """Lines of one family with their whole heights.

    `levels` repeat after `period` on a ring (else 0); `shadows` are lines that were tried and
    found too near to others.
    """

    lines: Lines
    levels: Indices
    period: int
    shadows: Lines


class Pieces(NamedTuple):
    """Parts of rails between crossings `i` and `j` next to each other, by rail and arc length.

    `p`, `q` are the lines crossed there; `up` is +1 where the rail runs with its family's
    common direction, else -1; `wraps` marks the piece over a closed rail's start.
    """

    rail: Indices
    i: Indices
    j: Indices
    p: Indices
    q: Indices
    begin: Floats
    length: Floats
    up: Floats
    wraps: Mask


@dataclass(frozen=True)
class Heights:
    """Height of each line, and the period after which they repeat on a ring (else 0)."""

    of: Floats
    period: float

    def rise(self, p: Indices, q: Indices, expected: Floats) -> Floats:
        """Height of q above p, whole periods chosen so that it comes next to what is expected."""
        rise = self.of[q] - self.of[p]
        if self.period:
            rise = rise - self.period * np.round((rise - expected) / self.period)
        return np.asarray(rise)


def pieces(crossed: Crossed) -> Pieces:
    """All pieces of the rails."""
    rails, found, family = crossed
    other = 1 - family
    order = found.order_along(other)
    rail, arc = found.lines[order, other], found.arcs[order, other]
    same = np.flatnonzero(rail[1:] == rail[:-1])
    i, j, length = order[same], order[same + 1], arc[same + 1] - arc[same]
    first = np.flatnonzero(np.diff(rail, prepend=-1) != 0)
    last = np.append(first[1:], len(rail)) - 1
    ring = rails.closed[rail[first]] & (last > first + 1) if len(first) else np.empty(0, bool)
    first, last = first[ring], last[ring]
    around = arc[first] + rails.total[rail[first]] - arc[last]
    i, j = np.concatenate([i, order[last]]), np.concatenate([j, order[first]])
    length = np.concatenate([length, around])
    wraps = np.arange(len(i)) >= len(same)
    lines, up = found.lines[:, family], _directions(found)[other]
    row = found.lines[i, other]
    begin = found.arcs[i, other]
    return Pieces(row, i, j, lines[i], lines[j], begin, length, up[row], wraps)


def _directions(found: Crossings) -> tuple[Floats, Floats]:
    """Sign of each line against the common direction of its family.

    Signs spread from line to line over their crossings: o_a o_b side = +1.
    """
    counts = found.lines.max(axis=0, initial=-1) + 1
    n = int(counts.sum())
    pairs, first = np.unique(found.lines, axis=0, return_index=True)
    side = found.side[first]
    a, b = pairs[:, 0], pairs[:, 1] + counts[0]
    lookup = dict(zip(zip(a.tolist(), b.tolist(), strict=True), side.tolist(), strict=True))
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(n, n)).tocsr()
    sign = np.ones(n)
    label = connected_components(graph, directed=False)[1]
    _, roots = np.unique(label, return_index=True)
    for root in roots:
        order, before = breadth_first_order(graph, root, directed=False)
        for node in order[1:].tolist():
            pair = (int(before[node]), node)
            sign[node] = sign[pair[0]] * lookup[min(pair), max(pair)]
    return sign[: counts[0]], sign[counts[0] :]


class _Links(NamedTuple):
    """Pairs of neighbouring lines low -> high with mean distance and weight."""

    low: Indices
    high: Indices
    length: Floats
    weight: Floats


def even_heights(crossed: Crossed, within: Mask, count: int) -> Heights:
    """Heights of lines 0..count-1 in the model unit that fit their mean distances best.

    Distances of a pair are averaged geometrically, so that a strip that narrows and widens has
    as many panels too short as too long. Those of crossings that are not `within` the region
    hardly count.
    """
    parts = pieces(crossed)
    links = _links(parts, within, count)
    height, roots = _spread(links, count)
    mismatch = height[links.high] - height[links.low] - links.length
    period = _girth(parts, len(crossed.rails), links, count)
    turns = np.round(-mismatch / period) if period else np.zeros(len(mismatch))
    # Relative errors count. Rows: height differences, the period, and one root per component.
    scale = np.sqrt(links.weight) / links.length
    row = np.arange(len(links.low))
    matrix = np.zeros((len(row) + len(roots), count + 1))
    matrix[row, links.high] += scale
    matrix[row, links.low] -= scale
    matrix[row, count] = scale * turns
    matrix[len(row) + np.arange(len(roots)), roots] = 1.0
    wanted = np.concatenate([scale * links.length, np.zeros(len(roots))])
    solution = np.linalg.lstsq(matrix, wanted, rcond=1e-12)[0]
    return Heights(solution[:count], abs(float(solution[count])) if turns.any() else 0.0)


def _links(parts: Pieces, within: Mask, count: int) -> _Links:
    """Mean distance of each pair of neighbouring lines."""
    low = np.where(parts.up > 0, parts.p, parts.q)
    high = np.where(parts.up > 0, parts.q, parts.p)
    weight = np.where(within[parts.i] | within[parts.j], 1.0, _OUTSIDE)
    real = (low != high) & (parts.length > 0)
    low, high, weight, length = low[real], high[real], weight[real], parts.length[real]
    keys, pair = np.unique(low * count + high, return_inverse=True)
    total = np.bincount(pair, weight, minlength=len(keys))
    mean = np.exp(np.bincount(pair, weight * np.log(length), minlength=len(keys)) / total)
    low, high = keys // count, keys % count
    # Two lines each above the other: around an umbilic, or a spiral; the stronger claim counts.
    back = np.searchsorted(keys, high * count + low)
    back = np.where(keys[np.minimum(back, len(keys) - 1)] == high * count + low, back, -1)
    rival = np.where(back >= 0, total[back], 0.0)
    kept = (total > rival) | ((total == rival) & (low < high))
    return _Links(low[kept], high[kept], mean[kept], total[kept])


def _spread(links: _Links, count: int) -> tuple[Floats, Indices]:
    """First heights, along a tree of links from one line of each component; those lines."""
    graph = coo_array((np.ones(len(links.low)), (links.low, links.high)), shape=(count, count))
    step = {
        pair: length
        for pair, length in zip(
            zip(links.low.tolist(), links.high.tolist(), strict=True),
            links.length.tolist(),
            strict=True,
        )
    }
    height = np.zeros(count)
    label = connected_components(graph, directed=False)[1]
    _, roots = np.unique(label, return_index=True)
    for root in roots:
        order, before = breadth_first_order(graph.tocsr(), root, directed=False)
        for node in order[1:].tolist():
            p = int(before[node])
            rise = step[p, node] if (p, node) in step else -step[node, p]
            height[node] = height[p] + rise
    return height, roots


def _girth(parts: Pieces, n_rails: int, links: _Links, count: int) -> float:
    """Mean length of a turn on closed rails, in mean distances; 0 without closed rails."""
    keys = links.low * count + links.high
    key = np.where(parts.up > 0, parts.p * count + parts.q, parts.q * count + parts.p)
    place = np.minimum(np.searchsorted(keys, key), max(len(keys) - 1, 0))
    known = (keys[place] == key) if len(keys) else np.zeros(len(key), dtype=np.bool_)
    length = np.where(known, links.length[place] if len(keys) else 0.0, parts.length)
    turn = np.bincount(parts.rail, length, minlength=n_rails)
    ring = np.unique(parts.rail[parts.wraps])
    return float(np.median(turn[ring])) if len(ring) else 0.0
