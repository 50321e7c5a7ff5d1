"""Koebe polyhedra: existence, uniqueness, exactness, and refusal of what is no polyhedron."""

import time

import numpy as np
import pytest
from graphs import divided_cube, dual, prism, pyramid, random_triangles
from shapes import random_rotation

from pqmesh.errors import MeshError
from pqmesh.koebe.functional import angle_gaps, log_radii
from pqmesh.koebe.layout import PlanePattern, Rounds, boost, centred, contacts, lorentz
from pqmesh.koebe.polyhedron import contact_points, koebe_polyhedron, tangency_deviation
from pqmesh.mesh import solids
from pqmesh.mesh.measure import nonconvex_faces
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Topology


def flatness(mesh):
    """Largest distance of a corner from its face's plane."""
    topology = mesh.topology
    away = mesh.vertices[topology.indices] - mesh.face_centers[topology.corner_faces]
    return np.abs((away * mesh.face_normals[topology.corner_faces]).sum(axis=1)).max()


def assert_koebe(mesh, tolerance):
    assert np.abs(tangency_deviation(mesh)).max() < tolerance
    assert flatness(mesh) < tolerance


# --- oracle 35: solids with midsphere -----------------------------------------------------------

MIDSPHERE = {
    "cube": solids.cube,
    "rhombic dodecahedron": solids.rhombic_dodecahedron,
    "rhombic triacontahedron": solids.rhombic_triacontahedron,
    "deltoidal icositetrahedron": solids.deltoidal_icositetrahedron,
    "deltoidal hexecontahedron": solids.deltoidal_hexecontahedron,
    "trapezohedron": lambda: solids.trapezohedron(7),
}


@pytest.mark.parametrize("name", MIDSPHERE)
def test_solids_with_a_midsphere_come_out_as_themselves(name):
    solid = MIDSPHERE[name]()
    distance = tangency_deviation(solid) + 1.0
    assert np.ptp(distance) < 1e-13
    found = koebe_polyhedron(solid.topology)
    expected = solid.vertices / distance.mean()
    # Congruent: equal products of all pairs of vertices.
    assert np.abs(found.vertices @ found.vertices.T - expected @ expected.T).max() < 1e-13
    assert_koebe(found, 1e-13)


def test_coordinates_of_the_cube_and_the_rhombic_dodecahedron():
    cube = koebe_polyhedron(solids.cube().topology)
    assert np.allclose(np.linalg.norm(cube.vertices, axis=1), np.sqrt(1.5), atol=1e-14)
    rhombic = koebe_polyhedron(solids.rhombic_dodecahedron().topology)
    radii = np.sort(np.linalg.norm(rhombic.vertices, axis=1))
    assert np.allclose(radii, np.sqrt(3 / 8) * np.array([3**0.5] * 8 + [2.0] * 6), atol=1e-14)


@pytest.mark.parametrize("n", [3, 4, 7, 30])
def test_regular_prism_has_its_closed_form(n):
    mesh = koebe_polyhedron(prism(n))
    heights = np.sqrt((mesh.vertices**2).sum(axis=1))
    assert np.allclose(heights, np.hypot(1.0, np.sin(np.pi / n)), atol=1e-13)


def test_faces_have_incircles_and_edges_the_sum_of_tangent_lengths():
    mesh = koebe_polyhedron(divided_cube(4))
    tangent = np.sqrt((mesh.vertices**2).sum(axis=1) - 1.0)
    assert np.abs(mesh.edge_lengths - tangent[mesh.edges].sum(axis=1)).max() < 1e-13
    sides = np.linalg.norm(mesh.corners - np.roll(mesh.corners, -1, axis=1), axis=2)
    assert np.abs(sides @ [1.0, -1.0, 1.0, -1.0]).max() < 1e-13


