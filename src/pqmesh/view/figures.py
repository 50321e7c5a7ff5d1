"""Pictures as PNG bytes: sites, surfaces, networks, measures, layers, nodes and panels."""

from pqmesh.view.chart import Series, chart_figure
from pqmesh.view.compared import NamedNetwork, difference_figure, networks_figure
from pqmesh.view.crosses import directions_figure
from pqmesh.view.layered import layers_figure
from pqmesh.view.measures import comparison_figure, measure_figure
from pqmesh.view.node import node_figure, typical_node
from pqmesh.view.plan import Surroundings, layout_figure, site_figure
from pqmesh.view.strips import strips_figure
from pqmesh.view.surfaces import network_figure, viability_figure

__all__ = [
    "NamedNetwork",
    "Series",
    "Surroundings",
    "chart_figure",
    "comparison_figure",
    "difference_figure",
    "directions_figure",
    "layers_figure",
    "layout_figure",
    "measure_figure",
    "network_figure",
    "networks_figure",
    "node_figure",
    "site_figure",
    "strips_figure",
    "typical_node",
    "viability_figure",
]
