"""Sparse symmetric systems of fixed pattern: all back ends against dense solutions."""

import mpmath
import numpy as np
import pytest
from scipy.sparse import csc_matrix, csr_array

from pqmesh import linear
from pqmesh.linear import BlockPattern, SymmetricPattern, factorized


def block_system(seed, n=12, diagonal=30.0):
    """Pattern, its blocks and the dense matrix: random pairs, some of them given twice."""
    rng = np.random.default_rng(seed)
    pairs = np.sort(rng.integers(0, n, (4 * n, 2)), axis=1)[:, ::-1]
    pairs = np.concatenate([pairs, pairs[:7]])
    pattern = BlockPattern(pairs[:, 0], pairs[:, 1], n)
    blocks, dense = np.zeros((pattern.count, 3, 3)), np.zeros((n, 3, n, 3))
    for (i, j), place in zip(pairs, pattern.place, strict=True):
        block = rng.normal(size=(3, 3))
        block = block + block.T if i == j else block
        blocks[place] += block
        dense[i, :, j] += block
        if i != j:
            dense[j, :, i] += block.T
    for i, place in enumerate(pattern.diagonal):
        blocks[place] += diagonal * np.eye(3)
        dense[i, :, i] += diagonal * np.eye(3)
    return pattern, blocks, dense.reshape(3 * n, 3 * n)


def entries(blocks):
    """Blocks (count, 3, 3) as a pattern takes them."""
    return np.array(blocks.transpose(1, 2, 0), order="C")


def relative(found, wanted):
    return np.abs(found - wanted).max() / np.abs(wanted).max()


# --- patterns ---------------------------------------------------------------------------------


def test_block_pattern_stores_each_block_below_the_diagonal_once():
    pattern = BlockPattern(np.array([2, 2, 1, 2]), np.array([0, 1, 1, 0]), 4)
    # Column by column: (0, 0), (2, 0); (1, 1), (2, 1); (2, 2); (3, 3).
    assert pattern.count == 6
    assert pattern.place.tolist() == [1, 3, 2, 1]
    assert pattern.diagonal.tolist() == [0, 2, 4, 5]


@pytest.mark.parametrize("seed", range(4))
def test_blocks_are_solved_as_the_dense_matrix(backend, seed):
    pattern, blocks, dense = block_system(seed)
    assert np.linalg.cond(dense) < 10
    rhs = np.random.default_rng(seed + 9).normal(size=len(dense))
    wanted = np.linalg.solve(dense, rhs)
    factor = pattern.factor(entries(blocks))
    # Condition below 10: some tens of roundings, refined or not.
    assert relative(factor.solve(rhs), wanted) < 1e-14
    assert relative(factor.solve(rhs, rough=True), wanted) < 1e-14


def test_matrix_that_is_not_definite_is_solved_too(backend):
    pattern, blocks, dense = block_system(5, diagonal=0.0)
    blocks[pattern.diagonal] += np.diag([9.0, -11.0, 10.0])
    dense += np.diag(np.tile([9.0, -11.0, 10.0], len(dense) // 3))
    assert np.linalg.eigvalsh(dense)[[0, -1]].prod() < 0
    rhs = np.arange(1.0, len(dense) + 1)
    assert relative(pattern.factor(entries(blocks)).solve(rhs), np.linalg.solve(dense, rhs)) < 1e-12


def test_older_factor_keeps_its_own_values(backend):
    # Rounds with the factor at hand go on after the pattern has had other values.
    pattern, blocks, dense = block_system(1)
    rhs = np.ones(len(dense))
    older = pattern.factor(entries(blocks))
    newer = pattern.factor(entries(2.0 * blocks))
    kept = blocks.copy()
    blocks[:] = 0.0
    wanted = np.linalg.solve(dense, rhs)
    for rough in (False, True):
        assert relative(older.solve(rhs, rough=rough), wanted) < 1e-14
        assert relative(newer.solve(rhs, rough=rough), wanted / 2) < 1e-14
    assert relative(pattern.factor(entries(kept)).solve(rhs), wanted) < 1e-14


def test_pardiso_analyses_again_only_where_it_has_to(monkeypatch):
    pytest.importorskip("pymklpardiso", reason="the extra `mkl` is not installed")
    pattern, blocks, _ = block_system(1)
    pattern._backend, calls, plain = linear._Pardiso(None), [], linear._analysed

    def analysed(lower):
        calls.append(lower.shape)
        return plain(lower)

    monkeypatch.setattr(linear, "_analysed", analysed)
    factor = None
    for _ in range(3):
        # The one before is given up first, as the solver does.
        factor = None
        factor = pattern.factor(entries(blocks))
    assert len(calls) == 1
    newer = pattern.factor(entries(2.0 * blocks))
    assert len(calls) == 2
    # What failed halfway is not used again.
    del factor, newer
    failing = pattern._backend._solver = Failing()
    with pytest.raises(MemoryError):
        pattern.factor(entries(blocks))
    assert pattern._backend._solver is not failing
    pattern.factor(entries(blocks))
    assert len(calls) == 3


class Failing:
    """A solver without memory."""

    def refactor(self, values):
        raise RuntimeError("not enough memory")


@pytest.mark.parametrize(
    "dense", [[[1.0, 0.0], [0.0, 1e-10]], [[0.0, 1.0], [1.0, 0.0]]], ids=["graded", "two rows"]
)
def test_pardiso_needs_no_other_for_small_pivots_and_blocks_of_two_rows(dense):
    pytest.importorskip("pymklpardiso", reason="the extra `mkl` is not installed")
    pattern = SymmetricPattern(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1]), 2)
    pattern._backend = linear._Pardiso(None)
    found = pattern.factor(np.ravel(dense)).solve(np.array([3.0, 2.0]))
    assert relative(found, np.linalg.solve(dense, [3.0, 2.0])) < 1e-14


