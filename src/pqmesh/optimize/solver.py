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
from dataclasses import dataclass, replace

import numpy as np

from pqmesh.linear import Factor
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.assembly import Assembly, Part
from pqmesh.optimize.ending import Best, Solution, Step, why_stuck
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.problem import Goal, Problem, Refreshing, gathered
from pqmesh.vectors import Floats, Mask, norm

__all__ = ["Solution", "Step", "solve"]

FIRST_PENALTY, LAST_PENALTY, PENALTY_GROWTH = 1e1, 1e8, 10.0
# The soft goals damp the finish where hard goals nearly depend on each other (closed meshes), so
# there they fade further.
FINISH_PENALTY = 1e12
# Inequalities are brought a little inside their slack at last, so that rounding and neighbours do
# not push them out again.
FINISH_ROOM = 0.97
# Steps without a better result after which the descent, or the finish, has had its chance.
PATIENCE = 12
# Longest move of a vertex in one step, in mean edges.
LONGEST_STEP = 0.3
# A face that would break is braked: first as stiff as a hard goal, then ten times as stiff; so
# many tries are made before the whole step is shortened. Brakes ease from step to step.
FIRST_BRAKE, BRAKE_GROWTH, BRAKE_TRIES, BRAKE_EASE, LAST_BRAKE = 1.0, 10.0, 4, 0.3, 1e-4
# A residual within this many roundings of the coordinates, in mean edges, is as good as zero.
ROUNDINGS, EPSILON = 4.0, float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class _State:
    """Where the iteration stands; brakes (F,) as in `Assembly.matrix`."""

    blocks: dict[str, Floats]
    goals: tuple[Goal, ...]
    multipliers: dict[str, Floats]
    penalty: float
    damping: float
    brakes: Floats
    finishing: bool = False


