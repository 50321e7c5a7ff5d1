"""Gauss-Newton with multipliers: hard goals to rounding error, soft goals as small as these allow.

First the descent. Each step solves the damped normal equations of

    soft(x) + lambda . h(x) + rho/2 |h(x)|^2

and the multipliers follow by lambda += rho h, the penalty rho grows. Unlike a penalty alone this
has no floor: the hard residuals h fall to rounding error while the soft goals keep their say in
what is left free. Where the descent does not settle (strongly curved constraints, a faceted
reference whose normals jump), the finish takes over: Newton's projection onto h = 0, moving as
little as possible in the metric of the soft goals.

References: method of multipliers [hestenes1969], [powell1969].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.linear import SymmetricPattern
from pqmesh.optimize.problem import Goal, Problem, Refreshing, gathered
from pqmesh.vectors import Floats, Indices, norm

FIRST_PENALTY, LAST_PENALTY, PENALTY_GROWTH = 1e1, 1e8, 10.0
# The soft goals damp the finish where hard goals nearly depend on each other (closed meshes), so
# there they fade further.
FINISH_PENALTY = 1e12
# Longest move of a vertex in one step, in mean edges.
LONGEST_STEP = 0.3


@dataclass(frozen=True)
class Step:
    """One iteration: largest hard residual, largest move in mean edges, share of the step taken."""

    hard: float
    moved: float
    share: float
    penalty: float


@dataclass(frozen=True)
class Solution:
    """Where the optimisation ended, and why.

    Attributes
    ----------
    blocks : mapping of name to (n, 3)
    converged : bool
        Every hard goal is within its tolerance.
    reason : str
    steps : tuple of Step
    residuals : mapping of hard goal to its largest residual
    """

    blocks: dict[str, Floats]
    converged: bool
    reason: str
    steps: tuple[Step, ...] = ()
    residuals: dict[str, float] = field(default_factory=dict)


class _Assembly:
    """Columns, pattern and normal equations of a problem's free rows."""

    def __init__(self, problem: Problem) -> None:
        self.names = list(problem.blocks)
        sizes = [len(problem.blocks[name]) for name in self.names]
        self.first = dict(zip(self.names, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))
        free = np.ones(sum(sizes), dtype=np.bool_)
        for name, mask in problem.fixed.items():
            free[self.first[name] : self.first[name] + len(mask)] = ~mask
        self.free = free
        # Fixed rows get the column past the last, which is cut off.
        self.size = 3 * int(free.sum())
        row_column = np.where(free, np.cumsum(free) - 1, int(free.sum()))
        self.columns = [self._columns(goal, row_column) for goal in problem.goals]
        rows, columns, self.slots = [], [], []
        for table in self.columns:
            k = table.shape[1]
            row = np.repeat(table[:, :, None], k, axis=2)
            column = np.repeat(table[:, None, :], k, axis=1)
            kept = (row < self.size) & (column < self.size)
            self.slots.append(kept)
            rows.append(row[kept])
            columns.append(column[kept])
        diagonal = np.arange(self.size)
        self.pattern = SymmetricPattern(
            np.concatenate([*rows, diagonal]), np.concatenate([*columns, diagonal]), self.size
        )

    def _columns(self, goal: Goal, row_column: Indices) -> Indices:
        """Columns (m, 3k) of each element of a goal."""
        rows = [
            row_column[self.first[name] + stencil] for name, stencil in goal.term.stencils.items()
        ]
        table = 3 * np.concatenate(rows, axis=1)[:, :, None] + np.arange(3)
        return np.asarray(table.reshape(len(table), 3 * table.shape[1]))

    def moved(self, blocks: dict[str, Floats], step: Floats) -> dict[str, Floats]:
        """Blocks after a step of the free rows."""
        full = np.zeros((len(self.free), 3))
        full[self.free] = step.reshape(-1, 3)
        return {
            name: block + full[self.first[name] : self.first[name] + len(block)]
            for name, block in blocks.items()
        }

    def normal_equations(
        self, parts: list[tuple[Floats, Floats, Floats]], damping: float
    ) -> tuple[Floats, Floats]:
        """Matrix values and right-hand side of parts (weights m, targets (m,r), jacobian)."""
        contributions, rhs = [], np.zeros(self.size + 3)
        for (scale, residual, jacobian), table, kept in zip(
            parts, self.columns, self.slots, strict=True
        ):
            flat = jacobian.reshape(*jacobian.shape[:2], table.shape[1])
            weighted = scale[:, None, None] * flat
            local = np.matmul(weighted.transpose(0, 2, 1), flat)
            contributions.append(local[kept])
            gradient = np.einsum("mrk,mr->mk", weighted, residual)
            rhs -= np.bincount(
                np.minimum(table, self.size).ravel(), gradient.ravel(), minlength=self.size + 3
            )
        values = self.pattern.values(np.concatenate([*contributions, np.zeros(self.size)]))
        diagonal = values[self.pattern.diagonal]
        values[self.pattern.diagonal] += damping * np.maximum(diagonal, 1e-12 * diagonal.max())
        return values, rhs[: self.size]


