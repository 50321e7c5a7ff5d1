"""Pairs of tangent directions at every point of a surface: what the two families follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pqmesh.network.trace import Field, Heading
from pqmesh.surface.base import Jet, Surface
from pqmesh.surface.curvature import second_form, shape_data
from pqmesh.vectors import TINY, Floats, norm

# Families that meet under a smaller angle make no panels: near asymptotic directions a conjugate
# pair falls together.
LEAST_ANGLE = np.radians(10.0)


class Cross(NamedTuple):
    """Two directions at N points.

    Attributes
    ----------
    steps : (N, 2, 2)
        Parameter steps (du, dv) at unit surface speed, one row a family.
    directions : (N, 2, 3)
        The same in space, unit vectors; their sign means nothing.
    margin : (N,)
        Positive where the pair is defined; falls through zero where it ends.
    """

    steps: Floats
    directions: Floats
    margin: Floats


# (surface, uv (N, 2) in the domain) -> Cross
CrossField = Callable[[Surface, Floats], Cross]


def principal_cross(gap: float) -> CrossField:
    """Principal directions, ending where k1 - k2 falls below the gap (1/length)."""

    def cross(surface: Surface, uv: Floats) -> Cross:
        shape = shape_data(surface.jet(uv))
        return Cross(shape.directions_uv, shape.directions, shape.k[:, 0] - shape.k[:, 1] - gap)

    return cross


def parameter_cross(surface: Surface, uv: Floats) -> Cross:
    """Directions of the parameter lines: family 0 along u, family 1 along v."""
    jet = surface.jet(uv)
    one, zero = np.ones(len(uv)), np.zeros(len(uv))
    return _paired(jet, np.column_stack([one, zero]), np.column_stack([zero, one]))


def conjugate_cross(plan_direction: Callable[[Floats], Floats]) -> CrossField:
    """A family that looks in given plan directions, and its conjugate one.

    Parameters
    ----------
    plan_direction : callable
        Plan vectors (N, 2) at surface points (N, 3). Family 0 are the surface curves that run
        along them in plan; family 1 is conjugate: II(a, b) = 0.

    References: [thesis] definition 2.1.7; transversality, errata page, E3.
    """

    def cross(surface: Surface, uv: Floats) -> Cross:
        jet = surface.jet(uv)
        wanted = plan_direction(jet.point)
        plan = np.stack([jet.du[:, :2], jet.dv[:, :2]], axis=2)
        first = np.asarray(np.linalg.solve(plan, wanted[..., None])[..., 0], dtype=np.float64)
        return _paired(jet, first, conjugate_step(jet, first))

    return cross


def conjugate_step(jet: Jet, step: Floats) -> Floats:
    """Parameter steps b with II(step, b) = 0, any length, (N, 2)."""
    bent = np.einsum("nij,nj->ni", second_form(jet), step)
    return np.column_stack([-bent[:, 1], bent[:, 0]])


def _paired(jet: Jet, first: Floats, second: Floats) -> Cross:
    """Cross of two parameter steps of any length; it ends where they fall together."""
    steps = np.stack([first, second], axis=1)
    vectors = steps[..., :1] * jet.du[:, None] + steps[..., 1:] * jet.dv[:, None]
    length = np.maximum(norm(vectors), TINY)[..., None]
    steps, vectors = steps / length, vectors / length
    sine = norm(np.cross(vectors[:, 0], vectors[:, 1]))
    return Cross(steps, vectors, sine - np.sin(LEAST_ANGLE))


def followed(cross: CrossField) -> Field:
    """Field that follows, of the two directions, the one nearest to the reference."""

    def heading(surface: Surface, uv: Floats, reference: Floats) -> Heading:
        pair = cross(surface, uv)
        along = np.einsum("nfi,ni->nf", pair.directions, reference)
        family = np.abs(along).argmax(axis=1)
        row = np.arange(len(uv))
        sign = np.where(along[row, family] < 0, -1.0, 1.0)[:, None]
        return Heading(
            sign * pair.steps[row, family],
            pair.steps[row, 1 - family],
            sign * pair.directions[row, family],
            family,
            pair.margin,
        )

    return heading
