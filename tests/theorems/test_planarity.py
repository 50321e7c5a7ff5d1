"""Planarity: closed values, planar families, and the sum of angles of planar meshes."""

from math import factorial

import numpy as np
import pytest
from scipy.special import gammaln
from shapes import curved_mesh, random_rotation, voxel_surface, zoo

from pqmesh.mesh import solids
from pqmesh.mesh.exact import grid_mesh, rotational_mesh, translational_mesh
from pqmesh.mesh.measure import (
    circularity_defect,
    corner_angles,
    nonconvex_faces,
    planarity,
    planarity_deviation,
    tetrahedron_volume,
)
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.quadmesh import QuadMesh


def plane_distances(quads):
    """Singular values of the centred corners, (F, 3); the last is the distance to a plane."""
    centred = quads - quads.mean(axis=1, keepdims=True)
    return np.linalg.svd(centred, compute_uv=False)


def moved(points, seed):
    rng = np.random.default_rng(seed)
    return points @ random_rotation(rng).T + rng.normal(size=3)


# --- hyperbolic paraboloid and the volume law -------------------------------------------------


@pytest.mark.parametrize(("h", "k"), [(1.0, 1.0), (0.3, 2.0), (0.01, 0.02)])
def test_volume_of_hyperbolic_paraboloid_cell_is_the_same_anywhere(h, k):
    x, y = np.meshgrid(1.3 + h * np.arange(5), -0.7 + k * np.arange(4), indexing="ij")
    mesh = grid_mesh(moved(np.stack([x, y, x * y], axis=-1), 1))
    # Triple products of cells far smaller than their coordinates: rounding over (size h k)^2.
    assert np.allclose(np.abs(tetrahedron_volume(mesh)), h * h * k * k / 6, rtol=1e-10, atol=0)
    assert planarity(mesh).min() > 1e-3 * h * k


@pytest.mark.parametrize("s", [1.0, 0.25, 1e-2])
def test_square_cell_of_hyperbolic_paraboloid_has_closed_values(s):
    corners = s * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    points = np.column_stack([corners, corners[:, 0] * corners[:, 1]])
    mesh = QuadMesh.of(moved(points, 2), [[0, 1, 2, 3]])
    # 1e-12 relative to the size s of the cell: rounding.
    assert np.isclose(planarity_deviation(mesh)[0], 2 * s * s, rtol=0, atol=1e-12 * s)
    planes = face_planes(mesh)
    heights = np.abs(mesh.corners[0] @ planes[0, :3] - planes[0, 3])
    assert np.allclose(heights, s * s, rtol=0, atol=1e-12 * s)
    # The closest planar quad is the projection to that plane: four moves of s^2.
    assert np.isclose(plane_distances(mesh.corners)[0, 2], 2 * s * s, rtol=0, atol=1e-12 * s)


def test_volume_is_area_times_diagonal_distance_over_three():
    rng = np.random.default_rng(3)
    quads = rng.normal(size=(500, 4, 3))
    mesh = QuadMesh.of(quads.reshape(-1, 3), np.arange(2000).reshape(-1, 4))
    area = np.linalg.norm(mesh.face_area_vectors, axis=1)
    law = area * planarity_deviation(mesh) / 3
    assert np.abs(np.abs(tetrahedron_volume(mesh)) - law).max() < 1e-12


def test_projection_to_the_best_plane_is_the_closest_planar_quad():
    rng = np.random.default_rng(4)
    quads = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) + 0.2 * rng.normal(
        size=(50, 4, 3)
    )
    centre = quads.mean(axis=1, keepdims=True)
    _, s, vt = np.linalg.svd(quads - centre)
    normal = vt[:, 2][:, None]
    flat = quads - ((quads - centre) * normal).sum(axis=-1, keepdims=True) * normal
    mesh = QuadMesh.of(flat.reshape(-1, 3), np.arange(200).reshape(-1, 4))
    assert planarity_deviation(mesh).max() < 1e-12
    assert np.allclose(np.sqrt(((flat - quads) ** 2).sum(axis=(1, 2))), s[:, 2], atol=1e-12)
    # No other plane nearby does better.
    for _ in range(50):
        other = normal + 0.05 * rng.normal(size=normal.shape)
        other /= np.linalg.norm(other, axis=-1, keepdims=True)
        far = ((quads - centre) * other).sum(axis=-1)
        assert (np.sqrt((far**2).sum(axis=1)) >= s[:, 2] - 1e-12).all()


def test_best_plane_lies_between_half_and_all_of_the_diagonal_distance():
    mesh = curved_mesh(noise=0.02)
    centred = mesh.corners - mesh.corners.mean(axis=1, keepdims=True)
    _, _, vt = np.linalg.svd(centred)
    far = np.abs(np.einsum("fki,fi->fk", centred, vt[:, 2])).max(axis=1)
    # Each corner off the plane of the diagonals' mid-plane by half; convex and nearly flat.
    ratio = far / planarity_deviation(mesh)
    assert ratio.min() > 0.5 - 1e-9
    assert ratio.max() < 1.0