@dataclass(frozen=True)
class _State:
    """Where the iteration stands."""

    blocks: dict[str, Floats]
    goals: tuple[Goal, ...]
    multipliers: dict[str, Floats]
    penalty: float
    damping: float
    finishing: bool = False


def solve(
    problem: Problem,
    mesh: QuadMesh,
    *,
    most_steps: int = 60,
    progress: Callable[[int, Step], None] | None = None,
) -> Solution:
    """Optimised unknowns of a problem whose block `vertices` is a quad mesh.

    Steps are shortened until no face breaks (`Guard`) and the merit falls; the damping rises
    when that fails. Ending without convergence is an answer, not an error.

    Parameters
    ----------
    problem : Problem
    mesh : QuadMesh
        The start; its faces and edges are guarded.
    most_steps : int
    progress : callable, optional
        Called after each step.

    References: [thesis] section 6.1 with errata E4, E32.
    """
    guard = Guard.of(mesh)
    assembly = _Assembly(problem)
    blocks = {name: np.array(block) for name, block in problem.blocks.items()}
    state = _State(blocks, problem.goals, {}, FIRST_PENALTY, 1e-9)
    best = _Best()
    steps: list[Step] = []
    best.offer(state)
    if assembly.size == 0:
        return best.solution((), "every vertex is fixed")
    for number in range(most_steps):
        state, step = _advance(state, assembly, guard, mesh.mean_edge_length)
        if step is None:
            return best.solution(tuple(steps), _why_stuck(guard, state))
        steps.append(step)
        best.offer(state)
        if progress is not None:
            progress(number, step)
        if best.settled(steps):
            return best.solution(tuple(steps), "hard goals reached and nothing moves any more")
        if best.stuck(steps):
            return best.solution(tuple(steps), _why_stuck(guard, state))
        if state.finishing and best.stalled():
            return best.solution(tuple(steps), _at_rest(best))
        if not state.finishing and step.penalty >= LAST_PENALTY:
            state = replace(state, finishing=True, multipliers={})
    return best.solution(tuple(steps), f"stopped after {most_steps} steps")


def _advance(
    state: _State, assembly: _Assembly, guard: Guard, length: float
) -> tuple[_State, Step | None]:
    """One accepted step, or None when even tiny ones break a face or raise the merit."""
    if not state.finishing:
        refreshed = tuple(_refreshed(goal, state.blocks) for goal in state.goals)
        state = replace(state, goals=refreshed)
    evaluated = [goal.term.evaluate(gathered(goal.term, state.blocks)) for goal in state.goals]
    merit = _merit(state, [residual for residual, _ in evaluated])
    parts = []
    for goal, (residual, jacobian) in zip(state.goals, evaluated, strict=True):
        scale = np.full(len(residual), goal.weight / max(len(residual), 1))
        if goal.hard:
            residual = residual + state.multipliers.get(goal.name, 0.0) / state.penalty
            scale = scale * state.penalty
        elif state.finishing:
            residual = np.zeros_like(residual)
        parts.append((scale / state.penalty, residual, jacobian))
    damping = state.damping
    for _ in range(14):
        values, rhs = assembly.normal_equations(parts, damping)
        try:
            direction = assembly.pattern.factor(values).solve(rhs)
        except ArithmeticError:
            damping = max(10.0 * damping, 1e-8)
            continue
        if not np.isfinite(direction).all():
            damping = max(10.0 * damping, 1e-8)
            continue
        taken = _line_search(state, assembly, guard, direction, merit, length)
        if taken is not None:
            return _updated(state, *taken, damping, length)
        damping = max(30.0 * damping, 1e-6)
    return replace(state, damping=damping), None


