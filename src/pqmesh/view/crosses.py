"""Picture of the principal directions of a surface, as crosses of two colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.network.principal import Inside
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import first_form, shape_data
from pqmesh.surface.umbilics import Umbilic
from pqmesh.vectors import Floats
from pqmesh.view.camera import Camera
from pqmesh.view.patches import Region, extent, predicate, surface_patches, with_corners
from pqmesh.view.scene import rgba
from pqmesh.view.sheet import INK, count, paper
from pqmesh.view.surfaces import LARGER, SMALLER, mark_umbilics, surface_scene, umbilic_words

# Crosses from one side of the surface to the other; length of an arm in their distance.
ACROSS, ARM = 34, 0.40
# Where |k1 - k2| falls below this share of its median, arms shrink, down to the least length.
CLEAR, LEAST_ARM = 0.5, 0.2


def directions_figure(
    surface: Surface,
    region: Region | None = None,
    umbilics: Sequence[Umbilic] = (),
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of a surface with short crosses along its principal directions.

    Parameters are those of `viability_figure`. Arms are shorter where the two curvatures come
    close, since directions mean little there.

    Raises
    ------
    PqmeshError
        When matplotlib is not installed.
    """
    inside = predicate(region, surface)
    patches = surface_patches(surface, inside)
    arms = cross_arms(surface, inside, extent(patches) / ACROSS)
    words = f"{count(len(arms[0]), 'place')}  ·  {umbilic_words(umbilics)}"
    with paper(title or "Principal directions", words if caption is None else caption) as sheet:
        scene = surface_scene(patches, camera)
        lift = 0.8 * patches.size
        for pieces, color in zip(arms, (LARGER, SMALLER), strict=True):
            scene.add_lines(pieces, rgba(color), 2.2, lift)
        scene.add_lines(with_corners(surface, region, patches), rgba(INK), 3.0, 1.3 * lift)
        scene.paint(sheet)
        mark_umbilics(sheet, scene, umbilics, patches.size)
        sheet.scale_bar(scene.view, units)
        entries = [(LARGER, "larger principal curvature"), (SMALLER, "smaller principal curvature")]
        sheet.legend(entries + ([(INK, "outline")] if len(patches.rim) else []))
        return sheet.png()


def cross_arms(surface: Surface, inside: Inside, apart: float) -> tuple[Floats, Floats]:
    """Segments (n, 2, 3) along both principal directions at evenly spread places."""
    uv = _places(surface, inside, apart)
    jet = surface.jet(uv)
    shape = shape_data(jet)
    gap = shape.k[:, 0] - shape.k[:, 1]
    median = max(float(np.median(gap)), 1e-300) if len(gap) else 1.0
    share = np.clip(gap / (CLEAR * median), LEAST_ARM, 1.0)
    reach = (ARM * apart * share)[:, None, None] * shape.directions
    ends = np.stack([jet.point[:, None] - reach, jet.point[:, None] + reach], axis=2)
    return np.asarray(ends[:, 0]), np.asarray(ends[:, 1])


def _places(surface: Surface, inside: Inside, apart: float) -> Floats:
    """Parameters of the region about so far apart, shape (n, 2)."""
    domain = surface.domain
    form = first_form(surface.jet(domain.grid(12, 12).reshape(-1, 2)))
    sizes = domain.size * np.sqrt(form[:, (0, 1), (0, 1)]).mean(axis=0)
    counts = np.maximum(np.round(sizes / apart), 1).astype(np.int64)
    lines = [
        low + (np.arange(n) + 0.5) * size / n
        for low, size, n in zip(domain.low, domain.size, counts, strict=True)
    ]
    uv = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.asarray(uv[np.asarray(inside(uv))])
