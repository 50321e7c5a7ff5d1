"""Pictures that compare: a surface with an earlier one, networks side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pqmesh.network.principal import CurveNetwork, Inside
from pqmesh.vectors import Floats
from pqmesh.view.camera import Box, Camera
from pqmesh.view.patches import (
    Patches,
    Region,
    extent,
    predicate,
    surface_patches,
    with_corners,
)
from pqmesh.view.scene import Scene, polygon_normals, rgba
from pqmesh.view.sheet import GREY, INK, ColorScale, number, paper
from pqmesh.view.surfaces import LARGER, SAMPLING, SMALLER, line_pieces, surface_scene

LINE = "#23272b"
# Networks stand beside each other in boxes of this width and height, pixels.
BOX_WIDTH, BOX_BOTTOM, BOX_TOP, GAP = 490.0, 330.0, 860.0, 30.0
# Share of the colours for differences: lines must stay legible on the largest.
DEPTH = 0.42


@dataclass(frozen=True, eq=False)
class NamedNetwork:
    """A network with its name and a few words about it, one line each."""

    name: str
    network: CurveNetwork
    words: tuple[str, ...] = ()


def difference_figure(
    network: CurveNetwork,
    difference: Callable[[Floats], Floats],
    *,
    region: Region | None = None,
    label: str,
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of a surface with its lines, coloured by its distance from an earlier state.

    Parameters
    ----------
    network : CurveNetwork
    difference : callable
        Length in the model unit, not negative, for parameters (n, 2).
    region : PlanOutline or predicate over parameters, optional
    label : str
        What the difference is, such as "below the first design".
    units : str
        Model unit.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    surface = network.surface
    inside = predicate(region, surface)
    patches = surface_patches(surface, inside)
    values = np.asarray(difference(surface.domain.reduce(patches.inner_uv)))
    scale = replace(ColorScale.of(values), depth=DEPTH)
    if caption is None:
        caption = f"{number(float(values.max()))} {units} {label} at most, "
        caption += f"{number(float(values.mean()))} {units} in the mean"
    with paper(title or "Two states of a surface", caption) as sheet:
        scene = surface_scene(patches, camera, scale.colors(values), 0.35)
        _add_lines(scene, network, inside, patches, (LINE, LINE), 1.2)
        rim = with_corners(surface, region, patches)
        scene.add_lines(rim, rgba(INK), 3.0, 1.1 * patches.size)
        scene.paint(sheet)
        sheet.scale_bar(scene.view, units)
        sheet.color_bar(scale, label, units)
        return sheet.png()


def networks_figure(
    networks: Sequence[NamedNetwork],
    *,
    region: Region | None = None,
    units: str,
    title: str = "",
    caption: str = "",
    families: tuple[str, str] = ("first family", "second family"),
    camera: Camera | None = None,
) -> bytes:
    """PNG of up to three networks on one surface, side by side in one view.

    Parameters
    ----------
    networks : sequence of NamedNetwork
        On the same surface.
    region : PlanOutline or predicate over parameters, optional
        The part that is drawn.
    units : str
        Model unit.
    families : (str, str)
        Names of the two families of lines, for the legend.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    surface = networks[0].network.surface
    inside = predicate(region, surface)
    patches = surface_patches(surface, inside)
    inner = replace(patches, outer=patches.outer[:0])
    if camera is None:
        camera = Camera.around(patches.inner.reshape(-1, 3), polygon_normals(patches.inner))
    rim = with_corners(surface, region, patches)
    with paper(title or "Networks on one surface", caption) as sheet:
        left = 800.0 - 0.5 * (len(networks) * (BOX_WIDTH + GAP) - GAP)
        for named in networks:
            box = Box(left, BOX_BOTTOM, left + BOX_WIDTH, BOX_TOP)
            scene = surface_scene(inner, camera, box=box)
            _add_lines(scene, named.network, inside, inner, (LARGER, SMALLER), 1.0)
            scene.add_lines(rim, rgba(INK), 2.2, 1.1 * patches.size)
            scene.paint(sheet)
            middle = box.middle[0]
            sheet.text(middle, BOX_BOTTOM - 32, named.name, "caption", ha="center", weight="bold")
            for row, words in enumerate(named.words):
                sheet.text(middle, BOX_BOTTOM - 64 - 27 * row, words, ha="center", color=GREY)
            left += BOX_WIDTH + GAP
        sheet.scale_bar(scene.view, units)
        sheet.legend([(LARGER, families[0]), (SMALLER, families[1]), (INK, "outline")])
        return sheet.png()


def _add_lines(
    scene: Scene,
    network: CurveNetwork,
    inside: Inside,
    patches: Patches,
    colors: tuple[str, str],
    width: float,
) -> None:
    """Both families as far as they run in the region."""
    step = SAMPLING * extent(patches)
    for family, color in enumerate(colors):
        pieces, _ = line_pieces(network, family, inside, step)
        scene.add_lines(pieces, rgba(color, 0.9), width, 0.8 * patches.size)
