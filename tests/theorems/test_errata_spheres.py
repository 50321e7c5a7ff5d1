"""Errata E19-E31: Lie, Laguerre and Moebius geometry, and the cone penalty of section 6.2.

The transformations are written out here, apart from those of the package. Oriented spheres are
rows (p, r), oriented planes (N, h) with N . x = h; contact of both means N . p - r = h.
"""

import itertools

import numpy as np
import pytest

from pqmesh.mesh.measure import (
    circle_deviation,
    conicality_defect,
    fitted_cones,
    planarity,
    star_angles,
)
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import angle, cross, dot, norm, unit

# Sizes are near 1 (boosts stretch by less than 3) and formulas a few products deep.
EXACT = 1e-12
LORENTZ = np.diag([1.0, 1.0, 1.0, -1.0])
LIE = np.diag([-1.0, 1.0, 1.0, 1.0, 1.0, -1.0])


def lie_point(sphere):
    """Lie coordinates of an oriented sphere (p, r) of any dimension."""
    p, r = np.asarray(sphere[:-1]), sphere[-1]
    q = p @ p - r * r
    return np.array([(1 + q) / 2, (1 - q) / 2, *p, r])


def lie_plane(normal, h, orientation=1.0):
    return np.array([h, -h, *normal, orientation])


def boost(direction, rapidity):
    b = unit(np.asarray(direction, dtype=float))
    matrix = np.eye(4)
    matrix[:3, :3] += (np.cosh(rapidity) - 1) * np.outer(b, b)
    matrix[:3, 3] = matrix[3, :3] = np.sinh(rapidity) * b
    matrix[3, 3] = np.cosh(rapidity)
    return matrix


def plane_rotation(t):
    """The kind of matrix printed in section 5.3: a Euclidean rotation of (x3, x4)."""
    matrix = np.eye(4)
    matrix[2:, 2:] = [[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]]
    return matrix


def lorentz_error(matrix):
    return np.abs(matrix.T @ LORENTZ @ matrix - LORENTZ).max()


def frame(seed):
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return rotation * np.sign(np.linalg.det(rotation))


def conical_mesh(profile=((2.0, 0.0), (2.4, 0.5), (2.5, 1.2), (2.2, 1.9)), turn=0.3, columns=4):
    """Rotational conical mesh in general position, and its image W with n . w = 1."""
    q = np.array(profile) * [np.cos(turn / 2), 1.0]
    edges = unit(np.diff(q, axis=0))
    m = np.column_stack([edges[:, 1], -edges[:, 0]])
    before, after = np.concatenate([m[:1], m]), np.concatenate([m, m[-1:]])
    w = (before + after) / (1 + dot(before, after))[:, None] / [np.cos(turn / 2), 1.0]
    phi = turn * np.arange(columns + 1)

    def turned(rows):
        r, z = rows.T[:, :, None]
        return np.stack([r * np.cos(phi), r * np.sin(phi), z + 0 * phi], -1).reshape(-1, 3)

    i, j = np.divmod(np.arange((len(q) - 1) * columns), columns)
    first = i * (columns + 1) + j
    faces = np.stack([first, first + 1, first + columns + 2, first + columns + 1], -1)
    rotation = frame(3)
    points = turned(np.array(profile)) @ rotation.T + [0.3, -0.2, 0.5]
    return QuadMesh.of(points, faces), turned(w) @ rotation.T


def laguerre(mesh, vectors, matrix, shift):
    """Vertices and vectors of the image: the line of spheres (v, 0) + t (w, 1), cut by r = 0."""
    start = np.column_stack([mesh.vertices, np.zeros(len(vectors))]) @ matrix.T + shift
    along = np.column_stack([vectors, np.ones(len(vectors))]) @ matrix.T
    points = start[:, :3] - start[:, 3:] / along[:, 3:] * along[:, :3]
    return mesh.with_vertices(points), along[:, :3] / along[:, 3:]


