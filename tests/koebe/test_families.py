"""Exact Koebe meshes, discrete minimal surfaces, and their offsets: oracles 33 and 36 to 41."""

import numpy as np
import pytest
from shapes import observed_orders

from pqmesh.errors import MeshError
from pqmesh.koebe.christoffel import christoffel_dual, edge_families, mixed_areas
from pqmesh.koebe.discs import koebe_disc
from pqmesh.koebe.edge_offset import edge_offset, edge_offset_vectors
from pqmesh.koebe.families import discrete_catenoid, rotational_koebe, square_koebe
from pqmesh.koebe.members import parallel_member
from pqmesh.koebe.polyhedron import tangency_deviation
from pqmesh.mesh import solids
from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.topology import Topology
from pqmesh.offset.offsets import (
    edge_distance,
    edge_factors,
    face_distance,
    offset_layer,
    parallel_error,
    vertex_distance,
)


def offset(mesh, image, distance):
    return mesh.with_vertices(mesh.vertices + distance * image.vertices)


def areas(mesh, normals):
    return (mesh.face_area_vectors * normals).sum(axis=1)


def random_disc(m, n, seed=0):
    topology = Topology(grid_faces(m, n)[:, ::-1], (m + 1) * (n + 1))
    radii = np.exp(0.15 * np.random.default_rng(seed).normal(size=topology.n_vertices))
    return koebe_disc(topology, radii=np.where(topology.is_boundary_vertex, radii, np.nan))


# --- oracle 36: rotation ------------------------------------------------------------------------


@pytest.mark.parametrize("n", [3, 4, 12, 50])
def test_rotational_koebe_mesh_touches_the_sphere(n):
    mesh = rotational_koebe(n, -1.1, 5)
    assert np.abs(tangency_deviation(mesh)).max() < 2e-15
    assert planarity(mesh).max() < 1e-14
    assert ((mesh.face_normals * mesh.face_centers).sum(axis=1) > 0).all()


def test_rotational_koebe_mesh_has_published_values():
    rows = rotational_koebe(12, -1.0, 3).vertices[::12, [0, 2]]
    expected = [
        (0.670915153, -0.761594156),
        (0.930458125, -0.438454201),
        (1.033454349, 0.059299337),
    ]
    assert np.abs(rows - expected).max() < 1e-9


# --- oracle 37: square grid ---------------------------------------------------------------------


@pytest.mark.parametrize("shift", [(0.0, 0.0), (-0.31, 0.2), (1.5, -2.0)])
def test_square_grid_of_circles_gives_a_koebe_mesh(shift):
    mesh = square_koebe(6, 5, 0.17, shift)
    assert np.abs(tangency_deviation(mesh)).max() < 1e-13
    assert planarity(mesh).max() < 1e-13
    assert ((mesh.face_normals * mesh.face_centers).sum(axis=1) > 0).all()


def test_square_koebe_mesh_has_published_values():
    vertex = square_koebe(2, 2, 0.2, (0.2, 0.4)).vertices[0]
    assert np.abs(vertex - [0.336134454, 0.672269, 0.680672269]).max() < 1e-6
    assert abs(vertex[1] - 0.672268908) < 1e-9


def test_circle_of_half_the_sphere_is_refused():
    with pytest.raises(MeshError, match="smaller than half of the sphere"):
        square_koebe(2, 2, 3.0)


# --- oracle 38: members of P(S) -----------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_every_member_of_p_of_a_koebe_mesh_has_constant_edge_distance(seed):
    image = random_disc(6, 5, seed)
    bumpy = np.random.default_rng(seed).normal(size=image.vertices.shape)
    member = parallel_member(image, 3.0 * image.vertices + 0.3 * bumpy)
    assert parallel_error(member, image).max() < 1e-11
    for distance in (0.4, -0.7):
        moved = offset(member, image, distance)
        assert np.abs(edge_distance(member, moved) - abs(distance)).max() < 1e-9
    # Neither vertices nor faces keep one distance: the content is the edges'.
    assert np.ptp(vertex_distance(member, moved)) > 1e-3


