"""A network of a family that the user gives and the family conjugate to it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import NetworkError
from pqmesh.network.curves import CurveNetwork
from pqmesh.network.fields import STEEPEST, PairField, bending, conjugate_pair
from pqmesh.network.given import Given
from pqmesh.network.guides import GuideField, check_accord, curve_samples, guide_field
from pqmesh.network.patch import Patch, extent, paired_patch, sampled
from pqmesh.network.spaced import spaced_network
from pqmesh.network.walker import Inside
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats

# Families that meet under a smaller angle make no panels: near an asymptotic direction, which is
# its own conjugate, both fall together.
LEAST_ANGLE = np.radians(10.0)
# The shape operator must turn the given family into more than this share of the median
# curvature: else every direction is conjugate to it and none is singled out.
LEAST_BENDING = 1e-3


def trace_conjugate_network(
    surface: Surface, edge: tuple[float, float], inside: Inside | None, given: Given
) -> CurveNetwork:
    """Network of given curves and their conjugate ones: infinitesimally its cells are planar.

    Family 0 runs along a direction in plan, or follows curves given in plan; family 1 is
    conjugate to it, II(a, b) = 0.

    Parameters
    ----------
    surface : Surface
        Seen from above, nowhere upright in the region.
    edge : (float, float), model unit
    inside : callable, optional
    given : Given
        With a direction or with curves.

    Raises
    ------
    NetworkError
        When the families meet under less than 10 degrees somewhere in the region, when the
        surface does not bend along family 0, when it stands upright, or when the curves miss it
        or leave the direction undecided.

    References: [thesis] definition 2.1.7 and section 6.1; errata page, E3.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> vault = graph_surface("x*x + 2*y*y", (-1, 1), (-1, 1))
    >>> network = trace_conjugate_network(vault, (0.3, 0.3), None, Given(direction=0.5))
    >>> bool(network.conjugacy.max() < 1e-7)
    True
    """
    plan = _plan_field(given)
    bend = _bend(surface, inside)
    pair = conjugate_pair(plan, LEAST_ANGLE, LEAST_BENDING * bend)
    patch = paired_patch(surface, inside, pair)
    _check_upright(patch)
    if isinstance(plan, GuideField):
        _check_guides(patch, given, plan)
    _check_bending(patch, pair, bend)
    _check_angle(patch, pair)
    return spaced_network("conjugate", patch, edge)


def _bend(surface: Surface, inside: Inside | None) -> float:
    """Median over the region of the larger curvature, 1/length."""
    jet = sampled(surface, inside)[2]
    bend = float(np.median(np.abs(shape_data(jet).k).max(axis=1)))
    if bend * extent(jet.point) < 1e-9:
        raise NetworkError(
            f"The surface must bend, else all directions are conjugate; most of it has "
            f"curvatures below {bend:.3g}. Choose another network or another surface."
        )
    return bend


def _plan_field(given: Given) -> Callable[[Floats], Floats]:
    """Plan directions (N, 2) at surface points (N, 3)."""
    if given.curves:
        return guide_field(given.curves)
    angle = float(given.direction or 0.0)
    direction = np.array([np.cos(angle), np.sin(angle)])
    return lambda points: np.tile(direction, (len(points), 1))


def _check_upright(patch: Patch) -> None:
    """Refuse a surface that stands upright or turns over."""
    rise = shape_data(patch.surface.jet(patch.uv)).normal[:, 2]
    side = np.sign(np.median(rise))
    worst = int((side * rise).argmin())
    if side * rise[worst] < STEEPEST:
        raise NetworkError(
            f"A direction in plan must be seen from above all over the region; the surface "
            f"stands upright or turns over near {_place(patch, worst)}. Cover less of it by the "
            f"outline, or choose another network."
        )


def _check_guides(patch: Patch, given: Given, field: GuideField) -> None:
    """Refuse curves that miss the region, or do not say where to go."""
    tree = cKDTree(patch.points[:, :2])
    pace = np.sqrt(np.prod(np.ptp(patch.points[:, :2], axis=0)) / len(patch.points))
    shares = np.linspace(0.0, 1.0, 200)
    for number, curve in enumerate(given.curves):
        gap = float(np.min(tree.query(curve_samples(curve[:, :2], shares)[0])[0]))
        if gap > 2.0 * pace:
            raise NetworkError(
                f"A given curve must pass over the region; curve {number} stays "
                f"{gap:.4g} away from it in plan. Move the curve, and check its units."
            )
    check_accord(field, patch.points)


def _check_bending(patch: Patch, pair: PairField, bend: float) -> None:
    """Refuse family 0 where every direction is conjugate to it."""
    bent = bending(patch.surface.jet(patch.uv), pair(patch.surface, patch.uv).steps[:, 0])
    worst = int(bent.argmin())
    if bent[worst] < LEAST_BENDING * bend:
        raise NetworkError(
            f"The surface must bend along family 0, else no direction is conjugate to it alone; "
            f"near {_place(patch, worst)} it bends by {bent[worst]:.3g}, with curvatures around "
            f"{bend:.3g}: the direction follows a ruling, or the surface is flat there. Turn the "
            f"direction, or choose another network."
        )


def _check_angle(patch: Patch, pair: PairField) -> None:
    """Refuse families that meet under a small angle."""
    uv, sine = _least(patch, lambda uv: pair(patch.surface, uv).sine)
    if sine < np.sin(LEAST_ANGLE):
        raise NetworkError(
            f"The families must meet under {np.degrees(LEAST_ANGLE):.0f} degrees or more; near "
            f"{_point(patch, uv)} they do so under {np.degrees(np.arcsin(sine)):.2g} degrees: "
            f"family 0 is nearly asymptotic there, and so its own conjugate. Turn it towards a "
            f"direction in which the surface bends more, or choose another network."
        )


def _least(patch: Patch, quantity: Callable[[Floats], Floats]) -> tuple[Floats, float]:
    """Parameters (2,) in the region where a quantity is smallest, and its value there.

    Grids around the smallest sample, each a quarter as wide as the last one.
    """
    domain = patch.surface.domain
    values = quantity(patch.uv)
    best, least = patch.uv[values.argmin()], float(values.min())
    reach = np.ptp(patch.uv, axis=0) / np.sqrt(len(patch.uv))
    share = np.linspace(-1.0, 1.0, 9)
    square = np.stack(np.meshgrid(share, share, indexing="ij"), axis=-1).reshape(-1, 2)
    for _ in range(4):
        around = domain.reduce(best + 1.5 * reach * square)
        around = around[patch.inside(around)]
        values = quantity(around)
        if len(around) and values.min() < least:
            best, least = around[values.argmin()], float(values.min())
        reach = 0.25 * reach
    return best, least


def _place(patch: Patch, sample: int) -> str:
    """Words for the place of a sample."""
    return str(np.round(patch.points[sample], 4).tolist())


def _point(patch: Patch, uv: Floats) -> str:
    """Words for the place at parameters (2,)."""
    point = patch.surface.jet(uv[None]).point[0]
    return f"{np.round(point, 4).tolist()} (uv {np.round(uv, 4).tolist()})"
