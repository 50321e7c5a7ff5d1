"""Breps of trimmed NURBS faces for rhino3dm, which can read them but has no way to make them.

The Brep is written as the archive that `Brep.Decode` takes, in the layout of openNURBS: chunks of
a code, a length and a CRC-32 of the bytes that are the chunk's own, not those of chunks inside it.
"""

from __future__ import annotations

import base64
import struct
import uuid
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rhino3dm

# Codes of openNURBS for the chunks of an object, and its identifiers of classes.
OBJECT, IDENTIFIER, DATA, END = 0x00027FFA, 0x0002FFFB, 0x0002FFFC, 0x80027FFF
ANONYMOUS = 0x40008000
CURVE = uuid.UUID("4ed7d4dd-e947-11d3-bfe5-0010830122f0")
SURFACE = uuid.UUID("4ed7d4de-e947-11d3-bfe5-0010830122f0")
BREP = uuid.UUID("60b5dbc5-e660-11d3-bfe4-0010830122f0")
NOT_ISO, WEST, SOUTH, EAST, NORTH = 0, 3, 4, 5, 6
BOUNDARY, MATED = 1, 2
OUTER, INNER = 1, 2


@dataclass(frozen=True, eq=False)
class Curve:
    """A polynomial spline curve: full knots, points of 2 or 3 coordinates."""

    degree: int
    knots: np.ndarray
    points: np.ndarray

    @property
    def domain(self) -> tuple[float, float]:
        return float(self.knots[self.degree]), float(self.knots[-1 - self.degree])


@dataclass(frozen=True, eq=False)
class Net:
    """A polynomial spline surface: degrees, full knots, points (n, m, 3)."""

    degrees: tuple[int, int]
    knots: tuple[np.ndarray, np.ndarray]
    points: np.ndarray


@dataclass(frozen=True, eq=False)
class Edge:
    """A curve in space from one vertex to another."""

    curve: Curve
    start: int
    end: int


@dataclass(frozen=True, eq=False)
class Trim:
    """A curve in the parameter plane, the way the loop runs; reversed when the edge runs back."""

    curve: Curve
    edge: int
    is_reversed: bool
    iso: int = NOT_ISO


@dataclass(frozen=True, eq=False)
class Face:
    """A surface with its loops, the outer one first; flipped when its normal points inwards."""

    net: Net
    loops: Sequence[Sequence[Trim]]
    is_flipped: bool = False


def brep(vertices: np.ndarray, edges: Sequence[Edge], faces: Sequence[Face]) -> Any:
    """The Brep of rhino3dm, decoded."""
    data = archive_bytes(vertices, edges, faces)
    # The layout written here is that of Rhino 6; the number of openNURBS is the library's own.
    made_by = rhino3dm.Point(rhino3dm.Point3d(0, 0, 0)).Encode()["opennurbs"]
    return rhino3dm.CommonObject.Decode(
        {
            **{"version": 10000, "archive3dm": 60, "opennurbs": made_by},
            "data": base64.b64encode(data).decode(),
        }
    )


@dataclass
class Chunk:
    """A piece of the archive: own bytes, and chunks inside it."""

    code: int
    parts: list[bytes | Chunk] = field(default_factory=list)
    has_crc: bool = True

    def bytes(self) -> bytes:
        inside = b"".join(p.bytes() if isinstance(p, Chunk) else p for p in self.parts)
        if self.has_crc:
            own = b"".join(p for p in self.parts if not isinstance(p, Chunk))
            inside += struct.pack("<I", zlib.crc32(own))
        return struct.pack("<Iq", self.code, len(inside)) + inside


def archive_bytes(vertices: np.ndarray, edges: Sequence[Edge], faces: Sequence[Face]) -> bytes:
    """The whole object as an archive."""
    loops = [(i, k, loop) for i, face in enumerate(faces) for k, loop in enumerate(face.loops)]
    trims = [(number, trim) for number, (_, _, loop) in enumerate(loops) for trim in loop]
    uses: list[list[int]] = [[] for _ in edges]
    for number, (_, trim) in enumerate(trims):
        uses[trim.edge].append(number)
    points = np.concatenate([face.net.points.reshape(-1, 3) for face in faces])
    no_meshes = Chunk(ANONYMOUS, [bytes(len(faces))])
    parts = [
        b"\x33",
        _list([_ints(1), _curve(trim.curve)] for _, trim in trims),
        _list([_ints(1), _curve(edge.curve)] for edge in edges),
        _list([_ints(1), _surface(face.net)] for face in faces),
        _list([_vertex(i, point, edges)] for i, point in enumerate(vertices)),
        _list([_edge(i, edge, uses[i])] for i, edge in enumerate(edges)),
        _list(
            [_trim(i, trim, edges[trim.edge], len(uses[trim.edge]), loop)]
            for i, (loop, trim) in enumerate(trims)
        ),
        _list(
            _loop(i, loops[i][:2], [t for t, (k, _) in enumerate(trims) if k == i])
            for i in range(len(loops))
        ),
        _faces(faces, loops),
        _doubles(points.min(axis=0), points.max(axis=0)),
        no_meshes,
        no_meshes,
        _ints(0),
        Chunk(ANONYMOUS, [_ints(1, 1), b"\x00"]),
    ]
    return _object(BREP, parts).bytes()


