"""Gauss-Newton with multipliers: hard goals to rounding error, soft goals as small as these allow.

First the descent. Each step solves the damped normal equations of

    soft(x) + lambda . h(x) + rho/2 |h(x)|^2

and the multipliers follow by lambda += rho h, the penalty rho grows. Unlike a penalty alone this
has no floor: the hard residuals h fall to rounding error while the soft goals keep their say in
what is left free. Where the descent does not settle (strongly curved constraints, a faceted
reference whose normals jump), the finish takes over: Newton's projection onto h = 0, moving as
little as possible in the metric of the soft goals.

Steps keep every face valid (`Guard`). Where faces stand in the way, these few are braked and the
step is solved again, so that the rest of the mesh goes on; only then is it shortened as a whole.

References: method of multipliers [hestenes1969], [powell1969].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pqmesh.linear import Factor
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.assembly import Assembly
from pqmesh.optimize.ending import OUT_OF_MEMORY, SETTLED, Best, Solution, Step, why_stuck
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.place import (
    ENOUGH,
    NEAR,
    ROOM,
    STRAIGHT,
    Place,
    State,
    Taken,
    hardest,
    left_by,
)
from pqmesh.optimize.problem import Problem, Refreshing, residual
from pqmesh.vectors import Floats, norm

__all__ = ["Solution", "Step", "solve"]

FIRST_PENALTY, LAST_PENALTY = 1e1, 1e8
# A start whose hard residuals are near zero begins with a bold penalty: the number of faces squared
# times the second number, for the smoothest modes of a mesh bend hard goals the less the finer it
# is; between the first and the third. It goes back to the ordinary one if the first step leaves
# more than MISSED, was bent more than NEARLY says, or is much longer than allowed.
LEAST_BOLD, BOLD, MOST_BOLD = 1e8, 10.0, 1e12
MISSED, NEARLY, NEAR_SHARE = 1e-4, 1e3, 0.4
# The penalty grows by this factor after a full step; where the hard goals were straight along it
# (residuals before over their bend), by the second times that, up to the third: near the solution
# nothing is gained by small steps of the penalty.
GROWTH, BENT, MOST_GROWTH = 10.0, 0.1, 1e5
# Up to this penalty steps that are followed by rounds need no refinement.
ROUGH = 1e6
# The soft goals damp the finish where hard goals nearly depend on each other (closed meshes), so
# there they fade further.
FINISH_PENALTY = 1e12
# Steps without a better result after which the descent, or the finish, has had its chance.
PATIENCE = 12
# A step that moves no vertex by more than this, in mean edges, finds the soft goals at rest.
# So many steps at the last penalty are waited for that.
AT_REST, RESTLESS = 1e-2, 4
# A face that would break is braked: first as stiff as a hard goal, then ten times as stiff; so
# many tries are made before the whole step is shortened. Brakes ease from step to step.
FIRST_BRAKE, BRAKE_GROWTH, BRAKE_TRIES, BRAKE_EASE, LAST_BRAKE = 1.0, 10.0, 4, 0.3, 1e-4
# A residual within this many roundings of the coordinates, in mean edges, is as good as zero.
ROUNDINGS, EPSILON = 4.0, float(np.finfo(np.float64).eps)


def solve(
    problem: Problem,
    mesh: PolyMesh,
    *,
    most_steps: int = 60,
    progress: Callable[[int, Step], None] | None = None,
    resting: float = SETTLED,
    bold: float | None = None,
    enough: float = ENOUGH,
    assembly: Assembly | None = None,
    guard: Guard | None = None,
) -> Solution:
    """Optimised unknowns of a problem whose block `vertices` is a mesh.

    Steps are shortened until no face breaks (`Guard`) and the merit falls; the damping rises
    when that fails. Ending without convergence is an answer, not an error.

    Parameters
    ----------
    problem : Problem
    mesh : PolyMesh
        The start; its faces and edges are guarded.
    most_steps : int
    progress : callable, optional
        Called after each step.
    resting : float
        Largest move of the last step, in mean edges.
    bold : float, optional
        First penalty of a start whose hard residuals are near zero; by the number of faces.
    enough : float
        Share of their tolerance that hard residuals are brought to with the factor at hand.
    assembly : Assembly, optional
        Of a problem with the same stencils, fixed rows and linear terms: the work on the pattern
        is not done again.
    guard : Guard, optional
        Other limits than those of the start.

    References: [thesis] section 6.1 with errata E4, E32.
    """
    guard = guard or Guard.of(mesh)
    length = mesh.mean_edge_length
    blocks = {name: np.array(block) for name, block in problem.blocks.items()}
    brakes = np.zeros(mesh.topology.n_faces)
    residuals = left_by(problem.goals, blocks)
    near = hardest(problem.goals, residuals) < NEAR
    if bold is None:
        bold = min(max(BOLD * mesh.topology.n_faces**2, LEAST_BOLD), MOST_BOLD)
    penalty, fallback = (bold, FIRST_PENALTY) if near else (FIRST_PENALTY, 0.0)
    state = State(
        blocks, problem.goals, residuals, {}, penalty, 1e-9, brakes, near, fallback, enough=enough
    )
    best = Best(ROUNDINGS * EPSILON * np.abs(mesh.vertices).max() / length)
    best.offer(state.blocks, state.goals, state.residuals)
    steps: list[Step] = []

    def ended(reason: str) -> Solution:
        return best.solution(tuple(steps), reason)

    try:
        assembly = assembly or Assembly(problem, mesh)
        if assembly.size == 0:
            return ended("every vertex is fixed")
        for number in range(most_steps):
            state, step = _advance(state, assembly, guard, length)
            if step is None:
                return ended(why_stuck(guard, state.blocks["vertices"]))
            steps.append(step)
            best.offer(state.blocks, state.goals, state.residuals)
            if progress is not None:
                progress(number, step)
            if best.settled(steps, resting):
                return ended("hard goals reached and nothing moves any more")
            if best.stuck(steps):
                return ended(why_stuck(guard, state.blocks["vertices"]))
            if state.finishing and best.stalled(4 if step.penalty >= FINISH_PENALTY else PATIENCE):
                return ended(best.at_rest())
            # The descent may also go in circles where the normals of a faceted reference jump.
            if not state.finishing and (_descended(steps) or best.stalled(PATIENCE)):
                state = replace(state, finishing=True, multipliers={})
                best.forget()
    except MemoryError:
        # What is found is kept: a mesh too large for the machine is no reason to lose it.
        return ended(OUT_OF_MEMORY)
    return ended(f"stopped after {most_steps} steps")


def _descended(steps: list[Step]) -> bool:
    """The penalty is at its end, and the soft goals have come to rest or had their time."""
    last = [step for step in steps[-RESTLESS:] if step.penalty >= LAST_PENALTY]
    return len(last) == RESTLESS or (bool(last) and last[-1].moved < AT_REST)


def _fallen_back(state: State) -> State:
    """The state with a bold penalty taken back: the ordinary way from here."""
    return replace(state, fallback=0.0, straight=False, penalty=state.fallback)


def _advance(
    state: State, assembly: Assembly, guard: Guard, length: float
) -> tuple[State, Step | None]:
    """One accepted step, or None when even tiny ones break a face or raise the merit."""
    if not state.finishing:
        state = _refreshed(state)
    here = Place.of(state, assembly, guard, length)
    slope, damping = here.slope(), state.damping
    exactly = state.straight or state.finishing
    brakes, tries = BRAKE_EASE * state.brakes, BRAKE_TRIES
    brakes[brakes < LAST_BRAKE] = 0.0
    factor: Factor | None
    for _ in range(14):
        factor = None  # The one of the last try makes room for the next.
        try:
            factor = assembly.factor(assembly.matrix(here.parts, damping, brakes))
            # With moderate penalties rounds make up for the digits of a rough step.
            direction = factor.solve(slope, rough=exactly and state.penalty <= ROUGH)
        except ArithmeticError:
            damping = max(10.0 * damping, 1e-8)
            continue
        if not np.isfinite(direction).all():
            damping = max(10.0 * damping, 1e-8)
            continue
        if state.fallback and here.whole(direction) < NEAR_SHARE:
            return _advance(_fallen_back(state), assembly, guard, length)
        place, direction, taken = _taken(here, direction, factor, exactly and state.penalty > ROUGH)
        short = taken is None or taken.share < place.whole(direction)
        blocking = place.blocking(direction) if short and tries else None
        if blocking is not None and blocking.any():
            tries -= 1
            stiffer = np.maximum(BRAKE_GROWTH * brakes, FIRST_BRAKE)
            brakes = np.where(blocking, stiffer, brakes)
        elif taken is not None:
            straight = place.straightness(direction, taken)
            if exactly and hardest(state.goals, taken.residuals) < NEAR:
                taken = place.brought_back(taken, factor)
            return _updated(replace(place.state, brakes=brakes), taken, damping, straight, length)
        else:
            damping = max(30.0 * damping, 1e-6)
    return replace(state, damping=damping), None


def _taken(
    here: Place, direction: Floats, factor: Factor, exactly: bool
) -> tuple[Place, Floats, Taken | None]:
    """The step to take: with exact multipliers if asked and if it may be taken whole."""
    if exactly:
        # Where goals nearly depend on each other, the exact step goes far for nothing.
        place, step = here.sharpened(direction, factor)
        taken = place.line_search(step, factor)
        if taken is not None and taken.share == 1.0:
            return place, step, taken
    return here, direction, here.line_search(direction, factor)


def _updated(
    state: State, taken: Taken, damping: float, straight: float, length: float
) -> tuple[State, Step]:
    """State after an accepted step: multipliers, penalty and damping follow."""
    moves = norm(taken.blocks["vertices"] - state.blocks["vertices"])
    multipliers, hard = dict(state.multipliers), hardest(state.goals, taken.residuals)
    # A short step has not solved the inner problem; its multipliers would mislead.
    if taken.share == 1.0 and not state.finishing:
        for goal, own in zip(state.goals, taken.residuals, strict=True):
            if goal.hard:
                shift = multipliers.get(goal.name, 0.0) / state.penalty
                multipliers[goal.name] = state.penalty * goal.beyond(own + shift, ROOM)
    penalty = state.penalty
    fallback = state.fallback if taken.share < 1.0 and straight >= STRAIGHT else 0.0
    if state.fallback and straight < NEARLY and hard > MISSED:
        penalty, multipliers, fallback = state.fallback, {}, 0.0
    elif taken.share == 1.0:
        highest = FINISH_PENALTY if state.finishing else max(LAST_PENALTY, penalty)
        growth = min(BENT * straight, MOST_GROWTH) if straight >= STRAIGHT else GROWTH
        if growth > GROWTH and not state.finishing:
            fallback = min(penalty * GROWTH, LAST_PENALTY)
        penalty = min(penalty * growth, highest)
        damping = max(damping * 0.1, 1e-12)
    elif taken.share < 0.25:
        damping = min(max(damping * 10.0, 1e-8), 1.0)
    moved = float(moves.max(initial=0.0)) / length
    step = Step(hard, moved, taken.share, state.penalty, straight >= STRAIGHT)
    return replace(
        state,
        blocks=taken.blocks,
        residuals=taken.residuals,
        multipliers=multipliers,
        penalty=penalty,
        damping=damping,
        straight=straight >= STRAIGHT,
        fallback=fallback,
    ), step


def _refreshed(state: State) -> State:
    """The state with terms that follow the unknowns brought up to date."""
    goals, residuals = list(state.goals), list(state.residuals)
    for index, goal in enumerate(goals):
        if isinstance(goal.term, Refreshing):
            term = goal.term.refreshed(state.blocks)
            if term is not goal.term:
                goals[index] = replace(goal, term=term)
                residuals[index] = residual(term, state.blocks)
    return replace(state, goals=tuple(goals), residuals=tuple(residuals))
