"""The numbered statements of chapters 2 to 4, each in the form that is true, with random cases.

Names follow the numbers of the thesis; `docs/errata.md` says where a statement was amended.
"""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pq import pq_rows
from scipy.optimize import brentq
from shapes import cyclide, sampled, torus, vertex_fan

from pqmesh.errors import MeshError
from pqmesh.mesh.cones import sign_class_residuals, vertex_cones
from pqmesh.mesh.exact import (
    grid_mesh,
    mirror_plane_mesh,
    rotational_mesh,
)
from pqmesh.mesh.measure import conicality_defect, fitted_cones, planarity, planarity_deviation
from pqmesh.offset.distances import (
    edge_distance,
    face_distance,
    is_offset,
    is_parallel,
    vertex_distance,
)
from pqmesh.offset.gauss import gauss_image, sphere_deviation, touches_sphere
from pqmesh.offset.members import combined
from pqmesh.offset.parallel import parallel_space
from pqmesh.offset.spaces import offset_space
from pqmesh.offset.vectors import face_offset_vectors

KINDS = ("vertex", "edge", "face")
# Singular vectors: theory tolerance for members of P(M).
MEMBER = 1e-9
seeds = st.integers(0, 2**31 - 1)
sizes = st.integers(1, 5)
distances = st.floats(0.05, 0.6).flatmap(lambda d: st.sampled_from([d, -d]))
few = settings(max_examples=25, deadline=None)


# --- proposition 2.1.1 ------------------------------------------------------------------------


def translational(h, seed):
    """Sums of two curves, sampled: planar at every step."""
    a, b = np.random.default_rng(seed).uniform(0.2, 0.6, (2, 3))
    t = np.arange(-1, 1 + h / 2, h)
    first = np.stack([t, a[0] * t**2, a[1] * np.sin(t + a[2])], axis=-1)
    second = np.stack([b[0] * t**2, t, b[1] * np.cos(t - b[2])], axis=-1)
    return first[:, None] + second[None]


def projective(h, seed):
    """A projective image of the former: planar at every step, no parallelograms."""
    points = translational(h, seed)
    return points / (1.5 + 0.2 * points @ np.array([0.5, -0.4, 0.3]))[..., None]


def rotational(h, seed):
    """A profile turned about an axis."""
    a = np.random.default_rng(seed).uniform(0.2, 0.6, 2)
    t, phi = np.meshgrid(np.arange(-1, 1 + h / 2, h), np.arange(-1, 1 + h / 2, h), indexing="ij")
    radius = 2 + a[0] * np.sin(t + a[1])
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), t], axis=-1)


def curvature_lines(h, seed):
    """Curvature lines of a cyclide in their parameters."""
    u, v = np.random.default_rng(seed).uniform(0.3, 0.8, 2)
    steps = np.arange(-1, 1 + h / 2, h)
    return sampled(cyclide, u + 0.4 * steps, v + 0.4 * steps)[0]


def slanted(h, seed):
    """A torus along lines that are not conjugate: the negative case."""
    t = np.arange(-1, 1 + h / 2, h)
    s, r = np.meshgrid(t, t, indexing="ij")
    tilt = np.random.default_rng(seed).uniform(0.3, 0.6)
    return torus(s + tilt * r, r - tilt * s)[0]


def conjugacy(points):
    """Largest defect of conjugacy |X_uv . N| / (|X_uu| + |X_vv| + |X_uv|) by differences."""
    u, v = points[2:, 1:-1] - points[:-2, 1:-1], points[1:-1, 2:] - points[1:-1, :-2]
    mixed = (points[2:, 2:] - points[2:, :-2] - points[:-2, 2:] + points[:-2, :-2]) / 4
    bent = [points[2:, 1:-1] + points[:-2, 1:-1], points[1:-1, 2:] + points[1:-1, :-2]]
    size = sum(np.linalg.norm(x - 2 * points[1:-1, 1:-1], axis=-1) for x in bent)
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal, axis=-1)[..., None]
    size = size + np.linalg.norm(mixed, axis=-1)
    return (np.abs((mixed * normal).sum(axis=-1)) / size).max()


