"""Conjugate networks: exact pairs, given curves, planarity, and where there are none."""

import math

import numpy as np
import pytest

from pqmesh.errors import NetworkError
from pqmesh.mesh.measure import planarity
from pqmesh.network.guides import curve_samples, guide_field
from pqmesh.network.kinds import Given, trace_network
from pqmesh.network.meshing import quads_from_network
from pqmesh.surface.analytic import conjugate_cubic, cylinder, sphere
from pqmesh.surface.formula import graph_surface
from pqmesh.surface.umbilics import conjugacy_defect
from pqmesh.vectors import norm

TRANSLATED = graph_surface("x*x + 0.2*x**3 + cosh(y)", (-1, 1), (-1, 1))
QUADRIC = graph_surface("x*x + 8*y*y", (-1, 1), (-1, 1))
GENERIC = graph_surface("x*x + 2*y*y + 0.3*x*y*y + 0.1*sin(2*x + y)", (-1, 1), (-1, 1))
BENT = np.array([[-1.0, -0.5], [-0.3, -0.1], [0.3, -0.1], [1.0, -0.4]])


def on_lines(lines):
    """Parameters on all lines, and the line of each."""
    segment = np.repeat(np.arange(len(lines.arc)), 3)
    return lines.at(segment, np.tile([0.0, 0.5, 1.0], len(lines.arc))), lines.line_of[segment]


def along(angle, edge=0.15, surface=GENERIC, inside=None):
    return trace_network("conjugate", surface, (edge, edge), inside, Given(direction=angle))


def test_conjugate_of_one_generating_direction_is_the_other():
    network = along(0.0, surface=TRANSLATED)
    for family, lines in enumerate(network.families):
        uv, owner = on_lines(lines)
        assert max(np.ptp(uv[owner == i, 1 - family]) for i in range(len(lines))) < 1e-9


def test_conjugate_lines_of_a_paraboloid_are_straight_in_plan():
    # II is diag(2, 16)/|n| everywhere: conjugate of (c, s) is (-8 s, c) in plan.
    network = along(0.6, surface=QUADRIC)
    wanted = np.array([-8.0 * math.sin(0.6), math.cos(0.6)])
    joints = [network.families[1].joints(i) for i in range(len(network.families[1]))]
    for line in joints:
        chord = line - line[0]
        away = (chord[:, 0] * wanted[1] - chord[:, 1] * wanted[0]) / np.linalg.norm(wanted)
        assert np.abs(away).max() < 1e-8


def test_conjugate_of_a_principal_direction_is_the_principal_network():
    vault = graph_surface("0.5*x*x + 0.1*x**3", (-1, 1), (-1, 1))
    conjugate, principal = (
        along(0.0, surface=vault),
        trace_network("principal", vault, (0.15, 0.15)),
    )
    for a, b in zip(conjugate.families, principal.families, strict=True):
        assert len(a) == len(b)
    x, y = (np.unique(n.found.uv[:, 0].round(6)) for n in (conjugate, principal))
    np.testing.assert_allclose(x, y, atol=2e-6)
    assert conjugate.angles == pytest.approx(math.pi / 2, abs=1e-9)


def test_parameter_lines_of_the_conjugate_cubic_are_conjugate():
    network = trace_network("uv", conjugate_cubic(), (0.06, 0.06))
    assert len(network.found) > 50
    assert network.conjugacy.max() < 1e-12
    assert network.angles.min() < math.radians(80)


def test_families_are_conjugate_at_all_crossings_of_a_generic_graph():
    network = along(0.9)
    assert len(network.found) > 300
    assert network.conjugacy.max() < 1e-9
    # The lines as traced, by the slopes of their dense output.
    steps = [
        lines.slope(*lines.locate(network.found.lines[:, i], network.found.arcs[:, i]))
        for i, lines in enumerate(network.families)
    ]
    assert conjugacy_defect(GENERIC, network.found.uv, *steps).max() < 1e-6
    # Family 0 runs along the given direction in plan.
    assert np.abs(steps[0] @ [-math.sin(0.9), math.cos(0.9)] / norm(steps[0])).max() < 1e-6


