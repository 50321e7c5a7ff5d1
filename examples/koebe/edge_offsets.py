"""Koebe polyhedra, discrete minimal surfaces, and how near edge offsets come to given surfaces.

Run it with `python examples/koebe/edge_offsets.py`: it prints what each patch reaches. With a
folder it also draws the pictures of the documentation there.
"""

import sys
from pathlib import Path

import numpy as np

from pqmesh.koebe.approximate import EdgeOffsetFit, approximate_edge_offset
from pqmesh.koebe.christoffel import christoffel_dual
from pqmesh.koebe.families import discrete_catenoid, rotational_koebe, square_koebe
from pqmesh.koebe.polyhedron import contact_points, koebe_polyhedron
from pqmesh.koebe.square_patch import square_patch
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Topology
from pqmesh.surface.formula import graph_surface
from pqmesh.vectors import cross, dot, unit

# Name: height, center, and half the lengths of the patch; model unit metres.
PATCHES = {
    "dome": ("-0.05*x**2 - 0.08*y**2", (0.3, 0.2), (1.5, 2.0)),
    "saddle": ("0.1*x*y", (0.0, 0.0), (2.0, 2.0)),
    "free-dome": (
        "-0.05*x**2 - 0.1*y**2 + 0.001*x**3*y + 0.003*x*y**2 - 0.001*y**4",
        (0.3, 0.2),
        (1.5, 1.5),
    ),
    "free-saddle": ("0.1*x*y + 0.004*x**3 - 0.002*y**4", (0.1, -0.1), (1.5, 1.5)),
}


def divided_cube(n: int) -> Topology:
    """Cube with n x n quads on each side."""
    number: dict[tuple[int, ...], int] = {}
    faces = []
    for axis in range(3):
        for side in (0, n):
            for i, j in np.ndindex(n, n):
                face = []
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    place = [0, 0, 0]
                    place[axis] = side
                    place[(axis + 1) % 3], place[(axis + 2) % 3] = i + a, j + b
                    face.append(number.setdefault(tuple(place), len(number)))
                faces.append(face if side else face[::-1])
    return Topology(np.array(faces), len(number))


def approximated(name: str, faces: int) -> tuple[float, EdgeOffsetFit]:
    """Defect of the patch, and the best mesh with edge offsets."""
    height, center, extent = PATCHES[name]
    surface = graph_surface(height, (-6.0, 6.0), (-6.0, 6.0))
    patch = square_patch(surface, np.array(center), extent, faces)
    return patch.defect, approximate_edge_offset(surface, patch.mesh, patch.uv)


# --- pictures -----------------------------------------------------------------------------------


def add_koebe(sheet, mesh: PolyMesh, box, camera=None) -> None:
    """A Koebe mesh with the caps of its sphere that stand out of the faces, and its contacts."""
    from pqmesh.view.camera import Camera, View
    from pqmesh.view.layered import lit
    from pqmesh.view.scene import Scene, face_polygons, rgba

    camera = camera or Camera.orbit(np.zeros(3), -0.9, 0.45)
    view = View.fitted(camera, mesh.vertices, box)
    scene = Scene(view)
    light = camera.light(mesh.face_normals)
    ink = rgba("#2b2f36")
    scene.add(face_polygons(mesh), lit("#efece4", light, 1.0), ink, 1.2)
    normals, heights = mesh.face_normals, dot(mesh.face_normals, mesh.face_centers)
    first = unit(cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)]))
    turn = 2.0 * np.pi * np.arange(48) / 48
    round_ = np.cos(turn)[:, None] * first[:, None]
    round_ = round_ + np.sin(turn)[:, None] * cross(normals, first)[:, None]
    radius = np.sqrt(1.0 - heights**2)
    circles = heights[:, None, None] * normals[:, None] + radius[:, None, None] * round_
    near = dot(mesh.face_centers, camera.axes[2][None]) + 1e-3
    seen = normals @ camera.axes[2] > 0
    fill = lit("#8fb3d1", light, 1.0)
    scene.add(circles[seen], fill[seen], rgba("#5c87ab"), 0.7, nearness=near[seen])
    contacts = contact_points(mesh)
    front = contacts @ camera.axes[2] > 0.02
    spots = contacts[front][:, None] + 0.012 * (
        np.cos(turn[::6])[:, None] * camera.axes[0] + np.sin(turn[::6])[:, None] * camera.axes[1]
    )
    scene.add(spots, rgba("#c2452d"), rgba("#c2452d"), 0.4, lift=0.1)
    scene.paint(sheet)