def image_planes(mesh, matrix, shift):
    normals = mesh.face_normals
    levels = dot(normals, mesh.face_centers)
    carried = np.column_stack([normals, np.ones(len(normals))]) @ matrix.T
    scale = carried[:, 3]
    return carried[:, :3] / scale[:, None], (levels + carried @ LORENTZ @ shift) / scale


def sample_map(rapidity=0.3):
    rotation = np.eye(4)
    rotation[:3, :3] = frame(4)
    return rotation @ boost([0.3, -0.5, 0.8], rapidity), np.array([0.2, -0.1, 0.4, 0.15])


# --- E19, E20: the quadric and its signs ----------------------------------------------------


def test_e19_planes_and_the_improper_point_lie_on_the_quadric_with_x1_plus_x2_zero():
    rng = np.random.default_rng(19)
    normal = unit(rng.normal(size=3))
    members = [
        lie_plane(normal, 0.7),
        lie_plane(normal, 0.7, -1.0),
        np.array([1.0, -1, 0, 0, 0, 0]),
    ]
    for y in members:
        assert abs(y @ LIE @ y) < EXACT
        assert y[0] + y[1] == 0.0
    sphere = lie_point(rng.normal(size=4))
    assert sphere[0] + sphere[1] == pytest.approx(1.0)
    # The improper point touches every plane and no sphere.
    products = [y @ LIE @ members[2] for y in (*members[:2], sphere)]
    assert np.abs(products[:2]).max() < EXACT
    assert abs(products[2]) == pytest.approx(1.0)


def test_e19_hyperboloid_runs_to_the_last_coordinate_and_the_metric_is_indefinite():
    zeta = lie_point([0.4, -0.3, 0.9, 0.5])[:5] / 0.5
    squares = np.array([-1, 1, 1, 1, 1]) * zeta**2
    assert squares.sum() == pytest.approx(1.0, abs=EXACT)
    assert abs(squares[:-1].sum() - 1.0) > 0.5  # printed: one term short
    values = np.linalg.eigvalsh(LIE)
    assert ((values > 0).sum(), (values < 0).sum()) == (4, 2)  # (n + 1, 2) with n = 3


def test_e20_positive_radius_goes_with_inward_normals():
    rng = np.random.default_rng(20)
    for r in (0.8, -0.8):  # any signed radius is on the quadric, not only r >= 0
        p, normal = rng.normal(size=3), unit(rng.normal(size=3))
        sphere = lie_point([*p, r])
        assert abs(sphere @ LIE @ sphere) < EXACT
        h = normal @ p - r
        assert abs(sphere @ LIE @ lie_plane(normal, h)) < EXACT
        contact = p - r * normal
        assert normal @ contact == pytest.approx(h, abs=EXACT)
        # The plane's normal points from the contact to the centre exactly when r > 0.
        assert np.sign(normal @ (p - contact)) == np.sign(r)


def test_e20_adding_d_to_radii_moves_planes_by_minus_d():
    rng = np.random.default_rng(21)
    normal, h, d = unit(rng.normal(size=3)), 0.4, 0.15
    points = rng.normal(size=(5, 3))
    spheres = np.column_stack([points, points @ normal - h])  # all touch the plane (N, h)
    moved = spheres + np.array([0, 0, 0, d])
    levels = moved[:, :3] @ normal - moved[:, 3]
    np.testing.assert_allclose(levels, h - d, atol=EXACT)
    assert np.abs(levels - (h + d)).min() > d


# --- E21 to E24: the groups -----------------------------------------------------------------


def test_e21_lie_quadric_has_dimension_n_plus_1():
    for n in (1, 2, 3, 4):
        point = np.random.default_rng(n).normal(size=n + 1)
        step = 1e-6
        rows = [lie_point(point)]
        for e in np.eye(n + 1):
            rows.append((lie_point(point + step * e) - lie_point(point - step * e)) / (2 * step))
        assert np.linalg.matrix_rank(np.array(rows), tol=1e-6) - 1 == n + 1 != n
        assert len(rows[0]) == n + 3  # so P maps GL(n + 3)


