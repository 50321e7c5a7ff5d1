"""What every report says of a mesh, in contract keys."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from pqmesh.mesh.measure import measures
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.offsets import offset_vectors
from pqmesh.offset.support import twist
from pqmesh.vectors import Floats

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
    found: dict[str, Any] = measures(mesh)
    found["twist_max_deg"] = None
    if kind == "edge-offset" and axes is not None:
        found["twist_max_deg"] = float(np.degrees(twist(mesh, axes).max()))
        return found
    # Axes of circular meshes are those of the vertex offset; a mesh in pieces has none.
    in_one_piece = mesh.topology.components.max() == 0
    # Nor has one with collapsed edges.
    if mesh.edge_lengths.min() > 0 and (kind != "circular" or in_one_piece):
        with suppress(ArithmeticError):
            axes = offset_vectors(mesh, "circular" if kind == "circular" else "conical").axes
            found["twist_max_deg"] = float(np.degrees(twist(mesh, axes).max()))
    return found


def judged(key: str, asked: float, reached: float | None) -> dict[str, Any]:
    """A row of the tolerances; nothing is judged of what does not exist."""
    passed = None if reached is None else bool(reached <= asked)
    return {"key": key, "asked": asked, "reached": reached, "pass": passed}


def failed(report: dict[str, Any]) -> list[dict[str, Any]]:
    """Tolerances of a report that were not reached."""
    return [row for row in report["tolerance"] if row["pass"] is False]
