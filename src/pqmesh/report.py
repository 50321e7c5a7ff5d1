"""The numbers of a result, as contract keys: report.json of `panelize` and `optimize`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import pqmesh
from pqmesh.design import Design
from pqmesh.fabricate.edgebeams import EdgeBeam
from pqmesh.fabricate.trim import TrimmedPanels
from pqmesh.job import Panelization
from pqmesh.mesh.measure import planarity_deviation, plane_deviation
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.network.principal import Inside
from pqmesh.network.region import PlanOutline, region_samples
from pqmesh.offset.offsets import Layer
from pqmesh.offset.support import SupportStructure
from pqmesh.optimize.constrained import Missed, constraint_miss
from pqmesh.optimize.mending import Mending
from pqmesh.optimize.outlook import Outlook, outlook
from pqmesh.optimize.solver import Solution
from pqmesh.optimize.worst import worst_places
from pqmesh.report_limits import (
    area_change,
    constraint_row,
    distances_to_surface,
    limit_rows,
    spread_of_cones,
)
from pqmesh.report_mesh import SCHEMA, all_measures, edge_twists, judged, measured, mesh_counts
from pqmesh.report_outlook import outlook_keys, worst_keys
from pqmesh.report_words import roof_warnings
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import first_form
from pqmesh.surface.reference import Reference, SurfaceReference, TriangleReference
from pqmesh.vectors import Floats, norm

# A sampled point of the surface counts as covered within this share of the mean edge.
COVERED = 0.05


def panelization_report(
    result: Panelization,
    *,
    source: str,
    design: Design,
    origin: Floats,
    notes: tuple[str, ...] = (),
) -> dict[str, Any]:
    """All report keys but `timing` and the writing of files.

    Parameters
    ----------
    result : Panelization
        Near the origin.
    source : str
        Name of the input.
    design : Design
    origin : (3,)
        Where the result stands: added to the places that are named.
    notes : tuple of str
        Warnings from reading the input.
    """
    mesh = result.mesh
    reference = SurfaceReference(result.surface, result.uv)
    distances = _distances(mesh, reference)
    report: dict[str, Any] = {
        "schema": SCHEMA,
        "version": pqmesh.__version__,
        "units": design.units,
        "kind": result.spec.kind,
        "input": source,
        "design": design.model_dump(mode="json", exclude_none=True),
        "seed": design.run.seed,
        "origin": origin.tolist(),
        "orientation": result.orientation,
        "mesh": mesh_counts(mesh),
        "before": all_measures(result.start, result.spec.kind),
        "after": all_measures(mesh, result.spec.kind, result.vectors.axes),
        "deviation": _deviation(result.start, mesh, distances),
        "network": _network(result, origin),
        "layers": [_layer(layer) for layer in result.layers],
        "support": _support(result.support),
        "panels": _panels(result),
        "outlook": outlook_keys(
            outlook(result.spec.kind, result.start, boundary=result.spec.boundary), origin
        ),
        "worst": worst_keys(
            worst_places(result.spec.kind, result.start, mesh, result.solution, reference, origin)
        ),
        "solver": solver_report(result.solution),
        "warnings": [*notes, *result.notes, *roof_warnings(result, origin)],
    }
    if not result.solution.converged:
        report["warnings"] += report["outlook"]["advice"]
    report["tolerance"] = _tolerance(report, result, design, distances, origin)
    missed = constraint_miss(result.start, reference, result.spec.constraints, result.solution)
    if missed is not None:
        report["tolerance"].append(constraint_row(missed, mesh, origin))
    return report


def optimization_report(
    start: PolyMesh,
    mesh: PolyMesh,
    solution: Solution,
    reference: Reference,
    *,
    kind: str,
    source: str,
    units: str,
    limits: Mapping[str, float],
    mending: Mending | None = None,
    seen: Outlook | None = None,
    missed: Missed | None = None,
) -> dict[str, Any]:
    """Report of `optimize`: the same keys where they exist.

    `start` is the mesh as it came; `mending` says what was done to it before, and `seen` is the
    outlook of what came of that. `limits` are those of `limits_of`. `missed` is by how much
    constraints were missed; None without any.
    """
    distances = _distances(mesh, reference)
    twists = edge_twists(mesh, kind, solution.blocks.get("image"))
    report: dict[str, Any] = {
        "schema": SCHEMA,
        "version": pqmesh.__version__,
        "units": units,
        "kind": kind,
        "input": source,
        "mesh": mesh_counts(mesh),
        "before": all_measures(start, kind),
        "after": measured(mesh, twists),
        "deviation": _deviation(start, mesh, distances),
        "mended": _mended(mending),
        "outlook": outlook_keys(seen or outlook(kind, start)),
        "worst": worst_keys(worst_places(kind, start, mesh, solution, reference)),
        "solver": solver_report(solution),
        "warnings": [] if mending is None else mending.words,
    }
    # What was mended is the surface to stay close to, and its area the one to keep.
    first = start if mending is None else mending.mesh
    report["tolerance"] = limit_rows(limits, first, mesh, solution, distances, twists)
    if missed is not None:
        report["tolerance"].append(constraint_row(missed, mesh))
    return report


# --- parts ----------------------------------------------------------------------------------


def deviation(start: PolyMesh, mesh: PolyMesh, reference: Reference) -> dict[str, float]:
    """Distances to the reference and from the start, model unit."""
    return _deviation(start, mesh, _distances(mesh, reference))


def _distances(mesh: PolyMesh, reference: Reference) -> Floats:
    """Distances (V,) of the vertices to a reference, model unit."""
    feet, _, _ = reference.closest(mesh.vertices)
    return np.asarray(norm(feet - mesh.vertices))


def _deviation(start: PolyMesh, mesh: PolyMesh, distances: Floats) -> dict[str, float]:
    """`deviation` of known distances (V,)."""
    return {
        "max": float(distances.max()),
        "rms": float(np.sqrt(np.mean(distances**2))),
        "moved_max": float(norm(mesh.vertices - start.vertices).max()),
    }


def coverage(
    surface: Surface,
    mesh: PolyMesh,
    inside: Inside | None,
    outline: PlanOutline | None = None,
    n: int = 120,
) -> dict[str, float]:
    """How much of the surface's region the mesh covers, and how far the rest is from it.

    Measured from the surface to the mesh: a mesh that slides or shrinks stays close to the
    surface, but leaves the surface bare.
    """
    uv, _ = region_samples(surface, inside, outline, n)
    jet = surface.jet(uv)
    weights = np.sqrt(np.maximum(np.linalg.det(first_form(jet)), 0.0))
    triangles = TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())
    feet, _, _ = triangles.closest(jet.point)
    distance = norm(feet - jet.point)
    near = distance <= COVERED * mesh.mean_edge_length
    return {
        "covered_share": float(weights[near].sum() / weights.sum()),
        "surface_to_mesh_max": float(distance.max()),
    }


def solver_report(solution: Solution) -> dict[str, Any]:
    """How the optimisation ended."""
    return {
        "converged": solution.converged,
        "iterations": len(solution.steps),
        "reason": solution.reason,
    }


def _mended(mending: Mending | None) -> dict[str, Any]:
    """Faces that started broken: which were mended, which were not, and how far vertices went."""
    if mending is None:
        return {"faces": [], "left": [], "vertices": 0, "moved_max": 0.0}
    return {
        "faces": mending.mended.tolist(),
        "left": mending.left.tolist(),
        "vertices": len(mending.moved),
        "moved_max": mending.moved_max,
    }


def _layer(layer: Layer[QuadMesh]) -> dict[str, Any]:
    return {
        "distance": layer.distance,
        "kind": layer.kind,
        "distance_error_max": layer.distance_error_max,
        "parallel_error_max": layer.parallel_error_max,
        "parallel_error_boundary_max": layer.parallel_error_boundary_max,
        "planarity_max": layer.planarity_max,
        "planarity_max_length": float(planarity_deviation(layer.mesh).max()),
        "first_reversed_edge_distance": layer.first_reversed_edge_distance,
    }


def _support(support: SupportStructure | None) -> dict[str, Any] | None:
    if support is None:
        return None
    depth = support.depths
    return {
        "quads": len(support.quads),
        "depth_min": float(depth.min()),
        "depth_max": float(depth.max()),
        "twist_max_deg": float(np.degrees(support.twist.max())),
        "planarity_max_length": float(support.planarity_deviation.max()),
    }


def _panels(result: Panelization) -> dict[str, Any]:
    """Panels as they are made: cut where there is an outline."""
    cut = result.trimmed
    if cut is None:
        # With an outline nothing counts as covered until it is cut.
        share = None if result.outline is None else 0.0
        return {
            "count": result.mesh.topology.n_faces,
            "trimmed": 0,
            "slivers": 0,
            "area_total": float(norm(result.mesh.face_area_vectors).sum()),
            "planarity_max_length": None,
            "covered_share": share,
            "edge_beams": [],
            "layers": [],
        }
    return {
        **_cut_panels(cut.panels),
        "edge_beams": [_beam(beam) for beam in cut.beams],
        "layers": [_cut_panels(layer) for layer in cut.layers],
    }


def _beam(beam: EdgeBeam) -> dict[str, Any]:
    """An edge beam: which ring of the outline it follows, and how long it is."""
    points = np.concatenate([beam.points, beam.points[:1]]) if beam.is_closed else beam.points
    return {
        "ring": beam.ring,
        "closed": beam.is_closed,
        "nodes": len(beam.points),
        "length": float(norm(np.diff(points, axis=0)).sum()),
    }


def _cut_panels(panels: TrimmedPanels) -> dict[str, Any]:
    """Figures of one cut layer; flatness is the distance from the plane through each polygon."""
    return {
        "count": len(panels.polygons),
        "trimmed": int(panels.is_trimmed.sum()),
        "slivers": len(panels.slivers),
        "area_total": float(panels.area.sum()),
        "planarity_max_length": max(plane_deviation(polygon) for polygon in panels.polygons),
        "covered_share": panels.covered_share,
    }


def _network(result: Panelization, origin: Floats) -> dict[str, Any]:
    found, network = result.umbilics, result.network
    angles = np.degrees(network.angles)
    return {
        "kind": network.kind,
        "family_angle_min_deg": float(angles.min(initial=90.0)),
        "family_angle_mean_deg": float(angles.mean()) if len(angles) else None,
        "conjugacy_max": float(network.conjugacy.max(initial=0.0)),
        "focal": [
            {"family": family, "point": (point + origin).tolist()}
            for family, _, point in network.focal
        ],
        "lines": [len(lines) for lines in result.network.families],
        "viability": found.viability if np.isfinite(found.viability) else None,
        "umbilics": [
            {
                "uv": list(u.uv),
                "point": (u.point + origin).tolist(),
                "index": u.index,
                "kind": u.kind,
            }
            for u in found.umbilics
        ],
        "degenerate_share": found.degenerate_fraction,
        "unusable_quads": result.network_mesh.unusable,
        "separate_quads": result.network_mesh.separate,
        **coverage(result.surface, result.mesh, result.inside, result.outline),
    }


def _tolerance(
    report: dict[str, Any],
    result: Panelization,
    design: Design,
    distances: Floats,
    origin: Floats,
) -> list[dict[str, Any]]:
    """Asked, reached and pass for each tolerance that this kind of mesh is judged on."""
    mesh, asked = result.mesh, design.tolerances
    area = area_change(result.start, mesh)
    share = report["panels"]["covered_share"]
    reached: dict[str, float | None] = {
        "flat": max(
            [report["after"]["planarity_max_length"]]
            + [layer["planarity_max_length"] for layer in report["layers"]]
        ),
        "offset": max((layer["distance_error_max"] for layer in report["layers"]), default=None),
        "twist": report["support"]["twist_max_deg"] if report["support"] else None,
        "deviation": report["deviation"]["max"],
        "conical": report["after"]["cone_spread_max"] if "conical" in report["kind"] else None,
        "cover": None if share is None else abs(1.0 - share),
        "deviation_rms": report["deviation"]["rms"],
        "area": area.total,
    }
    places = {
        "deviation": distances_to_surface(mesh, distances).worst(origin),
        "area": area.worst(origin),
    }
    places["deviation_rms"] = places["deviation"]
    if reached["conical"] is not None:
        places["conical"] = spread_of_cones(mesh).worst(origin)
    if report["kind"] == "planar":
        # No constant distance exists for a mesh that is only planar: reported, not judged.
        reached["offset"] = None
    if design.tolerance.area is None:
        # Panels may slide on their surface; what of the site they cover is judged by itself.
        reached["area"] = None
    beyond = max(map(_beyond, report["layers"]), default=0.0)
    if beyond > 0.0:
        # A layer whose edges run backwards is folded, however exact its distance.
        reached["offset"] = max(beyond, reached["offset"] or 0.0)
    return [judged(key, asked[key], reached[key], places.get(key)) for key in asked]


def _beyond(layer: dict[str, Any]) -> float:
    """How far a layer lies beyond the distance at which its first edge reverses."""
    bound = layer["first_reversed_edge_distance"]
    return 0.0 if bound is None else max(abs(layer["distance"]) - abs(bound), 0.0)
