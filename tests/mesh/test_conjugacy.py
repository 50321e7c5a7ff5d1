"""Are the lines conjugate? Surfaces whose second form is known, nets of every verdict."""

import json

import numpy as np
import pytest
from shapes import ellipsoid, random_rotation, sampled, vertex_fan

from pqmesh.io.compas import polygons_from_compas
from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh import solids
from pqmesh.mesh.conjugacy import VERDICTS, conjugacy
from pqmesh.mesh.exact import grid_mesh, rotational_mesh, translational_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import drop_unused


def ellipsoid_lines(n):
    """Lines of curvature between the umbilics, n x n faces."""
    s, t = np.linspace(0.3, 1.0, n + 1), np.linspace(0.5, 1.3, n + 1)
    return grid_mesh(sampled(lambda u, v: ellipsoid(u, v)[0], s, t))


def graph(height, n, size=1.0, turn=0.0):
    """Grid over a square in plan, turned by an angle."""
    x, y = np.meshgrid(*2 * [np.linspace(-size, size, n + 1)], indexing="ij")
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    return grid_mesh(np.stack([x, y, height(x, y)], axis=-1))


def roof(n):
    """A roof along lines that are conjugate nowhere but on two curves."""
    return graph(lambda x, y: 4 * np.cos(0.15 * x) * np.cos(0.12 * y) + 0.015 * x * y, n, 10.0)


def sphere(n, shear=0.0):
    """Latitudes and, sheared, curves that cross them."""
    u, v = np.meshgrid(np.linspace(0.6, 1.2, n + 1), np.linspace(0, 0.6, n + 1), indexing="ij")
    v = v + shear * u
    points = [np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)]
    return grid_mesh(np.stack(points, axis=-1))


def rough(mesh, share, seed=0):
    step = share * mesh.mean_edge_length
    noise = np.random.default_rng(seed).normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + step * noise)


# --- exact cases ------------------------------------------------------------------------------


def test_curvature_lines_of_an_ellipsoid_are_conjugate_with_ratio_eight():
    found = conjugacy(ellipsoid_lines(20))
    assert found.verdict == "conjugate"
    assert found.far_share == 0.0
    # p ~ h^3; the next term is a share of h^2.
    assert found.ratio_median == pytest.approx(8.0, rel=0.01)


def test_turn_and_planarity_of_a_conjugate_net_fall_with_the_second_and_third_power():
    coarse, fine = ellipsoid_lines(12), ellipsoid_lines(24)
    turns = conjugacy(coarse).turn_median / conjugacy(fine).turn_median
    assert turns == pytest.approx(4.0, rel=0.15)
    assert planarity(coarse).max() / planarity(fine).max() == pytest.approx(8.0, rel=0.1)


def test_affine_image_of_a_conjugate_net_is_conjugate():
    mesh = ellipsoid_lines(20)
    shear = np.array([[1, 0.3, 0.2], [0, 1.2, -0.4], [0.1, 0, 0.9]])
    found = conjugacy(mesh.with_vertices(mesh.vertices @ shear))
    assert found.verdict == "conjugate"
    assert found.ratio_median == pytest.approx(8.0, rel=0.01)
    assert np.degrees(np.median(found.family_angle)) < 85.0


def turn_of_roof(x, y):
    """Turn of the plan grid of `roof` at a place, from the fundamental forms."""
    zx = -0.6 * np.sin(0.15 * x) * np.cos(0.12 * y) + 0.015 * y
    zy = -0.48 * np.cos(0.15 * x) * np.sin(0.12 * y) + 0.015 * x
    zxx = -0.09 * np.cos(0.15 * x) * np.cos(0.12 * y)
    zyy = -0.0576 * np.cos(0.15 * x) * np.cos(0.12 * y)
    zxy = 0.072 * np.sin(0.15 * x) * np.sin(0.12 * y) + 0.015
    e, f, g = 1 + zx**2, zx * zy, 1 + zy**2
    area = np.sqrt(e * g - f * f)
    # Unit vectors along the lines, and the quarter turn within the tangent plane.
    first, mixed, second = zxx / e, zxy / np.sqrt(e * g), zyy / g
    cosine, sine = f / np.sqrt(e * g), area / np.sqrt(e * g)
    pull = np.hypot(second - cosine * mixed, cosine * mixed - first) / sine
    return np.arctan2(np.abs(mixed), pull)


