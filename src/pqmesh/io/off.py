"""OFF, the object file format of Geomview, as text: faces on lines of their own or broken."""

from __future__ import annotations

import re

import numpy as np

from pqmesh.errors import FormatError
from pqmesh.io.obj import (
    Polygons,
    real_numbers,
    shown,
    text_faces,
    text_lines,
    text_rows,
    whole_numbers,
    word_counts,
)
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices

# Line number and text; empty lines and comments are left out. Lines stay whole until they are
# split all at once: many small lists are slow.
Row = tuple[int, str]

_KEYWORD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF")


def polygons_from_off(data: bytes) -> Polygons:
    r"""Polygons of an OFF file.

    Line ends mean nothing in OFF, so records broken over lines are understood; colours of
    faces only where each face has a line of its own. Normals, colours and texture coordinates
    of vertices (NOFF, COFF, STOFF) are read over. The keyword may be missing.

    Parameters
    ----------
    data : bytes
        UTF-8 text with any line ends.

    Raises
    ------
    FormatError
        Naming the line; for a file cut short, with the promised and the found counts; for
        four or n dimensions; for indices that count from 1.

    References: Geomview manual, "OFF: vertices and faces".

    Examples
    --------
    >>> polygons_from_off(b"OFF 3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").face_lists()
    [[0, 1, 2]]
    """
    rows = [
        (number, text)
        for number, line in enumerate(text_lines(data), start=1)
        if (text := line.partition("#")[0].strip())
    ]
    widths, rows = _keyword(rows)
    line, n_vertices, n_faces, rows = _counts(rows)
    promise = f"the counts on line {line}"
    vertices, rows = _vertices(rows, n_vertices, n_faces, widths, promise)
    indices, sizes, lines = _faces(rows, n_faces, promise)
    _check_range(indices, sizes, lines, n_vertices)
    return Polygons(vertices, indices, sizes)


def off_from_mesh(mesh: PolyMesh) -> bytes:
    r"""OFF text of a mesh: 17 significant digits, so reading it gives the same doubles.

    Parameters
    ----------
    mesh : PolyMesh

    Examples
    --------
    >>> triangle = PolyMesh.of([[0, 0, 0], [1, 0, 0], [0, 0.5, 0]], [[0, 1, 2]])
    >>> print(off_from_mesh(triangle).decode())
    OFF
    # Written by pqmesh
    3 1 3
    0 0 0
    1 0 0
    0 0.5 0
    3 0 1 2
    """
    topology = mesh.topology
    return "".join(
        [
            "OFF\n# Written by pqmesh\n",
            f"{topology.n_vertices} {topology.n_faces} {topology.n_edges}\n",
            text_rows("%.17g %.17g %.17g\n", mesh.vertices),
            text_faces(None, topology.indices, topology.face_sizes),
        ]
    ).encode("ascii")


# --- head -----------------------------------------------------------------------------------


def _keyword(rows: list[Row]) -> tuple[tuple[int, ...], list[Row]]:
    """Possible numbers on a vertex by the keyword, and the rows behind the keyword."""
    if not rows:
        raise FormatError("The file must hold a mesh; it has no numbers. Export it again.")
    number, text = rows[0]
    keyword, *rest = text.split(None, 1)
    if keyword.isdecimal():
        return (3,), rows
    match = _KEYWORD.fullmatch(keyword)
    if match is None:
        raise FormatError(
            f"Line {number}: the file must begin with OFF; found {shown(keyword)}. Check that it "
            f"is an OFF file."
        )
    texture, color, normal, four, several = match.groups()
    if four or several or rest[:1] == ["BINARY"]:
        raise FormatError(
            f"Line {number}: OFF must be text in 3 dimensions; found {shown(text)}. Export it as "
            f"plain OFF."
        )
    width = 3 + (3 if normal else 0) + (2 if texture else 0)
    widths = (width + 3, width + 4) if color else (width,)
    return widths, [*((number, line) for line in rest), *rows[1:]]


def _counts(rows: list[Row]) -> tuple[int, int, int, list[Row]]:
    """Line, vertex and face counts, and the rows behind them."""
    used, words = 0, list[str]()
    while len(words) < 3 and used < len(rows):
        words += rows[used][1].split(None, 2 - len(words))
        used += 1
    if len(words) < 3:
        raise FormatError(
            "The counts of vertices, faces and edges must follow OFF; the file ends there. "
            "Export it again."
        )
    number = rows[used - 1][0]
    edges, *rest = words[2].split(None, 1)
    for word in (*words[:2], edges):
        if not (word.isascii() and word.isdecimal()):
            raise FormatError(
                f"Line {number}: the counts of vertices, faces and edges must stand here, three "
                f"whole numbers; found {shown(' '.join([*words[:2], edges]))}. Mend the line."
            )
    counts = whole_numbers(words[:2], lambda _: number)
    left = [*((number, text) for text in rest), *rows[used:]]
    return number, int(counts[0]), int(counts[1]), left