def test_e21_negative_factor_occurs_for_equal_signature():
    rng = np.random.default_rng(21)
    for k in (1, 2):
        metric = np.diag([-1.0] * k + [1.0] * k)
        swap = np.roll(np.eye(2 * k), k, axis=0)
        np.testing.assert_allclose(swap.T @ metric @ swap, -metric, atol=EXACT)  # lambda = -1
        light = np.concatenate([unit(rng.normal(size=k)), unit(rng.normal(size=k))])
        image = swap @ light
        assert abs(light @ metric @ light) < EXACT
        assert abs(image @ metric @ image) < EXACT
    # k = 2 is the Lie quadric of n = 1: a Lie transformation outside O(2, 2), the corollary fails.
    for scale in (-2.0, -1.0, 0.5, 1.0):
        scaled = scale * swap
        assert np.abs(scaled.T @ metric @ scaled - metric).max() > 1.0


def test_e22_a_kernel_of_two_elements_says_nothing_about_surjectivity():
    flip = np.diag([1.0, 1, 1, 1, 1, -1])  # r -> -r
    subgroup = [np.eye(6), -np.eye(6), flip, -flip]
    kernel = [g for g in subgroup if np.allclose(g, g[0, 0] * np.eye(6))]
    assert len(kernel) == 2  # the printed reason holds for this subgroup of O(4, 2) as well
    image = {tuple(np.round(g * np.sign(g[0, 0]), 9).ravel()) for g in subgroup}
    assert len(image) == 2  # which reaches two transformations only


def test_e22_point_sphere_maps_are_a_double_cover_of_the_moebius_group():
    flip = np.diag([1.0, 1, 1, 1, 1, -1])
    rng = np.random.default_rng(22)
    point, sphere = lie_point([*rng.normal(size=3), 0.0]), lie_point(rng.normal(size=4))
    np.testing.assert_allclose(flip @ point, point, atol=EXACT)  # identity on points
    assert not np.allclose(np.abs(flip), flip)  # neither I nor -I
    assert norm(flip @ sphere - sphere) > 0.1  # and it turns spheres over
    np.testing.assert_allclose(flip @ sphere, lie_point([*sphere[2:5], -sphere[5]]), atol=EXACT)


def printed_basis(n):
    e = np.eye(n + 3)
    last = (e[0] - e[n + 2]) / np.sqrt(2) + e[1]
    return np.array([e[1] + e[n + 2], *(e[0] + e[i] for i in range(1, n + 2)), last])


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_e23_basis_points_fix_a_lie_map_only_through_their_products(n):
    metric = np.diag([-1.0, *[1.0] * (n + 1), -1.0])
    basis = printed_basis(n)
    gram = basis @ metric @ basis.T
    assert np.abs(np.diag(gram)).max() < EXACT
    assert (np.abs(basis[:, 0] + basis[:, 1]) > 0.5).all()
    assert np.linalg.matrix_rank(basis) == n + 3
    # A projective map that fixes all basis points and is not the identity: the printed gap.
    stretch = np.linalg.solve(basis, np.diag(1.0 + np.arange(n + 3)) @ basis).T
    for v in basis:
        assert np.linalg.matrix_rank(np.array([v, stretch @ v]), tol=1e-9) == 1
    assert np.abs(stretch - stretch[0, 0] * np.eye(n + 3)).max() > 0.5
    # In O(n+1, 2) factors obey m_i m_j = 1 wherever the product is not 0. A connected graph
    # with an odd cycle leaves all m_i = 1 or all m_i = -1.
    linked = (np.abs(gram) > 1e-9).astype(float)
    reach = np.linalg.matrix_power(linked + np.eye(n + 3), n + 3)
    assert (reach > 0).all()
    assert np.trace(np.linalg.matrix_power(linked, 3)) > 0  # triangles
    signs = [
        s
        for s in itertools.product([1, -1], repeat=n + 3)
        if all(s[i] * s[j] == 1 for i, j in np.argwhere(linked))
    ]
    assert len(signs) == 2


