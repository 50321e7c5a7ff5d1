"""The case study of the roof: site, sketch, modified surface, networks and parts."""

from __future__ import annotations

import json
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from shapely.affinity import affine_transform
from shapely.geometry import Point, Polygon

from pqmesh.mesh.measure import planarity_deviation
from pqmesh.optimize.schedule import optimized
from pqmesh.surface.curvature import first_form, second_form, shape_data
from pqmesh.surface.reference import SurfaceReference

ROOF = Path(__file__).parents[2] / "examples" / "roof"
# The scripts import each other, as they do when one of them is run.
sys.path.insert(0, str(ROOF))
case_study, does_it_pay, make_net, measured, networks = (
    import_module(name)
    for name in ("case_study", "does_it_pay", "make_net", "measured", "networks")
)


@pytest.fixture(scope="module")
def site():
    return case_study.read_site()


@pytest.fixture(scope="module")
def sketch():
    return case_study.read_surface("sketch.toml")


@pytest.fixture(scope="module")
def roof():
    return case_study.read_surface("roof.toml")


def samples(surface, outline):
    uv = surface.domain.grid(90, 90).reshape(-1, 2)
    return uv[outline.on(surface)(uv)]


# --- the site -----------------------------------------------------------------------------------


def test_outline_of_the_drawing_is_that_of_the_designs(site):
    for name in ("roof.toml", "sketch.toml"):
        table = tomllib.loads((ROOF / name).read_text("utf-8"))["outline"]
        if "polygon" in table:
            np.testing.assert_allclose(site[0].polygon, table["polygon"], atol=1e-12)
        else:
            assert (table["file"], table["select"]) == ("site.svg", "roof")


def test_site_is_about_60_by_45_metres_between_buildings(site):
    outline, around = site
    np.testing.assert_allclose(np.ptp(outline.polygon, axis=0), [60, 45], atol=3)
    roof = Polygon(outline.polygon)
    buildings = [Polygon(ring) for ring in around.buildings]
    assert 4 <= len(buildings) <= 8
    assert all(building.is_valid and building.area > 100 for building in buildings)
    assert all(0 < roof.distance(building) < 5 for building in buildings)
    apart = [a.distance(b) for i, a in enumerate(buildings) for b in buildings[:i]]
    assert min(apart) > 3


def test_every_building_has_its_name(site):
    _, around = site
    for ring in around.buildings:
        inside = [name for name, place in around.names if Polygon(ring).contains(Point(place))]
        assert len(inside) == 1


def test_outline_has_no_symmetry(site):
    shape = Polygon(site[0].polygon)
    x, y = shape.centroid.coords[0]

    def other(a, b, c, d):
        copy = affine_transform(shape, [a, b, c, d, x - a * x - b * y, y - c * x - d * y])
        return shape.symmetric_difference(copy).area / shape.area

    angles = np.radians(np.arange(0, 360, 2))
    mirrored = min(other(np.cos(t), np.sin(t), np.sin(t), -np.cos(t)) for t in angles)
    large = angles[(angles > 0.5) & (angles < 2 * np.pi - 0.5)]
    turned = min(other(np.cos(t), -np.sin(t), np.sin(t), np.cos(t)) for t in large)
    # Shares of the area; a symmetric outline has 0.
    assert mirrored > 0.03
    assert turned > 0.03


# --- the surfaces -------------------------------------------------------------------------------


def test_nets_are_what_their_script_makes():
    for name, dome in (("net.json", 0.0), ("sketch.json", make_net.SKETCH_DOME)):
        points = json.loads((ROOF / name).read_text("utf-8"))["points"]
        np.testing.assert_array_equal(points, make_net.control_points(dome))


