"""Conical meshes: exact families, the angle theorem with its limits, and what an error costs."""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq
from shapes import cyclide, random_rotation, sampled, torus, vertex_fan

from pqmesh.mesh import solids
from pqmesh.mesh.exact import (
    grid_mesh,
    mirror_plane_mesh,
    rotational_mesh,
    tangent_plane_mesh,
)
from pqmesh.mesh.measure import (
    circularity_defect,
    conicality_defect,
    fitted_cones,
    nonconvex_faces,
    planarity,
    star_angles,
)
from pqmesh.mesh.planes import face_planes, mesh_from_planes, plane_meetings

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def balance(mesh):
    return np.abs(conicality_defect(mesh)[1])


def assert_conical(mesh, tolerance):
    """Planar, balanced, and one oriented cone at every interior vertex."""
    cones = fitted_cones(mesh)
    assert len(cones.vertices) > 0
    assert planarity(mesh).max() < tolerance
    assert cones.misfit.max() < tolerance
    assert cones.relative_spread.max() < 10 * tolerance
    if len(balance(mesh)):
        assert balance(mesh).max() < 10 * tolerance


# --- oracles 21, 22: rotation -----------------------------------------------------------------


def offset_profile(profile, step, distance):
    """Closed form of the profile of the face offset of a rotational mesh, outward."""
    q = profile * [np.cos(step / 2), 1.0]
    along = np.diff(q, axis=0)
    m = np.column_stack([along[:, 1], -along[:, 0]])
    m /= np.linalg.norm(m, axis=1)[:, None]
    inner = (m[:-1] + m[1:]) / (1 + (m[:-1] * m[1:]).sum(axis=1))[:, None]
    w = np.vstack([m[:1], inner, m[-1:]])
    return (q + distance * w) / [np.cos(step / 2), 1.0]


def test_offset_profile_has_published_values():
    found = offset_profile(np.array([[2, 0], [2.4, 0.5], [2.5, 1.2]]), 0.3, 0.1)
    golden = [
        [2.079320057, -0.062038961],
        [2.496310999, 0.459199717],
        [2.600141546, 1.186013542],
    ]
    # The digits of the oracle.
    assert np.abs(found - golden).max() < 5e-10


def test_rotational_mesh_with_equal_steps_is_conical():
    for step in (0.3, 2 * np.pi / 5):
        # 1e-12: a few roundings, over angles between normals of 20 degrees.
        assert_conical(rotational_mesh(PROFILE, step * np.arange(5)), 1e-12)


@pytest.mark.parametrize("distance", [0.1, -0.2])
def test_cone_vectors_of_rotational_mesh_are_those_of_the_closed_face_offset(distance):
    step = 0.3
    mesh = rotational_mesh(PROFILE, step * np.arange(6))
    offset = rotational_mesh(offset_profile(PROFILE, step, distance), step * np.arange(6))
    cones = fitted_cones(mesh)
    moves = (offset.vertices - mesh.vertices)[cones.vertices]
    # Least squares with four normals 20 degrees apart: rounding times ten.
    assert np.abs(distance * cones.vectors - moves).max() < 1e-13
    # Every face moves by the distance along its normal, every edge stays parallel.
    shift = np.einsum("fki,fi->fk", offset.corners - mesh.corners, mesh.face_normals)
    assert np.abs(shift - distance).max() < 1e-13
    turned = np.cross(mesh.edge_vectors, offset.edge_vectors)
    assert np.abs(turned).max() < 1e-13
    # It is an offset of faces only: vertices and edges move by different distances.
    assert np.ptp(np.linalg.norm(offset.vertices - mesh.vertices, axis=1)) > 1e-3 * abs(distance)


def test_golden_offset_follows_from_fitted_cones():
    mesh = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(3))
    cones = fitted_cones(mesh)
    assert cones.vertices.tolist() == [4]
    x, y, z = mesh.vertices[4] + 0.1 * cones.vectors[0]
    assert np.isclose(np.hypot(x, y), 2.496310999, rtol=0, atol=5e-10)
    assert np.isclose(z, 0.459199717, rtol=0, atol=5e-10)


def test_planes_shifted_by_a_distance_meet_in_the_face_offset():
    mesh = rotational_mesh(PROFILE, 0.3 * np.arange(6))
    shifted = face_planes(mesh) + np.array([0, 0, 0, 0.1])
    found = mesh_from_planes(mesh, shifted)
    cones = fitted_cones(mesh)
    wanted = mesh.vertices[cones.vertices] + 0.1 * cones.vectors
    assert np.abs(found.vertices[cones.vertices] - wanted).max() < 1e-13


