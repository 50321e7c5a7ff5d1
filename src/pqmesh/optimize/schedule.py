"""How strongly to hold on to the reference: as strongly as the mesh can bear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pqmesh.mesh.conjugacy import conjugacy
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.optimize.conflicts import answered, hopeless, without
from pqmesh.optimize.constraints import Constraints
from pqmesh.optimize.ending import OUT_OF_MEMORY
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.multilevel import coarse_to_fine
from pqmesh.optimize.problem import Problem, Term, gathered
from pqmesh.optimize.recipes import LOOSE, Weights, problem_for
from pqmesh.optimize.solver import Solution, Step, solve
from pqmesh.optimize.terms.curves import OnCurve
from pqmesh.surface.reference import Reference
from pqmesh.vectors import far_origin, norm

# A mesh that does not come right is tried again with less of a hold on surface and places.
TRIES = (Weights(), Weights(closeness=10.0, anchor=0.01), LOOSE)
# To stay within a distance, closeness is raised by this factor between tries, up to the second;
# what came by way of coarser meshes starts at the last.
FACTOR, STRONGEST, WEAKEST = 10.0, 1e7, 1.0


def optimized(
    kind: str,
    start: PolyMesh,
    reference: Reference,
    *,
    boundary: str = "free",
    within: float | None = None,
    warp: float = 0.0,
    constraints: Constraints | None = None,
    progress: Callable[[Step], None] | None = None,
) -> Solution:
    """Solution of a recipe with a closeness that the mesh can bear.

    A net that is far from conjugate goes by way of coarser meshes (`coarse_to_fine`).

    A strong pull to the reference keeps the design, but may hold a mesh that has far to go in
    front of a fold; then the pull is relaxed and the try repeated from the start. With `within`
    the pull is raised until every vertex is that close.

    Parameters
    ----------
    kind : 'planar', 'conical', 'circular' or 'conical-circular'
    start : PolyMesh
    reference : Reference
    boundary : 'free', 'fixed' or 'glide'
    within : float, optional, model unit
    warp : float, model unit
        Panels may be out of plane by so much; the rest of the freedom goes to the soft goals.
    constraints : Constraints, optional
        What is asked of the mesh beside.
    progress : callable, optional
        Called with every step.

    Returns
    -------
    Solution
        The first that converges; else the one with the smallest hard residuals. Where a boundary
        that stays forbids some faces, the rest is solved, and the reason names them; where it
        leaves too little room, the reason names the worst faces.

    Raises
    ------
    SpecError
        For an unknown kind or boundary, and for constraints that contradict each other.
    """
    origin = far_origin(start.vertices)
    if origin.any():
        # Far from the origin coordinates have few digits left for what is between them.
        found = optimized(
            kind,
            start.with_vertices(start.vertices - origin),
            reference.about(origin),
            boundary=boundary,
            within=within,
            warp=warp,
            constraints=None if constraints is None else constraints.about(origin),
            progress=progress,
        )
        moved = found.blocks | {"vertices": found.blocks["vertices"] + origin}
        return replace(found, blocks=moved)

    def problem(weights: Weights, first: PolyMesh) -> Problem:
        return problem_for(
            kind,
            first,
            reference,
            boundary=boundary,
            weights=weights,
            warp=warp,
            constraints=constraints,
        )

    def attempt(weights: Weights, first: PolyMesh) -> Solution:
        possible = without(problem(weights, first), impossible)
        return solve(possible, first, progress=lambda _, step: progress(step) if progress else None)

    def by_levels() -> Solution | None:
        if boundary == "glide" or constraints is not None or not start.topology.is_quad:
            return None
        quads = QuadMesh(start.vertices, start.topology)
        return coarse_to_fine(
            kind, quads, reference, boundary=boundary, warp=warp, progress=progress
        )

    impossible = [] if boundary == "free" else hopeless(problem(Weights(), start), start)
    far = conjugacy(start).lines_are_far
    best, weights, first = (by_levels() if far else None), Weights(), start
    if best is not None and best.converged:
        # The design is where the levels led; from there it may be pulled closer.
        first = start.with_vertices(best.blocks["vertices"])
        weights = replace(weights, closeness=WEAKEST)
    else:
        # Where the boundary forbids some faces it leaves the others little room.
        tries = TRIES[1:] if impossible else TRIES
        best, weights = _relaxed(attempt, tries, start, best)
        if not best.converged and not far and best.reason != OUT_OF_MEMORY:
            best = _better(best, by_levels())
    while (
        within is not None
        and best.converged
        and _distance(best, reference) > within
        and weights.closeness * FACTOR <= STRONGEST
    ):
        weights = replace(weights, closeness=weights.closeness * FACTOR)
        solution = attempt(weights, first)
        if not solution.converged or _distance(solution, reference) > _distance(best, reference):
            break
        best = solution
    if boundary == "free":
        return best
    best = _on_curves(best, without(problem(weights, start), impossible), start)
    return answered(best, impossible, start)


def _relaxed(
    attempt: Callable[[Weights, PolyMesh], Solution],
    tries: tuple[Weights, ...],
    start: PolyMesh,
    best: Solution | None,
) -> tuple[Solution, Weights]:
    """Tries with a weaker and weaker hold, until one converges; and its weights."""
    first, *others = tries
    weights, found = first, _better(attempt(first, start), best)
    for weights in others:
        if found.converged or found.reason == OUT_OF_MEMORY:
            break
        found = _better(attempt(weights, start), found)
    return found, weights


def _on_curves(best: Solution, problem: Problem, start: PolyMesh) -> Solution:
    """A mesh that did not converge, put on the curves that it was to lie on.

    What cannot be met elsewhere is no reason to leave them: they are the joints to other parts.
    Where a face would break, its vertices stay.
    """
    curves = [goal.term for goal in problem.goals if goal.hard and isinstance(goal.term, OnCurve)]
    if best.converged or not curves:
        return best
    before, guard = best.blocks["vertices"], Guard.of(start)
    on_curves = before.copy()
    for each in curves:
        rows = each.stencils["vertices"][:, 0]
        on_curves[rows], _ = each.curves.feet(before[rows], each.curves.nearest(before[rows]))
    vertices = on_curves
    while (blocked := guard.blocked(vertices) & ~guard.blocked(before)).any():
        stays = np.isin(
            np.arange(len(before)), start.topology.indices[blocked[start.topology.corner_faces]]
        )
        vertices = np.where(stays[:, None], before, vertices)
    blocks = best.blocks | {"vertices": vertices}
    residuals = {}
    for goal in problem.goals:
        if goal.hard:
            term: Term = goal.term
            if isinstance(term, OnCurve):
                rows = term.stencils["vertices"][:, 0]
                term = replace(term, segments=term.curves.nearest(vertices[rows]))
            found, _ = term.evaluate(gathered(term, blocks))
            residuals[goal.name] = float(np.abs(found).max(initial=0.0))
    return replace(best, blocks=blocks, residuals=residuals)


def _better(solution: Solution, other: Solution | None) -> Solution:
    """The one that converged, or else has the smaller residuals."""
    if other is None or (solution.converged and not other.converged):
        return solution
    if other.converged or _worst(other) < _worst(solution):
        return other
    return solution


def _worst(solution: Solution) -> float:
    """Largest hard residual."""
    return max(solution.residuals.values(), default=0.0)


def _distance(solution: Solution, reference: Reference) -> float:
    """Largest distance of a vertex to the reference."""
    vertices = solution.blocks["vertices"]
    return float(norm(vertices - reference.closest(vertices)[0]).max())
