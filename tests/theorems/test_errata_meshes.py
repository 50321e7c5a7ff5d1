"""Errata E1-E18: definitions, parallel meshes, Gauss image, circles and cones.

Every test asserts both sides: the printed statement gives a clearly wrong number, the true one
holds to rounding. `docs/errata.md` lists them.
"""

import itertools

import numpy as np
import pytest

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import (
    circle_deviation,
    circularity_defect,
    conicality_defect,
    fitted_cones,
    nonconvex_faces,
    planarity,
    planarity_deviation,
    tetrahedron_volume,
)
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.surface.base import Jet
from pqmesh.surface.curvature import second_form_in
from pqmesh.vectors import angle, cross, dot, norm, unit

# Sizes are near 1 and every formula is a few products deep: 1e-12 is 4 digits above rounding.
EXACT = 1e-12
# Null vectors of a singular value decomposition, theory tolerance for members of P(M).
NULL = 1e-9
ALTERNATING = np.array([1.0, -1.0, 1.0, -1.0])


# --- meshes to look at ----------------------------------------------------------------------


def grid_faces(m, n, closed=False):
    """m x n quads over vertices (i, j) -> i * columns + j; closed joins the last column."""
    columns = n if closed else n + 1
    i, j = np.meshgrid(np.arange(m), np.arange(n), indexing="ij")
    k = (j + 1) % columns
    corners = (i * columns + j, (i + 1) * columns + j, (i + 1) * columns + k, i * columns + k)
    return np.stack(corners, -1).reshape(-1, 4)


def rotational_mesh(profile, angles, closed=False):
    """Profile rows (r, z) turned by the angles; normals point outwards for z rising."""
    r, z = np.asarray(profile, dtype=float).T[:, :, None]
    phi = np.asarray(angles)[None]
    points = np.stack([r * np.cos(phi), r * np.sin(phi), z + 0 * phi], -1).reshape(-1, 3)
    faces = grid_faces(len(r), len(angles) if closed else len(angles) - 1, closed)
    faces = faces[: (len(r) - 1) * (len(angles) if closed else len(angles) - 1)]
    return QuadMesh.of(points, faces[:, ::-1])


def planar_grid(m, n, seed=0):
    """A generic PQ grid: the projective image of a translational mesh, its strips stretched."""
    rng = np.random.default_rng(seed)
    a = np.cumsum(np.column_stack([np.ones(m + 1), 0.3 * rng.normal(size=(m + 1, 2))]), 0)
    b = np.cumsum(
        np.column_stack([0.3 * rng.normal(size=n + 1), np.ones(n + 1), np.zeros(n + 1)]), 0
    )
    b[:, 2] = 0.1 * b[:, 1] ** 2
    points = (a[:, None] + b[None]).reshape(-1, 3)
    scale = 1.0 + points @ np.array([0.02, 0.03, 0.05])
    return QuadMesh.of(points / scale[:, None], grid_faces(m, n))


def star_mesh(directions):
    """One interior vertex at the origin with the given edges; parallelograms between them."""
    p = np.asarray(directions, dtype=float)
    k = len(p)
    points = np.concatenate([np.zeros((1, 3)), p, p + np.roll(p, -1, 0)])
    return PolyMesh.of(points, [[0, 1 + i, 1 + k + i, 1 + (i + 1) % k] for i in range(k)])


def quad_star(directions):
    return QuadMesh.of(star_mesh(directions).vertices, star_mesh(directions).topology.quads)


def four_bar(w, diagonal, side):
    """Spherical four-bar p1..p4 with angle(p_i, p_i+1) = w_i and angle(p1, p3) = diagonal."""
    cos_d, sin_d = np.cos(diagonal), np.sin(diagonal)

    def corner(to_first, to_third, sign):
        x = np.cos(to_first)
        y = (np.cos(to_third) - cos_d * x) / sin_d
        return [x, y, sign * np.sqrt(1 - x * x - y * y)]

    second, fourth = corner(w[0], w[1], 1), corner(w[3], w[2], side)
    return np.array([[1, 0, 0], second, [cos_d, sin_d, 0], fourth])


def koebe_ring(n, levels, start=-1.0):
    """Rotational mesh all of whose edges touch the unit sphere."""
    delta = np.pi / n
    tau = start + 2 * np.arccosh(1 / np.cos(delta)) * np.arange(levels)
    profile = np.column_stack([1 / np.cosh(tau) / np.cos(delta), np.tanh(tau)])
    return rotational_mesh(profile, 2 * delta * np.arange(n), closed=True)


# --- linear systems -------------------------------------------------------------------------


def parallel_rows(mesh, edges):
    """Rows of u_e x (v'_i - v'_j) = 0 over the given pairs, shape (3E, 3V)."""
    rows = np.zeros((len(edges), 3, len(mesh.vertices), 3))
    u = unit(mesh.vertices[edges[:, 1]] - mesh.vertices[edges[:, 0]])
    skew = np.stack([cross(u, np.tile(axis, (len(u), 1))) for axis in np.eye(3)], -1)
    number = np.arange(len(edges))
    rows[number, :, edges[:, 1]] = skew
    rows[number, :, edges[:, 0]] = -skew
    return rows.reshape(3 * len(edges), -1)