def test_rotational_hyperboloid_has_conical_saddle_vertices():
    z = np.array([-0.8, -0.5, -0.1, 0.2, 0.7])
    mesh = rotational_mesh(np.column_stack([np.sqrt(1 + z * z), z]), 0.4 * np.arange(6))
    assert_conical(mesh, 1e-12)
    (star,) = mesh.topology.stars()
    spokes = mesh.vertices[star.neighbors] - mesh.vertices[star.vertices][:, None]
    turn = np.linalg.det(
        np.stack([np.roll(spokes, 1, axis=1), spokes, np.roll(spokes, -1, axis=1)], axis=2)
    )
    signs = np.sign(turn)
    assert (signs[:, 0] == -signs[:, 1]).all()
    assert (signs[:, :2] == signs[:, 2:]).all()
    # The angle defect of a saddle is negative: the sum exceeds 2 pi.
    assert (star_angles(mesh, star).sum(axis=1) > 2 * np.pi).all()


# --- oracles 23, 24: planes -------------------------------------------------------------------


def test_mirror_plane_mesh_is_conical_for_any_strip_and_mirrors():
    rng = np.random.default_rng(0)
    z = np.cumsum(rng.uniform(0.2, 0.5, 6)) - 1
    strip = np.column_stack([np.ones(6), np.full(6, 0.1), z, 2 + 0.2 * z * z])
    turns = np.cumsum(rng.uniform(0.15, 0.4, 5))
    mirrors = np.column_stack([-np.sin(turns), np.cos(turns), 0.05 * rng.normal(size=(5, 2))])
    mesh = mirror_plane_mesh(strip, mirrors)
    assert mesh.topology.n_faces == 4 * 4
    assert len(nonconvex_faces(mesh)) == 0
    # Intersections of planes 20 degrees apart.
    assert_conical(mesh, 1e-10)
    # The mirrors share no line, so this is not a rotational mesh.
    axes = np.linalg.svd(mirrors / np.linalg.norm(mirrors[:, :3], axis=1)[:, None])[1]
    assert axes[3] > 1e-3


def test_blocks_of_reflected_planes_are_concurrent():
    rng = np.random.default_rng(1)
    strip = rng.normal(size=(5, 4))
    strip /= np.linalg.norm(strip[:, :3], axis=1)[:, None]
    mirror = rng.normal(size=4)
    mirror /= np.linalg.norm(mirror[:3])
    image = strip - 2 * (strip[:, :3] @ mirror[:3])[:, None] * mirror
    blocks = np.stack([strip[:-1], strip[1:], image[1:], image[:-1]], axis=1)
    found = plane_meetings(blocks)
    assert (found.misfit < 1e-13 * found.condition).all()
    # The meeting point lies in the mirror.
    assert (np.abs(found.points @ mirror[:3] - mirror[3]) < 1e-13 * found.condition**2).all()


def tangent_planes(formula, u, v):
    point, normal = sampled(formula, u, v)[:2]
    return np.concatenate([normal, (point * normal).sum(axis=-1, keepdims=True)], axis=-1)


