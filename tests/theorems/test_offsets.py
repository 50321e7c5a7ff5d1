"""Offsets: which meshes have them, how many, and the laws of edges and areas."""

import numpy as np
import pytest
from shapes import curved_mesh, cyclide, random_rotation, sampled, torus, without_faces

from pqmesh.mesh import solids
from pqmesh.mesh.exact import (
    contact_element_mesh,
    grid_mesh,
    mirror_mesh,
    mirror_plane_mesh,
    propagated_normals,
    rotational_mesh,
    stereographic_mesh,
    tangent_plane_mesh,
    translational_mesh,
)
from pqmesh.mesh.measure import circularity_defect, fitted_cones, planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.offsets import (
    edge_factors,
    face_distance,
    face_offset,
    offset_layer,
    parallel_error,
    valid_range,
    vertex_distance,
    vertex_offset,
)
from pqmesh.offset.vectors import (
    face_offset_vectors,
    parallel_offset_vectors,
    vertex_offset_vectors,
)

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def mirror_planes(faces=10, seed=0):
    """Conical mesh without symmetry: a strip of planes in random mirrors; its boundary slides."""
    rng = np.random.default_rng(seed)
    z = np.linspace(-1, 1, faces + 2)
    strip = np.column_stack([np.ones(faces + 2), np.full(faces + 2, 0.1), z, 2 + 0.2 * z * z])
    turn = np.cumsum(rng.uniform(0.1, 0.2, faces + 1))
    tilt = 0.05 * rng.normal(size=(faces + 1, 2))
    return mirror_plane_mesh(strip, np.column_stack([-np.sin(turn), np.cos(turn), tilt]))


def slid_boundary(mesh, share=0.15, seed=1):
    """Boundary vertices moved along their inward edges: inner planes and edges stay."""
    rng = np.random.default_rng(seed)
    points = mesh.vertices.copy()
    for star in mesh.topology.stars(boundary=True):
        if star.faces.shape[1] == 2:
            inward = mesh.vertices[star.neighbors[:, 1]] - mesh.vertices[star.vertices]
            amount = rng.uniform(-share, share, len(star.vertices))
            points[star.vertices] += amount[:, None] * inward
    return mesh.with_vertices(points)


def random_translational(seed=0):
    rng = np.random.default_rng(seed)
    bend = 0.3 * rng.normal(size=(2, 6, 3)) * [0, 0, 1]
    first = np.cumsum(rng.uniform(0.5, 1, (6, 3)) * [1, 0, 0] + bend[0], axis=0)
    second = np.cumsum(rng.uniform(0.5, 1, (6, 3)) * [0, 1, 0] + bend[1], axis=0)
    return translational_mesh(first, second)


# --- the linear system of P(M), written out densely -------------------------------------------


def parallel_rows(mesh):
    """Dense rows of u x (s_j - s_i) = 0 over the edges."""
    n = mesh.topology.n_vertices
    unit = mesh.edge_vectors / mesh.edge_lengths[:, None]
    rows = np.zeros((len(unit), 3, 3 * n))
    for k, ((i, j), u) in enumerate(zip(mesh.edges.tolist(), unit, strict=True)):
        skew = np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
        rows[k, :, 3 * j : 3 * j + 3] = skew
        rows[k, :, 3 * i : 3 * i + 3] = -skew
    return rows.reshape(-1, 3 * n)


def tangency_rows(mesh):
    """Dense rows of n_f . s_i = 1 over the corners."""
    topology = mesh.topology
    rows = np.zeros((len(topology.indices), 3 * topology.n_vertices))
    for k, (vertex, face) in enumerate(
        zip(topology.indices.tolist(), topology.corner_faces.tolist(), strict=True)
    ):
        rows[k, 3 * vertex : 3 * vertex + 3] = mesh.face_normals[face]
    return rows


