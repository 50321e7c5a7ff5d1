"""The edge-offset test: found where it exists, refused where not, with the right dimension."""

import numpy as np
import pytest
from graphs import divided_cube

from pqmesh.errors import MeshError
from pqmesh.koebe.christoffel import christoffel_dual
from pqmesh.koebe.discs import koebe_disc
from pqmesh.koebe.edge_cones import edge_cones, sign_classes
from pqmesh.koebe.edge_offset import edge_offset_test, image_error, nearest_image
from pqmesh.koebe.families import discrete_catenoid, rotational_koebe, square_koebe
from pqmesh.koebe.members import parallel_member
from pqmesh.koebe.polyhedron import koebe_polyhedron
from pqmesh.mesh import solids
from pqmesh.mesh.exact import grid_faces, grid_mesh, mirror_plane_mesh, rotational_mesh
from pqmesh.mesh.topology import Topology


def random_disc(m, n, seed=0):
    topology = Topology(grid_faces(m, n)[:, ::-1], (m + 1) * (n + 1))
    radii = np.exp(0.1 * np.random.default_rng(seed).normal(size=topology.n_vertices))
    return koebe_disc(topology, radii=np.where(topology.is_boundary_vertex, radii, np.nan))


def bumpy_member(image, seed=0):
    bumps = np.random.default_rng(seed).normal(size=image.vertices.shape)
    return parallel_member(image, 4.0 * image.vertices + 0.05 * bumps)


WITH_IMAGE = {
    "catenoid": (discrete_catenoid(12, -1.0, 5), rotational_koebe(12, -1.0, 5)),
    "coarse catenoid": (discrete_catenoid(4, -1.0, 4), rotational_koebe(4, -1.0, 4)),
    "fine catenoid": (discrete_catenoid(60, -0.3, 6), rotational_koebe(60, -0.3, 6)),
    "enneper": (
        christoffel_dual(square_koebe(9, 8, 0.1, (-0.4, -0.4))),
        square_koebe(9, 8, 0.1, (-0.4, -0.4)),
    ),
    "sphere": (koebe_polyhedron(divided_cube(4)), koebe_polyhedron(divided_cube(4))),
    "bumpy": (bumpy_member(random_disc(6, 5)), random_disc(6, 5)),
}


@pytest.mark.parametrize("name", WITH_IMAGE)
def test_image_of_a_mesh_with_edge_offsets_is_found(name):
    mesh, image = WITH_IMAGE[name]
    found = edge_offset_test(mesh)
    assert found.exists
    assert found.error < 1e-11
    assert found.family_dimension in (0, None)
    # On the side of the normals, which may be the other one.
    sign = np.sign((found.image * image.vertices).sum())
    assert np.abs(sign * found.image - image.vertices).max() < 1e-9
    assert (found.image * mesh.vertex_normals).sum() > 0


def folded(factors):
    """Mesh of revolution parallel to a Koebe mesh, its profile turning back where signs change."""
    image = rotational_koebe(16, -1.2, len(factors) + 1)
    steps = np.diff(image.vertices[::16][:, [0, 2]], axis=0) * np.array(factors)[:, None]
    profile = np.array([3.0, 0.0]) + np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    turns = 2 * np.pi * np.arange(16) / 16
    return image.with_vertices(rotational_mesh(profile, turns, closed=True).vertices), image


@pytest.mark.parametrize(
    "factors", [[1, 1, 1, 1, -1, -1, -1], [1, 1, -0.3, 0.5, 1, -1], [1, -1, 1, -1, 1, -1]]
)
def test_image_is_found_where_the_mesh_folds_back(factors):
    mesh, image = folded(factors)
    found = edge_offset_test(mesh)
    assert found.exists
    sign = np.sign((found.image * image.vertices).sum())
    assert np.abs(sign * found.image - image.vertices).max() < 1e-12


@pytest.mark.parametrize("seed", range(4))
def test_image_of_a_wild_member_is_found_whatever_its_sign_classes(seed):
    image = random_disc(7, 8, seed)
    rng = np.random.default_rng(seed)
    wild = image.vertices * rng.normal(size=3) + 0.4 * rng.normal(size=image.vertices.shape)
    mesh = parallel_member(image, wild)
    assert len(set(edge_cones(mesh).signs)) > 3
    found = edge_offset_test(mesh)
    assert found.exists
    sign = np.sign((found.image * image.vertices).sum())
    assert np.abs(sign * found.image - image.vertices).max() < 1e-6


