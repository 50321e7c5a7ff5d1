"""The example roof as a Brep of three joined, trimmed faces that share two edges."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from brep_archive import EAST, NORTH, SOUTH, WEST, Curve, Edge, Face, Net, Trim, brep
from scipy.interpolate import BSpline, NdBSpline

from pqmesh.io.outlines import read_outline
from pqmesh.surface.bspline import uniform_knots

ROOF = Path(__file__).resolve().parents[1] / "examples" / "roof"
# Where the roof is split, far from its knots, since short spans magnify the rounding of points
# at 5e8; and how far its faces reach over the site, in metres.
SPLITS = (0.26, 0.73)
REACH = 3.0


def roof_net() -> Net:
    """The example roof as it stands in its file, in metres on [0, 1] x [0, 1]."""
    table = json.loads((ROOF / "net.json").read_text(encoding="utf-8"))
    points, (p, q) = np.array(table["points"]), table["degree"]
    n, m = points.shape[:2]
    return Net((p, q), (uniform_knots(n, p), uniform_knots(m, q)), points)


def roof_outline() -> np.ndarray:
    """Corners of the example's site, (8, 2), in metres."""
    return read_outline(ROOF / "site.svg", "roof", units="m").polygon


class Part(NamedTuple):
    """How a face has its parameters: exchanged or not, and by how much they are longer."""

    low: float
    high: float
    is_exchanged: bool
    longer: float

    def own(self, uv: np.ndarray) -> np.ndarray:
        return self.longer * (uv[:, ::-1] if self.is_exchanged else uv)


def roof_brep(moved: Callable[[np.ndarray], np.ndarray]) -> Any:
    """The roof as a Brep of three trimmed faces that share two edges."""
    net = roof_net()
    left, right = SPLITS
    parts = (Part(0.0, left, False, 1.0), Part(left, right, True, 1.0),
             Part(right, 1.0, False, 60.0))  # fmt: skip
    lower, east, upper, west = _arcs(_trim_ring(net), net)
    lines = [lower, east, upper, west]
    for u, a, b in ((left, lower[0], upper[-1]), (right, lower[-1], upper[0])):
        lines.append(with_crossings(np.array([[u, a[1]], [u, b[1]]]), net))
    ends = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 3), (1, 2)]
    curves = [lifted(net, line, moved) for line in lines]
    edges = [Edge(curve, *pair) for curve, pair in zip(curves, ends, strict=True)]
    vertices = np.array([curves[0].points[0], curves[0].points[-1], curves[2].points[0],
                         curves[2].points[-1]])  # fmt: skip
    # Each loop as pairs of an edge and whether it runs back; seams lie on a bound.
    loops = ([(3, False), (4, False)], [(4, False), (2, True), (5, True), (0, True)],
             [(1, False), (5, True)])  # fmt: skip
    sides = ({4: EAST}, {4: SOUTH, 5: NORTH}, {5: WEST})
    faces = []
    for part, loop, side in zip(parts, loops, sides, strict=True):
        trims = [Trim(flat(part.own(lines[i]), back), i, back, side.get(i, 0)) for i, back in loop]
        faces.append(Face(_cut(net, part, moved), [trims], part.is_exchanged))
    return brep(vertices, edges, faces)


def _trim_ring(net: Net) -> np.ndarray:
    """Parameters of the corners of the trim: round about the site, counterclockwise."""
    site = roof_outline()
    along = np.roll(site, -1, axis=0) - site
    out = REACH * np.column_stack([along[:, 1], -along[:, 0]])
    out /= np.hypot(*along.T)[:, None]
    before = np.roll(out, 1, axis=0)
    middle = before + out
    middle *= REACH / np.hypot(*middle.T)[:, None]
    plan = np.stack([site + before, site + middle, site + out], axis=1).reshape(-1, 2)
    # In this net x hangs on u only, and y on v only.
    dense = np.linspace(0.0, 1.0, 2001)
    columns = []
    for axis, row in ((0, net.points[:, 0, 0]), (1, net.points[0, :, 1])):
        values = BSpline(net.knots[axis], row, net.degrees[axis])(dense)
        columns.append(np.interp(plan[:, axis], values, dense))
    return np.column_stack(columns).round(6)


