"""Traced lines: first integrals along them, exact ends, closing, crossings."""

import math

import numpy as np
import pytest

from pqmesh.network.crossings import crossings
from pqmesh.network.lines import joined, restricted, reversed_extension, selected
from pqmesh.network.trace import End, Limits, principal_field, trace
from pqmesh.surface.analytic import MovedSurface, ellipsoid, helicoid, revolution, torus
from pqmesh.surface.base import Domain
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.vectors import norm

AXES = np.array([3.0, 2.0, 1.2])
FINE = Limits(step=0.1, length=40.0, tolerance=1e-11, turn=0.05)


def traced(surface, family, seeds, limits=FINE, gap=1e-3):
    seeds = np.atleast_2d(np.asarray(seeds, float))
    directions = shape_data(surface.jet(seeds)).directions[:, family]
    return trace(surface, principal_field(gap), seeds, directions, limits)


def along(lines, per_step=5):
    """Unwrapped parameters at dense-output points, and the line of each."""
    segment = np.repeat(np.arange(len(lines.arc)), per_step)
    theta = np.tile(np.linspace(0.0, 1.0, per_step), len(lines.arc))
    return lines.at(segment, theta), lines.line_of[segment]


def spread_on_lines(values, owner):
    return max(np.ptp(values[owner == line]) for line in np.unique(owner))


def confocal(points):
    """Coordinates mu < nu of the ellipsoid's confocal family, from points alone."""
    total = (AXES**2).sum() - (points**2).sum(axis=1)
    product = np.prod(AXES**2) * (points**2 / AXES**4).sum(axis=1)
    root = np.sqrt(np.maximum(total**2 - 4.0 * product, 0.0))
    return np.stack([(total - root) / 2, (total + root) / 2], axis=1)


def seeds_on(domain, n, seed=0):
    rng = np.random.default_rng(seed)
    return domain.low + domain.size * rng.uniform(0.1, 0.9, size=(n, 2))


@pytest.mark.parametrize("family", [0, 1])
def test_confocal_coordinate_is_constant_along_lines_of_ellipsoid(family):
    surface = ellipsoid(*AXES)
    lines = traced(surface, family, seeds_on(surface.domain, 12))
    uv, owner = along(lines)
    values = confocal(surface.jet(surface.domain.reduce(uv)).point)
    drift = [spread_on_lines(values[:, i] / values[:, i].mean(), owner) for i in (0, 1)]
    # The normal points outwards, so k1 = -abc/(mu^1/2 nu^3/2): lines of mu const are family 0.
    assert drift[family] < 1e-9
    assert drift[1 - family] > 0.1


def test_tighter_tolerance_lowers_the_drift_on_the_ellipsoid():
    surface = ellipsoid(*AXES)
    drift = []
    for tolerance in (1e-6, 1e-8, 1e-10):
        lines = traced(surface, 0, [[0.6, 0.2]], FINE._replace(step=1.0, tolerance=tolerance))
        uv, owner = along(lines)
        mu = confocal(surface.jet(surface.domain.reduce(uv)).point)[:, 0]
        drift.append(spread_on_lines(mu, owner))
    # Local error h^6 against step h: two digits of tolerance give at least one of drift.
    assert drift[1] < 0.1 * drift[0]
    assert drift[2] < 0.1 * drift[1]


def test_lines_of_hyperbolic_paraboloid_keep_their_integrals():
    surface = graph_surface("x*y", (-1, 1), (-1, 1))
    for family in (0, 1):
        uv, owner = along(traced(surface, family, seeds_on(surface.domain, 9)))
        a, b = np.arcsinh(uv[:, 0]), np.arcsinh(uv[:, 1])
        # Dense output of a local error of 1e-11 over some thirty steps.
        assert min(spread_on_lines(a + b, owner), spread_on_lines(a - b, owner)) < 1e-9


def test_lines_of_helicoid_are_the_diagonals_of_its_parameters():
    surface = helicoid()
    for family in (0, 1):
        uv, owner = along(traced(surface, family, seeds_on(surface.domain, 9)))
        sums, differences = uv[:, 0] + uv[:, 1], uv[:, 0] - uv[:, 1]
        assert min(spread_on_lines(sums, owner), spread_on_lines(differences, owner)) < 1e-9


