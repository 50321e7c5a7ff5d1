"""A point of the iteration, linearised: the step from it, how far it goes, how it is sharpened."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pqmesh.linear import Factor
from pqmesh.optimize.assembly import Assembly, Part, Residuals
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.problem import Goal, gathered, residual
from pqmesh.vectors import TINY, Floats, Mask, norm

# Hard residuals below this are near zero: bends along a step are measured against it at least.
NEAR = 0.02
# A step along which the hard goals are this straight meets them exactly: the linearised problem is
# solved to so small a share of the residuals, by so many more solutions with the factor at hand.
STRAIGHT, EXACT, CORRECTIONS = 1e4, 1e-4, 5
# Rounds of Newton's method with an old factor, each of which has to leave less than such a share.
ROUNDS, WORTH = 8, 0.3
# They end at this share of the tolerance.
ENOUGH = 0.1
# Inequalities are aimed at this share of their slack, so that what is a rounding beyond is within;
# at last at the second share, so that neighbours do not push them out again.
ROOM, FINISH_ROOM = 1.0 - 1e-6, 0.97
# Longest move of a vertex in one step, in mean edges.
LONGEST_STEP = 0.3


@dataclass(frozen=True)
class State:
    """Where the iteration stands; residuals (m, r) are those of each goal there."""

    blocks: dict[str, Floats]
    goals: tuple[Goal, ...]
    residuals: tuple[Floats, ...]
    multipliers: dict[str, Floats]
    penalty: float
    damping: float
    brakes: Floats
    straight: bool = False
    fallback: float = 0.0
    finishing: bool = False
    enough: float = ENOUGH


class Taken(NamedTuple):
    """A step that may be taken: where it leads, what the goals leave there, the share of it."""

    blocks: dict[str, Floats]
    residuals: tuple[Floats, ...]
    share: float
    bent: bool = False


@dataclass(frozen=True)
class Place:
    """A point of the iteration, linearised: what a line search from it needs."""

    state: State
    assembly: Assembly
    guard: Guard
    length: float
    parts: list[Part]
    merit: float

    @classmethod
    def of(cls, state: State, assembly: Assembly, guard: Guard, length: float) -> Place:
        """Where a state stands; `length` is the mean edge at the start."""
        residuals = _shifted(state, state.residuals)
        parts = []
        for goal, left in zip(state.goals, residuals, strict=True):
            _, jacobian = goal.term.evaluate(gathered(goal.term, state.blocks))
            parts.append(Part(_scale(state, goal, len(left)), _active(goal, left, jacobian)))
        return cls(state, assembly, guard, length, parts, _merit(parts, residuals))

    def slope(self) -> Floats:
        """Right-hand side of the normal equations."""
        return self.assembly.descent(self.parts, _shifted(self.state, self.state.residuals))

    def line_search(self, direction: Floats, factor: Factor) -> Taken | None:
        """The longest share of the step that keeps faces valid and lowers the merit.

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
                    return Taken(blocks, residuals, share)
                if share == 1.0:
                    shifted = _shifted(self.state, residuals)
                    bent = factor.solve(self.assembly.descent(self.parts, shifted))
                    if np.isfinite(bent).all():
                        blocks = self.assembly.moved(blocks, bent)
                        residuals = self._residuals(blocks)
                        if residuals is not None and self._lower(residuals):
                            return Taken(blocks, residuals, share, bent=True)
            share *= 0.5
        return None

    def sharpened(self, direction: Floats, factor: Factor) -> tuple[Place, Floats]:
        """The step that meets the linearised hard goals, and the place with its multipliers.

        A penalty leaves a share of each residual. What has to be added to the multipliers to take
        it away solves a linear system whose matrix, symmetric in the weights of the residuals,
        is applied with the factor at hand: conjugate gradients find it in a few rounds.
        """
        left = _sum(self._hard(self.state.residuals), self._changes(direction))
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
        merit = _merit(self.parts, _shifted(state, state.residuals))
        return replace(self, state=state, merit=merit), direction

    def _hard(self, residuals: tuple[Floats, ...]) -> Residuals:
        """What is left of the hard goals, None for the soft ones."""
        return [
            goal.beyond(own, ROOM) if goal.hard else None
            for goal, own in zip(self.state.goals, residuals, strict=True)
        ]

    def _changes(self, step: Floats) -> Residuals:
        """Linear change of the hard residuals by a step."""
        return self.assembly.changes(self.parts, step, self._hard(self.state.residuals))

    def _product(self, one: Residuals, other: Residuals) -> float:
        """Inner product in the weights of the residuals."""
        return sum(
            part.scale * float(np.vdot(a, b))
            for part, a, b in zip(self.parts, one, other, strict=True)
            if a is not None and b is not None
        )

    def brought_back(self, taken: Taken, factor: Factor) -> Taken:
        """A step with what it left of the hard goals taken away, as far as that is cheap.

        Newton's method with the factor of the step: it costs no new factorisation, and goes on as
        long as each round takes most of what is left.
        """
        blocks, residuals = taken.blocks, taken.residuals
        left = self._hard(residuals)
        excess = self._excess(left)
        for _ in range(ROUNDS):
            if excess <= self.state.enough:
                break
            correction = factor.solve(self.assembly.descent(self.parts, left), rough=True)
            if not np.isfinite(correction).all():
                break
            tried = self.assembly.moved(blocks, correction)
            # Soft goals and the guard are asked at the end only.
            found = _renewed(self.state.goals, residuals, tried, hard=True)
            following = self._hard(found)
            before, beyond = excess, self._excess(following)
            if not beyond < before:
                break
            blocks, residuals, left, excess = tried, found, following, beyond
            if excess > WORTH * before:
                break
        if blocks is taken.blocks or self._breaks(blocks):
            return taken
        residuals = _renewed(self.state.goals, residuals, blocks, hard=False)
        return taken._replace(blocks=blocks, residuals=residuals)

    def _excess(self, residuals: Residuals) -> float:
        """Largest hard residual in units of its tolerance."""
        return max(
            (
                float(np.abs(left).max(initial=0.0)) / goal.tolerance
                for goal, left in zip(self.state.goals, residuals, strict=True)
                if left is not None
            ),
            default=0.0,
        )

    def straightness(self, direction: Floats, taken: Taken) -> float:
        """How straight the hard goals were along a step: residuals before it over their bend.

        Residuals count as those of a near start at least: where they hold already, a bend that
        is easily brought back is none.
        """
        if taken.share < 1.0 or taken.bent:
            # A step cut to the longest allowed says nothing, and what is known stays.
            cut = taken.share >= self.whole(direction) and self.state.straight
            return STRAIGHT if cut else 0.0
        old, new = self._hard(self.state.residuals), self._hard(taken.residuals)
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

    def _residuals(self, blocks: dict[str, Floats]) -> tuple[Floats, ...] | None:
        """Residuals of every goal, None where a face or an edge is broken."""
        return None if self._breaks(blocks) else left_by(self.state.goals, blocks)

    def _breaks(self, blocks: dict[str, Floats]) -> bool:
        """Whether a face or an edge is broken."""
        faces, edges = self.guard.broken(blocks["vertices"])
        return bool(faces.any() or edges.any())

    def _lower(self, residuals: tuple[Floats, ...]) -> bool:
        """Whether the merit falls, rounding allowed for."""
        slack = 1e-12 * abs(self.merit) + 1e-300
        return _merit(self.parts, _shifted(self.state, residuals)) <= self.merit + slack