def null_space(rows):
    _, s, vt = np.linalg.svd(rows)
    return vt[np.count_nonzero(s > NULL * max(s[0], 1.0)) :]


def touching_rows(mesh):
    """Rows of n_f . s_i = 1 over all corners, shape (corners, 3V)."""
    topology = mesh.topology
    rows = np.zeros((len(topology.indices), len(mesh.vertices), 3))
    rows[np.arange(len(rows)), topology.indices] = mesh.face_normals[topology.corner_faces]
    return rows.reshape(len(rows), -1)


def solve_face_offset(mesh, signs=None):
    """Least-squares S in P(M) with n_f . s_i = sign_f; returns S and the largest residual."""
    signs = np.ones(mesh.topology.n_faces) if signs is None else signs
    parallel = parallel_rows(mesh, mesh.edges)
    rows = np.concatenate([parallel, touching_rows(mesh)])
    right = np.concatenate([np.zeros(len(parallel)), signs[mesh.topology.corner_faces]])
    solution = np.linalg.lstsq(rows, right, rcond=1e-12)[0]
    return solution.reshape(-1, 3), np.abs(rows @ solution - right).max()


def propagate(mesh, first):
    """Vertex-offset image grown from `first` by reflection along edges, and its closing gap."""
    image = np.full_like(mesh.vertices, np.nan)
    image[0] = first
    queue, neighbors = [0], {v: [] for v in range(len(image))}
    for a, b in mesh.edges.tolist():
        neighbors[a].append(b)
        neighbors[b].append(a)

    def step(i, j):
        u = unit(mesh.vertices[j] - mesh.vertices[i])
        return image[i] - 2 * (image[i] @ u) * u

    while queue:
        i = queue.pop()
        for j in neighbors[i]:
            if np.isnan(image[j, 0]):
                image[j] = step(i, j)
                queue.append(j)
    return image, max(np.linalg.norm(image[b] - step(a, b)) for a, b in mesh.edges.tolist())


def line_distance(points, directions, origin=0.0):
    """Distance of the origin from the lines."""
    return norm(cross(points - origin, unit(directions)))


def cone_fit(normals):
    """Axis with n . a as constant as possible, and the spread of n . a; (..., k, 3)."""
    centered = normals - normals.mean(-2, keepdims=True)
    axis = np.linalg.svd(centered)[2][..., -1, :]
    return axis, np.ptp(dot(normals, axis[..., None, :]), axis=-1)


# --- E1 to E4: definitions ------------------------------------------------------------------


def meets_definition_2_1_1(faces):
    """The printed conditions: four different corners, sides only, at most two faces an edge."""
    sides = [frozenset(pair) for f in faces for pair in zip(f, f[1:] + f[:1], strict=True)]
    diagonals = [frozenset(pair) for f in faces for pair in (f[::2], f[1::2])]
    fits_twice = all(sides.count(side) <= 2 for side in sides)
    return all(len(set(f)) == 4 for f in faces) and fits_twice and not set(diagonals) & set(sides)


@pytest.mark.parametrize(
    ("faces", "vertices", "words"),
    [
        ([[0, 1, 2, 3], [0, 4, 5, 6]], 7, "one fan"),
        ([[0, 1, 4, 3], [1, 4, 5, 2]], 6, "coherently oriented"),
        ([[0, 1, 2, 3]], 5, "belong to a face"),
    ],
)
def test_e01_printed_mesh_definition_admits_what_topology_refuses(faces, vertices, words):
    assert meets_definition_2_1_1(faces)
    with pytest.raises(MeshError, match=words):
        Topology(faces, vertices)


def test_e01_moebius_strip_of_quads_meets_the_printed_definition_but_has_no_normals():
    n = 5
    faces = [[2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2] for i in range(n - 1)]
    faces.append([2 * n - 2, 2 * n - 1, 0, 1])
    assert meets_definition_2_1_1(faces)
    for flips in itertools.product([1, -1], repeat=n):
        with pytest.raises(MeshError, match="coherently oriented"):
            Topology([f[::s] for f, s in zip(faces, flips, strict=True)], 2 * n)


def test_e02_zero_volume_admits_broken_quads_that_are_reported_apart():
    crossed = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    collinear = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]
    repeated = [[0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 1]]
    for corners in (crossed, collinear, repeated):
        mesh = QuadMesh.of(corners, [[0, 1, 2, 3]])
        assert tetrahedron_volume(mesh)[0] == 0.0
    for corners in (crossed, collinear):
        assert nonconvex_faces(QuadMesh.of(corners, [[0, 1, 2, 3]])).tolist() == [0]