# --- planar families --------------------------------------------------------------------------


def polylines(seed):
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(2, 5, 3)) * 0.2 + np.array([[[1.0, 0, 0.2]], [[0, 1, -0.1]]])
    return np.cumsum(steps, axis=1)


def test_translational_mesh_is_planar():
    mesh = translational_mesh(*polylines(5))
    # Opposite edges are equal: only the sums a_i + b_j round.
    assert planarity(mesh).max() < 1e-14
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    assert np.abs((b - a) - (c - d)).max() < 1e-14


def test_translational_mesh_is_circular_exactly_when_edges_are_perpendicular():
    rng = np.random.default_rng(6)
    first = np.cumsum(rng.uniform(0.5, 1, size=(5, 3)) * [1, 1, 0], axis=0)
    second = np.cumsum(rng.uniform(0.5, 1, size=(4, 3)) * [0, 0, 1], axis=0)
    assert np.abs(circularity_defect(translational_mesh(first, second))).max() < 1e-13
    second[:, 0] += [0, 0.1, 0.2, 0.3]
    assert np.abs(circularity_defect(translational_mesh(first, second))).min() > 1e-3


def test_projective_image_of_planar_mesh_is_planar():
    rng = np.random.default_rng(7)
    mesh = translational_mesh(*polylines(8))
    matrix = np.eye(4) + 0.1 * rng.normal(size=(4, 4))
    matrix[3, :3] = [0.02, -0.03, 0.05]
    image = np.column_stack([mesh.vertices, np.ones(25)]) @ matrix.T
    weights = image[:, 3]
    assert weights.min() > 0.3
    projected = mesh.with_vertices(image[:, :3] / weights[:, None])
    assert planarity(projected).max() < 1e-12
    # It is not an affine image: opposite edges are no longer parallel.
    a, b, c, d = np.moveaxis(projected.corners, 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - d), axis=1).min() > 1e-5


def half_power(x):
    """(x)_{1/2} = Gamma(x + 1/2) / Gamma(x)."""
    return np.exp(gammaln(x + 0.5) - gammaln(x))


def test_gamma_net_is_planar_and_has_published_values():
    alpha, delta = np.array([1.2, 2.5, 4.1]), 0.3
    i, j = np.meshgrid(np.arange(6.0), np.arange(6.0), indexing="ij")
    x = half_power(i[..., None] + alpha) * half_power(j[..., None] + alpha - delta)
    # The eight digits of the oracle.
    assert np.allclose(x[0, 0], [0.82166479, 2.10926047, 3.70535398], rtol=0, atol=5e-9)
    assert np.allclose(x[1, 1], [1.81070575, 3.10636542, 4.70422990], rtol=0, atol=5e-9)
    first, second = np.diff(x, axis=0)[:, :-1], np.diff(x, axis=1)[:-1]
    mixed = np.diff(np.diff(x, axis=0), axis=1)
    law = (second - first) / (2 * (i - j + delta))[:-1, :-1, None]
    assert np.abs(mixed - law).max() < 1e-12
    assert planarity(grid_mesh(x)).max() < 1e-12


MONOMIALS = [(i, j) for i in range(4) for j in range(4 - i)]


def conjugate_cubic(c1, c2, a10, a01, a20):
    """Coefficients (10, 3) of the cubic X with X_uv = c1 X_u + c2 X_v and these first ones."""
    place = {m: k for k, m in enumerate(MONOMIALS)}
    system = np.zeros((10, 10))
    for (i, j), k in place.items():
        for target, factor in [
            ((i - 1, j - 1), i * j),
            ((i - 1, j), -c1 * i),
            ((i, j - 1), -c2 * j),
        ]:
            if factor:
                system[place[target], k] += factor
    known = {(0, 0): np.zeros(3), (1, 0): a10, (0, 1): a01, (2, 0): a20}
    given = [place[m] for m in known]
    free = [k for k in range(10) if k not in given]
    values = np.zeros((10, 3))
    values[given] = list(known.values())
    values[free] = np.linalg.lstsq(system[:, free], -system @ values, rcond=None)[0]
    assert np.abs(system @ values).max() < 1e-13
    return values


