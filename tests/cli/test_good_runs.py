"""Good designs: the files, what the report says of them, and that it says the same again."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.measure import measures, planarity_deviation
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import dot, norm

Command = Callable[..., Any]

MEASURES = (
    "planarity_max planarity_mean planarity_max_length cone_spread_max conicality_max_deg "
    "conicality_mean_deg circularity_max_deg offset_misfit_max twist_max_deg min_corner_deg "
    "max_corner_deg nonconvex_faces flipped_faces edge_min edge_mean edge_max area_total"
)
# The key tree of the contract; further keys are allowed.
REPORT = {
    "": "schema version units kind input design seed orientation mesh before after deviation "
    "outlook worst layers support panels tolerance solver timing warnings",
    "mesh": "vertices faces edges boundary_loops irregular_vertices euler_characteristic",
    "before": MEASURES,
    "after": MEASURES,
    "deviation": "max rms moved_max",
    "panels": "count trimmed slivers area_total",
    "solver": "converged iterations reason",
    "timing": "read network optimize offset fabricate write total",
}
LAYER = (
    "distance kind distance_error_max parallel_error_max parallel_error_boundary_max "
    "planarity_max first_reversed_edge_distance"
)
SUPPORT = "quads twist_max_deg planarity_max_length"
TOLERANCES = ["flat", "offset", "twist", "deviation", "conical", "cover", "deviation_rms", "area"]

NET = [[[i, j, 0.2 * i * j + 0.1 * i * i] for j in range(4)] for i in range(4)]
WEIGHTS = [[1.0, 1.0, 1.0, 1.0], [1.0, 1.2, 1.2, 1.0], [1.0, 1.2, 1.2, 1.0], [1.0] * 4]
KNOTS = [[0.0] * 4 + [2.0] * 4, [1.0] * 4 + [3.0] * 4]
GRAPH = 'graph = {z = "0.2*x*y + 0.05*x**2", x = [0, 4], y = [0, 3]}'
SURFACES = {
    "torus": ('shape = {kind = "torus"}', 0.9),
    "formula": (
        'formula = {x = "(R + v)*cos(u)", y = "(R + v)*sin(u)", z = "h*cosh(v)", '
        "u = [0.0, 2.0], v = [0.2, 1.0], constants = {R = 2.0, h = 1.5}}",
        0.5,
    ),
    "graph": (GRAPH, 0.6),
    "net in file": ('net = {file = "net.json"}', 0.6),
    "bare file": ('file = "net.json"', 0.6),
    "net with weights and knots": (
        f"net = {{degree = [3, 3], points = {NET}, weights = {WEIGHTS}, knots = {KNOTS}}}",
        0.6,
    ),
    "cyclide": ('shape = {kind = "cyclide", u = [0.3, 2.0], v = [0.2, 2.5]}', 0.6),
    "ellipsoid": (
        'shape = {kind = "ellipsoid", lines = "curvature", u = [0.6, 2.4], v = [0.6, 2.4]}',
        0.4,
    ),
}


def toml(surface: str = GRAPH, edge: object = 0.6, rest: str = "") -> str:
    return f"[surface]\n{surface}\n[panels]\nedge = {edge}\n{rest}\n"


@pytest.fixture
def built(pqmesh: Command, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Runs a design and gives its report; exit code 0 unless said otherwise."""

    def run(text: str, *options: str, code: int = 0, to: str = "out") -> dict[str, Any]:
        (tmp_path / "net.json").write_text(json.dumps({"degree": [3, 3], "points": NET}))
        (tmp_path / "roof.toml").write_text(text)
        result = pqmesh("panelize", "roof.toml", "-o", to, "--no-figures", *options)
        assert result.code == code, result.err
        assert result.out == ""
        report: dict[str, Any] = json.loads((tmp_path / to / "report.json").read_text())
        assert_sound(report, tmp_path / to)
        return report

    return run


def about(value: float | None) -> Any:
    """The same value, or null where it does not exist."""
    return None if value is None else pytest.approx(value, rel=1e-9, abs=1e-12)