# --- vertices -------------------------------------------------------------------------------


def _vertices(
    rows: list[Row], count: int, n_faces: int, widths: tuple[int, ...], promise: str
) -> tuple[Floats, list[Row]]:
    """Positions, and the rows behind the vertices."""
    if not count:
        raise FormatError(f"A mesh must have vertices; {promise} give none. Export it again.")
    if not rows:
        raise FormatError(_cut_short(0, count, "vertices", promise))
    n_words = len(rows[0][1].split())
    if n_words in widths:
        return _vertices_on_lines(rows, count, widths, promise)
    own_lines = len(rows) == count + n_faces and len(set(_sizes(rows[:count]).tolist())) == 1
    if len(widths) > 1 or (own_lines and n_words > widths[0]):
        raise FormatError(
            f"Line {rows[0][0]}: a vertex must have {_either(widths)} numbers on its line by the "
            f"keyword; found {n_words}. Mend the keyword (COFF has colours, NOFF normals), or "
            f"export plain OFF."
        )
    return _vertices_of_words(rows, count, widths[0], promise)


def _vertices_on_lines(
    rows: list[Row], count: int, widths: tuple[int, ...], promise: str
) -> tuple[Floats, list[Row]]:
    """Vertices with a line each."""
    chosen = rows[:count]
    sizes = _sizes(chosen)
    wrong = np.flatnonzero(~np.isin(sizes, widths))
    if len(wrong):
        raise FormatError(
            f"Line {chosen[wrong[0]][0]}: a vertex must have {_either(widths)} numbers; found "
            f"{sizes[wrong[0]]}. Mend the line, or {promise}."
        )
    if len(chosen) < count:
        raise FormatError(_cut_short(len(chosen), count, "vertices", promise))
    words, lines = _flat(chosen)
    places = (np.cumsum(sizes) - sizes)[:, None] + np.arange(3)
    flat = places.ravel().tolist()
    values = real_numbers([words[i] for i in flat], lambda i: lines[flat[i]])
    return values.reshape(-1, 3), rows[count:]


