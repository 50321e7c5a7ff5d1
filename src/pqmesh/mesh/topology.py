"""Topology: the abstract mesh (V, E, F), its edges, stars, boundary, strips and polylines."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pqmesh.errors import MeshError
from pqmesh.vectors import Indices, Mask, read_only

Faces = ArrayLike | Sequence[Sequence[int]]


class Stars(NamedTuple):
    """Ordered neighbourhoods of n vertices of one valence k.

    Attributes
    ----------
    vertices : (n,)
    neighbors : (n, k)
        Counterclockwise seen from outside; a boundary star starts at the boundary edge whose
        face lies to its left.
    faces : (n, k) interior, (n, k-1) boundary
        `faces[:, i]` lies between neighbours i and i+1.
    """

    vertices: Indices
    neighbors: Indices
    faces: Indices


class FaceGroup(NamedTuple):
    """All faces of one size k, so that they can be computed with as one array.

    Attributes
    ----------
    faces : (n,)
        Their numbers, rising.
    corners : (n, k)
    """

    faces: Indices
    corners: Indices


@dataclass(frozen=True, eq=False, repr=False)
class Topology:
    """Faces over vertices 0..n-1: coherently oriented, manifold, faces of any length >= 3.

    Parameters
    ----------
    faces : (F, k) integers, or a list of F index lists
    n_vertices : int

    Raises
    ------
    MeshError
        For an index out of range, a face that repeats a vertex or has fewer than three, an
        edge with three faces, an edge used twice in one direction (faces not coherently
        oriented), a vertex without a face, or a vertex whose faces form several fans. Names
        the first offending element.

    References: [thesis] definition 2.1.1, with the conditions of the errata page, E1.

    Examples
    --------
    >>> disc = Topology([[0, 1, 4, 3], [1, 2, 5, 4]], 6)
    >>> disc.n_edges, disc.euler_characteristic, disc.boundary_loops[0].tolist()
    (7, 1, [0, 1, 2, 5, 4, 3])
    """

    faces: Faces
    n_vertices: int
    offsets: Indices = field(init=False)
    indices: Indices = field(init=False)

    def __post_init__(self) -> None:
        offsets, indices = _flat_faces(self.faces)
        object.__setattr__(self, "offsets", read_only(offsets, np.int64))
        object.__setattr__(self, "indices", read_only(indices, np.int64))
        object.__setattr__(self, "faces", None)
        self._check_faces()
        self._check_edges()
        self._check_vertices()

    def __repr__(self) -> str:
        return f"Topology({self.n_vertices} vertices, {self.n_edges} edges, {self.n_faces} faces)"

    # --- counts -----------------------------------------------------------------------------

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return len(self.offsets) - 1

    @property
    def n_edges(self) -> int:
        """Number of edges."""
        return len(self.edges)

    @cached_property
    def face_sizes(self) -> Indices:
        """Number of corners of each face, shape (F,)."""
        return read_only(np.diff(self.offsets), np.int64)

    @cached_property
    def euler_characteristic(self) -> int:
        """V - E + F."""
        return self.n_vertices - self.n_edges + self.n_faces

    @cached_property
    def components(self) -> Indices:
        """Label of the connected piece of each face, shape (F,)."""
        pairs = self.edge_faces[~self.is_boundary_edge]
        graph = coo_array(
            (np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(self.n_faces, self.n_faces)
        )
        return read_only(connected_components(graph, directed=False)[1], np.int64)

    # --- faces ------------------------------------------------------------------------------

    @cached_property
    def is_quad(self) -> bool:
        """True when every face has four corners."""
        return bool((self.face_sizes == 4).all())

    @cached_property
    def quads(self) -> Indices:
        """Faces as an (F, 4) array; raises MeshError when a face is not a quad."""
        if not self.is_quad:
            odd = np.flatnonzero(self.face_sizes != 4)
            raise MeshError(
                f"Every face must be a quad; {len(odd)} of {self.n_faces} are not, the first is "
                f"face {odd[0]} with {self.face_sizes[odd[0]]} corners. Use an all-quad mesh, or "
                f"split or merge these faces."
            )
        return read_only(self.indices.reshape(-1, 4), np.int64)

    @cached_property
    def face_groups(self) -> list[FaceGroup]:
        """Faces by their number of corners, small ones first; every face in one group."""
        groups = []
        for size in np.unique(self.face_sizes):
            chosen = np.flatnonzero(self.face_sizes == size)
            corners = self.indices[self.offsets[chosen][:, None] + np.arange(size)]
            groups.append(FaceGroup(read_only(chosen, np.int64), read_only(corners, np.int64)))
        return groups

    def face(self, index: int) -> Indices:
        """Corners of one face, shape (k,)."""
        return self.indices[self.offsets[index] : self.offsets[index + 1]]

    def face_lists(self) -> list[list[int]]:
        """Faces as plain lists."""
        flat = self.indices.tolist()
        bounds = self.offsets.tolist()
        return [flat[a:b] for a, b in itertools.pairwise(bounds)]

    @cached_property
    def corner_faces(self) -> Indices:
        """Face of each corner, aligned with `indices`."""
        return read_only(np.repeat(np.arange(self.n_faces), self.face_sizes), np.int64)

    @cached_property
    def corner_next(self) -> Indices:
        """Corner that follows each corner in its face, aligned with `indices`."""
        following = np.arange(1, len(self.indices) + 1)
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return read_only(following, np.int64)

    # --- edges ------------------------------------------------------------------------------

    @cached_property
    def _edge_table(self) -> tuple[Indices, Indices, Indices]:
        """Edges (E,2) low-high, edge of each corner's half-edge, and edge_faces (E,2)."""
        tail, head = self.indices, self.indices[self.corner_next]
        pairs = np.stack([np.minimum(tail, head), np.maximum(tail, head)], axis=1)
        edges, of_corner = np.unique(pairs, axis=0, return_inverse=True)
        of_corner = of_corner.reshape(-1)
        faces = np.full((len(edges), 2), -1, dtype=np.int64)
        faces[of_corner, (tail > head).astype(np.int64)] = self.corner_faces
        return (
            read_only(edges, np.int64),
            read_only(of_corner, np.int64),
            read_only(faces, np.int64),
        )

    @property
    def edges(self) -> Indices:
        """Vertex pairs, lower index first, sorted; shape (E, 2)."""
        return self._edge_table[0]

    @property
    def face_edges(self) -> Indices:
        """Edge from each corner to the next one of its face, aligned with `indices`."""
        return self._edge_table[1]

    @property
    def edge_faces(self) -> Indices:
        """Faces to the left and right of each edge run low to high, -1 outside; (E, 2)."""
        return self._edge_table[2]

    @cached_property
    def is_boundary_edge(self) -> Mask:
        """Edges with one face, shape (E,)."""
        return read_only((self.edge_faces < 0).any(axis=1), np.bool_)

    @cached_property
    def is_boundary_vertex(self) -> Mask:
        """Vertices on the boundary, shape (V,)."""
        mask = np.zeros(self.n_vertices, dtype=np.bool_)
        mask[self.edges[self.is_boundary_edge]] = True
        return read_only(mask, np.bool_)

    @cached_property
    def has_inner_ends(self) -> Mask:
        """Whether no end of an edge is on the boundary, shape (E,)."""
        return read_only(~self.is_boundary_vertex[self.edges].any(axis=1), np.bool_)

    @cached_property
    def valence(self) -> Indices:
        """Number of edges at each vertex, shape (V,)."""
        return read_only(np.bincount(self.edges.ravel(), minlength=self.n_vertices), np.int64)

    # --- vertices ---------------------------------------------------------------------------

    @cached_property
    def _corner_turn(self) -> Indices:
        """Corner of the next face counterclockwise at the same vertex, -1 past the boundary."""
        n = len(self.indices)
        previous = np.empty(n, dtype=np.int64)
        previous[self.corner_next] = np.arange(n)
        # The half-edge that enters corner c ends at its vertex; its twin leaves that vertex in
        # the next face counterclockwise.
        twin = np.full(n, -1, dtype=np.int64)
        order = np.argsort(self.face_edges, kind="stable")
        same = self.face_edges[order[1:]] == self.face_edges[order[:-1]]
        first, second = order[:-1][same], order[1:][same]
        twin[first], twin[second] = second, first
        turned: Indices = np.where(twin[previous] >= 0, twin[previous], -1)
        return turned

    @cached_property
    def _star_walk(self) -> tuple[Indices, Indices]:
        """All corners, grouped by vertex and counterclockwise; and the (V+1,) bounds."""
        turn, n = self._corner_turn, len(self.indices)
        has_before = np.zeros(n, dtype=np.bool_)
        has_before[turn[turn >= 0]] = True
        start = np.full(self.n_vertices, n, dtype=np.int64)
        np.minimum.at(start, self.indices, np.arange(n))
        opening = np.flatnonzero(~has_before)
        start[self.indices[opening]] = opening
        counts = np.bincount(self.indices, minlength=self.n_vertices)
        bounds = np.concatenate([[0], np.cumsum(counts)])
        walk = np.full(n, -1, dtype=np.int64)
        current, alive = start.copy(), np.arange(self.n_vertices)
        for step in range(int(counts.max(initial=0))):
            alive = alive[(step < counts[alive]) & (current[alive] >= 0)]
            walk[bounds[alive] + step] = current[alive]
            after = turn[current[alive]]
            # A closed fan ends where it began, so that a second fan stays unreached.
            current[alive] = np.where(after == start[alive], -1, after)
        return walk, bounds

    def star(self, vertex: int) -> tuple[Indices, Indices]:
        """Neighbours and faces around one vertex, ordered as in `Stars`."""
        walk, bounds = self._star_walk
        corners = walk[bounds[vertex] : bounds[vertex + 1]]
        neighbors = self.indices[self.corner_next[corners]]
        if self.is_boundary_vertex[vertex]:
            last = self._previous_vertex(corners[-1:])
            neighbors = np.concatenate([neighbors, last])
        return neighbors, self.corner_faces[corners]

    def stars(self, *, boundary: bool = False) -> list[Stars]:
        """Ordered stars of all interior (or all boundary) vertices, one group per valence."""
        walk, bounds = self._star_walk
        chosen = np.flatnonzero(self.is_boundary_vertex == boundary)
        counts = np.diff(bounds)[chosen]
        groups = []
        for k in np.unique(counts):
            vertices = chosen[counts == k]
            corners = walk[bounds[vertices][:, None] + np.arange(k)]
            neighbors = self.indices[self.corner_next[corners]]
            if boundary:
                neighbors = np.column_stack([neighbors, self._previous_vertex(corners[:, -1])])
            groups.append(Stars(vertices, neighbors, self.corner_faces[corners]))
        return groups

    def _previous_vertex(self, corners: Indices) -> Indices:
        """Vertex before each given corner in its face."""
        faces = self.corner_faces[corners]
        first = corners == self.offsets[faces]
        before = np.where(first, self.offsets[faces + 1] - 1, corners - 1)
        return np.asarray(self.indices[before])

    @cached_property
    def irregular_vertices(self) -> Indices:
        """Interior vertices of valence other than 4."""
        return read_only(np.flatnonzero(~self.is_boundary_vertex & (self.valence != 4)), np.int64)

    # --- chains -----------------------------------------------------------------------------

    @cached_property
    def boundary_loops(self) -> list[Indices]:
        """Closed vertex cycles of the boundary, each with the mesh on its left."""
        on_boundary = self.is_boundary_edge[self.face_edges]
        tails = self.indices[on_boundary]
        heads = self.indices[self.corner_next[on_boundary]]
        follow = dict(zip(tails.tolist(), heads.tolist(), strict=True))
        loops = []
        while follow:
            start = min(follow)
            loop, vertex = [start], follow.pop(start)
            while vertex != start:
                loop.append(vertex)
                vertex = follow.pop(vertex)
            loops.append(np.array(loop, dtype=np.int64))
        return loops

    @cached_property
    def strips(self) -> list[Indices]:
        """Sequences of opposite edges across quads; a closed strip repeats its first edge."""
        sides = self.face_edges[: 4 * len(self.quads)].reshape(-1, 4)
        opposite: list[list[int]] = [[] for _ in range(self.n_edges)]
        for i in range(4):
            for a, b in zip(sides[:, i].tolist(), sides[:, (i + 2) % 4].tolist(), strict=True):
                opposite[a].append(b)
        return _chains(opposite, self.is_boundary_edge)

    @cached_property
    def polylines(self) -> list[Indices]:
        """Mesh polylines: vertex sequences that go straight through regular vertices.

        A polyline ends at the boundary and at irregular vertices; a closed one repeats its
        first vertex. Boundary polylines run along the boundary between its corners (vertices
        of valence 2) and re-entrant corners.
        """
        straight = self._straight_pairs
        tails = np.concatenate([self.edges[:, 0], self.edges[:, 1]])
        heads = np.concatenate([self.edges[:, 1], self.edges[:, 0]])
        known = {(a, b) for a, b in zip(tails.tolist(), heads.tolist(), strict=True)}
        entered = set(straight.values())
        chains: list[Indices] = []
        openings = sorted(known - entered)
        for edge in openings + sorted(known):
            if edge not in known:
                continue
            chain, current = [edge[0], edge[1]], edge
            known.discard(edge)
            known.discard(edge[::-1])
            while current in straight and straight[current] in known:
                current = straight[current]
                known.discard(current)
                known.discard(current[::-1])
                chain.append(current[1])
            chains.append(np.array(chain, dtype=np.int64))
        return chains

    @cached_property
    def polyline_of_edge(self) -> Indices:
        """Mesh polyline of each edge, by its place in `polylines`, shape (E,)."""
        lines, size = self.polylines, np.int64(self.n_vertices)
        tails = np.concatenate([line[:-1] for line in lines])
        heads = np.concatenate([line[1:] for line in lines])
        keys = np.minimum(tails, heads) * size + np.maximum(tails, heads)
        owner = np.repeat(np.arange(len(lines)), [len(line) - 1 for line in lines])
        order = np.argsort(keys)
        edges = self.edges[:, 0] * size + self.edges[:, 1]
        return read_only(owner[order[np.searchsorted(keys[order], edges)]], np.int64)

    @cached_property
    def _straight_pairs(self) -> dict[tuple[int, int], tuple[int, int]]:
        """Directed edge into a regular vertex -> the directed edge straight out of it."""
        pairs: dict[tuple[int, int], tuple[int, int]] = {}
        for a, v, b in self.straight_triples.tolist():
            pairs[a, v] = (v, b)
            pairs[b, v] = (v, a)
        return pairs

    @cached_property
    def straight_triples(self) -> Indices:
        """Vertices (before, middle, after) of every straight passage, shape (T, 3).

        Two passages at an interior vertex of valence 4, one along the boundary at a boundary
        vertex of valence 3.
        """
        triples = [np.empty((0, 3), dtype=np.int64)]
        for star in self.stars():
            if star.neighbors.shape[1] == 4:
                n = star.neighbors
                triples.append(np.stack([n[:, 0], star.vertices, n[:, 2]], axis=1))
                triples.append(np.stack([n[:, 1], star.vertices, n[:, 3]], axis=1))
        for star in self.stars(boundary=True):
            if star.neighbors.shape[1] == 3:
                n = star.neighbors
                triples.append(np.stack([n[:, 0], star.vertices, n[:, 2]], axis=1))
        return read_only(np.concatenate(triples), np.int64)

    # --- checks at the door -----------------------------------------------------------------

    def _check_faces(self) -> None:
        if self.n_faces == 0:
            raise MeshError("A mesh must have at least one face; found none. Add faces.")
        short = np.flatnonzero(self.face_sizes < 3)
        if len(short):
            raise MeshError(
                f"A face must have at least 3 corners; face {short[0]} has "
                f"{self.face_sizes[short[0]]}. Remove or mend it."
            )
        wrong = np.flatnonzero((self.indices < 0) | (self.indices >= self.n_vertices))
        if len(wrong):
            raise MeshError(
                f"Faces must index vertices 0..{self.n_vertices - 1}; face "
                f"{self.corner_faces[wrong[0]]} has vertex {self.indices[wrong[0]]}. "
                f"Re-index the faces, or drop the bad ones."
            )
        keys = self.corner_faces * self.n_vertices + self.indices
        values, counts = np.unique(keys, return_counts=True)
        if (counts > 1).any():
            face, vertex = divmod(int(values[counts > 1][0]), self.n_vertices)
            raise MeshError(
                f"A face must not repeat a vertex; face {face} has vertex {vertex} twice. "
                f"Remove the repeated corner or the face."
            )

    def _check_edges(self) -> None:
        tail, head = self.indices, self.indices[self.corner_next]
        edges, of_corner, _ = self._edge_table
        counts = np.bincount(of_corner)
        if (counts > 2).any():
            edge = int(np.flatnonzero(counts > 2)[0])
            a, b = edges[edge]
            raise MeshError(
                f"An edge must have at most two faces; edge {a}-{b} has {counts[edge]} "
                f"({int((counts > 2).sum())} such edges). Split the mesh into manifold pieces."
            )
        keys, counts = np.unique(tail * self.n_vertices + head, return_counts=True)
        if (counts > 1).any():
            a, b = divmod(int(keys[counts > 1][0]), self.n_vertices)
            first, second = self.corner_faces[(tail == a) & (head == b)][:2]
            raise MeshError(
                f"Faces must be coherently oriented; faces {first} and {second} both run along "
                f"edge {a}-{b} from {a} to {b} ({int((counts > 1).sum())} such edges). Reverse "
                f"one of them, or unify the normals in the modelling program."
            )

    def _check_vertices(self) -> None:
        unused = np.setdiff1d(np.arange(self.n_vertices), self.indices)
        if len(unused):
            raise MeshError(
                f"Every vertex must belong to a face; vertex {unused[0]} has none "
                f"({len(unused)} such vertices). Remove unused vertices."
            )
        walk, _ = self._star_walk
        if (walk < 0).any():
            counts = np.bincount(self.indices)
            reached = np.bincount(self.indices[walk[walk >= 0]], minlength=self.n_vertices)
            vertex = int(np.flatnonzero(reached < counts)[0])
            raise MeshError(
                f"The faces at a vertex must form one fan; at vertex {vertex} they form several. "
                f"Duplicate the vertex, one for each fan."
            )


