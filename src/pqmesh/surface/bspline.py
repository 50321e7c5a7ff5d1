"""Tensor-product B-spline and NURBS surfaces with exact second-order jets."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Domain, Jet
from pqmesh.vectors import Floats, Indices, read_only

# Points evaluated at once: their control windows stay in the processor's cache.
BLOCK = 2048


class KnotLine:
    """The basis functions of one parameter direction.

    Parameters
    ----------
    degree : int
        At least 1.
    knots : (n + degree + 1,) array
        Non-decreasing.
    count : int
        Number n of control points.
    name : str
        The parameter, for messages.

    Raises
    ------
    SurfaceError
        If the knots do not fit, or leave the surface less than C1 inside.
    """

    def __init__(self, degree: int, knots: ArrayLike, count: int, name: str) -> None:
        self.degree = degree
        self.knots = _checked_knots(degree, knots, count, name)
        inner = self.knots[degree : count + 1]
        filled = np.flatnonzero(np.diff(inner) > 0.0)
        self.spans: Indices = filled + degree
        # Parameters beyond either end fall to the end spans, whose polynomials go on.
        self.starts: Floats = self.knots[self.spans[1:]]
        self.low, self.high = float(inner[0]), float(inner[-1])
        self.windows: Floats = self.knots[self.spans[:, None] + np.arange(1 - degree, degree + 1)]

    def basis(self, t: Floats) -> tuple[Indices, Floats]:
        """First support index (N,) and basis functions with two derivatives (N, 3, p+1)."""
        place = np.searchsorted(self.starts, t, side="right")
        return self.spans[place] - self.degree, basis_functions(self.windows[place], t)


def basis_functions(window: Floats, t: Floats) -> Floats:
    """Basis functions with two derivatives (N, 3, p+1), from the 2p knots about each parameter.

    The recursion of Cox and de Boor [piegl1997, ch. 2], on whole columns.
    """
    p, n = window.shape[1] // 2, len(t)
    after, before = window - t[:, None], t[:, None] - window
    lower = [np.ones((n, 1))]
    widths = []
    for j in range(1, p + 1):
        width = window[:, p : p + j] - window[:, p - j : p]
        share = lower[-1] / width
        values = np.zeros((n, j + 1))
        values[:, :j] = after[:, p : p + j] * share
        values[:, 1:] += before[:, p - j : p] * share
        lower.append(values)
        widths.append(width)
    out = np.zeros((n, 3, p + 1))
    out[:, 0] = lower[p]
    out[:, 1] = _raised(p * lower[p - 1] / widths[p - 1])
    if p > 1:
        slope = _raised((p - 1) * lower[p - 2] / widths[p - 2])
        out[:, 2] = _raised(p * slope / widths[p - 1])
    return out


def _raised(share: Floats) -> Floats:
    """Differences of neighbouring columns: the derivative in the next higher degree."""
    n, j = share.shape
    out = np.zeros((n, j + 1))
    out[:, 1:] = share
    out[:, :j] -= share
    return out


def _checked_knots(degree: int, knots: ArrayLike, count: int, name: str) -> Floats:
    """Knots as an array, once they are known to give a C1 surface."""
    try:
        line = read_only(knots)
    except (TypeError, ValueError):
        raise SurfaceError(
            f"The knots in {name} must be a list of numbers; they are not. Give n + p + 1 numbers."
        ) from None
    if line.shape != (count + degree + 1,):
        raise SurfaceError(
            f"{count} control points of degree {degree} in {name} need {count + degree + 1} knots; "
            f"found shape {line.shape}. Some programs leave out the first and the last: "
            "repeat those."
        )
    if not np.isfinite(line).all() or (np.diff(line) < 0.0).any():
        bad = int(np.argmax(~np.isfinite(line) | (np.diff(line, prepend=line[0]) < 0.0)))
        raise SurfaceError(
            f"Knots must be finite and must not decrease; knot {bad} in {name} is {line[bad]} "
            f"after {line[max(bad - 1, 0)]}. Sort them, together with their control points."
        )
    low, high = line[degree], line[count]
    if not low < high:
        raise SurfaceError(
            f"The knots must leave a domain; in {name} it runs from {low} to {high}. "
            "Spread the inner knots."
        )
    values, times = np.unique(line, return_counts=True)
    sharp = (values > low) & (values < high) & (times > degree - 1)
    if sharp.any():
        at = int(np.argmax(sharp))
        reason = "degree 1 has a crease at every inner knot" if degree == 1 else "this is a crease"
        raise SurfaceError(
            f"A surface needs a continuous tangent plane, thus inner knots repeated at most "
            f"degree - 1 times; in {name} the knot {values[at]:g} stands {times[at]} times in "
            f"degree {degree}, and {reason}. Use degree 2 or higher and remove the repetition, or "
            "split the surface there."
        )
    return line


class BSplineSurface:
    """B-spline surface; rational (NURBS) if weights are given.

    Parameters
    ----------
    points : (n, m, 3) array, model unit
        Control points; the first index runs with u.
    degrees : (int, int)
        Degrees p in u and q in v. Curvature needs degree 2 or more, except for a single span
        (a ruled patch).
    knots : (U, V), optional
        Full knot vectors of n + p + 1 and m + q + 1 numbers. By default uniform on [0, 1] and
        clamped, so that the corners are control points.
    weights : (n, m) array, optional
        Positive.
    periodic : (bool, bool)
        Directions in which the surface closes smoothly. Without knots the control points then
        stand once each around the loop; with knots, points and knots must close by themselves.

    Raises
    ------
    SurfaceError
        If shapes, degrees, knots or weights do not fit, or a crease lies inside.

    Notes
    -----
    `jet` continues the polynomials of the end spans beyond the domain.

    References: [piegl1997] ch. 2 to 4.

    Examples
    --------
    >>> x, y = np.meshgrid(np.arange(4.0), np.arange(5.0), indexing="ij")
    >>> patch = BSplineSurface(np.stack([x, y, 0 * x], axis=-1), (3, 3))
    >>> patch.jet(np.array([[0.0, 1.0]])).point
    array([[0., 4., 0.]])
    """

    def __init__(
        self,
        points: ArrayLike,
        degrees: tuple[int, int],
        knots: tuple[ArrayLike, ArrayLike] | None = None,
        weights: ArrayLike | None = None,
        periodic: tuple[bool, bool] = (False, False),
    ) -> None:
        net = _checked_net(points, degrees)
        mass = _checked_weights(weights, net.shape[:2])
        self.degrees = (int(degrees[0]), int(degrees[1]))
        self.periodic = (bool(periodic[0]), bool(periodic[1]))
        if knots is None:
            net, mass = self._wrapped(net), self._wrapped(mass)
            knots = (
                uniform_knots(net.shape[0], self.degrees[0], self.periodic[0]),
                uniform_knots(net.shape[1], self.degrees[1], self.periodic[1]),
            )
        self.points = read_only(net)
        self.weights = read_only(mass) if weights is not None else None
        lines = [KnotLine(self.degrees[i], knots[i], net.shape[i], "uv"[i]) for i in (0, 1)]
        self.lines = (lines[0], lines[1])
        self.knots = (lines[0].knots, lines[1].knots)
        u, v = ((line.low, line.high) for line in lines)
        self.domain = Domain(u, v, self.periodic)
        stacked = net if weights is None else np.dstack([net * mass[..., None], mass])
        # Rows of (x, y, z) or of (wx, wy, wz, w), and where a point's window of them lies.
        self.rows = stacked.reshape(-1, stacked.shape[2])
        in_u, in_v = (np.arange(p + 1) for p in self.degrees)
        self._window: Indices = (in_u[:, None] * net.shape[1] + in_v).ravel()

    def __repr__(self) -> str:
        """Size and degrees, since the control points are too many to print."""
        n, m = self.points.shape[:2]
        kind = "B-spline" if self.weights is None else "NURBS"
        return f"<{kind} surface of {n} x {m} control points, degrees {self.degrees}>"

    def _wrapped(self, table: Floats) -> Floats:
        """The table with its first rows repeated at the end of each periodic direction."""
        for axis in (0, 1):
            if self.periodic[axis]:
                first = np.arange(self.degrees[axis])
                table = np.concatenate([table, table.take(first, axis=axis)], axis=axis)
        return table

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet at parameters uv of shape (N, 2)."""
        uv = np.asarray(uv, dtype=np.float64)
        out = np.empty((6, len(uv), 3))
        for start in range(0, len(uv), BLOCK):
            part = slice(start, start + BLOCK)
            table = self._derivatives(uv[part])
            for k, (a, b) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
                out[k, part] = table[:, a, b, :3]
        return Jet(*out)

    def _derivatives(self, uv: Floats) -> Floats:
        """All derivatives up to order 2 in u and 2 in v at once, shape (N, 3, 3, d)."""
        i, in_u = self.lines[0].basis(uv[:, 0])
        j, in_v = self.lines[1].basis(uv[:, 1])
        corner = i * self.points.shape[1] + j
        rows = self.rows.take(corner[:, None] + self._window, axis=0)
        p, q = self.degrees
        across = in_u @ rows.reshape(len(uv), p + 1, -1)
        table: Floats = in_v[:, None] @ across.reshape(len(uv), 3, q + 1, -1)
        return table if self.weights is None else projected(table)

    def extended(
        self,
        u_low: float = 0.0,
        u_high: float = 0.0,
        v_low: float = 0.0,
        v_high: float = 0.0,
    ) -> BSplineSurface:
        """The same surface on a domain that is larger by margins, in parameter units.

        The end spans are continued as the polynomials they are, so small margins are safe and
        large ones are not.

        Raises
        ------
        SurfaceError
            If a periodic direction, which has no end, is to be extended.
        """
        if (self.periodic[0] and (u_low or u_high)) or (self.periodic[1] and (v_low or v_high)):
            raise SurfaceError(
                "Only a direction that ends can be extended; a periodic one got a margin. "
                "Leave that margin 0."
            )
        u, v = self.domain.u, self.domain.v
        wider = copy.copy(self)
        wider.domain = Domain(
            (u[0] - u_low, u[1] + u_high), (v[0] - v_low, v[1] + v_high), self.periodic
        )
        return wider


