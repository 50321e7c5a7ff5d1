"""Exactly planar samples of conjugate cubics, and only those."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pqmesh.errors import NetworkError
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.network.cubic import conjugate_cubic_mesh
from pqmesh.surface.analytic import conjugate_cubic
from pqmesh.surface.curvature import gaussian_curvature

FACTOR = st.floats(0.3, 3.0).flatmap(lambda c: st.sampled_from([c, -c]))


@settings(max_examples=50, deadline=None)
@given(c1=FACTOR, c2=FACTOR, seed=st.integers(0, 1000))
def test_steps_in_the_ratio_of_the_factors_give_plane_cells(
    c1: float, c2: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    reach = 0.2 / max(abs(c1), abs(c2))
    shape = {"a10": frame[0], "a01": frame[1], "a20": frame[2], "u": (-reach, reach)}
    wide = (-reach * max(1, abs(c2 / c1)), reach * max(1, abs(c2 / c1)))
    mesh = conjugate_cubic_mesh(4, c1, c2, v=wide, **shape)
    assert planarity(mesh).max() < 1e-10


def test_other_steps_give_bent_cells() -> None:
    surface = conjugate_cubic()
    u, v = np.linspace(-0.35, 0.35, 9), np.linspace(-0.35, 0.35, 6)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), -1)
    points = surface.jet(uv.reshape(-1, 2)).point.reshape(9, 6, 3)
    assert planarity(grid_mesh(points)).min() > 1e-6


def test_every_such_surface_is_a_saddle() -> None:
    surface = conjugate_cubic(0.7, -1.3)
    jet = surface.jet(surface.domain.grid(20, 20).reshape(-1, 2))
    assert gaussian_curvature(jet).max() < 0


def test_steps_that_do_not_fit_are_refused() -> None:
    with pytest.raises(NetworkError, match=r"need steps of 3\.5 in v, and v runs over 0\.7"):
        conjugate_cubic_mesh(2, 1.0, 10.0)
    with pytest.raises(NetworkError, match="At least one step"):
        conjugate_cubic_mesh(0)