@pytest.mark.parametrize("refined", [translational, projective, rotational, curvature_lines])
@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_proposition_2_1_1_refined_planar_meshes_tend_to_conjugate_networks(refined, seed):
    steps = 0.2, 0.1, 0.05
    meshes = [grid_mesh(refined(h, seed)) for h in steps]
    # The refinement keeps faces planar at every step...
    assert max(planarity(mesh).max() for mesh in meshes) < 1e-12
    # ...so the limit is conjugate. Halving the step leaves a quarter of the defect or less.
    defects = np.array([conjugacy(refined(h, seed)) for h in steps])
    assert defects[2] < 5e-3
    ratio = defects[1:] / np.maximum(defects[:-1], 1e-12)
    assert (ratio < 0.3).all() or defects.max() < 1e-11


@settings(max_examples=8, deadline=None)
@given(seed=seeds)
def test_proposition_2_1_1_networks_that_are_not_conjugate_have_no_planar_refinement(seed):
    steps = 0.2, 0.1, 0.05
    defects = np.array([conjugacy(slanted(h, seed)) for h in steps])
    assert defects.min() > 0.05
    # Deviation of the samples: order 2 here, order 4 on conjugate lines, where it is not zero
    # anyway. So conjugate lines are a start for planar meshes, not planar by themselves (E4).
    flat = [planarity_deviation(grid_mesh(slanted(h, seed))).max() for h in steps]
    order = np.log2(np.array(flat[:-1]) / flat[1:])
    assert np.abs(order - 2).max() < 0.3


# --- proposition 2.2.1 ------------------------------------------------------------------------


@few
@given(m=sizes, n=sizes, seed=seeds, closed=st.booleans())
def test_proposition_2_2_1_parallel_meshes_form_a_linear_space(m, n, seed, closed):
    mesh = pq_rows(m, n + 4 if closed else n, seed, closed=closed)
    space = parallel_space(mesh)
    assert space.dimension == (n + 4 if closed else m + n + 3)
    rng = np.random.default_rng(seed)
    first, second = (space.member(rng.normal(size=space.dimension)) for _ in range(2))
    assert is_parallel(mesh, first, MEMBER)
    assert is_parallel(mesh, second, MEMBER)
    a, b = rng.normal(size=2)
    mixed = combined([first, second], [a, b])
    assert is_parallel(mesh, mixed, MEMBER)
    # Factors belong to edges, and those of a combination combine.
    factors = a * space.edge_factors(first) + b * space.edge_factors(second)
    assert np.abs(space.edge_factors(mixed) - factors).max() < MEMBER
    edges = mixed.edge_vectors - factors[:, None] * mesh.edge_vectors
    assert np.abs(edges).max() < MEMBER * np.abs(mixed.vertices).max()
    # The mesh itself, the point, translations and scalings are members.
    for points in (mesh.vertices, 0 * mesh.vertices + 1.0, -2 * mesh.vertices + [1, 2, 3]):
        member = space.member(space.coordinates(points))
        assert np.abs(member.vertices - points).max() < 1e-9 * np.abs(points).max()


def test_proposition_2_2_1_needs_edges_with_a_direction():
    mesh = pq_rows(2, 3)
    points = np.array(mesh.vertices)
    points[1] = points[0]
    with pytest.raises(MeshError, match="edge 0-1 has 0"):
        parallel_space(mesh.with_vertices(points))


# --- theorem 3.1.1 ----------------------------------------------------------------------------


def random_pair(m, n, seed):
    mesh = pq_rows(m, n, seed)
    space = parallel_space(mesh)
    step = np.random.default_rng(seed).normal(size=space.dimension)
    return mesh, mesh.with_vertices(space.member(step).vertices)


