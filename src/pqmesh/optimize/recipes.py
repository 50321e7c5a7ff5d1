"""Ready problems: planar, conical and circular meshes near a reference surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.constrained import constrained
from pqmesh.optimize.constraints import Constraints
from pqmesh.optimize.problem import Goal, Problem, Term
from pqmesh.optimize.selection import boundary_corners
from pqmesh.optimize.terms import (
    Circularity,
    Closeness,
    Cone,
    Conicality,
    EdgeParallel,
    Gliding,
    Planarity,
    PolygonPlanarity,
    anchor,
    fairness,
    held_edges,
)
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats, Indices

NONE = np.empty(0, dtype=np.int64)
KINDS = ("planar", "conical", "circular", "conical-circular")
BOUNDARIES = ("free", "fixed", "glide")


@dataclass(frozen=True)
class Weights:
    """Weights of the soft goals, on mean squares of residuals in mean edges.

    A vertex may slide about four times as far as it leaves the surface: where a net is noisy, or
    hardly short of its class, it stays where it is. Neighbours go along, which keeps lines that
    have to give way from a zigzag.
    """

    closeness: float = 50.0
    edges: float = 1.0
    fairness: float = 5.0
    anchor: float = 3.0


# For nets laid on a surface: where on it the vertices are is of little account.
SURFACE = Weights(closeness=100.0, fairness=0.1, anchor=1e-3)
# For nets that have far to go: the surface pulls as strongly as the edges hold on to each other,
# and the places of the vertices hardly count. Ten times the closeness keeps a coarse net three
# times as close to the surface, and slides it twice as far along it.
LOOSE = Weights(closeness=1.0, fairness=0.1, anchor=1e-3)


def problem_for(
    kind: str,
    mesh: PolyMesh,
    reference: Reference,
    *,
    boundary: str = "free",
    weights: Weights | None = None,
    warp: float = 0.0,
    constraints: Constraints | None = None,
    flat_edges: Indices | None = None,
) -> Problem:
    """Problem whose solution is a mesh of the given kind close to start and reference.

    Parameters
    ----------
    kind : 'planar', 'conical', 'circular' or 'conical-circular'
        The last is both at once: principal nets of few surfaces are, those of revolution among
        them.
    mesh : PolyMesh
        Faces of any size: triangles are flat and circular, polygons with more than four corners
        have k - 3 equations for each property. A vertex is asked to be conical when it is
        interior and of valence 4 or more; three planes always touch a cone.
    reference : Reference
    boundary : 'free', 'fixed' or 'glide'
        Boundary vertices move freely, stay, or move on the boundary curve of the start, whose
        corners stay.
    weights : Weights, optional
    warp : float, model unit
        Panels may be out of plane by so much (distance of the diagonals, for polygons each of
        their `PolygonPlanarity`).
    constraints : Constraints, optional
        What is asked of the mesh beside.
    flat_edges : (n,), optional
        Edges of a conical mesh whose ends need axes in a plane with them (`skew_edges`).

    Raises
    ------
    SpecError
        For an unknown kind or boundary, and for constraints that contradict each other.
    """
    if boundary not in BOUNDARIES:
        raise SpecError(
            f"The boundary must be one of {', '.join(BOUNDARIES)}; found {boundary!r}. Choose one."
        )
    weights = weights or Weights()
    goals, blocks = hard_goals(kind, mesh, warp / mesh.mean_edge_length, flat_edges)
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


def hard_goals(
    kind: str, mesh: PolyMesh, slack: float = 0.0, flat_edges: Indices | None = None
) -> tuple[list[Goal], dict[str, Floats]]:
    """What makes a mesh of the given kind, and the start of its unknowns.

    Parameters
    ----------
    kind : one of `KINDS`
    mesh : PolyMesh
    slack : float
        Faces may be out of plane by so much, in mean edges.
    flat_edges : (n,), optional
        Edges between inner vertices whose faces may lie in one plane: of a conical mesh, the axes
        of their ends have to lie in a plane with them.

    Raises
    ------
    SpecError
        For an unknown kind.
    """
    if kind not in KINDS:
        raise SpecError(f"The kind must be one of {', '.join(KINDS)}; found {kind!r}. Choose one.")
    blocks = {"vertices": mesh.vertices}
    goals = _planarity(mesh, slack)
    if "conical" in kind:
        edges = NONE if flat_edges is None else flat_edges
        ends = np.unique(mesh.edges[edges])
        # Two planes touch a cone whatever their angles: the balance is asked for beside it.
        goals.append(Goal("conicality", Conicality.on(mesh), hard=True, tolerance=1e-11))
        axes = Cone.start_axes(mesh, ends)
        if len(axes):
            blocks["axes"] = axes
            goals += _cones(mesh, ends)
        if len(edges):
            aligned = EdgeParallel.between_axes(mesh, edges)
            goals.append(Goal("twist", aligned, hard=True, tolerance=1e-11))
    if "circular" in kind:
        goals.append(Goal("circularity", Circularity.on(mesh), hard=True, tolerance=1e-11))
    return goals, blocks


def _planarity(mesh: PolyMesh, slack: float) -> list[Goal]:
    """Goals that make every face flat: one for quads, and one for each size of polygons."""
    terms: dict[str, Term] = {"planarity": Planarity.on(mesh)}
    for _, corners in mesh.topology.face_groups:
        size = corners.shape[1]
        if size > 4:
            terms[f"planarity of {size}-gons"] = PolygonPlanarity.on(mesh, size)
    return _shared(terms, tolerance=1e-12, slack=slack)


def _cones(mesh: PolyMesh, also: Indices) -> list[Goal]:
    """Goals of the cones at vertices with an axis: one for each size of faces there."""
    terms: dict[str, Term] = {"cone": Cone.on(mesh, also=also)}
    for _, corners in mesh.topology.face_groups:
        size = corners.shape[1]
        if size != 4:
            terms[f"cone of {size}-gons"] = Cone.on(mesh, size, also)
    return _shared(terms, tolerance=1e-11)


def _shared(terms: dict[str, Term], *, tolerance: float, slack: float = 0.0) -> list[Goal]:
    """Hard goals that share one weight by the number of their elements.

    A lone pentagon among a thousand quads then counts as much as one of them.
    """
    counts = {name: len(term.stencils["vertices"]) for name, term in terms.items()}
    total = sum(counts.values())
    if not total:
        name, term = next(iter(terms.items()))
        return [Goal(name, term, hard=True, tolerance=tolerance, slack=slack)]
    return [
        Goal(name, term, counts[name] / total, hard=True, tolerance=tolerance, slack=slack)
        for name, term in terms.items()
        if counts[name]
    ]
