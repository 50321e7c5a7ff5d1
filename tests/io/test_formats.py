"""Reading and writing by suffix: round trips, real files, and what every format refuses."""

import hashlib
import os
import re
from pathlib import Path

import numpy as np
import pytest

from pqmesh.errors import FormatError, MeshError
from pqmesh.io.formats import (
    MESH_FORMATS,
    read_mesh,
    read_polygons,
    read_quad_mesh,
    write_mesh,
)
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import drop_unused

SUFFIXES = list(MESH_FORMATS)

# Vertices, triangles, quads, pieces, boundary loops: from the index of the real files.
REAL = {
    "hypar.obj": (81, 0, 64, 1, 1),
    "tubemesh.obj": (200, 0, 171, 1, 1),
    "six.off": (720, 0, 656, 1, 2),
    "YasIsland.off": (1085, 0, 976, 1, 3),
    "Intersection.off": (1726, 64, 1632, 1, 4),
    "formfinding-circular.off": (432, 0, 396, 1, 1),
    "inspired_mesh_quads_Conjugate.off": (1749, 0, 1633, 1, 1),
    "inspired_mesh.obj": (2244, 4288, 0, 1, 1),
    "M2_eq_quad2.obj": (920, 0, 871, 1, 1),
    "conical1.obj": (1147, 0, 1080, 1, 1),
    "HyperbolicParaboloid_a1_b2_r_rot.off": (746, 1359, 0, 1, 1),
    "train-station.off": (1753, 3330, 0, 1, 2),
    "BubbleShell.ply": (1530, 2861, 0, 1, 5),
    "suzanne.ply": (1966, 32, 468, 499, 499),
}


def assert_same(first: PolyMesh, second: PolyMesh) -> None:
    # As bits, so that -0.0 differs from 0.0.
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.topology.face_lists() == second.topology.face_lists()
    assert first.topology.n_vertices == second.topology.n_vertices


def refusal(path: Path, error: type[Exception] = FormatError) -> str:
    with pytest.raises(error) as caught:
        read_mesh(path)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text


# --- round trips ----------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_write_then_read_gives_same_mesh(mesh: PolyMesh, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"mesh{suffix}"
    write_mesh(mesh, path)
    again = read_mesh(path)
    assert_same(again, mesh)
    assert isinstance(again, QuadMesh) == mesh.topology.is_quad


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_writing_leaves_mesh_untouched(mesh: PolyMesh, suffix: str, tmp_path: Path) -> None:
    before = mesh.vertices.tobytes(), mesh.topology.face_lists()
    write_mesh(mesh, tmp_path / f"mesh{suffix}")
    assert (mesh.vertices.tobytes(), mesh.topology.face_lists()) == before


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_same_mesh_gives_same_bytes(mesh: PolyMesh, suffix: str, tmp_path: Path) -> None:
    first, second, third = (tmp_path / f"{name}{suffix}" for name in "abc")
    write_mesh(mesh, first)
    write_mesh(mesh, second)
    write_mesh(read_mesh(first), third)
    assert first.read_bytes() == second.read_bytes() == third.read_bytes()
    assert b"pqmesh" in first.read_bytes()[:60]
    assert b"\r" not in first.read_bytes()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_reading_leaves_file_untouched(mixed: PolyMesh, suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"mesh{suffix}"
    write_mesh(mixed, path)
    before = path.read_bytes(), path.stat().st_mtime_ns
    read_mesh(path)
    assert (path.read_bytes(), path.stat().st_mtime_ns) == before


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("end", [b"\r\n", b"\r"])
def test_other_line_ends_read_the_same(
    mixed: PolyMesh, suffix: str, end: bytes, tmp_path: Path
) -> None:
    path = tmp_path / f"mesh{suffix}"
    write_mesh(mixed, path)
    path.write_bytes(path.read_bytes().replace(b"\n", end))
    assert_same(read_mesh(path), mixed)


def test_suffix_may_be_upper_case_and_path_a_string(mixed: PolyMesh, tmp_path: Path) -> None:
    path = str(tmp_path / "MESH.OBJ")
    write_mesh(mixed, path)
    assert_same(read_mesh(path), mixed)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_mesh_survives_every_other_format(suffix: str, mixed: PolyMesh, tmp_path: Path) -> None:
    current = mixed
    for other in (*SUFFIXES, suffix):
        write_mesh(current, tmp_path / f"a{other}")
        current = read_mesh(tmp_path / f"a{other}")
    assert_same(current, mixed)


def test_new_format_needs_one_line(
    mixed: PolyMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MESH_FORMATS, ".xyz", MESH_FORMATS[".off"])
    write_mesh(mixed, tmp_path / "a.xyz")
    assert_same(read_mesh(tmp_path / "a.xyz"), mixed)


# --- real files -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", REAL)
def test_real_file_has_counts_of_index(name: str, data_folder: Path) -> None:
    topology = read_mesh(data_folder / name).topology
    triangles = int((topology.face_sizes == 3).sum())
    quads = int((topology.face_sizes == 4).sum())
    pieces = int(topology.components.max()) + 1
    found = topology.n_vertices, triangles, quads, pieces, len(topology.boundary_loops)
    assert found == REAL[name]
    assert topology.n_faces == triangles + quads


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", ["conical1.obj", "Intersection.off", "suzanne.ply"])
def test_real_file_survives_writing(
    name: str, suffix: str, data_folder: Path, tmp_path: Path
) -> None:
    mesh = read_mesh(data_folder / name)
    write_mesh(mesh, tmp_path / f"a{suffix}")
    assert_same(read_mesh(tmp_path / f"a{suffix}"), mesh)


def test_real_file_has_stated_extent(data_folder: Path) -> None:
    mesh = read_quad_mesh(data_folder / "YasIsland.off")
    # The index gives four digits.
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [39.23, 24.83, 8.007], rtol=2e-4)


