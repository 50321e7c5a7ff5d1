import numpy as np
import pytest
from shapes import curved_mesh, polygon_mesh, random_rotation, vertex_fan, voxel_surface

from pqmesh.mesh.exact import grid_mesh, rotational_mesh, stereographic_mesh
from pqmesh.mesh.measure import (
    circle_deviation,
    circularity_defect,
    conicality_defect,
    corner_angles,
    fitted_cones,
    flipped_faces,
    mean_diagonals,
    measures,
    nonconvex_faces,
    planarity,
    planarity_deviation,
    tetrahedron_volume,
)
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.solids import rhombic_triacontahedron

FACE = [[0, 1, 2, 3]]
# The keys of "before" and "after" in the report, without the twist, which needs node axes.
REPORT_KEYS = {
    "planarity_max", "planarity_mean", "planarity_max_length", "cone_spread_max",
    "conicality_max_deg", "conicality_mean_deg", "circularity_max_deg", "offset_misfit_max",
    "min_corner_deg", "max_corner_deg", "nonconvex_faces", "flipped_faces",
    "edge_min", "edge_mean", "edge_max",
}  # fmt: skip


def quad(*corners):
    return QuadMesh.of(np.array(corners, float), FACE)


def flat_quad(points, seed=0):
    """A plane quad, turned and moved at random."""
    rng = np.random.default_rng(seed)
    xyz = np.column_stack([np.array(points, float), np.zeros(4)])
    return QuadMesh.of(xyz @ random_rotation(rng).T + rng.normal(size=3), FACE)


# --- faces ------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(
    "points",
    [
        [(0, 0), (1, 1), (0, 1), (1, 0)],
        [(0, 0), (0.2, 1), (1, 0), (0.8, 1)],
        [(0, 0), (1, 0), (0, 0), (1, 0)],
        [(0, 0), (1, 0), (2, 0), (1, 0)],
        [(0, 0), (1, 0), (1, 1), (0.9, 0.05)],
        [(0, 0), (2, 0), (1, 0), (1, 1)],
    ],
    ids=["crossed", "parallel_diagonals", "digon", "folded", "reflex", "spike"],
)
def test_planarity_deviation_vanishes_on_flat_quad_of_any_shape(points, seed):
    # Noise over the sine of the diagonals, and nothing where they count as parallel.
    assert planarity_deviation(flat_quad(points, seed))[0] < 1e-13


def test_planarity_is_free_of_scale_and_first_corner():
    mesh = curved_mesh(noise=0.05)
    value = planarity(mesh)
    assert np.allclose(planarity(mesh.with_vertices(1000 * mesh.vertices)), value, rtol=1e-12)
    rolled = QuadMesh.of(mesh.vertices, np.roll(mesh.faces, 1, axis=1))
    assert np.allclose(planarity(rolled), value, rtol=1e-11)
    assert np.allclose(planarity_deviation(mesh) / mean_diagonals(mesh), value)


def test_tetrahedron_volume_changes_sign_with_the_mirror():
    mesh = curved_mesh(noise=0.05)
    mirrored = mesh.with_vertices(mesh.vertices * [1, 1, -1])
    assert np.allclose(tetrahedron_volume(mirrored), -tetrahedron_volume(mesh), rtol=1e-13)


def test_corner_angles_of_convex_reflex_and_crossed_quads():
    square = flat_quad([(0, 0), (1, 0), (1, 1), (0, 1)])
    assert np.allclose(corner_angles(square), np.pi / 2, atol=1e-14)
    dart = flat_quad([(0, 0), (2, 0), (0.5, 0.5), (0, 2)])
    angles = corner_angles(dart)
    # A simple polygon's angles sum to 2 pi, the reflex one included.
    assert np.isclose(angles.sum(), 2 * np.pi, atol=1e-13)
    assert (angles > np.pi).tolist() == [False, False, True, False]
    crossed = corner_angles(flat_quad([(0, 0), (1, 0), (0, 1), (1, 1.2)]))
    assert (crossed > np.pi).sum() == 2


