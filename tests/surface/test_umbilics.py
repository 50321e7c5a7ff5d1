import math

import numpy as np
import pytest

from pqmesh.surface.analytic import SHAPES, ellipsoid, moved, revolution, shape_surface
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.formula import graph_surface
from pqmesh.surface.umbilics import conjugacy_defect, find_umbilics


def normal_form(alpha, beta, curvature, angle=0.0):
    """z = k|w|^2/2 + Re(alpha w^3 + beta w^2 conj(w)) with the axes turned by an angle."""
    c, s = math.cos(angle), math.sin(angle)
    p, q = "(c*x + s*y)", "(c*y - s*x)"
    cubic = f"a*({p}**3 - 3*{p}*{q}**2) + b*{p}*({p}**2 + {q}**2)"
    constants = {"a": alpha, "b": beta, "k": curvature, "c": c, "s": s}
    z = f"k*(x**2 + y**2)/2 + {cubic}"
    return graph_surface(z, (-0.03, 0.031), (-0.028, 0.03), constants)


@pytest.mark.parametrize("angle", [0.0, 1.0])
@pytest.mark.parametrize("curvature", [0.0, 1.0])
@pytest.mark.parametrize(
    ("alpha", "beta", "kind", "index"),
    [
        (1.0, 0.3, "star", -0.5),
        (0.05, 1.0, "lemon", 0.5),
        (0.25, -1.0, "monstar", 0.5),
        (1.0, 0.0, "star", -0.5),
    ],
)
def test_umbilics_of_the_normal_forms_have_their_kind(alpha, beta, kind, index, curvature, angle):
    # Oracle 56; (1, 0) with k = 0 is the monkey saddle.
    report = find_umbilics(normal_form(alpha, beta, curvature, angle))
    assert [(u.kind, u.index) for u in report.umbilics] == [(kind, index)]
    assert np.abs(report.umbilics[0].uv).max() < 1e-12
    assert report.viability < 0.05


def test_turned_over_surface_has_the_same_umbilics():
    surface = normal_form(0.25, -1.0, 1.0)
    over = moved(surface, np.diag([1.0, 1.0, -1.0]))
    (above,), (below,) = find_umbilics(surface).umbilics, find_umbilics(over).umbilics
    assert (above.kind, above.index, above.uv) == (below.kind, below.index, below.uv)


def test_umbilics_of_the_ellipsoid_are_four_lemons():
    # Oracle 50.
    report = find_umbilics(ellipsoid())
    assert [(u.kind, u.index) for u in report.umbilics] == [("lemon", 0.5)] * 4
    points = np.abs([u.point for u in report.umbilics])
    assert np.abs(points - [2.439750182, 0, 0.698297249]).max() < 1e-9
    m = (9 - 4) / (9 - 1.44)
    assert np.abs(points - [3 * math.sqrt(m), 0, 1.2 * math.sqrt(1 - m)]).max() < 1e-12


def test_umbilics_of_the_elliptic_paraboloid_are_where_known():
    # Oracle 55.
    p, q = 3.0, 2.0
    surface = graph_surface("x**2/(2*p) + y**2/(2*q)", (-3, 3), (-3, 3), {"p": p, "q": q})
    report = find_umbilics(surface)
    wanted = [[0, side * math.sqrt(q * (p - q)), (p - q) / 2] for side in (-1, 1)]
    assert np.abs(np.array([u.point for u in report.umbilics]) - wanted).max() < 1e-12
    assert [u.kind for u in report.umbilics] == ["lemon", "lemon"]


@pytest.mark.parametrize(
    ("z", "index"),
    [
        ("x**4 - 6*x**2*y**2 + y**4", -1.0),
        ("x**5 - 10*x**3*y**2 + 5*x*y**4", -1.5),
        ("x**2 + y**2", 1.0),
    ],
)
def test_degenerate_umbilics_are_reported_with_their_index(z, index):
    report = find_umbilics(graph_surface(z, (-0.3, 0.31), (-0.3, 0.3)))
    assert [(u.kind, u.index) for u in report.umbilics] == [("degenerate", index)]
    # A multiple zero is found to a root of the precision of the deviator only.
    assert np.abs(report.umbilics[0].point).max() < 1e-4


