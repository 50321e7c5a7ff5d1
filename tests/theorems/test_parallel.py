"""P(M) and its dimension on meshes of every kind, its members, and sizes of mesh classes."""

import numpy as np
import pytest
from pq import planarised, pq_rows
from shapes import curved_mesh, inverted, zoo

from pqmesh.mesh import solids
from pqmesh.mesh.exact import rotational_mesh, translational_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.distances import (
    constant_distance,
    edge_distance,
    face_distance,
    is_offset,
    is_parallel,
    parallel_error,
    vertex_distance,
)
from pqmesh.offset.parallel import generic_dimension, parallel_space

# Members of P(M) by singular vectors: theory tolerance of sines.
SINE = 1e-9
CIRCLE = np.array([[4, 0], [3, 1], [2, 0], [3, -1.0]])
PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def full_turn(count):
    return 2 * np.pi / count * np.arange(count)


def projected(mesh, seed=0):
    """A projective image that is not affine."""
    way = np.array([0.02, -0.03, 0.05])
    return mesh.with_vertices(mesh.vertices / (1 + mesh.vertices @ way)[:, None])


def three_valent_polyhedron(seed=0):
    """Faces touch the sphere in random points: all vertices have valence 3; 20 faces."""
    points = np.random.default_rng(seed).normal(size=(20, 3))
    return solids.sphere_tangent_mesh(points)


# --- oracle 7 ---------------------------------------------------------------------------------

TORUS = rotational_mesh(CIRCLE, full_turn(5), closed=True, closed_profile=True)
RING = rotational_mesh(PROFILE, full_turn(7), closed=True)
DIMENSIONS = {
    "grid 4 x 6": (pq_rows(4, 6), 4 + 6 + 3),
    "grid 1 x 9": (pq_rows(1, 9), 1 + 9 + 3),
    "translational 5 x 5": (
        translational_mesh(np.eye(3)[[0] * 6] * np.arange(6)[:, None] ** 1.2,
                           [[0, j, 0.1 * j * j] for j in range(6)]), 13),
    "not planar": (curved_mesh(6, 5, noise=0.1), 4),
    "annulus 3 x 5": (pq_rows(3, 5, closed=True), 5),
    "annulus 4 x 8": (pq_rows(4, 8, closed=True), 8),
    "rotational annulus 4 x 7": (RING, 4 + 7 + 1),
    "its projective image": (projected(RING), 4 + 7 + 1),
    "its inversion": (RING.with_vertices(inverted(RING.vertices, np.array([5.0, 1, 2]), 2.0)), 12),
    "torus 4 x 5": (planarised(TORUS, 0.1, seed=3), 4),
    "rotational torus 4 x 5": (TORUS, 4 + 5 - 1),
    "sphere type 12": (planarised(solids.rhombic_dodecahedron(), 0.1), 6),
    "sphere type 24": (planarised(solids.deltoidal_icositetrahedron(), 0.05), 6),
    "cube": (solids.cube(), 6),
    "trapezohedron 4": (solids.trapezohedron(4), 6),
    "trapezohedron 7": (solids.trapezohedron(7), 6),
    "rhombic dodecahedron": (solids.rhombic_dodecahedron(), 7),
    "rhombic triacontahedron": (solids.rhombic_triacontahedron(), 9),
    "deltoidal icositetrahedron": (solids.deltoidal_icositetrahedron(), 9),
    "deltoidal hexecontahedron": (solids.deltoidal_hexecontahedron(), 15),
    "valence 3": (three_valent_polyhedron(), 20),
    "disc with a vertex of valence 5": (zoo()["irregular_disc"][0], 3 + 15 - 2 * 5),
}  # fmt: skip


@pytest.mark.parametrize("name", DIMENSIONS)
def test_dimension_of_the_parallel_meshes(name):
    mesh, wanted = DIMENSIONS[name]
    space = parallel_space(mesh)
    assert space.dimension == wanted
    # Far above any rounding: nobody could decide otherwise.
    assert space.gap > 1e7


