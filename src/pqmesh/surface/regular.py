"""Whether a surface is fit for use: finite, with a tangent plane everywhere, and closing."""

from __future__ import annotations

import numpy as np

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Domain, Jet, Surface
from pqmesh.vectors import Floats, Mask, cross, norm, unit

# Below these shares a normal is rounding noise, or its direction turns within a few digits.
NORMAL_TOLERANCE = 1e-8
CLOSING_TOLERANCE = 1e-7
LARGEST = 1e150


def check_regular(surface: Surface, n: int = 65) -> None:
    """Nothing, once a surface is known to be regular at n x n samples.

    Finite values, coordinates below 1e150, a normal that does not vanish, and points and tangents
    that agree over every periodic bound. The samples include the bounds and the corners, where
    poles use to be; what happens between samples is not seen.

    Parameters
    ----------
    surface : Surface
        Any.
    n : int
        Samples in each direction, at least 2.

    Raises
    ------
    SurfaceError
        Naming the first bad parameters, the point in space and what was found there.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> check_regular(graph_surface("x*y", (-1, 1), (-1, 1)))
    """
    uv = bounds_grid(surface.domain, n).reshape(-1, 2)
    jet = surface.jet(uv)
    with np.errstate(all="ignore"):
        size = np.max([np.abs(row).max(axis=1) for row in jet], axis=0)
    _refuse_first(~np.isfinite(size), uv, jet, "be finite", "its jet is not")
    _refuse_first(size > LARGEST, uv, jet, f"stay below {LARGEST:g}", "its jet is larger")
    # Of unit vectors first: the plain product would overflow long before the coordinates do.
    sine = norm(cross(unit(jet.du), unit(jet.dv)))
    area = sine * norm(jet.du) * norm(jet.dv)
    poles = (area <= NORMAL_TOLERANCE * np.median(area)) & (np.median(sine) > NORMAL_TOLERANCE)
    for bad, what in (
        (poles, "its median: this is a pole or a singular point"),
        (
            sine <= NORMAL_TOLERANCE,
            "|X_u||X_v|: the parameter lines are tangent to each other, or one stands still",
        ),
    ):
        found = f"X_u x X_v is below {NORMAL_TOLERANCE:g} of {what}"
        _refuse_first(bad, uv, jet, "have a normal", found)
    for axis, closed in enumerate(closes(surface, n)):
        if surface.domain.periodic[axis] and not closed:
            raise SurfaceError(
                f"A surface that is periodic in {'uv'[axis]} must have equal points and first "
                f"derivatives at both bounds; they differ by more than {CLOSING_TOLERANCE:g} of "
                "their size. Give one full period, or make the direction not periodic."
            )


def closes(surface: Surface, n: int = 65) -> tuple[bool, bool]:
    """Whether points and first derivatives agree at both bounds, for u and for v.

    Use it to find out which directions of a formula or of an imported patch are periodic.

    Examples
    --------
    >>> from pqmesh.surface.formula import FormulaSurface
    >>> tube = FormulaSurface("cos(u)", "sin(u)", "v", Domain((0, 2 * np.pi), (0, 1)))
    >>> closes(tube)
    (True, False)
    """
    grid = bounds_grid(surface.domain, n)
    answer = []
    for axis in (0, 1):
        ends = [surface.jet(grid.swapaxes(0, axis)[place]) for place in (0, -1)]
        reach = np.ptp(np.concatenate([end.point for end in ends]), axis=0).max()
        step = surface.domain.size[axis]
        scale = max(float(reach), step * float(np.abs(ends[0][1 + axis]).max()))
        gaps = [np.abs(a - b).max() for a, b in zip(*ends, strict=True)][:3]
        sizes = (scale, *(scale / length for length in surface.domain.size))
        pairs = zip(gaps, sizes, strict=True)
        answer.append(all(bool(gap <= CLOSING_TOLERANCE * size) for gap, size in pairs))
    return answer[0], answer[1]


def bounds_grid(domain: Domain, n: int) -> Floats:
    """Parameters on n x n lines from bound to bound, shape (n, n, 2)."""
    u, v = np.linspace(*domain.u, n), np.linspace(*domain.v, n)
    return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)


def _refuse_first(bad: Mask, uv: Floats, jet: Jet, must: str, found: str) -> None:
    """Raise for the first bad sample, if there is one."""
    if bad.any():
        i = int(np.argmax(bad))
        point = ", ".join(f"{x:.6g}" for x in jet.point[i])
        raise SurfaceError(
            f"A surface must {must} everywhere; at u = {uv[i, 0]:.6g}, v = {uv[i, 1]:.6g}, "
            f"point ({point}), {found}. Narrow the domain, or change the surface there."
        )