def assert_sound(report: dict[str, Any], folder: Path) -> None:
    """Keys of the contract, and figures that the files bear out."""
    for name, keys in REPORT.items():
        part = report[name] if name else report
        assert set(keys.split()) <= set(part), name
    mesh = read_quad_mesh(folder / "mesh.obj")
    for key, value in measures(mesh).items():
        assert report["after"][key] == about(value), key
    counts = report["mesh"]
    assert (counts["vertices"], counts["faces"]) == (len(mesh.vertices), len(mesh.faces))
    assert counts["edges"] == len(mesh.edges)
    assert counts["vertices"] - counts["edges"] + counts["faces"] == counts["euler_characteristic"]
    assert report["panels"]["count"] > 0
    assert report["deviation"]["rms"] <= report["deviation"]["max"]
    assert len(report["layers"]) == len(report["design"]["layers"]["distances"])
    for number, layer in enumerate(report["layers"], start=1):
        assert set(LAYER.split()) <= set(layer)
        assert_layer(layer, mesh, read_quad_mesh(folder / f"layer-{number}.obj"))
    assert (report["support"] is None) == (not report["layers"])
    if report["support"]:
        assert set(SUPPORT.split()) <= set(report["support"])
        webs = read_quad_mesh(folder / "support.obj")
        assert report["support"]["quads"] == len(webs.faces) == len(mesh.edges)
        flat = float(planarity_deviation(webs).max())
        assert report["support"]["planarity_max_length"] == pytest.approx(flat, abs=1e-12)
    assert [row["key"] for row in report["tolerance"]] == TOLERANCES
    for row in report["tolerance"]:
        assert row["pass"] is (None if row["reached"] is None else row["reached"] <= row["asked"])


def assert_layer(layer: dict[str, Any], mesh: QuadMesh, found: QuadMesh) -> None:
    """A layer as its file has it: same faces, its planarity, the distance of its faces."""
    assert (found.faces == mesh.faces).all()
    assert layer["planarity_max"] == pytest.approx(measures(found)["planarity_max"], abs=1e-12)
    if layer["kind"] == "face":
        heights = dot(found.corners.mean(axis=1) - mesh.corners.mean(axis=1), mesh.face_normals)
        error = np.abs(heights - layer["distance"]).max()
        assert error <= layer["distance_error_max"] + 1e-4 * abs(layer["distance"])


