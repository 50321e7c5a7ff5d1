"""What a mesh is: `check`, as contract keys and as lines of text."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

import pqmesh
from pqmesh.errors import MeshError
from pqmesh.koebe.edge_offset import edge_offset_space
from pqmesh.mesh.cones import vertex_types
from pqmesh.mesh.conjugacy import conjugacy
from pqmesh.mesh.measure import (
    circularity_defect,
    corner_angles,
    fitted_cones,
    flipped_faces,
    nonconvex_faces,
    planarity,
)
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.distances import KINDS
from pqmesh.offset.parallel import parallel_space
from pqmesh.offset.spaces import offset_space
from pqmesh.report_mesh import SCHEMA, all_measures, mesh_counts
from pqmesh.report_outlook import conjugacy_keys

# An edge shorter than this share of the mean is listed as tiny.
TINY_EDGE = 0.05


def check_report(
    mesh: PolyMesh, *, source: str, units: str | None, tolerance: float
) -> dict[str, Any]:
    """What a mesh is, judged by the tolerance; what cannot be decided is None.

    Parameters
    ----------
    mesh : PolyMesh
    source : str
        Name of the input.
    units : str or None
    tolerance : float
        Dimensionless; of planarity, spread / theta and the balance of faces.
    """
    found = all_measures(mesh, "conical")
    flat = bool(found["planarity_max"] <= tolerance)
    spread = found["cone_spread_max"]
    listed = problems(mesh, tolerance)
    dimension, gap = _parallel(mesh, listed)
    offsets = {kind: _offsets(mesh, kind, tolerance, listed) for kind in KINDS}
    return {
        "schema": SCHEMA,
        "version": pqmesh.__version__,
        "input": source,
        "units": units,
        "tolerance": tolerance,
        "mesh": mesh_counts(mesh),
        "measures": found,
        "planar": flat,
        "circular": bool(flat and np.abs(circularity_defect(mesh)).max() <= tolerance),
        "conical": bool(flat and (spread is None or spread <= tolerance)),
        "edge_offset": offsets["edge"]["exists"],
        "lines": conjugacy_keys(conjugacy(mesh)),
        "vertex_types": dict(sorted(Counter(map(str, vertex_types(mesh).values())).items())),
        "parallel_dimension": dimension,
        "parallel_gap": gap,
        "offsets": offsets,
        "problems": listed,
    }


def check_lines(report: dict[str, Any]) -> list[str]:
    """The report of `check` as lines for people."""
    counts = report["mesh"]
    lines = [
        f"{report['input']}: {counts['vertices']} vertices, {counts['faces']} faces, "
        f"{counts['boundary_loops']} boundary loops, Euler characteristic "
        f"{counts['euler_characteristic']}"
    ]
    for key in ("planar", "circular", "conical"):
        verdict = "yes" if report[key] else "no"
        lines.append(f"{key:9} {verdict} (tolerance {report['tolerance']:g})")
    lines.append(_lines_line(report["lines"]))
    if report["parallel_dimension"] is None:
        lines.append("parallel  dimension of P(M) undecided, see the notes")
    else:
        lines.append(
            f"parallel  dimension of P(M) {report['parallel_dimension']} "
            f"(gap {report['parallel_gap']:.3g})"
        )
    for kind, offset in report["offsets"].items():
        lines.append(_offset_line(kind, offset))
    if report["vertex_types"]:
        types = ", ".join(f"{count} {name}" for name, count in report["vertex_types"].items())
        lines.append(f"vertices  {types}")
    for key, value in report["measures"].items():
        lines.append(f"  {key:22} {'-' if value is None else format(value, '.6g')}")
    return lines + [f"note: {problem['text']}" for problem in report["problems"]]


def _lines_line(found: dict[str, Any]) -> str:
    """One line about the two families of mesh lines."""
    turn = found["conjugacy_turn_median_deg"]
    by = "" if turn is None else f", must turn by {turn:.3g} deg in the median to be conjugate"
    return f"lines     {found['verdict']}{by}"


def _offset_line(kind: str, offset: dict[str, Any]) -> str:
    """One line about the offsets of a kind."""
    name = f"{kind} offset"
    if offset["exists"] is None:
        return f"{name:13} undecided, see the notes"
    error = f"error {offset['error']:.3g} per unit"
    if not offset["exists"]:
        return f"{name:13} no, best {error}"
    family = offset["family_dimension"]
    return f"{name:13} yes, {'' if family is None else f'{family} parameters, '}{error}"


def _parallel(mesh: PolyMesh, listed: list[dict[str, Any]]) -> tuple[int | None, float | None]:
    """Dimension of P(M) and its gap; None with a note where they cannot be decided."""
    try:
        space = parallel_space(mesh)
    except MeshError as error:
        listed.append({"kind": "parallel_undecided", "where": [], "text": str(error)})
        return None, None
    return space.dimension, space.gap


def _offsets(
    mesh: PolyMesh, kind: str, tolerance: float, listed: list[dict[str, Any]]
) -> dict[str, Any]:
    """What is known of the offsets of a kind."""
    try:
        found = (
            edge_offset_space(mesh, tolerance)
            if kind == "edge"
            else offset_space(mesh, kind, tolerance)
        )
    except MeshError as error:
        listed.append({"kind": f"{kind}_offset_undecided", "where": [], "text": str(error)})
        keys = ("exists", "family_dimension", "error", "parallel_error")
        return dict.fromkeys((*keys, "parallel_error_boundary"))
    return {
        "exists": found.exists,
        "family_dimension": found.family_dimension,
        "error": found.error,
        "parallel_error": found.parallel_error,
        "parallel_error_boundary": found.parallel_error_boundary,
    }


def problems(mesh: PolyMesh, tolerance: float) -> list[dict[str, Any]]:
    """What is unusual about a mesh, each kind once with its places."""
    cones = fitted_cones(mesh)
    corners = corner_angles(mesh)
    lengths = mesh.edge_lengths
    tiny = np.flatnonzero(lengths < TINY_EDGE * lengths.mean())
    straight = np.unique(mesh.topology.corner_faces[np.abs(corners - np.pi) < 1e-9])
    ring = np.flatnonzero(np.abs(circularity_defect(mesh)) > tolerance)
    bent = np.flatnonzero(planarity(mesh) > tolerance)
    leaning = cones.vertices[cones.relative_spread > tolerance]
    irregular = mesh.topology.irregular_vertices
    found = [
        ("irregular_vertices", irregular, "interior vertices of valence other than 4"),
        ("nonconvex_faces", nonconvex_faces(mesh), "faces that are not convex, or folded"),
        ("flipped_faces", flipped_faces(mesh), "faces turned over against their neighbours"),
        ("flat_vertices", cones.vertices[cones.is_flat], "vertices whose faces lie in one plane"),
        ("straight_corners", straight, "faces with a corner of 180 degrees"),
        ("tiny_edges", tiny, f"edges below {TINY_EDGE:g} of the mean edge"),
        ("bent_faces", bent, "faces not planar to the tolerance"),
        ("uncircular_faces", ring, "faces whose corners lie on no circle, to the tolerance"),
        ("unconical_vertices", leaning, "vertices without a common cone, to the tolerance"),
    ]
    result = [
        {"kind": kind, "where": where.tolist(), "text": f"{len(where)} {text}, first {where[0]}"}
        for kind, where, text in found
        if len(where)
    ]
    pieces = int(mesh.topology.components.max()) + 1
    if pieces > 1:
        text = f"the mesh falls into {pieces} pieces; are its vertices welded?"
        result.append({"kind": "pieces", "where": [], "text": text})
    return result
