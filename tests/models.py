"""Rhino models written for tests: the example roof in three trimmed faces, and models to refuse."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rhino3dm
from brep_archive import EAST, NORTH, SOUTH, WEST, Curve, Edge, Face, Net, Trim, brep
from scipy.interpolate import BSpline, NdBSpline

from pqmesh.io.foreign import METRES
from pqmesh.surface.bspline import uniform_knots

ROOF = Path(__file__).resolve().parents[1] / "examples" / "roof"
UNITS = {"Meters": "m", "Millimeters": "mm", "Centimeters": "cm", "Kilometers": "km"} | {
    **{"Feet": "ft", "Inches": "in"},
}
# Where the roof is split, far from its knots, since short spans magnify the rounding of points
# at 5e8; and how far its faces reach over the site, in metres.
SPLITS = (0.26, 0.73)
REACH = 3.0
TEMPLATE_TOLERANCE = 1e-5


class Model:
    """A model to be written, object by object."""

    def __init__(self, unit: str = "Meters") -> None:
        self.file = rhino3dm.File3dm()
        self.file.Settings.ModelUnitSystem = getattr(rhino3dm.UnitSystem, unit)
        self.file.Settings.ModelAbsoluteTolerance = TEMPLATE_TOLERANCE / METRES[UNITS[unit]]
        self.layers: dict[str, int] = {}

    def layer(self, name: str) -> int:
        """Number of a layer, made when it is new."""
        if name not in self.layers:
            made = rhino3dm.Layer()
            made.Name = name
            self.layers[name] = int(self.file.Layers.Add(made))
        return self.layers[name]

    def add(self, geometry: Any, layer: str, name: str = "", is_hidden: bool = False) -> Model:
        attributes = rhino3dm.ObjectAttributes()
        attributes.LayerIndex, attributes.Name = self.layer(layer), name
        if is_hidden:
            attributes.Mode, attributes.Visible = rhino3dm.ObjectMode.Hidden, False
        self.file.Objects.Add(geometry, attributes)
        return self

    def add_block(self, geometry: Any, layer: str, name: str = "") -> Model:
        """A block of one object, and an instance of it."""
        blocks = self.file.InstanceDefinitions
        at, inside = rhino3dm.Point3d(0, 0, 0), rhino3dm.ObjectAttributes()
        number = blocks.Add(f"block {len(blocks)}", "", "", "", at, (geometry,), (inside,))
        where = rhino3dm.Transform.Translation(1.0, 2.0, 3.0)
        found = rhino3dm.InstanceReference(blocks.FindIndex(number).Id, where)
        return self.add(found, layer, name)

    def write(self, path: Path, version: int = 8) -> Path:
        if not self.file.Write(str(path), version):
            raise OSError(f"{path} must be writable; it is not.")
        return path


def nurbs(
    points: Any,
    degrees: tuple[int, int] = (3, 3),
    knots: tuple[Any, Any] | None = None,
    weights: np.ndarray | None = None,
) -> Any:
    """A surface of rhino3dm from points that are not homogeneous and full knots."""
    points = np.asarray(points, dtype=np.float64)
    n, m = points.shape[:2]
    knots = knots or (uniform_knots(n, degrees[0]), uniform_knots(m, degrees[1]))
    mass = np.ones((n, m)) if weights is None else weights
    orders = degrees[0] + 1, degrees[1] + 1
    made = rhino3dm.NurbsSurface.Create(3, weights is not None, *orders, n, m)
    rows = np.dstack([points * mass[..., None], mass])
    for i in range(n):
        for j in range(m):
            made.Points[i, j] = rhino3dm.Point4d(*rows[i, j].tolist())
    for own, line in zip((made.KnotsU, made.KnotsV), knots, strict=True):
        for k, value in enumerate(np.asarray(line)[1:-1].tolist()):
            own[k] = value
    if not made.IsValid:
        raise ValueError("A surface must be valid to Rhino; this one is not.")
    return made


def closed_polyline(points: Any) -> Any:
    """A closed polyline curve through points (n, 3)."""
    rows = np.asarray(points, dtype=np.float64).tolist()
    line = rhino3dm.Polyline(len(rows) + 1)
    for row in [*rows, rows[0]]:
        line.Add(*row)
    return line.ToPolylineCurve()


def mesh_of_one_face() -> Any:
    made = rhino3dm.Mesh()
    for x, y in ((0, 0), (1, 0), (1, 1)):
        made.Vertices.Add(x, y, 0)
    made.Faces.AddFace(0, 1, 2)
    return made


# --- the roof -------------------------------------------------------------------------------


def roof_net() -> Net:
    """The example roof as it stands in its file, in metres on [0, 1] x [0, 1]."""
    table = json.loads((ROOF / "net.json").read_text(encoding="utf-8"))
    points, (p, q) = np.array(table["points"]), table["degree"]
    n, m = points.shape[:2]
    return Net((p, q), (uniform_knots(n, p), uniform_knots(m, q)), points)


def roof_outline() -> np.ndarray:
    """Corners of the example's site, (8, 2), in metres."""
    design = tomllib.loads((ROOF / "roof.toml").read_text(encoding="utf-8"))
    return np.array(design["outline"]["polygon"], dtype=np.float64)


