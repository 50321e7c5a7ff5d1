"""Orders of the measures on nets of curvature lines, against nets that are not conjugate."""

import numpy as np
import pytest
from shapes import ellipsoid, observed_orders, sampled

from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.measure import (
    circle_deviation,
    circularity_defect,
    conicality_defect,
    fitted_cones,
    planarity_deviation,
    star_angles,
    tetrahedron_volume,
)

AXES = (3.0, 2.0, 1.2)
STEPS = 0.05 / 2.0 ** np.arange(4)
RANGE = np.arange(-2, 3)


def curvature_net(h):
    """4 x 4 faces of curvature lines around one point of the ellipsoid."""
    return grid_mesh(sampled(ellipsoid, 0.7 + h * RANGE, 0.9 + 0.8 * h * RANGE)[0])


def other_net(h):
    """4 x 4 faces of curves that are not conjugate, around the same point."""
    s, t = np.meshgrid(h * RANGE, h * RANGE, indexing="ij")
    return grid_mesh(ellipsoid(0.7 + 0.9 * s + 0.5 * t, 0.9 - 0.6 * s + 0.8 * t)[0])


def orders(net, measure):
    return observed_orders([np.abs(measure(net(h))).max() for h in STEPS])


def balance(mesh):
    return conicality_defect(mesh)[1]


def spread(mesh):
    return fitted_cones(mesh).spread


def misfit(mesh):
    return fitted_cones(mesh).misfit


# Order on curvature lines, order on other nets.
LAWS = {
    "volume": (tetrahedron_volume, 6, 4),
    "diagonal_distance": (planarity_deviation, 4, 2),
    "circle_angles": (circularity_defect, 2, 0),
    # Ptolemy's residual is the square of the circle residual, which is of order 2.
    "ptolemy": (circle_deviation, 4, 0),
    "cone_spread": (spread, 3, 1),
    "offset_misfit": (misfit, 4, 2),
    "balance": (balance, 2, 0),
}


@pytest.mark.parametrize("name", sorted(LAWS))
def test_measure_has_its_order_on_nets(name):
    measure, on_curvature_lines, elsewhere = LAWS[name]
    # The finest pair is nearest to the law; within 0.1 of theory.
    assert orders(curvature_net, measure)[-1] == pytest.approx(on_curvature_lines, abs=0.1)
    assert orders(other_net, measure)[-1] == pytest.approx(elsewhere, abs=0.1)


def gauss_curvature(points):
    """Of the ellipsoid at a point of it: 1 / (a b c sum x_i^2 / a_i^4)^2."""
    a, b, c = AXES
    weight = (points**2 / np.array(AXES) ** 4).sum(axis=-1)
    return 1.0 / (a * b * c * weight) ** 2


def test_angle_defect_tends_to_curvature_times_area():
    defects, errors = [], []
    for h in STEPS:
        mesh = curvature_net(h)
        (star,) = mesh.topology.stars()
        middle = int(np.flatnonzero(star.vertices == 12)[0])
        defect = 2 * np.pi - star_angles(mesh, star)[middle].sum()
        area = np.linalg.norm(mesh.face_area_vectors[star.faces[middle]], axis=1).sum() / 4
        defects.append(defect)
        errors.append(defect / (gauss_curvature(mesh.vertices[12]) * area) - 1)
    assert observed_orders(defects)[-1] == pytest.approx(2, abs=0.1)
    assert abs(errors[-1]) < 1e-3
    assert observed_orders(errors)[-1] == pytest.approx(2, abs=0.2)


def test_ellipsoid_formula_has_published_values():
    point, mu, nu = ellipsoid(np.array(0.7), np.array(0.9), AXES)
    a, b, c = AXES
    # The digits of the oracle.
    assert np.allclose(point, [1.728834449, 1.198242934, 0.667006766], rtol=0, atol=5e-10)
    assert np.allclose([mu, nu], [2.502442057, 7.068005237], rtol=0, atol=5e-10)
    k = [a * b * c / (mu**1.5 * nu**0.5), a * b * c / (mu**0.5 * nu**1.5)]
    assert np.allclose(k, [0.684129030, 0.242217316], rtol=0, atol=5e-10)
    assert np.isclose(k[0] * k[1], gauss_curvature(point), rtol=1e-13)
    assert np.isclose(mu + nu, a * a + b * b + c * c - point @ point, rtol=1e-14)


@pytest.mark.parametrize("axes", [AXES, (5.0, 2.0, 0.3), (1.2, 1.1, 1.0)])
def test_ivory_diagonals_of_curvature_quads_are_equal(axes):
    rng = np.random.default_rng(0)
    s, t = np.sort(rng.uniform(0, np.pi / 2, 7)), np.sort(rng.uniform(0, np.pi / 2, 7))
    points = sampled(lambda x, y: ellipsoid(x, y, axes)[0], s, t)
    for i, j in [(1, 1), (3, 2), (6, 6)]:
        # Quads of any size: a diagonal from each corner to the opposite one.
        one = np.linalg.norm(points[i:, j:] - points[:-i, :-j], axis=-1)
        two = np.linalg.norm(points[i:, :-j] - points[:-i, j:], axis=-1)
        assert np.abs(one - two).max() < 1e-14 * max(axes)


def test_diagonals_of_other_nets_differ():
    a, b, c, d = np.moveaxis(other_net(0.05).corners, 1, 0)
    gap = np.linalg.norm(c - a, axis=1) - np.linalg.norm(d - b, axis=1)
    assert np.abs(gap).min() > 1e-3
