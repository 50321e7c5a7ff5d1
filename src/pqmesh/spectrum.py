"""Smallest singular values of sparse matrices, and their vectors."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csc_matrix, eye_array

from pqmesh.linear import Factor, factorized
from pqmesh.vectors import Floats

# Up to this size all singular values are computed densely.
DENSE = 300
# Shift of the normal equations against their largest entry: above their rounding, and so small
# that one step of inverse iteration brings what is not near zero down by many digits.
SHIFT = 1e-14
# Vectors kept beyond those asked for, and rounds of the iteration.
SPARE, ROUNDS, LONG_ROUNDS = 8, 2, 15
# A value that falls by less than this share of itself in a round is good to a hundredth.
SETTLED = 1e-4
# Right-hand sides solved at once.
COLUMNS = 16
# Passes of `orthonormal` at most, when it is content, and how far it trusts a Gram matrix.
PASSES, ORTHONORMAL, GRAM_FLOOR = 8, 1e-14, 1e-13
EPSILON = float(np.finfo(np.float64).eps)
# Squares of singular values below this share of the largest are computed again.
KNOWN = 1e-8


class LowSpectrum(NamedTuple):
    """Smallest singular values of a matrix, rising, and their right singular vectors.

    Attributes
    ----------
    values : (p,)
        All values up to the bound asked for, and at least one above it where there is one. That
        first one above is exact to about a hundredth, those beyond it are upper bounds.
    vectors : (n, p)
        Orthonormal columns.
    """

    values: Floats
    vectors: Floats


def low_spectrum(matrix: Any, bound: float, expected: int = 0) -> LowSpectrum:
    """Singular values of a sparse matrix (m, n) up to a bound, and their vectors.

    Inverse iteration on a block of vectors with the shifted normal equations; the values are
    then taken from the matrix itself, so that they are good to rounding error and not to its
    square root. The start is fixed: the same matrix gives the same result.

    Parameters
    ----------
    matrix : sparse (m, n)
    bound : float
        Absolute.
    expected : int
        About how many values lie below; a good guess saves a round.

    Examples
    --------
    >>> from scipy.sparse import diags_array
    >>> low_spectrum(diags_array([3.0, 0.0, 2.0]), 0.1).values
    array([0., 2., 3.])
    """
    rows = matrix.tocsr()
    size = rows.shape[1]
    if size <= DENSE:
        return _dense_spectrum(rows.toarray())
    normal = csc_matrix(rows.T @ rows)
    shift = SHIFT * (float(normal.diagonal().max()) or 1.0)
    factor = factorized(normal + shift * csc_matrix(eye_array(size)))
    count = min(expected + SPARE, size)
    while True:
        start = np.random.default_rng(0).normal(size=(size, count))
        found = _iterated(rows, factor, start, ROUNDS)
        low = int(np.count_nonzero(found.values <= bound))
        if low <= count - SPARE // 2 or count == size:
            break
        count = min(2 * count, size)
    if low == size:
        return found
    return _with_next(rows, factor, found, low)


def _iterated(rows: Any, factor: Factor, start: Floats, rounds: int) -> LowSpectrum:
    """Block inverse iteration, and the singular values of the matrix on its result."""
    block = start
    for _ in range(rounds):
        block = orthonormal(_solved(factor, block))
    return _values_on(rows @ block, block)


def _solved(factor: Factor, block: Floats) -> Floats:
    """Solutions for all columns, a few at a time.

    More at a time are not faster, and threads of the dense kernels then wait for each other.
    """
    parts = range(0, block.shape[1], COLUMNS)
    return np.hstack([factor.solve(block[:, start : start + COLUMNS]) for start in parts])


def _with_next(rows: Any, factor: Factor, found: LowSpectrum, low: int) -> LowSpectrum:
    """The lowest vectors kept, and the one after them iterated for long beside them."""
    kept = found.vectors[:, :low]
    block, value = found.vectors[:, low : low + SPARE], np.inf
    for _ in range(LONG_ROUNDS):
        block = factor.solve(block)
        for _ in range(2):
            # Once is not enough: the solution is nearly all in the space of the kept ones.
            block = orthonormal(block - kept @ (kept.T @ block))
        above, before = _values_on(rows @ block, block), value
        value = float(above.values[0])
        # A round takes off more of what is left than this, or else the vectors are of one value.
        if before - value <= SETTLED * value:
            break
    return LowSpectrum(
        np.concatenate([found.values[:low], above.values]),
        np.column_stack([kept, above.vectors]),
    )


def orthonormal(block: Floats) -> Floats:
    """Orthonormal columns that span those of a tall block; noise where the block is deficient.

    By products of matrices only, which run at full speed and do not make threads wait as
    factorisations of tall matrices do. Each pass divides by the root of the Gram matrix, as far
    as its rounding allows; a few passes do it for any condition.

    Examples
    --------
    >>> found = orthonormal(np.array([[1.0, 1.0], [0.0, 1e-9], [0.0, 0.0]]))
    >>> bool(np.allclose(found.T @ found, np.eye(2))), float(np.abs(found[2]).max())
    (True, 0.0)
    """
    # Sums of so many products are no better than the root of their number, in roundings.
    content = max(ORTHONORMAL, EPSILON * np.sqrt(len(block)))
    for _ in range(PASSES):
        length = np.sqrt(np.einsum("ni,ni->i", block, block))
        block = block / np.where(length > 0.0, length, 1.0)
        gram = block.T @ block
        if np.abs(gram - np.eye(len(gram))).max(initial=0.0) <= content:
            break
        values, turn = np.linalg.eigh(gram)
        block = block @ (turn / np.sqrt(np.maximum(values, GRAM_FLOOR * values[-1])))
    return np.asarray(block)


def _values_on(image: Floats, block: Floats) -> LowSpectrum:
    """Singular values of a matrix on an orthonormal block, rising, from its image of the block.

    The Gram matrix of the image knows values down to the root of rounding against the largest.
    What lies deeper is taken again by itself, so that zeros come out as rounding.
    """
    values, vectors = [np.empty(0)], [block[:, :0]]
    while image.shape[1]:
        squares, turn = np.linalg.eigh(image.T @ image)
        image, block = image @ turn, block @ turn
        known = squares >= KNOWN * max(squares[-1], 0.0)
        values.insert(0, np.sqrt(np.maximum(squares[known], 0.0)))
        vectors.insert(0, block[:, known])
        image, block = image[:, ~known], block[:, ~known]
    return LowSpectrum(np.concatenate(values), np.column_stack(vectors))


def _dense_spectrum(matrix: Floats) -> LowSpectrum:
    """All singular values and vectors."""
    missing = max(matrix.shape[1] - matrix.shape[0], 0)
    padded = np.vstack([matrix, np.zeros((missing, matrix.shape[1]))])
    _, values, vectors = np.linalg.svd(padded, full_matrices=False)
    return LowSpectrum(values[::-1].copy(), np.asarray(vectors[::-1].T))
