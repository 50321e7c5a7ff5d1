"""From elements to columns: the damped normal equations of a problem's free rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.linear import SymmetricPattern
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.problem import Goal, Problem
from pqmesh.vectors import Floats, Indices


@dataclass(frozen=True, eq=False)
class Part:
    """A goal at one place: weight of each residual, Jacobian (m, r, k, 3)."""

    scale: float
    jacobian: Floats

    @property
    def flat(self) -> Floats:
        """Jacobian of shape (m, r, 3k)."""
        m, r, k, _ = self.jacobian.shape
        return self.jacobian.reshape(m, r, 3 * k)


class Assembly:
    """Columns, pattern and normal equations.

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
        # Fixed rows get the column past the last, which is cut off.
        self.size = 3 * int(free.sum())
        row_column = np.where(free, np.cumsum(free) - 1, int(free.sum()))
        self.columns = [self._columns(goal, row_column) for goal in problem.goals]
        # Brake stencils: a table for each size of faces.
        self.face_groups = mesh.topology.face_groups
        corners = [row_column[self.first["vertices"] + group.corners] for group in self.face_groups]
        self.brake_stiffness = 1.0 / (mesh.mean_edge_length**2 * mesh.topology.n_faces)
        rows, columns, self.slots = [], [], []
        for table in [*self.columns, *map(_table, corners)]:
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
        return _table(np.concatenate(rows, axis=1))

    def moved(self, blocks: dict[str, Floats], step: Floats) -> dict[str, Floats]:
        """Blocks after a step of the free rows."""
        full = np.zeros((len(self.free), 3))
        full[self.free] = step.reshape(-1, 3)
        return {
            name: block + full[self.first[name] : self.first[name] + len(block)]
            for name, block in blocks.items()
        }

    def matrix(self, parts: list[Part], damping: float, brakes: Floats) -> Floats:
        """Stored values of the matrix of the normal equations.

        `damping` is a share of the diagonal; `brakes` (F,) resist the deformation of single
        faces, 1 being as stiff as a hard goal of weight 1.
        """
        contributions = []
        for part, kept in zip(parts, self.slots, strict=False):
            flat = part.flat
            contributions.append(np.matmul(part.scale * flat.transpose(0, 2, 1), flat)[kept])
        brake_slots = self.slots[len(self.columns) :]
        for group, kept in zip(self.face_groups, brake_slots, strict=True):
            stiffness = (self.brake_stiffness * brakes[group.faces])[:, None, None]
            contributions.append((stiffness * _deformation(group.corners.shape[1]))[kept])
        contributions.append(np.zeros(self.size))
        values = self.pattern.values(np.concatenate(contributions))
        diagonal = values[self.pattern.diagonal]
        values[self.pattern.diagonal] += damping * np.maximum(diagonal, 1e-12 * diagonal.max())
        return values

    def descent(self, parts: list[Part], residuals: list[Floats]) -> Floats:
        """Right-hand side of the normal equations for residuals (m, r) of each goal."""
        rhs = np.zeros(self.size + 3)
        for part, residual, table in zip(parts, residuals, self.columns, strict=True):
            slope = part.scale * np.einsum("mrk,mr->mk", part.flat, residual)
            rhs -= np.bincount(
                np.minimum(table, self.size).ravel(), slope.ravel(), minlength=self.size + 3
            )
        return rhs[: self.size]


def _deformation(size: int) -> Floats:
    """Corners of a face relative to their mean, as a projection: what a brake resists."""
    return np.asarray(np.kron(np.eye(size) - 1.0 / size, np.eye(3)), dtype=np.float64)


def _table(rows: Indices) -> Indices:
    """Columns (m, 3k) of the coordinates of rows (m, k)."""
    return np.asarray((3 * rows[:, :, None] + np.arange(3)).reshape(len(rows), 3 * rows.shape[1]))
