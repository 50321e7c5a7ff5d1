"""Pictures of a surface: its curvature lines, and where it has none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.network.meshing import NetworkMesh
from pqmesh.network.principal import CurveNetwork, Inside
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.umbilics import Umbilic
from pqmesh.vectors import Floats
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.patches import (
    Patches,
    Region,
    bisected,
    extent,
    predicate,
    surface_patches,
    with_corners,
)
from pqmesh.view.scene import Scene, add_shadow, ground, polygon_normals, rgba
from pqmesh.view.sheet import GREY, INK, STAGE, ColorScale, Sheet, count, number, paper

LARGER, SMALLER, MARK = "#c2452d", "#1d5b94", "#111417"
RIM = "#8b9096"
STONE = np.array([0.925, 0.915, 0.895])
# Line pieces have this many points; a line is sampled at this share of the surface's size.
PIECE_POINTS, SAMPLING = 4, 1.0 / 220.0


def network_figure(
    network: CurveNetwork,
    mesh: NetworkMesh | None = None,
    *,
    region: Region | None = None,
    umbilics: Sequence[Umbilic] = (),
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of a surface with both families of its network.

    Parameters
    ----------
    mesh : NetworkMesh, optional
        Its rim is drawn.
    region : PlanOutline or predicate over parameters, optional
        The part that is covered; the rest of the surface and its lines are pale.
    umbilics : sequence of Umbilic
        Marked with their kind and place.
    units : str
        Model unit.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    surface = network.surface
    inside = predicate(region, surface)
    counts = [len(lines) for lines in network.families]
    if caption is None:
        caption = (
            f"{counts[0]} + {counts[1]} lines of curvature, {count(len(network.found), 'crossing')}"
        )
        caption += f"  ·  {count(mesh.mesh.topology.n_faces, 'panel')}" if mesh else ""
        caption += f"  ·  {umbilic_words(umbilics)}"
    with paper(title or "Principal network", caption) as sheet:
        patches = surface_patches(surface, inside)
        scene = surface_scene(patches, camera)
        step = SAMPLING * extent(patches)
        lift = 0.8 * patches.size
        for family, color in enumerate((LARGER, SMALLER)):
            for pieces, paint, width in zip(
                line_pieces(network, family, inside, step),
                (rgba(color), rgba(color, 0.16)),
                (1.7, 1.0),
                strict=True,
            ):
                scene.add_lines(pieces, paint, width, lift)
        scene.add_lines(with_corners(surface, region, patches), rgba(INK), 3.0, 1.3 * lift)
        if mesh is not None:
            scene.add_lines(_mesh_rim(mesh), rgba(RIM), 1.3, 1.2 * lift)
        scene.paint(sheet)
        mark_umbilics(sheet, scene, umbilics, patches.size)
        sheet.scale_bar(scene.view, units)
        entries = [(LARGER, "larger principal curvature"), (SMALLER, "smaller principal curvature")]
        entries += [(INK, "outline")] if len(patches.rim) else []
        sheet.legend(entries + ([(RIM, "rim of the panels")] if mesh else []))
        return sheet.png()


def viability_figure(
    surface: Surface,
    region: Region | None = None,
    umbilics: Sequence[Umbilic] = (),
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of |k1 - k2| over its median: dark where a surface has no principal directions.

    Parameters are those of `network_figure`.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    inside = predicate(region, surface)
    with paper(title or "Where curvature lines exist", "") as sheet:
        patches = surface_patches(surface, inside)
        uv = surface.domain.reduce(patches.inner_uv)
        k = shape_data(surface.jet(uv)).k
        gap = k[:, 0] - k[:, 1]
        median = float(np.median(gap)) if len(gap) else 0.0
        noise = 1e-9 * float(np.abs(k).max(initial=0.0))
        has_lines = median > noise
        share = gap / median if has_lines else np.full_like(gap, np.nan)
        low, high = (float(share.min()), float(share.max())) if has_lines else (1.0, 1.0)
        scale = ColorScale(1e-2, max(2.0, high), True, True, low < 1e-2)
        scene = surface_scene(patches, camera, scale.colors(share), 0.2)
        scene.add_lines(with_corners(surface, region, patches), rgba(INK), 3.0, patches.size)
        scene.paint(sheet)
        mark_umbilics(sheet, scene, umbilics, patches.size)
        if caption is None:
            caption = "k₁ = k₂ on most of the surface: no lines of curvature"
            if has_lines:
                caption = f"smallest |k₁ − k₂| is {number(low)} of the median"
            caption += f"  ·  {umbilic_words(umbilics)}" if has_lines or umbilics else ""
        sheet.text(60, 906, caption, "caption", color=GREY)
        sheet.scale_bar(scene.view, units)
        sheet.color_bar(scale, "|k₁ − k₂| / median", "")
        return sheet.png()


# --- the shaded surface ------------------------------------------------------------------------


def surface_scene(
    patches: Patches,
    camera: Camera | None,
    rgb: Floats | None = None,
    depth: float = 0.8,
    box: Box = STAGE,
) -> Scene:
    """Scene of the shaded surface, pale outside the region, in a box of the sheet."""
    inner, outer = patches.inner, patches.outer
    shown = inner if len(inner) else outer
    camera = camera or Camera.around(shown.reshape(-1, 3), polygon_normals(shown))
    everything = np.concatenate([inner.reshape(-1, 3), outer.reshape(-1, 3)])
    dropped = ground(inner).reshape(-1, 3)
    scene = Scene(View.fitted(camera, np.concatenate([everything, dropped]), box))
    add_shadow(scene, inner)
    light = camera.light(polygon_normals(inner), depth=depth)
    base = STONE if rgb is None else rgb
    fill = np.column_stack([np.clip(base * light[:, None], 0, 1), np.ones(len(inner))])
    scene.add(inner, fill, fill, 0.9)
    pale = 0.965 + 0.10 * (camera.light(polygon_normals(outer)) - 1.0)
    ghost = np.column_stack([np.repeat(np.clip(pale, 0, 0.985)[:, None], 3, 1), np.ones(len(pale))])
    scene.add(outer, ghost, ghost, 0.9)
    return scene


# --- lines and marks --------------------------------------------------------------------------


def line_pieces(
    network: CurveNetwork, family: int, inside: Inside, step: float
) -> tuple[Floats, Floats]:
    """Short polylines (n, 4, 3) along the lines: those in the region and the others.

    Pieces that cross the rim are cut there.
    """
    surface, lines = network.surface, network.families[family]
    spans = PIECE_POINTS - 1
    rows, arcs = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for line, total in enumerate(lines.total.tolist()):
        pieces = max(int(np.ceil(total / (spans * step))), 1)
        ends = np.linspace(0.0, total, pieces * spans + 1)
        index = np.arange(pieces)[:, None] * spans + np.arange(PIECE_POINTS)[None]
        arcs.append(ends[index].ravel())
        rows.append(np.full(index.size, line))
    uv = lines.at(*lines.locate(np.concatenate(rows), np.concatenate(arcs)))
    truth = np.asarray(inside(surface.domain.reduce(uv))).reshape(-1, PIECE_POINTS)
    uv = uv.reshape(-1, PIECE_POINTS, 2)
    whole, none = truth.all(axis=1), ~truth.any(axis=1)
    mixed = uv[~whole & ~none]
    a, b = mixed[:, :-1].reshape(-1, 2), mixed[:, 1:].reshape(-1, 2)
    at_a = truth[~whole & ~none, :-1].ravel()
    at_b = truth[~whole & ~none, 1:].ravel()
    cut = bisected(surface, inside, a, b, at_a)
    crossed = (at_a != at_b)[:, None]
    first, second = np.where(crossed, cut, b), np.where(crossed, cut, a)
    # A segment on one side alone comes twice, which does no harm.
    parts = np.concatenate([np.stack([a, a, first, first], 1), np.stack([second, second, b, b], 1)])
    truths = np.concatenate([at_a, at_b])
    return (
        _raised(surface, np.concatenate([uv[whole], parts[truths]])),
        _raised(surface, np.concatenate([uv[none], parts[~truths]])),
    )


def _raised(surface: Surface, uv: Floats) -> Floats:
    """Points in space of unwrapped parameters (n, k, 2), shape (n, k, 3)."""
    flat = surface.domain.reduce(uv.reshape(-1, 2))
    return np.asarray(surface.jet(flat).point.reshape(*uv.shape[:2], 3))


def _mesh_rim(mesh: NetworkMesh) -> Floats:
    """Boundary edges of a network mesh, (n, 2, 3)."""
    topology = mesh.mesh.topology
    return np.asarray(mesh.mesh.vertices[topology.edges[topology.is_boundary_edge]])


def umbilic_words(umbilics: Sequence[Umbilic]) -> str:
    """How many umbilics of each kind."""
    if not umbilics:
        return "no umbilic"
    kinds = [u.kind for u in umbilics]
    parts = [f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds))]
    return f"{len(kinds)} umbilic{'s' if len(kinds) > 1 else ''} ({', '.join(parts)})"


def mark_umbilics(sheet: Sheet, scene: Scene, umbilics: Sequence[Umbilic], slack: float) -> None:
    """Signs, kinds and coordinates of umbilics; those behind the surface are hollow."""
    if not umbilics:
        return
    points = np.array([u.point for u in umbilics])
    pixels = scene.view.pixels(points)[:, :2]
    largest = float(np.abs(points).max())
    hidden = scene.hides(points, 1.5 * slack)
    taken: list[tuple[float, float, float, float]] = []
    for umbilic, (x, y), behind in zip(umbilics, pixels.tolist(), hidden.tolist(), strict=True):
        sides = {"star": 3, "monstar": 3, "lemon": 48}.get(umbilic.kind, 4)
        phi = np.pi / 2 + 2 * np.pi * np.arange(sides + 1) / sides
        radius = np.array([11.0, 11.0]) if umbilic.kind != "lemon" else np.array([12.0, 7.5])
        ring = np.array([x, y]) + radius * np.column_stack([np.cos(phi), np.sin(phi)])
        if umbilic.kind == "star":
            inner = np.array([x, y]) + 4.0 * np.column_stack(
                [np.cos(phi[:-1] + np.pi / 3), np.sin(phi[:-1] + np.pi / 3)]
            )
            ring = np.append(np.stack([ring[:-1], inner], 1).reshape(-1, 2), ring[:1], axis=0)
        sheet.line(ring, "white", 6.0, zorder=9e5)
        sheet.axes.fill(
            ring[:, 0], ring[:, 1], facecolor="white" if behind else MARK, edgecolor=MARK,
            linewidth=0.6, zorder=9.1e5, alpha=0.75 if behind else 1.0,
        )  # fmt: skip
        place = ", ".join(number(0.0 if abs(c) < 1e-6 * largest else c) for c in umbilic.point)
        words = f"{umbilic.kind} ({place})"
        words += "  behind" if behind else ""
        left, bottom = _free_place(taken, x, y, 8.6 * len(words))
        sheet.text(left, bottom, words, halo=True, color=GREY if behind else INK)


def _free_place(
    taken: list[tuple[float, float, float, float]], x: float, y: float, width: float
) -> tuple[float, float]:
    """Lower left of a label near a pixel that covers no earlier one; keeps it in `taken`."""
    right, left = x + 18.0, x - 18.0 - width
    choices = [(right, y - 7), (left, y - 7), (right, y + 18), (left, y + 18), (right, y - 32),
               (left, y - 32), (x - width / 2, y + 24), (x - width / 2, y - 40)]  # fmt: skip
    for place in choices:
        box = (place[0], place[1], place[0] + width, place[1] + 22)
        on_sheet = box[0] > 20 and box[2] < 1580
        if on_sheet and not any(
            box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken
        ):
            break
    else:
        place = choices[0]
    taken.append((place[0], place[1], place[0] + width, place[1] + 22))
    return place
