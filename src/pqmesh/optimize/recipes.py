"""Ready problems: planar, conical and circular meshes near a reference surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.constrained import constrained
from pqmesh.optimize.constraints import Constraints
from pqmesh.optimize.problem import Goal, Problem
from pqmesh.optimize.selection import boundary_corners
from pqmesh.optimize.terms import (
    Circularity,
    Closeness,
    Cone,
    Conicality,
    Gliding,
    Planarity,
    anchor,
    fairness,
    held_edges,
)
from pqmesh.surface.reference import Reference

KINDS = ("planar", "conical", "circular")
BOUNDARIES = ("free", "fixed", "glide")


@dataclass(frozen=True)
class Weights:
    """Weights of the soft goals, on mean squares of residuals in mean edges."""

    closeness: float = 100.0
    edges: float = 1.0
    fairness: float = 0.1
    anchor: float = 1e-3


def problem_for(
    kind: str,
    mesh: QuadMesh,
    reference: Reference,
    *,
    boundary: str = "free",
    weights: Weights | None = None,
    warp: float = 0.0,
    constraints: Constraints | None = None,
) -> Problem:
    """Problem whose solution is a mesh of the given kind close to start and reference.

    Parameters
    ----------
    kind : 'planar', 'conical' or 'circular'
    mesh : QuadMesh
    reference : Reference
    boundary : 'free', 'fixed' or 'glide'
        Boundary vertices move freely, stay, or move on the boundary curve of the start, whose
        corners stay.
    weights : Weights, optional
    warp : float, model unit
        Panels may be out of plane by so much (distance of the diagonals).
    constraints : Constraints, optional
        What is asked of the mesh beside.

    Raises
    ------
    SpecError
        For an unknown kind or boundary, and for constraints that contradict each other.
    """
    if kind not in KINDS:
        raise SpecError(f"The kind must be one of {', '.join(KINDS)}; found {kind!r}. Choose one.")
    if boundary not in BOUNDARIES:
        raise SpecError(
            f"The boundary must be one of {', '.join(BOUNDARIES)}; found {boundary!r}. Choose one."
        )
    weights = weights or Weights()
    blocks = {"vertices": mesh.vertices}
    slack = warp / mesh.mean_edge_length
    goals = [Goal("planarity", Planarity.on(mesh), hard=True, tolerance=1e-12, slack=slack)]
    if kind == "conical":
        goals.append(Goal("conicality", Conicality.on(mesh), hard=True, tolerance=1e-11))
        axes = Cone.start_axes(mesh)
        if len(axes):
            blocks["axes"] = axes
            goals.append(Goal("cone", Cone.on(mesh), hard=True, tolerance=1e-11))
    if kind == "circular":
        goals.append(Goal("circularity", Circularity.on(mesh), hard=True, tolerance=1e-11))
    goals += [
        Goal("closeness", Closeness.on(mesh, reference), weights.closeness),
        Goal("edges", held_edges(mesh), weights.edges),
        Goal("fairness", fairness(mesh), weights.fairness),
        Goal("anchor", anchor(mesh), weights.anchor),
    ]
    fixed = {}
    if boundary == "fixed":
        fixed["vertices"] = mesh.topology.is_boundary_vertex
    if boundary == "glide" and mesh.topology.is_boundary_vertex.any():
        corners = boundary_corners(mesh)
        fixed["vertices"] = corners
        gliding = np.flatnonzero(mesh.topology.is_boundary_vertex & ~corners)
        if len(gliding):
            goals.append(Goal("glide", Gliding.on(mesh, gliding), hard=True))
    problem = Problem(blocks, tuple(goals), fixed)
    return constrained(problem, mesh, reference, constraints) if constraints else problem
