"""Polygons and line pieces in space, painted from back to front."""

from __future__ import annotations

from typing import Any

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices, Mask, cross, unit
from pqmesh.view.camera import View
from pqmesh.view.sheet import Sheet

CLEAR = np.zeros(4)


def rgba(color: str, alpha: float = 1.0) -> Floats:
    """Red, green, blue and alpha of '#rrggbb', shape (4,).

    Examples
    --------
    >>> rgba("#ff0000", 0.5)
    array([1. , 0. , 0. , 0.5])
    """
    return np.array([*(int(color[i : i + 2], 16) / 255.0 for i in (1, 3, 5)), alpha])


class Scene:
    """What is to be painted in one view."""

    def __init__(self, view: View) -> None:
        self.view = view
        self._parts: list[tuple[Floats, Floats, Floats, Floats, Floats]] = []

    def add(
        self,
        polygons: Floats,
        fill: Floats,
        stroke: Floats,
        width: float,
        *,
        lift: float = 0.0,
        nearness: Floats | None = None,
    ) -> None:
        """Polygons (n, k, 3) with fills and strokes (n, 4) or (4,); strokes `width` pixels wide.

        They are painted in the order of their mean nearness to the viewer plus `lift` (model
        unit), or of the nearness given.
        """
        if not len(polygons):
            return
        n = len(polygons)
        seen = self.view.pixels(polygons)
        near = seen[..., 2].mean(axis=1) if nearness is None else nearness
        self._parts.append(
            (
                seen[..., :2],
                np.broadcast_to(fill, (n, 4)),
                np.broadcast_to(stroke, (n, 4)),
                np.full(n, width),
                near + lift,
            )
        )

    def add_lines(self, pieces: Floats, color: Floats, width: float, lift: float) -> None:
        """Open polylines (n, k, 3)."""
        # A polygon that runs back along itself is an open line.
        there_and_back = np.concatenate([pieces, pieces[:, -2:0:-1]], axis=1)
        self.add(there_and_back, CLEAR, color, width, lift=lift)

    def paint(self, sheet: Sheet, clip: Any = None) -> None:
        """Put everything on the sheet, the nearest last."""
        if not self._parts:
            return
        longest = max(part[0].shape[1] for part in self._parts)
        pixels = np.concatenate(
            [np.pad(part[0], ((0, 0), (0, longest - part[0].shape[1]), (0, 0)), "edge")
             for part in self._parts]
        )  # fmt: skip
        fill, stroke, width, near = (
            np.concatenate([part[i] for part in self._parts]) for i in range(1, 5)
        )
        order = np.argsort(near, kind="stable")
        sheet.polygons(pixels[order], fill[order], stroke[order], width[order], clip)

    def hides(self, points: Floats, slack: float) -> Mask:
        """Truth for points (n, 3) that lie behind a filled polygon by more than the slack."""
        seen = self.view.pixels(points)
        hidden = np.zeros(len(points), dtype=np.bool_)
        for pixels, fill, _, _, near in self._parts:
            solid = pixels[fill[:, 3] > 0.9]
            nearer = near[fill[:, 3] > 0.9]
            after = np.roll(solid, -1, axis=1)
            for i, (x, y, depth) in enumerate(seen.tolist()):
                spans = (solid[..., 1] > y) != (after[..., 1] > y)
                rise = np.where(spans, after[..., 1] - solid[..., 1], 1.0)
                at = solid[..., 0] + (y - solid[..., 1]) / rise * (after[..., 0] - solid[..., 0])
                covers = ((spans & (x < at)).sum(axis=1) % 2).astype(np.bool_)
                hidden[i] |= bool((covers & (nearer > depth + slack)).any())
        return hidden


def face_polygons(mesh: PolyMesh) -> Floats:
    """Corners of the faces, (F, k, 3); shorter faces repeat their last corner."""
    topology = mesh.topology
    sizes = topology.face_sizes
    place = np.minimum(np.arange(int(sizes.max()))[None], sizes[:, None] - 1)
    corners: Indices = topology.indices[topology.offsets[:-1, None] + place]
    return np.asarray(mesh.vertices[corners])


def polygon_normals(polygons: Floats) -> Floats:
    """Unit normals of polygons (n, k, 3); zero without area."""
    base = polygons - polygons[:, :1]
    areas = cross(base[:, 1:-1], base[:, 2:]).sum(axis=1)
    return unit(areas)


def ground(polygons: Floats) -> Floats:
    """Polygons (n, k, 3) dropped upon the level of their lowest point."""
    dropped = polygons.copy()
    if len(polygons):
        dropped[..., 2] = polygons[..., 2].min()
    return dropped


def add_shadow(scene: Scene, polygons: Floats) -> None:
    """The ground under polygons, a breath darker than the sheet."""
    dropped = ground(polygons)
    tone = np.array([0.955, 0.957, 0.960, 1.0])
    scene.add(dropped, tone, tone, 0.8, nearness=np.full(len(dropped), -np.inf))
