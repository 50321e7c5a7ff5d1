"""A smooth field of plan directions along given curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from pqmesh.errors import NetworkError
from pqmesh.vectors import Floats, norm

Complexes: TypeAlias = NDArray[np.complex128]

# Samples of each curve: enough for the field to agree with it between them to 1e-4 rad.
_SAMPLES = 32
# Width of the bells that the field is made of, in extents of the curves: wider ones are smoother
# but overshoot where curves disagree, narrower ones forget a curve sooner.
_WIDTH = 0.2
# Directions that cancel each other to this share are undecided.
LEAST_ACCORD = 0.1
# The field may miss the curves by this angle: by more if they contradict each other.
MOST_MISFIT = np.radians(1.0)


def curve_samples(points: Floats, shares: Floats) -> tuple[Floats, Complexes]:
    """Places (n, 2) at shares in [0, 1] of the spline through plan points, doubled tangents (n,).

    A doubled tangent is the complex unit at twice the angle: the same for both senses. The spline
    is of degree five where there are points enough.
    """
    knots = np.concatenate([[0.0], np.cumsum(norm(np.diff(points, axis=0)))])
    degree = 5 if len(points) > 5 else 3 if len(points) > 3 else len(points) - 1
    spline = make_interp_spline(knots, points, degree)
    at = knots[-1] * shares
    slope = spline(at, 1)
    tangent = np.asarray(slope[:, 0] + 1j * slope[:, 1], dtype=np.complex128) / norm(slope)
    return np.asarray(spline(at)), tangent**2


@dataclass(frozen=True, eq=False)
class GuideField:
    """Plan directions that agree with given curves, and turn smoothly between them.

    Directions have no sign, so their doubled angles are interpolated, as complex numbers: a
    constant and a bell 1/sqrt(1 + (r/c)^2) over each sample of the curves. A straight curve alone
    gives its parallels. Away from curved ones the field tends to the constant.

    Attributes
    ----------
    places : (M, 2)
        Samples of the curves in plan.
    heights : (M+1,)
        Complex heights of the bells, and the constant.
    width : float, model unit

    References: [hardy1971].

    Examples
    --------
    >>> field = guide_field((np.array([[0.0, 0.0], [1.0, 1.0]]),))
    >>> field(np.array([[5.0, 0.0, 1.0]])).round(6)
    array([[0.707107, 0.707107]])
    """

    places: Floats
    heights: Complexes
    width: float

    def __call__(self, points: Floats) -> Floats:
        """Plan unit vectors (N, 2) at points (N, 2) or (N, 3)."""
        half = 0.5 * np.angle(self.doubled(points))
        return np.column_stack([np.cos(half), np.sin(half)])

    def doubled(self, points: Floats) -> Complexes:
        """Interpolated doubled directions (N,), of length 1 on the curves."""
        bells = _bells(self.places, points, self.width)
        # Two real products are faster than a complex one.
        real, imaginary = bells @ self.heights.real[:-1], bells @ self.heights.imag[:-1]
        return np.asarray(real + 1j * imaginary + self.heights[-1])


def guide_field(curves: tuple[Floats, ...]) -> GuideField:
    """Field of plan directions from points (k, 2) or (k, 3) on each of some curves.

    Raises
    ------
    NetworkError
        Where curves contradict each other.
    """
    count = max(_SAMPLES, *(2 * len(curve) for curve in curves))
    # Denser at the ends, where the interpolation has data on one side only.
    dense, even = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count)), np.linspace(0.0, 1.0, 400)
    places, wanted = _together(curves, dense)
    width = _WIDTH * float(norm(np.ptp(places, axis=0)))
    matrix = np.ones((len(places) + 1, len(places) + 1))
    matrix[:-1, :-1], matrix[-1, -1] = _bells(places, places, width), 0.0
    heights = np.linalg.lstsq(matrix, np.append(wanted, 0.0), rcond=1e-13)[0]
    field = GuideField(places, np.asarray(heights), width)
    places, wanted = _together(curves, even)
    misfit = np.abs(0.5 * np.angle(field.doubled(places) / wanted))
    worst = int(misfit.argmax())
    if misfit[worst] > MOST_MISFIT:
        raise NetworkError(
            f"Given curves must agree on a direction where they are near each other, and turn "
            f"gently; near {np.round(places[worst], 4).tolist()} in plan a field along them "
            f"misses one by {np.degrees(misfit[worst]):.2g} degrees. Turn or smooth the curves, "
            f"or leave one out."
        )
    return field


def check_accord(field: GuideField, points: Floats) -> None:
    """Refuse a field that is undecided at one of the points (N, 3).

    Raises
    ------
    NetworkError
    """
    accord = np.abs(field.doubled(points))
    worst = int(accord.argmin())
    if accord[worst] < LEAST_ACCORD:
        raise NetworkError(
            f"Given curves must leave a direction at every place of the region; near "
            f"{np.round(points[worst, :2], 4).tolist()} in plan those around it cancel each "
            f"other. Give another curve there, or turn one of them."
        )


def _together(curves: tuple[Floats, ...], shares: Floats) -> tuple[Floats, Complexes]:
    """Samples of all curves."""
    sampled = [curve_samples(curve[:, :2], shares) for curve in curves]
    places, tangents = zip(*sampled, strict=True)
    return np.concatenate(places), np.concatenate(tangents)


def _bells(places: Floats, points: Floats, width: float) -> Floats:
    """Values of the bells over places (M, 2) at points (N, 2) or (N, 3), shape (N, M)."""
    x, y = points[:, :1] - places[:, 0], points[:, 1:2] - places[:, 1]
    return np.asarray(1.0 / np.sqrt(1.0 + (x * x + y * y) / width**2))
