"""Lines advancing in arrays: one step of each at a time, until all have their exact ends."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from pqmesh.network.lines import Lines, exit_fraction, nearest_on, restricted, reversed_extension
from pqmesh.network.steps import continuous, embedded_error, stages
from pqmesh.surface.base import Surface
from pqmesh.vectors import Floats, Indices, Mask, dot, norm

# Truth at parameters (N, 2) inside the domain: the part of the surface to be covered.
Inside = Callable[[Floats], Mask]

# A step that ends beyond a bound by no more than this share of the domain is cut at the bound.
_HAIR = 1e-7


class End(IntEnum):
    """Why a line ends; `UMBILIC` wherever the directions that it follows do."""

    RUNNING = 0
    BOUNDARY = 1
    UMBILIC = 2
    CLOSED = 3
    TOO_LONG = 4
    STALLED = 5
    OUTSIDE = 6
    SPIRAL = 7
    FOCAL = 8
    COVERED = 9


_ROUND = (End.CLOSED, End.SPIRAL)


class Heading(NamedTuple):
    """What a field says at N points.

    `velocity` is the step (du, dv) at unit surface speed along `direction`, `across` that at a
    right angle to it; `kind` is which of the field's directions it is; `margin` is positive where
    the field is defined and falls through zero where it ends.
    """

    velocity: Floats
    across: Floats
    direction: Floats
    kind: Indices
    margin: Floats


# (surface, uv (N,2) in the domain, reference directions (N,3), families (N,)) -> Heading; a field
# that tells its families apart by the reference needs not be told.
Field = Callable[[Surface, Floats, Floats, Indices], Heading]


class Limits(NamedTuple):
    """How finely and how far lines are followed, all in the model unit.

    `tolerance` bounds the local error of a step; `outside` is how long a line may stay outside
    the region before it is given up; a line that comes back beside its seed by less than `turn`
    winds like a spiral and ends there; with `passing` it may go on over places where its field
    is not defined but runs smoothly on both sides, as over a line of umbilics.
    """

    step: float
    length: float
    tolerance: float
    turn: float
    inside: Inside | None = None
    outside: float = np.inf
    passing: bool = True


class Step(NamedTuple):
    """One trial step of n lines: continuous extension, heading at its end, error / tolerance."""

    dense: Floats
    last: Heading
    error: Floats

    @property
    def finish(self) -> Floats:
        """Parameters at the end, shape (n, 2)."""
        return np.asarray(self.dense[:, 0] + self.dense[:, 1])


class Verdict(NamedTuple):
    """What becomes of n trial steps: taken or not, kept part, reason to stop, next step."""

    good: Mask
    theta: Floats
    stop: Indices
    factor: Floats


def surface_length(steps: Floats, along: Floats, across: Floats) -> Floats:
    """Lengths on the surface of parameter steps, from two orthonormal ones."""
    area = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    a = steps[:, 0] * across[:, 1] - steps[:, 1] * across[:, 0]
    b = along[:, 0] * steps[:, 1] - along[:, 1] * steps[:, 0]
    return np.asarray(np.hypot(a, b) / np.abs(area))


class Walker:
    """State of all half lines; line i runs forwards as i and backwards as i + L.

    `seeds` (L, 2) are parameters inside the domain, `family` (L,) the family of each line.
    """

    def __init__(
        self, surface: Surface, field: Field, limits: Limits, seeds: Floats, family: Indices
    ) -> None:
        self.surface, self.field, self.limits = surface, field, limits
        self.domain = surface.domain
        fixed = ~np.array(self.domain.periodic)
        self.low = np.where(fixed, self.domain.low, -np.inf)
        self.high = np.where(fixed, self.domain.high, np.inf)
        self.uv = np.concatenate([seeds, seeds]).astype(np.float64)
        self.family = np.concatenate([family, family])
        self.seed = self.uv.copy()
        jet = surface.jet(self.domain.reduce(self.uv))
        self.seed_tangents = jet.du, jet.dv
        self.arc = np.zeros(len(self.uv))
        self.outside = np.zeros(len(self.uv))
        self.h = np.full(len(self.uv), 0.25 * limits.step)
        self.taken: list[tuple[Indices, Floats, Floats, Floats]] = []
        # No regular field asks for a mean step this short; a broken one must not hang.
        self.rounds_left = int(20.0 * limits.length / limits.step) + 2000

    def followed(self, directions: Floats) -> Lines:
        """Lines from start directions (L, 3) and against them, to their ends."""
        self.begin(np.concatenate([directions, -directions]))
        while self.advance():
            pass
        return self.lines()

    def begin(self, directions: Floats) -> None:
        """Exact start directions; seeds without one, or on a bound and leaving, end at once."""
        self.heading = self._head(self.uv, directions, self.family)
        self.seed_direction = self.heading.direction.copy()
        self.end = np.where(self.heading.margin > 0, End.RUNNING, End.UMBILIC).astype(np.int64)
        velocity = self.heading.velocity
        leaving = (self.uv <= self.low) & (velocity < 0) | (self.uv >= self.high) & (velocity > 0)
        self.end[leaving.any(axis=1)] = End.BOUNDARY

    def _head(self, uv: Floats, reference: Floats, family: Indices) -> Heading:
        return self.field(self.surface, self.domain.reduce(uv), reference, family)

    def advance(self) -> bool:
        """Try one step on every running line; False when none runs."""
        live = np.flatnonzero(self.end == End.RUNNING)
        self.rounds_left -= 1
        if self.rounds_left < 0:
            self.end[live] = End.STALLED
        if not len(live) or self.rounds_left < 0:
            return False
        step = self._tried(live)
        verdict = self._at_bounds(live, step, self._judged(live, step))
        verdict = self._at_umbilics(live, step, verdict)
        verdict = self._at_seeds(live, step, verdict)
        self._take(live, step, verdict)
        self.h[live] = np.minimum(self.h[live] * verdict.factor, self.limits.step)
        tiny = (self.h[live] < 1e-9 * self.limits.step) & (self.end[live] == End.RUNNING)
        self.end[live[tiny]] = End.STALLED
        return True

    def _tried(self, live: Indices) -> Step:
        """Stages of one step and its continuous extension."""
        reference, family = self.heading.direction[live], self.family[live]

        def motion(uv: Floats) -> tuple[Floats, Heading]:
            heading = self._head(uv, reference, family)
            return heading.velocity, heading

        h = self.h[live][:, None]
        rates, finish, last = stages(self.uv[live], self.heading.velocity[live], h, motion)
        dense = continuous(self.uv[live], finish, h, rates)
        error = embedded_error(h, rates)
        length = surface_length(error, self.heading.velocity[live], self.heading.across[live])
        return Step(dense, last, length / self.limits.tolerance)

    def _judged(self, live: Indices, step: Step) -> Verdict:
        """Error control, and no turn by more than 45 degrees."""
        turn = dot(step.last.direction, self.heading.direction[live])
        finite = np.isfinite(step.finish).all(axis=1) & np.isfinite(step.error)
        good = (step.error <= 1.0) & finite & (turn > 0.7)
        growth = np.clip(0.9 * np.maximum(step.error, 1e-10) ** -0.2, 0.2, 4.0)
        growth = np.where(finite, growth, 0.2)
        factor = np.where(good, growth, np.minimum(growth, 0.5))
        return Verdict(good, np.ones(len(live)), np.zeros(len(live), dtype=np.int64), factor)

    def _at_bounds(self, live: Indices, step: Step, verdict: Verdict) -> Verdict:
        """Cut steps that end a hair beyond a bound; shorten those that end farther out."""
        good, theta, stop, factor = verdict
        size, finish = self.domain.size, step.finish
        beyond = np.maximum(self.low - finish, finish - self.high) / size
        over = np.isfinite(finish).all(axis=1) & (beyond > 0).any(axis=1)
        cut = over & good & (beyond < _HAIR).all(axis=1)
        theta[cut] = exit_fraction(step.dense[cut], self.low, self.high, 52)
        far = over & ~cut
        # Stages beyond a bound were clamped and their error says little: aim half a hair beyond.
        aside = 0.5 * _HAIR * size
        part = exit_fraction(step.dense[far], self.low - aside, self.high + aside, 24)
        good[far], factor[far] = False, np.clip(part, 1e-3, 1.0 - 1e-6)
        outwards = np.where(beyond > -1e-10, np.abs(step.dense[:, 1]) / size, 0.0)
        stop[cut | (good & (outwards > 1e-9).any(axis=1))] = End.BOUNDARY
        return verdict

    def _at_umbilics(self, live: Indices, step: Step, verdict: Verdict) -> Verdict:
        """Shorten steps that run over an umbilic, until they end next to it.

        A step over an umbilic ends on a line of the other kind, even where it clears the gap.
        """
        good, theta, stop, factor = verdict
        before, after = self.heading.margin[live], step.last.margin
        changed = step.last.kind != self.heading.kind[live]
        lost = np.flatnonzero(good & (changed | (after <= 0)))
        if not len(lost):
            return verdict
        before = np.maximum(before[lost], 0.0)
        fall = before + np.abs(after[lost]) + 1e-300
        part = before / fall
        stuck = ~self._smooth_at(live[lost], step.dense[lost], part)
        small = (before < 1e-3 * fall) & ~changed[lost]
        arrived = stuck & (small | (self.h[live[lost]] < 1e-6 * self.limits.step))
        stop[lost[arrived]] = End.UMBILIC
        theta[lost[arrived]] = np.maximum(part[arrived], 1e-6)
        back = lost[stuck & ~arrived]
        good[back] = False
        factor[back] = np.clip(0.999 * part[stuck & ~arrived], 0.05, 0.95)
        return verdict

    def _smooth_at(self, rows: Indices, dense: Floats, part: Floats) -> Mask:
        """Whether the directions run smoothly over a place of each step, given as a fraction.

        They do so over a line of umbilics, which may be crossed. Around an isolated umbilic they
        turn by half the angle or faster: by 22 degrees or more on the diagonals.
        """
        smooth = np.full(len(rows), self.limits.passing)
        if not self.limits.passing:
            return smooth
        place = dense[:, 0] + part[:, None] * dense[:, 1]
        reference = self.heading.direction[rows]
        aside = 0.5 * self.limits.step
        for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            shift = a * self.heading.velocity[rows] + b * self.heading.across[rows]
            there = self._head(place + aside * shift, reference, self.family[rows])
            smooth &= dot(there.direction, reference) > 0.97
        return smooth

    def _at_seeds(self, live: Indices, step: Step, verdict: Verdict) -> Verdict:
        """Cut steps that pass through their own seed in their own direction: a closed line."""
        good, theta, stop, _ = verdict
        # Forward halves alone may close, so that one half holds the whole line.
        rows = good & (stop == 0) & (live < len(self.end) // 2)
        rows = np.flatnonzero(rows & (self.arc[live] > 2.0 * self.limits.step))
        offset = self.seed[live[rows]] - step.dense[rows, 0]
        period = np.where(np.array(self.domain.periodic), self.domain.size, np.inf)
        turns = np.round(offset / period)
        offset = offset - np.where(turns == 0, 0.0, turns) * np.where(turns == 0, 0.0, period)
        du, dv = (tangent[live[rows]] for tangent in self.seed_tangents)
        chord = step.dense[rows, 1]
        chord3 = du * chord[:, :1] + dv * chord[:, 1:]
        offset3 = du * offset[:, :1] + dv * offset[:, 1:]
        along = dot(offset3, chord3) / np.maximum(dot(chord3, chord3), 1e-300)
        near = (np.abs(along - 0.5) < 1.0) & (dot(chord3, self.seed_direction[live[rows]]) > 0)
        near &= norm(offset3 - along[:, None] * chord3) < self.limits.turn
        rows = rows[near]
        if len(rows):
            part, miss = nearest_on(step.dense[rows], offset[near], du[near], dv[near])
            # A closed line misses its seed by the error gathered on the way round.
            passes = (part > -1e-9) & (part <= 1.0) & (miss < self.limits.turn)
            closed = miss[passes] < 1e4 * self.limits.tolerance
            theta[rows[passes]] = np.maximum(part[passes], 1e-6)
            stop[rows[passes]] = np.where(closed, End.CLOSED, End.SPIRAL)
        return verdict

    def _take(self, live: Indices, step: Step, verdict: Verdict) -> None:
        """Record the good steps and move on."""
        rows = np.flatnonzero(verdict.good)
        moved, theta, dense = live[rows], verdict.theta[rows], step.dense[rows]
        cut = theta < 1.0
        dense[cut] = restricted(dense[cut], theta[cut])
        length = self.h[moved] * theta
        self.taken.append((moved, self.arc[moved], length, dense))
        self.uv[moved] = dense[:, 0] + dense[:, 1]
        self.arc[moved] += length
        for old, new in zip(self.heading, step.last, strict=True):
            old[moved] = new[rows]
        self.end[moved] = verdict.stop[rows]
        running = self.end[moved] == End.RUNNING
        self.end[moved[running & (self.arc[moved] > self.limits.length)]] = End.TOO_LONG
        if self.limits.inside is not None and len(moved):
            within = self.limits.inside(self.domain.reduce(self.uv[moved]))
            self.outside[moved] = np.where(within, 0.0, self.outside[moved] + length)
            self.end[moved[running & (self.outside[moved] > self.limits.outside)]] = End.OUTSIDE
        # A line that came round forwards needs no backward half.
        round_now = moved[np.isin(self.end[moved], _ROUND)]
        self.end[round_now + len(self.end) // 2] = self.end[round_now]

    def lines(self) -> Lines:
        """Half lines joined to lines: the backward half reversed, then the forward half."""
        count = len(self.end) // 2
        none = (np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty((0, 5, 2)))
        columns = zip(none, *self.taken, strict=True)
        owner, arc, length, dense = (np.concatenate(column) for column in columns)
        closed = self.end[:count] == End.CLOSED
        keep = (owner < count) | ~np.isin(self.end[:count], _ROUND)[owner % count]
        owner, arc, length, dense = owner[keep], arc[keep], length[keep], dense[keep]
        backward, line = owner >= count, owner % count
        before = np.bincount(line[backward], length[backward], minlength=count)
        position = np.where(backward, before[line] - arc - length, before[line] + arc)
        dense = np.where(backward[:, None, None], reversed_extension(dense), dense)
        order = np.lexsort((position, line))
        start = np.concatenate([[0], np.cumsum(np.bincount(line, minlength=count))])
        ends = np.stack([self.end[count:], self.end[:count]], axis=1)
        return Lines(start, dense[order], position[order], length[order], closed, ends)
