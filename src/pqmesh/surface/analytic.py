"""Named shapes with exact jets: each is its textbook formula, with sensible domains.

A direction is periodic when its range is exactly one full turn. Default domains stay clear of
poles and cusps; wider ones are the caller's choice, which `check_regular` judges.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import SpecError
from pqmesh.surface.base import Domain, Jet, Surface
from pqmesh.surface.formula import FormulaSurface, nearest_name
from pqmesh.surface.sweep import TURN, Range, checked_range, monge, revolution
from pqmesh.vectors import Floats, read_only


def sphere(radius: float = 1.0, u: Range = TURN, v: Range = (-1.2, 1.2)) -> FormulaSurface:
    """Sphere by longitude u and latitude v; the normal points outwards."""
    _require(radius > 0, "sphere", "radius > 0", radius)
    x, y, z = "r*cos(v)*cos(u)", "r*cos(v)*sin(u)", "r*sin(v)"
    return FormulaSurface(x, y, z, _domain(u, v, "u"), {"r": radius})


def cylinder(radius: float = 1.0, u: Range = TURN, v: Range = (0.0, 1.0)) -> FormulaSurface:
    """Cylinder of revolution around z, height v; the normal points outwards."""
    _require(radius > 0, "cylinder", "radius > 0", radius)
    return FormulaSurface("r*cos(u)", "r*sin(u)", "v", _domain(u, v, "u"), {"r": radius})


def cone(half_angle: float = 0.5, u: Range = TURN, v: Range = (0.5, 1.5)) -> FormulaSurface:
    """Cone of revolution around z with apex 0; v is the distance from the apex, angle in rad."""
    _require(0 < half_angle < math.pi / 2, "cone", "0 < half_angle < pi/2", half_angle)
    x, y, z = "s*v*cos(u)", "s*v*sin(u)", "c*v"
    constants = {"s": math.sin(half_angle), "c": math.cos(half_angle)}
    return FormulaSurface(x, y, z, _domain(u, v, "u"), constants)


def torus(R: float = 3.0, r: float = 1.0, u: Range = TURN, v: Range = TURN) -> FormulaSurface:
    """Ring torus around z; curvatures -1/r and -cos(v)/(R + r cos v) against the outer normal."""
    _require(0 < r < R, "torus", "0 < r < R", (R, r))
    x, y, z = "(R + r*cos(v))*cos(u)", "(R + r*cos(v))*sin(u)", "r*sin(v)"
    return FormulaSurface(x, y, z, _domain(u, v, "uv"), {"R": R, "r": r})


def cyclide(
    a: float = 3.0, c: float = 1.0, d: float = 1.7, u: Range = TURN, v: Range = TURN
) -> FormulaSurface:
    """Ring cyclide of Dupin by its curvature lines, all of them circles [pottmann2007]."""
    _require(0 <= c < d < a, "cyclide", "0 <= c < d < a (a ring without pinch points)", (a, c, d))
    q = "(a - c*cos(u)*cos(v))"
    x = f"(d*(c - a*cos(u)*cos(v)) + b**2*cos(u))/{q}"
    y, z = f"b*sin(u)*(a - d*cos(v))/{q}", f"b*sin(v)*(c*cos(u) - d)/{q}"
    constants = {"a": a, "b": math.sqrt(a * a - c * c), "c": c, "d": d}
    return FormulaSurface(x, y, z, _domain(u, v, "uv"), constants)


def ellipsoid(
    a: float = 3.0,
    b: float = 2.0,
    c: float = 1.2,
    lines: str = "geographic",
    u: Range | None = None,
    v: Range | None = None,
) -> FormulaSurface:
    """Ellipsoid with semi-axes a, b, c along x, y, z.

    With `lines="geographic"`, u is longitude and v reduced latitude. With `lines="curvature"`,
    for a > b > c, the parameter lines are lines of curvature: u, v in (0, pi) cover the half
    y > 0, and the umbilics are the corners of that square.
    """
    _require(min(a, b, c) > 0, "ellipsoid", "a, b, c > 0", (a, b, c))
    if lines == "geographic":
        x, y, z = "a*cos(v)*cos(u)", "b*cos(v)*sin(u)", "c*sin(v)"
        domain = _domain(u or TURN, v or (-1.2, 1.2), "u")
        return FormulaSurface(x, y, z, domain, {"a": a, "b": b, "c": c})
    _require(lines == "curvature", "ellipsoid", "lines geographic or curvature", lines)
    _require(a > b > c, "ellipsoid", "a > b > c for lines of curvature", (a, b, c))
    x = "a*cos(v)*sqrt(cos(u)**2 + m*sin(u)**2)"
    z = "c*sin(u)*sqrt(sin(v)**2 + (1 - m)*cos(v)**2)"
    constants = {"a": a, "b": b, "c": c, "m": (a * a - b * b) / (a * a - c * c)}
    domain = _domain(u or (0.3, math.pi - 0.3), v or (0.3, math.pi - 0.3), "")
    return FormulaSurface(x, "b*cos(u)*sin(v)", z, domain, constants)


def enneper(u: Range = (-1.0, 1.0), v: Range = (-1.0, 1.0)) -> FormulaSurface:
    """Minimal surface of Enneper by its lines of curvature; k = +-2/(1 + u^2 + v^2)^2."""
    x, y = "u - u**3/3 + u*v**2", "v - v**3/3 + v*u**2"
    return FormulaSurface(x, y, "u**2 - v**2", _domain(u, v, ""))


def catenoid(radius: float = 1.0, u: Range = TURN, v: Range = (-1.0, 1.0)) -> FormulaSurface:
    """Minimal surface of revolution around z with waist `radius`; k = +-1/(r cosh^2 v)."""
    _require(radius > 0, "catenoid", "radius > 0", radius)
    x, y = "r*cosh(v)*cos(u)", "r*cosh(v)*sin(u)"
    return FormulaSurface(x, y, "r*v", _domain(u, v, "u"), {"r": radius})


def helicoid(pitch: float = 1.0, u: Range = TURN, v: Range = (-1.0, 1.0)) -> FormulaSurface:
    """Helicoid around z; u, v are asymptotic lines, u + v and u - v lines of curvature."""
    _require(pitch != 0, "helicoid", "pitch other than 0", pitch)
    x, y = "p*sinh(v)*cos(u)", "p*sinh(v)*sin(u)"
    return FormulaSurface(x, y, "p*u", _domain(u, v, ""), {"p": pitch})


def conjugate_cubic(
    c1: float = 1.0,
    c2: float = 1.0,
    a00: ArrayLike = (0.0, 0.0, 0.0),
    a10: ArrayLike = (1.0, 0.0, 0.0),
    a01: ArrayLike = (0.0, 1.0, 0.0),
    a20: ArrayLike = (0.0, 0.0, 1.0),
    u: Range = (-0.35, 0.35),
    v: Range = (-0.35, 0.35),
) -> FormulaSurface:
    """Cubic surface with X_uv = c1 X_u + c2 X_v: its parameter lines are conjugate.

    A saddle everywhere. Cells of size h x k are exactly planar if and only if h|c2| = k|c1|
    [thesis, appendix A; the coefficients follow from its relations 1 to 6].
    """
    _require(c1 != 0 and c2 != 0, "conjugate-cubic", "c1 and c2 other than 0", (c1, c2))
    rows = [_vector(a, "conjugate-cubic") for a in (a00, a10, a01, a20)]
    p00, p10, p01, p20 = rows
    independent = abs(np.linalg.det(rows[1:])) > 1e-12 * np.prod([max(abs(a)) for a in rows[1:]])
    _require(bool(independent), "conjugate-cubic", "a10, a01, a20 linearly independent", "a plane")
    p11 = c1 * p10 + c2 * p01
    p21 = c1 * p20 + c2 / 2 * p11
    p12 = -c1 / c2 * p21
    p02 = (2 * p12 - c1 * p11) / (2 * c2)
    p03, p30 = -c1 / (3 * c2) * p12, -c2 / (3 * c1) * p21
    names = ("1", "u", "v", "u*v", "u**2", "v**2", "u**2*v", "u*v**2", "u**3", "v**3")
    table = (p00, p10, p01, p11, p20, p02, p21, p12, p30, p03)
    x, y, z = (
        " + ".join(f"({float(a[i])!r})*{name}" for a, name in zip(table, names, strict=True))
        for i in range(3)
    )
    return FormulaSurface(x, y, z, _domain(u, v, ""))


@dataclass(frozen=True, eq=False)
class MovedSurface:
    """A surface after a similarity: x -> scale * rotation x + translation."""

    surface: Surface
    rotation: Floats
    translation: Floats
    scale: float

    @property
    def domain(self) -> Domain:
        """The parameter rectangle of the original."""
        return self.surface.domain

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet at parameters uv of shape (N, 2)."""
        linear = self.scale * self.rotation.T
        rows = [row @ linear for row in self.surface.jet(uv)]
        return Jet(rows[0] + self.translation, *rows[1:])