def drop_unused(faces: list[list[int]], n_vertices: int) -> tuple[list[list[int]], Indices]:
    """Faces re-indexed over the vertices they use, and those vertices in rising order."""
    used = np.unique(np.concatenate([np.asarray(face, dtype=np.int64) for face in faces]))
    place = np.full(n_vertices, -1, dtype=np.int64)
    place[used] = np.arange(len(used))
    return [place[np.asarray(face)].tolist() for face in faces], used


def _flat_faces(faces: Faces) -> tuple[Indices, Indices]:
    """Offsets and concatenated corners of a face list or array."""
    if isinstance(faces, np.ndarray) and faces.ndim == 2:
        if not np.issubdtype(faces.dtype, np.integer):
            raise MeshError(f"Face indices must be integers; found {faces.dtype}. Convert them.")
        count, size = faces.shape
        return np.arange(count + 1, dtype=np.int64) * size, faces.astype(np.int64).ravel()
    rows = [np.asarray(face) for face in faces]  # type: ignore[union-attr]
    for number, row in enumerate(rows):
        if row.ndim != 1 or (row.size and not np.issubdtype(row.dtype, np.integer)):
            raise MeshError(
                f"A face must be a list of vertex numbers; face {number} is {row!r}. Mend it."
            )
    sizes = [len(row) for row in rows]
    offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    flat = np.concatenate(rows).astype(np.int64) if rows else np.empty(0, dtype=np.int64)
    return offsets, flat


def _chains(neighbors: list[list[int]], is_end: Mask) -> list[Indices]:
    """Walks of a graph whose nodes have at most two neighbours; ends first, then cycles."""
    seen = np.zeros(len(neighbors), dtype=np.bool_)
    chains: list[Indices] = []
    for start in [*np.flatnonzero(is_end).tolist(), *range(len(neighbors))]:
        if seen[start] or not neighbors[start]:
            continue
        chain, current = [start], start
        seen[start] = True
        while True:
            fresh = [n for n in neighbors[current] if not seen[n]]
            if not fresh:
                break
            current = fresh[0]
            seen[current] = True
            chain.append(current)
        if len(chain) > 2 and start in neighbors[current] and not is_end[start]:
            chain.append(start)
        chains.append(np.array(chain, dtype=np.int64))
    return chains
