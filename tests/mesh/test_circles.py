"""Circle fit: the direct test of circular faces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import curved_mesh, cyclide, random_rotation, sampled, torus

from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.circles import fitted_circles
from pqmesh.mesh.exact import grid_mesh, mirror_mesh, rotational_mesh, stereographic_mesh
from pqmesh.mesh.measure import circle_deviation, circularity_defect
from pqmesh.mesh.quadmesh import PolyMesh


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), size=st.integers(3, 9), radius=st.floats(0.1, 20.0))
def test_corners_on_a_circle_give_that_circle(seed, size, radius):
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.uniform(0.3, 1.0, size))
    turns *= 2 * np.pi / (turns[-1] + 0.5)
    center, turn = rng.normal(size=3), random_rotation(rng)
    ring = radius * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    circle = fitted_circles(PolyMesh.of(center + ring @ turn.T, [list(range(size))]))
    assert circle.radii[0] == pytest.approx(radius, rel=1e-12)
    assert np.abs(circle.centers[0] - center).max() < 1e-11 * (radius + 1)
    assert np.abs(circle.axes[0] - turn[:, 2]).max() < 1e-12
    assert circle.deviation[0] < 1e-12 * (radius + 1)


def test_circular_meshes_have_circles_and_others_have_not():
    u, v = np.array([0.2, 0.5, 1.1, 1.3]), np.array([0.4, 0.6, 1.2, 2.0])
    for mesh in (grid_mesh(sampled(cyclide, u, v)[0]),
                 rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], [0, 0.3, 0.8])):  # fmt: skip
        assert fitted_circles(mesh).deviation.max() < 1e-13
        assert np.abs(circularity_defect(mesh)).max() < 1e-13
    bent = curved_mesh(5, 4, noise=0.05)
    assert fitted_circles(bent).deviation.min() > 1e-4


def exact_circular_meshes():
    rng = np.random.default_rng(4)
    profile = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.3], [1.5, 2.3]])
    polyline = np.cumsum([[0, 0, 0], [0.1, 1, 0.3], [-0.1, 0.8, -0.4], [0.2, 1.1, 0.2]], axis=0)
    tilt = 0.05 * rng.normal(size=(5, 2))
    mirrors = np.column_stack([np.ones(5), tilt, 1 + 1.5 * np.arange(5)])
    u, v = (np.cumsum(rng.uniform(0.05, 0.7, 9)) for _ in range(2))
    turns = np.sort(rng.uniform(0, 2 * np.pi, 9))
    return {
        "rotational": rotational_mesh(profile, turns, closed=True),
        "mirrors": mirror_mesh(polyline, mirrors),
        "stereographic": stereographic_mesh(u - 2, v - 1.5),
        "torus": grid_mesh(sampled(torus, u, v)[0]),
        "cyclide": grid_mesh(sampled(cyclide, u, v)[0]),
    }


@pytest.mark.parametrize("name", sorted(exact_circular_meshes()))
def test_exact_circular_mesh_fits_its_circles_to_rounding_error(name):
    # Oracles 12, 13, 15 and 16 at their tolerance, by distance and not by a squared residual.
    mesh = exact_circular_meshes()[name]
    assert fitted_circles(mesh).deviation.max() < 1e-13


def test_crossed_cyclic_quads_have_a_circle_though_their_order_is_wrong():
    polyline = [[-1.0, 0, 0], [0.6, 1, 0], [0.5, 2, 0.1]]
    mesh = mirror_mesh(polyline, [[1.0, 0, 0, 0]])
    assert fitted_circles(mesh).deviation[0] < 1e-14
    assert circle_deviation(mesh)[0] > 0.1


def test_corners_on_a_line_have_no_circle():
    line = PolyMesh.of([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]], [[0, 1, 2, 3]])
    circle = fitted_circles(line)
    assert circle.radii[0] == np.inf
    assert circle.deviation[0] == 0.0


def test_skew_quad_is_off_its_circle_by_half_the_distance_of_its_diagonals():
    skew = PolyMesh.of([[-1, -1, 0.1], [1, -1, -0.1], [1, 1, 0.1], [-1, 1, -0.1]], [[0, 1, 2, 3]])
    circle = fitted_circles(skew)
    assert circle.radii[0] == pytest.approx(np.sqrt(2), rel=1e-14)
    assert circle.deviation[0] == pytest.approx(0.1, rel=1e-12)


def test_deviation_of_a_real_mesh_has_the_same_twelve_outliers_as_its_angles(data_folder):
    mesh = read_quad_mesh(data_folder / "formfinding-circular.off")
    circle = fitted_circles(mesh)
    share = circle.deviation / circle.radii
    by_angle = np.flatnonzero(np.degrees(np.abs(circularity_defect(mesh))) > 0.2)
    assert len(by_angle) == 12
    assert set(np.argsort(share)[-12:].tolist()) == set(by_angle.tolist())
    assert np.median(share) < 1e-4