def add_mesh(sheet, mesh: PolyMesh, box, color: str, camera=None) -> None:
    """A mesh in plain shading."""
    from pqmesh.view.camera import Camera, View
    from pqmesh.view.layered import lit
    from pqmesh.view.scene import Scene, face_polygons, rgba

    camera = camera or Camera.around(mesh.vertices, mesh.face_normals)
    scene = Scene(View.fitted(camera, mesh.vertices, box))
    light = camera.light(mesh.face_normals)
    scene.add(face_polygons(mesh), lit(color, light, 1.0), rgba("#2b2f36"), 1.0)
    scene.paint(sheet)


def draw(folder: Path, fits: dict[str, EdgeOffsetFit]) -> None:
    """All pictures."""
    from pqmesh.view import figures
    from pqmesh.view.camera import Box, Camera
    from pqmesh.view.sheet import paper

    folder.mkdir(parents=True, exist_ok=True)
    left, right = Box(90, 130, 760, 860), Box(850, 130, 1510, 860)
    with paper("Koebe polyhedra", "Every edge touches the unit sphere (red)") as sheet:
        add_koebe(sheet, koebe_polyhedron(divided_cube(1)), left)
        add_koebe(sheet, koebe_polyhedron(divided_cube(4)), right)
        (folder / "cubes.png").write_bytes(sheet.png())
    side = Camera.orbit(np.zeros(3), -0.9, 0.3)
    with paper("Discrete catenoid", "The surface, and its Gauss image: a Koebe mesh") as sheet:
        image = rotational_koebe(20, -1.57, 11)
        add_mesh(sheet, discrete_catenoid(20, -1.57, 11), left, "#e8c9a8", side)
        add_koebe(sheet, image, right, side)
        (folder / "catenoid.png").write_bytes(sheet.png())
    above = Camera.orbit(np.zeros(3), -0.6, 0.6)
    with paper("Discrete Enneper surface", "Christoffel dual of a Koebe mesh") as sheet:
        image = square_koebe(21, 21, 0.12, (-1.2, -1.2))
        add_mesh(sheet, christoffel_dual(image), left, "#e8c9a8", above)
        add_koebe(sheet, image, right, above)
        (folder / "enneper.png").write_bytes(sheet.png())
    for name, fit in fits.items():
        values = 100.0 * fit.deviation / fit.mesh.mean_edge_length
        title = f"{name.replace('-', ' ').capitalize()} with exact edge offsets"
        drawn = figures.measure_figure(
            fit.mesh,
            values,
            label="distance from the surface",
            unit="% of an edge",
            units="m",
            at="vertex",
            title=title,
        )
        (folder / f"{name}.png").write_bytes(drawn)


def main(folder: str | None = None) -> dict[str, dict[str, float]]:
    """Approximate all patches, print the figures, and return them."""
    found, fits = {}, {}
    for name in PATCHES:
        for faces in (8, 16):
            defect, fit = approximated(name, faces)
            figures = fit.figures
            row = {"defect": defect, "deviation_max": float(fit.deviation.max()), **figures}
            found[f"{name} {fit.mesh.topology.n_faces}"] = row
            print(f"{name}, {fit.mesh.topology.n_faces} faces")
            for key, value in row.items():
                print(f"    {key:18} {value:.3g}")
            fits[name] = fit
    if folder:
        draw(Path(folder), fits)
    return found


if __name__ == "__main__":
    main(*sys.argv[1:2])
