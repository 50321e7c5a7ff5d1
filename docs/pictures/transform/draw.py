"""Draws the pictures of the page on transformations into this folder."""

import io
from pathlib import Path

import numpy as np
from PIL import Image

from pqmesh.mesh.exact import rotational_mesh, tangent_plane_mesh
from pqmesh.transform.circular import face_circles
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.moebius import MoebiusTransform
from pqmesh.vectors import unit
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.scene import CLEAR, Scene, face_polygons, rgba
from pqmesh.view.sheet import GREY, INK, paper

HERE = Path(__file__).parent
PANEL, BACK, EDGE = np.array([0.71, 0.80, 0.86]), np.array([0.91, 0.86, 0.77]), rgba("#2b2f36")


def torus(columns=36, rows=18, ring=3.0, tube=1.0):
    """Closed conical mesh in tangent planes of a torus, normals outwards."""
    u, v = np.meshgrid(
        np.arange(columns) * 2 * np.pi / columns, np.arange(rows) * 2 * np.pi / rows, indexing="ij"
    )
    normals = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=-1)
    heights = (ring * np.cos(v) + tube)[..., None]
    return tangent_plane_mesh(np.concatenate([normals, heights], axis=-1), (True, True))


def add_mesh(scene, mesh, width=1.0):
    """Faces in the light of the camera, both sides."""
    camera = scene.view.camera
    light = camera.light(mesh.face_normals)[:, None]
    front = (mesh.face_normals @ camera.axes[2] > 0)[:, None]
    fill = np.column_stack(
        [np.clip(light * np.where(front, PANEL, BACK), 0, 1), np.ones(len(light))]
    )
    scene.add(face_polygons(mesh), fill, EDGE, width)


def ring(center, radius, axis, count=73):
    """Closed polyline (count, 3) of a circle."""
    first = unit(np.cross(axis, [0.3, 0.5, 0.1]))
    t = np.linspace(0, 2 * np.pi, count)[:, None]
    return center + radius * (np.cos(t) * first + np.sin(t) * np.cross(axis, first))


def torus_to_cyclides():
    """A torus and two of its images under boosts."""
    start = torus()
    title = "A torus, bent by boosts into Dupin cyclides"
    caption = "648 planar panels; every state is conical to rounding, and keeps its curvature lines"
    with paper(title, caption) as sheet:
        for k, rapidity in enumerate((0.0, 0.14, 0.27)):
            mesh = LaguerreTransform.boost([1, 0, 0], rapidity).of_mesh(start).mesh
            camera = Camera.orbit(mesh.vertices.mean(axis=0), np.radians(-62), np.radians(38))
            box = Box(50 + 515 * k, 190, 530 + 515 * k, 830)
            scene = Scene(View.fitted(camera, mesh.vertices, box))
            add_mesh(scene, mesh, 0.7)
            scene.paint(sheet)
            sheet.text(box.middle[0], 110, f"rapidity {rapidity:g}", ha="center")
        return sheet.png()


def inversion_of_a_circular_mesh():
    """A circular mesh and its image, both with the circles of their faces."""
    z = np.array([0.0, 0.35, 0.8, 1.2, 1.7, 2.0, 2.5])
    profile = np.column_stack([1.6 + 0.45 * np.sin(1.1 * z), z])
    start = rotational_mesh(profile, np.array([0, 0.2, 0.5, 0.7, 1.1, 1.3, 1.7, 2.0, 2.2, 2.6]))
    found = MoebiusTransform.inversion([0.6, 2.6, 3.4], 2.2)
    image = found.of_mesh(start).mesh
    title = "A circular mesh, and its image under an inversion"
    caption = "faces change size and shape and keep their circles; edges and planes are drawn anew"
    with paper(title, caption) as sheet:
        for k, mesh in enumerate((start, image.reversed())):
            camera = Camera.around(mesh.vertices, mesh.face_normals)
            box = Box(70 + 760 * k, 170, 770 + 760 * k, 830)
            scene = Scene(View.fitted(camera, mesh.vertices, box))
            add_mesh(scene, mesh, 1.2)
            circles = face_circles(mesh)
            rings = np.stack(
                [
                    ring(*row)
                    for row in zip(circles.centers, circles.radii, circles.axes, strict=True)
                ]
            )
            scene.add_lines(rings, rgba("#b04a2f", 0.55), 1.2, 10.0)
            scene.paint(sheet)
            sheet.text(box.middle[0], 100, ("before", "after")[k], ha="center")
        return sheet.png()


