import numpy as np
import pytest
from shapes import curved_mesh, polygon_mesh, random_rotation

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.isomorphism import isomorphism
from pqmesh.mesh.planes import dual_mesh, face_planes, mesh_from_planes, plane_meetings
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.solids import cube, deltoidal_icositetrahedron, rhombic_triacontahedron
from pqmesh.mesh.topology import Topology


def test_face_planes_pass_halfway_between_the_diagonals():
    mesh = curved_mesh(noise=0.05)
    planes = face_planes(mesh)
    signed = np.einsum("fki,fi->fk", mesh.corners, planes[:, :3]) - planes[:, 3:]
    # Corners are alternately above and below by the same height.
    assert np.allclose(signed, signed[:, :1] * [1, -1, 1, -1], atol=1e-14)
    turned = face_planes(mesh.reversed())
    assert np.allclose(turned, -planes, atol=1e-14)


def test_plane_meetings_match_direct_solution_and_least_squares():
    rng = np.random.default_rng(0)
    planes = rng.normal(size=(20, 3, 4))
    found = plane_meetings(planes)
    exact = np.linalg.solve(planes[..., :3], planes[..., 3:])[..., 0]
    # Two backward stable solutions differ by rounding times the condition.
    assert (np.abs(found.points - exact).max(axis=1) < 1e-14 * found.condition**2).all()
    assert np.allclose(found.condition, np.linalg.cond(planes[..., :3]))
    more = rng.normal(size=(20, 6, 4))
    found = plane_meetings(more)
    for k in range(20):
        best = np.linalg.lstsq(more[k, :, :3], more[k, :, 3], rcond=None)[0]
        assert np.allclose(found.points[k], best, atol=1e-12)
        assert np.isclose(found.misfit[k], np.abs(more[k, :, :3] @ best - more[k, :, 3]).max())


@pytest.mark.parametrize(("rank", "k"), [(1, 1), (1, 4), (2, 2), (2, 5)])
def test_plane_meetings_leave_the_guess_where_the_planes_do(rank, k):
    rng = np.random.default_rng(rank * 10 + k)
    frame = random_rotation(rng)
    normals = rng.normal(size=(k, rank)) @ frame[:rank]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    common, guess = rng.normal(size=3), rng.normal(size=(1, 3))
    planes = np.column_stack([normals, normals @ common])[None]
    found = plane_meetings(planes, guess)
    assert np.isinf(found.condition[0])
    # The planes meet exactly: rounding over an angle of a few degrees.
    assert found.misfit[0] < 1e-13
    step = found.points[0] - guess[0]
    assert np.abs(frame[rank:] @ step).max() < 1e-13


def test_plane_meetings_keep_digits_far_from_the_origin():
    normals = np.eye(3) + 0.1
    point = np.array([1e6, -2e6, 5e5])
    near = point + 0.25
    planes = np.column_stack([normals, normals @ point])[None]
    # h itself is rounded at 1e6 * 1e-16: no more than that may be lost.
    assert np.abs(plane_meetings(planes, near[None]).points[0] - point).max() < 2e-9


@pytest.mark.parametrize("mesh", [cube(), deltoidal_icositetrahedron(), rhombic_triacontahedron()])
def test_mesh_from_its_own_planes_is_the_mesh(mesh):
    again = mesh_from_planes(mesh, face_planes(mesh))
    # Planes at 30 degrees and more: rounding.
    assert np.abs(again.vertices - mesh.vertices).max() < 1e-13
    assert again.topology is mesh.topology
    assert type(again) is QuadMesh


def test_mesh_from_planes_keeps_boundary_in_planes_and_next_to_the_guess():
    mesh = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9]], np.arange(5) * 0.3)
    planes = face_planes(mesh)
    start = mesh.with_vertices(mesh.vertices + 0.05)
    again = mesh_from_planes(start, planes)
    signed = np.einsum("fki,fi->fk", again.corners, planes[:, :3]) - planes[:, 3:]
    assert np.abs(signed).max() < 1e-13
    inside = ~mesh.topology.is_boundary_vertex
    assert np.abs(again.vertices - mesh.vertices)[inside].max() < 1e-13
    corner = again.vertices[0] - start.vertices[0]
    assert np.linalg.norm(np.cross(corner, planes[0, :3])) < 1e-14


def test_dual_of_the_dual_is_the_same_abstract_mesh():
    for mesh in (cube(), rhombic_triacontahedron()):
        planes = np.column_stack([mesh.vertices, np.ones(len(mesh.vertices))])
        dual = dual_mesh(mesh.topology, planes)
        again = dual_mesh(dual.topology, face_planes(mesh))
        assert isomorphism(again.topology, mesh.topology) is not None
        assert np.abs(again.vertices - mesh.vertices).max() < 1e-13
        # The pole of a face plane that touches the unit sphere is the contact point.
        assert np.allclose(np.linalg.norm(dual.vertices, axis=1), 1.0, atol=1e-13)


def test_dual_mesh_keeps_the_orientation_and_drops_what_it_does_not_use():
    mesh = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9]], np.arange(5) * 0.3)
    normals = mesh.vertex_normals
    planes = np.column_stack([normals, (normals * mesh.vertices).sum(axis=1)])
    dual = dual_mesh(mesh.topology, planes, mesh.face_centers)
    inner = np.flatnonzero(~mesh.topology.is_boundary_vertex)
    assert dual.topology.n_faces == len(inner)
    assert ((dual.face_normals * normals[inner]).sum(axis=1) > 0.99).all()
    # A 3 x 1 row of faces off to the side touches no interior vertex.
    three = Topology([*mesh.topology.face_lists(), [15, 16, 20, 21]], 22)
    more = np.vstack([planes, planes[:2]])
    assert dual_mesh(three, more).topology.n_vertices == dual.topology.n_vertices


def test_dual_of_polygons_has_polygons():
    mesh = polygon_mesh()
    rng = np.random.default_rng(0)
    normals = np.column_stack([0.3 * rng.normal(size=(11, 2)), np.ones(11)])
    planes = np.column_stack([normals, (normals * mesh.vertices).sum(axis=1)])
    dual = dual_mesh(mesh.topology, planes)
    assert dual.topology.face_sizes.tolist() == [4]
    assert dual.topology.n_vertices == 4


def test_dual_mesh_refuses_planes_parallel_to_a_line_by_face():
    mesh = curved_mesh(2, 2)
    planes = np.tile([0.0, 0.0, 1.0, 0.0], (9, 1))
    planes[0, :3] = [0.6, 0.0, 0.8]
    with pytest.raises(MeshError, match=r"those of face 0 are parallel to one line \(4 such"):
        dual_mesh(mesh.topology, planes)
