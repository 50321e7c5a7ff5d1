"""How strongly to hold on to the reference: as strongly as the mesh can bear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.conflicts import answered, hopeless, without
from pqmesh.optimize.constraints import Constraints
from pqmesh.optimize.problem import Problem
from pqmesh.optimize.recipes import Weights, problem_for
from pqmesh.optimize.solver import Solution, Step, solve
from pqmesh.surface.reference import Reference
from pqmesh.vectors import norm

# Closeness is relaxed or raised by this factor between tries, within these bounds.
FACTOR, WEAKEST, STRONGEST = 10.0, 1.0, 1e7


def optimized(
    kind: str,
    start: QuadMesh,
    reference: Reference,
    *,
    boundary: str = "free",
    within: float | None = None,
    warp: float = 0.0,
    constraints: Constraints | None = None,
    progress: Callable[[Step], None] | None = None,
) -> Solution:
    """Solution of a recipe with a closeness that the mesh can bear.

    A strong pull to the reference keeps the design, but may hold a mesh that has far to go in
    front of a fold; then the pull is relaxed and the try repeated from the start. With `within`
    the pull is raised until every vertex is that close.

    Parameters
    ----------
    kind : 'planar', 'conical' or 'circular'
    start : QuadMesh
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

    def problem(weights: Weights) -> Problem:
        return problem_for(
            kind,
            start,
            reference,
            boundary=boundary,
            weights=weights,
            warp=warp,
            constraints=constraints,
        )

    def attempt(weights: Weights) -> Solution:
        possible = without(problem(weights), impossible)
        return solve(possible, start, progress=lambda _, step: progress(step) if progress else None)

    impossible = [] if boundary == "free" else hopeless(problem(Weights()), start)
    weights = Weights()
    best = solution = attempt(weights)
    while not solution.converged and weights.closeness / FACTOR >= WEAKEST:
        weights = replace(weights, closeness=weights.closeness / FACTOR)
        solution = attempt(weights)
        if solution.converged or _worst(solution) < _worst(best):
            best = solution
    while (
        within is not None
        and best.converged
        and _distance(best, reference) > within
        and weights.closeness * FACTOR <= STRONGEST
    ):
        weights = replace(weights, closeness=weights.closeness * FACTOR)
        solution = attempt(weights)
        if not solution.converged or _distance(solution, reference) > _distance(best, reference):
            break
        best = solution
    return best if boundary == "free" else answered(best, impossible, start)


def _worst(solution: Solution) -> float:
    """Largest hard residual."""
    return max(solution.residuals.values(), default=0.0)


def _distance(solution: Solution, reference: Reference) -> float:
    """Largest distance of a vertex to the reference."""
    vertices = solution.blocks["vertices"]
    return float(norm(vertices - reference.closest(vertices)[0]).max())