def test_sketch_is_not_viable_and_its_umbilics_are_named(site, sketch):
    outline, (surface, spec) = site[0], sketch
    traced = measured.traced(surface, outline, spec.edges)
    found = measured.viability(traced, outline)
    assert not found["viable"]
    assert found["edge_ratio"] > 10
    assert len(found["umbilics"]) >= 2
    jet = surface.jet(samples(surface, outline))
    usual = np.median(-np.diff(shape_data(jet).k, axis=1))
    for umbilic, place in zip(traced.umbilics.umbilics, found["umbilics"], strict=True):
        assert place["kind"] in ("star", "lemon", "monstar")
        assert outline.contains(np.array([place["point"]])).all()
        k = shape_data(surface.jet(np.array([umbilic.uv]))).k[0]
        assert abs(k[0] - k[1]) < 1e-6 * usual


def test_modified_surface_is_viable(site, roof):
    outline, (surface, spec) = site[0], roof
    found = measured.viability(measured.traced(surface, outline, spec.edges), outline)
    assert found["viable"]
    assert found["umbilics"] == []
    assert found["panels"] >= 700


def test_modified_surface_lies_within_three_metres_of_the_sketch(site, sketch, roof):
    outline, drawn, surface = site[0], sketch[0], roof[0]
    uv = samples(surface, outline)
    heights = measured.height_between(surface, drawn, uv)
    assert 1 < heights.max() <= 3
    # The height over a place in plan: x and y are the same there.
    here, there = surface.jet(uv).point, drawn.jet(uv).point
    np.testing.assert_allclose(here[:, :2], there[:, :2], atol=1e-12)
    assert (there[:, 2] - here[:, 2]).min() > -1e-12
    nearest = SurfaceReference(drawn).closest(here[::40])[0]
    assert (np.linalg.norm(nearest - here[::40], axis=1) <= heights[::40] + 1e-9).all()


def test_both_signs_of_curvature_take_a_tenth_of_the_area_each(site, roof):
    outline, surface = site[0], roof[0]
    found = measured.character(surface, outline)
    assert min(found.values()) >= 0.10
    # The second formula: K = det II / det I.
    jet = surface.jet(samples(surface, outline))
    area = np.sqrt(np.linalg.det(first_form(jet)))
    dome = area[np.linalg.det(second_form(jet)) > 0].sum() / area.sum()
    assert abs(dome - found["dome_share"]) < 0.01


# --- networks and parts -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def start(site, roof):
    return networks.start_of("principal", roof[0], site[0], networks.EDGE)


def test_panels_flatter_than_the_warp_allowed_stay_where_they_are(start):
    own = 1.01 * float(planarity_deviation(start.mesh).max())
    row = networks.made(start, "planar", own)
    assert row["moved_edges"] < 1e-9
    exact = networks.made(start, "planar")
    curve = networks.warp_curve(start, exact, (0.5 * own,))
    assert [point["reached"] for point in curve] == [True, True]
    assert curve[0]["flat_after_mm"] < 1e-8
    assert 0 < curve[1]["moved_edges"] < curve[0]["moved_edges"]


def test_parts_of_quads_and_triangles_add_up(site, roof, start):
    solution = optimized("conical", start.mesh, start.reference)
    conical = start.mesh.with_vertices(solution.blocks["vertices"])
    grid = networks.start_of("uv", roof[0], site[0], networks.EDGE)
    table = does_it_pay.compared(conical, grid.mesh)
    quads, triangles = table["conical quads"], table["triangles"]
    assert triangles["panels"] == 2 * quads["panels"]
    assert triangles["area, m2"] == pytest.approx(quads["area, m2"], rel=1e-12)
    # The smallest rectangle around a triangle stands on its longest side: half of it is waste.
    assert triangles["waste of stock, %"] == pytest.approx(50.0, abs=1e-9)
    # Every beam has a joint on both sides, but on the rim.
    rim = conical.edge_lengths[conical.topology.is_boundary_edge].sum()
    for found in (quads, triangles):
        beams, joints = found["beam, m per m2"], found["joint, m per m2"]
        total = found["area, m2"]
        assert joints * total == pytest.approx(2 * beams * total - rim, rel=1e-9)
    assert quads["beams at an inner node"] == 4.0
    assert triangles["beams at an inner node"] > 5.9
    assert quads["largest twist, deg"] < 1e-6 < triangles["largest twist, deg"]
    assert quads["out of plane, mm"] < 1e-8 < table["parameter grid"]["out of plane, mm"]
