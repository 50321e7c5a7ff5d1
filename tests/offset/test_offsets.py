"""Layers and their figures, offset vectors of every kind, the support structure."""

import time

import numpy as np
import pytest
from shapes import curved_mesh, zoo

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import grid_mesh, mirror_mesh, rotational_mesh, translational_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.offsets import (
    edge_factors,
    face_distance,
    face_offset,
    offset_layer,
    offset_vectors,
    parallel_error,
    valid_range,
    vertex_distance,
    vertex_offset,
)
from pqmesh.offset.support import support_structure, twist
from pqmesh.offset.vectors import (
    OffsetVectors,
    face_offset_vectors,
    parallel_offset_vectors,
    vertex_offset_vectors,
)

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])
CONICAL = rotational_mesh(PROFILE, 0.3 * np.arange(7))
CIRCULAR = mirror_mesh(
    [[0, 0, 0], [0.2, 1, 0.1], [0.1, 2, 0.5], [0.3, 3, 0.4]],
    [[1, 0, 0, 1], [1, 0.1, 0.2, 3], [1, -0.1, 0.3, 6]],
)
PLANAR = translational_mesh(
    [[0, 0, 0], [1, 0, 0.2], [2, 0, 0.1], [3, 0, -0.3]],
    [[0, 0, 0], [0, 1, 0.3], [0.2, 2, 0.2], [0.1, 3, -0.2]],
)
MESHES = {"conical": CONICAL, "circular": CIRCULAR, "planar": PLANAR}


# --- figures of a layer -----------------------------------------------------------------------


@pytest.mark.parametrize("kind", MESHES)
@pytest.mark.parametrize("distance", [0.05, -0.05])
def test_layer_of_its_kind_is_parallel_planar_and_of_constant_distance(kind, distance):
    mesh = MESHES[kind]
    vectors = offset_vectors(mesh, kind)
    assert vectors.kind == {"conical": "face", "circular": "vertex", "planar": "parallel"}[kind]
    layer = offset_layer(mesh, vectors, distance)
    assert layer.mesh.topology is mesh.topology
    assert layer.distance == distance
    # Rounding over the angle between neighbouring planes.
    assert layer.parallel_error_max < 1e-12
    assert layer.parallel_error_boundary_max < 1e-12
    assert layer.planarity_max < 1e-12
    if kind != "planar":
        assert layer.distance_error_max < 1e-12
    # On the side of the face normals.
    assert np.median(face_distance(mesh, layer.mesh)) * distance > 0
    assert np.isclose(
        layer.distance_error_max, vectors.error * abs(distance), rtol=1e-6, atol=1e-12
    )


def test_layer_of_the_wrong_kind_says_so():
    layer = offset_layer(PLANAR, face_offset_vectors(PLANAR), 0.1)
    assert layer.distance_error_max > 1e-3 * 0.1
    wrong = offset_layer(PLANAR, vertex_offset_vectors(PLANAR), 0.1)
    assert wrong.parallel_error_max > 1e-3
    # Face offsets of a circular mesh that is not conical.
    assert face_offset_vectors(CIRCULAR).error > 1e-5


def test_layer_at_distance_zero_is_the_mesh():
    layer = offset_layer(CONICAL, face_offset_vectors(CONICAL), 0.0)
    assert (layer.mesh.vertices == CONICAL.vertices).all()
    assert layer.distance_error_max == 0.0