def face_offset_family(mesh):
    """Dimension and smallest residual of {S in P(M): n_f . s = 1}."""
    rows = np.vstack([parallel_rows(mesh), tangency_rows(mesh)])
    target = np.concatenate([np.zeros(3 * len(mesh.edges)), np.ones(len(mesh.topology.indices))])
    values = np.linalg.svd(rows, compute_uv=False)
    solution = np.linalg.lstsq(rows, target, rcond=1e-9)[0]
    # Zero values come out as rounding, the others are at least about theta^2 / n^2.
    return int((values < 1e-9 * values[0]).sum()), np.abs(rows @ solution - target).max()


@pytest.mark.parametrize("mesh", [mirror_planes(3), mirror_planes(5)], ids=["3x3", "5x5"])
def test_conical_grid_has_a_four_parameter_family_of_face_offsets(mesh):
    dimension, residual = face_offset_family(mesh)
    assert dimension == 4
    # Planes meet at angles of some 10 degrees.
    assert residual < 1e-11


def test_every_planar_strip_has_a_four_parameter_family_of_face_offsets():
    mesh = random_translational()
    strip = without_faces(mesh, np.arange(5, 25))
    assert strip.topology.n_faces == 5
    dimension, residual = face_offset_family(strip)
    assert dimension == 4
    assert residual < 1e-12


def test_planar_mesh_that_is_not_conical_has_no_face_offset():
    mesh = random_translational()
    assert planarity(mesh).max() < 1e-14
    _, residual = face_offset_family(mesh)
    assert residual > 1e-3
    assert face_offset_vectors(mesh).error > 1e-3
    assert parallel_offset_vectors(mesh).error > 1e-3


# --- circular meshes (oracle 17, 18) ----------------------------------------------------------

CIRCULAR_DISCS = {
    "rotational": rotational_mesh(PROFILE, [0, 0.2, 0.55, 0.8, 1.2]),
    "stereographic": stereographic_mesh([-0.5, -0.2, 0.1, 0.5], [-0.4, 0.0, 0.3, 0.5]),
    "mirrors": mirror_mesh(
        [[0, 0, 0], [0.2, 1, 0.1], [0.1, 2, 0.5], [0.3, 3, 0.4]],
        [[1, 0, 0, 1], [1, 0.1, 0.2, 3], [1, -0.1, 0.3, 6]],
    ),
    "torus": grid_mesh(sampled(torus, [0.1, 0.5, 0.7, 1.2], [-0.5, 0.1, 0.5, 0.8])[0]),
    "cyclide": grid_mesh(sampled(cyclide, [0.1, 0.5, 0.7, 1.2], [-0.5, 0.1, 0.5, 0.8])[0]),
}


@pytest.mark.parametrize("name", CIRCULAR_DISCS)
@pytest.mark.parametrize("seed", range(3))
def test_reflected_normals_of_a_circular_disc_close_for_every_start(name, seed):
    mesh = CIRCULAR_DISCS[name]
    s = propagated_normals(mesh, np.random.default_rng(seed).normal(size=3))
    i, j = mesh.edges.T
    u = mesh.edge_vectors / mesh.edge_lengths[:, None]
    mirrored = s[i] - 2 * (s[i] * u).sum(axis=1, keepdims=True) * u
    # Along a path of ten reflections.
    assert np.abs(mirrored - s[j]).max() < 1e-11
    assert np.abs(np.cross(u, s[j] - s[i])).max() < 1e-11
    # Short of the focal set of any start, where edges turn and faces cross.
    moved = mesh.with_vertices(mesh.vertices + 0.02 * s)
    assert np.ptp(vertex_distance(mesh, moved)) < 1e-12
    assert planarity(moved).max() < 1e-11
    assert np.abs(circularity_defect(moved)).max() < 1e-10


