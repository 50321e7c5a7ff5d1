"""A shell on four feet behind an arch that is given: constraints of a designer, met exactly.

Run it with `python examples/constrained_shell.py`.
"""

import numpy as np

from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.optimize.constraints import Constraints, Curve, FlatPolylines, Level, Mirror
from pqmesh.optimize.polylines import Polylines
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.selection import Where, selected
from pqmesh.surface.reference import TriangleReference
from pqmesh.vectors import Floats


def main() -> dict[str, float]:
    """Make the shell planar within its constraints, print what it reaches, return the numbers."""
    # A sketch: 12 x 8 panels that are neither flat nor quite symmetric.
    x, y = np.meshgrid(np.linspace(-6, 6, 13), np.linspace(-4, 4, 9), indexing="ij")
    z = 4 - x**2 / 14 - y**2 / 20 + 0.02 * x**2 * y / 4 + 0.01 * np.sin(3 * x + y)
    start = grid_mesh(np.stack([x, y, z], axis=-1))
    # The arch in front, part of a circle of radius 9 that leans outwards.
    turn = np.linspace(-0.85, 0.85, 60)
    rise = 9 * np.cos(turn) - 5.8
    arch = np.stack([9 * np.sin(turn), -4 - 0.1 * rise, rise], axis=-1)

    front = Where("boundary", box=[[-7, -4.1, -1], [7, -3.9, 9]])
    wanted = Constraints(
        (
            Mirror(point=(0, 0, 0), normal=(1, 0, 0)),
            Curve(front, arch),
            Level("corners", 0.9),
            # The rim can be cut from plates.
            FlatPolylines("boundary"),
        )
    )
    surface = TriangleReference.of_polygons(start.vertices, start.faces.tolist())
    solution = optimized("planar", start, surface, constraints=wanted)
    mesh = start.with_vertices(solution.blocks["vertices"])

    curve = Polylines.of([arch])
    held = mesh.vertices[selected(front, start)]
    image = mesh.vertices.reshape(13, 9, 3)[::-1].reshape(-1, 3) * [-1, 1, 1]
    rims = [c for c in start.topology.polylines if start.topology.is_boundary_vertex[c].all()]
    found = {
        "panels": float(mesh.topology.n_faces),
        "planarity_before": float(planarity(start).max()),
        "planarity": float(planarity(mesh).max()),
        "arch_error": float(curve.gaps(held, curve.nearest(held)).max()),
        "level_error": float(np.abs(mesh.vertices[selected("corners", start), 2] - 0.9).max()),
        "mirror_error": float(np.abs(image - mesh.vertices).max()),
        "rim_error": max(_off_plane(mesh.vertices[chain]) for chain in rims),
        "moved_max": float(np.linalg.norm(mesh.vertices - start.vertices, axis=1).max()),
    }
    for name, value in found.items():
        print(f"{name:17} {value:.3g}")
    return found


def _off_plane(points: Floats) -> float:
    """Largest distance of points from their best plane."""
    away = points - points.mean(axis=0)
    return float(np.abs(away @ np.linalg.svd(away)[2][2]).max())


if __name__ == "__main__":
    main()
