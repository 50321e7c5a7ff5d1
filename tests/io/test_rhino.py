"""Surfaces of .3dm files: numbers, units, origins, choice, and every refusal."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pqmesh.design import UNITS
from pqmesh.errors import FormatError, PqmeshError, SpecError, SurfaceError
from pqmesh.io.foreign import METRES
from pqmesh.io.nurbs import surface_from_nurbs
from pqmesh.io.rhino import read_rhino_surfaces
from pqmesh.surface.bspline import uniform_knots
from pqmesh.surface.regular import check_regular

rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")

RNG = np.random.default_rng(7)


def nurbs(
    points: np.ndarray,
    degrees: tuple[int, int],
    knots: tuple[np.ndarray, np.ndarray] | None = None,
    weights: np.ndarray | None = None,
) -> Any:
    """A NURBS surface of rhino3dm of Euclidean points and full knots."""
    n, m = points.shape[:2]
    knots = knots or (uniform_knots(n, degrees[0]), uniform_knots(m, degrees[1]))
    mass = np.ones((n, m)) if weights is None else weights
    orders = degrees[0] + 1, degrees[1] + 1
    made = rhino3dm.NurbsSurface.Create(3, weights is not None, *orders, n, m)
    for i in range(n):
        for j in range(m):
            x, y, z = (points[i, j] * mass[i, j]).tolist()
            made.Points[i, j] = rhino3dm.Point4d(x, y, z, float(mass[i, j]))
    for own, line in ((made.KnotsU, knots[0]), (made.KnotsV, knots[1])):
        for k, value in enumerate(line[1:-1].tolist()):
            own[k] = value
    assert made.IsValid
    return made


def net(n: int, m: int, size: float = 10.0) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, size, n), np.linspace(0, size, m), indexing="ij")
    return np.stack([x, y, 0.2 * size * RNG.random((n, m))], axis=-1)


class Model:
    """A model to be written, object by object."""

    def __init__(self, unit: str = "Meters") -> None:
        self.file = rhino3dm.File3dm()
        self.file.Settings.ModelUnitSystem = getattr(rhino3dm.UnitSystem, unit)

    def layer(self, name: str, parent: int | None = None) -> int:
        layer = rhino3dm.Layer()
        layer.Name = name
        if parent is not None:
            layer.ParentLayerId = self.file.Layers[parent].Id
        return int(self.file.Layers.Add(layer))

    def add(self, geometry: Any, layer: int = 0, name: str = "") -> "Model":
        attributes = rhino3dm.ObjectAttributes()
        attributes.LayerIndex, attributes.Name = layer, name
        self.file.Objects.Add(geometry, attributes)
        return self

    def write(self, path: Path, version: int = 8) -> Path:
        assert self.file.Write(str(path), version)
        return path


def plain_patch() -> Any:
    return nurbs(net(5, 6), (3, 3))


def block_model() -> Model:
    model = Model()
    model.layer("Roof")
    attributes = rhino3dm.ObjectAttributes()
    definitions = model.file.InstanceDefinitions
    definitions.Add("b", "", "", "", rhino3dm.Point3d(0, 0, 0), (plain_patch(),), (attributes,))
    move = rhino3dm.Transform.Identity()
    return model.add(rhino3dm.InstanceReference(definitions.FindIndex(0).Id, move), 0, "roof block")


def mesh() -> Any:
    made = rhino3dm.Mesh()
    for x, y in ((0, 0), (1, 0), (1, 1)):
        made.Vertices.Add(x, y, 0)
    made.Faces.AddFace(0, 1, 2)
    return made


def refused(kind: type[PqmeshError], path: Path, select: str | None = None) -> str:
    with pytest.raises(kind) as caught:
        read_rhino_surfaces(path, select)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert text.endswith((".", "?"))
    return text.removeprefix(f"{path}: ")


# --- numbers --------------------------------------------------------------------------------


def geomdl_jets(
    points: np.ndarray,
    degrees: tuple[int, int],
    knots: tuple[np.ndarray, np.ndarray],
    weights: np.ndarray | None,
    uv: np.ndarray,
) -> np.ndarray:
    from geomdl import NURBS, BSpline

    other = BSpline.Surface() if weights is None else NURBS.Surface()
    other.degree_u, other.degree_v = degrees
    n, m = points.shape[:2]
    flat = points.reshape(-1, 3)
    if weights is not None:
        flat = np.hstack([flat * weights.reshape(-1, 1), weights.reshape(-1, 1)])
    other.set_ctrlpts(flat.tolist(), n, m)
    other.knotvector_u, other.knotvector_v = knots[0].tolist(), knots[1].tolist()
    pairs = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    jets = [other.derivatives(u, v, order=2) for u, v in uv]
    return np.array([[jet[a][b] for jet in jets] for a, b in pairs])


def cases() -> dict[str, tuple[Any, ...]]:
    half = np.sqrt(0.5)
    ring = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
    tube = np.array([[[x, y, 0.0], [x, y, 2.0]] for x, y in ring], dtype=float)
    mass = np.array([[1.0, 1.0], [half, half]] * 4 + [[1.0, 1.0]])
    double = np.array([0.0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]) / 4
    ends = np.array([0.0, 0, 1, 1])
    grid = uniform_knots(5, 3), uniform_knots(6, 2)
    weights = 0.5 + RNG.random((5, 6))
    uneven = np.array([0, 0, 0, 0.1, 0.6, 0.7, 1, 1, 1.0])
    return {
        "polynomial": (net(5, 6), (3, 2), grid, None),
        "rational": (net(5, 6), (3, 2), grid, weights),
        "degree 5": (net(7, 6), (5, 5), (uniform_knots(7, 5), uniform_knots(6, 5)), None),
        "uneven knots": (net(6, 6), (2, 2), (uneven, uneven), None),
        "rational arcs": (tube, (2, 1), (double, ends), mass),
    }


@pytest.mark.parametrize("name", list(cases()))
def test_jets_equal_those_of_another_program(name: str, tmp_path: Path) -> None:
    points, degrees, knots, weights = cases()[name]
    path = Model().add(nurbs(points, degrees, knots, weights)).write(tmp_path / "a.3dm")
    surface = read_rhino_surfaces(path).patches[0].surface
    uv = np.random.default_rng(3).random((12, 2))
    expected = geomdl_jets(points, degrees, knots, weights, uv)
    assert np.stack(surface.jet(uv)) == pytest.approx(expected, rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("version", [5, 6, 7, 8])
def test_control_net_comes_back_exactly_from_each_version(version: int, tmp_path: Path) -> None:
    points = net(5, 4)
    path = Model().add(nurbs(points, (3, 3))).write(tmp_path / "a.3dm", version)
    surface = read_rhino_surfaces(path).patches[0].surface
    assert (surface.points == points).all()
    assert surface.degrees == (3, 3)
    assert surface.weights is None
    assert np.allclose(surface.knots[0], uniform_knots(5, 3), rtol=0, atol=0)


def test_periodic_patch_is_periodic(tmp_path: Path) -> None:
    angles = np.arange(8) / 8 * 2 * np.pi
    loop = np.stack([5 * np.cos(angles), 5 * np.sin(angles), 0 * angles], axis=1)
    points = np.stack([loop, 0.7 * loop + [0, 0, 3], 0.9 * loop + [0, 0, 6]], axis=1)
    wrapped = np.concatenate([points, points[:3]])
    knots = uniform_knots(8, 3, periodic=True), uniform_knots(3, 2)
    knots = np.arange(-3.0, 12.0) / 8, knots[1]
    path = Model().add(nurbs(wrapped, (3, 2), knots)).write(tmp_path / "a.3dm")
    patch = read_rhino_surfaces(path).patches[0]
    assert patch.surface.domain.periodic == (True, False)
    assert patch.surface.domain.u == (0.0, 1.0)
    check_regular(patch.surface)


def test_rational_tube_is_periodic_and_round(tmp_path: Path) -> None:
    points, degrees, knots, weights = cases()["rational arcs"]
    path = Model().add(nurbs(points, degrees, knots, weights)).write(tmp_path / "a.3dm")
    surface = read_rhino_surfaces(path).patches[0].surface
    assert surface.domain.periodic == (True, False)
    at = surface.jet(np.random.default_rng(0).random((50, 2))).point
    assert np.hypot(at[:, 0], at[:, 1]) == pytest.approx(np.ones(50), abs=1e-14)


def test_smooth_polynomial_joint_of_full_multiplicity_is_accepted() -> None:
    points = net(5, 4)
    # Two Bezier pieces of degree 2 with equal tangents at the joint.
    points[2] = 0.5 * (points[1] + points[3])
    line = np.array([0.0, 0, 0, 1, 1, 2, 2, 2])
    surface = surface_from_nurbs(points, (2, 3), (line, uniform_knots(4, 3)))
    assert surface.degrees == (3, 3)
    uv = np.random.default_rng(1).random((9, 2)) * [2, 1]
    expected = geomdl_jets(points, (2, 3), (line / 2, uniform_knots(4, 3)), None, uv / [2, 1])
    assert surface.jet(uv).point == pytest.approx(expected[0], abs=1e-13)
    assert surface.jet(uv).duu == pytest.approx(expected[3] / 4, abs=1e-11)


def test_crease_is_refused_with_object_and_layer(tmp_path: Path) -> None:
    line = np.array([0.0, 0, 0, 1, 1, 2, 2, 2])
    model = Model()
    roof = model.layer("Roof")
    bad = nurbs(net(5, 4), (2, 3), (line, uniform_knots(4, 3)))
    text = refused(SurfaceError, model.add(bad, roof, "ridge").write(tmp_path / "a.3dm"))
    assert text.startswith("Object 'ridge' on layer 'Roof', face 0: ")
    assert "this is a crease" in text


# --- units and origins ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rhino_unit", "unit"),
    [
        *(("Meters", "m"), ("Millimeters", "mm"), ("Centimeters", "cm"), ("Kilometers", "km")),
        *(("Feet", "ft"), ("Inches", "in")),
    ],
)
def test_units_are_those_of_the_file(rhino_unit: str, unit: str, tmp_path: Path) -> None:
    path = Model(rhino_unit).add(plain_patch()).write(tmp_path / "a.3dm")
    assert read_rhino_surfaces(path).units == unit


def test_units_agree_with_the_design() -> None:
    assert METRES == UNITS


@pytest.mark.parametrize("unit", ["Yards", "Miles", "Microns"])
def test_other_units_are_refused_by_name(unit: str, tmp_path: Path) -> None:
    path = Model(unit).add(plain_patch()).write(tmp_path / "a.3dm")
    assert f"found {unit}. Set the model unit" in refused(FormatError, path)


def test_far_origin_is_taken_off_without_losing_a_digit(tmp_path: Path) -> None:
    points = np.round(net(5, 5, 40_000.0) * 1024) / 1024 + [5e8, 3e8, 0.0]
    path = Model("Millimeters").add(nurbs(points, (3, 3))).write(tmp_path / "a.3dm")
    found = read_rhino_surfaces(path)
    assert (found.origin == np.round(found.origin)).all()
    assert np.abs(found.origin - [5e8, 3e8, 0]).max() < 40_000
    near = found.patches[0].surface.points
    assert np.abs(near).max() < 50_000
    assert (near + found.origin == points).all()


def test_near_geometry_keeps_its_origin(tmp_path: Path) -> None:
    path = Model().add(nurbs(net(4, 4) + 50.0, (3, 3))).write(tmp_path / "a.3dm")
    assert (read_rhino_surfaces(path).origin == 0).all()


def test_patches_share_one_origin(tmp_path: Path) -> None:
    model = Model().add(nurbs(net(4, 4) + 1e6, (3, 3)))
    found = read_rhino_surfaces(
        model.add(nurbs(net(4, 4) + (1e6 + 10), (3, 3))).write(tmp_path / "a.3dm")
    )
    left, right = (patch.surface.points[..., 0] for patch in found.patches)
    assert left.max() == right.min()


# --- choice ---------------------------------------------------------------------------------


@pytest.fixture
def office(tmp_path: Path) -> Path:
    model = Model()
    roof = model.layer("Roof")
    shell, site, empty = model.layer("Shell", roof), model.layer("Site"), model.layer("Empty")
    model.layer("Shell", site)
    model.add(plain_patch(), shell, "main").add(plain_patch(), shell, "porch")
    model.add(plain_patch(), site, "ground").add(mesh(), site, "trees")
    model.add(rhino3dm.LineCurve(rhino3dm.Point3d(0, 0, 0), rhino3dm.Point3d(1, 0, 0)), roof)
    assert empty == 3
    return model.write(tmp_path / "office.3dm")


@pytest.mark.parametrize(
    ("select", "names"),
    [
        ("Roof::Shell", ["main", "porch"]),
        ("roof::SHELL", ["main", "porch"]),
        ("Site", ["ground"]),
        ("main", ["main"]),
        ("PORCH", ["porch"]),
    ],
)
def test_selection_by_layer_or_name(office: Path, select: str, names: list[str]) -> None:
    patches = read_rhino_surfaces(office, select).patches
    assert [patch.name for patch in patches] == names
    assert {patch.layer for patch in patches} <= {"Roof::Shell", "Site"}


def test_leaf_of_a_path_selects_the_layer(tmp_path: Path) -> None:
    model = Model()
    inner = model.layer("Shell", model.layer("Roof"))
    path = model.add(plain_patch(), inner).write(tmp_path / "a.3dm")
    assert read_rhino_surfaces(path, "shell").patches[0].layer == "Roof::Shell"


def test_several_layers_need_a_selection(office: Path) -> None:
    text = refused(SpecError, office)
    assert "There are surfaces on the layers 'Roof::Shell' (2), 'Site' (1)" in text
    assert "named objects: 'main' (1), 'porch' (1), 'ground' (1)" in text


def test_unknown_name_brings_the_nearest_and_what_is_there(office: Path) -> None:
    text = refused(SpecError, office, "Prch")
    assert "No layer or object is called 'Prch'; did you mean 'porch'?" in text
    assert "'Roof::Shell' (2)" in text


def test_name_like_nothing_has_no_hint(office: Path) -> None:
    assert "is called 'qqqqqq'. There are" in refused(SpecError, office, "qqqqqq")


def test_leaf_of_two_layers_is_refused(office: Path) -> None:
    assert "'Roof::Shell', 'Site::Shell'" in refused(SpecError, office, "Shell")


def test_layer_without_a_surface_is_refused(office: Path) -> None:
    assert "'Roof' must hold a surface; it holds 1 curve." in refused(SpecError, office, "Roof")
    assert "'trees' must hold a surface; it holds 1 mesh." in refused(SpecError, office, "trees")
    assert "The layer 'Empty' is empty." in refused(SpecError, office, "Empty")


def test_hidden_and_locked_objects_are_read(tmp_path: Path) -> None:
    model = Model()
    attributes = rhino3dm.ObjectAttributes()
    attributes.Mode, attributes.Visible = rhino3dm.ObjectMode.Locked, False
    model.file.Objects.Add(plain_patch(), attributes)
    assert len(read_rhino_surfaces(model.write(tmp_path / "a.3dm")).patches) == 1


def test_junk_beside_the_surface_is_ignored(tmp_path: Path) -> None:
    model = block_model()
    junk = model.layer("Junk")
    model.add(mesh(), junk).add(rhino3dm.Point(rhino3dm.Point3d(1, 2, 3)), junk)
    path = model.add(plain_patch(), model.layer("Shell")).write(tmp_path / "a.3dm")
    assert len(read_rhino_surfaces(path).patches) == 1


# --- refusals -------------------------------------------------------------------------------


def test_block_instance_is_refused_when_selected(tmp_path: Path) -> None:
    path = block_model().write(tmp_path / "a.3dm")
    for select in ("Roof", "roof block"):
        text = refused(SpecError, path, select)
        assert "holds 1 block instance. Explode the blocks" in text
    assert "it holds 1 block instance. Explode the blocks first." in refused(FormatError, path)


def test_layer_of_a_surface_and_a_block_is_refused(tmp_path: Path) -> None:
    path = block_model().add(plain_patch()).write(tmp_path / "a.3dm")
    assert "Explode the blocks" in refused(SpecError, path, "Roof")


def test_file_without_a_surface_says_what_it_holds(tmp_path: Path) -> None:
    path = Model().add(mesh()).add(mesh()).write(tmp_path / "a.3dm")
    assert refused(FormatError, path).startswith(
        "The file must hold a surface; it holds 2 meshes. Export a surface."
    )


def test_files_that_are_no_models_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.3dm"
    assert "must exist; found none" in refused(FormatError, path)
    assert "found a folder" in refused_folder(tmp_path)
    path.write_bytes(b"")
    assert "it is empty" in refused(FormatError, path)
    path.write_bytes(b"solid roof\n" * 100)
    assert "compressed or encrypted? Save it as .3dm" in refused(FormatError, path)
    Model().write(path)
    assert "must hold objects; this one is empty" in refused(FormatError, path)


def refused_folder(folder: Path) -> str:
    with pytest.raises(FormatError) as caught:
        read_rhino_surfaces(folder)
    return str(caught.value)


def test_file_of_a_newer_rhino_is_refused(tmp_path: Path) -> None:
    path = Model().add(plain_patch()).write(tmp_path / "a.3dm")
    content = path.read_bytes()
    newest = rhino3dm.__version__.partition(".")[0]
    path.write_bytes(content[:24] + b"     990" + content[32:])
    text = refused(FormatError, path)
    assert f"must be of version {newest} or earlier; this one is of version 99." in text


def test_missing_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Model().add(plain_patch()).write(tmp_path / "a.3dm")
    monkeypatch.setitem(sys.modules, "rhino3dm", None)
    text = refused(FormatError, path)
    assert "needs the library rhino3dm" in text
    assert "pip install 'pqmesh[aec]'" in text


@settings(
    max_examples=60,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.data())
def test_cut_file_is_refused(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "whole.3dm"
    if not path.exists():
        Model().add(plain_patch(), 0, "main").write(path)
    content = path.read_bytes()
    cut = tmp_path / "cut.3dm"
    cut.write_bytes(content[: data.draw(st.integers(0, len(content) - 1))])
    with pytest.raises(FormatError):
        read_rhino_surfaces(cut)
