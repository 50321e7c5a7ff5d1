"""Surfaces swept by a plane profile: turned around an axis, or carried along a plane spine."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from pqmesh.errors import SpecError
from pqmesh.surface.base import Domain, Jet
from pqmesh.surface.expression import Graph, JetProgram, Term, jet_program
from pqmesh.surface.formula import checked_constants, parse_formula
from pqmesh.surface.regular import closes
from pqmesh.vectors import Floats

Range: TypeAlias = tuple[float, float]
Constants: TypeAlias = dict[str, float]

TURN: Range = (0.0, 2.0 * math.pi)


@dataclass(frozen=True, eq=False)
class SweptSurface:
    """Surface made from profile and spine formulas; see `revolution` and `monge`."""

    kind: str
    formulas: tuple[tuple[str, str], ...]
    domain: Domain
    program: JetProgram

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet at parameters uv of shape (N, 2)."""
        return self.program.jet(uv)


def revolution(
    r: str = "2 + cos(v)",
    z: str = "2*v",
    u: Range = TURN,
    v: Range = (0.0, 2.0),
    constants: Constants | None = None,
) -> SweptSurface:
    """Surface of revolution around z with profile (r(v), z(v)), turned by the angle u.

    Raises
    ------
    SpecError
        For a formula of anything else than v and the constants.
    SurfaceError
        If a formula is not finite at a bound.

    Examples
    --------
    >>> import numpy as np
    >>> revolution("2", "v", v=(0, 1)).jet(np.zeros((1, 2))).point
    array([[2., 0., 0.]])
    """
    formulas = (("r", r), ("z", z))
    graph, (radius, height) = _parsed(formulas, "vv", constants)
    turn = graph.variable(0)
    program = jet_program((radius * turn.cos(), radius * turn.sin(), height))
    return _closed("revolution", formulas, u, v, program)


def monge(
    x: str = "4*cos(u)",
    y: str = "3*sin(u)",
    p: str = "v",
    z: str = "v**2/2",
    u: Range = (0.0, math.pi),
    v: Range = (-1.0, 1.0),
    constants: Constants | None = None,
) -> SweptSurface:
    """Moulding surface: a profile carried along a plane spine, in planes normal to it.

    X = (x(u), y(u), 0) + p(v) n(u) + z(v) e_z with the unit normal n of the spine, to the left of
    its direction. The parameter lines are lines of curvature. Regular where p(v) stays below the
    spine's radius of curvature.

    Raises
    ------
    SpecError
        For a formula of anything else than its variable and the constants, or a fixed spine.
    SurfaceError
        If a formula is not finite at a bound.

    Examples
    --------
    >>> import numpy as np
    >>> monge("u", "0*u", "v", "v**2").jet(np.array([[2.0, 1.0]])).point
    array([[2., 1., 1.]])
    """
    formulas = (("x", x), ("y", y), ("p", p), ("z", z))
    graph, (along, across, out, height) = _parsed(formulas, "uuvv", constants)
    dx, dy = graph.slope(along, 0), graph.slope(across, 0)
    if dx.value == 0.0 and dy.value == 0.0:
        raise SpecError(f"The spine of monge must move with u; x = {x!r}, y = {y!r} stand still.")
    speed = dx.hypot(dy)
    program = jet_program((along - out * (dy / speed), across + out * (dx / speed), height))
    return _closed("monge", formulas, u, v, program)


def _closed(
    kind: str, formulas: tuple[tuple[str, str], ...], u: Range, v: Range, program: JetProgram
) -> SweptSurface:
    """The surface, periodic where its spine, its turn or its profile closes smoothly."""
    domain = Domain(checked_range(u, "u"), checked_range(v, "v"))
    surface = SweptSurface(kind, formulas, domain, program)
    return replace(surface, domain=replace(domain, periodic=closes(surface)))


def _parsed(
    formulas: tuple[tuple[str, str], ...], variables: str, constants: Constants | None
) -> tuple[Graph, list[Term]]:
    """Terms of profile formulas, each of one variable only."""
    graph = Graph()
    numbers = checked_constants(constants or {}, ("u", "v"))
    places = {"u": graph.variable(0), "v": graph.variable(1)}
    terms = [
        parse_formula(graph, text, label, {name: places[name], **numbers})
        for (label, text), name in zip(formulas, variables, strict=True)
    ]
    return graph, terms


def checked_range(value: Any, name: str) -> Range:
    """A pair of increasing finite numbers."""
    try:
        low, high = (float(end) for end in value)
    except (TypeError, ValueError, OverflowError):
        low, high = math.nan, math.nan
    if not -math.inf < low < high < math.inf:
        raise SpecError(
            f"{name} must be a range [low, high] of finite numbers; found {str(value)[:80]}."
        )
    return low, high
