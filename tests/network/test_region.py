"""Plan outlines: even-odd rule, holes, refusals."""

import numpy as np
import pytest

from pqmesh.errors import SpecError
from pqmesh.network.region import PlanOutline
from pqmesh.surface.formula import graph_surface

SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]


@pytest.mark.parametrize("ring", [SQUARE, SQUARE[::-1], SQUARE[2:] + SQUARE[:2]])
def test_direction_and_first_corner_mean_nothing(ring):
    outline = PlanOutline(ring)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 5, size=(500, 2))
    exact = ((points > 0) & (points < 4)).all(axis=1)
    assert (outline.contains(points) == exact).all()
    assert outline.area == 16.0


def test_holes_are_outside_and_their_area_is_taken_off():
    outline = PlanOutline(SQUARE, ([[1, 1], [2, 1], [2, 3], [1, 3]],))
    assert outline.area == 14.0
    assert outline.contains(np.array([[1.5, 2.0], [3.0, 2.0]])).tolist() == [False, True]


def test_outline_on_a_surface_looks_at_the_plan_only():
    surface = graph_surface("100*x + y**2", (-5, 5), (-5, 5))
    within = PlanOutline(SQUARE).on(surface)
    assert within(np.array([[1.0, 1.0], [-1.0, 1.0]])).tolist() == [True, False]


@pytest.mark.parametrize(
    ("ring", "text"),
    [
        ([[0, 0], [1, 0]], "at least three points"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], "at least three points"),
        ([[0, 0], [1, 0], [np.nan, 1]], "must be finite"),
        ([[0, 0], [1, 1], [2, 2]], "must enclose area"),
    ],
)
def test_outline_refuses(ring, text):
    with pytest.raises(SpecError, match=text):
        PlanOutline(ring)
    with pytest.raises(SpecError, match="hole 0"):
        PlanOutline(SQUARE, (ring,))