@pytest.mark.parametrize("name", CIRCULAR_DISCS)
def test_vertex_offset_vectors_of_a_circular_disc_are_exact(name):
    mesh = CIRCULAR_DISCS[name]
    found = vertex_offset_vectors(mesh)
    assert found.kind == "vertex"
    assert found.error < 1e-11
    assert np.abs(np.linalg.norm(found.vectors, axis=1) - 1).max() < 1e-12
    for distance in (0.2, -0.1):
        moved = vertex_offset(mesh, distance)
        assert np.abs(vertex_distance(mesh, moved) - abs(distance)).max() < 1e-12
        assert parallel_error(mesh, moved).max() < 1e-11
    # The side of the vertex normals.
    assert (found.vectors * mesh.vertex_normals).sum() > 0.5 * len(found.vectors)
    # The Gauss image is no single point (E8): it has no zero edge.
    image = np.linalg.norm(
        found.vectors[mesh.edges[:, 1]] - found.vectors[mesh.edges[:, 0]], axis=1
    )
    assert image.max() > 0.01


def test_faces_off_the_circle_leave_a_gap_of_order_one():
    mesh = curved_mesh(5, 4, noise=0.05)
    # Cells with corners 10 degrees off the circle; a gap of 1e-2 is far from rounding.
    assert vertex_offset_vectors(mesh).error > 1e-2


@pytest.mark.parametrize("n", [5, 6, 7, 8, 11, 12])
def test_rotational_annulus_has_vertex_offsets_along_the_meridian_plane_at_least(n):
    mesh = rotational_mesh(PROFILE, 2 * np.pi / n * np.arange(n), closed=True)
    found = vertex_offset_vectors(mesh)
    # Closed through n reflections.
    assert found.error < 1e-11
    start = found.vectors[0]
    across = np.array([0.0, 1.0, 0.0])
    rng = np.random.default_rng(n)
    inside = rng.normal(size=3) * [1, 0, 1]
    outside = inside + 0.5 * across

    def gap(direction):
        s = propagated_normals(mesh, direction)
        i, j = mesh.edges.T
        u = mesh.edge_vectors / mesh.edge_lengths[:, None]
        return np.abs(s[i] - 2 * (s[i] * u).sum(axis=1, keepdims=True) * u - s[j]).max()

    assert gap(inside) < 1e-11
    if n % 2:
        # Odd: only starts in the meridian plane (y = 0 at vertex 0) close.
        assert abs(start @ across) < 1e-11
        assert gap(outside) > 1e-2
    else:
        assert gap(outside) < 1e-11


def test_prism_over_a_quad_without_circumcircle_has_the_degenerate_vertex_offset_only():
    base = np.array([[0, 0], [2, 0], [2.2, 1.5], [0.3, 1]])
    points = np.concatenate([np.column_stack([base, np.full(4, z)]) for z in (0.0, 1.0, 2.5)])
    faces = [[4 * k + i, 4 * k + (i + 1) % 4, 4 * k + 4 + (i + 1) % 4, 4 * k + 4 + i]
             for k in range(2) for i in range(4)]  # fmt: skip
    mesh = QuadMesh.of(points, faces)
    assert np.abs(circularity_defect(mesh)).max() < 1e-14
    found = vertex_offset_vectors(mesh)
    assert found.error < 1e-11
    # Along the axis, up on one ring and down on the next: horizontal edges of the image vanish.
    assert np.abs(found.vectors[:, :2]).max() < 1e-11
    ring = found.vectors[mesh.edges[:4]]
    assert np.abs(ring[:, 1] - ring[:, 0])[:, :2].max() < 1e-11
    # Over a base with a circumcircle there is a proper one.
    angle = np.array([0.1, 1.9, 3.2, 4.9])
    base = np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.concatenate([np.column_stack([base, np.full(4, z)]) for z in (0.0, 1.0, 2.5)])
    mesh = QuadMesh.of(points, faces)
    found = vertex_offset_vectors(mesh)
    assert found.error < 1e-11
    assert np.linalg.norm(found.vectors[:, :2], axis=1).min() > 0.5


# --- conical meshes (oracles 21, 25, 26) ------------------------------------------------------


