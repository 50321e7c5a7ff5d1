"""Offset spaces: which offsets exist, how many there are, what the best one reaches."""

import numpy as np
import pytest
from shapes import curved_mesh, without_faces, zoo

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import grid_mesh, mirror_plane_mesh, rotational_mesh, translational_mesh
from pqmesh.mesh.measure import conicality_defect, fitted_cones
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.solids import cube, deltoidal_hexecontahedron
from pqmesh.offset.distances import is_offset, is_parallel
from pqmesh.offset.parallel import parallel_space
from pqmesh.offset.spaces import offset_space

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def full_turn(count):
    return 2 * np.pi / count * np.arange(count)


def mirror_planes(faces):
    """Conical without symmetry, boundary vertices slid along their inward edges."""
    rng = np.random.default_rng(0)
    z = np.linspace(-1, 1, faces + 2)
    strip = np.column_stack([np.ones(faces + 2), np.full(faces + 2, 0.1), z, 2 + 0.2 * z * z])
    turn = np.cumsum(rng.uniform(0.1, 0.2, faces + 1))
    tilt = 0.05 * rng.normal(size=(faces + 1, 2))
    return mirror_plane_mesh(strip, np.column_stack([-np.sin(turn), np.cos(turn), tilt]))


def slid(mesh):
    rng = np.random.default_rng(1)
    points = mesh.vertices.copy()
    for star in mesh.topology.stars(boundary=True):
        if star.faces.shape[1] == 2:
            inward = mesh.vertices[star.neighbors[:, 1]] - mesh.vertices[star.vertices]
            points[star.vertices] += rng.uniform(-0.15, 0.15, (len(inward), 1)) * inward
    return mesh.with_vertices(points)


def cylinder_sheared():
    """A cylinder along sheared rulings: two planes at each vertex, edges along them flat."""
    phi, z = np.array([0, 0.4, 0.9, 1.3, 1.9]), np.array([0, 0.2, 0.1, 0.4, 0.3])
    k = np.arange(5)
    rise = z[:, None] + k / 2
    return grid_mesh(
        np.stack([np.cos(phi)[:, None] + 0 * k, np.sin(phi)[:, None] + 0 * k, rise], axis=-1)
    )


def affine_family(mesh):
    """Dimension and residual of {S in P(M): n_f . s = 1}, in the basis of P(M)."""
    space = parallel_space(mesh)
    topology = mesh.topology
    basis = space.basis.reshape(-1, 3, space.dimension)[topology.indices]
    rows = np.einsum("ci,cik->ck", mesh.face_normals[topology.corner_faces], basis)
    values = np.linalg.svd(rows, compute_uv=False)
    solution = np.linalg.lstsq(rows, np.ones(len(rows)), rcond=1e-10)[0]
    return int((values < 1e-9 * values[0]).sum()), np.abs(rows @ solution - 1).max()


# --- faces ------------------------------------------------------------------------------------