@few
@given(m=sizes, n=sizes, seed=seeds, d=distances)
def test_theorem_3_1_1_distance_is_that_of_the_image_from_the_origin(m, n, seed, d):
    # For every parallel pair, offset or not; both directions of the theorem are special cases.
    mesh, image = random_pair(m, n, seed)
    other = mesh.with_vertices(mesh.vertices + d * image.vertices)
    found = gauss_image(mesh, other, d)
    size = np.abs(image.vertices).max() + np.abs(mesh.vertices).max() / abs(d)
    assert np.abs(found.vertices - image.vertices).max() < 1e-14 * size
    reached = vertex_distance(mesh, other)
    wanted = abs(d) * (1 + sphere_deviation(mesh, image, "vertex"))
    assert np.abs(reached - wanted).max() < 1e-12
    long = other.edge_lengths > 1e-3 * mesh.edge_lengths
    reached = edge_distance(mesh, other)[long]
    wanted = abs(d) * (1 + sphere_deviation(mesh, image, "edge"))[long]
    assert np.abs(reached - wanted).max(initial=0.0) < MEMBER
    wanted = d * (1 + sphere_deviation(mesh, image, "face"))
    assert np.abs(face_distance(mesh, other) - wanted).max() < 1e-12
    # All corners of a face agree.
    assert np.ptp(sphere_deviation(mesh, image, "face"), axis=1).max() < MEMBER
    # A random pair is no offset, and its image does not touch the sphere; one face always does.
    assume(m * n > 1)
    for kind in KINDS:
        assert not is_offset(mesh, other, kind)
        assert not touches_sphere(mesh, image, kind)


@few
@given(seed=seeds, d=distances)
def test_theorem_3_1_1_vertex_offset_if_and_only_if_the_image_lies_on_the_sphere(seed, d):
    rng = np.random.default_rng(seed)
    turns = np.cumsum(rng.uniform(0.15, 0.4, 6))
    profile = np.column_stack([2 + 0.3 * rng.normal(size=4).cumsum() * 0.3, np.arange(4)])
    mesh = rotational_mesh(profile, turns)
    # An image on the sphere gives an offset...
    image = mesh.with_vertices(offset_space(mesh, "vertex").vectors)
    assert touches_sphere(mesh, image, "vertex", 1e-11)
    other = mesh.with_vertices(mesh.vertices + d * image.vertices)
    assert is_offset(mesh, other, "vertex")
    assert np.abs(vertex_distance(mesh, other) - abs(d)).max() < 1e-11
    # ...and an offset an image on the sphere: reflections by hand, from another start.
    start = rng.normal(size=3)
    start /= np.linalg.norm(start)
    u = mesh.edge_vectors / mesh.edge_lengths[:, None]
    moved = np.full_like(mesh.vertices, np.nan)
    moved[0] = mesh.vertices[0] + d * start
    for _ in range(10):
        for (i, j), way in zip(mesh.edges.tolist(), u, strict=True):
            for a, b in ((i, j), (j, i)):
                if np.isnan(moved[b, 0]) and not np.isnan(moved[a, 0]):
                    s = moved[a] - mesh.vertices[a]
                    moved[b] = mesh.vertices[b] + s - 2 * (s @ way) * way
    other = mesh.with_vertices(moved)
    assert np.ptp(vertex_distance(mesh, other)) < 1e-11
    assert touches_sphere(mesh, gauss_image(mesh, other, d), "vertex", 1e-10 / abs(d))


def koebe_ring(columns, rows, start):
    """Rotational mesh whose edges touch the unit sphere."""
    half = np.pi / columns
    tau = start + 2 * np.arccosh(1 / np.cos(half)) * np.arange(rows)
    profile = np.column_stack([1 / np.cosh(tau) / np.cos(half), np.tanh(tau)])
    return rotational_mesh(profile, 2 * half * np.arange(columns), closed=True)


