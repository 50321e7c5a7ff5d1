import math

import numpy as np
import pytest

from pqmesh.errors import SurfaceError
from pqmesh.surface.analytic import SHAPES, revolution, shape_surface, sphere
from pqmesh.surface.base import Domain
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.surface.regular import check_regular, closes

FULL = (0.0, 2 * math.pi)


@pytest.mark.parametrize("kind", SHAPES)
def test_every_shape_is_regular_on_its_own_domain(kind):
    surface = shape_surface(kind)
    check_regular(surface)
    assert closes(surface) == surface.domain.periodic


@pytest.mark.parametrize(
    ("surface", "message"),
    [
        (FormulaSurface("1", "2", "3", Domain((0, 1), (0, 1))), "have a normal"),
        (FormulaSurface("u", "2*u", "3*u", Domain((0, 1), (0, 1))), "one stands still"),
        (FormulaSurface("u+v", "2*u+2*v", "sin(u+v)", Domain((0, 1), (0, 1))), "tangent to each"),
        (FormulaSurface("u**3", "v", "u**3", Domain((-1, 1), (0, 1))), "u = 0, v = 0, point"),
        (sphere(v=(-1.2, math.pi / 2)), r"v = 1.5708, point \(6.12323e-17, 0, 1\).* pole"),
        (revolution("v", "v", v=(0.0, 1.0)), r"v = 0, point \(0, 0, 0\)"),
        (graph_surface("1e90*(1 + x)*(1e70*x)", (0, 1), (0, 1)), "stay below 1e\\+150"),
        (graph_surface("exp(1000*x)", (0, 1), (0, 1)), "must be finite"),
        (graph_surface("log(x)", (0, 1), (0, 1)), "z is -inf at x = 0, y = 0"),
    ],
)
def test_check_refuses_surfaces_without_a_tangent_plane(surface, message):
    with pytest.raises(SurfaceError, match=message):
        check_regular(surface)


def test_check_refuses_a_foreign_surface_that_is_not_finite():
    class Broken:
        domain = Domain((0, 1), (0, 1))

        def jet(self, uv):
            jet = graph_surface("x*y", (0, 1), (0, 1)).jet(uv)
            jet.duv[-1] = np.nan
            return jet

    with pytest.raises(SurfaceError, match="be finite everywhere; at u = 1, v = 1"):
        check_regular(Broken())


def test_check_refuses_a_periodic_direction_that_does_not_close():
    texts = ("cos(u)", "sin(u)", "v")
    check_regular(FormulaSurface(*texts, Domain(FULL, (0, 1), (True, False))))
    with pytest.raises(SurfaceError, match="periodic in u must have equal points"):
        check_regular(FormulaSurface(*texts, Domain((0, 6.28), (0, 1), (True, False))))
    with pytest.raises(SurfaceError, match="periodic in v"):
        check_regular(FormulaSurface(*texts, Domain(FULL, (0, 1), (False, True))))


def test_points_that_meet_under_an_angle_do_not_close():
    drop = FormulaSurface("sin(u)", "sin(2*u)", "v", Domain((0, math.pi), (0, 1)))
    assert closes(drop) == (False, False)


def test_huge_and_tiny_surfaces_are_judged_alike():
    for scale in (1e-60, 1.0, 1e60):
        points = scale * np.random.default_rng(3).normal(size=(5, 5, 3))
        points[..., 0] += 5 * scale * np.arange(5)[:, None]
        points[..., 1] += 5 * scale * np.arange(5)
        check_regular(BSplineSurface(points, (3, 3)))
