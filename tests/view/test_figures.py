from __future__ import annotations

import io
import struct
import sys

import matplotlib.image
import numpy as np
import pytest
from shapes import curved_mesh, polygon_mesh

from pqmesh.errors import MeshError, PqmeshError
from pqmesh.fabricate.trim import trimmed_panels
from pqmesh.fabricate.unroll import unrolled_strip
from pqmesh.mesh.exact import grid_mesh, rotational_mesh
from pqmesh.mesh.measure import fitted_cones, planarity_deviation
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import trace_principal_network
from pqmesh.network.region import PlanOutline
from pqmesh.surface.analytic import ellipsoid, sphere, torus
from pqmesh.surface.formula import graph_surface
from pqmesh.surface.umbilics import Umbilic
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.crosses import cross_arms
from pqmesh.view.figures import (
    NamedNetwork,
    Series,
    Surroundings,
    chart_figure,
    comparison_figure,
    difference_figure,
    directions_figure,
    layers_figure,
    layout_figure,
    measure_figure,
    network_figure,
    networks_figure,
    node_figure,
    site_figure,
    strips_figure,
    typical_node,
    viability_figure,
)
from pqmesh.view.measures import vertex_cells
from pqmesh.view.patches import surface_patches
from pqmesh.view.plan import level_pieces
from pqmesh.view.scene import Scene
from pqmesh.view.sheet import ColorScale

WORDS = {"label": "distance of diagonals", "unit": "mm", "units": "m"}


def size_of(png):
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", png[16:24])


def pixels_of(png):
    return matplotlib.image.imread(io.BytesIO(png))[..., :3]


def offset(mesh, distance):
    move = mesh.vertex_normals.copy()
    cones = fitted_cones(mesh)
    move[cones.vertices] = cones.vectors
    return mesh.with_vertices(mesh.vertices + distance * move)


def webs(mesh, layer):
    a, b = mesh.edges.T
    corners = (mesh.vertices[a], mesh.vertices[b], layer.vertices[b], layer.vertices[a])
    return np.stack(corners, axis=1)


def closed_torus():
    turn = np.arange(12) * 2 * np.pi / 12
    profile = np.column_stack([6 + 2 * np.cos(turn), 2 * np.sin(turn)])
    around = np.arange(20) * 2 * np.pi / 20
    return rotational_mesh(profile, around, closed=True, closed_profile=True)


@pytest.fixture(scope="module")
def ring():
    surface = torus(6.0, 2.0)
    return trace_principal_network(surface, (3.0, 3.0))


# --- every figure -----------------------------------------------------------------------------


def figures(ring):
    mesh = curved_mesh(6, 5)
    layers = [offset(mesh, 0.2), offset(mesh, 0.4)]
    support = webs(mesh, layers[-1])
    flat = np.zeros(mesh.topology.n_faces)
    values = planarity_deviation(mesh)
    outline = PlanOutline([[-4, -7], [7, -6], [6, 7], [-7, 3]])
    drum = rotational_mesh([[1.0, 0.0], [1.6, 0.5], [1.7, 1.5]], 0.4 * np.arange(7))
    rows = sorted(drum.topology.strips, key=len, reverse=True)
    umbilic = Umbilic((0.0, 0.0), (8.0, 0.0, 0.0), -0.5, "star")
    far = Umbilic((0.0, 0.0), (-8.0, 0.0, -0.5), 0.5, "monstar")
    return {
        "network": lambda: network_figure(ring, units="m"),
        "network in outline": lambda: network_figure(
            ring, quads_from_network(ring), region=outline, umbilics=[umbilic, far], units="m"
        ),
        "viability": lambda: viability_figure(ring.surface, outline, units="m"),
        "measure": lambda: measure_figure(mesh, values, **WORDS),
        "before and after": lambda: comparison_figure(mesh, mesh, values, flat, **WORDS),
        "layers": lambda: layers_figure(mesh, layers, support, units="m"),
        "layers without support": lambda: layers_figure(mesh, layers[:1], None, units="m"),
        "node": lambda: node_figure(mesh, layers, support, typical_node(mesh), units="m"),
        "strips": lambda: strips_figure(drum, [unrolled_strip(drum, rows[0])], units="m"),
    }


@pytest.mark.parametrize("name", figures(None))
def test_figure_is_png_of_stated_size_and_repeats_byte_for_byte(ring, name):
    draw = figures(ring)[name]
    first = draw()
    assert size_of(first) == (1600, 1000)
    assert draw() == first


