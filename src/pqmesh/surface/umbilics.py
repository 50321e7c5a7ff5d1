"""Umbilics of a surface, and how far it is from having none: what a network must know first.

At an umbilic both principal curvatures are equal and the lines of curvature have a singularity.
In an orthonormal tangent frame an umbilic is a zero of the deviator, the traceless part of the
second form, whose angle is twice the angle of the first principal direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pqmesh.surface.base import Domain, Jet, Surface
from pqmesh.surface.curvature import second_form_in, shape_data
from pqmesh.vectors import TINY, Floats, Mask, dot, norm

# |k1 - k2| below this share of the largest curvature: no principal directions worth following.
DEGENERATE = 1e-3
# Radius of the circle around an umbilic on which it is classified, in sizes of the domain.
CIRCLE = 1e-4
CIRCLE_SAMPLES = 360
REFINEMENTS = 60
KINDS = {(-0.5, 3): "star", (0.5, 1): "lemon", (0.5, 3): "monstar"}


@dataclass(frozen=True)
class Umbilic:
    """One isolated umbilic.

    Attributes
    ----------
    uv : (float, float)
        Parameters.
    point : (float, float, float)
        Place in space, model unit.
    index : float
        Turns of the lines of curvature around it; +-1/2 unless it is degenerate.
    kind : str
        `star` (index -1/2, three lines of each family end in it), `lemon` (+1/2, one), `monstar`
        (+1/2, three), `degenerate`, or `rim`: on a bound of the domain, where no circle fits
        around it and the index is given as 0.
    """

    uv: tuple[float, float]
    point: tuple[float, float, float]
    index: float
    kind: str


@dataclass(frozen=True)
class UmbilicReport:
    """Where the principal directions fail.

    Attributes
    ----------
    umbilics : tuple of Umbilic
        Isolated ones, ordered by u, then v. Those of index 0, which leave the network as it
        is, and lines of umbilics are left out.
    degenerate_fraction : float
        Share of the samples with |k1 - k2| < 1e-3 max|k|: spherical and plane parts.
    degenerate_uv : (float, float) or None
        The most degenerate sample, if the share is not zero.
    viability : float
        Smallest over median |k1 - k2| of the samples; 0 where there is no network to follow.
    """

    umbilics: tuple[Umbilic, ...]
    degenerate_fraction: float
    degenerate_uv: tuple[float, float] | None
    viability: float


def find_umbilics(
    surface: Surface, inside: Callable[[Floats], Mask] | None = None, n: int = 80
) -> UmbilicReport:
    """Umbilics by the winding of the deviator around the cells of a sampling, then refined.

    Parameters
    ----------
    surface : Surface
        Regular on its domain.
    inside : callable, optional
        Truth for each row of uv (N, 2); the report is then about that part alone.
    n : int
        Cells in each direction. Umbilics closer together than a cell may cancel.

    References: [berry1977] for the three kinds.

    Examples
    --------
    >>> from pqmesh.surface.analytic import ellipsoid
    >>> report = find_umbilics(ellipsoid())
    >>> [(u.kind, u.index) for u in report.umbilics]
    [('lemon', 0.5), ('lemon', 0.5), ('lemon', 0.5), ('lemon', 0.5)]
    """
    grid = _uneven_grid(surface.domain, n)
    uv = grid.reshape(-1, 2)
    data = shape_data(surface.jet(uv))
    gap, bend = data.k[:, 0] - data.k[:, 1], np.abs(data.k).max(axis=1)
    chosen = np.ones(len(uv), dtype=bool) if inside is None else np.asarray(inside(uv))
    if not chosen.any():
        return UmbilicReport((), 0.0, None, math.inf)
    flat = chosen & (gap <= DEGENERATE * bend[chosen].max())
    worst = int(np.argmin(np.where(chosen, gap, math.inf)))
    median = float(np.median(gap[chosen]))
    noise = 1e-9 * bend.max()
    umbilics: list[Umbilic] = []
    if median > noise:
        starts = _suspects(grid, data.deviator.reshape(*grid.shape), noise)
        found = _refined(surface, starts, 1e-9 * median)
        umbilics = _classified(surface, found)
        if inside is not None:
            umbilics = [u for u in umbilics if bool(np.asarray(inside(np.array([u.uv])))[0])]
    return UmbilicReport(
        tuple(umbilics),
        float(flat.sum() / chosen.sum()),
        _pair(uv[worst]) if flat.any() else None,
        float(gap[worst] / median) if median > noise else 0.0,
    )


def conjugacy_defect(surface: Surface, uv: Floats, a: Floats, b: Floats) -> Floats:
    """How far tangent vectors are from conjugate: |II(a, b)| / (|II| |a| |b|), in [0, 1].

    |II| is the spectral norm, the larger of |k1| and |k2|; lengths are those of the tangent
    vectors in space. At a flat point, where every pair is conjugate, the defect is 0.

    Parameters
    ----------
    uv : (N, 2)
        Parameters.
    a, b : (N, 2)
        Tangent vectors as parameter steps, not zero.

    References: [thesis] definition 2.1.7; [docarmo1976] section 3.2.

    Examples
    --------
    >>> from pqmesh.surface.analytic import torus
    >>> at, a, b = np.array([[0.3, 0.5]]), np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    >>> conjugacy_defect(torus(), at, a, b).round(12)
    array([0.])
    """
    jet = surface.jet(uv)
    size = np.abs(shape_data(jet).k).max(axis=1) * norm(_lifted(jet, a)) * norm(_lifted(jet, b))
    value = np.abs(second_form_in(jet, a, b))
    return np.where(size > TINY, value / np.where(size > TINY, size, 1.0), 0.0)


def _lifted(jet: Jet, step: Floats) -> Floats:
    """Tangent vectors in space of parameter steps."""
    return jet.du * step[:, :1] + jet.dv * step[:, 1:]


def _pair(uv: Floats) -> tuple[float, float]:
    return float(uv[0]), float(uv[1])


def _uneven_grid(domain: Domain, n: int) -> Floats:
    """Cell corners from bound to bound, shape (n+1, n+1, 2).

    Inner lines are moved off the even places: umbilics of symmetric surfaces like to lie on
    halves and quarters, where the winding around a cell would not be defined.
    """
    share = np.linspace(0.0, 1.0, n + 1)
    lines = []
    for low, size, bend in zip(domain.low, domain.size, (0.0237, 0.0311), strict=True):
        lines.append(low + size * (share + bend * share * (1.0 - share) * (1.3 - share)))
    return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)


def _suspects(grid: Floats, deviator: Floats, noise: float) -> Floats:
    """Parameters near which umbilics are expected, shape (M, 2).

    Cells around which the deviator winds, and corners where it is smallest among neighbours: the
    latter catch umbilics on the rim and those whose windings cancel.
    """
    size = np.hypot(deviator[..., 0], deviator[..., 1])
    angle = np.arctan2(deviator[..., 1], deviator[..., 0])
    ring = [angle[:-1, :-1], angle[1:, :-1], angle[1:, 1:], angle[:-1, 1:]]
    turns = sum(_turn(b - a) for a, b in zip(ring, ring[1:] + ring[:1], strict=True))
    real = np.minimum.reduce([size[:-1, :-1], size[1:, :-1], size[1:, 1:], size[:-1, 1:]]) > noise
    winding = (np.abs(turns) > 1.0) & real
    centres = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[1:, 1:] + grid[:-1, 1:])
    framed = np.pad(size, 1, constant_values=math.inf)
    n, m = size.shape
    shifts = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    around = np.minimum.reduce([framed[i : i + n, j : j + m] for i, j in shifts])
    # A zero as near as a cell is passed with a slope; a mere dip of the deviator is not followed.
    low = (size <= around) & (size < 0.2 * np.median(size)) & (size > noise)
    exact = (size <= noise) & (around > noise)
    return np.concatenate([centres[winding], grid[low | exact]])


def _turn(angle: Floats) -> Floats:
    """Angles brought into (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2.0 * np.pi)