def test_e24_similarities_fix_the_improper_point_and_scale_tangential_distance():
    k = 1.7
    matrix = np.eye(6)
    matrix[:2, :2] = 0.5 * np.array([[1 / k + k, 1 / k - k], [1 / k - k, 1 / k + k]])
    np.testing.assert_allclose(matrix.T @ LIE @ matrix, LIE, atol=EXACT)
    improper = np.array([1.0, -1, 0, 0, 0, 0])
    np.testing.assert_allclose(matrix @ improper, k * improper, atol=EXACT)
    first, second = np.random.default_rng(24).normal(size=(2, 4))
    for sphere in (first, second):
        image = matrix @ lie_point(sphere)
        np.testing.assert_allclose(image / (image[0] + image[1]), lie_point(k * sphere), atol=EXACT)
    gap, image_gap = first - second, k * (first - second)
    # So Y = lambda T X + B with lambda = k: the printed form keeps this product.
    assert image_gap @ LORENTZ @ image_gap == pytest.approx(k * k * (gap @ LORENTZ @ gap))
    assert lorentz_error(k * np.eye(4)) > 1


# --- E25 to E27: spheres, cones, the penalty ------------------------------------------------

SPHERE = np.array([1.0, 2.0, 3.0, 5.0])


def test_e25_printed_matrix_is_a_euclidean_rotation_and_gives_no_printed_number():
    for t, third, fourth, error in (
        (12.0, 5.2144265, 2.6095510, 0.91),
        (np.radians(12), 1.8948843, 5.5144732, 0.41),
        (0.1, 2.4858454, 5.2745211, 0.199),
    ):
        matrix = plane_rotation(t)
        assert lorentz_error(matrix) == pytest.approx(error, abs=0.006)
        np.testing.assert_allclose(matrix @ SPHERE, [1, 2, third, fourth], atol=1e-6)
    image = plane_rotation(0.1) @ SPHERE  # 0.1 radian alone gives the printed 2.486, 5.275
    np.testing.assert_allclose(image[2:], [2.486, 5.275], atol=5e-4)
    assert SPHERE @ LORENTZ @ SPHERE == -11
    assert image @ LORENTZ @ image == pytest.approx(-16.64, abs=0.01)


def test_e25_corrected_example_is_a_boost():
    for rapidity, third, fourth in (
        (0.1, 3.515846248, 5.325521089),
        (-0.1, 2.514178752, 4.724520591),
    ):
        matrix = boost([0, 0, 1], rapidity)
        image = matrix @ SPHERE
        assert lorentz_error(matrix) < EXACT
        np.testing.assert_allclose(image, [1, 2, third, fourth], atol=1e-9)
        assert image @ LORENTZ @ image == pytest.approx(-11, abs=1e-11)


def test_e25_light_cone_meets_r_zero_in_a_sphere():
    center = boost([0, 0, 1], 0.1) @ SPHERE
    directions = unit(np.random.default_rng(25).normal(size=(50, 3)))
    points = np.column_stack([center[:3] + center[3] * directions, np.zeros(50)])
    gaps = points - center
    assert np.abs(np.einsum("ni,ij,nj->n", gaps, LORENTZ, gaps)).max() < 1e-11
    spread = np.linalg.svd(points[:, :3] - points[:, :3].mean(0), compute_uv=False)
    assert spread[2] > 0.3 * spread[0]  # all of a sphere: a circle would lie in a plane


