"""NURBS of other programs as `BSplineSurface`: periodic where they close, joints made visible.

Circular arcs come as rational pieces of degree 2 whose inner knots stand twice. That looks like
a crease in the knots, but the pieces meet with equal derivatives. Numerator and denominator,
multiplied by one function of the parameter, are C1 themselves, and then knots of degree - 1 say
so; the surface and its parameters stay exactly what they were.
"""

from __future__ import annotations

import math

import numpy as np

from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.regular import closes
from pqmesh.vectors import Floats

# Derivatives on both sides of a joint that differ by less are equal: files round to 1e-12 or so.
JOINT = 1e-8


def surface_from_nurbs(
    points: Floats,
    degrees: tuple[int, int],
    knots: tuple[Floats, Floats],
    weights: Floats | None = None,
) -> BSplineSurface:
    """Surface of a control net, with directions that close smoothly found out.

    Weights that are all equal are left out.

    Parameters
    ----------
    points : (n, m, 3)
        Not homogeneous.
    degrees : (int, int)
    knots : two arrays
        Full, of n + p + 1 and m + q + 1 numbers.
    weights : (n, m), optional

    Raises
    ------
    SurfaceError
        As `BSplineSurface`.

    Examples
    --------
    >>> half = np.sqrt(0.5)
    >>> ring = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
    >>> net = np.array([[[x, y, 0.0], [x, y, 2.0]] for x, y in ring])
    >>> weights = np.array([[1.0, 1.0], [half, half]] * 4 + [[1.0, 1.0]])
    >>> line = np.array([0.0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4])
    >>> tube = surface_from_nurbs(net, (2, 1), (line, np.array([0.0, 0, 1, 1])), weights)
    >>> tube, tube.domain.periodic
    (<NURBS surface of 18 x 2 control points, degrees (5, 1)>, (True, False))
    """
    if weights is not None and np.ptp(weights) == 0.0 and weights.flat[0] > 0.0:
        weights = None
    checkable = (
        points.ndim == 3
        and np.isfinite(points).all()
        and (weights is None or (weights.shape == points.shape[:2] and (weights > 0.0).all()))
    )
    degree, line = list(degrees), list(knots)
    if checkable:
        mass = np.ones(points.shape[:2]) if weights is None else weights
        rows = np.dstack([points * mass[..., None], mass])
        for axis in (0, 1):
            smooth = _smooth_joints(rows.swapaxes(0, axis), degree[axis], line[axis])
            if smooth is not None:
                rows, degree[axis], line[axis] = smooth[0].swapaxes(0, axis), *smooth[1:]
        if degree != list(degrees):
            points, mass = rows[..., :3] / rows[..., 3:], rows[..., 3]
            weights = None if weights is None else mass
    pair = (degree[0], degree[1]), (line[0], line[1])
    surface = BSplineSurface(points, *pair, weights)
    periodic = closes(surface)
    return BSplineSurface(points, *pair, weights, periodic) if any(periodic) else surface


def _smooth_joints(rows: Floats, degree: int, knots: Floats) -> tuple[Floats, int, Floats] | None:
    """Rows, degree and knots that show the pieces to meet C1; None when not needed or not so."""
    if len(knots) != len(rows) + degree + 1 or not (np.diff(knots) >= 0.0).all():
        return None
    low, high = knots[degree], knots[len(rows)]
    values, times = np.unique(knots, return_counts=True)
    inner = (values > low) & (values < high)
    if not low < high or not (times[inner] >= degree).any() or (times[inner] > degree).any():
        return None
    pieces, breaks = _pieces(rows, degree, knots)
    width = np.diff(breaks)
    jumps = _jumps(pieces, width, degree)
    if jumps is None:
        return None
    raised = 3 if np.abs(jumps * width[1:]).max() > JOINT else 1
    # Each piece times a cubic that is 1 at both ends and turns half of each jump away.
    left = np.concatenate([[0.0], -0.5 * jumps]) * width
    right = np.concatenate([0.5 * jumps, [0.0]]) * width
    ones = np.ones_like(width)
    factors = np.stack([ones, 1 + left / 3, 1 - right / 3, ones], axis=1)
    if raised == 1:
        factors = factors[:, [0, 3]]
    new = degree + raised
    out = np.zeros((len(pieces), new + 1, *rows.shape[1:]))
    for i in range(degree + 1):
        for j in range(raised + 1):
            share = math.comb(degree, i) * math.comb(raised, j) / math.comb(new, i + j)
            out[:, i + j] += share * factors[:, j, None, None] * pieces[:, i]
    # The joints themselves lie between their neighbours and need no control points.
    net = np.concatenate([out[0, :1], *out[:, 1:-1], out[-1, -1:]])
    ends = np.repeat(breaks[[0, -1]], new + 1)
    line = np.concatenate([ends[: new + 1], np.repeat(breaks[1:-1], new - 1), ends[new + 1 :]])
    return net, new, line


def _jumps(pieces: Floats, width: Floats, degree: int) -> Floats | None:
    """Logarithmic jumps of the denominator at the joints, when the quotient itself has none."""
    scale = degree / width[:, None, None]
    before = (scale * (pieces[:, -1] - pieces[:, -2]))[:-1]
    after = (scale * (pieces[:, 1] - pieces[:, 0]))[1:]
    joint = pieces[1:, 0]
    jump = after - before
    share = jump[..., 3] / joint[..., 3]
    mean = share.mean(axis=1)
    rest = np.abs(jump - mean[:, None, None] * joint).max()
    size = max(float(np.abs(before).max()), float(np.abs(after).max()))
    # A jump that varies along the joint cannot be undone by a function of one parameter.
    return mean if rest <= JOINT * size else None


def _pieces(rows: Floats, degree: int, knots: Floats) -> tuple[Floats, Floats]:
    """Bezier points of each span, shape (s, p+1, m, 4), by inserting knots; and the breaks."""
    low, high = knots[degree], knots[len(rows)]
    breaks = np.unique(knots[(knots >= low) & (knots <= high)])
    for value in breaks:
        wanted = degree + (value in (low, high))
        while np.count_nonzero(knots == value) < wanted:
            rows, knots = _inserted(rows, degree, knots, float(value))
    first = np.searchsorted(knots, breaks[:-1], side="right") - 1 - degree
    return np.stack([rows[i : i + degree + 1] for i in first]), breaks


def _inserted(rows: Floats, degree: int, knots: Floats, value: float) -> tuple[Floats, Floats]:
    """Rows and knots with one knot more, by Boehm's rule [piegl1997, 5.2]."""
    n = len(rows)
    k = min(int(np.searchsorted(knots, value, side="right")) - 1, len(knots) - 2)
    out = np.empty((n + 1, *rows.shape[1:]))
    for i in range(n + 1):
        if i <= k - degree:
            out[i] = rows[i]
        elif i > k or i >= n:
            out[i] = rows[i - 1]
        else:
            span = knots[i + degree] - knots[i]
            share = (value - knots[i]) / span if span > 0.0 else 0.0
            out[i] = share * rows[i] + (1.0 - share) * rows[i - 1]
    return out, np.insert(knots, k + 1, value)