@pytest.mark.parametrize("distance", [0.1, -0.2])
def test_face_offset_of_a_rotational_mesh_is_the_closed_formula(distance):
    profile, step = PROFILE[:3], 0.3
    mesh = rotational_mesh(profile, step * np.arange(6))
    q = profile * [np.cos(step / 2), 1.0]
    along = np.diff(q, axis=0)
    m = np.column_stack([along[:, 1], -along[:, 0]])
    m /= np.linalg.norm(m, axis=1)[:, None]
    w = np.vstack([m[:1], (m[:1] + m[1:]) / (1 + m[0] @ m[1]), m[1:]])
    wanted = (q + distance * w) / [np.cos(step / 2), 1.0]
    found = face_offset(mesh, distance)
    # The inner row is free of choice.
    inner = found.vertices.reshape(3, 6, 3)[1, 1:-1]
    assert np.abs(np.hypot(inner[:, 0], inner[:, 1]) - wanted[1, 0]).max() < 1e-13
    assert np.abs(inner[:, 2] - wanted[1, 1]).max() < 1e-13
    # Everywhere: constant signed distance of the faces, parallel edges.
    assert np.abs(face_distance(mesh, found) - distance).max() < 1e-13
    assert parallel_error(mesh, found).max() < 1e-12
    # Not a vertex offset.
    assert np.ptp(vertex_distance(mesh, found)) > 1e-3 * abs(distance)


def test_face_offset_has_the_published_inner_vertex():
    mesh = rotational_mesh(PROFILE[:3], 0.3 * np.arange(3))
    x, y, z = face_offset(mesh, 0.1).vertices[4]
    # The digits of the oracle.
    assert np.isclose(np.hypot(x, y), 2.496310999, rtol=0, atol=5e-10)
    assert np.isclose(z, 0.459199717, rtol=0, atol=5e-10)


CONICAL = {
    "rotational": rotational_mesh(PROFILE, 0.3 * np.arange(7)),
    "annulus": rotational_mesh(PROFILE, 2 * np.pi / 9 * np.arange(9), closed=True),
    "mirrors": mirror_planes(),
    "solid": solids.deltoidal_hexecontahedron(),
    "closed_torus": rotational_mesh(
        [[4, 0], [3, 1], [2, 0], [3, -1]],
        2 * np.pi / 9 * np.arange(9), closed=True, closed_profile=True),
}  # fmt: skip


@pytest.mark.parametrize("name", CONICAL)
@pytest.mark.parametrize("distance", [0.05, -0.05])
def test_conical_mesh_moves_every_face_by_the_distance_along_its_normal(name, distance):
    mesh = CONICAL[name]
    layer = offset_layer(mesh, face_offset_vectors(mesh), distance)
    assert layer.kind == "face"
    # Rounding over the angle between planes, 5 to 20 degrees.
    assert layer.distance_error_max < 1e-13
    assert layer.parallel_error_max < 1e-12
    assert layer.parallel_error_boundary_max < 1e-12
    assert layer.planarity_max < 1e-12
    signed = face_distance(mesh, layer.mesh)
    assert (np.sign(signed) == np.sign(distance)).all()
    # Turned over, the same distance goes to the other side.
    back = mesh.reversed()
    other = offset_layer(back, face_offset_vectors(back), -distance)
    inner = ~mesh.topology.is_boundary_vertex
    assert np.abs(other.mesh.vertices - layer.mesh.vertices)[inner].max(initial=0.0) < 1e-12


@pytest.mark.parametrize("distance", [0.5, -0.25, -1.0])
def test_face_offset_of_a_mesh_around_a_ball_is_a_scaling(distance):
    mesh = solids.rhombic_triacontahedron()
    found = face_offset(mesh, distance)
    # One plus the distance over the radius 1; at -1 all is one point.
    assert np.abs(found.vertices - (1 + distance) * mesh.vertices).max() < 1e-13


