"""Three networks on the roof, each made planar and conical, and what is gained by allowing warp.

Panels of lines of curvature are all but flat and hardly move until they are; those of geodesics
and of parameter lines have far to go, or break. The case study calls this.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pqmesh.mesh.measure import (
    conicality_defect,
    flipped_faces,
    nonconvex_faces,
    planarity,
    planarity_deviation,
)
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.kinds import trace_network
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import CurveNetwork
from pqmesh.network.region import PlanOutline
from pqmesh.offset.offsets import offset_vectors
from pqmesh.offset.support import twist
from pqmesh.optimize.recipes import SURFACE
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import Solution
from pqmesh.report import deviation
from pqmesh.surface.base import Surface
from pqmesh.surface.reference import SurfaceReference

KINDS = ("geodesic", "uv", "principal")
# Edge of the panels that are compared, metres: unaligned ones take long at 1.5 m.
EDGE = 2.0
# Warp that is allowed besides none, metres. Lines of curvature need less than a millimetre, and
# parameter lines take long.
WARPS = {
    "geodesic": (1e-3, 2e-3, 5e-3, 10e-3, 20e-3),
    "uv": (10e-3, 20e-3),
    "principal": (0.2e-3, 0.5e-3, 1e-3, 2e-3, 5e-3, 10e-3, 20e-3),
}
# Panels count as flat up to a warp when they miss it by no more than this, mm.
FLAT_ENOUGH = 0.01


@dataclass(frozen=True, eq=False)
class Start:
    """A network with its mesh, normals upwards, and the surface it lies on."""

    kind: str
    network: CurveNetwork
    mesh: QuadMesh
    reference: SurfaceReference


@dataclass(frozen=True, eq=False)
class Comparison:
    """What became of three networks.

    Attributes
    ----------
    rows : one a start and goal, as `row_of`
    curves : kind to rows of `warp_curve`
    """

    rows: list[dict[str, Any]]
    curves: dict[str, list[dict[str, Any]]]


def start_of(kind: str, surface: Surface, outline: PlanOutline, edge: float) -> Start:
    """The network of a kind over the outline, and its mesh."""
    inside = outline.on(surface)
    network = trace_network(kind, surface, (edge, edge), inside)
    found = quads_from_network(network, inside)
    up = found.mesh.face_area_vectors[:, 2].sum() > 0
    mesh = found.mesh if up else found.mesh.reversed()
    return Start(kind, network, mesh, SurfaceReference(surface, found.uv))


def row_of(start: Start, solution: Solution, goal: str) -> dict[str, Any]:
    """What became of a start: lengths in mm and in mean edges, angles in degrees."""
    before, after = start.mesh, start.mesh.with_vertices(solution.blocks["vertices"])
    away = deviation(before, after, start.reference)
    return {
        "network": start.kind,
        "goal": goal,
        "panels": before.topology.n_faces,
        "flat_before": float(planarity(before).max()),
        "flat_before_mm": 1e3 * float(planarity_deviation(before).max()),
        "balance_before_deg": float(np.degrees(np.abs(conicality_defect(before)[1]).max())),
        "flat_after_mm": 1e3 * float(planarity_deviation(after).max()),
        "balance_after_deg": float(np.degrees(np.abs(conicality_defect(after)[1]).max())),
        "moved_edges": away["moved_max"] / before.mean_edge_length,
        "deviation_mm": 1e3 * away["max"],
        "deviation_rms_mm": 1e3 * away["rms"],
        "twist_deg": float(np.degrees(twist(after, offset_vectors(after, goal).axes).max())),
        "edge_ratio": float(after.edge_lengths.max() / after.edge_lengths.min()),
        "broken": len(nonconvex_faces(after)) + len(flipped_faces(after)),
        "converged": solution.converged,
        "reason": solution.reason,
    }


def made(start: Start, goal: str, warp: float = 0.0) -> dict[str, Any]:
    """A start made planar or conical, with panels out of plane by so many metres at most."""
    return row_of(
        start, optimized(goal, start.mesh, start.reference, weights=SURFACE, warp=warp), goal
    )


def warp_curve(
    start: Start, exact: dict[str, Any], warps: tuple[float, ...]
) -> list[dict[str, Any]]:
    """Distance from the surface against the warp allowed, from exactly flat (given) on; mm."""
    rows = [exact, *(made(start, "planar", warp) for warp in warps)]
    kept = ("flat_after_mm", "deviation_mm", "deviation_rms_mm", "moved_edges")
    return [
        {
            "warp_mm": 1e3 * warp,
            "reached": row["flat_after_mm"] <= 1e3 * warp + FLAT_ENOUGH,
            **{key: row[key] for key in kept},
        }
        for warp, row in zip((0.0, *warps), rows, strict=True)
    ]


def study(surface: Surface, outline: PlanOutline) -> tuple[list[Start], Comparison]:
    """The three networks on a roof, and what becomes of them."""
    starts = [start_of(kind, surface, outline, EDGE) for kind in KINDS]
    rows = [made(start, goal) for start in starts for goal in ("planar", "conical")]
    exact = {row["network"]: row for row in rows if row["goal"] == "planar"}
    curves = {s.kind: warp_curve(s, exact[s.kind], WARPS[s.kind]) for s in starts}
    return starts, Comparison(rows, curves)
