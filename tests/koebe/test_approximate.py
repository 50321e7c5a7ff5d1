"""Approximation of surface patches: exact where the surface allows, honest where not."""

import re

import numpy as np
import pytest

from pqmesh.errors import NetworkError
from pqmesh.koebe.approximate import FitWeights, approximate_edge_offset
from pqmesh.koebe.best import HELD, edge_offset_solution
from pqmesh.koebe.edge_offset import edge_offset_test
from pqmesh.koebe.families import square_koebe
from pqmesh.koebe.square_patch import square_edges, square_patch
from pqmesh.koebe.terms import Tangency
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.network.kinds import trace_network
from pqmesh.network.meshing import quads_from_network
from pqmesh.offset.distances import edge_distance
from pqmesh.optimize.problem import gathered
from pqmesh.optimize.terms.parallel import EdgeParallel
from pqmesh.surface.analytic import shape_surface
from pqmesh.surface.closest import closest_point
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.formula import graph_surface
from pqmesh.surface.reference import TriangleReference
from pqmesh.surface.umbilics import conjugacy_defect
from pqmesh.vectors import cross, dot, norm, unit

SIX = (-6.0, 6.0)
DOME = (graph_surface("-0.05*x**2-0.08*y**2", SIX, SIX), (0.3, 0.2), (1.5, 2.0))
SADDLE = (graph_surface("0.1*x*y", SIX, SIX), (0.0, 0.0), (2.0, 2.0))
FREE = (
    graph_surface("-0.05*x**2-0.1*y**2+0.001*x**3*y+0.003*x*y**2-0.001*y**4", SIX, SIX),
    (0.3, 0.2),
    (1.5, 1.5),
)


def fitted(case, faces, **options):
    surface, center, extent = case
    patch = square_patch(surface, np.array(center), extent, faces)
    return patch, approximate_edge_offset(surface, patch.mesh, patch.uv, **options)


# --- the start ----------------------------------------------------------------------------------


@pytest.mark.parametrize("case", [DOME, SADDLE, FREE])
def test_square_patch_follows_curvature_lines(case):
    surface, center, extent = case
    patch = square_patch(surface, np.array(center), extent, 10)
    assert np.abs(surface.jet(patch.uv).point - patch.mesh.vertices).max() < 1e-12
    # Two edges of an inner vertex along the grid, as parameter differences: principal and so
    # conjugate up to the size of the edges.
    inner = next(star for star in patch.mesh.topology.stars() if star.neighbors.shape[1] == 4)
    steps = patch.uv[inner.neighbors] - patch.uv[inner.vertices][:, None]
    defect = conjugacy_defect(
        surface, patch.uv[inner.vertices], steps[:, 0] - steps[:, 2], steps[:, 1] - steps[:, 3]
    )
    assert np.abs(defect).max() < 5e-3
    jet = surface.jet(patch.uv[inner.vertices])
    assert (dot(patch.mesh.vertex_normals[inner.vertices], shape_data(jet).normal) > 0.99).all()


@pytest.mark.parametrize("case", [DOME, SADDLE])
def test_gauss_image_of_quadrics_can_be_spaced_into_squares(case):
    # Quadrics are L-isothermic: the third fundamental form is conformal in curvature lines.
    surface, center, extent = case
    patch = square_patch(surface, np.array(center), extent, 12)
    assert patch.defect < 1e-5
    normals = shape_data(surface.jet(patch.uv)).normal
    a, b, c, d = (normals[patch.mesh.faces[:, k]] for k in range(4))
    ratio = np.log(norm(b - a) + norm(c - d)) - np.log(norm(c - b) + norm(d - a))
    # One common factor remains, since the number of faces along the other family is whole.
    assert np.ptp(np.abs(ratio)) < 2e-3
    assert np.abs(ratio).max() < 0.1


def test_defect_of_other_surfaces_does_not_fade_with_refinement():
    surface, center, extent = FREE
    defects = [square_patch(surface, np.array(center), extent, n).defect for n in (6, 12)]
    assert min(defects) > 0.05
    assert abs(defects[0] - defects[1]) < 1e-12


def test_surface_of_revolution_has_a_square_patch():
    torus = shape_surface("torus", R=3.0, r=1.0)
    patch = square_patch(torus, np.array([0.4, 0.3]), (0.4, 0.7), 8)
    assert patch.defect < 1e-4


