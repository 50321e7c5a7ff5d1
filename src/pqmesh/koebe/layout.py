"""Circle patterns laid out in the plane and lifted to the unit sphere.

A circle on the sphere is a unit vector X of R^{3,1}, product diag(1, 1, 1, -1): the circle with
centre c and angular radius a is (c, cos a) / sin a, and X_space / X_4 is its pole, the apex of
the cone that touches the sphere along it. Two circles are orthogonal when <X, Y> = 0 and touch
from outside when <X, Y> = -1; X + Y is then the point of contact, (t, 1) up to a factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from pqmesh.errors import MeshError
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, Indices, Mask, norm

METRIC = np.array([1.0, 1.0, 1.0, -1.0])
MOST_BOOSTS, LONGEST_BOOST, CENTRED = 200, 1.0, 1e-15


def lorentz(a: Floats, b: Floats) -> Floats:
    """Products <a, b> of the rows of two (..., 4) arrays."""
    return np.asarray(np.einsum("...i,...i,i->...", a, b, METRIC))


# --- combinatorics --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Rounds:
    """Circles and their neighbours in counterclockwise order: vertices first, faces after.

    Attributes
    ----------
    circle, neighbor : (N,)
        One entry for each neighbour of each circle, a circle's entries together and in order.
    first : (n + 1,)
        Where each circle's entries begin.
    back : (N,)
        The entry that has circle and neighbour exchanged.
    """

    circle: Indices
    neighbor: Indices
    first: Indices
    back: Indices

    @classmethod
    def of(cls, topology: Topology) -> Rounds:
        """Rounds of all vertices and faces of a mesh."""
        n = topology.n_vertices
        lists: list[Indices] = [np.empty(0, dtype=np.int64)] * n
        for boundary in (False, True):
            for star in topology.stars(boundary=boundary):
                for vertex, faces in zip(star.vertices.tolist(), star.faces, strict=True):
                    lists[vertex] = n + faces
        counts = np.concatenate([[len(row) for row in lists], topology.face_sizes])
        circle = np.repeat(np.arange(len(counts)), counts)
        neighbor = np.concatenate([*lists, topology.indices])
        size = len(counts)
        order = np.argsort(circle * size + neighbor, kind="stable")
        turned = np.argsort(neighbor * size + circle, kind="stable")
        back = np.empty(len(order), dtype=np.int64)
        back[order] = turned
        return cls(circle, neighbor, np.concatenate([[0], np.cumsum(counts)]), back)

    @property
    def corners(self) -> Indices:
        """Pairs (vertex, face) as circles, shape (C, 2)."""
        half = len(self.circle) // 2
        return np.column_stack([self.circle[:half], self.neighbor[:half]])


# --- the plane ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PlanePattern:
    """Circles and lines in the plane.

    Attributes
    ----------
    centre : (n,) complex
        Of a line the unit normal.
    radius : (n,)
        Infinite for lines.
    height : (n,)
        Of a line the distance from the origin along its normal, which points to its inner side.
    """

    centre: Any
    radius: Floats
    height: Floats

    def moved(self, factor: complex, shift: complex) -> PlanePattern:
        """The pattern after the similarity z -> factor z + shift."""
        finite, size = np.isfinite(self.radius), abs(factor)
        turned = factor * self.centre
        normal = turned / size
        height = size * self.height + (normal * np.conj(shift)).real
        return PlanePattern(
            np.where(finite, turned + shift, normal),
            size * self.radius,
            np.where(finite, 0, height),
        )

    def lifted(self) -> Floats:
        """The circles on the sphere, seen from (0, 0, -1), shape (n, 4)."""
        finite = np.isfinite(self.radius)
        radius = np.where(finite, self.radius, 1.0)
        power = np.abs(self.centre) ** 2 - radius**2
        x, y, h = self.centre.real, self.centre.imag, self.height
        circles = np.column_stack([2.0 * x, 2.0 * y, 1.0 - power, 1.0 + power])
        lines = np.column_stack([x, y, -h, h])
        return np.where(finite[:, None], circles / (2.0 * radius)[:, None], lines)

    def contacts(self, edges: Indices) -> Any:
        """Points where the circles of an edge's vertices touch, (E,) complex; may be infinite."""
        i, j = edges.T
        i, j = (
            np.where(np.isfinite(self.radius[j]), i, j),
            np.where(np.isfinite(self.radius[j]), j, i),
        )
        line, both = ~np.isfinite(self.radius[i]), ~np.isfinite(self.radius[j])
        share = np.where(line, 0.0, self.radius[i]) / np.where(
            line | both, 1.0, self.radius[i] + self.radius[j]
        )
        between = self.centre[i] + share * (self.centre[j] - self.centre[i])
        # The foot of a circle's centre on the line.
        along = self.centre[j] * np.conj(self.centre[i])
        foot = self.centre[j] + self.centre[i] * (self.height[i] - along.real)
        return np.where(both, np.inf, np.where(line, foot, between))

    def centred(self, edges: Indices) -> PlanePattern:
        """The pattern placed so that on the sphere the mean of the contacts comes to 0.

        Moebius maps of the sphere are rotations after similarities of the plane, so that these
        suffice. Small circles keep their digits here, and would lose them under boosts.

        References: [springborn2005].
        """
        pattern = self
        for _ in range(MOST_BOOSTS):
            step = _centring(_sphere_points(pattern.contacts(edges)))
            length = float(norm(step))
            if length < CENTRED:
                break
            # The point of the hyperboloid that the boost brings to (0, 1), in the half-space.
            point = -np.sinh(length) * step / length
            height = 1.0 / (point[2] + np.cosh(length))
            pattern = pattern.moved(1.0 / height, -complex(point[0], point[1]))
        return pattern


