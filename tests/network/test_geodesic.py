"""Geodesics against exact ones, their focal points, and the networks that they make."""

import math

import numpy as np
import pytest

from pqmesh.errors import NetworkError
from pqmesh.mesh.measure import flipped_faces
from pqmesh.network.geodesic import NARROWEST
from pqmesh.network.jacobi import trace_geodesics
from pqmesh.network.kinds import Given, trace_network
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.region import PlanOutline
from pqmesh.network.trace import End, Limits
from pqmesh.surface.analytic import catenoid, cone, cylinder, moved, sphere, torus
from pqmesh.surface.base import Domain
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.vectors import norm

FINE = Limits(step=0.15, length=20.0, tolerance=5e-11, turn=0.02)
GLOBE = sphere(v=(-1.4, 1.4))


def started(surface, n, seed=0):
    """Seeds and unit start directions."""
    rng = np.random.default_rng(seed)
    seeds = surface.domain.low + surface.domain.size * rng.uniform(0.1, 0.9, (n, 2))
    turn = rng.uniform(0.0, 2.0 * math.pi, (n, 1))
    axes = shape_data(surface.jet(seeds)).directions
    return seeds, np.cos(turn) * axes[:, 0] + np.sin(turn) * axes[:, 1]


def on_lines(lines, per_step=5):
    segment = np.repeat(np.arange(len(lines.arc)), per_step)
    theta = np.tile(np.linspace(0.0, 1.0, per_step), len(lines.arc))
    return segment, theta


def places(surface, lines):
    """Places on all lines, dense output and joints alike, and the line of each."""
    segment, theta = on_lines(lines)
    uv = surface.domain.reduce(lines.at(segment, theta))
    return surface.jet(uv).point, lines.line_of[segment]


# --- single geodesics -------------------------------------------------------------------------


def test_geodesics_of_a_sphere_are_great_circles():
    seeds, directions = started(GLOBE, 40)
    lines = trace_geodesics(GLOBE, seeds, directions, FINE)
    points, owner = places(GLOBE, lines)
    poles = np.cross(GLOBE.jet(seeds).point, directions)
    assert np.abs((points * poles[owner]).sum(axis=1)).max() < 1e-8
    # Circles that stay clear of the chart's bounds close after a full turn.
    clear = np.abs(poles[:, 2]) > math.cos(1.35)
    assert lines.closed[clear].all()
    assert clear.sum() > 3
    assert lines.total[clear] == pytest.approx(2.0 * math.pi, abs=1e-8)


def test_geodesics_of_a_plane_are_straight_in_any_chart():
    bent = FormulaSurface("u + 0.3*v*v", "sinh(v)", "0.5*u + 0.15*v*v", Domain((0, 1), (0, 1)))
    seeds, directions = started(bent, 20)
    points, owner = places(bent, trace_geodesics(bent, seeds, directions, FINE))
    away = np.cross(points - bent.jet(seeds).point[owner], directions[owner])
    assert norm(away).max() < 1e-8


@pytest.mark.parametrize(
    ("surface", "developed"),
    [
        (cylinder(v=(0, 4)), lambda uv: uv),
        # A cone of half angle 30 degrees develops to a sector: radius 2 rho at half the angle.
        (
            cone(half_angle=math.pi / 6, v=(0.3, 2)),
            lambda uv: uv[:, 1:] * np.column_stack([np.cos(uv[:, 0] / 2), np.sin(uv[:, 0] / 2)]),
        ),
    ],
    ids=["cylinder", "cone"],
)
def test_geodesics_of_developable_surfaces_are_straight_when_developed(surface, developed):
    seeds, directions = started(surface, 20)
    lines = trace_geodesics(surface, seeds, directions, FINE)
    segment, theta = on_lines(lines)
    flat = developed(lines.at(segment, theta))
    for line in range(len(lines)):
        chord = flat[lines.line_of[segment] == line]
        chord = chord - chord[0]
        along = chord[norm(chord).argmax()]
        away = chord[:, 0] * along[1] - chord[:, 1] * along[0]
        assert np.abs(away).max() < 1e-8 * norm(along)


def test_equators_of_a_torus_close_and_others_keep_clairauts_constant():
    surface = torus(3.0, 1.0)
    seeds = np.array([[0.3, 0.0], [0.3, math.pi]])
    limits = FINE._replace(length=60.0)
    lines = trace_geodesics(surface, seeds, surface.jet(seeds).du, limits)
    assert lines.closed.all()
    assert lines.total == pytest.approx([8.0 * math.pi, 4.0 * math.pi], abs=1e-7)
    seeds, directions = started(surface, 20)
    lines = trace_geodesics(surface, seeds, directions, FINE)
    segment, theta = on_lines(lines, 2)
    jet = surface.jet(surface.domain.reduce(lines.at(segment, theta)))
    slope = lines.slope(segment, theta) / lines.length[segment, None]
    tangent = jet.du * slope[:, :1] + jet.dv * slope[:, 1:]
    constant = jet.point[:, 0] * tangent[:, 1] - jet.point[:, 1] * tangent[:, 0]
    owner = lines.line_of[segment]
    assert max(np.ptp(constant[owner == i]) for i in range(20)) < 1e-7
    assert norm(tangent) == pytest.approx(1.0, abs=1e-7)