def test_e02_volume_is_area_times_deviation_over_three_and_so_no_tolerance():
    rng = np.random.default_rng(2)
    mesh = QuadMesh.of(rng.normal(size=(400, 3)), np.arange(400).reshape(-1, 4))
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    area = 0.5 * norm(cross(c - a, d - b))
    volume, deviation = np.abs(tetrahedron_volume(mesh)), planarity_deviation(mesh)
    np.testing.assert_allclose(volume, area * deviation / 3, rtol=1e-9, atol=EXACT)
    # One shape in millimetres and in metres: the volume says anything, the planarity the same.
    small = mesh.with_vertices(1e-3 * mesh.vertices)
    np.testing.assert_allclose(np.abs(tetrahedron_volume(small)), 1e-9 * volume, rtol=1e-6)
    np.testing.assert_allclose(planarity(small), planarity(mesh), rtol=1e-9)


def test_e03_a_strip_of_n_faces_has_rulings_zero_to_n():
    n = 6
    strip = max(Topology(grid_faces(1, n), 2 * (n + 1)).strips, key=len)
    assert len(strip) == n + 1 != len(range(1, n + 1))


def test_e03_an_asymptotic_family_is_conjugate_to_itself_but_not_to_the_other():
    # z = xy at (0.3, -0.4), parameters x, y: both coordinate lines are asymptotic.
    x, y, one = 0.3, -0.4, np.eye(3)
    rows = ([x, y, x * y], one[0] + y * one[2], one[1] + x * one[2], 0 * one[2], one[2], 0 * one[2])
    jet = Jet(*(np.array([row]) for row in rows))
    u, v = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    assert abs(second_form_in(jet, u, u)[0]) < EXACT  # passes the formula with A = B: no net
    assert abs(second_form_in(jet, u, v)[0]) > 0.5  # the transversal pair is not conjugate
    s = 0.1
    corners = np.array([x, y]) + s * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cell = np.column_stack([corners, corners.prod(1)])
    # The ruled cell: distance of the diagonals' lines, 2 s^2 over sqrt(1 + x^2 + y^2).
    found = planarity_deviation(QuadMesh.of(cell, [[0, 1, 2, 3]]))[0]
    assert found == pytest.approx(2 * s * s / np.sqrt(1 + x * x + y * y), rel=1e-9)


def ellipsoid(s, t, axes=(3.0, 2.0, 1.2)):
    """Points by curvature-line parameters."""
    a, b, c = axes
    k = (a * a - b * b) / (a * a - c * c)
    x = a * np.cos(t) * np.sqrt(np.cos(s) ** 2 + k * np.sin(s) ** 2)
    z = c * np.sin(s) * np.sqrt(np.sin(t) ** 2 + (1 - k) * np.cos(t) ** 2)
    return np.stack([x, b * np.cos(s) * np.sin(t), z], -1)


def test_e04_conjugate_cells_are_two_orders_flatter_but_not_flat():
    shear = np.array([[1, 0.4, 0.1], [0, 1.2, 0.3], [0.2, 0, 0.9]])  # keeps conjugacy only

    def cells(h, turn):
        offsets = 0.5 * h * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn
        s, t = (np.array([0.7, 0.9]) + offsets).T
        mesh = QuadMesh.of(ellipsoid(s, t) @ shear, [[0, 1, 2, 3]])
        return np.array([abs(tetrahedron_volume(mesh)[0]), planarity_deviation(mesh)[0]])

    oblique = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
    for turn, orders in ((np.eye(2), (6, 4)), (oblique, (4, 2))):
        coarse, fine = cells(0.08, turn), cells(0.04, turn)
        np.testing.assert_allclose(np.log2(coarse / fine), orders, atol=0.1)
        # A conjugate net is a start: its mesh is not planar yet.
        assert fine[1] > 1e-9


# --- E5 to E8: parallel meshes and distances ------------------------------------------------


def test_e05_factors_belong_to_edges_not_to_vertices():
    mesh = planar_grid(3, 3)
    basis = null_space(parallel_rows(mesh, mesh.edges))
    member = (np.random.default_rng(5).normal(size=len(basis)) @ basis).reshape(-1, 3)
    images = member[mesh.edges[:, 1]] - member[mesh.edges[:, 0]]
    factors = dot(images, mesh.edge_vectors) / mesh.edge_lengths**2
    np.testing.assert_allclose(images, factors[:, None] * mesh.edge_vectors, atol=NULL)
    at_vertex = factors[(mesh.edges == 5).any(1)]  # vertex (1, 1): one c_i would be one value
    assert len(at_vertex) == 4
    assert np.ptp(at_vertex) > 0.05


def test_e05_parallelism_to_a_collapsed_mesh_is_not_symmetric():
    mesh = planar_grid(3, 2)
    rows = parallel_rows(mesh, mesh.edges)
    point = mesh.with_vertices(np.ones_like(mesh.vertices))
    assert np.abs(rows @ point.vertices.ravel()).max() < EXACT  # the point is in P(M)
    assert np.abs(rows @ -mesh.vertices.ravel()).max() < EXACT  # and so is a factor of -1
    assert len(null_space(rows)) == 3 + 2 + 3
    # Every mesh whatever is parallel to the point, M and non-planar ones included.
    assert not parallel_rows(point, mesh.edges).any()


