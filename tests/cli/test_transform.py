"""`offset` and `transform`: what they write and print, how they agree, and what they refuse."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapes import cyclide, inverted, sampled

from pqmesh.io.formats import read_quad_mesh, write_mesh
from pqmesh.mesh.exact import grid_mesh, rotational_mesh
from pqmesh.mesh.measure import circle_deviation, fitted_cones, planarity
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.solids import cube
from pqmesh.offset.offsets import face_offset, vertex_distance
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.moebius import MoebiusTransform

Command = Callable[..., Any]
Refused = Callable[..., str]

PROFILE = [[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9]]
DESIGN = """
[surface]
graph = {z = "3 - y**2/16 + x**2/50 + x*y/60", x = [-6, 6], y = [-4, 4]}
[panels]
edge = 1.6
[layers]
distances = [0.15, -0.2]
[output]
figures = false
"""


def conical() -> QuadMesh:
    return rotational_mesh(PROFILE, 0.3 * np.arange(6))


def skew() -> QuadMesh:
    """Circular, planar, and not conical: uneven steps."""
    return rotational_mesh(PROFILE, np.array([0.0, 0.3, 0.7, 1.0]))


def wavy() -> QuadMesh:
    """Neither planar nor circular nor conical."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    return grid_mesh(np.stack([x, y, 0.1 * x * x + 0.08 * y * y + 0.04 * x * y], axis=-1))


@pytest.fixture
def roof(tmp_path: Path) -> Path:
    path = tmp_path / "roof.obj"
    write_mesh(conical(), path)
    return path


def report_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "out.json").read_text())
    return found


# --- good runs ------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [0.1, -0.2])
def test_offset_of_faces_moves_every_face_along_its_normal(
    pqmesh: Command, tmp_path: Path, roof: Path, distance: float
) -> None:
    result = pqmesh("offset", roof, "--distance", distance, "-o", "out.obj", "--report", "out.json")
    assert result.code == 0, result.err
    start, moved = read_quad_mesh(roof), read_quad_mesh(tmp_path / "out.obj")
    step = face_planes(moved)[:, 3] - face_planes(start)[:, 3]
    np.testing.assert_allclose(step, distance, atol=1e-12)
    report = report_of(tmp_path)
    assert (report["kind"], report["distance"], report["input"]) == ("face", distance, "roof.obj")
    assert report["distance_error_max"] < 1e-12
    assert report["parallel_error_max"] < 1e-12
    assert [row["pass"] for row in report["tolerance"]] == [True]
    assert report["warnings"] == []


def test_offset_of_vertices_moves_every_vertex_by_the_distance(
    pqmesh: Command, tmp_path: Path
) -> None:
    write_mesh(skew(), tmp_path / "skew.obj")
    result = pqmesh("offset", "skew.obj", "--kind", "vertex", "--distance", 0.1, "-o", "out.off")
    assert result.code == 0, result.err
    moved = read_quad_mesh(tmp_path / "out.off")
    np.testing.assert_allclose(vertex_distance(skew(), moved), 0.1, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "kind", "code"),
    [("skew", "vertex", 0), ("skew", "face", 3), ("wavy", "vertex", 3), ("wavy", "face", 3)],
)
def test_offset_that_is_not_exact_is_code_3_with_the_file_there(
    pqmesh: Command, tmp_path: Path, name: str, kind: str, code: int
) -> None:
    write_mesh({"skew": skew, "wavy": wavy}[name](), tmp_path / "in.obj")
    options = ["--kind", kind, "--distance", "0.1", "--report", "out.json"]
    result = pqmesh("offset", "in.obj", "-o", "out.obj", *options)
    assert result.code == code
    read_quad_mesh(tmp_path / "out.obj")
    row = report_of(tmp_path)["tolerance"][0]
    assert row["key"] == "offset"
    assert row["pass"] is (code == 0)
    assert (row["reached"] > 1e-6) == (code == 3)
    assert ("not reached: offset" in result.err) == (code == 3)


def test_offset_beyond_the_focal_set_is_refused_with_its_edge_and_range(
    pqmesh: Command, refused: Refused, roof: Path
) -> None:
    line = refused("offset", roof, "--distance", "-1.5", "-o", "out.obj")
    found = re.search(r"edge \d+-\d+ becomes -\S+ times as long", line)
    assert found, line
    low = float(line.split("between ")[1].split(" and ")[0])
    assert -1.5 < low < 0
    assert pqmesh("offset", roof, "--distance", str(0.999 * low), "-o", "out.obj").code == 0


