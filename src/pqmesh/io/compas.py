"""COMPAS JSON: NURBS surfaces and meshes, read and written without COMPAS itself."""

from __future__ import annotations

import json
import uuid
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from pqmesh.errors import FormatError, PqmeshError
from pqmesh.io.atomic import PathLike
from pqmesh.io.foreign import DAMAGE, file_bytes, named
from pqmesh.io.nurbs import surface_from_nurbs
from pqmesh.io.obj import Polygons
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.vectors import Floats

# Any fixed one: the same mesh gives the same identifier.
_NAMESPACE = uuid.UUID("5c3a8f0e-52a4-5b9e-9d0c-6f1c2f6b7a11")

_SURFACE_KEYS = frozenset({"points", "knots_u", "knots_v", "degree_u", "degree_v"})
_MESH_KEYS = frozenset({"vertex", "face"})


def read_compas_surface(path: PathLike) -> BSplineSurface:
    """The NURBS surface of a COMPAS JSON file, alone or inside a scene, list or session.

    Parameters
    ----------
    path : str or path

    Raises
    ------
    FormatError
        When there is no such file, it is not JSON, or does not hold exactly one surface.
    SurfaceError
        When the surface has a crease or does not fit.

    References: COMPAS 2, class `compas.geometry.NurbsSurface`.
    """
    try:
        table = _the_one(file_bytes(path, "a COMPAS surface"), _SURFACE_KEYS, "NURBS surface")
        try:
            return _surface(table)
        except PqmeshError:
            raise
        except DAMAGE as error:
            raise FormatError(
                f"A COMPAS surface must hold points, weights, knots, multiplicities and degrees; "
                f"found: {error!s:.80}. Export it again."
            ) from None
    except PqmeshError as error:
        raise named(path, error) from None


def polygons_from_compas(data: bytes) -> Polygons:
    """Polygons of the only mesh in COMPAS JSON, vertices and faces in the order of the file.

    Parameters
    ----------
    data : bytes
        UTF-8 text.

    Raises
    ------
    FormatError
        When it is not JSON, or does not hold exactly one mesh.

    Examples
    --------
    >>> text = b'{"vertex": {"4": {"x": 0, "y": 0}, "7": {"x": 1}, "9": {"y": 1, "z": 2}},'
    >>> polygons_from_compas(text + b' "face": {"0": [4, 7, 9]}}').face_lists()
    [[0, 1, 2]]
    """
    table = _the_one(data, _MESH_KEYS, "mesh")
    vertex, face = table["vertex"], table["face"]
    if not isinstance(vertex, dict) or not isinstance(face, dict) or not vertex or not face:
        raise FormatError(
            "A COMPAS mesh must have the tables 'vertex' and 'face' with entries; one is missing "
            "or empty. Export a mesh with faces."
        )
    default = _defaults(table)
    number = {key: i for i, key in enumerate(vertex)}
    points = np.array([_position(key, entry, default) for key, entry in vertex.items()])
    corners: list[int] = []
    sizes: list[int] = []
    for key, cycle in face.items():
        # COMPAS 1 wrote corners as tables from each vertex to the next in some files.
        if not isinstance(cycle, list) or not cycle:
            raise FormatError(f"Face {key!r} must be a list of vertices; it is not. Mend it.")
        for corner in cycle:
            if str(corner) not in number:
                raise FormatError(
                    f"Faces must name vertices of the file; face {key!r} has {str(corner)[:40]!r}. "
                    f"Mend it."
                )
            corners.append(number[str(corner)])
        sizes.append(len(cycle))
    return Polygons(points, np.array(corners, dtype=np.int64), np.array(sizes, dtype=np.int64))


def compas_from_mesh(mesh: PolyMesh) -> bytes:
    """COMPAS JSON of a mesh (`compas.datastructures/Mesh` of COMPAS 2), full precision.

    Parameters
    ----------
    mesh : PolyMesh

    Examples
    --------
    >>> triangle = PolyMesh.of([[0, 0, 0], [1, 0, 0], [0, 0.5, 0]], [[0, 1, 2]])
    >>> polygons_from_compas(compas_from_mesh(triangle)).vertices[2]
    array([0. , 0.5, 0. ])
    """
    rows = mesh.vertices.tolist()
    faces = mesh.topology.face_lists()
    table = {
        "attributes": {},
        "default_vertex_attributes": {"x": 0.0, "y": 0.0, "z": 0.0},
        "default_edge_attributes": {},
        "default_face_attributes": {},
        "vertex": {str(i): {"x": x, "y": y, "z": z} for i, (x, y, z) in enumerate(rows)},
        "face": {str(i): face for i, face in enumerate(faces)},
        "facedata": {},
        "edgedata": {},
        "max_vertex": len(rows) - 1,
        "max_face": len(faces) - 1,
    }
    text = json.dumps(table)
    whole = {
        "dtype": "compas.datastructures/Mesh",
        "data": table,
        "inheritance": [],
        "guid": str(uuid.uuid5(_NAMESPACE, text)),
    }
    return json.dumps(whole).encode("ascii")