@pytest.mark.parametrize("formula", [torus, cyclide], ids=["torus", "cyclide"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_tangent_planes_at_any_curvature_parameters_span_a_conical_mesh(formula, seed):
    rng = np.random.default_rng(seed)
    # Away from the parallel circles where the planes of a block pass through one direction.
    u, v = 0.2 + np.cumsum(rng.uniform(0.1, 0.3, 8)), -1.2 + np.cumsum(rng.uniform(0.1, 0.3, 8))
    planes = tangent_planes(formula, u, v)
    blocks = np.stack([planes[:-1, :-1], planes[1:, :-1], planes[1:, 1:], planes[:-1, 1:]], axis=2)
    assert plane_meetings(blocks.reshape(-1, 4, 4)).misfit.max() < 1e-11
    # Rounding over the square of the angles between planes, some 5 degrees: 1e-11.
    assert_conical(tangent_plane_mesh(planes), 1e-11)


def test_tangent_planes_off_the_curvature_lines_are_not_concurrent():
    s, t = np.meshgrid(0.2 * np.arange(6), -1.0 + 0.2 * np.arange(6), indexing="ij")
    point, normal = torus(s + 0.4 * t, t - 0.3 * s)
    heights = (point * normal).sum(axis=-1, keepdims=True)
    mesh = tangent_plane_mesh(np.concatenate([normal, heights], axis=-1))
    assert planarity(mesh).max() > 1e-4
    assert fitted_cones(mesh).relative_spread.max() > 1e-3


# --- oracle 26: around a sphere ---------------------------------------------------------------

SOLIDS = {
    "cube": solids.cube(),
    "rhombic_dodecahedron": solids.rhombic_dodecahedron(),
    "deltoidal_icositetrahedron": solids.deltoidal_icositetrahedron(),
    "rhombic_triacontahedron": solids.rhombic_triacontahedron(),
    "deltoidal_hexecontahedron": solids.deltoidal_hexecontahedron(),
    "trapezohedron_7": solids.trapezohedron(7),
}


@pytest.mark.parametrize("name", sorted(SOLIDS))
@pytest.mark.parametrize(("radius", "distance"), [(1.0, 0.3), (2.5, -1.0)])
def test_mesh_around_a_sphere_is_conical_and_its_face_offset_is_a_scaling(name, radius, distance):
    mesh = SOLIDS[name]
    rng = np.random.default_rng(3)
    center = rng.normal(size=3)
    mesh = mesh.with_vertices(center + radius * mesh.vertices @ random_rotation(rng).T)
    assert_conical(mesh, 1e-13)
    cones = fitted_cones(mesh)
    # The axis runs through the center: w is the vertex seen from it, over the radius.
    wanted = (mesh.vertices - center) / radius
    assert np.abs(cones.vectors - wanted).max() < 1e-13
    offset = mesh_from_planes(mesh, face_planes(mesh) + np.array([0, 0, 0, distance]))
    scaled = center + (1 + distance / radius) * (mesh.vertices - center)
    assert np.abs(offset.vertices - scaled).max() < 1e-12
    # By minus the radius everything collapses to the center.
    point = mesh_from_planes(mesh, face_planes(mesh) + np.array([0, 0, 0, -radius]))
    assert np.abs(point.vertices - center).max() < 1e-12


def test_vertices_of_valence_three_are_always_conical():
    rng = np.random.default_rng(4)
    for _ in range(100):
        cones = fitted_cones(vertex_fan(rng.normal(size=(3, 3))))
        # Three normals always have a common w; rounding times their condition.
        assert cones.misfit[0] < 1e-14 * np.linalg.norm(cones.vectors[0]) ** 2 + 1e-13


# --- oracles 27, 28: the angle theorem and its classes ----------------------------------------

IDENTITIES = {
    "++++": (1, -1, 1, -1, 0),
    "+-+-": (1, 1, 1, 1, -2 * np.pi),
    "+--+": (1, 1, -1, -1, 0),
    "++--": (-1, 1, 1, -1, 0),
}


def random_cone_vertices(count, seed):
    """Edges of vertices whose planes touch a cone: for each, the class of orientations."""
    rng = np.random.default_rng(seed)
    while count > 0:
        phi, psi = rng.uniform(0, 2 * np.pi, 4), rng.uniform(0.1, 1.5)
        s, c = np.sin(psi), np.cos(psi)
        n = np.column_stack([s * np.cos(phi), s * np.sin(phi), np.full(4, c)])
        gaps = np.abs(np.subtract.outer(phi, phi)[np.triu_indices(4, 1)])
        if np.minimum(gaps, 2 * np.pi - gaps).min() < 0.1:
            continue
        count -= 1
        for signs in itertools.product((1, -1), repeat=3):
            p = np.cross(np.roll(n, 1, axis=0), n) * np.array([1, *signs])[:, None]
            p /= np.linalg.norm(p, axis=1)[:, None]
            face = np.sign((np.cross(p, np.roll(p, -1, axis=0)) * n).sum(axis=1))
            face = (face * face[0]).astype(int)
            yield p, "".join("+" if x > 0 else "-" for x in face)


def turn_signs(p):
    return np.sign(np.linalg.det(np.stack([np.roll(p, 1, axis=0), p, np.roll(p, -1, axis=0)], 1)))


def angles_of(p):
    q = np.roll(p, -1, axis=0)
    return np.arctan2(np.linalg.norm(np.cross(p, q), axis=1), (p * q).sum(axis=1))


def test_each_class_of_orientations_has_its_own_angle_identity():
    seen = dict.fromkeys(IDENTITIES, 0)
    types = set()
    for p, face_class in random_cone_vertices(400, 5):
        # An odd number of turned planes would force a flat vertex.
        assert face_class in IDENTITIES
        omega = angles_of(p)
        residuals = {k: abs(omega @ row[:4] + row[4]) for k, row in IDENTITIES.items()}
        # Angles between edges at least 0.1 rad apart: 1e-9 leaves room for flat crossings.
        assert residuals.pop(face_class) < 1e-9
        seen[face_class] += 1
        if face_class != "++++":
            assert residuals["++++"] > 1e-9
            continue
        positive = int((turn_signs(p) > 0).sum())
        kind = {4: "convex", 0: "convex", 3: "3:1", 1: "3:1"}.get(positive)
        if kind is None:
            signs = turn_signs(p)
            kind = "saddle" if signs[0] == signs[2] else "2:2"
        types.add(kind)
    assert min(seen.values()) > 100
    # Elliptic, saddle and crossed vertices occur; two against two neighbours never.
    assert types == {"convex", "saddle", "3:1"}


def test_only_the_oriented_class_counts_as_conical():
    for p, face_class in itertools.islice(random_cone_vertices(60, 6), 480):
        mesh = vertex_fan(p)
        misfit = fitted_cones(mesh).misfit[0]
        if face_class == "++++":
            # The condition grows as edges come near a common plane.
            cond = np.linalg.cond(mesh.face_normals)
            assert misfit < 1e-14 * cond**2
            assert balance(mesh)[0] < 1e-9
        else:
            # The same planes, one turned over: no face distance is common to them.
            assert misfit > 1e-3


def four_bar(side):
    """Directions at (100, 70, 90, 100) degrees, 150 between the first and the third.

    The second and the fourth lie on one side of their plane (+1) or on two (-1).
    """
    w1, w2, w3, w4, d = np.radians([100, 70, 90, 100, 150])
    p1, p3 = np.array([0, 0, 1.0]), np.array([np.sin(d), 0, np.cos(d)])

    def between(to_first, to_third, side):
        z = np.cos(to_first)
        x = (np.cos(to_third) - z * np.cos(d)) / np.sin(d)
        return np.array([x, side * np.sqrt(1 - x * x - z * z), z])

    return np.array([p1, between(w1, w2, 1), p3, between(w4, w3, side)])


@pytest.mark.parametrize(("side", "spread"), [(1, 0.0457), (-1, 0.0081)])
def test_angle_sum_of_360_degrees_is_not_conical(side, spread):
    p = four_bar(side)
    assert np.allclose(np.degrees(angles_of(p)), [100, 70, 90, 100], atol=1e-12)
    mesh = vertex_fan(p)
    cones = fitted_cones(mesh)
    # Digits: of the oracle for the first, of the same construction for the second.
    assert np.isclose(cones.spread[0], spread, rtol=0, atol=5e-5)
    assert np.isclose(np.degrees(balance(mesh)[0]), 20)
    assert cones.misfit[0] > 1e-3
    # With every second plane turned over they touch one cone: the developable class.
    turned = mesh.face_normals * np.array([1, -1, 1, -1])[:, None]
    w = np.linalg.lstsq(turned, np.ones(4), rcond=None)[0]
    assert np.abs(turned @ w - 1).max() < 1e-13


# --- oracles 29, 30, 31: what the angles do not see --------------------------------------------


def test_flat_vertex_is_conical_with_any_angles():
    t = np.array([0, 1.2, 2.9, 4.0])
    mesh = vertex_fan(np.column_stack([np.cos(t), np.sin(t), 0 * t]))
    cones = fitted_cones(mesh)
    assert cones.misfit[0] < 1e-15
    assert cones.relative_spread[0] == 0
    assert cones.is_flat.tolist() == [True]
    assert np.allclose(cones.vectors[0], [0, 0, 1], atol=1e-15)
    assert balance(mesh)[0] > 1


def flat_edge_vertex(turn):
    """Four edges whose first and last faces are coplanar; edge 0 in that plane at an angle."""
    a, b, c = np.array([1.0, -0.2, -0.5]), np.array([-0.6, 0.9, -0.4]), np.array([-0.5, -1, -0.3])
    along = (a + c) / np.linalg.norm(a + c)
    across = a - (a @ along) * along
    across /= np.linalg.norm(across)
    return np.array([np.cos(turn) * along + np.sin(turn) * across, a, b, c])


def test_flat_edge_is_always_conical_and_balances_only_along_the_generator():
    def signed(turn):
        return float(conicality_defect(vertex_fan(flat_edge_vertex(turn)))[1][0])

    turns = np.linspace(-0.4, 0.4, 9)
    for turn in turns:
        cones = fitted_cones(vertex_fan(flat_edge_vertex(turn)))
        assert cones.misfit[0] < 1e-13
        assert cones.relative_spread[0] < 1e-12
    values = [signed(turn) for turn in turns]
    assert np.abs(values).max() > 0.1
    balanced = brentq(signed, -0.8, 0.8, xtol=1e-14)
    # The generator: the line of the plane nearest to the axis, its projection.
    mesh = vertex_fan(flat_edge_vertex(balanced))
    n, w = mesh.face_normals[0], fitted_cones(mesh).vectors[0]
    generator = w - (n @ w) * n
    edge = flat_edge_vertex(balanced)[0]
    assert np.linalg.norm(np.cross(generator, edge)) < 1e-11 * np.linalg.norm(generator)


def test_sheared_cylinder_has_cones_without_balance():
    phi, z = np.array([0, 0.4, 0.9, 1.3, 1.9]), np.array([0, 0.2, 0.1, 0.4, 0.3])
    k = np.arange(5)
    points = np.stack(
        [
            np.cos(phi)[:, None] + 0.0 * k,
            np.sin(phi)[:, None] + 0.0 * k,
            z[:, None] + k / 2,
        ],
        axis=-1,
    )
    mesh = grid_mesh(points)
    cones = fitted_cones(mesh)
    assert planarity(mesh).max() < 1e-14
    assert cones.misfit.max() < 1e-12
    assert cones.relative_spread.max() < 1e-12
    assert np.isclose(balance(mesh).max(), 0.958, atol=5e-4)


def test_vertex_of_valence_six_may_balance_without_a_cone():
    t = np.arange(6) * np.pi / 3 + np.array([0.0, 0.2, -0.1, 0.15, 0.05, -0.2])

    def spokes(height):
        z = np.array([-0.3, -0.5, -0.2, height, -0.45, -0.25])
        return np.column_stack([np.cos(t), np.sin(t), z])

    def alternating(height):
        return float(angles_of(unit_rows(spokes(height))) @ [1, -1, 1, -1, 1, -1])

    heights = np.linspace(-3, 2, 101)
    values = np.array([alternating(h) for h in heights])
    k = int(np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[0])
    height = brentq(alternating, heights[k], heights[k + 1], xtol=1e-14)
    assert abs(alternating(height)) < 1e-12
    mesh = vertex_fan(spokes(height))
    assert mesh.topology.irregular_vertices.tolist() == [0]
    assert fitted_cones(mesh).spread[0] > 1e-3


def unit_rows(p):
    return p / np.linalg.norm(p, axis=1)[:, None]


# --- oracle 34: the cost of an imbalance ------------------------------------------------------


def test_imbalance_law_of_nearly_flat_vertices():
    rng = np.random.default_rng(7)
    spread, misfit = [], []
    while len(spread) < 400:
        # Tangent directions near a cross, heights of a nearly flat vertex, edges perturbed.
        t = np.arange(4) * np.pi / 2 + rng.uniform(-0.3, 0.3, 4)
        k1, k2 = rng.uniform(0.02, 0.1, 2) * rng.choice([-1, 1], 2)
        height = k1 * np.cos(t) ** 2 + k2 * np.sin(t) ** 2
        mesh = vertex_fan(np.column_stack([np.cos(t), np.sin(t), height]))
        cones, a = fitted_cones(mesh), balance(mesh)[0]
        spread.append(cones.spread[0] / (cones.theta[0] * a / 4))
        misfit.append(cones.misfit[0] / (cones.theta[0] ** 2 * a / 8))
    assert np.median(spread) == pytest.approx(1.0, abs=0.25)
    assert np.median(misfit) == pytest.approx(1.0, abs=0.25)


def test_conical_is_not_circular_nor_the_reverse():
    cone_like = tangent_plane_mesh(
        tangent_planes(cyclide, 0.3 + 0.2 * np.arange(6), -1.0 + 0.25 * np.arange(6))
    )
    assert np.abs(circularity_defect(cone_like)).max() > 1e-3
    u, v = np.array([0.2, 0.5, 1.1, 1.3]), np.array([0.4, 0.6, 1.2, 2.0])
    assert balance(grid_mesh(sampled(cyclide, u, v)[0])).max() > 1e-3