def plane_pattern(rounds: Rounds, radii: Floats) -> PlanePattern:
    """Circles of a pattern with given radii in the plane.

    The centres are chained along the tree that goes over the largest circles, so that small
    circles, whose angles say least, pass their error on to few others.

    Parameters
    ----------
    rounds : Rounds
    radii : (n,)
        Infinite for circles that are lines; finite circles hang together.
    """
    finite = np.isfinite(radii)
    along = _directions(rounds, radii)
    centre, base = _chained(rounds, radii, along, finite)
    height = np.zeros(len(radii))
    for line in np.flatnonzero(~finite):
        # A circle orthogonal to the line has its centre on it and sees it across.
        entries = np.arange(rounds.first[line], rounds.first[line + 1])
        around = rounds.neighbor[entries]
        best = int(np.where(finite[around], radii[around], -1.0).argmax())
        other, entry = around[best], rounds.back[entries[best]]
        centre[line] = np.exp(1j * (base[other] + along[entry]))
        height[line] = (centre[other] * np.conj(centre[line])).real
    return PlanePattern(centre, radii, height)


def _directions(rounds: Rounds, radii: Floats) -> Floats:
    """Direction of each neighbour, counted from the first one of its circle, (N,), radians."""
    own, other = radii[rounds.circle], radii[rounds.neighbor]
    # Angles at lines are never used: a line has its centre at infinity.
    known = np.isfinite(own)
    half = np.where(known, np.arctan2(other, np.where(known, own, 1.0)), 0.0)
    steps = np.concatenate([[0.0], half[:-1] + half[1:]])
    total = np.cumsum(steps)
    start = rounds.first[:-1]
    return np.asarray(total - total[start][rounds.circle])


def _chained(rounds: Rounds, radii: Floats, along: Floats, finite: Mask) -> tuple[Any, Floats]:
    """Centres as complex numbers and the direction of the first neighbour, finite circles."""
    n = len(radii)
    entries = np.flatnonzero(finite[rounds.circle] & finite[rounds.neighbor])
    tail, head = rounds.circle[entries], rounds.neighbor[entries]
    weight = 1.0 / np.minimum(radii[tail], radii[head])
    graph = coo_array((weight, (tail, head)), shape=(n, n)).tocsr()
    tree = minimum_spanning_tree(graph)
    # At the smallest circle: near the origin coordinates have digits to spare.
    root = int(np.where(finite, radii, np.inf).argmin())
    order, before = breadth_first_order(tree, root, directed=False)
    if len(order) < finite.sum():
        raise MeshError(
            f"The circles must hang together; only {len(order)} of {int(finite.sum())} do. Give a "
            f"mesh in one piece."
        )
    place = {
        (a, b): k for a, b, k in zip(tail.tolist(), head.tolist(), entries.tolist(), strict=True)
    }
    centre, base = np.zeros(n, dtype=np.complex128), np.zeros(n)
    for circle in order[1:].tolist():
        parent = int(before[circle])
        entry = place[parent, circle]
        direction = base[parent] + along[entry]
        reach = np.hypot(radii[parent], radii[circle])
        centre[circle] = centre[parent] + reach * complex(np.cos(direction), np.sin(direction))
        base[circle] = direction + np.pi - along[rounds.back[entry]]
    return centre, base


# --- the sphere -----------------------------------------------------------------------------


def contacts(circles: Floats, edges: Indices) -> Floats:
    """Points of the sphere where the circles of an edge's vertices touch, shape (E, 3)."""
    sums = circles[edges[:, 0]] + circles[edges[:, 1]]
    return np.asarray(sums[:, :3] / norm(sums[:, :3])[:, None] * np.sign(sums[:, 3:]))


def centred(circles: Floats, points: Floats) -> Floats:
    """Circles after the Moebius map that brings the mean of some points of the sphere to 0.

    The map is unique up to rotation when no point carries half of them.

    References: [springborn2005].
    """
    total, current = np.eye(4), points
    for _ in range(MOST_BOOSTS):
        step = _centring(current)
        if norm(step) < CENTRED:
            break
        total = boost(step) @ total
        moved = points @ total[:, :3].T + total[:, 3]
        current = moved[:, :3] / norm(moved[:, :3])[:, None]
    return np.asarray(circles @ total.T)


def _centring(points: Floats) -> Floats:
    """Rapidity (3,) of the boost towards mean 0, none that is too long.

    Newton's step to the minimum of sum log(p_4 - t . p) over the hyperboloid.
    """
    spread = np.eye(3) - points.T @ points / len(points)
    step = -np.linalg.solve(spread, points.mean(axis=0))
    return np.asarray(step * min(1.0, LONGEST_BOOST / max(float(norm(step)), 1e-300)))


def _sphere_points(plane: Any) -> Floats:
    """Points of the sphere over points of the plane (n,), seen from (0, 0, -1)."""
    away = ~np.isfinite(plane)
    z = np.where(away, 0.0, plane)
    square = np.abs(z) ** 2
    points = np.column_stack([2.0 * z.real, 2.0 * z.imag, 1.0 - square]) / (1.0 + square)[:, None]
    points[away] = [0.0, 0.0, -1.0]
    return np.asarray(points)


def boost(rapidity: Floats) -> Floats:
    """Lorentz boost (4, 4) along a vector, by its length; points of the sphere follow it."""
    length = float(norm(rapidity))
    matrix = np.eye(4)
    if length == 0.0:
        return matrix
    axis = rapidity / length
    matrix[:3, :3] += (np.cosh(length) - 1.0) * np.outer(axis, axis)
    matrix[:3, 3] = matrix[3, :3] = np.sinh(length) * axis
    matrix[3, 3] = np.cosh(length)
    return matrix
