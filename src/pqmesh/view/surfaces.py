"""Pictures of a surface: its curvature lines, and where it has none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pqmesh.network.meshing import NetworkMesh
from pqmesh.network.principal import CurveNetwork, Inside
from pqmesh.network.region import PlanOutline
from pqmesh.network.trace import Lines
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.umbilics import Umbilic
from pqmesh.vectors import Floats, Mask, norm
from pqmesh.view.camera import Camera, View
from pqmesh.view.scene import Scene, polygon_normals, rgba, shadow
from pqmesh.view.sheet import GREY, INK, STAGE, ColorScale, Sheet, number, paper

LARGER, SMALLER, MARK = "#c2452d", "#1d5b94", "#111417"
STONE = np.array([0.945, 0.935, 0.915])
# Patches a surface is drawn with, both directions together.
PATCHES = 9000
# Line pieces have this many points; a line is sampled at this share of the surface's size.
PIECE_POINTS, SAMPLING = 4, 1.0 / 220.0
BISECTIONS = 14

Region = PlanOutline | Inside


@dataclass(frozen=True, eq=False)
class Patches:
    """A surface as small polygons, cut exactly along the rim of a region.

    Attributes
    ----------
    inner, outer : (n, k, 3)
        Polygons inside and outside the region.
    inner_uv : (n, 2)
        A parameter point of each inner polygon.
    rim : (m, 2, 3)
        Segments of the rim.
    size : float
        Mean diameter of a patch.
    """

    inner: Floats
    outer: Floats
    inner_uv: Floats
    rim: Floats
    size: float


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
    inside = _predicate(region, surface)
    counts = [len(lines) for lines in network.families]
    if caption is None:
        caption = f"{counts[0]} + {counts[1]} lines of curvature, {number(len(network.found))} crossings"
        caption += f"  ·  {number(mesh.mesh.topology.n_faces)} panels" if mesh else ""
        caption += f"  ·  {_umbilic_words(umbilics)}"
    with paper(title or "Principal network", caption) as sheet:
        patches = surface_patches(surface, inside)
        scene = _surface_scene(patches, camera)
        step = SAMPLING * _extent(patches)
        lift = 0.8 * patches.size
        for lines, color in zip(network.families, (LARGER, SMALLER), strict=True):
            pieces, within = _line_pieces(surface, lines, inside, step)
            scene.add_lines(pieces[within], rgba(color), 1.7, lift)
            scene.add_lines(pieces[~within], rgba(color, 0.16), 1.0, lift)
        scene.add_lines(patches.rim, rgba(INK), 3.0, 1.3 * lift)
        if mesh is not None:
            scene.add_lines(_mesh_rim(mesh), rgba(INK, 0.55), 1.2, 1.2 * lift)
        scene.paint(sheet)
        _mark_umbilics(sheet, scene, umbilics, patches.size)
        sheet.scale_bar(scene.view, units)
        sheet.legend(
            [(LARGER, "larger principal curvature"), (SMALLER, "smaller principal curvature")]
        )
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
    inside = _predicate(region, surface)
    with paper(title or "Where curvature lines exist", "") as sheet:
        patches = surface_patches(surface, inside)
        uv = surface.domain.reduce(patches.inner_uv)
        k = shape_data(surface.jet(uv)).k
        gap = k[:, 0] - k[:, 1]
        median = float(np.median(gap)) if len(gap) else 0.0
        noise = 1e-9 * float(np.abs(k).max(initial=0.0))
        share = gap / median if median > noise else np.zeros_like(gap)
        scale = ColorScale(1e-2, max(10.0 ** 0.5, 1e-2 + float(share.max(initial=0.0))), True, True,
                           bool((share < 1e-2).any()))  # fmt: skip
        scene = _surface_scene(patches, camera, scale.colors(share), 0.35)
        scene.add_lines(patches.rim, rgba(INK), 3.0, patches.size)
        scene.paint(sheet)
        _mark_umbilics(sheet, scene, umbilics, patches.size)
        if caption is None:
            least = number(float(share.min(initial=np.inf)))
            caption = f"smallest |k₁ − k₂| is {least} of the median  ·  {_umbilic_words(umbilics)}"
        sheet.text(60, 906, caption, "caption", color=GREY)
        sheet.scale_bar(scene.view, units)
        sheet.color_bar(scale, "|k₁ − k₂| / median", "")
        return sheet.png()


# --- the surface as polygons ------------------------------------------------------------------


def _predicate(region: Region | None, surface: Surface) -> Inside:
    """Truth over parameters."""
    if region is None:
        return lambda uv: np.ones(len(uv), dtype=np.bool_)
    if isinstance(region, PlanOutline):
        return region.on(surface)
    return region


def surface_patches(surface: Surface, inside: Inside, count: int = PATCHES) -> Patches:
    """About `count` patches of a surface, cut along the rim of a region."""
    grid = _patch_grid(surface, count)
    domain = surface.domain
    flat = grid.reshape(-1, 2)
    points = surface.jet(flat).point.reshape(*grid.shape[:2], 3)
    truth = np.asarray(inside(domain.reduce(flat))).reshape(grid.shape[:2])
    slots, uv, holds = _cell_slots(surface, inside, grid, points, truth)
    corners = holds[:, ::2]
    whole, mixed = corners.all(axis=1), corners.any(axis=1) & ~corners.all(axis=1)
    crossing = holds[:, 1::2] & mixed[:, None]
    inner_mask = np.zeros(slots.shape[:2], dtype=np.bool_)
    inner_mask[:, ::2], inner_mask[:, 1::2] = corners, crossing
    outer_mask = np.zeros_like(inner_mask)
    outer_mask[:, ::2], outer_mask[:, 1::2] = ~corners, crossing
    inner = _gathered(slots[whole | mixed], inner_mask[whole | mixed])
    inner_uv = _gathered(uv[whole | mixed], inner_mask[whole | mixed]).mean(axis=1)
    outer = _gathered(slots[~whole], outer_mask[~whole])
    sizes = norm(slots[:, 4] - slots[:, 0])
    return Patches(inner, outer, inner_uv, _rim(slots, crossing), float(sizes.mean()))


def _patch_grid(surface: Surface, count: int) -> Floats:
    """Cell corners with cells about as wide as long, (n+1, m+1, 2)."""
    domain = surface.domain
    jet = surface.jet(domain.grid(12, 12).reshape(-1, 2))
    wide = float(norm(jet.du).mean() * domain.size[0])
    long = float(norm(jet.dv).mean() * domain.size[1])
    ratio = float(np.clip(wide / max(long, 1e-300), 0.05, 20.0))
    n = max(int(np.sqrt(count * ratio)), 8)
    m = max(int(count / n), 8)
    u = np.linspace(*domain.u, n + 1)
    v = np.linspace(*domain.v, m + 1)
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)


def _cell_slots(
    surface: Surface, inside: Inside, grid: Floats, points: Floats, truth: Mask
) -> tuple[Floats, Floats, Mask]:
    """Corners and edge crossings of each cell in turn: (n, 8, 3), their uv, and their truth.

    Even slots are corners, with the truth of the region; odd slots are the points where the
    rim crosses the edge to the next corner, true where it does.
    """
    shifts = [((0, 0), (1, 0)), ((1, 0), (1, 1)), ((1, 1), (0, 1)), ((0, 1), (0, 0))]
    n, m = truth.shape[0] - 1, truth.shape[1] - 1
    uv = np.empty((n, m, 8, 2))
    place = np.empty((n, m, 8, 3))
    holds = np.zeros((n, m, 8), dtype=np.bool_)
    for k, (a, b) in enumerate(shifts):
        from_a = (slice(a[0], a[0] + n), slice(a[1], a[1] + m))
        from_b = (slice(b[0], b[0] + n), slice(b[1], b[1] + m))
        uv[:, :, 2 * k], place[:, :, 2 * k] = grid[from_a], points[from_a]
        holds[:, :, 2 * k] = truth[from_a]
        crossed = truth[from_a] != truth[from_b]
        uv[:, :, 2 * k + 1], place[:, :, 2 * k + 1] = grid[from_a], points[from_a]
        holds[:, :, 2 * k + 1] = crossed
        if crossed.any():
            start = truth[from_a][crossed]
            at = _bisected(surface, inside, grid[from_a][crossed], grid[from_b][crossed], start)
            uv[:, :, 2 * k + 1][crossed] = at
            place[:, :, 2 * k + 1][crossed] = surface.jet(at).point
    return place.reshape(-1, 8, 3), uv.reshape(-1, 8, 2), holds.reshape(-1, 8)


def _bisected(surface: Surface, inside: Inside, a: Floats, b: Floats, at_a: Mask) -> Floats:
    """Parameters between a and b (n, 2) where the truth of the region changes."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (a + b)
        same = np.asarray(inside(surface.domain.reduce(middle))) == at_a
        a, b = np.where(same[:, None], middle, a), np.where(same[:, None], b, middle)
    return 0.5 * (a + b)