def test_nearest_member_is_nearest():
    # Least squares: what is left over is across every other member.
    image = random_disc(4, 4, 5)
    rng = np.random.default_rng(2)
    targets = image.vertices + 0.2 * rng.normal(size=image.vertices.shape)
    member = parallel_member(image, targets)
    other = parallel_member(image, rng.normal(size=image.vertices.shape))
    left = member.vertices - targets
    across = (left * (other.vertices - member.vertices)).sum()
    assert abs(across) < 1e-9 * np.linalg.norm(left) * np.linalg.norm(other.vertices)


def test_member_does_not_depend_on_where_the_targets_are():
    image = random_disc(4, 3, 1)
    far = np.array([1e6, -2e6, 5e5])
    bumpy = image.vertices + 0.1 * np.random.default_rng(1).normal(size=image.vertices.shape)
    near_by, far_away = parallel_member(image, bumpy), parallel_member(image, bumpy + far)
    assert np.abs(far_away.vertices - far - near_by.vertices).max() < 1e-8


# --- oracle 39: catenoid ------------------------------------------------------------------------


def test_discrete_catenoid_has_published_values():
    points = discrete_catenoid(12, -1.0, 3).vertices[::12]
    assert np.abs(points[:, 0] - [1.490501437, 1.074739393, 0.967628615]).max() < 1e-9
    assert np.abs(np.diff(points[:, 2]) + 0.517638090).max() < 1e-9


@pytest.mark.parametrize("n", [4, 12, 40])
def test_discrete_catenoid_is_minimal_with_exact_edge_offsets(n):
    mesh, image = discrete_catenoid(n, -1.0, 6), rotational_koebe(n, -1.0, 6)
    assert parallel_error(mesh, image).max() < 1e-13
    assert np.abs(mixed_areas(mesh, image)).max() < 1e-13
    moved = offset(mesh, image, 0.3)
    assert np.abs(edge_distance(mesh, moved) - 0.3).max() < 1e-13