def test_lines_do_not_depend_on_the_parametrisation():
    # The same graph with u stretched a thousandfold and sheared.
    z = "0.1*({x})**2 - 0.07*({y})**2 + 0.02*({x})*({y})"
    plain = graph_surface(z.format(x="x", y="y"), (-4, 4), (-4, 4))
    x = "(u/1000 + 0.5*v)"
    odd = FormulaSurface(x, "v", z.format(x=x, y="v"), Domain((-9000, 9000), (-4, 4)))
    limits = FINE._replace(length=2.0)
    one = traced(plain, 0, [[0.3, 0.4]], limits)
    two = traced(odd, 0, [[100.0, 0.4]], limits)
    arcs = np.linspace(0.5, 3.5, 20)
    zero = np.zeros(20, dtype=np.int64)
    places = [
        surface.jet(lines.at(*lines.locate(zero, arcs))).point
        for surface, lines in ((plain, one), (odd, two))
    ]
    centre = [lines.total[0] / 2 for lines in (one, two)]
    assert centre[0] == pytest.approx(centre[1], abs=0.2)
    first = places[0]
    # A line has two directions: compare places, not arc lengths.
    uv, _ = along(two, 40)
    curve = odd.jet(uv).point
    assert max(norm(curve - p).min() for p in first[8:12]) < 0.02


def test_principal_curvature_direction_is_the_tangent_at_every_joint():
    surface = FormulaSurface(
        "u", "v", "0.2*v**2 - 0.1*cos(u) + 0.05*v*sin(u)", Domain((0, 6), (-2, 2))
    )
    lines = traced(surface, 1, seeds_on(surface.domain, 8))
    segment = np.arange(len(lines.arc))
    uv = surface.domain.reduce(lines.at(segment, np.full(len(segment), 0.37)))
    slope = lines.slope(segment, np.full(len(segment), 0.37))
    jet = surface.jet(uv)
    tangent = jet.du * slope[:, :1] + jet.dv * slope[:, 1:]
    speed = norm(tangent) / lines.length
    # Derivative of a fourth-order extension: one order less than the extension itself.
    assert np.abs(speed - 1.0).max() < 1e-7
    direction = shape_data(jet).directions
    sine = np.abs((tangent * direction[:, 0]).sum(axis=1)) / norm(tangent)
    cosine = np.abs((tangent * direction[:, 1]).sum(axis=1)) / norm(tangent)
    assert np.minimum(sine, cosine).max() < 1e-7


def test_open_lines_end_exactly_on_the_bounds():
    surface = graph_surface("0.1*x**2 - 0.08*y**2 + 0.05*x*y + 0.01*x**3", (-2, 2), (-1.5, 1.5))
    lines = traced(surface, 0, seeds_on(surface.domain, 15))
    assert (lines.ends == End.BOUNDARY).all()
    low, high = surface.domain.low, surface.domain.high
    for line in range(len(lines)):
        for uv in lines.joints(line)[[0, -1]]:
            assert np.abs(np.concatenate([uv - low, uv - high])).min() < 1e-9
            assert surface.domain.inside(uv, 1e-9)


def test_line_along_a_bound_is_followed_to_its_ends():
    surface = graph_surface("0.1*x**2 - 0.08*y**2", (-2, 2), (-1.5, 1.5))
    # y = 0 is a line of curvature and here a bound.
    half = graph_surface("0.1*x**2 - 0.08*y**2", (-2, 2), (0, 1.5))
    for here in (surface, half):
        for family in (0, 1):
            lines = traced(here, family, [[0.1, 0.0]])
            uv, _ = along(lines)
            spans = np.ptp(uv, axis=0)
            assert spans.max() > 1.4


def test_seed_in_a_corner_that_leaves_at_once_gives_an_empty_line():
    surface = graph_surface("0.1*x**2 - 0.08*y**2 + 0.05*x*y", (-2, 2), (-1.5, 1.5))
    lines = traced(surface, 0, [[2.0, -1.5], [-2.0, 1.5], [2.0, 1.5], [-2.0, -1.5]])
    assert len(lines) == 4
    assert (lines.total >= 0).all()
    assert (lines.ends == End.BOUNDARY).all()


def test_lines_into_an_umbilic_stop_next_to_it():
    surface = ellipsoid(*AXES)
    gap = 1e-3
    # The section y = 0 runs through the umbilics at z = c sqrt(1 - m).
    latitude = math.asin(math.sqrt(1 - (9 - 4) / (9 - 1.44)))
    found = 0
    for family, v in ((0, 0.2), (1, 0.2), (0, 0.9), (1, 0.9)):
        lines = traced(surface, family, [[0.0, v]], gap=gap)
        for side in np.flatnonzero(lines.ends[0] == End.UMBILIC):
            uv = lines.joints(0)[[0, -1]][side]
            k = shape_data(surface.jet(surface.domain.reduce(uv[None]))).k[0]
            assert 0.999 * gap < k[0] - k[1] < 1.01 * gap
            assert abs(abs(uv[1]) - latitude) < 0.02
            found += 1
    # From below to both umbilics of this side, from above to one and over the bound.
    assert found == 3


