"""The principal network of a surface: lines of both families, spaced for even panels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.network.crossings import Crossings, crossings
from pqmesh.network.growth import Growth
from pqmesh.network.lines import Lines
from pqmesh.network.patch import Patch, sampled_patch
from pqmesh.network.probe import probe_lines
from pqmesh.network.trace import End, Limits
from pqmesh.network.trace import Inside as Inside
from pqmesh.surface.base import Surface
from pqmesh.vectors import Floats

# The probe's lines stand as far apart as the wanted ones, but neither so far that they miss how
# the spacing varies over the region, nor so near that tracing them costs more than the network.
_PROBE = (1 / 45, 1 / 14)
# Probe lines that need steps shorter than this share of what they may take wave within a panel.
LEAST_STEP = 0.12
# Local errors of a step in sizes of the region. The probe only measures; dense output of the
# lines loses two digits against their steps, and 1e-8 is promised.
_PROBE_TOLERANCE, _TOLERANCE = 1e-7, 5e-11


@dataclass(frozen=True, eq=False)
class CurveNetwork:
    """Two transversal families of lines on a surface and all their crossings.

    Attributes
    ----------
    surface : Surface
    families : (Lines, Lines)
        Lines along the larger (0) and the smaller (1) principal curvature.
    found : Crossings
    """

    surface: Surface
    families: tuple[Lines, Lines]
    found: Crossings

    @cached_property
    def points(self) -> Floats:
        """Crossings in space, shape (N, 3)."""
        return self.surface.jet(self.found.uv).point

    def ended(self, reason: End) -> Floats:
        """Parameters at which lines of either family end for the given reason, (n, 2)."""
        places = [np.empty((0, 2))]
        for lines in self.families:
            for side, theta in ((0, 0.0), (1, 1.0)):
                which = np.flatnonzero((lines.ends[:, side] == reason) & (np.diff(lines.start) > 0))
                segment = lines.start[which] if side == 0 else lines.start[which + 1] - 1
                places.append(lines.at(segment, np.full(len(which), theta)))
        return self.surface.domain.reduce(np.concatenate(places))


def trace_principal_network(
    surface: Surface,
    edge: tuple[float, float],
    inside: Inside | None = None,
    *,
    most_lines: int = 4000,
) -> CurveNetwork:
    """Network of curvature lines spaced so that panels come out as even as the surface allows.

    A coarse network all over the region measures how the distance of neighbouring lines
    varies; the final lines stand where its geometric mean equals the wanted edge. They reach
    beyond the region by up to a panel where the surface does.

    Parameters
    ----------
    surface : Surface
    edge : (float, float), model unit
        Wanted panel edge along the lines of larger and of smaller principal curvature.
    inside : callable, optional
        Truth at parameters (N, 2): the region to cover; default the whole domain.
    most_lines : int
        Refuse beyond this many lines in a family.

    Raises
    ------
    NetworkError
        When the region misses the surface, when there are no principal directions (sphere,
        plane), or when too many lines are needed.

    References: [thesis] section 6.2; errata page, E33 and E37.
    """
    if not (np.isfinite(edge).all() and min(edge) > 0):
        raise NetworkError(f"Panel edges must be positive lengths; found {edge}. Give two.")
    patch = sampled_patch(surface, inside)
    # Lines of a family stand apart by the edge along the other family.
    spacing = (float(edge[1]), float(edge[0]))
    apart, coarse, fine = _limits(patch, spacing)
    probe = probe_lines(patch, apart, coarse)
    _check_smooth(probe, coarse, spacing)
    families = Growth(patch, spacing, fine, most_lines).grown(probe)
    return CurveNetwork(surface, families, crossings(surface, *families))


def _limits(patch: Patch, spacing: tuple[float, float]) -> tuple[Floats, Limits, Limits]:
    """Distances of the probe's lines, and limits of tracing for the probe and for the network."""
    # Regions smaller than a panel need lines all around them.
    reach = patch.size + 4.0 * max(spacing)
    apart = np.clip(spacing, _PROBE[0] * reach, _PROBE[1] * reach)
    coarse = Limits(
        step=0.7 * float(apart.min()),
        length=4.0 * reach,
        tolerance=_PROBE_TOLERANCE * patch.size,
        turn=0.75 * float(apart.min()),
        inside=patch.inside,
        outside=reach - 0.5 * patch.size,
    )
    fine = coarse._replace(
        step=min(0.5 * min(spacing), 0.05 * reach),
        tolerance=_TOLERANCE * patch.size,
        turn=0.75 * min(spacing),
    )
    return apart, coarse, fine


def _check_smooth(probe: tuple[Lines, Lines], limits: Limits, spacing: tuple[float, float]) -> None:
    """Refuse a surface that waves within a panel: its lines have no panels to bound."""
    lengths = np.concatenate([lines.length for lines in probe])
    if len(lengths) and np.median(lengths) < LEAST_STEP * limits.step:
        raise NetworkError(
            f"The surface must be smooth at the size of a panel; its lines turn so quickly that "
            f"they can be followed only by steps of about {np.median(lengths):.3g}, for edges of "
            f"{min(spacing):.3g}. Shorten the edge, or smooth the surface."
        )