@pytest.mark.parametrize("name", [n for n in DIMENSIONS if "torus" not in n and "annulus" not in n])
def test_discs_and_spheres_in_general_position_have_the_generic_dimension(name):
    mesh, wanted = DIMENSIONS[name]
    if name == "not planar":
        assert generic_dimension(mesh.topology) > wanted
    else:
        assert generic_dimension(mesh.topology) <= wanted
    if name.startswith(("grid", "sphere", "valence", "disc")):
        assert generic_dimension(mesh.topology) == wanted


def test_generic_dimension_of_closed_rows_and_handles():
    assert generic_dimension(DIMENSIONS["annulus 3 x 5"][0].topology) == 5
    assert generic_dimension(TORUS.topology) == 4
    assert generic_dimension(zoo()["two_handles"][0].topology) == 4
    assert generic_dimension(zoo()["two_pieces"][0].topology) == 2 * 14


# --- oracle 9 ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", DIMENSIONS)
def test_mesh_plus_a_member_is_parallel_and_planar(name):
    mesh, _ = DIMENSIONS[name]
    space = parallel_space(mesh)
    rng = np.random.default_rng(9)
    # A tenth of an edge a vertex: edges keep their direction.
    step = rng.normal(size=space.dimension)
    step *= 0.1 * mesh.mean_edge_length * np.sqrt(len(mesh.vertices)) / np.linalg.norm(step)
    other = mesh.with_vertices(mesh.vertices + space.member(step).vertices)
    assert parallel_error(mesh, other).max() < SINE
    if isinstance(mesh, QuadMesh) and name != "not planar":
        assert planarity(other).max() < SINE
    # And nothing else is parallel: what lies across the space turns edges.
    away = rng.normal(size=mesh.vertices.shape)
    away -= space.member(space.coordinates(away)).vertices
    turned = mesh.with_vertices(mesh.vertices + 0.01 * away)
    assert len(mesh.vertices) * 3 == space.dimension or parallel_error(mesh, turned).max() > 1e-5


@pytest.mark.parametrize("name", ["grid 4 x 6", "rotational annulus 4 x 7", "sphere type 12"])
def test_linear_map_carries_the_space_with_it(name):
    mesh, _ = DIMENSIONS[name]
    space = parallel_space(mesh)
    matrix = np.eye(3) + 0.3 * np.random.default_rng(1).normal(size=(3, 3))
    image = parallel_space(mesh.with_vertices(mesh.vertices @ matrix.T))
    assert image.dimension == space.dimension
    members = space.basis.reshape(-1, 3, space.dimension)
    moved = np.einsum("ij,vjk->vik", matrix, members).reshape(len(space.basis), -1)
    across = moved - image.basis @ (image.basis.T @ moved)
    assert np.abs(across).max() < SINE


# --- oracle 4, second part --------------------------------------------------------------------


def test_projective_image_of_a_parallel_pair_is_not_parallel():
    mesh = DIMENSIONS["grid 4 x 6"][0]
    space = parallel_space(mesh)
    step = np.random.default_rng(4).normal(size=space.dimension)
    other = mesh.with_vertices(mesh.vertices + 0.1 * space.member(step).vertices)
    images = projected(mesh), projected(other)
    assert max(planarity(image).max() for image in images) < 1e-12
    assert parallel_error(mesh, other).max() < SINE
    assert parallel_error(*images).max() > 1e-3


# --- oracle 11 --------------------------------------------------------------------------------


def rank_at(residuals, points, step=1e-6):
    """Rank of the Jacobian of residuals by central differences, and its gap."""
    flat = points.ravel()
    columns = []
    for k in range(len(flat)):
        move = np.zeros_like(flat)
        move[k] = step
        there, back = (residuals((flat + s * move).reshape(-1, 3)) for s in (1, -1))
        columns.append((there - back) / (2 * step))
    values = np.linalg.svd(np.array(columns).T, compute_uv=False)
    # Differences are good to 1e-9, the true values of these small meshes lie above 1e-4.
    rank = int(np.count_nonzero(values > 1e-6))
    assert values[rank - 1] > 1e-4
    assert rank == len(values) or values[rank] < 1e-8
    return rank


