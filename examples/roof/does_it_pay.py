"""Does it pay? The example roof as conical quads, as a grid of parameter lines and as triangles.

The introduction of the thesis claims that flat quads with torsion-free nodes need fewer and
simpler parts than triangles. This script counts: valence of the nodes, metres of beam and of
joint, panels, waste of the stock rectangles, twist of the beams. The triangles stand on the
nodes of the conical mesh; the grid has the same wanted edge, as it comes from the surface.
Run it after `make roof`: python examples/roof/does_it_pay.py out/roof
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from pqmesh.network.kinds import trace_network

from pqmesh import PolyMesh, QuadMesh, read_mesh
from pqmesh.design import Design
from pqmesh.fabricate.sizes import panel_sizes
from pqmesh.io.outlines import read_outline
from pqmesh.mesh.measure import plane_deviation
from pqmesh.network.meshing import quads_from_network
from pqmesh.offset.support import twist
from pqmesh.offset.vectors import face_offset_vectors

HERE = Path(__file__).parent


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
    polygons = [mesh.vertices[face] for face in topology.face_lists()]
    sizes = panel_sizes(polygons)
    inner = ~topology.is_boundary_vertex
    covered = sum(size.area for size in sizes)
    stock = sum(size.width * size.height for size in sizes)
    turns = np.degrees(twist(mesh, axes))
    return {
        "panels": topology.n_faces,
        "area, m2": covered,
        "panels per 100 m2": 100.0 * topology.n_faces / covered,
        "beams at an inner node": float(topology.valence[inner].mean()),
        "beam, m per m2": float(mesh.edge_lengths.sum()) / covered,
        "joint, m per m2": sum(size.perimeter for size in sizes) / covered,
        "waste of stock, %": 100.0 * (1.0 - covered / stock),
        "largest twist, deg": float(turns.max()),
        "mean twist, deg": float(turns.mean()),
        "out of plane, mm": 1e3 * max(plane_deviation(polygon) for polygon in polygons),
    }


def compared(conical: QuadMesh, grid: QuadMesh) -> dict[str, dict[str, float]]:
    """Figures of a conical mesh, of the same nodes triangulated, and of a parameter grid.

    Nodes of the conical mesh have the axes of its face offset; the others have the mean normal
    of their faces, the best that is known for them.
    """
    triangles = triangulated(conical)
    return {
        "conical quads": figures(conical, face_offset_vectors(conical).axes),
        "parameter grid": figures(grid, grid.vertex_normals),
        "triangles": figures(triangles, triangles.vertex_normals),
    }


def print_figures(table: dict[str, dict[str, float]]) -> None:
    """One column a mesh."""
    print(f"{'':24}" + "".join(f"{name:>16}" for name in table))
    for row in next(iter(table.values())):
        print(f"{row:24}" + "".join(f"{column[row]:16.4g}" for column in table.values()))


def main(folder: Path) -> dict[str, dict[str, float]]:
    """Print the table and return it."""
    conical = read_mesh(folder / "mesh.obj")
    assert isinstance(conical, QuadMesh)
    design = Design.of(Design.read(HERE / "roof.toml")[0])
    surface = design.build_surface(HERE)
    inside = read_outline(HERE / "site.svg", "roof", units=design.units).on(surface)
    network = trace_network("uv", surface, design.edges, inside)
    table = compared(conical, quads_from_network(network, inside).mesh)
    print_figures(table)
    return table


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/roof"))