def test_corner_angles_of_polygons_sum_to_the_polygon_sum():
    mesh = polygon_mesh()
    sums = np.add.reduceat(corner_angles(mesh), mesh.topology.offsets[:-1])
    assert np.allclose(sums, (mesh.topology.face_sizes - 2) * np.pi, atol=1e-13)


@pytest.mark.parametrize(
    ("points", "is_bad"),
    [
        ([(0, 0), (1, 0), (1, 1), (0, 1)], False),
        ([(0, 0), (1, 0), (2, 0), (1, 1)], False),
        ([(0, 0), (2, 0), (0.5, 0.5), (0, 2)], True),
        ([(0, 0), (1, 0), (0, 1), (1, 1)], True),
        ([(0, 0), (1, 0), (0, 1), (1, 1.2)], True),
        ([(0, 0), (1, 0), (2, 0), (1, 0)], True),
        ([(0, 0), (1, 0), (2, 0), (3, 0)], True),
    ],
    ids=["square", "straight_corner", "dart", "bow_tie", "crossed", "folded", "line"],
)
def test_nonconvex_faces_are_named(points, is_bad):
    for scale in (1e-3, 1.0, 1e3):
        mesh = quad(*[(scale * x, scale * y, 0.0) for x, y in points])
        assert nonconvex_faces(mesh).tolist() == ([0] if is_bad else [])


def test_nonconvex_face_is_found_among_good_ones():
    mesh = curved_mesh(4, 4)
    points = mesh.vertices.copy()
    points[12] += 0.9 * (points[6] - points[12])
    assert len(nonconvex_faces(mesh)) == 0
    # The middle vertex moves close to the far corner of face 5, beyond its diagonal.
    assert nonconvex_faces(mesh.with_vertices(points)).tolist() == [5]


def test_flipped_face_is_named():
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=-1)
    # Pull the corners of the middle face through each other: it turns over.
    middle = points[1:3, 1:3].copy()
    points[1:3, 1:3] = 1.5 - 0.2 * (middle - 1.5)
    points[..., 2] = 0.0
    mesh = grid_mesh(points)
    # A half turn of the middle square keeps its side up, so nothing is flipped ...
    assert len(flipped_faces(mesh)) == 0
    points[1, 1], points[1, 2] = points[1, 2].copy(), points[1, 1].copy()
    points[2, 1], points[2, 2] = points[2, 2].copy(), points[2, 1].copy()
    # ... and exchanging two sides turns it over.
    assert flipped_faces(grid_mesh(points)).tolist() == [4]
    assert len(flipped_faces(voxel_surface([(0, 0, 0)]))) == 0


def test_circle_measures_agree_on_flat_convex_quads():
    t = np.array([0.1, 0.9, 2.3, 4.4])
    circle = flat_quad(np.column_stack([np.cos(t), np.sin(t)]))
    assert abs(circularity_defect(circle)[0]) < 1e-14
    assert abs(circle_deviation(circle)[0]) < 1e-14
    kite = flat_quad([(0, 0), (1, 0), (1, 1), (0, 1.1)])
    assert abs(circularity_defect(kite)[0]) > 0.01
    assert circle_deviation(kite)[0] > 1e-4


def test_circularity_defect_does_not_depend_on_orientation():
    mesh = curved_mesh(noise=0.05)
    assert np.allclose(circularity_defect(mesh.reversed()), -circularity_defect(mesh), atol=1e-14)


# --- vertices ---------------------------------------------------------------------------------


def test_conicality_defect_of_a_mesh_without_regular_vertex_is_empty():
    vertices, defect = conicality_defect(voxel_surface([(0, 0, 0)]))
    assert len(vertices) == len(defect) == 0