def volumes(faces):
    def residuals(points):
        a, b, c, d = np.moveaxis(points[faces], 1, 0)
        return np.einsum("fi,fi->f", np.cross(b - a, c - a), d - a)

    return residuals


def angles(p, q):
    return np.arctan2(np.linalg.norm(np.cross(p, q), axis=-1), (p * q).sum(axis=-1))


@pytest.mark.parametrize(("m", "n"), [(2, 3), (3, 3)])
def test_planar_grids_have_their_number_of_parameters(m, n):
    mesh = pq_rows(m, n, seed=2)
    rank = rank_at(volumes(mesh.faces), mesh.vertices)
    assert 3 * len(mesh.vertices) - rank == 2 * m * n + 3 * m + 3 * n + 3


def circular_grid(m, n, seed=5):
    """Three sides are free, then each vertex lies somewhere on the circle of the other three."""
    rng = np.random.default_rng(seed)
    i, j = np.meshgrid(np.arange(m + 1.0), np.arange(n + 1.0), indexing="ij")
    points = np.stack([i, j, 0.1 * i * i - 0.15 * j * j], axis=-1)
    points += 0.08 * rng.normal(size=points.shape)
    for a in range(m):
        for b in range(n):
            p, q, r = points[a, b], points[a + 1, b], points[a, b + 1]
            # The circle by inversion about p: the line through the images of q and r.
            q1, r1 = ((x - p) / ((x - p) @ (x - p)) for x in (q, r))
            image = q1 + rng.uniform(0.4, 0.6) * (r1 - q1)
            points[a + 1, b + 1] = p + image / (image @ image)
    return points.reshape(-1, 3)


@pytest.mark.parametrize(("m", "n"), [(2, 3), (3, 3)])
def test_circular_grids_have_their_number_of_parameters(m, n):
    mesh = pq_rows(m, n)
    points = circular_grid(m, n)
    faces = np.array(mesh.faces)
    flat = volumes(faces)

    def residuals(points):
        corners = points[faces]
        ahead, behind = np.roll(corners, -1, axis=1), np.roll(corners, 1, axis=1)
        balance = angles(ahead - corners, behind - corners) @ np.array([1.0, -1, 1, -1])
        return np.concatenate([flat(points), balance])

    assert np.abs(residuals(points)).max() < 1e-12
    assert 3 * len(points) - rank_at(residuals, points) == m * n + 3 * m + 3 * n + 3


def conical_grid(m, n, seed=7):
    """Planes of the first row and column are free, then each touches the cone of three others."""
    rng = np.random.default_rng(seed)
    planes = np.zeros((m, n, 4))
    for a in range(m):
        for b in range(n):
            x, y = np.array([a - m / 2, b - n / 2]) + 0.5 + 0.03 * rng.normal(size=2)
            normal = np.array([0.3 * x, -0.25 * y, 1.0]) / np.linalg.norm([0.3 * x, 0.25 * y, 1])
            height = normal @ [x, y, -0.15 * x * x + 0.125 * y * y]
            planes[a, b] = [*normal, height]
            if a and b:
                three = planes[[a - 1, a - 1, a], [b - 1, b, b - 1]]
                apex = np.linalg.solve(three[:, :3], three[:, 3])
                # The normals lie on the circle through these three: one is free on it.
                p, q, r = three[:, :3]
                q1, r1 = ((z - p) / ((z - p) @ (z - p)) for z in (q, r))
                image = q1 + rng.uniform(0.45, 0.55) * (r1 - q1)
                found = p + image / (image @ image)
                planes[a, b] = [*found, found @ apex]
    points = np.zeros((m + 1, n + 1, 3))
    for a in range(m + 1):
        for b in range(n + 1):
            near = planes[max(a - 1, 0) : a + 1, max(b - 1, 0) : b + 1].reshape(-1, 4)
            guess = np.array([a - m / 2, b - n / 2, 0.0])
            step = np.linalg.lstsq(near[:, :3], near[:, 3] - near[:, :3] @ guess, rcond=1e-9)[0]
            points[a, b] = guess + step
    return points.reshape(-1, 3)