def test_contact_planes_of_a_circular_mesh_are_conical_and_their_offset_is_that_of_the_vertices():
    ball = CIRCULAR_DISCS["torus"]
    start = np.array([0.3, 0.4, 1.0])
    s = propagated_normals(ball, start)
    dual = contact_element_mesh(ball, start)
    # Planes meet at angles of a few degrees: 1e-8 as in the theory.
    assert fitted_cones(dual).misfit.max() < 1e-8
    assert planarity(dual).max() < 1e-8
    # The offset circular mesh has the planes moved by the same distance.
    moved = contact_element_mesh(ball.with_vertices(ball.vertices + 0.1 * s), start)
    distance = face_distance(dual, moved)
    assert np.abs(np.abs(distance) - 0.1).max() < 1e-8
    assert np.ptp(distance) < 1e-8


@pytest.mark.parametrize("name", ["rotational", "mirrors"])
def test_conical_mesh_carries_a_two_parameter_family_of_circular_meshes(name):
    # A point of one face plane, reflected in the bisecting planes of neighbouring faces.
    mesh = CONICAL[name]
    n, topology = mesh.face_normals, mesh.topology
    inner = np.flatnonzero(~topology.is_boundary_edge)
    pairs = topology.edge_faces[inner]
    mirror = n[pairs[:, 1]] - n[pairs[:, 0]]
    mirror /= np.linalg.norm(mirror, axis=1)[:, None]
    base = mesh.vertices[topology.edges[inner, 0]]
    for shift in ([0.0, 0.0], [0.1, -0.05]):
        side = mesh.vertices[mesh.faces[0, 1]] - mesh.vertices[mesh.faces[0, 0]]
        side /= np.linalg.norm(side)
        points = np.full((topology.n_faces, 3), np.nan)
        points[0] = mesh.face_centers[0] + shift[0] * side + shift[1] * np.cross(n[0], side)
        for _ in range(topology.n_faces):
            for (a, b), m, p in zip(pairs, mirror, base, strict=True):
                for x, y in ((a, b), (b, a)):
                    if np.isnan(points[y, 0]) and not np.isnan(points[x, 0]):
                        points[y] = points[x] - 2 * ((points[x] - p) @ m) * m
            if not np.isnan(points).any():
                break
        gaps = [points[b] - (points[a] - 2 * ((points[a] - p) @ m) * m)
                for (a, b), m, p in zip(pairs, mirror, base, strict=True)]  # fmt: skip
        # Closes around every inner vertex; mirrors of planes 5 degrees apart.
        assert np.abs(gaps).max() < 1e-10
        heights = (points * n).sum(axis=1) - (mesh.face_centers * n).sum(axis=1)
        assert np.abs(heights).max() < 1e-10
        stars = topology.stars()[0]
        quads = points[stars.faces]
        dual = QuadMesh.of(quads.reshape(-1, 3), np.arange(4 * len(quads)).reshape(-1, 4))
        assert np.abs(circularity_defect(dual)).max() < 1e-9
        assert planarity(dual).max() < 1e-10


# --- boundaries (oracle 59) -------------------------------------------------------------------


def outlines():
    full = mirror_planes(10)
    index = np.arange(100).reshape(10, 10)
    cut = {
        "full": full,
        "cut_corner": without_faces(full, [0, 1, 10]),
        "hole": without_faces(full, index[4:6, 4:6].ravel()),
        "notch": without_faces(full, index[0:2, 4:6].ravel()),
    }
    # Rims of holes slide as well: before, their lines are those of the larger exact mesh.
    return {name: slid_boundary(mesh) for name, mesh in cut.items()}


