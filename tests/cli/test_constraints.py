"""Constraints as a user types them: in a design, and in a file beside a mesh."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.design import Design, read_constraints
from pqmesh.errors import SpecError
from pqmesh.io.formats import read_quad_mesh, write_mesh
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.optimize.constraints import EdgeLengths, Level, PanelSizes, Plane
from pqmesh.optimize.selection import Where

Command = Callable[..., Any]
Refused = Callable[..., str]

ALL = """
units = "m"
[constraints]
corners = { turn_deg = 40 }
within = "100 mm"
[[constraints.fixed]]
vertices = [3, 5]
[[constraints.glide]]
box = [[0, 0, 0], [1, 1, 1]]
hard = false
weight = 2.5
[[constraints.curve]]
vertices = "boundary"
near_curve = [[0, 0, 0], [1, 0, 0]]
near = "0.2 m"
points = [[0, 0, 0], [1, 0, 0], [2, 1, 0]]
[[constraints.level]]
near_level = 1
near = 0.5
height = "1200 mm"
[[constraints.plane]]
vertices = "corners"
point = [0, 0, 1]
normal = [0, 1, 1]
[[constraints.mirror]]
normal = [1, 0, 0]
[[constraints.rotation]]
order = 3
tolerance = 0.1
[[constraints.axis]]
vertices = "inside"
direction = [0, 0, 1]
[[constraints.edge_lengths]]
least = "900 mm"
most = 1.5
[[constraints.edge_lengths]]
vertices = "boundary"
most = 1.1
relative = true
[[constraints.panel_sizes]]
least = 2
measure = "area"
[[constraints.flat_polylines]]
polylines = [[0, 1, 2, 3]]
[[constraints.flat_polylines]]
through = [[0, 0, 1]]
"""


@pytest.fixture
def dome(tmp_path: Path) -> Path:
    """A small mesh over a dome, its faces a little twisted."""
    x, y = np.meshgrid(np.arange(-2.0, 3.0), np.arange(-2.0, 3.0), indexing="ij")
    points = np.stack([x, y, 2 - 0.1 * x * x - 0.08 * y * y + 0.01 * x * y], axis=-1)
    path = tmp_path / "dome.obj"
    write_mesh(grid_mesh(points), path)
    return path


def test_every_key_becomes_its_constraint(tmp_path: Path) -> None:
    (tmp_path / "all.toml").write_text(ALL)
    parts = read_constraints(tmp_path / "all.toml").parts
    assert [part.name for part in parts] == [
        "corners", "fixed", "glide", "curve", "level", "plane", "mirror", "rotation", "axis",
        "edge lengths", "edge lengths", "panel sizes", "flat polylines", "flat polylines", "within",
    ]  # fmt: skip
    level = next(part for part in parts if isinstance(part, Level))
    assert level == Level(Where(level=1.0, distance=0.5), 1.2)
    assert (parts[2].hard, parts[2].weight) == (False, 2.5)
    lengths, shares = (part for part in parts if isinstance(part, EdgeLengths))
    assert (lengths.least, lengths.most, lengths.relative) == (0.9, 1.5, False)
    assert shares == EdgeLengths(None, 1.1, "boundary", True)
    assert PanelSizes(2.0, None, "area") in parts


def test_places_of_a_design_count_from_the_origin_of_its_surface() -> None:
    table = {
        "surface": {"shape": {"kind": "torus"}, "units": "mm"},
        "panels": {"edge": 0.3},
        "constraints": {
            "level": [{"vertices": "boundary", "height": "1 m"}],
            "plane": [{"box": [[1, 2, 3], [4, 5, 6]], "point": [1, 1, 1], "normal": [1, 0, 0]}],
        },
    }
    found = Design.of(table).constraints_about(np.array([10.0, 20.0, 30.0]))
    assert found is not None
    where = Where(box=[[-9, -18, -27], [-6, -15, -24]])
    assert found.parts == (Level("boundary", 970.0), Plane(where, (-9, -19, -29), (1, 0, 0)))


def test_optimize_meets_its_constraints_and_says_so(
    tmp_path: Path, dome: Path, pqmesh: Command
) -> None:
    (tmp_path / "wanted.toml").write_text(
        '[[constraints.level]]\nvertices = "corners"\nheight = 1.2\n'
        "[[constraints.mirror]]\nnormal = [1, 0, 0]\n"
        "[[constraints.edge_lengths]]\nvertices = [0, 1, 2, 3, 4]\nmost = 1.05\n"
    )
    report = tmp_path / "report.json"
    done = pqmesh(
        "optimize", dome.name, "-o", "out.obj", "--kind", "planar",
        "--constraints", "wanted.toml", "--report", report.name,
    )  # fmt: skip
    assert done.code == 0, done.err
    mesh = read_quad_mesh(tmp_path / "out.obj")
    assert np.abs(mesh.vertices[[0, 4, 20, 24], 2] - 1.2).max() < 1e-12
    grid = mesh.vertices.reshape(5, 5, 3)
    assert np.abs(grid[::-1] * [-1, 1, 1] - grid).max() < 1e-11
    assert np.linalg.norm(np.diff(grid[0], axis=0), axis=1).max() <= 1.05
    assert planarity(mesh).max() < 1e-11
    rows = {row["key"]: row for row in json.loads(report.read_text())["tolerance"]}
    assert rows["constraints"]["pass"]
    assert rows["constraints"]["reached"] < 1e-11


def test_constraint_that_is_not_met_gives_exit_code_3(
    tmp_path: Path, dome: Path, pqmesh: Command
) -> None:
    # Edges of 1 cannot become edges of 4 without moving by many of them.
    (tmp_path / "wanted.toml").write_text(
        "[[constraints.edge_lengths]]\nleast = 4\n[constraints]\nwithin = 0.1\n"
        "[[constraints.fixed]]\nvertices = [0, 4]\n"
    )
    done = pqmesh(
        "optimize", dome.name, "-o", "out.obj", "--kind", "planar", "--constraints", "wanted.toml"
    )
    assert done.code == 3
    assert "not reached: constraints" in done.err
    assert (tmp_path / "out.obj").exists()


SURFACE = '[surface]\ngraph = {z = "5 - y**2/16 - x**2/50", x = [-9, 9], y = [-6, 6]}\n'


def test_panelize_meets_the_constraints_of_a_design(tmp_path: Path, pqmesh: Command) -> None:
    (tmp_path / "roof.toml").write_text(
        SURFACE + '[panels]\nedge = 1.5\nkind = "planar"\nnetwork = "uv"\n'
        "[output]\nfigures = false\n"
        "[[constraints.mirror]]\nnormal = [1, 0, 0]\n"
        '[[constraints.flat_polylines]]\npolylines = "boundary"\n'
    )
    done = pqmesh("panelize", "roof.toml", "-o", "out")
    assert done.code == 0
    mesh = read_quad_mesh(tmp_path / "out" / "mesh.obj")
    image = mesh.vertices * [-1, 1, 1]
    gaps = np.linalg.norm(image[:, None] - mesh.vertices, axis=2).min(axis=1)
    assert gaps.max() < 1e-11
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert "constraints" in [row["key"] for row in report["tolerance"]]
    assert report["design"]["constraints"]["mirror"][0]["normal"] == [1.0, 0.0, 0.0]


LEVEL = '[[constraints.level]]\nvertices = "corners"\nheight = 1\n'
BAD_FILES = {
    "constraints.level.1.hieght is not a known key; did you mean 'height'?": (
        LEVEL + '[[constraints.level]]\nvertices = "corners"\nhieght = 1\n'
    ),
    "line 6: constraints.level.1.hieght": (
        LEVEL + '[[constraints.level]]\nvertices = "corners"\nhieght = 1\n'
    ),
    "constraints.levels is not a known key; did you mean 'level'?": "[[constraints.levels]]\n",
    "panels is not a known key. Known here: constraints, units": LEVEL + "[panels]\n",
    "constraints must be given": "units = 'm'\n",
    "a file of constraints must have some; found none": "[constraints]\n",
    "constraints.level.0.height has a unit, so the unit of the mesh must be known": (
        LEVEL.replace("1\n", '"1 m"\n')
    ),
    "line 3: constraints.level.0.height must be a length": LEVEL.replace("1\n", "nan\n"),
    "line 1: constraints.level.0: vertices must be chosen; found no choice": (
        "[[constraints.level]]\nheight = 1\n"
    ),
    "line 1: constraints.level.0: The weight of a constraint (level) must be a finite": (
        LEVEL + "weight = 0\n"
    ),
    "constraints.edge_lengths.0: edge lengths: least must not exceed most; found 2 and 1": (
        "[[constraints.edge_lengths]]\nleast = 2\nmost = 1\n"
    ),
    "constraints.edge_lengths.0.most must be a plain number where relative": (
        "[[constraints.edge_lengths]]\nmost = '1 m'\nrelative = true\n"
    ),
    "constraints.axis.0: An axis of nodes must have a length above 0": (
        '[[constraints.axis]]\nvertices = "all"\ndirection = [0, 0, 0]\n'
    ),
    "constraints.fixed.0: A group of vertices must be one of all, boundary": (
        '[[constraints.fixed]]\nvertices = "rim"\n'
    ),
    "Vertices must be numbered 0..24; a constraint names 25": (
        "[[constraints.fixed]]\nvertices = [25]\n"
    ),
    "the 2 planes and levels of vertex 0 have none": LEVEL + LEVEL.replace("= 1\n", "= 2\n"),
    "units must be one of m, mm, cm": LEVEL.replace("[[", 'units = "yard"\n[[', 1),
    "the mirror takes vertex 0 to (18": (
        "[[constraints.mirror]]\npoint = [8, 0, 0]\nnormal = [1, 0, 0]\n"
    ),
}


@pytest.mark.parametrize("text", BAD_FILES)
def test_bad_file_of_constraints_is_refused_in_one_line(
    tmp_path: Path, dome: Path, refused: Refused, text: str
) -> None:
    (tmp_path / "wanted.toml").write_text(BAD_FILES[text])
    line = refused("optimize", dome.name, "-o", "out.obj", "--constraints", "wanted.toml")
    assert text in line
    assert not (tmp_path / "out.obj").exists()


def test_constraints_do_not_go_with_edge_offsets(
    tmp_path: Path, dome: Path, refused: Refused
) -> None:
    (tmp_path / "wanted.toml").write_text(LEVEL)
    line = refused(
        "optimize", dome.name, "-o", "out.obj", "--kind", "edge-offset",
        "--constraints", "wanted.toml",
    )  # fmt: skip
    assert "free boundary; found --constraints" in line


@pytest.mark.parametrize(
    "rows",
    [
        "[[constraints.fixed]]\nvertices = [1]\n",
        "[[constraints.flat_polylines]]\npolylines = [[1, 2, 3, 4]]\n",
    ],
)
def test_design_refuses_vertices_by_number(tmp_path: Path, refused: Refused, rows: str) -> None:
    (tmp_path / "roof.toml").write_text(SURFACE + "[panels]\nedge = 1.5\n" + rows)
    line = refused("panelize", "roof.toml", "-o", "out")
    assert "line 5: constraints." in line
    assert "the vertices of a mesh that is yet to be made have no numbers" in line


def test_design_with_edge_offsets_refuses_constraints() -> None:
    table = {
        "surface": {"shape": {"kind": "torus"}},
        "panels": {"edge": 0.3, "kind": "edge-offset"},
        "constraints": {"within": 0.1},
    }
    with pytest.raises(SpecError, match="found constraints beside it"):
        Design.of(table)
