"""The meshes of the table: exact curvature lines, a roof off every conjugate net, real files."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pqmesh.io.compas import polygons_from_compas
from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import drop_unused
from pqmesh.surface.analytic import ellipsoid
from pqmesh.surface.base import Surface
from pqmesh.surface.formula import graph_surface
from pqmesh.surface.reference import Reference, SurfaceReference, TriangleReference

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("PQMESH_DATA", ROOT.parent / "shared" / "data"))

FILES = {
    "six": "six.off",
    "YasIsland": "YasIsland.off",
    "formfinding-circular": "formfinding-circular.off",
    "inspired": "inspired_mesh_quads_Conjugate.off",
    "conical1": "conical1.obj",
    "thrust": "examples_dropdowns_5.json",
    "M2_eq_quad2": "M2_eq_quad2.obj",
    "tubemesh": "tubemesh.obj",
    "hypar": "hypar.obj",
}


@dataclass(frozen=True)
class Case:
    """A start mesh and the surface it stands for."""

    name: str
    mesh: QuadMesh
    reference: Reference


def case(name: str) -> Case:
    """A mesh by name: `ellipsoid-N` and `roof-N` with N vertices a side, or one of FILES.

    Examples
    --------
    >>> case("ellipsoid-21").mesh.vertices.shape
    (441, 3)
    """
    family, _, count = name.rpartition("-")
    if family in ("ellipsoid", "roof") and count.isdigit() and int(count) > 2:
        return (_ellipsoid if family == "ellipsoid" else _roof)(int(count), name)
    if name not in FILES:
        known = ", ".join(["ellipsoid-N", "roof-N", *FILES])
        raise ValueError(f"The mesh must be one of {known}; found {name!r}.")
    path = DATA / FILES[name]
    mesh = _thrust_diagram(path) if path.suffix == ".json" else read_quad_mesh(path)
    return Case(name, mesh, TriangleReference.of_polygons(mesh.vertices, mesh.faces.tolist()))


def _ellipsoid(n: int, name: str) -> Case:
    """Curvature lines of the ellipsoid with squared axes 9, 4, 1, n x n vertices."""
    a, b, c = 9.0, 4.0, 1.0
    low, high = np.meshgrid(
        np.linspace(c + 0.15 * (b - c), b - 0.25 * (b - c), n),
        np.linspace(b + 0.25 * (a - b), a - 0.15 * (a - b), n),
        indexing="ij",
    )
    x = np.sqrt(a * (a - low) * (a - high) / ((a - b) * (a - c)))
    y = np.sqrt(b * (b - low) * (high - b) / ((a - b) * (b - c)))
    z = np.sqrt(c * (low - c) * (high - c) / ((a - c) * (b - c)))
    surface = ellipsoid(3.0, 2.0, 1.0, u=(0.0, 0.5 * np.pi), v=(0.0, 1.5))
    longitude = np.arctan2(y / 2.0, x / 3.0)
    return _of_surface(name, surface, (x, y, z), (longitude, np.arcsin(z)))


def _roof(n: int, name: str) -> Case:
    """Plan grid of a roof, n x n vertices: far from conjugate, 26 degrees off balance."""
    surface = graph_surface("4*cos(0.15*x)*cos(0.12*y) + 0.015*x*y", (-10.0, 10.0), (-10.0, 10.0))
    x, y = np.meshgrid(*2 * [np.linspace(-10.0, 10.0, n)], indexing="ij")
    z = 4 * np.cos(0.15 * x) * np.cos(0.12 * y) + 0.015 * x * y
    return _of_surface(name, surface, (x, y, z), (x, y))


def _of_surface(name: str, surface: Surface, xyz: tuple, uv: tuple) -> Case:
    """Grid on a surface, with the parameters of its vertices."""
    points, parameters = (np.stack(part, axis=-1) for part in (xyz, uv))
    m, n = points.shape[:2]
    mesh = QuadMesh.of(points.reshape(-1, 3), grid_faces(m - 1, n - 1))
    return Case(name, mesh, SurfaceReference(surface, parameters.reshape(-1, 2)))


def _thrust_diagram(path: Path) -> QuadMesh:
    """The thrust diagram of a saved analysis, without the faces that only close its openings."""
    item = json.loads(path.read_bytes())["scene"]["data"]["items"][2]
    polygons = polygons_from_compas(json.dumps(item).encode())
    quads = [face for face in polygons.face_lists() if len(face) == 4]
    faces, used = drop_unused(quads, len(polygons.vertices))
    return QuadMesh.of(polygons.vertices[used], faces)
