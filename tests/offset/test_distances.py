"""Distances of parallel pairs, offsets, Gauss images, stacks, and Steiner's formula."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pq import pq_rows
from shapes import random_rotation

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import grid_mesh, mirror_mesh, rotational_mesh
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.solids import cube, deltoidal_icositetrahedron, sphere_tangent_mesh
from pqmesh.offset.distances import (
    constant_distance,
    edge_distance,
    edge_factors,
    face_distance,
    is_offset,
    is_parallel,
    valid_range,
    vertex_distance,
)
from pqmesh.offset.gauss import gauss_image, sphere_deviation, touches_sphere
from pqmesh.offset.offsets import offset_stack
from pqmesh.offset.parallel import parallel_space
from pqmesh.offset.steiner import area_range, face_curvatures, mixed_areas, offset_areas
from pqmesh.offset.vectors import face_offset_vectors, vertex_offset_vectors

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])
CONICAL = rotational_mesh(PROFILE, 0.3 * np.arange(7))
CIRCULAR = rotational_mesh(PROFILE, [0, 0.2, 0.55, 0.8, 1.2])
SQUARE = grid_mesh(np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.0]]]))


# --- distances --------------------------------------------------------------------------------


def test_distances_of_a_turned_square_are_those_of_lines():
    # Turned about the vertical line through its middle, and lifted by 2: lines turned by t at
    # half an edge from the axis stay 2 apart where they cross, that is what the lines have.
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
    moved = (SQUARE.vertices - [0.5, 0.5, 0]) @ turn.T + [0.5, 0.5, 2.0]
    other = SQUARE.with_vertices(moved)
    assert np.abs(edge_distance(SQUARE, other) - 2.0).max() < 1e-14
    assert not is_parallel(SQUARE, other)
    assert not is_offset(SQUARE, other, "face")
    assert constant_distance(SQUARE, other, "face") == pytest.approx((2.0, 0.0))


def test_edge_distance_does_not_depend_on_sliding_along_edges():
    long = QuadMesh.of([[0, 0, 0], [4, 0, 0], [4, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    other = long.with_vertices(long.vertices + np.array([10.0, 0.0, 0.5]))
    found = edge_distance(long, other)
    horizontal = np.abs(long.edge_vectors[:, 0]) > 1
    assert np.abs(found[horizontal] - 0.5).max() < 1e-14
    assert np.abs(found[~horizontal] - np.hypot(10, 0.5)).max() < 1e-13
    # A collapsed edge keeps the line of its counterpart.
    point = long.with_vertices(np.zeros((4, 3)) + np.array([2.0, 0.5, 3.0]))
    assert np.abs(edge_distance(long, point) - np.where(horizontal, np.hypot(3, 0.5),
                                                        np.hypot(3, 2))).max() < 1e-14  # fmt: skip


def test_distances_do_not_change_with_a_motion():
    mesh = pq_rows(3, 4)
    space = parallel_space(mesh)
    other = space.member(np.random.default_rng(0).normal(size=space.dimension))
    turn = random_rotation(np.random.default_rng(1))
    images = [part.with_vertices(part.vertices @ turn.T + [5, 6, 7]) for part in (mesh, other)]
    for measured in (vertex_distance, edge_distance, face_distance):
        assert np.abs(measured(mesh, other) - measured(*images)).max() < 1e-12


def test_translation_is_an_offset_only_along_the_normal_of_a_flat_mesh():
    curved = CIRCULAR.with_vertices(CIRCULAR.vertices + np.array([0.1, 0.2, 0.2]))
    assert vertex_distance(CIRCULAR, curved) == pytest.approx(0.3)
    assert not is_offset(CIRCULAR, curved, "vertex")
    up = SQUARE.with_vertices(SQUARE.vertices + np.array([0, 0, 0.3]))
    aside = SQUARE.with_vertices(SQUARE.vertices + np.array([0.3, 0, 0]))
    assert all(is_offset(SQUARE, up, kind) for kind in ("vertex", "edge", "face"))
    assert not any(is_offset(SQUARE, aside, kind) for kind in ("edge", "face"))
    assert not is_offset(SQUARE, SQUARE, "vertex")


def test_reversed_mesh_has_the_opposite_face_distance():
    mesh = deltoidal_icositetrahedron()
    other = mesh.with_vertices(1.2 * mesh.vertices)
    assert is_offset(mesh, other, "face")
    assert constant_distance(mesh, other, "face")[0] == pytest.approx(0.2)
    assert constant_distance(mesh.reversed(), other.reversed(), "face")[0] == pytest.approx(-0.2)


def test_other_faces_and_unknown_kinds_are_refused():
    with pytest.raises(MeshError, match="same faces to correspond"):
        is_parallel(SQUARE, cube())
    with pytest.raises(MeshError, match="one of vertex, edge, face; found 'corner'"):
        constant_distance(SQUARE, SQUARE, "corner")
    with pytest.raises(MeshError, match="found 'corner'"):
        sphere_deviation(SQUARE, SQUARE, "corner")
    with pytest.raises(MeshError, match="at some distance; found 0"):
        gauss_image(SQUARE, SQUARE, 0.0)


def test_gauss_image_of_an_offset_and_its_reverse_are_opposite():
    vectors = face_offset_vectors(CONICAL).vectors
    offset = CONICAL.with_vertices(CONICAL.vertices + 0.1 * vectors)
    image = gauss_image(CONICAL, offset, 0.1)
    assert np.abs(image.vertices - vectors).max() < 1e-13
    assert touches_sphere(CONICAL, image, "face", 1e-12)
    assert not touches_sphere(CONICAL, image, "vertex")
    back = gauss_image(offset, CONICAL, -0.1)
    assert np.abs(back.vertices - vectors).max() < 1e-13
    assert sphere_deviation(CONICAL, gauss_image(CONICAL, offset, -0.1), "face").max() < -1.9


# --- stacks -----------------------------------------------------------------------------------


def test_layers_of_a_stack_are_offsets_of_each_other():
    stack = offset_stack(CONICAL, face_offset_vectors(CONICAL), [-0.1, 0.05, 0.2])
    assert [layer.distance for layer in stack] == [-0.1, 0.05, 0.2]
    for lower, upper in ((0, 1), (1, 2), (0, 2)):
        first, second = stack[lower], stack[upper]
        assert is_offset(first.mesh, second.mesh, "face", 1e-11)
        reached = face_distance(first.mesh, second.mesh)
        assert np.abs(reached - (second.distance - first.distance)).max() < 1e-12


def test_stack_beyond_the_first_reversed_edge_or_with_equal_layers_is_refused():
    vectors = face_offset_vectors(CONICAL)
    low, high = valid_range(CONICAL, vectors.vectors)
    assert low == pytest.approx(-0.716, abs=1e-3)
    assert len(offset_stack(CONICAL, vectors, [0.99 * low])) == 1
    with pytest.raises(MeshError, match=rf"between {low:.6g} and {high:.6g}; found"):
        offset_stack(CONICAL, vectors, [0.1, 1.01 * low])
    with pytest.raises(MeshError, match=r"distance 0\.1 was given 2 times"):
        offset_stack(CONICAL, vectors, [0.1, 0.2, 0.1])


@pytest.mark.parametrize("distance", [0.1, -0.3])
def test_edges_of_an_offset_are_multiples_to_rounding_error(distance):
    # Oracle 33 at its own tolerance.
    vectors = face_offset_vectors(CONICAL).vectors
    moved = CONICAL.with_vertices(CONICAL.vertices + distance * vectors)
    factors = 1 + distance * edge_factors(CONICAL, vectors)
    assert np.abs(moved.edge_vectors - factors[:, None] * CONICAL.edge_vectors).max() < 1e-13


# --- Steiner ----------------------------------------------------------------------------------


def shoelace(mesh, points):
    """Signed face areas along the normals of a mesh, corner by corner."""
    areas = []
    for face, normal in zip(mesh.topology.face_lists(), mesh.face_normals, strict=True):
        corners = points[face]
        areas.append(0.5 * np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0) @ normal)
    return np.array(areas)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), d=st.floats(-0.5, 0.5))
def test_offset_areas_are_steiners_polynomial_for_every_parallel_pair(seed, d):
    mesh = pq_rows(3, 4, seed)
    space = parallel_space(mesh)
    image = space.member(np.random.default_rng(seed).normal(size=space.dimension))
    moved = mesh.vertices + d * image.vertices
    size = np.abs(moved).max() ** 2 + np.abs(mesh.vertices).max() ** 2
    assert np.abs(offset_areas(mesh, image, d) - shoelace(mesh, moved)).max() < 1e-13 * size
    # Symmetric, linear, and the area itself.
    mixed = mixed_areas(mesh, mesh, image)
    assert np.abs(mixed - mixed_areas(mesh, image, mesh)).max() < 1e-12
    area = np.linalg.norm(mesh.face_area_vectors, axis=1)
    assert np.abs(mixed_areas(mesh, mesh, mesh) - area).max() < 1e-12


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_faces_about_a_ball_have_its_curvatures(radius):
    solids = (
        deltoidal_icositetrahedron(),
        sphere_tangent_mesh(np.random.default_rng(0).normal(size=(15, 3))),
    )
    for solid in solids:
        mesh = solid.with_vertices(radius * solid.vertices)
        found = face_curvatures(mesh, solid)
        assert np.abs(found.mean + 1 / radius).max() < 1e-12
        assert np.abs(found.gauss - 1 / radius**2).max() < 1e-12
        back = face_curvatures(mesh.reversed(), solid.with_vertices(-solid.vertices).reversed())
        assert np.abs(back.mean - 1 / radius).max() < 1e-12
        low, high = area_range(mesh, solid)
        assert low == pytest.approx(-radius, rel=1e-5)
        assert high == np.inf


def test_curvatures_of_a_fine_torus_tend_to_those_of_the_surface():
    errors = []
    for count in (24, 48):
        t = 2 * np.pi / count * np.arange(count)
        profile = np.column_stack([3 + np.cos(t), np.sin(t)])
        mesh = rotational_mesh(profile, t, closed=True, closed_profile=True)
        vectors = vertex_offset_vectors(mesh).vectors
        # The image nearest to the vertex normals, outwards.
        found = face_curvatures(mesh, mesh.with_vertices(vectors))
        x, y, z = mesh.face_centers.T
        cosine = (np.hypot(x, y) - 3) / np.hypot(np.hypot(x, y) - 3, z)
        wanted = cosine / (3 + cosine)
        errors.append(np.abs(found.gauss - wanted).max())
        assert np.abs(found.mean + 0.5 * (1 + wanted)).max() < 2 * errors[-1] + 0.02
    assert errors[1] < 0.3 * errors[0]


def test_faces_of_a_minimal_pair_have_no_mean_curvature():
    # The discrete catenoid and its Koebe image, in closed form: mixed areas vanish.
    n, start = 12, -1.0
    half = np.pi / n
    tau = start + 2 * np.arccosh(1 / np.cos(half)) * np.arange(4)
    turns = 2 * half * np.arange(n)
    image = rotational_mesh(
        np.column_stack([1 / np.cosh(tau) / np.cos(half), np.tanh(tau)]), turns, closed=True
    )
    profile = np.column_stack([np.cos(half) * np.cosh(tau), -2 * np.arange(4) * np.sin(half)])
    catenoid = image.with_vertices(rotational_mesh(profile, turns, closed=True).vertices)
    assert is_parallel(image, catenoid, 1e-12)
    assert np.abs(mixed_areas(image, catenoid, image)).max() < 1e-13
    curvatures = face_curvatures(catenoid, image)
    assert np.abs(curvatures.mean).max() < 1e-12
    assert curvatures.gauss.max() < 0
    assert touches_sphere(catenoid, image, "edge", 1e-12)


def test_area_range_is_never_smaller_than_that_of_the_edges():
    mesh = mirror_mesh(
        [[0, 0, 0], [0.2, 1, 0.1], [0.1, 2, 0.5], [0.3, 3, 0.4]],
        [[1, 0, 0, 1], [1, 0.1, 0.2, 3], [1, -0.1, 0.3, 6]],
    )
    vectors = vertex_offset_vectors(mesh).vectors
    image = mesh.with_vertices(vectors)
    edges, faces = valid_range(mesh, vectors), area_range(mesh, image)
    assert faces[0] <= edges[0] * (1 - 1e-9)
    assert faces[1] >= edges[1] * (1 - 1e-9)
    for d in (0.999 * faces[0], 0.999 * faces[1]):
        if np.isfinite(d):
            assert offset_areas(mesh, image, d).min() > 0
            assert offset_areas(mesh, image, 1.01 * d).min() < 0


def test_saddle_loses_face_areas_on_both_sides():
    z = np.array([-0.8, -0.5, -0.1, 0.2, 0.7])
    mesh = rotational_mesh(np.column_stack([np.sqrt(1 + z * z), z]), 0.4 * np.arange(6))
    image = mesh.with_vertices(face_offset_vectors(mesh).vectors)
    assert (face_curvatures(mesh, image).gauss < 0).all()
    low, high = area_range(mesh, image)
    assert -np.inf < low < 0 < high < np.inf
    for d in (low, high):
        assert offset_areas(mesh, image, 0.999 * d).min() > 0
        assert offset_areas(mesh, image, 1.001 * d).min() < 0


def test_flat_mesh_keeps_its_areas_at_any_distance():
    up = SQUARE.with_vertices(0 * SQUARE.vertices + np.array([0, 0, 1.0]))
    assert area_range(SQUARE, up) == (-np.inf, np.inf)
    assert offset_areas(SQUARE, up, 7.0) == pytest.approx(1.0)


def test_face_without_area_has_no_curvature():
    line = PolyMesh.of(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 2, 0]], [[0, 1, 2, 3], [2, 1, 4]]
    )
    with pytest.raises(MeshError, match="face 1 has 0"):
        face_curvatures(line, line)
