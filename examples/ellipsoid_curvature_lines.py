"""Lines of curvature of an ellipsoid, judged by their classical properties.

Along such a line one ellipsoidal coordinate is constant, there are four umbilics in known places,
and cells of size h between the lines leave their plane by the order h^4 only.
"""

import sys
from pathlib import Path

import numpy as np

import pqmesh
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.measure import planarity_deviation

AXES = np.array([3.0, 2.0, 1.2])


def ellipsoidal_coordinates(points: np.ndarray) -> np.ndarray:
    """Roots l other than 0 of sum x_i^2 / (a_i^2 - l) = 1, rising, shape (N, 2)."""
    p, q, r = AXES**2
    x, y, z = (points**2).T
    linear = x + y + z - (p + q + r)
    constant = p * q + q * r + r * p - x * (q + r) - y * (r + p) - z * (p + q)
    root = np.sqrt(linear**2 - 4 * constant)
    return np.stack([-linear - root, -linear + root], axis=1) / 2


def cell_deviation(n: int) -> float:
    """Largest distance of the diagonals in n x n cells of a fixed patch of curvature lines."""
    surface = pqmesh.shape_surface("ellipsoid", lines="curvature")
    u, v = np.meshgrid(*2 * [np.linspace(0.8, 2.0, n + 1)], indexing="ij")
    points = surface.jet(np.stack([u, v], axis=-1).reshape(-1, 2)).point
    return float(planarity_deviation(grid_mesh(points.reshape(n + 1, n + 1, 3))).max())


def main(picture: str | None = None) -> dict[str, float]:
    """Trace, compare, print, and return the numbers."""
    patch = pqmesh.shape_surface("ellipsoid", u=[0.7, 2.4], v=[-0.7, 0.7])
    network = pqmesh.trace_network("principal", patch, (0.4, 0.4))
    traced = [lines.joints(i) for lines in network.families for i in range(len(lines))]
    spans = [np.ptp(ellipsoidal_coordinates(patch.jet(uv).point), axis=0) for uv in traced]
    umbilics = pqmesh.find_umbilics(pqmesh.shape_surface("ellipsoid")).umbilics
    p, q, r = AXES**2
    known = np.sqrt([p * (p - q) / (p - r), 0.0, r * (q - r) / (p - r)])
    found = {
        "crossings": float(len(network.points)),
        "coordinate_drift": float(np.min(spans, axis=1).max()),
        "umbilics": float(len(umbilics)),
        "umbilic_error": max(float(np.abs(np.abs(u.point) - known).max()) for u in umbilics),
        "order_of_deviation": float(np.log2(cell_deviation(32) / cell_deviation(64))),
    }
    for name, value in found.items():
        print(f"{name:19} {value:.3g}")
    if picture:
        from pqmesh.view import figures

        drawn = figures.network_figure(network, units="m", title="Lines of curvature")
        Path(picture).write_bytes(drawn)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