def _scale(state: State, goal: Goal, count: int) -> float:
    """Weight of each residual in the augmented Lagrangian over the penalty."""
    return goal.weight / max(count, 1) / (1.0 if goal.hard else state.penalty)


def _shifted(state: State, residuals: tuple[Floats, ...]) -> list[Floats]:
    """Residuals, the hard ones shifted by their multipliers; soft ones count no more at last."""
    result = []
    for goal, own in zip(state.goals, residuals, strict=True):
        shifted = own
        if goal.hard:
            shift = state.multipliers.get(goal.name, 0.0) / state.penalty
            shifted = goal.beyond(own + shift, FINISH_ROOM if state.finishing else ROOM)
        elif state.finishing:
            shifted = np.zeros_like(own)
        result.append(shifted)
    return result


def _active(goal: Goal, left: Floats, jacobian: Floats) -> Floats:
    """Jacobian without the rows of inequalities that hold with room to spare."""
    if goal.slack == 0.0:
        return jacobian
    return np.asarray(np.where((left != 0.0)[:, :, None, None], jacobian, 0.0))


def _merit(parts: list[Part], residuals: list[Floats]) -> float:
    """Augmented Lagrangian over the penalty."""
    pairs = zip(parts, residuals, strict=True)
    return sum(0.5 * part.scale * float(np.vdot(own, own)) for part, own in pairs)


def _largest(residuals: Residuals) -> float:
    """Largest absolute value."""
    known = [float(np.abs(one).max(initial=0.0)) for one in residuals if one is not None]
    return max(known, default=0.0)


def _sum(one: Residuals, other: Residuals, share: float = 1.0) -> list[Floats | None]:
    """Residuals plus a share of others."""
    return [
        None if a is None or b is None else a + share * b for a, b in zip(one, other, strict=True)
    ]


def hardest(goals: tuple[Goal, ...], residuals: tuple[Floats, ...]) -> float:
    """Largest residual of a hard goal beyond its slack."""
    return max(
        (
            float(np.abs(goal.beyond(own)).max(initial=0.0))
            for goal, own in zip(goals, residuals, strict=True)
            if goal.hard
        ),
        default=0.0,
    )


def left_by(goals: tuple[Goal, ...], blocks: dict[str, Floats]) -> tuple[Floats, ...]:
    """Residuals of every goal."""
    return tuple(residual(goal.term, blocks) for goal in goals)


def _renewed(
    goals: tuple[Goal, ...], known: tuple[Floats, ...], blocks: dict[str, Floats], *, hard: bool
) -> tuple[Floats, ...]:
    """Residuals of which those of the hard goals, or of the soft ones, are taken anew."""
    return tuple(
        residual(goal.term, blocks) if goal.hard == hard else own
        for goal, own in zip(goals, known, strict=True)
    )
