"""Several patches that stand side by side over the plan, as one surface of x and y."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Domain, Jet, Surface
from pqmesh.vectors import TINY, Floats, Indices, Mask, cross, norm, unit

# Samples of each patch in each direction: starts for Newton's method in plan.
SAMPLES = 48
# Patches tried for a point: those with the nearest samples.
TRIED = 3
# Points on each side of a loop that is the rectangle of a domain.
SIDE = 96
# A patch steeper than this against the plan has no plan parameters there.
STEEPEST = np.cos(np.radians(87.0))


@dataclass(frozen=True, eq=False)
class Patch:
    """A parametric surface with the loops that bound its face in the parameter plane.

    Attributes
    ----------
    surface : Surface
    loops : tuple of (n, 2)
        Outer loop and holes, not closed by repetition; none for the whole domain.
    name : str
    """

    surface: Surface
    loops: tuple[Floats, ...] = ()
    name: str = ""

    def contains(self, uv: Floats) -> Mask:
        """Truth for parameters (N, 2) inside the face: even-odd over its loops."""
        if not self.loops:
            return self.surface.domain.inside(uv, 1e-12)
        inside = np.zeros(len(uv), dtype=np.bool_)
        for loop in self.loops:
            inside ^= even_odd(loop, uv)
        return inside

    def plan_rings(self) -> tuple[Floats, ...]:
        """Loops of the face in plan, the outer one first, (n, 2) each."""
        loops = self.loops or (_bounds(self.surface.domain),)
        return tuple(self.surface.jet(loop).point[:, :2] for loop in loops)

    def outside(self, uv: Floats) -> Floats:
        """How far parameters lie outside the face, in domain sizes; 0 inside. Shape (N,)."""
        distance = np.zeros(len(uv))
        beyond = np.flatnonzero(~self.contains(uv))
        distance[beyond] = self.from_rim(uv[beyond])
        return distance

    def from_rim(self, uv: Floats) -> Floats:
        """Distance of parameters from the rim of the face, in domain sizes, shape (N,)."""
        if not len(uv):
            return np.empty(0)
        size, low = self.surface.domain.size, self.surface.domain.low
        square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * size + low
        rings = self.loops or (square,)
        return np.asarray(np.min([ring_distance(ring / size, uv / size) for ring in rings], axis=0))


def _bounds(domain: Domain) -> Floats:
    """The bounds of a domain as a dense ring."""
    share = np.arange(SIDE) / SIDE
    zero, one = np.zeros(SIDE), np.ones(SIDE)
    sides = [(share, zero), (one, share), (1.0 - share, one), (zero, 1.0 - share)]
    unit_square = np.concatenate([np.column_stack(side) for side in sides])
    return np.asarray(domain.low + unit_square * domain.size)


# Points times edges handled at once.
_BLOCK = 1_000_000


def even_odd(ring: Floats, points: Floats) -> Mask:
    """Truth for points (N, 2) inside a ring (n, 2)."""
    x0, y0 = ring.T
    x1, y1 = np.roll(ring, -1, axis=0).T
    level = np.where(y1 == y0, 1.0, y1 - y0)
    low, high = np.minimum(y0, y1), np.maximum(y0, y1)
    inside = np.zeros(len(points), dtype=np.bool_)
    step = max(_BLOCK // len(ring), 1)
    for first in range(0, len(points), step):
        x, y = points[first : first + step, :1], points[first : first + step, 1:2]
        crosses = (y >= low) & (y < high) & (x < x0 + (y - y0) * (x1 - x0) / level)
        inside[first : first + step] = crosses.sum(axis=1) % 2 == 1
    return inside


def ring_distance(ring: Floats, points: Floats) -> Floats:
    """Distance of points (N, 2) to a closed polyline."""
    along = np.roll(ring, -1, axis=0) - ring
    square = np.maximum((along**2).sum(axis=1), TINY)
    best = np.empty(len(points))
    step = max(_BLOCK // len(ring), 1)
    for first in range(0, len(points), step):
        offset = points[first : first + step, None] - ring
        share = np.clip((offset * along).sum(axis=2) / square, 0.0, 1.0)
        gap = offset - share[..., None] * along
        best[first : first + step] = np.sqrt((gap**2).sum(axis=2)).min(axis=1)
    return best


@dataclass(frozen=True, eq=False)
class PlanSurface:
    """The graph z(x, y) of patches that cover the plan without overlapping.

    The parameters are x and y themselves, so a line of a network crosses a seam without noticing.
    Each point is found on its patch by Newton's method in plan; the derivatives are exact, by the
    implicit function theorem. Near its rim a patch is continued by its own formula.

    Parameters
    ----------
    patches : tuple of Patch
    margin : float, model unit
        How far beyond the faces the surface may be used (its continuation); lines end there.

    Raises
    ------
    SurfaceError
        When a patch stands upright or turns over, seen from above.

    References: implicit function theorem; seams as in [thesis] chapter 7 (roofs of several faces).

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> left = Patch(graph_surface("x*x - y*y", (-1, 0), (-1, 1)))
    >>> right = Patch(graph_surface("x*x - y*y", (0, 1), (-1, 1)))
    >>> roof = PlanSurface((left, right))
    >>> roof.jet(np.array([[0.5, 0.25]])).point
    array([[0.5   , 0.25  , 0.1875]])
    """

    patches: tuple[Patch, ...]
    margin: float = 0.0
    _tree: cKDTree = field(init=False, repr=False)
    _owner: Indices = field(init=False, repr=False)
    _start: Floats = field(init=False, repr=False)

    def __post_init__(self) -> None:
        places, owners, starts = [], [], []
        for number, patch in enumerate(self.patches):
            uv = patch.surface.domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
            uv = uv[patch.contains(uv)]
            if not len(uv):
                raise SurfaceError(
                    f"A face must enclose part of its surface; face {number} "
                    f"{patch.name!r} does not. Rebuild its trim curves."
                )
            jet = patch.surface.jet(uv)
            upright = unit(cross(jet.du, jet.dv))[:, 2]
            if np.abs(upright).min() < STEEPEST or np.ptp(np.sign(upright)) > 0:
                worst = int(np.abs(upright).argmin())
                raise SurfaceError(
                    f"Faces that are joined to one surface must be seen from above; face {number} "
                    f"{patch.name!r} stands upright or turns over near "
                    f"{np.round(jet.point[worst], 4).tolist()}. Panel it on its own."
                )
            places.append(jet.point[:, :2])
            owners.append(np.full(len(uv), number))
            starts.append(uv)
        object.__setattr__(self, "_tree", cKDTree(np.concatenate(places)))
        object.__setattr__(self, "_owner", np.concatenate(owners))
        object.__setattr__(self, "_start", np.concatenate(starts))

    @cached_property
    def domain(self) -> Domain:
        """Plan rectangle around the faces, wider by the margin."""
        rings = np.concatenate([ring for patch in self.patches for ring in patch.plan_rings()])
        low, high = rings.min(axis=0) - self.margin, rings.max(axis=0) + self.margin
        return Domain((float(low[0]), float(high[0])), (float(low[1]), float(high[1])))

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet of (x, y, z(x, y)) at plan points (N, 2)."""
        n = len(uv)
        zero, one = np.zeros(n), np.ones(n)
        z = self._heights(uv)
        return Jet(
            np.column_stack([uv, z[:, 0]]),
            np.column_stack([one, zero, z[:, 1]]),
            np.column_stack([zero, one, z[:, 2]]),
            np.column_stack([zero, zero, z[:, 3]]),
            np.column_stack([zero, zero, z[:, 4]]),
            np.column_stack([zero, zero, z[:, 5]]),
        )

    def contains(self, uv: Floats) -> Mask:
        """Truth for plan points (N, 2) over one of the faces."""
        return np.asarray(self._located(uv)[2] == 0.0)

    def _heights(self, points: Floats) -> Floats:
        """z, z_x, z_y, z_xx, z_xy, z_yy at plan points, shape (N, 6)."""
        owner, uv, _ = self._located(points)
        result = np.empty((len(points), 6))
        for number in np.unique(owner).tolist():
            rows = owner == number
            result[rows] = _graph_jet(self.patches[number].surface.jet(uv[rows]))
        return result

    def _located(self, points: Floats) -> tuple[Indices, Floats, Floats]:
        """Patch, its parameters, and how far outside its face, for plan points (N, 2)."""
        count = min(12, len(self._owner))
        near = self._tree.query(points, k=count)[1].reshape(len(points), count)
        owner = np.full(len(points), -1, dtype=np.int64)
        uv, best = np.zeros((len(points), 2)), np.full(len(points), np.inf)
        owners = self._owner[near]
        for number in range(len(self.patches)):
            seen = owners == number
            rows = np.flatnonzero(seen.any(axis=1) & (best > 0))
            if not len(rows):
                continue
            patch = self.patches[number]
            start = self._start[near[rows, seen[rows].argmax(axis=1)]]
            found, solved = _in_plan(patch.surface, points[rows], start)
            away = np.where(solved, patch.outside(found), 1e6)
            better = away < best[rows]
            chosen = rows[better]
            owner[chosen], uv[chosen], best[chosen] = number, found[better], away[better]
        return owner, uv, best


