"""Plan outlines: even-odd rule, holes, refusals."""

import time

import numpy as np
import pytest

from pqmesh.errors import SpecError
from pqmesh.fabricate.walls import outline_walls
from pqmesh.network.region import PlanOutline
from pqmesh.surface.face import even_odd, ring_distance
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


def test_ring_of_many_corners_answers_as_all_its_sides_do_one_by_one():
    rng = np.random.default_rng(4)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 700))
    ring = np.column_stack([3.0 * np.cos(angle), np.sin(5.0 * angle) + np.sin(angle)])
    points = np.concatenate([rng.uniform(-4.0, 4.0, (300, 2)), ring[::50]])
    away, inside = np.full(len(points), np.inf), np.zeros(len(points), dtype=bool)
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        share = np.clip(((points - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
        away = np.minimum(away, np.hypot(*(points - a - share[:, None] * (b - a)).T))
        between = (points[:, 1] >= min(a[1], b[1])) & (points[:, 1] < max(a[1], b[1]))
        with np.errstate(divide="ignore", invalid="ignore"):
            x = a[0] + (points[:, 1] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
        inside ^= between & (points[:, 0] < x)
    assert np.abs(ring_distance(ring, points) - away).max() < 1e-14
    assert (even_odd(ring, points) == inside).all()


def test_outline_of_ten_thousand_corners_is_answered_in_seconds():
    angle = np.linspace(0.0, 2.0 * np.pi, 10_000, endpoint=False)
    outline = PlanOutline(np.column_stack([8.0 * np.cos(angle), 6.0 * np.sin(angle)]))
    surface = graph_surface("x*y/9", (-12, 12), (-9, 9))
    began = time.process_time()
    uv = surface.domain.grid(120, 120).reshape(-1, 2)
    assert outline.on(surface)(uv).mean() == pytest.approx(outline.area / (24 * 18), abs=0.01)
    assert outline.on(surface, 2.0)(uv).mean() > 0.5
    assert len(outline_walls(outline).starts) == 10_000
    # 0.4 s; compared with all corners one by one it takes 6 s.
    assert time.process_time() - began < 3.0
