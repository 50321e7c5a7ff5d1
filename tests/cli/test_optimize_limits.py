"""`optimize` and its limits: exact meshes that went too far are told, with figure and place."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapes import crown, football, icosahedron, lantern, zoo

from pqmesh.io.formats import read_mesh, write_mesh
from pqmesh.mesh.exact import grid_mesh, rotational_mesh
from pqmesh.mesh.measure import measures
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import norm

Command = Callable[..., Any]


@pytest.fixture
def turned(tmp_path: Path) -> QuadMesh:
    """A saddle whose lines are far from conjugate: its flat mesh lies far away."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0), indexing="ij")
    mesh = grid_mesh(np.stack([x, y, 0.08 * x * y + 0.01 * x * x], axis=-1))
    write_mesh(mesh, tmp_path / "turned.obj")
    return mesh


def rows_of(path: Path) -> dict[str, dict[str, Any]]:
    return {row["key"]: row for row in json.loads(path.read_text())["tolerance"]}


# --- every class on every topology --------------------------------------------------------------

SHAPES = {name: mesh for name, (mesh, *_) in zoo().items()} | {
    "crown": crown(),
    "football": football(),
    "icosahedron": icosahedron(),
    "lantern": lantern(),
}


@pytest.mark.parametrize("kind", ["planar", "conical", "circular", "conical-circular"])
@pytest.mark.parametrize("name", SHAPES)
def test_every_class_keeps_its_promise_or_names_what_limits_it(
    pqmesh: Command, tmp_path: Path, name: str, kind: str
) -> None:
    exact = SHAPES[name]
    step = np.random.default_rng(0).normal(size=exact.vertices.shape)
    start = exact.with_vertices(exact.vertices + 0.03 * exact.mean_edge_length * step)
    write_mesh(start, tmp_path / "start.obj")
    options = ["--kind", kind, "--report", "o.json"]
    result = pqmesh("optimize", "start.obj", "-o", "o.obj", *options)
    rows = rows_of(tmp_path / "o.json")
    moved = measures(read_mesh(tmp_path / "o.obj"))
    # What the written mesh says, and not the report alone.
    kept = {"planar": moved["planarity_max"] <= 1e-9}
    if "conical" in kind:
        kept["conical"] = (moved["cone_spread_max"] or 0.0) <= 1e-8
        kept["offset"] = (moved["offset_misfit_max"] or 0.0) <= 1e-9
    if "circular" in kind:
        kept["circular"] = np.radians(moved["circularity_max_deg"]) <= 1e-6
    for key, is_kept in kept.items():
        assert (rows[key]["pass"] is not False) == is_kept, key
    missed = [row for row in rows.values() if row["pass"] is False]
    assert result.code == (3 if missed else 0)
    for row in missed:
        noun = next(noun for noun in ("face", "vertex", "edge") if noun in row["worst"])
        assert f"not reached: {row['key']} " in result.err
        assert f"worst is {noun} " in result.err
    # These are exact but for the roughness: no class is out of reach.
    assert all(kept.values()), result.err
    assert moved["nonconvex_faces"] == moved["flipped_faces"] == 0


# --- limits -------------------------------------------------------------------------------------


def area(mesh: Any) -> np.ndarray:
    return norm(mesh.face_area_vectors)


