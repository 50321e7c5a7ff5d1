"""Dragging vertices of exact meshes: they stay exact, whole, and come back."""

import numpy as np
import pytest
from shapes import grid_mesh, zoo

from pqmesh.errors import SpecError
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import flipped_faces, measures, nonconvex_faces
from pqmesh.optimize.editing import Editing
from pqmesh.optimize.schedule import optimized
from pqmesh.surface.reference import TriangleReference

PROFILE = np.column_stack([2 + 0.6 * np.sin(np.linspace(0, 3, 13)), np.linspace(0, 3, 13)])
VASE = rotational_mesh(PROFILE, 0.15 * np.arange(14))
MIDDLE = 14 * 6 + 7


def pulled(editing, steps, share=0.25):
    """Meshes while the first handle goes out along its normal in so many steps."""
    start = editing.rest
    handle = editing.handles[0]
    way = share * start.mean_edge_length * start.vertex_normals[handle]
    targets = start.vertices[editing.handles].copy()
    for step in steps:
        targets[0] += step * way
        editing, solution = editing.dragged(targets)
        yield editing, solution, targets


@pytest.mark.parametrize("kind", ["planar", "conical", "circular", "conical-circular"])
def test_dragged_mesh_stays_in_its_class_and_whole_at_every_step(kind):
    editing = Editing.of(kind, VASE, [MIDDLE])
    for found, solution, targets in pulled(editing, [1, 1, 1, 1, -1, -1]):
        assert solution.converged, solution.reason
        assert found.gaps(targets)[0] < 0.02 * VASE.mean_edge_length
        reached = measures(found.mesh)
        assert reached["planarity_max"] < 1e-6
        if "conical" in kind:
            assert reached["cone_spread_max"] < 1e-6
        if "circular" in kind:
            assert reached["circularity_max_deg"] < 1e-5
        assert not len(nonconvex_faces(found.mesh))
        assert not len(flipped_faces(found.mesh))


def test_drag_and_its_way_back_lead_near_to_where_it_began():
    editing = Editing.of("planar", VASE, [MIDDLE])
    *_, (found, _, _) = pulled(editing, [1, 1, -1, -1, 0, 0])
    gap = np.linalg.norm(found.mesh.vertices - VASE.vertices, axis=1).max()
    assert gap < 0.02 * VASE.mean_edge_length


def test_drag_spreads_over_a_region_and_makes_no_peak():
    editing = Editing.of("planar", VASE, [MIDDLE])
    *_, (found, _, _) = pulled(editing, [1, 1])
    moved = np.linalg.norm(found.mesh.vertices - VASE.vertices, axis=1)
    neighbors, _ = VASE.topology.star(MIDDLE)
    assert moved[neighbors].min() > 0.5 * moved[MIDDLE]


def test_fixed_vertices_stay_and_second_handle_holds():
    fixed = VASE.topology.is_boundary_vertex.copy()
    held = MIDDLE + 3
    editing = Editing.of("planar", VASE, [MIDDLE, held], fixed=fixed)
    *_, (found, solution, targets) = pulled(editing, [1, 1])
    assert solution.converged
    assert (found.mesh.vertices[fixed] == VASE.vertices[fixed]).all()
    assert found.gaps(targets).max() < 0.02 * VASE.mean_edge_length


def test_units_and_place_do_not_matter():
    far, scale = np.array([1e3, -2e3, 5e2]), 1e3
    moved = VASE.with_vertices(scale * VASE.vertices + far)
    (here, _, _), (there, _, _) = (
        list(pulled(Editing.of("conical", mesh, [MIDDLE]), [1, 1]))[-1] for mesh in (VASE, moved)
    )
    back = (there.mesh.vertices - far) / scale
    assert np.abs(back - here.mesh.vertices).max() < 1e-6 * VASE.mean_edge_length


def test_drag_that_would_break_faces_leaves_them_whole():
    editing = Editing.of("planar", VASE, [MIDDLE])
    across = VASE.vertices[MIDDLE + 2 * 14]
    found, _ = editing.dragged([across])
    assert not len(nonconvex_faces(found.mesh))
    assert measures(found.mesh)["edge_min"] > 0.1 * measures(VASE)["edge_min"]


