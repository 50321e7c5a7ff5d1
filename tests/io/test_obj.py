"""Wavefront OBJ."""

import time

import numpy as np
import pytest

from pqmesh.errors import FormatError
from pqmesh.io.obj import obj_from_mesh, polygons_from_obj
from pqmesh.mesh.quadmesh import QuadMesh

SQUARE = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def faces(text: bytes) -> list[list[int]]:
    return polygons_from_obj(text).face_lists()


@pytest.mark.parametrize(
    "line",
    [
        b"f 1 2 3 4",
        b"f 1/1 2/1 3/1 4/1",
        b"f 1//7 2//7 3//7 4//7",
        b"f 1/5/7 2/5/7 3/5/7 4/5/7",
        b"f -4 -3 -2 -1",
        b"f -4/-1/-1 -3/-1/-1 3/1/1 -1/-1/-1",
        b"\tf  1\t2   3 4  ",
        b"f 1 2 3 4 # the roof",
        b"f 1 2 \\\n3 4",
        b"f 1 \\\r\n2 \\\r\n3 \\  \r\n4",
        b"f \\\n1 2 3 4\\",
    ],
)
def test_face_may_be_written_in_every_way(line: bytes) -> None:
    assert faces(SQUARE + line) == [[0, 1, 2, 3]]
    assert faces(SQUARE + line + b"\n") == [[0, 1, 2, 3]]


def test_negative_indices_count_from_where_they_stand() -> None:
    text = (
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\nf 1 2 -1\n"
    )
    assert faces(text) == [[0, 1, 2], [3, 4, 5], [0, 1, 5]]


def test_positive_index_may_come_before_its_vertex() -> None:
    assert faces(b"f 1 2 3 4\n" + SQUARE) == [[0, 1, 2, 3]]


def test_triangles_and_polygons_survive() -> None:
    text = SQUARE + b"v 2 0 0\nv 3 1 0\nv 2 2 0\nf 1 2 3 4\nf 2 5 3\nf 5 6 7 3 2\n"
    assert faces(text) == [[0, 1, 2, 3], [1, 4, 2], [4, 5, 6, 2, 1]]


@pytest.mark.parametrize("extra", [b" 1.0", b" 0.5 0.5 0.5", b" 1 0.5 0.5 0.5"])
def test_weights_and_colors_are_read_over(extra: bytes) -> None:
    text = SQUARE.replace(b"\n", extra + b"\n", 2) + b"f 1 2 3 4\n"
    polygons = polygons_from_obj(text)
    assert polygons.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


def test_other_statements_are_read_over() -> None:
    head = "\ufeff# café\nmtllib a.mtl\no roof\ng a b\ns off\nusemtl a\n"
    head += "vt 0 0\nvn 0 0 1\nvp 1\nl 1 2\np 1\n"
    assert faces(head.encode() + SQUARE + b"f 1 2 3 4\n") == [[0, 1, 2, 3]]


def test_comment_that_ends_in_backslash_continues_nothing() -> None:
    assert faces(b"# C:\\roof\\\n" + SQUARE + b"f 1 2 3 4 # C:\\\nf 3 2 1\n") == [
        [0, 1, 2, 3],
        [2, 1, 0],
    ]


def test_numbers_are_written_with_17_digits() -> None:
    mesh = QuadMesh.of([[0.1, 0, 0], [1, 0, 0], [1, 1 / 3, 0], [0, 1, -0.0]], [[0, 1, 2, 3]])
    assert obj_from_mesh(mesh).decode() == (
        "# Written by pqmesh: 4 vertices, 1 faces\n"
        "v 0.10000000000000001 0 0\nv 1 0 0\nv 1 0.33333333333333331 0\nv 0 1 -0\nf 1 2 3 4\n"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            SQUARE + b"f 0 1 2\n",
            "Line 5: a face must index vertices 1..4, or count back from -1; found 0.",
        ),
        (SQUARE + b"f 1 2 5\n", "Line 5: .* found 5. Mend the index"),
        (
            SQUARE + b"f 1 2 99999999999999999999\n",
            "Line 5: .* whole number; found '99999999999999999999'",
        ),
        (
            b"v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n",
            "Line 3: .* found -3 with 2 vertices above it",
        ),
        (SQUARE + b"f 1 2\n", "Line 5: a face must have at least 3 corners; found 2"),
        (SQUARE + b"f\n", "Line 5: a face must have at least 3 corners; found 0"),
        (SQUARE + b"f 1 2 x\n", "Line 5: .* must be a whole number; found 'x'"),
        (SQUARE + b"f 1 2 3.0\n", "Line 5: .* must be a whole number; found '3.0'"),
        (SQUARE + b"f 1 2 /3\n", "Line 5: .* must be a whole number; found ''"),
        (SQUARE + b"f 1 \\\n2 \\\nx\n", "Line 5: .* must be a whole number; found 'x'"),
        (b"# a\nv 0 0\nf 1 2 3\n", "Line 2: a vertex must have 3 coordinates .* found 2 numbers"),
        (b"v\nf 1 2 3\n", "Line 1: a vertex must have 3 coordinates .* found 0 numbers"),
        (b"v 0 0 0 0 0\nf 1 2 3\n", "Line 1: .* found 5 numbers"),
        (b"v 0 0 0 red\nf 1 1 1\n", "Line 1: .* finite number; found 'red'"),
        (SQUARE, "must have vertices .'v'. and faces .'f'.; found 4 and 0. Export polygons"),
        (b"f 1 2 3\n", "found 0 and 1"),
        (b"OFF\n4 1 0\n", "Line 1: a line must begin with an OBJ statement .* found 'OFF'"),
        (
            SQUARE + b"surf 0 1 0 1 1 2 3 4\n",
            "Line 5: .* free-form statement 'surf'. Export the surface",
        ),
    ],
)
def test_refusal_names_line(text: bytes, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        polygons_from_obj(text)


def test_quoted_word_is_kept_short() -> None:
    with pytest.raises(FormatError) as caught:
        polygons_from_obj(b"v 0 0 " + b"9x" * 10000 + b"\nf 1 2 3\n")
    assert len(str(caught.value)) < 200


def test_large_file_is_read_in_reasonable_time() -> None:
    n = 150
    grid = np.arange(n * n).reshape(n, n)
    quads = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], axis=-1)
    points = np.random.default_rng(1).normal(size=(n * n, 3))
    data = obj_from_mesh(QuadMesh.of(points, quads.reshape(-1, 4)))
    start = time.perf_counter()
    polygons = polygons_from_obj(data)
    # About 0.1 s here; the bound only catches quadratic time.
    assert time.perf_counter() - start < 3.0
    assert np.array_equal(polygons.vertices, points)