def test_e06_equations_over_all_pairs_leave_translations_and_scaling_only():
    m, n = 4, 3
    mesh = planar_grid(m, n)
    assert planarity(mesh).max() < EXACT
    pairs = np.array(list(itertools.combinations(range(len(mesh.vertices)), 2)))
    assert len(null_space(parallel_rows(mesh, pairs))) == 4
    assert len(null_space(parallel_rows(mesh, mesh.edges))) == m + n + 3


DEVELOPABLE = np.radians([100.0, 70.0, 90.0, 100.0])


def test_e07_unsigned_face_distance_admits_a_pseudo_offset():
    mesh = quad_star(four_bar(DEVELOPABLE, np.radians(150), -1))
    image, residual = solve_face_offset(mesh, ALTERNATING)
    assert residual < NULL
    other = mesh.with_vertices(mesh.vertices + 0.1 * image)
    moves = dot(other.face_centers - mesh.face_centers, mesh.face_normals)
    assert norm(cross(unit(other.face_normals), mesh.face_normals)).max() < NULL
    np.testing.assert_allclose(np.abs(moves), 0.1, atol=NULL)  # unsigned: an 'offset'
    np.testing.assert_allclose(moves, 0.1 * ALTERNATING, atol=NULL)  # signed: none
    assert solve_face_offset(mesh)[1] > 1e-3
    assert fitted_cones(mesh).misfit[0] > 1e-3


def test_e07_edge_distance_is_that_of_lines_not_of_segments():
    # Tangents of a circle at four points of one half: contacts of two sides lie outside them.
    quad, contacts = exscribed_quad()
    sides = np.roll(quad, -1, 0) - quad
    along = dot(contacts - quad, sides) / dot(sides, sides)
    segment = norm(quad + np.clip(along, 0, 1)[:, None] * sides)
    np.testing.assert_allclose(line_distance(quad, sides), 1.0, atol=EXACT)
    assert segment.max() > 1.05


def exscribed_quad(height=0.4):
    """Quad in the plane z = height whose side lines touch the unit sphere, and the contacts."""
    phi = np.radians([0, 40, 80, 120])
    radius = np.sqrt(1 - height**2)
    middle, half = phi - 0.5 * (phi - np.roll(phi, 1)), 0.5 * (phi - np.roll(phi, 1))
    reach = radius / np.cos(half)
    corners = np.column_stack([reach * np.cos(middle), reach * np.sin(middle), 0 * phi + height])
    touch = np.column_stack([radius * np.cos(phi), radius * np.sin(phi), 0 * phi + height])
    return corners, touch


def test_e08_a_translation_is_a_vertex_offset_of_every_mesh():
    rng = np.random.default_rng(8)
    mesh = planar_grid(2, 2)
    shift = unit(rng.normal(size=3)) * 0.3
    other = mesh.with_vertices(mesh.vertices + shift)
    distance = norm(other.vertices - mesh.vertices)
    np.testing.assert_allclose(distance, 0.3, atol=EXACT)  # an offset as printed
    image = mesh.with_vertices((other.vertices - mesh.vertices) / 0.3)
    assert image.edge_lengths.max() < EXACT  # but its Gauss image is one point
    # With edges that must not vanish there is none: the mesh is not circular.
    assert np.abs(circularity_defect(mesh)).max() > 1e-2
    assert min(propagate(mesh, s)[1] for s in unit(rng.normal(size=(200, 3)))) > 1e-2


# --- E9, E10: the Gauss image ---------------------------------------------------------------


def conical_ring(count=5):
    profile = [[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9]]
    return rotational_mesh(profile, 0.3 * np.arange(count + 1))


def test_e09_gauss_image_is_offset_minus_mesh():
    mesh, d = conical_ring(), 0.1
    image, residual = solve_face_offset(mesh)
    assert residual < NULL
    offset = mesh.vertices + d * image
    printed, true = (mesh.vertices - offset) / d, (offset - mesh.vertices) / d
    corners = mesh.topology.indices
    normals = mesh.face_normals[mesh.topology.corner_faces]
    np.testing.assert_allclose(dot(true[corners], normals), 1.0, atol=NULL)
    np.testing.assert_allclose(dot(printed[corners], normals), -1.0, atol=NULL)
    np.testing.assert_allclose(mesh.vertices + d * true, offset, atol=EXACT)
    assert norm(mesh.vertices + d * printed - offset).min() > d


def test_e09_gauss_image_depends_on_the_offset_and_not_on_the_mesh_alone():
    mesh = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], [0, 0.3, 0.7, 0.9])
    images = [propagate(mesh, unit(np.array(s))) for s in ([1.0, 0.2, 0.3], [0.5, 0.6, -0.3])]
    for image, gap in images:
        assert gap < EXACT
        offset = mesh.vertices + 0.1 * image
        np.testing.assert_allclose(norm(offset - mesh.vertices), 0.1, atol=EXACT)
        assert np.abs(parallel_rows(mesh, mesh.edges) @ image.ravel()).max() < EXACT
    assert norm(images[0][0] - images[1][0]).min() > 0.1


