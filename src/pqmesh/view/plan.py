"""Pictures from above: a site with its buildings and a surface, and the layout of the panels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pqmesh.fabricate.trim import TrimmedPanels
from pqmesh.network.region import PlanOutline
from pqmesh.surface.base import Surface
from pqmesh.vectors import Floats
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.patches import Patches, surface_patches, with_corners
from pqmesh.view.scene import Scene, polygon_normals, rgba
from pqmesh.view.sheet import INK, STAGE, Sheet, count, number, paper, round_length
from pqmesh.view.surfaces import STONE, surface_scene

GROUND, BUILDING, BUILDING_LINE = "#f4f2ec", "#bdb6aa", "#5a544b"
WHOLE, CUT, SLIVER = "#cfe3ec", "#e9b872", "#c2452d"
PANEL_LINE, HEIGHT_LINE = "#2f5366", "#7a6a55"
# Margins around all that stands on the site, and around the roof alone, in its size.
MARGIN, CLOSE_MARGIN = 0.04, 0.15
# Lines of equal height between the lowest and the highest, about.
LEVELS = 14


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What stands around a roof, seen from above.

    Attributes
    ----------
    buildings : tuple of (k, 2), model unit
    names : tuple of (str, (float, float))
        Words and the place of their middle.
    """

    buildings: tuple[Floats, ...] = ()
    names: tuple[tuple[str, tuple[float, float]], ...] = ()


