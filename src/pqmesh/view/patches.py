"""A surface as small polygons, cut along the rim of a region."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.network.principal import Inside
from pqmesh.network.region import PlanOutline
from pqmesh.surface.base import Surface
from pqmesh.vectors import Floats, Mask, norm

# Patches a surface is drawn with, both directions together.
PATCHES = 12000
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
    rim, rim_uv : (m, 2, 3) and (m, 2, 2)
        Segments of the rim in space and in parameters.
    size : float
        Mean diameter of a patch.
    """

    inner: Floats
    outer: Floats
    inner_uv: Floats
    rim: Floats
    rim_uv: Floats
    size: float


def predicate(region: Region | None, surface: Surface) -> Inside:
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
    whole = np.asarray(corners.all(axis=1))
    mixed = np.logical_and(corners.any(axis=1), ~whole)
    crossing = holds[:, 1::2] & mixed[:, None]
    inner_mask = np.zeros(slots.shape[:2], dtype=np.bool_)
    inner_mask[:, ::2], inner_mask[:, 1::2] = corners, crossing
    outer_mask = np.zeros_like(inner_mask)
    outer_mask[:, ::2], outer_mask[:, 1::2] = ~corners, crossing
    inner = _gathered(slots[whole | mixed], inner_mask[whole | mixed])
    inner_uv = _gathered(uv[whole | mixed], inner_mask[whole | mixed]).mean(axis=1)
    outer = _gathered(slots[~whole], outer_mask[~whole])
    sizes = norm(slots[:, 4] - slots[:, 0])
    rim, rim_uv = _rim(slots, crossing), _rim(uv, crossing)
    return Patches(inner, outer, inner_uv, rim, rim_uv, float(sizes.mean()))


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
        crossed: Mask = np.logical_xor(truth[from_a], truth[from_b])
        uv[:, :, 2 * k + 1], place[:, :, 2 * k + 1] = grid[from_a], points[from_a]
        holds[:, :, 2 * k + 1] = crossed
        if crossed.any():
            start = truth[from_a][crossed]
            at = bisected(surface, inside, grid[from_a][crossed], grid[from_b][crossed], start)
            uv[:, :, 2 * k + 1][crossed] = at
            place[:, :, 2 * k + 1][crossed] = surface.jet(at).point
    return place.reshape(-1, 8, 3), uv.reshape(-1, 8, 2), holds.reshape(-1, 8)


def bisected(surface: Surface, inside: Inside, a: Floats, b: Floats, at_a: Mask) -> Floats:
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
    """Segments between the crossings of each cell (n, 8, d), shape (m, 2, d)."""
    odd = slots[:, 1::2]
    pieces = [np.empty((0, 2, slots.shape[-1]))]
    for amount, pairs in ((2, ((0, 1),)), (4, ((0, 1), (2, 3)))):
        rows = np.flatnonzero(crossing.sum(axis=1) == amount)
        order = np.argsort(~crossing[rows], axis=1, kind="stable")
        for a, b in pairs:
            pieces.append(np.stack([odd[rows, order[:, a]], odd[rows, order[:, b]]], axis=1))
    return np.concatenate(pieces)


def with_corners(surface: Surface, region: Region | None, patches: Patches) -> Floats:
    """The rim's segments with the corners of a plan outline, which cells cut off, put back."""
    rim = patches.rim
    if not isinstance(region, PlanOutline) or not len(rim):
        return rim
    middle = rim.mean(axis=1)
    added = []
    for corner in np.concatenate(region.rings):
        place = int(np.argmin(((middle[:, :2] - corner) ** 2).sum(axis=1)))
        uv = patches.rim_uv[place].mean(axis=0, keepdims=True)
        for _ in range(6):
            jet = surface.jet(surface.domain.reduce(uv))
            slope = np.column_stack([jet.du[0, :2], jet.dv[0, :2]])
            uv = uv + np.linalg.lstsq(slope, corner - jet.point[0, :2], rcond=1e-9)[0]
        point = surface.jet(surface.domain.reduce(uv)).point[0]
        if float(norm(point - middle[place])) < patches.size and np.allclose(
            point[:2], corner, atol=1e-3 * patches.size
        ):
            added += [[rim[place, 0], point], [point, rim[place, 1]]]
    return np.concatenate([rim, np.array(added).reshape(-1, 2, 3)])


def extent(patches: Patches) -> float:
    """Diagonal of the bounding box of the inner part."""
    points = (patches.inner if len(patches.inner) else patches.outer).reshape(-1, 3)
    return float(np.linalg.norm(np.ptp(points, axis=0)))