def test_e09_connecting_lines_of_any_parallel_pair_are_node_axes():
    mesh = planar_grid(3, 3)
    basis = null_space(parallel_rows(mesh, mesh.edges))
    member = (np.random.default_rng(9).normal(size=len(basis)) @ basis).reshape(-1, 3)
    start, end = mesh.edges.T
    torsion = dot(cross(member[start], member[end]), unit(mesh.edge_vectors))
    assert np.abs(torsion).max() < NULL  # coplanar neighbours: axes
    assert np.ptp(norm(member)) > 0.1  # though the pair is no offset
    assert np.ptp(dot(member[mesh.topology.indices], mesh.face_normals.repeat(4, 0))) > 0.1


def test_e10_edge_image_touches_with_lines_and_offset_is_d_away_not_1():
    image = koebe_ring(12, 4)
    basis = null_space(parallel_rows(image, image.edges))
    rng = np.random.default_rng(10)
    points = image.vertices + 0.2 * (rng.normal(size=len(basis)) @ basis).reshape(-1, 3)
    mesh, d = image.with_vertices(points), 0.25
    start = mesh.edges[:, 0]
    offset = mesh.vertices + d * image.vertices
    away = line_distance(offset[start], mesh.edge_vectors, mesh.vertices[start])
    np.testing.assert_allclose(away, d, atol=NULL)
    assert np.abs(away - 1.0).min() > 0.7  # the printed last lines of both directions
    touch = line_distance(image.vertices[start], image.edge_vectors)
    np.testing.assert_allclose(touch, 1.0, atol=EXACT)
    np.testing.assert_allclose(away, d * touch, atol=NULL)
    # Carrier lines: also an image whose contacts are not on the edges gives an edge offset.
    quad, _ = exscribed_quad()
    sides = np.roll(quad, -1, 0) - quad
    away = line_distance(quad + d * quad, sides, quad)
    np.testing.assert_allclose(away, d, atol=EXACT)


def test_e10_faces_of_the_image_must_touch_with_one_sign():
    mesh = quad_star(four_bar(DEVELOPABLE, np.radians(150), -1))
    image, residual = solve_face_offset(mesh, ALTERNATING)
    assert residual < NULL
    products = dot(image[mesh.topology.indices], mesh.face_normals[mesh.topology.corner_faces])
    np.testing.assert_allclose(np.abs(products), 1.0, atol=NULL)  # every plane touches S^2
    assert products.min() < 0 < products.max()  # but this is no face offset


# --- E12 to E14: circles and cones ----------------------------------------------------------


def test_e12_vertex_balance_does_not_decide_vertex_offsets_face_balance_does():
    rng = np.random.default_rng(12)
    directions = balanced_directions(rng, 400)[0]
    conical = quad_star(directions)  # balanced at its vertex, parallelogram faces
    assert abs(conicality_defect(conical)[1][0]) < EXACT
    assert np.abs(circularity_defect(conical)).max() > 0.1
    assert min(propagate(conical, s)[1] for s in unit(rng.normal(size=(200, 3)))) > 1e-2
    circular = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], [0, 0.3, 0.8, 0.9])
    assert np.abs(conicality_defect(circular)[1]).min() > 1e-3
    assert np.abs(circularity_defect(circular)).max() < EXACT
    assert propagate(circular, unit(np.array([1.0, 0.3, 0.2])))[1] < EXACT


def test_e12_face_balance_needs_planar_uncrossed_quads():
    phi = np.array([0.0, 0.9, 2.6, 4.1])
    ring = np.column_stack([np.cos(phi), np.sin(phi), 0 * phi])
    crossed = QuadMesh.of(ring[[0, 2, 1, 3]], [[0, 1, 2, 3]])  # on a circle, but crossed
    assert abs(circularity_defect(crossed)[0]) > 0.5
    corners = crossed.corners[0]
    a, b = np.roll(corners, -1, 0) - corners, np.roll(corners, 1, 0) - corners
    alpha, beta, gamma, delta = angle(a, b)
    assert alpha == pytest.approx(gamma, abs=EXACT)
    assert beta == pytest.approx(delta, abs=EXACT)
    tetrahedron = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    skew = QuadMesh.of(tetrahedron, [[0, 1, 2, 3]])
    assert abs(circularity_defect(skew)[0]) < EXACT  # four angles of 60 degrees
    assert planarity(skew)[0] > 0.5
    # The residual of Ptolemy's theorem is right in every case.
    assert circle_deviation(QuadMesh.of(ring, [[0, 1, 2, 3]]))[0] < EXACT
    assert circle_deviation(skew)[0] > 0.5
    assert circle_deviation(crossed)[0] > 0.1


def test_e13_a_prism_is_circular_but_has_no_vertex_offset():
    base = np.array([[0, 0], [2, 0], [2.5, 1.4], [0.3, 1.1]])
    points = np.array([[*p, z] for z in (0, 1) for p in base])
    mesh = QuadMesh.of(points, [[i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4)])
    assert np.abs(circularity_defect(mesh)).max() < EXACT
    assert circle_deviation(mesh).max() < EXACT
    images = around(base)
    fixed = null_space(images - np.eye(3))
    np.testing.assert_allclose(np.abs(fixed), [[0, 0, 1]], atol=NULL)  # only +-e_z closes
    image, gap = propagate(mesh, np.array([0.0, 0.0, 1.0]))
    assert gap < EXACT
    assert mesh.with_vertices(image).edge_lengths.min() < EXACT  # and collapses the edges


