"""Surfaces evaluated together give what they give alone."""

import jets
import numpy as np
import pytest

from pqmesh.surface.base import Surface
from pqmesh.surface.bspline import BLOCK, BSplineSurface
from pqmesh.surface.bundle import Bundle
from pqmesh.surface.formula import graph_surface


def splines() -> list[Surface]:
    """Two cubics of different size, one of them periodic; rational ones; one of degree 5."""
    round_one, weighted = jets.periodic_net(), jets.weighted_net()
    plain = BSplineSurface(weighted.points[:, :5], (3, 3))
    turned = weighted._replace(weights=weighted.weights[::-1])
    rational = [BSplineSurface(n.points, n.degrees, n.knots, n.weights) for n in (weighted, turned)]
    closed = BSplineSurface(round_one.points, (3, 3), round_one.knots, None, (True, False))
    quintic = jets.quintic_net()
    return [plain, rational[0], closed, rational[1],
            BSplineSurface(quintic.points, (5, 5), quintic.knots),
            graph_surface("x*x*y", (0, 2), (0, 3))]  # fmt: skip


@pytest.mark.parametrize("n", [0, 1, 50, 2 * BLOCK + 7])
@pytest.mark.parametrize("chosen", [range(6), [0, 2], [1, 3], [4], [5]])
def test_jets_are_those_of_each_surface(chosen: list[int], n: int) -> None:
    surfaces = [splines()[i] for i in chosen]
    rng = np.random.default_rng(n)
    owner = rng.integers(len(surfaces), size=n)
    low, size = (np.array([getattr(s.domain, name) for s in surfaces]) for name in ("low", "size"))
    # Also beyond the bounds, where the polynomials go on, and on bounds and knots.
    uv = (
        low[owner]
        + rng.choice([-0.1, 0.0, 0.25, 0.5, 1.0, 1.1, *rng.random(9)], (n, 2)) * size[owner]
    )
    found = Bundle(surfaces).jet(owner, uv)
    assert found.shape == (6, n, 3)
    for number, surface in enumerate(surfaces):
        rows = owner == number
        own = uv[rows]
        if surface.domain.periodic[0]:
            own[:, 0] = surface.domain.reduce(own)[:, 0]
        expected = np.stack(surface.jet(own))
        size_of = np.abs(expected).max(axis=(1, 2), keepdims=True, initial=1.0)
        assert (np.abs(found[:, rows] - expected) <= 1e-14 * size_of).all()
