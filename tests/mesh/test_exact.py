import numpy as np
import pytest
from shapes import curved_mesh, cyclide, sampled, torus

from pqmesh.errors import MeshError
from pqmesh.mesh import exact
from pqmesh.mesh.measure import (
    circle_deviation,
    fitted_cones,
    nonconvex_faces,
    planarity,
)
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Topology

STEPS = [0.0, 0.3, 0.8, 1.1]
PROFILE = [[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9]]


@pytest.mark.parametrize(
    ("m", "n", "closed", "vertices", "euler"),
    [
        (2, 3, (False, False), 12, 1),
        (1, 1, (False, False), 4, 1),
        (3, 2, (True, False), 9, 0),
        (2, 3, (False, True), 9, 0),
        (3, 5, (True, True), 15, 0),
    ],
)
def test_grid_faces_close_where_asked(m, n, closed, vertices, euler):
    t = Topology(exact.grid_faces(m, n, closed), vertices)
    assert t.n_faces == m * n
    assert t.euler_characteristic == euler


@pytest.mark.parametrize(
    ("m", "n", "closed", "text"),
    [
        (0, 2, (False, False), "An open grid direction needs at least 1 faces; m is 0"),
        (2, 0, (False, False), "An open grid direction needs at least 1 faces; n is 0"),
        (2, 2, (True, False), "A closed grid direction needs at least 3 faces; m is 2"),
        (2, 2, (False, True), "A closed grid direction needs at least 3 faces; n is 2"),
    ],
)
def test_grid_faces_refuse_too_few(m, n, closed, text):
    with pytest.raises(MeshError, match=text):
        exact.grid_faces(m, n, closed)


def test_grid_normal_is_step_in_i_times_step_in_j():
    points = np.stack([*np.meshgrid(STEPS, STEPS, indexing="ij"), np.zeros((4, 4))], axis=-1)
    assert np.allclose(exact.grid_mesh(points).face_normals, [0, 0, 1])


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("closed_profile", [False, True])
def test_rotational_mesh_normals_point_away_from_the_axis(closed, closed_profile):
    turns = np.arange(8) * np.pi / 4
    t = np.arange(5) * 2 * np.pi / 5
    profile = np.column_stack([3 + np.cos(t), np.sin(t)]) if closed_profile else PROFILE
    mesh = exact.rotational_mesh(profile, turns, closed=closed, closed_profile=closed_profile)
    center = np.array([3.0, 0.0]) if closed_profile else np.array([0.0, 1.0])
    middle = mesh.face_centers
    radius = np.hypot(middle[:, 0], middle[:, 1])
    away = np.column_stack(
        [
            middle[:, :2] / radius[:, None] * (radius - center[0])[:, None],
            middle[:, 2] - center[1],
        ]
    )
    assert ((away * mesh.face_normals).sum(axis=1) > 0).all()
    assert mesh.topology.euler_characteristic == (0 if closed or closed_profile else 1)
    assert (mesh.vertices[:, 2].reshape(len(profile), -1) == np.array(profile)[:, 1:]).all()


def test_mirror_mesh_reflects_each_polyline_in_the_next_mirror():
    polyline = np.array([[0.0, 0, 0], [0.1, 1, 0.3], [-0.2, 2, 0.1]])
    mirrors = np.array([[2.0, 0, 0, 2], [1, 0.1, 0.2, 3]])
    grid = exact.mirror_mesh(polyline, mirrors).vertices.reshape(3, 3, 3)
    for j, mirror in enumerate(mirrors):
        n = mirror[:3] / np.linalg.norm(mirror[:3])
        middle = (grid[:, j] + grid[:, j + 1]) / 2
        # Midpoints lie in the mirror and moves are along its normal: what a reflection is.
        assert np.allclose(middle @ mirror[:3], mirror[3], atol=1e-14)
        assert np.allclose(np.cross(grid[:, j + 1] - grid[:, j], n), 0, atol=1e-14)