@pytest.mark.parametrize("name", ["full", "cut_corner", "hole", "notch"])
def test_face_offset_is_exact_whatever_the_outline(name):
    mesh = outlines()[name]
    vectors = face_offset_vectors(mesh)
    layer = offset_layer(mesh, vectors, 0.05)
    # Angles between planes of 5 degrees and more.
    assert vectors.error < 1e-13
    assert layer.distance_error_max < 1e-13
    assert layer.parallel_error_max < 1e-12
    assert layer.planarity_max < 1e-12
    sines = parallel_error(mesh, layer.mesh)
    outer = mesh.topology.is_boundary_edge
    assert layer.parallel_error_boundary_max == sines[outer].max()
    assert layer.parallel_error_max == sines[~outer].max()
    # All boundary edges are parallel exactly where the linear system says that they can be.
    _, residual = face_offset_family(mesh)
    if name in ("full", "cut_corner"):
        assert residual < 1e-11
        assert layer.parallel_error_boundary_max < 1e-11
    else:
        assert residual > 1e-6
        assert layer.parallel_error_boundary_max > 1e-6


def test_boundary_slides_make_the_boundary_edges_as_parallel_as_can_be():
    mesh = outlines()["notch"]
    vectors = face_offset_vectors(mesh).vectors
    edges = mesh.edges[mesh.topology.is_boundary_edge]
    e = mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]]

    def turned(w):
        """Sum of squares of the angle by which boundary edges turn, per unit of offset."""
        length = np.linalg.norm(e, axis=1)[:, None]
        return ((np.cross(e, w[edges[:, 1]] - w[edges[:, 0]]) / length**2) ** 2).sum()

    best = turned(vectors)
    assert best > 1e-9
    tried = 0
    for star in mesh.topology.stars(boundary=True):
        # Vertices of two faces may slide along their shared edge; no small slide does better.
        if star.faces.shape[1] == 2:
            inward = mesh.vertices[star.neighbors[:, 1]] - mesh.vertices[star.vertices]
            for vertex, direction in zip(star.vertices, inward, strict=True):
                for amount in (1e-3, -1e-3):
                    other = vectors.copy()
                    other[vertex] += amount * direction
                    # Rounding of the minimum.
                    assert turned(other) >= best * (1 - 1e-9)
                    tried += 1
    assert tried > 50


# --- nearest parallel mesh --------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rotational", "annulus", "mirrors"])
def test_nearest_parallel_mesh_of_a_conical_mesh_is_a_face_offset(name):
    mesh = CONICAL[name]
    found, face = parallel_offset_vectors(mesh), face_offset_vectors(mesh)
    # Normal equations with a soft goal of 1e-6: 1e-8 of the distance.
    assert found.error < 1e-7
    inner = ~mesh.topology.is_boundary_vertex
    # Sides may slide; inside, w is determined up to the error over the angle of normals squared.
    assert np.abs(found.vectors - face.vectors)[inner].max() < 1e-4
    layer = offset_layer(mesh, found, 0.1)
    assert layer.kind == "parallel"
    assert max(layer.parallel_error_max, layer.parallel_error_boundary_max) < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_nearest_parallel_mesh_of_a_planar_mesh_is_parallel_and_nearest(seed):
    mesh = random_translational(seed)
    found = parallel_offset_vectors(mesh)
    moved = mesh.with_vertices(mesh.vertices + 0.3 * found.vectors)
    assert parallel_error(mesh, moved).max() < 1e-12
    assert planarity(moved).max() < 1e-12
    # The least-squares optimum over a basis of P(M) by singular vectors.
    rows = parallel_rows(mesh)
    _, values, vt = np.linalg.svd(rows)
    rank = int((values > 1e-9 * values[0]).sum())
    basis = vt[rank:].T
    # m + n + 3 for m x n faces.
    assert basis.shape[1] == 5 + 5 + 3
    tangency = tangency_rows(mesh)
    best = basis @ np.linalg.lstsq(tangency @ basis, np.ones(len(tangency)), rcond=None)[0]
    least = ((tangency @ best - 1) ** 2).sum()
    reached = ((tangency @ found.vectors.ravel() - 1) ** 2).sum()
    assert np.isclose(reached, least, rtol=1e-8)
    # And no stray translation: as long as a unit offset should be.
    assert np.linalg.norm(found.vectors, axis=1).max() < 3


