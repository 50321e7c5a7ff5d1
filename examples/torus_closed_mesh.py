"""A closed mesh without boundary: the torus, panelled and offset as a whole.

Its lines of curvature are circles that close, so the network closes, and nothing is left over at
a rim. Run it with `python examples/torus_closed_mesh.py`, and with a path to get a picture.
"""

import sys
from pathlib import Path

import numpy as np

import pqmesh
from pqmesh.job import Spec, panelize
from pqmesh.mesh.measure import fitted_cones, planarity_deviation
from pqmesh.offset.offsets import valid_range


def main(picture: str | None = None) -> dict[str, float]:
    """Panel the torus, print what it reaches, and return the numbers."""
    torus = pqmesh.shape_surface("torus", R=3.0, r=1.0)
    ring = panelize(torus, Spec(edges=(0.5, 0.5), distances=(-0.2, 0.2)))
    topology = ring.mesh.topology
    low, _ = valid_range(ring.mesh, ring.vectors.vectors)
    found = {
        "panels": float(topology.n_faces),
        "boundary_loops": float(len(topology.boundary_loops)),
        "euler_characteristic": float(topology.euler_characteristic),
        "planarity": float(planarity_deviation(ring.mesh).max()),
        "cone_spread": float(fitted_cones(ring.mesh).relative_spread.max()),
        "distance_error": max(layer.distance_error_max for layer in ring.layers),
        "parallel_error": max(layer.parallel_error_max for layer in ring.layers),
        "twist_deg": float(np.degrees(ring.support.twist.max())),
        "first_reversed_edge": low,
    }
    for name, value in found.items():
        print(f"{name:20} {value:.3g}")
    if picture:
        from pqmesh.view import figures

        layers = [layer.mesh for layer in ring.layers]
        title = "A torus of conical panels, closed both ways"
        drawn = figures.layers_figure(ring.mesh, layers, ring.support.quads, units="m", title=title)
        Path(picture).write_bytes(drawn)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
