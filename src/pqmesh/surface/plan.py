"""Several faces that stand side by side over the plan, as one surface of x and y."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.surface.base import Domain, Jet
from pqmesh.surface.bundle import Bundle
from pqmesh.surface.face import Patch as Patch
from pqmesh.surface.face import even_odd as even_odd
from pqmesh.surface.face import ring_distance as ring_distance
from pqmesh.surface.overhead import (
    Samples,
    check_side_by_side,
    face_samples,
    graph_jet,
    in_plan,
    plan_step,
)
from pqmesh.vectors import Floats, Indices, Mask, norm, unit

# Loops of neighbours may follow their common edge this differently, in domain sizes.
RIM = 1.5e-4


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

    Attributes
    ----------
    bundle : Bundle
        The surfaces of the faces, evaluated together.
    starts : tuple of Samples
        Of each face, to start Newton's method from.

    Raises
    ------
    SurfaceError
        When a face stands upright or turns over, seen from above.
    SpecError
        When a face lies over another.

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
    bundle: Bundle = field(init=False, repr=False)
    starts: tuple[Samples, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        bundle = Bundle([patch.surface for patch in self.patches])
        starts = tuple(face_samples(i, patch, bundle) for i, patch in enumerate(self.patches))
        check_side_by_side(starts, self.patches)
        object.__setattr__(self, "bundle", bundle)
        object.__setattr__(self, "starts", starts)

    @cached_property
    def trees(self) -> tuple[cKDTree, ...]:
        """Plan points of the samples of each face, to look up the nearest."""
        return tuple(cKDTree(part.jet[0, :, :2]) for part in self.starts)

    @cached_property
    def _all(self) -> Samples:
        """Samples of all faces."""
        return Samples.joined(self.starts)

    @cached_property
    def _tree(self) -> cKDTree:
        """Plan points of all samples."""
        return cKDTree(self._all.jet[0, :, :2])

    @cached_property
    def domain(self) -> Domain:
        """Plan rectangle around the faces, wider by the margin."""
        rings = np.concatenate([ring for patch in self.patches for ring in patch.plan_rings()])
        low, high = rings.min(axis=0) - self.margin, rings.max(axis=0) + self.margin
        return Domain((float(low[0]), float(high[0])), (float(low[1]), float(high[1])))

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet of (x, y, z(x, y)) at plan points (N, 2)."""
        out = np.zeros((6, len(uv), 3))
        out[0, :, :2], out[1, :, 0], out[2, :, 1] = uv, 1.0, 1.0
        out[..., 2] = graph_jet(self._located(uv).jet).T
        return Jet(*out)

    def contains(self, uv: Floats) -> Mask:
        """Truth for plan points (N, 2) over one of the faces, or in a crack between them."""
        return np.asarray(self._located(uv).outside <= RIM)

    def _located(self, points: Floats) -> _Places:
        """Where plan points (N, 2) lie: on the face that contains them, or the nearest."""
        trial, expected = self._guessed(points)
        jet, away = self._tried(trial, points)
        places = _Places(trial.near.owner, jet, away)
        # A guess is rarely so wrong that another face must be tried as well.
        for other in self._beside(points, places.owner, (away > RIM) & (expected <= RIM)):
            jet, away = self._tried(other, points[other.rows])
            better = away < places.outside[other.rows]
            rows = other.rows[better]
            places.owner[rows] = other.near.owner[better]
            places.jet[:, rows], places.outside[rows] = jet[:, better], away[better]
        return places

    def _guessed(self, points: Floats) -> tuple[_Trial, Floats]:
        """The face to look on for each point, and how far outside it the point seems to lie."""
        near = self._all.rows(_nearest(self._tree, points)[1])
        start = near.uv + plan_step(near.jet, points, self.bundle.size[near.owner])[0]
        away = np.zeros(len(points))
        unsure = np.flatnonzero(~near.is_deep)
        away[unsure] = self._outside(near.owner[unsure], start[unsure])
        for rows, other, begin in self._beside(points, near.owner, away > 0.0):
            gap = self._outside(other.owner, begin)
            better = gap < away[rows]
            chosen = rows[better]
            near.put(chosen, other.rows(better))
            start[chosen], away[chosen] = begin[better], gap[better]
        return _Trial(np.arange(len(points)), near, start), away

    def _beside(self, points: Floats, owner: Indices, wanted: Mask) -> Iterator[_Trial]:
        """Other faces than the owner that have samples near points wanted."""
        missed = np.flatnonzero(wanted)
        owner = owner[missed]
        for number, samples in enumerate(self.starts):
            rows = missed[owner != number]
            if not len(rows):
                continue
            distance, index = _nearest(self.trees[number], points[rows])
            close = distance <= 3.0 * samples.pace[index] + self.margin
            if close.any():
                rows, near = rows[close], samples.rows(index[close])
                step, _ = plan_step(near.jet, points[rows], self.bundle.size[number])
                yield _Trial(rows, near, near.uv + step)

    def _tried(self, trial: _Trial, points: Floats) -> tuple[Floats, Floats]:
        """Jets (6, N, 3) over points, and how far outside the face they lie; unsolved: inf."""
        _, near, start = trial
        uv, jet, solved = in_plan(self.bundle, near.owner, points, start)
        away = np.where(solved, 0.0, np.inf)
        # Within a cell of a sample that has the rim beyond its cell nothing needs a test.
        sure = near.is_deep & (np.abs(uv - near.uv) <= near.cell).all(axis=1)
        unsure = np.flatnonzero(~sure & solved)
        away[unsure] = self._outside(near.owner[unsure], uv[unsure])
        return jet, away

    def _outside(self, owner: Indices, uv: Floats) -> Floats:
        """How far parameters lie outside their faces, in domain sizes; 0 inside. Shape (N,)."""
        away = np.empty(len(owner))
        for number in np.unique(owner).tolist():
            rows = np.flatnonzero(owner == number)
            away[rows] = self.patches[number].outside(uv[rows])
        return away


def _nearest(tree: cKDTree, points: Floats) -> tuple[Floats, Indices]:
    """Distances (N,) and indices of the nearest points of a tree."""
    distance, index = tree.query(points)
    return np.asarray(distance), np.asarray(index, dtype=np.int64)


class _Trial(NamedTuple):
    """Faces to try for some points: rows of the points, a sample of the face each, starts."""

    rows: Indices
    near: Samples
    start: Floats


class _Places(NamedTuple):
    """Where plan points lie: face (N,), its jet (6, N, 3), distance outside it (N,)."""

    owner: Indices
    jet: Floats
    outside: Floats


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
        jet = surface.bundle.jet(np.full(len(rim), i), rim)
        mine = graph_jet(jet)
        for j, second in enumerate(surface.patches):
            if j <= i:
                continue
            closest = _nearest(surface.trees[j], jet[0, :, :2])[1]
            start = surface.starts[j].uv[closest]
            owner = np.full(len(rim), j)
            uv, facing, solved = in_plan(surface.bundle, owner, jet[0, :, :2], start)
            near = solved & (second.outside(uv) < 1e-3)
            if near.sum() < 3:
                continue
            theirs = graph_jet(facing[:, near])
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
    loop = patch.rings[0]
    closed = np.concatenate([loop, loop[:1]])
    steps = norm(np.diff(closed, axis=0) / domain.size)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.linspace(0.0, arc[-1], samples, endpoint=False)
    return np.column_stack([np.interp(places, arc, closed[:, k]) for k in (0, 1)])
