"""Observed orders of the network's panels under refinement: theory within 0.1.

On lines of curvature (errata page, E37): distance of the diagonals h^4, planarity (distance over
diagonal) h^3, angle balance h^2, and Rodrigues' dN + k dX = 0 along an edge h^2 in the angle.
"""

import numpy as np
import pytest

from pqmesh.mesh.measure import conicality_defect, planarity, planarity_deviation
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import trace_principal_network
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.formula import graph_surface
from pqmesh.vectors import angle

EDGES = (2.0, 1.0, 0.5)


def spline_roof():
    x, y = np.meshgrid(np.linspace(-24, 24, 7), np.linspace(-20, 20, 7), indexing="ij")
    z = 9 * (1 - (y / 24) ** 2) + 1.2 * np.sin(x / 9 + 0.4) * (1 - y / 50) + 0.006 * x * y
    return BSplineSurface(np.stack([x, y, z], axis=-1), (5, 5))


def formula_roof():
    z = "9 - 0.02*y**2 + 0.8*sin(x/9 + 0.4)*(1 - y/50) + 0.006*x*y"
    return graph_surface(z, (-24, 24), (-20, 20))


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def measured(surface, edge):
    """Root mean squares over the panels of a fixed part of the surface, by name."""

    def inside(uv):
        point = surface.jet(uv).point
        return (np.abs(point[:, 0]) < 9) & (np.abs(point[:, 1]) < 8)

    network = trace_principal_network(surface, (edge, edge), inside)
    result = quads_from_network(network, inside)
    mesh = result.mesh
    vertices, balance = conicality_defect(mesh)
    normal = shape_data(surface.jet(result.uv)).normal
    p, q = mesh.edges.T
    chord, turn = mesh.vertices[q] - mesh.vertices[p], normal[q] - normal[p]
    straight = np.linalg.norm(turn, axis=1) > 1e-3 * np.linalg.norm(chord, axis=1)
    lean = angle(chord[straight], turn[straight])
    center = mesh.vertices[mesh.faces].mean(axis=1)
    face = (np.abs(center[:, 0]) < 8) & (np.abs(center[:, 1]) < 7)
    node = (np.abs(mesh.vertices[vertices, :2]) < [8, 7]).all(axis=1)
    return {
        "diagonals": rms(planarity_deviation(mesh)[face]),
        "planarity": rms(planarity(mesh)[face]),
        "balance": rms(balance[node]),
        "rodrigues": float(np.median(np.minimum(lean, np.pi - lean))),
    }


@pytest.fixture(scope="module", params=[spline_roof, formula_roof], ids=["spline", "formula"])
def orders(request):
    surface = request.param()
    rows = [measured(surface, edge) for edge in EDGES]
    return {
        name: np.log2([rows[i][name] / rows[i + 1][name] for i in range(len(rows) - 1)])
        for name in rows[0]
    }


@pytest.mark.parametrize(
    ("quantity", "theory"), [("diagonals", 4), ("planarity", 3), ("balance", 2), ("rodrigues", 2)]
)
def test_panels_improve_with_the_edge_at_the_order_of_theory(orders, quantity, theory):
    # The last halving; the first still carries the next order.
    assert orders[quantity][-1] == pytest.approx(theory, abs=0.1)
    assert orders[quantity][0] == pytest.approx(theory, abs=0.4)
