"""Pairs of tangent directions at every point of a surface: what the two families follow."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from pqmesh.network.trace import Field, Heading
from pqmesh.surface.base import Jet, Surface
from pqmesh.surface.curvature import second_form
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm, unit

# A surface steeper than this against the plan takes no directions from there.
STEEPEST = np.cos(np.radians(87.0))


class Pair(NamedTuple):
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

    @property
    def sine(self) -> Floats:
        """Sine of the angle between the two directions, shape (N,)."""
        return norm(cross(self.directions[:, 0], self.directions[:, 1]))


# (surface, uv (N, 2) in the domain) -> Pair
PairField = Callable[[Surface, Floats], Pair]


def parameter_pair(surface: Surface, uv: Floats) -> Pair:
    """Directions of the parameter lines: family 0 along u, family 1 along v.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> pair = parameter_pair(graph_surface("x", (0, 1), (0, 1)), np.array([[0.5, 0.5]]))
    >>> pair.directions[0].round(4).tolist()
    [[0.7071, 0.0, 0.7071], [0.0, 1.0, 0.0]]
    """
    jet = surface.jet(uv)
    one, zero = np.ones(len(uv)), np.zeros(len(uv))
    return paired(jet, np.column_stack([one, zero]), np.column_stack([zero, one]), one)


def conjugate_pair(
    plan_direction: Callable[[Floats], Floats], least_angle: float, least_bending: float
) -> PairField:
    """A family that runs in given plan directions, and its conjugate one.

    Parameters
    ----------
    plan_direction : callable
        Plan vectors (N, 2), of any length but 0, at surface points (N, 3). Family 0 are the
        surface curves that run along them in plan; family 1 is conjugate: II(a, b) = 0.
    least_angle : float, radians
        The pair ends where its directions meet under less than this, near asymptotic ones.
    least_bending : float, 1/length
        It ends where the shape operator turns family 0 into less than this.

    References: [thesis] definition 2.1.7; [docarmo1976] section 3.2; errata page, E3.
    """

    def pair(surface: Surface, uv: Floats) -> Pair:
        jet = surface.jet(uv)
        first = steps_of(jet, plan_tangents(jet, plan_direction(jet.point)))
        image = _product(second_form(jet), first)
        second = np.column_stack([-image[:, 1], image[:, 0]])
        found = paired(jet, first, second, np.ones(len(uv)))
        apart = found.sine / np.sin(least_angle) - 1.0
        bent = bending(jet, found.steps[:, 0]) / least_bending - 1.0
        return found._replace(margin=np.minimum(apart, bent))

    return pair


def plan_tangents(jet: Jet, plan: Floats) -> Floats:
    """Tangent vectors (N, 3) that stand over plan vectors (N, 2), of any length and sign.

    Each lies in the tangent plane and in the vertical plane of its plan vector, so it exists
    where the surface is upright as well, unless both planes are the same: there it is 0.
    """
    normal = unit(cross(jet.du, jet.dv))
    rise = -dot(normal[:, :2], plan)
    return np.asarray(np.column_stack([plan * normal[:, 2:], rise]))


def steps_of(jet: Jet, tangents: Floats) -> Floats:
    """Parameter steps (N, 2) of tangent vectors (N, 3)."""
    return _raised(jet, np.stack([dot(jet.du, tangents), dot(jet.dv, tangents)], axis=1))


def bending(jet: Jet, steps: Floats) -> Floats:
    """Length of the shape operator's image of unit tangent steps (N, 2), 1/length, (N,).

    Where it vanishes every direction is conjugate to the step, and none is singled out.
    """
    bent = _product(second_form(jet), steps)
    return np.sqrt(np.maximum(dot(bent, _raised(jet, bent)), 0.0))


def _raised(jet: Jet, products: Floats) -> Floats:
    """Steps (N, 2) whose products with X_u and X_v are given: the first form is solved for."""
    e, f, g = dot(jet.du, jet.du), dot(jet.du, jet.dv), dot(jet.dv, jet.dv)
    p, q = products[:, 0], products[:, 1]
    rows = np.stack([g * p - f * q, e * q - f * p], axis=1)
    return np.asarray(rows / (e * g - f * f)[:, None])


def _product(form: Floats, steps: Floats) -> Floats:
    """Rows of forms (N, 2, 2) times steps (N, 2)."""
    return np.asarray(np.einsum("nij,nj->ni", form, steps))


def paired(jet: Jet, first: Floats, second: Floats, margin: Floats) -> Pair:
    """Pair of two parameter steps of any length but 0."""
    steps = np.stack([first, second], axis=1)
    vectors = steps[..., :1] * jet.du[:, None] + steps[..., 1:] * jet.dv[:, None]
    length = np.maximum(norm(vectors), TINY)[..., None]
    return Pair(steps / length, vectors / length, margin)


def pair_field(pair: PairField) -> Field:
    """Field that follows one direction of a pair, by family; its sign by continuity.

    The other way to follow a pair, the direction nearest to the last heading, would change
    families where they meet under a small angle.
    """

    def heading(surface: Surface, uv: Floats, reference: Floats, family: Indices) -> Heading:
        found, row = pair(surface, uv), np.arange(len(uv))
        direction = found.directions[row, family]
        sign = np.where(dot(direction, reference) < 0, -1.0, 1.0)[:, None]
        return Heading(
            sign * found.steps[row, family],
            found.steps[row, 1 - family],
            sign * direction,
            family.copy(),
            found.margin,
        )

    return heading
