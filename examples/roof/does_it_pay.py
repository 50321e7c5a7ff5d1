"""Does it pay? The example roof as conical quads, as a parameter grid and as triangles.

The introduction of the thesis claims that flat quads with torsion-free nodes need fewer and
simpler parts than triangles. This script counts: valence of the nodes, metres of beam and of
joint, panels, waste of the stock rectangles, twist of the beams. All three have the same mean
panel edge. Run it after `make roof`: python examples/roof/does_it_pay.py out/roof
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from pqmesh import PolyMesh, QuadMesh, read_mesh
from pqmesh.fabricate.sizes import panel_sizes
from pqmesh.mesh.measure import planarity_deviation
from pqmesh.offset.support import twist
from pqmesh.offset.vectors import face_offset_vectors


def triangulated(mesh: QuadMesh) -> PolyMesh:
    """Every quad cut along its shorter diagonal: flat panels, but nodes of valence six."""
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    shorter = np.linalg.norm(c - a, axis=1) <= np.linalg.norm(d - b, axis=1)
    faces = []
    for (p, q, r, s), first in zip(mesh.faces.tolist(), shorter.tolist(), strict=True):
        faces += [[p, q, r], [p, r, s]] if first else [[p, q, s], [q, r, s]]
    return PolyMesh.of(mesh.vertices, faces)


def figures(mesh: PolyMesh, axes: np.ndarray) -> dict[str, float]:
    """What a builder counts, per square metre where it grows with the roof."""
    topology = mesh.topology
    sizes = panel_sizes([mesh.vertices[face] for face in topology.face_lists()])
    inner = ~topology.is_boundary_vertex
    covered = sum(size.area for size in sizes)
    stock = sum(size.width * size.height for size in sizes)
    return {
        "panels": topology.n_faces,
        "valence of inner nodes": float(topology.valence[inner].mean()),
        "beam, m per m2": float(mesh.edge_lengths.sum()) / covered,
        "joint, m per m2": sum(size.perimeter for size in sizes) / covered,
        "waste of stock, %": 100.0 * (1.0 - covered / stock),
        "largest twist, deg": float(np.degrees(twist(mesh, axes).max())),
        "mean twist, deg": float(np.degrees(twist(mesh, axes).mean())),
    }


def main(folder: Path) -> dict[str, dict[str, float]]:
    """Print the table and return it."""
    conical = read_mesh(folder / "mesh.obj")
    assert isinstance(conical, QuadMesh)
    triangles = triangulated(conical)
    table = {
        "conical quads": figures(conical, face_offset_vectors(conical).axes),
        "triangles": figures(triangles, triangles.vertex_normals),
    }
    table["conical quads"]["out of plane, mm"] = 1e3 * float(planarity_deviation(conical).max())
    table["triangles"]["out of plane, mm"] = 0.0
    for row in table["conical quads"]:
        cells = "".join(f"{column[row]:16.4g}" for column in table.values())
        print(f"{row:24}{cells}")
    return table


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/roof"))
