"""Errata E32-E37: penalties, tracing, the numbers of the case study, and appendix A."""

import numpy as np
import pytest
from numpy.polynomial import polynomial

from pqmesh.mesh.measure import (
    conicality_defect,
    corner_angles,
    fitted_cones,
    planarity,
    planarity_deviation,
    star_angles,
    tetrahedron_volume,
)
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.surface.base import Jet
from pqmesh.surface.curvature import gaussian_curvature, shape_data
from pqmesh.vectors import cross, dot, norm, unit

# Sizes are near 1 and every formula is a few products deep: 1e-12 is 4 digits above rounding.
EXACT = 1e-12
AXES = np.array([3.0, 2.0, 1.2])


def grid_faces(m, n):
    """m x n quads over vertices (i, j) -> i (n + 1) + j."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    first = i * (n + 1) + j
    return np.stack([first, first + n + 1, first + n + 2, first + 1], -1)


# --- E32: the planarity penalty -------------------------------------------------------------


def rough_mesh():
    rng = np.random.default_rng(32)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij"))
    points = np.column_stack([i, j, 0 * i]) + 0.1 * rng.normal(size=(20, 3))
    return QuadMesh.of(points, grid_faces(4, 3))


def test_e32_volumes_belong_to_faces_and_their_sum_of_squares_shrinks_with_the_mesh():
    mesh = rough_mesh()
    volumes = tetrahedron_volume(mesh)
    n_vertices, n_faces = len(mesh.vertices), mesh.topology.n_faces
    assert len(volumes) == n_faces == 12 != n_vertices  # one a face, none for a vertex
    penalty = (volumes**2).sum()
    small = mesh.with_vertices(mesh.vertices / 10)
    assert (tetrahedron_volume(small) ** 2).sum() == pytest.approx(1e-6 * penalty, rel=1e-9)
    np.testing.assert_allclose(planarity(small), planarity(mesh), rtol=1e-9)
    # The sign says at which corner the face starts, and nothing of its orientation.
    np.testing.assert_allclose(tetrahedron_volume(mesh.reversed()), volumes, atol=EXACT)
    shifted = QuadMesh.of(mesh.vertices, np.roll(mesh.topology.quads, 1, axis=1))
    np.testing.assert_allclose(tetrahedron_volume(shifted), -volumes, atol=EXACT)
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    gradient = cross(b - a, c - a) / 6
    step = np.random.default_rng(33).normal(size=d.shape)
    moved = np.einsum("fi,fi->f", b - a, cross(c - a, d + step - a)) / 6
    np.testing.assert_allclose(moved - volumes, dot(gradient, step), atol=EXACT)  # V is linear in d


# --- E33: tracing ---------------------------------------------------------------------------


def ellipsoid_jet(points):
    """Jet at points of the ellipsoid, as a graph over its tangent plane at each point."""
    gradient = 2 * points / AXES**2
    hessian = np.diag(2 / AXES**2)
    normal = unit(gradient)
    helper = np.eye(3)[np.abs(normal).argmin(1)]
    e1 = unit(cross(normal, helper))
    e2 = cross(normal, e1)

    def second(a, b):
        return -np.einsum("ni,ij,nj->n", a, hessian, b)[:, None] / norm(gradient)[:, None] * normal

    return Jet(points, e1, e2, second(e1, e1), second(e1, e2), second(e2, e2))


def confocal(point):
    """The two roots mu <= nu: each is constant along one family of curvature lines."""
    total = (AXES**2).sum() - point @ point
    product = (AXES**2).prod() * (point**2 / AXES**4).sum()
    root = np.sqrt(total**2 / 4 - product)
    return np.array([total / 2 - root, total / 2 + root])


def ellipsoid(s, t):
    """Points by curvature-line parameters."""
    a, b, c = AXES
    k = (a * a - b * b) / (a * a - c * c)
    x = a * np.cos(t) * np.sqrt(np.cos(s) ** 2 + k * np.sin(s) ** 2)
    z = c * np.sin(s) * np.sqrt(np.sin(t) ** 2 + (1 - k) * np.cos(t) ** 2)
    return np.stack([x, b * np.cos(s) * np.sin(t), z], -1)


def to_surface(point):
    """Radial projection."""
    return point / np.sqrt((point**2 / AXES**2).sum())


def direction(point, before, family=0):
    found = shape_data(ellipsoid_jet(to_surface(point)[None])).directions[0, family]
    return found if found @ before >= 0 else -found


def euler_step(point, before, h):
    d = direction(point, before)
    return to_surface(point + h * d), d


def runge_kutta_step(point, before, h):
    k1 = direction(point, before)
    k2 = direction(point + 0.5 * h * k1, k1)
    k3 = direction(point + 0.5 * h * k2, k2)
    k4 = direction(point + h * k3, k3)
    return to_surface(point + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)), k4


def drift(step, count, length=1.6):
    point = ellipsoid(0.4, 0.7)
    start, d = confocal(point), direction(point, np.array([0.1, 0.2, 1.0]))
    for _ in range(count):
        point, d = step(point, d, length / count)
    moves = np.abs(confocal(point) - start)
    assert moves.max() > 0.3  # it went somewhere
    return moves.min()


def test_e33_step_and_projection_drifts_in_first_order():
    for step, order, smallest, largest in (
        (euler_step, 1, 1e-3, 1e-2),
        (runge_kutta_step, 4, 0, 1e-6),
    ):
        coarse, fine = drift(step, 8), drift(step, 16)
        assert np.log2(coarse / fine) == pytest.approx(order, abs=0.1)
        assert smallest <= fine < largest


def test_e33_no_sign_of_the_directions_is_continuous_around_an_umbilic():
    a, b, c = AXES
    k = (a * a - b * b) / (a * a - c * c)
    umbilic = np.array([a * np.sqrt(k), 0.0, c * np.sqrt(1 - k)])
    assert np.ptp(shape_data(ellipsoid_jet(umbilic[None])).k) < 1e-7  # root of rounding
    e1 = unit(np.array([umbilic[2] / c**2, 0.0, -umbilic[0] / a**2]))
    phi = np.linspace(0, 2 * np.pi, 201)
    ring = umbilic + 0.05 * (np.cos(phi)[:, None] * e1 + np.sin(phi)[:, None] * np.eye(3)[1])
    first = carried = direction(ring[0], np.ones(3))
    for point in ring[1:]:
        carried = direction(point, carried)
    assert carried @ first == pytest.approx(-1.0, abs=1e-9)  # index 1/2: it comes back reversed


# --- E34: numbers of the case study ---------------------------------------------------------


def sphere_cap(radius, panel, count):
    """Rotational mesh on a sphere about its equator; panels of the given size."""
    turn = panel / radius
    latitude = turn * (np.arange(count + 1) - count / 2)
    longitude = turn * np.arange(count + 1)
    u, v = (k.ravel() for k in np.meshgrid(longitude, latitude, indexing="ij"))
    points = radius * np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    return QuadMesh.of(points, grid_faces(count, count))


def test_e34_angle_defect_is_total_curvature_and_cannot_vanish():
    mesh = sphere_cap(20.0, 1.5, 8)
    star = mesh.topology.stars()[0]
    defects = 2 * np.pi - star_angles(mesh, star).sum(1)
    assert np.degrees(defects.mean()) == pytest.approx(0.32, abs=0.02)  # 1.5^2 / 20^2 rad
    assert np.degrees(defects.min()) > 300 * 0.001  # far above the printed 0.001
    assert np.abs(conicality_defect(mesh)[1]).max() < EXACT  # yet exactly conical
    assert fitted_cones(mesh).misfit.max() < EXACT
    # Gauss-Bonnet: interior and boundary defects of flat faces add up to 2 pi, bend as they may.
    angles, topology = corner_angles(mesh), mesh.topology
    sums = np.bincount(topology.indices, angles, len(mesh.vertices))
    full = np.where(topology.is_boundary_vertex, np.pi, 2 * np.pi)
    assert (full - sums).sum() == pytest.approx(2 * np.pi, abs=1e-10)


def test_e34_balance_without_planarity_is_not_conical():
    mesh = sphere_cap(20.0, 1.5, 2)
    points = mesh.vertices.copy()
    lifts = 1.3e-3 * np.array([2.0, -1.0, 1.5, 1.0])
    points[[0, 2, 6, 8]] += lifts[:, None] * unit(points[[0, 2, 6, 8]])
    bent = mesh.with_vertices(points)
    # The four corners do not enter the angles at the middle vertex.
    assert abs(conicality_defect(bent)[1][0]) < EXACT
    assert planarity_deviation(bent).max() > 5e-4  # of the size printed, in metres
    assert fitted_cones(mesh).misfit[0] < EXACT
    assert fitted_cones(bent).misfit[0] > 1e-6


# --- E35, E36: the conjugate cubic ----------------------------------------------------------


def coefficients(c1, c2, a10, a01, a20):
    """Table a[i, j] of u^i v^j (the printed relations 1 to 6), shape (4, 4) + vector shape."""
    a = np.zeros((4, 4, *np.shape(a10)))
    a[1, 0], a[0, 1], a[2, 0] = a10, a01, a20
    a[1, 1] = c1 * a[1, 0] + c2 * a[0, 1]
    a[2, 1] = c1 * a[2, 0] + c2 / 2 * a[1, 1]
    a[1, 2] = -c1 / c2 * a[2, 1]
    a[0, 2] = (2 * a[1, 2] - c1 * a[1, 1]) / (2 * c2)
    a[0, 3] = -c1 / (3 * c2) * a[1, 2]
    a[3, 0] = -c2 / (3 * c1) * a[2, 1]
    return a


def cubic(seed=36, c1=0.8, c2=-1.3):
    rng = np.random.default_rng(seed)
    return coefficients(c1, c2, *rng.normal(size=(3, 3))), c1, c2


def cubic_jet(a, u, v):
    def at(du, dv):
        table = polynomial.polyder(polynomial.polyder(a, du, axis=0), dv, axis=1)
        return np.moveaxis(polynomial.polyval2d(u, v, table), 0, -1)

    return Jet(*(at(*k) for k in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))))


def test_e35_corrected_derivative_in_v():
    rng = np.random.default_rng(35)
    a, (u, v) = rng.normal(size=(4, 4)), rng.normal(size=(2, 50))
    a[np.add.outer(range(4), range(4)) > 3] = 0.0  # degree three, any coefficients
    true = polynomial.polyval2d(u, v, polynomial.polyder(a, axis=1))
    shared = a[0, 1] + 2 * a[1, 2] * u * v + a[2, 1] * u**2 + 3 * a[0, 3] * v**2
    corrected = shared + 2 * a[0, 2] * v + a[1, 1] * u
    printed = shared + a[0, 2] * v + 2 * a[1, 1] * u
    np.testing.assert_allclose(corrected, true, atol=1e-11)
    assert np.abs(printed - true).max() > 0.5


def test_e35_the_relations_and_the_printed_example_are_right():
    (a, c1, c2), (u, v) = cubic(), np.random.default_rng(35).normal(size=(2, 50))
    jet = cubic_jet(a, u, v)
    np.testing.assert_allclose(jet.duv, c1 * jet.du + c2 * jet.dv, atol=1e-11)
    example = coefficients(1.0, 1.0, *np.eye(3))
    tail = u * u * v - u * v * v - u**3 / 3 + v**3 / 3
    printed = [
        u + u * v - v * v + tail / 2,
        v + u * v - v * v + tail / 2,
        u * u - v * v + tail,
    ]
    np.testing.assert_allclose(cubic_jet(example, u, v).point, np.column_stack(printed), atol=1e-11)


def conjugacy_residual(a, c1, c2):
    """Coefficients of X_uv - c1 X_u - c2 X_v for a (4, 4) table of scalars."""
    total = np.zeros((4, 4))
    du, dv = polynomial.polyder(a, axis=0), polynomial.polyder(a, axis=1)
    for factor, part in ((1.0, polynomial.polyder(du, axis=1)), (-c1, du), (-c2, dv)):
        total[: part.shape[0], : part.shape[1]] += factor * part
    return total.ravel()


def conjugate_solutions(c1, c2):
    """Scalar cubics without constant term that satisfy X_uv = c1 X_u + c2 X_v: null space."""
    powers = [(i, j) for i in range(4) for j in range(4 - i) if i + j]
    rows = []
    for i, j in powers:
        a = np.zeros((4, 4))
        a[i, j] = 1.0
        rows.append(conjugacy_residual(a, c1, c2))
    _, s, vt = np.linalg.svd(np.array(rows).T)
    return powers, vt[np.count_nonzero(s > 1e-9) :]


def test_e36_both_factors_must_be_nonzero():
    assert len(conjugate_solutions(0.8, -1.3)[1]) == 3  # a10, a01, a20
    powers, curves = conjugate_solutions(0.8, 0.0)
    assert len(curves) == 3
    with_u = [k for k, (i, _) in enumerate(powers) if i]
    assert np.abs(curves[:, with_u]).max() < EXACT  # no u at all: only curves
    powers, sums = conjugate_solutions(0.0, 0.0)
    assert len(sums) == 6
    mixed = [k for k, (i, j) in enumerate(powers) if i and j]
    assert np.abs(sums[:, mixed]).max() < EXACT  # f(u) + g(v)


def test_e36_every_such_surface_is_a_regular_saddle():
    u, v = np.random.default_rng(37).uniform(-3, 3, (2, 2000))
    for seed in range(5):
        a, c1, c2 = cubic(seed)
        det = np.linalg.det([a[1, 0], a[0, 1], a[2, 0]])
        jet = cubic_jet(a, u, v)
        area = norm(cross(jet.du, jet.dv))
        expected = -4 * (c1 / c2 * det) ** 2 / area**4
        np.testing.assert_allclose(gaussian_curvature(jet), expected, rtol=1e-6)
        assert gaussian_curvature(jet).max() < 0  # never a dome
        # Why it is regular: X_uu . (X_u x X_v) is one constant, so X_u x X_v is never 0.
        height = dot(jet.duu, cross(jet.du, jet.dv))
        np.testing.assert_allclose(height, 2 * det, rtol=1e-6, atol=1e-9)


def test_e36_parameter_cells_have_constant_volume_and_are_flat_for_one_ratio_only():
    a, c1, c2 = cubic()
    det = np.linalg.det([a[1, 0], a[0, 1], a[2, 0]])
    for h, k in ((0.3, 0.2), (0.5, 0.5), (0.4, 0.4 * abs(c2 / c1))):
        i, j = np.meshgrid(np.arange(5), np.arange(4), indexing="ij")
        points = cubic_jet(a, h * i.ravel() - 0.4, k * j.ravel() - 0.6).point
        mesh = QuadMesh.of(points, grid_faces(4, 3))
        law = -c1 / (6 * c2) * h**2 * k**2 * (c1**2 * k**2 - c2**2 * h**2) * det
        np.testing.assert_allclose(6 * tetrahedron_volume(mesh), law, atol=EXACT)
        is_flat = planarity_deviation(mesh).max() < EXACT
        assert is_flat == (abs(h * abs(c2) - k * abs(c1)) < EXACT)


# --- E37: the summary -----------------------------------------------------------------------


def curvature_net(h):
    i, j = (k.ravel() for k in np.meshgrid(np.arange(-1, 2), np.arange(-1, 2), indexing="ij"))
    return QuadMesh.of(ellipsoid(0.7 + h * i, 0.9 + h * j), grid_faces(2, 2))


def circle_residual(mesh):
    """Distance of the fourth corner from the circle of the first three, over the diagonal."""
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    ab, ac, n = b - a, c - a, cross(b - a, c - a)
    arm = cross(n, ab) * dot(ac, ac)[:, None] + cross(ac, n) * dot(ab, ab)[:, None]
    arm /= 2 * dot(n, n)[:, None]
    return (np.abs(norm(d - a - arm) - norm(arm)) / norm(ac)).max()


def test_e37_sampled_curvature_lines_approach_a_conical_mesh_but_are_none():
    def errors(mesh):
        balance = np.abs(conicality_defect(mesh)[1][0])
        cones = fitted_cones(mesh)
        return np.array([balance, cones.spread[0], cones.misfit[0], circle_residual(mesh)])

    coarse, fine = errors(curvature_net(0.04)), errors(curvature_net(0.02))
    np.testing.assert_allclose(np.log2(coarse / fine), [2, 3, 4, 2], atol=0.1)
    assert fine[0] > 1e-4  # rad: no face offset without optimising first
    assert fine[2] > 1e-9