def test_refinement_takes_off_what_a_factor_misses():
    class Rough:
        def solve(self, rhs):
            return 1.01 * rhs / 2.0

    factor = linear._Refined(Rough(), linear._Lower.of(csc_matrix(2.0 * np.eye(3))))
    assert np.allclose(factor.solve(np.ones(3), rough=True), 0.5 * 1.01, rtol=1e-14)
    assert np.allclose(factor.solve(np.ones(3)), 0.5 * (1 - 1e-4), rtol=1e-14)


def test_both_patterns_and_the_single_matrix_agree(backend):
    pattern, blocks, dense = block_system(2)
    rhs = np.sin(np.arange(len(dense)))
    wanted = np.linalg.solve(dense, rhs)
    rows, columns = np.nonzero(dense)
    scalars = SymmetricPattern(rows, columns, len(dense))
    stored = scalars.values(dense[rows, columns])
    assert (scalars.matrix(stored).toarray() == dense).all()
    assert relative(scalars.factor(stored).solve(rhs), wanted) < 1e-14
    assert relative(factorized(csr_array(dense)).solve(rhs), wanted) < 1e-14
    assert relative(pattern.factor(entries(blocks)).solve(rhs), wanted) < 1e-14


def test_stiff_system_is_solved_to_its_condition(backend):
    # As at a large penalty: ten equations of weight 1e8 over 24 unknowns of weight 1.
    rng = np.random.default_rng(0)
    equations = rng.normal(size=(10, 24))
    dense = 1e8 * equations.T @ equations + np.diag(rng.uniform(1, 2, 24))
    rows, columns = np.tril_indices(8)
    pattern = BlockPattern(rows, columns, 8)
    blocks = np.zeros((pattern.count, 3, 3))
    blocks[pattern.place] = dense.reshape(8, 3, 8, 3).transpose(0, 2, 1, 3)[rows, columns]
    rhs = rng.normal(size=24)
    with mpmath.workdps(40):
        exact = mpmath.lu_solve(mpmath.matrix(dense.tolist()), mpmath.matrix(rhs.tolist()))
    wanted = np.array([float(value) for value in exact])
    condition = np.linalg.cond(dense)
    assert 1e9 < condition < 1e10
    factor = pattern.factor(entries(blocks))
    for rough in (False, True):
        assert relative(factor.solve(rhs, rough=rough), wanted) < condition * 2.3e-16


def test_refined_solution_has_a_residual_of_rounding(backend):
    pattern, blocks, dense = block_system(3)
    rhs = np.random.default_rng(0).normal(size=len(dense))
    residual = dense @ pattern.factor(entries(blocks)).solve(rhs) - rhs
    assert np.abs(residual).max() < 1e-15 * np.abs(dense).sum(axis=1).max()


# --- singular ---------------------------------------------------------------------------------


def springs(n, held):
    """A chain of springs, which can be moved as a whole unless the first end is held."""
    i = np.arange(n - 1)
    pattern = BlockPattern(i + 1, i, n)
    blocks = np.zeros((pattern.count, 3, 3))
    blocks[pattern.place] -= np.eye(3)
    np.add.at(blocks, pattern.diagonal[i], np.eye(3))
    np.add.at(blocks, pattern.diagonal[i + 1], np.eye(3))
    blocks[pattern.diagonal[0]] += held * np.eye(3)
    return pattern, blocks


