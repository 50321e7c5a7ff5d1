"""The one place that factorises: sparse symmetric positive definite systems of fixed pattern."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csc_array, csc_matrix
from scipy.sparse.linalg import splu

from pqmesh.vectors import Floats, Indices


class Factor(Protocol):
    """A factorised matrix."""

    def solve(self, rhs: Floats) -> Floats:
        """Solution of A x = rhs."""
        ...


class SymmetricPattern:
    """Sparse symmetric matrix whose pattern is fixed and whose values change.

    Parameters
    ----------
    rows, columns : (N,)
        Coordinates of contributions; `factor` takes one value for each, duplicates add up.
    size : int
    """

    def __init__(self, rows: Indices, columns: Indices, size: int) -> None:
        keys = columns * np.int64(size) + rows
        unique, self._place = np.unique(keys, return_inverse=True)
        self._place = self._place.reshape(-1)
        column, self._rows = np.divmod(unique, size)
        self._columns = column
        self._indptr = np.searchsorted(column, np.arange(size + 1))
        self.size = size
        self.diagonal = np.searchsorted(unique, np.arange(size) * np.int64(size + 1))
        self._backend: _Backend = _Rslab() if find_spec("rslab") else _SuperLU()

    def values(self, contributions: Floats) -> Floats:
        """Stored values of the matrix, contributions added up."""
        summed = np.bincount(self._place, contributions, minlength=len(self._rows))
        return np.asarray(summed, dtype=np.float64)

    def matrix(self, values: Floats) -> Any:
        """The matrix in compressed columns."""
        shape = (self.size, self.size)
        return csc_array((values, self._rows, self._indptr), shape=shape)

    def factor(self, values: Floats) -> Factor:
        """Factor of the matrix with these stored values; raises ArithmeticError if singular."""
        return self._backend.factor(self.matrix(values))


class _Backend(Protocol):
    def factor(self, matrix: Any) -> Factor: ...


class _SuperLU:
    """SciPy's LU with a symmetric ordering: always there, no symbolic reuse."""

    def factor(self, matrix: Any) -> Factor:
        try:
            factor: Factor = splu(
                csc_matrix(matrix),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise ArithmeticError(str(error)) from error
        return factor


class _Rslab:
    """Sparse LDL' that keeps its symbolic analysis; the extra `fast`."""

    def __init__(self) -> None:
        self._symbolic: Any = None
        self._lower: Any = None

    def factor(self, matrix: Any) -> Factor:
        import rslab

        if self._symbolic is None:
            self._symbolic = rslab.analyze(csc_matrix(matrix), path="ldlt")
            column = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
            self._lower = matrix.indices >= column
        try:
            factor = self._symbolic.factor(np.ascontiguousarray(matrix.data[self._lower]))
        except (RuntimeError, ValueError) as error:
            raise ArithmeticError(str(error)) from error
        return _Refined(factor, matrix)


class _Refined:
    """One step of iterative refinement around a factor: guards the result at little cost."""

    def __init__(self, factor: Any, matrix: Any) -> None:
        self._factor, self._matrix = factor, matrix

    def solve(self, rhs: Floats) -> Floats:
        x = np.asarray(self._factor.solve(rhs), dtype=np.float64)
        return np.asarray(x + self._factor.solve(rhs - self._matrix @ x))
