import math
import pickle
import time

import numpy as np
import pytest
from geomdl import NURBS, BSpline

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Surface
from pqmesh.surface.bspline import BSplineSurface, uniform_knots
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.regular import check_regular, closes

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


def random_net(n, m, seed=0):
    rng = np.random.default_rng(seed)
    points = 0.2 * rng.normal(size=(n, m, 3))
    points[..., 0] += np.arange(n)[:, None]
    points[..., 1] += np.arange(m)
    return points, rng.uniform(0.5, 2.0, size=(n, m)), rng


def quarter_circle():
    """Control points and weights of a quarter of the unit circle [piegl1997, 7.3]."""
    return np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), np.array([1.0, math.sqrt(0.5), 1.0])


@pytest.mark.parametrize(
    ("degrees", "size", "rational"),
    [((3, 3), (8, 9), False), ((2, 4), (6, 7), True), ((5, 3), (9, 8), True), ((1, 2), (2, 5), 0)],
)
def test_jet_agrees_with_geomdl(degrees, size, rational):
    points, weights, rng = random_net(*size)
    knots = [uniform_knots(size[i], degrees[i]) for i in (0, 1)]
    for i in (0, 1):
        inner = knots[i][degrees[i] + 1 : size[i]]
        inner += 0.3 / size[i] * rng.uniform(-1, 1, size=inner.shape)
    surface = BSplineSurface(points, degrees, tuple(knots), weights if rational else None)
    other = NURBS.Surface() if rational else BSpline.Surface()
    other.degree_u, other.degree_v = degrees
    rows = np.dstack([points * weights[..., None], weights]) if rational else points
    other.set_ctrlpts(rows.reshape(-1, rows.shape[2]).tolist(), *size)
    other.knotvector_u, other.knotvector_v = knots[0].tolist(), knots[1].tolist()
    uv = np.vstack([rng.uniform(size=(30, 2)), [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    jet = surface.jet(uv)
    for k, (u, v) in enumerate(uv):
        wanted = other.derivatives(u, v, 2)
        for row, (a, b) in zip(jet, ORDERS, strict=True):
            if (a, degrees[0]) != (2, 1):
                scale = max(1.0, np.abs(wanted[a][b]).max())
                assert np.abs(row[k] - wanted[a][b]).max() < 1e-10 * scale


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize("periodic", [(False, False), (True, False), (True, True)])
def test_jet_agrees_with_central_differences(rational, periodic):
    points, weights, rng = random_net(7, 8, seed=2)
    surface = BSplineSurface(points, (3, 4), None, weights if rational else None, periodic)
    assert isinstance(surface, Surface)
    # Away from knots, where third derivatives jump.
    columns = []
    for line in surface.knots:
        ends = np.unique(np.clip(line, 0, 1))
        place = rng.integers(0, len(ends) - 1, size=30)
        columns.append(ends[place] + rng.uniform(0.1, 0.9, size=30) * np.diff(ends)[place])
    uv = np.stack(columns, axis=-1)
    jet, h = surface.jet(uv), 1e-5
    for axis in (0, 1):
        step = h * np.eye(2)[axis]
        high, low = surface.jet(uv + step), surface.jet(uv - step)
        for lower, upper in ((0, 1 + axis), (1, 3 + axis), (2, 4 + axis)):
            difference = (high[lower] - low[lower]) / (2 * h)
            # h^2 times third derivatives of up to 1e4.
            assert np.abs(difference - jet[upper]).max() < 1e-5


def test_jet_of_a_polynomial_is_exact():
    # Degree elevation of z = x y: control heights are products of Greville abscissae.
    knots = uniform_knots(7, 3)
    greville = np.array([knots[i + 1 : i + 4].mean() for i in range(7)])
    x, y = np.meshgrid(greville, greville, indexing="ij")
    surface = BSplineSurface(np.stack([x, y, x * y], axis=-1), (3, 3))
    uv = np.random.default_rng(3).uniform(-0.1, 1.1, size=(50, 2))
    jet = surface.jet(uv)
    assert np.abs(jet.point[:, 2] - uv[:, 0] * uv[:, 1]).max() < 1e-15
    assert np.abs(jet.duv - [0, 0, 1]).max() < 1e-13
    assert np.abs(jet.duu).max() < 1e-12


def test_nurbs_cylinder_has_its_curvature():
    arc, weights = quarter_circle()
    points = np.stack([np.column_stack([2 * arc, [z] * 3]) for z in (0.0, 1.0, 3.0)], axis=1)
    surface = BSplineSurface(points, (2, 2), None, np.repeat(weights[:, None], 3, axis=1))
    uv = np.random.default_rng(4).uniform(size=(100, 2))
    k = shape_data(surface.jet(uv)).k
    assert np.abs(np.abs(k) - [0.0, 0.5]).max() < 1e-13


def test_nurbs_octant_lies_on_the_sphere_and_has_its_curvature():
    arc, weights = quarter_circle()
    x, y, z = arc[:, None, 0] * arc[:, 0], arc[:, None, 1] * arc[:, 0], 0 * arc[:, :1] + arc[:, 1]
    mass = weights[:, None] * weights
    surface = BSplineSurface(np.stack([x, y, z], axis=-1), (2, 2), None, mass)
    # The pole v = 1 is singular.
    uv = np.random.default_rng(5).uniform(0, 0.95, size=(100, 2))
    jet = surface.jet(uv)
    assert np.abs(np.linalg.norm(jet.point, axis=1) - 1).max() < 1e-15
    assert np.abs(np.abs(shape_data(jet).k) - 1).max() < 1e-12
    with pytest.raises(SurfaceError, match="pole"):
        check_regular(surface)


def test_equal_weights_change_nothing():
    points, _, rng = random_net(6, 6)
    uv = rng.uniform(size=(40, 2))
    plain = BSplineSurface(points, (3, 3)).jet(uv)
    heavy = BSplineSurface(points, (3, 3), weights=np.full((6, 6), 7.0)).jet(uv)
    assert max(np.abs(a - b).max() for a, b in zip(plain, heavy, strict=True)) < 1e-12


def test_corners_are_control_points():
    points, weights, _ = random_net(5, 6)
    surface = BSplineSurface(points, (3, 2), weights=weights)
    corners = surface.jet(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])).point
    wanted = points[[0, -1, 0, -1], [0, 0, -1, -1]]
    assert np.abs(corners - wanted).max() < 1e-15


def test_periodic_surface_closes_and_has_equal_spans():
    angle = 2 * math.pi * np.arange(8) / 8
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    points = np.stack([ring + np.array([0, 0, z]) for z in range(4)], axis=1)
    surface = BSplineSurface(points, (3, 3), periodic=(True, False))
    assert closes(surface) == (True, False)
    check_regular(surface)
    # A turn by one control point is a shift by one span.
    uv = np.random.default_rng(6).uniform(0, 0.8, size=(20, 2))
    a, b = surface.jet(uv).point, surface.jet(uv + np.array([1 / 8, 0])).point
    turn = np.exp(2j * math.pi / 8) * (a[:, 0] + 1j * a[:, 1])
    assert np.abs(turn - b[:, 0] - 1j * b[:, 1]).max() < 1e-14


def test_parameters_outside_continue_the_end_polynomial():
    points, weights, rng = random_net(6, 7)
    surface = BSplineSurface(points, (3, 3), weights=weights)
    wide = surface.extended(u_low=0.1, v_high=0.2)
    assert wide.domain.u == (-0.1, 1.0)
    assert wide.domain.v == (0.0, 1.2)
    assert surface.domain.u == (0.0, 1.0)
    base = surface.jet(np.array([[0.0, 0.5]]))
    for h in (1e-2, 1e-3):
        outside = wide.jet(np.array([[-h, 0.5]])).point
        taylor = base.point - h * base.du + h * h / 2 * base.duu
        assert np.abs(outside - taylor).max() < 500 * h**3
    uv = rng.uniform(0.2, 0.9, size=(10, 2))
    assert (wide.jet(uv).point == surface.jet(uv).point).all()


def test_surface_survives_pickling_and_prints_short():
    points, weights, rng = random_net(5, 5)
    surface = BSplineSurface(points, (3, 3), weights=weights)
    uv = rng.uniform(size=(5, 2))
    again = pickle.loads(pickle.dumps(surface))
    assert (again.jet(uv).dvv == surface.jet(uv).dvv).all()
    assert repr(surface) == "<NURBS surface of 5 x 5 control points, degrees (3, 3)>"
    with pytest.raises(ValueError, match="read-only"):
        surface.points[0, 0, 0] = 1.0


def test_no_points_give_an_empty_jet():
    assert BSplineSurface(random_net(5, 5)[0], (3, 3)).jet(np.empty((0, 2))).duv.shape == (0, 3)


def test_long_arrays_are_fast():
    surface = BSplineSurface(random_net(20, 30)[0], (3, 3))
    uv = np.random.default_rng(7).uniform(size=(100_000, 2))
    start = time.perf_counter()
    surface.jet(uv)
    # 0.1 s on an idle core.
    assert time.perf_counter() - start < 1.0


NET = random_net(5, 5)[0]
SPOILT = NET.copy()
SPOILT[2, 3, 1] = np.nan
U = uniform_knots(5, 3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": NET[0]}, r"shape \(n, m, 3\); found \(5, 3\)"),
        ({"points": [[[1, 2, 3]], [[1, 2]]]}, "rows of different length"),
        ({"points": SPOILT}, r"point \[2, 3\] is \[.*nan"),
        ({"degrees": (0, 3)}, "degree 1 has creases"),
        ({"degrees": (3, 2.5)}, "whole numbers"),
        ({"degrees": (3,)}, "two whole numbers"),
        ({"degrees": (3, 5)}, "Degree 5 in v needs at least 6 control points; found 5"),
        ({"degrees": (1, 3)}, "a crease at every inner knot"),
        ({"weights": np.ones((5, 4))}, r"shape \(5, 5\); found \(5, 4\)"),
        ({"weights": 1 - np.eye(5)}, r"weight \[0, 0\] is 0.0"),
        ({"weights": np.full((5, 5), np.nan)}, "positive and finite"),
        ({"knots": (U[1:-1], U)}, r"in u need 9 knots; found shape \(7,\). Some programs"),
        ({"knots": (U, U[::-1])}, "must not decrease; knot 4 in v"),
        ({"knots": (U, U * np.nan)}, "knot 0 in v is nan"),
        ({"knots": (U, 0 * U)}, "leave a domain"),
        ({"knots": (U, ["a"] * 9)}, "list of numbers"),
        ({"degrees": (3, 2), "knots": (U, [0, 0, 0, 0.5, 0.5, 1, 1, 1])}, "the knot 0.5 stands 2"),
    ],
)
def test_bspline_refuses_wrong_data(arguments, message):
    with pytest.raises(SurfaceError, match=message):
        BSplineSurface(**{"points": NET, "degrees": (3, 3), **arguments})


def test_periodic_direction_cannot_be_extended():
    surface = BSplineSurface(NET, (3, 3), periodic=(True, False))
    surface.extended(v_low=0.1)
    with pytest.raises(SurfaceError, match="a periodic one got a margin"):
        surface.extended(u_low=0.1)
