"""Meshes that the commands read and write, and surfaces to stay close to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pqmesh.cli_typed import SURFACE_SUFFIXES, design_text
from pqmesh.errors import MeshError

if TYPE_CHECKING:
    from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
    from pqmesh.surface.reference import Reference

# Model sizes beyond this, or below its inverse, leave the range of doubles when squared twice.
LARGEST = 1e50
# Steps of the coordinates, in mean edges, that leave exact faces no room.
COARSEST = 1e-7


def check_outputs(output: Path, report: Path | None) -> None:
    """Refuse outputs that cannot be written, before the work."""
    from pqmesh.io.formats import MESH_FORMATS
    from pqmesh.outputs import check_file

    check_file(output, list(MESH_FORMATS))
    if report is not None:
        check_file(report, [".json"])


def read_to_move(path: Path) -> PolyMesh:
    """A mesh that can be optimised or offset."""
    from pqmesh.io.formats import read_mesh

    mesh = read_mesh(path)
    check_shape(mesh, path.name, edges=True)
    return mesh


def read_quads_to_move(path: Path) -> QuadMesh:
    """A quad mesh that can be transformed."""
    from pqmesh.io.formats import read_quad_mesh

    mesh = read_quad_mesh(path)
    check_shape(mesh, path.name, edges=True)
    return mesh


def write_moved(moved: PolyMesh, found: dict[str, Any], output: Path, report: Path | None) -> None:
    """Write a moved mesh and, where one is wanted, its report."""
    from pqmesh.io.formats import MESH_FORMATS
    from pqmesh.outputs import json_bytes, write_files

    files = {output: MESH_FORMATS[output.suffix.lower()].bytes_from_mesh(moved)}
    if report is not None:
        files[report] = json_bytes(found)
    write_files(files)


def check_shape(mesh: PolyMesh, name: str, *, edges: bool) -> None:
    """Refuse meshes without area or of a size that squares leave the range of numbers."""
    from pqmesh.vectors import norm

    extent = _extent(mesh)
    if not 1 / LARGEST < extent < LARGEST:
        raise MeshError(
            f"{name}: the extent of a mesh must lie between {1 / LARGEST:g} and {LARGEST:g}; found "
            f"{extent:g}. Check its coordinates and units."
        )
    if norm(mesh.face_area_vectors).sum() <= 1e-14 * extent**2:
        raise MeshError(f"{name}: a mesh must have area; all its faces have none. Export it again.")
    if edges and not mesh.edge_lengths.min() > 0:
        a, b = mesh.edges[mesh.edge_lengths.argmin()]
        raise MeshError(
            f"{name}: the edges of the mesh must have length; edge {a}-{b} has none. "
            f"Merge its ends, or move one. (Vertices count from 0 here.)"
        )


def _extent(mesh: PolyMesh) -> float:
    """Longest side of the box around a mesh."""
    return float((mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0)).max())


def check_near(mesh: PolyMesh, name: str) -> None:
    """Refuse meshes so far away that their coordinates are too coarse for exact faces."""
    import numpy as np

    grain = float(np.spacing(np.abs(mesh.vertices).max()))
    if grain > COARSEST * mesh.mean_edge_length:
        raise MeshError(
            f"{name}: coordinates must be finer than {COARSEST:g} of an edge for flat faces; as "
            f"far away as {np.abs(mesh.vertices).max():.6g} they are multiples of {grain:.3g}, "
            f"with a mean edge of {mesh.mean_edge_length:.3g}. Move the mesh nearer to the origin."
        )


def check_quads(mesh: PolyMesh, name: str) -> None:
    """Refuse meshes with other faces than quads; names the file."""
    from pqmesh.mesh.quadmesh import QuadMesh

    try:
        QuadMesh(mesh.vertices, mesh.topology)
    except MeshError as error:
        raise MeshError(f"{name}: {error}") from None


def reference_of(path: Path | None, start: PolyMesh) -> Reference:
    """The surface to stay close to, not far from the start; the start itself without one."""
    from pqmesh.vectors import norm

    reference = _reference(path, start)
    if path is not None:
        away = norm(reference.closest(start.vertices)[0] - start.vertices)
        extent = _extent(start)
        if not away.min() <= extent:
            raise MeshError(
                f"{path.name}: the surface to stay close to must lie near the mesh; its nearest "
                f"vertex, {int(away.argmin())}, is {away.min():.4g} away, more than the mesh is "
                f"large ({extent:.4g}). Check units and origin of the two files."
            )
    return reference


def _reference(path: Path | None, start: PolyMesh) -> Reference:
    """The surface itself."""
    from pqmesh.surface.reference import SurfaceReference, TriangleReference

    if path is None:
        return TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    if path.suffix.lower() in (".toml", *SURFACE_SUFFIXES):
        from pqmesh.design import Design
        from pqmesh.source import opened_surface

        text = design_text(path)
        # Only the surface counts here; a design without panels will do.
        text.tables.setdefault("panels", {"edge": 1.0})
        return SurfaceReference(opened_surface(Design.of(text.tables, text.where), text.folder))
    from pqmesh.io.formats import read_mesh

    other = read_mesh(path)
    check_shape(other, path.name, edges=False)
    return TriangleReference.of_polygons(other.vertices, other.topology.face_lists())
