"""Meshes from files and to files; the suffix tells the format."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pqmesh.errors import FormatError, MeshError
from pqmesh.io.atomic import PathLike, shown_path, write_bytes
from pqmesh.io.foreign import file_bytes
from pqmesh.io.obj import Polygons, obj_from_mesh, polygons_from_obj
from pqmesh.io.off import off_from_mesh, polygons_from_off
from pqmesh.io.ply import ply_from_mesh, polygons_from_ply
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats


class MeshFormat(NamedTuple):
    """How one file format is read and written."""

    polygons_from_bytes: Callable[[bytes], Polygons]
    bytes_from_mesh: Callable[[PolyMesh], bytes]


# The only list of mesh formats: a line here is all that a new one needs.
MESH_FORMATS = {
    ".obj": MeshFormat(polygons_from_obj, obj_from_mesh),
    ".off": MeshFormat(polygons_from_off, off_from_mesh),
    ".ply": MeshFormat(polygons_from_ply, ply_from_mesh),
}


def read_mesh(path: PathLike) -> PolyMesh:
    """Mesh of a file; a `QuadMesh` when all of its faces are quads.

    Nothing is repaired. A mesh that `Topology` refuses can still be had as its bare polygons by
    `read_polygons`.

    Parameters
    ----------
    path : str or path
        The suffix, in upper or lower case, tells the format.

    Raises
    ------
    FormatError
        When there is no such file or format, or the file does not follow its format; names the
        file and, in text, the line.
    MeshError
        When the polygons are not a mesh; names the file and the first offending element.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> square = QuadMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_mesh(square, Path(folder, "square.obj"))
    ...     read_mesh(Path(folder, "square.obj"))
    QuadMesh(Topology(4 vertices, 4 edges, 1 faces))
    """
    polygons = _polygons(path)
    try:
        _check_use(polygons)
        topology = Topology(polygons.faces, len(polygons.vertices))
        kind = QuadMesh if topology.is_quad else PolyMesh
        return kind(polygons.vertices, topology)
    except MeshError as error:
        raise MeshError(
            f"{shown_path(path)}: {error} (Vertices and faces count from 0 here, in the order of "
            f"the file.)"
        ) from None


def read_quad_mesh(path: PathLike) -> QuadMesh:
    """Mesh of a file that holds quads only.

    Parameters
    ----------
    path : str or path

    Raises
    ------
    FormatError, MeshError
        As `read_mesh`; also when a face is not a quad, with the count and the first one.
    """
    mesh = read_mesh(path)
    if isinstance(mesh, QuadMesh):
        return mesh
    try:
        return QuadMesh(mesh.vertices, mesh.topology)
    except MeshError as error:
        raise MeshError(
            f"{shown_path(path)}: {error} (Faces count from 0 here, in the order of the file.)"
        ) from None


def read_polygons(path: PathLike) -> tuple[Floats, list[list[int]]]:
    """Vertices (V, 3) and faces of a file, without any check that they make a mesh.

    For files to be repaired by named functions, for example `drop_unused`.

    Parameters
    ----------
    path : str or path

    Raises
    ------
    FormatError
        As `read_mesh`.
    """
    polygons = _polygons(path)
    return polygons.vertices, polygons.face_lists()


def write_mesh(mesh: PolyMesh, path: PathLike) -> None:
    """Write a mesh, in full double precision; an earlier file is replaced only when all is well.

    The same mesh gives the same bytes.

    Parameters
    ----------
    mesh : PolyMesh
    path : str or path
        In a folder that exists; the suffix tells the format.

    Raises
    ------
    FormatError
        For a format that is not known, or when the file cannot be written.
    """
    write_bytes(path, _format_of(path).bytes_from_mesh(mesh))


def _format_of(path: PathLike) -> MeshFormat:
    """Format by the suffix of a path."""
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    if suffix not in MESH_FORMATS:
        raise FormatError(
            f"{shown_path(path)}: the suffix of a mesh file must be one of "
            f"{', '.join(MESH_FORMATS)}; found {suffix or 'none'!r}. Rename or convert the file."
        )
    return MESH_FORMATS[suffix]


def _polygons(path: PathLike) -> Polygons:
    """Polygons of a file; errors name the file."""
    mesh_format = _format_of(path)
    data = file_bytes(path, "a mesh")
    try:
        return mesh_format.polygons_from_bytes(data)
    except FormatError as error:
        raise FormatError(f"{shown_path(path)}: {error}") from None


def _check_use(polygons: Polygons) -> None:
    """Refuse vertices without a face; many files hold some, so the remedy is named."""
    is_used = np.zeros(len(polygons.vertices), dtype=np.bool_)
    inside = (polygons.indices >= 0) & (polygons.indices < len(is_used))
    is_used[polygons.indices[inside]] = True
    unused = np.flatnonzero(~is_used)
    if len(unused):
        raise MeshError(
            f"Every vertex must belong to a face; {len(unused)} of {len(is_used)} belong "
            f"to none, the first is vertex {unused[0]}. Remove unused vertices in the modelling "
            f"program, or in Python with read_polygons and drop_unused."
        )
