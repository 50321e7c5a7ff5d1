"""Panels and webs cut by an outline."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from roofs import (
    U_SHAPE,
    cut_pieces,
    dome,
    flatness,
    open_sides,
    outline_gap,
    plane_grid,
    square,
    vault,
)

from pqmesh.errors import MeshError, SpecError
from pqmesh.fabricate.panels import obj_from_polygons
from pqmesh.fabricate.tidy import area_vector
from pqmesh.fabricate.trim import trimmed_panels, trimmed_webs
from pqmesh.mesh.exact import grid_mesh, translational_mesh
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.region import PlanOutline
from pqmesh.offset.offsets import offset_layer, offset_vectors
from pqmesh.offset.support import support_structure

HEXAGON = [[0.4, 1.1], [1.7, 0.3], [3.6, 0.9], [3.8, 2.2], [2.1, 3.7], [0.7, 2.9]]
SLOPES = [(0.0, 0.0), (0.3, -0.7), (20.0, 5.0)]


def check(panels, mesh):
    """What holds of every cut of every mesh."""
    normals = mesh.face_normals
    for k, points in enumerate(panels.polygons):
        face = panels.face[k]
        vector = area_vector(points)
        assert vector @ normals[face] > 0
        assert flatness(points) < 1e-12
        assert panels.area[k] == pytest.approx(np.linalg.norm(vector), rel=1e-12)
        on_vertex = panels.corner_vertex[k] >= 0
        assert np.array_equal(points[on_vertex], mesh.vertices[panels.corner_vertex[k][on_vertex]])
        for point, edge in zip(points, panels.corner_edge[k], strict=True):
            if edge >= 0:
                a, b = mesh.vertices[mesh.edges[edge]]
                assert np.linalg.norm(np.cross(b - a, point - a)) < 1e-12 * ((b - a) @ (b - a))
        if not panels.is_trimmed[k]:
            assert np.array_equal(panels.corner_vertex[k], mesh.faces[face])


# --- exact cases ----------------------------------------------------------------------------


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize("polygon", [HEXAGON, U_SHAPE, HEXAGON[::-1]])
def test_areas_in_plan_add_up_to_the_outline(slope, polygon):
    mesh, outline = plane_grid(slope=slope), PlanOutline(polygon)
    panels = trimmed_panels(mesh, outline, 1.0)
    check(panels, mesh)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-12)
    stretch = np.hypot(1.0, np.hypot(*slope))
    assert panels.area.sum() == pytest.approx(outline.area * stretch, rel=1e-12)


def test_outline_along_mesh_lines_leaves_whole_faces():
    mesh = plane_grid()
    panels = trimmed_panels(mesh, square(1, 3), 1.0)
    assert panels.face.tolist() == [5, 6, 9, 10]
    assert not panels.is_trimmed.any()
    assert not len(panels.slivers)


@pytest.mark.parametrize("shift", [1e-16, -1e-16, 3e-13, -3e-13, 1e-10, -1e-10])
def test_outline_next_to_mesh_lines_leaves_whole_faces(shift):
    panels = trimmed_panels(plane_grid(), square(1 + shift, 3 - 2 * shift), 1.0)
    assert panels.face.tolist() == [5, 6, 9, 10]
    assert not panels.is_trimmed.any()


def test_outline_around_all_leaves_the_mesh():
    mesh = vault()
    panels = trimmed_panels(mesh, square(-5, 30), 1.0)
    assert np.array_equal(np.array(panels.polygons), mesh.corners)


def test_outline_through_vertices_cuts_diagonals():
    panels = trimmed_panels(plane_grid(), PlanOutline([[2, 0], [4, 2], [2, 4], [0, 2]]), 1.0)
    assert len(panels.polygons) == 12
    assert sorted(len(p) for p in panels.polygons) == [3] * 8 + [4] * 4
    assert all((v >= 0).all() for v in panels.corner_vertex)
    assert panels.area_plan.sum() == 8.0


def test_outline_that_touches_a_corner_cuts_nothing_off():
    outline = PlanOutline([[0, 0], [3, 0], [2, 2], [3, 4], [0, 4]])
    panels = trimmed_panels(plane_grid(), outline, 1.0)
    check(panels, plane_grid())
    assert panels.area_plan.sum() == pytest.approx(outline.area, rel=1e-14)
    assert panels.is_trimmed[np.isin(panels.face, [5, 6])].sum() == 0


def test_face_falls_into_two_pieces():
    mesh = plane_grid(1, 1)
    notch = [[0, -1], [2, -1], [2, 0.4], [-1, 0.4], [-1, 0.6], [2, 0.6], [2, 2], [-2, 2], [-2, -1]]
    panels = trimmed_panels(mesh, PlanOutline(notch), 1.0)
    assert panels.face.tolist() == [0, 0]
    assert panels.area_plan.tolist() == pytest.approx([0.4, 0.4])
    assert [(v >= 0).sum() for v in panels.corner_vertex] == [2, 2]


def test_notch_that_just_reaches_across_parts_a_face():
    wedge = [[-1, -1], [2, -1], [2, 0.3], [0, 0.5], [2, 0.7], [2, 2], [-1, 2]]
    panels = trimmed_panels(plane_grid(1, 1), PlanOutline(wedge), 1.0)
    assert panels.face.tolist() == [0, 0]
    assert panels.area_plan.sum() == pytest.approx(0.9, rel=1e-14)
    assert [(e >= 0).sum() for e in panels.corner_edge] == [2, 2]


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize(
    "hole",
    [
        [[1.3, 1.3], [1.6, 1.3], [1.6, 1.7], [1.3, 1.7]],
        [[1.2, 1.2], [1.8, 1.2], [1.8, 1.8], [1.2, 1.8]],
        [[1.5, 1.0], [1.7, 1.5], [1.5, 1.9]],
        [[1.0, 1.0], [1.7, 1.5], [1.5, 1.7]],
        [[1.0, 1.2], [1.6, 1.2], [1.6, 1.6], [1.0, 1.6]],
    ],
    ids=["inside", "middle", "touches edge", "touches vertex", "along edge"],
)
def test_hole_in_one_face_leaves_simple_polygons(hole, slope):
    mesh = plane_grid(3, 3, slope)
    outline = PlanOutline([[-1, -1], [4, -1], [4, 4], [-1, 4]], holes=(hole,))
    area = PlanOutline(hole).area
    panels = trimmed_panels(mesh, outline, 1.0)
    check(panels, mesh)
    assert panels.area_plan.sum() == pytest.approx(9 - area, rel=1e-13)
    # Before slivers are merged, which may join the parts to neighbours in the same plane:
    polygons, faces = cut_pieces(mesh, outline)
    touches = bool((np.array(hole) == 1.0).any())
    assert faces.count(4) in ((1, 2, 3) if touches else (2,))
    assert len(faces) == 8 + faces.count(4)
    assert sum(area_vector(p)[2] for p, f in zip(polygons, faces, strict=True) if f == 4) == (
        pytest.approx(1 - area, rel=1e-13)
    )


def test_two_holes_in_one_face():
    holes = [[[0.2, 0.4], [0.3, 0.4], [0.3, 0.6]], [[0.7, 0.45], [0.8, 0.45], [0.8, 0.6]]]
    outline = PlanOutline([[-1, -1], [2, -1], [2, 2], [-1, 2]], holes=holes)
    panels = trimmed_panels(plane_grid(1, 1), outline, 1.0)
    check(panels, plane_grid(1, 1))
    assert panels.area_plan.sum() == pytest.approx(1 - 0.01 - 0.0075, rel=1e-13)


def test_outline_inside_one_face_is_the_panel():
    outline = PlanOutline([[1.2, 1.2], [1.4, 1.8], [1.8, 1.3]])
    mesh = plane_grid(slope=(0.5, 0.25))
    panels = trimmed_panels(mesh, outline, 1.0)
    assert panels.face.tolist() == [5]
    assert panels.area_plan[0] == pytest.approx(outline.area, rel=1e-14)
    assert {tuple(p) for p in panels.polygons[0][:, :2].tolist()} == {
        tuple(p) for p in outline.polygon.tolist()
    }
    assert area_vector(panels.polygons[0])[2] > 0


def test_outline_with_hole_inside_one_face():
    outline = PlanOutline([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9]],
                          holes=([[0.3, 0.3], [0.6, 0.3], [0.6, 0.6]],))  # fmt: skip
    panels = trimmed_panels(plane_grid(1, 1), outline, 1.0)
    assert panels.area_plan.sum() == pytest.approx(outline.area, rel=1e-14)
    assert len(panels.polygons) == 2


def test_straight_and_double_outline_corners_leave_no_corner():
    ring = [[0.5, 0.5], [1.2, 0.5], [1.2, 0.5], [2.5, 0.5], [2.5, 2.5], [0.5, 2.5]]
    panels = trimmed_panels(plane_grid(), PlanOutline(ring), 1.0)
    assert all(len(p) == 4 for p in panels.polygons)
    assert len(panels.polygons) == 9


# --- steep, upright, overhanging and reversed -------------------------------------------------


def test_upright_faces_are_cut_in_their_own_plane():
    wall = translational_mesh(
        [[0, 0, 0], [1, 0.5, 0], [2, 1, 0]], [[0, 0, 0], [0, 0, 1], [0, 0, 2]]
    )
    panels = trimmed_panels(wall, PlanOutline([[0.5, -1], [1.5, -1], [1.5, 2], [0.5, 2]]), 1.0)
    check(panels, wall)
    assert panels.area.sum() == pytest.approx(2 * np.hypot(1, 0.5), rel=1e-14)
    assert panels.area_plan.max() < 1e-15
    ends = open_sides(panels)
    assert len(ends) == 8


def test_upright_face_falls_into_pieces():
    wall = translational_mesh([[0, 0, 0], [4, 0, 0]], [[0, 0, 0], [0, 0, 1]])
    outline = PlanOutline([[0.5, -1], [3.5, -1], [3.5, 1], [2.5, 1], [2.5, -0.5], [1.5, -0.5],
                           [1.5, 1], [0.5, 1]])  # fmt: skip
    assert trimmed_panels(wall, outline, 1.0).area.tolist() == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("lean", [1e-2, 1e-5, 1e-6, 1e-8, 1e-12])
def test_nearly_upright_faces_end_on_the_walls(lean):
    wall = translational_mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 0, 0], [0, lean, 1]])
    outline = PlanOutline([[0.5, -1], [1.25, -1], [1.5, 1], [0.5, 1]])
    panels = trimmed_panels(wall, outline, 1.0)
    check(panels, wall)
    points = np.concatenate(panels.polygons)
    cut = np.concatenate(panels.corner_vertex) < 0
    assert outline_gap(points[cut], outline).max() < 1e-14
    assert panels.area.sum() == pytest.approx((0.875 + lean * 0.0625) * np.hypot(1, lean), rel=1e-6)


def test_downward_mesh_keeps_its_orientation():
    mesh, outline = vault().reversed(), PlanOutline([[2, 2], [9, 3], [8, 8], [3, 7]])
    panels = trimmed_panels(mesh, outline, 1.0)
    check(panels, mesh)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-12)


def test_two_sheets_over_one_outline_are_both_cut():
    tube = translational_mesh([[0, 0, 0], [3, 0, 0], [6, 0, 0]],
                              [[0, 0, 0], [0, 3, 1], [0, 4, 3], [0, 0, 5]])  # fmt: skip
    outline = PlanOutline([[1, 1], [5, 1], [5, 2], [1, 2]])
    panels = trimmed_panels(tube, outline, 1.0)
    check(panels, tube)
    assert panels.covered_share == pytest.approx(2.0, rel=1e-13)


def test_folded_face_is_refused_when_it_must_be_cut():
    bow = QuadMesh.of([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    with pytest.raises(MeshError, match="face 0 crosses itself"):
        trimmed_panels(bow, PlanOutline([[0.2, -1], [3, -1], [3, 0.7], [0.2, 0.8]]), 1.0)


# --- refusals -------------------------------------------------------------------------------


def test_outline_beside_the_mesh_is_refused():
    with pytest.raises(SpecError, match="must lie over the mesh"):
        trimmed_panels(plane_grid(), square(10, 12), 1.0)


def test_crossing_outline_is_refused():
    with pytest.raises(SpecError, match="must not cross"):
        trimmed_panels(plane_grid(), PlanOutline([[0, 0], [3, 3], [3, 0], [0, 2]]), 1.0)


@pytest.mark.parametrize(
    ("holes", "words"),
    [
        ([[[5, 5], [6, 5], [6, 6]]], "hole 0 lies outside"),
        ([[[0.5, 0.5], [3, 0.5], [3, 3]], [[2, 1], [2.5, 1], [2.5, 1.5]]], "hole 1 lies in hole 0"),
    ],
)
def test_misplaced_holes_are_refused(holes, words):
    with pytest.raises(SpecError, match=words):
        trimmed_panels(plane_grid(), PlanOutline(square(0, 4).polygon, holes=holes), 1.0)


# --- curved meshes ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def site():
    """Outline inside the vault, with two holes, one of them within a face."""
    ring = [[1.3, 1.1], [6.1, 0.9], [10.9, 1.4], [11.2, 8.8], [7, 7.1], [4, 9.2], [1.1, 8.7]]
    holes = ([[4, 4], [6.2, 4.1], [5.9, 6], [4.2, 5.5]], [[8.3, 3.3], [8.5, 3.3], [8.4, 3.5]])
    return PlanOutline(ring, holes=holes)


def test_vault_is_cut_flat_and_complete(site):
    mesh = vault()
    panels = trimmed_panels(mesh, site, 1.0)
    check(panels, mesh)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-13)
    assert panels.is_trimmed.any()


def test_neighbours_share_their_corners_bit_for_bit(site):
    ends = open_sides(trimmed_panels(vault(), site, 1.0))
    assert outline_gap(ends.mean(axis=1), site).max() < 1e-13


def test_trimming_is_deterministic(site):
    first, second = (trimmed_panels(vault(), site, 1.0) for _ in range(2))
    assert obj_from_polygons(first.polygons) == obj_from_polygons(second.polygons)
    assert np.array_equal(first.slivers, second.slivers)


def test_result_does_not_depend_on_the_start_of_the_outline(site):
    turned = PlanOutline(np.roll(site.polygon[::-1], 3, axis=0), holes=site.holes)
    first, second = (trimmed_panels(vault(), outline, 1.0) for outline in (site, turned))
    assert len(first.polygons) == len(second.polygons)
    for a, b in zip(first.polygons, second.polygons, strict=True):
        assert np.abs(a - b).max() < 1e-13


def test_far_from_the_origin_cuts_are_as_exact_as_coordinates(site):
    move = np.array([4.5e6, 5.4e6, 300.0])
    mesh = vault()
    mesh = mesh.with_vertices(mesh.vertices + move)
    outline = PlanOutline(site.polygon + move[:2], holes=[h + move[:2] for h in site.holes])
    panels = trimmed_panels(mesh, outline, 1.0)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-8)
    assert outline_gap(open_sides(panels).mean(axis=1), outline).max() < 1e-8


def test_layers_are_cut_by_the_same_walls(site):
    mesh = vault()
    vectors = offset_vectors(mesh, "conical")
    for distance in (-0.3, 0.2):
        layer = offset_layer(mesh, vectors, distance).mesh
        panels = trimmed_panels(layer, site, 1.0)
        assert panels.covered_share == pytest.approx(1.0, abs=1e-12)
        assert outline_gap(open_sides(panels).mean(axis=1), site).max() < 1e-13


@pytest.mark.slow
def test_roof_of_1480_panels_with_three_layers_is_cut_in_three_seconds():
    mesh = dome()
    vectors = offset_vectors(mesh, "conical")
    layers = [offset_layer(mesh, vectors, d).mesh for d in (-0.6, -0.08, 0.12)]
    support = support_structure(mesh, vectors.axes, layers[0], layers[2])
    turns = np.linspace(0.1, 1.5, 60)
    arc = np.column_stack([np.cos(turns), np.sin(turns)])
    outline = PlanOutline(np.concatenate([36.5 * arc, 10.3 * arc[::-1]]))
    begin = time.process_time()
    panels = [trimmed_panels(layer, outline, 1.5) for layer in (mesh, *layers)]
    trimmed_webs(support, outline)
    assert time.process_time() - begin < 3.0
    assert panels[0].covered_share == pytest.approx(1.0, abs=1e-12)


# --- slivers --------------------------------------------------------------------------------


def test_flat_slivers_are_merged_into_their_neighbours():
    mesh, outline = plane_grid(slope=(0.5, 0.0)), square(0.5, 3.03)
    panels = trimmed_panels(mesh, outline, 1.0)
    check(panels, mesh)
    assert not len(panels.slivers)
    assert len(panels.polygons) == 9
    assert all(len(points) == 4 for points in panels.polygons)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-13)


def test_slivers_of_a_curved_roof_are_listed_with_their_place():
    line = np.arange(5.0)
    mesh = translational_mesh(
        [[x, 0, 0.1 * x * x] for x in line], [[0, y, -0.1 * y * y] for y in line]
    )
    panels = trimmed_panels(mesh, square(0.5, 3.03), 1.0)
    assert len(panels.slivers) == 7
    assert (panels.sliver_places[:, :2].max(axis=1) > 3).all()
    assert (panels.area[panels.slivers] < 0.15).all()


def test_short_side_makes_a_sliver():
    outline = PlanOutline([[0.5, 0.96], [3.5, 1.02], [3.5, 3.5], [0.5, 3.5]])
    line = np.arange(5.0)
    mesh = translational_mesh([[x, 0, 0.1 * x * x] for x in line], [[0, y, 0] for y in line])
    panels = trimmed_panels(mesh, outline, 1.0)
    sides = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1).min() for p in panels.polygons]
    assert set(np.flatnonzero(np.array(sides) < 0.05)) <= set(panels.slivers.tolist())


# --- webs -----------------------------------------------------------------------------------


def upright_support(mesh, height=0.5):
    up = np.tile([0.0, 0.0, 1.0], (len(mesh.vertices), 1))
    top = mesh.with_vertices(mesh.vertices + height * up)
    return support_structure(mesh, up, mesh, top)


def test_upright_webs_are_cut_to_the_length_inside():
    mesh = plane_grid(slope=(0.3, 0.1))
    webs = trimmed_webs(upright_support(mesh), PlanOutline(U_SHAPE))
    length = sum(
        float(np.ptp(p[:, axis]))
        for p in webs.polygons
        for axis in (0, 1)
        if np.ptp(p[:, axis]) > 0
    )
    # Grid lines inside the U: x = 1, 2, 3 and y = 1, 2, 3.
    assert length == pytest.approx((3 + 1 + 3) + (3 + 2 * (0.8 + 0.9)), rel=1e-13)
    assert max(flatness(p) for p in webs.polygons) < 1e-13


def test_web_falls_into_pieces():
    mesh = translational_mesh([[0, 0, 0], [4, 0, 0]], [[0, 0, 0], [0, 4, 0]])
    comb = [[-1, -1], [5, -1], [5, 1], [3, 1], [3, -0.5], [2, -0.5], [2, 1], [-1, 1]]
    webs = trimmed_webs(upright_support(mesh), PlanOutline(comb))
    bottom = [p for p, e in zip(webs.polygons, webs.edge, strict=True) if np.ptp(p[:, 1]) == 0]
    assert sorted(float(np.ptp(p[:, 0])) for p in bottom) == pytest.approx([1.0, 2.0])


def test_webs_share_cut_points_with_the_layers(site):
    mesh = vault()
    vectors = offset_vectors(mesh, "conical")
    low, high = (offset_layer(mesh, vectors, d).mesh for d in (-0.3, 0.2))
    support = support_structure(mesh, vectors.axes, low, high)
    webs = trimmed_webs(support, site)
    known = {tuple(p) for polygon in webs.polygons for p in polygon.tolist()}
    for layer in (low, high):
        panels = trimmed_panels(layer, site, 1.0)
        for points, edges in zip(panels.polygons, panels.corner_edge, strict=True):
            assert {tuple(p) for p in points[edges >= 0].tolist()} <= known
    for polygon, edge in zip(webs.polygons, webs.edge, strict=True):
        quad = support.quads[edge]
        normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
        assert area_vector(polygon) @ normal > 0


def test_leaning_webs_stay_flat(site):
    mesh = dome(12, 12)
    vectors = offset_vectors(mesh, "conical")
    low, high = (offset_layer(mesh, vectors, d).mesh for d in (-0.6, 0.2))
    outline = PlanOutline([[15, 1], [33, 2], [30, 9], [14, 5]])
    webs = trimmed_webs(support_structure(mesh, vectors.axes, low, high), outline)
    assert webs.is_trimmed.any()
    assert max(flatness(p) for p in webs.polygons) < 1e-11


def test_bent_faces_are_still_cut():
    line = np.arange(5.0)
    x, y = np.meshgrid(line, line, indexing="ij")
    mesh = grid_mesh(np.stack([x, y, 0.05 * np.sin(5 * x * y)], axis=-1))
    panels = trimmed_panels(mesh, PlanOutline(HEXAGON), 1.0)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-12)
