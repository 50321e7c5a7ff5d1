import math

import mpmath
import numpy as np
import pytest

from pqmesh.errors import SpecError, SurfaceError
from pqmesh.surface.analytic import (
    SHAPES,
    conjugate_cubic,
    cyclide,
    ellipsoid,
    monge,
    moved,
    revolution,
    shape_surface,
    torus,
)
from pqmesh.surface.curvature import gaussian_curvature, shape_data
from pqmesh.vectors import cross, dot, norm


def samples(surface, n=40, seed=0):
    rng = np.random.default_rng(seed)
    return surface.domain.low + surface.domain.size * rng.uniform(0.05, 0.95, size=(n, 2))


def mixed_curvature(jet):
    """II(X_u, X_v) and I(X_u, X_v), both zero on lines of curvature."""
    normal = shape_data(jet).normal
    return np.abs(dot(jet.duv, normal)).max(), np.abs(dot(jet.du, jet.dv)).max()


@pytest.mark.parametrize("kind", SHAPES)
def test_jet_agrees_with_central_differences(kind):
    surface = shape_surface(kind)
    uv, h = samples(surface), 1e-5
    jet = surface.jet(uv)
    for axis in (0, 1):
        step = h * np.eye(2)[axis]
        high, low = surface.jet(uv + step), surface.jet(uv - step)
        for lower, upper in ((0, 1 + axis), (1, 3 + axis), (2, 4 + axis)):
            difference = (high[lower] - low[lower]) / (2 * h)
            # Truncation h^2 times a third derivative of some tens.
            assert np.abs(difference - jet[upper]).max() < 2e-8


def mp_torus(u, v):
    m = mpmath
    return [(3 + m.cos(v)) * m.cos(u), (3 + m.cos(v)) * m.sin(u), m.sin(v)]


def mp_cyclide(u, v):
    m = mpmath
    a, c, d = 3, 1, m.mpf("1.7")
    b, q = m.sqrt(8), 3 - m.cos(u) * m.cos(v)
    x = (d * (c - a * m.cos(u) * m.cos(v)) + b * b * m.cos(u)) / q
    return [x, b * m.sin(u) * (a - d * m.cos(v)) / q, b * m.sin(v) * (c * m.cos(u) - d) / q]


def mp_monge(u, v):
    m = mpmath
    speed = m.sqrt(16 * m.sin(u) ** 2 + 9 * m.cos(u) ** 2)
    n = (-3 * m.cos(u) / speed, -4 * m.sin(u) / speed)
    return [4 * m.cos(u) + v * n[0], 3 * m.sin(u) + v * n[1], v * v / 2]


@pytest.mark.parametrize(
    ("kind", "formula"), [("torus", mp_torus), ("cyclide", mp_cyclide), ("monge", mp_monge)]
)
def test_jet_agrees_with_mpmath(kind, formula):
    u, v = 0.4, 0.7
    jet = shape_surface(kind).jet(np.array([[u, v]]))
    with mpmath.workdps(40):
        for row, order in zip(jet[1:], ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2)), strict=True):
            for i in range(3):
                exact = mpmath.diff(
                    lambda s, t, i=i: formula(s, t)[i], (mpmath.mpf(u), mpmath.mpf(v)), order
                )
                assert float(row[0, i]) == pytest.approx(float(exact), abs=2e-14)


def test_sphere_cylinder_and_cone_have_their_curvatures():
    for kind, wanted in (
        ("sphere", lambda uv: (-0.5, -0.5)),
        ("cylinder", lambda uv: (0.0, -0.5)),
    ):
        surface = shape_surface(kind, radius=2)
        k = shape_data(surface.jet(samples(surface))).k
        assert np.abs(k - wanted(None)).max() < 1e-14
    surface = shape_surface("cone", half_angle=0.4)
    uv = samples(surface)
    k = shape_data(surface.jet(uv)).k
    wanted = np.stack([0 * uv[:, 1], -1 / (np.tan(0.4) * uv[:, 1])], axis=-1)
    assert np.abs(k - wanted).max() < 1e-13


def test_torus_has_its_curvatures_and_lines():
    surface = torus(R=4.0, r=1.5)
    uv = samples(surface)
    jet = surface.jet(uv)
    wanted = np.stack(
        [-np.cos(uv[:, 1]) / (4 + 1.5 * np.cos(uv[:, 1])), np.full(40, -1 / 1.5)], axis=-1
    )
    assert np.abs(shape_data(jet).k - wanted).max() < 1e-14
    assert max(mixed_curvature(jet)) < 1e-13