def test_mirror_plane_mesh_lies_in_the_reflected_planes():
    strip = np.array([[1, 0.2, z, 2 + 0.1 * z * z] for z in (-0.6, -0.1, 0.3, 0.8)])
    mesh = exact.mirror_plane_mesh(strip, [[-0.5, 1, 0, 0], [-1, 1, 0, 0], [-1.5, 1, 0, 0]])
    assert mesh.topology.n_faces == 2 * 2
    first = strip / np.linalg.norm(strip[:, :3], axis=1)[:, None]
    m = np.array([-0.5, 1, 0]) / np.hypot(0.5, 1)
    normal = first[1:3, :3] - 2 * (first[1:3, :3] @ m)[:, None] * m
    planes = face_planes(mesh).reshape(2, 2, 4)[:, 0]
    # Intersections of planes 20 degrees apart: a few digits above rounding.
    assert np.allclose(np.abs((planes[:, :3] * normal).sum(axis=1)), 1, atol=1e-12)
    assert np.allclose(np.abs(planes[:, 3]), first[1:3, 3], atol=1e-12)


@pytest.mark.parametrize("closed", [(False, False), (True, False), (True, True)])
def test_tangent_plane_mesh_lies_in_its_planes_and_keeps_their_side(closed):
    u = np.arange(12) * 2 * np.pi / 12
    v = np.arange(10) * 2 * np.pi / 10
    point, normal, _ = sampled(cyclide, u, v)
    planes = np.concatenate([normal, (point * normal).sum(axis=-1, keepdims=True)], axis=-1)
    mesh = exact.tangent_plane_mesh(planes, closed)
    keep = [slice(None) if c else slice(1, -1) for c in closed]
    wanted = planes[keep[0], keep[1]].reshape(-1, 4)
    order = np.lexsort(np.round(wanted, 6).T)
    reached = face_planes(mesh)
    sign = 1.0 if (reached[0, :3] @ wanted.T[:3]).max() > 0.999 else -1.0
    # Each wanted plane is there, on the same side as all others (one sign for the mesh).
    distance = np.abs(sign * reached[:, None] - wanted[None]).max(axis=-1)
    assert distance.min(axis=0)[order].max() < 1e-11


def test_tangent_plane_mesh_refuses_planes_parallel_to_a_line():
    # Tangent planes of a cylinder.
    t = np.arange(4) * 0.4
    planes = np.zeros((4, 4, 4))
    planes[..., 0], planes[..., 1], planes[..., 3] = np.cos(t)[:, None], np.sin(t)[:, None], 1.0
    with pytest.raises(MeshError, match="those of face 0 are parallel to one line"):
        exact.tangent_plane_mesh(planes)


def test_contact_element_mesh_refuses_mesh_without_interior_vertex():
    strip = exact.translational_mesh([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 1, 0], [0, 2, 0]])
    with pytest.raises(MeshError, match="needs an interior vertex; all vertices lie on"):
        exact.contact_element_mesh(strip, [0.1, 0.2, 1.0])


def test_propagated_normals_refuse_mesh_in_two_pieces():
    mesh = curved_mesh(1, 1)
    two = QuadMesh.of(np.vstack([mesh.vertices, mesh.vertices + 5]), [[0, 2, 3, 1], [4, 6, 7, 5]])
    with pytest.raises(MeshError, match="must be connected; vertex 4 cannot be reached from ver"):
        exact.propagated_normals(two, [0, 0, 1])


def test_propagated_normals_start_where_told():
    mesh = exact.stereographic_mesh(STEPS, STEPS)
    start = np.array([1.0, 2.0, 2.0])
    normals = exact.propagated_normals(mesh, start, root=5)
    assert np.allclose(normals[5], start / 3)
    # Every reflection keeps the length up to one rounding.
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-14)


def test_each_constructor_has_what_it_claims():
    grid, _ = sampled(torus, STEPS, STEPS)
    circular = [
        exact.rotational_mesh(PROFILE, STEPS),
        exact.mirror_mesh([[0, 0, 0], [0.1, 1, 0.3]], [[1, 0, 0, 1], [1, 0.1, 0.2, 3]]),
        exact.stereographic_mesh(STEPS, STEPS),
        exact.grid_mesh(grid),
    ]
    for mesh in circular:
        assert planarity(mesh).max() < 1e-13
        assert circle_deviation(mesh).max() < 1e-13
        assert len(nonconvex_faces(mesh)) == 0
    conical = exact.contact_element_mesh(exact.grid_mesh(grid), [1.0, 0.2, 0.1])
    # Intersections of planes: rounding over the angle between them squared.
    assert fitted_cones(conical).misfit.max() < 1e-10