def masked(folder: Path) -> dict[str, bytes]:
    """All files of a result, with the timing taken out of the report."""
    files = {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    pattern = rb'"timing": \{[^}]*\}'
    assert re.search(pattern, files["report.json"])
    files["report.json"] = re.sub(pattern, b"", files["report.json"])
    return files


# --- the report -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", SURFACES)
def test_report_tells_what_the_files_hold(built: Command, name: str) -> None:
    surface, edge = SURFACES[name]
    report = built(toml(surface, edge), "--layers", "-0.05,0.1")
    assert report["solver"]["converged"]
    assert report["units"] == "m"
    assert report["input"] == "roof.toml"
    assert report["after"]["planarity_max"] < 1e-9
    assert [layer["distance"] for layer in report["layers"]] == [-0.05, 0.1]


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_kinds_reach_what_they_are_named_for(built: Command, kind: str) -> None:
    rest = f'kind = "{kind}"\n[layers]\ndistances = [0.1]\n[tolerance]\ntwist = "5 deg"'
    report = built(toml(rest=rest))
    assert report["kind"] == kind
    assert report["after"]["planarity_max"] < 1e-9
    judged = {row["key"]: row["pass"] for row in report["tolerance"]}
    assert (judged["conical"] is None) == (kind != "conical")
    # No constant distance exists for a mesh that is only planar.
    assert (judged["offset"] is None) == (kind == "planar")
    if kind == "circular":
        assert report["after"]["circularity_max_deg"] < 1e-6


def test_two_edges_give_panels_of_two_sizes(built: Command) -> None:
    even = built(toml(edge=0.5))
    oblong = built(toml(edge=0.5), "--edge", "0.5,0.3")
    assert oblong["design"]["panels"]["edge"] == [0.5, 0.3]
    assert oblong["mesh"]["faces"] > 1.3 * even["mesh"]["faces"]


def test_design_is_repeated_with_the_options_that_won(built: Command) -> None:
    text = toml(rest='[layers]\ndistances = ["80 mm"]\n[tolerance]\nflat = "1 mm"\n[run]\nseed = 3')
    options = ["--layers", "120 mm,-0.05", "--seed", "7", "--tolerance", "flat=2mm"]
    report = built(text, *options, "--boundary", "glide", "--within", "1 m")
    design = report["design"]
    assert design["surface"]["graph"]["z"] == "0.2*x*y + 0.05*x**2"
    assert design["panels"]["edge"] == 0.6
    assert design["panels"]["within"] == "1 m"
    assert design["boundary"]["mode"] == "glide"
    assert design["layers"]["distances"] == ["120 mm", -0.05]
    assert design["tolerance"]["flat"] == "2mm"
    assert report["seed"] == design["run"]["seed"] == 7
    assert [layer["distance"] for layer in report["layers"]] == [0.12, -0.05]
    asked = {row["key"]: row["asked"] for row in report["tolerance"]}
    assert asked["flat"] == pytest.approx(0.002)
    assert asked["deviation"] == 1.0


def test_quantities_that_do_not_exist_are_null(built: Command) -> None:
    surface = 'graph = {z = "0.3*x*y", x = [0, 3.0], y = [0, 1.5]}'
    report = built(toml(surface, 0.6))
    assert report["layers"] == []
    assert report["support"] is None
    judged = {row["key"]: row["reached"] for row in report["tolerance"]}
    assert judged["offset"] is judged["twist"] is None
    # A single row of panels has no interior vertex.
    assert report["mesh"]["vertices"] == 2 * (report["mesh"]["faces"] + 1)
    assert report["after"]["cone_spread_max"] is None
    assert report["after"]["conicality_max_deg"] is None
    assert judged["conical"] is None


def test_flip_turns_normals_and_layers_over(built: Command, tmp_path: Path) -> None:
    up = built(toml(), "--layers", "0.2", to="up")
    down = built(toml(), "--layers", "0.2", "--flip", to="down")
    assert "upwards" in up["orientation"]
    assert "downwards" in down["orientation"]
    heights = []
    for name, sign in (("up", 1), ("down", -1)):
        mesh = read_quad_mesh(tmp_path / name / "mesh.obj")
        layer = read_quad_mesh(tmp_path / name / "layer-1.obj")
        assert (sign * mesh.face_area_vectors[:, 2]).min() > 0
        heights.append(layer.vertices[:, 2].mean() - mesh.vertices[:, 2].mean())
    assert heights[0] > 0.1
    assert heights[1] < -0.1


def test_fixed_boundary_stays_on_the_surface(built: Command, tmp_path: Path) -> None:
    # On lines of curvature of a torus the start is conical but for the error of tracing; a fixed
    # rim keeps a little of that.
    surface = 'shape = {kind = "torus", u = [0.0, 2.0], v = [0.5, 2.5]}'
    report = built(toml(surface, 0.6), "--boundary", "fixed", "--tolerance", "conical=1e-5")
    assert report["design"]["boundary"]["mode"] == "fixed"
    mesh = read_quad_mesh(tmp_path / "out" / "mesh.obj")
    x, y, z = mesh.vertices[mesh.topology.is_boundary_vertex].T
    assert np.abs(np.hypot(np.hypot(x, y) - 3.0, z) - 1.0).max() < 1e-9


def test_quiet_says_nothing_and_plain_runs_name_their_stages(
    pqmesh: Command, tmp_path: Path
) -> None:
    (tmp_path / "roof.toml").write_text(toml('shape = {kind = "torus"}', 0.9))
    loud = pqmesh("panelize", "roof.toml", "--no-figures")
    assert loud.code == 0
    for stage in ("network", "optimize", "offset", "write"):
        assert f"{stage} ...\n" in loud.err
    assert "140 panels" in loud.err
    quiet = pqmesh("--quiet", "panelize", "roof.toml", "--no-figures")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")


# --- tolerances -----------------------------------------------------------------------------


def test_tolerance_out_of_reach_ends_in_code_3_with_every_file_there(
    pqmesh: Command, built: Command, tmp_path: Path
) -> None:
    options = ["--layers", "0.1", "--tolerance", "deviation=1e-12"]
    report = built(toml(), *options, code=3)
    failed = [row["key"] for row in report["tolerance"] if row["pass"] is False]
    assert failed == ["deviation"]
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"mesh.obj", "layer-1.obj", "support.obj", "panels.obj", "report.json"} <= names
    again = pqmesh("panelize", "roof.toml", "-o", "out", "--no-figures", *options)
    assert again.err.splitlines()[-1].startswith("not reached: deviation ")


