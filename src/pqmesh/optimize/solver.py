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
from typing import NamedTuple

import numpy as np

from pqmesh.linear import Factor
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.assembly import Assembly, Part, Residuals
from pqmesh.optimize.ending import OUT_OF_MEMORY, SETTLED, Best, Solution, Step, why_stuck
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.problem import Goal, Problem, Refreshing, gathered
from pqmesh.vectors import TINY, Floats, Mask, norm

__all__ = ["Solution", "Step", "solve"]

FIRST_PENALTY, LAST_PENALTY = 1e1, 1e8
# A start whose hard residuals are below the second number is taken for near: the first penalty is
# then the first number, and goes back to the ordinary one if the first step leaves more than the
# last.
# So it does where the step is longer than allowed by more than this share.
NEAR_PENALTY, NEAR, MISSED, NEAR_SHARE = 1e6, 0.02, 1e-4, 0.4
# The penalty grows by this factor after a full step; where the hard goals were straight along it
# (residuals before over their bend), by the second times that, up to the third: near the solution
# nothing is gained by small steps of the penalty.
GROWTH, BENT, MOST_GROWTH = 10.0, 0.1, 1e5
# This straight, the goals are met exactly in one step: the linearised problem is solved to so
# small a share of the residuals, by so many more solutions with the factor at hand. A start taken
# for near has to be as straight as the last number.
STRAIGHT, EXACT, CORRECTIONS, NEARLY = 1e4, 1e-4, 5, 1e3
# Rounds of Newton's method with an old factor, each of which has to leave less than such a share.
ROUNDS, WORTH = 8, 0.3
# The soft goals damp the finish where hard goals nearly depend on each other (closed meshes), so
# there they fade further.
FINISH_PENALTY = 1e12
# Inequalities are brought a little inside their slack at last, so that rounding and neighbours do
# not push them out again.
FINISH_ROOM = 0.97
# Steps without a better result after which the descent, or the finish, has had its chance.
PATIENCE = 12
# A step that moves no vertex by more than this, in mean edges, finds the soft goals at rest.
# So many steps at the last penalty are waited for that.
AT_REST, RESTLESS = 1e-2, 4
# Longest move of a vertex in one step, in mean edges.
LONGEST_STEP = 0.3
# A face that would break is braked: first as stiff as a hard goal, then ten times as stiff; so
# many tries are made before the whole step is shortened. Brakes ease from step to step.
FIRST_BRAKE, BRAKE_GROWTH, BRAKE_TRIES, BRAKE_EASE, LAST_BRAKE = 1.0, 10.0, 4, 0.3, 1e-4
# A residual within this many roundings of the coordinates, in mean edges, is as good as zero.
ROUNDINGS, EPSILON = 4.0, float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class _State:
    """Where the iteration stands; values are (residual, Jacobian) of each goal there."""

    blocks: dict[str, Floats]
    goals: tuple[Goal, ...]
    values: tuple[tuple[Floats, Floats], ...]
    multipliers: dict[str, Floats]
    penalty: float
    damping: float
    brakes: Floats
    straight: bool = False
    fallback: float = 0.0
    finishing: bool = False


