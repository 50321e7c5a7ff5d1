"""The principal network of a surface: lines of both families, spaced for even panels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.network.crossings import Crossings, crossings
from pqmesh.network.trace import End, Lines, joined, principal_field, selected, trace
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, Indices, Mask, norm

# Truth at parameters (N, 2) inside the domain: the part of the surface to be covered.
Inside = Callable[[Floats], Mask]

# Directions mean nothing where k1 - k2 is below this share of the surface's median curvature.
UMBILIC_GAP = 1e-3


@dataclass(frozen=True, eq=False)
class CurveNetwork:
    """Two transversal families of lines on a surface and all their crossings.

    Attributes
    ----------
    surface : Surface
    families : (Lines, Lines)
        Lines along the larger (0) and the smaller (1) principal curvature.
    found : Crossings
    """

    surface: Surface
    families: tuple[Lines, Lines]
    found: Crossings

    @cached_property
    def points(self) -> Floats:
        """Crossings in space, shape (N, 3)."""
        return self.surface.jet(self.found.uv).point

    def ended(self, reason: End) -> Floats:
        """Parameters at which lines of either family end for the given reason, (n, 2)."""
        places = [np.empty((0, 2))]
        for lines in self.families:
            for side, theta in ((0, 0.0), (1, 1.0)):
                which = np.flatnonzero((lines.ends[:, side] == reason) & (np.diff(lines.start) > 0))
                segment = lines.start[which] if side == 0 else lines.start[which + 1] - 1
                places.append(lines.at(segment, np.full(len(which), theta)))
        return self.surface.domain.reduce(np.concatenate(places))


@dataclass(frozen=True)
class Spacing:
    """Wanted panel edges along family 0 and along family 1, model unit, and the line limit."""

    along: tuple[float, float]
    most_lines: int


def trace_principal_network(
    surface: Surface,
    edge: tuple[float, float],
    inside: Inside | None = None,
    *,
    most_lines: int = 4000,
) -> CurveNetwork:
    """Network of curvature lines spaced so that panels come out as even as the surface allows.

    A first, coarse network measures how the distance of neighbouring lines varies; the final
    lines stand where its geometric mean equals the wanted edge. Lines are added beyond the
    last ones as long as a whole panel fits before the boundary.

    Parameters
    ----------
    surface : Surface
    edge : (float, float), model unit
        Wanted panel edge along the lines of larger and of smaller principal curvature.
    inside : callable, optional
        Truth at parameters (N, 2): the region to cover; default the whole domain.
    most_lines : int
        Refuse beyond this many lines in a family.

    Raises
    ------
    NetworkError
        When the surface has no principal directions (sphere, plane), or needs too many lines.

    References: [thesis] section 6.2; errata page, E33 and E37.
    """
    builder = _Builder(surface, Spacing(edge, most_lines), inside)
    probe = builder.grown(builder.central(), coarse=True)
    seeds = [builder.even_seeds(probe, family) for family in (0, 1)]
    return builder.grown(seeds, coarse=False)


class _Builder:
    """What stays fixed while the network grows: surface, spacing, region and its scale."""

    def __init__(self, surface: Surface, spacing: Spacing, inside: Inside | None) -> None:
        self.surface, self.spacing = surface, spacing
        self.inside: Inside = inside or (lambda uv: np.ones(len(uv), dtype=np.bool_))
        samples = surface.domain.grid(60, 60).reshape(-1, 2)
        kept = samples[self.inside(samples)]
        self.samples = kept if len(kept) else samples
        jet = surface.jet(self.samples)
        self.shape = shape_data(jet)
        self.size = float(np.linalg.norm(np.ptp(jet.point, axis=0)))
        self.scale = float(np.median(np.abs(self.shape.k).max(axis=1)))
        self.points = jet.point
        self.gap = UMBILIC_GAP * self.scale
        self._check()

    def _check(self) -> None:
        gaps = self.shape.k[:, 0] - self.shape.k[:, 1]
        if self.scale * self.size < 1e-9 or np.median(gaps) <= self.gap:
            bad = int(np.argmin(gaps))
            raise NetworkError(
                f"Curvature lines need k1 != k2 on most of the surface; the median of k1 - k2 is "
                f"{np.median(gaps):.3g} with curvatures around {self.scale:.3g} (at uv = "
                f"{np.round(self.samples[bad], 6).tolist()}: a plane or a sphere has no principal "
                f"directions). Choose another network or another surface."
            )

    def central(self) -> list[_Seeds]:
        """One seed for each family, at a clearly curved place near the middle."""
        gaps = self.shape.k[:, 0] - self.shape.k[:, 1]
        clear = gaps >= 0.5 * np.median(gaps)
        middle = self.points.mean(axis=0)
        away = np.where(clear, norm(self.points - middle), np.inf)
        best = int(away.argmin())
        uv = self.samples[best : best + 1]
        return [(uv, self.shape.directions[best : best + 1, family]) for family in (0, 1)]

    def lines(self, seeds: _Seeds, coarse: bool) -> Lines:
        """Traced lines of seeds and directions; coarse lines are for measuring only."""
        return trace(
            self.surface,
            principal_field(self.gap),
            *seeds,
            max_step=min(self.spacing.along) * (1.0 if coarse else 0.5),
            max_length=4.0 * self.size,
            tolerance=(1e-7 if coarse else 1e-12) * self.size,
        )

    def grown(self, seeds: list[_Seeds], *, coarse: bool) -> CurveNetwork:
        """Network of the seeds, extended until no further line fits into the region."""
        families = [self.lines(part, coarse) for part in seeds]
        found = crossings(self.surface, families[0], families[1])
        # Arc length on each rail's end up to which nothing is to be tried again.
        tried: dict[tuple[int, int, bool], float] = {}
        idle = 0
        while idle < 2:
            for family in (0, 1):
                tail = self._widest_tail(families, found, family, tried)
                if tail is None:
                    idle += 1
                    continue
                idle = 0
                rails = families[1 - family]
                line = np.full(len(tail.arcs), tail.rail)
                more = self.lines(self._seeds_at(rails, line, tail.arcs), coarse)
                old = len(families[family])
                trial = families.copy()
                trial[family] = joined([families[family], more])
                found_now = crossings(self.surface, trial[0], trial[1])
                good = self._uncrowded(trial, found_now, family, old)
                if good < len(more):
                    # Too near to a line that does not reach this rail: try a little further on.
                    tried[family, tail.rail, tail.backward] = float(tail.arcs[good]) + (
                        0.75 * tail.step if tail.backward else -0.75 * tail.step
                    )
                    trial[family] = joined([families[family], selected(more, good)])
                    found_now = crossings(self.surface, trial[0], trial[1])
                families, found = trial, found_now
                self._limit(len(families[family]))
        return CurveNetwork(self.surface, (families[0], families[1]), found)

    def _uncrowded(self, families: list[Lines], found: Crossings, family: int, old: int) -> int:
        """How many lines from `old` on, in order, keep half a panel from their neighbours."""
        least = np.log(0.55 * self.spacing.along[1 - family])
        crowded = len(families[family])
        for pair, pieces in self._pieces(families, found, family).items():
            new = max(pair)
            if new < old:
                continue
            chosen = [piece for piece in pieces if piece.inside] or pieces
            if np.mean(np.log([piece.length for piece in chosen])) < least:
                crowded = min(crowded, new)
        return crowded - old

    def _limit(self, count: int) -> None:
        if count > self.spacing.most_lines:
            raise NetworkError(
                f"The network needs more than {self.spacing.most_lines} lines in one family for "
                f"edges of {self.spacing.along} on a surface of size {self.size:.3g}. Choose "
                f"longer edges, or raise the limit."
            )

    def _widest_tail(
        self,
        families: list[Lines],
        found: Crossings,
        family: int,
        tried: dict[tuple[int, int, bool], float],
    ) -> _Tail | None:
        """Places for lines of a family past its last ones, on the rail with most room."""
        rails, other = families[1 - family], 1 - family
        wanted = self.spacing.along[other]
        best_room, best = 1.0, None
        for sequence in found.sequences[other]:
            line = int(found.lines[sequence[0], other])
            arcs = found.arcs[sequence, other]
            for backward in (False, True):
                start = tried.get((family, line, backward))
                room, step, origin = self._room(rails, line, arcs, backward, wanted, start)
                if room / step > best_room:
                    best_room, best = room / step, (line, step, origin, backward)
        if best is None:
            return None
        line, step, origin, backward = best
        offsets = step * np.arange(1.0, int(best_room * (1 + 1e-9)) + 1.0)
        arcs = origin - offsets if backward else origin + offsets
        return _Tail(line, backward, step, arcs)

    def _room(
        self,
        rails: Lines,
        line: int,
        arcs: Floats,
        backward: bool,
        wanted: float,
        start: float | None,
    ) -> tuple[float, float, float]:
        """Arc length left on a rail past its last crossing inside the region, and the step."""
        total = float(rails.total[line])
        if rails.closed[line]:
            return self._closed_room(total, arcs, wanted)
        origin = float(arcs[0] if backward else arcs[-1])
        step = wanted
        if len(arcs) > 1:
            gap = arcs[1] - arcs[0] if backward else arcs[-1] - arcs[-2]
            step = float(np.clip(gap, 0.4 * wanted, 2.5 * wanted))
        if start is not None:
            origin = min(origin, start) if backward else max(origin, start)
        joints = rails.arc[rails.start[line] : rails.start[line + 1]]
        joints = np.append(joints, total)
        ahead = joints < origin if backward else joints > origin
        if not ahead.any():
            return 0.0, step, origin
        uv = self.surface.domain.reduce(rails.joints(line)[ahead])
        hits = self.inside(uv)
        if not hits.any():
            return 0.0, step, origin
        reach = joints[ahead][hits]
        edge = float(reach.min() if backward else reach.max())
        # One step further, so that the last panel reaches over the region's rim.
        room = abs(edge - origin) + step
        limit = origin if backward else total - origin
        return min(room, limit), step, origin

    @staticmethod
    def _closed_room(total: float, arcs: Floats, wanted: float) -> tuple[float, float, float]:
        """Widest gap on a closed rail, split into equal steps."""
        gaps = np.diff(np.append(arcs, arcs[0] + total))
        widest = int(gaps.argmax())
        count = max(round(float(gaps[widest]) / wanted), 1)
        if count < 2:
            return 0.0, wanted, 0.0
        step = float(gaps[widest]) / count
        return step * (count - 1), step, float(arcs[widest])

    def _seeds_at(self, rails: Lines, line: Indices, arcs: Floats) -> _Seeds:
        """Parameters on rails, and start directions across them."""
        total = rails.total[line]
        arcs = np.where(rails.closed[line], np.mod(arcs, total), np.clip(arcs, 0.0, total))
        segment, theta = rails.locate(line, arcs)
        uv = self.surface.domain.reduce(rails.at(segment, theta))
        jet = self.surface.jet(uv)
        slope = rails.slope(segment, theta)
        along = jet.du * slope[:, :1] + jet.dv * slope[:, 1:]
        across = np.cross(shape_data(jet).normal, along)
        return uv, across / norm(across)[:, None]

    def even_seeds(self, network: CurveNetwork, family: int) -> _Seeds:
        """Seeds that make the mean distance of neighbouring lines equal the wanted edge.

        Neighbouring lines of the coarse network form a graph (a path, a ring, or a tree where
        the family branches). Each of its links gets the geometric mean length of the pieces
        between the two lines; the wanted lines stand at equal steps along it.
        """
        other = 1 - family
        rails = network.families[other]
        links = self._links(network, family)
        if not links:
            first = network.found.sequences[other][0][:1]
            return self._seeds_at(
                rails, network.found.lines[first, other], network.found.arcs[first, other]
            )
        lines, arcs = [], []
        for link, fractions in _even_steps(links, self.spacing.along[other]):
            for fraction in fractions:
                lines.append(link.rail)
                arcs.append(link.begin + fraction * (link.end - link.begin))
        return self._seeds_at(rails, np.array(lines), np.array(arcs))

    def _links(self, network: CurveNetwork, family: int) -> list[_Link]:
        """Neighbouring lines of a family, each with its mean distance and a rail between."""
        families = list(network.families)
        pieces = self._pieces(families, network.found, family)
        direct = _direct_links(set(pieces), rings=bool(families[1 - family].closed.any()))
        return [_link(p, q, pieces[p, q]) for p, q in direct]

    def _pieces(
        self, families: list[Lines], found: Crossings, family: int
    ) -> dict[tuple[int, int], list[_Piece]]:
        """Parts of rails between neighbouring crossings, by the two lines in common order."""
        other = 1 - family
        rails = families[other]
        within = self.inside(found.uv)
        forward = _rail_directions(found, other)
        pieces: dict[tuple[int, int], list[_Piece]] = {}
        for sequence in found.sequences[other]:
            rail = int(found.lines[sequence[0], other])
            arcs = found.arcs[sequence, other]
            if rails.closed[rail] and len(sequence) > 2:
                sequence = np.append(sequence, sequence[0])
                arcs = np.append(arcs, arcs[0] + rails.total[rail])
            if not forward[rail]:
                sequence, arcs = sequence[::-1], arcs[::-1]
            line = found.lines[sequence, family].tolist()
            good = within[sequence]
            for i in range(len(sequence) - 1):
                piece = _Piece(
                    bool(good[i] or good[i + 1]), rail, float(arcs[i]), float(arcs[i + 1])
                )
                if line[i] != line[i + 1]:
                    pieces.setdefault((line[i], line[i + 1]), []).append(piece)
        return pieces


# Parameters (n, 2) and start directions (n, 3) of lines to trace.
_Seeds = tuple[Floats, Floats]


class _Tail(NamedTuple):
    """Places for new lines on the free end of a rail."""

    rail: int
    backward: bool
    step: float
    arcs: Floats


class _Piece(NamedTuple):
    """Part of a rail between two neighbouring crossings; in the region or not."""

    inside: bool
    rail: int
    begin: float
    end: float

    @property
    def length(self) -> float:
        """Arc length."""
        return abs(self.end - self.begin)


def _rail_directions(found: Crossings, family: int) -> dict[int, bool]:
    """Whether each line of the family runs in the common direction of its family.

    Signs spread from line to line over their crossings: o_a o_b side = +1.
    """
    on_line = {
        (kind, int(found.lines[sequence[0], kind])): sequence
        for kind in (0, 1)
        for sequence in found.sequences[kind]
    }
    sign: dict[tuple[int, int], float] = {}
    for root in on_line:
        if root in sign:
            continue
        sign[root] = 1.0
        stack = [root]
        while stack:
            kind, line = stack.pop()
            sequence = on_line[kind, line]
            partners = found.lines[sequence, 1 - kind].tolist()
            for partner, side in zip(partners, found.side[sequence].tolist(), strict=True):
                if (1 - kind, partner) not in sign:
                    sign[1 - kind, partner] = sign[kind, line] * side
                    stack.append((1 - kind, partner))
    return {line: value > 0 for (kind, line), value in sign.items() if kind == family}


def _direct_links(links: set[tuple[int, int]], *, rings: bool) -> list[tuple[int, int]]:
    """Links that no longer chain of links replaces.

    Where a line ends, a rail passes from its neighbour before to its neighbour after; such a
    link says nothing about neighbours. On rings a chain may not run around.
    """
    follow: dict[int, list[int]] = {}
    for p, q in sorted(links):
        follow.setdefault(p, []).append(q)
    depth = len(follow) // 2 if rings else len(follow) + 1
    return [
        (p, q)
        for p, q in sorted(links)
        if (q, p) not in links and not _reaches(follow, p, q, depth)
    ]


def _reaches(follow: dict[int, list[int]], start: int, goal: int, depth: int) -> bool:
    """Whether a chain of two or more links leads from start to goal."""
    level = {node for node in follow.get(start, []) if node != goal}
    seen = set(level)
    for _ in range(depth):
        level = {far for node in level for far in follow.get(node, []) if far not in seen}
        if goal in level:
            return True
        if not level:
            return False
        seen |= level
    return False


@dataclass(frozen=True)
class _Link:
    """Two neighbouring lines p, q: mean distance, and a rail with its arcs at p and at q."""

    p: int
    q: int
    length: float
    rail: int
    begin: float
    end: float


def _link(p: int, q: int, pieces: list[_Piece]) -> _Link:
    """Geometric mean of the pieces between two lines, and the piece nearest to it."""
    chosen = [piece for piece in pieces if piece.inside] or pieces
    logs = np.log([piece.length for piece in chosen])
    mean = float(logs.mean())
    typical = chosen[int(np.abs(logs - mean).argmin())]
    return _Link(p, q, float(np.exp(mean)), typical.rail, typical.begin, typical.end)


def _even_steps(links: list[_Link], wanted: float) -> list[tuple[_Link, Floats]]:
    """Fractions along each link at which a line shall stand.

    Distances are measured from the line of the first link with the most neighbours along the
    graph; a ring is closed by stretching the step.
    """
    neighbors: dict[int, list[_Link]] = {}
    for link in links:
        neighbors.setdefault(link.p, []).append(link)
        neighbors.setdefault(link.q, []).append(link)
    result: list[tuple[_Link, Floats]] = []
    seen: set[int] = set()
    for root in sorted(neighbors):
        if root in seen:
            continue
        members = _component(root, neighbors)
        inner = {id(link) for node in members for link in neighbors[node]}
        ring = len(inner) == len(members) and all(len(neighbors[n]) == 2 for n in members)
        total = sum(link.length for link in links if id(link) in inner)
        step = total / max(round(total / wanted), 3) if ring else wanted
        result += _walked(root, neighbors, seen, step)
    return result


def _component(root: int, neighbors: dict[int, list[_Link]]) -> set[int]:
    """Lines reached from one line."""
    members, stack = {root}, [root]
    while stack:
        node = stack.pop()
        for link in neighbors[node]:
            for end in (link.p, link.q):
                if end not in members:
                    members.add(end)
                    stack.append(end)
    return members


def _walked(
    root: int, neighbors: dict[int, list[_Link]], seen: set[int], step: float
) -> list[tuple[_Link, Floats]]:
    """Multiples of the step on each link, by signed distance from the root."""
    result: list[tuple[_Link, Floats]] = []
    used: set[int] = set()
    distance = {root: 0.0}
    seen.add(root)
    stack = [root]
    first = True
    while stack:
        node = stack.pop()
        for link in neighbors[node]:
            if id(link) in used:
                continue
            used.add(id(link))
            far = link.q if link.p == node else link.p
            low = distance[node]
            high = low + link.length
            # The root's own line belongs to its first link only; other links exclude their
            # near end, which the link before has served.
            inclusive = first and node == root
            first = False
            marks = _multiples(low, high, step, inclusive)
            if far in seen:
                # The ring closes here, on a line that has its mark already.
                marks = marks[marks < high - 1e-6 * step]
            fractions = (marks - low) / link.length
            result.append((link, fractions if link.p == node else 1.0 - fractions))
            if far not in seen:
                seen.add(far)
                distance[far] = high
                stack.append(far)
    return result


def _multiples(low: float, high: float, step: float, inclusive: bool) -> Floats:
    """Multiples of step in (low, high], or in [low, high]."""
    tiny = 1e-9 * step
    first = np.ceil((low - tiny) / step) if inclusive else np.floor((low + tiny) / step) + 1
    last = np.floor((high + tiny) / step)
    return np.asarray(step * np.arange(first, last + 1))