def test_nearest_parallel_mesh_of_a_narrow_patch_has_no_stray_translation():
    # Normals within 2 degrees: the move along the patch is hardly seen by any face.
    rng = np.random.default_rng(0)
    s = np.linspace(0.2, 1.2, 11)
    profile = np.column_stack([2 + np.sin(2 * s), s])
    mesh = rotational_mesh(profile, np.cumsum(rng.uniform(0.005, 0.02, 10)))
    found = parallel_offset_vectors(mesh)
    assert np.linalg.norm(found.vectors, axis=1).max() < 1.1


# --- laws of edges and areas (oracle 33) ------------------------------------------------------


def area_vectors(mesh, points):
    """Twice the vector area of each face at other positions."""
    a, b, c, d = np.moveaxis(points[mesh.faces], 1, 0)
    return np.cross(c - a, d - b)


@pytest.mark.parametrize("name", ["rotational", "mirrors"])
def test_edges_of_the_offset_grow_by_their_factor(name):
    mesh = CONICAL[name]
    s = face_offset_vectors(mesh).vectors
    factor = edge_factors(mesh, s)
    for d in (0.1, -0.3):
        moved = mesh.with_vertices(mesh.vertices + d * s)
        wanted = (1 + d * factor)[:, None] * mesh.edge_vectors
        assert np.abs(moved.edge_vectors - wanted).max() < 1e-12


@pytest.mark.parametrize("name", ["rotational", "mirrors"])
def test_face_areas_of_the_offset_follow_steiner(name):
    mesh = CONICAL[name]
    s, n = face_offset_vectors(mesh).vectors, mesh.face_normals
    mixed = area_vectors(mesh, mesh.vertices + s) - area_vectors(mesh, mesh.vertices)
    mixed = 0.5 * (mixed - area_vectors(mesh, s))
    for d in (0.1, -0.3):
        area = (area_vectors(mesh, mesh.vertices + d * s) * n).sum(axis=1)
        terms = area_vectors(mesh, mesh.vertices) + 2 * d * mixed + d * d * area_vectors(mesh, s)
        assert np.abs(area - (terms * n).sum(axis=1)).max() < 1e-13


@pytest.mark.parametrize("radius", [1.0, 2.5])
def test_mesh_around_a_ball_has_the_curvatures_of_the_ball(radius):
    solid = solids.deltoidal_icositetrahedron()
    mesh = solid.with_vertices(radius * solid.vertices)
    s, n = face_offset_vectors(mesh).vectors, mesh.face_normals
    area = (area_vectors(mesh, mesh.vertices) * n).sum(axis=1)
    image = (area_vectors(mesh, s) * n).sum(axis=1)
    both = (area_vectors(mesh, mesh.vertices + s) * n).sum(axis=1)
    mixed = 0.5 * (both - area - image)
    # Outward normals: H = -A(M, S)/A = -1/R, K = A(S)/A = 1/R^2.
    assert np.abs(-mixed / area + 1 / radius).max() < 1e-13
    assert np.abs(image / area - 1 / radius**2).max() < 1e-13
    assert np.abs(edge_factors(mesh, s) - 1 / radius).max() < 1e-13


# --- how far (focal set) ----------------------------------------------------------------------