def test_turn_converges_to_that_of_the_surface():
    errors = []
    for n in (20, 40):
        mesh = roof(n)
        inner = np.setdiff1d(np.arange(n * n), boundary_faces(mesh))
        x, y = mesh.face_centers[inner, :2].T
        exact = turn_of_roof(x, y)
        error = np.abs(conjugacy(mesh).turn[inner] - exact)
        errors.append(np.median(error))
        # Where the turn is zero its mean over neighbours has a kink.
        assert error[exact > 0.2].max() < 0.02
    assert errors[1] < 5e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def boundary_faces(mesh):
    faces = mesh.topology.edge_faces[mesh.topology.is_boundary_edge]
    return faces[faces >= 0]


@pytest.mark.parametrize("n", [20, 60])
def test_misaligned_roof_is_far_from_conjugate_at_every_size(n):
    found = conjugacy(roof(n))
    assert found.verdict == "far from conjugate"
    assert found.ratio_median == pytest.approx(2.0, rel=0.01)
    # Neither the turn nor the share depends on the size of the faces.
    assert np.degrees(found.turn_median) == pytest.approx(21.7, abs=0.4)
    assert found.far_share == pytest.approx(0.72, abs=0.02)


def test_hyperbolic_paraboloid_along_its_rulings_is_asymptotic():
    found = conjugacy(graph(lambda x, y: x * y, 20))
    assert found.verdict == "asymptotic"
    assert found.is_asymptotic.all()
    # At the saddle both families are asymptotic: a right angle.
    assert np.degrees(found.turn.max()) > 89.0


@pytest.mark.parametrize(
    ("degrees", "verdict"),
    [(15, "asymptotic"), (30, "far from conjugate"), (40, "nearly conjugate"), (45, "conjugate")],
)
def test_saddle_turned_from_its_rulings_to_its_curvature_lines(degrees, verdict):
    found = conjugacy(graph(lambda x, y: x * y, 20, 0.3, np.radians(degrees)))
    assert found.verdict == verdict
    if degrees < 45:
        # Both directions turn by t in a plane form [[-s, c], [c, s]] of the angle 2 a.
        middle = np.arctan2(1 / np.tan(2 * np.radians(degrees)), np.sqrt(2))
        assert found.turn_median == pytest.approx(middle, rel=0.08)


def test_translational_net_is_conjugate_without_a_ratio():
    t = np.linspace(0, 1, 15)
    arch = np.stack([t, 0 * t, t * (1 - t)], axis=-1)
    found = conjugacy(translational_mesh(arch, np.stack([0.4 * t, t, t**3], axis=-1)))
    assert found.verdict == "conjugate"
    assert found.ratio_median is None
    assert not found.turn.any()


def test_surface_of_revolution_is_conjugate():
    profile = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])
    found = conjugacy(rotational_mesh(profile, 0.3 * np.arange(8)))
    assert found.verdict == "conjugate"


def test_net_on_a_sphere_is_conjugate_where_it_is_orthogonal():
    # II is a multiple of the metric: conjugate is orthogonal, whatever the directions.
    assert conjugacy(sphere(16)).verdict == "conjugate"
    skew = conjugacy(sphere(16, shear=0.3))
    assert skew.ratio_median == pytest.approx(2.0, rel=0.03)
    # Two directions that miss the right angle by d turn by d / sqrt 2 in root of squares.
    missing = np.pi / 2 - np.median(skew.family_angle)
    assert skew.turn_median == pytest.approx(missing / np.sqrt(2), rel=0.05)


def test_cylinder_is_conjugate_along_rulings_and_asymptotic_never():
    def vault(x, y):
        return np.sqrt(4 - x * x)

    assert conjugacy(graph(vault, 16, 0.7)).verdict == "conjugate"
    for degrees in (10, 25, 45):
        found = conjugacy(graph(vault, 16, 0.7, np.radians(degrees)))
        assert found.verdict in ("nearly conjugate", "far from conjugate")


@pytest.mark.parametrize("tilt", [0.0, 0.37])
def test_plane_is_conjugate_and_divides_by_nothing(tilt):
    with np.errstate(all="raise"):
        found = conjugacy(graph(lambda x, y: tilt * x, 8, turn=0.3))
    assert found.verdict == "conjugate"
    assert not found.turn.any()


