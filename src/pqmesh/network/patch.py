"""The part of a surface that a network is to cover: its samples, its size, its curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.network.lines import Lines, selected
from pqmesh.network.trace import Inside, Limits, principal_field, trace
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import Curvature, shape_data
from pqmesh.vectors import Floats, Indices, Mask, cross, unit

# Directions mean nothing where k1 - k2 is below this share of the patch's median curvature.
UMBILIC_GAP = 1e-3
# Samples in each direction of the parameters.
SAMPLES = 80

# Parameters (n, 2) and start directions (n, 3) of lines to trace.
Seeds = tuple[Floats, Floats]


@dataclass(frozen=True, eq=False)
class Patch:
    """The region of a surface, sampled.

    Attributes
    ----------
    surface : Surface
    inside : callable
        Truth at parameters: the region.
    uv, points, shape
        Samples of the region: parameters (N, 2), places (N, 3) and principal data.
    """

    surface: Surface
    inside: Inside
    uv: Floats
    points: Floats
    shape: Curvature

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, model unit."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def gaps(self) -> Floats:
        """Difference of the principal curvatures, k1 - k2, at the samples."""
        return np.asarray(self.shape.k[:, 0] - self.shape.k[:, 1])

    @property
    def least_gap(self) -> float:
        """Difference k1 - k2 below which lines end."""
        return UMBILIC_GAP * float(np.median(np.abs(self.shape.k).max(axis=1)))

    def traced(self, seeds: tuple[Seeds, Seeds], limits: Limits) -> tuple[Lines, Lines]:
        """Lines of both families at once."""
        uv, directions = (np.concatenate(rows) for rows in zip(*seeds, strict=True))
        lines = trace(self.surface, principal_field(self.least_gap), uv, directions, limits)
        count = len(seeds[0][0])
        place = np.arange(len(lines))
        return selected(lines, place[:count]), selected(lines, place[count:])

    def seeds_on(self, rails: Lines, rail: Indices, arc: Floats) -> Seeds:
        """Parameters on rails at given arc lengths, and start directions across them."""
        uv, along = self.on(rails, rail, arc)
        normal = shape_data(self.surface.jet(uv)).normal
        return uv, unit(cross(normal, along))

    def on(self, rails: Lines, rail: Indices, arc: Floats) -> tuple[Floats, Floats]:
        """Parameters inside the domain and tangents at arc lengths of lines; closed ones wrap."""
        total = rails.total[rail]
        inner = np.where(rails.closed[rail], np.mod(arc, total), np.clip(arc, 0.0, total))
        segment, theta = rails.locate(rail, inner)
        uv = self.surface.domain.reduce(rails.at(segment, theta))
        jet, slope = self.surface.jet(uv), rails.slope(segment, theta)
        return uv, np.asarray(jet.du * slope[:, :1] + jet.dv * slope[:, 1:])


def sampled_patch(surface: Surface, inside: Inside | None) -> Patch:
    """The patch of a region, the whole domain if none is given.

    Raises
    ------
    NetworkError
        When the region misses the surface, or the surface has no principal directions there.
    """
    within: Inside = inside or _everywhere
    uv = _samples(surface, within)
    jet = surface.jet(uv)
    patch = Patch(surface, within, uv, jet.point, shape_data(jet))
    bend = float(np.median(np.abs(patch.shape.k).max(axis=1)))
    if bend * patch.size < 1e-9 or np.median(patch.gaps) <= UMBILIC_GAP * bend:
        bad = int(np.argmin(patch.gaps))
        raise NetworkError(
            f"Curvature lines need k1 != k2 on most of the surface; the median of k1 - k2 is "
            f"{np.median(patch.gaps):.3g} with curvatures around {bend:.3g} (at uv = "
            f"{np.round(uv[bad], 6).tolist()}: a plane or a sphere has no principal "
            f"directions). Choose another network or another surface."
        )
    return patch


def _everywhere(uv: Floats) -> Mask:
    """The whole domain as a region."""
    return np.ones(len(uv), dtype=np.bool_)


def _samples(surface: Surface, inside: Inside) -> Floats:
    """Samples of the region, on a finer grid where it is a small part of the domain."""
    low, size = surface.domain.low, surface.domain.size
    for _ in range(3):
        cells = (surface.domain.grid(SAMPLES, SAMPLES) - surface.domain.low) / surface.domain.size
        uv = low + size * cells.reshape(-1, 2)
        kept = uv[inside(uv)]
        if len(kept) > 0.1 * len(uv):
            return kept
        if not len(kept):
            fine = np.linspace(0.0, 1.0, 5 * SAMPLES)
            uv = low + size * np.stack(np.meshgrid(fine, fine, indexing="ij"), -1).reshape(-1, 2)
            kept = uv[inside(uv)]
            if not len(kept):
                raise NetworkError(
                    "The region to be covered must lie on the surface; no sample of the surface "
                    "is in it. Move the outline over the surface, or enlarge either."
                )
        margin = size / SAMPLES
        new_low = np.maximum(kept.min(axis=0) - margin, surface.domain.low)
        new_high = np.minimum(kept.max(axis=0) + margin, surface.domain.high)
        low, size = new_low, new_high - new_low
    return kept


def line_samples(patch: Patch, lines: Lines) -> tuple[Floats, Indices]:
    """Parameters inside the domain on lines, three for each step, and the line of each."""
    segment = np.repeat(np.arange(len(lines.arc)), 3)
    uv = lines.at(segment, np.tile([1 / 6, 0.5, 5 / 6], len(lines.arc)))
    return patch.surface.domain.reduce(uv), np.asarray(np.repeat(lines.line_of, 3))


def line_points(patch: Patch, lines: Lines) -> Floats:
    """Places of the same samples, shape (n, 3)."""
    return patch.surface.jet(line_samples(patch, lines)[0]).point
