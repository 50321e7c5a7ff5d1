"""A smooth field of plan directions along given curves."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from pqmesh.errors import NetworkError
from pqmesh.vectors import Floats, dot, norm

# Samples of each piece of a curve, from which Newton's method starts, and its steps.
_SAMPLES, _STEPS = 24, 6
# Points nearer to the centre of curvature of a curve than this share of its radius, and
# directions that cancel each other to this share, leave the direction undecided.
LEAST_SPREAD, LEAST_ACCORD = 0.1, 0.1


Complexes: TypeAlias = NDArray[np.complex128]


class _Foot(NamedTuple):
    """Nearest points of a curve, as plan points see them.

    `tangent` are complex units; `spread` is the distance from the centre of curvature over the
    radius of curvature, 1 on the curve.
    """

    distance: Floats
    tangent: Complexes
    spread: Floats


class GuideCurve:
    """A cubic spline through plan points (k, 2), with straight ends."""

    def __init__(self, points: Floats) -> None:
        knots = np.concatenate([[0.0], np.cumsum(norm(np.diff(points, axis=0)))])
        self.spline = CubicSpline(knots, points)
        pieces = [np.linspace(*ends, _SAMPLES, endpoint=False) for ends in pairwise(knots)]
        self.starts = np.concatenate([*pieces, knots[-1:]])
        self.tree = cKDTree(self.spline(self.starts))

    def foot(self, points: Floats) -> _Foot:
        """Nearest points to plan points (N, 2); beyond the ends those of the end tangents."""
        t = self.starts[self.tree.query(points)[1]]
        for _ in range(_STEPS):
            offset, slope, bend = self._from(points, t)
            square = dot(slope, slope)
            t = t - dot(offset, slope) / np.maximum(square + dot(offset, bend), 0.05 * square)
        offset, slope, bend = self._from(points, t)
        tangent = np.asarray(slope[:, 0] + 1j * slope[:, 1], dtype=np.complex128) / norm(slope)
        return _Foot(norm(offset), tangent, 1.0 + dot(offset, bend) / dot(slope, slope))

    def _from(self, points: Floats, t: Floats) -> tuple[Floats, Floats, Floats]:
        """Curve points less the given ones, and first and second derivatives there."""
        inner = np.clip(t, self.starts[0], self.starts[-1])
        slope = self.spline(inner, 1)
        place = self.spline(inner) + (t - inner)[:, None] * slope
        return place - points, slope, np.where((t == inner)[:, None], self.spline(inner, 2), 0.0)


@dataclass(frozen=True, eq=False)
class GuideField:
    """Plan directions that agree with given curves.

    At a point each curve proposes the tangent at its nearest point, so that one curve alone gives
    its parallels. The proposals are averaged as doubled angles, since directions have no sign,
    with weights 1/distance^2: on a curve its own tangent results.

    Parameters
    ----------
    curves : tuple of GuideCurve

    Examples
    --------
    >>> line = GuideCurve(np.array([[0.0, 0.0], [1.0, 1.0]]))
    >>> field = GuideField((line,))
    >>> field(np.array([[5.0, 0.0, 1.0]])).round(6)
    array([[0.707107, 0.707107]])
    """

    curves: tuple[GuideCurve, ...]

    def __call__(self, points: Floats) -> Floats:
        """Plan unit vectors (N, 2) at points (N, 2) or (N, 3)."""
        half = 0.5 * np.angle(self._doubled(points)[0])
        return np.column_stack([np.cos(half), np.sin(half)])

    def _doubled(self, points: Floats) -> tuple[Complexes, Floats]:
        """Mean doubled direction, its length 1 where all agree, and the nearest curve's spread."""
        feet = [curve.foot(points[:, :2]) for curve in self.curves]
        distance = np.stack([foot.distance for foot in feet])
        nearest = np.argmin(distance, axis=0)
        # Scaled by the least distance: a point on a curve divides nothing by zero.
        least = np.maximum(distance.min(axis=0), 1e-300)
        weight = (least / np.maximum(distance, least)) ** 2
        total = sum(w * foot.tangent**2 for w, foot in zip(weight, feet, strict=True))
        spread = np.stack([foot.spread for foot in feet])[nearest, np.arange(len(points))]
        return np.asarray(total / weight.sum(axis=0)), spread

    def check(self, points: Floats) -> None:
        """Refuse curves that leave the direction undecided somewhere, points (N, 2) or (N, 3).

        Raises
        ------
        NetworkError
            Where a curve turns about a point of the region, or curves contradict each other.
        """
        doubled, spread = self._doubled(points)
        worst = int(spread.argmin())
        if spread[worst] < LEAST_SPREAD:
            raise NetworkError(
                f"A given curve must not turn about a point of the region; near "
                f"{np.round(points[worst, :2], 4).tolist()} in plan lies its centre of "
                f"curvature, where all directions meet. Give a gentler curve, or another one "
                f"beside it on the inner side."
            )
        accord = np.abs(doubled)
        worst = int(accord.argmin())
        if accord[worst] < LEAST_ACCORD:
            raise NetworkError(
                f"Given curves must agree on a direction between them; near "
                f"{np.round(points[worst, :2], 4).tolist()} in plan they cancel each other to "
                f"{accord[worst]:.2g}. Turn one of them, or leave it out."
            )
