"""Circular meshes: families that are exactly so, what keeps them so, and what deceives a test."""

import numpy as np
import pytest
from shapes import curved_mesh, cyclide, inverted, random_rotation, sampled, torus

from pqmesh.mesh.exact import (
    contact_element_mesh,
    grid_mesh,
    mirror_mesh,
    propagated_normals,
    rotational_mesh,
    stereographic_mesh,
    translational_mesh,
)
from pqmesh.mesh.measure import (
    circle_deviation,
    circularity_defect,
    conicality_defect,
    fitted_cones,
    nonconvex_faces,
    planarity,
    planarity_deviation,
)
from pqmesh.mesh.quadmesh import QuadMesh

# Steps and profile without any regularity.
STEPS = np.array([0.0, 0.31, 0.44, 0.9, 1.5, 1.71])
PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.3], [1.5, 2.3]])


def circle_misfit(mesh):
    """Distance of each fourth corner from the circle of the other three, over its radius."""
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    p, q = b - a, c - a
    normal = np.cross(p, q)
    square = (normal**2).sum(axis=1, keepdims=True)
    pp, qq = (p**2).sum(axis=1, keepdims=True), (q**2).sum(axis=1, keepdims=True)
    center = a + np.cross(pp * q - qq * p, normal) / (2 * square)
    radius = np.linalg.norm(a - center, axis=1)
    unit = normal / np.sqrt(square)
    height = ((d - center) * unit).sum(axis=1)
    flat = d - center - height[:, None] * unit
    return np.hypot(height, np.linalg.norm(flat, axis=1) - radius) / radius


def assert_circular(mesh, tolerance=1e-13):
    """Planar, convex, and four corners of each face on one circle."""
    assert len(nonconvex_faces(mesh)) == 0
    assert planarity(mesh).max() < tolerance
    # The Ptolemy residual is of second order in the misfit: it alone would prove little.
    assert np.abs(circle_deviation(mesh)).max() < tolerance
    assert np.abs(circularity_defect(mesh)).max() < 10 * tolerance
    assert circle_misfit(mesh).max() < 10 * tolerance


# --- oracle 12: rotation ----------------------------------------------------------------------


def test_rotational_mesh_of_any_profile_and_any_angles_is_circular():
    # 1e-13: products of numbers near 1, a few roundings each.
    assert_circular(rotational_mesh(PROFILE, STEPS))
    turns = np.sort(np.random.default_rng(0).uniform(0, 2 * np.pi, 9))
    assert_circular(rotational_mesh(PROFILE, turns, closed=True))


def test_rotational_mesh_faces_are_isosceles_trapezoids():
    a, b, c, d = np.moveaxis(rotational_mesh(PROFILE, STEPS).corners, 1, 0)
    sides = [np.linalg.norm(x - y, axis=1) for x, y in ((a, d), (b, c), (a, b), (c, d))]
    legs = np.minimum(np.abs(sides[0] - sides[1]), np.abs(sides[2] - sides[3]))
    assert legs.max() < 1e-14


def test_rotational_mesh_is_conical_for_equal_steps_and_not_otherwise():
    assert fitted_cones(rotational_mesh(PROFILE, 0.3 * np.arange(6))).misfit.max() < 1e-12
    uneven = fitted_cones(rotational_mesh(PROFILE, STEPS))
    # Each interior vertex lies between two different steps and bends in the profile.
    assert uneven.relative_spread.min() > 1e-4


def test_rotational_mesh_with_straight_or_vertical_profile_is_conical_for_any_steps():
    cylinder = [[2, 0], [2, 0.4], [2, 1.3]]
    cone = [[2, 0], [2.4, 0.5], [2.8, 1.0]]
    for profile in (cylinder, cone):
        cones = fitted_cones(rotational_mesh(profile, STEPS))
        assert cones.misfit.max() < 1e-12


# --- oracle 13: mirrors -----------------------------------------------------------------------


def test_mirror_mesh_of_space_polyline_in_any_mirrors_is_circular():
    rng = np.random.default_rng(1)
    polyline = np.cumsum([[0, 0, 0], [0.1, 1, 0.3], [-0.1, 0.8, -0.4], [0.2, 1.1, 0.2]], axis=0)
    mirrors = np.column_stack([np.ones(5), 0.05 * rng.normal(size=(5, 2)), 1 + 1.5 * np.arange(5)])
    mesh = mirror_mesh(polyline, mirrors)
    assert_circular(mesh)
    # It is not rotational in disguise: the vertices' normals do not balance.
    assert np.abs(conicality_defect(mesh)[1]).max() > 1e-3


