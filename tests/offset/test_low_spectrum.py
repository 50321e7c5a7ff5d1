"""Smallest singular values of sparse matrices, against dense ones."""

import numpy as np
import pytest
from scipy.sparse import block_diag, csr_array, random_array

from pqmesh.spectrum import low_spectrum, orthonormal


def with_zeros(zeros, size=500, seed=0):
    """Sparse (size + 100, size) with this many singular values near `level`, others near 1."""
    rng = np.random.default_rng(seed)
    sparse = random_array((size + 100, size), density=0.01, rng=rng).tolil()
    for k in range(size):
        sparse[k, k] = 3.0
    dense = sparse.toarray()
    # Some columns are combinations of others: so many zeros.
    for k in range(zeros):
        dense[:, size - 1 - k] = dense[:, k] - 2 * dense[:, zeros + k]
    return csr_array(dense)


@pytest.mark.parametrize("zeros", [0, 1, 7, 40])
def test_zeros_are_counted_and_the_next_value_is_exact(zeros):
    matrix = with_zeros(zeros)
    wanted = np.linalg.svd(matrix.toarray(), compute_uv=False)[::-1]
    found = low_spectrum(matrix, 1e-9, expected=3)
    assert np.count_nonzero(found.values <= 1e-9) == zeros
    assert found.values[:zeros].max(initial=0.0) < 1e-13
    # Exact to a hundredth, and from above, as every Ritz value.
    assert wanted[zeros] * (1 - 1e-12) <= found.values[zeros] <= 1.01 * wanted[zeros]
    kept = found.vectors[:, :zeros]
    assert np.abs(kept.T @ kept - np.eye(zeros)).max(initial=0.0) < 1e-13
    assert np.abs(matrix @ kept).max(initial=0.0) < 1e-13


def test_values_inside_the_bound_are_those_of_the_dense_matrix():
    # A band of small values, well apart from the others.
    rng = np.random.default_rng(1)
    small = np.diag(np.geomspace(1e-6, 1e-3, 12))
    matrix = block_diag([small, 2.0 * np.eye(400) + 0.01 * rng.normal(size=(400, 400))]).tocsr()
    found = low_spectrum(matrix, 1e-2, expected=2)
    assert np.allclose(found.values[:12], np.geomspace(1e-6, 1e-3, 12), rtol=1e-6, atol=0)


@pytest.mark.parametrize("condition", [1.0, 1e6, 1e12, 1e15])
def test_orthonormal_columns_span_those_of_blocks_of_any_condition(condition):
    rng = np.random.default_rng(0)
    left = np.linalg.qr(rng.normal(size=(900, 20)))[0]
    right = np.linalg.qr(rng.normal(size=(20, 20)))[0]
    values = np.geomspace(1.0, 1.0 / condition, 20)
    block = (left * values) @ right
    found = orthonormal(block)
    assert np.abs(found.T @ found - np.eye(20)).max() < 1e-13
    # Directions above the rounding of the block are kept.
    clear = values > 1e-8
    missing = left[:, clear] - found @ (found.T @ left[:, clear])
    assert np.abs(missing).max() < 1e-6


def test_zero_columns_do_not_spoil_the_others():
    block = np.zeros((50, 3))
    block[:, 0] = 2.0
    found = orthonormal(block)
    assert np.isfinite(found).all()
    assert np.abs(found[:, np.abs(found).max(axis=0) > 0].std(axis=0)).max() < 1e-12


def test_small_and_wide_matrices_are_solved_densely():
    wide = csr_array(np.eye(3, 5))
    found = low_spectrum(wide, 0.5)
    assert np.allclose(found.values, [0, 0, 1, 1, 1])
    assert np.abs(wide @ found.vectors[:, :2]).max() < 1e-15


def test_large_matrix_of_zeros_has_zeros_only():
    found = low_spectrum(csr_array((350, 320)), 1.0)
    assert found.values.shape == (320,)
    assert not found.values.any()


def test_everything_below_the_bound_is_returned_as_it_is():
    found = low_spectrum(csr_array(np.zeros((4, 3))), 1.0)
    assert np.allclose(found.values, 0)
    assert found.vectors.shape == (3, 3)
