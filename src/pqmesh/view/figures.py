"""Pictures as PNG bytes: network, viability, measures, before and after, layers, one node."""

from pqmesh.view.layered import layers_figure
from pqmesh.view.measures import comparison_figure, measure_figure
from pqmesh.view.node import node_figure, typical_node
from pqmesh.view.surfaces import network_figure, viability_figure

__all__ = [
    "comparison_figure",
    "layers_figure",
    "measure_figure",
    "network_figure",
    "node_figure",
    "typical_node",
    "viability_figure",
]