@few
@given(columns=st.integers(4, 12), rows=st.integers(2, 5), seed=seeds, d=distances)
def test_theorem_3_1_1_edge_offset_if_and_only_if_edge_lines_touch_the_sphere(
    columns, rows, seed, d
):
    image = koebe_ring(columns, rows, -1.0)
    space = parallel_space(image)
    step = np.random.default_rng(seed).normal(size=space.dimension)
    mesh = image.with_vertices(image.vertices + 0.2 * space.member(step).vertices)
    assume(mesh.edge_lengths.min() > 0.01 * mesh.mean_edge_length)
    assert touches_sphere(mesh, image, "edge", MEMBER)
    other = mesh.with_vertices(mesh.vertices + d * image.vertices)
    long = other.edge_lengths > 0.01 * mesh.edge_lengths
    assert np.abs(edge_distance(mesh, other)[long] - abs(d)).max() < 1e-8
    # Back: of all combinations of images the offset is found by its distance alone.
    found = gauss_image(mesh, other, d)
    assert np.abs(sphere_deviation(mesh, found, "edge")).max() < 1e-9 / abs(d)
    # Moved off the sphere, in P(M), it is no offset any more.
    for factor, shift in ((1.1, 0.0), (1.0, 0.1)):
        wrong = mesh.with_vertices(mesh.vertices + d * (factor * image.vertices + shift))
        assert not touches_sphere(mesh, gauss_image(mesh, wrong, d), "edge")
        assert factor != 1.0 or not is_offset(mesh, wrong, "edge")


def conical_grid(seed):
    """Planes in mirrors: conical, without symmetry. Mirrors tilt little, so that none cross."""
    rng = np.random.default_rng(seed)
    z = np.linspace(-1, 1, 6) + rng.uniform(-0.05, 0.05, 6)
    strip = np.column_stack([np.ones(6), np.full(6, 0.1), z, 2 + 0.2 * z * z])
    turn = np.cumsum(rng.uniform(0.1, 0.2, 5))
    tilt = rng.uniform(-0.06, 0.06, (5, 2))
    return mirror_plane_mesh(strip, np.column_stack([-np.sin(turn), np.cos(turn), tilt]))


@few
@given(seed=seeds, d=distances)
def test_theorem_3_1_1_face_offset_if_and_only_if_planes_touch_the_sphere_with_one_sign(seed, d):
    mesh = conical_grid(seed)
    d = 0.2 * d
    image = mesh.with_vertices(face_offset_vectors(mesh).vectors)
    assert touches_sphere(mesh, image, "face", 1e-12)
    other = mesh.with_vertices(mesh.vertices + d * image.vertices)
    assert is_offset(mesh, other, "face", 1e-10)
    assert np.abs(face_distance(mesh, other) - d).max() < 1e-13
    # Back: the mesh whose planes were moved by d, built from these planes alone.
    planes = np.column_stack([mesh.face_normals, (mesh.face_normals * mesh.face_centers).sum(1)])
    planes[:, 3] += d
    points = np.array(other.vertices)
    (star,) = mesh.topology.stars()
    for vertex, faces in zip(star.vertices, star.faces, strict=True):
        points[vertex] = np.linalg.lstsq(planes[faces, :3], planes[faces, 3], rcond=None)[0]
    found = gauss_image(mesh, mesh.with_vertices(points), d)
    assert touches_sphere(mesh, found, "face", 1e-12 / abs(d))
    # The planes of the image lie at distance 1 on the side of the normals; reversed, they touch
    # the sphere too, but from the other side, and that is the offset by -d.
    back = mesh.with_vertices(-image.vertices)
    assert sphere_deviation(mesh, back, "face") == pytest.approx(-2.0, abs=1e-12)


# --- theorem 4.1.1 ----------------------------------------------------------------------------


def angles(p, q):
    return np.arctan2(np.linalg.norm(np.cross(p, q), axis=-1), (p * q).sum(axis=-1))


def cone_vertex(seed):
    """Edges of four oriented planes about a cone, corners with one sign: 0 < w < pi."""
    rng = np.random.default_rng(seed)
    while True:
        phi, tilt = rng.uniform(0, 2 * np.pi, 4), rng.uniform(0.1, 1.3)
        if np.abs(np.sin(0.5 * np.subtract.outer(phi, phi)[np.triu_indices(4, 1)])).min() < 0.15:
            continue
        normals = np.stack([np.sin(tilt) * np.cos(phi), np.sin(tilt) * np.sin(phi),
                            np.cos(tilt) + 0 * phi], axis=-1)  # fmt: skip
        ways = np.cross(np.roll(normals, 1, axis=0), normals)
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        signs = np.ones(4)
        for i in range(3):
            signs[i + 1] = np.sign(np.cross(signs[i] * ways[i], ways[i + 1]) @ normals[i])
        ways = ways * signs[:, None]
        if np.cross(ways[3], ways[0]) @ normals[3] > 0:
            return ways, normals, tilt