def test_distances_and_parallel_error_have_closed_values():
    square = QuadMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    lifted = square.with_vertices(square.vertices + np.array([0.3, 0, -0.4]))
    assert np.allclose(face_distance(square, lifted), -0.4, rtol=0, atol=1e-15)
    assert np.allclose(vertex_distance(square, lifted), 0.5, rtol=0, atol=1e-15)
    assert (parallel_error(square, lifted) == 0).all()
    c, s = np.cos(0.2), np.sin(0.2)
    turned = square.with_vertices(square.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    assert np.allclose(parallel_error(square, turned), s, rtol=0, atol=1e-15)
    # A collapsed edge is parallel to every edge (errata, E5).
    point = square.with_vertices(0.0 * square.vertices)
    assert (parallel_error(square, point) == 0).all()


def test_range_of_a_shrinking_square_ends_where_it_is_a_point():
    square = QuadMesh.of([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]], [[0, 1, 2, 3]])
    inward = np.array([1.0, 1, 0]) - square.vertices
    assert np.allclose(edge_factors(square, inward), -1.0)
    assert valid_range(square, inward) == (-np.inf, 1.0)
    assert valid_range(square, -inward) == (-1.0, np.inf)
    assert valid_range(square, np.ones((4, 3))) == (-np.inf, np.inf)


def test_offset_functions_are_the_vectors_times_the_distance():
    for offset, vectors in (
        (face_offset, face_offset_vectors),
        (vertex_offset, vertex_offset_vectors),
    ):
        mesh = CONICAL
        moved = offset(mesh, 0.2)
        assert (moved.vertices == mesh.vertices + 0.2 * vectors(mesh).vectors).all()
        # Offsets add up.
        back = mesh.with_vertices(moved.vertices - 0.2 * vectors(mesh).vectors)
        assert np.abs(back.vertices - mesh.vertices).max() < 1e-15


# --- every topology ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(zoo()))
@pytest.mark.parametrize("kind", ["conical", "planar", "circular"])
def test_every_topology_has_finite_offset_vectors(name, kind):
    mesh = zoo()[name][0]
    if kind == "circular" and name == "two_pieces":
        return
    vectors = offset_vectors(mesh, kind)
    assert vectors.vectors.shape == mesh.vertices.shape
    assert np.isfinite(vectors.vectors).all()
    assert np.isfinite(vectors.error)
    assert np.allclose(np.linalg.norm(vectors.axes, axis=1)[
        np.linalg.norm(vectors.vectors, axis=1) > 0], 1.0)  # fmt: skip


def test_vertex_offset_of_two_pieces_is_refused_with_the_count():
    mesh = zoo()["two_pieces"][0]
    with pytest.raises(MeshError, match="only 42 of 84 vertices"):
        vertex_offset_vectors(mesh)


def test_face_offset_of_two_pieces_is_that_of_each():
    one = CONICAL
    n = one.topology.n_vertices
    shift = np.array([20.0, 0, 0])
    two = QuadMesh.of(
        np.vstack([one.vertices, one.vertices + shift]), np.vstack([one.faces, one.faces + n])
    )
    single, both = face_offset_vectors(one).vectors, face_offset_vectors(two).vectors
    # Slides of the sides are shortest to the square root of rounding.
    assert np.abs(both[:n] - single).max() < 1e-7
    assert np.abs(both[n:] - single).max() < 1e-7


def test_same_input_gives_the_same_bytes():
    for vectors in (face_offset_vectors, vertex_offset_vectors, parallel_offset_vectors):
        assert vectors(CONICAL).vectors.tobytes() == vectors(CONICAL).vectors.tobytes()


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_offset_vectors_do_not_depend_on_the_unit(scale):
    for vectors in (face_offset_vectors, vertex_offset_vectors, parallel_offset_vectors):
        plain = vectors(CONICAL).vectors
        other = vectors(CONICAL.with_vertices(scale * CONICAL.vertices)).vectors
        inner = ~CONICAL.topology.is_boundary_vertex
        # The parallel ones by normal equations with a soft goal of 1e-6.
        limit = 1e-5 if vectors is parallel_offset_vectors else 1e-11
        assert np.abs(plain - other)[inner].max() < limit


