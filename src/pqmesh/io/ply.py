"""PLY, the Stanford polygon format: ASCII and binary of both byte orders."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pqmesh.errors import FormatError
from pqmesh.io.obj import (
    LineOf,
    Polygons,
    real_numbers,
    shown,
    text_faces,
    text_lines,
    text_rows,
    whole_numbers,
)
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Indices

_KINDS = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_AXES = ("x", "y", "z")
_CORNER_NAMES = ("vertex_indices", "vertex_index")


class _Property(NamedTuple):
    """One property: its name, NumPy kind, and the kind of its list count (empty: no list)."""

    name: str
    kind: str
    count_kind: str


@dataclass(frozen=True)
class _Element:
    """One element of the header, for example the vertices."""

    name: str
    count: int
    properties: list[_Property]

    @property
    def is_fixed(self) -> bool:
        """Whether every record has the same length by the header alone."""
        return not any(p.count_kind for p in self.properties)


class _Column(NamedTuple):
    """Values of one property over all records; sizes are those of its lists."""

    values: NDArray[Any]
    sizes: Indices


Columns = Mapping[str, _Column]
# Reads the wanted properties of an element at a position; returns them and the next position.
ReadElement = Callable[[_Element, int, Sequence[str]], tuple[Columns, int]]


def polygons_from_ply(data: bytes) -> Polygons:
    r"""Polygons of a PLY file: x, y, z of its vertices and the index lists of its faces.

    Other elements and properties are read over. Sizes that the file promises are compared with
    what it holds before any memory is taken.

    Parameters
    ----------
    data : bytes

    Raises
    ------
    FormatError
        Naming the line of the header or of an ASCII body, or the element cut short.

    References: G. Turk, "The PLY polygon file format", 1994.

    Examples
    --------
    >>> head = "ply\nformat ascii 1.0\nelement vertex 3\n"
    >>> axes = "property float x\nproperty float y\nproperty float z\n"
    >>> faces = "element face 1\nproperty list uchar int vertex_index\nend_header\n"
    >>> body = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    >>> polygons_from_ply((head + axes + faces + body).encode()).face_lists()
    [[0, 1, 2]]
    """
    order, elements, start, n_lines = _header(data)
    corners = _check_elements(elements)
    wanted: dict[str, Sequence[str]] = {"vertex": _AXES, "face": (corners,)}
    position, length, read = (
        _binary_body(data, start, order) if order else _ascii_body(data[start:], n_lines)
    )
    found: dict[str, Columns] = {}
    for element in filter(lambda e: e.properties, elements):
        found[element.name], position = read(element, position, wanted.get(element.name, ()))
    if position < length:
        raise FormatError(
            f"Nothing may follow the elements of the header; found {length - position} more "
            f"{'bytes' if order else 'words'}. Mend the counts in the header, or export it again."
        )
    with np.errstate(invalid="ignore"):  # the mesh names a vertex that is not a number
        columns = [found["vertex"][axis].values.astype(np.float64) for axis in _AXES]
    points = np.stack(columns, axis=1)
    faces = found["face"][corners]
    return Polygons(points, faces.values.astype(np.int64), faces.sizes)


def ply_from_mesh(mesh: PolyMesh) -> bytes:
    r"""ASCII PLY of a mesh in doubles: 17 significant digits, so reading it gives the same.

    Parameters
    ----------
    mesh : PolyMesh

    Examples
    --------
    >>> triangle = PolyMesh.of([[0, 0, 0], [1, 0, 0], [0, 0.5, 0]], [[0, 1, 2]])
    >>> ply_from_mesh(triangle).decode().splitlines()[-4:]
    ['0 0 0', '1 0 0', '0 0.5 0', '3 0 1 2']
    """
    topology = mesh.topology
    count_type = "uchar" if topology.face_sizes.max() < 256 else "int"
    header = [
        "ply",
        "format ascii 1.0",
        "comment Written by pqmesh",
        f"element vertex {topology.n_vertices}",
        *(f"property double {axis}" for axis in _AXES),
        f"element face {topology.n_faces}",
        f"property list {count_type} int vertex_indices",
        "end_header\n",
    ]
    return "".join(
        [
            "\n".join(header),
            text_rows("%.17g %.17g %.17g\n", mesh.vertices),
            text_faces(None, topology.indices, topology.face_sizes),
        ]
    ).encode("ascii")


# --- header ---------------------------------------------------------------------------------


def _header(data: bytes) -> tuple[str, list[_Element], int, int]:
    """Byte order (empty: ASCII), elements, start of the body, and lines of the header."""
    # The header's own line end decides: a binary body may begin with a byte that looks like one.
    match = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if match is None:
        raise FormatError(
            f"Line 1: the file must begin with the line 'ply'; found "
            f"{shown(repr(data[:12])[2:-1])}. Check that it is a PLY file."
        )
    newline = match.group(1)
    end = re.search(re.escape(newline) + rb"end_header[ \t]*" + re.escape(newline), data)
    if end is None:
        raise FormatError(
            "The header must end with the line 'end_header'; there is none. The file is cut "
            "short or not PLY: export it again."
        )
    lines = data[: end.start()].decode("latin-1").split(newline.decode("ascii"))
    order = ""
    has_format = False
    elements: list[_Element] = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _ORDERS:
            order, has_format = _ORDERS[words[1]], True
        elif words[0] == "element" and len(words) == 3 and _is_count(words[2]):
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[0] == "property" and elements:
            elements[-1].properties.append(_property(words, number))
        else:
            raise FormatError(_bad_line(number, line))
    if not has_format:
        raise FormatError(
            f"The header must have a line 'format', with one of {', '.join(_ORDERS)}; it has "
            f"none. Export it again."
        )
    return order, elements, end.end(), len(lines) + 1


def _property(words: list[str], number: int) -> _Property:
    """One property line of the header."""
    if len(words) == 3 and words[1] in _KINDS:
        return _Property(words[2], _KINDS[words[1]], "")
    if len(words) == 5 and words[1] == "list" and words[2] in _KINDS and words[3] in _KINDS:
        count_kind, kind = _KINDS[words[2]], _KINDS[words[3]]
        if count_kind[0] != "f":
            return _Property(words[4], kind, count_kind)
    raise FormatError(_bad_line(number, " ".join(words)))


def _is_count(word: str) -> bool:
    """Whether a word is a plain whole number that is not absurdly long."""
    return word.isascii() and word.isdecimal() and len(word) < 20


def _bad_line(number: int, line: str) -> str:
    """What to say about a header line that cannot be understood."""
    return (
        f"Line {number}: a header line must be format, comment, element or property with known "
        f"types and counts; found {shown(line.strip())}. Mend the header, or export it again."
    )


def _check_elements(elements: list[_Element]) -> str:
    """Refuse a header without a polygon mesh; returns the name of the corner property."""
    for names in ([e.name for e in elements], *([p.name for p in e.properties] for e in elements)):
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise FormatError(
                f"Names in the header must differ; {shown(twice[0])} stands twice. Mend the header."
            )
    nothing = _Element("", 0, [])
    vertex = next((e for e in elements if e.name == "vertex"), nothing)
    face = next((e for e in elements if e.name == "face"), nothing)
    scalars = [p.name for p in vertex.properties if not p.count_kind]
    if not vertex.count or not all(axis in scalars for axis in _AXES):
        raise FormatError(
            f"The file must have vertices with x, y and z; found {vertex.count} with "
            f"{', '.join(map(shown, scalars)) or 'no numbers'}. Export it again."
        )
    lists = [p for p in face.properties if p.name in _CORNER_NAMES and p.count_kind]
    lists = [p for p in lists if p.kind[0] != "f"]
    if not face.count or len(lists) != 1:
        raise FormatError(
            f"The file must have faces with one list of integers {' or '.join(_CORNER_NAMES)}; "
            f"found {face.count} faces with {len(lists)} such lists. Export polygons (not points "
            f"or triangle strips)."
        )
    return lists[0].name


# --- ASCII ----------------------------------------------------------------------------------


def _ascii_body(body: bytes, n_lines: int) -> tuple[int, int, ReadElement]:
    """First position, length in words, and reader of an ASCII body."""
    # Empty lines stand for the header, so that lines count as in the file.
    rows = [line.split() for line in text_lines(b"\n" * n_lines + body)]
    words = list(chain.from_iterable(rows))

    def line_of(word: int) -> int:
        ends = np.cumsum([len(row) for row in rows])
        return 1 + int(np.searchsorted(ends, word, side="right"))

    def read(element: _Element, start: int, wanted: Sequence[str]) -> tuple[Columns, int]:
        sizes: dict[str, list[int]] = {}
        if element.is_fixed:
            places, end = _fixed_places(element, start, len(words))
        else:
            places, sizes, end = _list_places(element, start, words, line_of)
        columns = {}
        for name in wanted:
            # Only lists are wanted as integers.
            numbers = whole_numbers if name in sizes else real_numbers
            at = places[name]
            values = numbers([words[i] for i in at], _line_of_place(at, line_of))
            columns[name] = _Column(values, np.array(sizes.get(name, ()), dtype=np.int64))
        return columns, end

    return 0, len(words), read


def _line_of_place(places: Sequence[int], line_of: LineOf) -> LineOf:
    """Line of the word at the i-th place."""
    return lambda i: line_of(places[i])


def _fixed_places(
    element: _Element, start: int, length: int
) -> tuple[dict[str, Sequence[int]], int]:
    """Positions of the words of each property, and the end of the element."""
    width = len(element.properties)
    end = start + width * element.count
    if end > length:
        raise FormatError(_cut_short(element, (length - start) // width))
    return {p.name: range(start + i, end, width) for i, p in enumerate(element.properties)}, end


def _list_places(
    element: _Element, start: int, words: list[str], line_of: LineOf
) -> tuple[dict[str, Sequence[int]], dict[str, list[int]], int]:
    """The same for records with lists; also the list lengths."""
    places: dict[str, list[int]] = {p.name: [] for p in element.properties}
    sizes: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_kind}
    position = start
    # The loop ends with the words: every record of an element with a list takes at least one.
    for record in range(element.count):
        for p in element.properties:
            size = 1
            if position < len(words) and p.count_kind:
                if not _is_count(words[position]):
                    raise FormatError(
                        f"Line {line_of(position)}: the length of a list must stand here; found "
                        f"{shown(words[position])}. Mend the line, or export it again."
                    )
                size = int(words[position])
                sizes[p.name].append(size)
                position += 1
            elif p.count_kind:
                raise FormatError(_cut_short(element, record))
            if position + size > len(words):
                raise FormatError(_cut_short(element, record))
            places[p.name].extend(range(position, position + size))
            position += size
    return dict(places), sizes, position


# --- binary ---------------------------------------------------------------------------------


def _binary_body(data: bytes, start: int, order: str) -> tuple[int, int, ReadElement]:
    """First position, length in bytes, and reader of a binary body."""

    def read(element: _Element, start: int, wanted: Sequence[str]) -> tuple[Columns, int]:
        if not element.is_fixed:
            return _list_records(data, start, element, order, wanted)
        kinds = [(p.name, order + p.kind) for p in element.properties]
        records = _values(data, start, element.count, kinds)
        if records is None:
            raise FormatError(_cut_short(element, (len(data) - start) // np.dtype(kinds).itemsize))
        no_sizes = np.empty(0, dtype=np.int64)
        return {name: _Column(records[name], no_sizes) for name in wanted}, start + records.nbytes

    return start, len(data), read


def _list_records(
    data: bytes, start: int, element: _Element, order: str, wanted: Sequence[str]
) -> tuple[Columns, int]:
    """Columns of records with lists, one record after the other."""
    parts: dict[str, list[NDArray[Any]]] = {p.name: [] for p in element.properties}
    kinds = [(p.name, np.dtype(order + p.kind), p.count_kind) for p in element.properties]
    position = start
    # The loop ends with the data: every record of an element with a list takes some bytes.
    for record in range(element.count):
        for name, kind, count_kind in kinds:
            size = 1
            if count_kind:
                counts = _values(data, position, 1, order + count_kind)
                size = -1 if counts is None else int(counts[0])
                position += int(count_kind[1])
            values = _values(data, position, size, kind)
            if values is None:
                raise FormatError(_cut_short(element, record))
            position += values.nbytes
            if name in wanted:
                parts[name].append(values)
    return {
        name: _Column(
            np.concatenate(parts[name]), np.array([len(p) for p in parts[name]], dtype=np.int64)
        )
        for name in wanted
    }, position


def _values(data: bytes, start: int, count: int, kind: Any) -> NDArray[Any] | None:
    """View of `count` values, None where the data end before them or the count is negative."""
    dtype = np.dtype(kind)
    if count < 0 or start + count * dtype.itemsize > len(data):
        return None
    return (
        np.frombuffer(data, dtype=dtype, count=count, offset=start) if count else np.empty(0, dtype)
    )


def _cut_short(element: _Element, found: int) -> str:
    """What to say where the data of an element end, or make no sense, too early."""
    return (
        f"The file must hold {element.count} records of element {shown(element.name)} by its "
        f"header; it ends, or a list length makes no sense, after {found}. It is cut short or "
        f"damaged: copy or export it again."
    )
