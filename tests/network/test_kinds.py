"""Every network by its name: parameter lines, what is given, what is refused."""

import math

import numpy as np
import pytest

from pqmesh.errors import NetworkError, SpecError
from pqmesh.mesh.measure import flipped_faces, nonconvex_faces
from pqmesh.network.kinds import NETWORKS, Given, trace_network
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import trace_principal_network
from pqmesh.surface.analytic import cylinder, moved, sphere, torus
from pqmesh.surface.base import Domain
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.vectors import norm

PLANE = graph_surface("0.3*x - 0.2*y", (-2, 2), (-1, 1))
# No umbilics; asymptotic directions more than 30 degrees away from the given one.
SADDLE = graph_surface("0.8*x*x - 0.2*y*y + 0.1*x*y*y", (-1, 1), (-1, 1))
AHEAD = Given(direction=0.3)


def on_lines(lines, per_step=3):
    """Unwrapped parameters on all lines, and the line of each."""
    segment = np.repeat(np.arange(len(lines.arc)), per_step)
    theta = np.tile(np.linspace(0.0, 1.0, per_step), len(lines.arc))
    return lines.at(segment, theta), lines.line_of[segment]


def test_principal_network_by_name_is_the_principal_network():
    a = trace_network("principal", torus(), (0.5, 0.6))
    b = trace_principal_network(torus(), (0.5, 0.6))
    assert a.kind == b.kind == "principal"
    np.testing.assert_array_equal(a.found.uv, b.found.uv)
    assert a.angles == pytest.approx(math.pi / 2, abs=1e-12)
    assert a.conjugacy.max() < 1e-12
    assert a.focal == ()


@pytest.mark.parametrize("surface", [torus(), cylinder(), sphere(), PLANE], ids=str)
def test_lines_of_the_uv_network_are_parameter_lines(surface):
    network = trace_network("uv", surface, (0.3, 0.4))
    for family, lines in enumerate(network.families):
        uv, owner = on_lines(lines)
        assert len(lines) > 2
        for line in range(len(lines)):
            assert np.ptp(uv[owner == line, 1 - family]) == 0.0
            assert np.ptp(uv[owner == line, family]) > 0.9 * surface.domain.size[family]
    assert lines.closed.all() == surface.domain.periodic[1]


def test_uv_panels_of_a_plane_have_the_wanted_edges():
    # Parameters of this plane are neither orthogonal nor of unit speed.
    oblique = FormulaSurface("2*u + v", "v", "0*u", Domain((0, 3), (0, 4)))
    network = trace_network("uv", oblique, (0.4, 0.3))
    corners = quads_from_network(network).mesh
    edges = norm(np.diff(corners.vertices[corners.faces], axis=1))
    np.testing.assert_allclose(edges[:, [0, 2]], 0.4, rtol=1e-6)
    np.testing.assert_allclose(edges[:, 1], 0.3, rtol=1e-6)
    assert network.angles == pytest.approx(math.pi / 4, abs=1e-12)


@pytest.mark.parametrize("kind", NETWORKS)
def test_every_network_of_a_saddle_makes_a_sound_mesh(kind):
    given = AHEAD if kind == "conjugate" else None
    network = trace_network(kind, SADDLE, (0.15, 0.15), lambda uv: norm(uv) < 0.8, given)
    result = quads_from_network(network, lambda uv: norm(uv) < 0.8)
    assert network.kind == kind
    # A cell that the rim only grazes may touch the others by a corner.
    assert result.unusable == 0
    assert result.separate <= 2
    assert not len(flipped_faces(result.mesh))
    assert not len(nonconvex_faces(result.mesh))
    assert result.mesh.topology.euler_characteristic == 1
    # Quads reach over the disk, by less than a panel all around.
    x, y = result.uv[result.mesh.faces].transpose(2, 0, 1)
    area = 0.5 * (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum()
    assert math.pi * 0.8**2 < area < math.pi * 1.05**2


@pytest.mark.parametrize("scale", [1e-4, 1e5])
def test_networks_do_not_depend_on_the_unit(scale):
    curve = np.array([[-1.0, -0.1], [0.0, 0.1], [1.0, 0.0]])
    large = moved(SADDLE, scale=scale)
    for kind, given, scaled in (
        ("uv", None, None),
        ("geodesic", Given(0.3, (), (0.1, 0.2)), Given(0.3, (), (0.1 * scale, 0.2 * scale))),
        ("conjugate", AHEAD, AHEAD),
        ("conjugate", Given(curves=(curve,)), Given(curves=(scale * curve,))),
    ):
        a = trace_network(kind, SADDLE, (0.3, 0.3), None, given)
        b = trace_network(kind, large, (0.3 * scale, 0.3 * scale), None, scaled)
        assert len(a.found) == len(b.found)
        # Rounding may choose another place for a line that only cuts a corner off.
        away = norm(a.found.uv - b.found.uv)
        assert np.median(away) < 1e-7
        assert away.max() < 2e-3


@pytest.mark.parametrize(
    ("kind", "given", "words"),
    [
        ("spiral", None, "found 'spiral'. Known are principal, uv"),
        ("conjugate", None, "found neither"),
        ("conjugate", Given(direction=0.0, curves=([[0, 0], [1, 1]],)), "found both"),
        ("conjugate", Given(direction=0.0, through=(0, 0)), "no use for through"),
        ("geodesic", Given(curves=([[0, 0], [1, 1]],)), "no use for curves"),
        ("uv", Given(curves=([[0, 0], [1, 1]],)), "no use for curves"),
        ("uv", Given(direction=0.0, through=(0, 0)), "no use for direction and through"),
        ("principal", Given(direction=0.0), "no use for direction"),
    ],
)
def test_what_does_not_fit_the_kind_is_refused(kind, given, words):
    with pytest.raises(SpecError, match=words):
        trace_network(kind, SADDLE, (0.2, 0.2), None, given)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"direction": math.nan}, "finite angle; found nan"),
        ({"through": (0.0, math.inf)}, "two finite plan coordinates"),
        ({"through": (0.0, 1.0, 2.0)}, "two finite plan coordinates"),
        ({"curves": ([[0.0, 0.0]],)}, "two points that differ in plan; curve 0 has 1"),
        ({"curves": ([[0, 0], [1, 1]], [[2, 2, 0], [2, 2, 5]])}, "curve 1 has 1"),
        ({"curves": ([[0.0, math.nan], [1, 1]],)}, "must be finite; curve 0"),
        ({"curves": ([0.0, 1.0],)}, r"curve 0 has shape \(2,\)"),
        ({"curves": (np.empty((0, 2)),)}, "curve 0 has 0"),
    ],
)
def test_given_values_that_mean_nothing_are_refused(table, words):
    with pytest.raises(SpecError, match=words):
        Given(**table)


def test_edges_that_are_no_lengths_are_refused():
    for kind in NETWORKS:
        given = AHEAD if kind == "conjugate" else None
        with pytest.raises(NetworkError, match="positive lengths"):
            trace_network(kind, SADDLE, (0.2, -1.0), None, given)


def test_region_off_the_surface_is_refused_by_every_network():
    for kind in NETWORKS:
        given = AHEAD if kind == "conjugate" else None
        with pytest.raises(NetworkError, match="no sample of the surface"):
            trace_network(kind, SADDLE, (0.2, 0.2), lambda uv: uv[:, 0] > 5, given)
