"""A torus of flat panels, bent into a Dupin cyclide by a Laguerre transformation.

The panels stay flat, the nodes stay conical, and every layer is mapped to a layer of the image.
Run it with `python examples/torus_to_cyclide.py`, and with a path to get a picture.
"""

import sys
from pathlib import Path

import numpy as np

from pqmesh.mesh.exact import tangent_plane_mesh
from pqmesh.mesh.measure import fitted_cones, planarity
from pqmesh.offset.offsets import edge_factors, face_distance, face_offset
from pqmesh.transform.conical import rapidity_range
from pqmesh.transform.laguerre import LaguerreTransform


def main(picture: str | None = None) -> dict[str, float]:
    """Bend the torus, print what is left of its properties, and return the numbers."""
    u, v = np.meshgrid(np.arange(36) * np.pi / 18, np.arange(18) * np.pi / 9, indexing="ij")
    normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=-1)
    planes = np.concatenate([normals, (3.0 * np.cos(v) + 1.0)[..., None]], axis=-1)
    torus = tangent_plane_mesh(planes, (True, True))
    _, bearable = rapidity_range(torus, [1.0, 0.0, 0.0])
    image = LaguerreTransform.boost([1.0, 0.0, 0.0], 0.8 * bearable).of_mesh(torus)
    layer = face_offset(image.mesh, 0.1)
    found = {
        "panels": float(torus.topology.n_faces),
        "rapidity_limit": bearable,
        "planarity": float(planarity(image.mesh).max()),
        "cone_spread": float(fitted_cones(image.mesh).relative_spread.max()),
        "layer_distance_error": float(np.abs(face_distance(image.mesh, layer) - 0.1).max()),
        # Radius 1 all around the torus; 1 / largest curvature of an edge.
        "thinnest_tube_radius": 1.0 / float(edge_factors(image.mesh, image.vectors).max()),
    }
    for name, value in found.items():
        print(f"{name:21} {value:.3g}")
    if picture:
        from pqmesh.view import figures

        title = "A cyclide of conical panels, and its layer"
        Path(picture).write_bytes(
            figures.layers_figure(image.mesh, [layer], units="m", title=title)
        )
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