def test_error_of_a_geodesic_falls_with_the_fifth_power_of_the_step():
    seeds, direction = np.array([[1.0, 0.2]]), np.array([[0.3, 0.4, 1.0]])
    normal = GLOBE.jet(seeds).point
    direction -= (direction * normal).sum() * normal
    direction /= norm(direction)
    errors = []
    for step in (0.1, 0.05, 0.025):
        # A tolerance that accepts every step: all but the first few are of full length.
        limits = Limits(step=step, length=1.0, tolerance=1e3, turn=1e-9)
        lines = trace_geodesics(GLOBE, seeds, direction, limits)
        joints = GLOBE.jet(GLOBE.domain.reduce(lines.joints(0))).point
        arcs = np.append(lines.arc, lines.total[0])
        arcs = arcs - arcs[norm(joints - normal).argmin()]
        exact = np.cos(arcs)[:, None] * normal + np.sin(arcs)[:, None] * direction
        errors.append(norm(joints - exact).max())
    order = np.log2(np.divide(errors[:-1], errors[1:]))
    assert ((order > 4.7) & (order < 5.6)).all(), order


def test_lines_end_exactly_at_the_bounds():
    seeds, directions = started(GLOBE, 60)
    lines = trace_geodesics(GLOBE, seeds, directions, FINE)
    ends = [lines.joints(i)[-1, 1] for i in np.flatnonzero(lines.ends[:, 1] == End.BOUNDARY)]
    assert len(ends) > 5
    assert np.abs(np.abs(ends) - 1.4).max() < 1e-12


# --- focusing ---------------------------------------------------------------------------------