def test_held_chain_is_stretched_as_by_hand(backend):
    # A force of 1 at the last end moves the k-th of them by 1 / held + k.
    pattern, blocks = springs(20, held=0.5)
    force = np.zeros((20, 3))
    force[-1, 1] = 1.0
    moved = pattern.factor(entries(blocks)).solve(force.ravel()).reshape(-1, 3)
    assert np.abs(moved[:, 1] - 2.0 - np.arange(20)).max() < 1e-11
    assert (moved[:, [0, 2]] == 0).all()


@pytest.mark.parametrize("name", ["zero", "equal rows", "empty row", "loose chain"])
def test_singular_matrix_is_an_arithmetic_error(backend, name):
    pattern, blocks = springs(8, held=0.0)
    if name != "loose chain":
        blocks[:] = {"zero": 0.0, "equal rows": 1.0, "empty row": 0.0}[name]
    if name == "empty row":
        blocks[pattern.diagonal[1:]] = np.eye(3)
    with pytest.raises(ArithmeticError):
        pattern.factor(entries(blocks))


def test_pattern_solves_again_after_a_singular_matrix(backend):
    # The solver raises its damping and tries again on the same pattern.
    pattern, loose = springs(8, held=0.0)
    with pytest.raises(ArithmeticError):
        pattern.factor(entries(loose))
    _, held = springs(8, held=1.0)
    moved = pattern.factor(entries(held)).solve(np.ones(24)).reshape(-1, 3)
    # Forces of 1 on eight points: 8 + 7 + ... through the springs.
    assert np.abs(moved - np.cumsum([8, 7, 6, 5, 4, 3, 2, 1])[:, None]).max() < 1e-11


def test_back_ends_agree(backend, without_extras):
    results = []
    for _ in range(2):
        pattern, blocks, dense = block_system(7)
        results.append(pattern.factor(entries(blocks)).solve(np.ones(len(dense))))
        without_extras()
    assert relative(results[0], results[1]) < 1e-14


@pytest.mark.parametrize(
    ("installed", "size", "chosen"),
    [
        ({"rslab", "pymklpardiso"}, linear.FASTER, "_Pardiso"),
        ({"rslab", "pymklpardiso"}, linear.FASTER + 1, "_Rslab"),
        ({"pymklpardiso"}, linear.FASTER + 1, "_Pardiso"),
        ({"rslab"}, 10, "_Rslab"),
        (set(), 10, "_SuperLU"),
        ({"pymklpardiso"}, 0, "_SuperLU"),
    ],
)
def test_faster_one_of_what_is_installed_is_chosen(monkeypatch, installed, size, chosen):
    monkeypatch.setattr(linear, "is_usable", lambda name: name in installed)
    assert type(linear._backend(size)).__name__ == chosen


@pytest.mark.parametrize("fault", ["ImportError('libmkl: wrong ELF class')", "OSError('no file')"])
def test_module_that_does_not_load_is_told_once_and_another_used(tmp_path, monkeypatch, fault):
    (tmp_path / "broken_solver.py").write_text(f"raise {fault}")
    monkeypatch.syspath_prepend(tmp_path)
    linear.is_usable.cache_clear()
    with pytest.warns(RuntimeWarning, match="broken_solver is installed, but does not"):
        assert not linear.is_usable("broken_solver")
    # Warnings are errors here: there is no second one.
    assert not linear.is_usable("broken_solver")
    linear.is_usable.cache_clear()


def test_matrix_without_rows_has_an_empty_solution(backend):
    none = np.zeros(0, dtype=np.int64)
    scalars, blocks = SymmetricPattern(none, none, 0), BlockPattern(none, none, 0)
    assert scalars.factor(np.zeros(0)).solve(np.zeros(0)).shape == (0,)
    assert blocks.factor(np.zeros((3, 3, 0))).solve(np.zeros(0)).shape == (0,)


def test_entries_of_the_diagonal_may_be_missing(backend):
    # Equations of equilibrium with multipliers: the second unknown has no entry of its own.
    pattern = SymmetricPattern(np.array([0, 1, 0, 1, 2]), np.array([0, 0, 1, 2, 1]), 3)
    values = pattern.values(np.array([2.0, 1.0, 1.0, 1.0, 1.0]))
    dense = np.array([[2.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    assert (pattern.matrix(values).toarray() == dense).all()
    assert values[pattern.diagonal].tolist() == [2.0, 0.0, 0.0]
    rhs = np.array([1.0, 2.0, 3.0])
    assert relative(pattern.factor(values).solve(rhs), np.linalg.solve(dense, rhs)) < 1e-14