def _refined(surface: Surface, uv: Floats, tolerance: float) -> Floats:
    """Zeros of the deviator near the starts, each once, shape (K, 2).

    Newton's method. The derivative of the deviator needs third derivatives of the surface, which
    no jet has, so it is a difference; the zero itself is as exact as the deviator.
    """
    domain = surface.domain
    value = shape_data(surface.jet(uv)).deviator
    reach = np.ones(len(uv))
    for _ in range(REFINEMENTS):
        if (reach < 1e-3).all():
            break
        inverse = np.linalg.pinv(_deviator_slopes(surface, uv), rcond=1e-8)
        step = -np.einsum("nij,nj->ni", inverse, value)
        # Two cells of a fine grid at most, so that a start finds its own zero.
        share = np.abs(step / domain.size).max(axis=1) + TINY
        target = domain.reduce(uv + step * np.minimum(reach, 0.02 / share)[:, None])
        trial = shape_data(surface.jet(target)).deviator
        better = norm(trial) < norm(value)
        uv, value = np.where(better[:, None], target, uv), np.where(better[:, None], trial, value)
        reach = np.where(better, np.minimum(1.0, 2.0 * reach), 0.25 * reach)
    return _distinct(domain, uv[norm(value) <= tolerance])


def _deviator_slopes(surface: Surface, uv: Floats) -> Floats:
    """Derivatives of the deviator by u and v as columns, shape (N, 2, 2)."""
    domain = surface.domain
    columns = []
    for axis in (0, 1):
        aside = 1e-5 * domain.size * np.eye(2)[axis]
        low, high = domain.reduce(uv - aside), domain.reduce(uv + aside)
        # One-sided at a bound; over a periodic one the difference of parameters wraps.
        gap = np.mod(high[:, axis] - low[:, axis], domain.size[axis])
        rise = shape_data(surface.jet(high)).deviator - shape_data(surface.jet(low)).deviator
        columns.append(rise / gap[:, None])
    return np.stack(columns, axis=-1)