def around(loop):
    """Product of the reflections along a closed polygon of the plane z = 0."""
    total = np.eye(3)
    for side in np.roll(loop, -1, 0) - loop:
        u = unit(np.append(side, 0.0))
        total = (np.eye(3) - 2 * np.outer(u, u)) @ total
    return total


@pytest.mark.parametrize(("columns", "family"), [(6, 2), (7, 1)])
def test_e13_closed_rings_have_two_or_one_parameters_by_the_parity_of_columns(columns, family):
    phi = 2 * np.pi * np.arange(columns) / columns
    holonomy = around(np.column_stack([np.cos(phi), np.sin(phi)]))
    # Fixed directions form a space of dimension k; the unit ones in it a sphere of k - 1.
    assert len(null_space(holonomy - np.eye(3))) - 1 == family
    mesh = rotational_mesh([[2, 0], [2.4, 0.5]], phi, closed=True)
    gap = propagate(mesh, unit(np.array([1.0, 0.3, 0.2])))[1]
    assert (gap < EXACT) == (family == 2)
    assert propagate(mesh, unit(np.array([1.0, 0.0, 0.2])))[1] < EXACT  # in the meridian plane


def test_e14_four_planes_always_touch_some_cone_but_seldom_one_of_revolution():
    directions = four_bar(np.radians([80, 95, 70, 85]), np.radians(120), -1)
    mesh = quad_star(directions)
    n = mesh.face_normals
    # Cones as quadrics of their tangent planes: n^T Q n = 0 with Q symmetric.
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    rows = np.array([[(1 if i == j else 2) * m[i] * m[j] for i, j in pairs] for m in n])
    pencil = null_space(rows)
    assert len(pencil) == 2  # a whole pencil of quadratic cones
    q = np.zeros((3, 3))
    for (i, j), value in zip(pairs, pencil[0] + 0.3 * pencil[1], strict=True):
        q[i, j] = q[j, i] = value
    assert np.abs(np.einsum("fi,ij,fj->f", n, q, n)).max() < EXACT
    assert abs(np.linalg.det(q)) > 1e-3
    assert fitted_cones(mesh).spread[0] > 1e-2  # no cone of revolution


def test_e14_boundary_vertices_carry_no_condition():
    mesh = conical_ring()
    inner = np.flatnonzero(~mesh.topology.is_boundary_vertex)
    np.testing.assert_array_equal(fitted_cones(mesh).vertices, inner)
    for star in mesh.topology.stars(boundary=True):
        normals = mesh.face_normals[star.faces]
        assert cone_fit(normals)[1].max() < EXACT  # one or two planes always touch a cone


# --- E15 to E18: angles, bisectors, Koebe ---------------------------------------------------


def balance(directions):
    """w1 - w2 + w3 - w4 ... of cyclic directions (..., k, 3)."""
    w = angle(directions, np.roll(directions, -1, -2))
    return w @ np.where(np.arange(directions.shape[-2]) % 2, -1.0, 1.0)


def corner_normals(directions):
    return unit(cross(directions, np.roll(directions, -1, -2)))


def balanced_directions(rng, trials, k=4):
    """Random vertices of valence k with balance 0: the last edge turned until it is so."""
    free = unit(rng.normal(size=(trials, k - 1, 3)))
    ends = unit(rng.normal(size=(2, trials, 3)))

    def at(last):
        return np.concatenate([free, unit(last)[:, None]], 1)

    low, high = ends
    use = balance(at(low)) * balance(at(high)) < 0
    free, low, high = free[use], low[use], high[use]
    low, high = (
        np.where((balance(at(low)) < 0)[:, None], a, b) for a, b in ((low, high), (high, low))
    )
    for _ in range(60):
        middle = unit(low + high)
        below = (balance(at(middle)) < 0)[:, None]
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    directions = at(low)
    # Stay away from flat edges, straight corners and jumps of the search.
    normals = corner_normals(directions)
    kinks = norm(cross(normals, np.roll(normals, -1, 1))).min(1)
    corners = np.sin(angle(directions, np.roll(directions, -1, 1))).min(1)
    centered = normals - normals.mean(1, keepdims=True)
    second = np.linalg.svd(centered, compute_uv=False)[:, 1]
    good = (np.abs(balance(directions)) < EXACT) & (kinks > 0.1) & (corners > 0.1) & (second > 0.1)
    return directions[good]


def sign_types(directions):
    """Signs of det(p_i-1, p_i, p_i+1), up to a rotation of the indices."""
    before, after = np.roll(directions, 1, -2), np.roll(directions, -1, -2)
    return np.sign(dot(cross(before, directions), after)).astype(int)


