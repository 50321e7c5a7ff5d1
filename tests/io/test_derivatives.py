"""Derivatives of surfaces read from files, against two other programs, to 1e-10 of their size."""

import json
from pathlib import Path

import numpy as np
import pytest

from pqmesh.io.compas import read_compas_surface
from pqmesh.io.rhino import read_rhino_surfaces
from pqmesh.surface.bspline import BSplineSurface

pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")
pytest.importorskip("geomdl", reason="geomdl (extra test) is not installed")

import iges
import jets
import models

LIMIT = 1e-10


def found_jets(surface: BSplineSurface, origin: np.ndarray, uv: np.ndarray) -> np.ndarray:
    rows = np.stack(surface.jet(uv))
    rows[0] += origin
    return rows


def check(net: jets.Nurbs, surface: BSplineSurface, origin: np.ndarray) -> None:
    uv = jets.places(net)
    assert surface.domain.inside(uv).all()
    found = found_jets(surface, origin, uv)
    for other in (jets.geomdl_jets, jets.scipy_jets):
        assert jets.differences(found, other(net, uv)).max() < LIMIT


def saved_and_read(net: jets.Nurbs, path: Path) -> tuple[BSplineSurface, np.ndarray]:
    models.Model("Inches").add(models.nurbs(*net), "LENS").write(path)
    file = read_rhino_surfaces(path)
    return file.patches[0].surface, file.origin


@pytest.mark.parametrize("name", list(jets.OWN))
def test_own_files(name: str, tmp_path: Path) -> None:
    net = jets.OWN[name]()
    surface, origin = saved_and_read(net, tmp_path / "a.3dm")
    assert surface.domain.periodic == {"torus": (True, True), "periodic": (True, False)}.get(
        name, (False, False)
    )
    check(net, surface, origin)


def test_compas_surface(data_folder: Path) -> None:
    path = data_folder / "surface_from_rhino.json"
    table = json.loads(path.read_text(encoding="utf-8"))["data"]
    knots = [np.repeat(table[f"knots_{x}"], table[f"mults_{x}"]) for x in "uv"]
    net = jets.Nurbs(np.array(table["points"]), (3, 3), (knots[0], knots[1]))
    check(net, read_compas_surface(path), np.zeros(3))


def test_lens_of_nine_patches(data_folder: Path, tmp_path: Path) -> None:
    unit, surfaces = iges.read_iges_surfaces(data_folder / "sunglasses_lens.igs")
    assert unit == "in"
    assert len(surfaces) == 9
    for i, net in enumerate(surfaces):
        assert net.degrees == (3, 3)
        assert net.points.shape == (16, 16, 3)
        assert net.weights is None
        made = jets.Nurbs(net.points, net.degrees, net.knots)
        check(made, *saved_and_read(made, tmp_path / f"{i}.3dm"))


def test_lens_in_one_file_has_the_extent_of_its_index(data_folder: Path, tmp_path: Path) -> None:
    _, nets = iges.read_iges_surfaces(data_folder / "sunglasses_lens.igs")
    model = models.Model("Inches")
    for i, net in enumerate(nets):
        model.add(models.nurbs(net.points, net.degrees, net.knots), "LENS", f"patch {i}")
    file = read_rhino_surfaces(model.write(tmp_path / "lens.3dm"), "lens")
    assert [patch.name for patch in file.patches] == [f"patch {i}" for i in range(9)]
    uv = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 40)]), axis=-1).reshape(-1, 2)
    points = np.concatenate([patch.surface.jet(uv).point for patch in file.patches])
    # The index of the data gives millimetres.
    assert 25.4 * np.ptp(points, axis=0) == pytest.approx([62.9, 33.5, 20.0], rel=0.01)
    assert 25.4 * np.linalg.norm(points.mean(axis=0) + file.origin) == pytest.approx(330, rel=0.05)


def test_second_derivatives_that_jump_are_those_from_the_right(tmp_path: Path) -> None:
    net = jets.torus_net()
    surface, origin = saved_and_read(net, tmp_path / "a.3dm")
    knot = np.array([[2.0, 1.3]])
    before, at, after = (
        found_jets(surface, origin, knot + step * np.array([[1.0, 0.0]]))[3]
        for step in (-1e-9, 0.0, 1e-9)
    )
    assert np.abs(before - at).max() > 1.0
    assert after == pytest.approx(at, abs=1e-6)
    assert jets.geomdl_jets(net, knot)[3] == pytest.approx(at, abs=1e-10)
    assert jets.scipy_jets(net, knot)[3] == pytest.approx(at, abs=1e-10)


# --- the reader of IGES files is strict -----------------------------------------------------


@pytest.fixture
def lens(data_folder: Path) -> str:
    return (data_folder / "sunglasses_lens.igs").read_text(encoding="ascii")


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("P    100\n", "P    101\n", "Lines must be numbered"),
        ("P    100\n", "P    100 \n", "80 columns"),
        ("128     213", "126     213", "Entities must be 128"),
        ("128     213", "128     214", "point back"),
        ("128,15,15,", "128,15,14,", "must have 1013 numbers here; found 1078"),
        ("0.153846153846,", "0.15384615x846,", "must be numbers"),
        ("P   1908  ", "P   1907  ", "Sections must be complete"),
    ],
)
def test_iges_file_that_is_not_right_is_refused(
    lens: str, tmp_path: Path, old: str, new: str, text: str
) -> None:
    assert old in lens
    path = tmp_path / "a.igs"
    path.write_text(lens.replace(old, new, 1), encoding="ascii")
    with pytest.raises(ValueError, match=text):
        iges.read_iges_surfaces(path)
