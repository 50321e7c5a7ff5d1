"""Closest points of a parametric surface, to rounding error, for many points at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Domain, Jet, Surface
from pqmesh.surface.regular import bounds_grid
from pqmesh.vectors import Floats, Indices, Mask, dot, norm

SAMPLES = 64
NEIGHBOURS = 16
CANDIDATES = 3
MAX_STEPS = 60
# A Newton step of this share of the size leaves an error of its square: rounding.
STILL = 1e-12


class Foot(NamedTuple):
    """Closest points on a surface.

    Attributes
    ----------
    uv : (N, 2)
        Parameters, inside the domain.
    jet : Jet
        Of the closest points; `jet.point` are the points themselves.
    distance : (N,)
        Model unit, never negative.
    """

    uv: Floats
    jet: Jet
    distance: Floats


def closest_point(surface: Surface, points: Floats, start_uv: Floats | None = None) -> Foot:
    """Closest point on the surface to each point.

    Without a start the search is global, as fine as a sampling of 65 x 65 parameters can tell
    sheets apart; with a start it goes down to the nearest local minimum, which is what a small
    move of a known point needs and about ten times faster. Parameters stay in the domain: over
    the rim, the closest rim point is the answer.

    Parameters
    ----------
    surface : Surface
        Regular on its domain.
    points : (N, 3), model unit
        Anywhere. Points on the focal surface have no isolated closest point; they get one of
        the nearest all the same.
    start_uv : (N, 2), optional
        Parameters near the answer.

    Raises
    ------
    SurfaceError
        If the points are not finite or the shapes do not fit.

    References: [nocedal2006] chapters 3 and 16.

    Examples
    --------
    >>> from pqmesh.surface.analytic import sphere
    >>> foot = closest_point(sphere(radius=2.0), np.array([[0.0, 3.0, 0.0]]))
    >>> foot.distance, foot.jet.point.round(12) + 0.0
    (array([1.]), array([[0., 2., 0.]]))
    """
    points = np.asarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise SurfaceError(
            f"Points must be finite rows of shape (N, 3); found shape {points.shape} or a value "
            "that is not finite. Check the input."
        )
    if start_uv is not None:
        if np.shape(start_uv) != (len(points), 2):
            raise SurfaceError(
                f"Starts must be one pair (u, v) a point, shape {(len(points), 2)}; found "
                f"{np.shape(start_uv)}. Leave them out for a global search."
            )
        return _descend(surface, points, np.asarray(start_uv, dtype=np.float64))
    if len(points) == 0:
        return _descend(surface, points, np.empty((0, 2)))
    owner, start = _candidates(surface, points)
    found = _descend(surface, points[owner], start)
    # The best candidate of each point: sorted by owner, then by distance, take the first.
    order = np.lexsort((found.distance, owner))
    best = order[np.searchsorted(owner[order], np.arange(len(points)))]
    return Foot(found.uv[best], _rows_of(found.jet, best), found.distance[best])


def _rows_of(jet: Jet, rows: Indices) -> Jet:
    """The jet at some of its points."""
    return Jet(*(field[rows] for field in jet))


def _candidates(surface: Surface, points: Floats) -> tuple[Indices, Floats]:
    """Owners and starts of up to `CANDIDATES` separate near samples for each point."""
    n = SAMPLES + 1
    grid = bounds_grid(surface.domain, n).reshape(-1, 2)
    tree = cKDTree(surface.jet(grid).point)
    near = np.asarray(tree.query(points, k=NEIGHBOURS)[1])
    cells = np.stack(np.divmod(near, n), axis=-1)
    free: Mask = np.ones(near.shape, dtype=bool)
    owners, starts = [], []
    for _ in range(CANDIDATES):
        left = np.flatnonzero(free.any(axis=1))
        first = np.argmax(free[left], axis=1)
        owners.append(left)
        starts.append(grid[near[left, first]])
        gap = np.abs(cells[left] - cells[left, first][:, None])
        for axis in (0, 1):
            if surface.domain.periodic[axis]:
                gap[..., axis] = np.minimum(gap[..., axis], SAMPLES - gap[..., axis])
        # Neighbours of a sample lead to the same minimum as that sample itself.
        free[left] &= gap.max(axis=-1) > 2
    return np.concatenate(owners), np.concatenate(starts)


def _descend(surface: Surface, points: Floats, start: Floats) -> Foot:
    """Damped Newton iteration on half the squared distance, for all points side by side."""
    domain = surface.domain
    uv = domain.reduce(start)
    state = np.stack(surface.jet(uv))
    value = _half_square(state[0], points)
    damping = np.zeros(len(points))
    size = norm(state[0]) + norm(points) + 1e-300
    active = np.arange(len(points))
    for _ in range(MAX_STEPS):
        if len(active) == 0:
            break
        jet = Jet(*state[:, active])
        step = _step(domain, uv[active], jet, points[active], damping[active])
        target = domain.reduce(uv[active] + step)
        trial = np.stack(surface.jet(target))
        trial_value = _half_square(trial[0], points[active])
        # Near the minimum rounding hides the descent, so an equal value is a success.
        noise = 1e-15 * size[active]
        slack = noise * (np.sqrt(value[active]) + noise)
        good = trial_value <= value[active] + slack
        moved = active[good]
        uv[moved], state[:, moved] = target[good], trial[:, good]
        value[moved] = trial_value[good]
        damping[moved] = np.where(damping[moved] < 1e-3, 0.0, 0.1 * damping[moved])
        damping[active[~good]] = np.maximum(8.0 * damping[active[~good]], 1e-2)
        length = norm(jet.du * step[:, :1] + jet.dv * step[:, 1:])
        active = active[(length > STILL * size[active]) & (damping[active] < 1e12)]
    distance = norm(state[0] - points)
    return Foot(uv, Jet(*state), distance)


def _half_square(feet: Floats, points: Floats) -> Floats:
    """Half the squared distances."""
    gap = feet - points
    return 0.5 * dot(gap, gap)


def _step(domain: Domain, uv: Floats, jet: Jet, points: Floats, damping: Floats) -> Floats:
    """Newton step where the Hessian is positive, Gauss-Newton step elsewhere, inside bounds."""
    gap = jet.point - points
    slope = np.stack([dot(gap, jet.du), dot(gap, jet.dv)], axis=-1)
    e, f, g = dot(jet.du, jet.du), dot(jet.du, jet.dv), dot(jet.dv, jet.dv)
    gauss = np.stack([e, f, g])
    second = np.stack([dot(gap, jet.duu), dot(gap, jet.duv), dot(gap, jet.dvv)])
    damped = damping * np.stack([e, np.zeros_like(f), g])
    fixed = _blocked(domain, uv, -slope)
    step = _solve(gauss, second, damped, slope, fixed)
    # A step that leaves over a bound it stands on must be found again along the bound.
    return _solve(gauss, second, damped, slope, fixed | _blocked(domain, uv, step))


def _blocked(domain: Domain, uv: Floats, direction: Floats) -> Mask:
    """Coordinates that stand on a bound and would leave over it."""
    low = (uv <= domain.low) & (direction < 0.0)
    high = (uv >= domain.high) & (direction > 0.0)
    return np.asarray((low | high) & ~np.array(domain.periodic))


def _solve(gauss: Floats, second: Floats, damped: Floats, slope: Floats, fixed: Mask) -> Floats:
    """Descent step that leaves the fixed coordinates alone.

    A symmetric 2x2 matrix stands as its three entries; `gauss + second` is the Hessian.
    """
    cut = fixed.any(axis=1)
    gauss = np.stack([gauss[0], np.where(cut, 0.0, gauss[1]), gauss[2]])
    a, b, c = gauss + np.stack([second[0], np.where(cut, 0.0, second[1]), second[2]])
    # Positive with a margin: an almost singular Hessian would throw the point away.
    area = gauss[0] * gauss[2] - gauss[1] ** 2
    convex = ((a > 1e-6 * gauss[0]) | fixed[:, 0]) & ((c > 1e-6 * gauss[2]) | fixed[:, 1])
    convex &= cut | (a * c - b * b > 1e-6 * area)
    a, b, c = np.where(convex, [a, b, c], gauss) + damped
    a, c = np.where(fixed[:, 0], 1.0, a), np.where(fixed[:, 1], 1.0, c)
    right = np.where(fixed, 0.0, -slope)
    determinant = a * c - b * b
    first = (c * right[:, 0] - b * right[:, 1]) / determinant
    last = (a * right[:, 1] - b * right[:, 0]) / determinant
    return np.stack([first, last], axis=-1)