def site_figure(
    surface: Surface,
    outline: PlanOutline,
    around: Surroundings | None = None,
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of a surface on its site: the plan with lines of equal height, and a view of it.

    Parameters
    ----------
    surface : Surface
    outline : PlanOutline
        Only the surface over it is drawn.
    around : Surroundings, optional
    units : str
        Model unit.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    patches = surface_patches(surface, outline.on(surface))
    low, high = _heights(patches)
    step = round_length(1.6 * (high - low) / LEVELS)
    if caption is None:
        wide, long = np.ptp(outline.polygon, axis=0).tolist()
        caption = f"{number(wide)} × {number(long)} {units}, {number(outline.area)} {units}² in "
        caption += f"plan  ·  heights from {number(low)} to {number(high)} {units}, a line every "
        caption += f"{number(step)} {units}"
    levels = level_pieces(patches.inner, step)
    rim = with_corners(surface, outline, patches)
    with paper(title or "Site plan", caption) as sheet:
        everything = [*outline.rings, *(around.buildings if around else ())]
        frame = _framed(np.concatenate(everything), MARGIN)
        view = _site(sheet, around, frame, Box(60, 125, 1040, 880))
        scene = Scene(view)
        light = _light(patches.inner)
        fill = np.column_stack([np.clip(STONE * light[:, None], 0, 1), np.ones(len(light))])
        scene.add(patches.inner, fill, fill, 0.9)
        _add_levels(scene, levels, patches.size)
        scene.add_lines(rim, rgba(INK), 3.0, 100 * patches.size)
        scene.paint(sheet)
        _name_levels(sheet, view, levels, step, units)
        aside = replace(patches, outer=patches.outer[:0])
        tilted = surface_scene(aside, camera, box=Box(1080, 250, 1560, 760))
        _add_levels(tilted, levels, patches.size)
        tilted.add_lines(rim, rgba(INK), 2.4, 1.5 * patches.size)
        tilted.paint(sheet)
        sheet.scale_bar(view, units)
        return sheet.png()


def layout_figure(
    panels: TrimmedPanels,
    around: Surroundings | None = None,
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
) -> bytes:
    """PNG of trimmed panels on their site: those that are cut are shaded, slivers marked.

    Parameters are those of `site_figure`, and the panels.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    cut = int(panels.is_trimmed.sum())
    amounts = (len(panels.polygons) - cut, cut - len(panels.slivers), len(panels.slivers))
    if caption is None:
        caption = f"{count(len(panels.polygons), 'panel')}  ·  "
        caption += f"{number(float(panels.area.sum()))} {units}² of panels over "
        caption += f"{number(panels.outline.area)} {units}² in plan"
    with paper(title or "Layout of the panels", caption) as sheet:
        view = _site(sheet, around, _framed(panels.outline.polygon, CLOSE_MARGIN), STAGE)
        scene = Scene(view)
        kind = panels.is_trimmed.astype(np.int64)
        kind[panels.slivers] = 2
        colors = np.array([rgba(color) for color in (WHOLE, CUT, SLIVER)])
        longest = max(len(polygon) for polygon in panels.polygons)
        corners = np.stack([_padded(polygon, longest) for polygon in panels.polygons])
        fill = colors[kind]
        fill[:, :3] = np.clip(fill[:, :3] * _light(corners, 0.35)[:, None], 0, 1)
        scene.add(corners, fill, rgba(PANEL_LINE, 0.85), 0.8)
        scene.paint(sheet)
        ring = np.append(panels.outline.polygon, panels.outline.polygon[:1], axis=0)
        sheet.line(_flat(view, ring), INK, 3.0)
        sheet.scale_bar(view, units)
        words = ("whole", "cut by the outline", "cut to slivers")
        shown = [
            (color, f"{count(amount)} {word}")
            for color, amount, word in zip((WHOLE, CUT, SLIVER), amounts, words, strict=True)
            if amount
        ]
        sheet.legend(shown, 1330)
        return sheet.png()


# --- the site ---------------------------------------------------------------------------------


def _site(
    sheet: Sheet, around: Surroundings | None, frame: tuple[Floats, Floats], box: Box
) -> View:
    """Ground, buildings and north arrow in a box, and the view from above they are drawn in."""
    corners = np.stack(frame)
    camera = Camera.orbit(np.zeros(3), -0.5 * np.pi, 0.5 * np.pi)
    view = View.fitted(camera, _lifted(corners), box)
    low, high = _flat(view, corners)
    ground = sheet.rectangle(low, high, GROUND)
    for ring in around.buildings if around else ():
        fill, line = rgba(BUILDING)[None], rgba(BUILDING_LINE)[None]
        sheet.polygons(_flat(view, ring)[None], fill, line, np.array([1.6]), ground)
    tip = high - np.array([34.0, 34.0])
    arrow = tip + np.array([[0.0, 0.0], [9.0, -34.0], [0.0, -27.0], [-9.0, -34.0]])
    sheet.polygons(arrow[None], rgba(INK)[None], rgba(INK)[None], np.array([0.0]))
    sheet.text(float(tip[0]), float(tip[1]) + 6.0, "N", ha="center")
    for words, place in around.names if around else ():
        # Room for half a word between its middle and the edge.
        x, y = _flat(view, np.array([place]))[0].tolist()
        half = 5.0 * len(words)
        if low[0] + half < x < high[0] - half and low[1] + 20.0 < y < high[1] - 20.0:
            sheet.text(x, y - 6.0, words, ha="center", halo=True)
    return view


def _framed(points: Floats, margin: float) -> tuple[Floats, Floats]:
    """Lower left and upper right of plan points (n, 2) with a margin in their size."""
    room = margin * float(np.ptp(points, axis=0).max())
    return points.min(axis=0) - room, points.max(axis=0) + room


def _lifted(points: Floats) -> Floats:
    """Plan points (n, 2) at height 0."""
    return np.column_stack([points, np.zeros(len(points))])


def _flat(view: View, points: Floats) -> Floats:
    """Pixels (n, 2) of plan points (n, 2)."""
    return np.asarray(view.pixels(_lifted(points))[:, :2])


def _light(polygons: Floats, depth: float = 0.9) -> Floats:
    """Brightness of polygons (n, k, 3) seen from above, lit from the north-west."""
    normals = polygon_normals(polygons)
    normals = np.where(normals[:, 2:] < 0, -normals, normals)
    slope = normals[:, :2] @ np.array([-0.7, 0.7])
    return np.asarray(1.0 + depth * 0.45 * np.clip(slope, -1.0, 1.0))


def _padded(polygon: Floats, longest: int) -> Floats:
    """A polygon with its last corner repeated."""
    return np.pad(polygon, ((0, longest - len(polygon)), (0, 0)), "edge")


# --- lines of equal height ----------------------------------------------------------------------


def _heights(patches: Patches) -> tuple[float, float]:
    """Lowest and highest point of the inner part."""
    z = patches.inner[..., 2]
    return float(z.min()), float(z.max())


def level_pieces(polygons: Floats, step: float) -> dict[int, Floats]:
    """Segments (m, 2, 3) of lines of equal height on convex polygons (n, k, 3), by steps."""
    following = np.roll(polygons, -1, axis=1)
    z, ahead = polygons[..., 2], following[..., 2]
    pieces = {}
    for index in range(int(np.ceil(z.min() / step)), int(np.floor(z.max() / step)) + 1):
        level = index * step
        crossed = (z < level) != (ahead < level)
        rows = np.flatnonzero(crossed.sum(axis=1) == 2)
        places = np.argsort(~crossed[rows], axis=1, kind="stable")[:, :2]
        a, b = polygons[rows[:, None], places], following[rows[:, None], places]
        share = (level - a[..., 2]) / (b[..., 2] - a[..., 2])
        pieces[index] = a + share[..., None] * (b - a)
    return pieces


def _add_levels(scene: Scene, levels: dict[int, Floats], lift: float) -> None:
    """Lines of equal height, every fifth of them heavier."""
    for index, pieces in levels.items():
        heavy = index % 5 == 0
        scene.add_lines(pieces, rgba(HEIGHT_LINE, 0.9), 2.0 if heavy else 0.9, lift)


def _name_levels(
    sheet: Sheet, view: View, levels: dict[int, Floats], step: float, units: str
) -> None:
    """Heights at the heavy lines, in the middle of their southern and their northern part."""
    for index, pieces in levels.items():
        middle = view.pixels(pieces.mean(axis=1))[:, :2]
        centre = 0.5 * (middle[:, 1].min() + middle[:, 1].max()) if len(middle) else 0.0
        for side in (middle[:, 1] < centre, middle[:, 1] >= centre):
            rows = np.flatnonzero(side)
            if index % 5 == 0 and len(rows):
                place = middle[rows[np.argsort(middle[rows, 0])[len(rows) // 2]]]
                words = f"{number(index * step)} {units}".strip()
                sheet.text(place[0], place[1] - 6, words, ha="center", halo=True, color=HEIGHT_LINE)