@pytest.mark.parametrize(("m", "n"), [(2, 3), (3, 3)])
def test_conical_grids_have_their_number_of_parameters(m, n):
    mesh = pq_rows(m, n)
    points, faces = conical_grid(m, n), np.array(mesh.faces)
    (star,) = mesh.topology.stars()
    flat = volumes(faces)

    def residuals(points):
        spokes = points[star.neighbors] - points[star.vertices][:, None]
        balance = angles(spokes, np.roll(spokes, -1, axis=1)) @ np.array([1.0, -1, 1, -1])
        return np.concatenate([flat(points), balance])

    assert np.abs(residuals(points)).max() < 1e-11
    assert 3 * len(points) - rank_at(residuals, points) == m * n + 4 * m + 4 * n + 2


@pytest.mark.parametrize(("m", "n"), [(2, 3), (3, 3)])
def test_koebe_grids_have_their_number_of_parameters(m, n):
    # Poles of the circles of an orthogonal pattern: edges touch the unit sphere.
    a, b = np.meshgrid(np.arange(m + 1.0), np.arange(n + 1.0), indexing="ij")
    p = np.stack([0.2 * a - 0.31, 0.2 * b - 0.17], axis=-1).reshape(-1, 2)
    square = (p * p).sum(axis=1) - 0.1**2
    points = np.column_stack([2 * p, 1 - square]) / (1 + square)[:, None]
    mesh = pq_rows(m, n).with_vertices(points)
    faces, (low, high) = np.array(mesh.faces), mesh.edges.T
    flat = volumes(faces)

    def residuals(points):
        x, y = points[low], points[high]
        moment = np.cross(x, y)
        touch = (moment * moment).sum(axis=1) - ((y - x) ** 2).sum(axis=1)
        return np.concatenate([10 * flat(points), 10 * touch])

    assert np.abs(residuals(points)).max() < 1e-13
    assert 3 * len(points) - rank_at(residuals, points) == 2 * m + 2 * n + 3


# --- oracle 41 --------------------------------------------------------------------------------


def test_box_with_the_cube_as_its_image_has_all_three_distances_constant():
    unit_cube = solids.cube()
    box = unit_cube.with_vertices(unit_cube.vertices * [2.0, 1.0, 3.5])
    image = unit_cube.vertices / np.sqrt(2)
    for d in (0.7, -0.3):
        other = box.with_vertices(box.vertices + d * image)
        assert is_parallel(box, other)
        assert np.abs(vertex_distance(box, other) - abs(d) * np.sqrt(1.5)).max() < 1e-14
        assert np.abs(edge_distance(box, other) - abs(d)).max() < 1e-14
        assert np.abs(face_distance(box, other) - d * np.sqrt(0.5)).max() < 1e-14
        assert all(is_offset(box, other, kind) for kind in ("vertex", "edge", "face"))
        assert constant_distance(box, other, "face")[0] == pytest.approx(d * np.sqrt(0.5))


def test_skewed_box_has_one_distance_constant_at_most():
    # Sizes of the image for which one distance is constant are not those of the others.
    wide = solids.cube().with_vertices(solids.cube().vertices * [2.0, 1.0, 3.5])
    image = wide.vertices * [0.3, 0.8, 0.2]
    other = wide.with_vertices(wide.vertices + image)
    assert not is_offset(wide, other, "edge")
    assert not is_offset(wide, other, "face")
    assert is_offset(wide, other, "vertex")
    # By the diagonal alone: any box is an offset of any box for the vertices.
    assert vertex_distance(wide, other) == pytest.approx(np.sqrt(0.6**2 + 0.8**2 + 0.7**2))