def test_polyline_that_crosses_the_mirror_gives_crossed_cyclic_quads():
    polyline = [[-1.0, 0, 0], [0.6, 1, 0], [0.5, 2, 0.1]]
    mesh = mirror_mesh(polyline, [[1.0, 0, 0, 0]])
    # Face 0 is the crossed one; it is planar and its corners lie on a circle in crossed order.
    assert nonconvex_faces(mesh).tolist() == [0]
    assert planarity(mesh).max() < 1e-14
    assert circle_misfit(mesh).max() < 1e-13
    assert circle_deviation(mesh)[0] > 0.1
    assert abs(circle_deviation(mesh)[1]) < 1e-14


# --- oracles 14, 15: Moebius maps and the sphere ----------------------------------------------


def cross_ratio(mesh):
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)

    def far(x, y):
        return np.linalg.norm(x - y, axis=1)

    return far(a, b) * far(c, d) / (far(b, c) * far(d, a))


@pytest.mark.parametrize("center", [(0.3, -0.2, 0.5), (6.0, 1.0, -2.0), (2.5, 1.0, 1.0)])
def test_inversion_keeps_circular_and_the_cross_ratio(center):
    mesh = rotational_mesh(PROFILE, STEPS)
    image = mesh.with_vertices(inverted(mesh.vertices, np.array(center), 1.7))
    # 1e-11: the third center is near the mesh, and distortion multiplies the rounding.
    assert planarity(image).max() < 1e-11
    assert np.abs(circle_deviation(image)).max() < 1e-11
    assert circle_misfit(image).max() < 1e-11
    assert np.abs(cross_ratio(image) / cross_ratio(mesh) - 1).max() < 1e-10


def test_inversion_does_not_make_other_meshes_planar():
    mesh = translational_mesh([[0, 0, 0], [1, 0, 0], [2, 0.3, 0.4]], [[0, 0, 0], [0.4, 1, 0]])
    image = mesh.with_vertices(inverted(mesh.vertices, np.array([0.3, -2.0, 2.0]), 1.7))
    assert planarity(mesh).max() < 1e-14
    assert planarity(image).max() > 1e-3


def inversion_matrix(center, radius):
    """Reflection of R^{4,1}, metric diag(-1,1,1,1,1), for points as in `lifted`."""
    square = center @ center
    pole = np.concatenate([[(1 + square - radius**2) / 2, (1 - square + radius**2) / 2], center])
    pole /= radius
    metric = np.diag([-1.0, 1, 1, 1, 1])
    assert np.isclose(pole @ metric @ pole, 1.0)
    return np.eye(5) - 2 * np.outer(pole, pole @ metric)


def lifted(points):
    square = (points**2).sum(axis=1, keepdims=True)
    return np.hstack([(1 + square) / 2, (1 - square) / 2, points])


def lowered(rows):
    return rows[:, 2:] / (rows[:, :1] + rows[:, 1:2])


def test_matrix_of_the_inversion_gives_the_same_points_and_composes():
    mesh = rotational_mesh(PROFILE, STEPS)
    metric = np.diag([-1.0, 1, 1, 1, 1])
    first, second = np.array([0.3, -0.2, 0.5]), np.array([6.0, 1.0, -2.0])
    a, b = inversion_matrix(first, 1.7), inversion_matrix(second, 0.8)
    one = inverted(mesh.vertices, first, 1.7)
    assert np.abs(lowered(lifted(mesh.vertices) @ a.T) - one).max() < 1e-12
    two = inverted(one, second, 0.8)
    product = b @ a
    assert np.abs(lowered(lifted(mesh.vertices) @ product.T) - two).max() < 1e-11
    # Sums of products of entries that reach hundreds: rounding of their squares.
    bound = 1e-15 * np.abs(product).max() ** 2
    assert np.abs(product.T @ metric @ product - metric).max() < bound
    assert_circular(mesh.with_vertices(two), 1e-11)


def test_stereographic_mesh_is_circular_on_the_sphere():
    mesh = stereographic_mesh(STEPS - 0.7, STEPS**1.3 - 0.9)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 1e-15
    assert_circular(mesh)
    assert ((mesh.face_normals * mesh.face_centers).sum(axis=1) > 0).all()