def test_fitted_cones_follow_similarity_and_reversal():
    mesh = curved_mesh(noise=0.02)
    rotation = random_rotation(np.random.default_rng(4))
    cones = fitted_cones(mesh)
    moved = fitted_cones(mesh.with_vertices(7.0 * mesh.vertices @ rotation.T + [1, -2, 3]))
    # Well conditioned: normals about 10 degrees apart.
    assert np.allclose(moved.vectors, cones.vectors @ rotation.T, atol=1e-11)
    assert np.allclose(moved.spread, cones.spread, atol=1e-12)
    back = fitted_cones(mesh.reversed())
    assert np.allclose(back.vectors, -cones.vectors, atol=1e-11)
    assert np.allclose(back.theta, cones.theta, atol=1e-12)


def test_fitted_cones_come_in_vertex_order_for_mixed_valences():
    cones = fitted_cones(rhombic_triacontahedron())
    assert cones.vertices.tolist() == list(range(32))
    strip = fitted_cones(curved_mesh(1, 4))
    assert len(strip.vertices) == 0
    assert strip.vectors.shape == (0, 3)


def test_fitted_cones_take_polygons():
    mesh = polygon_mesh()
    raised = PolyMesh(mesh.vertices + [0, 0, 1] * (np.arange(11) == 0)[:, None], mesh.topology)
    assert fitted_cones(raised).vertices.tolist() == [0]


def test_flat_vertex_counts_as_flat_and_slight_vertex_does_not():
    ring = np.array([[1, 0], [0, 1.2], [-0.9, 0.1], [-0.2, -1.0]])
    for height, flat in [(0.0, True), (1e-8, True), (1e-4, False)]:
        heights = height * np.array([1.0, 0.2, 1.1, 0.7])
        cones = fitted_cones(vertex_fan(np.column_stack([ring, heights])))
        assert bool(cones.is_flat[0]) is flat
        assert bool(cones.relative_spread[0] == 0) is flat


def test_cylinder_vertices_are_conical_with_axis_across_the_rulings():
    t = np.array([0.0, 0.3, 0.6, 1.1])
    points = np.stack(
        [np.cos(t)[:, None] + 0 * t, np.sin(t)[:, None] + 0 * t, 0 * t[:, None] + t], axis=-1
    )
    # Turned, so that the rank of the normals is 2 only up to rounding.
    rotation = random_rotation(np.random.default_rng(8))
    cones = fitted_cones(grid_mesh(points @ rotation.T))
    # Two different planes at each vertex: always a common vector, the shortest is across.
    assert cones.misfit.max() < 1e-14
    assert cones.spread.max() < 1e-14
    assert np.abs(cones.vectors @ rotation[:, 2]).max() < 1e-14


# --- the table --------------------------------------------------------------------------------


def test_measures_have_the_keys_of_the_report():
    table = measures(curved_mesh(noise=0.02))
    assert set(table) == REPORT_KEYS
    assert all(np.isfinite(value) for value in table.values())


def test_measures_are_none_where_there_is_no_interior_vertex():
    table = measures(curved_mesh(1, 3))
    for key in ("cone_spread_max", "conicality_max_deg", "conicality_mean_deg",
                "offset_misfit_max"):  # fmt: skip
        assert table[key] is None
    assert table["planarity_max"] > 0


def test_measures_of_a_conical_and_circular_mesh_are_zero():
    mesh = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], np.arange(5) * 0.3)
    table = measures(mesh)
    for key in ("planarity_max", "cone_spread_max", "conicality_max_deg", "circularity_max_deg",
                "offset_misfit_max"):  # fmt: skip
        # Degrees and division by theta ~ 0.3 over rounding.
        assert table[key] < 1e-11, key
    assert table["nonconvex_faces"] == table["flipped_faces"] == 0
    assert np.isclose(table["edge_min"], mesh.edge_lengths.min())
    square = measures(stereographic_mesh([-1, 1], [-1, 1]))
    assert np.isclose(square["min_corner_deg"], 90.0)
    assert np.isclose(square["max_corner_deg"], 90.0)