def light_cones():
    """Plane geometry in space: oriented circles (x, y; r) are points, at height r."""
    spheres = np.array([[-0.9, 0.1, 0.7], [0.75, 0.35, 1.25]])
    up = np.array([0.0, 0, 1])
    camera = Camera.orbit(np.array([0.1, 0.0, 0.35]), np.radians(-72), np.radians(24))
    title = "Oriented circles as points over the plane r = 0"
    caption = "light cones cut the plane in the circles; isotropic planes through the line of "
    caption += "both points, in common tangents"
    with paper(title, caption) as sheet:
        ground = np.array([[-2.6, -1.5, 0], [2.6, -1.5, 0], [2.6, 1.9, 0], [-2.6, 1.9, 0]])
        top = np.array([[0, 0, 1.35]])
        view = View.fitted(camera, np.concatenate([ground, top]), Box(60, 90, 1540, 860))
        scene = Scene(view)
        scene.add(ground[None], rgba("#eef0f2"), rgba("#c9ced2"), 1.0, nearness=np.full(1, -1e9))
        gap = spheres[1] - spheres[0]
        apex = spheres[0] - spheres[0][2] / gap[2] * gap
        for x, color in zip(spheres, ("#3f7d9b", "#5b8c5a"), strict=True):
            rim = ring(np.append(x[:2], 0.0), x[2], up)
            sides = np.stack([rim[:-1], rim[1:], np.broadcast_to(x, rim[1:].shape)], axis=1)
            scene.add(sides, rgba(color, 0.28), rgba(color, 0.10), 0.5)
            scene.add_lines(rim[None], rgba(color), 3.0, 5.0)
        scene.add_lines(np.stack([apex, spheres[1] + 0.1 * gap])[None], rgba("#23272b"), 2.2, 6.0)
        # Normals n with n . gap_xy = gap_r: the two isotropic planes through both points.
        flat, length = gap[:2], np.hypot(*gap[:2])
        along, across = gap[2] / length, np.sqrt(1 - (gap[2] / length) ** 2)
        for side in (1, -1):
            u = flat / length
            n = along * u + side * across * np.array([-u[1], u[0]])
            t = np.array([-n[1], n[0]])
            t = t * np.sign(t @ flat)
            ends = np.stack([np.append(apex[:2] + s * t, 0.0) for s in (0.0, 4.3)])
            scene.add_lines(ends[None], rgba("#b04a2f"), 2.6, 7.0)
            if side > 0:
                triangle = np.stack(
                    [apex, spheres[1], np.append(spheres[1][:2] - spheres[1][2] * n, 0.0)]
                )
                scene.add(triangle[None], rgba("#b04a2f", 0.22), CLEAR, 0.0, lift=4.0)
        scene.paint(sheet)
        names = zip(
            [*spheres, apex],
            ["X = (p, r)", "Y = (q, s)", "the line meets r = 0 in the apex"],
            strict=True,
        )
        for x, words in names:
            seen = view.pixels(x)[:2]
            sheet.circle(seen, 6, facecolor=INK, edgecolor="white")
            is_apex = words.endswith("apex")
            at = seen + (np.array([4, -110]) if is_apex else np.array([14, 10]))
            sheet.text(*at, words, "caption", halo=True)
        sheet.text(
            60,
            60,
            "the same in space: spheres, their common tangent planes, and the cone these envelop",
            color=GREY,
        )
        return sheet.png()


if __name__ == "__main__":
    for draw in (torus_to_cyclides, inversion_of_a_circular_mesh, light_cones):
        sheet = Image.open(io.BytesIO(draw())).convert("RGB").resize((1200, 750), Image.LANCZOS)
        name = f"{draw.__name__.replace('_', '-')}.png"
        # A palette makes the files four times smaller, and nothing else.
        sheet.quantize(96, dither=Image.Dither.NONE).save(HERE / name, optimize=True)
