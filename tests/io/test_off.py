"""OFF."""

import pytest

from pqmesh.errors import FormatError
from pqmesh.io.off import polygons_from_off

POINTS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n2 0.5 0\n"
FACES = "4 0 1 2 3\n3 1 4 2\n"
WANTED = [[0, 1, 2, 3], [1, 4, 2]]
PLAIN = f"OFF\n5 2 0\n{POINTS}{FACES}"


def faces(text: str) -> list[list[int]]:
    polygons = polygons_from_off(text.encode())
    assert polygons.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0]]
    return polygons.face_lists()


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        f"5 2 0\n{POINTS}{FACES}",
        f"OFF 5 2 0\n{POINTS}{FACES}",
        f"OFF 5 2 0 {POINTS}{FACES}".replace("\n", " "),
        PLAIN.replace(" ", "\n"),
        PLAIN.replace("\n", "\n\n"),
        PLAIN.replace("\n", " # a comment 1 2 3\n"),
        f"# first\n\nOFF\n# second\n5 2 0\n{POINTS}# third\n{FACES}\n# last",
        f"OFF\n5 2 0\n{POINTS}4 0 1\n2 3\n3 1\n\n4 2",
        f"OFF\n5 2 0\n{POINTS}4 0 1 2 3 3 1 4 2",
        f"OFF\n5 2 0\n{POINTS.replace(chr(10), ' ')}\n{FACES}",
    ],
)
def test_line_ends_and_comments_mean_nothing(text: str) -> None:
    assert faces(text) == WANTED
    assert faces(text.replace("\n", "\r\n")) == WANTED


@pytest.mark.parametrize(
    ("first", "second"),
    [("7", ""), ("255 0 0", "0 255 0"), ("0.5 0.5 0.5 1", "0.1 0.2 0.3 0.4"), ("", "1 0 0")],
)
def test_colors_of_faces_are_read_over(first: str, second: str) -> None:
    assert faces(f"OFF\n5 2 0\n{POINTS}4 0 1 2 3 {first}\n3 1 4 2 {second}\n") == WANTED


@pytest.mark.parametrize(
    ("keyword", "extra"),
    [
        ("NOFF", "0 0 1"),
        ("COFF", "255 0 0 255"),
        ("COFF", "0.1 0.2 0.3"),
        ("STOFF", "0.5 0.5"),
        ("CNOFF", "0 0 1 1 1 1 1"),
        ("STCNOFF", "0 0 1 1 1 1 1 0 0"),
    ],
)
def test_normals_and_colors_of_vertices_are_read_over(keyword: str, extra: str) -> None:
    points = POINTS.replace("\n", f" {extra}\n")
    assert faces(f"{keyword}\n5 2 0\n{points}{FACES}") == WANTED


def test_two_triangles_on_a_line_are_not_a_colored_one() -> None:
    text = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2 3 0 2 3\n"
    assert polygons_from_off(text.encode()).face_lists() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# only\n", "The file must hold a mesh; it has no numbers"),
        ("solid roof\n", "Line 1: the file must begin with OFF; found 'solid'"),
        ("4OFF\n5 2 0\n", "Line 1: OFF must be text in 3 dimensions; found '4OFF'"),
        ("nOFF\n3\n5 2 0\n", "Line 1: OFF must be text in 3 dimensions; found 'nOFF'"),
        ("OFF BINARY\n", "Line 1: OFF must be text in 3 dimensions; found 'OFF BINARY'"),
        ("OFF\n", "counts of vertices, faces and edges must follow OFF; the file ends there"),
        ("OFF\n5 2\n", "counts of vertices, faces and edges must follow OFF; the file ends there"),
        ("OFF\n5 -2 0\n", "Line 2: the counts .* found '5 -2 0'"),
        ("OFF\n5 2.5 0\n", "Line 2: the counts .* found '5 2.5 0'"),
        ("OFF\n0 2 0\n", "A mesh must have vertices; the counts on line 2 give none"),
        (f"OFF\n5 0 0\n{POINTS}", "A mesh must have faces; the counts on line 2 give none"),
        (
            "OFF\n5 2 0\n0 0 0\n1 0 0\n",
            "must hold 5 vertices by the counts on line 2; it ends after 2",
        ),
        (
            "OFF\n5 2 0\n0 0 0 1 0 0\n1 1\n",
            "must hold 5 vertices .* it ends after 2. It is cut short",
        ),
        ("OFF\n5 2 0\n", "must hold 5 vertices by the counts on line 2; it ends after 0"),
        (f"OFF\n5 2 0\n{POINTS}", "must hold 2 faces by the counts on line 2; it ends after 0"),
        (
            f"OFF\n5 3 0\n{POINTS}{FACES}",
            "must hold 3 faces by the counts on line 2; it ends after 2",
        ),
        (f"OFF\n5 3 0\n{POINTS}4 0 1\n2 3 3 1", "must hold 3 faces .* it ends after 1"),
        (f"OFF\n5 2 0\n{POINTS}4 0 1 2 3\n3 1 4", "Line 9: a face must be its number .* '3 1 4'"),
        (
            f"OFF\n5 1 0\n{POINTS}{FACES}",
            "Line 9: nothing may follow the last of 1 faces .* '3 1 4 2'",
        ),
        (f"OFF\n5 1 0\n{POINTS}4 0 1\n2 3 9", "Line 9: nothing may follow the last of 1 faces"),
        (f"OFF\n5 1 0\n{POINTS}0 1\n2 3 9", "Line 8: the number of corners of face 0 .* found 0"),
        (
            f"OFF\n5 1 0\n{POINTS}4 0 1 2 5\n",
            "Line 8: faces must index vertices 0..4; face 0 has vertex 5",
        ),
        (f"OFF\n5 2 0\n{POINTS}4 0 1 2 3\n3 1 4 -2\n", "Line 9: .* 0..4; face 1 has vertex -2"),
        (f"OFF\n5 2 0\n{POINTS}4 0 1 2 3\n3 1 4 x\n", "Line 9: .* whole number; found 'x'"),
        (f"OFF\n5 2 0\n{POINTS}4 0 1 2 3 red\n3 1 4 2\n", "Line 8: .* finite number; found 'red'"),
        (f"OFF\n5 2 0\n{POINTS}4 1 2 3 4\n3 2 5 3\n", "they index 1..5, so the file looks 1-based"),
        (
            f"OFF\n6 2 0\n{POINTS}{FACES}",
            "Line 8: a vertex must have 3 numbers; found 5. Mend the line",
        ),
        (
            "OFF\n3 1 0\n0 0 0 1\n0 0 0 1\n0 0 0 1\n3 0 1 2\n",
            "Line 3: a vertex must have 3 numbers on its",
        ),
        (
            "COFF\n3 1 0\n0 0 0\n0 0 0\n0 0 0\n3 0 1 2\n",
            "Line 3: a vertex must have 6 or 7 numbers on",
        ),
        ("OFF\n1000000000000000000 1 0\n0 0 0\n", "must hold 1000000000000000000 vertices"),
        (f"OFF\n5 1000000000000000000 0\n{POINTS}{FACES}", "must hold 1000000000000000000 faces"),
        (f"OFF\n5 {'9' * 5000} 0\n{POINTS}{FACES}", "Line 2: .* whole number; found '9999"),
    ],
)
def test_refusal_says_what_is_missing_where(text: str, message: str) -> None:
    with pytest.raises(FormatError, match=message):
        polygons_from_off(text.encode())
