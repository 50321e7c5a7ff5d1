"""A mesh offset or transformed as a whole, and the report of what that reached."""

from __future__ import annotations

from typing import Any

import numpy as np

import pqmesh
from pqmesh.errors import MeshError, SpecError
from pqmesh.mesh.measure import circularity_defect
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.offset.distances import edge_factors, valid_range
from pqmesh.offset.offsets import offset_layer
from pqmesh.offset.vectors import OffsetVectors, face_offset_vectors, vertex_offset_vectors
from pqmesh.report_mesh import SCHEMA, all_measures, judged, mesh_counts
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.moebius import MoebiusTransform
from pqmesh.vectors import Floats

# Error per unit distance up to which an offset is exact; and of planarity, cones and circles.
EXACT = 1e-6


def offset_mesh(
    mesh: PolyMesh, kind: str, distance: float, *, source: str = ""
) -> tuple[PolyMesh, dict[str, Any]]:
    """Offset of a mesh at a constant signed distance of vertices, edges or faces, and its report.

    Parameters
    ----------
    mesh : PolyMesh
    kind : 'vertex', 'edge' or 'face'
        What keeps its distance: exact on circular, Koebe-like and conical meshes.
    distance : float, model unit
        A positive one moves every face along its normal.
    source : str
        Name of the input.

    Raises
    ------
    SpecError
        When the distance is zero or no number.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> moved, report = offset_mesh(cube(), "face", 0.5)
    >>> bool(np.allclose(moved.vertices, 1.5 * cube().vertices)), report["tolerance"][0]["pass"]
    (True, True)
    """
    if not (np.isfinite(distance) and distance):
        raise SpecError(
            f"The distance of an offset must be a number other than 0; found {distance:g}. A "
            f"positive one moves every face along its normal."
        )
    vectors = _vectors(mesh, kind)
    _check_range(mesh, vectors.vectors, distance)
    layer = offset_layer(mesh, vectors, distance)
    # Vertices may keep their distance while edges turn: the gap of the vectors counts as well.
    reached = max(layer.distance_error_max / abs(distance), vectors.error)
    report = {
        **_head(mesh, kind, source),
        "distance": distance,
        "distance_error_max": layer.distance_error_max,
        "parallel_error_max": layer.parallel_error_max,
        "parallel_error_boundary_max": layer.parallel_error_boundary_max,
        "first_reversed_edge_distance": layer.first_reversed_edge_distance,
        "before": all_measures(mesh, "circular" if kind == "vertex" else "conical"),
        "after": all_measures(layer.mesh, "circular" if kind == "vertex" else "conical"),
        "tolerance": [judged("offset", EXACT, reached)],
        "warnings": [],
    }
    return layer.mesh, report


def transformed_mesh(
    mesh: QuadMesh, transform: LaguerreTransform | MoebiusTransform, *, source: str = ""
) -> tuple[QuadMesh, dict[str, Any]]:
    """Image of a conical mesh by Laguerre, of a circular one by Moebius, and its report.

    Raises
    ------
    MeshError
        Where the image is no mesh; names the vertex, edge or face.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> image, report = transformed_mesh(roof, LaguerreTransform.boost([1, 0, 0], 0.2))
    >>> [row["pass"] for row in report["tolerance"]]
    [True, True]
    """
    if isinstance(transform, LaguerreTransform):
        laguerre = transform.of_mesh(mesh)
        image, kind, orientation = laguerre.mesh, "conical", laguerre.orientation
        warnings = laguerre.warnings
        written = {
            "matrix": transform.matrix.tolist(),
            "translation": transform.translation.tolist(),
            "scale": transform.scale,
        }
    else:
        moebius = transform.of_mesh(mesh)
        image, kind, orientation = moebius.mesh, "circular", 1
        warnings = moebius.warnings
        written = {"matrix": transform.matrix.tolist()}
    before, after = all_measures(mesh, kind), all_measures(image, kind)
    asked: dict[str, float | None] = {"planar": after["planarity_max"]}
    if kind == "conical":
        asked["conical"] = after["cone_spread_max"]
    else:
        asked["circular"] = float(np.abs(circularity_defect(image)).max())
    report = {
        **_head(mesh, kind, source),
        "transform": written,
        "orientation": orientation,
        "before": before,
        "after": after,
        "tolerance": [judged(key, EXACT, value) for key, value in asked.items()],
        "warnings": list(warnings),
    }
    return image, report


# --- parts ----------------------------------------------------------------------------------


def _head(mesh: PolyMesh, kind: str, source: str) -> dict[str, Any]:
    """Keys that open every report."""
    return {
        "schema": SCHEMA,
        "version": pqmesh.__version__,
        "units": "",
        "kind": kind,
        "input": source,
        "mesh": mesh_counts(mesh),
    }


def _vectors(mesh: PolyMesh, kind: str) -> OffsetVectors:
    """Offset vectors of a kind."""
    if kind == "face":
        return face_offset_vectors(mesh)
    if kind == "vertex":
        return vertex_offset_vectors(mesh)
    # The fits to surfaces that come with it are long to import.
    from pqmesh.koebe.best import best_edge_vectors

    return best_edge_vectors(mesh)


def _check_range(mesh: PolyMesh, vectors: Floats, distance: float) -> None:
    """Refuse an offset in which edges run backwards."""
    factors = 1.0 + distance * edge_factors(mesh, vectors)
    turned = np.flatnonzero(factors <= 0)
    if not len(turned):
        return
    a, b = mesh.edges[turned[0]]
    low, high = valid_range(mesh, vectors)
    raise MeshError(
        f"An offset must not turn edges round; at {distance:g} edge {a}-{b} becomes "
        f"{factors[turned[0]]:.3g} times as long ({len(turned)} such edges): it lies beyond the "
        f"focal set. Choose a distance between {low:.6g} and {high:.6g}."
    )