def test_boxes_have_one_edge_offset():
    cube = solids.cube()
    for scale in ([1.0, 1.0, 1.0], [1.0, 2.0, 0.3]):
        found = edge_offset_test(cube.with_vertices(cube.vertices * scale))
        assert found.exists
        assert found.family_dimension == 0
        assert np.abs(found.image - cube.vertices / 2**0.5).max() < 1e-14


def test_one_rectangle_has_a_one_parameter_family():
    # Plane sections of the sphere at any height: 4 edges touch, P(M) has dimension 5.
    flat = grid_mesh([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]])
    found = edge_offset_test(flat)
    assert found.exists
    assert found.family_dimension == 1


def test_flat_grid_has_translations_only_and_they_do_not_count():
    i, j = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    found = edge_offset_test(grid_mesh(np.stack([i, j, 0 * i], axis=-1)))
    assert not found.exists
    assert found.image is None


def test_meshes_without_edge_offsets_are_recognised():
    # Conical, with exact face offsets; circular, with exact vertex offsets.
    roof = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.3, 1.8]], 0.3 * np.arange(6))
    strip = [[1, 0.2, z, 2 + 0.1 * z * z] for z in (-0.6, -0.1, 0.3, 0.8, 1.1)]
    mirrors = [[-t, 1, 0, 0] for t in (0.5, 1.0, 1.5, 2.3)]
    for mesh in (roof, mirror_plane_mesh(strip, mirrors)):
        found = edge_offset_test(mesh)
        assert not found.exists
        assert found.error > 1e-4
        assert found.family_dimension is None


def test_error_is_that_of_the_offset():
    mesh = WITH_IMAGE["catenoid"][0]
    noise = 1e-5 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    moved = mesh.with_vertices(mesh.vertices + noise)
    found = edge_offset_test(moved)
    assert not found.exists
    assert 1e-7 < found.error < 1e-2
    assert abs(found.error - image_error(moved, nearest_image(moved))) < 1e-15
    assert edge_offset_test(moved, tolerance=2 * found.error).exists


def test_edge_of_no_length_is_refused():
    mesh = square_koebe(3, 3, 0.1)
    points = mesh.vertices.copy()
    points[1] = points[0]
    with pytest.raises(MeshError, match="edge 0-1 has length 0"):
        edge_offset_test(mesh.with_vertices(points))


# --- cones through the edges --------------------------------------------------------------------


def test_sign_classes_tell_elliptic_vertices_from_saddles():
    ball = edge_cones(square_koebe(6, 6, 0.1, (-0.25, -0.25)))
    saddle = edge_cones(discrete_catenoid(12, -0.5, 5))
    assert set(ball.signs) == {"++++"}
    assert set(saddle.signs) == {"+-+-"}
    for cones in (ball, saddle):
        assert cones.misfit.max() < 1e-12


def test_cone_vectors_are_the_image_up_to_its_side():
    mesh, image = WITH_IMAGE["catenoid"]
    cones = edge_cones(mesh)
    wanted = image.vertices[cones.vertices]
    sign = np.sign((cones.vectors * wanted).sum(axis=1))
    assert (sign == sign[0]).all()
    assert np.abs(sign[:, None] * cones.vectors - wanted).max() < 1e-12


def test_one_condition_an_edge_past_the_third():
    mesh = WITH_IMAGE["enneper"][0]
    noise = 1e-3 * np.random.default_rng(3).normal(size=mesh.vertices.shape)
    cones = edge_cones(mesh.with_vertices(mesh.vertices + noise))
    assert cones.misfit.min() > 1e-7
    three = edge_cones(solids.cube().with_vertices(solids.cube().vertices * [1.0, 1.2, 1.4]))
    assert three.misfit.max() < 1e-12


def test_mesh_without_interior_vertices_has_no_cones():
    assert len(edge_cones(square_koebe(2, 4, 0.1)).vertices) == 0


def test_classes_of_high_valences_are_the_two_of_nature():
    assert sign_classes(8).tolist() == [[1.0] * 8, [1.0, -1.0] * 4]
    assert len(sign_classes(5)) == 16