def _arcs(ring: np.ndarray, net: Net) -> list[np.ndarray]:
    """The ring in four: below between the splits, then counterclockwise."""
    closed = with_crossings(np.concatenate([ring, ring[:1]]), net)[:-1]
    stops = np.flatnonzero(np.isin(closed[:, 0], SPLITS))
    if len(stops) != 4:
        raise ValueError(f"The splits must cross the trim four times; found {len(stops)}.")
    order = closed[stops, 0]
    stops = np.roll(stops, -int(np.argmax(order < np.roll(order, -1))))
    arcs = []
    for start, end in zip(stops, np.roll(stops, -1), strict=True):
        count = (end - start) % len(closed)
        arcs.append(closed[np.arange(start, start + count + 1) % len(closed)])
    return arcs


def with_crossings(line: np.ndarray, net: Net) -> np.ndarray:
    """A polyline of parameters with points where it crosses knots and splits."""
    levels = (np.unique([*net.knots[0], *SPLITS]), np.unique(net.knots[1]))
    rows = [line[0]]
    for a, b in pairwise(line):
        found = []
        for axis in (0, 1):
            low, high = sorted((a[axis], b[axis]))
            for level in levels[axis][(levels[axis] > low) & (levels[axis] < high)]:
                share = (level - a[axis]) / (b[axis] - a[axis])
                point = a + share * (b - a)
                point[axis] = level
                found.append((share, point))
        rows += [point for _, point in sorted(found, key=lambda pair: pair[0])] + [b]
    return np.array(rows)


def lifted(net: Net, line: np.ndarray, moved: Callable[[np.ndarray], np.ndarray]) -> Curve:
    """The image of a polyline that has a corner at every knot it crosses, exactly.

    Between corners it is one polynomial of the sum of both degrees, found from as many of its
    points as it needs. Parameters are the numbers of the corners.
    """
    surface, order = NdBSpline(net.knots, net.points, net.degrees), sum(net.degrees)
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(order + 1) / order)
    uv = line[:-1, None] + nodes[:, None] * np.diff(line, axis=0)[:, None]
    values = surface(uv.reshape(-1, 2)).reshape(len(uv), order + 1, 3)
    pieces = np.linalg.solve(bernstein(order, nodes), values)
    pieces[:, [0, -1]] = values[:, [0, -1]]
    points = np.concatenate([pieces[0, :1], *pieces[:, 1:]])
    inner = np.repeat(np.arange(len(line), dtype=np.float64), order)
    return Curve(order, np.concatenate([inner[:1], inner, inner[-1:]]), moved(points))


def bernstein(degree: int, t: np.ndarray) -> np.ndarray:
    """Bernstein polynomials at parameters (n,), shape (n, degree + 1)."""
    rows = [math.comb(degree, j) * t**j * (1.0 - t) ** (degree - j) for j in range(degree + 1)]
    return np.stack(rows, axis=1)


def flat(line: np.ndarray, is_back: bool) -> Curve:
    """A polyline as a curve with the parameters of its lifted edge, run back or not."""
    number = np.arange(len(line), dtype=np.float64)
    if is_back:
        line, number = line[::-1], -number[::-1]
    return Curve(1, np.concatenate([number[:1], number, number[-1:]]), line)


def _cut(net: Net, part: Part, moved: Callable[[np.ndarray], np.ndarray]) -> Net:
    """The part of a net between two values of u, by inserting knots, with its own parameters."""
    p, line = net.degrees[0], BSpline(net.knots[0], net.points, net.degrees[0])
    for value in (part.low, part.high):
        missing = p - np.count_nonzero(line.t == value)
        line = line.insert_knot(value, missing) if missing > 0 else line
    first = int(np.searchsorted(line.t, part.low, side="right")) - p - 1
    last = int(np.searchsorted(line.t, part.high))
    inner = line.t[first + p + 1 : last]
    ends = np.repeat([part.low, part.high], p + 1)
    knots = np.concatenate([ends[: p + 1], inner, ends[p + 1 :]])
    points, pair, degrees = moved(line.c[first:last]), (knots, net.knots[1]), net.degrees
    if part.is_exchanged:
        points, pair, degrees = points.swapaxes(0, 1), pair[::-1], degrees[::-1]
    return Net(degrees, (part.longer * pair[0], part.longer * pair[1]), points)