def orders(trace, edges):
    """Orders by which the mean planarity over a fixed square falls as the edge is halved."""
    means = []
    for edge in edges:
        mesh = quads_from_network(trace(edge), box).mesh
        middle = mesh.vertices[mesh.faces].mean(axis=1)
        means.append(planarity(mesh)[box(middle)].mean())
    return np.log2(np.divide(means[:-1], means[1:]))


def box(places):
    return (np.abs(places[:, :2]) < 0.5).all(axis=1)


@pytest.mark.parametrize("angle", [0.1, 0.9, 1.7])
def test_quads_of_a_conjugate_network_are_planar_to_third_order(angle):
    found = orders(lambda edge: along(angle, edge, inside=box), (0.2, 0.1, 0.05))
    assert ((found > 2.8) & (found < 3.2)).all(), found


@pytest.mark.parametrize(("kind", "given"), [("uv", None), ("geodesic", Given(direction=0.5))])
def test_quads_of_other_networks_are_planar_to_first_order_only(kind, given):
    found = orders(
        lambda edge: trace_network(kind, GENERIC, (edge, edge), box, given), (0.1, 0.05, 0.025)
    )
    assert ((found > 0.9) & (found < 1.1)).all(), found


@pytest.mark.parametrize("angle", [0.2, 0.35, 0.6])
def test_oblique_families_have_the_wanted_edges_and_no_gaps(angle):
    # Lines of families that meet under 20 to 30 degrees stand half as far apart as edges are long.
    network = along(angle, 0.12, surface=QUADRIC)
    result = quads_from_network(network)
    assert (result.unusable, result.separate) == (0, 0)
    assert np.degrees(network.angles.min()) < 35
    corners = result.mesh.vertices[result.mesh.faces]
    edges = norm(corners - np.roll(corners, -1, axis=1))
    assert np.exp(np.log(edges[:, 0::2]).mean()) == pytest.approx(0.12, rel=0.1)
    assert np.exp(np.log(edges[:, 1::2]).mean()) == pytest.approx(0.12, rel=0.1)
    assert edges.max() < 2.5 * 0.12


# --- given curves -----------------------------------------------------------------------------


def test_field_has_the_tangents_of_the_given_curves():
    curves = (BENT, BENT[::-1] * [1.0, 1.2] + [0.1, 0.8], np.array([[-1.0, 0.9], [1.0, 1.1]]))
    field = guide_field(curves)
    for curve in curves:
        places, doubled = curve_samples(curve, np.linspace(0.0, 1.0, 501))
        assert np.abs(np.angle(field.doubled(places) / doubled)).max() < 1e-4


def test_field_does_not_depend_on_the_sense_of_a_curve():
    points = np.random.default_rng(1).uniform(-1, 1, (50, 2))
    a, b = guide_field((BENT,))(points), guide_field((BENT[::-1],))(points)
    assert np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).max() < 1e-5


def test_one_straight_curve_gives_the_network_of_its_direction():
    line = np.array([[-1.0, -0.3], [0.5, -0.3 + 1.5 * math.tan(0.4)]])
    a = trace_network("conjugate", GENERIC, (0.2, 0.2), None, Given(curves=(line,)))
    b = along(0.4, 0.2)
    assert len(a.found) == len(b.found)
    np.testing.assert_allclose(a.found.uv, b.found.uv, atol=1e-4)


