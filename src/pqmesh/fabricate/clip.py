"""Plane polygons cut by the vertical prism over an outline: the pieces of each."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.fabricate.crossings import Crossing, Nodes, Section
from pqmesh.fabricate.tidy import Tidied, distance_to_segment, tidied
from pqmesh.fabricate.upright import Upright, upright_section
from pqmesh.fabricate.walls import (
    Walls,
    inside_polygon,
)
from pqmesh.fabricate.ways import segments_cross, way_through
from pqmesh.vectors import Floats, Indices, cross, unit

# Faces whose unit normal rises less than this are cut as vertical ones, in their own plane.
VERTICAL = 1e-7
# Points nearer than this share of the mean edge are one; thinner pieces are none.
SNAP = 1e-9
# More holes than this in one face are refused.
MOST_SPLITS = 200


class Pieces(NamedTuple):
    """What is left of the faces.

    Attributes
    ----------
    nodes : Nodes
    loops : list of lists of node numbers
    face : list of int
        Source of each loop.
    edges : (E, 2)
        Vertex pairs of the faces, low to high, sorted, as `Topology.edges`.
    """

    nodes: Nodes
    loops: list[list[int]]
    face: list[int]
    edges: Indices


def cut_faces(points: Floats, faces: Indices, walls: Walls, what: str = "face") -> Pieces:
    """Pieces of plane quads (F, 4) inside the walls; whole faces keep their corners and order.

    Parameters
    ----------
    points : (N, 3), model unit
    faces : (F, 4)
    walls : Walls
    what : str
        Name of a face in messages.

    Raises
    ------
    MeshError
        When a face that must be cut crosses itself, or holds too many holes; names it.
    """
    tails, heads = faces, np.roll(faces, -1, axis=1)
    ends = np.stack([np.minimum(tails, heads), np.maximum(tails, heads)], axis=-1).reshape(-1, 2)
    edges, face_edges = np.unique(ends, axis=0, return_inverse=True)
    face_edges = face_edges.reshape(-1, 4)
    lengths = np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)
    # Far from the origin coordinates are coarser than the share of an edge.
    snap = max(SNAP * float(lengths.mean()), 16 * 2.0**-53 * float(np.abs(points).max()))
    nodes = Nodes(list(map(tuple, points.tolist())), snap)
    plan = np.ascontiguousarray(points[:, :2])
    section = Section(nodes, dict(enumerate(plan)), walls)
    section.prepare(edges, plan)
    crossed = np.array([bool(section.crossings(a, b)) for a, b in edges.tolist()])
    rings = _rings_in_faces(plan[faces], walls)
    is_cut = np.asarray(crossed[face_edges].any(axis=1))
    is_cut[list(rings)] = True
    corners = points[faces]
    normals = unit(cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]))
    pieces = Pieces(nodes, [], [], edges)
    for number, face in enumerate(faces.tolist()):
        if is_cut[number]:
            sides = face_edges[number].tolist()
            cut = _Face(section, (what, number), face, sides, normals[number])
            cut.rings = rings.get(number, [])
            loops = cut.loops()
        else:
            loops = [face] if section.is_inside(face[0]) else []
        pieces.loops.extend(loops)
        pieces.face.extend([number] * len(loops))
    return pieces


def _rings_in_faces(corners: Floats, walls: Walls) -> dict[int, list[int]]:
    """Rings of the outline that may lie inside a face, by face."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    found: dict[int, list[int]] = {}
    for ring in range(walls.n_rings):
        points = walls.starts[walls.ring == ring]
        within = (low <= points.min(axis=0)).all(axis=1) & (high >= points.max(axis=0)).all(axis=1)
        for face in np.flatnonzero(within).tolist():
            found.setdefault(face, []).append(ring)
    return found


