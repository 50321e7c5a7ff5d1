"""How an optimisation went: its steps, its best positions, when it ends and why."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pqmesh.optimize.guard import Guard
from pqmesh.optimize.problem import Goal
from pqmesh.vectors import Floats, norm

# A last move as small as this, in mean edges, has found the optimum of the soft goals.
SETTLED = 1e-3
# After a straight step up to this long, in mean edges, the next one would be smaller than that.
FORESEEN = 1e-2
# Reason for an end where a matrix does not fit.
OUT_OF_MEMORY = "the memory does not suffice for the next step: a coarser mesh needs less"


@dataclass(frozen=True)
class Step:
    """One iteration: largest hard residual, largest move in mean edges, share of the step taken.

    `straight` tells that the hard goals hardly bent along it.
    """

    hard: float
    moved: float
    share: float
    penalty: float
    straight: bool = False


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


class Best:
    """The best positions so far: smallest excess of the hard goals over their tolerances."""

    def __init__(self, rounding: float) -> None:
        self.rounding = rounding
        self.blocks: dict[str, Floats] = {}
        self.excess = np.inf
        self.residuals: dict[str, float] = {}
        self.history: list[float] = []

    def offer(
        self,
        blocks: dict[str, Floats],
        goals: tuple[Goal, ...],
        values: tuple[Floats, ...],
    ) -> None:
        """Take the unknowns with their residuals if they are better, or as good and later."""
        residuals, excess = {}, 0.0
        for goal, value in zip(goals, values, strict=True):
            if goal.hard:
                residuals[goal.name] = float(np.abs(value).max(initial=0.0))
                reachable = max(goal.tolerance, self.rounding)
                beyond = float(np.abs(goal.beyond(value)).max(initial=0.0))
                excess = max(excess, beyond / reachable)
        self.history.append(excess)
        if max(excess, 1.0) <= max(self.excess, 1.0):
            self.blocks, self.excess, self.residuals = blocks, excess, residuals

    def forget(self) -> None:
        """Begin to count steps anew."""
        self.history = self.history[-1:]

    def settled(self, steps: list[Step], resting: float = SETTLED) -> bool:
        """Hard goals within tolerance and the last step small, or the one that would follow it."""
        last = steps[-1]
        least = max(FORESEEN, resting) if last.straight else resting
        return self.history[-1] <= 1.0 and last.moved <= least and last.share == 1.0

    def stuck(self, steps: list[Step]) -> bool:
        """Three short steps that hardly moved anything while hard goals are open."""
        last = steps[-3:]
        return (
            self.history[-1] > 1.0
            and len(last) == 3
            and all(step.moved < 1e-6 and step.share < 1.0 for step in last)
        )

    def stalled(self, count: int) -> bool:
        """So many steps without a better result."""
        last, before = self.history[-count:], self.history[:-count]
        return len(before) > 0 and min(last) >= 0.7 * min(before)

    def at_rest(self) -> str:
        """Reason for an end at which the hard goals improve no more."""
        if self.excess <= 1.0:
            return "hard goals reached to rounding error"
        worst = max(self.residuals, key=lambda name: self.residuals[name])
        return f"no further progress: {worst} stays at {self.residuals[worst]:.3g}"

    def solution(self, steps: tuple[Step, ...], reason: str) -> Solution:
        """The result."""
        converged = bool(self.excess <= 1.0)
        return Solution(self.blocks, converged, reason, steps, self.residuals)


def why_stuck(guard: Guard, vertices: Floats) -> str:
    """What holds the iteration back."""
    lengths = norm(vertices[guard.mesh.edges[:, 1]] - vertices[guard.mesh.edges[:, 0]])
    edge = int((lengths / guard.least_edge).argmin())
    if lengths[edge] < 1.05 * guard.least_edge[edge]:
        a, b = guard.mesh.edges[edge]
        return (
            f"held back by the guard: edge {a}-{b} would shrink below {guard.least_edge[edge]:.3g}"
        )
    return "held back by the guard: every further step breaks a face or leads away"