def test_mesh_that_left_the_surface_ends_in_3_with_figure_and_place(
    pqmesh: Command, tmp_path: Path, turned: QuadMesh
) -> None:
    options = ["--kind", "planar", "--report", "out.json"]
    tight = ["--tolerance", "deviation_rms=1e-4", "--tolerance", "area=1e-5"]
    result = pqmesh("optimize", "turned.obj", "-o", "out.obj", *options, *tight)
    assert result.code == 3
    report, moved = json.loads((tmp_path / "out.json").read_text()), read_mesh("out.obj")
    rows = {row["key"]: row for row in report["tolerance"]}
    assert rows["planar"]["pass"]
    # The report speaks of the mesh that was written.
    assert report["before"]["area_total"] == pytest.approx(area(turned).sum(), rel=1e-12)
    assert report["after"]["area_total"] == pytest.approx(area(moved).sum(), rel=1e-12)
    change = abs(area(moved).sum() / area(turned).sum() - 1.0)
    assert (rows["area"]["asked"], rows["area"]["pass"]) == (1e-5, False)
    assert rows["area"]["reached"] == pytest.approx(change, rel=1e-9)
    assert rows["deviation_rms"]["asked"] == 1e-4
    assert rows["deviation_rms"]["reached"] == report["deviation"]["rms"] > 1e-4
    vertex = rows["deviation_rms"]["worst"]["vertex"]
    assert rows["deviation_rms"]["worst"]["value"] == report["deviation"]["max"]
    assert rows["deviation_rms"]["worst"]["at"] == pytest.approx(moved.vertices[vertex].tolist())
    gaps = np.abs(area(moved) - area(turned))
    assert rows["area"]["worst"]["face"] == int(gaps.argmax())
    place = ", ".join(f"{x:.6g}" for x in moved.vertices[vertex])
    line = next(line for line in result.err.splitlines() if "not reached: deviation_rms" in line)
    assert f"worst is vertex {vertex} at ({place})" in line
    assert "% of an edge" in line
    assert "not reached: area" in result.err
    assert "Allow that (--tolerance KEY=VALUE)" in result.err


def test_limits_are_a_tenth_of_an_edge_and_three_percent_unless_asked_otherwise(
    pqmesh: Command, tmp_path: Path, turned: QuadMesh
) -> None:
    edge = turned.mean_edge_length
    for kind, share in (("planar", 0.15), ("circular", 0.10)):
        pqmesh("optimize", "turned.obj", "-o", "o.obj", "--kind", kind, "--report", "o.json")
        rows = rows_of(tmp_path / "o.json")
        assert rows["deviation_rms"]["asked"] == pytest.approx(share * edge, rel=1e-12)
        assert rows["area"]["asked"] == 0.03
        assert "deviation" not in rows
    wide = ["--within", "2", "--kind", "planar", "--tolerance", "1e-7", "--report", "o.json"]
    pqmesh("optimize", "turned.obj", "-o", "o.obj", *wide)
    rows = rows_of(tmp_path / "o.json")
    assert (rows["deviation"]["asked"], rows["deviation_rms"]["asked"]) == (2.0, 2.0)
    assert rows["planar"]["asked"] == 1e-7


def test_node_axes_that_cannot_lie_flat_are_told(pqmesh: Command, tmp_path: Path) -> None:
    # A vase is conical, and its beams are flat; a limit below rounding names the worst of them.
    profile = [[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [2.3, 1.8]]
    write_mesh(rotational_mesh(profile, 0.3 * np.arange(6)), tmp_path / "vase.obj")
    options = ["-o", "o.obj", "--report", "o.json"]
    assert pqmesh("optimize", "vase.obj", *options).code == 0
    rows = rows_of(tmp_path / "o.json")
    assert rows["twist"]["reached"] < 1e-9
    assert rows["offset"]["reached"] < 1e-12
    result = pqmesh("optimize", "vase.obj", *options, "--tolerance", "twist=1e-30")
    assert result.code == 3
    assert "not reached: twist" in result.err
    assert "worst is edge " in result.err


@pytest.mark.parametrize("name", ["six.off", "inspired_mesh_quads_Conjugate.off"])
def test_conical_real_mesh_keeps_its_promise_or_names_the_limit_and_the_place(
    pqmesh: Command, tmp_path: Path, data_folder: Path, name: str
) -> None:
    result = pqmesh("optimize", data_folder / name, "-o", "o.obj", "--report", "o.json")
    report = json.loads((tmp_path / "o.json").read_text())
    after, edge = report["after"], report["before"]["edge_mean"]
    kept = {
        "conical": after["cone_spread_max"] <= 1e-8,
        "offset": after["offset_misfit_max"] <= 1e-9,
        "twist": after["twist_max_deg"] <= 1e-5,
        "deviation_rms": report["deviation"]["rms"] <= 0.10 * edge,
        "area": abs(after["area_total"] / report["before"]["area_total"] - 1.0) <= 0.03,
    }
    assert result.code == (0 if all(kept.values()) else 3)
    for key, is_kept in kept.items():
        lines = [line for line in result.err.splitlines() if f"not reached: {key} " in line]
        assert len(lines) == (not is_kept)
        assert all("; worst is " in line and " at (" in line for line in lines)
