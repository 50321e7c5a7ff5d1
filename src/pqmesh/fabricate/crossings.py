"""Where mesh edges cross the walls of an outline: each crossing once, for all who share it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple, TypeVar

import numpy as np

from pqmesh.fabricate.walls import Walls, edge_sides, inside_walls, wall_sides
from pqmesh.vectors import Floats, Indices

# Bound of the relative rounding error of a determinant, with a margin.
ROUNDING = 1e-15

Pair = tuple[int, int]
Key = tuple[Fraction, Fraction, Fraction]
ItemT = TypeVar("ItemT")


class Crossing(NamedTuple):
    """An edge crosses a wall at share t of the edge (low to high vertex) and s of the wall."""

    pair: Pair
    wall: int
    t: float
    s: float
    slack: float
    node: int


@dataclass
class Nodes:
    """Corners of cut polygons: the vertices of the mesh, then what cutting adds.

    Attributes
    ----------
    points : list of (x, y, z)
    edge : list of int
        Mesh edge on which an added node lies, -1 elsewhere; -1 for vertices.
    n_vertices : int
    snap : float, model unit
        Nodes nearer than this are one.
    """

    points: list[tuple[float, float, float]]
    snap: float
    n_vertices: int = field(init=False)
    edge: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.n_vertices = len(self.points)
        self.edge = [-1] * len(self.points)

    def add(self, point: Floats, edge: int = -1) -> int:
        """Number of a new node."""
        self.points.append((float(point[0]), float(point[1]), float(point[2])))
        self.edge.append(edge)
        return len(self.points) - 1

    def at(self, numbers: Sequence[int]) -> Floats:
        """Positions, shape (len(numbers), 3)."""
        return np.array([self.points[number] for number in numbers]).reshape(-1, 3)

    def along(self, pair: Pair, t: float, before: Crossing | None, edge: int) -> int:
        """Node at share t of an edge; an end, or the crossing before it, when that is as near."""
        a, b = np.array(self.points[pair[0]]), np.array(self.points[pair[1]])
        length = float(np.linalg.norm(b - a))
        if t * length < self.snap:
            return pair[0]
        if (1.0 - t) * length < self.snap:
            return pair[1]
        if before is not None and (t - before.t) * length < self.snap:
            return before.node
        return self.add(a + t * (b - a), edge)


class Section:
    """Mesh points in a plane with the walls, and the crossings of their edges with them.

    The plane is the plan as a rule; `Upright` makes its own for a vertical face.
    """

    def __init__(self, nodes: Nodes, xy: dict[int, Floats], walls: Walls) -> None:
        self.nodes, self.walls = nodes, walls
        self.xy = xy
        self._crossings: dict[Pair, list[Crossing]] = {}
        self._inside: dict[int, bool] = {}

    def prepare(self, edges: Indices, xy: Floats) -> None:
        """Find the crossings of all mesh edges (E, 2), and which vertices are inside."""
        inside = inside_walls(xy, self.walls)
        self._inside = dict(enumerate(inside.tolist()))
        self._crossings = {(a, b): [] for a, b in edges.tolist()}
        found = self._found(edges, xy[edges[:, 0]], xy[edges[:, 1]])
        for number, entries in found.items():
            pair = (int(edges[number, 0]), int(edges[number, 1]))
            self._crossings[pair] = self._with_nodes(pair, entries, number)

    def add(self, point: Floats, xy: Floats) -> int:
        """Number of a new point that may carry edges."""
        number = self.nodes.add(point)
        self.xy[number] = xy
        return number

    def is_inside(self, number: int) -> bool:
        """Whether a point is inside the outline."""
        if number not in self._inside:
            self._inside[number] = bool(inside_walls(self.xy[number][None], self.walls)[0])
        return self._inside[number]

    def crossings(self, tail: int, head: int) -> list[Crossing]:
        """Crossings of an edge, from tail to head."""
        pair = (min(tail, head), max(tail, head))
        if pair not in self._crossings:
            low, high = self.xy[pair[0]][None], self.xy[pair[1]][None]
            entries = self._found(np.array([pair]), low, high).get(0, [])
            self._crossings[pair] = self._with_nodes(pair, entries, -1)
        found = self._crossings[pair]
        return found if tail < head else found[::-1]

    def node_on(self, crossing: Crossing, before: Crossing | None, edge: int) -> int:
        """Node of a crossing."""
        return self.nodes.along(crossing.pair, crossing.t, before, edge)

    def along_walls(self, marks: list[Crossing]) -> dict[int, list[int]]:
        """For each wall the places in a list of its crossings, in the direction of the wall."""
        of_wall: dict[int, list[int]] = {}
        for place, mark in enumerate(marks):
            of_wall.setdefault(mark.wall, []).append(place)
        return {
            wall: in_order(
                places,
                [(marks[k].s, marks[k].slack) for k in places],
                lambda k: self._exact(marks[k])[1],
            )
            for wall, places in of_wall.items()
        }

    def _found(self, pairs: Indices, tails: Floats, heads: Floats) -> dict[int, list[Crossing]]:
        """Crossings of edges with all walls, by row, not yet in order."""
        rows, walls = _near_pairs(tails, heads, self.walls)
        a, b = tails[rows], heads[rows]
        c, d = self.walls.starts[walls], self.walls.ends[walls]
        crosses = wall_sides(c, d, a) != wall_sides(c, d, b)
        crosses &= edge_sides(a, b, c) * edge_sides(a, b, d) < 0
        rows, walls, a, b, c, d = (v[crosses] for v in (rows, walls, a, b, c, d))
        across, whole = _products(b - a, d - c)
        t, size_t = _products(c - a, d - c)
        s, size_s = _products(c - a, b - a)
        found: dict[int, list[Crossing]] = {}
        for k, (row, wall) in enumerate(zip(rows.tolist(), walls.tolist(), strict=True)):
            pair = (int(pairs[row, 0]), int(pairs[row, 1]))
            if abs(across[k]) <= 1e3 * ROUNDING * whole[k]:
                crossing = Crossing(pair, wall, 0.0, 0.0, 1.0, -1)
                exact_t, exact_s = self._exact(crossing)
                crossing = crossing._replace(t=_share(exact_t[0]), s=_share(exact_s[0]))
            else:
                error = ROUNDING * (whole[k] + size_s[k] + size_t[k]) / abs(across[k])
                crossing = Crossing(
                    pair, wall, _share(t[k] / across[k]), _share(s[k] / across[k]), 2 * error, -1
                )
            found.setdefault(row, []).append(crossing)
        return found

    def _with_nodes(self, pair: Pair, entries: list[Crossing], edge: int) -> list[Crossing]:
        """The crossings of one edge in order, with their nodes."""
        result: list[Crossing] = []
        keys = [(entry.t, entry.slack) for entry in entries]
        for entry in in_order(entries, keys, lambda entry: self._exact(entry)[0]):
            before = result[-1] if result else None
            result.append(entry._replace(node=self.node_on(entry, before, edge)))
        return result

    def _exact(self, crossing: Crossing) -> tuple[Key, Key]:
        """Shares t and s as exact numbers, with what the motion (e, e^2) of the mesh adds."""
        low, high = (self.xy[number] for number in crossing.pair)
        ends = (low, high, self.walls.starts[crossing.wall], self.walls.ends[crossing.wall])
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = (
            (Fraction(float(p[0])), Fraction(float(p[1]))) for p in ends
        )
        px, py, qx, qy = bx - ax, by - ay, dx - cx, dy - cy
        across = px * qy - py * qx
        t = ((cx - ax) * qy - (cy - ay) * qx) / across
        s = ((cx - ax) * py - (cy - ay) * px) / across
        return (t, -qy / across, qx / across), (s, -py / across, px / across)


def in_order(
    items: Sequence[ItemT], keys: list[tuple[float, float]], exact: Callable[[ItemT], Key]
) -> list[ItemT]:
    """Items by rising key (value, error), by their exact keys where the errors leave a doubt."""
    places = sorted(range(len(items)), key=lambda k: keys[k][0])
    for a, b in itertools.pairwise(places):
        if keys[b][0] - keys[a][0] <= keys[a][1] + keys[b][1]:
            return sorted(items, key=exact)
    return [items[k] for k in places]


def _near_pairs(tails: Floats, heads: Floats, walls: Walls) -> tuple[Indices, Indices]:
    """Edges and walls whose boxes meet."""
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    rows, numbers = [np.empty(0, dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for number, (a, b) in enumerate(zip(walls.starts, walls.ends, strict=True)):
        near = (low <= np.maximum(a, b)).all(axis=1) & (high >= np.minimum(a, b)).all(axis=1)
        rows.append(np.flatnonzero(near))
        numbers.append(np.full(len(rows[-1]), number))
    return np.concatenate(rows), np.concatenate(numbers)


def _products(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Plan cross products and the size of their terms."""
    left, right = a[:, 0] * b[:, 1], a[:, 1] * b[:, 0]
    return left - right, np.abs(left) + np.abs(right)


def _share(value: float | Fraction) -> float:
    return min(1.0, max(0.0, float(value)))