# --- oracle 16: torus and cyclide -------------------------------------------------------------


def test_cyclide_formula_has_published_values():
    point, normal, curvature = cyclide(np.array(0.3), np.array(0.5))
    # The digits of the oracle.
    assert np.allclose(point, [2.344045486, 0.583159128, -0.467141248], rtol=0, atol=5e-10)
    assert np.allclose(curvature, [0.581908991, -1.342888413], rtol=0, atol=5e-10)
    assert np.isclose(np.linalg.norm(normal), 1.0, atol=1e-14)
    a, c, d, b2 = 3.0, 1.0, 1.7, 8.0
    x, y, _ = point
    quartic = (point @ point + b2 - d * d) ** 2 - 4 * (a * x - c * d) ** 2 - 4 * b2 * y * y
    assert abs(quartic) < 1e-12


@pytest.mark.parametrize("formula", [torus, cyclide], ids=["torus", "cyclide"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_torus_and_cyclide_sampled_anyhow_are_exactly_circular(formula, seed):
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.uniform(0.05, 0.7, 9))
    v = np.cumsum(rng.uniform(0.05, 0.7, 8))
    mesh = grid_mesh(sampled(formula, u, v)[0])
    assert planarity(mesh).max() < 1e-13
    assert np.abs(circle_deviation(mesh)).max() < 1e-13
    # Radii down to a twentieth of the size, so two more digits go.
    assert circle_misfit(mesh).max() < 1e-12


def test_torus_sampled_off_its_curvature_lines_is_not_circular():
    s, t = np.meshgrid(0.3 * np.arange(6), 0.3 * np.arange(5), indexing="ij")
    mesh = grid_mesh(torus(s + 0.4 * t, t - 0.3 * s)[0])
    assert planarity(mesh).max() > 1e-4
    assert circle_deviation(mesh).max() > 1e-3


# --- oracles 17, 25: propagated normals and contact elements ----------------------------------


@pytest.mark.parametrize("seed", [0, 1])
def test_propagated_normals_close_on_circular_mesh_for_any_start(seed):
    rng = np.random.default_rng(seed)
    u, v = np.cumsum(rng.uniform(0.1, 0.5, 6)), np.cumsum(rng.uniform(0.1, 0.5, 7))
    mesh = grid_mesh(sampled(cyclide, u, v)[0])
    normals = propagated_normals(mesh, rng.normal(size=3))
    low, high = mesh.edges.T
    step = mesh.edge_vectors / mesh.edge_lengths[:, None]
    mirrored = normals[low] - 2 * (normals[low] * step).sum(axis=1)[:, None] * step
    # Every edge, not only those of the tree: 1e-14 for each of the 12 steps of a path.
    assert np.abs(mirrored - normals[high]).max() < 1e-11
    # Unit normals at parallel edges: a vertex offset at constant distance.
    offset = mesh.with_vertices(mesh.vertices + 0.1 * normals)
    turned = np.cross(offset.edge_vectors, step)
    assert np.abs(turned).max() < 1e-11


def test_propagated_normals_leave_a_gap_on_other_meshes():
    mesh = curved_mesh(4, 4)
    normals = propagated_normals(mesh, [0.3, 0.5, 1.0])
    low, high = mesh.edges.T
    step = mesh.edge_vectors / mesh.edge_lengths[:, None]
    mirrored = normals[low] - 2 * (normals[low] * step).sum(axis=1)[:, None] * step
    assert np.abs(mirrored - normals[high]).max() > 0.01


def test_cyclide_normals_are_propagated_normals_of_their_mesh():
    u, v = np.array([0.2, 0.5, 1.1, 1.3]), np.array([0.4, 0.6, 1.2, 2.0])
    point, normal, _ = sampled(cyclide, u, v)
    mesh = grid_mesh(point)
    found = propagated_normals(mesh, normal[0, 0])
    # Four points of two families of circles: the surface normals are one choice.
    assert np.abs(found - normal.reshape(-1, 3)).max() < 1e-12


@pytest.mark.parametrize("start", [(0.2, 0.3, 1.0), (-0.4, 0.1, 0.8), (1.0, 0.2, 0.1)])
def test_contact_elements_of_circular_mesh_span_a_conical_mesh(start):
    mesh = rotational_mesh(PROFILE, STEPS)
    start = random_rotation(np.random.default_rng(5)) @ start
    conical = contact_element_mesh(mesh, start)
    assert conical.topology.n_faces == 3 * 4
    # Vertices are intersections of planes that may be nearly parallel: 1e-8 as stated.
    assert planarity(conical).max() < 1e-8
    normals = propagated_normals(mesh, start)[~mesh.topology.is_boundary_vertex]
    found = np.abs((normals * conical.face_normals).sum(axis=1))
    assert np.abs(found - 1).max() < 1e-8


def test_contact_elements_of_a_torus_give_cones():
    u, v = np.array([0.2, 0.5, 1.1, 1.3, 1.9]), np.array([0.4, 0.6, 1.2, 2.0, 2.2])
    point, normal = sampled(torus, u, v)
    mesh = grid_mesh(point)
    for tilt in (0.0, 0.1, -0.2):
        conical = contact_element_mesh(mesh, normal[0, 0] + tilt * np.array([0.3, -1.0, 0.5]))
        cones = fitted_cones(conical)
        assert len(nonconvex_faces(conical)) == 0
        assert cones.misfit.max() < 1e-8
        assert np.abs(conicality_defect(conical)[1]).max() < 1e-8


# --- oracles 19, 20: what deceives ------------------------------------------------------------


def test_crossed_cyclic_quad_has_equal_opposite_angles_and_is_not_taken_for_circular():
    t = np.array([0.2, 1.0, 2.9, 4.6])[[0, 2, 1, 3]]
    mesh = QuadMesh.of(np.column_stack([np.cos(t), np.sin(t), 0 * t]), [[0, 1, 2, 3]])
    p = mesh.corners[0]
    out, back = np.roll(p, -1, axis=0) - p, np.roll(p, 1, axis=0) - p
    cosine = (out * back).sum(axis=1) / np.linalg.norm(out, axis=1) / np.linalg.norm(back, axis=1)
    angles = np.arccos(cosine)
    assert np.allclose(angles[:2], angles[2:], atol=1e-12)
    assert abs(circularity_defect(mesh)[0]) > 0.1
    assert circle_deviation(mesh)[0] > 0.1
    assert nonconvex_faces(mesh).tolist() == [0]


def test_tetrahedron_quad_balances_and_is_not_planar():
    corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    mesh = QuadMesh.of(np.array(corners, float), [[0, 1, 2, 3]])
    assert abs(circularity_defect(mesh)[0]) < 1e-15
    assert np.isclose(planarity_deviation(mesh)[0], 2.0)
    # Six equal edges: s^2 + s^2 - s^2 over s^2.
    assert np.isclose(circle_deviation(mesh)[0], 1.0)


def test_ptolemy_residual_is_never_negative():
    points = np.random.default_rng(2).normal(size=(4000, 3))
    mesh = QuadMesh.of(points, np.arange(4000).reshape(-1, 4))
    assert circle_deviation(mesh).min() > 0


def test_ptolemy_residual_vanishes_only_for_a_circle_in_order():
    rng = np.random.default_rng(3)
    for _ in range(50):
        t = np.sort(rng.uniform(0, 2 * np.pi, 4))
        ring = np.column_stack([np.cos(t), np.sin(t), 0 * t]) @ random_rotation(rng).T
        mesh = QuadMesh.of(np.vstack([ring, ring]), [[0, 1, 2, 3], [4, 6, 5, 7]])
        values = circle_deviation(mesh)
        # Rounding over the product of two diagonals, which may be short.
        short = np.min(np.linalg.norm(ring[[2, 3]] - ring[[0, 1]], axis=1))
        assert abs(values[0]) < 1e-14 / short**2
        # In crossed order a diagonal and a side change places.
        assert values[1] > 100 * abs(values[0])


def test_ptolemy_residual_is_quadratic_in_the_angle_defect():
    t = np.array([0.1, 1.3, 2.9, 4.4])
    ring = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    defects, residuals = [], []
    for step in (1e-2, 1e-3, 1e-4):
        points = ring.copy()
        points[3] *= 1 + step
        mesh = QuadMesh.of(points, [[0, 1, 2, 3]])
        defects.append(abs(circularity_defect(mesh)[0]))
        residuals.append(circle_deviation(mesh)[0])
    assert np.allclose(np.diff(np.log10(defects)), -1, atol=0.05)
    # So a Ptolemy residual of 1e-12 stands for an angle defect of 1e-6, not of 1e-12.
    assert np.allclose(np.diff(np.log10(residuals)), -2, atol=0.05)
