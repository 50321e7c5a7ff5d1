"""Triangles as a reference: exact closest points, and normals that are smooth where it is."""

import numpy as np
import pytest
from shapes import icosahedron, observed_orders, random_rotation, sampled, torus, voxel_surface

from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.surface import reference
from pqmesh.surface.analytic import torus as torus_surface
from pqmesh.surface.reference import CREASE, SurfaceReference, TriangleReference


def closest_by_force(corners, points):
    """Distances (N,) of points from triangles, one after the other, in barycentric terms.

    The least of the distances from the three segments, and from the plane where the foot lies
    inside: another way than the reference's.
    """
    best = np.full(len(points), np.inf)
    for a, b, c in corners:
        for p, q in ((a, b), (b, c), (c, a)):
            square = (q - p) @ (q - p)
            share = np.clip((points - p) @ (q - p) / square, 0, 1) if square > 0 else 0 * best
            best = np.minimum(best, np.linalg.norm(points - p - share[:, None] * (q - p), axis=1))
        normal = np.cross(b - a, c - a)
        if np.linalg.norm(normal) > 0:
            system = np.column_stack([b - a, c - a, normal])
            u, v, h = np.linalg.solve(system, (points - a).T)
            inside = (u >= 0) & (v >= 0) & (u + v <= 1)
            best = np.where(inside, np.minimum(best, np.abs(h) * np.linalg.norm(normal)), best)
    return best