@pytest.mark.parametrize("options", [("--boost", "0.2,-0.3,1,0.15"), ("--offset", "0.1")])
def test_transform_writes_the_laguerre_image(
    pqmesh: Command, tmp_path: Path, roof: Path, options: tuple[str, str]
) -> None:
    result = pqmesh("transform", roof, *options, "-o", "out.ply", "--report", "out.json")
    assert result.code == 0, result.err
    if options[0] == "--boost":
        wanted = LaguerreTransform.boost([0.2, -0.3, 1], 0.15)
    else:
        wanted = LaguerreTransform.offset(0.1)
    image = read_quad_mesh(tmp_path / "out.ply")
    expected = wanted.of_mesh(read_quad_mesh(roof)).mesh
    np.testing.assert_allclose(image.vertices, expected.vertices, atol=0)
    assert planarity(image).max() < 1e-12
    assert fitted_cones(image).relative_spread.max() < 1e-11
    report = report_of(tmp_path)
    np.testing.assert_allclose(report["transform"]["matrix"], wanted.matrix, atol=0)
    assert [row["key"] for row in report["tolerance"]] == ["planar", "conical"]
    assert report["orientation"] == 1


def test_boost_about_a_center_is_that_of_the_file_of_it(
    pqmesh: Command, tmp_path: Path, roof: Path
) -> None:
    transform = LaguerreTransform.boost([1, 0, 0], 0.3, [2, 0.5, 1])
    (tmp_path / "boost.json").write_text(transform.to_json())
    code = pqmesh("transform", roof, "--boost", "1,0,0,0.3", "--center", "2,0.5,1", "-o", "a.obj")
    assert code.code == 0
    assert pqmesh("transform", roof, "--laguerre", "boost.json", "-o", "b.obj").code == 0
    assert (tmp_path / "a.obj").read_bytes() == (tmp_path / "b.obj").read_bytes()


def test_reversing_file_turns_the_faces(pqmesh: Command, tmp_path: Path, roof: Path) -> None:
    turn = LaguerreTransform(np.diag([1.0, 1.0, 1.0, -1.0]))
    (tmp_path / "turn.json").write_text(turn.to_json())
    options = ["--laguerre", "turn.json", "-o", "out.obj", "--report", "out.json"]
    assert pqmesh("transform", roof, *options).code == 0
    start, image = read_quad_mesh(roof), read_quad_mesh(tmp_path / "out.obj")
    np.testing.assert_allclose(image.face_normals, -start.face_normals, atol=1e-12)
    assert report_of(tmp_path)["orientation"] == -1


def test_inversion_and_its_file_write_the_circular_image(pqmesh: Command, tmp_path: Path) -> None:
    u, v = np.array([-0.7, -0.3, 0.1, 0.55]), np.array([-0.9, -0.5, 0.0, 0.3])
    mesh = grid_mesh(sampled(cyclide, u, v)[0])
    write_mesh(mesh, tmp_path / "in.obj")
    inversion = '{"inversions": [{"center": [0.4, 0.3, -2.5], "radius": 1.7}]}'
    (tmp_path / "list.json").write_text(inversion)
    matrix = MoebiusTransform.inversion([0.4, 0.3, -2.5], 1.7).to_json()
    (tmp_path / "matrix.json").write_text(matrix)
    ways = [
        ["--invert", "0.4,0.3,-2.5,1.7"],
        ["--moebius", "list.json"],
        ["--moebius", "matrix.json"],
    ]
    for way in ways:
        result = pqmesh("transform", "in.obj", *way, "-o", "out.obj", "--report", "out.json")
        assert result.code == 0, result.err
        image = read_quad_mesh(tmp_path / "out.obj")
        wanted = inverted(mesh.vertices, np.array([0.4, 0.3, -2.5]), 1.7)
        np.testing.assert_allclose(image.vertices, wanted, atol=1e-11)
        assert circle_deviation(image).max() < 1e-11
        assert [row["key"] for row in report_of(tmp_path)["tolerance"]] == ["planar", "circular"]


