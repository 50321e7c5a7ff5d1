"""Integral curves of direction fields on a surface: a whole family at once, in arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, Indices, Mask, dot, norm

# Dormand-Prince 5(4): nodes, stages, embedded error and the fourth-order continuous extension.
# References: [dormand1980]; [hairer1993] section II.6.
_STAGES = [
    np.array([1 / 5]),
    np.array([3 / 40, 9 / 40]),
    np.array([44 / 45, -56 / 15, 32 / 9]),
    np.array([19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729]),
    np.array([9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656]),
    np.array([35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84]),
]
_ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
_DENSE = np.array(
    [
        -12715105075 / 11282082432,
        0.0,
        87487479700 / 32700410799,
        -10690763975 / 1880347072,
        701980252875 / 199316789632,
        -1453857185 / 822651844,
        69997945 / 29380423,
    ]
)


class End(IntEnum):
    """Why a line ends."""

    RUNNING = 0
    BOUNDARY = 1
    UMBILIC = 2
    CLOSED = 3
    TOO_LONG = 4
    STALLED = 5


class Heading(NamedTuple):
    """What a field says at N points: velocity in the parameter plane at unit surface speed.

    `margin` is positive where the field is defined and falls through zero where it ends.
    """

    velocity: Floats
    direction: Floats
    margin: Floats


# (surface, uv (N,2) in the domain, reference directions (N,3)) -> Heading
Field = Callable[[Surface, Floats, Floats], Heading]


def principal_field(gap: float) -> Field:
    """Field of curvature lines that follows the family nearest to the reference direction.

    Parameters
    ----------
    gap : float, 1/length
        The field ends where k1 - k2 falls below this: an umbilic has no direction.

    References: [thesis] section 6.2; sign and family by continuity (errata page, E33).
    """

    def heading(surface: Surface, uv: Floats, reference: Floats) -> Heading:
        shape = shape_data(surface.jet(uv))
        along = np.einsum("nfi,ni->nf", shape.directions, reference)
        family = np.abs(along).argmax(axis=1)
        row = np.arange(len(uv))
        sign = np.where(along[row, family] < 0, -1.0, 1.0)[:, None]
        return Heading(
            sign * shape.directions_uv[row, family],
            sign * shape.directions[row, family],
            shape.k[:, 0] - shape.k[:, 1] - gap,
        )

    return heading


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
        last = self.start[1:] - 1
        return np.asarray(self.arc[last] + self.length[last])

    def at(self, segment: Indices, theta: Floats) -> Floats:
        """Unwrapped parameters at a fraction of each given segment, shape (n, 2)."""
        t = theta[:, None]
        r = self.coefficients[segment]
        inner = r[:, 3] + (1 - t) * r[:, 4]
        return np.asarray(r[:, 0] + t * (r[:, 1] + (1 - t) * (r[:, 2] + t * inner)))

    def slope(self, segment: Indices, theta: Floats) -> Floats:
        """Derivative of `at` with respect to theta, shape (n, 2)."""
        t = theta[:, None]
        r = self.coefficients[segment]
        c4, c5 = r[:, 3], r[:, 4]
        p = c4 + (1 - t) * c5
        q = r[:, 2] + t * p
        dq = p - t * c5
        s = r[:, 1] + (1 - t) * q
        return np.asarray(s + t * (-q + (1 - t) * dq))

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
        end = self.at(segments[-1:], np.ones(1))
        return np.concatenate([begin, end])


def joined(parts: list[Lines]) -> Lines:
    """One bundle of the lines of several."""
    starts = [np.zeros(1, dtype=np.int64)]
    for part in parts:
        starts.append(part.start[1:] + starts[-1][-1])
    return Lines(
        np.concatenate(starts),
        np.concatenate([part.coefficients for part in parts]),
        np.concatenate([part.arc for part in parts]),
        np.concatenate([part.length for part in parts]),
        np.concatenate([part.closed for part in parts]),
        np.concatenate([part.ends for part in parts]),
    )


def selected(lines: Lines, count: int) -> Lines:
    """The first lines of a bundle."""
    end = lines.start[count]
    return Lines(
        lines.start[: count + 1],
        lines.coefficients[:end],
        lines.arc[:end],
        lines.length[:end],
        lines.closed[:count],
        lines.ends[:count],
    )


def trace(
    surface: Surface,
    field: Field,
    seeds: Floats,
    directions: Floats,
    *,
    max_step: float,
    max_length: float,
    tolerance: float,
) -> Lines:
    """Lines of a field through seed points, followed both ways to their exact ends.

    All lines advance together with their own step lengths (Dormand-Prince 5(4) in the
    parameter plane, error measured on the surface).

    Parameters
    ----------
    surface : Surface
    field : Field
    seeds : (L, 2)
        Parameters inside the domain.
    directions : (L, 3)
        Start directions; the field decides the exact ones.
    max_step, max_length, tolerance : float, model unit
        Longest step, longest half line, and local error of a step.
    """
    count = len(seeds)
    walker = _Walker(surface, field, max_step, max_length, tolerance)
    walker.begin(np.concatenate([seeds, seeds]), np.concatenate([directions, -directions]))
    while walker.advance():
        pass
    return walker.lines(count)


class _Walker:
    """State of all half lines while they are integrated."""

    def __init__(
        self, surface: Surface, field: Field, max_step: float, max_length: float, tolerance: float
    ) -> None:
        self.surface, self.field = surface, field
        self.max_step, self.max_length, self.tolerance = max_step, max_length, tolerance
        self.domain = surface.domain
        self.steps: list[tuple[Indices, Floats, Floats, Floats]] = []

    def begin(self, seeds: Floats, directions: Floats) -> None:
        n = len(seeds)
        self.uv = seeds.astype(np.float64)
        self.seed = self.uv.copy()
        self.heading = self._head(self.uv, directions)
        self.seed_direction = self.heading.direction
        self.seed_point = self.surface.jet(self.domain.reduce(self.uv)).point
        self.arc = np.zeros(n)
        self.h = np.full(n, 0.25 * self.max_step)
        self.end = np.where(self.heading.margin > 0, End.RUNNING, End.UMBILIC).astype(np.int64)
        outward = self._leaves_at_once()
        self.end[outward] = End.BOUNDARY

    def _head(self, uv: Floats, reference: Floats) -> Heading:
        return self.field(self.surface, self.domain.reduce(uv), reference)

    def _leaves_at_once(self) -> Mask:
        """Seeds on a bound whose heading points outside."""
        low, high = self.domain.low, self.domain.high
        velocity, fixed = self.heading.velocity, ~np.array(self.domain.periodic)
        at_low = (self.uv <= low) & (velocity < 0) & fixed
        at_high = (self.uv >= high) & (velocity > 0) & fixed
        return np.asarray((at_low | at_high).any(axis=1))

    def advance(self) -> bool:
        """Try one step on every running line; False when none runs."""
        live = np.flatnonzero(self.end == End.RUNNING)
        if not len(live):
            return False
        start, first = self.uv[live], self.heading.velocity[live]
        reference, h = self.heading.direction[live], self.h[live][:, None]
        slopes = [first]
        for weights in _STAGES:
            moved = start + h * np.einsum("s,sni->ni", weights, np.array(slopes))
            last = self._head(moved, reference)
            slopes.append(last.velocity)
        rates = np.array(slopes)
        finish = moved
        error = self._surface_length(start, h * np.einsum("s,sni->ni", _ERROR, rates))
        ratio = error / self.tolerance
        growth = np.clip(0.9 * np.maximum(ratio, 1e-10) ** -0.2, 0.2, 4.0)
        dense = self._extension(start, finish, h, rates)
        good = (ratio <= 1.0) & np.isfinite(finish).all(axis=1)
        good &= dot(last.direction, reference) > 0.7
        shrink = np.where(np.isfinite(growth), np.minimum(growth, 0.5), 0.2)
        factor = np.where(good, growth, shrink)
        good, factor, stop = self._landing(finish, last.margin, live, dense, good, factor)
        self._accept(live, good, stop, finish, last, dense)
        self.h[live] = np.minimum(self.h[live] * factor, self.max_step)
        tiny = (self.h[live] < 1e-9 * self.max_step) & (self.end[live] == End.RUNNING)
        self.end[live[tiny]] = End.STALLED
        return True

    def _surface_length(self, uv: Floats, step: Floats) -> Floats:
        jet = self.surface.jet(self.domain.reduce(uv))
        return norm(jet.du * step[:, :1] + jet.dv * step[:, 1:])

    @staticmethod
    def _extension(start: Floats, finish: Floats, h: Floats, rates: Floats) -> Floats:
        rise = finish - start
        bend = h * rates[0] - rise
        twist = rise - h * rates[6] - bend
        return np.stack([start, rise, bend, twist, h * np.einsum("s,sni->ni", _DENSE, rates)], 1)

    def _landing(
        self,
        finish: Floats,
        margin: Floats,
        live: Indices,
        dense: Floats,
        good: Mask,
        factor: Floats,
    ) -> tuple[Mask, Floats, Indices]:
        """Shorten steps that run over an end, and recognise those that hit it."""
        stop = np.zeros(len(live), dtype=np.int64)
        low, high, size = self.domain.low, self.domain.high, self.domain.size
        fixed = ~np.array(self.domain.periodic)
        # A landing step misses the bound by the difference of step and extension: the wider
        # slack recognises it, and the end is exact to 1e-9 of the domain.
        beyond = np.where(fixed, np.maximum(low - finish, finish - high), -size)
        over = good & (beyond > 1e-11 * size).any(axis=1)
        if over.any():
            part = _exit_fraction(dense[over], low, high, fixed)
            good[over], factor[over] = False, np.clip(part, 1e-6, 1.0 - 1e-9)
        on_bound = good & (beyond > -1e-9 * size).any(axis=1)
        stop[on_bound] = End.BOUNDARY
        lost = good & (margin <= 0)
        if lost.any():
            before = self.heading.margin[live[lost]]
            part = before / (before - margin[lost])
            near = before < 1e-3 * np.abs(before - margin[lost]) + 1e-12
            step_small = self.h[live[lost]] < 1e-6 * self.max_step
            done = near | step_small
            rows = np.flatnonzero(lost)
            stop[rows[done]] = End.UMBILIC
            good[rows[~done]] = False
            factor[rows[~done]] = np.clip(part[~done] * 0.999, 0.05, 0.95)
        return good, factor, stop

    def _accept(
        self,
        live: Indices,
        good: Mask,
        stop: Indices,
        finish: Floats,
        last: Heading,
        dense: Floats,
    ) -> None:
        closing, theta = self._closing(live, good, dense)
        length = self.h[live].copy()
        if closing.any():
            length[closing] *= theta[closing]
            stop[closing] = End.CLOSED
            dense[closing] = _restricted(dense[closing], theta[closing])
        rows = np.flatnonzero(good)
        if not len(rows):
            return
        moved = live[rows]
        self.steps.append((moved, self.arc[moved].copy(), length[rows], dense[rows]))
        self.uv[moved] = finish[rows]
        self.arc[moved] += length[rows]
        for old, new in zip(self.heading, last, strict=True):
            old[moved] = new[rows]
        self.end[moved] = stop[rows]
        long = (self.arc[moved] > self.max_length) & (self.end[moved] == End.RUNNING)
        self.end[moved[long]] = End.TOO_LONG
        # A line that closed forwards needs no backward half.
        half = len(self.end) // 2
        twins = moved[self.end[moved] == End.CLOSED]
        self.end[np.where(twins < half, twins + half, twins - half)] = End.CLOSED

    def _closing(self, live: Indices, good: Mask, dense: Floats) -> tuple[Mask, Floats]:
        """Lines whose step passes through their own seed in their own direction, and where."""
        theta = np.ones(len(live))
        chord = dense[:, 1]
        offset = self.seed[live] - dense[:, 0]
        period = self.domain.size * np.array(self.domain.periodic)
        safe = np.where(period > 0, period, 1.0)
        offset = offset - np.where(period > 0, np.round(offset / safe) * period, 0.0)
        jet = self.surface.jet(self.domain.reduce(self.seed[live]))
        chord3 = jet.du * chord[:, :1] + jet.dv * chord[:, 1:]
        offset3 = jet.du * offset[:, :1] + jet.dv * offset[:, 1:]
        along = dot(offset3, chord3) / np.maximum(dot(chord3, chord3), 1e-300)
        miss = norm(offset3 - along[:, None] * chord3)
        near = good & (self.arc[live] > 2.0 * self.max_step) & (along > -0.5) & (along < 1.5)
        near &= miss < 0.2 * self.max_step
        near &= dot(chord3, self.seed_direction[live]) > 0
        if near.any():
            part, distance = _nearest_on(dense[near], offset[near], jet.du[near], jet.dv[near])
            closes = (part > -1e-9) & (part <= 1.0) & (distance < 1e-7 * self.max_length)
            rows = np.flatnonzero(near)
            near[rows[~closes]] = False
            theta[rows[closes]] = np.maximum(part[closes], 1e-6)
        return near, theta

    def lines(self, count: int) -> Lines:
        """Half lines joined to lines: the backward half reversed, then the forward half."""
        owner = np.concatenate([s[0] for s in self.steps]) if self.steps else np.empty(0, int)
        if not self.steps:
            none = np.empty((0, 5, 2))
            empty = np.zeros(count + 1, dtype=np.int64)
            return Lines(empty, none, np.empty(0), np.empty(0), np.zeros(count, bool), self._ends())
        arc = np.concatenate([s[1] for s in self.steps])
        length = np.concatenate([s[2] for s in self.steps])
        dense = np.concatenate([s[3] for s in self.steps])
        closed = (self.end[:count] == End.CLOSED) | (self.end[count:] == End.CLOSED)
        backward = owner >= count
        # A line closed by its backward half keeps that half, else the forward one alone.
        by_forward = np.zeros(count, dtype=np.bool_)
        by_forward[closed] = True
        keep = ~(backward & by_forward[owner % count])
        owner, arc, length, dense = owner[keep], arc[keep], length[keep], dense[keep]
        backward = owner >= count
        line = owner % count
        before = np.zeros(count)
        np.add.at(before, line[backward], length[backward])
        position = np.where(backward, before[line] - arc - length, before[line] + arc)
        dense = np.where(backward[:, None, None], _reversed_extension(dense), dense)
        order = np.lexsort((position, line))
        counts = np.bincount(line, minlength=count)
        start = np.concatenate([[0], np.cumsum(counts)])
        return Lines(start, dense[order], position[order], length[order], closed, self._ends())

    def _ends(self) -> Indices:
        half = len(self.end) // 2
        return np.stack([self.end[half:], self.end[:half]], axis=1)


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


def _reversed_extension(dense: Floats) -> Floats:
    """The same curve run from its end to its start (t -> 1 - t)."""
    r1, r2, r3, r4, r5 = np.moveaxis(dense, 1, 0)
    return np.stack([r1 + r2, -r2, r3 + r4, -r4, r5], axis=1)


def _restricted(dense: Floats, theta: Floats) -> Floats:
    """The part [0, theta] of each curve, run from 0 to 1."""
    powers = theta[:, None] ** np.arange(5)
    return _from_polynomial(_polynomial(dense) * powers[:, :, None])


def _exit_fraction(dense: Floats, low: Floats, high: Floats, fixed: Mask) -> Floats:
    """First fraction at which each curve leaves the rectangle (known to end outside)."""
    power = _polynomial(dense)
    a, b = np.zeros(len(dense)), np.ones(len(dense))
    # Bisection: the end is outside, the start inside; 45 halvings reach rounding error.
    for _ in range(45):
        middle = 0.5 * (a + b)
        value = np.einsum("nki,nk->ni", power, middle[:, None] ** np.arange(5))
        outside = (((value < low) | (value > high)) & fixed).any(axis=1)
        a, b = np.where(outside, a, middle), np.where(outside, middle, b)
    return b


def _nearest_on(dense: Floats, offset: Floats, du: Floats, dv: Floats) -> tuple[Floats, Floats]:
    """Fraction and distance of the point of each curve nearest to start + offset."""
    power = _polynomial(dense)
    power[:, 0] = -offset
    ladder = np.arange(5)
    grid = np.linspace(-0.5, 1.5, 41)
    values = np.einsum("nki,tk->nti", power, grid[:, None] ** ladder)
    lengths = norm(values[..., :1] * du[:, None] + values[..., 1:] * dv[:, None])
    t = grid[lengths.argmin(axis=1)]
    for _ in range(6):
        value = np.einsum("nki,nk->ni", power, t[:, None] ** ladder)
        slope = np.einsum("nki,nk->ni", power[:, 1:], ladder[1:] * t[:, None] ** ladder[:4])
        value3 = du * value[:, :1] + dv * value[:, 1:]
        slope3 = du * slope[:, :1] + dv * slope[:, 1:]
        t = t - dot(value3, slope3) / np.maximum(dot(slope3, slope3), 1e-300)
    value = np.einsum("nki,nk->ni", power, t[:, None] ** ladder)
    return t, norm(du * value[:, :1] + dv * value[:, 1:])
