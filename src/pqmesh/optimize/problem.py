"""What is to be optimised: named blocks of unknowns, terms, weights, fixed rows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, Self, runtime_checkable

import numpy as np

from pqmesh.errors import MeshError, SpecError
from pqmesh.vectors import Floats, Indices, Mask

# An inequality is brought into its slack by no more than this, in the unit of its residual.
MOST_ROOM = 1e-3

# Unknowns by name: rows of 3-vectors, e.g. "vertices" (V, 3) and "axes" (n, 3).
Blocks = Mapping[str, Floats]


@runtime_checkable
class Term(Protocol):
    """m like elements, each reading k rows of unknowns and giving r dimensionless residuals.

    A term knows nothing of weights, columns or other terms; one from outside the package is
    accepted wherever ours are.

    Attributes
    ----------
    stencils : mapping of block name to (m, k_b) row numbers
        The k rows of an element are those of the blocks, in the order of the mapping.
    """

    @property
    def stencils(self) -> Mapping[str, Indices]:
        """Rows that each element reads."""
        ...

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, r) and Jacobian (m, r, k, 3) at rows (m, k, 3)."""
        ...


@runtime_checkable
class Refreshing(Protocol):
    """A term that follows the unknowns, such as foot points on a surface."""

    def refreshed(self, blocks: Blocks) -> Self:
        """The term for the current unknowns, of the same stencils."""
        ...


@runtime_checkable
class Linear(Protocol):
    """A term whose Jacobian never changes."""

    @property
    def is_linear(self) -> bool:
        """True; the Jacobian is taken once."""
        ...


@runtime_checkable
class ByItself(Protocol):
    """A term whose residuals cost much less than they do with their Jacobian."""

    def residual(self, rows: Floats) -> Floats:
        """Residuals (m, r), the same as those of `evaluate`."""
        ...


@dataclass(frozen=True)
class Goal:
    """A term with its role in a problem.

    Attributes
    ----------
    name : str
    term : Term
    weight : float
        On the mean square of the residuals, so it survives refinement and a change of unit.
    hard : bool
        Hard terms are driven to rounding error; soft terms are as small as these allow.
    tolerance : float
        Largest residual at which a hard term counts as reached.
    slack : float
        Residuals of a hard term within +-slack are as good as zero: an inequality.

    Raises
    ------
    SpecError
        When the weight is not a finite number above 0, or tolerance or slack are below 0.
    """

    name: str
    term: Term
    weight: float = 1.0
    hard: bool = False
    tolerance: float = 1e-12
    slack: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.weight < math.inf:
            raise SpecError(
                f"A weight must be a finite number above 0; that of {self.name!r} is "
                f"{self.weight:g}. Raise it, or leave the goal out."
            )
        for key, value in (("tolerance", self.tolerance), ("slack", self.slack)):
            if not 0 <= value < math.inf:
                raise SpecError(
                    f"The {key} of a goal must be a finite number, at least 0; that of "
                    f"{self.name!r} is {value:g}. Mend it."
                )

    def beyond(self, residual: Floats, share: float = 1.0) -> Floats:
        """What of each residual lies beyond the slack, or beyond a share of it."""
        if self.slack == 0.0:
            return residual
        room = max(share * self.slack, self.slack - MOST_ROOM)
        return np.asarray(residual - np.clip(residual, -room, room))


@dataclass(frozen=True)
class Problem:
    """Unknowns, goals and fixed rows.

    Parameters
    ----------
    blocks : mapping of name to (n, 3)
        Start values.
    goals : tuple of Goal
    fixed : mapping of name to (n,) bool
        Rows that must not move; missing blocks are free.

    Raises
    ------
    MeshError
        When a term reads a block or a row that does not exist.
    """

    blocks: Blocks
    goals: tuple[Goal, ...]
    fixed: Mapping[str, Mask] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for goal in self.goals:
            for name, rows in goal.term.stencils.items():
                if name not in self.blocks:
                    raise MeshError(
                        f"A term must read blocks that exist; {goal.name!r} reads {name!r}, the "
                        f"problem has {sorted(self.blocks)}. Add the block."
                    )
                if rows.size and (rows.min() < 0 or rows.max() >= len(self.blocks[name])):
                    raise MeshError(
                        f"A stencil must index rows 0..{len(self.blocks[name]) - 1} of block "
                        f"{name!r}; {goal.name!r} reads row {int(rows.max())}. Re-index it."
                    )

    def residuals(self, blocks: Blocks) -> dict[str, Floats]:
        """Residuals (m, r) of every goal."""
        return {goal.name: residual(goal.term, blocks) for goal in self.goals}


def gathered(term: Term, blocks: Blocks) -> Floats:
    """Rows (m, k, 3) that a term reads."""
    read = [blocks[name].take(rows, axis=0) for name, rows in term.stencils.items()]
    return read[0] if len(read) == 1 else np.concatenate(read, axis=1)


def residual(term: Term, blocks: Blocks) -> Floats:
    """Residuals (m, r) of a term, without the Jacobian where it can be left out."""
    rows = gathered(term, blocks)
    return term.residual(rows) if isinstance(term, ByItself) else term.evaluate(rows)[0]
