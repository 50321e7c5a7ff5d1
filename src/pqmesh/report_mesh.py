"""What every report says of a mesh, in contract keys."""

from __future__ import annotations

from typing import Any

import numpy as np

from pqmesh.mesh.measure import measures
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.offsets import offset_vectors
from pqmesh.offset.support import twist
from pqmesh.vectors import Floats, norm

# Of the reports' keys.
SCHEMA = 1


def mesh_counts(mesh: PolyMesh) -> dict[str, int]:
    """Counts of the combinatorics."""
    topology = mesh.topology
    return {
        "vertices": topology.n_vertices,
        "faces": topology.n_faces,
        "edges": topology.n_edges,
        "boundary_loops": len(topology.boundary_loops),
        "irregular_vertices": len(topology.irregular_vertices),
        "euler_characteristic": topology.euler_characteristic,
        "pieces": int(topology.components.max()) + 1,
    }


def all_measures(mesh: PolyMesh, kind: str, axes: Floats | None = None) -> dict[str, Any]:
    """Measures of the mesh with the twist of its node axes: given ones, or those of its kind."""
    return measured(mesh, edge_twists(mesh, kind, axes))


def measured(mesh: PolyMesh, twists: Floats | None) -> dict[str, Any]:
    """Measures of the mesh with the twists (E,) of its node axes, degrees, where there are any."""
    return {
        **measures(mesh),
        "twist_max_deg": None if twists is None else float(twists.max()),
        "area_total": float(norm(mesh.face_area_vectors).sum()),
    }


def edge_twists(mesh: PolyMesh, kind: str, axes: Floats | None = None) -> Floats | None:
    """Twist of the node axes along each edge, (E,), degrees: given ones, or those of its kind.

    None where there are no axes, or the memory does not suffice to find them.
    """
    if kind != "edge-offset" or axes is None:
        # Axes of circular meshes are those of the vertex offset; a mesh in pieces has none.
        in_one_piece = mesh.topology.components.max() == 0
        # Nor has one with collapsed edges.
        if not mesh.edge_lengths.min() > 0 or (kind == "circular" and not in_one_piece):
            return None
        try:
            axes = offset_vectors(mesh, "circular" if kind == "circular" else "conical").axes
        except (ArithmeticError, MemoryError):
            return None
    return np.degrees(twist(mesh, axes))


def judged(
    key: str, asked: float, reached: float | None, worst: dict[str, Any] | None = None
) -> dict[str, Any]:
    """A row of the tolerances, with its worst place; nothing is judged of what does not exist."""
    passed = None if reached is None else bool(reached <= asked)
    return {"key": key, "asked": asked, "reached": reached, "pass": passed, "worst": worst}


def failed(report: dict[str, Any]) -> list[dict[str, Any]]:
    """Tolerances of a report that were not reached."""
    return [row for row in report["tolerance"] if row["pass"] is False]
