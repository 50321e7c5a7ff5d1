"""The terms of pqmesh. A new one is a file here and a line in `TERMS`."""

from pqmesh.optimize.terms.angles import Circularity, Conicality
from pqmesh.optimize.terms.closeness import Closeness, Gliding
from pqmesh.optimize.terms.cone import Cone
from pqmesh.optimize.terms.linear import anchor, fairness, held_edges
from pqmesh.optimize.terms.planarity import Planarity, PolygonPlanarity

# Name -> constructor; the contract tests run over this table.
TERMS = {
    "planarity": Planarity.on,
    "polygon_planarity": PolygonPlanarity.on,
    "conicality": Conicality.on,
    "cone": Cone.on,
    "circularity": Circularity.on,
    "closeness": Closeness.on,
    "gliding": Gliding.on,
    "held_edges": held_edges,
    "fairness": fairness,
    "anchor": anchor,
}

__all__ = [
    "TERMS",
    "Circularity",
    "Closeness",
    "Cone",
    "Conicality",
    "Gliding",
    "Planarity",
    "PolygonPlanarity",
    "anchor",
    "fairness",
    "held_edges",
]
