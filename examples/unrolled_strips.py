"""Strips of a planar mesh rolled out: each is a discrete developable surface.

A row of flat quads can be laid into the plane without stretching, and so be cut from one sheet of
metal. Run it with `python examples/unrolled_strips.py`, and with a path to get a picture.
"""

import sys
from pathlib import Path

import numpy as np

import pqmesh
from pqmesh.fabricate.unroll import unrolled_strip
from pqmesh.job import Spec, panelize
from pqmesh.vectors import norm


def main(picture: str | None = None) -> dict[str, float]:
    """Panel a vault, unroll every third strip along it, print and return the numbers."""
    surface = pqmesh.graph_surface("4 - y**2/10 - x**2/60 + x*y/50", (-8, 8), (-5, 5))
    mesh = panelize(surface, Spec(edges=(1.0, 1.0), kind="planar")).mesh
    rows = [strip for strip in mesh.topology.strips if len(strip) > 10]
    along = rows[0]
    seen = set(mesh.topology.edge_faces[along].ravel().tolist())
    # Strips beside the first one have no face in common with it.
    rows = [along] + [s for s in rows[1:] if not seen & _faces(mesh, s)]
    strips = [unrolled_strip(mesh, strip) for strip in rows[::3]]
    gaps = []
    for strip in strips:
        flat, space = (_lengths(ends) for ends in (strip.points, mesh.vertices[strip.vertices]))
        gaps.append(np.abs(flat - space).max())
    area = sum(float(norm(mesh.face_area_vectors)[strip.faces].sum()) for strip in strips)
    found = {
        "strips": float(len(strips)),
        "length_error": float(max(gaps)),
        "area_error": abs(sum(strip.area for strip in strips) - area),
    }
    for name, value in found.items():
        print(f"{name:14} {value:.3g}")
    if picture:
        from pqmesh.view import figures

        title = "Strips of flat panels, rolled out"
        Path(picture).write_bytes(figures.strips_figure(mesh, strips, units="m", title=title))
    return found


def _lengths(ends: np.ndarray) -> np.ndarray:
    """Rulings, rims and diagonals between the ends of rulings, (n, 2, 2) or (n, 2, 3)."""
    a, b = ends[:-1], ends[1:]
    pairs = (ends[:, 0] - ends[:, 1], (b - a).reshape(-1, a.shape[2]), b[:, 0] - a[:, 1])
    return np.concatenate([norm(pair) for pair in pairs])


def _faces(mesh: pqmesh.QuadMesh, strip: np.ndarray) -> set[int]:
    """Faces beside the edges of a strip."""
    return {int(face) for face in mesh.topology.edge_faces[strip].ravel() if face >= 0}


if __name__ == "__main__":
    main(*sys.argv[1:2])