FULL = mirror_planes(10)
INDEX = np.arange(100).reshape(10, 10)
OUTLINES = {
    "full": slid(FULL),
    "cut corner": slid(without_faces(FULL, [0, 1, 10])),
    "hole": slid(without_faces(FULL, INDEX[4:6, 4:6].ravel())),
    "notch": slid(without_faces(FULL, INDEX[0:2, 4:6].ravel())),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_conical_mesh_of_any_outline_has_its_face_offset(name):
    found = offset_space(OUTLINES[name], "face")
    assert found.exists
    # Exact in its planes and its inner edges, whatever the outline: oracle 59.
    assert found.error < 1e-13
    assert found.parallel_error < 1e-13
    dimension, residual = affine_family(OUTLINES[name])
    if name in ("full", "cut corner"):
        # The residual of the system in the basis of P(M), of the vectors themselves below.
        assert residual < 1e-11
        assert found.parallel_error_boundary < 1e-13
        assert found.family_dimension == dimension == 4
    else:
        assert 5e-5 < found.parallel_error_boundary < 2e-3
        assert residual > 1e-6


def test_offset_vectors_of_the_family_reach_the_distance():
    mesh = OUTLINES["full"]
    vectors = offset_space(mesh, "face").vectors
    other = mesh.with_vertices(mesh.vertices + 0.1 * vectors)
    assert is_offset(mesh, other, "face")
    assert not is_offset(mesh, other, "vertex")
    assert not is_offset(mesh, other, "edge")


FACE_FAMILIES = {
    "conical 3 x 3": slid(mirror_planes(3)),
    "strip": without_faces(
        translational_mesh([[0, 0, 0], [1, 0, 0.4], [2, 0, 0.3]],
                           [[0, j, 0.1 * j * j] for j in range(6)]),
        np.arange(5, 10),
    ),
    "rotational": rotational_mesh(PROFILE, 0.3 * np.arange(6)),
    "annulus": rotational_mesh(PROFILE, full_turn(8), closed=True),
    "closed torus": rotational_mesh([[4, 0], [3, 1], [2, 0], [3, -1]], full_turn(9),
                                    closed=True, closed_profile=True),
    "flat": grid_mesh(np.stack([*np.meshgrid(np.arange(4.0), np.arange(5.0), indexing="ij"),
                                np.zeros((4, 5))], axis=-1)),
    "sheared cylinder": cylinder_sheared(),
    "cube": cube(),
    "hexecontahedron": deltoidal_hexecontahedron(),
}  # fmt: skip


@pytest.mark.parametrize("name", FACE_FAMILIES)
def test_number_of_face_offsets_is_that_of_the_linear_system(name):
    mesh = FACE_FAMILIES[name]
    found = offset_space(mesh, "face")
    dimension, residual = affine_family(mesh)
    assert residual < 1e-11
    assert found.exists
    assert found.family_dimension == dimension
    assert max(found.error, found.parallel_error, found.parallel_error_boundary) < 1e-12


def test_sheared_cylinder_has_a_parallel_offset_though_its_vertices_do_not_balance():
    # Oracle 30: solvable in P(M) to 1e-12; the shortest vectors alone turn the flat edges.
    mesh = cylinder_sheared()
    assert np.abs(conicality_defect(mesh)[1]).max() == pytest.approx(0.958, abs=5e-4)
    assert affine_family(mesh)[1] < 1e-12
    found = offset_space(mesh, "face")
    assert is_offset(mesh, mesh.with_vertices(mesh.vertices + 0.2 * found.vectors), "face", 1e-11)
    cones = fitted_cones(mesh)
    shortest = np.array(found.vectors)
    shortest[cones.vertices] = cones.vectors
    naive = mesh.with_vertices(mesh.vertices + 0.2 * shortest)
    assert not is_parallel(mesh, naive, 1e-3)


def test_planar_mesh_that_is_not_conical_has_no_face_offset():
    bent = rotational_mesh(PROFILE, [0, 0.2, 0.5, 0.6, 1.0])
    found = offset_space(bent, "face")
    assert not found.exists
    assert found.family_dimension is None
    assert found.error > 1e-4


def test_face_offset_of_two_pieces_has_the_freedom_of_both():
    one = OUTLINES["full"]
    size = len(one.vertices)
    two = QuadMesh.of(
        np.vstack([one.vertices, one.vertices + 20]), np.vstack([one.faces, one.faces + size])
    )
    assert offset_space(two, "face").family_dimension == 8


# --- vertices ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mesh", "dimension"),
    [
        (rotational_mesh(PROFILE, [0, 0.2, 0.55, 0.8, 1.2]), 2),
        (rotational_mesh(PROFILE, full_turn(8), closed=True), 2),
        (rotational_mesh(PROFILE, full_turn(7), closed=True), 1),
        (rotational_mesh([[2, 0], [2, 1], [2, 2.5]], full_turn(7), closed=True), 1),
        (cube(), 2),
    ],
    ids=["disc", "even ring", "odd ring", "odd cylinder", "cube"],
)
def test_number_of_vertex_offsets_follows_the_loops(mesh, dimension):
    found = offset_space(mesh, "vertex")
    assert found.exists
    assert found.family_dimension == dimension
    assert found.error < 1e-11
    other = mesh.with_vertices(mesh.vertices + 0.1 * found.vectors)
    assert is_offset(mesh, other, "vertex")


def test_prism_over_a_quad_without_circumcircle_has_no_vertex_offset():
    base = np.array([[0, 0], [2, 0], [2.2, 1.5], [0.3, 1]])
    points = np.concatenate([np.column_stack([base, np.full(4, z)]) for z in (0.0, 1.0, 2.5)])
    faces = [[4 * k + i, 4 * k + (i + 1) % 4, 4 * k + 4 + (i + 1) % 4, 4 * k + 4 + i]
             for k in range(2) for i in range(4)]  # fmt: skip
    found = offset_space(QuadMesh.of(points, faces), "vertex")
    # Reflections close for the direction of the axis, which collapses all horizontal edges.
    assert found.error < 1e-11
    assert not found.exists
    assert found.family_dimension is None


def test_faces_off_the_circle_leave_a_gap():
    found = offset_space(curved_mesh(5, 4, noise=0.05), "vertex")
    assert not found.exists
    assert found.error > 1e-2


# --- doors ------------------------------------------------------------------------------------


def test_unknown_kind_pieces_and_empty_edges_are_refused():
    mesh = OUTLINES["full"]
    with pytest.raises(MeshError, match=r"one of vertex, .*face; found 'corner'"):
        offset_space(mesh, "corner")
    with pytest.raises(MeshError, match="in one piece"):
        offset_space(zoo()["two_pieces"][0], "vertex")
    points = np.array(mesh.vertices)
    points[mesh.edges[0, 1]] = points[mesh.edges[0, 0]]
    with pytest.raises(MeshError, match="Edges must have length"):
        offset_space(mesh.with_vertices(points), "face")


def test_real_conical_mesh_has_the_four_parameters_of_a_grid(data_folder):
    from pqmesh.io.formats import read_quad_mesh

    mesh = read_quad_mesh(data_folder / "conical1.obj")
    found = offset_space(mesh, "face", 1e-3)
    assert found.exists
    assert found.family_dimension == 4
    # The mesh is planar to 4e-5 and balanced to 0.04 degrees.
    assert found.error < 1e-5
    assert found.parallel_error < 1e-3
    assert not offset_space(mesh, "vertex", 1e-3).exists