# --- support structure ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", MESHES)
def test_webs_between_exact_layers_are_flat_and_without_twist(kind):
    mesh = MESHES[kind]
    vectors = offset_vectors(mesh, kind)
    lower = offset_layer(mesh, vectors, -0.05).mesh
    upper = offset_layer(mesh, vectors, 0.1).mesh
    support = support_structure(mesh, vectors.axes, lower, upper)
    assert support.quads.shape == (len(mesh.edges), 4, 3)
    assert (support.edges == mesh.edges).all()
    # Angles of a few roundings; deviations over the height of 0.15.
    assert support.twist.max() < 1e-12
    assert support.planarity_deviation.max() < 1e-13
    i, j = mesh.edges.T
    assert (support.quads[:, 0] == lower.vertices[i]).all()
    assert (support.quads[:, 2] == upper.vertices[j]).all()
    # Each web contains its edge of the base mesh and the axes at both ends.
    normal = np.cross(support.quads[:, 1] - support.quads[:, 0], vectors.axes[i])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    for offset in (mesh.vertices[i], mesh.vertices[j]):
        assert np.abs(((offset - support.quads[:, 0]) * normal).sum(axis=1)).max() < 1e-13


def test_twist_and_deviation_of_a_turned_axis_have_closed_values():
    mesh = QuadMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    axes = np.tile([0.0, 0, 1], (4, 1))
    axes[1] = [0, np.sin(0.1), np.cos(0.1)]
    turned = twist(mesh, axes)
    edge = mesh.edges.tolist().index([0, 1])
    # Turned about the edge by 0.1 rad; along the other edge at vertex 1 it leans in the web.
    assert np.isclose(turned[edge], 0.1, rtol=0, atol=1e-15)
    assert np.abs(np.delete(turned, edge)).max() < 1e-15
    upper = mesh.with_vertices(mesh.vertices + 0.2 * axes)
    support = support_structure(mesh, axes, mesh, upper)
    assert support.planarity_deviation[edge] > 0.005
    # The length and the sign of the axes do not count for the twist of one edge.
    assert np.abs(twist(mesh, 3.0 * axes) - turned).max() < 1e-15


def test_vertex_normals_of_a_twisted_mesh_twist_its_beams_by_a_tenth():
    # Rulings of a hyperbolic paraboloid: normals turn along every edge.
    s = np.linspace(-1, 1, 9)
    x, y = np.meshgrid(s, s, indexing="ij")
    mesh = grid_mesh(np.stack([x, y, 0.5 * x * y], axis=-1))
    turned = twist(mesh, mesh.vertex_normals)
    # Normals turn by 0.5 per unit length, edges are a quarter long.
    assert 0.08 < turned.max() < 0.15
    assert planarity(mesh).max() > 0.01
    # A planar mesh near it has none, by its parallel mesh.
    assert twist(PLANAR, parallel_offset_vectors(PLANAR).axes).max() < 1e-12


def test_axes_are_unit_and_zero_stays_zero():
    vectors = OffsetVectors("face", np.array([[0.0, 0, 2], [0, 0, 0], [3, 4, 0]]), 0.0)
    assert vectors.axes.tolist() == [[0, 0, 1], [0, 0, 0], [0.6, 0.8, 0]]


# --- size -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("profile", "columns"),
    [(100, 100), (2, 5000)],
    ids=["square", "strip"],
)
def test_offsets_of_ten_thousand_faces_take_seconds(profile, columns):
    s = np.linspace(0.2, 1.2, profile + 1)
    curve = np.column_stack([2 + np.sin(2 * s), s])
    mesh = rotational_mesh(curve, np.linspace(0, 2.0, columns + 1))
    began = time.perf_counter()
    vectors = face_offset_vectors(mesh)
    # 0.2 to 0.3 s on one core, long boundary or not.
    assert time.perf_counter() - began < 5.0
    layer = offset_layer(mesh, vectors, 0.01)
    assert layer.distance_error_max < 1e-13
    # Angles between planes of a thousandth, edges of 4e-4.
    assert layer.parallel_error_boundary_max < 1e-10


def test_noise_of_planarity_shows_in_the_figures_but_does_not_break_them():
    mesh = curved_mesh(5, 4, noise=0.05)
    for kind in ("conical", "planar", "circular"):
        layer = offset_layer(mesh, offset_vectors(mesh, kind), 0.1)
        assert np.isfinite(layer.distance_error_max)
        assert layer.planarity_max > 1e-3