def test_patch_that_leaves_the_surface_is_refused():
    surface, center, _ = DOME
    with pytest.raises(NetworkError, match="line through the center ends after"):
        square_patch(surface, np.array(center), (9.0, 9.0), 8)


def test_surface_with_a_vanishing_curvature_is_refused():
    tube = graph_surface("-0.1*x**2", SIX, SIX)
    with pytest.raises(NetworkError, match="the normal hardly turns"):
        square_patch(tube, np.array([0.1, 0.2]), (1.0, 1.0), 6)


def test_network_with_square_edges_comes_near_to_a_quadric_too():
    # A region of any rim instead of a patch; long faces of the Gauss image would spoil it.
    surface = graph_surface("-0.05*x**2-0.08*y**2", (-2.0, 2.0), (-2.0, 2.0))
    edge = square_edges(surface, surface.domain.grid(5, 5).reshape(-1, 2), 0.32)
    assert edge[0] > edge[1]
    found = quads_from_network(trace_network("principal", surface, edge))
    wide = graph_surface("-0.05*x**2-0.08*y**2", SIX, SIX)
    fit = approximate_edge_offset(wide, found.mesh, found.uv)
    assert fit.figures["deviation_max_pct"] < 0.5
    assert fit.figures["offset_error_max"] < 1e-12
    long_faces = quads_from_network(trace_network("principal", surface, edge[::-1]))
    worse = approximate_edge_offset(wide, long_faces.mesh, long_faces.uv)
    assert worse.figures["deviation_max_pct"] > 10 * fit.figures["deviation_max_pct"]


def test_edges_across_a_parabolic_line_are_refused():
    surface = graph_surface("x**3 + y**2", (-1.0, 1.0), (-1.0, 1.0))
    with pytest.raises(NetworkError, match="must keep their signs"):
        square_edges(surface, surface.domain.grid(4, 4).reshape(-1, 2), 0.1)


# --- what is reached ----------------------------------------------------------------------------


@pytest.mark.parametrize(("case", "percent"), [(DOME, 0.02), (SADDLE, 1e-3), (FREE, 1.0)])
def test_edge_offset_mesh_comes_near_and_is_exact(case, percent):
    _, fit = fitted(case, 12)
    figures = fit.figures
    assert figures["deviation_max_pct"] < percent
    assert figures["deviation_rms_pct"] <= figures["member_rms_pct"]
    assert figures["tangency_max"] < 1e-13
    assert figures["parallel_max"] < 1e-12
    assert figures["offset_error_max"] < 1e-12
    assert planarity(fit.mesh).max() < 1e-11
    moved = fit.mesh.with_vertices(fit.mesh.vertices + 0.3 * fit.image.vertices)
    assert np.abs(edge_distance(fit.mesh, moved) - 0.3).max() < 1e-12


def test_approximation_passes_the_edge_offset_test():
    _, fit = fitted(DOME, 8)
    found = edge_offset_test(fit.mesh)
    assert found.exists
    sign = np.sign((found.image * fit.image.vertices).sum())
    assert np.abs(sign * found.image - fit.image.vertices).max() < 1e-8


def test_deviation_is_measured_on_the_surface_and_both_ways():
    surface, _, _ = FREE
    _, fit = fitted(FREE, 8)
    x, y, z = fit.mesh.vertices.T
    height = z - surface.jet(np.column_stack([x, y])).point[:, 2]
    assert np.abs(fit.deviation - np.abs(height)).max() < 0.1 * np.abs(height).max()
    # The start is covered where the mesh has not slid away from it.
    assert fit.figures["uncovered_max_pct"] < 150.0
    assert (fit.uncovered >= 0).all()


def test_free_surface_keeps_a_distance_that_refinement_does_not_lower():
    coarse, fine = (fitted(FREE, n)[1] for n in (8, 16))
    assert 0.4 < fine.deviation.max() / coarse.deviation.max() < 2.5