def test_jacobi_field_of_a_sphere_is_the_cosine():
    seeds, directions = np.array([[1.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    wide = sphere(radius=2.0, v=(-1.56, 1.56))
    for least in (0.8, NARROWEST, 0.0):
        lines = trace_geodesics(wide, seeds, directions, FINE, max(least, 0.02))
        assert (lines.ends == End.FOCAL).all()
        assert lines.total[0] == pytest.approx(4.0 * math.acos(max(least, 0.02)), abs=1e-3)


def test_geodesics_of_negative_curvature_never_focus():
    network = trace_network("geodesic", catenoid(), (0.2, 0.2))
    assert network.focal == ()
    assert not any((lines.ends == End.FOCAL).any() for lines in network.families)


def test_families_of_a_sphere_focus_a_quarter_circle_from_their_start_curves():
    surface = moved(sphere(v=(-1.45, 1.45)), scale=2.0, translation=(0, 0, 5))
    surface = moved(surface, rotation=[[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    given = Given(direction=0.7, through=(5.2, 0.3))
    network = trace_network("geodesic", surface, (0.3, 0.3), None, given)
    centre = np.array([5.0, 0.0, 0.0])
    assert {family for family, _, _ in network.focal} == {0, 1}
    for family in (0, 1):
        uv = np.array([uv for f, uv, _ in network.focal if f == family])
        points = np.array([point for f, _, point in network.focal if f == family])
        np.testing.assert_allclose(surface.jet(uv).point, points, atol=1e-12)
        # All of a family focus in the two poles of its start curve.
        axis = (points[0] - centre) / 2.0
        assert norm(np.cross(points - centre, axis)).max() < 1e-4
        # Seen from the pole the start curve, at right angles to the lines, is a quarter away.
        lines = network.families[family]
        both = (lines.ends == End.FOCAL).all(axis=1)
        assert lines.total[both] == pytest.approx(4.0 * math.acos(NARROWEST), abs=1e-3)
        assert both.any()


# --- networks ---------------------------------------------------------------------------------

BUMP = graph_surface("0.5*exp(-2*(x*x + y*y))", (-2, 2), (-2, 2))


def test_families_leave_the_start_curves_at_right_angles_and_equal_steps():
    network = trace_network("geodesic", BUMP, (0.2, 0.25), None, Given(0.3, (), (-0.7, 0.4)))
    for family, edge in ((0, 0.2), (1, 0.25)):
        # The start curve is the line of the family through the centre.
        at = norm(network.found.uv - [-0.7, 0.4]).argmin()
        assert norm(network.found.uv[at] - [-0.7, 0.4]) < 1e-8
        rows = network.found.lines[:, family] == network.found.lines[at, family]
        arcs = np.sort(network.found.arcs[rows, family])
        assert np.diff(arcs) == pytest.approx(edge, abs=1e-7)
        assert len(arcs) > 8
        assert network.angles[rows] == pytest.approx(math.pi / 2, abs=1e-6)
    assert network.angles.min() < math.radians(88)


def test_first_start_curve_has_the_given_plan_direction():
    network = trace_network("geodesic", BUMP, (0.2, 0.2), None, Given(0.3, (), (-0.7, 0.4)))
    at = norm(network.found.uv - [-0.7, 0.4]).argmin()
    step = network.slopes[at, 0]
    assert math.atan2(step[1], step[0]) % math.pi == pytest.approx(0.3, abs=1e-6)


def test_default_start_curves_have_principal_directions():
    vault = graph_surface("x*x", (-1, 1), (-1, 1))
    network = trace_network("geodesic", vault, (0.2, 0.2))
    # The normal points upwards: the vault bends towards it along x.
    for line in range(len(network.families[0])):
        assert np.ptp(network.families[0].joints(line)[:, 1]) < 1e-9


def test_planes_and_spheres_have_geodesic_networks():
    plane = graph_surface("0.3*x", (-2, 2), (-1, 1))
    network = trace_network("geodesic", plane, (0.3, 0.2))
    assert network.angles == pytest.approx(math.pi / 2, abs=1e-9)
    assert len(quads_from_network(network).mesh.faces) > 80
    network = trace_network("geodesic", sphere(), (0.2, 0.2))
    mesh = quads_from_network(network).mesh
    assert len(mesh.faces) > 80
    assert not len(flipped_faces(mesh))


def test_circles_of_a_cylinder_close_to_an_annulus():
    network = trace_network("geodesic", cylinder(v=(0, 2)), (0.2, 0.2))
    # The normal points outwards: rulings bend most towards it.
    assert network.families[1].closed.all()
    mesh = quads_from_network(network).mesh
    assert mesh.topology.euler_characteristic == 0
    assert len(mesh.topology.boundary_loops) == 2


@pytest.mark.parametrize("direction", [0.3, 0.8, 1.2])
def test_helices_of_a_cylinder_cover_it_once(direction):
    lying = moved(cylinder(v=(0, 6)), rotation=[[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    given = Given(direction=direction, through=(3.0, 0.2))
    mesh = quads_from_network(trace_network("geodesic", lying, (0.2, 0.2), None, given)).mesh
    area = norm(mesh.face_area_vectors).sum()
    # All but a rim of a panel at both ends, and a seam.
    assert 0.75 * 12.0 * math.pi < area < 12.0 * math.pi


def test_lines_that_meet_behind_a_bump_cover_every_place_once():
    sharp = graph_surface("1.2*exp(-4*(x*x + y*y))", (-2, 2), (-2, 2))
    given = Given(direction=math.pi / 2, through=(-1.5, 0.1))
    network = trace_network("geodesic", sharp, (0.15, 0.15), None, given)
    assert (network.families[1].ends == End.COVERED).any()
    result = quads_from_network(network)
    x, y = result.uv[result.mesh.faces].transpose(2, 0, 1)
    area = 0.5 * (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1)
    assert (area > 0).all()
    middle = result.uv[result.mesh.faces].mean(axis=1)
    # Cells on a fine raster are hit by at most one quad: no two middles nearer than half a panel.
    gaps = norm(middle[:, None] - middle) + 10.0 * np.eye(len(middle))
    assert gaps.min() > 0.02


def test_region_bounds_the_network():
    outline = PlanOutline([[-1, -1], [1, -1], [1, 0], [0, 0], [0, 1], [-1, 1]])
    low = graph_surface("0.2*exp(-2*(x*x + y*y))", (-2, 2), (-2, 2))
    inside = outline.on(low)
    network = trace_network("geodesic", low, (0.2, 0.2), inside, Given(direction=0.2))
    result = quads_from_network(network, inside)
    # A cell that the rim only grazes may touch the others by a corner.
    assert result.unusable == 0
    assert result.separate <= 2
    assert result.mesh.topology.euler_characteristic == 1
    uv = low.domain.grid(80, 80).reshape(-1, 2)
    uv = uv[inside(uv)]
    nearest = norm(uv[:, None] - result.uv[None]).min(axis=1)
    assert nearest.max() < 0.16


# --- refusals ---------------------------------------------------------------------------------


def test_start_point_off_the_surface_is_refused():
    with pytest.raises(NetworkError, match=r"over \[7.0, 0.0\] in plan there is none"):
        trace_network("geodesic", BUMP, (0.2, 0.2), None, Given(through=(7.0, 0.0)))


def test_start_point_in_a_corner_of_the_surface_is_refused():
    saddle = graph_surface("x*y/10", (-5, 5), (-5, 5))
    with pytest.raises(NetworkError, match="one of them leaves it at once"):
        trace_network("geodesic", saddle, (1.0, 1.0), None, Given(through=(5.0, 5.0)))


def test_plan_direction_where_the_surface_stands_upright_is_refused():
    with pytest.raises(NetworkError, match="stands upright at"):
        trace_network("geodesic", cylinder(), (0.2, 0.2), None, Given(direction=0.0))


def test_too_many_lines_are_refused():
    with pytest.raises(NetworkError, match="up to 4000 lines"):
        trace_network("geodesic", BUMP, (0.2, 1e-4))
