"""Faces seen from above: the parameters that lie over plan points, and heights as a graph."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import SpecError, SurfaceError
from pqmesh.surface.bundle import Bundle
from pqmesh.surface.face import Patch
from pqmesh.vectors import Floats, Indices, Mask, cross, norm, unit

# A face steeper than this against the plan has no plan parameters there.
STEEPEST = np.cos(np.radians(87.0))
# Parameters are good when they miss by less than this share of the domain.
GOOD = 1e-12
STEPS = 12


class Samples(NamedTuple):
    """Samples of faces that Newton's method starts from.

    Attributes
    ----------
    owner : (M,)
        Their face.
    uv : (M, 2)
    jet : (6, M, 3)
    cell : (M, 2)
        Steps of their grid.
    pace : (M,)
        Diagonal of their cell in plan.
    is_deep : (M,)
        Truth for samples whose neighbours lie inside their face as well.
    """

    owner: Indices
    uv: Floats
    jet: Floats
    cell: Floats
    pace: Floats
    is_deep: Mask

    def rows(self, chosen: Indices | Mask) -> Samples:
        """Some of the samples."""
        owner, uv, jet, cell, pace, is_deep = self
        return Samples(
            *(owner[chosen], uv[chosen], jet[:, chosen]),
            *(cell[chosen], pace[chosen], is_deep[chosen]),
        )

    def put(self, rows: Indices, others: Samples) -> None:
        """Write other samples into some rows."""
        for own, other in zip(self, others, strict=True):
            if own is self.jet:
                own[:, rows] = other
            else:
                own[rows] = other

    @staticmethod
    def joined(parts: tuple[Samples, ...]) -> Samples:
        """The samples of all faces."""
        return Samples(
            np.concatenate([part.owner for part in parts]),
            np.concatenate([part.uv for part in parts]),
            np.concatenate([part.jet for part in parts], axis=1),
            np.concatenate([part.cell for part in parts]),
            np.concatenate([part.pace for part in parts]),
            np.concatenate([part.is_deep for part in parts]),
        )


def face_samples(number: int, patch: Patch, bundle: Bundle) -> Samples:
    """Samples of a face, once it is known to be seen from above.

    Raises
    ------
    SurfaceError
        When the face encloses nothing, stands upright or turns over.
    """
    uv, step = patch.samples()
    if not len(uv):
        raise SurfaceError(
            f"A face must enclose part of its surface; face {number} {patch.name!r} does not. "
            "Rebuild its trim curves."
        )
    owner = np.full(len(uv), number)
    jet = bundle.jet(owner, uv)
    upright = unit(cross(jet[1], jet[2]))[:, 2]
    if np.abs(upright).min() < STEEPEST or np.ptp(np.sign(upright)) > 0:
        worst = int(np.abs(upright).argmin())
        raise SurfaceError(
            f"Faces that are joined to one surface must be seen from above; face {number} "
            f"{patch.name!r} stands upright or turns over near "
            f"{np.round(jet[0, worst], 4).tolist()}. Panel it on its own."
        )
    deep = patch.rim_distance(uv) > 1.5 * float(norm(step / patch.surface.domain.size))
    pace = np.hypot(norm(jet[1, :, :2]) * step[0], norm(jet[2, :, :2]) * step[1])
    cell = np.repeat(step[None], len(uv), axis=0)
    return Samples(owner, uv, jet, cell, pace, deep)


def check_side_by_side(parts: tuple[Samples, ...], patches: tuple[Patch, ...]) -> None:
    """Nothing, once no sample of a face stands over the inner samples of another.

    Overlaps narrower than about two cells are not seen.

    Raises
    ------
    SpecError
        Naming both faces and a place.
    """
    trees = [cKDTree(part.jet[0, :, :2]) for part in parts]
    for i, mine in enumerate(parts):
        points = mine.jet[0, :, :2]
        for j, theirs in enumerate(parts):
            low, high = trees[j].mins, trees[j].maxes
            rows = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
            if i == j or not len(rows):
                continue
            near = theirs.rows(np.asarray(trees[j].query(points[rows])[1], dtype=np.int64))
            step, _ = plan_step(near.jet, points[rows], patches[j].surface.domain.size)
            over = near.is_deep & (np.abs(step) <= near.cell).all(axis=1)
            if over.any():
                place = np.round(mine.jet[0, rows[int(over.argmax())]], 4).tolist()
                raise SpecError(
                    f"Faces that are joined to one surface must stand side by side in plan; face "
                    f"{i} {patches[i].name!r} lies over face {j} {patches[j].name!r} near {place}. "
                    "Select one of them."
                )


def in_plan(
    bundle: Bundle, owner: Indices, points: Floats, start: Floats
) -> tuple[Floats, Floats, Mask]:
    """Parameters over plan points, their jets (6, N, 3), and where Newton's method worked.

    Parameters
    ----------
    bundle : Bundle
    owner : (N,)
        The surface each point is looked for on.
    points : (N, 2)
    start : (N, 2)
        Parameters near the answer.
    """
    uv, size = start.copy(), bundle.size[owner]
    jet = bundle.jet(owner, uv)
    step, miss = plan_step(jet, points, size)
    active = np.arange(len(points))
    for _ in range(STEPS):
        uv[active] += step
        now = bundle.jet(owner[active], uv[active])
        jet = now if len(active) == len(points) else _put(jet, active, now)
        # Written so that what is not a number goes on and is not solved.
        moving = ~(miss <= GOOD)
        active = active[moving]
        if not len(active):
            break
        step, miss = plan_step(now[:, moving], points[active], size[active])
    solved = np.ones(len(points), dtype=np.bool_)
    solved[active] = False
    return uv, jet, solved


def _put(jet: Floats, rows: Indices, part: Floats) -> Floats:
    """The jets with some of them replaced."""
    jet[:, rows] = part
    return jet


def plan_step(jet: Floats, points: Floats, size: Floats) -> tuple[Floats, Floats]:
    """Steps (N, 2) from jets to plan points, to second order, and how much they will miss (N,).

    It is the step of Newton's method less the bend of the parameter lines along it. A step of
    more than a tenth of the domain has left what the formula knows, and is cut.

    Parameters
    ----------
    jet : (6, N, 3)
    points : (N, 2)
    size : (2,) or (N, 2)
        Of the domains; shares of it measure the miss.
    """
    plan = jet[:, :, :2].transpose(0, 2, 1)
    x, y = points.T - plan[0]
    ux, uy, vx, vy = _inverse(*plan[1], *plan[2])
    u, v = ux * x + uy * y, vx * x + vy * y
    x, y = 0.5 * u * u * plan[3] + u * v * plan[4] + 0.5 * v * v * plan[5]
    step = np.stack([u, v], axis=1)
    bend = np.stack([ux * x + uy * y, vx * x + vy * y], axis=1)
    longest = np.abs(step / size).max(axis=1)
    bent = np.abs(bend / size).max(axis=1)
    # A bend that is not small against the step says that the step is too long for it.
    helps = bent < 0.25 * longest
    step -= np.where(helps[:, None], bend, 0.0)
    # Each order is smaller than the one before by about the same share; where the bend happens
    # to vanish, the third order does not.
    third = 4.0 * bent * bent / np.maximum(longest, 1e-300) + 10.0 * longest**3
    miss = np.where(helps, third, longest)
    cut = np.minimum(1.0, 0.1 / np.maximum(longest, 1e-300))
    return np.asarray(step * cut[:, None]), np.where(cut < 1.0, 1.0, miss)


def _inverse(a: Floats, c: Floats, b: Floats, d: Floats) -> tuple[Floats, ...]:
    """Derivatives u_x, u_y, v_x, v_y from x_u = a, y_u = c, x_v = b, y_v = d."""
    determinant = a * d - b * c
    safe = np.where(np.abs(determinant) > 1e-300, determinant, 1e-300)
    return d / safe, -b / safe, -c / safe, a / safe


def graph_jet(jet: Floats) -> Floats:
    """Height and its plan derivatives from parametric jets (6, N, 3), shape (N, 6).

    With K the inverse of the plan part, second derivatives are the pulled-back second derivatives
    of z less the slope times those of the plan part.
    """
    (a, c, e), (b, d, f) = jet[1].T, jet[2].T
    ux, uy, vx, vy = _inverse(a, c, b, d)
    zx, zy = e * ux + f * vx, e * uy + f * vy
    uu, uv, vv = (row[:, 2] - zx * row[:, 0] - zy * row[:, 1] for row in jet[3:])
    return np.column_stack(
        [
            *(jet[0, :, 2], zx, zy),
            uu * ux * ux + 2.0 * uv * ux * vx + vv * vx * vx,
            uu * ux * uy + uv * (ux * vy + uy * vx) + vv * vx * vy,
            uu * uy * uy + 2.0 * uv * uy * vy + vv * vy * vy,
        ]
    )
