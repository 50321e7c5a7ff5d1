"""Moebius transformations: the group, circular meshes, their refusals, and text."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cyclide, inverted, sampled, torus
from sphere_samples import PROFILE, rotational, spheres

from pqmesh.errors import FormatError, MeshError
from pqmesh.mesh.exact import grid_mesh, mirror_mesh, rotational_mesh, stereographic_mesh
from pqmesh.mesh.measure import (
    circle_deviation,
    circularity_defect,
    fitted_cones,
    flipped_faces,
    nonconvex_faces,
    planarity,
)
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.offsets import parallel_error, vertex_distance
from pqmesh.transform.circular import Circles, face_circles
from pqmesh.transform.lie import LieTransform, lie_coordinates, spheres_of
from pqmesh.transform.moebius import MOEBIUS, MoebiusTransform
from pqmesh.vectors import dot, norm, unit

seeds = st.integers(0, 2**32 - 1)
random_cases = settings(deadline=None, derandomize=True, max_examples=50)
CENTER, RADIUS = np.array([0.4, 0.3, -2.5]), 1.7


def circular_meshes():
    """Circular meshes of all kinds, uneven steps."""
    u, v = np.array([-0.7, -0.3, 0.1, 0.55, 1.2]), np.array([-0.9, -0.5, 0.0, 0.3, 0.8])
    line = np.array([[1.0, 0, 0], [1.1, 0.8, 0.2], [0.9, 1.5, 0.7], [1.2, 2.0, 1.5]])
    mirrors = [[1, 0.1, 0, 1.8], [1, 0.25, 0.1, 2.9], [1, 0.2, 0.3, 4.4]]
    return {
        "rotational": rotational_mesh(PROFILE, [0.0, 0.3, 0.7, 0.9, 1.4]),
        "mirrors": mirror_mesh(line, mirrors),
        "ball": stereographic_mesh([-0.5, -0.2, 0.1, 0.5], [-0.4, 0.0, 0.3, 0.5]),
        "torus": grid_mesh(sampled(torus, u, v)[0]),
        "cyclide": grid_mesh(sampled(cyclide, u, v)[0]),
    }


MESHES = circular_meshes()


def cross_ratios(mesh):
    """|ab||cd| / (|bc||da|) of each face."""
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    return norm(b - a) * norm(d - c) / (norm(c - b) * norm(a - d))


def on_circle(circles, turns):
    """Points (n, k, 3) of circles at angles from some start, counterclockwise about the axes."""
    first = unit(np.cross(circles.axes, [0.3, 0.5, 0.1]))
    second = np.cross(circles.axes, first)
    spokes = np.cos(turns)[:, None] * first[:, None] + np.sin(turns)[:, None] * second[:, None]
    return circles.centers[:, None] + circles.radii[:, None, None] * spokes


# --- the group ------------------------------------------------------------------------------


@random_cases
@given(seeds)
def test_matrix_of_an_inversion_is_the_inversion(seed):
    rng = np.random.default_rng(seed)
    center, radius, points = rng.normal(size=3), rng.uniform(0.5, 2), rng.normal(size=(20, 3))
    found = MoebiusTransform.inversion(center, radius)
    assert np.abs(found.matrix.T @ MOEBIUS @ found.matrix - MOEBIUS).max() < 1e-10
    wanted = inverted(points, center, radius)
    far = 1 + np.abs(wanted).max() ** 2
    np.testing.assert_allclose(found.on_points(points), wanted, atol=1e-13 * far)
    np.testing.assert_allclose(
        MoebiusTransform(found.matrix).on_points(points), wanted, atol=1e-11 * far
    )
    images = spheres_of(found.lie.on(lie_coordinates(points)))
    np.testing.assert_allclose(images[:, :3], wanted, atol=1e-11 * far)
    assert not found.keeps_orientation


@random_cases
@given(seeds)
def test_composition_and_inverse_act_as_they_say(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(20, 3))
    parts = [
        MoebiusTransform.inversion(3 * rng.normal(size=3), rng.uniform(0.5, 2)),
        MoebiusTransform.random(rng, 0.2),
        MoebiusTransform.inversion(3 * rng.normal(size=3), rng.uniform(0.5, 2)),
    ]
    step, whole = points, MoebiusTransform(np.eye(5))
    for part in parts:
        step, whole = part.on_points(step), part @ whole
    far = 1 + np.abs(step).max() ** 2
    np.testing.assert_allclose(whole.on_points(points), step, atol=1e-10 * far)
    np.testing.assert_allclose(
        MoebiusTransform.of_lie(whole.lie).on_points(points), step, atol=1e-6 * far
    )
    assert whole.inverse.on_points(step) == pytest.approx(points, abs=1e-6)
    assert (whole.inverse @ whole).on_points(points) == pytest.approx(points, abs=1e-6)


def test_two_inversions_about_one_center_are_a_scaling_and_in_parallel_limits_a_motion():
    first, second = (MoebiusTransform.inversion([1, 2, 3], r) for r in (1.0, 3.0))
    both = second @ first
    assert both.pole is None
    assert both.keeps_orientation
    np.testing.assert_allclose(both.on_points(np.array([[2.0, 2, 3]])), [[10, 2, 3]], atol=1e-12)
    assert (first @ first).pole is None


def test_inversion_far_from_the_origin_keeps_its_digits():
    shift = np.array([4e5, -3e5, 2e3])
    points = np.random.default_rng(0).normal(size=(30, 3))
    near = MoebiusTransform.inversion(CENTER, RADIUS)
    far = MoebiusTransform.inversion(CENTER + shift, RADIUS)
    gap = far.on_points(points + shift) - shift - near.on_points(points)
    assert np.abs(gap).max() < 1e-8  # coordinates of 4e5 carry 6e-11 themselves
    again = (far @ far).on_points(points + shift) - shift
    assert np.abs(again - points).max() < 1e-8


@random_cases
@given(seeds)
def test_spheres_go_to_spheres_with_their_radius_signs(seed):
    rng = np.random.default_rng(seed)
    found, ball = MoebiusTransform.random(rng, 0.3), spheres(rng, 20)
    images = found.on_spheres(ball)
    rim = ball[:, None, :3] + np.abs(ball[:, 3])[:, None, None] * unit(rng.normal(size=(20, 5, 3)))
    points = found.on_points(rim.reshape(-1, 3)).reshape(20, 5, 3)
    size = 1 + np.abs(images[:, 3:]) + norm(images[:, :3])[:, None]
    off = norm(points - images[:, None, :3]) - np.abs(images[:, 3:])
    assert (np.abs(off) < 1e-7 * size**2).all()
    lie = spheres_of(found.lie.on(lie_coordinates(ball)))
    assert (np.abs(lie - images) < 1e-7 * size**2).all()


@random_cases
@given(seeds, st.booleans())
def test_circles_go_to_circles_with_their_sense_of_running(seed, is_inverted):
    rng = np.random.default_rng(seed)
    found = MoebiusTransform.random(rng, 0.3)
    if is_inverted:
        found = found @ MoebiusTransform.inversion(rng.normal(size=3), 1.2)
    circles = Circles(
        rng.normal(size=(8, 3)), unit(rng.normal(size=(8, 3))), rng.uniform(0.5, 1.5, 8)
    )
    images = found.on_circles(circles)
    points = found.on_points(on_circle(circles, np.arange(6.0)).reshape(-1, 3)).reshape(8, 6, 3)
    spokes = (points - images.centers[:, None]) / images.radii[:, None, None]
    assert norm(spokes) == pytest.approx(1.0, abs=1e-6)
    assert np.einsum("nki,ni->nk", spokes, images.axes) == pytest.approx(0.0, abs=1e-6)
    area = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    assert (dot(area, images.axes) > 0).all()


def test_circle_through_the_pole_has_no_finite_image():
    circle = Circles(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.ones(1))
    image = MoebiusTransform.inversion([1, 0, 0], 1.0).on_circles(circle)
    assert not np.isfinite(image.radii[0])


def test_spheres_that_cut_at_an_angle_do_so_afterwards():
    ball = np.array([[1.0, 0, 0, 1.0], [0, 0.9, 0.3, 0.8]])
    image = MoebiusTransform.inversion([0.2, -1.5, 2.0], 1.3).on_spheres(ball)

    def cosine(rows):
        gap = rows[0, :3] - rows[1, :3]
        return (rows[0, 3] ** 2 + rows[1, 3] ** 2 - gap @ gap) / (2 * rows[0, 3] * rows[1, 3])

    assert cosine(image) == pytest.approx(cosine(ball), abs=1e-12)


# --- circular meshes ------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(MESHES))
def test_image_of_a_circular_mesh_is_circular_with_its_cross_ratios(name):
    mesh = MESHES[name]
    image = MoebiusTransform.inversion(CENTER, RADIUS).of_mesh(mesh)
    np.testing.assert_allclose(
        image.mesh.vertices, inverted(mesh.vertices, CENTER, RADIUS), atol=1e-13
    )
    assert np.abs(circle_deviation(image.mesh)).max() < 1e-11
    assert planarity(image.mesh).max() < 1e-11
    assert np.abs(circularity_defect(image.mesh)).max() < 1e-10
    np.testing.assert_allclose(cross_ratios(image.mesh), cross_ratios(mesh), rtol=1e-10)
    assert image.warnings == ()
    assert not len(flipped_faces(image.mesh))
    assert not len(nonconvex_faces(image.mesh))


@pytest.mark.parametrize("name", sorted(MESHES))
def test_vertex_offset_of_the_image_is_exact_and_computed_anew(name):
    image = MoebiusTransform.inversion(CENTER, RADIUS).of_mesh(MESHES[name])
    assert image.vectors.error < 1e-11
    moved = image.mesh.with_vertices(image.mesh.vertices + 0.02 * image.vectors.vectors)
    np.testing.assert_allclose(vertex_distance(image.mesh, moved), 0.02, atol=1e-14)
    assert parallel_error(image.mesh, moved).max() < 1e-10


def test_image_of_an_offset_is_no_offset():
    found = MoebiusTransform.inversion(CENTER, RADIUS)
    mesh = MESHES["torus"]
    plain = MoebiusTransform(np.eye(5)).of_mesh(mesh)
    layer = mesh.with_vertices(mesh.vertices + 0.2 * plain.vectors.vectors)
    both = found.of_mesh(mesh).mesh, found.of_mesh(layer).mesh
    assert np.ptp(vertex_distance(*both)) > 1e-3
    assert parallel_error(*both).max() > 1e-3


def test_image_of_a_conical_mesh_is_not_conical():
    mesh = rotational()
    assert fitted_cones(mesh).spread.max() < 1e-13
    image = MoebiusTransform.inversion([0.4, 0.3, -2.5], 1.7).of_mesh(mesh).mesh
    assert planarity(image).max() < 1e-12
    assert fitted_cones(image).spread.max() > 1e-4


@pytest.mark.parametrize("name", sorted(MESHES))
def test_face_circles_run_through_their_corners(name):
    mesh = MESHES[name]
    circles = face_circles(mesh)
    np.testing.assert_allclose(
        norm(mesh.corners - circles.centers[:, None]), circles.radii[:, None] + np.zeros((1, 4)),
        atol=1e-12,
    )  # fmt: skip
    mapped = MoebiusTransform.inversion(CENTER, RADIUS).on_circles(circles)
    there = face_circles(MoebiusTransform.inversion(CENTER, RADIUS).of_mesh(mesh).mesh)
    np.testing.assert_allclose(mapped.centers, there.centers, atol=1e-11)
    np.testing.assert_allclose(mapped.radii, there.radii, atol=1e-11)
    np.testing.assert_allclose(mapped.axes, there.axes, atol=1e-10)


# --- refusals -------------------------------------------------------------------------------


def test_center_on_a_vertex_is_refused_with_the_vertex():
    mesh = MESHES["torus"]
    with pytest.raises(MeshError, match="vertex 7 does, and goes to infinity"):
        MoebiusTransform.inversion(mesh.vertices[7], 1.0).of_mesh(mesh)


@pytest.mark.parametrize("face", [0, 5])
def test_center_on_a_face_circle_is_refused_with_the_face(face):
    mesh = MESHES["cyclide"]
    circle = face_circles(mesh)
    point = on_circle(circle, np.array([0.4321]))[face, 0]
    with pytest.raises(MeshError, match=rf"face {face} does, and becomes a line"):
        MoebiusTransform.inversion(point, 1.0).of_mesh(mesh)


def test_center_near_a_face_turns_it_over_and_is_refused():
    mesh = MESHES["torus"]
    circle = face_circles(mesh)
    inside = circle.centers[6] + 0.3 * circle.radii[6] * circle.axes[6]
    with pytest.raises(MeshError, match=r"face 5 turns over against the others \(3 of 16"):
        MoebiusTransform.inversion(inside, 1.0).of_mesh(mesh)
    # That is the truth: its image normal is turned against the images of its neighbours.
    image = mesh.with_vertices(inverted(mesh.vertices, inside, 1.0))
    gaps = mesh.corners - inside
    normals = mesh.face_normals[:, None]
    pushed = 2 * dot(normals, unit(gaps))[..., None] * unit(gaps) - normals
    along = np.einsum("fki,fi->fk", pushed, image.face_normals)
    turned = dot(circle.centers - inside, circle.centers - inside) < circle.radii**2
    assert (along[turned] < 0).all()
    assert (along[~turned] > 0).all()


def test_mesh_that_is_not_circular_is_warned_about():
    bent = QuadMesh.of([[0, 0, 0], [2, 0, 0], [1.5, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    image = MoebiusTransform.inversion([0.5, 0.5, 2], 1.0).of_mesh(bent)
    assert "circular only to" in image.warnings[0]
    assert planarity(image.mesh).max() > 1e-3


def test_mesh_in_pieces_is_mapped_without_vertex_offset():
    one = MESHES["ball"]
    two = QuadMesh.of(
        np.vstack([one.vertices, one.vertices + np.array([5.0, 0, 0])]),
        np.vstack([one.faces, one.faces + len(one.vertices)]),
    )
    image = MoebiusTransform.inversion([0, 0, 6], 2.0).of_mesh(two)
    assert image.vectors is None
    assert "in pieces" in image.warnings[-1]


def test_sphere_through_the_pole_is_refused_with_its_row():
    with pytest.raises(MeshError, match="row 1 does, and becomes a plane"):
        MoebiusTransform.inversion([0, 0, 0], 1.0).on_spheres(
            np.array([[3.0, 0, 0, 1.0], [0, 2.0, 0, 2.0]])
        )


def test_lie_transformation_that_moves_points_is_refused():
    with pytest.raises(MeshError, match="must take points to points"):
        MoebiusTransform.of_lie(LieTransform.random(np.random.default_rng(3)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: MoebiusTransform(np.eye(4)), r"must have shape \(5, 5\)"),
        (lambda: MoebiusTransform(2 * np.eye(5)), "is off by 3"),
        (lambda: MoebiusTransform.inversion([0, 0], 1.0), "must be 3 finite numbers"),
        (lambda: MoebiusTransform.inversion([0, 0, np.inf], 1.0), "must be 3 finite numbers"),
        (lambda: MoebiusTransform.inversion([0, 0, 0], 0.0), "radius .* must be a number above 0"),
        (lambda: MoebiusTransform.inversion([0, 0, 0], np.nan), "must be a number above 0"),
    ],
)
def test_what_is_no_moebius_transformation_is_refused(make, message):
    with pytest.raises(MeshError, match=message):
        make()


# --- text -----------------------------------------------------------------------------------


def test_text_brings_the_transformation_back():
    found = MoebiusTransform.random(np.random.default_rng(2))
    assert (MoebiusTransform.from_json(found.to_json()).matrix == found.matrix).all()
    text = (
        '{"inversions": [{"center": [1, 2, 3], "radius": 1}, {"center": [1, 2, 3], "radius": 3}]}'
    )
    scaled = MoebiusTransform.from_json(text)
    np.testing.assert_allclose(scaled.on_points(np.array([[2.0, 2, 3]])), [[10, 2, 3]], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "line 1, column 2"),
        ("{}", "exactly one of the keys matrix and inversions; found none"),
        ('{"matrix": [], "inversions": []}', "found matrix, inversions"),
        ('{"inversion": []}', "Did you mean 'inversions'?"),
        ('{"inversions": []}', "must hold a list like"),
        ('{"inversions": [3]}', "must be a JSON object; found int"),
        ('{"inversions": [{"center": [0, 0, 0]}]}', "the key 'radius' with a number"),
        ('{"inversions": [{"center": [0, 0], "radius": 1}]}', "'center' must hold 3 numbers"),
        ('{"matrix": [[1]]}', "'matrix' must hold 5 x 5 numbers"),
    ],
)
def test_text_that_is_no_transformation_is_refused_in_one_line(text, message):
    with pytest.raises(FormatError) as caught:
        MoebiusTransform.from_json(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
