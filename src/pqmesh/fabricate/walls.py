"""The vertical walls over a plan outline, and on which side of them points lie, exactly.

Coincidences of mesh and outline (a wall through a vertex, along an edge, a corner on an edge)
are decided as if the whole mesh were moved by (e, e^2) in plan with e > 0 beyond all bounds
small. It is a true motion, so all decisions fit together, and no vertex lies on a wall nor an
outline corner on an edge any more. Coordinates stay as they are: the motion only tells sides.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.network.region import PlanOutline
from pqmesh.vectors import Floats, Indices, Mask, read_only

# A determinant of doubles beyond this share of its two products has the sign it shows.
SURE = (3.0 + 16.0 * 2.0**-53) * 2.0**-53


@dataclass(frozen=True, eq=False)
class Walls:
    """Sides of the outline in plan, what is inside on their left.

    Attributes
    ----------
    starts, ends : (S, 2), model unit
    ring : (S,)
        0 for the outer ring, then the holes.
    following : (S,)
        The next side of the same ring.
    """

    starts: Floats
    ends: Floats
    ring: Indices
    following: Indices

    @property
    def n_rings(self) -> int:
        """Number of rings."""
        return int(self.ring[-1]) + 1

    @classmethod
    def of_rings(cls, rings: list[Floats]) -> Walls:
        """Walls of rings that have what is inside on their left."""
        sizes = [len(ring) for ring in rings]
        first = np.cumsum([0, *sizes[:-1]])
        following = [k + (np.arange(n) + 1) % n for k, n in zip(first, sizes, strict=True)]
        return cls(
            read_only(np.concatenate(rings)),
            read_only(np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])),
            read_only(np.repeat(np.arange(len(rings)), sizes), np.int64),
            read_only(np.concatenate(following), np.int64),
        )


def outline_walls(outline: PlanOutline) -> Walls:
    """Walls over an outline.

    Raises
    ------
    SpecError
        When sides of the outline cross, or a hole lies outside the polygon or in another hole.

    Examples
    --------
    >>> square = PlanOutline([[0, 0], [0, 2], [2, 2], [2, 0]])
    >>> outline_walls(square).starts.tolist()
    [[2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [0.0, 0.0]]
    """
    rings = []
    for number, points in enumerate(outline.rings):
        ring = points[(points != np.roll(points, 1, axis=0)).any(axis=1)]
        is_left = _doubled_area(ring) > 0
        rings.append(ring if is_left == (number == 0) else ring[::-1])
    walls = Walls.of_rings(rings)
    _check_crossings(walls)
    apart = [Walls.of_rings([ring]) for ring in rings]
    places = np.array([interior_point(ring) for ring in rings])
    for hole in range(1, len(rings)):
        if not inside_walls(places[hole : hole + 1], apart[0])[0]:
            raise SpecError(
                f"Holes of an outline must lie in its polygon; hole {hole - 1} lies outside. "
                f"Remove it, or check which ring is the outer one."
            )
        for other in range(1, len(rings)):
            if other != hole and inside_walls(places[hole : hole + 1], apart[other])[0]:
                raise SpecError(
                    f"Holes of an outline must be apart; hole {hole - 1} lies in hole "
                    f"{other - 1}. Remove one of them."
                )
    return walls


def interior_point(ring: Floats) -> Floats:
    """A point well inside a simple ring (n, 2): halfway along its widest middle section."""
    low, high = ring[:, 1].min(), ring[:, 1].max()
    level = 0.5 * (low + high)
    after = np.roll(ring, -1, axis=0)
    cut = (ring[:, 1] > level) != (after[:, 1] > level)
    a, b = ring[cut], after[cut]
    x = np.sort(a[:, 0] + (level - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
    widest = int(np.argmax(x[1::2] - x[0::2]))
    return np.array([0.5 * (x[2 * widest] + x[2 * widest + 1]), level])


# --- sides ----------------------------------------------------------------------------------


def turn_signs(a: Floats, b: Floats, c: Floats) -> Indices:
    """Exact signs of the areas of plan triangles a, b, c; rows are broadcast."""
    left = (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
    right = (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    value = left - right
    signs = np.sign(value).astype(np.int64)
    size = np.abs(left) + np.abs(right)
    unsure = (np.abs(value) <= SURE * size) & (size > 0)
    if unsure.any():
        a, b, c = (np.broadcast_to(p, (*value.shape, 2)) for p in (a, b, c))
        for place in zip(*np.nonzero(unsure), strict=True):
            ax, ay, bx, by, cx, cy = (Fraction(float(v)) for p in (a, b, c) for v in p[place])
            exact = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            signs[place] = (exact > 0) - (exact < 0)
    return signs


def wall_sides(starts: Floats, ends: Floats, points: Floats) -> Indices:
    """+1 where a mesh point lies left of a wall, -1 right of it; never 0."""
    signs = turn_signs(starts, ends, points)
    # (dx, dy) x (e, e^2) = dx e^2 - dy e.
    step = ends - starts
    tie = np.where(step[..., 1] != 0, -np.sign(step[..., 1]), np.sign(step[..., 0]))
    return np.where(signs != 0, signs, tie.astype(np.int64))


def edge_sides(tails: Floats, heads: Floats, corners: Floats) -> Indices:
    """+1 where an outline corner lies left of a mesh edge, -1 right; 0 for upright edges only."""
    signs = turn_signs(tails, heads, corners)
    # The edge moves, so the corner moves by (-e, -e^2) against it.
    step = heads - tails
    tie = np.where(step[..., 1] != 0, np.sign(step[..., 1]), -np.sign(step[..., 0]))
    return np.where(signs != 0, signs, tie.astype(np.int64))


def inside_walls(points: Floats, walls: Walls) -> Mask:
    """Mesh points (N, 2) inside the outline, by the even-odd rule; no point is on a wall."""
    inside = np.zeros(len(points), dtype=np.bool_)
    for a, b in zip(walls.starts, walls.ends, strict=True):
        # A point on the level of a corner is above it.
        beside = np.flatnonzero((a[1] > points[:, 1]) != (b[1] > points[:, 1]))
        if len(beside):
            sides = wall_sides(a, b, points[beside])
            inside[beside] ^= (sides > 0) == (b[1] > a[1])
    return inside


def inside_polygon(corner: Floats, polygon: Floats) -> bool:
    """Whether an outline corner (2,) lies in a mesh polygon (k, 2), by the even-odd rule."""
    after = np.roll(polygon, -1, axis=0)
    beside = (polygon[:, 1] >= corner[1]) != (after[:, 1] >= corner[1])
    sides = edge_sides(polygon[beside], after[beside], corner)
    rises = after[beside, 1] > polygon[beside, 1]
    return bool(np.count_nonzero((sides > 0) == rises) % 2)


def _doubled_area(ring: Floats) -> float:
    base = ring - ring[0]
    after = np.roll(base, -1, axis=0)
    return float(np.sum(base[:, 0] * after[:, 1] - base[:, 1] * after[:, 0]))


def _check_crossings(walls: Walls) -> None:
    """Refuse walls that cross properly; walls may touch."""
    low, high = np.minimum(walls.starts, walls.ends), np.maximum(walls.starts, walls.ends)
    # Walls from left to right: only those that begin before one ends can cross it.
    order = np.argsort(low[:, 0], kind="stable")
    last = np.searchsorted(low[order, 0], high[order, 0], side="right")
    for row, k in enumerate(order):
        a, b = walls.starts[k], walls.ends[k]
        other = order[row + 1 : last[row]]
        near = (low[other, 1] <= high[k, 1]) & (high[other, 1] >= low[k, 1])
        # Neighbours have an end in common and touch there.
        near &= (other != walls.following[k]) & (walls.following[other] != k)
        other = np.sort(other[near])
        if not len(other):
            continue
        c, d = walls.starts[other], walls.ends[other]
        crossed = (turn_signs(a, b, c) * turn_signs(a, b, d) < 0) & (
            turn_signs(c, d, a) * turn_signs(c, d, b) < 0
        )
        if crossed.any():
            first = int(other[crossed][0])
            raise SpecError(
                f"Sides of an outline must not cross; the side from {a.tolist()} to {b.tolist()} "
                f"crosses the one from {walls.starts[first].tolist()} to "
                f"{walls.ends[first].tolist()}. Mend the outline."
            )
