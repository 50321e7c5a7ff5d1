"""Koebe discs: prescribed boundaries, when they exist, and the dimension of their class."""

import numpy as np
import pytest
from shapes import zoo

from pqmesh.errors import MeshError
from pqmesh.koebe.discs import exact_image, koebe_disc, koebe_near, planar_radii
from pqmesh.koebe.families import square_koebe
from pqmesh.koebe.polyhedron import tangency_deviation
from pqmesh.koebe.terms import Tangency
from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.optimize.problem import gathered
from pqmesh.optimize.terms import Planarity


def grid(m, n):
    return Topology(grid_faces(m, n)[:, ::-1], (m + 1) * (n + 1))


def at_rim(topology, values):
    return np.where(topology.is_boundary_vertex, values, np.nan)


def random_radii(topology, seed=0, spread=0.3):
    rng = np.random.default_rng(seed)
    return at_rim(topology, np.exp(spread * rng.normal(size=topology.n_vertices)))


def polygon_angles(mesh):
    """Angles of the boundary polygon of circle centres in the plane, nan inside."""
    radius = planar_radii(mesh)
    square = (mesh.vertices**2).sum(axis=1)
    # Pole x of the circle |z - p| = r from (0, 0, -1): (2p, 1 - p^2 + r^2) / (1 + p^2 - r^2).
    weight = 2.0 / (1.0 + mesh.vertices[:, 2])
    centre = 0.5 * weight[:, None] * mesh.vertices[:, :2]
    assert np.allclose(radius, 0.5 * weight * np.sqrt(square - 1.0))
    loop = mesh.topology.boundary_loops[0]
    points = centre[loop] @ [1.0, 1.0j]
    ahead, behind = np.roll(points, -1) - points, np.roll(points, 1) - points
    angles = np.full(mesh.topology.n_vertices, np.nan)
    angles[loop] = np.mod(np.angle(behind / ahead), 2 * np.pi)
    return angles


# --- what is prescribed is kept -----------------------------------------------------------------


@pytest.mark.parametrize("size", [(3, 4), (12, 7)])
def test_given_radii_are_kept_up_to_a_common_factor(size):
    topology = grid(*size)
    radii = random_radii(topology)
    mesh = koebe_disc(topology, radii=radii)
    ratio = (planar_radii(mesh) / radii)[topology.is_boundary_vertex]
    assert np.ptp(ratio) < 1e-11 * ratio.mean()
    assert np.abs(tangency_deviation(mesh)).max() < 1e-13
    assert planarity(mesh).max() < 1e-12


def test_given_angles_are_those_of_the_polygon_of_centres():
    topology = grid(5, 6)
    rng = np.random.default_rng(1)
    loop = topology.boundary_loops[0]
    bend = 0.2 * rng.normal(size=len(loop))
    angles = np.where(topology.valence == 2, np.pi / 2, np.pi)
    angles[loop] += bend - bend.mean()
    mesh = koebe_disc(topology, angles=at_rim(topology, angles))
    assert np.nanmax(np.abs(polygon_angles(mesh) - at_rim(topology, angles))) < 1e-11
    assert np.abs(tangency_deviation(mesh)).max() < 1e-13


def test_angles_and_radii_may_be_mixed():
    topology = grid(4, 4)
    radii = random_radii(topology)
    radii[np.arange(0, 25, 5)] = np.nan
    angles = np.full(25, np.nan)
    angles[np.arange(0, 25, 5)] = [1.4, 3.0, 3.1, 3.3, 1.7]
    mesh = koebe_disc(topology, angles=angles, radii=radii)
    given = np.isfinite(angles)
    assert np.abs(polygon_angles(mesh) - angles)[given].max() < 1e-12
    ratio = (planar_radii(mesh) / radii)[np.isfinite(radii)]
    assert np.ptp(ratio) < 1e-12 * ratio.mean()