# --- figures promised ---------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "tolerance"), [(10, 1e-12), (30, 1e-10)])
def test_divided_cube_touches_the_sphere_to_the_promised_error(n, tolerance):
    mesh = koebe_polyhedron(divided_cube(n))
    assert isinstance(mesh, QuadMesh)
    assert mesh.topology.n_faces == 6 * n * n
    assert_koebe(mesh, tolerance)
    assert len(nonconvex_faces(mesh)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(("n", "seconds"), [(10, 1.0), (30, 20.0)])
def test_divided_cube_is_ready_within_the_promised_time(n, seconds):
    topology = divided_cube(n)
    start = time.perf_counter()
    koebe_polyhedron(topology)
    assert time.perf_counter() - start < seconds


# --- any polyhedral graph -----------------------------------------------------------------------

GRAPHS = {
    "triangles": random_triangles(80),
    "valences 3": dual(random_triangles(80)),
    "pyramid": pyramid(40),
    "prism": prism(25),
    "bipyramid": dual(prism(25)),
    "tetrahedron": pyramid(3),
}


@pytest.mark.parametrize("name", GRAPHS)
def test_every_polyhedral_graph_has_a_koebe_polyhedron(name):
    mesh = koebe_polyhedron(GRAPHS[name])
    assert_koebe(mesh, 1e-12)
    contacts = contact_points(mesh)
    assert np.abs(np.linalg.norm(contacts, axis=1) - 1.0).max() < 1e-12
    assert np.abs(contacts.mean(axis=0)).max() < 1e-12
    # Convex with the origin inside: every vertex beneath every other face's plane.
    heights = (mesh.face_normals * mesh.face_centers).sum(axis=1)
    assert heights.min() > 0
    assert (mesh.face_normals @ mesh.vertices.T - heights[:, None]).max() < 1e-12


def test_contact_lies_inside_the_edges():
    mesh = koebe_polyhedron(random_triangles(60, seed=3))
    a, b = mesh.vertices[mesh.edges[:, 0]], mesh.vertices[mesh.edges[:, 1]]
    contacts = contact_points(mesh)
    assert (((contacts - a) * (contacts - b)).sum(axis=1) < 0).all()


def test_dual_of_a_koebe_polyhedron_is_the_koebe_polyhedron_of_the_dual():
    mesh = koebe_polyhedron(random_triangles(40, seed=5))
    heights = (mesh.face_normals * mesh.face_centers).sum(axis=1)
    poles = mesh.face_normals / heights[:, None]
    other = koebe_polyhedron(dual(mesh.topology))
    assert np.abs(poles @ poles.T - other.vertices @ other.vertices.T).max() < 1e-10


def test_numbering_of_the_vertices_does_not_change_the_solid():
    topology = random_triangles(50, seed=7)
    renumbered = np.random.default_rng(1).permutation(50)
    faces = [renumbered[face].tolist() for face in topology.face_lists()]
    first = koebe_polyhedron(topology).vertices
    second = koebe_polyhedron(Topology(faces, 50)).vertices[renumbered]
    assert np.abs(first @ first.T - second @ second.T).max() < 1e-11


def test_reversed_topology_gives_the_mirror_image_with_outward_normals():
    topology = random_triangles(30, seed=9)
    mesh = koebe_polyhedron(topology)
    mirrored = koebe_polyhedron(mesh.reversed().topology)
    products = mesh.vertices @ mesh.vertices.T
    assert np.abs(products - mirrored.vertices @ mirrored.vertices.T).max() < 1e-12
    sense = [np.linalg.det(m.vertices[mesh.topology.face(0)]) for m in (mesh, mirrored)]
    assert sense[0] > 0 > sense[1]
    assert (mirrored.face_normals * mirrored.face_centers).sum(axis=1).min() > 0


def test_moebius_image_of_a_koebe_polyhedron_is_one_and_is_normalised_back():
    mesh = koebe_polyhedron(divided_cube(2))
    tangent = np.sqrt((mesh.vertices**2).sum(axis=1) - 1.0)
    circles = np.column_stack([mesh.vertices, np.ones(len(tangent))]) / tangent[:, None]
    moved = circles @ boost(random_rotation(np.random.default_rng(2)) @ [0.4, 0.0, 0.0]).T
    image = mesh.with_vertices(moved[:, :3] / moved[:, 3:])
    assert_koebe(image, 1e-13)
    assert np.linalg.norm(contact_points(image).mean(axis=0)) > 0.1
    back = centred(moved, contacts(moved, mesh.edges))
    back = back[:, :3] / back[:, 3:]
    assert np.abs(back @ back.T - mesh.vertices @ mesh.vertices.T).max() < 1e-12


# --- refusals -----------------------------------------------------------------------------------


def test_disc_is_refused():
    with pytest.raises(MeshError, match=r"edge 0-1 has one face .* use koebe_disc"):
        koebe_polyhedron(Topology([[0, 1, 2, 3]], 4))


def test_torus_is_refused():
    i, j = np.indices((3, 4)).reshape(2, -1)
    wrap = lambda a, b: (a % 3) * 4 + b % 4  # noqa: E731
    faces = np.stack([wrap(i, j), wrap(i + 1, j), wrap(i + 1, j + 1), wrap(i, j + 1)], axis=1)
    with pytest.raises(MeshError, match=r"V - E \+ F = 2; found 0, that is 1 handles"):
        koebe_polyhedron(Topology(faces, 12))


def test_two_pieces_are_refused():
    one = solids.cube().topology.face_lists()
    other = [[v + 8 for v in face] for face in one]
    with pytest.raises(MeshError, match="one piece; found 2"):
        koebe_polyhedron(Topology(one + other, 16))


def test_vertex_of_valence_two_is_refused():
    faces = solids.cube().topology.face_lists()
    a, b = faces[0][0], faces[0][1]
    split = []
    for face in faces:
        pairs = list(zip(face, [*face[1:], face[0]], strict=True))
        split.append([w for p, q in pairs for w in ([p, 8] if {p, q} == {a, b} else [p])])
    with pytest.raises(MeshError, match="vertex 8 has 2"):
        koebe_polyhedron(Topology(split, 9))


def test_graph_that_two_vertices_cut_apart_is_refused():
    # Two square pyramids' sides around the poles 0 and 1, joined by two hexagons... the outer
    # faces share the separating pair and more.
    faces = [
        [0, 2, 3],
        [2, 4, 3],
        [2, 1, 4],
        [3, 4, 1],
        [0, 5, 6],
        [5, 7, 6],
        [5, 1, 7],
        [6, 7, 1],
        [0, 3, 1, 5],
        [0, 6, 1, 2],
    ]
    with pytest.raises(MeshError, match=r"faces 8 and 9 share the vertices \[0, 1\]"):
        koebe_polyhedron(Topology(faces, 8))


def stacked(depth):
    """Tetrahedron with vertices stacked into one triangle: circles shrink like a power."""
    faces, n = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]], 4
    for _ in range(depth):
        a, b, c = faces.pop()
        faces += [[a, b, n], [b, c, n], [c, a, n]]
        n += 1
    return Topology(faces, n)