def _vertices_of_words(
    rows: list[Row], count: int, width: int, promise: str
) -> tuple[Floats, list[Row]]:
    """Vertices broken over lines in any way."""
    words, lines = _flat(rows)
    needed = count * width
    if len(words) < needed:
        raise FormatError(_cut_short(len(words) // width, count, "vertices", promise))
    values = real_numbers(words[:needed], lines.__getitem__)
    rest: list[Row] = []
    position = 0
    for number, text in rows:
        row = text.split()
        position += len(row)
        if position > needed:
            rest.append((number, " ".join(row[max(0, len(row) - (position - needed)) :])))
    return values.reshape(-1, width)[:, :3], rest


# --- faces ----------------------------------------------------------------------------------


def _faces(rows: list[Row], count: int, promise: str) -> tuple[Indices, Indices, list[int]]:
    """Corners, sizes, and the line of each corner."""
    if not count:
        raise FormatError(f"A mesh must have faces; {promise} give none. Export it again.")
    if not rows:
        raise FormatError(_cut_short(0, count, "faces", promise))
    if len(rows) == count and all(_is_record(text) for _, text in rows):
        return _faces_on_lines(rows)
    try:
        return _faces_of_words(rows, count, promise)
    except FormatError:
        # The file means one face a line when it begins so: then say what is wrong with that.
        if _is_record(rows[0][1]):
            _refuse_lines(rows, count, promise)
        raise


def _is_record(text: str) -> bool:
    """Whether a line is one face: a count, that many indices, then 0, 1, 3 or 4 of colour."""
    words = text.split()
    return (
        len(words[0]) < 10
        and words[0].isascii()
        and words[0].isdecimal()
        and int(words[0]) > 0
        and len(words) - 1 - int(words[0]) in (0, 1, 3, 4)
    )


def _faces_on_lines(rows: list[Row]) -> tuple[Indices, Indices, list[int]]:
    """Faces with a line each; colours are read over."""
    words, lines = _flat(rows)
    lengths = _sizes(rows)
    starts = np.cumsum(lengths) - lengths
    sizes = np.array([int(words[i]) for i in starts.tolist()], dtype=np.int64)
    place = np.arange(len(words)) - np.repeat(starts, lengths)
    is_corner = (place > 0) & (place <= np.repeat(sizes, lengths))
    kept = np.flatnonzero(is_corner).tolist()
    colors = np.flatnonzero(place > np.repeat(sizes, lengths)).tolist()
    real_numbers([words[i] for i in colors], lambda i: lines[colors[i]])
    corner_lines = [lines[i] for i in kept]
    return whole_numbers([words[i] for i in kept], corner_lines.__getitem__), sizes, corner_lines


def _faces_of_words(
    rows: list[Row], count: int, promise: str
) -> tuple[Indices, Indices, list[int]]:
    """Faces broken over lines in any way; colours cannot be told apart and are refused."""
    words, lines = _flat(rows)
    values = whole_numbers(words, lines.__getitem__)
    flat = values.tolist()
    sizes: list[int] = []
    heads: list[int] = []
    position = 0
    while len(sizes) < count:
        size = flat[position] if position < len(flat) else 0
        if position >= len(flat) or size > len(flat) - position - 1:
            raise FormatError(_cut_short(len(sizes), count, "faces", promise))
        if size < 1:
            raise FormatError(
                f"Line {lines[position]}: the number of corners of face {len(sizes)} must stand "
                f"here; found {size}. Mend the line."
            )
        heads.append(position)
        sizes.append(size)
        position += size + 1
    if position < len(flat):
        raise FormatError(_too_much(lines[position], words[position], count, promise))
    is_corner = np.ones(len(flat), dtype=np.bool_)
    is_corner[heads] = False
    kept = np.flatnonzero(is_corner)
    return values[kept], np.array(sizes, dtype=np.int64), [lines[i] for i in kept.tolist()]


def _refuse_lines(rows: list[Row], count: int, promise: str) -> None:
    """Raise what is wrong with rows that should each hold one face."""
    for number, text in rows[:count]:
        if not _is_record(text):
            raise FormatError(
                f"Line {number}: a face must be its number of corners, that many indices and at "
                f"most a colour; found {shown(text)}. Mend the line."
            )
    if len(rows) < count:
        raise FormatError(_cut_short(len(rows), count, "faces", promise))
    raise FormatError(_too_much(*rows[count], count, promise))


# --- messages and checks --------------------------------------------------------------------


def _sizes(rows: list[Row]) -> Indices:
    """Number of words of each row."""
    return word_counts([text for _, text in rows])


def _flat(rows: list[Row]) -> tuple[list[str], list[int]]:
    """All words, and the line of each."""
    words = " ".join([text for _, text in rows]).split()
    numbers = np.array([number for number, _ in rows], dtype=np.int64)
    return words, np.repeat(numbers, _sizes(rows)).tolist()


def _either(widths: tuple[int, ...]) -> str:
    """The possible widths in words."""
    return " or ".join(map(str, widths))


def _cut_short(found: int, expected: int, what: str, promise: str) -> str:
    """What to say where the file ends too early."""
    return (
        f"The file must hold {expected} {what} by {promise}; it ends after {found}. It is cut "
        f"short: copy or export it again, or mend the counts."
    )


def _too_much(line: int, text: str, count: int, promise: str) -> str:
    """What to say where the file goes on too long."""
    return (
        f"Line {line}: nothing may follow the last of {count} faces by {promise}; found "
        f"{shown(text)}. Mend the counts, or remove the rest; colours of faces are understood "
        f"only with one face a line."
    )


def _check_range(indices: Indices, sizes: Indices, lines: list[int], n_vertices: int) -> None:
    """Refuse indices outside 0..n_vertices-1."""
    wrong = np.flatnonzero((indices < 0) | (indices >= n_vertices))
    if not len(wrong):
        return
    if indices.min() == 1 and indices.max() == n_vertices:
        raise FormatError(
            f"Faces must index vertices 0..{n_vertices - 1}; they index 1..{n_vertices}, so the "
            f"file looks 1-based ({len(wrong)} corners point past the last vertex, the first on "
            f"line {lines[wrong[0]]}). Subtract 1 from every face index, or export the mesh as "
            f"OBJ, which counts from 1."
        )
    first = int(wrong[0])
    face = int(np.searchsorted(np.cumsum(sizes), first, side="right"))
    raise FormatError(
        f"Line {lines[first]}: faces must index vertices 0..{n_vertices - 1}; face {face} has "
        f"vertex {indices[first]}. Mend the index, or check that no vertex is missing."
    )