def solve(
    problem: Problem,
    mesh: PolyMesh,
    *,
    most_steps: int = 60,
    progress: Callable[[int, Step], None] | None = None,
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

    References: [thesis] section 6.1 with errata E4, E32.
    """
    guard = Guard.of(mesh)
    assembly = Assembly(problem, mesh)
    blocks = {name: np.array(block) for name, block in problem.blocks.items()}
    brakes = np.zeros(mesh.topology.n_faces)
    state = _State(blocks, problem.goals, {}, FIRST_PENALTY, 1e-9, brakes)
    best = Best(ROUNDINGS * EPSILON * np.abs(mesh.vertices).max() / mesh.mean_edge_length)
    steps: list[Step] = []
    best.offer(state.blocks, state.goals)
    if assembly.size == 0:
        return best.solution((), "every vertex is fixed")
    for number in range(most_steps):
        state, step = _advance(state, assembly, guard, mesh.mean_edge_length)
        if step is None:
            return best.solution(tuple(steps), why_stuck(guard, state.blocks["vertices"]))
        steps.append(step)
        best.offer(state.blocks, state.goals)
        if progress is not None:
            progress(number, step)
        if best.settled(steps):
            return best.solution(tuple(steps), "hard goals reached and nothing moves any more")
        if best.stuck(steps):
            return best.solution(tuple(steps), why_stuck(guard, state.blocks["vertices"]))
        if state.finishing and best.stalled(4 if state.penalty >= FINISH_PENALTY else PATIENCE):
            return best.solution(tuple(steps), best.at_rest())
        # The descent may also go in circles where the normals of a faceted reference jump.
        if not state.finishing and (step.penalty >= LAST_PENALTY or best.stalled(PATIENCE)):
            state = replace(state, finishing=True, multipliers={})
            best.forget()
    return best.solution(tuple(steps), f"stopped after {most_steps} steps")


def _advance(
    state: _State, assembly: Assembly, guard: Guard, length: float
) -> tuple[_State, Step | None]:
    """One accepted step, or None when even tiny ones break a face or raise the merit."""
    if not state.finishing:
        refreshed = tuple(_refreshed(goal, state.blocks) for goal in state.goals)
        state = replace(state, goals=refreshed)
    evaluated = [goal.term.evaluate(gathered(goal.term, state.blocks)) for goal in state.goals]
    residuals = _shifted(state, [residual for residual, _ in evaluated])
    parts = [
        Part(_scale(state, goal, len(residual)), _active(goal, residual, jacobian))
        for goal, residual, (_, jacobian) in zip(state.goals, residuals, evaluated, strict=True)
    ]
    here = _Place(state, assembly, guard, length, parts, _merit(parts, residuals))
    rhs, damping = assembly.descent(parts, residuals), state.damping
    brakes, tries = BRAKE_EASE * state.brakes, BRAKE_TRIES
    brakes[brakes < LAST_BRAKE] = 0.0
    for _ in range(14):
        try:
            factor = assembly.pattern.factor(assembly.matrix(parts, damping, brakes))
            direction = factor.solve(rhs)
        except ArithmeticError:
            damping = max(10.0 * damping, 1e-8)
            continue
        if not np.isfinite(direction).all():
            damping = max(10.0 * damping, 1e-8)
            continue
        taken = here.line_search(direction, factor)
        short = taken is None or taken[1] < here.whole(direction)
        blocking = here.blocking(direction)
        if short and tries and blocking.any():
            tries -= 1
            stiffer = np.maximum(BRAKE_GROWTH * brakes, FIRST_BRAKE)
            brakes = np.where(blocking, stiffer, brakes)
        elif taken is not None:
            return _updated(replace(state, brakes=brakes), *taken, damping, length)
        else:
            damping = max(30.0 * damping, 1e-6)
    return replace(state, damping=damping), None


@dataclass(frozen=True)
class _Place:
    """A point of the iteration, linearised: what a line search from it needs."""

    state: _State
    assembly: Assembly
    guard: Guard
    length: float
    parts: list[Part]
    merit: float

    def line_search(
        self, direction: Floats, factor: Factor
    ) -> tuple[dict[str, Floats], float] | None:
        """Blocks after the longest share of the step that keeps faces valid and lowers the merit.

        Where a full step fails for the curvature of the hard goals alone, it is bent back to
        them once with the factor at hand (second-order correction) before it is shortened.
        """
        share, longest = self.whole(direction), self._longest(direction)
        for _ in range(7):
            blocks = self.assembly.moved(self.state.blocks, share * direction)
            residuals = self._residuals(blocks)
            if residuals is not None:
                # Near the end the merit is flat to rounding: a tiny step is taken as it is.
                if self._lower(residuals) or share * longest < 1e-9 * self.length:
                    return blocks, share
                if share == 1.0:
                    bent = factor.solve(self.assembly.descent(self.parts, residuals))
                    if np.isfinite(bent).all():
                        blocks = self.assembly.moved(blocks, bent)
                        residuals = self._residuals(blocks)
                        if residuals is not None and self._lower(residuals):
                            return blocks, share
            share *= 0.5
        return None

    def whole(self, direction: Floats) -> float:
        """Share of the step at which a vertex moves as far as it may, at most 1."""
        return min(1.0, LONGEST_STEP * self.length / max(self._longest(direction), 1e-300))

    def blocking(self, direction: Floats) -> Mask:
        """Faces (F,) that the whole step would break, or an edge of theirs."""
        step = self.whole(direction) * direction
        blocks = self.assembly.moved(self.state.blocks, step)
        return self.guard.blocked(blocks["vertices"])

    def _longest(self, direction: Floats) -> float:
        """Longest move of a vertex, model unit."""
        moves = self.assembly.moved(
            {"vertices": np.zeros_like(self.state.blocks["vertices"])}, direction
        )
        return float(norm(moves["vertices"]).max(initial=0.0))

    def _residuals(self, blocks: dict[str, Floats]) -> list[Floats] | None:
        """Residuals with multipliers, None where a face or an edge is broken."""
        faces, edges = self.guard.broken(blocks["vertices"])
        if faces.any() or edges.any():
            return None
        terms = [goal.term for goal in self.state.goals]
        return _shifted(self.state, [term.evaluate(gathered(term, blocks))[0] for term in terms])

    def _lower(self, residuals: list[Floats]) -> bool:
        """Whether the merit falls, rounding allowed for."""
        slack = 1e-12 * abs(self.merit) + 1e-300
        return _merit(self.parts, residuals) <= self.merit + slack


def _scale(state: _State, goal: Goal, count: int) -> float:
    """Weight of each residual in the augmented Lagrangian over the penalty."""
    return goal.weight / max(count, 1) / (1.0 if goal.hard else state.penalty)


def _shifted(state: _State, residuals: list[Floats]) -> list[Floats]:
    """Residuals, the hard ones shifted by their multipliers; soft ones count no more at last."""
    result = []
    for goal, residual in zip(state.goals, residuals, strict=True):
        if goal.hard:
            shift = state.multipliers.get(goal.name, 0.0) / state.penalty
            residual = goal.beyond(residual + shift, FINISH_ROOM if state.finishing else 1.0)
        elif state.finishing:
            residual = np.zeros_like(residual)
        result.append(residual)
    return result


def _active(goal: Goal, residual: Floats, jacobian: Floats) -> Floats:
    """Jacobian without the rows of inequalities that hold with room to spare."""
    if goal.slack == 0.0:
        return jacobian
    return np.asarray(np.where((residual != 0.0)[:, :, None, None], jacobian, 0.0))


def _merit(parts: list[Part], residuals: list[Floats]) -> float:
    """Augmented Lagrangian over the penalty."""
    pairs = zip(parts, residuals, strict=True)
    return sum(0.5 * part.scale * float(np.sum(residual**2)) for part, residual in pairs)


def _updated(
    state: _State, blocks: dict[str, Floats], share: float, damping: float, length: float
) -> tuple[_State, Step]:
    """State after an accepted step: multipliers, penalty and damping follow."""
    moved = float(norm(blocks["vertices"] - state.blocks["vertices"]).max(initial=0.0)) / length
    multipliers, hard = dict(state.multipliers), 0.0
    for goal in state.goals:
        if goal.hard:
            residual = goal.term.evaluate(gathered(goal.term, blocks))[0]
            hard = max(hard, float(np.abs(goal.beyond(residual)).max(initial=0.0)))
            # A short step has not solved the inner problem; its multipliers would mislead.
            if share == 1.0 and not state.finishing:
                shift = multipliers.get(goal.name, 0.0) / state.penalty
                multipliers[goal.name] = state.penalty * goal.beyond(residual + shift)
    penalty = state.penalty
    if share == 1.0:
        highest = FINISH_PENALTY if state.finishing else LAST_PENALTY
        penalty = min(penalty * PENALTY_GROWTH, highest)
        damping = max(damping * 0.1, 1e-12)
    elif share < 0.25:
        damping = min(max(damping * 10.0, 1e-8), 1.0)
    step = Step(hard, moved, share, state.penalty)
    return replace(
        state, blocks=blocks, multipliers=multipliers, penalty=penalty, damping=damping
    ), step


def _refreshed(goal: Goal, blocks: dict[str, Floats]) -> Goal:
    """The goal with its term brought up to the current unknowns."""
    if isinstance(goal.term, Refreshing):
        return replace(goal, term=goal.term.refreshed(blocks))
    return goal