def _gathered(slots: Floats, chosen: Mask) -> Floats:
    """The chosen slots of each row in order, the last one repeated."""
    if not len(slots):
        return np.empty((0, 4, slots.shape[-1]))
    order = np.argsort(~chosen, axis=1, kind="stable")
    counts = np.maximum(chosen.sum(axis=1), 1)
    longest = max(int(counts.max()), 4)
    place = np.minimum(np.arange(longest)[None], counts[:, None] - 1)
    picked = np.take_along_axis(order, place, axis=1)
    return np.asarray(np.take_along_axis(slots, picked[..., None], axis=1))


def _rim(slots: Floats, crossing: Mask) -> Floats:
    """Segments between the crossings of each cell, (m, 2, 3)."""
    odd = slots[:, 1::2]
    pieces = [np.empty((0, 2, 3))]
    for count, pairs in ((2, ((0, 1),)), (4, ((0, 1), (2, 3)))):
        rows = np.flatnonzero(crossing.sum(axis=1) == count)
        order = np.argsort(~crossing[rows], axis=1, kind="stable")
        for a, b in pairs:
            pieces.append(np.stack([odd[rows, order[:, a]], odd[rows, order[:, b]]], axis=1))
    return np.concatenate(pieces)


def _extent(patches: Patches) -> float:
    """Diagonal of the bounding box of the inner part."""
    points = (patches.inner if len(patches.inner) else patches.outer).reshape(-1, 3)
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _surface_scene(
    patches: Patches, camera: Camera | None, rgb: Floats | None = None, depth: float = 0.8
) -> Scene:
    """Scene of the shaded surface, pale outside the region."""
    inner, outer = patches.inner, patches.outer
    shown = inner if len(inner) else outer
    camera = camera or Camera.around(shown.reshape(-1, 3), polygon_normals(shown))
    everything = np.concatenate([inner.reshape(-1, 3), outer.reshape(-1, 3)])
    scene = Scene(View.fitted(camera, everything, STAGE))
    shadow(scene, inner, float(everything[:, 2].min()))
    light = camera.light(polygon_normals(inner), depth=depth)
    base = STONE if rgb is None else rgb
    fill = np.column_stack([np.clip(base * light[:, None], 0, 1), np.ones(len(inner))])
    scene.add(inner, fill, fill, 0.9)
    pale = 0.965 + 0.10 * (camera.light(polygon_normals(outer)) - 1.0)
    ghost = np.column_stack([np.repeat(np.clip(pale, 0, 0.985)[:, None], 3, 1), np.ones(len(pale))])
    scene.add(outer, ghost, ghost, 0.9)
    return scene


