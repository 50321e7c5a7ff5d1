"""Bad input of `optimize`: it ends in seconds, in code 2 or 3, with what, where and advice."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.io.formats import read_mesh, write_mesh
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh

Command = Callable[..., Any]
Refused = Callable[..., str]


def grid(scale: float = 1.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> QuadMesh:
    """Sixteen vertices of a dome whose nine faces are not flat."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    points = np.stack([x, y, 0.1 * x * x + 0.08 * y * y + 0.04 * x * y], axis=-1)
    return grid_mesh(scale * points + np.array(at))


def beside(one: PolyMesh, other: PolyMesh) -> PolyMesh:
    """Two meshes as one of two pieces."""
    count = one.topology.n_vertices
    faces = [[count + i for i in face] for face in other.topology.face_lists()]
    return PolyMesh.of(
        np.concatenate([one.vertices, other.vertices]), one.topology.face_lists() + faces
    )


@pytest.fixture
def wavy(tmp_path: Path) -> str:
    write_mesh(grid(), tmp_path / "wavy.obj")
    return "wavy.obj"


# --- meshes ---------------------------------------------------------------------------------

SQUARES = "".join(
    f"v {i} {j} {0.1 * i * j}\n" for i in range(3) for j in range(2)
) + "f 1 3 4 2\nf 3 5 6 4\n"  # fmt: skip
BAD = {
    "flap.obj": (SQUARES + "v 1 0 5\nv 1 1 5\nf 3 4 8 7\n", "edge 2-3 has 3"),
    "twice.obj": (SQUARES + "f 1 3 4 2\n", "An edge must have at most two faces"),
    "turned.obj": (SQUARES + "f 2 4 3 1\n", "An edge must have at most two faces"),
    "loose.obj": (SQUARES + "v 9 9 9\n", "the first is vertex 6"),
    "touch.obj": (
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 1 0\nv 2 2 0\nv 1 2 0\n"
        "f 1 2 3 4\nf 3 5 6 7\n",
        "at vertex 2 they form several",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_mesh_that_is_none_is_refused_and_named(
    tmp_path: Path, refused: Refused, name: str
) -> None:
    text, expected = BAD[name]
    (tmp_path / name).write_text(text)
    line = refused("optimize", name, "-o", "o.obj")
    assert expected in line
    assert name in line


def test_far_away_mesh_is_refused_where_its_coordinates_are_coarse(
    pqmesh: Command, refused: Refused, tmp_path: Path
) -> None:
    for exponent in (6, 7):
        write_mesh(grid(at=(10.0**exponent, 0.0, 0.0)), tmp_path / "far.obj")
        result = pqmesh("optimize", "far.obj", "-o", "o.obj", "--report", "o.json")
        assert result.code == 0, result.err
        assert json.loads((tmp_path / "o.json").read_text())["solver"]["converged"] is True
    write_mesh(grid(at=(1e12, 0.0, 0.0)), tmp_path / "far.obj")
    line = refused("optimize", "far.obj", "-o", "o.obj")
    assert "multiples of 0.000122" in line


@pytest.mark.parametrize("scale", [1e-40, 1e-9, 1e9, 1e40])
def test_size_of_the_unit_does_not_matter(pqmesh: Command, tmp_path: Path, scale: float) -> None:
    write_mesh(grid(scale), tmp_path / "mesh.obj")
    result = pqmesh("optimize", "mesh.obj", "-o", "o.obj", "--report", "o.json")
    assert result.code == 0, result.err
    report = json.loads((tmp_path / "o.json").read_text())
    assert 0.01 < report["deviation"]["moved_max"] / scale < 0.5


def test_pieces_of_one_size_are_solved_and_of_two_told_apart(
    pqmesh: Command, tmp_path: Path
) -> None:
    write_mesh(beside(grid(), grid(at=(10.0, 0.0, 0.0))), tmp_path / "two.obj")
    assert pqmesh("optimize", "two.obj", "-o", "o.obj").code == 0
    # The small piece is exact to the roundings of the large one only: it is named.
    write_mesh(beside(grid(), grid(1e8, (1e9, 0.0, 0.0))), tmp_path / "two.obj")
    result = pqmesh("optimize", "two.obj", "-o", "o.obj", "--report", "o.json")
    assert result.code == 3
    rows = json.loads((tmp_path / "o.json").read_text())["tolerance"]
    planar = next(row for row in rows if row["key"] == "planar")
    assert planar["worst"]["face"] < 9
    assert "not reached: planar " in result.err


def test_triangles_alone_are_conical_and_one_face_is_told_what_it_lost(
    pqmesh: Command, tmp_path: Path
) -> None:
    whole = grid()
    halves = [
        corners for a, b, c, d in whole.topology.face_lists() for corners in ([a, b, c], [a, c, d])
    ]
    write_mesh(PolyMesh.of(whole.vertices, halves), tmp_path / "tris.obj")
    result = pqmesh("optimize", "tris.obj", "-o", "o.obj", "--report", "o.json")
    rows = json.loads((tmp_path / "o.json").read_text())["tolerance"]
    reached = {row["key"]: row["reached"] for row in rows}
    assert result.code == 0, result.err
    assert reached["conical"] < 1e-8
    # Edges at the rim, whose vertices are asked for no cone, do not count.
    assert reached["twist"] < 1e-5
    (tmp_path / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 .01\nv 0 1 0\nf 1 2 3 4\n")
    assert pqmesh("optimize", "one.obj", "-o", "o.obj").code == 0
    assert read_mesh(tmp_path / "o.obj").topology.n_faces == 1


def test_edge_offset_asks_for_quads_before_it_says_anything_else(
    refused: Refused, tmp_path: Path
) -> None:
    (tmp_path / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1 2 3\n")
    line = refused("optimize", "one.obj", "-o", "o.obj", "--kind", "edge-offset")
    assert "one.obj: Every face must be a quad" in line


# --- reference ------------------------------------------------------------------------------

REFERENCES = {
    "far.obj": (
        grid(at=(1e6, 0.0, 0.0)),
        "must lie near the mesh; its nearest vertex, 12, is 1e+06 away",
    ),
    "huge.obj": (grid(1e60), "between 1e-50 and 1e+50; found 3e+60"),
    "speck.obj": (grid(1e-3, (20.0, 0.0, 0.0)), "more than the mesh is large (3)"),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_reference_elsewhere_is_refused(
    refused: Refused, tmp_path: Path, wavy: str, name: str
) -> None:
    mesh, expected = REFERENCES[name]
    write_mesh(mesh, tmp_path / name)
    line = refused("optimize", wavy, "-o", "o.obj", "--reference", name)
    assert expected in line
    assert name in line


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("empty.obj", "", "it is empty"),
        ("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 3 0 0\nf 1 2 3 4\n", "must have area"),
        ("note.txt", "hello", "must be one of .obj, .off, .ply"),
        ("net.json", "{", "must be JSON"),
    ],
)
def test_reference_that_is_no_surface_is_refused(
    refused: Refused, tmp_path: Path, wavy: str, name: str, text: str, expected: str
) -> None:
    (tmp_path / name).write_text(text)
    assert expected in refused("optimize", wavy, "-o", "o.obj", "--reference", name)


# --- constraints ----------------------------------------------------------------------------

LEVEL = "[[constraints.level]]\nvertices = [0]\nheight = "
REFUSED = {
    "": "must not be empty",
    "[constraints]\n": "must have some; found none",
    "[constraints\n": "must be a TOML file",
    "[constraints]\nfixd = 1\n": "did you mean 'fixed'?",
    "[[constraints.fixed]]\nvertices = [99]\n": "numbered 0..15; a constraint names 99",
    "[[constraints.fixed]]\nvertices = [1.5]\n": "a list of whole numbers; found",
    "[[constraints.fixed]]\nvertices = []\n": "at least one; found []",
    "[[constraints.fixed]]\nvertices = 'all'\nhard = false\nweight = 0\n": "above 0; found 0",
    "[[constraints.fixed]]\nvertices = 'all'\nhard = false\nweight = -1\n": "above 0; found -1",
    "[[constraints.fixed]]\nvertices = 'all'\nweight = nan\n": "a finite number; found nan",
    "[[constraints.fixed]]\nvertices = 'all'\n": "face 0 (0, 4, 5, 1) is not flat",
    LEVEL + "nan\n": "found nan",
    LEVEL + "1\n" + LEVEL + "2\n": "of vertex 0 have none",
    LEVEL + "2\n[[constraints.fixed]]\nvertices = [0]\n": "vertex 0 misses the level by 2",
    "[[constraints.edge_lengths]]\nleast = 2\nmost = 1\n": "least must not exceed most",
    "[[constraints.plane]]\nvertices = [0]\npoint = [0, 0, 0]\nnormal = [0, 0, 0]\n": "above 0",
    "[constraints]\nwithin = 0\n": "above 0; found 0",
    "[constraints]\nwithin = '1 parsec'\n": "Known units are",
}


@pytest.mark.parametrize("text", REFUSED)
def test_constraints_without_sense_are_refused(
    refused: Refused, tmp_path: Path, wavy: str, text: str
) -> None:
    (tmp_path / "c.toml").write_text(text)
    assert REFUSED[text] in refused("optimize", wavy, "-o", "o.obj", "--constraints", "c.toml")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("[[constraints.edge_lengths]]\nmost = 1e-9\n", "edge lengths"),
        ("[[constraints.level]]\nvertices = [0, 1, 2, 3]\nheight = 1e6\n", "level"),
        ("[constraints]\nwithin = 1e-12\n", "within"),
    ],
)
def test_constraint_out_of_reach_is_named_with_its_place(
    pqmesh: Command, tmp_path: Path, wavy: str, text: str, name: str
) -> None:
    (tmp_path / "c.toml").write_text(text)
    options = ["--kind", "planar", "--constraints", "c.toml", "--report", "o.json"]
    result = pqmesh("optimize", wavy, "-o", "o.obj", *options)
    assert result.code == 3
    row = json.loads((tmp_path / "o.json").read_text())["tolerance"][-1]
    moved = read_mesh(tmp_path / "o.obj")
    worst = row["worst"]
    assert (row["key"], row["pass"], worst["constraint"]) == ("constraints", False, name)
    assert worst["at"] == pytest.approx(moved.vertices[worst["vertex"]].tolist())
    line = next(text for text in result.err.splitlines() if "not reached: constraints" in text)
    assert f"worst is vertex {worst['vertex']} at (" in line
    assert line.endswith(f"({name})")