def moved(
    surface: Surface,
    rotation: ArrayLike | None = None,
    translation: ArrayLike = (0.0, 0.0, 0.0),
    scale: float = 1.0,
) -> MovedSurface:
    """The surface after x -> scale * rotation x + translation.

    Parameters
    ----------
    rotation : (3, 3), optional
        Orthogonal; a reflection turns the normal over.
    translation : (3,)
        Model unit.
    scale : float
        Positive.

    Raises
    ------
    SpecError
        If `rotation` is not orthogonal to 1e-9, or `scale` is not positive.

    Examples
    --------
    >>> moved(sphere(), translation=(0, 0, 5)).jet(np.zeros((1, 2))).point
    array([[1., 0., 5.]])
    """
    matrix = np.eye(3) if rotation is None else np.array(rotation, dtype=np.float64)
    fits = matrix.shape == (3, 3) and bool(np.abs(matrix @ matrix.T - np.eye(3)).max() <= 1e-9)
    _require(fits, "moved", "rotation an orthogonal 3 x 3 matrix", matrix.tolist())
    _require(bool(scale > 0 and np.isfinite(scale)), "moved", "a finite scale > 0", scale)
    shift = _vector(translation, "moved")
    return MovedSurface(surface, read_only(matrix), read_only(shift), float(scale))