def test_figure_ignores_and_keeps_settings_of_the_user(ring):
    mesh = curved_mesh(3, 2)
    plain = measure_figure(mesh, planarity_deviation(mesh), **WORDS)
    with matplotlib.rc_context({"font.size": 31.0, "patch.antialiased": False}):
        assert measure_figure(mesh, planarity_deviation(mesh), **WORDS) == plain
        assert matplotlib.rcParams["font.size"] == 31.0


def test_figure_without_matplotlib_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    mesh = curved_mesh(3, 2)
    with pytest.raises(PqmeshError, match=r"pqmesh\[viz\]"):
        measure_figure(mesh, planarity_deviation(mesh), **WORDS)


# --- measures ---------------------------------------------------------------------------------


def test_measure_figure_colors_the_largest_face_apart():
    mesh = grid_mesh(np.stack([*np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij"),
                               np.zeros((4, 3))], -1))  # fmt: skip
    top = Camera.orbit(mesh.vertices.mean(axis=0), -np.pi / 2, np.pi / 2)
    values = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.5])
    picture = pixels_of(measure_figure(mesh, values, camera=top, **WORDS))
    view = View.fitted(top, mesh.vertices, Box(60, 125, 1540, 880))
    x, y = view.pixels(mesh.face_centers)[:, :2].round().astype(int).T
    colors = picture[1000 - y, x]
    assert np.allclose(colors[[0, 1, 3]], colors[4], atol=0.02)
    brightness = colors.mean(axis=1)
    assert brightness[2] < brightness[5] - 0.1 < brightness[0] - 0.2


def test_color_scale_maps_values_in_order_and_missing_ones_to_grey():
    scale = ColorScale.of(np.array([0.0, 2.0, np.nan]))
    assert (scale.low, scale.high) == (0.0, 2.0)
    colors = scale.colors(np.array([0.0, 1.0, 2.0, 9.0, np.nan]))
    assert (np.diff(colors[:3].mean(axis=1)) < 0).all()
    assert np.array_equal(colors[2], colors[3])
    assert np.ptp(colors[4]) == 0


def test_color_scale_spans_at_most_six_decades():
    scale = ColorScale.of(np.array([1e-15, 0.0, 3.0]), log=True)
    assert scale.clipped
    assert scale.high / scale.low <= 10.0**7
    assert scale.ticks()[0] >= scale.low * 0.99
    assert np.array_equal(scale.shares(np.array([0.0, scale.low, scale.high])), [0.0, 0.0, 1.0])


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("value", [0.0, np.nan, -3.0, 1e-300])
def test_measure_figure_takes_constant_and_missing_values(value, log):
    mesh = curved_mesh(3, 2)
    values = np.full(mesh.topology.n_faces, value)
    assert size_of(measure_figure(mesh, values, log=log, **WORDS)) == (1600, 1000)


def test_measure_figure_takes_vertex_values_and_polygons():
    mesh = polygon_mesh()
    values = mesh.vertices[:, 0]
    assert size_of(measure_figure(mesh, values, **WORDS)) == (1600, 1000)


def test_vertex_cells_tile_the_faces():
    mesh = curved_mesh(3, 2)
    cells, vertices, faces = vertex_cells(mesh)
    assert np.array_equal(cells[:, 0], mesh.vertices[vertices])
    assert np.array_equal(cells[:, 2], mesh.face_centers[faces])
    sums = np.zeros((mesh.topology.n_faces, 3))
    diagonals = np.cross(cells[:, 2] - cells[:, 0], cells[:, 3] - cells[:, 1])
    np.add.at(sums, faces, 0.5 * diagonals)
    assert np.allclose(sums, mesh.face_area_vectors)


def test_measure_figure_refuses_values_of_wrong_length():
    mesh = curved_mesh(3, 2)
    with pytest.raises(MeshError, match=r"shape \(6,\) for each face or \(12,\) for each vertex"):
        measure_figure(mesh, np.zeros(7), **WORDS)
    with pytest.raises(MeshError, match="for each vertex; found"):
        measure_figure(mesh, np.zeros(6), at="vertex", **WORDS)
    with pytest.raises(MeshError, match="'face' or 'vertex'"):
        measure_figure(mesh, np.zeros(6), at="edge", **WORDS)