def _in_plan(surface: Surface, points: Floats, start: Floats) -> tuple[Floats, Mask]:
    """Parameters whose surface points stand over given plan points, by Newton's method."""
    uv = start.copy()
    size = surface.domain.size
    solved = np.zeros(len(points), dtype=np.bool_)
    for _ in range(20):
        jet = surface.jet(uv)
        gap = points - jet.point[:, :2]
        inverse = _plan_inverse(jet)
        step = np.einsum("nij,nj->ni", inverse, gap)
        # A step of more than a tenth of the domain has left what the formula knows.
        longest = np.abs(step / size).max(axis=1)
        uv = uv + step * np.minimum(1.0, 0.1 / np.maximum(longest, 1e-300))[:, None]
        solved = longest < 1e-14
        if (longest < 1e-13).all():
            solved[:] = True
            break
    else:
        solved = longest < 1e-9
    return uv, solved


def _plan_inverse(jet: Jet) -> Floats:
    """Inverse of the plan part of (X_u, X_v), shape (N, 2, 2)."""
    a, c = jet.du[:, 0], jet.du[:, 1]
    b, d = jet.dv[:, 0], jet.dv[:, 1]
    determinant = a * d - b * c
    safe = np.where(np.abs(determinant) > 1e-300, determinant, 1e-300)
    rows = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], -2)
    return np.asarray(rows / safe[:, None, None])