def test_real_file_with_indices_from_1_is_refused(data_folder: Path) -> None:
    text = refusal(data_folder / "QuadMesh.off")
    assert (
        "Faces must index vertices 0..1084; they index 1..1085, so the file looks 1-based" in text
    )
    assert "(2 corners point past the last vertex" in text
    assert "Subtract 1 from every face index" in text


def test_real_file_with_reversed_faces_is_refused(data_folder: Path) -> None:
    text = refusal(data_folder / "faces_reversed.obj", MeshError)
    assert "Faces must be coherently oriented; faces 0 and 5 both run along edge 6-7" in text
    assert "(10 such edges)" in text
    assert "count from 0" in text


def test_real_file_with_three_faces_at_edge_is_refused(data_folder: Path) -> None:
    text = refusal(data_folder / "joined_tetrahedra.obj", MeshError)
    assert "An edge must have at most two faces; edge 0-1 has 4 (3 such edges)" in text


@pytest.mark.parametrize(
    ("name", "count", "total"), [("Intersection.off", 64, 1696), ("suzanne.ply", 32, 500)]
)
def test_read_quad_mesh_refuses_real_file_with_triangles(
    name: str, count: int, total: int, data_folder: Path
) -> None:
    with pytest.raises(MeshError, match=rf"{name}: .*; {count} of {total} are not, the first is"):
        read_quad_mesh(data_folder / name)


# --- refusals -------------------------------------------------------------------------------


def test_read_quad_mesh_names_count_and_first_other_face(mixed: PolyMesh, tmp_path: Path) -> None:
    write_mesh(mixed, tmp_path / "a.off")
    with pytest.raises(MeshError) as caught:
        read_quad_mesh(tmp_path / "a.off")
    assert "2 of 3 are not, the first is face 1 with 3 corners" in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "a.off"))