def random_cone_vertices(rng, count, classes):
    """Edges of four planes on a cone, turned so that corner normals are +- the cone normals."""
    phi = rng.uniform(0, 2 * np.pi, (count, 4))
    tilt = rng.uniform(0.2, 1.3, (count, 1))
    n = np.stack(
        [np.sin(tilt) * np.cos(phi), np.sin(tilt) * np.sin(phi), np.cos(tilt) + 0 * phi], -1
    )
    lines = unit(cross(np.roll(n, 1, 1), n))
    turn = np.sign(dot(cross(lines, np.roll(lines, -1, 1)), n)) * np.asarray(classes)
    sigma = np.concatenate([np.ones((count, 1)), np.cumprod(turn[:, :3], 1)], 1)
    clear = np.abs(np.sin(phi - np.roll(phi, 1, 1))).min(1) > 0.05
    use = (turn.prod(1) > 0) & clear
    return (sigma[..., None] * lines)[use], n[use]


def test_e15_balance_is_equivalent_to_an_oriented_cone_without_convexity():
    rng = np.random.default_rng(15)
    directions = balanced_directions(rng, 6000)
    assert len(directions) > 1000
    _, spread = cone_fit(corner_normals(directions))
    assert spread.max() < 1e-11  # conditioning 1 / second singular value, filtered at 0.1
    found = {tuple(t) for t in sign_types(directions)}
    sums = {sum(t) for t in found}
    assert sums == {4, -4, 2, -2, 0}  # elliptic, crossed and saddle vertices all occur
    assert {t for t in found if sum(t) == 0} == {(1, -1, 1, -1), (-1, 1, -1, 1)}
    other, _ = random_cone_vertices(rng, 6000, (1, 1, 1, 1))
    assert len(other) > 1000
    assert np.abs(balance(other)).max() < 1e-10


@pytest.mark.parametrize(
    ("classes", "identity", "right"),
    [
        ((1, -1, 1, -1), (1, 1, 1, 1), 2 * np.pi),
        ((1, -1, -1, 1), (1, 1, -1, -1), 0.0),
        ((1, 1, -1, -1), (-1, 1, 1, -1), 0.0),
    ],
)
def test_e15_unoriented_cones_have_three_further_classes(classes, identity, right):
    directions, normals = random_cone_vertices(np.random.default_rng(16), 4000, classes)
    assert len(directions) > 500
    angles = angle(directions, np.roll(directions, -1, 1))
    np.testing.assert_allclose(angles @ np.array(identity), right, atol=1e-10)
    planes = corner_normals(directions) * np.array(classes)[:, None]
    signs = np.sign(dot(planes, normals))
    assert (signs == signs[:, :1]).all()  # the planes touch the cone, with these signs
    assert np.median(np.abs(balance(directions))) > 0.1  # but the balance fails


def test_e15_flat_vertices_and_flat_edges_are_conical_without_balance():
    t = np.array([0.0, 1.2, 2.9, 4.0])
    flat = quad_star(np.column_stack([np.cos(t), np.sin(t), 0 * t]))
    assert abs(conicality_defect(flat)[1][0]) > 1
    assert fitted_cones(flat).spread[0] < 1e-7  # angle of equal normals: root of rounding
    edge = quad_star([[1, 0, 0], [0.2, 1, 0], [-1, 0.3, 0], [-0.4, -1, 1.2]])
    assert norm(cross(edge.face_normals[0], edge.face_normals[1])) < EXACT
    assert abs(conicality_defect(edge)[1][0]) > 0.05
    assert fitted_cones(edge).misfit[0] < EXACT


def test_e15_reflex_corners_balance_modulo_two_pi_only():
    _, normals = random_cone_vertices(np.random.default_rng(17), 200, (1, 1, 1, 1))
    lines = unit(cross(np.roll(normals, 1, 1), normals))
    jumps = set()
    for signs in itertools.product([1, -1], repeat=4):
        p = lines * np.array(signs)[:, None]
        q = np.roll(p, -1, 1)
        corners = np.arctan2(dot(cross(p, q), normals), dot(p, q)) % (2 * np.pi)
        turns = corners @ ALTERNATING / (2 * np.pi)
        assert np.abs(turns - np.round(turns)).max() < 1e-10
        jumps |= set(np.round(turns).astype(int).tolist())
    assert jumps >= {-1, 0, 1}  # with reflex corners the printed equality fails


def test_e15_valence_3_is_always_conical_and_valence_6_not_by_its_alternating_sum():
    rng = np.random.default_rng(18)
    triple = star_mesh(unit(np.array([[1, 0, 0.2], [-0.4, 0.9, 0.5], [-0.5, -0.8, 0.1]])))
    assert fitted_cones(triple).spread[0] < EXACT
    six = balanced_directions(rng, 400, k=6)
    assert np.abs(balance(six)).max() < EXACT
    assert np.median(cone_fit(corner_normals(six))[1]) > 0.1
    phi = np.array([0.1, 1.0, 2.2, 3.1, 4.0, 5.3])
    n = np.column_stack([0.5 * np.cos(phi), 0.5 * np.sin(phi), np.sqrt(0.75) + 0 * phi])
    assert abs(balance(cross(np.roll(n, 1, 0), n))) < EXACT  # necessary: a true cone has it


