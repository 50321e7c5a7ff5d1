"""Radii of orthogonal circle patterns: the minimum of a convex functional, by Newton's method.

A pattern has a circle for each vertex and each face of a mesh. A vertex and a face that share a
corner have orthogonal circles; their centres and the two points where the circles meet form a
kite, whose angle at circle i is 2 arctan(r_j / r_i). The pattern closes up around circle i when
these angles sum to a prescribed value, 2 pi inside. In rho = log r these are the equations

    angle_i - sum_j 2 arctan exp(rho_j - rho_i) = 0

of the minimum of a convex function whose second derivative is the Laplacian of the graph of
corners with weights 1 / cosh(rho_j - rho_i).

Degrees of freedom: rho + constant is the same pattern at another size, so without a known radius
the angles must sum to pi for each corner. A solution exists exactly when, besides, every set of
circles wants less than pi for each corner that touches it; it is unique up to size.

References: [bobenkospringborn2004].
"""

from __future__ import annotations

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.linear import SymmetricPattern
from pqmesh.vectors import Floats, Indices, Mask

MOST_STEPS, MOST_HALVINGS = 90, 30
# Largest change of a logarithm in one step, and the angle at which a circle counts as closed.
LONGEST_STEP, CLOSED = 5.0, 1e-9
# A logarithm that has run so far ahead belongs to a circle that vanishes or fills the plane.
RUNAWAY = 300.0


def log_radii(corners: Indices, angles: Floats, known: Floats | None = None) -> Floats:
    """Logarithms of the radii of an orthogonal circle pattern, shape (n,).

    Parameters
    ----------
    corners : (C, 2)
        Pairs of circles that meet at right angles.
    angles : (n,), radians
        Sum of the kites' angles around each circle; unused where the radius is known.
    known : (n,), optional
        Logarithms of the radii that are given, nan elsewhere. Without any the size is free, and
        circle 0 of the result has radius 1.

    Raises
    ------
    MeshError
        When the pattern does not exist: angles that do not add up, or a set of circles that
        wants more angle than its corners have.

    References: [bobenkospringborn2004].

    Examples
    --------
    A chain of three circles. The one in the middle sees right angles on both sides, so that all
    radii agree.

    >>> chain = np.array([[0, 1], [1, 2]])
    >>> bool(np.allclose(log_radii(chain, np.pi * np.array([0.5, 1.0, 0.5])), 0.0))
    True
    """
    given = np.zeros(len(angles), dtype=np.bool_) if known is None else ~np.isnan(known)
    free = ~given
    if not given.any():
        _check_sum(corners, angles)
        # Any circle may be held, for the size is free.
        rho, free = np.zeros(len(angles)), np.arange(len(angles)) > 0
    else:
        assert known is not None
        rho = np.where(given, known, known[given].mean())
    if free.any():
        rho = _newton(corners, angles, rho, free)
    if free.any() and np.abs(angle_gaps(corners, angles, rho)[free]).max() > CLOSED:
        raise _unsolvable(corners, angles, rho, given)
    return rho


def angle_gaps(corners: Indices, angles: Floats, rho: Floats) -> Floats:
    """Prescribed angle less the sum of the kites' angles, for each circle, (n,), radians."""
    i, j = corners.T
    turn = 2.0 * np.arctan(np.exp(rho[j] - rho[i]))
    # The kite's angles at i and j sum to pi; both are taken from the smaller side, for accuracy.
    back = 2.0 * np.arctan(np.exp(rho[i] - rho[j]))
    size = len(angles)
    return np.asarray(
        angles - np.bincount(i, turn, minlength=size) - np.bincount(j, back, minlength=size)
    )