# --- what is in a file ----------------------------------------------------------------------


def _the_one(data: bytes, keys: frozenset[str], what: str) -> dict[str, Any]:
    """The only table of a file that has these keys."""
    try:
        tree = json.loads(data.decode("utf-8-sig"))
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError, ValueError) as error:
        text = f"{error!s:.80}" if isinstance(error, json.JSONDecodeError) else "it is not text"
        raise FormatError(f"A COMPAS file must be JSON; found: {text}. Export it again.") from None
    found = list(_tables(tree, keys))
    if len(found) != 1:
        names = [name for name, _ in found if name]
        listed = f" ({', '.join(repr(name[:40]) for name in names[:8])})" if names else ""
        advice = "Export one alone" if found else "Export a " + what
        raise FormatError(
            f"A COMPAS file must hold one {what}; found {len(found) or 'none'}{listed}. {advice}."
        )
    return found[0][1]


def _tables(tree: Any, keys: frozenset[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Tables with these keys anywhere in a JSON tree, with the name beside or in them."""
    waiting: list[tuple[str, Any]] = [("", tree)]
    while waiting:
        name, node = waiting.pop()
        if isinstance(node, list):
            waiting.extend((name, child) for child in reversed(node))
        elif isinstance(node, dict):
            own = node.get("name") or node.get("dtype") or name
            name = own if isinstance(own, str) else name
            if keys <= node.keys():
                yield name, node
            else:
                waiting.extend((name, child) for child in reversed(node.values()))


# --- meshes ---------------------------------------------------------------------------------


def _defaults(table: Mapping[str, Any]) -> dict[str, Any]:
    """Coordinates of vertices that do not say; COMPAS 1 calls the table "dva"."""
    found = table.get("default_vertex_attributes", table.get("dva"))
    return {"x": 0.0, "y": 0.0, "z": 0.0} | (found if isinstance(found, dict) else {})


def _position(key: str, entry: Any, default: Mapping[str, Any]) -> list[float]:
    """Coordinates of a vertex."""
    whole = {**default, **entry} if isinstance(entry, dict) else None
    try:
        if whole is None or any(isinstance(whole[axis], (str, bool)) for axis in "xyz"):
            raise TypeError
        return [float(whole[axis]) for axis in "xyz"]
    except (TypeError, ValueError, OverflowError):
        raise FormatError(
            f"Vertices must have numbers x, y, z; vertex {key[:40]!r} has not. Mend it."
        ) from None


# --- surfaces -------------------------------------------------------------------------------


def _surface(table: Mapping[str, Any]) -> BSplineSurface:
    """Surface of COMPAS's keys."""
    points = np.array(table["points"], dtype=np.float64)
    weights = np.array(table.get("weights") or np.ones(points.shape[:2]), dtype=np.float64)
    if points.ndim != 3 or points.shape[2] != 3 or weights.shape != points.shape[:2]:
        raise FormatError(
            f"Control points must be n x m x 3 with one weight each; found shapes {points.shape} "
            f"and {weights.shape}. Export the surface again."
        )
    degrees = int(table["degree_u"]), int(table["degree_v"])
    knots = []
    for axis, letter in enumerate("uv"):
        line = np.array(table[f"knots_{letter}"], dtype=np.float64)
        times = table.get(f"mults_{letter}")
        if times is not None:
            line = np.repeat(line, np.array(times, dtype=np.int64))
        periodic = bool(table.get(f"is_periodic_{letter}", False))
        rows = np.dstack([points, weights])
        rows, line = _unrolled(rows.swapaxes(0, axis), line, degrees[axis], periodic)
        rows = rows.swapaxes(0, axis)
        points, weights = rows[..., :3], rows[..., 3]
        knots.append(line)
    return surface_from_nurbs(points, degrees, (knots[0], knots[1]), weights)


def _unrolled(rows: Floats, line: Floats, degree: int, periodic: bool) -> tuple[Floats, Floats]:
    """Rows and full knots of one direction, from each of the ways to leave some out."""
    short = len(rows) + degree + 1 - len(line)
    if short == 2 and len(line):
        # Rhino's way: the first and the last knot have no say and are left out.
        return rows, np.concatenate([line[:1], line, line[-1:]])
    first = int(np.count_nonzero(line == line[0])) if len(line) else 0
    if short <= 0 or not periodic or len(line) - first != len(rows):
        return rows, line
    # The way of Open Cascade: one period of knots, and as many points as it has knots.
    period, more = line[-1] - line[0], degree + 1 - first
    before = line[:-first][-more:] - period if more else line[:0]
    after = line[first:][:more] + period if more else line[:0]
    wrapped = np.concatenate([rows, rows[:more]])
    return wrapped, np.concatenate([before, line, after])