def _ints(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}i", *values)


def _doubles(*values: Any) -> bytes:
    return np.concatenate([np.ravel(v) for v in values]).astype("<f8").tobytes()


def _array(values: Sequence[int]) -> bytes:
    return _ints(len(values), *values)


def _object(identifier: uuid.UUID, parts: list[bytes | Chunk]) -> Chunk:
    """An object: the identifier of its class, its data, and an end."""
    end = struct.pack("<Iq", END, 0)
    head = Chunk(IDENTIFIER, [identifier.bytes_le])
    return Chunk(OBJECT, [head, Chunk(DATA, parts), end], has_crc=False)


def _list(entries: Any, minor: int = 0, tail: bytes = b"") -> Chunk:
    """A counted list in a chunk of its own."""
    rows = list(entries)
    parts = [part for row in rows for part in row]
    return Chunk(ANONYMOUS, [bytes([16 + minor]), _ints(len(rows)), *parts, tail])


def _knots(line: np.ndarray) -> bytes:
    """Knots as openNURBS has them, without the first and the last."""
    return _ints(len(line) - 2) + _doubles(line[1:-1])


# A box with its corners the wrong way round: not known.
_NO_BOX = _doubles([1.0, 0.0, 0.0, -1.0, 0.0, 0.0])


def _curve(curve: Curve) -> Chunk:
    count, dimension = curve.points.shape
    head = _ints(dimension, 0, curve.degree + 1, count, 0, 0)
    body = _knots(curve.knots) + _ints(count) + _doubles(curve.points)
    return _object(CURVE, [b"\x11", head, _NO_BOX, body, b"\x00"])


def _surface(net: Net) -> Chunk:
    n, m = net.points.shape[:2]
    head = _ints(3, 0, net.degrees[0] + 1, net.degrees[1] + 1, n, m, 0, 0)
    body = _knots(net.knots[0]) + _knots(net.knots[1]) + _ints(n * m) + _doubles(net.points)
    return _object(SURFACE, [b"\x10", head, _NO_BOX, body])


def _vertex(number: int, point: np.ndarray, edges: Sequence[Edge]) -> bytes:
    ends = [i for i, edge in enumerate(edges) for end in (edge.start, edge.end) if end == number]
    return _ints(number) + _doubles(point) + _array(ends) + _doubles(0.0)


def _edge(number: int, edge: Edge, uses: list[int]) -> bytes:
    domain = _doubles(edge.curve.domain)
    head = _ints(number, number, 0) + domain + _ints(edge.start, edge.end)
    return head + _array(uses) + _doubles(0.0) + domain


def _trim(number: int, trim: Trim, edge: Edge, uses: int, loop: int) -> bytes:
    domain = _doubles(trim.curve.domain)
    ends = (edge.end, edge.start) if trim.is_reversed else (edge.start, edge.end)
    kind = BOUNDARY if uses == 1 else MATED
    middle = _ints(trim.edge, *ends, int(trim.is_reversed), kind, trim.iso, loop)
    # Tolerances in the plane, a flag for reversed curves and room kept free, tolerances again.
    return _ints(number, number) + domain + middle + bytes(16) + domain + bytes(32 + 16)


def _loop(number: int, place: tuple[int, int], trims: list[int]) -> list[bytes]:
    face, rank = place
    return [_ints(number) + _array(trims) + _ints(OUTER if rank == 0 else INNER, face)]


def _faces(faces: Sequence[Face], loops: list[Any]) -> Chunk:
    rows = []
    for i, face in enumerate(faces):
        own = [k for k, (number, _, _) in enumerate(loops) if number == i]
        rows.append([_ints(i) + _array(own) + _ints(i, int(face.is_flipped), 0)])
    return _list(rows, minor=1, tail=bytes(16 * len(faces)))