def test_cyclide_agrees_with_published_point_and_equation():
    # Oracle 16.
    a, c, d = 3.0, 1.0, 1.7
    surface = cyclide(a, c, d)
    uv = np.vstack([[0.3, 0.5], samples(surface)])
    jet = surface.jet(uv)
    assert np.abs(jet.point[0] - [2.344045486, 0.583159128, -0.467141248]).max() < 1e-9
    u, v = uv.T
    b = math.sqrt(a * a - c * c)
    x, y, _ = jet.point.T
    left = (dot(jet.point, jet.point) + b * b - d * d) ** 2
    assert np.abs(left - 4 * (a * x - c * d) ** 2 - 4 * b * b * y * y).max() < 1e-11
    curvature = np.stack([-np.cos(v) / (d * np.cos(v) - a), -1 / (d - c * np.cos(u))], axis=-1)
    assert np.abs(curvature[0] - [0.581908991, -1.342888413]).max() < 1e-9
    data = shape_data(jet)
    centre = np.stack([a * np.cos(u), b * np.sin(u), 0 * u], axis=-1)
    normal = (jet.point - centre) / (d - c * np.cos(u))[:, None]
    side = np.sign(dot(normal, data.normal))
    assert np.abs(np.abs(dot(normal, data.normal)) - 1).max() < 1e-14
    assert (
        np.abs(np.sort(data.k, axis=1) - np.sort(curvature * side[:, None], axis=1)).max() < 1e-12
    )
    assert max(mixed_curvature(jet)) < 1e-13


def test_ellipsoid_by_lines_of_curvature_agrees_with_oracle():
    # Oracle 50.
    a, b, c = 3.0, 2.0, 1.2
    surface = ellipsoid(a, b, c, lines="curvature")
    uv = np.vstack([[0.7, 0.9], samples(surface)])
    jet = surface.jet(uv)
    assert np.abs(jet.point[0] - [1.728834449, 1.198242934, 0.667006766]).max() < 1e-9
    s, t = uv.T
    mu = (c * np.cos(s)) ** 2 + (b * np.sin(s)) ** 2
    nu = (b * np.cos(t)) ** 2 + (a * np.sin(t)) ** 2
    axes = np.array([a, b, c])
    assert np.abs(mu + nu - (axes**2).sum() + dot(jet.point, jet.point)).max() < 1e-13
    weighted = (jet.point / axes**2) ** 2
    assert np.abs(mu * nu - (a * b * c) ** 2 * weighted.sum(axis=1)).max() < 1e-12
    wanted = a * b * c / np.sqrt(mu * nu)[:, None] / np.stack([mu, nu], axis=-1)
    assert np.abs(wanted[0] - [0.684129030, 0.242217316]).max() < 1e-9
    k = np.sort(np.abs(shape_data(jet).k), axis=1)[:, ::-1]
    assert np.abs(k - wanted).max() < 1e-13
    assert max(mixed_curvature(jet)) < 1e-13


def test_both_ellipsoids_are_the_same_surface():
    for lines in ("geographic", "curvature"):
        surface = ellipsoid(lines=lines)
        points = surface.jet(samples(surface)).point / [3.0, 2.0, 1.2]
        assert np.abs(dot(points, points) - 1).max() < 1e-14


def test_quads_of_curvature_lines_of_the_ellipsoid_have_equal_diagonals():
    # Oracle 52 (Ivory).
    surface = ellipsoid(lines="curvature")
    (s, t), (p, q) = samples(surface).T, samples(surface, seed=1).T
    corners = [surface.jet(np.stack(pair, -1)).point for pair in ((s, t), (p, q), (s, q), (p, t))]
    assert np.abs(norm(corners[0] - corners[1]) - norm(corners[2] - corners[3])).max() < 1e-14


def test_minimal_surfaces_have_their_curvatures():
    # Oracle 54.
    for kind, size in (
        ("enneper", lambda u, v: 2 / (1 + u**2 + v**2) ** 2),
        ("catenoid", lambda u, v: 1 / np.cosh(v) ** 2),
        ("helicoid", lambda u, v: 1 / np.cosh(v) ** 2),
    ):
        surface = shape_surface(kind)
        uv = samples(surface)
        k = shape_data(surface.jet(uv)).k
        assert np.abs(k - size(*uv.T)[:, None] * [1, -1]).max() < 1e-14