@pytest.mark.parametrize("kind", ["planar", "conical"])
def test_target_far_away_is_neared_by_an_edge_with_each_drag(kind):
    edge = VASE.mean_edge_length
    target = VASE.vertices[[MIDDLE]] + 3.6 * edge * VASE.vertex_normals[[MIDDLE]]
    editing, gaps = Editing.of(kind, VASE, [MIDDLE]), []
    for _ in range(4):
        editing, solution = editing.dragged(target)
        assert solution.converged
        assert measures(editing.mesh)["planarity_max"] < 1e-6
        assert not len(nonconvex_faces(editing.mesh))
        gaps.append(float(editing.gaps(target)[0] / edge))
    assert gaps == pytest.approx([2.6, 1.6, 0.6, 0.0], abs=0.02)


@pytest.mark.parametrize("seed", [0, 1])
def test_corner_dragged_far_out_finds_back(seed):
    # The mesh does not follow a drag of an edge: drags get shorter until it does.
    x, y = np.meshgrid(*2 * [np.linspace(-2.0, 2.0, 8)], indexing="ij")
    bowl = grid_mesh(np.stack([x, y, 0.4 * x * x - 0.1 * x * y + 0.25 * y * y], axis=-1))
    reference = TriangleReference.of_polygons(bowl.vertices, bowl.faces.tolist())
    start = bowl.with_vertices(optimized("conical", bowl, reference).blocks["vertices"])
    editing, length = Editing.of("conical", start, [0]), start.mean_edge_length
    home = target = start.vertices[[0]]
    way = np.random.default_rng(seed).normal(size=3)
    for _ in range(20):
        target = target + 0.25 * length * way / np.linalg.norm(way)
        editing, _ = editing.dragged(target)
    assert editing.gaps(home)[0] > 4.9 * length
    for _ in range(20):
        editing, solution = editing.dragged(home)
    assert solution.converged
    assert editing.gaps(home)[0] < 1e-3 * length


def test_same_drags_give_the_same_bytes():
    one, other = (
        [
            found.mesh.vertices.tobytes()
            for found, _, _ in pulled(Editing.of("planar", VASE, [3]), [1, 1])
        ]
        for _ in range(2)
    )
    assert one == other


@pytest.mark.parametrize(
    ("handles", "fixed", "said"),
    [
        ([], None, "at least one, each once; found"),
        ([-1], None, "Handles must be vertices 0..181"),
        ([182], None, "Handles must be vertices 0..181"),
        ([1.5], None, r"found \[1.5\]"),
        (["a"], None, "Handles must be vertices"),
        ([0], VASE.topology.is_boundary_vertex, "vertex 0 is fixed"),
    ],
)
def test_handles_that_cannot_be_are_refused(handles, fixed, said):
    with pytest.raises(SpecError, match=said):
        Editing.of("planar", VASE, handles, fixed=fixed)


@pytest.mark.parametrize("targets", [[[0, 0]], [[0, 0, np.nan]], np.zeros((2, 3))])
def test_targets_that_are_no_points_are_refused(targets):
    with pytest.raises(SpecError, match="one finite point for each of the 1 handles"):
        Editing.of("planar", VASE, [5]).dragged(targets)


def test_unknown_kind_is_refused():
    with pytest.raises(SpecError, match="found 'flat'"):
        Editing.of("flat", VASE, [5])


def test_targets_belong_to_handles_in_the_order_given():
    handles = [MIDDLE + 3, MIDDLE]
    targets = VASE.vertices[handles] + 0.1 * VASE.mean_edge_length * VASE.vertex_normals[handles]
    found, solution = Editing.of("planar", VASE, handles).dragged(targets)
    assert solution.converged
    gaps = np.linalg.norm(found.mesh.vertices[handles] - targets, axis=1)
    assert gaps.max() < 0.02 * VASE.mean_edge_length


@pytest.mark.parametrize("name", ["annulus", "torus"])
def test_rings_and_closed_meshes_are_dragged(name):
    mesh = zoo()[name][0]
    editing = Editing.of("planar", mesh, [1])
    before = measures(mesh)["planarity_max"]
    found, solution = editing.dragged(mesh.vertices[[1]])
    assert solution.converged
    assert measures(found.mesh)["planarity_max"] < max(1e-6, before * 1e-3)
