"""What the user gives for a network that the surface alone does not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.vectors import Floats, read_only


@dataclass(frozen=True, eq=False)
class Given:
    """Directions, curves and a place for conjugate and geodesic networks.

    Attributes
    ----------
    direction : float, optional, radians
        Plan angle from the x axis.
    curves : tuple of (k, 2) or (k, 3), model unit
        Points on curves in plan, or in space; the latter are projected in plan.
    through : (float, float), optional, model unit
        Plan point through which the start curves of a geodesic network go.

    Raises
    ------
    SpecError
        When a value is not finite, or a curve has fewer than two different points.

    Examples
    --------
    >>> Given(curves=(np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 0.7]]),)).curves[0].shape
    (3, 2)
    """

    direction: float | None = None
    curves: tuple[Floats, ...] = ()
    through: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.direction is not None and not np.isfinite(self.direction):
            raise SpecError(
                f"A plan direction must be a finite angle; found {self.direction}. Give radians "
                f"from the x axis."
            )
        if self.through is not None and not (
            len(self.through) == 2 and np.isfinite(self.through).all()
        ):
            raise SpecError(
                f"The point of the start curves must be two finite plan coordinates; found "
                f"{self.through}. Give x and y."
            )
        curves = tuple(_curve(points, i) for i, points in enumerate(self.curves))
        object.__setattr__(self, "curves", curves)


def _curve(points: Floats, number: int) -> Floats:
    """A checked curve without repeated points."""
    curve = read_only(points)
    if curve.ndim != 2 or curve.shape[1] not in (2, 3):
        raise SpecError(
            f"A given curve must be rows [x, y] or [x, y, z]; curve {number} has shape "
            f"{curve.shape}. Give a list of points."
        )
    if not np.isfinite(curve).all():
        raise SpecError(
            f"A given curve must be finite; curve {number} is not. Mend its coordinates."
        )
    plan = curve[:, :2]
    steps = np.abs(np.diff(plan, axis=0)).max(axis=1, initial=0.0)
    kept = np.concatenate([[True], steps > 1e-9 * np.abs(plan - plan[:1]).max(initial=0.0)])
    kept = kept[: len(curve)]
    if kept.sum() < 2:
        raise SpecError(
            f"A given curve must have at least two points that differ in plan; curve {number} "
            f"has {int(kept.sum())}. Give more points, or a direction instead."
        )
    return read_only(curve[kept])
