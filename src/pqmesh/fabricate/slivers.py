"""Panels cut too small: which they are, and mergers with neighbours in the same plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pqmesh.fabricate.clip import Pieces
from pqmesh.fabricate.crossings import Nodes
from pqmesh.fabricate.tidy import area_vector, area_vectors, distance_to_segment
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats, Mask, norm

# A cut panel is a sliver below this share of the mean area of the whole panels,
LEAST_AREA = 0.15
# or with a side below this share of the wanted edge.
LEAST_SIDE = 0.05
# Faces whose corners lie this near to one plane, in wanted edges, lie in it.
COPLANAR = 5e-10


@dataclass
class Merged:
    """Loops after mergers, with the area that slivers are measured by."""

    loops: list[list[int]]
    face: list[int]
    is_trimmed: list[bool]
    mean_area: float


def is_sliver(
    polygons: Sequence[Floats],
    areas: Sequence[float] | Floats,
    is_trimmed: Sequence[bool] | Mask,
    mean_area: float,
    edge: float,
) -> list[bool]:
    """Truth for each panel that was cut too small."""
    return [
        bool(cut)
        and (bool(area < LEAST_AREA * mean_area) or _least_side(points) < LEAST_SIDE * edge)
        for points, area, cut in zip(polygons, areas, is_trimmed, strict=True)
    ]


def merged_slivers(pieces: Pieces, mesh: QuadMesh, edge: float) -> Merged:
    """Loops with slivers joined to the neighbour in their plane with the longest common side."""
    faces = mesh.faces.tolist()
    trimmed = [loop != faces[f] for loop, f in zip(pieces.loops, pieces.face, strict=True)]
    points = [pieces.nodes.at(loop) for loop in pieces.loops]
    areas = norm(area_vectors(points)).tolist()
    whole = [area for area, cut in zip(areas, trimmed, strict=True) if not cut]
    mean = float(np.mean(whole)) if whole else float(norm(mesh.face_area_vectors).mean())
    small = is_sliver(points, areas, trimmed, mean, edge)
    merger = _Merger(pieces, mesh, COPLANAR * edge)
    waiting = sorted((k for k, wrong in enumerate(small) if wrong), key=lambda k: (areas[k], k))
    while waiting:
        into = merger.merge(waiting.pop(0))
        if into is None:
            continue
        trimmed[into] = True
        joined = pieces.nodes.at(merger.loops[into])
        still = is_sliver([joined], [float(norm(area_vector(joined)))], [True], mean, edge)[0]
        if into in waiting and not still:
            waiting.remove(into)
        elif still and into not in waiting:
            waiting.append(into)
    kept = [k for k, loop in enumerate(merger.loops) if loop]
    return Merged(
        [merger.loops[k] for k in kept],
        [pieces.face[k] for k in kept],
        [trimmed[k] for k in kept],
        mean,
    )


class _Merger:
    """Loops with their directed sides, so that neighbours are found."""

    def __init__(self, pieces: Pieces, mesh: QuadMesh, tolerance: float) -> None:
        self.nodes, self.mesh, self.tolerance = pieces.nodes, mesh, tolerance
        self.face = pieces.face
        self.loops = list(pieces.loops)
        self._owner = {side: k for k, loop in enumerate(self.loops) for side in _sides(loop)}

    def merge(self, sliver: int) -> int | None:
        """Join a sliver to a neighbour in its plane: the neighbour's number, or None."""
        if not self.loops[sliver]:
            return None
        common: dict[int, float] = {}
        for a, b in _sides(self.loops[sliver]):
            other = self._owner.get((b, a))
            if other is not None and other != sliver:
                pair = self.nodes.at([a, b])
                common[other] = common.get(other, 0.0) + float(norm(pair[1] - pair[0]))
        for other in sorted(common, key=lambda k: (-common[k], k)):
            if not self._in_one_plane(sliver, other):
                continue
            joined = _joined(self.loops[sliver], self.loops[other], self.nodes)
            if joined:
                self._replace(sliver, other, joined)
                return other
        return None

    def _replace(self, sliver: int, other: int, joined: list[int]) -> None:
        for side in [*_sides(self.loops[sliver]), *_sides(self.loops[other])]:
            self._owner.pop(side, None)
        self.loops[sliver], self.loops[other] = [], joined
        self._owner.update((side, other) for side in _sides(joined))

    def _in_one_plane(self, sliver: int, other: int) -> bool:
        """Whether both whole faces lie in the plane of the other one."""
        normal = self.mesh.face_normals[self.face[other]]
        center = self.mesh.face_centers[self.face[other]]
        corners = self.mesh.corners[[self.face[sliver], self.face[other]]]
        near = bool((np.abs((corners - center) @ normal) <= self.tolerance).all())
        return near and float(self.mesh.face_normals[self.face[sliver]] @ normal) > 0


def _sides(loop: list[int]) -> list[tuple[int, int]]:
    return list(zip(loop, loop[1:] + loop[:1], strict=True))


def _joined(first: list[int], second: list[int], nodes: Nodes) -> list[int]:
    """Union of two loops over their common sides; empty when it is not one simple loop."""
    sides = {*_sides(first), *_sides(second)}
    rest = [side for side in [*_sides(second), *_sides(first)] if side[::-1] not in sides]
    after = dict(rest)
    if not rest or len(after) < len(rest):
        return []
    loop = [rest[0][0]]
    while after[loop[-1]] != loop[0]:
        loop.append(after[loop[-1]])
    if len(loop) < len(rest):
        return []
    # Where the common sides end a corner may have become straight.
    ends = {a for a, _ in _sides(first)} & {a for a, _ in _sides(second)}
    k = 0
    while k < len(loop) and len(loop) > 3:
        a, b, c = nodes.at([loop[k - 1], loop[k], loop[(k + 1) % len(loop)]])
        if loop[k] in ends and float(distance_to_segment(b, a, c)) < nodes.snap:
            del loop[k]
        else:
            k += 1
    return loop


def _least_side(points: Floats) -> float:
    return float(norm(np.roll(points, -1, axis=0) - points).min())