@settings(max_examples=100, deadline=None)
@given(seed=seeds)
def test_theorem_4_1_1_conical_vertices_balance(seed):
    ways, normals, tilt = cone_vertex(seed)
    mesh = vertex_fan(ways)
    # The planes are the ones chosen, with one sign.
    assert np.abs(mesh.face_normals - normals).max() < 1e-9
    balance = conicality_defect(mesh)[1][0]
    assert abs(balance) < 1e-9
    residuals = sign_class_residuals(mesh)[1]
    assert abs(residuals["++++"][0]) < 1e-9
    for method in ("least squares", "bisectors"):
        cone = vertex_cones(mesh, method)
        assert np.abs(cone.axis[0] - [0, 0, 1]).max() < 1e-8
        assert cone.half_angle[0] == pytest.approx(np.pi / 2 - tilt, abs=1e-8)
        assert cone.deviation[0] < 1e-8


def balanced_vertex(seed):
    """Four edges whose angles balance, and their corners' normals; no planes nearly equal."""
    rng = np.random.default_rng(seed)
    while True:
        ways = rng.normal(size=(4, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        ends = rng.normal(size=(2, 3))

        def balance(t, ways=ways, ends=ends):
            p = np.array([*ways[:3], ends[0] + t * (ends[1] - ends[0])])
            return float(angles(p, np.roll(p, -1, axis=0)) @ [1, -1, 1, -1])

        if balance(0.0) * balance(1.0) >= 0:
            continue
        t = brentq(balance, 0.0, 1.0, xtol=1e-15)
        ways[3] = ends[0] + t * (ends[1] - ends[0])
        ways[3] /= np.linalg.norm(ways[3])
        normals = np.cross(ways, np.roll(ways, -1, axis=0))
        sines = np.linalg.norm(normals, axis=1)
        normals /= sines[:, None]
        bends = np.linalg.norm(normals - np.roll(normals, 1, axis=0), axis=1)
        spread = np.linalg.svd(normals - normals.mean(axis=0), compute_uv=False)
        # The last three: corners, flat edges, planes nearly through one line.
        if min(sines.min(), bends.min(), spread[1]) > 0.1 and abs(balance(t)) < 1e-12:
            return ways, normals


@settings(max_examples=100, deadline=None)
@given(seed=seeds)
def test_theorem_4_1_1_balanced_vertices_are_conical(seed):
    # No convexity is asked: elliptic, saddle and crossed vertices occur.
    ways, normals = balanced_vertex(seed)
    spread = np.linalg.svd(normals - normals.mean(axis=0), compute_uv=False)
    assert spread[2] < 1e-10
    mesh = vertex_fan(ways)
    assert abs(conicality_defect(mesh)[1][0]) < 1e-11
    # In the corners' own orientation the planes touch one cone with one sign.
    axis = np.linalg.svd(normals - normals.mean(axis=0))[2][2]
    assert np.ptp(normals @ axis) < 1e-10


def test_theorem_4_1_1_flat_edges_are_why_normals_must_differ():
    mesh = vertex_fan([[1, 0, 0], [0.2, 1, 0], [-1, 0.3, 0], [-0.4, -1, 1.2]])
    assert fitted_cones(mesh).misfit[0] < 1e-13
    assert abs(conicality_defect(mesh)[1][0]) > 0.05


# --- lemma 4.1.2 ------------------------------------------------------------------------------


def sides_of(corners):
    return angles(corners, np.roll(corners, -1, axis=0))


def tangent_quad(rng):
    """Corners of a spherical quad whose sides touch a circle, counterclockwise about the pole."""
    radius, steps = rng.uniform(0.1, 0.7), rng.uniform(0.7, 1.3, 4)
    phi = np.cumsum(steps / steps.sum() * 2 * np.pi)
    inward = np.stack([-np.cos(radius) * np.cos(phi), -np.cos(radius) * np.sin(phi),
                       np.sin(radius) + 0 * phi], axis=-1)  # fmt: skip
    corners = np.cross(inward, np.roll(inward, -1, axis=0))
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    return (corners, radius) if corners[:, 2].min() > 0.05 else tangent_quad(rng)


@settings(max_examples=100, deadline=None)
@given(seed=seeds)
def test_lemma_4_1_2_quads_with_incircle_balance(seed):
    corners, radius = tangent_quad(np.random.default_rng(seed))
    poles = np.cross(np.roll(corners, 1, axis=0), corners)
    poles /= np.linalg.norm(poles, axis=1)[:, None]
    assert np.abs(poles[:, 2] - np.sin(radius)).max() < 1e-12
    # Both tangents from a corner are equal, and so the alternating sum of the sides vanishes.
    tangents = np.arccos(np.clip(corners[:, 2] / np.cos(radius), -1, 1))
    assert np.abs(sides_of(corners) - tangents - np.roll(tangents, -1)).max() < 1e-7
    assert abs(sides_of(corners) @ [1, -1, 1, -1]) < 1e-11


def balanced_quad(seed):
    """A convex spherical quad that balances, and the inward poles of its sides."""
    rng = np.random.default_rng(seed)
    while True:
        corners, _ = tangent_quad(rng)
        # Another quad: three corners moved at will, the fourth on a ray so that it balances.
        corners[:3] += 0.15 * rng.normal(size=(3, 3))
        corners /= np.linalg.norm(corners, axis=1)[:, None]
        ray = np.cross(corners[3], [0.3, rng.normal(), 1.0])

        def balance(t, corners=corners, ray=ray):
            return float(sides_of(np.array([*corners[:3], corners[3] + t * ray])) @ [1, -1, 1, -1])

        if balance(-0.5) * balance(0.5) >= 0:
            continue
        corners[3] += brentq(balance, -0.5, 0.5, xtol=1e-15) * ray
        corners /= np.linalg.norm(corners, axis=1)[:, None]
        inward = np.cross(corners, np.roll(corners, -1, axis=0))
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        # Convex, in an open half of the sphere, sides not too small.
        heights = inward @ corners.T
        away = [heights[i, (i + k) % 4] for i in range(4) for k in (2, 3)]
        if min(away) > 0.05 and sides_of(corners).min() > 0.05:
            return corners, inward


@settings(max_examples=100, deadline=None)
@given(seed=seeds)
def test_lemma_4_1_2_convex_quads_that_balance_have_an_incircle(seed):
    corners, inward = balanced_quad(seed)
    # The center has one distance from the first three sides; that of the fourth is no accident.
    center = np.linalg.solve(inward[:3], np.ones(3))
    assert inward[3] @ center == pytest.approx(1.0, abs=1e-8)
    # The circle lies inside: the contact of each side lies between its corners.
    axis = center / np.linalg.norm(center)
    contacts = axis - (inward @ axis)[:, None] * inward
    following = np.roll(corners, -1, axis=0)
    assert ((np.cross(corners, contacts) * inward).sum(axis=1) > -1e-9).all()
    assert ((np.cross(contacts, following) * inward).sum(axis=1) > -1e-9).all()


def test_lemma_4_1_2_printed_sum_of_tangents_contradicts_nothing_but_the_corrected_one_does():
    # A quad whose one corner was moved along a side has no incircle and no balance: the triangle
    # inequality is strict.
    radius, phi = 0.4, np.array([0.2, 1.7, 3.3, 4.9])
    inward = np.stack([-np.cos(radius) * np.cos(phi), -np.cos(radius) * np.sin(phi),
                       np.sin(radius) + 0 * phi], axis=-1)  # fmt: skip
    corners = np.cross(inward, np.roll(inward, -1, axis=0))
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    assert abs(sides_of(corners) @ [1, -1, 1, -1]) < 1e-12
    away = corners[3] - 0.2 * (corners[2] - corners[3])
    moved = np.array([*corners[:3], away / np.linalg.norm(away)])
    assert abs(sides_of(moved) @ [1, -1, 1, -1]) > 1e-2