def folded_star(side):
    """2 x 2 parallelograms about a vertex with angles 100, 70, 90, 100 degrees."""
    w, diagonal = np.radians([100.0, 70.0, 90.0, 100.0]), np.radians(150)

    def corner(to_first, to_third, sign):
        x = np.cos(to_first)
        y = (np.cos(to_third) - np.cos(diagonal) * x) / np.sin(diagonal)
        return [x, y, sign * np.sqrt(1 - x * x - y * y)]

    second, fourth = corner(w[0], w[1], 1), corner(w[3], w[2], side)
    p = np.array([[1, 0, 0], second, [np.cos(diagonal), np.sin(diagonal), 0], fourth])
    points = np.concatenate([np.zeros((1, 3)), p, p + np.roll(p, -1, 0)])
    return QuadMesh.of(points, [[0, 1 + i, 5 + i, 1 + (i + 1) % 4] for i in range(4)])


@pytest.mark.parametrize(("side", "spread"), [(1, 0.0457), (-1, 0.0081)])
def test_e26_angle_sum_two_pi_is_not_conical(side, spread):
    mesh = folded_star(side)
    star = mesh.topology.stars()[0]
    assert star_angles(mesh, star).sum() == pytest.approx(2 * np.pi, abs=EXACT)  # printed: 0
    assert fitted_cones(mesh).spread[0] == pytest.approx(spread, abs=5e-5)
    assert np.degrees(conicality_defect(mesh)[1][0]) == pytest.approx(20.0, abs=1e-9)
    # What the sum does say: the planes touch a cone with alternating orientation.
    normals = mesh.face_normals * np.array([1, -1, 1, -1])[:, None]
    assert np.linalg.svd(normals - normals.mean(0), compute_uv=False)[2] < EXACT


def test_e26_conical_meshes_do_not_have_angle_sum_two_pi():
    mesh, _ = conical_mesh()
    star = mesh.topology.stars()[0]
    defects = 2 * np.pi - star_angles(mesh, star).sum(1)
    assert np.abs(defects).min() > 0.02  # printed penalty: far from 0
    assert np.abs(conicality_defect(mesh)[1]).max() < EXACT  # corrected penalty: 0
    assert fitted_cones(mesh).spread.max() < EXACT


def test_e26_angle_sum_two_pi_belongs_to_faces():
    rng = np.random.default_rng(26)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) + 0.3 * rng.normal(size=(500, 4, 2))
    flat = np.concatenate([corners, np.zeros((500, 4, 1))], -1)
    bent = flat + 0.1 * np.array([1, -1, 1, -1])[:, None] * [0, 0, 1.0]

    def angle_sum(quads):
        before, after = np.roll(quads, 1, 1) - quads, np.roll(quads, -1, 1) - quads
        return angle(before, after).sum(1), cross(after, before)[..., 2]

    total, turning = angle_sum(flat)
    convex = (turning > 0).all(1)
    assert 0 < convex.sum() < 500
    np.testing.assert_allclose(total[convex], 2 * np.pi, atol=EXACT)
    assert total[~convex].max() < 2 * np.pi - 1e-3
    assert angle_sum(bent)[0].max() < 2 * np.pi - 1e-3


def common_planes(first, second, count=720):
    """Unit normals N with N . (p - q) = r - s, sampled over their circle."""
    gap = first[:3] - second[:3]
    level = (first[3] - second[3]) / norm(gap)
    axis = unit(gap)
    e1 = unit(np.cross(axis, [0.3, 0.5, 0.8]))
    phi = 2 * np.pi * np.arange(count)[:, None] / count
    rim = np.cos(phi) * e1 + np.sin(phi) * np.cross(axis, e1)
    return level * axis + np.sqrt(max(0.0, 1 - level**2)) * rim