def test_lines_of_curvature_of_minimal_surfaces_are_where_known():
    for kind in ("enneper", "catenoid"):
        surface = shape_surface(kind)
        assert max(mixed_curvature(surface.jet(samples(surface)))) < 1e-14
    helicoid = shape_surface("helicoid")
    steps = shape_data(helicoid.jet(samples(helicoid))).directions_uv
    assert np.abs(np.abs(steps[..., 0]) - np.abs(steps[..., 1])).max() < 1e-14


def test_conjugate_cubic_satisfies_its_equation_and_its_curvature():
    # Oracle 6.
    rng = np.random.default_rng(4)
    a10, a01, a20 = rng.normal(size=(3, 3))
    c1, c2 = 0.8, -1.3
    surface = conjugate_cubic(c1, c2, rng.normal(size=3), a10, a01, a20, u=(-1, 1), v=(-1, 1))
    jet = surface.jet(samples(surface))
    assert np.abs(jet.duv - c1 * jet.du - c2 * jet.dv).max() < 1e-13
    area = norm(cross(jet.du, jet.dv))
    wanted = -4 * (c1 / c2) ** 2 * np.linalg.det([a10, a01, a20]) ** 2 / area**4
    assert np.abs(gaussian_curvature(jet) / wanted - 1).max() < 1e-11


@pytest.mark.parametrize(("h", "k"), [(0.2, 0.3), (0.26, 0.1)])
def test_cells_of_the_conjugate_cubic_have_one_volume(h, k):
    # Oracle 6.
    rng = np.random.default_rng(5)
    a10, a01, a20 = rng.normal(size=(3, 3))
    c1, c2 = 0.8, -1.3
    surface = conjugate_cubic(c1, c2, np.zeros(3), a10, a01, a20)
    uv = samples(surface)
    shifts = np.array([(0, 0), (h, 0), (h, k), (0, k)])
    a, b, c, d = (surface.jet(uv + shift).point for shift in shifts)
    volume = dot(cross(b - a, c - a), d - a)
    wanted = -c1 / (6 * c2) * h**2 * k**2 * (c1**2 * k**2 - c2**2 * h**2)
    assert abs(wanted) > 1e-6
    assert np.abs(volume - wanted * np.linalg.det([a10, a01, a20])).max() < 1e-14


def test_cells_of_the_conjugate_cubic_are_planar_at_the_right_ratio():
    c1, c2 = 0.8, -1.3
    h, k = c1 / 5, abs(c2) / 5
    surface = conjugate_cubic(c1, c2)
    uv = samples(surface)
    shifts = np.array([(0, 0), (h, 0), (h, k), (0, k)])
    a, b, c, d = (surface.jet(uv + shift).point for shift in shifts)
    assert np.abs(dot(cross(b - a, c - a), d - a)).max() < 1e-15


def test_conjugate_cubic_agrees_with_the_example_of_the_appendix():
    surface = conjugate_cubic()
    jet = surface.jet(np.array([[0.3, -0.7]]))
    assert np.abs(jet.point[0] - [-17 / 30, -47 / 30, -11 / 15]).max() < 1e-15
    uv = samples(surface)
    u, v = uv.T
    cubic = (v - u)[:, None] ** 3 / 6 * [1, 1, 2]
    low = np.stack([u + u * v - v * v, v + u * v - v * v, u * u - v * v], axis=-1)
    assert np.abs(surface.jet(uv).point - low - cubic).max() < 1e-15


def test_revolution_and_monge_lines_are_lines_of_curvature():
    for surface in (
        revolution("a + sin(v)", "v", constants={"a": 2}),
        monge("u", "sin(u)", "0.3*v", "cos(v)"),
    ):
        assert max(mixed_curvature(surface.jet(samples(surface)))) < 1e-13


def test_revolution_of_a_circle_is_the_torus_and_closes():
    swept = revolution("3 + cos(v)", "sin(v)", v=(0.0, 2 * math.pi))
    assert swept.domain.periodic == (True, True)
    uv = samples(swept)
    for a, b in zip(swept.jet(uv), torus().jet(uv), strict=True):
        assert np.abs(a - b).max() < 1e-14


def test_monge_along_a_line_is_a_cylinder_and_along_a_circle_a_surface_of_revolution():
    along = monge("u", "0", "v", "v**2").jet(np.array([[2.0, 0.5]]))
    assert along.point[0].tolist() == [2.0, 0.5, 0.25]
    ring = monge("2*cos(u)", "2*sin(u)", "-v", "v**2", u=(0, 2 * math.pi), v=(0.5, 1))
    assert ring.domain.periodic == (True, False)
    turned = revolution("2 + v", "v**2", v=(0.5, 1))
    uv = samples(ring)
    for a, b in zip(ring.jet(uv), turned.jet(uv), strict=True):
        assert np.abs(a - b).max() < 1e-14