def test_boundary_of_a_koebe_mesh_gives_the_mesh_back():
    mesh = koebe_disc(grid(5, 4), radii=random_radii(grid(5, 4), seed=3))
    radii = at_rim(mesh.topology, planar_radii(mesh))
    again = koebe_disc(mesh.topology, radii=radii)
    assert np.abs(planar_radii(again) - planar_radii(mesh)).max() < 1e-12
    assert np.abs(again.vertices @ again.vertices.T - mesh.vertices @ mesh.vertices.T).max() < 1e-11


def test_right_angles_give_the_square_grid_in_closed_form():
    # Oracle 37 from the boundary alone.
    topology = grid(3, 5)
    angles = at_rim(topology, np.where(topology.valence == 2, np.pi / 2, np.pi))
    mesh = koebe_disc(topology, angles=angles, reach=0.4)
    radii = planar_radii(mesh)
    assert np.ptp(radii) < 1e-14
    expected = square_koebe(4, 6, 2 * radii[0], (-3 * radii[0], -5 * radii[0]))
    products = expected.vertices @ expected.vertices.T
    assert np.abs(mesh.vertices @ mesh.vertices.T - products).max() < 1e-13


def test_reach_is_the_size_in_the_plane():
    topology = grid(4, 4)
    for reach in (0.1, 0.5, 0.9):
        mesh = koebe_disc(topology, radii=random_radii(topology), reach=reach)
        lengths = np.sqrt((mesh.vertices**2).sum(axis=1) - 1.0)
        i, j = mesh.edges.T
        share = (lengths[i] / (lengths[i] + lengths[j]))[:, None]
        contacts = (1.0 - share) * mesh.vertices[i] + share * mesh.vertices[j]
        plane = contacts[:, :2] / (1.0 + contacts[:, 2:])
        assert np.abs(np.linalg.norm(contacts, axis=1) - 1.0).max() < 1e-13
        assert abs(np.linalg.norm(plane, axis=1).max() - reach) < 1e-12


NOTCHED = {
    "without a corner": Topology(grid_faces(3, 3)[:-1, ::-1], 15),
    "valence 5": Topology([[0, 2 * i + 1, 2 * i + 2, (2 * i + 2) % 10 + 1] for i in range(5)], 11),
    "mixed faces": Topology([[0, 1, 2], [0, 2, 3, 4], [0, 4, 5, 6, 1]], 7),
}


@pytest.mark.parametrize("name", NOTCHED)
def test_discs_with_notches_irregular_vertices_and_other_faces(name):
    topology = NOTCHED[name]
    mesh = koebe_disc(topology, radii=at_rim(topology, 1.0))
    assert np.abs(tangency_deviation(mesh)).max() < 1e-13
    away = mesh.vertices[topology.indices] - mesh.face_centers[topology.corner_faces]
    assert np.abs((away * mesh.face_normals[topology.corner_faces]).sum(axis=1)).max() < 1e-13


def test_layout_of_five_thousand_faces_is_exact():
    topology = grid(50, 100)
    mesh = koebe_disc(topology, radii=random_radii(topology), reach=0.8)
    assert topology.n_faces == 5000
    assert np.abs(tangency_deviation(mesh)).max() < 1e-12
    assert planarity(mesh).max() < 1e-11


# --- oracle 11: dimension -----------------------------------------------------------------------


@pytest.mark.parametrize(("m", "n"), [(1, 1), (2, 3), (4, 4), (5, 3)])
def test_koebe_meshes_of_a_grid_have_dimension_2m_2n_3(m, n):
    topology = grid(m, n)
    mesh = koebe_disc(topology, radii=random_radii(topology, seed=m + n), reach=0.7)
    rows = []
    for term in (Tangency.on(mesh), Planarity({"image": mesh.faces}, mesh.mean_edge_length)):
        _, jacobian = term.evaluate(gathered(term, {"image": mesh.vertices}))
        stencil = term.stencils["image"]
        full = np.zeros((len(stencil), topology.n_vertices, 3))
        np.put_along_axis(full, stencil[:, :, None], jacobian[:, 0], axis=1)
        rows.append(full.reshape(len(stencil), -1))
    values = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    rank = int((values > 1e-8 * values[0]).sum())
    assert 3 * topology.n_vertices - rank == 2 * m + 2 * n + 3