def solve(
    problem: Problem,
    mesh: PolyMesh,
    *,
    most_steps: int = 60,
    progress: Callable[[int, Step], None] | None = None,
    resting: float = SETTLED,
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
    values = _evaluated(problem.goals, blocks)
    near = _hardest(problem.goals, values) < NEAR
    penalty, fallback = (NEAR_PENALTY, FIRST_PENALTY) if near else (FIRST_PENALTY, 0.0)
    state = _State(blocks, problem.goals, values, {}, penalty, 1e-9, brakes, near, fallback)
    best = Best(ROUNDINGS * EPSILON * np.abs(mesh.vertices).max() / length)
    steps: list[Step] = []
    best.offer(state.blocks, state.goals, state.values)
    try:
        assembly = assembly or Assembly(problem, mesh)
    except MemoryError:
        return best.solution((), OUT_OF_MEMORY)
    if assembly.size == 0:
        return best.solution((), "every vertex is fixed")
    for number in range(most_steps):
        try:
            state, step = _advance(state, assembly, guard, length)
        except MemoryError:
            return best.solution(tuple(steps), OUT_OF_MEMORY)
        if step is None:
            return best.solution(tuple(steps), why_stuck(guard, state.blocks["vertices"]))
        steps.append(step)
        best.offer(state.blocks, state.goals, state.values)
        if progress is not None:
            progress(number, step)
        if best.settled(steps, resting):
            return best.solution(tuple(steps), "hard goals reached and nothing moves any more")
        if best.stuck(steps):
            return best.solution(tuple(steps), why_stuck(guard, state.blocks["vertices"]))
        if state.finishing and best.stalled(4 if step.penalty >= FINISH_PENALTY else PATIENCE):
            return best.solution(tuple(steps), best.at_rest())
        # The descent may also go in circles where the normals of a faceted reference jump.
        if not state.finishing and (_descended(steps) or best.stalled(PATIENCE)):
            state = replace(state, finishing=True, multipliers={})
            best.forget()
    return best.solution(tuple(steps), f"stopped after {most_steps} steps")


def _descended(steps: list[Step]) -> bool:
    """The penalty is at its end, and the soft goals have come to rest or had their time."""
    last = [step for step in steps[-RESTLESS:] if step.penalty >= LAST_PENALTY]
    return len(last) == RESTLESS or (bool(last) and last[-1].moved < AT_REST)


def _hardest(goals: tuple[Goal, ...], values: tuple[tuple[Floats, Floats], ...]) -> float:
    """Largest residual of a hard goal beyond its slack."""
    return max(
        (
            float(np.abs(goal.beyond(residual)).max(initial=0.0))
            for goal, (residual, _) in zip(goals, values, strict=True)
            if goal.hard
        ),
        default=0.0,
    )


def _evaluated(
    goals: tuple[Goal, ...], blocks: dict[str, Floats]
) -> tuple[tuple[Floats, Floats], ...]:
    """Residual and Jacobian of every goal."""
    return tuple(goal.term.evaluate(gathered(goal.term, blocks)) for goal in goals)


def _fallen_back(state: _State) -> _State:
    """The state with a bold penalty taken back: the ordinary way from here."""
    return replace(state, fallback=0.0, straight=False, penalty=state.fallback)


def _advance(
    state: _State, assembly: Assembly, guard: Guard, length: float
) -> tuple[_State, Step | None]:
    """One accepted step, or None when even tiny ones break a face or raise the merit."""
    if not state.finishing:
        state = _refreshed(state)
    residuals = _shifted(state, state.values)
    parts = [
        Part(_scale(state, goal, len(residual)), _active(goal, residual, jacobian))
        for goal, residual, (_, jacobian) in zip(state.goals, residuals, state.values, strict=True)
    ]
    here = _Place(state, assembly, guard, length, parts, _merit(parts, residuals))
    rhs, damping = assembly.descent(parts, residuals), state.damping
    exactly = state.straight or state.finishing
    brakes, tries = BRAKE_EASE * state.brakes, BRAKE_TRIES
    brakes[brakes < LAST_BRAKE] = 0.0
    for _ in range(14):
        try:
            factor = assembly.factor(assembly.matrix(parts, damping, brakes))
            direction = factor.solve(rhs)
        except ArithmeticError:
            damping = max(10.0 * damping, 1e-8)
            continue
        if not np.isfinite(direction).all():
            damping = max(10.0 * damping, 1e-8)
            continue
        if state.fallback and here.whole(direction) < NEAR_SHARE:
            return _advance(_fallen_back(state), assembly, guard, length)
        taken = None
        if exactly:
            # Where goals nearly depend on each other, the exact step goes far for nothing.
            exact, step = here.sharpened(direction, factor)
            taken = exact.line_search(step, factor)
            if taken is not None and taken.share == 1.0:
                here, direction = exact, step
            else:
                taken = None
        taken = taken or here.line_search(direction, factor)
        short = taken is None or taken.share < here.whole(direction)
        blocking = here.blocking(direction) if short and tries else None
        if blocking is not None and blocking.any():
            tries -= 1
            stiffer = np.maximum(BRAKE_GROWTH * brakes, FIRST_BRAKE)
            brakes = np.where(blocking, stiffer, brakes)
        elif taken is not None:
            straight = here.straightness(direction, taken)
            if exactly and _hardest(state.goals, taken.values) < NEAR:
                taken = here.brought_back(taken, factor)
            return _updated(replace(here.state, brakes=brakes), taken, damping, straight, length)
        else:
            damping = max(30.0 * damping, 1e-6)
    return replace(state, damping=damping), None


def _largest(residuals: Residuals) -> float:
    """Largest absolute value."""
    known = [float(np.abs(one).max(initial=0.0)) for one in residuals if one is not None]
    return max(known, default=0.0)


def _sum(one: Residuals, other: Residuals, share: float = 1.0) -> list[Floats | None]:
    """Residuals plus a share of others."""
    return [
        None if a is None or b is None else a + share * b for a, b in zip(one, other, strict=True)
    ]


class _Taken(NamedTuple):
    """A step that may be taken: where it leads, what the goals are there, the share of it."""

    blocks: dict[str, Floats]
    values: tuple[tuple[Floats, Floats], ...]
    share: float
    bent: bool = False


@dataclass(frozen=True)
class _Place:
    """A point of the iteration, linearised: what a line search from it needs."""

    state: _State
    assembly: Assembly
    guard: Guard
    length: float
    parts: list[Part]
    merit: float

    def line_search(self, direction: Floats, factor: Factor) -> _Taken | None:
        """The longest share of the step that keeps faces valid and lowers the merit.

        Where a full step fails for the curvature of the hard goals alone, it is bent back to
        them once with the factor at hand (second-order correction) before it is shortened.
        """
        share, longest = self.whole(direction), self._longest(direction)
        for _ in range(7):
            blocks = self.assembly.moved(self.state.blocks, share * direction)
            values = self._values(blocks)
            if values is not None:
                # Near the end the merit is flat to rounding: a tiny step is taken as it is.
                if self._lower(values) or share * longest < 1e-9 * self.length:
                    return _Taken(blocks, values, share)
                if share == 1.0:
                    residuals = _shifted(self.state, values)
                    bent = factor.solve(self.assembly.descent(self.parts, residuals))
                    if np.isfinite(bent).all():
                        blocks = self.assembly.moved(blocks, bent)
                        values = self._values(blocks)
                        if values is not None and self._lower(values):
                            return _Taken(blocks, values, share, bent=True)
            share *= 0.5
        return None

    def sharpened(self, direction: Floats, factor: Factor) -> tuple[_Place, Floats]:
        """The step that meets the linearised hard goals, and the place with its multipliers.

        A penalty leaves a share of each residual. What has to be added to the multipliers to take
        it away solves a linear system whose matrix, symmetric in the weights of the residuals,
        is applied with the factor at hand: conjugate gradients find it in a few rounds.
        """
        left = _sum(self._hard(self.state.values), self._changes(direction))
        first = worst = _largest(left)
        total: list[Floats | None] = [None if rest is None else 0.0 * rest for rest in left]
        search, square = left, self._product(left, left)
        for _ in range(CORRECTIONS):
            if worst <= EXACT * first or not square > 0.0:
                break
            step = factor.solve(self.assembly.descent(self.parts, search), rough=True)
            change = self._changes(step)
            curvature = -self._product(search, change)
            if not curvature > 0.0:
                break
            share = square / curvature
            following = _sum(left, change, share)
            if not _largest(following) < 2.0 * worst:
                break
            direction = direction + share * step
            total, left, worst = _sum(total, search, share), following, _largest(following)
            before, square = square, self._product(left, left)
            search = _sum(left, search, square / before)
        if self.state.finishing:
            return self, direction
        multipliers = dict(self.state.multipliers)
        for goal, shift in zip(self.state.goals, total, strict=True):
            if shift is not None:
                added = self.state.penalty * shift
                multipliers[goal.name] = multipliers.get(goal.name, 0.0) + added
        state = replace(self.state, multipliers=multipliers)
        merit = _merit(self.parts, _shifted(state, state.values))
        return replace(self, state=state, merit=merit), direction

    def _hard(self, values: tuple[tuple[Floats, Floats], ...]) -> Residuals:
        """What is left of the hard goals, None for the soft ones."""
        return [
            goal.beyond(residual) if goal.hard else None
            for goal, (residual, _) in zip(self.state.goals, values, strict=True)
        ]

    def _changes(self, step: Floats) -> Residuals:
        """Linear change of the hard residuals by a step."""
        return self.assembly.changes(self.parts, step, self._hard(self.state.values))

    def _product(self, one: Residuals, other: Residuals) -> float:
        """Inner product in the weights of the residuals."""
        return sum(
            part.scale * float(np.vdot(a, b))
            for part, a, b in zip(self.parts, one, other, strict=True)
            if a is not None and b is not None
        )

    def brought_back(self, taken: _Taken, factor: Factor) -> _Taken:
        """A step with what it left of the hard goals taken away, as far as that is cheap.

        Newton's method with the factor of the step: it costs no new factorisation, and goes on as
        long as each round takes most of what is left.
        """
        for _ in range(ROUNDS):
            left = self._hard(taken.values)
            excess = self._excess(left)
            if excess <= 0.1:
                break
            correction = factor.solve(self.assembly.descent(self.parts, left), rough=True)
            blocks = self.assembly.moved(taken.blocks, correction)
            values = self._values(blocks) if np.isfinite(correction).all() else None
            if values is None or self._excess(self._hard(values)) > WORTH * excess:
                break
            taken = taken._replace(blocks=blocks, values=values)
        return taken

    def _excess(self, residuals: Residuals) -> float:
        """Largest hard residual in units of its tolerance."""
        return max(
            (
                float(np.abs(residual).max(initial=0.0)) / goal.tolerance
                for goal, residual in zip(self.state.goals, residuals, strict=True)
                if residual is not None
            ),
            default=0.0,
        )

    def straightness(self, direction: Floats, taken: _Taken) -> float:
        """How straight the hard goals were along a step: residuals before it over their bend.

        Residuals count as those of a near start at least: where they hold already, a bend that
        is easily brought back is none.
        """
        if taken.share < 1.0 or taken.bent:
            # A step cut to the longest allowed says nothing, and what is known stays.
            cut = taken.share >= self.whole(direction) and self.state.straight
            return STRAIGHT if cut else 0.0
        old, new = self._hard(self.state.values), self._hard(taken.values)
        bend = _largest(_sum(_sum(new, old, -1.0), self._changes(direction), -1.0))
        return max(_largest(old), NEAR) / max(bend, TINY)

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

    def _values(self, blocks: dict[str, Floats]) -> tuple[tuple[Floats, Floats], ...] | None:
        """Residuals and Jacobians, None where a face or an edge is broken."""
        faces, edges = self.guard.broken(blocks["vertices"])
        if faces.any() or edges.any():
            return None
        return _evaluated(self.state.goals, blocks)

    def _lower(self, values: tuple[tuple[Floats, Floats], ...]) -> bool:
        """Whether the merit falls, rounding allowed for."""
        slack = 1e-12 * abs(self.merit) + 1e-300
        return _merit(self.parts, _shifted(self.state, values)) <= self.merit + slack


def _scale(state: _State, goal: Goal, count: int) -> float:
    """Weight of each residual in the augmented Lagrangian over the penalty."""
    return goal.weight / max(count, 1) / (1.0 if goal.hard else state.penalty)


def _shifted(state: _State, values: tuple[tuple[Floats, Floats], ...]) -> list[Floats]:
    """Residuals, the hard ones shifted by their multipliers; soft ones count no more at last."""
    result = []
    for goal, (residual, _) in zip(state.goals, values, strict=True):
        shifted = residual
        if goal.hard:
            shift = state.multipliers.get(goal.name, 0.0) / state.penalty
            shifted = goal.beyond(residual + shift, FINISH_ROOM if state.finishing else 1.0)
        elif state.finishing:
            shifted = np.zeros_like(residual)
        result.append(shifted)
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
    state: _State, taken: _Taken, damping: float, straight: float, length: float
) -> tuple[_State, Step]:
    """State after an accepted step: multipliers, penalty and damping follow."""
    moves = norm(taken.blocks["vertices"] - state.blocks["vertices"])
    multipliers, hard = dict(state.multipliers), 0.0
    for goal, (residual, _) in zip(state.goals, taken.values, strict=True):
        if goal.hard:
            hard = max(hard, float(np.abs(goal.beyond(residual)).max(initial=0.0)))
            # A short step has not solved the inner problem; its multipliers would mislead.
            if taken.share == 1.0 and not state.finishing:
                shift = multipliers.get(goal.name, 0.0) / state.penalty
                multipliers[goal.name] = state.penalty * goal.beyond(residual + shift)
    penalty = state.penalty
    fallback = state.fallback if taken.share < 1.0 and straight >= STRAIGHT else 0.0
    if state.fallback and straight < NEARLY and hard > MISSED:
        penalty, multipliers, fallback = state.fallback, {}, 0.0
    elif taken.share == 1.0:
        highest = FINISH_PENALTY if state.finishing else LAST_PENALTY
        growth = min(BENT * straight, MOST_GROWTH) if straight >= STRAIGHT else GROWTH
        if growth > GROWTH and not state.finishing:
            fallback = min(penalty * GROWTH, LAST_PENALTY)
        penalty = min(penalty * growth, highest)
        damping = max(damping * 0.1, 1e-12)
    elif taken.share < 0.25:
        damping = min(max(damping * 10.0, 1e-8), 1.0)
    step = Step(hard, float(moves.max(initial=0.0)) / length, taken.share, state.penalty)
    return replace(
        state,
        blocks=taken.blocks,
        values=taken.values,
        multipliers=multipliers,
        penalty=penalty,
        damping=damping,
        straight=straight >= STRAIGHT,
        fallback=fallback,
    ), step


def _refreshed(state: _State) -> _State:
    """The state with terms that follow the unknowns brought up to date."""
    goals, values = list(state.goals), list(state.values)
    for index, goal in enumerate(goals):
        if isinstance(goal.term, Refreshing):
            term = goal.term.refreshed(state.blocks)
            if term is not goal.term:
                goals[index] = replace(goal, term=term)
                values[index] = term.evaluate(gathered(term, state.blocks))
    return replace(state, goals=tuple(goals), values=tuple(values))