def test_layer_beyond_the_focal_set_ends_in_code_3(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "roof.toml").write_text(toml(rest='kind = "conical"\n[layers]\ndistances = [-40]'))
    result = pqmesh("panelize", "roof.toml", "-o", "out")
    assert result.code == 3
    assert "note: layer -40 lies beyond the focal set: its first edge reverses at -" in result.err
    assert "not reached: offset" in result.err
    layer = json.loads((tmp_path / "out" / "report.json").read_text())["layers"][0]
    assert -40 < layer["first_reversed_edge_distance"] < 0


def test_within_is_judged_when_it_was_asked_for(built: Command) -> None:
    report = built(toml(), "--within", "1e-13", code=3)
    failed = {row["key"]: row["asked"] for row in report["tolerance"] if row["pass"] is False}
    assert failed == {"deviation": 1e-13}


# --- same input, same bytes -----------------------------------------------------------------


def test_same_command_gives_the_same_bytes(built: Command, tmp_path: Path) -> None:
    for folder in ("one", "two"):
        built(toml(), "--layers", "0.1", "--seed", "5", to=folder)
    assert masked(tmp_path / "one") == masked(tmp_path / "two")


def test_second_run_replaces_the_first_and_leaves_nothing_of_it(
    built: Command, tmp_path: Path
) -> None:
    built(toml(), "--layers", "0.1,0.2")
    (tmp_path / "out" / "notes.txt").write_text("mine")
    built(toml(), "--layers", "0.1")
    built(toml(), "--layers", "0.1", to="fresh")
    kept = masked(tmp_path / "out")
    assert kept.pop("notes.txt") == b"mine"
    assert kept == masked(tmp_path / "fresh")