SHAPES: dict[str, Callable[..., Surface]] = {
    "sphere": sphere,
    "cylinder": cylinder,
    "cone": cone,
    "torus": torus,
    "cyclide": cyclide,
    "ellipsoid": ellipsoid,
    "revolution": revolution,
    "monge": monge,
    "conjugate-cubic": conjugate_cubic,
    "enneper": enneper,
    "catenoid": catenoid,
    "helicoid": helicoid,
}


def shape_surface(kind: str, **parameters: Any) -> Surface:
    """Surface of a kind in `SHAPES`, from its parameters by name.

    Raises
    ------
    SpecError
        For an unknown kind or parameter, naming the nearest known one, and for wrong values.

    Examples
    --------
    >>> shape_surface("torus", R=5.0, r=2.0).domain.periodic
    (True, True)
    """
    if kind not in SHAPES:
        raise SpecError(
            f"The kind of a shape must be known; found {kind!r}{nearest_name(str(kind), SHAPES)}. "
            f"Known are {', '.join(SHAPES)}."
        )
    known = inspect.signature(SHAPES[kind]).parameters
    for name, value in parameters.items():
        if name not in known:
            raise SpecError(
                f"A {kind} has no parameter {name!r}{nearest_name(name, known)}. "
                f"It has {', '.join(known)}."
            )
        _check_kind_of_value(kind, name, value, known[name].default)
    return SHAPES[kind](**parameters)


def _check_kind_of_value(kind: str, name: str, value: Any, default: Any) -> None:
    """Refuse a parameter whose value is not of the kind of its default."""
    if name in ("u", "v"):
        checked_range(value, name)
    elif isinstance(default, str):
        _require(isinstance(value, str), kind, f"{name} as text", value)
    elif isinstance(default, float):
        real = isinstance(value, int | float) and not isinstance(value, bool)
        _require(real and abs(value) <= 1e100, kind, f"{name} a finite number", value)
    elif default is None:
        _require(isinstance(value, dict), kind, f"{name} a table of numbers", value)


def _require(holds: bool, kind: str, what: str, found: object) -> None:
    """Raise SpecError unless a condition on a shape holds."""
    if not holds:
        raise SpecError(f"{kind} needs {what}; found {str(found)[:80]}. Change the parameter.")


def _domain(u: Range, v: Range, turning: str) -> Domain:
    """Domain in which the turning parameters are periodic when given one full turn."""
    ranges = checked_range(u, "u"), checked_range(v, "v")
    full = [
        name in turning and math.isclose(high - low, 2 * math.pi, rel_tol=1e-12)
        for name, (low, high) in zip("uv", ranges, strict=True)
    ]
    return Domain(*ranges, periodic=(full[0], full[1]))


def _vector(a: ArrayLike, kind: str) -> Floats:
    """A finite vector of three coordinates."""
    try:
        row = np.array(a, dtype=np.float64)
    except (TypeError, ValueError):
        row = np.empty(0)
    fits = row.shape == (3,) and bool(np.isfinite(row).all())
    _require(fits, kind, "vectors of three finite coordinates", a)
    return row
