"""pqmesh: freeform surfaces to flat panels with exact offsets.

The public names are imported when they are used, so that `import pqmesh` stays fast.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

# Public name -> module, grouped by stage.
_PUBLIC = {
    "Topology": "mesh.topology",
    "PolyMesh": "mesh.quadmesh",
    "QuadMesh": "mesh.quadmesh",
    "measures": "mesh.measure",
    "conjugacy": "mesh.conjugacy",
    "read_mesh": "io.formats",
    "write_mesh": "io.formats",
    "Domain": "surface.base",
    "BSplineSurface": "surface.bspline",
    "FormulaSurface": "surface.formula",
    "graph_surface": "surface.formula",
    "shape_surface": "surface.analytic",
    "find_umbilics": "surface.umbilics",
    "PlanOutline": "network.region",
    "trace_network": "network.kinds",
    "quads_from_network": "network.meshing",
    "problem_for": "optimize.recipes",
    "Constraints": "optimize.constraints",
    "read_constraints": "design",
    "solve": "optimize.solver",
    "outlook": "optimize.outlook",
    "mended": "optimize.mending",
    "face_offset": "offset.offsets",
    "edge_offset": "koebe.edge_offset",
    "vertex_offset": "offset.offsets",
    "support_structure": "offset.support",
    "parallel_space": "offset.parallel",
    "nearest_member": "offset.members",
    "dragged": "offset.members",
    "offset_space": "offset.spaces",
    "edge_offset_space": "koebe.edge_offset",
    "koebe_polyhedron": "koebe.polyhedron",
    "is_offset": "offset.distances",
    "gauss_image": "offset.gauss",
    "face_curvatures": "offset.steiner",
    "vertex_cones": "mesh.cones",
    "check_report": "check",
    "LaguerreTransform": "transform.laguerre",
    "MoebiusTransform": "transform.moebius",
    "Design": "design",
    "read_design": "source",
    "Spec": "job_spec",
    "Panelization": "job",
    "panelize": "job",
    "PqmeshError": "errors",
}

__all__ = sorted([*_PUBLIC, "__version__"])


def __getattr__(name: str) -> Any:
    """A public name, from its module."""
    if name not in _PUBLIC:
        raise AttributeError(f"module 'pqmesh' has no attribute {name!r}")
    value = getattr(import_module(f"pqmesh.{_PUBLIC[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
