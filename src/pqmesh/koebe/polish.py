"""Circles on the sphere brought to exact contact: Newton's method on the sphere itself.

The layout in the plane adds up rounding errors. Here every circle moves by three numbers in its
own orthonormal frame of R^{3,1} (two shifts over its radius, one growth over its radius), so that
large and small circles count alike, and the equations

    <X_v, X_f> = 0  at each corner,     <X_v, X_w> = -1  at each edge

are solved with the smallest such move. On a sphere-type mesh these are 3E equations for 3E + 6
unknowns, and the six are the Moebius maps; on a disc the boundary adds its freedom.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from pqmesh.koebe.layout import METRIC, lorentz
from pqmesh.linear import SymmetricPattern
from pqmesh.vectors import Floats, Indices, cross, norm, unit

MOST_STEPS, LONGEST_STEP = 25, 0.5
# Share of the last residual that a step must save to be worth another one.
WORTH = 0.5


def polished(circles: Floats, corners: Indices, edges: Indices) -> tuple[Floats, float]:
    """Circles in exact contact near the given ones, and the largest error in space.

    Parameters
    ----------
    circles : (n, 4)
        Unit vectors of R^{3,1}.
    corners : (C, 2)
        Circles that are orthogonal.
    edges : (E, 2)
        Circles that touch.
    """
    circles = _unit(circles)
    best, least = circles, np.inf
    for _ in range(MOST_STEPS):
        residual, error = _residuals(circles, corners, edges)
        if not np.isfinite(error) or error > WORTH * least:
            if error < least:
                best, least = circles, error
            break
        best, least = circles, error
        frames = _frames(circles)
        slopes = _jacobian(circles, frames, corners, edges)
        square = (slopes @ slopes.T).tocoo()
        pattern = SymmetricPattern(square.row, square.col, len(residual))
        try:
            forces = pattern.factor(pattern.values(square.data)).solve(-residual)
        except ArithmeticError:
            break
        step = (slopes.T @ forces).reshape(-1, 3)
        step *= min(1.0, LONGEST_STEP / max(float(norm(step).max()), 1e-300))
        circles = _unit(circles + np.einsum("nak,nk->na", frames, step))
    return best, least


def _unit(circles: Floats) -> Floats:
    """Vectors scaled to <X, X> = 1; nan for one that has lost all digits and is no circle.

    The layout leaves rounding of large coordinates in the product.
    """
    square = lorentz(circles, circles)
    size = np.sqrt(np.where(square > 0.0, square, np.nan))
    return np.asarray(circles / size[:, None])


def _residuals(circles: Floats, corners: Indices, edges: Indices) -> tuple[Floats, float]:
    """Residuals, and the largest one in space: over the product of the two lengths."""
    square = lorentz(circles[corners[:, 0]], circles[corners[:, 1]])
    touch = lorentz(circles[edges[:, 0]], circles[edges[:, 1]]) + 1.0
    residual = np.concatenate([square, touch])
    pairs = np.concatenate([corners, edges])
    size = norm(circles[:, :3])
    return residual, float(np.abs(residual / (size[pairs[:, 0]] * size[pairs[:, 1]])).max())


def _frames(circles: Floats) -> Floats:
    """Orthonormal vectors across each circle's vector: two shifts, one growth; (n, 4, 3)."""
    size, last = norm(circles[:, :3]), circles[:, 3]
    centre = circles[:, :3] / size[:, None]
    helper = np.eye(3)[np.abs(centre).argmin(axis=1)]
    first = unit(cross(centre, helper))
    frames = np.zeros((len(circles), 4, 3))
    frames[:, :3, 0], frames[:, :3, 1] = first, cross(centre, first)
    frames[:, :3, 2], frames[:, 3, 2] = centre * last[:, None], size
    return frames


def _jacobian(circles: Floats, frames: Floats, corners: Indices, edges: Indices) -> csr_array:
    """Derivatives of the residuals by the moves of both circles, sparse (C + E, 3n)."""
    pairs = np.concatenate([corners, edges])
    row = np.repeat(np.arange(len(pairs)), 3)
    rows, columns, values = [], [], []
    for own, other in ((0, 1), (1, 0)):
        moving, still = pairs[:, own], pairs[:, other]
        value = np.einsum("nak,na,a->nk", frames[moving], circles[still], METRIC)
        rows.append(row)
        columns.append((3 * moving[:, None] + np.arange(3)).ravel())
        values.append(value.ravel())
    shape = (len(pairs), 3 * len(circles))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return coo_array(entries, shape=shape).tocsr()