def test_pictures_are_written_unless_declined(pqmesh: Command, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    # As many faces as vertices: a picture must be told which of them its values are of.
    (tmp_path / "roof.toml").write_text(toml('shape = {kind = "torus"}', 0.9))
    assert pqmesh("panelize", "roof.toml", "-o", "out", "--layers", "0.1").code == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["warnings"] == []
    pictures = sorted(path.name for path in (tmp_path / "out" / "figures").iterdir())
    assert "flatness.png" in pictures
    assert pqmesh("panelize", "roof.toml", "-o", "out", "--no-figures").code == 0
    assert not (tmp_path / "out" / "figures").exists()


# --- units ----------------------------------------------------------------------------------

LENGTHS = {"planarity_max_length", "edge_min", "edge_mean", "edge_max"}


def test_same_roof_in_millimetres_gives_the_same_report(built: Command) -> None:
    small = 'formula = {x="u", y="v", z="0.2*u*v + 0.05*u**2", u=[0, 4], v=[0, 3]}\nunits = "m"'
    large = (
        'formula = {x="k*u", y="k*v", z="k*(0.2*u*v + 0.05*u**2)", u=[0, 4], v=[0, 3], '
        'constants={k=1000}}\nunits = "mm"'
    )
    layers = '[layers]\ndistances = ["10 cm"]'
    metres = built(toml(small, '"60 cm"', layers), to="m")
    millimetres = built(toml(large, '"60 cm"', layers), to="mm")
    assert millimetres["units"] == "mm"
    assert millimetres["mesh"] == metres["mesh"]
    for part in ("before", "after"):
        for key, value in metres[part].items():
            factor = 1000.0 if key in LENGTHS else 1e6 if key == "area_total" else 1.0
            # Residuals at rounding level, and angles of the arcus cosine, are noise.
            noise = 1e-5 if key.endswith("deg") else 1e-9 * factor
            expected = pytest.approx(value * factor, rel=1e-6, abs=noise)
            assert millimetres[part][key] == expected, (part, key)
    for key, value in metres["deviation"].items():
        assert millimetres["deviation"][key] == pytest.approx(1000 * value, rel=1e-5, abs=1e-6)
    assert millimetres["layers"][0]["distance"] == pytest.approx(100.0)
    area = metres["panels"]["area_total"] * 1e6
    assert millimetres["panels"]["area_total"] == pytest.approx(area, rel=1e-9)
    for row, other in zip(metres["tolerance"], millimetres["tolerance"], strict=True):
        factor = 1000.0 if row["key"] in ("flat", "offset", "deviation", "deviation_rms") else 1.0
        assert other["asked"] == pytest.approx(factor * row["asked"])
        assert other["pass"] == row["pass"]


@pytest.mark.parametrize("size", [1e-9, 1e9])
def test_tiny_and_huge_model_units_work_alike(built: Command, size: float) -> None:
    surface = f'shape = {{kind = "torus", R = {3 * size!r}, r = {size!r}}}'
    report = built(toml(surface, 0.9 * size), "--layers", str(0.1 * size))
    assert report["mesh"]["faces"] == 140
    assert report["after"]["planarity_max"] < 1e-12


# --- umbilics -------------------------------------------------------------------------------


def test_warnings_name_place_and_kind_of_umbilics(built: Command) -> None:
    # An elliptic paraboloid has two umbilics; the edge is long for speed.
    surface = 'graph = {z = "x**2/2 + y**2", x = [-1, 1], y = [-1, 1]}'
    report = built(toml(surface, 0.35), "--tolerance", "twist=5", "--tolerance", "deviation=1")
    found = report["network"]["umbilics"]
    assert len(found) == 2
    lines = [text for text in report["warnings"] if text.startswith("umbilic (lemon")]
    assert len(lines) == 2
    for umbilic, text in zip(found, lines, strict=True):
        place = ", ".join(f"{round(x, 3) + 0.0:.12g}" for x in umbilic["point"])
        assert f"at ({place})" in text
        x, y, _ = umbilic["point"]
        # k1 = k2 where x = 0 and 1 + (2 y)^2 = 2.
        assert (x, abs(y)) == pytest.approx((0.0, 0.5), abs=1e-6)


def test_area_total_is_the_sum_of_panel_areas(built: Command, tmp_path: Path) -> None:
    report = built(toml())
    mesh = read_quad_mesh(tmp_path / "out" / "mesh.obj")
    area = float(norm(mesh.face_area_vectors).sum())
    assert report["panels"]["area_total"] == pytest.approx(area, rel=1e-9)


# --- hard surfaces --------------------------------------------------------------------------

HARD = [
    ("edge longer than a ring", 'shape = {kind = "torus"}', 3.0),
    ("umbilic in the middle of rings", 'graph = {z = "x**2 + y**2", x=[-1,1], y=[-1,1]}', 0.35),
    pytest.param("four umbilics", 'shape = {kind = "ellipsoid"}', 0.5, marks=pytest.mark.slow),
    pytest.param(
        "waves shorter than the edge",
        'graph = {z = "x*y*exp(-9*x*x)*sin(40*y)", x = [-1, 1], y = [-1, 1]}',
        0.3,
    ),
    pytest.param(
        "folded net",
        f"net = {{points = {NET}, periodic = [true, false]}}",
        0.6,
    ),
]


@pytest.mark.parametrize(("name", "surface", "edge"), HARD)
def test_hard_surface_ends_in_time_with_files_or_one_line(
    pqmesh: Command, tmp_path: Path, name: str, surface: str, edge: float
) -> None:
    (tmp_path / "roof.toml").write_text(toml(surface, edge))
    result = pqmesh("panelize", "roof.toml", "-o", "out", "--no-figures")
    assert result.code in (0, 2, 3), name
    if result.code == 2:
        assert result.line
    assert (tmp_path / "out" / "report.json").exists() == (result.code != 2)
