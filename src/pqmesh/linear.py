"""The one place that factorises sparse matrices: symmetric systems whose pattern is fixed.

What does not change is done once: where the contributions go, the fill-reducing order, and the
symbolic part of the factorisation where the back end keeps one. The back end is what is installed:
rslab (extra `fast`) or SciPy's SuperLU, and MKL's Pardiso (extra `mkl`) in place of rslab for small
matrices and in place of SuperLU for all.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol
from warnings import warn
from weakref import ref

import numpy as np
from scipy.sparse import csc_array, csc_matrix, csr_matrix
from scipy.sparse.linalg import splu

from pqmesh.vectors import Floats, Indices

# Bytes that rslab's analysis takes for each stored entry: about 80 measured, on quad meshes.
ANALYSIS = 100
# Bytes that Pardiso takes for each stored entry: up to 270 measured, on quad meshes.
FACTOR = 400
# Up to so many unknowns Pardiso is faster than rslab: twice at 1000, as fast at 44 000.
FASTER = 40_000
# Parameters of Pardiso by number: pivots below 1e-15 of the largest entry are replaced, and told
# (the matrix is singular, or its rows want another order); blocks of two rows are pivots, too.
PARDISO = {9: 15, 20: 1}
REPLACED = 13
# Bytes for the stacks and heaps of its threads, which it starts with the first analysis.
THREADS = 1 << 27
# Below so many unknowns threads wait for each other longer than they work.
FEW = 6000
# So many bytes are there: to ask would take longer than to factorise.
SMALL = 1 << 24


class Factor(Protocol):
    """A factorised matrix."""

    def solve(self, rhs: Floats, *, rough: bool = False) -> Floats:
        """Solution (n,) of A x = rhs; a rough one where a few digits will do.

        SciPy's factor takes several columns (n, k), too.
        """
        ...


def factorized(matrix: Any) -> Factor:
    """SciPy's factor of one symmetric sparse matrix.

    Raises
    ------
    ArithmeticError
        When it is singular.
    MemoryError
        When it does not fit.
    """
    return _SuperLU().factor(_Lower.of(csc_matrix(matrix)))


class SymmetricPattern:
    """Sparse symmetric matrix whose pattern is fixed and whose values change.

    Parameters
    ----------
    rows, columns : (N,)
        Coordinates of contributions; `factor` takes one value for each, duplicates add up.
    size : int
    """

    def __init__(self, rows: Indices, columns: Indices, size: int) -> None:
        column, self._rows, self._place, self.diagonal = _stored(rows, columns, size)
        self._indptr = np.searchsorted(column, np.arange(size + 1))
        self._lower = self._rows >= column
        self._below = np.concatenate([[0], np.cumsum(self._lower)])[self._indptr]
        self.size = size
        self._backend = _backend(size)

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
        lower = (values[self._lower], self._rows[self._lower], self._below)
        shape = (self.size, self.size)
        return self._backend.factor(_Lower(csc_matrix(lower, shape=shape)))


class BlockPattern:
    """Sparse symmetric matrix of 3 x 3 blocks whose pattern is fixed and whose values change.

    Parameters
    ----------
    rows, columns : (N,)
        Blocks that are not zero, rows >= columns, in any order, repeated at will; those of the
        diagonal are added.
    size : int
        Number of block rows.

    Attributes
    ----------
    place : (N,)
        Stored block of each pair.
    count : int
        Number of stored blocks: those on and below the diagonal.
    diagonal : (size,)
        The stored blocks of the diagonal.
    """

    def __init__(self, rows: Indices, columns: Indices, size: int) -> None:
        column, row, self.place, self.diagonal = _stored(rows, columns, size)
        self.size, self.count = size, len(row)
        self._order, self._rows, self._indptr = _scalar_columns(row, column, size)
        self._backend = _backend(3 * size)

    def factor(self, entries: Floats) -> Factor:
        """Factor of the matrix with these entries (3, 3, count) of its stored blocks.

        Raises
        ------
        ArithmeticError
            When it is singular.
        MemoryError
            When it does not fit.
        """
        data = entries.reshape(-1)[self._order]
        shape = (3 * self.size, 3 * self.size)
        return self._backend.factor(_Lower(csc_matrix((data, self._rows, self._indptr), shape)))


def _stored(
    rows: Indices, columns: Indices, size: int
) -> tuple[Indices, Indices, Indices, Indices]:
    """Columns and rows of what is stored, column by column; places of pairs and of the diagonal."""
    own = np.arange(size)
    keys = np.concatenate([columns * np.int64(size) + rows, own * np.int64(size + 1)])
    unique, place = np.unique(keys, return_inverse=True)
    place = place.reshape(-1)
    column, row = np.divmod(unique, max(size, 1))
    return column, row, place[: len(rows)], place[len(rows) :]


def _scalar_columns(row: Indices, column: Indices, size: int) -> tuple[Indices, Any, Any]:
    """Lower triangle of 3 x 3 blocks as compressed columns: places in the blocks, rows, starts.

    The blocks come sorted by column and row, the diagonal one first in its column.
    """
    count = len(row)
    first = np.searchsorted(column, np.arange(size + 1))
    height = np.diff(first)
    lengths = (3 * height[:, None] - np.arange(3)).ravel()
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    # Entry (r, c) of the b-th block of a column stands in scalar column 3 column + c.
    rank = np.arange(count) - first[column]
    block, r, c = (
        x.ravel() for x in np.meshgrid(np.arange(count), [0, 1, 2], [0, 1, 2], indexing="ij")
    )
    below = (rank[block] > 0) | (r >= c)
    block, r, c = block[below], r[below], c[below]
    at = indptr[3 * column[block] + c] + 3 * rank[block] + r - c
    order = np.empty(len(at), dtype=np.int64)
    rows = np.empty(len(at), dtype=np.int32)
    order[at] = (3 * r + c) * count + block
    rows[at] = 3 * row[block] + r
    small = indptr[-1] < np.iinfo(np.int32).max
    return order, rows, indptr.astype(np.int32 if small else np.int64)


class _Lower:
    """A symmetric matrix as its lower triangle in compressed columns."""

    def __init__(self, lower: Any) -> None:
        lower.has_canonical_format = True
        self.lower = lower

    @classmethod
    def of(cls, matrix: Any) -> _Lower:
        """From the whole matrix."""
        matrix.sum_duplicates()
        column = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        kept = matrix.indices >= column
        below = np.concatenate([[0], np.cumsum(kept)])[matrix.indptr]
        return cls(csc_matrix((matrix.data[kept], matrix.indices[kept], below), matrix.shape))

    def times(self, x: Floats) -> Floats:
        """The matrix times a vector (n,)."""
        return np.asarray(self.lower @ x + self.lower.T @ x - self.lower.diagonal() * x)

    def whole(self) -> Any:
        """Both triangles, in compressed columns."""
        upper = self.lower.T.tocsc()
        upper.setdiag(0.0)
        return csc_matrix(self.lower + upper)


class _Backend(Protocol):
    def factor(self, matrix: _Lower) -> Factor: ...


def _backend(size: int) -> _Backend:
    """What is installed, the faster one for so many unknowns."""
    rslab = is_usable("rslab")
    other: _Backend = _Rslab() if rslab else _SuperLU()
    # Pardiso refuses a matrix without rows, which needs no solver.
    faster = size > 0 and (size <= FASTER or not rslab)
    return _Pardiso(other) if faster and is_usable("pymklpardiso") else other


@cache
def is_usable(module: str) -> bool:
    """Whether an optional module is installed and can be loaded; one that cannot is told once."""
    if find_spec(module) is None:
        return False
    try:
        import_module(module)
    except (ImportError, OSError) as error:
        warn(
            f"An optional solver must load; {module} is installed, but does not ({error}). "
            f"Another solver is used: install it anew, or remove it.",
            RuntimeWarning,
            stacklevel=2,
        )
        return False
    return True


def check_room(size: int) -> None:
    """Raise MemoryError unless so many bytes can be had.

    A back end that runs out of memory ends the whole process: what it will need is asked for, and
    given back, before. A system that promises more than it has is not believed.
    """
    if size < SMALL:
        return
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text().splitlines()
        free = [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
        if free and size > free[0]:
            raise MemoryError(f"{size} bytes are needed, {free[0]} are free")
    np.empty(size, dtype=np.uint8)


@contextmanager
def room_kept(size: int) -> Iterator[None]:
    """So many bytes are kept back, for what comes after work that may take all there is."""
    held = np.empty(size, dtype=np.uint8)
    yield
    del held


def _failure(error: Exception) -> Exception:
    """What a back end's error means: too little memory, or a singular matrix."""
    words = str(error).lower()
    short = any(word in words for word in ("memory", "malloc", "alloc"))
    return MemoryError(str(error)) if short else ArithmeticError(str(error))


