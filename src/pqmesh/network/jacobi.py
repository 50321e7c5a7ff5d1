"""Geodesics on a surface, with the Jacobi field that tells where a family of them focuses.

A family leaves a start curve at right angles, at equal steps. How far apart two neighbours are
at arc length s is j(s) steps, to first order, with j'' + K j = 0, j(0) = 1 and, where the start
curve is itself a geodesic, j'(0) = 0.
"""

from __future__ import annotations

import numpy as np

from pqmesh.network.lines import Lines, slopes
from pqmesh.network.steps import continuous, embedded_error, stages
from pqmesh.network.walker import End, Heading, Limits, Step, Verdict, Walker, surface_length
from pqmesh.surface.base import Jet, Surface
from pqmesh.surface.curvature import gaussian_curvature, shape_data
from pqmesh.vectors import Floats, Indices, cross, dot, unit

# A geodesic that comes back to its seed closes there if it has turned by less than the first
# angle, goes on beside itself up to the second one, and crosses itself beyond.
_SAME_WAY, _BESIDE = np.cos(np.radians([0.1, 25.0]))


def trace_geodesics(
    surface: Surface, seeds: Floats, directions: Floats, limits: Limits, least: float = -np.inf
) -> Lines:
    """Geodesics through seed points, followed both ways to their exact ends.

    Parameters
    ----------
    seeds : (L, 2)
        Parameters inside the domain.
    directions : (L, 3)
        Tangent vectors there, of any length but 0.
    limits : Limits
    least : float
        Lines end (`End.FOCAL`) where neighbours have come as near to each other as this share
        of their distance at the seeds; 0 at focal points, by default never.

    References: [docarmo1976] sections 4.4 and 5.5; [dormand1980].

    Examples
    --------
    >>> from pqmesh.surface.analytic import sphere
    >>> limits = Limits(step=0.1, length=20.0, tolerance=1e-11, turn=0.05)
    >>> lines = trace_geodesics(sphere(), np.zeros((1, 2)), np.array([[0.0, 1.0, 0.0]]), limits)
    >>> bool(lines.closed[0]), round(float(lines.total[0]), 9)
    (True, 6.283185307)
    """
    return _GeodesicWalker(surface, seeds, limits, least).followed(directions)


def geodesic_bend(jet: Jet, velocity: Floats) -> Floats:
    """Second derivatives (u'', v'') of geodesics from their first ones, (N, 2).

    The acceleration in space, X_u u'' + X_v v'' + a with a = X_uu u'^2 + 2 X_uv u'v' + X_vv v'^2,
    has no tangential part.
    """
    u, v = velocity[:, :1], velocity[:, 1:]
    a = jet.duu * u**2 + 2.0 * jet.duv * (u * v) + jet.dvv * v**2
    e, f, g = dot(jet.du, jet.du), dot(jet.du, jet.dv), dot(jet.dv, jet.dv)
    p, q = dot(jet.du, a), dot(jet.dv, a)
    area = e * g - f * f
    return np.asarray(np.stack([(f * q - g * p) / area, (f * p - e * q) / area], axis=1))


class _GeodesicWalker(Walker):
    """Walker whose state is position, velocity and the Jacobi field with its rate."""

    def __init__(self, surface: Surface, seeds: Floats, limits: Limits, least: float) -> None:
        # No focal point is passed.
        limits = limits._replace(passing=False)
        family = np.zeros(len(seeds), dtype=np.int64)
        super().__init__(surface, self._along, limits, seeds, family)
        self.least = least
        self.jacobi = np.tile([1.0, 0.0], (len(self.uv), 1))
        self.tried_jacobi = self.jacobi

    def _along(self, surface: Surface, uv: Floats, reference: Floats, _: Indices) -> Heading:
        """Heading along given tangent vectors: that of the seeds."""
        jet = surface.jet(uv)
        data = shape_data(jet)
        cos = np.einsum("nfi,ni->nf", data.directions, reference)
        cos /= np.hypot(cos[:, 0], cos[:, 1])[:, None]
        velocity = np.einsum("nf,nfi->ni", cos, data.directions_uv)
        return self._moving(jet, velocity, np.ones(len(uv)))

    def _moving(self, jet: Jet, velocity: Floats, j: Floats) -> Heading:
        """Heading of geodesics with given velocity and Jacobi field."""
        direction = jet.du * velocity[:, :1] + jet.dv * velocity[:, 1:]
        normal = cross(jet.du, jet.dv)
        area2 = dot(normal, normal)
        side = cross(normal, direction) / np.sqrt(area2)[:, None]
        # side = a X_u + b X_v, by products with the normal.
        across = np.stack([dot(cross(side, jet.dv), normal), dot(cross(jet.du, side), normal)], 1)
        kind = np.zeros(len(velocity), dtype=np.int64)
        return Heading(velocity, across / area2[:, None], direction, kind, j - self.least)

    def _tried(self, live: Indices) -> Step:
        """Stages of one step and its continuous extension."""

        def motion(state: Floats) -> tuple[Floats, Heading]:
            velocity, j, rise = state[:, 2:4], state[:, 4:5], state[:, 5:]
            jet = self.surface.jet(self.domain.reduce(state[:, :2]))
            force = -gaussian_curvature(jet)[:, None] * j
            rates = np.hstack([velocity, geodesic_bend(jet, velocity), rise, force])
            return rates, self._moving(jet, velocity, j[:, 0])

        h = self.h[live][:, None]
        velocity = self.heading.velocity[live]
        start = np.hstack([self.uv[live], velocity, self.jacobi[live]])
        rates, finish, last = stages(start, motion(start)[0], h, motion)
        self.tried_jacobi = finish[:, 4:]
        dense = continuous(start[:, :2], finish[:, :2], h, rates[..., :2])
        error = embedded_error(h, rates)
        across = self.heading.across[live]
        length = surface_length(error[:, :2], velocity, across)
        # An error of the direction grows over the rest of the line.
        turn = 0.25 * self.limits.length * surface_length(error[:, 2:4], velocity, across)
        return Step(dense, last, np.maximum(length, turn) / self.limits.tolerance)

    def _at_umbilics(self, live: Indices, step: Step, verdict: Verdict) -> Verdict:
        """Shorten steps that run over a focal point, until they end next to it."""
        verdict = super()._at_umbilics(live, step, verdict)
        verdict.stop[verdict.stop == End.UMBILIC] = End.FOCAL
        return verdict

    def _at_seeds(self, live: Indices, step: Step, verdict: Verdict) -> Verdict:
        """A geodesic closes only where it passes its seed in the same direction."""
        verdict = super()._at_seeds(live, step, verdict)
        rows = np.flatnonzero(np.isin(verdict.stop, (End.CLOSED, End.SPIRAL)))
        slope = slopes(step.dense[rows], verdict.theta[rows])
        du, dv = (tangent[live[rows]] for tangent in self.seed_tangents)
        cos = dot(unit(du * slope[:, :1] + dv * slope[:, 1:]), self.seed_direction[live[rows]])
        away = rows[cos < _BESIDE]
        verdict.stop[away], verdict.theta[away] = End.RUNNING, 1.0
        verdict.stop[rows[(cos >= _BESIDE) & (cos < _SAME_WAY)]] = End.SPIRAL
        return verdict

    def _take(self, live: Indices, step: Step, verdict: Verdict) -> None:
        """Record the good steps and move on."""
        super()._take(live, step, verdict)
        good = verdict.good
        self.jacobi[live[good]] = self.tried_jacobi[good]
