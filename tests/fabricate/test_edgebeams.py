"""Edge beams along the cut boundary."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from roofs import dome, outline_gap, plane_grid, square, vault

from pqmesh.fabricate.edgebeams import edge_beams
from pqmesh.fabricate.trim import trimmed_panels
from pqmesh.network.region import PlanOutline
from pqmesh.offset.offsets import offset_vectors


def plan_length(beam):
    ends = np.roll(beam.points, -1, axis=0) if beam.is_closed else beam.points[1:]
    steps = ends - beam.points[: len(ends)]
    return float(np.linalg.norm(steps[:, :2], axis=1).sum())


def ring_length(ring):
    return float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())


def test_each_ring_gives_one_closed_beam_of_its_length():
    holes = ([[4, 4], [6.2, 4.1], [5.9, 6], [4.2, 5.5]], [[8.3, 3.3], [8.5, 3.3], [8.4, 3.5]])
    outline = PlanOutline([[1.3, 1.1], [10.9, 1.4], [11.2, 8.8], [7, 7.1], [1.1, 8.7]], holes=holes)
    mesh = vault()
    panels = trimmed_panels(mesh, outline, 1.0)
    axes = offset_vectors(mesh, "conical").axes
    beams = edge_beams(panels, mesh, axes)
    assert [beam.ring for beam in beams] == [0, 1, 2]
    for beam in beams:
        assert beam.is_closed
        assert len(beam.panel) == len(beam.points) == len(beam.axes)
        assert outline_gap(beam.points, outline).max() < 1e-13
        assert plan_length(beam) == pytest.approx(ring_length(outline.rings[beam.ring]), rel=1e-12)


def test_axes_at_cut_nodes_lie_in_the_plane_of_their_web():
    mesh = dome(12, 12)
    outline = PlanOutline([[15, 1], [33, 2], [30, 9], [14, 5]])
    axes = offset_vectors(mesh, "conical").axes
    panels = trimmed_panels(mesh, outline, 1.5)
    edge_of = {
        tuple(p): e
        for points, edges in zip(panels.polygons, panels.corner_edge, strict=True)
        for p, e in zip(points.tolist(), edges.tolist(), strict=True)
        if e >= 0
    }
    checked = 0
    for beam in edge_beams(panels, mesh, axes):
        assert np.abs(np.linalg.norm(beam.axes, axis=1) - 1).max() < 1e-14
        for point, axis in zip(beam.points.tolist(), beam.axes, strict=True):
            if tuple(point) in edge_of:
                i, j = mesh.edges[edge_of[tuple(point)]]
                volume = np.dot(np.cross(mesh.vertices[j] - mesh.vertices[i], axes[i]), axis)
                assert abs(volume) < 1e-11
                checked += 1
    assert checked > 20


def test_beams_along_mesh_lines_keep_the_vertex_axes():
    mesh = plane_grid()
    axes = np.random.default_rng(1).normal(size=(25, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    beams = edge_beams(trimmed_panels(mesh, square(1, 3), 1.0), mesh, axes)
    assert len(beams) == 1
    place = {tuple(p): k for k, p in enumerate(mesh.vertices.tolist())}
    rows = [place[tuple(p)] for p in beams[0].points.tolist()]
    assert len(rows) == 8
    assert np.abs(beams[0].axes - axes[rows]).max() < 1e-15


def test_beams_are_open_where_the_mesh_ends():
    mesh = plane_grid()
    axes = np.tile([0.0, 0.0, 1.0], (25, 1))
    outline = PlanOutline([[0.5, 0.5], [6, 0.5], [6, 3.5], [0.5, 3.5]])
    beams = edge_beams(trimmed_panels(mesh, outline, 1.0), mesh, axes)
    assert [beam.is_closed for beam in beams] == [False]
    assert beams[0].points[[0, -1], 0].tolist() == [4.0, 4.0]
    assert len(beams[0].panel) == len(beams[0].points) - 1


def test_beam_passes_a_whole_panel_with_a_cut_node_on_its_side():
    """The outline meets a mesh line at (1.5, 1) and follows it: a T-joint."""
    outline = PlanOutline([[0.5, 0.25], [1.5, 1], [2, 1], [4, 1], [4, 3], [0.5, 3]])
    mesh = plane_grid()
    beams = edge_beams(trimmed_panels(mesh, outline, 1.0), mesh, np.tile([0.0, 0, 1], (25, 1)))
    assert [beam.is_closed for beam in beams] == [True]
    assert plan_length(beams[0]) == pytest.approx(ring_length(outline.polygon), rel=1e-13)


def test_rings_that_meet_in_a_point_give_beams_of_the_whole_length():
    outline = PlanOutline([[0.5, 0.5], [3.5, 0.5], [3.5, 3.5], [0.5, 3.5]],
                          holes=([[0.5, 2], [1.5, 1.5], [1.5, 2.5]],))  # fmt: skip
    mesh = plane_grid()
    beams = edge_beams(trimmed_panels(mesh, outline, 1.0), mesh, np.tile([0.0, 0, 1], (25, 1)))
    total = sum(ring_length(ring) for ring in outline.rings)
    assert sum(plan_length(beam) for beam in beams) == pytest.approx(total, rel=1e-13)