def test_moved_surface_keeps_curvature_and_moves_points():
    rotation = np.linalg.qr(np.random.default_rng(6).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    surface = torus()
    after = moved(surface, rotation, (1, 2, 3), scale=2.0)
    uv = samples(surface)
    jet, image = surface.jet(uv), after.jet(uv)
    assert np.abs(image.point - 2 * jet.point @ rotation.T - [1, 2, 3]).max() < 1e-14
    assert np.abs(image.duv - 2 * jet.duv @ rotation.T).max() < 1e-14
    assert np.abs(2 * shape_data(image).k - shape_data(jet).k).max() < 1e-14
    assert after.domain is surface.domain


def test_only_a_full_turn_is_periodic():
    assert torus().domain.periodic == (True, True)
    assert torus(u=(0, 3)).domain.periodic == (False, True)
    assert torus(u=(1.0, 1.0 + 2 * math.pi)).domain.periodic == (True, True)
    assert shape_surface("sphere", u=[0, 1]).domain.periodic == (False, False)


@pytest.mark.parametrize(
    ("kind", "parameters", "message"),
    [
        ("torsu", {}, "did you mean 'torus'"),
        ("", {}, "Known are sphere"),
        ("torus", {"radius": 1}, "has no parameter 'radius'"),
        ("cyclide", {"dd": 1}, "did you mean 'd'"),
        ("torus", {"R": 1, "r": 2}, "0 < r < R"),
        ("torus", {"R": "1"}, "R a finite number"),
        ("torus", {"R": math.nan}, "R a finite number"),
        ("torus", {"R": True}, "R a finite number"),
        ("torus", {"u": (1, 0)}, "u must be a range"),
        ("torus", {"v": 3}, "v must be a range"),
        ("torus", {"v": ("a", "b")}, "v must be a range"),
        ("torus", {"v": (0, math.inf)}, "v must be a range"),
        ("sphere", {"radius": -1.0}, "radius > 0"),
        ("cylinder", {"radius": 0.0}, "radius > 0"),
        ("catenoid", {"radius": 0.0}, "radius > 0"),
        ("helicoid", {"pitch": 0.0}, "pitch other than 0"),
        ("cone", {"half_angle": 2.0}, "half_angle < pi/2"),
        ("cyclide", {"d": 0.5}, "ring without pinch points"),
        ("ellipsoid", {"a": 0.0}, "a, b, c > 0"),
        ("ellipsoid", {"lines": "uv"}, "geographic or curvature"),
        ("ellipsoid", {"lines": "curvature", "a": 1.0}, "a > b > c"),
        ("conjugate-cubic", {"c1": 0.0}, "other than 0"),
        ("conjugate-cubic", {"a20": (1, 1, 0)}, "linearly independent"),
        ("conjugate-cubic", {"a20": (1, 1)}, "three finite coordinates"),
        ("conjugate-cubic", {"a20": "abc"}, "three finite coordinates"),
        ("revolution", {"r": 2.0}, "r as text"),
        ("revolution", {"r": "u"}, "formula for r has the unknown name 'u'"),
        ("revolution", {"r": "q", "constants": {"Q": 1.0}}, "did you mean|unknown name 'q'"),
        ("revolution", {"constants": [1]}, "constants a table"),
        ("monge", {"x": "1", "y": "2"}, "stand still"),
        ("monge", {"p": "u"}, "formula for p has the unknown name 'u'"),
    ],
)
def test_shapes_refuse_wrong_parameters(kind, parameters, message):
    with pytest.raises(SpecError, match=message):
        shape_surface(kind, **parameters)


def test_profile_that_is_not_finite_is_named():
    with pytest.raises(SurfaceError, match="at u = 0, v = 0"):
        revolution("log(v)", "v", v=(0, 1))


def test_moved_refuses_what_is_no_similarity():
    with pytest.raises(SpecError, match="orthogonal"):
        moved(torus(), 2 * np.eye(3))
    with pytest.raises(SpecError, match="scale > 0"):
        moved(torus(), scale=0.0)
    with pytest.raises(SpecError, match="three finite"):
        moved(torus(), translation=(0, 1))