def test_measure_figure_asks_where_values_of_a_torus_belong():
    mesh = closed_torus()
    values = mesh.face_centers[:, 2] ** 2
    with pytest.raises(MeshError, match="as many faces as vertices"):
        measure_figure(mesh, values, **WORDS)
    assert measure_figure(mesh, values, at="face", **WORDS) != measure_figure(
        mesh, values, at="vertex", **WORDS
    )


def test_comparison_figure_refuses_values_of_the_other_mesh():
    one, two = curved_mesh(3, 2), curved_mesh(4, 2)
    with pytest.raises(MeshError, match=r"found \(6,\)"):
        comparison_figure(one, two, np.zeros(6), np.zeros(6), **WORDS)


# --- surfaces ---------------------------------------------------------------------------------


def test_viability_figure_draws_surfaces_with_and_without_umbilics():
    surface = ellipsoid(3.0, 2.0, 1.2)
    x, z = 3.0 * np.sqrt(5.0 / 7.56), 1.2 * np.sqrt(2.56 / 7.56)
    found = [Umbilic((0.0, 0.0), (x, 0.0, side * z), 0.5, "lemon") for side in (1.0, -1.0)]
    plain = viability_figure(surface, units="m")
    assert plain != viability_figure(surface, None, found, units="m")
    assert size_of(viability_figure(sphere(), None, (), units="m")) == (1600, 1000)


def test_surface_patches_cut_the_surface_exactly_along_the_region():
    surface = torus(6.0, 2.0)
    outline = PlanOutline([[-4, -7], [7, -6], [6, 7], [-7, 3]])
    patches = surface_patches(surface, outline.on(surface), 3000)
    for points in patches.rim[:, 0, :2]:
        ring = outline.polygon
        along = np.roll(ring, -1, axis=0) - ring
        t = np.clip(((points - ring) * along).sum(axis=1) / (along**2).sum(axis=1), 0, 1)
        # 14 bisections of a cell about 0.4 long.
        assert np.linalg.norm(ring + t[:, None] * along - points, axis=1).min() < 1e-4
    whole = surface_patches(surface, lambda uv: np.ones(len(uv), dtype=bool), 3000)
    assert not len(whole.outer)
    assert not len(whole.rim)
    assert len(patches.inner) < len(whole.inner) < len(patches.inner) + len(patches.outer) + 1


def test_scene_tells_what_is_behind():
    view = View.fitted(Camera(np.zeros(3), np.eye(3)), np.eye(3), Box(0, 0, 100, 100))
    scene = Scene(view)
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]]])
    scene.add(square, np.ones(4), np.ones(4), 1.0)
    points = np.array([[0.5, 0.5, -1.0], [0.5, 0.5, 1.0], [2.0, 0.5, -1.0]])
    assert scene.hides(points, 0.1).tolist() == [True, False, False]


# --- layers and nodes -------------------------------------------------------------------------


def test_layers_figure_refuses_what_does_not_fit():
    mesh = curved_mesh(3, 2)
    layer = offset(mesh, 0.2)
    with pytest.raises(MeshError, match="at least one layer"):
        layers_figure(mesh, [], None, units="m")
    with pytest.raises(MeshError, match="layer 1 has others"):
        layers_figure(mesh, [curved_mesh(4, 2)], None, units="m")
    with pytest.raises(MeshError, match=r"shape \(17, 4, 3\)"):
        layers_figure(mesh, [layer], np.zeros((3, 4, 3)), units="m")


def test_node_figure_refuses_boundary_vertices():
    mesh = curved_mesh(3, 2)
    for vertex in (0, 99, -1):
        with pytest.raises(MeshError, match=f"found vertex {vertex}"):
            node_figure(mesh, [offset(mesh, 0.2)], None, vertex, units="m")


def test_layers_and_node_figures_draw_closed_meshes_and_layers_below():
    mesh = closed_torus()
    layers = [offset(mesh, -0.2), mesh, offset(mesh, 0.3)]
    support = webs(layers[0], layers[2])
    assert size_of(layers_figure(mesh, layers, support, units="m")) == (1600, 1000)
    assert size_of(node_figure(mesh, layers, support, 5, units="m")) == (1600, 1000)


def test_typical_node_is_inside_and_missing_on_a_strip():
    mesh = curved_mesh(6, 5)
    assert not mesh.topology.is_boundary_vertex[typical_node(mesh)]
    assert 0 <= typical_node(closed_torus()) < 240
    with pytest.raises(MeshError, match="interior vertex"):
        typical_node(curved_mesh(1, 6))


