"""Lines of two families spaced for even panels, whatever directions they follow."""

from __future__ import annotations

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.network.crossings import crossings
from pqmesh.network.curves import CurveNetwork
from pqmesh.network.growth import Growth
from pqmesh.network.lines import Lines
from pqmesh.network.patch import Patch
from pqmesh.network.probe import LEAST_STEP, probe_lines
from pqmesh.network.walker import Inside, Limits
from pqmesh.vectors import Floats

# The probe's lines stand as far apart as the wanted ones, but neither so far that they miss how
# the spacing varies over the region, nor so near that tracing them costs more than the network.
_PROBE = (1 / 45, 1 / 14)
# Local errors of a step in sizes of the region. The probe only measures; dense output of the
# lines loses two digits against their steps, and 1e-8 is promised.
_PROBE_TOLERANCE, _TOLERANCE = 1e-7, 5e-11
# Refuse beyond this many lines in a family.
MOST_LINES = 4000


def spaced_network(
    kind: str, patch: Patch, edge: tuple[float, float], most_lines: int = MOST_LINES
) -> CurveNetwork:
    """Network along the directions of a patch, as even as they allow.

    A coarse network all over the region measures how the distance of neighbouring lines
    varies; the final lines stand where its geometric mean equals the wanted edge. They reach
    beyond the region by up to a panel where the surface does.

    Parameters
    ----------
    kind : str
        Name of the network.
    patch : Patch
        The region, and the directions to follow.
    edge : (float, float), model unit
        Wanted panel edge along the lines of family 0 and of family 1.
    most_lines : int
        Refuse beyond this many lines in a family.

    Raises
    ------
    NetworkError
        When the surface waves within a panel, or when too many lines are needed.

    References: [thesis] section 6.2; errata page, E33 and E37.
    """
    # Lines of a family stand apart by the edge along the other family.
    spacing = (float(edge[1]), float(edge[0]))
    apart, coarse, fine = tracing_limits(patch.size, patch.inside, spacing)
    probe = probe_lines(patch, apart, coarse)
    _check_smooth(probe, coarse, spacing)
    families = Growth(patch, spacing, fine, most_lines).grown(probe)
    found = crossings(patch.surface, *families)
    return CurveNetwork(patch.surface, families, found, kind, patch.field)


def check_edge(edge: tuple[float, float]) -> None:
    """Refuse panel edges that are no lengths."""
    if not (np.isfinite(edge).all() and min(edge) > 0):
        raise NetworkError(f"Panel edges must be positive lengths; found {edge}. Give two.")


def tracing_limits(
    size: float, inside: Inside, spacing: tuple[float, float]
) -> tuple[Floats, Limits, Limits]:
    """Distances of the probe's lines, and limits of tracing for the probe and for the network.

    `size` is that of the region.
    """
    # Regions smaller than a panel need lines all around them.
    reach = size + 4.0 * max(spacing)
    apart = np.clip(spacing, _PROBE[0] * reach, _PROBE[1] * reach)
    coarse = Limits(
        step=0.7 * float(apart.min()),
        length=4.0 * reach,
        tolerance=_PROBE_TOLERANCE * size,
        turn=0.75 * float(apart.min()),
        inside=inside,
        outside=reach - 0.5 * size,
    )
    fine = coarse._replace(
        step=min(0.5 * min(spacing), 0.05 * reach),
        tolerance=_TOLERANCE * size,
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
