"""Bundles of traced lines with dense output, and the polynomials that they consist of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pqmesh.vectors import Floats, Indices, Mask, dot, norm

_POWERS = np.arange(5)


@dataclass(frozen=True, eq=False)
class Lines:
    """L traced lines as joined segments with dense output, each run by arc length.

    Attributes
    ----------
    start : (L+1,)
        Segments of line i are `start[i]:start[i+1]`.
    coefficients : (S, 5, 2)
        Continuous extension of each segment in unwrapped parameters.
    arc, length : (S,)
        Arc length at the start of each segment (0 at the line's start) and of the segment.
    closed : (L,)
    ends : (L, 2)
        `End` code at the start and at the end of each line.
    """

    start: Indices
    coefficients: Floats
    arc: Floats
    length: Floats
    closed: Mask
    ends: Indices

    def __len__(self) -> int:
        return len(self.start) - 1

    @cached_property
    def line_of(self) -> Indices:
        """Line of each segment, shape (S,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.start))

    @cached_property
    def total(self) -> Floats:
        """Arc length of each line, shape (L,)."""
        return np.asarray(
            np.bincount(self.line_of, self.length, minlength=len(self)), dtype=np.float64
        )

    def at(self, segment: Indices, theta: Floats) -> Floats:
        """Unwrapped parameters at a fraction of each given segment, shape (n, 2)."""
        t = theta[:, None]
        r = self.coefficients[segment]
        inner = r[:, 3] + (1 - t) * r[:, 4]
        return np.asarray(r[:, 0] + t * (r[:, 1] + (1 - t) * (r[:, 2] + t * inner)))

    def slope(self, segment: Indices, theta: Floats) -> Floats:
        """Derivative of `at` with respect to theta, shape (n, 2)."""
        return slopes(self.coefficients[segment], theta)

    def locate(self, line: Indices, arc: Floats) -> tuple[Indices, Floats]:
        """Segment and fraction at given arc lengths of given lines."""
        scale = np.concatenate([[0.0], np.cumsum(self.total)])
        keys = self.arc + scale[self.line_of]
        segment = np.searchsorted(keys, arc + scale[line], side="right") - 1
        segment = np.clip(segment, self.start[line], self.start[line + 1] - 1)
        return segment, (arc - self.arc[segment]) / self.length[segment]

    def joints(self, line: int) -> Floats:
        """Unwrapped parameters of the joints of one line, ends included, shape (n+1, 2)."""
        segments = np.arange(self.start[line], self.start[line + 1])
        begin = self.coefficients[segments, 0]
        end = self.at(segments[-1:], np.ones(len(segments[-1:])))
        return np.concatenate([begin, end])


def slopes(dense: Floats, theta: Floats) -> Floats:
    """Derivatives of continuous extensions (n, 5, 2) at fractions (n,), shape (n, 2)."""
    t, r = theta[:, None], dense
    c4, c5 = r[:, 3], r[:, 4]
    p = c4 + (1 - t) * c5
    q = r[:, 2] + t * p
    dq = p - t * c5
    s = r[:, 1] + (1 - t) * q
    return np.asarray(s + t * (-q + (1 - t) * dq))


def joined(parts: list[Lines]) -> Lines:
    """One bundle of the lines of several."""
    counts = np.concatenate([np.diff(part.start) for part in parts])
    return Lines(
        np.concatenate([[0], np.cumsum(counts)]),
        np.concatenate([part.coefficients for part in parts]),
        np.concatenate([part.arc for part in parts]),
        np.concatenate([part.length for part in parts]),
        np.concatenate([part.closed for part in parts]),
        np.concatenate([part.ends for part in parts]),
    )


def selected(lines: Lines, which: Indices) -> Lines:
    """Some lines of a bundle, in the given order."""
    counts = np.diff(lines.start)[which]
    start = np.concatenate([[0], np.cumsum(counts)])
    rows = np.arange(start[-1]) + np.repeat(lines.start[which] - start[:-1], counts)
    return Lines(
        start,
        lines.coefficients[rows],
        lines.arc[rows],
        lines.length[rows],
        lines.closed[which],
        lines.ends[which],
    )