@pytest.mark.parametrize(("c1", "c2"), [(1.0, 1.0), (0.7, -1.3), (-2.0, 0.5)])
def test_conjugate_cubic_cells_have_the_same_volume_and_are_flat_for_matching_steps(c1, c2):
    rng = np.random.default_rng(10)
    first = rng.normal(size=(3, 3))
    values = conjugate_cubic(c1, c2, *first)

    def net(h, k):
        u, v = np.meshgrid(0.3 + h * np.arange(5), -0.7 + k * np.arange(4), indexing="ij")
        powers = np.stack([u**i * v**j for i, j in MONOMIALS], axis=-1)
        return grid_mesh(powers @ values)

    for h, k in [(0.2, 0.3), (0.5, 0.1)]:
        law = -c1 / (6 * c2) * (h * k) ** 2 * ((c1 * k) ** 2 - (c2 * h) ** 2) * np.linalg.det(first)
        # Cells of volume 1e-4 on a surface of size 10: 1e-12 of that size.
        assert np.abs(6 * np.abs(tetrahedron_volume(net(h, k))) - abs(law)).max() < 1e-12
        # Far above the rounding that the matching steps below leave.
        assert planarity(net(h, k)).min() > 1e-8
    assert planarity(net(0.2, 0.2 * abs(c2 / c1))).max() < 1e-12


def test_conjugate_cubic_has_its_published_point():
    axes = np.eye(3)
    values = conjugate_cubic(1.0, 1.0, *axes)
    u, v = 0.3, -0.7
    point = np.array([u**i * v**j for i, j in MONOMIALS]) @ values
    assert np.allclose(point, [-17 / 30, -47 / 30, -11 / 15], rtol=0, atol=1e-14)


def test_conjugate_cubic_is_a_saddle_of_closed_curvature():
    rng = np.random.default_rng(11)
    first, (c1, c2) = rng.normal(size=(3, 3)), (0.7, -1.3)
    values = conjugate_cubic(c1, c2, *first)
    u, v = rng.uniform(-1, 1, size=(2, 200))

    def derivative(a, b):
        """Of order a in u and b in v."""
        terms = [
            0 * u if i < a or j < b else factorial(i) // factorial(i - a)
            * (factorial(j) // factorial(j - b)) * u ** (i - a) * v ** (j - b)
            for i, j in MONOMIALS
        ]  # fmt: skip
        return np.stack(terms, axis=-1) @ values

    du, dv = derivative(1, 0), derivative(0, 1)
    mixed = derivative(1, 1)
    assert np.abs(mixed - c1 * du - c2 * dv).max() < 1e-12
    normal = np.cross(du, dv)
    square = (normal * normal).sum(axis=1)
    e, f, g = ((derivative(*order) * normal).sum(axis=1) for order in ((2, 0), (1, 1), (0, 2)))
    found = (e * g - f * f) / square**2
    law = -4 * (c1 / c2) ** 2 * np.linalg.det(first) ** 2 / square**2
    # Relative to the largest curvature, which is where the tangents are shortest.
    assert np.abs(found - law).max() < 1e-12 * np.abs(law).max()
    assert found.max() < 0


# --- Gauss-Bonnet -----------------------------------------------------------------------------


def angle_excess(mesh):
    """Sum of 2 pi (inside) or pi (boundary) minus the corner angles, over the vertices."""
    t = mesh.topology
    full = np.where(t.is_boundary_vertex, np.pi, 2 * np.pi).sum()
    return full - corner_angles(mesh).sum()


STEPS = np.array([0.0, 0.3, 0.8, 1.1, 1.9])
PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9], [1.5, 2.3]])
CIRCLE = np.arange(7) * 2 * np.pi / 7
RING = np.column_stack([3 + np.cos(CIRCLE), np.sin(CIRCLE)])
PLANAR = {
    "disc": rotational_mesh(PROFILE, STEPS),
    "annulus": rotational_mesh(PROFILE, CIRCLE, closed=True),
    "torus": rotational_mesh(RING, CIRCLE, closed=True, closed_profile=True),
    "translational": translational_mesh(*polylines(9)),
    "voxels": voxel_surface([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)]),
    "two_handles": zoo()["two_handles"][0],
    "triacontahedron": solids.rhombic_triacontahedron(),
    "hexecontahedron": solids.deltoidal_hexecontahedron(),
    "dodecahedron": solids.sphere_tangent_mesh(
        [
            np.roll([0, s, r * (1 + 5**0.5) / 2], k)
            for s in (1, -1)
            for r in (1, -1)
            for k in range(3)
        ]
    ),
}


@pytest.mark.parametrize("name", sorted(PLANAR))
def test_gauss_bonnet_holds_on_planar_convex_faces(name):
    mesh = PLANAR[name]
    assert len(nonconvex_faces(mesh)) == 0
    # Up to 240 angles, each rounded at 1e-16.
    assert abs(angle_excess(mesh) - 2 * np.pi * mesh.topology.euler_characteristic) < 1e-11


def test_gauss_bonnet_fails_where_faces_are_not_planar():
    mesh = curved_mesh(noise=0.05)
    assert abs(angle_excess(mesh) - 2 * np.pi) > 1e-3
