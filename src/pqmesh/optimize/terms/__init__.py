"""The terms of pqmesh. A new one is a file here and a line in `TERMS`."""

from pqmesh.optimize.terms.angles import Circularity, Conicality
from pqmesh.optimize.terms.axis import NodeAxis
from pqmesh.optimize.terms.closeness import Closeness, Within
from pqmesh.optimize.terms.cone import Cone
from pqmesh.optimize.terms.curves import Gliding, OnCurve
from pqmesh.optimize.terms.linear import Combination, anchor, fairness, held_edges
from pqmesh.optimize.terms.parallel import EdgeParallel
from pqmesh.optimize.terms.planarity import Planarity, PolygonPlanarity
from pqmesh.optimize.terms.planes import OnPlanes, PlanarPolyline
from pqmesh.optimize.terms.sizes import EdgeLength, PanelArea, PanelWidth
from pqmesh.optimize.terms.symmetry import Symmetry

# Name -> constructor; the contract tests run over this table.
TERMS = {
    "planarity": Planarity.on,
    "polygon_planarity": PolygonPlanarity.on,
    "conicality": Conicality.on,
    "cone": Cone.on,
    "circularity": Circularity.on,
    "closeness": Closeness.on,
    "within": Within.on,
    "gliding": Gliding.on,
    "on_curve": OnCurve.on,
    "on_planes": OnPlanes.on,
    "planar_polyline": PlanarPolyline.on,
    "symmetry": Symmetry.on,
    "node_axis": NodeAxis.on,
    "edge_parallel": EdgeParallel.between_axes,
    "edge_length": EdgeLength.on,
    "panel_width": PanelWidth.on,
    "panel_area": PanelArea.on,
    "held_edges": held_edges,
    "fairness": fairness,
    "anchor": anchor,
}

__all__ = [
    "TERMS",
    "Circularity",
    "Closeness",
    "Combination",
    "Cone",
    "Conicality",
    "EdgeLength",
    "EdgeParallel",
    "Gliding",
    "NodeAxis",
    "OnCurve",
    "OnPlanes",
    "PanelArea",
    "PanelWidth",
    "PlanarPolyline",
    "Planarity",
    "PolygonPlanarity",
    "Symmetry",
    "Within",
    "anchor",
    "fairness",
    "held_edges",
]
