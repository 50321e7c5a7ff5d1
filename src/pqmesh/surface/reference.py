"""Surfaces to stay close to: a parametric one, or a mesh taken as triangles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol, Self

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.surface.base import Surface
from pqmesh.surface.closest import closest_point
from pqmesh.vectors import TINY, Floats, Indices, Mask, cross, dot, norm, unit

# A point this close to a triangle, as a share of the largest radius of one, lies on it.
ON_IT = 1e-14
# Triangles by the distance of their centres that are asked about first: the fans of six quads.
NEAREST = 24
# Pairs of points and triangles that are looked at together.
PAIRS = 1 << 16
# Cosine between the normals of a triangle and of its corner below which there is a crease: 40
# degrees. Across the edge of a box the normal of both faces together leaves each by 45.
CREASE = 0.766
# A corner whose normal differs by less than this from that of its triangle keeps it.
OWN = 1e-12


class Reference(Protocol):
    """What the optimiser asks of a surface; an answer may remember where it looked."""

    def closest(self, points: Floats) -> tuple[Floats, Floats, Self]:
        """Closest points (N, 3), unit normals there, and the reference for the next call."""
        ...

    def about(self, origin: Floats) -> Self:
        """The same surface with places counted from an origin (3,)."""
        ...


@dataclass(frozen=True, eq=False)
class SurfaceReference:
    """A parametric surface with the parameters found last as the next start.

    Attributes
    ----------
    surface : Surface
    uv : (N, 2), optional
        Start parameters for the points of the next call.
    origin : (3,), optional
        Place of the surface from which points are counted.
    """

    surface: Surface
    uv: Floats | None = None
    origin: Floats | None = None

    def closest(self, points: Floats) -> tuple[Floats, Floats, SurfaceReference]:
        """Closest points of the surface, by Newton's method from the last parameters."""
        start = self.uv if self.uv is not None and len(self.uv) == len(points) else None
        origin = np.zeros(3) if self.origin is None else self.origin
        uv, jet, _ = closest_point(self.surface, points + origin, start)
        return jet.point - origin, unit(cross(jet.du, jet.dv)), replace(self, uv=uv)

    def about(self, origin: Floats) -> SurfaceReference:
        """The same surface with places counted from an origin (3,)."""
        return replace(self, origin=origin if self.origin is None else self.origin + origin)


class _Feet(NamedTuple):
    """Closest points (N, 3) as far as they are known, their triangles (N,) and distances (N,)."""

    places: Floats
    triangles: Indices
    gaps: Floats


