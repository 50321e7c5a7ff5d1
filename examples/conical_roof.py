"""A small vault of conical panels: flat glass, three exact layers, beams without twist.

Run it with `python examples/conical_roof.py`, and with a path to get a picture.
"""

import sys
from pathlib import Path

import numpy as np

import pqmesh
from pqmesh.job import Spec, panelize
from pqmesh.mesh.measure import fitted_cones, planarity_deviation
from pqmesh.report import deviation
from pqmesh.surface.reference import SurfaceReference


def main(picture: str | None = None) -> dict[str, float]:
    """Panel the vault, print what it reaches, and return the numbers."""
    surface = pqmesh.graph_surface("5 - y**2/16 + x**2/50 + x*y/60", (-9, 9), (-6, 6))
    wanted = Spec(edges=(1.5, 1.5), kind="conical", distances=(-0.4, -0.08, 0.12))
    roof = panelize(surface, wanted)
    moves = deviation(roof.start, roof.mesh, SurfaceReference(surface, roof.uv))
    found = {
        "panels": float(roof.mesh.topology.n_faces),
        "planarity_before": float(planarity_deviation(roof.start).max()),
        "planarity": float(planarity_deviation(roof.mesh).max()),
        "cone_spread": float(fitted_cones(roof.mesh).relative_spread.max()),
        "distance_error": max(layer.distance_error_max for layer in roof.layers),
        "twist_deg": float(np.degrees(roof.support.twist.max())),
        "deviation": moves["max"],
    }
    for name, value in found.items():
        print(f"{name:17} {value:.3g}")
    if picture:
        from pqmesh.view import figures

        layers = [layer.mesh for layer in roof.layers]
        title = "A vault of conical panels in three layers"
        drawn = figures.layers_figure(roof.mesh, layers, roof.support.quads, units="m", title=title)
        Path(picture).write_bytes(drawn)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
