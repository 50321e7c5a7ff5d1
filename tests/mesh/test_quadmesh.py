import numpy as np
import pytest
from shapes import curved_mesh, polygon_mesh, random_rotation, zoo

from pqmesh.errors import MeshError, PqmeshError
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Topology

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACE = [[0, 1, 2, 3]]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -2e150])
def test_mesh_refuses_coordinates_that_are_not_finite_or_too_large(value):
    points = SQUARE.copy()
    points[2, 1] = value
    with pytest.raises(MeshError, match=r"finite and below 1e\+150; vertex 2 is \[1.0, "):
        QuadMesh.of(points, FACE)


@pytest.mark.parametrize("shape", [(4, 2), (4, 4), (5, 3), (3, 3), (12,), (4, 3, 1)])
def test_mesh_refuses_vertices_of_wrong_shape(shape):
    with pytest.raises(MeshError, match=r"must have shape \(4, 3\) to fit the topology; found"):
        QuadMesh(np.zeros(shape), Topology(FACE, 4))


def test_quadmesh_refuses_triangle_and_polymesh_takes_it():
    points, faces = SQUARE[:3], [[0, 1, 2]]
    with pytest.raises(MeshError, match="must be a quad; 1 of 1 are not, the first is face 0 with"):
        QuadMesh.of(points, faces)
    assert np.allclose(PolyMesh.of(points, faces).face_normals, [[0, 0, 1]])


def test_mesh_errors_are_value_errors():
    assert issubclass(MeshError, PqmeshError)
    assert issubclass(MeshError, ValueError)


def test_mesh_keeps_a_read_only_copy():
    points = SQUARE.copy()
    mesh = QuadMesh.of(points, FACE)
    points[0, 0] = 9.0
    assert mesh.vertices[0, 0] == 0.0
    for name in ("vertices", "edge_vectors", "edge_lengths", "face_area_vectors", "face_normals",
                 "face_centers", "vertex_normals", "corners"):  # fmt: skip
        with pytest.raises(ValueError, match="read-only"):
            getattr(mesh, name)[0] = 1.0


def test_with_vertices_shares_the_topology_and_keeps_the_kind():
    mesh = curved_mesh()
    moved = mesh.with_vertices(mesh.vertices + 1.0)
    assert moved.topology is mesh.topology
    assert type(moved) is QuadMesh
    assert type(polygon_mesh().with_vertices(polygon_mesh().vertices)) is PolyMesh


def test_reversed_turns_normals_and_stars():
    mesh = zoo()["two_handles"][0]
    back = mesh.reversed()
    assert np.allclose(back.face_normals, -mesh.face_normals, atol=1e-15)
    assert np.allclose(back.vertex_normals, -mesh.vertex_normals, atol=1e-15)
    forward = mesh.topology.star(0)[0]
    again = back.topology.star(0)[0]
    turned = again[::-1]
    start = turned.tolist().index(forward[0])
    assert np.roll(turned, -start).tolist() == forward.tolist()
    assert (back.reversed().topology.indices == mesh.topology.indices).all()


def test_area_vector_of_a_quad_is_half_the_cross_product_of_its_diagonals():
    mesh = curved_mesh(noise=0.1)
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    # Same sum in another order: rounding of numbers near 1.
    assert np.allclose(mesh.face_area_vectors, 0.5 * np.cross(c - a, d - b), atol=1e-14)


def test_area_vectors_of_a_closed_mesh_sum_to_zero():
    for name in ("torus", "two_handles", "l_shape"):
        mesh = zoo()[name][0]
        assert np.allclose(mesh.face_area_vectors.sum(axis=0), 0.0, atol=1e-12)


def test_polygon_normals_centers_and_areas():
    mesh = polygon_mesh()
    assert np.allclose(mesh.face_normals, [[0, 0, 1]] * 4, atol=1e-15)
    # The polygons tile the regular decagon of circumradius 1.
    assert np.isclose(mesh.face_area_vectors[:, 2].sum(), 5 * np.sin(2 * np.pi / 10), atol=1e-14)
    assert np.allclose(mesh.face_centers[2], mesh.vertices[[0, 8, 9]].mean(axis=0))


def test_normals_do_not_suffer_far_from_the_origin():
    rotation = random_rotation(np.random.default_rng(3))
    near = curved_mesh()
    near = near.with_vertices(near.vertices @ rotation.T)
    far = near.with_vertices(near.vertices + 1e6)
    # Coordinates of 1e6 are stored to 1e-10: that, over edges of length 1, and no more.
    assert np.abs(far.face_normals - near.face_normals).max() < 5e-10


def test_face_without_area_has_zero_normal():
    mesh = QuadMesh.of(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]]), FACE)
    assert (mesh.face_normals == 0).all()


def test_edge_lengths_and_mean():
    mesh = QuadMesh.of(SQUARE * [3.0, 1.0, 1.0], FACE)
    assert sorted(mesh.edge_lengths.tolist()) == [1.0, 1.0, 3.0, 3.0]
    assert mesh.mean_edge_length == 2.0
