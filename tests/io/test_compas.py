"""COMPAS JSON: surfaces and meshes, alone and inside scenes, and every refusal."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pqmesh.errors import FormatError, PqmeshError, SurfaceError
from pqmesh.io.compas import compas_from_mesh, polygons_from_compas, read_compas_surface
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.surface.bspline import BSplineSurface


def surface_table(**changes: Any) -> dict[str, Any]:
    points = [[[2.0 * i, 3.0 * j, 0.3 * i * j] for j in range(4)] for i in range(5)]
    table = {
        "points": points,
        "weights": [[1.0] * 4 for _ in range(5)],
        **{"knots_u": [0.0, 1.0, 2.0], "mults_u": [4, 1, 4]},
        **{"knots_v": [0.0, 5.0], "mults_v": [4, 4], "degree_u": 3, "degree_v": 3},
        **{"is_periodic_u": False, "is_periodic_v": False},
    }
    return table | changes


def written(path: Path, tree: Any) -> Path:
    path.write_text(json.dumps(tree))
    return path


def whole(table: dict[str, Any]) -> dict[str, Any]:
    return {"dtype": "compas.geometry/NurbsSurface", "data": table, "guid": "g"}


def refused(kind: type[PqmeshError], path: Path) -> str:
    with pytest.raises(kind) as caught:
        read_compas_surface(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


def test_surface_of_the_office(data_folder: Path) -> None:
    surface = read_compas_surface(data_folder / "surface_from_rhino.json")
    assert surface.degrees == (3, 3)
    assert surface.points.shape == (4, 4, 3)
    assert surface.weights is None
    assert surface.domain.u == (0.0, 10.0)
    corner = surface.jet(np.array([[10.0, 0.0]])).point
    assert corner == pytest.approx(np.array([[18.0, 0.0, 0.0]]))


@pytest.mark.parametrize(
    "wrap", [lambda t: t, lambda t: [1, t], lambda t: {"scene": {"items": [t]}}]
)
def test_surface_is_found_inside(wrap: Any, tmp_path: Path) -> None:
    path = written(tmp_path / "a.json", wrap(whole(surface_table())))
    surface = read_compas_surface(path)
    assert surface.points.tolist() == surface_table()["points"]
    assert surface.knots[0].tolist() == [0, 0, 0, 0, 1, 2, 2, 2, 2]


def test_knots_without_the_first_and_last_are_completed(tmp_path: Path) -> None:
    table = surface_table(knots_u=[0, 0, 0, 1, 2, 2, 2], mults_u=[1] * 7)
    surface = read_compas_surface(written(tmp_path / "a.json", whole(table)))
    assert surface.knots[0].tolist() == [0, 0, 0, 0, 1, 2, 2, 2, 2]


def test_weights_are_read(tmp_path: Path) -> None:
    table = surface_table(weights=[[1.0, 0.5, 0.5, 1.0]] * 5)
    surface = read_compas_surface(written(tmp_path / "a.json", whole(table)))
    assert surface.weights is not None
    assert surface.weights[2].tolist() == [1.0, 0.5, 0.5, 1.0]


def test_one_period_of_knots_is_unrolled(tmp_path: Path) -> None:
    angles = 2 * np.pi * np.arange(8) / 8
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    points = np.stack([ring + k * np.eye(3)[2] for k in range(4)], axis=1)
    table = surface_table(
        points=points.tolist(),
        weights=np.ones((8, 4)).tolist(),
        **{"knots_u": np.arange(9.0).tolist(), "mults_u": [1] * 9, "is_periodic_u": True},
    )
    surface = read_compas_surface(written(tmp_path / "a.json", whole(table)))
    assert surface.domain.periodic == (True, False)
    own = BSplineSurface(points, (3, 3), periodic=(True, False))
    uv = np.random.default_rng(0).random((9, 2))
    scaled = uv * [8.0, 5.0]
    assert surface.jet(scaled).point == pytest.approx(own.jet(uv).point, abs=1e-14)


def test_files_without_one_surface_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    assert "must exist" in refused(FormatError, path)
    path.write_bytes(b"")
    assert "it is empty" in refused(FormatError, path)
    path.write_bytes(b"\xff\xfe\x00")
    assert "must be JSON; found: it is not text" in refused(FormatError, path)
    path.write_text("{")
    assert "must be JSON; found: Expecting property name" in refused(FormatError, path)
    path.write_text("[" * 100_000)
    assert "must be JSON" in refused(FormatError, path)
    assert "one NURBS surface; found none. Export a NURBS surface." in refused(
        FormatError, written(path, {"data": 1})
    )
    two = [{**whole(surface_table()), "name": name} for name in ("roof", "wall")]
    assert "found 2 ('roof', 'wall'). Export one alone." in refused(FormatError, written(path, two))


@pytest.mark.parametrize(
    ("changes", "kind", "text"),
    [
        ({"points": 3}, FormatError, "n x m x 3"),
        ({"points": [["a"]]}, FormatError, "must hold points"),
        ({"weights": [[1.0]]}, FormatError, "found shapes (5, 4, 3) and (1, 1)"),
        ({"degree_u": None}, FormatError, "must hold points"),
        ({"mults_u": [4, -1, 4]}, FormatError, "must hold points"),
        ({"mults_u": [4, 4]}, FormatError, "must hold points"),
        ({"mults_u": [4, 3, 4]}, SurfaceError, "control points of degree 3 in u need 9 knots"),
        ({"weights": [[0.0] * 4] * 5}, SurfaceError, "Weights must be positive"),
        ({"points": [[[0.0, 0.0, float("nan")]] * 4] * 5}, SurfaceError, "finite"),
        ({"knots_u": [0.0, 3.0, 2.0]}, SurfaceError, "must not decrease"),
    ],
)
def test_bad_surface_is_refused(
    changes: dict[str, Any], kind: type[PqmeshError], text: str, tmp_path: Path
) -> None:
    assert text in refused(kind, written(tmp_path / "a.json", whole(surface_table(**changes))))


# --- meshes ---------------------------------------------------------------------------------


def test_mesh_comes_back_exactly(mesh: PolyMesh) -> None:
    found = polygons_from_compas(compas_from_mesh(mesh))
    assert (found.vertices == mesh.vertices).all()
    assert found.face_lists() == mesh.topology.face_lists()
    assert compas_from_mesh(mesh) == compas_from_mesh(mesh.with_vertices(mesh.vertices))


def test_mesh_has_the_keys_of_compas(mixed: PolyMesh) -> None:
    tree = json.loads(compas_from_mesh(mixed))
    assert tree["dtype"] == "compas.datastructures/Mesh"
    assert list(tree) == ["dtype", "data", "inheritance", "guid"]
    assert tree["data"]["max_vertex"] == 7
    assert tree["data"]["max_face"] == 2
    assert tree["data"]["face"]["2"] == [1, 5, 6, 7, 2]


def test_thrust_diagram_of_the_office(data_folder: Path) -> None:
    path = data_folder / "examples_dropdowns_5.json"
    with pytest.raises(FormatError, match=r"must hold one mesh; found 4 \(.*ThrustDiagram"):
        polygons_from_compas(path.read_bytes())
    item = json.loads(path.read_bytes())["scene"]["data"]["items"][2]
    found = polygons_from_compas(json.dumps(item).encode())
    assert found.vertices.shape == (132, 3)
    assert len(found.sizes) == 112


def test_mesh_of_compas_one_is_read() -> None:
    data = {"dva": {"x": 0, "y": 0, "z": 7}, "vertex": {"3": {"x": 1}, "5": {}, "9": {"y": 2}}}
    tree = {"dtype": "compas.datastructures/Mesh", "value": {**data, "face": {"0": [9, 5, 3]}}}
    found = polygons_from_compas(json.dumps(tree).encode())
    assert found.vertices.tolist() == [[1, 0, 7], [0, 0, 7], [0, 2, 7]]
    assert found.face_lists() == [[2, 1, 0]]


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"vertex": {}, "face": {}}, "with entries"),
        ({"vertex": [], "face": 3}, "with entries"),
        ({"vertex": {"0": 3}, "face": {"0": [0]}}, "vertex '0' has not"),
        ({"vertex": {"0": {"x": "1"}}, "face": {"0": [0]}}, "vertex '0' has not"),
        ({"vertex": {"0": {"x": None}}, "face": {"0": [0]}}, "vertex '0' has not"),
        ({"vertex": {"0": {}}, "face": {"4": [0, 8]}}, "face '4' has '8'"),
        ({"vertex": {"0": {}}, "face": {"4": {"0": 0}}}, "Face '4' must be a list"),
    ],
)
def test_bad_mesh_is_refused(table: dict[str, Any], text: str) -> None:
    with pytest.raises(FormatError) as caught:
        polygons_from_compas(json.dumps(table).encode())
    assert text in str(caught.value)


@settings(
    max_examples=100,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.data())
def test_cut_and_changed_files_are_refused_or_read(tmp_path: Path, data: st.DataObject) -> None:
    text = json.dumps(whole(surface_table())).encode()
    at = data.draw(st.integers(0, len(text) - 1))
    bad = data.draw(st.sampled_from([b"", b"9", b"-", b"null", b"[]", b"{}", b"1e999", b'"a"']))
    path = tmp_path / "fuzz.json"
    path.write_bytes(text[:at] + bad + text[at + data.draw(st.integers(0, 9)) :])
    message = ""
    try:
        read_compas_surface(path)
    except PqmeshError as error:
        message = str(error)
    assert "\n" not in message
    path.write_bytes(text[:at])
    refused(FormatError, path)
