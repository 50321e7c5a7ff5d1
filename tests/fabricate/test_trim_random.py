"""Random outlines against an independent clipper."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))

from roofs import cut_pieces, flatness, open_sides, outline_gap, plane_grid, vault

from pqmesh.fabricate.tidy import area_vector
from pqmesh.fabricate.trim import trimmed_panels, trimmed_webs
from pqmesh.network.region import PlanOutline
from pqmesh.offset.support import support_structure

shapely = pytest.importorskip("shapely")

# Coordinates on mesh lines, between them, and next to them.
nudges = st.sampled_from([0.0, 0.0, 0.0, 1e-16, -1e-15, 1e-12, -1e-9, 2e-9, 1e-7])
coordinates = st.builds(lambda k, d: k / 4 + d, st.integers(-4, 20), nudges)
corners = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=9)


def outline_of(ring, holes=()):
    """Outline of a random ring, None where it is none."""
    shape = shapely.Polygon(ring, holes)
    thin = any(shapely.Polygon(hole).area < 1e-3 for hole in holes)
    if not shape.is_valid or shape.area < 1e-3 or thin:
        return None
    return PlanOutline(ring, holes=holes)


def by_shapely(mesh, outline):
    """Area in plan of each face, and its numbers of pieces before and after necks are parted."""
    shape = shapely.Polygon(outline.polygon, outline.holes)
    found = shapely.intersection(shapely.polygons(mesh.corners[:, :, :2]), shape)
    pieces = [
        [sum(p.area > 1e-6 for p in polygons_of(g)) for g in geometries]
        for geometries in (found, shapely.buffer(found, -1e-8))
    ]
    return shapely.area(found), np.array(pieces)


def polygons_of(geometry):
    return [p for p in shapely.get_parts(geometry) if p.geom_type == "Polygon"]


def compare(mesh, outline):
    area, pieces = by_shapely(mesh, outline)
    polygons, faces = cut_pieces(mesh, outline)
    plan = np.array([area_vector(points)[2] for points in polygons])
    assert (plan > 0).all()
    face = np.array(faces, dtype=int)
    assert np.abs(np.bincount(face, plan, minlength=len(area)) - area).max() < 1e-7
    if not outline.holes:
        big = np.bincount(face[plan > 1e-6], minlength=len(area))
        # Pieces that hang together by less than the snap may count as one or as two.
        assert (pieces.min(axis=0) <= big).all()
        assert (big <= pieces.max(axis=0)).all()
    for points in polygons:
        flat = shapely.Polygon(points[:, :2])
        assert flat.is_valid or flat.buffer(1e-8).geom_type == "Polygon"
        assert flatness(points) < 1e-12 or flat.area < 1e-6
    if len(polygons):
        panels = trimmed_panels(mesh, outline, 1.0)
        assert panels.area_plan.sum() == pytest.approx(area.sum(), rel=1e-7, abs=1e-7)
        assert all(shapely.Polygon(p[:, :2]).buffer(1e-8).is_valid for p in panels.polygons)


@settings(max_examples=200, deadline=None)
@given(corners)
def test_pieces_agree_with_shapely_on_a_plane(ring):
    outline = outline_of(ring)
    if outline is not None:
        compare(plane_grid(slope=(0.5, -0.25)), outline)


@settings(max_examples=80, deadline=None)
@given(corners)
def test_pieces_agree_with_shapely_on_a_vault(ring):
    outline = outline_of([(2 * x + 1, 2 * y + 1) for x, y in ring])
    if outline is not None:
        compare(vault(), outline)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 7), st.integers(1, 7)), min_size=3, max_size=7), nudges)
def test_holes_agree_with_shapely(hole, nudge):
    ring = [(-1, -1), (5, -1), (5, 5), (-1, 5)]
    outline = outline_of(ring, ([(x / 2 + nudge, y / 2) for x, y in hole],))
    if outline is not None:
        compare(plane_grid(), outline)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 15), st.integers(1, 15)), min_size=3, max_size=6))
def test_small_holes_agree_with_shapely(hole):
    ring = [(-1, -1), (5, -1), (5, 5), (-1, 5)]
    outline = outline_of(ring, ([(1 + x / 16, 1 + y / 16) for x, y in hole],))
    if outline is not None:
        compare(plane_grid(), outline)


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 10**6), st.integers(3, 40))
def test_random_stars_leave_no_open_side_off_the_outline(seed, n):
    rng = np.random.default_rng(seed)
    turns = np.sort(rng.uniform(0, 2 * np.pi, n))
    if np.diff([*turns, turns[0] + 2 * np.pi]).max() > 3.0:
        return
    reach = rng.uniform(0.3, 4.0, n)
    ring = np.column_stack([6 + reach * np.cos(turns), 5 + reach * np.sin(turns)])
    outline, mesh = PlanOutline(ring), vault()
    panels = trimmed_panels(mesh, outline, 1e-6)
    assert panels.covered_share == pytest.approx(1.0, abs=1e-9)
    assert outline_gap(open_sides(panels).mean(axis=1), outline).max() < 1e-8


@settings(max_examples=100, deadline=None)
@given(corners)
def test_webs_agree_with_lengths_by_shapely(ring):
    outline = outline_of(ring)
    if outline is None:
        return
    mesh = plane_grid()
    up = np.tile([0.0, 0.0, 1.0], (len(mesh.vertices), 1))
    support = support_structure(mesh, up, mesh, mesh.with_vertices(mesh.vertices + up))
    webs = trimmed_webs(support, outline)
    # Webs along the outline may fall to either side.
    inner, outer = (shapely.Polygon(outline.polygon).buffer(d) for d in (-1e-6, 1e-6))
    lines = shapely.linestrings(mesh.vertices[mesh.edges][:, :, :2])
    low, high = (shapely.length(shapely.intersection(lines, s)).sum() for s in (inner, outer))
    found = sum(np.ptp(p[:, :2], axis=0).max() for p in webs.polygons)
    assert low - 1e-3 <= found <= high + 1e-3
