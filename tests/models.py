"""Rhino models written for tests: the example roof in three trimmed faces, and models to refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rhino3dm
from roof_brep import roof_brep, roof_net, roof_outline

from pqmesh.io.foreign import METRES
from pqmesh.surface.bspline import uniform_knots

UNITS = {"Meters": "m", "Millimeters": "mm", "Centimeters": "cm", "Kilometers": "km"} | {
    **{"Feet": "ft", "Inches": "in"},
}
TEMPLATE_TOLERANCE = 1e-5  # metres

__all__ = ["roof_brep", "roof_net", "roof_outline"]


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
    axis = rhino3dm.LineCurve(spot, rhino3dm.Point3d(*(place + scale * np.eye(3)[0]).tolist()))
    model.add(axis, "AXES", "axis A", is_hidden=True)
    model.layer("LIGHTS")
    return model.write(path)


# --- models to refuse -----------------------------------------------------------------------


def graph_net(rows: Any = None) -> np.ndarray:
    """Control points (7, 6, 3) of a vault of 72 x 58 m; rows of x and z may be given."""
    x = np.linspace(-36, 36, 7)
    line = np.column_stack([x, 8 - x**2 / 200]) if rows is None else np.array(rows, dtype=float)
    y = np.linspace(-29, 29, 6)
    net = np.empty((len(line), len(y), 3))
    net[..., 0], net[..., 1] = line[:, None, 0], y
    net[..., 2] = line[:, None, 1] - y**2 / 150
    return net


def _site(model: Model) -> Model:
    corners = np.column_stack([roof_outline(), np.zeros(len(roof_outline()))])
    return model.add(closed_polyline(corners), "SITE", "site")


def write_empty(path: Path) -> Path:
    """No objects at all."""
    return Model().write(path)


def write_block(path: Path) -> Path:
    """The roof is inside a block."""
    return _site(Model().add_block(nurbs(graph_net()), "ROOF", "roof")).write(path)


def write_two_layers(path: Path) -> Path:
    """A surface on each of two layers."""
    model = Model().add(nurbs(graph_net()), "ROOF", "roof")
    return _site(model.add(nurbs(graph_net() - [0, 0, 5]), "CEILING", "ceiling")).write(path)


def write_fold(path: Path) -> Path:
    """A surface that turns over at x = 25 and comes back under itself, over the site."""
    rows = [[-36, 5], [-22, 7], [-8, 8], [8, 8], [22, 7], [32, 4], [30, -2], [16, -6], [0, -7]]
    return _site(Model().add(nurbs(graph_net(rows)), "ROOF", "roof")).write(path)


def write_two_storeys(path: Path) -> Path:
    """Two surfaces, one above the other."""
    model = Model().add(nurbs(graph_net()), "ROOF", "upper")
    return _site(model.add(nurbs(graph_net() - [0, 0, 4]), "ROOF", "lower")).write(path)


def write_upright(path: Path) -> Path:
    """A wall."""
    net = graph_net()[..., [0, 2, 1]] * [1.0, 0.1, 0.3]
    return _site(Model().add(nurbs(net), "ROOF", "wall")).write(path)


def write_crease(path: Path) -> Path:
    """A ridge of full multiplicity at x = 0."""
    rows = [[-36, 0], [-24, 3], [-12, 6], [0, 9], [12, 6], [24, 3], [36, 0]]
    knots = np.array([0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2.0]), uniform_knots(6, 3)
    made = nurbs(graph_net(rows), (3, 3), knots)
    return _site(Model().add(made, "ROOF", "ridge")).write(path)


def write_plain(path: Path) -> Path:
    """One untrimmed vault and the site: nothing to refuse."""
    return _site(Model().add(nurbs(graph_net()), "ROOF", "roof")).write(path)


def write_encrypted(path: Path) -> Path:
    """The head of a model, and noise after it."""
    head = write_plain(path).read_bytes()[:32]
    path.write_bytes(head + np.random.default_rng(5).bytes(20_000))
    return path


def write_truncated(path: Path) -> Path:
    """The first half of a model."""
    content = write_plain(path).read_bytes()
    path.write_bytes(content[: len(content) // 2])
    return path


def write_newer(path: Path) -> Path:
    """A model that says that it is of Rhino 9."""
    content = write_plain(path).read_bytes()
    path.write_bytes(content[:24] + b"      90" + content[32:])
    return path


def write_text(path: Path) -> Path:
    """Text under the name of a model."""
    path.write_text("solid roof\n" + "facet normal 0 0 1\n" * 50, encoding="utf-8")
    return path


ZOO = {
    "empty": write_empty,
    "block": write_block,
    "two_layers": write_two_layers,
    "fold": write_fold,
    "two_storeys": write_two_storeys,
    "upright": write_upright,
    "crease": write_crease,
    "plain": write_plain,
    "encrypted": write_encrypted,
    "truncated": write_truncated,
    "newer": write_newer,
    "text": write_text,
}


def write_models_zoo(folder: Path) -> dict[str, Path]:
    """All of them, each as NAME.3dm in a folder."""
    return {name: write(folder / f"{name}.3dm") for name, write in ZOO.items()}
