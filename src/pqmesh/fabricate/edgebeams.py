"""Edge beams: the cut boundary of trimmed panels as polylines with node axes."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pqmesh.fabricate.panels import polygons_mesh
from pqmesh.fabricate.trim import TrimmedPanels
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats, Indices, dot, norm, read_only, unit

# Sides this near to the outline, in mean edges, lie on it.
ON_OUTLINE = 1e-7

Side = tuple[int, int]


@dataclass(frozen=True, eq=False)
class EdgeBeam:
    """One polyline of the cut boundary, panels on its left seen from outside.

    Attributes
    ----------
    points : (k, 3), model unit
        A closed one does not repeat its first point.
    axes : (k, 3)
        Unit node axes.
    panel : (k,) closed, (k-1,) open
        Panel at each side.
    ring : int
        0 along the outer ring of the outline, then the holes.
    is_closed : bool
        Open where the mesh does not cover the outline.
    """

    points: Floats
    axes: Floats
    panel: Indices
    ring: int
    is_closed: bool


def edge_beams(trimmed: TrimmedPanels, mesh: QuadMesh, axes: Floats) -> list[EdgeBeam]:
    """Edge beams of trimmed panels: one loop for each ring that the mesh covers.

    A cut node keeps the axis that its edge has there: on edge (i, j) at share t the direction
    of (1 - t) a_i + t a_j, in the plane of the edge's web when nodes are torsion-free. Nodes at
    vertices have their own axis. An outline corner inside a panel lies on no edge: its axis is
    the panel's normal, on the side of the axes. Sides of uncut panels count where they lie on
    the outline; the mesh's own boundary inside it does not.

    Parameters
    ----------
    trimmed : TrimmedPanels
    mesh : QuadMesh
        That the panels were cut from: the mesh or a layer.
    axes : (V, 3)
        Unit node axes.

    Examples
    --------
    >>> from pqmesh.fabricate.trim import trimmed_panels
    >>> from pqmesh.mesh.exact import translational_mesh
    >>> from pqmesh.network.region import PlanOutline
    >>> mesh = translational_mesh([[0, 0, 0], [2, 0, 0]], [[0, 0, 0], [0, 2, 0]])
    >>> panels = trimmed_panels(mesh, PlanOutline([[1, 1], [3, 1], [3, 3], [1, 3]]), 2.0)
    >>> beam, = edge_beams(panels, mesh, np.tile([0.0, 0.0, 1.0], (4, 1)))
    >>> beam.points.tolist(), beam.is_closed
    ([[1.0, 2.0, 0.0], [1.0, 1.0, 0.0], [2.0, 1.0, 0.0]], False)
    """
    boundary = _Boundary(trimmed, mesh)
    return [
        EdgeBeam(
            read_only(boundary.points[nodes]),
            read_only(_node_axes(boundary, nodes, mesh, axes)),
            read_only(panels, np.int64),
            ring,
            is_closed,
        )
        for nodes, panels, ring, is_closed in boundary.chains()
    ]


class _Boundary:
    """Sides of panels on the outline, with the places of their nodes in the mesh."""

    def __init__(self, trimmed: TrimmedPanels, mesh: QuadMesh) -> None:
        self.points, self.faces = polygons_mesh(trimmed.polygons)
        self.vertex = np.full(len(self.points), -1, dtype=np.int64)
        self.edge = np.full(len(self.points), -1, dtype=np.int64)
        self.face = np.zeros(len(self.points), dtype=np.int64)
        for panel, loop in enumerate(self.faces):
            # A node may be a vertex to one panel and a straight point to none: the largest wins.
            self.vertex[loop] = np.maximum(self.vertex[loop], trimmed.corner_vertex[panel])
            self.edge[loop] = np.maximum(self.edge[loop], trimmed.corner_edge[panel])
            self.face[loop] = trimmed.face[panel]
        self._mesh = mesh
        owner = self._directed_sides()
        self.owner = {side: k for side, k in owner.items() if side[::-1] not in owner}
        self._keep_those_on_outline(trimmed)

    def _directed_sides(self) -> dict[Side, int]:
        """Sides of all panels, parted at the cut nodes that stand on them."""
        ends = self._mesh.edges.tolist()
        of_pair = {(a, b): k for k, (a, b) in enumerate(ends)}
        nodes_on: dict[int, list[int]] = {}
        for node in np.flatnonzero((self.edge >= 0) & (self.vertex < 0)).tolist():
            nodes_on.setdefault(int(self.edge[node]), []).append(node)
        owner: dict[Side, int] = {}
        for panel, loop in enumerate(self.faces):
            for a, b in pairwise([*loop, loop[0]]):
                between = self._between(a, b, self._edge_of(a, b, ends, of_pair), nodes_on)
                for side in pairwise([a, *between, b]):
                    owner.setdefault(side, panel)
        return owner

    def _edge_of(
        self, a: int, b: int, ends: list[list[int]], of_pair: dict[tuple[int, int], int]
    ) -> int:
        """Mesh edge along which two nodes lie, or -1."""
        va, vb = int(self.vertex[a]), int(self.vertex[b])
        if va >= 0 and vb >= 0:
            return of_pair.get((min(va, vb), max(va, vb)), -1)
        edge = int(self.edge[a] if va < 0 else self.edge[b])
        if edge < 0:
            return -1
        for node, vertex in ((a, va), (b, vb)):
            if vertex not in ends[edge] if vertex >= 0 else int(self.edge[node]) != edge:
                return -1
        return edge

    def _between(self, a: int, b: int, edge: int, nodes_on: dict[int, list[int]]) -> list[int]:
        """Cut nodes strictly between two nodes of a mesh edge, in their direction."""
        others = [node for node in nodes_on.get(edge, []) if node not in (a, b)]
        if not others:
            return []
        step = self.points[b] - self.points[a]
        share = (self.points[others] - self.points[a]) @ step / float(step @ step)
        order = np.argsort(share, kind="stable").tolist()
        return [others[k] for k in order if 0.0 < share[k] < 1.0]

    def _keep_those_on_outline(self, trimmed: TrimmedPanels) -> None:
        """Drop the sides off the outline; note ring and place along it of the others."""
        rings = trimmed.outline.rings
        starts = np.concatenate(rings)
        steps = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) - starts
        ring_of = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
        lengths = norm(steps)
        before = np.cumsum(lengths) - lengths
        self.ring: dict[Side, int] = {}
        self.place: dict[Side, float] = {}
        squares = np.where(lengths > 0, lengths, 1.0) ** 2
        limit = ON_OUTLINE * self._mesh.mean_edge_length
        low = np.minimum(starts, starts + steps) - 2.0 * limit
        high = np.maximum(starts, starts + steps) + 2.0 * limit
        for side in list(self.owner):
            middle = self.points[list(side), :2].mean(axis=0)
            near = np.flatnonzero(((low <= middle) & (middle <= high)).all(axis=1))
            offset = middle - starts[near]
            share = np.clip(dot(offset, steps[near]) / squares[near], 0, 1)
            gap = norm(offset - share[:, None] * steps[near])
            if gap.min(initial=np.inf) > limit:
                del self.owner[side]
                continue
            nearest = int(np.argmin(gap))
            wall = int(near[nearest])
            self.ring[side] = int(ring_of[wall])
            self.place[side] = float(before[wall] + share[nearest] * lengths[wall])

    def chains(self) -> list[tuple[list[int], list[int], int, bool]]:
        """Nodes, panels, ring and closedness of each run of sides, by ring and place along it."""
        leaving: dict[int, list[Side]] = {}
        for side in self.owner:
            leaving.setdefault(side[0], []).append(side)
        entered = {side[1] for side in self.owner}
        first = sorted(self.owner, key=lambda s: (s[0] in entered, self.ring[s], self.place[s]))
        left = set(self.owner)
        found = []
        for start in first:
            if start not in left:
                continue
            run = [start]
            left.discard(start)
            while onward := [side for side in leaving.get(run[-1][1], []) if side in left]:
                here = (self.ring[run[-1]], self.place[run[-1]])
                # Where panels meet in a corner only, stay on the ring and near.
                run.append(
                    min(onward, key=lambda s: (self.ring[s] != here[0], self.place[s] - here[1]))
                )
                left.discard(run[-1])
            is_closed = run[-1][1] == start[0]
            nodes = [side[0] for side in run] + ([] if is_closed else [run[-1][1]])
            panels = [self.owner[side] for side in run]
            found.append((nodes, panels, self.ring[start], is_closed))
        return sorted(found, key=lambda chain: chain[2])


def _node_axes(boundary: _Boundary, nodes: list[int], mesh: QuadMesh, axes: Floats) -> Floats:
    """Axes at nodes on vertices, on mesh edges and inside faces."""
    result = np.empty((len(nodes), 3))
    for row, node in enumerate(nodes):
        vertex, edge = int(boundary.vertex[node]), int(boundary.edge[node])
        if vertex >= 0:
            result[row] = axes[vertex]
        elif edge >= 0:
            i, j = mesh.edges[edge]
            away = norm(boundary.points[node] - mesh.vertices[i])
            share = float(away / mesh.edge_lengths[edge])
            result[row] = (1.0 - share) * axes[i] + share * axes[j]
        else:
            face = boundary.face[node]
            normal = mesh.face_normals[face]
            side = float(axes[mesh.faces[face]].sum(axis=0) @ normal)
            result[row] = normal if side >= 0 else -normal
    return unit(result)