class _Face:
    """One face on its way through the walls."""

    def __init__(
        self,
        section: Section,
        name: tuple[str, int],
        corners: list[int],
        edges: list[int],
        normal: Floats,
    ) -> None:
        self.name, self.corners, self.edges = name, corners, edges
        self.normal = normal
        self.rings: list[int] = []
        self.nodes = section.nodes
        self.center = self.nodes.at(corners).mean(axis=0)
        self.section = section
        folds = _crosses_itself(section, corners)
        self.is_upright = abs(normal[2]) < VERTICAL or folds
        if folds and not normal.any():
            raise self._folded()
        if self.is_upright:
            self.section = upright_section(section, corners, self.center, normal)
            if _crosses_itself(self.section, corners):
                raise self._folded()
        self.is_reversed = not self.is_upright and normal[2] < 0
        self._ends: dict[int, int] = {}
        self._splits = 0

    def loops(self) -> list[list[int]]:
        """Pieces of the face, oriented like it; the face itself where nothing is cut off."""
        found = self._pieces(self.corners[::-1] if self.is_reversed else self.corners)
        return [self._begun(loop) for loop in found]

    def _pieces(self, corners: list[int]) -> list[list[int]]:
        """Tidy pieces of a polygon of mesh points, split through holes."""
        sides = [
            self.section.crossings(a, b) for a, b in itertools.pairwise([*corners, corners[0]])
        ]
        touched = {int(self.section.walls.ring[c.wall]) for side in sides for c in side}
        inner = [ring for ring in self._free_rings(corners) if ring not in touched]
        for ring in inner:
            if ring > 0:
                walls = self.section.walls
                return self._split(corners, walls.starts[walls.ring == ring])
        if any(sides):
            loops = self._walked(corners, sides)
        elif inner:
            loops = [[self._end(k) for k in np.flatnonzero(self.section.walls.ring == 0).tolist()]]
        else:
            loops = [corners] if self.section.is_inside(corners[0]) else []
        if self.is_reversed:
            loops = [loop[::-1] for loop in loops]
        result: list[list[int]] = []
        for loop in loops:
            if len(loop) == len(corners) and set(loop) == set(corners):
                result.append(loop)
                continue
            pieces: Tidied = tidied(loop, self.nodes, self.normal)
            if pieces.hole is not None:
                return self._split(corners, self._flat(pieces.hole))
            result.extend(pieces.loops)
        return result

    def _free_rings(self, corners: list[int]) -> list[int]:
        """Rings with their first corner inside a polygon of mesh points."""
        if self.is_upright or not self.rings:
            return []
        polygon = np.array([self.section.xy[number] for number in corners])
        walls = self.section.walls
        first = {ring: int(np.argmax(walls.ring == ring)) for ring in self.rings}
        return [r for r in self.rings if inside_polygon(walls.starts[first[r]], polygon)]

    def _walked(self, corners: list[int], sides: list[list[Crossing]]) -> list[list[int]]:
        """Loops along the polygon inside the walls and along the walls inside the polygon."""
        items: list[tuple[int, int]] = []
        marks: list[Crossing] = []
        places: list[int] = []
        for corner, side in zip(corners, sides, strict=True):
            items.append((corner, -1))
            for crossing in side:
                places.append(len(items))
                items.append((crossing.node, len(marks)))
                marks.append(crossing)
        inside = self.section.is_inside(corners[0])
        if len(marks) % 2:
            raise self._folded()
        of_wall = self.section.along_walls(marks)
        # Crossings alternate: out of the outline, into it.
        leaving = list(range(0 if inside else 1, len(marks), 2))
        open_marks, loops = set(leaving), []
        for first in leaving:
            if first not in open_marks:
                continue
            loop: list[int] = []
            mark = first
            while True:
                if mark not in open_marks:
                    raise self._folded()
                open_marks.discard(mark)
                ends, entry = self._along_outline(mark, marks, of_wall)
                loop += [marks[mark].node, *ends, marks[entry].node]
                place = (places[entry] + 1) % len(items)
                while items[place][1] < 0:
                    loop.append(items[place][0])
                    place = (place + 1) % len(items)
                mark = items[place][1]
                if mark == first:
                    break
            loops.append(loop)
        return loops

    def _along_outline(
        self, mark: int, marks: list[Crossing], of_wall: dict[int, list[int]]
    ) -> tuple[list[int], int]:
        """Outline corners from one crossing to the next one of the polygon, and that crossing."""
        wall = marks[mark].wall
        place = of_wall[wall].index(mark) + 1
        if place < len(of_wall[wall]):
            return [], of_wall[wall][place]
        ends = []
        for _ in range(len(self.section.walls.ring)):
            wall = int(self.section.walls.following[wall])
            ends.append(self._end(wall))
            if wall in of_wall:
                return ends, of_wall[wall][0]
        raise self._folded()

    def _end(self, wall: int) -> int:
        """Node of the outline corner where a wall starts, in the plane of the face."""
        if wall not in self._ends:
            self._ends[wall] = self._new_end(self.section.walls.starts[wall])
        return self._ends[wall]

    def _new_end(self, corner: Floats) -> int:
        point = self._lifted(corner)
        points = self.nodes.at(self.corners)
        near = np.linalg.norm(points - point, axis=1)
        if near.min() < self.nodes.snap:
            return self.corners[int(np.argmin(near))]
        gaps = distance_to_segment(point, points, np.roll(points, -1, axis=0))
        side = int(np.argmin(gaps))
        return self.nodes.add(point, self.edges[side] if gaps[side] < self.nodes.snap else -1)

    def _lifted(self, corner: Floats) -> Floats:
        """Point of the face's plane over a point of the section.

        The height comes from the center of the face, so it is a small difference of small
        numbers; however steep the face, its error stays in the plane times the normal's rise.
        """
        if isinstance(self.section, Upright):
            h, v = corner
            along = self.section.along
            return np.asarray(self.center + np.array([h * along[0], h * along[1], v]))
        x, y = corner - self.center[:2]
        rise = -(self.normal[0] * x + self.normal[1] * y) / self.normal[2]
        return np.array([corner[0], corner[1], self.center[2] + rise])

    def _flat(self, loop: list[int]) -> Floats:
        """Nodes in the coordinates of the section, (k, 2)."""
        points = self.nodes.at(loop)
        if isinstance(self.section, Upright):
            return self.section.flat(points)
        return np.asarray(points[:, :2])

    def _split(self, corners: list[int], hole: Floats) -> list[list[int]]:
        """Pieces of the two polygons beside a way from corner to corner through a hole (k, 2)."""
        self._splits += 1
        if self._splits > MOST_SPLITS:
            raise MeshError(
                f"A {self.name[0]} may hold at most {MOST_SPLITS} holes of the outline; "
                f"{self.name[0]} {self.name[1]} holds more. Shorten the panel edge."
            )
        polygon = np.array([self.section.xy[number] for number in corners])
        way = way_through(polygon, hole, 10 * self.nodes.snap)
        if way is None:
            raise self._folded()
        i, j, points = way
        added = [self.section.add(self._lifted(point), point) for point in points]
        return [
            *self._pieces([*corners[i : j + 1], *added[::-1]]),
            *self._pieces([*corners[j:], *corners[: i + 1], *added]),
        ]

    def _begun(self, loop: list[int]) -> list[int]:
        """The loop from its first face corner on: the face itself when it is whole."""
        for corner in self.corners:
            if corner in loop:
                place = loop.index(corner)
                return loop[place:] + loop[:place]
        return loop

    def _folded(self) -> MeshError:
        return MeshError(
            f"A {self.name[0]} must be a simple polygon to be cut; {self.name[0]} {self.name[1]} "
            f"crosses itself, near {self.center.round(6).tolist()}. Mend the mesh there."
        )


# --- polygons -------------------------------------------------------------------------------


def _crosses_itself(section: Section, corners: list[int]) -> bool:
    """Whether opposite sides of a quad cross."""
    a, b, c, d = (section.xy[number] for number in corners)
    return segments_cross(a, b, c, d) or segments_cross(b, c, d, a)