def shortened(lines: Lines, low: Floats, high: Floats, reason: int) -> Lines:
    """The parts of open lines between arc lengths (L,), with a reason for new ends."""
    first, last = low[lines.line_of], high[lines.line_of]
    kept = np.flatnonzero((lines.arc + lines.length > first) & (lines.arc < last))
    arc, length, dense = lines.arc[kept], lines.length[kept], lines.coefficients[kept]
    begin, finish = np.maximum(arc, first[kept]), np.minimum(arc + length, last[kept])
    late, soon = begin > arc, finish < arc + length
    dense[soon] = restricted(dense[soon], (finish - arc)[soon] / length[soon])
    back = reversed_extension(dense[late])
    back = restricted(back, (finish - begin)[late] / (finish - arc)[late])
    dense[late] = reversed_extension(back)
    counts = np.bincount(lines.line_of[kept], minlength=len(lines))
    ends = lines.ends.copy()
    ends[low > 0, 0] = ends[high < lines.total, 1] = reason
    start = np.concatenate([[0], np.cumsum(counts)])
    begin = begin - np.maximum(first[kept], 0.0)
    return Lines(
        start, dense, begin, finish - arc - np.maximum(first[kept] - arc, 0.0), lines.closed, ends
    )


def reversed_extension(dense: Floats) -> Floats:
    """The same curve run from its end to its start (t -> 1 - t)."""
    r1, r2, r3, r4, r5 = np.moveaxis(dense, 1, 0)
    return np.stack([r1 + r2, -r2, r3 + r4, -r4, r5], axis=1)


def restricted(dense: Floats, theta: Floats) -> Floats:
    """The part [0, theta] of each curve, run from 0 to 1."""
    powers = theta[:, None] ** _POWERS
    return _from_polynomial(_polynomial(dense) * powers[:, :, None])


def exit_fraction(dense: Floats, low: Floats, high: Floats, halvings: int) -> Floats:
    """Fraction at which each curve, known to end outside, leaves the rectangle; by bisection."""
    power = _polynomial(dense).swapaxes(1, 2)
    low_end, width = np.zeros(len(dense)), 1.0
    for _ in range(halvings if len(dense) else 0):
        width *= 0.5
        middle = low_end + width
        value = (power @ (middle[:, None] ** _POWERS)[:, :, None])[..., 0]
        within = ((value >= low) & (value <= high)).all(axis=1)
        low_end = np.where(within, middle, low_end)
    return low_end + width


def nearest_on(dense: Floats, offset: Floats, du: Floats, dv: Floats) -> tuple[Floats, Floats]:
    """Fraction and distance of the point of each curve nearest to start + offset."""
    power = _polynomial(dense)
    power[:, 0] = -offset
    grid = np.linspace(-0.5, 1.5, 41)
    values = np.einsum("nki,tk->nti", power, grid[:, None] ** _POWERS)
    lengths = norm(values[..., :1] * du[:, None] + values[..., 1:] * dv[:, None])
    t = grid[lengths.argmin(axis=1)]
    for _ in range(6):
        value = np.einsum("nki,nk->ni", power, t[:, None] ** _POWERS)
        slope = np.einsum("nki,nk->ni", power[:, 1:], _POWERS[1:] * t[:, None] ** _POWERS[:4])
        value3 = du * value[:, :1] + dv * value[:, 1:]
        slope3 = du * slope[:, :1] + dv * slope[:, 1:]
        t = t - dot(value3, slope3) / np.maximum(dot(slope3, slope3), 1e-300)
    value = np.einsum("nki,nk->ni", power, t[:, None] ** _POWERS)
    return t, norm(du * value[:, :1] + dv * value[:, 1:])


def _polynomial(dense: Floats) -> Floats:
    """Power-basis coefficients (n, 5, 2), lowest first, of continuous extensions."""
    r1, r2, r3, r4, r5 = np.moveaxis(dense, 1, 0)
    # r1 + t r2 + t(1-t) r3 + t^2(1-t) r4 + t^2(1-t)^2 r5
    return np.stack([r1, r2 + r3, -r3 + r4 + r5, -r4 - 2 * r5, r5], axis=1)


def _from_polynomial(power: Floats) -> Floats:
    """Inverse of `_polynomial`."""
    c0, c1, c2, c3, c4 = np.moveaxis(power, 1, 0)
    r5 = c4
    r4 = -c3 - 2 * r5
    r3 = -(c2 - r4 - r5)
    return np.stack([c0, c1 - r3, r3, r4, r5], axis=1)
