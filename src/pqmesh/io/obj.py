"""Wavefront OBJ, and what the text formats share: lines, numbers, polygons as flat arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pqmesh.errors import FormatError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Faces
from pqmesh.vectors import Floats, Indices

LineOf = Callable[[int], int]

# Statements without a say in where the polygons are.
_IGNORED = {"vn", "vt", "vp", "g", "o", "s", "mg", "l", "p", "usemtl", "mtllib", "usemap"} | {
    *("maplib", "bevel", "c_interp", "d_interp", "lod", "shadow_obj", "trace_obj")
}
_FREE_FORM = {"cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim", "hole"} | {
    *("scrv", "sp", "end", "con", "bzp", "bsp", "cdc", "cdp", "res")
}


class Polygons(NamedTuple):
    """What a file says, before anything is checked about the mesh as a whole.

    Attributes
    ----------
    vertices : (V, 3), unit of the file
    indices : (C,)
        Corners of all faces, one face after the other, counted from 0.
    sizes : (F,)
        Corners of each face.
    """

    vertices: Floats
    indices: Indices
    sizes: Indices

    @property
    def faces(self) -> Faces:
        """Faces as `Topology` takes them: one array when they are alike, else lists."""
        if len(self.sizes) and (self.sizes == self.sizes[0]).all():
            return self.indices.reshape(len(self.sizes), -1)
        return self.face_lists()

    def face_lists(self) -> list[list[int]]:
        """Faces as plain lists."""
        ends = np.cumsum(self.sizes).tolist()
        flat = self.indices.tolist()
        return [flat[end - size : end] for end, size in zip(ends, self.sizes.tolist(), strict=True)]


def polygons_from_obj(data: bytes) -> Polygons:
    r"""Polygons of an OBJ file: its `v` and `f` statements, checked line by line.

    Texture and normal references, colours and weights after the coordinates, and groups,
    materials, lines and points are read over. Free-form statements are refused.

    Parameters
    ----------
    data : bytes
        UTF-8 text with any line ends.

    Raises
    ------
    FormatError
        Naming the line.

    References: Wavefront, Advanced Visualizer manual, appendix B1, "Object files".

    Examples
    --------
    >>> polygons_from_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3/1 2/1 \\\n3/1\n").face_lists()
    [[0, 1, 2]]
    """
    # Lines stay whole until they are split all at once: many small lists are slow.
    points: list[str] = []
    point_lines: list[int] = []
    corners: list[str] = []
    corner_lines: list[int] = []
    points_before: list[int] = []
    for number, line in _statements(data):
        keyword, *rest = line.split(None, 1) or [""]
        if keyword == "v":
            points.extend(rest or [""])
            point_lines.append(number)
        elif keyword == "f":
            corners.extend(rest or [""])
            corner_lines.append(number)
            points_before.append(len(points))
        elif keyword and keyword not in _IGNORED:
            raise FormatError(_unknown_statement(number, keyword))
    if not points or not corners:
        raise FormatError(
            f"A mesh must have vertices ('v') and faces ('f'); found {len(points)} and "
            f"{len(corners)}. Export polygons, not curves or surfaces."
        )
    vertices = _coordinates(points, point_lines)
    sizes = word_counts(corners)
    indices = _corner_indices(corners, sizes, corner_lines, points_before, len(points))
    return Polygons(vertices, indices, sizes)


def obj_from_mesh(mesh: PolyMesh) -> bytes:
    r"""OBJ text of a mesh: 17 significant digits, so reading it gives the same doubles.

    Parameters
    ----------
    mesh : PolyMesh

    Examples
    --------
    >>> triangle = PolyMesh.of([[0, 0, 0], [1, 0, 0], [0, 0.5, 0]], [[0, 1, 2]])
    >>> print(obj_from_mesh(triangle).decode())
    # Written by pqmesh: 3 vertices, 1 faces
    v 0 0 0
    v 1 0 0
    v 0 0.5 0
    f 1 2 3
    """
    topology = mesh.topology
    return "".join(
        [
            f"# Written by pqmesh: {topology.n_vertices} vertices, {topology.n_faces} faces\n",
            text_rows("v %.17g %.17g %.17g\n", mesh.vertices),
            text_faces("f", topology.indices + 1, topology.face_sizes),
        ]
    ).encode("ascii")


# --- statements -----------------------------------------------------------------------------


def _statements(data: bytes) -> Iterator[tuple[int, str]]:
    """Statements without comments, continued lines joined, with the number of their first line."""
    lines = text_lines(data)
    # Comments go first: a path in a comment may end in a backslash without continuing anything.
    lines = [line.partition("#")[0] if "#" in line else line for line in lines]
    if not any("\\" in line for line in lines):
        yield from enumerate(lines, start=1)
        return
    parts: list[str] = []
    for number, line in enumerate(lines, start=1):
        parts.append(line.rstrip())
        if parts[-1].endswith("\\"):
            parts[-1] = parts[-1][:-1]
            continue
        yield number - len(parts) + 1, " ".join(parts)
        parts.clear()
    if parts:
        yield len(lines) - len(parts) + 1, " ".join(parts)


def _unknown_statement(number: int, keyword: str) -> str:
    """What to say about a statement that is not read."""
    if keyword in _FREE_FORM:
        return (
            f"Line {number}: faces must be polygons; found the free-form statement '{keyword}'. "
            f"Export the surface as a polygon mesh."
        )
    return (
        f"Line {number}: a line must begin with an OBJ statement such as 'v' or 'f'; found "
        f"{shown(keyword)}. Mend the line, or check that the file is an OBJ file."
    )


def _coordinates(points: list[str], lines: list[int]) -> Floats:
    """First three numbers of each vertex; what follows must be numbers too."""
    sizes = word_counts(points)
    # x y z, then a weight, a colour, or both.
    wrong = np.flatnonzero(~np.isin(sizes, (3, 4, 6, 7)))
    if len(wrong):
        raise FormatError(
            f"Line {lines[wrong[0]]}: a vertex must have 3 coordinates (and at most a weight and a "
            f"colour of 3 numbers); found {sizes[wrong[0]]} numbers. Mend the line."
        )
    numbers = real_numbers(" ".join(points).split(), _line_of_word(sizes, lines))
    starts = np.cumsum(sizes) - sizes
    return np.asarray(numbers[starts[:, None] + np.arange(3)])


def _corner_indices(
    corners: list[str], sizes: Indices, lines: list[int], points_before: list[int], n_points: int
) -> Indices:
    """Indices from 0; a negative one counts back from the last vertex above its face."""
    short = np.flatnonzero(sizes < 3)
    if len(short):
        raise FormatError(
            f"Line {lines[short[0]]}: a face must have at least 3 corners; found "
            f"{sizes[short[0]]}. Mend or remove it."
        )
    words = " ".join(corners).split()
    if any("/" in line for line in corners):
        words = [word.partition("/")[0] for word in words]
    line_of = _line_of_word(sizes, lines)
    given = whole_numbers(words, line_of)
    before = np.repeat(np.array(points_before, dtype=np.int64), sizes)
    wrong = np.flatnonzero((given == 0) | (given > n_points) | (given < -before))
    if len(wrong):
        first = int(wrong[0])
        above = f" with {before[first]} vertices above it" if given[first] < 0 else ""
        raise FormatError(
            f"Line {line_of(first)}: a face must index vertices 1..{n_points}, or count back "
            f"from -1; found {given[first]}{above}. Mend the index, or check that no vertex "
            f"is missing."
        )
    return np.where(given > 0, given - 1, given + before)


def _line_of_word(sizes: Indices, lines: list[int]) -> LineOf:
    """Line of a word, where record i has sizes[i] words and stands on lines[i]."""
    return lambda word: lines[int(np.searchsorted(np.cumsum(sizes), word, side="right"))]


# --- shared by the text formats -------------------------------------------------------------


def text_lines(data: bytes) -> list[str]:
    """Lines of a UTF-8 text with any line ends; refuses what is not text."""
    if b"\0" in data:
        raise FormatError(
            f"Line {data.count(10, 0, data.index(0)) + 1}: the file must be text; found a zero "
            f"byte, as in binary files. Check the format, or export it as text."
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(10, 0, error.start) + 1
        raise FormatError(
            f"Line {line}: the text must be UTF-8; found byte 0x{data[error.start]:02x}. Save the "
            f"file as UTF-8, or check that it is a text file."
        ) from None
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def word_counts(lines: Sequence[str]) -> Indices:
    """Number of words on each line, shape (len(lines),)."""
    return np.array([len(line.split()) for line in lines], dtype=np.int64)


def real_numbers(words: Sequence[str], line_of: LineOf) -> Floats:
    """Finite numbers of the words, shape (len(words),)."""
    try:
        values = np.array([float(word) for word in words], dtype=np.float64)
    except ValueError:
        values = np.full(len(words), np.nan)
    if _are_plain(words) and np.isfinite(values).all():
        return values
    first = next(i for i, word in enumerate(words) if not _is_finite_number(word))
    raise FormatError(
        f"Line {line_of(first)}: a coordinate must be a finite number; found "
        f"{shown(words[first])}. Mend or remove it."
    )


def whole_numbers(words: Sequence[str], line_of: LineOf) -> Indices:
    """64-bit integers of the words, shape (len(words),)."""
    try:
        if _are_plain(words):
            return np.array([int(word) for word in words], dtype=np.int64)
    except (ValueError, OverflowError):
        pass
    first = next(i for i, word in enumerate(words) if not _is_index(word))
    raise FormatError(
        f"Line {line_of(first)}: an index or a count must be a whole number; found "
        f"{shown(words[first])}. Mend it."
    )


def shown(word: str) -> str:
    """A word of a file as a message may quote it: short and printable."""
    return repr(word if len(word) <= 40 else word[:37] + "...")


def text_rows(row: str, values: Floats) -> str:
    """The row format filled with each row of values."""
    return (row * len(values)) % tuple(values.ravel().tolist())


def text_faces(start: str | None, indices: Indices, sizes: Indices) -> str:
    """One line for each face, begun with `start` or else with its number of corners."""
    flat = indices.tolist()
    rows: list[str] = []
    position = 0
    for size in sizes.tolist():
        corners = " ".join(map(str, flat[position : position + size]))
        rows.append(f"{start or size} {corners}\n")
        position += size
    return "".join(rows)


def _are_plain(words: Sequence[str]) -> bool:
    """Whether Python's own liberties with numbers, 1_000 and non-ASCII digits, are absent."""
    joined = "".join(words)
    return joined.isascii() and "_" not in joined


def _is_finite_number(word: str) -> bool:
    """Whether a word is a finite number in plain ASCII."""
    try:
        return _are_plain([word]) and math.isfinite(float(word))
    except ValueError:
        return False


def _is_index(word: str) -> bool:
    """Whether a word is an integer of 64 bits in plain ASCII."""
    try:
        return _are_plain([word]) and -(2**63) <= int(word) < 2**63
    except ValueError:
        return False