def test_lines_cross_a_parallel_of_umbilics():
    # k1 = k2 where the profile is a circle around the axis to third order: at v = 0.
    surface = revolution("3*cos(v) + 0.3*v**3", "3*sin(v)", v=(-0.8, 0.8))
    for v in (-0.5, 0.4):
        ends = [traced(surface, family, [[1.0, v]]) for family in (0, 1)]
        meridian = next(lines for lines in ends if not lines.closed[0])
        assert (meridian.ends == End.BOUNDARY).all()
        assert np.ptp(meridian.joints(0)[:, 1]) == pytest.approx(1.6, abs=1e-9)


def test_seed_on_an_umbilic_gives_an_empty_line():
    surface = graph_surface("x**2 + y**2 + x**3", (-0.5, 0.5), (-0.5, 0.5))
    lines = traced(surface, 0, [[0.0, 0.0]])
    assert lines.total[0] == 0.0
    assert (lines.ends == End.UMBILIC).all()


@pytest.mark.parametrize(
    ("surface", "seed", "length"),
    [
        (torus(), [0.3, 0.7], [2 * math.pi, 2 * math.pi * (3 + math.cos(0.7))]),
        (torus(), [6.2, 6.2], [2 * math.pi, 2 * math.pi * (3 + math.cos(6.2))]),
        (revolution("2 + cos(v)", "2*v"), [0.0, 1.0], [None, 2 * math.pi * (2 + math.cos(1.0))]),
    ],
)
def test_lines_around_a_surface_of_revolution_close(surface, seed, length):
    for family in (0, 1):
        lines = traced(surface, family, [seed])
        if lines.closed[0]:
            errors = [abs(lines.total[0] - exact) for exact in length if exact]
            assert min(errors) < 1e-9
            step = np.diff(lines.joints(0)[[0, -1]], axis=0) / (2 * math.pi)
            assert np.abs(step - np.round(step)).max() < 1e-9
        else:
            assert (lines.ends == End.BOUNDARY).all()


def test_lines_around_the_umbilics_of_an_ellipsoid_close():
    surface = ellipsoid(*AXES)
    lines = traced(surface, 1, [[0.0, 0.0], [0.3, 0.1], [0.1, -0.15]])
    closed = np.flatnonzero(lines.closed)
    assert len(closed)
    for line in closed:
        ends = surface.domain.reduce(lines.joints(line)[[0, -1]])
        first, last = surface.jet(ends).point
        assert np.linalg.norm(last - first) < 1e-8
    # The equator z = 0 is a line of curvature: an ellipse of known length.
    t = np.linspace(0, 2 * math.pi, 400, endpoint=False)
    ellipse = np.hypot(3 * np.sin(t), 2 * np.cos(t)).mean() * 2 * math.pi
    whole = [traced(surface, family, [[0.4, 0.0]]) for family in (0, 1)]
    assert min(abs(lines.total[0] - ellipse) for lines in whole) < 1e-9


def test_spiral_is_recognised_and_ends_after_one_turn():
    r = "(1 + 0.1*cos(2*u + v))"
    surface = FormulaSurface(
        f"(3 + cos(v)*{r})*cos(u)",
        f"(3 + cos(v)*{r})*sin(u)",
        f"{r}*sin(v)",
        Domain((0, 2 * math.pi), (0, 2 * math.pi), (True, True)),
    )
    for family in (0, 1):
        lines = traced(surface, family, [[0.3, 0.4], [2.0, 1.0]], FINE._replace(turn=0.5))
        # The tube is about 2 pi around, the ring up to 8 pi; without recognition lines are 80 long.
        assert (lines.ends == End.SPIRAL).all()
        assert (lines.total < 8.0).all() or ((lines.total > 12.0) & (lines.total < 26.0)).all()


def test_too_long_line_ends_as_such():
    lines = traced(torus(), 1, [[0.3, 0.7]], FINE._replace(length=1.0))
    assert (lines.ends == End.TOO_LONG).all()
    assert lines.total[0] < 2.3