def _newton(corners: Indices, angles: Floats, start: Floats, free: Mask) -> Floats:
    """Radii by Newton's method, each step halved until the slope along it has fallen."""
    column = np.where(free, np.cumsum(free) - 1, -1)
    i, j = column[corners[:, 0]], column[corners[:, 1]]
    inner = (i >= 0) & (j >= 0)
    rows = np.concatenate([i[i >= 0], j[j >= 0], i[inner], j[inner]])
    columns = np.concatenate([i[i >= 0], j[j >= 0], j[inner], i[inner]])
    pattern = SymmetricPattern(rows, columns, int(free.sum()))
    rho, gaps, best = start.copy(), angle_gaps(corners, angles, start), np.inf
    for _ in range(MOST_STEPS):
        size = float(np.abs(gaps[free]).max())
        # Below this only rounding is left; the last step that helped is kept.
        if size < CLOSED and size >= 0.5 * best:
            return rho
        best = min(best, size)
        weight = 1.0 / np.cosh(np.clip(rho[corners[:, 1]] - rho[corners[:, 0]], -300, 300))
        values = pattern.values(
            np.concatenate([weight[i >= 0], weight[j >= 0], -weight[inner], -weight[inner]])
        )
        try:
            step = pattern.factor(values).solve(-gaps[free])
        except ArithmeticError:
            break
        if not np.isfinite(step).all():
            break
        rho = _line_search(corners, angles, rho, free, step)
        gaps = angle_gaps(corners, angles, rho)
        if np.ptp(rho) > RUNAWAY:
            break
    return rho


def _line_search(corners: Indices, angles: Floats, rho: Floats, free: Mask, step: Floats) -> Floats:
    """Point along a step of a convex function where its slope is no steeper than before."""
    share = min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
    slope = abs(float(angle_gaps(corners, angles, rho)[free] @ step))
    for _ in range(MOST_HALVINGS):
        moved = rho.copy()
        moved[free] += share * step
        found = angle_gaps(corners, angles, moved)
        if abs(float(found[free] @ step)) <= 0.9 * slope + 1e-14 * float(np.abs(step).sum()):
            break
        share *= 0.5
    return moved


def _check_sum(corners: Indices, angles: Floats) -> None:
    """Refuse angles whose total no sizes of circles can give."""
    total, wanted = float(angles.sum()), np.pi * len(corners)
    if abs(total - wanted) > 1e-9 * max(wanted, 1.0):
        raise MeshError(
            f"Where no radius is given, the angles must sum to pi for each of the {len(corners)} "
            f"corners, {wanted:.6g}; found {total:.6g}. Change an angle by {wanted - total:.6g}, "
            f"or give a radius in its place."
        )


def _unsolvable(corners: Indices, angles: Floats, rho: Floats, given: Mask) -> MeshError:
    """The error that names a set of circles asking for more angle than there is.

    Where no such set is found the pattern exists, but the iteration did not get there.
    """
    # Such circles vanish in the iteration: the sets to try are the smallest circles so far.
    order = np.flatnonzero(~given)
    order = order[np.argsort(rho[order], kind="stable")]
    place = np.full(len(rho), len(order))
    place[order] = np.arange(len(order))
    touched = np.bincount(place[corners].min(axis=1), minlength=len(order) + 1)[: len(order)]
    available, wanted = np.pi * np.cumsum(touched), np.cumsum(angles[order])
    proper = len(order) if given.any() else len(order) - 1
    count = int((wanted - available)[:proper].argmax()) + 1
    if wanted[count - 1] < available[count - 1] - CLOSED:
        return MeshError(
            f"The circles must be large enough for double precision; the radii of this pattern "
            f"range over a factor of 10^{np.ptp(rho) / np.log(10.0):.0f} and more. Make valences "
            f"and boundary data more even."
        )
    named = ", ".join(str(circle) for circle in np.sort(order[: min(count, 5)]))
    return MeshError(
        f"Every set of circles must want less angle than pi for each corner that touches it; "
        f"circles {named}{f', ... ({count} in all)' if count > 5 else ''} want "
        f"{wanted[count - 1]:.6g}, and there is {available[count - 1]:.6g}. No such "
        f"pattern exists: lower these angles, or give radii."
    )