def test_discrete_catenoid_tends_to_the_catenoid_in_second_order():
    errors = []
    for n in (16, 32, 64, 128):
        mesh = discrete_catenoid(n, 0.0, n // 4)
        height = -mesh.vertices[:, 2]
        radius = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
        errors.append(np.abs(radius - np.cosh(height)).max())
    assert (np.abs(observed_orders(errors) - 2.0) < 0.15).all()


def test_christoffel_dual_of_the_rotational_mesh_is_the_catenoid():
    dual = christoffel_dual(rotational_koebe(12, -1.0, 5))
    expected = discrete_catenoid(12, -1.0, 5)
    ratio = (dual.edge_vectors * expected.edge_vectors).sum(axis=1) / expected.edge_lengths**2
    assert parallel_error(dual, expected).max() < 1e-12
    assert np.ptp(ratio) < 1e-11 * abs(ratio.mean())


# --- oracle 40: Enneper -------------------------------------------------------------------------


def test_discrete_enneper_closes_and_is_minimal():
    image = square_koebe(13, 11, 0.1, (-0.6, -0.5))
    mesh = christoffel_dual(image)
    assert parallel_error(mesh, image).max() < 1e-11
    assert np.abs(mixed_areas(mesh, image)).max() < 1e-11
    assert planarity(mesh).max() < 1e-12
    moved = offset(mesh, image, 0.5)
    assert np.abs(edge_distance(mesh, moved) - 0.5).max() < 1e-11


def test_discrete_enneper_tends_to_enneper_s_surface():
    # In curvature lines the dual of stereographic coordinates is (u - u^3/3 + u v^2, ...).
    errors = []
    for n in (4, 8, 16):
        step = 0.8 / n
        image = square_koebe(2 * n + 1, 2 * n + 1, step, (-0.8, -0.8))
        mesh = christoffel_dual(image)
        points = mesh.vertices - mesh.vertices[(2 * n + 1) * n + n]
        u, v = np.meshgrid(*[step * np.arange(-n, n + 1)] * 2, indexing="ij")
        smooth = np.stack(
            [u - u**3 / 3 + u * v**2, -(v - v**3 / 3 + v * u**2), v**2 - u**2], axis=-1
        ).reshape(-1, 3)
        scale = (points * smooth).sum() / (smooth**2).sum()
        errors.append(np.abs(points / scale - smooth).max())
    assert (np.abs(observed_orders(errors) - 2.0) < 0.3).all()


def test_dual_of_any_koebe_disc_is_minimal():
    image = random_disc(5, 6, 4)
    for flip in (False, True):
        mesh = christoffel_dual(image, flip=flip)
        size = np.abs(mesh.face_area_vectors).max() ** 0.5
        assert np.abs(mixed_areas(mesh, image)).max() < 1e-11 * size
        assert parallel_error(mesh, image).max() < 1e-11


def test_edge_families_alternate_and_need_even_valences():
    topology = Topology(grid_faces(3, 4), 20)
    signs = edge_families(topology)[topology.face_edges].reshape(-1, 4)
    assert (signs == -np.roll(signs, 1, axis=1)).all()
    with pytest.raises(MeshError, match="vertex 0 has odd valence"):
        edge_families(solids.cube().topology)


def test_dual_of_a_mesh_that_is_no_koebe_mesh_is_refused():
    with pytest.raises(MeshError, match="touch the unit sphere between its ends"):
        christoffel_dual(random_disc(3, 3).with_vertices(1.01 * random_disc(3, 3).vertices))


# --- oracle 41: boxes ---------------------------------------------------------------------------


def test_box_has_all_three_distances_constant():
    cube = solids.cube()
    box = cube.with_vertices(cube.vertices * [1.0, 2.0, 3.5])
    image = cube.with_vertices(cube.vertices / 2**0.5)
    moved = offset(box, image, 1.0)
    assert np.abs(vertex_distance(box, moved) - 1.5**0.5).max() < 1e-14
    assert np.abs(edge_distance(box, moved) - 1.0).max() < 1e-14
    assert np.abs(face_distance(box, moved) - 0.5**0.5).max() < 1e-14


# --- oracle 33: edge law and Steiner's formula --------------------------------------------------


def test_edges_and_areas_of_edge_offsets_follow_their_laws():
    image = random_disc(5, 4, 8)
    mesh = christoffel_dual(image)
    d = 0.2
    moved = offset(mesh, image, d)
    law = (1.0 + d * edge_factors(mesh, image.vertices))[:, None] * mesh.edge_vectors
    assert np.abs(moved.edge_vectors - law).max() < 1e-13 * np.abs(mesh.vertices).max()
    normals = image.face_normals
    steiner = (
        areas(mesh, normals) + 2 * d * mixed_areas(mesh, image) + d * d * areas(image, normals)
    )
    assert np.abs(areas(moved, normals) - steiner).max() < 1e-13 * np.abs(mesh.vertices).max() ** 2


# --- distances of lines -------------------------------------------------------------------------


def test_edge_distance_of_skew_edges_is_the_common_perpendicular():
    cube = solids.cube()
    other = cube.vertices.copy()
    a, b = cube.edges[0]
    along = (cube.vertices[b] - cube.vertices[a]) / 2.0
    side = np.eye(3)[np.abs(along).argmin()]
    up = np.cross(along, side)
    other[a], other[b] = cube.vertices[a] + 0.5 * up - side, cube.vertices[b] + 0.5 * up + side
    assert abs(edge_distance(cube, cube.with_vertices(other))[0] - 0.5) < 1e-14


def test_layers_of_edge_offsets_are_measured_by_their_edges():
    mesh = discrete_catenoid(10, -0.6, 4)
    vectors = edge_offset_vectors(mesh)
    layer = offset_layer(mesh, vectors, -0.2)
    assert layer.kind == "edge"
    assert layer.distance_error_max < 1e-13
    assert layer.parallel_error_max < 1e-13
    assert np.abs(layer.mesh.vertices - edge_offset(mesh, -0.2).vertices).max() < 1e-14