def test_lines_follow_a_given_curve_and_the_network_is_sound():
    network = trace_network("conjugate", GENERIC, (0.15, 0.15), None, Given(curves=(BENT,)))
    assert network.conjugacy.max() < 1e-9
    result = quads_from_network(network)
    assert (result.unusable, result.separate) == (0, 0)
    # Between the two lines next to it, the curve keeps its share of the way to 2 %.
    places, _ = curve_samples(BENT, np.linspace(0.1, 0.9, 9))
    heights = []
    for line in range(len(network.families[0])):
        joints, _ = on_lines(network.families[0])
        own = joints[np.repeat(network.families[0].line_of, 3) == line]
        own = own[np.argsort(own[:, 0])]
        if own[0, 0] < places[0, 0] and own[-1, 0] > places[-1, 0]:
            heights.append(np.interp(places[:, 0], own[:, 0], own[:, 1]))
    rows = np.sort(np.array(heights), axis=0)
    above = (rows > places[:, 1]).argmax(axis=0)
    assert np.ptp(above) == 0
    low, high = rows[above[0] - 1], rows[above[0]]
    assert np.ptp((places[:, 1] - low) / (high - low)) < 0.1


def test_curve_in_space_is_taken_in_plan():
    raised = np.column_stack([BENT, [3.0, 1.0, 4.0, 1.0]])
    a, b = (
        trace_network("conjugate", GENERIC, (0.3, 0.3), None, Given(curves=(curve,)))
        for curve in (BENT, raised)
    )
    np.testing.assert_array_equal(a.found.uv, b.found.uv)


# --- refusals ---------------------------------------------------------------------------------


def test_asymptotic_direction_of_a_saddle_is_refused_with_place_and_angle():
    saddle = graph_surface("x*x - y*y", (-1, 1), (-1, 1))
    with pytest.raises(NetworkError, match=r"near \[.*degrees: family 0 is nearly asymptotic"):
        along(math.pi / 4, surface=saddle)
    # In plan the conjugate of the angle t is 90 degrees - t: at 41 degrees they meet under 8.
    with pytest.raises(NetworkError, match=r"10 degrees or more; near .* under .* degrees"):
        along(math.radians(41), surface=saddle, inside=lambda uv: norm(uv) < 0.3)
    network = along(math.radians(35), surface=saddle, inside=lambda uv: norm(uv) < 0.1)
    assert 10 < np.degrees(network.angles.min()) < 30
    assert network.angles[network.narrow[0]] == network.angles.min()
    assert len(network.narrow) == (network.angles < math.radians(30)).sum()
    assert not len(along(0.0, surface=saddle).narrow)


def test_rulings_are_refused_and_directions_across_them_are_not():
    vault = graph_surface("x*x", (-1, 1), (-1, 1))
    with pytest.raises(NetworkError, match="follows a ruling"):
        along(math.pi / 2, surface=vault)
    network = along(math.radians(30), surface=vault)
    uv, owner = on_lines(network.families[1])
    assert np.abs(network.families[1].joints(0)[:, 0] - uv[0, 0]).max() < 1e-9
    assert len(np.unique(owner)) > 3


def test_plane_and_upright_surfaces_are_refused():
    with pytest.raises(NetworkError, match="The surface must bend"):
        along(0.3, surface=graph_surface("x + y", (0, 1), (0, 1)))
    with pytest.raises(NetworkError, match="stands upright or turns over near"):
        along(0.3, surface=sphere())
    with pytest.raises(NetworkError, match="stands upright"):
        along(0.3, surface=cylinder())


def test_curves_that_miss_or_contradict_are_refused():
    def follow(*curves):
        return trace_network("conjugate", GENERIC, (0.2, 0.2), None, Given(curves=curves))

    with pytest.raises(NetworkError, match=r"curve 1 stays \S+ away from it"):
        follow(BENT, BENT + np.array([0.0, 3.4]))
    with pytest.raises(NetworkError, match="must agree on a direction"):
        follow(np.array([[-1.0, -1.0], [1.0, 1.0]]), np.array([[-1.0, 0.9], [1.0, -0.9]]))
    # Opposite diagonals around a square leave its middle undecided.
    turn = np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    with pytest.raises(NetworkError, match=r"leave a direction at every place|agree"):
        follow(0.8 * np.column_stack([np.cos(turn), np.sin(turn)]))
