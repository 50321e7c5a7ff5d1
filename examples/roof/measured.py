"""What the case study measures: viability of a network, curvature, flatness, panels as cut."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from make_net import SKETCH_DOME, control_points

from pqmesh.job import Panelization
from pqmesh.mesh.measure import conicality_defect, planarity_deviation, plane_deviation
from pqmesh.network.meshing import NetworkMesh, quads_from_network
from pqmesh.network.principal import CurveNetwork, trace_principal_network
from pqmesh.network.region import PlanOutline
from pqmesh.report import coverage
from pqmesh.surface.base import Surface
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.curvature import first_form, shape_data
from pqmesh.surface.umbilics import UmbilicReport, find_umbilics

# Shares of the sketch's dome on the way from the sketch to the roof.
DOMES = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
# What makes a network viable: no umbilic, edges that differ by no more than this, full cover.
MOST_EDGE_RATIO, LEAST_COVER = 4.0, 0.98


@dataclass(frozen=True, eq=False)
class Traced:
    """A surface over the site with its principal network as far as it goes."""

    surface: Surface
    umbilics: UmbilicReport
    network: CurveNetwork
    mesh: NetworkMesh


def traced(surface: Surface, outline: PlanOutline, edges: tuple[float, float]) -> Traced:
    """Umbilics, network and mesh of a surface, whatever comes of them."""
    inside = outline.on(surface)
    network = trace_principal_network(surface, edges, inside)
    mesh = quads_from_network(network, inside)
    return Traced(surface, find_umbilics(surface, inside), network, mesh)


def viability(found: Traced, outline: PlanOutline) -> dict[str, Any]:
    """Can the network be built? Umbilics with their places, even panels, full cover."""
    mesh = found.mesh.mesh
    lengths = mesh.edge_lengths
    cover = coverage(found.surface, mesh, outline.on(found.surface))["covered_share"]
    ratio = float(lengths.max() / lengths.min())
    good = not found.umbilics.umbilics and ratio <= MOST_EDGE_RATIO and cover >= LEAST_COVER
    return {
        "umbilics": [
            {"kind": u.kind, "index": u.index, "point": list(u.point)}
            for u in found.umbilics.umbilics
        ],
        "gap_min_over_median": found.umbilics.viability,
        "panels": mesh.topology.n_faces,
        "unusable_quads": found.mesh.unusable,
        "covered_share": cover,
        "edge_min": float(lengths.min()),
        "edge_max": float(lengths.max()),
        "edge_ratio": ratio,
        "viable": bool(good),
    }


def character(surface: Surface, outline: PlanOutline) -> dict[str, float]:
    """Shares of the area that are curved like a dome and like a saddle."""
    uv = surface.domain.grid(200, 200).reshape(-1, 2)
    uv = uv[outline.on(surface)(uv)]
    jet = surface.jet(uv)
    weights = np.sqrt(np.linalg.det(first_form(jet)))
    gauss = shape_data(jet).k.prod(axis=1)
    return {
        "dome_share": float(weights[gauss > 0].sum() / weights.sum()),
        "saddle_share": float(weights[gauss < 0].sum() / weights.sum()),
    }


def height_between(surface: Surface, other: Surface, uv: np.ndarray) -> np.ndarray:
    """Distance (n,) of equal parameters (n, 2): a height, since both nets have one plan."""
    return np.linalg.norm(surface.jet(uv).point - other.jet(uv).point, axis=1)


def way(outline: PlanOutline) -> list[dict[str, Any]]:
    """Umbilics and |k1 - k2| while the sketch's dome is lowered to nothing."""
    rows = []
    for share in DOMES:
        surface = BSplineSurface(control_points(share * SKETCH_DOME), (5, 5))
        found = find_umbilics(surface, outline.on(surface))
        rows.append(
            {
                "dome": share * SKETCH_DOME,
                "umbilics": len(found.umbilics),
                "gap_min_over_median": found.viability,
            }
        )
    return rows


def before_after(roof: Panelization) -> dict[str, dict[str, float]]:
    """The table of figure 7.5: out of plane in mm, angle condition in degrees."""
    return {
        name: {
            "out_of_plane_mm": 1e3 * float(planarity_deviation(mesh).max()),
            "angle_condition_deg": float(np.degrees(np.abs(conicality_defect(mesh)[1]).max())),
        }
        for name, mesh in (("before", roof.start), ("after", roof.mesh))
    }


def built(roof: Panelization) -> list[dict[str, float]]:
    """Mesh and layers as they are cut: panels, area, flatness, and cover in plan."""
    assert roof.trimmed is not None
    cuts = [(0.0, roof.trimmed.panels), *zip(roof.spec.distances, roof.trimmed.layers, strict=True)]
    return [
        {
            "distance": distance,
            "panels": len(cut.polygons),
            "cut": int(cut.is_trimmed.sum()),
            "slivers": len(cut.slivers),
            "area": float(cut.area.sum()),
            "flat_max": max(plane_deviation(polygon) for polygon in cut.polygons),
            "plan_cover_error": abs(cut.covered_share - 1.0),
        }
        for distance, cut in cuts
    ]