# --- refusals -----------------------------------------------------------------------------------


def test_angles_that_do_not_close_the_polygon_are_refused():
    topology = grid(2, 2)
    with pytest.raises(MeshError, match="must sum to pi for each of the 16 corners"):
        koebe_disc(topology, angles=at_rim(topology, 2.0))


def test_corner_wider_than_its_one_face_is_refused_by_its_name():
    # A circle with one face can see no more than pi.
    topology = grid(4, 4)
    angles = np.where(topology.valence == 2, np.pi / 2, np.pi)
    loop = topology.boundary_loops[0]
    angles[loop] -= 1.7 / (len(loop) - 1)
    angles[0] = np.pi / 2 + 1.7
    with pytest.raises(MeshError, match=r"circles 0 want 3\.2708, and there is 3\.14159"):
        koebe_disc(topology, angles=at_rim(topology, angles))
    angles[0] -= 0.2
    angles[loop[1:]] += 0.2 / (len(loop) - 1)
    mesh = koebe_disc(topology, angles=at_rim(topology, angles))
    assert np.abs(tangency_deviation(mesh)).max() < 1e-13


def test_missing_double_and_senseless_boundary_data_are_refused():
    topology = grid(2, 2)
    radii = at_rim(topology, 1.0)
    radii[3] = np.nan
    with pytest.raises(MeshError, match="vertex 3 has none"):
        koebe_disc(topology, radii=radii)
    with pytest.raises(MeshError, match="vertex 0 has both"):
        koebe_disc(topology, radii=at_rim(topology, 1.0), angles=at_rim(topology, 1.0))
    with pytest.raises(MeshError, match=r"radii must be positive; vertex 0 has -1\.0"):
        koebe_disc(topology, radii=at_rim(topology, -1.0))
    with pytest.raises(MeshError, match=r"shape \(9,\)"):
        koebe_disc(topology, radii=np.ones(4))
    with pytest.raises(MeshError, match="reach must be positive"):
        koebe_disc(topology, radii=at_rim(topology, 1.0), reach=0.0)


def test_closed_meshes_and_rings_are_refused():
    ring = zoo()["annulus"][0].topology
    with pytest.raises(MeshError, match="found 2 boundaries"):
        koebe_disc(ring, radii=at_rim(ring, 1.0))


def test_circle_larger_than_half_of_the_sphere_is_refused():
    topology = grid(2, 2)
    koebe_disc(topology, radii=at_rim(topology, 1.0), reach=1.0)
    with pytest.raises(MeshError, match=r"vertex 4 is not .* smaller reach than 3"):
        koebe_disc(topology, radii=at_rim(topology, 1.0), reach=3.0)


# --- near given normals -------------------------------------------------------------------------


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_normals_of_a_koebe_mesh_lead_near_to_it_in_either_sense(mirror):
    mesh = square_koebe(7, 6, 0.1, (0.1, -0.2))
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1)[:, None]
    normals = normals * [1.0, mirror, 1.0]
    found = koebe_near(mesh.topology, normals)
    image = mesh.with_vertices(found)
    assert np.abs(tangency_deviation(image)).max() < 1e-13
    assert np.abs(found - mesh.vertices * [1.0, mirror, 1.0]).max() < 0.02 * mesh.mean_edge_length


def test_nearly_exact_image_is_made_exact():
    mesh = square_koebe(6, 6, 0.1, (-0.25, -0.25))
    noise = 1e-4 * np.random.default_rng(0).normal(size=mesh.vertices.shape)
    found, error = exact_image(mesh.with_vertices(mesh.vertices + noise))
    assert error < 1e-14
    assert np.abs(tangency_deviation(found)).max() < 1e-14
    assert planarity(found).max() < 1e-13
    assert np.abs(found.vertices - mesh.vertices).max() < 3e-3


def test_image_inside_the_sphere_is_refused():
    mesh = square_koebe(3, 3, 0.1, (-0.1, -0.1))
    with pytest.raises(MeshError, match="outside of the unit sphere"):
        exact_image(QuadMesh(0.9 * mesh.vertices, mesh.topology))
