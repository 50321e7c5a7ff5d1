"""Chapter 5, statement by statement: the Lie quadric, its group, Laguerre and Moebius subgroups."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_samples import cyclide_mesh, planes, rotational, spheres, torus_mesh

from pqmesh.mesh.exact import contact_element_mesh, mirror_plane_mesh, stereographic_mesh
from pqmesh.mesh.measure import conicality_defect, fitted_cones, planarity
from pqmesh.mesh.planes import face_planes
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.transform.conical import rapidity_range
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.lie import (
    IMPROPER_POINT,
    LIE,
    LORENTZ,
    LieTransform,
    is_in_contact,
    is_plane,
    lie_coordinates,
    lie_coordinates_of_planes,
    lie_product,
    lorentz_product,
    planes_of,
    spheres_of,
    tangential_distance,
)
from pqmesh.transform.moebius import MoebiusTransform
from pqmesh.vectors import dot, norm, unit

# Sizes are near 1, formulas a few products deep.
EXACT = 1e-12
seeds = st.integers(0, 2**32 - 1)
random_cases = settings(deadline=None, derandomize=True, max_examples=60)


def generator(seed):
    return np.random.default_rng(seed)


def plane_rotation(angle):
    """The kind of matrix printed in section 5.3: a Euclidean rotation of (x3, x4)."""
    matrix = np.eye(4)
    matrix[2:, 2:] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return matrix


# --- section 5.1 ----------------------------------------------------------------------------


@random_cases
@given(seeds)
def test_definition_5_1_1_lightlike_vectors_are_spheres_planes_and_the_improper_point(
    seed,
):
    rng = generator(seed)
    ball, wall = spheres(rng), planes(rng)
    x, y = lie_coordinates(ball), lie_coordinates_of_planes(wall)
    size = 1 + norm(ball[:, :3]) ** 2 + ball[:, 3] ** 2
    assert (np.abs(lie_product(x, x)) < EXACT * size**2).all()
    assert (np.abs(lie_product(y, y)) < EXACT * (1 + wall[:, 3] ** 2)).all()
    assert not is_plane(x).any()
    assert is_plane(y).all()
    scale = rng.uniform(0.5, 2.0, len(x))[:, None] * rng.choice([-1.0, 1.0], (len(x), 1))
    np.testing.assert_allclose(spheres_of(scale * x), ball, atol=EXACT * 10)
    np.testing.assert_allclose(planes_of(scale * y), wall, atol=EXACT)
    products = lie_product(x, y)
    wanted = dot(wall[:, :3], ball[:, :3]) - wall[:, 3] - ball[:, 3]
    np.testing.assert_allclose(products, wanted, atol=EXACT * 20)
    # The improper point touches all planes and no sphere.
    assert (lie_product(y, IMPROPER_POINT) == 0).all()
    np.testing.assert_allclose(lie_product(x, IMPROPER_POINT), -1.0, atol=1e-9)


def test_printed_sphere_has_the_published_coordinates():
    assert lie_coordinates([[1, 2, 3, 5]]).tolist() == [[-5, 6, 1, 2, 3, 5]]


@random_cases
@given(seeds)
def test_oriented_spheres_touch_exactly_when_centers_are_apart_by_the_difference_of_radii(seed):
    rng = generator(seed)
    first = spheres(rng)
    step = rng.normal(size=len(first))
    touching = first + np.column_stack([step[:, None] * unit(rng.normal(size=(50, 3))), step])
    x, y = lie_coordinates(first), lie_coordinates(touching)
    assert is_in_contact(x, y).all()
    assert tangential_distance(first, touching) == pytest.approx(0.0, abs=1e-6)
    # Turned over, one of them touches no more.
    turned = touching * [1, 1, 1, -1]
    apart = np.abs(step * (touching[:, 3] + first[:, 3])) > 0.05
    clear = apart & (
        np.abs(norm(first[:, :3] - turned[:, :3]) - np.abs(first[:, 3] - turned[:, 3])) > 0.05
    )
    assert not is_in_contact(x, lie_coordinates(turned), 1e-6)[clear].any()


# --- theorem 5.2.1 --------------------------------------------------------------------------


@random_cases
@given(seeds, st.integers(2, 6), st.data())
def test_theorem_5_2_1_maps_that_keep_lightlike_vectors_keep_the_product_up_to_a_factor(
    seed, n, data
):
    k = data.draw(st.integers(1, n - 1))
    rng = generator(seed)
    metric = np.diag([-1.0] * k + [1.0] * (n - k))
    # Any map that keeps lightlike vectors: a multiple of a product of reflections, and where the
    # signature is equal, the exchange of its halves.
    matrix = rng.uniform(0.5, 2.0) * np.eye(n)
    for _ in range(3):
        v = rng.normal(size=n)
        v[0 if rng.random() < 0.5 else -1] += 3.0
        matrix = matrix @ (np.eye(n) - 2.0 / (v @ metric @ v) * np.outer(v, metric @ v))
    swapped = 2 * k == n and rng.random() < 0.5
    if swapped:
        matrix = matrix @ np.roll(np.eye(n), k, axis=0)
    light = np.concatenate([unit(rng.normal(size=(40, k))), unit(rng.normal(size=(40, n - k)))], 1)
    images = light @ matrix.T
    slack = 1e-10 * np.abs(matrix).max() ** 2
    assert np.abs(np.einsum("mi,ij,mj->m", images, metric, images)).max() < slack
    carried = matrix.T @ metric @ matrix
    factor = carried[0, 0] / metric[0, 0]
    assert abs(factor) > 0.1
    assert np.abs(carried - factor * metric).max() < slack
    assert (factor > 0) == (not swapped)
    # (2): for k other than n - k the factor is positive.
    assert factor > 0 or 2 * k == n


@random_cases
@given(seeds, st.integers(2, 5))
def test_theorem_5_2_1_the_product_follows_from_lightlike_vectors_alone(seed, n):
    # Forms that vanish on all lightlike vectors are multiples of the metric: the linear system
    # q(x, x) = 0 over many lightlike x has a solution space of dimension one.
    rng = generator(seed)
    for k in range(1, n):
        light = np.concatenate(
            [unit(rng.normal(size=(60, k))), unit(rng.normal(size=(60, n - k)))], axis=1
        )
        pairs = list(itertools.combinations_with_replacement(range(n), 2))
        rows = np.stack([light[:, i] * light[:, j] for i, j in pairs], axis=1)
        values = np.linalg.svd(rows, compute_uv=False)
        assert (values > 1e-8 * values[0]).sum() == len(pairs) - 1


# --- corollary 5.2.2 ------------------------------------------------------------------------


@random_cases
@given(seeds)
def test_corollary_5_2_2_lie_transformations_are_the_matrices_of_signature_4_2_up_to_sign(seed):
    rng = generator(seed)
    first, second = LieTransform.random(rng), LieTransform.random(rng)
    x, y = lie_coordinates(spheres(rng)), lie_coordinates_of_planes(planes(rng))
    size = np.abs(first.matrix).max() ** 2 * norm(x) * norm(y)
    kept = lie_product(first.on(x), first.on(y)) - lie_product(x, y)
    assert (np.abs(kept) < EXACT * size).all()
    # The group: products, inverses, and A = -A.
    both = first @ second
    np.testing.assert_allclose(
        both.on(x), first.on(second.on(x)), rtol=1e-9, atol=1e-9 * size.max()
    )
    assert (both @ both.inverse).is_same(LieTransform(np.eye(6)), 1e-6 * size.max())
    assert first.is_same(LieTransform(-first.matrix))
    assert not first.is_same(second)
    # A random element keeps contact and neither planes nor points.
    assert not first.is_laguerre
    assert not first.is_moebius


@random_cases
@given(seeds)
def test_corollary_5_2_2_moebius_transformations_are_those_that_keep_points(seed):
    rng = generator(seed)
    found = MoebiusTransform.random(rng)
    lie = found.lie
    assert lie.is_moebius
    points = rng.normal(size=(20, 3))
    images = spheres_of(lie.on(lie_coordinates(points)))
    assert np.abs(images[:, 3]).max() < 1e-9
    np.testing.assert_allclose(
        images[:, :3], found.on_points(points), atol=1e-8 * (1 + np.abs(images).max()) ** 2
    )
    # Two elements of O(4, 2) do the same on points: the other one turns all spheres over.
    turned = LieTransform(np.diag([1.0, 1, 1, 1, 1, -1])) @ lie
    assert turned.is_moebius
    assert not turned.is_same(lie)
    ball = spheres(rng)
    np.testing.assert_allclose(
        spheres_of(turned.on(lie_coordinates(ball))) * [1, 1, 1, -1],
        spheres_of(lie.on(lie_coordinates(ball))),
        atol=0,
    )
    assert MoebiusTransform.of_lie(turned).on_points(points) == pytest.approx(
        found.on_points(points), rel=1e-6, abs=1e-6
    )


# --- lemma 5.3.1 ----------------------------------------------------------------------------


@random_cases
@given(seeds)
def test_lemma_5_3_1_a_lie_transformation_is_determined_by_its_action_on_spheres(seed):
    rng = generator(seed)
    hidden = LieTransform.random(rng)
    x = lie_coordinates(spheres(rng, 40))
    images = hidden.on(x) * rng.choice([-2.0, 0.5, 1.0], (40, 1))  # known up to factors only
    # A x_i parallel to y_i: a linear system for A, whose solutions are the multiples of one.
    rows = []
    for a, b in zip(x, images / norm(images)[:, None], strict=True):
        across = np.eye(6) - np.outer(b, b)
        rows.append(np.einsum("ij,k->ijk", across, a / norm(a)).reshape(6, 36))
    _, values, basis = np.linalg.svd(np.concatenate(rows))
    assert values[-1] < 1e-10 * values[0]
    assert values[-2] > 1e-6 * values[0]
    matrix = basis[-1].reshape(6, 6)
    matrix = matrix / np.sqrt(np.abs(np.trace(LIE @ matrix.T @ LIE @ matrix) / 6))
    assert min(np.abs(matrix - s * hidden.matrix).max() for s in (1, -1)) < 1e-6


# --- lemma 5.3.2 ----------------------------------------------------------------------------


@random_cases
@given(seeds)
def test_lemma_5_3_2_spheres_have_a_common_tangent_plane_exactly_when_not_timelike(seed):
    rng = generator(seed)
    first, second = spheres(rng), spheres(rng)
    gap = second - first
    square = lorentz_product(gap, gap)
    distance = tangential_distance(first, second)
    assert (np.isnan(distance) == (square < 0)).all()
    for x, y, d, kind in zip(first, gap, distance, square, strict=True):
        # Planes with n . p - r = h for both: n . (q - p) = s - r, a cut of the unit sphere.
        length, rise = norm(y[:3]), y[3]
        axis = y[:3] / length
        assert (abs(rise) <= length) == (kind >= 0)
        if kind < 1e-6:
            continue
        side = unit(np.cross(axis, [0.3, -0.5, 0.8]))
        normal = rise / length * axis + np.sqrt(1 - (rise / length) ** 2) * side
        plane = lie_coordinates_of_planes(np.append(normal, normal @ x[:3] - x[3]))
        assert is_in_contact(lie_coordinates(x), plane, 1e-9)
        assert is_in_contact(lie_coordinates(x + y), plane, 1e-9)
        contacts = x[:3] - x[3] * normal, (x + y)[:3] - (x + y)[3] * normal
        assert norm(contacts[1] - contacts[0]) == pytest.approx(d, rel=1e-6, abs=1e-6)


def test_lemma_5_3_2_lightlike_pairs_have_one_plane_only():
    first = np.array([0.2, 0.1, -0.4, 0.7])
    axis = unit(np.array([1.0, 2.0, -0.5]))
    second = first + np.append(1.5 * axis, 1.5)
    normals = unit(np.random.default_rng(0).normal(size=(4000, 3)))
    misses = np.abs(normals @ (second - first)[:3] - 1.5)
    assert misses.min() > 0  # no other normal than the axis itself touches both
    assert normals[misses.argmin()] @ axis > 0.99
    assert tangential_distance(first, second) == pytest.approx(0.0, abs=1e-7)


# --- theorem 5.3.3 --------------------------------------------------------------------------


def conical_meshes():
    """Conical meshes of all kinds, none with a symmetry that hides an error."""
    z = np.linspace(-1, 1, 7)
    strip = np.column_stack([np.ones(7), np.full(7, 0.1), z, 2 + 0.2 * z * z])
    turn = np.array([0.1, 0.23, 0.4, 0.52, 0.7])
    mirrors = np.column_stack([-np.sin(turn), np.cos(turn), 0.05 * turn, 0.02 * turn])
    ball = stereographic_mesh([-0.5, -0.2, 0.1, 0.5], [-0.4, 0.0, 0.3, 0.5])
    return {
        "rotational": rotational(),
        "cyclide": cyclide_mesh(),
        "torus": torus_mesh(),
        "mirrors": mirror_plane_mesh(strip, mirrors),
        "contact": contact_element_mesh(ball, [0.1, 0.2, -1.0]),
    }


MESHES = conical_meshes()


@random_cases
@given(seeds, st.sampled_from(sorted(MESHES)), st.floats(-0.5, 0.5))
def test_theorem_5_3_3_laguerre_transformations_take_conical_meshes_to_conical_meshes(
    seed, name, share
):
    mesh = MESHES[name]
    middle = mesh.vertices.mean(axis=0)
    bearable = rapidity_range(mesh, center=middle)[1]
    random = LaguerreTransform.random(generator(seed), share * bearable)
    transform = random @ LaguerreTransform.shift(-middle)
    image = transform.of_mesh(mesh)
    # The image lies in the image planes, with the image vectors, boundary included.
    planes = transform.on_planes(face_planes(mesh))
    corners, faces = image.mesh.topology.indices, image.mesh.topology.corner_faces
    heights = dot(planes[faces, :3], image.mesh.vertices[corners]) - planes[faces, 3]
    assert np.abs(heights).max() < 1e-10
    assert np.abs(dot(planes[faces, :3], image.vectors[corners]) - 1).max() < 1e-9
    assert dot(image.mesh.face_normals, planes[:, :3]).min() > 1 - 1e-10
    # It is conical by its own planes, measured without any of the above.
    assert planarity(image.mesh).max() < 1e-10
    assert fitted_cones(image.mesh).relative_spread.max() < 1e-8
    assert np.abs(conicality_defect(image.mesh)[1]).max() < 1e-8


@pytest.mark.parametrize("name", sorted(MESHES))
def test_theorem_5_3_3_fails_for_linear_maps_that_are_not_lorentzian(name):
    # In general position: along the axis of a mesh of revolution the map would keep its cones.
    turn = LaguerreTransform.rotation([0.4, 0.8, -0.3], 0.9)
    mesh, matrix = turn.of_mesh(MESHES[name]).mesh, plane_rotation(0.1)
    vectors = face_offset_vectors(mesh).vectors
    start = np.column_stack([mesh.vertices, np.zeros(len(vectors))]) @ matrix.T
    along = np.column_stack([vectors, np.ones(len(vectors))]) @ matrix.T
    image = mesh.with_vertices(start[:, :3] - start[:, 3:] / along[:, 3:] * along[:, :3])
    assert planarity(image).max() < 1e-10  # linearity keeps faces planar: the printed proof
    # ... and destroys the cones: by the direct test, and by the angles.
    assert fitted_cones(image).spread.max() > 1e-4
    assert np.abs(conicality_defect(image)[1]).max() > 1e-4


# --- oracles of section 5.3 -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("rapidity", "third", "fourth"),
    [(0.1, 3.515846248, 5.325521089), (-0.1, 2.514178752, 4.724520591)],
)
def test_worked_example_corrected_is_a_boost(rapidity, third, fourth):
    sphere = np.array([1.0, 2.0, 3.0, 5.0])
    image = LaguerreTransform.boost([0, 0, 1], rapidity).on_spheres(sphere)
    np.testing.assert_allclose(image, [1, 2, third, fourth], atol=5e-10)
    assert lorentz_product(image, image) == pytest.approx(-11, abs=1e-11)


@pytest.mark.parametrize("angle", [12.0, np.radians(12), 0.1])
def test_worked_example_as_printed_is_refused(angle):
    with pytest.raises(ValueError, match="must keep J = diag"):
        LaguerreTransform(plane_rotation(angle))


@random_cases
@given(seeds)
def test_laguerre_transformations_keep_the_square_of_the_tangential_distance(seed):
    rng = generator(seed)
    found = LaguerreTransform.random(rng, rng.uniform(-1, 1), distance=0.3)
    assert np.abs(found.matrix.T @ LORENTZ @ found.matrix - LORENTZ).max() < EXACT * 10
    first, second = spheres(rng), spheres(rng)
    gap, image = first - second, found.on_spheres(first) - found.on_spheres(second)
    np.testing.assert_allclose(lorentz_product(image, image), lorentz_product(gap, gap), atol=1e-10)
    scaled = LaguerreTransform.similarity(1.7) @ found
    wide = scaled.on_spheres(first) - scaled.on_spheres(second)
    np.testing.assert_allclose(
        lorentz_product(wide, wide), 1.7**2 * lorentz_product(gap, gap), atol=1e-9
    )