def test_read_quad_mesh_gives_quad_mesh(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert read_quad_mesh(tmp_path / "a.obj").faces.tolist() == [[0, 1, 2, 3]]


@pytest.mark.parametrize("name", ["a.stl", "a", "a.obj.gz", ".obj"])
def test_unknown_suffix_is_refused_and_known_ones_named(
    name: str, mixed: PolyMesh, tmp_path: Path
) -> None:
    with pytest.raises(FormatError, match=r"must be one of \.obj, \.off, \.ply; found "):
        read_mesh(tmp_path / name)
    with pytest.raises(FormatError, match=r"must be one of \.obj, \.off, \.ply; found "):
        write_mesh(mixed, tmp_path / name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_file_is_refused(suffix: str, tmp_path: Path) -> None:
    assert "the file must exist; found none" in refusal(tmp_path / f"a{suffix}")
    assert "the file must exist; found none" in refusal(tmp_path / "no" / f"a{suffix}")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_folder_is_refused(suffix: str, tmp_path: Path) -> None:
    (tmp_path / f"a{suffix}").mkdir()
    assert "must be read from a file; found a folder" in refusal(tmp_path / f"a{suffix}")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes on this system")
def test_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.obj")
    assert "must be read from a file" in refusal(tmp_path / "a.obj")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_empty_file_is_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"")
    assert "it is empty" in refusal(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("content", [b"\n", b"  \r\n\n", b"# nothing\n", b"\xef\xbb\xbf"])
def test_file_without_content_is_refused(suffix: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    refusal(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_binary_garbage_is_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(hashlib.sha512(b"seed").digest() * 50 + bytes(10))
    assert "Line 1" in refusal(path) or "must be text" in refusal(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_text_that_is_not_utf8_is_refused_with_line(
    suffix: str, mixed: PolyMesh, tmp_path: Path
) -> None:
    path = tmp_path / f"a{suffix}"
    write_mesh(mixed, path)
    data = path.read_bytes()
    path.write_bytes(data + "Süd\n".encode("latin-1"))
    line = data.count(b"\n") + 1
    assert f"Line {line}: the text must be UTF-8; found byte 0xfc" in refusal(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_zero_byte_in_text_is_refused_with_line(
    suffix: str, mixed: PolyMesh, tmp_path: Path
) -> None:
    path = tmp_path / f"a{suffix}"
    write_mesh(mixed, path)
    data = path.read_bytes()
    path.write_bytes(data + b"\0")
    assert f"Line {data.count(10) + 1}: the file must be text; found a zero byte" in refusal(path)


def test_unreadable_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    monkeypatch.setattr(Path, "read_bytes", refuse)
    assert "the file must be readable; found: Permission denied" in refusal(tmp_path / "a.obj")


@pytest.mark.parametrize("name", ["a\0b.obj", "a" * 5000 + ".obj", "line\nfeed.obj"])
def test_impossible_path_is_refused_on_one_line(name: str, mixed: PolyMesh, tmp_path: Path) -> None:
    with pytest.raises(FormatError) as caught:
        read_mesh(os.path.join(tmp_path, name))
    assert "\n" not in str(caught.value)
    with pytest.raises(FormatError) as caught:
        write_mesh(mixed, os.path.join(tmp_path, "none", name))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "number", ["1e999", "nan", "-inf", "abc", "1_0", "0x1", "٣", "1,5", "1.0d3"]
)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_bad_coordinate_is_refused_with_line(suffix: str, number: str, tmp_path: Path) -> None:
    mesh = QuadMesh.of([[0, 0, 0], [7.5, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    path = tmp_path / f"a{suffix}"
    write_mesh(mesh, path)
    text = path.read_text().replace("7.5", number)
    path.write_text(text, encoding="utf-8")
    line = next(i for i, row in enumerate(text.split("\n"), start=1) if number in row.split())
    expected = f"Line {line}: a coordinate must be a finite number; found '{number}'"
    assert expected in refusal(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_coordinate_too_large_is_refused(suffix: str, tmp_path: Path) -> None:
    mesh = QuadMesh.of([[0, 0, 0], [7.5, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    path = tmp_path / f"a{suffix}"
    write_mesh(mesh, path)
    path.write_text(path.read_text().replace("7.5", "1e300"))
    assert "Coordinates must be finite and below 1e+150; vertex 1 is" in refusal(path, MeshError)


def test_unused_vertices_are_refused_and_remedy_works(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 8 8 8\nv 0 1 0\nf 2 3 5\n")
    text = refusal(path, MeshError)
    assert "2 of 5 belong to none, the first is vertex 0" in text
    assert "read_polygons and drop_unused" in text
    vertices, faces = read_polygons(path)
    faces, used = drop_unused(faces, len(vertices))
    mesh = PolyMesh.of(vertices[used], faces)
    assert mesh.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def test_read_polygons_checks_no_topology(data_folder: Path) -> None:
    vertices, faces = read_polygons(data_folder / "joined_tetrahedra.obj")
    assert (len(vertices), len(faces)) == (5, 8)


def test_every_refusal_says_what_to_do(tmp_path: Path) -> None:
    # The template: what must hold; what was found; what to do, as sentences.
    for name, content in {
        "a.obj": b"v 0 0\nf 1 2 3\n",
        "a.off": b"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "a.ply": b"ply\nformat ascii 1.0\nend_header\n",
    }.items():
        (tmp_path / name).write_bytes(content)
        assert re.search(r": .* must .*[;:] .*\. [A-Z].*\.$", refusal(tmp_path / name))