def test_panels_stay_off_the_surface_by_the_rise_of_its_curves():
    # The middle of a flat panel of a dome: (k_1 e_1^2 + k_2 e_2^2) / 8 beneath it.
    _, fit = fitted(DOME, 10)
    surface = DOME[0]
    edges = fit.mesh.edge_vectors[fit.mesh.topology.face_edges].reshape(-1, 4, 3)
    jet = closest_point(surface, fit.mesh.face_centers).jet
    shape = shape_data(jet)
    rise = np.zeros(len(edges))
    for side in (0, 1):
        mean = 0.5 * (norm(edges[:, side]) + norm(edges[:, side + 2]))
        along = np.abs(np.einsum("fdi,fi->fd", shape.directions, unit(edges[:, side])))
        rise += np.abs(shape.k[np.arange(len(rise)), along.argmax(axis=1)]) * mean**2 / 8
    assert np.abs(fit.panel_deviation / rise - 1.0).max() < 0.02


def test_faces_that_are_broken_twice_are_counted_once():
    # A net of asymptotic lines: the nearest mesh with edge offsets is folded all over.
    u, v = np.meshgrid(np.linspace(-1, 1, 6), np.linspace(-1, 1, 6), indexing="ij")
    start = grid_mesh(np.stack([u, v, u * v], axis=-1))
    itself = TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    found, _ = edge_offset_solution(start, itself, start.vertex_normals, weights=HELD)
    count = int(re.search(r"the nearest has (\d+) broken faces", found.reason).group(1))
    assert not found.converged
    assert 0 < count <= start.topology.n_faces


def test_stronger_anchor_slides_less():
    _, loose = fitted(FREE, 8)
    _, held = fitted(FREE, 8, weights=FitWeights(anchor=30.0))
    assert held.figures["moved_max_pct"] < loose.figures["moved_max_pct"]


def test_no_joint_steps_leave_the_linear_fit():
    values = []
    _, fit = fitted(FREE, 6, most_steps=0, progress=lambda _, value: values.append(value))
    assert fit.steps == 0
    assert values == []
    assert np.array_equal(fit.deviation, fit.member_deviation)
    _, better = fitted(FREE, 6, progress=lambda _, value: values.append(value))
    assert better.steps == len(values) > 0
    assert (np.diff(values) < 0).all()


# --- terms --------------------------------------------------------------------------------------


def slopes(term, blocks):
    """Jacobian by central differences, (m, r, k, 3)."""
    rows = gathered(term, blocks)
    step, parts = 1e-6, []
    for k in range(rows.shape[1]):
        for axis in range(3):
            shift = np.zeros_like(rows)
            shift[:, k, axis] = step
            change = term.evaluate(rows + shift)[0] - term.evaluate(rows - shift)[0]
            parts.append(change / (2 * step))
    stacked = np.stack(parts, axis=-1)
    return stacked.reshape(*stacked.shape[:2], rows.shape[1], 3)


def test_jacobians_of_the_joint_terms():
    image = square_koebe(4, 4, 0.2, (-0.3, -0.2))
    rng = np.random.default_rng(0)
    mesh = image.with_vertices(2.0 * image.vertices + 0.05 * rng.normal(size=image.vertices.shape))
    rough = image.vertices + 0.03 * rng.normal(size=image.vertices.shape)
    blocks = {"vertices": mesh.vertices, "image": rough}
    for term in (EdgeParallel.on(mesh, image), Tangency.on(image)):
        residual, jacobian = term.evaluate(gathered(term, blocks))
        assert np.abs(residual).max() > 1e-3
        assert np.abs(jacobian - slopes(term, blocks)).max() < 1e-6 * np.abs(jacobian).max()


def test_joint_terms_vanish_on_an_exact_pair():
    image = square_koebe(4, 4, 0.2, (-0.3, -0.2))
    mesh = image.with_vertices(-2.0 * image.vertices)
    blocks = {"vertices": mesh.vertices, "image": image.vertices}
    for term in (EdgeParallel.on(mesh, image), Tangency.on(image)):
        assert np.abs(term.evaluate(gathered(term, blocks))[0]).max() < 1e-13


def test_parallel_term_is_the_sine_for_edges_of_mean_length():
    image = square_koebe(2, 2, 0.2, (-0.1, -0.1))
    turned = image.with_vertices(
        image.vertices + 0.1 * cross(np.tile([0.0, 0.0, 1.0], (4, 1)), image.vertices)
    )
    term = EdgeParallel.on(image, turned)
    residual, _ = term.evaluate(
        gathered(term, {"vertices": image.vertices, "image": turned.vertices})
    )
    assert np.abs(norm(residual) - np.sin(np.arctan(0.1))).max() < 1e-3