def _graph_jet(jet: Jet) -> Floats:
    """Height and its plan derivatives from a parametric jet, shape (N, 6).

    With K the inverse of the plan part, second derivatives are the pulled-back second derivatives
    of z less the slope times those of the plan part.
    """
    inverse = _plan_inverse(jet)
    slope = np.einsum("ni,nij->nj", np.stack([jet.du[:, 2], jet.dv[:, 2]], 1), inverse)
    second = np.stack([np.stack([jet.duu, jet.duv], 1), np.stack([jet.duv, jet.dvv], 1)], 1)
    bend = second[..., 2] - np.einsum("nj,nabj->nab", slope, second[..., :2])
    pulled = np.einsum("nai,nab,nbj->nij", inverse, bend, inverse)
    return np.column_stack(
        [jet.point[:, 2], slope, pulled[:, 0, 0], pulled[:, 0, 1], pulled[:, 1, 1]]
    )


@dataclass(frozen=True)
class Seam:
    """How two faces meet: largest gap, angle and curvature jump found along their rims."""

    first: str
    second: str
    gap: float
    angle: float
    curvature: float


def seams(surface: PlanSurface, samples: int = 400) -> tuple[Seam, ...]:
    """Joints of the faces of a plan surface, measured at rim points that face another face.

    Gaps are model units, angles radians, curvature jumps 1/length (largest entry of the jump of
    the second derivatives of z).
    """
    found = []
    for i, first in enumerate(surface.patches):
        rim = _rim(first, samples)
        jet = first.surface.jet(rim)
        mine = _graph_jet(jet)
        for j, second in enumerate(surface.patches):
            if j <= i:
                continue
            grid = second.surface.domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
            tree = cKDTree(second.surface.jet(grid).point[:, :2])
            start = grid[tree.query(jet.point[:, :2])[1]]
            uv, solved = _in_plan(second.surface, jet.point[:, :2], start)
            near = solved & (second.outside(uv) < 1e-3)
            if near.sum() < 3:
                continue
            theirs = _graph_jet(second.surface.jet(uv[near]))
            jump = np.abs(theirs - mine[near])
            normals = [
                unit(np.column_stack([-t[:, 1], -t[:, 2], np.ones(len(t))]))
                for t in (theirs, mine[near])
            ]
            turn = 2.0 * np.arcsin(np.clip(norm(normals[0] - normals[1]) / 2.0, 0.0, 1.0))
            found.append(
                Seam(
                    first.name,
                    second.name,
                    float(jump[:, 0].max()),
                    float(turn.max()),
                    float(jump[:, 3:].max()),
                )
            )
    return tuple(found)


def _rim(patch: Patch, samples: int) -> Floats:
    """Parameters along the outer loop of a face."""
    domain = patch.surface.domain
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * domain.size + domain.low
    loop = patch.loops[0] if patch.loops else corners
    closed = np.concatenate([loop, loop[:1]])
    steps = norm(np.diff(closed, axis=0) / domain.size)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.linspace(0.0, arc[-1], samples, endpoint=False)
    return np.column_stack([np.interp(places, arc, closed[:, k]) for k in (0, 1)])


@dataclass(frozen=True)
class Overlap:
    """Two faces one above the other: where, as (x, y, z) on the first."""

    first: str
    second: str
    place: tuple[float, float, float]


def overlaps(surface: PlanSurface, samples: int = 24) -> tuple[Overlap, ...]:
    """Pairs of faces that lie over the same part of the plan, sampled inside each first face.

    Faces that only meet along a seam do not overlap: samples nearer to the rim of a face than
    half of their own distance do not count.
    """
    found = []
    for i, first in enumerate(surface.patches):
        uv = first.surface.domain.grid(samples, samples).reshape(-1, 2)
        uv = uv[first.contains(uv)]
        points = first.surface.jet(uv).point
        for second in surface.patches[i + 1 :]:
            grid = second.surface.domain.grid(SAMPLES, SAMPLES).reshape(-1, 2)
            tree = cKDTree(second.surface.jet(grid).point[:, :2])
            start = grid[tree.query(points[:, :2])[1]]
            there, solved = _in_plan(second.surface, points[:, :2], start)
            deep = solved & second.contains(there)
            rows = np.flatnonzero(deep)
            deep[rows] = second.from_rim(there[rows]) > 0.5 / samples
            if deep.any():
                place = points[int(np.argmax(deep))].tolist()
                found.append(Overlap(first.name, second.name, (place[0], place[1], place[2])))
    return tuple(found)