def soup(count, seed, spread=1.0):
    """Triangles of very different sizes and shapes, all over the place."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-2, 0.5, size=(count, 1, 1))
    return spread * rng.normal(size=(count, 1, 3)) + size * rng.normal(size=(count, 3, 3))


def torus_mesh(m, n):
    turn = 2 * np.pi
    points, _ = sampled(torus, turn / m * np.arange(m), turn / n * np.arange(n))
    return grid_mesh(points, (True, True))


def sphere_net(n):
    """A quad net on the unit sphere away from its poles, n strips each way."""
    at = np.linspace(-1.0, 1.0, n + 1)
    t, s = np.meshgrid(at, at, indexing="ij")
    points = np.stack([np.cos(t) * np.cos(s), np.cos(t) * np.sin(s), np.sin(t)], axis=-1)
    return grid_mesh(points)


def reference_of(mesh):
    return TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())


# --- closest points ---------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 5, 12, 13, 60, 300])
@pytest.mark.parametrize("seed", [0, 1])
def test_closest_points_of_a_soup_are_those_of_brute_force(count, seed):
    corners = soup(count, seed)
    rng = np.random.default_rng(seed + 7)
    far, near = 4.0 * rng.normal(size=(60, 3)), rng.normal(size=(60, 3))
    points = np.concatenate([far, near, corners[:, 0], corners.mean(axis=1)])
    feet, normals, again = TriangleReference(corners).closest(points)
    gaps = np.linalg.norm(points - feet, axis=1)
    # Coordinates of size 10; the distance of a foot is flat, so rounding is all.
    assert np.abs(gaps - closest_by_force(corners, points)).max() < 1e-13
    # The feet lie on the triangles.
    assert closest_by_force(corners, feet).max() < 1e-13
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-14
    assert isinstance(again, TriangleReference)


def test_one_large_triangle_among_many_small_ones_is_found():
    # Its centre is far from the points that it is nearest to: hundreds of others come first.
    small = 1e-2 * soup(400, 3) + [0.0, 0.0, 1.0]
    large = np.array([[[-50.0, -50.0, 0.0], [50.0, -50.0, 0.0], [0.0, 80.0, 0.0]]])
    points = np.random.default_rng(0).normal(size=(40, 3)) * [1.0, 1.0, 0.05] + [10.0, 0.0, 0.0]
    feet, normals, _ = TriangleReference(np.concatenate([small, large])).closest(points)
    assert np.abs(feet - points * [1, 1, 0]).max() < 1e-12
    # The way to a foot at a distance of some hundredths: rounding of 10 over that.
    assert np.abs(np.abs(normals) - [0, 0, 1]).max() < 1e-11


def test_points_as_far_from_all_triangles_take_no_more_memory(monkeypatch):
    # In the middle of a sphere every triangle has to be asked by every point.
    whole = reference_of(icosahedron()).corners
    whole = np.concatenate([whole @ random_rotation(np.random.default_rng(k)) for k in range(30)])
    points = 1e-12 * np.random.default_rng(0).normal(size=(50, 3))
    feet, _, _ = TriangleReference(whole).closest(points)
    plain, sizes = reference._closest_on_triangles, []

    def seen(corners, points):
        sizes.append(len(points))
        return plain(corners, points)

    monkeypatch.setattr(reference, "_closest_on_triangles", seen)
    monkeypatch.setattr(reference, "PAIRS", 1000)
    again, _, _ = TriangleReference(whole).closest(points)
    assert (again == feet).all()
    assert sum(sizes) >= 50 * len(whole)
    assert max(sizes) <= 1000
    gaps = np.linalg.norm(points - feet, axis=1)
    assert np.abs(gaps - closest_by_force(whole, points)).max() < 1e-14


def test_triangles_without_area_are_segments_and_points():
    segment = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    point = np.full((1, 3, 3), 5.0)
    feet, _, _ = TriangleReference(np.concatenate([segment, point])).closest(
        np.array([[1.7, 1.0, 0.0], [-1.0, 0.0, 1.0], [6.0, 5.0, 5.0]])
    )
    assert np.abs(feet - [[1.7, 0, 0], [0, 0, 0], [5, 5, 5]]).max() < 1e-14


@pytest.mark.parametrize("mesh", [torus_mesh(12, 9), sphere_net(7), icosahedron()])
def test_closest_points_of_meshes_are_those_of_brute_force(mesh):
    reference = reference_of(mesh)
    rng = np.random.default_rng(5)
    center = mesh.vertices.mean(axis=0)
    points = [
        mesh.vertices,
        mesh.vertices + 0.1 * rng.normal(size=mesh.vertices.shape),
        center + 3.0 * rng.normal(size=(50, 3)),
        mesh.vertices[mesh.edges].mean(axis=1),
    ]
    points = np.concatenate(points)
    feet, _, _ = reference.closest(points)
    gaps = np.linalg.norm(points - feet, axis=1)
    assert np.abs(gaps - closest_by_force(reference.corners, points)).max() < 1e-13
    # The vertices are on it, to the last digits.
    assert gaps[: len(mesh.vertices)].max() < 1e-14


def test_polygons_are_fans_about_their_centers():
    square = PolyMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.4]], [[0, 1, 2, 3]])
    reference = reference_of(square)
    assert reference.corners.shape == (4, 3, 3)
    assert (reference.corners[:, 2] == [0.5, 0.5, 0.1]).all()
    areas = np.cross(
        reference.corners[:, 1] - reference.corners[:, 0],
        reference.corners[:, 2] - reference.corners[:, 0],
    )
    assert np.abs(areas.sum(axis=0) / 2 - square.face_area_vectors[0]).max() < 1e-15
    # A mirror of the square is a mirror of the fan: no diagonal is preferred.
    flipped = square.vertices[[1, 0, 3, 2]] * [-1, 1, 1] + [1, 0, 0]
    other = TriangleReference.of_polygons(flipped, [[0, 1, 2, 3]])
    points = np.random.default_rng(1).uniform(size=(30, 3))
    here = np.linalg.norm(points - reference.closest(points)[0], axis=1)
    mirrored = points * [-1, 1, 1] + [1, 0, 0]
    there = np.linalg.norm(mirrored - other.closest(mirrored)[0], axis=1)
    assert np.abs(here - there).max() < 1e-15


# --- normals ----------------------------------------------------------------------------------


BOX = reference_of(voxel_surface([(0, 0, 0)]))


@pytest.mark.parametrize("height", [0.005, 0.0])
def test_faces_of_a_box_keep_their_normals_up_to_the_edges(height):
    inner = np.random.default_rng(2).uniform(0.01, 0.99, size=(200, 2))
    for axis in range(3):
        for side in (0.0, 1.0):
            points = np.insert(inner, axis, side, axis=1)
            wanted = (2 * side - 1) * np.eye(3)[axis]
            feet, normals, _ = BOX.closest(points + height * wanted)
            assert np.abs(feet - points).max() < 1e-15
            assert np.abs(normals - wanted).max() < 1e-12


def test_way_from_an_edge_inside_is_the_normal_there():
    # Nearest to the edge x = y = 1 of the box: all directions between its two faces.
    for turn in (0.2, 0.5, 1.0):
        way = np.array([np.cos(turn), np.sin(turn), 0.0])
        feet, normals, _ = BOX.closest(np.array([[1.0, 1.0, 0.4]]) + 0.1 * way)
        assert np.abs(feet - [1, 1, 0.4]).max() < 1e-14
        assert np.abs(normals - way).max() < 1e-13


@pytest.mark.parametrize("beyond", [-5.0, 5.0])
def test_crease_is_where_a_face_leaves_the_common_normal_by_the_limit(beyond):
    # Two equal slopes: the normal at their ridge is straight up, theirs lean to the sides.
    angle = np.arccos(CREASE) + np.radians(beyond)
    x, z = np.cos(angle), -np.sin(angle)
    points = [[0, 0, 0], [0, 1, 0], [x, 0, z], [x, 1, z], [-x, 0, z], [-x, 1, z]]
    roof = reference_of(PolyMesh.of(points, [[0, 2, 3, 1], [4, 0, 1, 5]]))
    _, normals, _ = roof.closest(np.array([[0.0, 0.5, 0.0]]))
    lean = np.abs(normals[0]) - ([0, 0, 1] if beyond < 0 else [np.sin(angle), 0, np.cos(angle)])
    assert np.abs(lean).max() < 1e-12


def test_normals_of_a_net_on_a_sphere_are_near_those_of_the_sphere():
    worst, facets = [], []
    for n in (8, 16, 32):
        mesh = sphere_net(n)
        reference = reference_of(mesh)
        # Well inside, where vertices have faces all around, and on the triangles themselves.
        t, s = np.random.default_rng(4).uniform(-0.7, 0.7, size=(2, 400))
        on = np.stack([np.cos(t) * np.cos(s), np.cos(t) * np.sin(s), np.sin(t)], axis=-1)
        feet = reference.closest(on)[0]
        outwards = np.sign(mesh.face_normals[0] @ mesh.vertices[0])
        wanted = outwards * feet / np.linalg.norm(feet, axis=1, keepdims=True)
        flat = TriangleReference(reference.corners)
        for kept, asked in ((worst, reference), (facets, flat)):
            kept.append(np.linalg.norm(asked.closest(feet)[1] - wanted, axis=1).max())
    # Normals of facets are wrong by half of what these turn; interpolated ones of second order.
    assert (observed_orders(worst) > 1.8).all()
    assert (observed_orders(facets) < 1.2).all()
    assert worst[-1] < 0.03 * facets[-1]


def test_normals_along_a_mesh_do_not_jump_from_facet_to_facet():
    mesh = torus_mesh(24, 18)
    reference = reference_of(mesh)
    path = torus(np.linspace(0.3, 1.5, 4001), np.linspace(0.2, 1.1, 4001))[0]
    path = reference.closest(path)[0]
    normals = reference.closest(path)[1]
    facets = TriangleReference(reference.corners).closest(path)[1]
    steps, jumps = (np.linalg.norm(np.diff(n, axis=0), axis=1).max() for n in (normals, facets))
    # Facets turn by some 0.2 from one to the next; the path itself by 0.0005 a step.
    assert jumps > 0.1
    assert steps < 0.005


def test_normals_and_feet_turn_with_the_mesh():
    mesh = torus_mesh(9, 7)
    rng = np.random.default_rng(6)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    points = mesh.vertices + 0.2 * rng.normal(size=mesh.vertices.shape)
    feet, normals, _ = reference_of(mesh).closest(points)
    moved = mesh.with_vertices(mesh.vertices @ turn.T + shift)
    there, turned, _ = reference_of(moved).closest(points @ turn.T + shift)
    assert np.abs(there - feet @ turn.T - shift).max() < 1e-13
    assert np.abs(turned - normals @ turn.T).max() < 1e-10


@pytest.mark.parametrize("kind", ["triangles", "surface"])
def test_places_may_be_counted_from_another_origin(kind):
    mesh = torus_mesh(9, 7)
    reference = reference_of(mesh) if kind == "triangles" else SurfaceReference(torus_surface())
    origin = np.array([100.0, -200.0, 300.0])
    points = mesh.vertices + 0.2
    feet, normals, _ = reference.closest(points)
    for about in (reference.about(origin), reference.about(2 * origin).about(-origin)):
        there, turned, again = about.closest(points - origin)
        # Coordinates of 600 carry 1e-13 of rounding.
        assert np.abs(there + origin - feet).max() < 1e-12
        assert np.abs(turned - normals).max() < 1e-11
        # It stays so in the next call.
        assert np.abs(again.closest(points - origin)[0] + origin - feet).max() < 1e-12


def test_beyond_the_rim_the_normal_of_the_surface_stays():
    # The way from the rim runs along the surface: it would let vertices hang over it.
    square = grid_mesh(np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.0]]]))
    feet, normals, _ = reference_of(square).closest(np.array([[1.5, 0.5, 0.0], [1.5, 0.5, 0.2]]))
    assert np.abs(feet - [1, 0.5, 0]).max() < 1e-15
    assert np.abs(normals - [0, 0, 1]).max() < 1e-15