def test_valid_range_of_a_torus_tends_to_its_focal_set():
    # Tangent planes of the part where both curvatures have one sign: radii 1 and 3 / cos v + 1.
    reached = []
    for n in (8, 16, 32):
        u, v = np.linspace(0, 0.8, n), np.linspace(-0.5, 0.5, n)
        points, normals = sampled(torus, u, v)
        planes = np.concatenate([normals, (points * normals).sum(-1, keepdims=True)], axis=-1)
        mesh = tangent_plane_mesh(planes)
        s = face_offset_vectors(mesh).vectors
        low, high = valid_range(mesh, s)
        assert high == np.inf
        # The circle of centres lies 1 inside.
        reached.append(abs(low + 1.0))
        # Just before, no edge is reversed; just behind, one is.
        for share, reversed_edges in ((0.999, False), (1.001, True)):
            moved = mesh.with_vertices(mesh.vertices + share * low * s)
            turned = (moved.edge_vectors * mesh.edge_vectors).sum(axis=1) < 0
            assert turned.any() == reversed_edges
    # The tube's circles touch their own polygons: exact at every size.
    assert max(reached) < 1e-10


def test_valid_range_of_a_saddle_ends_on_both_sides():
    v = np.linspace(np.pi - 0.5, np.pi + 0.5, 12)
    points, normals = sampled(torus, np.linspace(0, 0.8, 12), v)
    planes = np.concatenate([normals, (points * normals).sum(-1, keepdims=True)], axis=-1)
    mesh = tangent_plane_mesh(planes)
    s = face_offset_vectors(mesh).vectors
    low, high = valid_range(mesh, s)
    # Inward to the circle of centres at 1; outward to the axis at (3 + cos v) / -cos v = 2.
    assert np.isclose(low, -1.0, atol=1e-10)
    assert np.isclose(high, 2.0, atol=0.05)
    layer = offset_layer(mesh, face_offset_vectors(mesh), 0.1)
    assert layer.first_reversed_edge_distance == high
    layer = offset_layer(mesh, face_offset_vectors(mesh), -0.1)
    assert layer.first_reversed_edge_distance == low


def test_flat_mesh_can_move_any_distance():
    flat = grid_mesh(np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0), [0.0],
                                          indexing="ij"), axis=-1)[:, :, 0])  # fmt: skip
    layer = offset_layer(flat, face_offset_vectors(flat), 0.3)
    assert layer.first_reversed_edge_distance is None
    assert np.abs(layer.mesh.vertices - flat.vertices - 0.3 * flat.face_normals[0]).max() < 1e-15


# --- the thesis' definitions, amended ---------------------------------------------------------


def test_translation_is_no_face_offset_of_a_curved_mesh():
    # E8: every vertex moves by the same length, but faces by different signed distances.
    mesh = CONICAL["rotational"]
    moved = mesh.with_vertices(mesh.vertices + np.array([0, 0, 0.1]))
    assert np.ptp(vertex_distance(mesh, moved)) < 1e-15
    assert np.ptp(face_distance(mesh, moved)) > 0.01


def test_signed_face_distance_tells_a_chessboard_from_an_offset():
    # E7: a mesh whose normals touch a cone with alternating signs moves its faces by + and -.
    turn = np.array([0.3, 1.7, 3.2, 4.9])
    n = np.column_stack([np.sin(0.5) * np.cos(turn), np.sin(0.5) * np.sin(turn),
                         np.full(4, np.cos(0.5))])  # fmt: skip
    signs = np.array([1, -1, 1, -1])
    alternating = n * signs[:, None]
    w = np.linalg.lstsq(n, np.ones(4), rcond=None)[0]
    moves = alternating @ w
    assert np.ptp(np.abs(moves)) < 1e-14
    assert np.ptp(moves) > 1.9


def test_face_offset_commutes_with_rigid_motions_and_scaling():
    mesh = CONICAL["mirrors"]
    rng = np.random.default_rng(3)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    moved = mesh.with_vertices(7.0 * mesh.vertices @ turn.T + shift)
    plain, image = face_offset(mesh, 0.05).vertices, face_offset(moved, 0.35).vertices
    gap = np.abs(image - 7.0 * plain @ turn.T - shift)
    inner = ~mesh.topology.is_boundary_vertex
    # Rounding over the angle between planes; the sides' slides are free, and shortest only to
    # the square root of rounding.
    assert gap[inner].max() < 1e-11
    assert gap.max() < 1e-7