def test_nearly_flat_place_has_no_directions():
    # A twist of 1e-6 over the whole mesh: p is above rounding, the lines are not to blame.
    with np.errstate(all="raise"):
        found = conjugacy(graph(lambda x, y: 1e-5 * x * y, 8))
    assert found.verdict == "conjugate"


def test_rough_mesh_is_undecided_and_says_rough():
    found = conjugacy(rough(ellipsoid_lines(20), 0.03))
    assert found.verdict == "undecided"
    assert found.is_rough
    assert found.ratio_median < 1.0


# --- topology and invariance ------------------------------------------------------------------


def test_size_place_and_side_do_not_matter():
    mesh = rough(roof(16), 0.002)
    plain = conjugacy(mesh)
    turned = conjugacy(
        mesh.with_vertices(
            1000.0 * mesh.vertices @ random_rotation(np.random.default_rng(3)).T + [3e4, -1e4, 2e4]
        )
    )
    assert np.allclose(plain.turn, turned.turn, rtol=0, atol=1e-6)
    assert np.allclose(plain.ratio, turned.ratio, rtol=1e-6)
    other = conjugacy(mesh.reversed())
    assert np.allclose(plain.turn, other.turn, rtol=0, atol=1e-9)


def test_order_of_faces_and_corners_does_not_matter():
    mesh = roof(10)
    rng = np.random.default_rng(5)
    order = rng.permutation(len(mesh.faces))
    rolled = [np.roll(face, k) for face, k in zip(mesh.faces, rng.integers(0, 4, 100), strict=True)]
    other = QuadMesh.of(mesh.vertices, np.array(rolled)[order])
    assert np.allclose(conjugacy(mesh).turn[order], conjugacy(other).turn, rtol=0, atol=1e-9)


@pytest.mark.parametrize("k", [3, 5, 6])
def test_faces_at_irregular_vertices_only_are_undecided(k):
    turn = 2 * np.pi * np.arange(k) / k
    fan = rough(vertex_fan(np.column_stack([np.cos(turn), np.sin(turn), np.full(k, -0.4)])), 0.02)
    found = conjugacy(fan)
    assert found.verdict == "undecided"
    assert not found.decided.any()
    assert found.turn_median is None
    assert found.far_share is None


def test_closed_and_small_exact_meshes_are_conjugate_and_coarse_ones_undecided():
    assert conjugacy(solids.cube()).verdict == "conjugate"
    assert conjugacy(rough(solids.cube(), 0.05)).verdict == "undecided"
    assert conjugacy(rough(solids.trapezohedron(4), 0.03)).verdict == "undecided"


def test_collapsed_edges_and_faces_are_left_out():
    mesh = roof(8)
    points = mesh.vertices.copy()
    points[40] = points[41]
    with np.errstate(all="raise"):
        found = conjugacy(mesh.with_vertices(points))
    assert found.verdict in VERDICTS
    assert np.isfinite(found.turn[found.decided]).all()


# --- meshes from practice ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "verdict", "degrees"),
    [
        ("six.off", "conjugate", 0.001),
        ("YasIsland.off", "conjugate", 0.026),
        ("formfinding-circular.off", "conjugate", 0.001),
        ("conical1.obj", "conjugate", 0.001),
        # By its planarity, which falls with the first power only, not conjugate but near it.
        ("inspired_mesh_quads_Conjugate.off", "nearly conjugate", 6.7),
        ("tubemesh.obj", "nearly conjugate", 4.2),
        ("M2_eq_quad2.obj", "far from conjugate", 28.9),
        ("hypar.obj", "asymptotic", 85.0),
    ],
)
def test_real_mesh_has_its_verdict(name, verdict, degrees, data_folder):
    found = conjugacy(read_quad_mesh(data_folder / name))
    assert found.verdict == verdict
    assert np.degrees(found.turn_median) == pytest.approx(degrees, rel=0.05, abs=5e-4)


def test_thrust_diagram_is_nearly_conjugate(data_folder):
    tree = json.loads((data_folder / "examples_dropdowns_5.json").read_bytes())
    found = polygons_from_compas(json.dumps(tree["scene"]["data"]["items"][2]).encode())
    # Its two large polygons only close it along the rim.
    quads = [face for face in found.face_lists() if len(face) == 4]
    faces, used = drop_unused(quads, len(found.vertices))
    assert conjugacy(QuadMesh.of(found.vertices[used], faces)).verdict == "nearly conjugate"