@pytest.mark.parametrize(
    ("options", "missed", "note"),
    [
        (["--boost", "0,0,1,0.2"], "conical", "conical only to"),
        (["--invert", "1,1,-5,3"], "circular", "circular only to"),
    ],
)
def test_image_of_another_mesh_is_code_3_with_the_reason(
    pqmesh: Command, tmp_path: Path, options: list[str], missed: str, note: str
) -> None:
    write_mesh(wavy(), tmp_path / "in.obj")
    result = pqmesh("transform", "in.obj", *options, "-o", "out.obj", "--report", "out.json")
    assert result.code == 3
    assert f"not reached: {missed}" in result.err
    assert f"note: the mesh is {note}" in result.err
    read_quad_mesh(tmp_path / "out.obj")
    assert report_of(tmp_path)["tolerance"][1]["pass"] is False


def test_offset_transform_and_layers_agree(pqmesh: Command, tmp_path: Path) -> None:
    (tmp_path / "roof.toml").write_text(DESIGN)
    assert pqmesh("panelize", "roof.toml", "-o", "out").code == 0
    mesh = read_quad_mesh(tmp_path / "out" / "mesh.obj")
    for number, distance in ((1, "0.15"), (2, "-0.2")):
        layer = read_quad_mesh(tmp_path / "out" / f"layer-{number}.obj")
        assert pqmesh("offset", "out/mesh.obj", "--distance", distance, "-o", "a.obj").code == 0
        options = ["--offset", distance, "-o", "b.obj"]
        assert pqmesh("transform", "out/mesh.obj", *options).code == 0
        for name in ("a.obj", "b.obj"):
            other = read_quad_mesh(tmp_path / name)
            np.testing.assert_allclose(other.vertices, layer.vertices, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            face_planes(layer)[:, 3] - face_planes(mesh)[:, 3], float(distance), atol=1e-9
        )
        np.testing.assert_allclose(
            face_offset(mesh, float(distance)).vertices, layer.vertices, rtol=0, atol=1e-12
        )


def test_same_input_gives_the_same_bytes(pqmesh: Command, tmp_path: Path, roof: Path) -> None:
    for name in ("one", "two"):
        options = ["-o", f"{name}.obj", "--report", f"{name}.json"]
        pqmesh("transform", roof, "--boost", "1,2,3,0.1", *options)
    assert (tmp_path / "one.obj").read_bytes() == (tmp_path / "two.obj").read_bytes()
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


# --- edge offsets ---------------------------------------------------------------------------


def test_edge_offset_is_measured_at_the_edges(pqmesh: Command, tmp_path: Path) -> None:
    options = ["--kind", "edge", "--distance", "0.1", "-o", "out.obj", "--report", "out.json"]
    write_mesh(cube(), tmp_path / "box.obj")
    assert pqmesh("offset", "box.obj", *options).code == 0
    assert report_of(tmp_path)["distance_error_max"] < 1e-15
    # Edges of a cube lie at the half diagonal of a face, so each vertex moves along its diagonal.
    moved = read_quad_mesh(tmp_path / "out.obj").vertices
    assert moved == pytest.approx(cube().vertices * (1 + 0.1 / 2**0.5), abs=1e-15)


def test_edge_offset_of_a_mesh_without_one_is_the_nearest_and_code_3(
    pqmesh: Command, tmp_path: Path, roof: Path
) -> None:
    options = ["--kind", "edge", "--distance", "0.1", "-o", "out.obj", "--report", "out.json"]
    result = pqmesh("offset", roof, *options)
    assert result.code == 3
    assert "not reached: offset" in result.err
    report = report_of(tmp_path)
    assert 1e-7 < report["distance_error_max"] < 0.01
    # Edges that are not parallel would bend the faces.
    assert report["parallel_error_max"] < 1e-9


# --- refusals -------------------------------------------------------------------------------