def _line_search(
    state: _State, assembly: _Assembly, guard: Guard, direction: Floats, merit: float, length: float
) -> tuple[dict[str, Floats], float] | None:
    """Blocks after the longest share of the step that keeps faces valid and lowers the merit."""
    moves = assembly.moved({name: np.zeros_like(b) for name, b in state.blocks.items()}, direction)
    longest = float(norm(moves["vertices"]).max(initial=0.0))
    share = min(1.0, LONGEST_STEP * length / max(longest, 1e-300))
    for _ in range(7):
        blocks = assembly.moved(state.blocks, share * direction)
        faces, edges = guard.broken(blocks["vertices"])
        if not (faces.any() or edges.any()):
            residuals = [goal.term.evaluate(gathered(goal.term, blocks))[0] for goal in state.goals]
            # Near the end the merit is flat to rounding: a tiny step is taken as it is.
            slack = 1e-12 * abs(merit) + 1e-300
            if _merit(state, residuals) <= merit + slack or share * longest < 1e-9 * length:
                return blocks, share
        share *= 0.5
    return None


def _merit(state: _State, residuals: list[Floats]) -> float:
    """Augmented Lagrangian over the penalty."""
    total = 0.0
    for goal, residual in zip(state.goals, residuals, strict=True):
        weight = goal.weight / max(len(residual), 1)
        if goal.hard:
            residual = residual + state.multipliers.get(goal.name, 0.0) / state.penalty
        else:
            weight = 0.0 if state.finishing else weight / state.penalty
        total += 0.5 * weight * float(np.sum(residual**2))
    return total


def _updated(
    state: _State, blocks: dict[str, Floats], share: float, damping: float, length: float
) -> tuple[_State, Step]:
    """State after an accepted step: multipliers, penalty and damping follow."""
    moved = float(norm(blocks["vertices"] - state.blocks["vertices"]).max(initial=0.0)) / length
    multipliers, hard = dict(state.multipliers), 0.0
    for goal in state.goals:
        if goal.hard:
            residual = goal.term.evaluate(gathered(goal.term, blocks))[0]
            hard = max(hard, float(np.abs(residual).max(initial=0.0)))
            # A short step has not solved the inner problem; its multipliers would mislead.
            if share == 1.0 and not state.finishing:
                known = multipliers.get(goal.name, 0.0)
                multipliers[goal.name] = known + state.penalty * residual
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


def _why_stuck(guard: Guard, state: _State) -> str:
    """What holds the iteration back."""
    vertices = state.blocks["vertices"]
    lengths = norm(vertices[guard.mesh.edges[:, 1]] - vertices[guard.mesh.edges[:, 0]])
    edge = int((lengths / guard.least_edge).argmin())
    if lengths[edge] < 1.05 * guard.least_edge[edge]:
        a, b = guard.mesh.edges[edge]
        return (
            f"held back by the guard: edge {a}-{b} would shrink below {guard.least_edge[edge]:.3g}"
        )
    return "held back by the guard: every further step breaks a face or leads away"


def _at_rest(best: _Best) -> str:
    """Reason for an end at which the hard goals improve no more."""
    if best.excess <= 1.0:
        return "hard goals reached to rounding error"
    worst = max(best.residuals, key=lambda name: best.residuals[name])
    return f"no further progress: {worst} stays at {best.residuals[worst]:.3g}"


class _Best:
    """The best positions so far: smallest excess of the hard goals over their tolerances."""

    def __init__(self) -> None:
        self.blocks: dict[str, Floats] = {}
        self.excess = np.inf
        self.residuals: dict[str, float] = {}
        self.history: list[float] = []

    def offer(self, state: _State) -> None:
        """Take the state if it is better, or as good and later."""
        residuals, excess = {}, 0.0
        for goal in state.goals:
            if goal.hard:
                value = goal.term.evaluate(gathered(goal.term, state.blocks))[0]
                residuals[goal.name] = float(np.abs(value).max(initial=0.0))
                excess = max(excess, residuals[goal.name] / goal.tolerance)
        self.history.append(excess)
        if max(excess, 1.0) <= max(self.excess, 1.0):
            self.blocks, self.excess, self.residuals = state.blocks, excess, residuals

    def settled(self, steps: list[Step]) -> bool:
        """Hard goals within tolerance and the last step small."""
        return self.history[-1] <= 1.0 and steps[-1].moved < 1e-5 and steps[-1].share == 1.0

    def stuck(self, steps: list[Step]) -> bool:
        """Three short steps that hardly moved anything while hard goals are open."""
        last = steps[-3:]
        return (
            self.history[-1] > 1.0
            and len(last) == 3
            and all(step.moved < 1e-6 and step.share < 1.0 for step in last)
        )

    def stalled(self) -> bool:
        """Four steps without a better result."""
        return len(self.history) > 6 and min(self.history[-4:]) >= 0.7 * min(self.history[:-4])

    def solution(self, steps: tuple[Step, ...], reason: str) -> Solution:
        """The result."""
        converged = self.excess <= 1.0
        return Solution(self.blocks, converged, reason, steps, self.residuals)