# --- lines and marks --------------------------------------------------------------------------


def _line_pieces(
    surface: Surface, lines: Lines, inside: Inside, step: float
) -> tuple[Floats, Mask]:
    """Short polylines (n, 4, 3) along the lines, and whether each is in the region."""
    spans = PIECE_POINTS - 1
    rows, arcs = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for line, total in enumerate(lines.total.tolist()):
        pieces = max(int(np.ceil(total / (spans * step))), 1)
        ends = np.linspace(0.0, total, pieces * spans + 1)
        index = np.arange(pieces)[:, None] * spans + np.arange(PIECE_POINTS)[None]
        arcs.append(ends[index].ravel())
        rows.append(np.full(index.size, line))
    uv = surface.domain.reduce(lines.at(*lines.locate(np.concatenate(rows), np.concatenate(arcs))))
    points = surface.jet(uv).point.reshape(-1, PIECE_POINTS, 3)
    truth = np.asarray(inside(uv)).reshape(-1, PIECE_POINTS)
    return points, truth.sum(axis=1) >= PIECE_POINTS // 2


def _mesh_rim(mesh: NetworkMesh) -> Floats:
    """Boundary edges of a network mesh, (n, 2, 3)."""
    topology = mesh.mesh.topology
    return np.asarray(mesh.mesh.vertices[topology.edges[topology.is_boundary_edge]])


def _umbilic_words(umbilics: Sequence[Umbilic]) -> str:
    """How many umbilics of each kind."""
    if not umbilics:
        return "no umbilic"
    kinds = [u.kind for u in umbilics]
    parts = [f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds))]
    return f"{len(kinds)} umbilic{'s' if len(kinds) > 1 else ''} ({', '.join(parts)})"


def _mark_umbilics(sheet: Sheet, scene: Scene, umbilics: Sequence[Umbilic], slack: float) -> None:
    """Signs, kinds and coordinates of umbilics; those behind the surface are hollow."""
    if not umbilics:
        return
    points = np.array([u.point for u in umbilics])
    pixels = scene.view.pixels(points)[:, :2]
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
        words = f"{umbilic.kind} ({', '.join(number(c) for c in umbilic.point)})"
        words += "  behind" if behind else ""
        left, bottom = _free_place(taken, x, y, 11.4 * len(words))
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
