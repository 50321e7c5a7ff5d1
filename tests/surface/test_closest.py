import numpy as np
import pytest

from pqmesh.errors import SurfaceError
from pqmesh.surface.analytic import SHAPES, ellipsoid, moved, shape_surface, sphere, torus
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.closest import closest_point
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.formula import graph_surface
from pqmesh.vectors import dot, norm


def wavy_patch():
    x, y = np.meshgrid(np.linspace(0, 10, 12), np.linspace(0, 8, 10), indexing="ij")
    z = 0.5 * np.random.default_rng(9).normal(size=x.shape)
    return BSplineSurface(np.stack([x, y, z], axis=-1), (3, 3))


SURFACES = {**{kind: shape_surface(kind) for kind in SHAPES}, "patch": wavy_patch()}


def lifted_points(surface, n=400, seed=0):
    """Points at signed distances well within the focal distance, with their parameters."""
    rng = np.random.default_rng(seed)
    uv = surface.domain.low + surface.domain.size * rng.uniform(0.02, 0.98, size=(n, 2))
    jet = surface.jet(uv)
    data = shape_data(jet)
    h = rng.uniform(-0.2, 0.2, size=n) / max(1e-3, np.abs(data.k).max())
    return uv, jet.point, h, jet.point + h[:, None] * data.normal


def slope_along_domain(surface, foot, points):
    """Cosines of the residual with both tangents, where the domain lets them matter."""
    gap = foot.jet.point - points
    cosines = []
    for axis, tangent in enumerate((foot.jet.du, foot.jet.dv)):
        slope = dot(gap, tangent) / (norm(tangent) * norm(gap))
        if not surface.domain.periodic[axis]:
            at_low = (foot.uv[:, axis] <= surface.domain.low[axis]) & (slope > 0)
            at_high = (foot.uv[:, axis] >= surface.domain.high[axis]) & (slope < 0)
            slope = np.where(at_low | at_high, 0.0, slope)
        cosines.append(np.abs(slope).max())
    return max(cosines)


@pytest.mark.parametrize("name", SURFACES)
def test_point_at_height_h_over_the_surface_has_distance_h(name):
    # Oracle 58; sizes are up to 10, so rounding is some 1e-15.
    surface = SURFACES[name]
    _, feet, h, points = lifted_points(surface)
    foot = closest_point(surface, points)
    assert np.abs(foot.distance - np.abs(h)).max() < 1e-14
    assert norm(foot.jet.point - feet).max() < 1e-13
    assert surface.domain.inside(foot.uv).all()


@pytest.mark.parametrize("name", SURFACES)
def test_start_nearby_leads_to_the_same_foot(name):
    surface = SURFACES[name]
    uv, feet, h, points = lifted_points(surface, seed=1)
    start = uv + 0.01 * surface.domain.size * np.random.default_rng(2).normal(size=uv.shape)
    foot = closest_point(surface, points, start)
    assert np.abs(foot.distance - np.abs(h)).max() < 1e-14
    assert norm(foot.jet.point - feet).max() < 1e-13


@pytest.mark.parametrize("name", SURFACES)
def test_far_points_find_a_minimum_no_worse_than_dense_samples(name):
    surface = SURFACES[name]
    centre = surface.jet(surface.domain.grid(20, 20).reshape(-1, 2)).point
    size = np.ptp(centre, axis=0).max()
    points = centre[::4] + 0.4 * size * np.random.default_rng(3).normal(size=(100, 3))
    foot = closest_point(surface, points)
    dense = surface.jet(surface.domain.grid(150, 150).reshape(-1, 2)).point
    brute = np.array([norm(dense - point).min() for point in points])
    assert (foot.distance <= brute + 1e-12).all()
    # The minimum is quadratic: gradients stop near rounding over the smallest curvature.
    assert slope_along_domain(surface, foot, points) < 1e-9


def test_points_on_the_surface_have_distance_zero():
    surface = torus()
    _, feet, _, _ = lifted_points(surface)
    assert closest_point(surface, feet).distance.max() < 2e-15


def test_points_beyond_the_rim_get_the_rim():
    surface = graph_surface("x*y", (-1, 1), (-1, 1))
    points = np.array([[3.0, 0.0, 0.0], [3.0, 4.0, 1.0], [0.2, -5.0, 0.0]])
    foot = closest_point(surface, points)
    assert foot.uv[0].tolist() == [1.0, 0.0]
    assert foot.uv[1].tolist() == [1.0, 1.0]
    assert foot.uv[2, 1] == -1.0
    assert slope_along_domain(surface, foot, points) < 1e-12


def test_seam_of_a_periodic_surface_is_no_rim():
    surface = torus()
    point = np.array([[4.2, -1e-3, 0.0]])
    foot = closest_point(surface, point, np.array([[0.1, 6.2]]))
    assert foot.distance[0] == pytest.approx(np.hypot(4.2, 1e-3) - 4.0, abs=1e-14)
    assert surface.domain.inside(foot.uv).all()


def test_start_near_a_saddle_of_the_distance_goes_down():
    # Below z = xy at depth 2 the origin is no minimum; the feet are (1, -1) and (-1, 1).
    surface = graph_surface("x*y", (-3, 3), (-3, 3))
    foot = closest_point(surface, np.array([[0.0, 0.0, -2.0]]), np.array([[0.01, 0.0]]))
    assert foot.distance[0] == pytest.approx(3**0.5, abs=1e-14)


def test_centre_of_a_sphere_gets_any_point_of_it():
    foot = closest_point(sphere(radius=2.0), np.zeros((1, 3)))
    assert foot.distance[0] == pytest.approx(2.0, abs=1e-15)


def test_distance_does_not_depend_on_place_and_size():
    surface = ellipsoid()
    _, _, h, points = lifted_points(surface, n=50)
    for scale, shift in ((1e-3, 0.0), (1e3, 1e5)):
        image = moved(surface, translation=(shift, 0, 0), scale=scale)
        foot = closest_point(image, scale * points + [shift, 0, 0])
        assert np.abs(foot.distance - scale * np.abs(h)).max() < 1e-14 * (scale + shift)


def test_no_points_give_an_empty_answer():
    assert closest_point(torus(), np.empty((0, 3))).distance.shape == (0,)


@pytest.mark.parametrize(
    ("points", "start", "message"),
    [
        (np.zeros(3), None, r"shape \(N, 3\); found shape \(3,\)"),
        (np.full((2, 3), np.nan), None, "not finite"),
        (np.zeros((2, 3)), np.zeros((1, 2)), r"shape \(2, 2\); found \(1, 2\)"),
    ],
)
def test_closest_point_refuses_wrong_shapes(points, start, message):
    with pytest.raises(SurfaceError, match=message):
        closest_point(torus(), points, start)