@pytest.mark.parametrize("depth", [10, 20, 30])
def test_circles_of_very_different_sizes_are_exact(depth):
    mesh = koebe_polyhedron(stacked(depth))
    assert mesh.edge_lengths.min() < 3.0 ** -(depth / 3)
    assert_koebe(mesh, 1e-11)


@pytest.mark.parametrize("depth", [40, 80])
def test_circles_beyond_double_precision_are_refused(depth):
    with pytest.raises(MeshError, match="large enough for double precision"):
        koebe_polyhedron(stacked(depth))


# --- the functional -----------------------------------------------------------------------------


def test_radii_close_every_circle_to_rounding():
    rng = np.random.default_rng(4)
    rounds = Rounds.of(divided_cube(3))
    count = int(rounds.corners.max()) + 1
    wanted = rng.normal(size=count)
    # Angles of radii at random; the functional must find these radii again.
    angles = -angle_gaps(rounds.corners, np.zeros(count), wanted)
    found = log_radii(rounds.corners, angles)
    assert np.abs(angle_gaps(rounds.corners, angles, found)).max() < 1e-13
    assert np.abs((found - found[0]) - (wanted - wanted[0])).max() < 1e-12


def test_given_radii_stay_and_the_others_follow():
    rounds = Rounds.of(divided_cube(3))
    count = int(rounds.corners.max()) + 1
    wanted = np.random.default_rng(5).normal(size=count)
    angles = -angle_gaps(rounds.corners, np.zeros(count), wanted)
    known = np.where(np.arange(count) < 7, wanted, np.nan)
    assert np.abs(log_radii(rounds.corners, angles, known) - wanted).max() < 1e-12


def test_angles_with_a_wrong_sum_are_refused():
    with pytest.raises(MeshError, match=r"pi for each of the 2 corners, 6\.28319; found 3\.14159"):
        log_radii(np.array([[0, 1], [1, 2]]), np.pi * np.array([0.25, 0.5, 0.25]))


def test_similarity_of_the_plane_is_a_moebius_map_of_the_sphere():
    rng = np.random.default_rng(7)
    centre, radius = rng.normal(size=(2, 6)), rng.uniform(0.1, 1.0, size=6)
    centre = centre[0] + 1j * centre[1]
    # Two circles and a line through their centres, orthogonal to both.
    normal = 1j * (centre[1] - centre[0]) / abs(centre[1] - centre[0])
    centre[5], radius[5] = normal, np.inf
    height = np.zeros(6)
    height[5] = (centre[0] * np.conj(normal)).real
    pattern = PlanePattern(centre, radius, height)
    moved = pattern.moved(0.3 - 0.8j, 2.0 + 1.0j)
    before, after = pattern.lifted(), moved.lifted()
    products = lorentz(before[:, None], before[None])
    assert np.allclose(lorentz(after[:, None], after[None]), products, atol=1e-10)
    assert np.allclose(np.diag(products), 1.0, atol=1e-10)
    assert np.abs(products[5, :2]).max() < 1e-12


def test_boost_keeps_the_lorentz_product():
    rng = np.random.default_rng(6)
    vectors = rng.normal(size=(5, 4))
    moved = vectors @ boost(rng.normal(size=3)).T
    assert np.allclose(lorentz(moved, moved), lorentz(vectors, vectors), atol=1e-12)


def test_result_is_a_polymesh_where_faces_are_no_quads():
    assert type(koebe_polyhedron(pyramid(5))) is PolyMesh