def test_e27_two_spheres_give_a_cone_only_if_spacelike_and_of_different_radii():
    first = np.array([0.1, 0.2, -0.3, 0.5])
    step = 2.0 * unit(np.array([1.0, 2.0, 2.0]))
    cases = {
        name: first + np.append(step, dr)
        for name, dr in (("cone", 1), ("light", 2), ("cylinder", 0))
    }
    for name, second in cases.items():
        gap = first - second
        assert gap @ LORENTZ @ gap > -EXACT  # every case meets the lemma
        normals = common_planes(first, second)
        levels = normals @ first[:3] - first[3]
        np.testing.assert_allclose(normals @ second[:3] - second[3], levels, atol=EXACT)
        singular = np.linalg.svd(np.column_stack([normals, levels]), compute_uv=False)
        # Planes through one point (the vertex): N . x = h solvable with three independent N.
        solution, _, rank, _ = np.linalg.lstsq(normals, levels, rcond=1e-9)
        meets = np.abs(normals @ solution - levels).max() < EXACT
        if name == "cone":
            assert rank == 3
            assert meets
            np.testing.assert_allclose(solution, first[:3] - first[3] * step, atol=EXACT)
        elif name == "light":
            assert np.count_nonzero(singular > 1e-6) == 1  # one plane, no cone
        else:
            assert rank == 2  # parallel to one direction
            assert not meets


# --- E28 to E30: Laguerre maps of conical meshes --------------------------------------------


def test_e28_linearity_keeps_faces_planar_and_lorentz_keeps_cones():
    mesh, vectors = conical_mesh()
    corners = mesh.topology.indices
    normals = mesh.face_normals[mesh.topology.corner_faces]
    np.testing.assert_allclose(dot(vectors[corners], normals), 1.0, atol=EXACT)
    matrix, shift = sample_map()
    assert lorentz_error(matrix) < EXACT
    image, image_vectors = laguerre(mesh, vectors, matrix, shift)
    planes, levels = image_planes(mesh, matrix, shift)
    turned = planes[mesh.topology.corner_faces]
    np.testing.assert_allclose(norm(planes), 1.0, atol=EXACT)
    found = dot(image.vertices[corners], turned)
    np.testing.assert_allclose(found, levels[mesh.topology.corner_faces], atol=1e-11)
    np.testing.assert_allclose(dot(image_vectors[corners], turned), 1.0, atol=1e-11)
    assert planarity(image).max() < 1e-11
    assert fitted_cones(image).spread.max() < 1e-10
    # A Euclidean rotation is as linear, and passes the printed proof.
    wrong, _ = laguerre(mesh, vectors, plane_rotation(0.1), shift)
    assert planarity(wrong).max() < 1e-11
    assert fitted_cones(wrong).spread.max() > 1e-4
    assert np.abs(conicality_defect(wrong)[1]).max() > 1e-4


def test_e28_a_second_sphere_is_needed_and_any_will_do():
    mesh, vectors = conical_mesh()
    matrix, shift = sample_map()
    image, _ = laguerre(mesh, vectors, matrix, shift)
    point_spheres = np.column_stack([mesh.vertices, np.zeros(len(vectors))]) @ matrix.T + shift
    assert np.abs(point_spheres[:, 3]).max() > 0.1  # images of vertices are no points
    assert norm(point_spheres[:, :3] - image.vertices).max() > 0.1
    for t in (0.5, -2.0):
        spheres = np.column_stack([mesh.vertices + t * vectors, np.full(len(vectors), t)])
        second = spheres @ matrix.T + shift
        ratio = point_spheres[:, 3:] / (point_spheres[:, 3:] - second[:, 3:])
        vertices = point_spheres + ratio * (second - point_spheres)
        np.testing.assert_allclose(vertices[:, :3], image.vertices, atol=1e-11)


