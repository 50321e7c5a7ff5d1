"""The part of a surface that a network is to cover, and the directions to follow there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.network.fields import PairField, pair_field
from pqmesh.network.lines import Lines, selected
from pqmesh.network.trace import principal_field
from pqmesh.network.walker import Field, Inside, Limits, Walker
from pqmesh.surface.base import Jet, Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, Indices, Mask, cross, dot, unit

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
    uv, points
        Samples of the region: parameters (N, 2) and places (N, 3).
    directions : (N, 2, 3)
        Directions of both families at the samples.
    clear, weak : (N,)
        Samples where the directions are as well defined as elsewhere, and those where they are
        hardly so: no line need pass there.
    field : Field
        What the lines follow.
    pair : callable, optional
        Directions of both families anywhere; none where they are always at right angles.
    """

    surface: Surface
    inside: Inside
    uv: Floats
    points: Floats
    directions: Floats
    clear: Mask
    weak: Mask
    field: Field
    pair: PairField | None = None

    @property
    def size(self) -> float:
        """Diagonal of the bounding box, model unit."""
        return extent(self.points)

    def sines(self, uv: Floats) -> Floats:
        """Sines of the angles between the families at parameters inside the domain, (n,).

        Lines whose panels have an edge e across them stand apart by e times this.
        """
        return np.ones(len(uv)) if self.pair is None else self.pair(self.surface, uv).sine

    def axes(self, uv: Floats, along: Floats, family: int) -> Floats:
        """Unit parameter steps along rails and along the lines that cross them, (n, 2, 2).

        Their signs mean nothing. `along` are the tangents (n, 3) of the rails, whose lines are
        those of the given family.
        """
        if self.pair is not None:
            return self.pair(self.surface, uv).steps[:, [1 - family, family]]
        shape = shape_data(self.surface.jet(uv))
        cos = dot(unit(along)[:, None], shape.directions)
        turned = np.stack([-cos[:, 1], cos[:, 0]], axis=1)
        return np.asarray(np.stack([cos, turned], axis=1) @ shape.directions_uv)

    def traced(self, seeds: tuple[Seeds, Seeds], limits: Limits) -> tuple[Lines, Lines]:
        """Lines of both families at once."""
        uv, directions = (np.concatenate(rows) for rows in zip(*seeds, strict=True))
        counts = [len(places) for places, _ in seeds]
        family = np.repeat([0, 1], counts)
        if self.pair is not None:
            limits = limits._replace(passing=False)
        lines = Walker(self.surface, self.field, limits, uv, family).followed(directions)
        place = np.arange(len(lines))
        return selected(lines, place[: counts[0]]), selected(lines, place[counts[0] :])

    def seeds_on(self, rails: Lines, rail: Indices, arc: Floats) -> Seeds:
        """Parameters on rails at given arc lengths, and start directions across them."""
        return seeds_across(self.surface, rails, rail, arc)

    def on(self, rails: Lines, rail: Indices, arc: Floats) -> tuple[Floats, Floats]:
        """Parameters inside the domain and tangents at arc lengths of lines; closed ones wrap."""
        return places_on(self.surface, rails, rail, arc)


def places_on(surface: Surface, rails: Lines, rail: Indices, arc: Floats) -> tuple[Floats, Floats]:
    """Parameters inside the domain and tangents at arc lengths of lines; closed ones wrap."""
    total = rails.total[rail]
    inner = np.where(rails.closed[rail], np.mod(arc, total), np.clip(arc, 0.0, total))
    segment, theta = rails.locate(rail, inner)
    uv = surface.domain.reduce(rails.at(segment, theta))
    jet, slope = surface.jet(uv), rails.slope(segment, theta)
    return uv, np.asarray(jet.du * slope[:, :1] + jet.dv * slope[:, 1:])


def seeds_across(surface: Surface, rails: Lines, rail: Indices, arc: Floats) -> Seeds:
    """Parameters on rails at given arc lengths, and unit tangents at right angles to them."""
    uv, along = places_on(surface, rails, rail, arc)
    return uv, unit(cross(shape_data(surface.jet(uv)).normal, along))


def principal_patch(surface: Surface, inside: Inside | None) -> Patch:
    """The patch of a region, the whole domain if none is given, with its principal directions.

    Raises
    ------
    NetworkError
        When the region misses the surface, or the surface has no principal directions there.
    """
    within, uv, jet = sampled(surface, inside)
    shape = shape_data(jet)
    gaps = np.asarray(shape.k[:, 0] - shape.k[:, 1])
    bend, size = float(np.median(np.abs(shape.k).max(axis=1))), extent(jet.point)
    if bend * size < 1e-9 or np.median(gaps) <= UMBILIC_GAP * bend:
        bad = int(np.argmin(gaps))
        raise NetworkError(
            f"Curvature lines need k1 != k2 on most of the surface; the median of k1 - k2 is "
            f"{np.median(gaps):.3g} with curvatures around {bend:.3g} (at uv = "
            f"{np.round(uv[bad], 6).tolist()}: a plane or a sphere has no principal "
            f"directions). Choose another network or another surface."
        )
    # Lines end where k1 - k2 falls below the least.
    least = UMBILIC_GAP * bend
    clear, weak = gaps >= 0.5 * np.median(gaps), gaps <= 10.0 * least
    field = principal_field(least)
    return Patch(surface, within, uv, jet.point, shape.directions, clear, weak, field)


def paired_patch(surface: Surface, inside: Inside | None, pair: PairField) -> Patch:
    """The patch of a region, the whole domain if none is given, with directions of its own.

    Raises
    ------
    NetworkError
        When the region misses the surface.
    """
    within, uv, jet = sampled(surface, inside)
    found = pair(surface, uv)
    clear, weak = found.margin >= 0.5 * np.median(found.margin), found.margin <= 0.0
    field = pair_field(pair)
    return Patch(surface, within, uv, jet.point, found.directions, clear, weak, field, pair)


def sampled(surface: Surface, inside: Inside | None) -> tuple[Inside, Floats, Jet]:
    """The region as a predicate, parameters (N, 2) of samples of it, and their jets.

    Raises
    ------
    NetworkError
        When the region misses the surface.
    """
    within: Inside = inside or _everywhere
    uv = _samples(surface, within)
    return within, uv, surface.jet(uv)


def extent(points: Floats) -> float:
    """Diagonal of the bounding box."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


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


def line_samples(surface: Surface, lines: Lines) -> tuple[Floats, Indices]:
    """Parameters inside the domain on lines, three for each step, and the line of each."""
    segment = np.repeat(np.arange(len(lines.arc)), 3)
    uv = lines.at(segment, np.tile([1 / 6, 0.5, 5 / 6], len(lines.arc)))
    return surface.domain.reduce(uv), np.asarray(np.repeat(lines.line_of, 3))


def line_points(surface: Surface, lines: Lines) -> Floats:
    """Places of the same samples, shape (n, 3)."""
    return surface.jet(line_samples(surface, lines)[0]).point
