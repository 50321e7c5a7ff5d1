"""Files from the office through the command: Rhino models, COMPAS surfaces, outlines, units."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import models
import numpy as np
import pytest

from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.measure import fitted_cones, planarity
from pqmesh.vectors import dot, norm

Command = Callable[..., Any]
Refused = Callable[..., str]


def report_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "report.json").read_text("utf-8"))
    return found


# --- the roof as three joined, trimmed faces, far away and in millimetres -------------------


@pytest.fixture
def far_roof(pqmesh: Command, tmp_path: Path) -> Path:
    """The folder of a coarse roof panelled from a Rhino model."""
    models.write_roof_model(tmp_path / "roof.3dm")
    done = pqmesh(
        *("panelize", "roof.3dm", "--select", "ROOF", "--outline", "roof.3dm:SITE"),
        *("--edge", "4000", "--layers=-600,120", "--no-figures", "-o", "far"),
    )
    assert done.code == 0, done.err
    return tmp_path / "far"


def test_far_roof_keeps_unit_and_place_and_stays_exact(far_roof: Path) -> None:
    report = report_of(far_roof)
    assert report["units"] == "mm"
    assert "3 faces joined to one surface" in report["warnings"]
    assert report["panels"]["covered_share"] == pytest.approx(1.0, abs=1e-9)
    origin = np.array(report["origin"])
    assert np.abs(origin[:2] - [5e8, 3e8]).max() < 1e5
    mesh = read_quad_mesh(far_roof / "mesh.obj")
    assert np.abs(mesh.vertices.mean(axis=0)[:2] - [5e8, 3e8]).max() < 5e3
    # Coordinates of 5e8 are rounded to 6e-8: judged near the origin they are flat to that.
    near = mesh.with_vertices(mesh.vertices - origin)
    assert planarity(near).max() < 1e-9
    cones = fitted_cones(near)
    assert cones.relative_spread.max() < 1e-7
    for number, distance in ((1, -600.0), (2, 120.0)):
        layer = read_quad_mesh(far_roof / f"layer-{number}.obj").vertices - origin
        shift = (layer - near.vertices)[near.faces]
        reached = dot(shift, near.face_normals[:, None])
        assert np.abs(reached - distance).max() < 1e-6


def test_far_roof_is_the_near_one_moved(far_roof: Path, pqmesh: Command, tmp_path: Path) -> None:
    models.write_roof_model(tmp_path / "near.3dm", unit="Meters", origin=(0.0, 0.0, 0.0))
    done = pqmesh(
        *("panelize", "near.3dm", "--select", "ROOF", "--outline", "near.3dm:SITE"),
        *("--edge", "4", "--layers=-0.6,0.12", "--no-figures", "-o", "near"),
    )
    assert done.code == 0, done.err
    far, near = (read_quad_mesh(tmp_path / f / "mesh.obj") for f in ("far", "near"))
    assert far.topology.n_faces == near.topology.n_faces
    moved = (far.vertices - [5e8, 3e8, 0.0]) / 1000.0
    assert np.abs(moved - near.vertices).max() < 1e-6


def test_faces_without_an_outline_are_cut_at_their_rim(pqmesh: Command, tmp_path: Path) -> None:
    models.write_roof_model(tmp_path / "roof.3dm", unit="Meters", origin=(0.0, 0.0, 0.0))
    done = pqmesh(
        "panelize", "roof.3dm", "--select", "roof", "--edge", "5", "--no-figures", "-o", "out"
    )
    assert done.code == 0, done.err
    report = report_of(tmp_path / "out")
    assert "no outline given: panels are cut at the rim of the faces" in report["warnings"]
    assert report["panels"]["trimmed"] > 20
    # The faces reach about three metres over a site of 2633 m2 and 208 m around, and are bent.
    assert 2633 + 2 * 208 < report["panels"]["area_total"] < 1.15 * (2633 + 4 * 208)


def test_faces_that_do_not_join_are_panelled_each_on_its_own(
    pqmesh: Command, tmp_path: Path
) -> None:
    model = models.Model("Meters")
    for shift, name in ((0.0, "west"), (72.0, "east")):
        points = models.graph_net() + np.array([shift, 0.0, 0.02 * shift])
        model.add(models.nurbs(points), "ROOF", name)
    model.write(tmp_path / "two.3dm")
    done = pqmesh("panelize", "two.3dm", "--edge", "6", "--no-figures", "-o", "out")
    index = report_of(tmp_path / "out")
    assert [part["name"] for part in index["parts"]] == ["west (face 0)", "east (face 0)"]
    assert done.code == max(part["exit_code"] for part in index["parts"])
    assert any("each face is panelled on its own" in text for text in index["warnings"])
    for part in index["parts"]:
        mesh = read_quad_mesh(tmp_path / "out" / part["folder"] / "mesh.obj")
        assert planarity(mesh).max() < 1e-10


def test_compas_surface_of_the_index_is_read_by_the_command(
    pqmesh: Command, data_folder: Path, tmp_path: Path
) -> None:
    done = pqmesh(
        *("panelize", data_folder / "surface_from_rhino.json", "--edge", "1.2", "--no-figures"),
        *("--kind", "planar", "--network", "uv", "-o", "out"),
    )
    assert done.code in (0, 3), done.err
    assert report_of(tmp_path / "out")["after"]["planarity_max"] < 1e-9


def test_surface_is_continued_on_request_only(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(
        '[surface]\ngraph = {z = "x*y/9 - y**2/12", x = [-5, 5], y = [-4, 4]}\n'
        "[outline]\npolygon = [[-5, -4], [5, -4], [5, 4], [-5, 4]]\n[panels]\nedge = 1\n"
    )
    short = pqmesh("panelize", "vault.toml", "--no-figures", "-o", "short")
    assert short.code == 3
    assert "not reached: cover" in short.err
    assert "surface.extend" in " ".join(report_of(tmp_path / "short")["warnings"])
    whole = pqmesh("panelize", "vault.toml", "--extend", "3 m", "--no-figures", "-o", "whole")
    assert whole.code == 0, whole.err
    assert report_of(tmp_path / "whole")["panels"]["covered_share"] == pytest.approx(1, abs=1e-9)


# --- outlines -------------------------------------------------------------------------------

VAULT = (
    '[surface]\ngraph = {z = "5 - y**2/16 + x**2/50 + x*y/60", x = [-12, 12], y = [-9, 9]}\n'
    'units = "m"\n[panels]\nedge = 2\n[output]\nfigures = false\n'
)
RING = "-8,-5\n8,-5\n8,5\n-8,5\n-8,-5\n"


def test_outline_in_another_unit_is_converted(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(VAULT)
    (tmp_path / "site.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="20000mm" height="20000mm" '
        'viewBox="0 0 20 20"><path id="site" d="M-8 -5 H8 V5 H-8 Z"/></svg>'
    )
    done = pqmesh("panelize", "vault.toml", "--outline", "site.svg:site", "-o", "out")
    assert done.code == 0, done.err
    area = report_of(tmp_path / "out")["panels"]["covered_share"] * 160
    assert area == pytest.approx(160.0, rel=1e-9)


def test_hole_of_an_outline_is_left_out(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(
        VAULT + "[outline]\npolygon = [[-8,-5],[8,-5],[8,5],[-8,5]]\n"
        "holes = [[[-1,-1],[1,-1],[1,1],[-1,1]]]\n"
    )
    done = pqmesh("panelize", "vault.toml", "-o", "out")
    assert done.code == 0, done.err
    rows = (tmp_path / "out" / "panels.obj").read_text().splitlines()
    corners = np.array([row.split()[1:3] for row in rows if row.startswith("v ")], dtype=float)
    assert not (np.abs(corners) < 0.999).all(axis=1).any()
    faces = [[int(i) - 1 for i in row.split()[1:]] for row in rows if row.startswith("f ")]
    plan = 0.0
    for face in faces:
        x, y = corners[face].T
        plan += 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert plan == pytest.approx(156.0, rel=1e-9)


OUTLINES = {
    "misses": ("40,40\n50,40\n50,50\n40,50\n40,40\n", "outline must lie over the surface"),
    "crosses itself": ("-8,-5\n8,5\n8,-5\n-8,5\n-8,-5\n", "must not cross or touch itself"),
    "is a point": ("1,1\n1,1\n1,1\n", "all of it lies at the point"),
    "in millimetres": (RING.replace("5", "5000").replace("8", "8000"), "one were in mm"),
    "in kilometres": (RING.replace("5", ".005").replace("8", ".008"), "one were in mm"),
    "hole outside": (RING + "\n20,20\n21,20\n21,21\n20,20\n", "lies outside the largest ring"),
    "is too thin": ("-8,0\n8,0\n8,0.001\n-8,0.001\n", "inside it (16 by 0.001)"),
    "is smaller than a panel": ("0,0\n.3,0\n.3,.3\n0,.3\n", "edge must be shorter than the roof"),
    "has decimal commas between commas": ("-8,5,-5,2\n8,5,-5,2\n8,5,5,2\n", "found 4 in"),
    "empty": ("", "it is empty"),
    "words": ("here,there\n", "rows"),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_outline_without_sense_is_refused(refused: Refused, tmp_path: Path, name: str) -> None:
    text, expected = OUTLINES[name]
    (tmp_path / "vault.toml").write_text(VAULT)
    (tmp_path / "site.csv").write_text(text)
    assert expected in refused("panelize", "vault.toml", "--outline", "site.csv", "-o", "out")


def test_open_outline_is_refused_with_the_place(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(VAULT)
    (tmp_path / "site.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><path id="a" d="M-8 -5 H8 V5 H-8 V-4"/></svg>'
    )
    line = refused("panelize", "vault.toml", "--outline", "site.svg", "-o", "out")
    assert "it is open at (-8, 5)" in line


# --- models that cannot be meant ------------------------------------------------------------

MODELS = {
    "empty": "must hold objects; this one is empty",
    "block": "Explode the blocks",
    "crease": "this is a crease",
    "encrypted": "damaged or encrypted",
    "truncated": "cut off",
    "newer": "this one is of version 9",
    "text": "A Rhino model must begin with",
    "two_storeys": "lies over face",
    "fold": "must not turn over, seen from above",
    "upright": "seen from above",
}


@pytest.mark.parametrize("name", MODELS)
def test_model_without_sense_is_refused(refused: Refused, tmp_path: Path, name: str) -> None:
    models.ZOO[name](tmp_path / "a.3dm")
    site = tmp_path / "site.csv"
    ring = models.roof_outline()
    site.write_text("".join(f"{x},{y}\n" for x, y in [*ring, ring[0]]))
    line = refused(
        *("panelize", "a.3dm", "--select", "ROOF", "--outline", "site.csv", "--edge", "4"),
        *("-o", "out"),
    )
    assert MODELS[name] in line


def test_layer_that_does_not_exist_is_answered_with_what_is_there(
    refused: Refused, tmp_path: Path
) -> None:
    models.write_plain(tmp_path / "a.3dm")
    line = refused("panelize", "a.3dm", "--select", "ROOOF", "--edge", "4", "-o", "out")
    assert "did you mean 'roof'?" in line
    assert "'ROOF' (1)" in line


def test_unit_that_contradicts_the_model_is_refused(refused: Refused, tmp_path: Path) -> None:
    models.write_roof_model(tmp_path / "a.3dm")
    line = refused(
        *("panelize", "a.3dm", "--select", "ROOF", "--units", "m", "--edge", "4", "-o", "out")
    )
    assert "the file is in mm and the design says m" in line


def test_edge_of_another_unit_is_refused_with_the_extent(refused: Refused, tmp_path: Path) -> None:
    models.write_roof_model(tmp_path / "a.3dm")
    line = refused("panelize", "a.3dm", "--select", "ROOF", "--edge", "1.5", "-o", "out")
    assert "at most 1000000 panels" in line


CONTRADICTIONS = {
    '[outline]\nfile = "site.csv"\npolygon = [[0,0],[1,0],[0,1]]': "either a file or a polygon",
    '[outline]\nfile = "site.csv"\nholes = [[[0,0],[1,0],[0,1]]]': "holes beside a file",
    '[outline]\npolygon = [[0,0],[1,0],[0,1]]\nselect = "x"': "beside a polygon",
    '[tolerance]\ndeviation = "1 mm"\n[boundary]\nmode = "free"': "panels.within must not ask",
    '[tolerance]\nflat = "1 mm"': "panels.flat must not allow more",
}


@pytest.mark.parametrize("section", CONTRADICTIONS, ids=lambda text: text[:40].replace("\n", " "))
def test_keys_that_contradict_each_other_are_refused(
    refused: Refused, tmp_path: Path, section: str
) -> None:
    design = VAULT.replace("edge = 2", 'edge = 2\nwithin = "5 mm"\nflat = "2 mm"')
    design = (
        design
        if "panels.within" in CONTRADICTIONS[section]
        else design.replace('within = "5 mm"', "")
    )
    (tmp_path / "vault.toml").write_text(design + section)
    assert CONTRADICTIONS[section] in refused("panelize", "vault.toml", "-o", "out")


def test_message_tells_the_line_of_the_key(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(VAULT.replace("edge = 2", "edge = 2\nwithn = 3"))
    line = refused("panelize", "vault.toml", "-o", "out")
    assert line.startswith("pqmesh: vault.toml, line 6: panels.withn is not a known key; did you")


# --- panels out of plane on request ---------------------------------------------------------


def test_flat_mode_brings_the_mesh_closer_to_the_design(pqmesh: Command, tmp_path: Path) -> None:
    text = VAULT.replace("x*y/60", "x*y/60 + x**3/900").replace(
        "edge = 2", 'edge = 1.5\nkind = "planar"\nnetwork = "uv"'
    )
    (tmp_path / "vault.toml").write_text(text + '[tolerance]\ndeviation = "1 m"\n')
    found = {}
    for flat in ("", "2 mm", "8 mm"):
        options = ["--flat", flat] if flat else []
        done = pqmesh("panelize", "vault.toml", *options, "-o", f"out{flat[:1]}")
        assert done.code == 0, done.err
        found[flat] = report_of(tmp_path / f"out{flat[:1]}")
    away = [report["deviation"]["max"] for report in found.values()]
    assert away[0] > away[1] > away[2]
    warp = [report["after"]["planarity_max_length"] for report in found.values()]
    assert warp[0] < 1e-9
    assert 0.0015 < warp[1] <= 0.002
    assert 0.004 < warp[2] <= 0.008


def test_examples_are_listed_written_and_never_overwritten(
    pqmesh: Command, refused: Refused, tmp_path: Path
) -> None:
    listed = pqmesh("example")
    assert listed.code == 0
    names = [line.split()[0] for line in listed.out.splitlines()]
    assert names == ["vault", "roof", "conjugate", "dome", "torus", "rhino"]
    for name in names:
        assert pqmesh("example", name, "-o", name).code == 0
    assert "did you mean 'vault'?" in refused("example", "valut")
    (tmp_path / "vault" / "vault.toml").write_text("mine")
    assert "must not exist yet" in refused("example", "vault", "-o", "vault")


@pytest.mark.parametrize("name", ["vault", "conjugate", "dome", "torus"])
def test_example_runs_within_its_tolerances(pqmesh: Command, tmp_path: Path, name: str) -> None:
    assert pqmesh("example", name).code == 0
    done = pqmesh("panelize", f"{name}.toml", "--no-figures", "-o", "out")
    assert done.code == 0, done.err
    assert norm(read_quad_mesh(tmp_path / "out" / "mesh.obj").face_area_vectors).min() > 0


# --- names with colons ----------------------------------------------------------------------


def test_name_of_a_nested_layer_keeps_its_colons(pqmesh: Command, tmp_path: Path) -> None:
    import rhino3dm

    model = models.Model()
    site = model.file.Layers[model.layer("SITE")]
    below = rhino3dm.Layer()
    below.Name, below.ParentLayerId = "Um riss", site.Id
    model.layers["below"] = model.file.Layers.Add(below)
    corners = [[-8, -5, 0], [8, -5, 0], [8, 5, 0], [-8, 5, 0]]
    model.add(models.closed_polyline(corners), "below", "in:ner").write(tmp_path / "site.3dm")
    (tmp_path / "vault.toml").write_text(VAULT)
    for name in ("SITE::Um riss", "site::um riss", "Um riss", "in:ner"):
        done = pqmesh("panelize", "vault.toml", "--outline", f"site.3dm:{name}", "-o", "out")
        assert done.code == 0, done.err
        asked = report_of(tmp_path / "out")["design"]["outline"]
        assert asked == {"file": "site.3dm", "select": name, "holes": []}


# --- results of several parts ---------------------------------------------------------------


def two_vaults(path: Path, shift: float = 72.0) -> None:
    """Two vaults that do not join, west and east."""
    model = models.Model("Meters")
    for x, name in ((0.0, "west"), (shift, "east")):
        model.add(models.nurbs(models.graph_net() + np.array([x, 0.0, 0.02 * x])), "ROOF", name)
    model.write(path)


def files_in(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def test_files_of_earlier_runs_do_not_stand_beside_those_of_others(
    pqmesh: Command, tmp_path: Path
) -> None:
    two_vaults(tmp_path / "two.3dm")
    models.write_plain(tmp_path / "one.3dm")
    options = ("--edge", "8", "--no-figures", "-o", "out")
    one = ("panelize", "one.3dm", "--select", "ROOF", *options)
    assert pqmesh(*one).code in (0, 3)
    out = tmp_path / "out"
    single = files_in(out)
    assert single == {"mesh.obj", "panels.obj", "report.json"}
    (out / "mine.obj").write_text("v 0 0 0\n")
    (out / "3-mine").mkdir()
    (out / "3-mine" / "mesh.obj").write_text("v 0 0 0\n")
    mine = {"mine.obj", "3-mine/mesh.obj"}
    assert pqmesh("panelize", "two.3dm", *options).code in (0, 3)
    assert files_in(out) - mine == {"report.json"} | {
        f"{part['folder']}/{name}" for part in report_of(out)["parts"] for name in single
    }
    assert pqmesh(*one).code in (0, 3)
    assert files_in(out) == single | mine
    assert not (out / "1-west-face-0").exists()


def test_part_that_cannot_be_panelled_is_named_and_nothing_is_written(
    refused: Refused, tmp_path: Path
) -> None:
    model = models.Model("Meters").add(models.nurbs(models.graph_net()), "ROOF", "vault")
    flat = models.graph_net() * [1, 1, 0] + [100, 0, 0]
    model.add(models.nurbs(flat), "ROOF", "terrace").write(tmp_path / "two.3dm")
    line = refused("panelize", "two.3dm", "--edge", "8", "--no-figures", "-o", "out")
    assert line.startswith("pqmesh: terrace (face 0): Curvature lines need k1 != k2")
    assert not (tmp_path / "out").exists()


def test_small_part_of_a_large_surface_is_panelled(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(VAULT)
    (tmp_path / "bay.csv").write_text("3,3\n3.3,3\n3.3,3.4\n3,3.4\n")
    done = pqmesh("panelize", "vault.toml", "--outline", "bay.csv", "--edge", "0.05", "-o", "out")
    assert done.code == 0, done.err
    report = report_of(tmp_path / "out")
    assert report["panels"]["covered_share"] == pytest.approx(1.0, abs=1e-9)
    assert report["network"]["covered_share"] == pytest.approx(1.0, abs=1e-9)
    assert report["panels"]["count"] > 40


# --- places ---------------------------------------------------------------------------------


def test_place_where_numbers_are_too_coarse_is_refused(refused: Refused, tmp_path: Path) -> None:
    model = models.Model("Meters")
    model.add(models.nurbs(models.graph_net() + np.array([1e12, 5e11, 0])), "ROOF", "far")
    model.write(tmp_path / "far.3dm")
    line = refused("panelize", "far.3dm", "--edge", "8", "-o", "out")
    assert "around (1e+12, 500000000000, 2) they step by 0.000122" in line


def test_continuation_that_is_not_regular_names_its_key(refused: Refused, tmp_path: Path) -> None:
    (tmp_path / "vault.toml").write_text(VAULT.replace("5 - y**2/16", "sqrt(150 - x**2)"))
    line = refused("panelize", "vault.toml", "--extend", "6", "-o", "out")
    assert "surface.extend = 6" in line
    assert "z is nan at x = -13" in line


# --- options win over the file --------------------------------------------------------------


def test_direction_typed_wins_over_curves_of_the_design(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "saddle.toml").write_text(
        '[surface]\ngraph = {z = "x*y/10", x = [-5, 5], y = [-5, 5]}\n[panels]\nedge = 1\n'
        'network = "conjugate"\ncurves = {points = [[[-4, -4], [4, 0]]]}\n'
    )
    done = pqmesh("panelize", "saddle.toml", "--direction-deg", "45", "--no-figures", "-o", "out")
    assert done.code == 0, done.err
    assert report_of(tmp_path / "out")["design"]["panels"]["curves"] == {"direction_deg": 45.0}


def test_pictures_typed_win_over_the_design_and_the_report_says_so(
    pqmesh: Command, tmp_path: Path
) -> None:
    (tmp_path / "vault.toml").write_text(VAULT)
    for option, wanted in (("--figures", True), ("--no-figures", False)):
        assert pqmesh("panelize", "vault.toml", option, "-o", "out").code == 0
        assert report_of(tmp_path / "out")["design"]["output"]["figures"] is wanted
        assert (tmp_path / "out" / "figures").exists() is wanted