def sphere_mesh(radius=2.0):
    """Conical mesh whose faces touch a sphere, its vectors w, and the center of the sphere."""
    phi = 0.4 + 0.3 * np.arange(4)  # contact latitudes: profile edges touch a circle
    half = np.cos(0.15)  # the rotation keeps mid-panel contacts at cos(turn / 2)
    middles = 0.5 * (phi[1:] + phi[:-1])
    q = radius * np.column_stack([np.cos(middles), np.sin(middles)]) / np.cos(0.15)
    mesh, _ = conical_mesh(q / [half, 1.0])
    center = np.array([0.3, -0.2, 0.5])
    return mesh, (mesh.vertices - center) / radius, center


def test_e28_the_vertex_map_may_collapse_or_leave_space():
    mesh, vectors, center = sphere_mesh()
    np.testing.assert_allclose(dot(mesh.face_centers - center, mesh.face_normals), 2.0, atol=EXACT)
    image, _ = laguerre(mesh, vectors, np.eye(4), np.array([0, 0, 0, 2.0]))
    assert np.ptp(image.vertices, axis=0).max() < EXACT  # one point: not injective
    _, w = conical_mesh()
    length = norm(w[6])
    bad = boost(-w[6] / length, np.arctanh(1 / length))
    assert lorentz_error(bad) < 1e-10
    assert abs((bad @ np.append(w[6], 1.0))[3]) < 1e-10  # c' = 0: the vertex goes to infinity


def test_e28_boundary_cones_are_not_determined():
    mesh, _ = conical_mesh()
    for star in mesh.topology.stars(boundary=True):
        for normals in mesh.face_normals[star.faces]:
            assert np.linalg.matrix_rank(normals, tol=1e-9) < 3  # n . w = 1 leaves w free
    inner = mesh.topology.stars()[0]
    for normals in mesh.face_normals[inner.faces]:
        assert np.linalg.matrix_rank(normals, tol=1e-9) == 3


def test_e28_the_map_is_affine_and_not_linear():
    matrix, shift = sample_map()
    x, y = np.random.default_rng(28).normal(size=(2, 4))
    affine = matrix @ (x + y) + shift - (matrix @ x + shift) - (matrix @ y + shift)
    np.testing.assert_allclose(affine, -shift, atol=EXACT)
    assert norm(affine) > 0.1


def touched_sphere(mesh):
    """Best sphere (p, r) with N . p - r = h for all faces, and its residual."""
    rows = np.column_stack([mesh.face_normals, -np.ones(mesh.topology.n_faces)])
    levels = dot(mesh.face_normals, mesh.face_centers)
    solution = np.linalg.lstsq(rows, levels, rcond=None)[0]
    return solution, np.abs(rows @ solution - levels).max()


def test_e29_spheres_go_to_spheres_and_only_general_meshes_gain():
    matrix, shift = sample_map()
    mesh, vectors, center = sphere_mesh()
    image, _ = laguerre(mesh, vectors, matrix, shift)
    sphere, residual = touched_sphere(image)
    assert residual < 1e-11
    expected = matrix @ np.append(center, -2.0) + shift  # outward normals: r = -2
    np.testing.assert_allclose(sphere, expected, atol=1e-9)
    general, w = conical_mesh()
    assert touched_sphere(laguerre(general, w, matrix, shift)[0])[1] > 1e-3


def test_e29_cylinders_of_revolution_go_to_cones_of_revolution():
    matrix, shift = sample_map()
    mesh, vectors = conical_mesh(((2.0, 0.0), (2.0, 0.7), (2.0, 1.5)), turn=0.4)
    axis = frame(3)[:, 2]
    assert np.abs(mesh.face_normals @ axis).max() < EXACT
    image, _ = laguerre(mesh, vectors, matrix, shift)
    line = matrix @ np.append(axis, 0.0)  # direction of the line of touching spheres
    normals = image.face_normals
    np.testing.assert_allclose(normals @ line[:3], line[3], atol=1e-11)
    assert abs(line[3]) > 0.05
    levels = dot(normals, image.face_centers)
    apex = np.linalg.lstsq(normals, levels, rcond=1e-9)[0]
    np.testing.assert_allclose(normals @ apex, levels, atol=1e-10)
    assert np.linalg.matrix_rank(normals, tol=1e-6) == 3