class _SuperLU:
    """SciPy's LU with a symmetric ordering: always there."""

    def factor(self, matrix: _Lower) -> Factor:
        try:
            factor = splu(
                matrix.whole(),
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:
            raise _failure(error) from error
        return _Plain(factor)


class _Rslab:
    """Sparse LDL' that keeps its symbolic analysis; the extra `fast`."""

    def __init__(self) -> None:
        self._symbolic: Any = None
        self._needed = 0

    def factor(self, matrix: _Lower) -> Factor:
        import rslab

        if self._symbolic is None:
            check_room(ANALYSIS * matrix.lower.nnz + THREADS)
            threads = 1 if matrix.lower.shape[0] < FEW else None
            self._symbolic = rslab.analyze(matrix.lower, path="ldlt", threads=threads)
            self._needed = self._symbolic.memory_plan()["peak_bytes"]
        check_room(self._needed)
        try:
            factor = self._symbolic.factor(matrix.lower.data)
        except (RuntimeError, ValueError) as error:
            raise _failure(error) from error
        return _Refined(factor, matrix)


class _Pardiso:
    """MKL's sparse LDL', which keeps its symbolic analysis, too; the extra `mkl`.

    It pivots within its blocks only: another back end takes the matrices for which that is not
    enough, and tells which of them are singular. All systems here are definite, or nearly singular;
    no back end is safe for others: rslab may refuse them, SuperLU does not pivot.
    """

    def __init__(self, other: _Backend) -> None:
        self._other = other
        self._solver: Any = None
        self._last: ref[_Refined] | None = None

    def factor(self, matrix: _Lower) -> Factor:
        # A solver holds one factor: as long as somebody has it, the next one is another's.
        if self._last is not None and self._last() is not None:
            self._solver = None
        try:
            if self._solver is None:
                self._solver = _analysed(matrix.lower)
            else:
                self._solver.refactor(matrix.lower.data)
        except RuntimeError as error:
            self._solver = None
            raise _failure(error) from error
        if self._solver.get_iparm_value(REPLACED):
            return self._other.factor(matrix)
        factor = _Refined(self._solver, matrix)
        self._last = ref(factor)
        return factor


def _analysed(lower: Any) -> Any:
    """Pardiso's analysis and first factor of a matrix by its lower triangle."""
    from pymklpardiso import MTYPE_REAL_SYM_INDEF, PardisoSolver

    check_room(FACTOR * lower.nnz)
    # The lower triangle by columns is the upper one by rows.
    rows = csr_matrix((lower.data, lower.indices, lower.indptr), shape=lower.shape)
    return PardisoSolver(rows, MTYPE_REAL_SYM_INDEF, iparms=PARDISO)


class _Plain:
    """A factor as it is."""

    def __init__(self, factor: Any) -> None:
        self._factor = factor

    def solve(self, rhs: Floats, *, rough: bool = False) -> Floats:
        return np.asarray(self._factor.solve(rhs), dtype=np.float64)


class _Refined:
    """One step of iterative refinement around a factor: guards the result at little cost."""

    def __init__(self, factor: Any, matrix: _Lower) -> None:
        self._factor, self._matrix = factor, matrix

    def solve(self, rhs: Floats, *, rough: bool = False) -> Floats:
        x = self._solved(rhs)
        return x if rough else x + self._solved(rhs - self._matrix.times(x))

    def _solved(self, rhs: Floats) -> Floats:
        return np.asarray(self._factor.solve(np.ascontiguousarray(rhs)), dtype=np.float64)