def test_line_far_outside_the_region_is_given_up():
    surface = graph_surface("0.1*x**2 - 0.08*y**2", (-5, 5), (-5, 5))
    limits = FINE._replace(inside=lambda uv: np.abs(uv[:, 0]) < 1.0, outside=1.5)
    lines = traced(surface, 0, [[0.0, 0.3]], limits)
    ends = np.abs(lines.joints(0)[[0, -1], 0])
    assert (lines.ends == End.OUTSIDE).all()
    # The curve is a little longer than its plan; steps are at most 0.1.
    assert (ends > 2.2).all()
    assert (ends < 2.75).all()


def test_scaled_and_turned_surface_has_scaled_lines():
    surface = graph_surface("0.1*x**2 - 0.08*y**2 + 0.05*x*y", (-2, 2), (-2, 2))
    big = MovedSurface(surface, np.eye(3)[[2, 0, 1]], np.array([5.0, -3.0, 2.0]), 1000.0)
    limits = Limits(FINE.step * 1e3, FINE.length * 1e3, FINE.tolerance * 1e3, FINE.turn * 1e3)
    one = traced(surface, 0, [[0.3, 0.4]])
    two = traced(big, 0, [[0.3, 0.4]], limits, gap=1e-6)
    assert two.total[0] == pytest.approx(1e3 * one.total[0], rel=1e-9)


def test_crossings_lie_on_both_lines():
    surface = ellipsoid(*AXES, lines="geographic", u=(0.4, 2.7), v=(-0.4, 0.4))
    grid = surface.domain.grid(4, 4).reshape(-1, 2)
    a, b = (traced(surface, family, grid) for family in (0, 1))
    found = crossings(surface, a, b)
    for family, lines in ((0, a), (1, b)):
        at = lines.at(*lines.locate(found.lines[:, family], found.arcs[:, family]))
        assert np.abs(surface.domain.reduce(at) - found.uv).max() < 1e-10
    values = confocal(surface.jet(found.uv).point)
    own = [confocal(surface.jet(surface.domain.reduce(x.coefficients[x.start[:-1], 0])).point)
           for x in (a, b)]  # fmt: skip
    # Oracle: mu of the crossing is that of its first line, nu that of its second one.
    assert np.abs(values[:, 0] - own[0][found.lines[:, 0], 0]).max() < 1e-8
    assert np.abs(values[:, 1] - own[1][found.lines[:, 1], 1]).max() < 1e-8


def test_every_meridian_crosses_every_parallel_once():
    surface = torus()
    turn = 2 * math.pi
    around = np.stack([np.full(5, 0.1), np.linspace(0, turn, 5, endpoint=False)], axis=1)
    across = np.stack([np.linspace(0, turn, 7, endpoint=False), np.full(7, 0.2)], axis=1)
    families = {0: None, 1: None}
    for family in (0, 1):
        lines = traced(surface, family, around[:1])
        families[family] = abs(lines.total[0] - turn) < 1e-6
    tube = 0 if families[0] else 1
    parallels, meridians = traced(surface, 1 - tube, around), traced(surface, tube, across)
    pair = (meridians, parallels) if tube == 0 else (parallels, meridians)
    found = crossings(surface, *pair)
    assert len(found) == 35
    assert len(np.unique(found.lines, axis=0)) == 35
    assert len(np.unique(found.side)) == 1


def test_lines_can_be_joined_and_selected():
    surface = graph_surface("0.1*x**2 - 0.08*y**2", (-2, 2), (-2, 2))
    lines = traced(surface, 0, seeds_on(surface.domain, 4))
    order = np.array([2, 0])
    part = selected(lines, order)
    assert part.total == pytest.approx(lines.total[order])
    both = joined([part, selected(lines, np.array([], dtype=np.int64)), lines])
    assert both.total == pytest.approx(np.concatenate([part.total, lines.total]))
    assert np.allclose(both.joints(0), lines.joints(2))


def test_extension_restricted_and_reversed_is_the_same_curve():
    rng = np.random.default_rng(3)
    dense = rng.normal(size=(3, 5, 2))

    def value(r, t):
        return r[:, 0] + t * (r[:, 1] + (1 - t) * (r[:, 2] + t * (r[:, 3] + (1 - t) * r[:, 4])))

    theta = np.array([0.3, 0.7, 1.0])
    for t in (0.0, 0.4, 1.0):
        shorter = value(restricted(dense, theta), t)
        exact = np.array([value(dense[i : i + 1], t * theta[i])[0] for i in range(3)])
        assert shorter == pytest.approx(exact, abs=1e-12)
        assert value(reversed_extension(dense), t) == pytest.approx(value(dense, 1 - t), abs=1e-12)