def write_roof_model(
    path: Path, unit: str = "Millimeters", origin: tuple[float, float, float] = (5e8, 3e8, 0.0)
) -> Path:
    """The example roof as an architect might send it.

    The roof is one joined Brep "roof" on layer ROOF: three faces side by side, trimmed about
    three metres outside the site. The middle face has its parameters exchanged and is flipped,
    the right one has longer parameters. The site is a closed polyline on layer SITE. Other
    layers hold what does not belong to the job.

    Parameters
    ----------
    path : Path
    unit : str
        Of the model, in Rhino's words.
    origin : (3,), unit of the model
        Where the roof's own origin comes to lie.
    """
    scale, place = 1.0 / METRES[UNITS[unit]], np.array(origin)

    def moved(points: np.ndarray) -> np.ndarray:
        return points * scale + place

    model = Model(unit).add(roof_brep(moved), "ROOF", "roof")
    corners = np.column_stack([roof_outline(), np.zeros(len(roof_outline()))])
    model.add(closed_polyline(moved(corners)), "SITE", "site")
    x, y = np.meshgrid(np.linspace(-80, 80, 5), np.linspace(-60, 60, 4), indexing="ij")
    ground = nurbs(moved(np.stack([x, y, -20.0 + 0.02 * x], axis=-1)))
    model.add(ground, "CONTEXT", "ground").add(mesh_of_one_face(), "CONTEXT", "neighbour")
    spot = rhino3dm.Point3d(*place.tolist())
    model.add(rhino3dm.Point(spot), "SURVEY").add(rhino3dm.TextDot("0.00", spot), "SURVEY")
    model.add_block(ground, "TREES", "tree")
    axis = rhino3dm.LineCurve(spot, rhino3dm.Point3d(*(place + [scale, 0, 0]).tolist()))
    model.add(axis, "AXES", "axis A", is_hidden=True)
    model.layer("LIGHTS")
    return model.write(path)


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
        lines.append(_with_crossings(np.array([[u, a[1]], [u, b[1]]]), net))
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
        trims = [Trim(_flat(part.own(lines[i]), back), i, back, side.get(i, 0)) for i, back in loop]
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
    closed = _with_crossings(np.concatenate([ring, ring[:1]]), net)[:-1]
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


def _with_crossings(line: np.ndarray, net: Net) -> np.ndarray:
    """A polyline of parameters with points where it crosses knots and splits."""
    levels = (np.unique([*net.knots[0], *SPLITS]), np.unique(net.knots[1]))
    rows = [line[0]]
    for a, b in zip(line[:-1], line[1:], strict=True):
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


def _flat(line: np.ndarray, is_back: bool) -> Curve:
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
    points, pair, degrees = moved(line.c[max(first, 0) : last]), (knots, net.knots[1]), net.degrees
    if part.is_exchanged:
        points, pair, degrees = points.swapaxes(0, 1), pair[::-1], degrees[::-1]
    return Net(degrees, (part.longer * pair[0], part.longer * pair[1]), points)
