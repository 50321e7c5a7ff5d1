"""From elements to columns: the damped normal equations of a problem's free rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.sparse import csr_array

from pqmesh.linear import BlockPattern, Factor
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.problem import Goal, Linear, Problem, gathered
from pqmesh.vectors import Floats, Indices

# Residuals (m, r) of each goal, None for those that do not count.
Residuals: TypeAlias = Sequence[Floats | None]


@dataclass(frozen=True, eq=False)
class Part:
    """A goal at one place: weight of each residual, Jacobian (m, r, k, 3)."""

    scale: float
    jacobian: Floats


class Assembly:
    """Columns, pattern and normal equations; what does not change is worked out once.

    Parameters
    ----------
    problem : Problem
    mesh : PolyMesh
        Its faces are where brakes act.
    """

    def __init__(self, problem: Problem, mesh: PolyMesh) -> None:
        names = list(problem.blocks)
        sizes = [len(problem.blocks[name]) for name in names]
        self.first = dict(zip(names, np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))
        free = np.ones(sum(sizes), dtype=np.bool_)
        for name, mask in problem.fixed.items():
            free[self.first[name] : self.first[name] + len(mask)] = ~mask
        self.free = free
        # Free rows are counted, fixed ones are -1: they have no column.
        row = np.where(free, np.cumsum(free) - 1, -1)
        self.size = 3 * int(free.sum())
        self._elements = [
            _Elements(self._rows(goal, row), self.size // 3) for goal in problem.goals
        ]
        groups = mesh.topology.face_groups
        self._brakes = [
            _Elements(row[self.first["vertices"] + group.corners], self.size // 3)
            for group in groups
        ]
        self._braked = [group.faces for group in groups]
        self._stiffness = 1.0 / (mesh.mean_edge_length**2 * max(mesh.topology.n_faces, 1))
        every = [*self._elements, *self._brakes]
        self.pattern = BlockPattern(
            np.concatenate([elements.pair_rows for elements in every]),
            np.concatenate([elements.pair_columns for elements in every]),
            self.size // 3,
        )
        ends = np.cumsum([len(elements.pair_rows) for elements in every])
        for elements, place in zip(every, np.split(self.pattern.place, ends[:-1]), strict=True):
            elements.put_at(place, self.pattern.count)
        # Jacobians that never change are added up once, for a weight of 1.
        self._constant = {
            index: self._elements[index].constant(
                goal.term.evaluate(gathered(goal.term, problem.blocks))[1]
            )
            for index, goal in enumerate(problem.goals)
            if isinstance(goal.term, Linear) and not goal.slack
        }

    def _rows(self, goal: Goal, row: Indices) -> Indices:
        """Free rows (m, k) of each element of a goal, -1 where fixed."""
        rows = [row[self.first[name] + stencil] for name, stencil in goal.term.stencils.items()]
        return np.concatenate(rows, axis=1)

    def moved(self, blocks: dict[str, Floats], step: Floats) -> dict[str, Floats]:
        """Blocks after a step of the free rows."""
        full = np.zeros((len(self.free), 3))
        full[self.free] = step.reshape(-1, 3)
        return {
            name: block + full[self.first[name] : self.first[name] + len(block)]
            for name, block in blocks.items()
        }

    def matrix(self, parts: list[Part], damping: float, brakes: Floats) -> Floats:
        """Entries (3, 3, n) of the blocks of the matrix of the normal equations.

        `damping` is a share of the mean diagonal of each row; `brakes` (F,) resist the deformation
        of single faces, 1 being as stiff as a hard goal of weight 1.
        """
        values = np.zeros((3, 3, self.pattern.count))
        for index, (part, elements) in enumerate(zip(parts, self._elements, strict=True)):
            if index in self._constant:
                for (i, j), slots, entries in self._constant[index]:
                    values[i, j, slots] += part.scale * entries
            else:
                elements.add_squares(values, part.jacobian, part.scale)
        for elements, rows in zip(self._brakes, self._braked, strict=True):
            if brakes[rows].any():
                elements.add_stiffness(values, self._stiffness * brakes[rows])
        # The mean of the three axes of a row: what is turned is damped alike.
        mean = sum(values[axis, axis, self.pattern.diagonal] for axis in range(3)) / 3.0
        amount = damping * np.maximum(mean, 1e-12 * mean.max(initial=0.0))
        self.add_diagonal(values, np.repeat(amount[:, None], 3, axis=1))
        return values

    def add_diagonal(self, values: Floats, amounts: Floats) -> None:
        """Add amounts (n, 3) to the diagonal of a matrix."""
        for axis in range(3):
            values[axis, axis, self.pattern.diagonal] += amounts[:, axis]

    def factor(self, values: Floats) -> Factor:
        """Factor of a matrix; raises ArithmeticError where it is singular."""
        return self.pattern.factor(values)

    def descent(self, parts: list[Part], residuals: Residuals) -> Floats:
        """Right-hand side of the normal equations for residuals (m, r) of each goal."""
        rhs = np.zeros((self.size // 3, 3))
        for part, residual, elements in zip(parts, residuals, self._elements, strict=True):
            if residual is not None:
                elements.subtract_slope(rhs, part.jacobian, part.scale * residual)
        return rhs.ravel()

    def changes(self, parts: list[Part], step: Floats, like: Residuals) -> list[Floats | None]:
        """Linear change (m, r) of residuals by a step of the free rows; None where `like` is."""
        rows = np.concatenate([step.reshape(-1, 3), np.zeros((1, 3))])
        return [
            None
            if residual is None
            else np.einsum("mrki,mki->mr", part.jacobian, rows[elements.rows])
            for part, elements, residual in zip(parts, self._elements, like, strict=True)
        ]


class _Elements:
    """Where m elements of k rows each put their squares and slopes.

    Attributes
    ----------
    rows : (m, k)
        Free rows, -1 where fixed.
    pair_rows, pair_columns : (N,)
        Blocks on or below the diagonal that the free rows of the elements meet in.
    """

    def __init__(self, rows: Indices, n_rows: int) -> None:
        self.rows, (m, k) = rows, rows.shape
        # From the last row to the first, so that every pair lies below the diagonal.
        self._turn = np.argsort(-rows, axis=1, kind="stable")
        falling = np.take_along_axis(rows, self._turn, axis=1).T
        self._first, self._second = np.triu_indices(k)
        # Pair after pair, each of all elements: the products run along the elements.
        pair_rows, pair_columns = falling[self._first].ravel(), falling[self._second].ravel()
        self._kept = np.flatnonzero(pair_columns >= 0)
        self.pair_rows, self.pair_columns = pair_rows[self._kept], pair_columns[self._kept]
        # A row that an element reads twice meets itself in both orders.
        two = np.repeat(self._first != self._second, m)
        self._twice = np.flatnonzero(two & (pair_rows == pair_columns) & (pair_columns >= 0))
        kept = np.flatnonzero(rows.ravel() >= 0)
        self._slopes = _summing(rows.ravel()[kept], kept, (n_rows, m * k))

    def put_at(self, place: Indices, count: int) -> None:
        """Fix the stored block of each pair."""
        shape = (count, len(self.rows) * len(self._first))
        self._squares = _summing(place, self._kept, shape)

    def add_squares(self, values: Floats, jacobian: Floats, scale: float) -> None:
        """Add scale J'J to entries (3, 3, n) of blocks."""
        if len(self.rows):
            products = self._products(jacobian, scale)
            for i, j in np.ndindex(3, 3):
                values[i, j] += self._squares @ products[i, j]

    def constant(self, jacobian: Floats) -> list[tuple[tuple[int, int], Indices, Floats]]:
        """Row and column in the blocks, blocks that J'J meets there, and what it adds to them."""
        products, constant = self._products(jacobian, 1.0), []
        for i, j in np.ndindex(3, 3):
            if products[i, j].any():
                added = self._squares @ products[i, j]
                slots = np.flatnonzero(added)
                constant.append(((i, j), slots, added[slots]))
        return constant

    def _products(self, jacobian: Floats, scale: float) -> Floats:
        """Entries (3, 3, pairs * m) of the blocks J_a' J_b of each element."""
        first, second, m = self._first, self._second, len(self.rows)
        total = np.zeros((3, 3, len(first), m))
        if len(jacobian) and jacobian.strides[0] == 0:
            # The same for every element: worked out once.
            same = scale * np.einsum("rai,rbj->ijab", jacobian[0], jacobian[0])
            total += same[:, :, self._turn[:, first], self._turn[:, second]].swapaxes(2, 3)
        else:
            for residual in range(jacobian.shape[1]):
                turned = np.take_along_axis(jacobian[:, residual], self._turn[:, :, None], axis=1)
                turned = np.ascontiguousarray(turned.transpose(2, 1, 0))
                right = turned[:, second]
                for i, left in enumerate(scale * turned):
                    total[i] += left[first] * right
        flat = total.reshape(3, 3, -1)
        if len(self._twice):
            flat[:, :, self._twice] += flat[:, :, self._twice].swapaxes(0, 1)
        return flat

    def add_stiffness(self, values: Floats, stiffness: Floats) -> None:
        """Resist the deformation of each element: its rows relative to their mean."""
        k = self.rows.shape[1]
        share = np.where(self._first == self._second, 1.0, 0.0) - 1.0 / k
        sums = self._squares @ (share[:, None] * stiffness).ravel()
        for axis in range(3):
            values[axis, axis] += sums

    def subtract_slope(self, rhs: Floats, jacobian: Floats, residual: Floats) -> None:
        """Subtract J'r from rows (n, 3)."""
        if len(self.rows):
            slope = np.einsum("mrki,mr->mki", jacobian, residual)
            rhs -= self._slopes @ slope.reshape(-1, 3)


def _summing(target: Indices, source: Indices, shape: tuple[int, int]) -> csr_array:
    """Matrix that adds up sources at their targets."""
    return csr_array((np.ones(len(source)), (target, source)), shape=shape)
