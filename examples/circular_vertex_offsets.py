"""A circular mesh and its vertex offsets: every node moves by exactly the same distance.

Each face has a circumcircle, and the nodes of all layers lie on common axes. Run it with
`python examples/circular_vertex_offsets.py`, and with a path to get a picture.
"""

import sys
from pathlib import Path

import numpy as np

import pqmesh
from pqmesh.job import Spec, panelize
from pqmesh.mesh.measure import circle_deviation, circularity_defect, planarity_deviation
from pqmesh.offset.offsets import face_distance, vertex_distance


def main(picture: str | None = None) -> dict[str, float]:
    """Panel a saddle with circular quads, offset it, print and return the numbers."""
    surface = pqmesh.graph_surface("x**2/40 - y**2/24 + x*y**2/600", (-9, 9), (-6, 6))
    wanted = Spec(edges=(1.5, 1.5), kind="circular", distances=(0.3,))
    roof = panelize(surface, wanted)
    layer = pqmesh.vertex_offset(roof.mesh, 0.3)
    found = {
        "panels": float(roof.mesh.topology.n_faces),
        "circularity_before_deg": float(np.degrees(np.abs(circularity_defect(roof.start)).max())),
        "circularity_deg": float(np.degrees(np.abs(circularity_defect(roof.mesh)).max())),
        "circle_deviation": float(circle_deviation(layer).max()),
        "planarity": float(planarity_deviation(layer).max()),
        "vertex_distance_error": float(np.abs(vertex_distance(roof.mesh, layer) - 0.3).max()),
        "face_distance_range": float(np.ptp(face_distance(roof.mesh, layer))),
        "twist_deg": float(np.degrees(roof.support.twist.max())),
    }
    for name, value in found.items():
        print(f"{name:22} {value:.3g}")
    if picture:
        from pqmesh.view import figures

        title = "A circular mesh and its vertex offset"
        drawn = figures.layers_figure(
            roof.mesh, [layer], roof.support.quads, units="m", title=title
        )
        Path(picture).write_bytes(drawn)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