def projected(table: Floats) -> Floats:
    """Quotient rule: derivatives of (w x, w), shape (N, 3, 3, 4), to those of x.

    References: [piegl1997] section 4.5.
    """
    x, w = table[..., :3], table[..., 3:]
    out = np.zeros_like(x)
    out[:, 0, 0] = x[:, 0, 0] / w[:, 0, 0]
    for a, b in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2)):
        rest = x[:, a, b] - w[:, a, b] * out[:, 0, 0]
        if a + b == 2 and a:
            rest -= a * w[:, 1, 0] * out[:, a - 1, b]
        if a + b == 2 and b:
            rest -= b * w[:, 0, 1] * out[:, a, b - 1]
        out[:, a, b] = rest / w[:, 0, 0]
    return out


def uniform_knots(count: int, degree: int, periodic: bool = False) -> Floats:
    """Uniform knots of `count` control points on [0, 1], clamped unless periodic.

    Examples
    --------
    >>> uniform_knots(4, 2)
    array([0. , 0. , 0. , 0.5, 1. , 1. , 1. ])
    """
    spans = count - degree
    if periodic:
        return np.arange(-degree, count + 1) / spans
    return np.clip(np.arange(-degree, count + 1), 0, spans) / spans


def _checked_net(points: ArrayLike, degrees: Sequence[int]) -> Floats:
    """Control points as an array (n, m, 3) that is large enough for the degrees."""
    try:
        net = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise SurfaceError(
            "Control points must form a table of n x m points; rows of different length or "
            "other things than numbers were found. Give every row the same number of points."
        ) from None
    if net.ndim != 3 or net.shape[2] != 3:
        raise SurfaceError(
            f"Control points must have the shape (n, m, 3); found {net.shape}. "
            "Give n rows of m points of 3 coordinates."
        )
    whole = len(degrees) == 2 and all(int(p) == p and p >= 1 for p in degrees)
    if not whole:
        raise SurfaceError(
            f"Degrees must be two whole numbers of at least 1, and at least 2 for a surface of "
            f"several spans, since degree 1 has creases; found {tuple(degrees)}. Use (3, 3)."
        )
    for count, degree, name in zip(net.shape, degrees, "uv", strict=False):
        if count < degree + 1:
            raise SurfaceError(
                f"Degree {degree} in {name} needs at least {degree + 1} control points; found "
                f"{count}. Lower the degree or add points."
            )
    if not np.isfinite(net).all():
        i, j = np.argwhere(~np.isfinite(net))[0, :2]
        raise SurfaceError(
            f"Control points must be finite; point [{i}, {j}] is {net[i, j].tolist()}. "
            "Correct it in the file."
        )
    return net


def _checked_weights(weights: ArrayLike | None, shape: tuple[int, ...]) -> Floats:
    """Weights as an array (n, m); ones if none are given."""
    if weights is None:
        return np.ones(shape)
    mass = np.array(weights, dtype=np.float64)
    if mass.shape != shape:
        raise SurfaceError(
            f"Weights must match the control points, shape {shape}; found {mass.shape}. "
            "Give one weight a point."
        )
    bad = ~(np.isfinite(mass) & (mass > 0.0))
    if bad.any():
        i, j = np.argwhere(bad)[0]
        raise SurfaceError(
            f"Weights must be positive and finite; weight [{i}, {j}] is {mass[i, j]}. "
            "Use 1 for a plain point."
        )
    return mass