def tangent_quad(rng):
    """Contacts p_i and vertices u_i (between sides i and i+1) of a quad about a circle."""
    axis, radius = unit(rng.normal(size=3)), rng.uniform(0.2, 0.5)
    e1 = unit(np.cross(axis, rng.normal(size=3)))
    e2 = np.cross(axis, e1)
    phi = 0.5 * np.pi * np.arange(4) + rng.uniform(-0.4, 0.4, 4)
    around_axis = np.cos(phi)[:, None] * e1 + np.sin(phi)[:, None] * e2
    contacts = np.cos(radius) * axis + np.sin(radius) * around_axis
    poles = np.cos(radius) * around_axis - np.sin(radius) * axis
    vertices = unit(cross(poles, np.roll(poles, -1, 0)))
    return contacts, vertices * np.sign(vertices @ axis)[:, None]


def test_e16_corrected_chain_of_tangent_lengths_and_the_strict_triangle_inequality():
    rng = np.random.default_rng(19)
    for _ in range(50):
        (p1, p2, p3, p4), (u1, u2, u3, cut) = tangent_quad(rng)
        assert angle(u1, p1) == pytest.approx(angle(u1, p2), abs=EXACT)  # printed: p1 twice
        assert angle(u2, p2) == pytest.approx(angle(u2, p3), abs=EXACT)
        assert angle(u3, p3) == pytest.approx(angle(u3, p4), abs=EXACT)
        assert angle(cut, p4) == pytest.approx(angle(cut, p1), abs=EXACT)
        a1_cut, a2, a3, a4_cut = angle(cut, u1), angle(u1, u2), angle(u2, u3), angle(u3, cut)
        assert a1_cut + a3 == pytest.approx(a2 + a4_cut, abs=EXACT)
        # Side e1 prolonged beyond u4' to u4: no incircle any more, and no balance.
        u4 = unit(cut + 0.2 * unit(cut - u1 * (cut @ u1)))
        a1, a4 = angle(u4, u1), angle(u3, u4)
        assert a1 - a1_cut == pytest.approx(angle(u4, cut), abs=EXACT)
        assert a4 < a4_cut + angle(u4, cut) - 1e-4  # strict
        assert a1 + a3 - a2 - a4 > 1e-4
        # (1) and (2) would give a1 - a1' = a4 - a4'; the printed sum is of another size.
        assert a4 + a4_cut - (a1 - a1_cut) > 0.1


def test_e17_bisector_planes_contain_the_sum_of_normals():
    directions, _ = random_cone_vertices(np.random.default_rng(20), 500, (1, 1, 1, 1))
    normals = corner_normals(directions)
    axis = cone_fit(normals)[0][:, None]
    before = np.roll(normals, 1, 1)
    true = dot(cross(directions, unit(before + normals)), axis)
    wrong = dot(cross(directions, unit(before - normals)), axis)
    assert np.abs(true).max() < 1e-9  # the axis of a nearly flat quartet is known to 1e-10
    assert np.median(np.abs(wrong)) > 0.1


def test_e17_circle_of_a_saddle_vertex_is_not_inscribed():
    directions = balanced_directions(np.random.default_rng(21), 6000)
    normals = corner_normals(directions)
    axis = cone_fit(normals)[0]
    level = dot(normals, axis[:, None])
    contact = axis[:, None] - level[..., None] * normals
    left = dot(cross(directions, contact), normals)
    right = dot(cross(contact, np.roll(directions, -1, 1)), normals)
    inside = [((s * left > 0) & (s * right > 0)).all(1) for s in (1, -1)]
    inscribed = inside[0] | inside[1]
    total = np.abs(sign_types(directions).sum(1))
    assert (total == 0).sum() > 100
    assert not inscribed[total == 0].any()
    assert inscribed[total == 4].all()


def test_e18_koebe_functional_is_convex_in_logarithms_of_radii_only():
    rng = np.random.default_rng(22)
    pairs = np.array([(i, 4 + j) for i in range(4) for j in range(5) if (i * j + i) % 3 != 1])
    rho, target = rng.normal(size=9), 4.0 * np.ones(9)
    gradient, hessian = target.copy(), np.zeros((9, 9))
    for i, j in pairs:
        weight = 1 / np.cosh(rho[j] - rho[i])
        gradient[i] -= 2 * np.arctan(np.exp(rho[j] - rho[i]))
        gradient[j] -= 2 * np.arctan(np.exp(rho[i] - rho[j]))
        hessian[np.ix_([i, j], [i, j])] += weight * np.array([[1, -1], [-1, 1]])
    assert np.linalg.eigvalsh(hessian).min() > -EXACT
    r = np.exp(rho)
    in_radii = hessian / np.outer(r, r) - np.diag(gradient / r**2)
    assert np.linalg.eigvalsh(in_radii).min() < -0.1


def test_e18_edge_offset_meshes_need_no_closed_polyhedron():
    image = koebe_ring(12, 4)
    touch = line_distance(image.vertices[image.edges[:, 0]], image.edge_vectors)
    np.testing.assert_allclose(touch, 1.0, atol=EXACT)
    assert planarity(image).max() < EXACT
    assert image.topology.euler_characteristic == 0
    assert len(image.topology.boundary_loops) == 2
