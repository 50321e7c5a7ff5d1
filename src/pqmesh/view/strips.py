"""Picture of PQ strips: on the mesh, and rolled out beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.fabricate.unroll import UnrolledStrip
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.scene import Scene, add_shadow, face_polygons, rgba
from pqmesh.view.sheet import INK, count, number, paper

# Strips in turn, so that neighbours differ.
COLORS = ("#8fc3d6", "#e9b872", "#9dbf8a", "#d98f7c", "#b3a4cf")
# Gap between strips that lie side by side, in their mean width.
GAP = 0.35


def strips_figure(
    mesh: QuadMesh,
    strips: Sequence[UnrolledStrip],
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of a mesh with some strips coloured, and the same strips flat.

    Parameters
    ----------
    mesh : QuadMesh
    strips : sequence of UnrolledStrip
        Without common faces.
    units : str
        Model unit; each half has its own scale.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    flat = _side_by_side(strips)
    if caption is None:
        area = sum(strip.area for strip in strips)
        caption = f"{count(len(strips), 'strip', 'strips')}, {number(area)} {units}² in space and "
        caption += "in the plane"
    polygons = face_polygons(mesh)
    camera = camera or Camera.around(mesh.vertices, mesh.face_normals)
    with paper(title or "Strips rolled out", caption) as sheet:
        view = View.fitted(camera, mesh.vertices, Box(60, 150, 790, 860))
        scene = Scene(view)
        add_shadow(scene, polygons)
        fill = np.tile(rgba("#eeeae2"), (len(polygons), 1))
        for number_of, strip in enumerate(strips):
            fill[strip.faces] = rgba(COLORS[number_of % len(COLORS)])
        light = camera.light(mesh.face_normals)[:, None]
        fill[:, :3] = np.clip(fill[:, :3] * light, 0.0, 1.0)
        scene.add(polygons, fill, np.tile(rgba(INK), (len(polygons), 1)), 1.0)
        scene.paint(sheet)
        top = Camera.orbit(np.zeros(3), -np.pi / 2, np.pi / 2)
        plane = View.fitted(
            top, _lifted(np.concatenate(flat).reshape(-1, 2)), Box(850, 150, 1540, 860)
        )
        for number_of, points in enumerate(flat):
            quads = np.stack([points[:-1, 0], points[1:, 0], points[1:, 1], points[:-1, 1]], 1)
            pixels = plane.pixels(_lifted(quads))[..., :2]
            color = np.tile(rgba(COLORS[number_of % len(COLORS)]), (len(quads), 1))
            ink = np.tile(rgba(INK), (len(quads), 1))
            sheet.polygons(pixels, color, ink, np.full(len(quads), 1.0))
        sheet.scale_bar(view, units)
        sheet.scale_bar(plane, units, left=850.0)
        return sheet.png()


def _side_by_side(strips: Sequence[UnrolledStrip]) -> list[Floats]:
    """The strips turned to their longest way across and set beside each other, upwards."""
    placed, top = [], 0.0
    for strip in strips:
        points = strip.points - strip.points.reshape(-1, 2).mean(axis=0)
        axes = np.linalg.svd(points.reshape(-1, 2), full_matrices=False)[2]
        # A turn, no mirror image.
        axes[1] *= np.sign(np.linalg.det(axes))
        points = points @ axes.T
        low, high = points[..., 1].min(), points[..., 1].max()
        placed.append(points + np.array([0.0, top - low]))
        top += (high - low) + GAP * float(strip.area / np.ptp(points[..., 0]))
    return placed


def _lifted(points: Floats) -> Floats:
    """Plane points (..., 2) in space."""
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