# --- sites, crosses, comparisons, charts ----------------------------------------------------------


SITE = PlanOutline([[-0.5, -0.4], [0.6, -0.5], [0.5, 0.45], [-0.45, 0.5]])
AROUND = Surroundings(
    (np.array([[0.7, -0.4], [1.0, -0.4], [1.0, 0.3], [0.7, 0.3]]),),
    (("Hall", (0.85, 0.0)), ("Far away", (9.0, 9.0))),
)


def hill():
    return graph_surface("0.6 - 0.4*x**2 - 0.2*y**2 + 0.1*x*y", (-0.9, 0.9), (-0.8, 0.8))


def hill_network():
    surface = hill()
    return trace_principal_network(surface, (0.1, 0.1), SITE.on(surface))


def hill_panels():
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, 17), np.linspace(-0.7, 0.7, 15), indexing="ij")
    mesh = grid_mesh(np.stack([x, y, 0.2 * x**2 - 0.1 * y**2], -1))
    return trimmed_panels(mesh, SITE, 0.1)


@pytest.mark.parametrize(
    "draw",
    [
        lambda: site_figure(hill(), SITE, AROUND, units="m"),
        lambda: layout_figure(hill_panels(), AROUND, units="m"),
        lambda: directions_figure(hill(), SITE, units="m"),
        lambda: difference_figure(
            hill_network(), lambda uv: uv[:, 0] ** 2, region=SITE, label="below", units="m"
        ),
        lambda: networks_figure(
            [NamedNetwork("one", hill_network(), ("a", "b"))] * 3, region=SITE, units="m"
        ),
        lambda: chart_figure(
            [Series("s", "#c2452d", {0.0: 3.0, 1.0: 0.0}, frozenset([1.0]))],
            across="x (mm)",
            up="y (mm)",
            least=0.1,
        ),
    ],
    ids=["site", "layout", "directions", "difference", "networks", "chart"],
)
def test_picture_has_its_size_and_the_same_bytes_twice(draw):
    first = draw()
    assert size_of(first) == (1600, 1000)
    assert first == draw()


def test_buildings_are_on_the_site_that_has_them():
    with_buildings = pixels_of(site_figure(hill(), SITE, AROUND, units="m", caption=" "))
    alone = pixels_of(site_figure(hill(), SITE, units="m", caption=" "))
    building = np.array([int("bdb6aa"[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0

    def amount(pixels):
        return int((np.abs(pixels - building).max(axis=2) < 0.004).sum())

    assert amount(with_buildings) > 20 * amount(alone)


def test_cut_panels_and_slivers_have_their_colours():
    panels = hill_panels()
    assert panels.is_trimmed.any()
    assert len(panels.slivers)
    pixels = pixels_of(layout_figure(panels, units="m"))
    red = (pixels[..., 0] > 0.6) & (pixels[..., 1] < 0.35)
    sand = (pixels[..., 0] > 0.8) & (pixels[..., 2] < 0.55) & (pixels[..., 1] > 0.6)
    # Their plan areas, as shares of the cut area, appear as pixels of their colours.
    slivers = panels.area_plan[panels.slivers].sum()
    cut = panels.area_plan[panels.is_trimmed].sum() - slivers
    assert sand.sum() > 3000
    assert abs(red.sum() / sand.sum() - slivers / cut) < 0.1


def test_lines_of_equal_height_lie_at_their_heights():
    patches = surface_patches(hill(), SITE.on(hill()))
    levels = level_pieces(patches.inner, 0.05)
    assert len(levels) >= 4
    for index, pieces in levels.items():
        np.testing.assert_allclose(pieces[..., 2], 0.05 * index, atol=1e-14)


def test_crosses_shrink_towards_an_umbilic():
    surface = graph_surface("x**2 + y**2 + x**3", (-0.5, 0.5), (-0.5, 0.5))
    first, second = cross_arms(surface, lambda uv: np.ones(len(uv), dtype=bool), 0.05)
    length = np.linalg.norm(np.diff(first, axis=1)[:, 0], axis=1)
    across = np.einsum("ni,ni->n", np.diff(first, axis=1)[:, 0], np.diff(second, axis=1)[:, 0])
    nearest = np.linalg.norm(first.mean(axis=1)[:, :2], axis=1).argmin()
    assert length[nearest] < 0.25 * length.max()
    # Principal directions are at right angles.
    np.testing.assert_allclose(across, 0.0, atol=1e-12)