@pytest.mark.parametrize("kind", sorted(set(SHAPES) - {"ellipsoid", "sphere"}))
def test_shapes_without_umbilics_have_none(kind):
    report = find_umbilics(shape_surface(kind))
    assert report.umbilics == ()
    assert report.degenerate_fraction == 0.0
    assert report.degenerate_uv is None
    assert report.viability > 0.1


@pytest.mark.parametrize(
    "surface", [shape_surface("sphere"), graph_surface("x + y", (0, 1), (0, 1))]
)
def test_sphere_and_plane_are_degenerate_everywhere(surface):
    report = find_umbilics(surface)
    assert report.umbilics == ()
    assert report.degenerate_fraction == 1.0
    assert report.degenerate_uv is not None
    assert report.viability == 0.0


def test_lines_of_umbilics_are_no_isolated_umbilics():
    report = find_umbilics(revolution("v", "v**2/2 + v**3", v=(0.1, 1.0)))
    assert report.umbilics == ()
    assert report.viability < 0.1


def test_umbilic_on_the_rim_is_named_so():
    surface = graph_surface("x**2/6 + y**2/4", (0, 3), (-3, 3))
    report = find_umbilics(surface)
    assert [(u.kind, u.index) for u in report.umbilics] == [("rim", 0.0)] * 2


def test_index_of_all_umbilics_is_the_winding_along_the_rim():
    # Nine umbilics: four lemons and five stars.
    surface = graph_surface("sin(3*x)*cos(2*y) + x*y/2", (-1, 1), (-1, 1))
    report = find_umbilics(surface)
    assert sorted(u.kind for u in report.umbilics) == ["lemon"] * 4 + ["star"] * 5
    side = np.linspace(-1, 1, 400)
    rim = np.concatenate(
        [np.stack([side, 0 * side - 1], -1), np.stack([0 * side + 1, side], -1)], axis=0
    )
    rim = np.concatenate([rim, -rim])
    deviator = shape_data(surface.jet(rim)).deviator
    angle = np.unwrap(np.arctan2(deviator[:, 1], deviator[:, 0]))
    turns = (angle[-1] - angle[0]) / (2 * math.pi)
    assert sum(u.index for u in report.umbilics) == pytest.approx(turns / 2, abs=1e-2)


def test_report_is_about_the_inside_only():
    report = find_umbilics(ellipsoid(), inside=lambda uv: uv[:, 1] > 0)
    assert [u.point[2] > 0 for u in report.umbilics] == [True, True]
    away = find_umbilics(ellipsoid(), inside=lambda uv: np.abs(np.cos(uv[:, 0])) < 0.3)
    assert away.umbilics == ()
    assert away.viability > 0.3
    nowhere = find_umbilics(ellipsoid(), inside=lambda uv: uv[:, 0] > 100)
    assert nowhere.umbilics == ()
    assert nowhere.viability == math.inf


def test_conjugacy_defect_vanishes_on_conjugate_lines_only():
    uv = np.random.default_rng(0).uniform(-0.9, 0.9, size=(50, 2))
    u, v = np.tile([[1.0, 0.0]], (50, 1)), np.tile([[0.0, 1.0]], (50, 1))
    conjugate = ("conjugate-cubic", "enneper", "torus", "catenoid", "monge")
    for kind in conjugate:
        assert conjugacy_defect(shape_surface(kind), uv, u, v).max() < 1e-13
    # Asymptotic lines of the helicoid at right angles: the norm is reached. (Oracle 54.)
    helicoid = shape_surface("helicoid")
    assert np.abs(conjugacy_defect(helicoid, uv, u, v) - 1).max() < 1e-14
    assert conjugacy_defect(helicoid, uv, u + v, u - v).max() < 1e-14


def test_conjugacy_defect_ignores_lengths_and_is_zero_where_flat():
    uv = np.array([[0.3, 0.2]])
    a, b = np.array([[1.0, 2.0]]), np.array([[-1.0, 0.5]])
    surface = ellipsoid()
    once = conjugacy_defect(surface, uv, a, b)
    assert np.abs(once - conjugacy_defect(surface, uv, 5 * a, -3 * b)).max() < 1e-15
    assert 0 < once[0] < 1
    flat = graph_surface("x + y", (0, 1), (0, 1))
    assert conjugacy_defect(flat, uv, a, b)[0] == 0.0