@dataclass(frozen=True, eq=False)
class TriangleReference:
    """A triangle mesh with smooth normals: interpolated between those of the corners.

    The normals of the triangles themselves would jump from one to the next, and at a corner be
    those of any of them: what stays close to the mesh would follow its facets.

    Parameters
    ----------
    corners : (T, 3, 3), model unit
    normals : (T, 3, 3), optional
        Unit normals at the corners; those of the triangles without.
    """

    corners: Floats
    normals: Floats | None = None
    _tree: cKDTree = field(init=False, repr=False)
    _radii: Floats = field(init=False, repr=False)
    _reach: float = field(init=False, repr=False)
    _creased: Mask = field(init=False, repr=False)

    def __post_init__(self) -> None:
        centers = self.corners.mean(axis=1)
        radii = norm(self.corners - centers[:, None]).max(axis=1)
        object.__setattr__(self, "_tree", cKDTree(centers))
        object.__setattr__(self, "_radii", radii)
        object.__setattr__(self, "_reach", float(radii.max(initial=0.0)))
        own = _flat_normals(self.corners)[:, None]
        smooth = own if self.normals is None else self.normals
        creased = (norm(smooth - own) < OWN).any(axis=1)
        object.__setattr__(self, "_creased", creased)

    @classmethod
    def of_polygons(cls, vertices: Floats, faces: list[list[int]]) -> TriangleReference:
        """Polygons as fans about their centres: symmetric, so no diagonal is preferred.

        The normal at a vertex is that of all its faces together; where it leaves that of a
        triangle by more than 40 degrees there is a crease, and the triangle keeps its own.
        """
        sizes = np.array([len(face) for face in faces])
        triangles, corner_vertices, owners = [], [], []
        for size in np.unique(sizes):
            chosen = np.flatnonzero(sizes == size)
            rows = np.array([faces[face] for face in chosen])
            points = vertices[rows]
            if size == 3:
                triangles.append(points)
                corner_vertices.append(rows)
                owners.append(chosen)
                continue
            following = np.roll(points, -1, axis=1)
            center = np.broadcast_to(points.mean(axis=1, keepdims=True), points.shape)
            fan = np.stack([points, following, center], axis=2)
            triangles.append(fan.reshape(-1, 3, 3))
            none = np.full_like(rows, -1)
            names = np.stack([rows, np.roll(rows, -1, axis=1), none], axis=2)
            corner_vertices.append(names.reshape(-1, 3))
            owners.append(np.repeat(chosen, size))
        corners, names = np.concatenate(triangles), np.concatenate(corner_vertices)
        return cls(corners, _corner_normals(corners, names, np.concatenate(owners), len(vertices)))

    def closest(self, points: Floats) -> tuple[Floats, Floats, TriangleReference]:
        """Exact closest points: nearest centres first, more of them until none can be missed."""
        n, count = len(points), min(NEAREST, len(self.corners))
        found = _Feet(np.empty((n, 3)), np.zeros(n, dtype=np.int64), np.full(n, np.inf))
        open_rows = np.arange(n)
        while len(open_rows):
            # A point far off has very many: all at once would take memory and time.
            size = max(PAIRS // count, 1)
            parts = np.split(open_rows, range(size, len(open_rows), size))
            open_rows = np.concatenate([self._asked(points, part, count, found) for part in parts])
            count = min(4 * count, len(self.corners))
        feet, which, _ = found
        normals = self._normals_at(feet, which)
        # Nearest to a crease, the way to the foot is the normal: it does not jump between the
        # triangles that meet there. Beyond the rim it runs along the surface and is none.
        way = points - feet
        length, along = norm(way), dot(way, normals)
        turned = (
            self._creased[which] & (np.abs(along) > 0.5 * length) & (length > 1e-9 * self._reach)
        )
        ways = unit(way) * np.sign(along)[:, None]
        return feet, np.where(turned[:, None], ways, normals), self

    def _asked(self, points: Floats, rows: Indices, count: int, found: _Feet) -> Indices:
        """Rows of points that need more than so many nearest centres; what is found is entered."""
        feet, which, gaps = found
        answer = self._tree.query(points[rows], k=count)
        distance, near = (np.asarray(part).reshape(-1, count) for part in answer)
        # A triangle lies within its radius of its centre: most cannot be the nearest.
        least, reach = distance - self._radii[near], self._reach
        ranks = 0
        while ranks < count:
            # One, three, twelve, ... at a time: the nearer ones leave few of the others.
            block = slice(ranks, min(4 * ranks, count) or 1)
            gap = np.where(gaps > ON_IT * reach, gaps, 0.0)[rows]
            asked, rank = np.nonzero(least[:, block] < gap[:, None])
            own, triangles = rows[asked], near[:, block][asked, rank]
            places = _closest_on_triangles(self.corners[triangles], points[own])
            away = norm(places - points[own])
            # The best of each point, the first of equals.
            order = np.lexsort((away, own))
            order = order[np.diff(own[order], prepend=-1) > 0]
            order = order[away[order] < gaps[own[order]]]
            own = own[order]
            feet[own], which[own], gaps[own] = places[order], triangles[order], away[order]
            ranks = block.stop
        if count == len(self.corners):
            return rows[:0]
        gap = gaps[rows]
        return rows[(gap > distance[:, -1] - reach) & (gap > ON_IT * reach)]

    def about(self, origin: Floats) -> TriangleReference:
        """The same surface with places counted from an origin (3,)."""
        return TriangleReference(self.corners - origin, self.normals)

    def _normals_at(self, feet: Floats, triangles: Indices) -> Floats:
        """Unit normals at points of triangles."""
        corners = self.corners[triangles]
        a, b, c = np.moveaxis(corners, 1, 0)
        flat = cross(b - a, c - a)
        if self.normals is None:
            return unit(flat)
        square = np.maximum(dot(flat, flat), TINY)
        shares = np.stack(
            [
                dot(cross(c - b, feet - b), flat),
                dot(cross(a - c, feet - c), flat),
                dot(cross(b - a, feet - a), flat),
            ],
            axis=1,
        )
        shares = np.clip(shares / square[:, None], 0.0, 1.0)
        return unit(np.einsum("nk,nki->ni", shares, self.normals[triangles]))


def _corner_normals(corners: Floats, names: Indices, owners: Indices, count: int) -> Floats:
    """Normals (T, 3, 3) at the corners of triangles: of a vertex, or of the polygon (-1)."""
    areas = cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    at_vertex, of_face = np.zeros((count, 3)), np.zeros((int(owners.max()) + 1, 3))
    np.add.at(of_face, owners, areas)
    for corner in range(3):
        known = names[:, corner] >= 0
        np.add.at(at_vertex, names[known, corner], areas[known])
    smooth = np.where((names >= 0)[..., None], at_vertex[names], of_face[owners][:, None])
    smooth, own = unit(smooth), unit(areas)[:, None]
    crease = np.einsum("tki,tki->tk", smooth, np.broadcast_to(own, smooth.shape)) < CREASE
    return np.asarray(np.where(crease[..., None], own, smooth))


def _flat_normals(corners: Floats) -> Floats:
    """Unit normals (T, 3) of triangles."""
    return unit(cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def _closest_on_triangles(corners: Floats, points: Floats) -> Floats:
    """Closest points of triangles (..., 3, 3) to points (..., 3)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    normal = cross(b - a, c - a)
    square = np.maximum(dot(normal, normal), TINY)
    weights = np.stack(
        [
            dot(cross(c - b, points - b), normal),
            dot(cross(a - c, points - c), normal),
            dot(cross(b - a, points - a), normal),
        ],
        axis=-1,
    )
    inside = (weights >= 0).all(axis=-1) & (dot(normal, normal) > TINY)
    best = np.einsum("...k,...ki->...i", weights / square[..., None], corners)
    gap = np.where(inside, norm(best - points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        along = q - p
        share = np.clip(dot(points - p, along) / np.maximum(dot(along, along), TINY), 0.0, 1.0)
        place = p + share[..., None] * along
        distance = norm(place - points)
        closer = distance < gap
        best = np.where(closer[..., None], place, best)
        gap = np.where(closer, distance, gap)
    return np.asarray(best)
