"""Panels with edge offsets: beams of one depth where there are any, an honest answer elsewhere."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.io.formats import read_quad_mesh
from pqmesh.offset.distances import edge_distance

Command = Callable[..., Any]
Refused = Callable[..., str]

DOME = "4 - x**2/20 - y**2/14"
# Curved like a dome along one edge and like a saddle along the other.
VAULT = "5 - y**2/16 + x**3/400"
# The lengths of beams are those between the two meshes in one file each, of nine digits.
EXACT = 1e-9


def design(graph: str, rest: str = "") -> str:
    """Text of a design of edge-offset panels over a rectangle."""
    return f"""
[surface]
graph = {{z = "{graph}", x = [-6, 6], y = [-4, 4]}}
units = "m"
[panels]
kind = "edge-offset"
edge = 0.9
{rest}
[layers]
distances = [-0.3, 0.2]
[output]
figures = false
"""


def panelized(pqmesh: Command, folder: Path, text: str) -> tuple[Any, dict[str, Any]]:
    """The run of a design, and its report."""
    (folder / "roof.toml").write_text(text)
    result = pqmesh("panelize", "roof.toml", "-o", "out")
    assert result.code in (0, 3), result.err
    return result, json.loads((folder / "out" / "report.json").read_text())


def test_dome_has_beams_of_one_depth(pqmesh: Command, tmp_path: Path) -> None:
    result, report = panelized(pqmesh, tmp_path, design(DOME))
    assert result.code == 0, result.err
    assert report["kind"] == "edge-offset"
    assert report["after"]["planarity_max"] < 1e-12
    assert report["support"]["depth_min"] == pytest.approx(0.5, abs=1e-12)
    assert report["support"]["depth_max"] == pytest.approx(0.5, abs=1e-12)
    assert report["deviation"]["max"] < 0.01 * report["after"]["edge_mean"]
    mesh = read_quad_mesh(tmp_path / "out" / "mesh.obj")
    for number, layer in enumerate(report["layers"], start=1):
        assert layer["kind"] == "edge"
        assert layer["distance_error_max"] < 1e-12
        assert layer["parallel_error_max"] < 1e-12
        found = read_quad_mesh(tmp_path / "out" / f"layer-{number}.obj")
        assert np.abs(edge_distance(mesh, found) - abs(layer["distance"])).max() < EXACT


def test_dome_to_saddle_is_nearly_so_and_says_why(pqmesh: Command, tmp_path: Path) -> None:
    result, report = panelized(pqmesh, tmp_path, design(VAULT))
    assert result.code == 3
    assert "not reached: " in result.err
    assert not report["solver"]["converged"]
    assert "no mesh with edge offsets near: " in report["solver"]["reason"]
    assert report["after"]["planarity_max"] < 1e-9
    depths = report["support"]["depth_min"], report["support"]["depth_max"]
    assert depths[1] - depths[0] > 1e-6
    errors = [layer["distance_error_max"] for layer in report["layers"]]
    judged = {row["key"]: row for row in report["tolerance"]}
    assert judged["offset"]["reached"] == pytest.approx(max(errors))


@pytest.mark.parametrize(
    "rest",
    ["flat = 0.01", 'within = 0.1\n[boundary]\nmode = "fixed"', '[boundary]\nmode = "glide"'],
)
def test_edge_offset_with_a_wish_it_cannot_keep_is_refused(
    refused: Refused, tmp_path: Path, rest: str
) -> None:
    (tmp_path / "roof.toml").write_text(design(DOME, rest))
    assert "panels.kind = 'edge-offset' fits a flat mesh with a free boundary" in refused(
        "panelize", "roof.toml", "-o", "out"
    )


def test_unreached_deviation_ends_in_code_3(pqmesh: Command, tmp_path: Path) -> None:
    wish = design(DOME) + "[tolerance]\ndeviation = 1e-6\n"
    result, report = panelized(pqmesh, tmp_path, wish)
    assert result.code == 3
    assert "not reached: deviation" in result.err
    assert report["solver"]["converged"]