OFFSETS = {
    (): "'--distance'",
    ("--distance", "0"): "must be a number other than 0; found 0",
    ("--distance", "nan"): "must be a number other than 0; found nan",
    ("--distance", "inf"): "must be a number other than 0; found inf",
    ("--distance", "x"): "'--distance'",
    ("--distance", "1", "--kind", "corner"): "'corner' is not one of",
    ("--distance", "1", "--report", "r.txt"): "must be one of .json; found '.txt'",
}
TRANSFORMS = {
    (): "of --offset, --boost, --laguerre, --invert, --moebius must be given; found none",
    ("--offset", "1", "--boost", "0,0,1,1"): "found --offset and --boost",
    ("--offset", "nan"): "--offset must be DISTANCE, 1 finite numbers; found 'nan'",
    ("--offset", "x"): "'--offset'",
    ("--boost", "0,0,1"): "--boost must be X,Y,Z,RAPIDITY, 4 finite numbers; found '0,0,1'",
    ("--boost", "0,0,1,1m"): "--boost must be X,Y,Z,RAPIDITY",
    ("--boost", "0,0,1,inf"): "--boost must be X,Y,Z,RAPIDITY",
    ("--boost", "0,0,0,1"): "direction of a Laguerre transformation must not be zero",
    ("--boost", "0,0,1,900"): "rapidity of a boost must be a number below 300",
    ("--boost", "0,0,1,1", "--center", "1,2"): "--center must be X,Y,Z",
    ("--offset", "1", "--center", "1,2,3"): "--center belongs to --boost",
    ("--invert", "0,0,0"): "--invert must be X,Y,Z,R, 4 finite numbers",
    ("--invert", "0,0,0,-1"): "radius of an inversion must be a number above 0; found -1",
    ("--laguerre", "none.json"): "none.json: the file must exist",
    ("--laguerre", "list.json"): "list.json: A transformation must be a JSON object; found list",
    ("--laguerre", "bytes.json"): "bytes.json: A transformation must be JSON text in UTF-8",
    ("--laguerre", "turn.json"): "turn.json: The matrix T of a Laguerre transformation must keep J",
    ("--moebius", "turn.json"): "turn.json: 'matrix' must hold 5 x 5 numbers",
    ("--moebius", "empty.json"): "empty.json: the file must hold a transformation; it is empty",
    ("--offset", "1", "--report", "none/r.json"): "the folder of the output must exist",
}
GEOMETRY = {
    ("--boost", "-1,0,0,9"): "c' must have one sign on the whole mesh",
    ("--offset", "-1.5"): "turns over against the others",
    ("--invert", "2.0,0,0,1"): "vertex 0 does, and goes to infinity",
    ("--invert", "2.1,0.32,0.2,1"): "lies inside the sphere about its circle",
}


@pytest.mark.parametrize("options", OFFSETS, ids=" ".join)
def test_offset_without_sense_is_refused(
    roof: Path, refused: Refused, options: tuple[str, ...]
) -> None:
    assert OFFSETS[options] in refused("offset", roof, "-o", "out.obj", *options)


@pytest.mark.parametrize("options", TRANSFORMS | GEOMETRY, ids=" ".join)
def test_transform_without_sense_is_refused(
    tmp_path: Path, roof: Path, refused: Refused, options: tuple[str, ...]
) -> None:
    (tmp_path / "list.json").write_text("[]")
    (tmp_path / "empty.json").write_text("")
    (tmp_path / "bytes.json").write_bytes(b"\xff\xfe\x00{")
    c, s = np.cos(0.1), np.sin(0.1)
    turn = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, c, -s], [0, 0, s, c]]
    (tmp_path / "turn.json").write_text(json.dumps({"matrix": turn}))
    (tmp_path / "out.obj").write_text("an earlier result")
    expected = (TRANSFORMS | GEOMETRY)[options]
    assert expected in refused("transform", roof, "-o", "out.obj", *options)


@pytest.mark.parametrize("command", [("offset", "--distance", "1"), ("transform", "--offset", "1")])
def test_bad_meshes_and_outputs_are_refused(
    tmp_path: Path, roof: Path, refused: Refused, command: tuple[str, ...]
) -> None:
    (tmp_path / "bad.obj").write_text("v 0 0 0\nv 0 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    (tmp_path / "tri.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    name, *options = command
    assert "edge 0-1 has none" in refused(name, "bad.obj", *options, "-o", "out.obj")
    if name == "transform":
        assert "must be a quad" in refused(name, "tri.obj", *options, "-o", "out.obj")
    assert "the file must exist" in refused(name, "none.obj", *options, "-o", "out.obj")
    assert "found '.stl'" in refused(name, roof, *options, "-o", "out.stl")
    assert "'-o'" in refused(name, roof, *options)


def test_vertex_offset_of_a_mesh_in_pieces_is_refused(tmp_path: Path, refused: Refused) -> None:
    one = conical()
    points = np.vstack([one.vertices, one.vertices + np.array([9.0, 0, 0])])
    faces = np.vstack([one.faces, one.faces + len(one.vertices)])
    write_mesh(QuadMesh.of(points, faces), tmp_path / "two.obj")
    line = refused("offset", "two.obj", "--kind", "vertex", "--distance", "1", "-o", "out.obj")
    assert "in one piece" in line