def test_e30_the_offset_is_identity_with_minus_d_in_the_radius():
    mesh, vectors = conical_mesh()
    d = 0.1
    image, _ = laguerre(mesh, vectors, np.eye(4), np.array([0, 0, 0, d]))
    np.testing.assert_allclose(image.vertices, mesh.vertices - d * vectors, atol=EXACT)
    moves = dot(image.face_centers - mesh.face_centers, mesh.face_normals)
    np.testing.assert_allclose(moves, -d, atol=EXACT)
    assert np.abs(moves - d).min() > d  # printed sign
    wanted, _ = laguerre(mesh, vectors, np.eye(4), np.array([0, 0, 0, -d]))
    moves = dot(wanted.face_centers - mesh.face_centers, mesh.face_normals)
    np.testing.assert_allclose(moves, d, atol=EXACT)


# --- E31: Moebius ---------------------------------------------------------------------------


def invert(points, center, radius):
    gap = points - center
    return center + radius**2 * gap / dot(gap, gap)[..., None]


def invert_sphere(p, r, center, radius):
    gap = p - center
    scale = radius**2 / (gap @ gap - r * r)
    return center + scale * gap, abs(scale) * r


def test_e31_inversions_keep_the_angle_of_intersection_and_not_that_of_centers():
    center, radius = np.array([0.2, -1.5, 2.0]), 1.3
    p, r, q, s = np.array([1.0, 0, 0]), 1.0, np.array([0, 0.9, 0.3]), 0.8
    (p1, r1), (q1, s1) = invert_sphere(p, r, center, radius), invert_sphere(q, s, center, radius)
    rim = unit(np.random.default_rng(31).normal(size=(9, 3)))
    np.testing.assert_allclose(norm(invert(p + r * rim, center, radius) - p1), r1, atol=EXACT)

    def cosine(p, r, q, s):
        return (r * r + s * s - (p - q) @ (p - q)) / (2 * r * s)

    assert abs(cosine(p, r, q, s)) < 0.9  # they do intersect
    assert cosine(p1, r1, q1, s1) == pytest.approx(cosine(p, r, q, s), abs=EXACT)
    assert abs(angle(p, q) - angle(p1, q1)) > 0.1  # the angle seen from the origin
    assert abs(norm(p - q) - norm(p1 - q1)) > 0.1


def test_e31_circles_stay_circles_while_face_planes_and_edges_are_not_mapped():
    mesh, _ = conical_mesh()
    center = np.array([0.5, 0.4, -2.5])
    image = mesh.with_vertices(invert(mesh.vertices, center, 1.7))
    assert np.abs(circle_deviation(mesh)).max() < EXACT
    assert np.abs(circle_deviation(image)).max() < 1e-11
    assert planarity(image).max() < 1e-11
    middle = invert(mesh.face_centers, center, 1.7)
    off_plane = dot(middle - image.face_centers, image.face_normals)
    assert np.abs(off_plane).min() > 1e-4  # the image of a face is a piece of a sphere
    start, end = mesh.edges.T
    middle = invert(0.5 * (mesh.vertices[start] + mesh.vertices[end]), center, 1.7)
    off_line = norm(cross(middle - image.vertices[start], unit(image.edge_vectors)))
    assert off_line.min() > 1e-4  # and that of an edge an arc


def test_e31_a_face_circle_through_the_center_of_inversion_is_lost():
    t = np.array([0.3, 1.4, 2.9, 4.4])
    circle = np.column_stack([np.cos(t), np.sin(t), 0 * t])
    image = invert(circle, np.array([1.0, 0.0, 0.0]), 1.0)
    spread = np.linalg.svd(image - image.mean(0), compute_uv=False)
    assert spread[1] < EXACT * spread[0]  # four points of one line: no face