def _distinct(domain: Domain, uv: Floats) -> Floats:
    """Rows that differ by more than a circle of classification, ordered by u, then v."""
    kept: list[Floats] = []
    for row in uv[np.lexsort((uv[:, 1], uv[:, 0]))]:
        gaps = [np.abs(row - other) for other in kept]
        gaps = [np.where(domain.periodic, np.minimum(g, domain.size - g), g) for g in gaps]
        if all((g > 2.0 * CIRCLE * domain.size).any() for g in gaps):
            kept.append(row)
    return np.array(kept).reshape(-1, 2)


def _classified(surface: Surface, found: Floats) -> list[Umbilic]:
    """Index and kind of each isolated zero, from a small circle around it."""
    domain = surface.domain
    # The odd start keeps samples off the axes, where a line of umbilics may lie.
    phi = 2.0 * np.pi * (np.arange(CIRCLE_SAMPLES) + 0.382) / CIRCLE_SAMPLES
    turned = np.stack([np.cos(phi), np.sin(phi)], axis=-1)
    result = []
    for uv in found:
        jet = surface.jet(uv[None])
        # Directions around the tangent plane, as parameter steps that stay inside the domain.
        steps = turned @ shape_data(jet).directions_uv[0]
        room = np.minimum(uv - domain.low, domain.high - uv) / domain.size
        room = np.where(domain.periodic, CIRCLE, np.minimum(room, CIRCLE)).min()
        index, kind = 0.0, "rim"
        if room > 0.01 * CIRCLE:
            steps *= room / np.abs(steps / domain.size).max()
            index, lines = _circle_counts(surface, uv, steps)
            kind = KINDS.get((index, lines), "degenerate")
        x, y, z = jet.point[0].tolist()
        if kind == "rim" or index != 0.0:
            result.append(Umbilic(_pair(uv), (x, y, z), index, kind))
    return result


def _circle_counts(surface: Surface, uv: Floats, steps: Floats) -> tuple[float, int]:
    """Index and number of separatrices of each family, from parameter steps around a circle.

    A separatrix leaves where the radius is a principal direction, thus where II(radial,
    tangential) = 0. Opposite zeros belong to the two families, so half of them are counted.
    """
    jet = surface.jet(surface.domain.reduce(uv + steps))
    data = shape_data(jet)
    p, q = data.deviator[:, 0], data.deviator[:, 1]
    angle = np.arctan2(q, p)
    turns = _turn(np.roll(angle, -1) - angle)
    if np.abs(turns).max() > 2.8:
        # Half a turn at once: a line of umbilics crosses the circle, and no index exists.
        return 0.0, 0
    radial = _lifted(jet, steps)
    x, y = dot(radial, data.frame[:, 0]), dot(radial, data.frame[:, 1])
    signs = np.sign(q * (x * x - y * y) - 2.0 * p * x * y)
    changes = int((signs != np.roll(signs, 1)).sum())
    return round(float(turns.sum()) / (2.0 * np.pi)) / 2.0, changes // 2
