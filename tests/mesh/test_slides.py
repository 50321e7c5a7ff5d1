"""Least squares behind the slides: small singular values count, null vectors do not."""

import numpy as np
import pytest
from scipy.sparse import coo_array

from pqmesh.mesh.slides import least_squares


@pytest.mark.parametrize("left_over", [0.0, 1.0])
@pytest.mark.parametrize("shape", [(9, 7), (7, 9), (12, 12)])
def test_least_squares_is_the_shortest_one_with_small_singular_values(
    shape: tuple[int, int], left_over: float
) -> None:
    rng = np.random.default_rng(sum(shape))
    rank = min(shape)
    left, right = (np.linalg.qr(rng.normal(size=(size, rank)))[0] for size in shape)
    # The smallest is far below the root of the ridge, 1e-4; two are none at all.
    values = np.concatenate([np.geomspace(1.0, 1e-5, rank - 2), [0.0, 0.0]])
    matrix = (left * values) @ right.T
    target = matrix @ rng.normal(size=shape[1]) + left_over * rng.normal(size=shape[0])
    found = least_squares(coo_array(matrix), target)
    exact = np.linalg.lstsq(matrix, target, rcond=1e-9)[0]
    gap = float(np.linalg.norm(matrix @ (found - exact)))
    # What is left over leaves the rounding of the normal equations.
    assert gap < (1e-6 if left_over else 1e-13) * np.linalg.norm(target)
    assert np.linalg.norm(found) == pytest.approx(float(np.linalg.norm(exact)), rel=1e-4)
