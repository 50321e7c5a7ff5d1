"""Spanning trees of a mesh and the loops that its faces do not fill."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, Indices


class Loop(NamedTuple):
    """Closed walk along edges.

    Attributes
    ----------
    edges : (n,)
    signs : (n,)
        +1 where the walk runs from the lower to the higher vertex of the edge.
    """

    edges: Indices
    signs: Floats


@dataclass(frozen=True, eq=False)
class SpanningForest:
    """One breadth-first tree of edges for each connected piece.

    Attributes
    ----------
    roots : (pieces,)
        Lowest vertex of each piece.
    pieces : (V,)
        Piece of each vertex.
    levels : tuple of (n,)
        Vertices by their number of steps from the root, roots first.
    parent : (V,)
        Vertex before each vertex on its way from the root, -1 at roots.
    parent_edge : (V,)
        Edge to that vertex, -1 at roots.
    """

    roots: Indices
    pieces: Indices
    levels: tuple[Indices, ...]
    parent: Indices
    parent_edge: Indices

    def path(self, vertex: int) -> list[tuple[int, int, int]]:
        """Steps (from, to, edge) from a vertex to its root."""
        steps = []
        while self.parent[vertex] >= 0:
            before = int(self.parent[vertex])
            steps.append((vertex, before, int(self.parent_edge[vertex])))
            vertex = before
        return steps


def spanning_forest(topology: Topology) -> SpanningForest:
    """Breadth-first trees of the edges, one for each connected piece.

    Examples
    --------
    >>> forest = spanning_forest(Topology([[0, 1, 2, 3]], 4))
    >>> forest.parent.tolist(), len(forest.levels)
    ([-1, 0, 1, 0], 3)
    """
    n, edges = topology.n_vertices, topology.edges
    graph = coo_array((np.arange(1, len(edges) + 1), edges.T), shape=(n, n)).tocsr()
    pieces = connected_components(graph, directed=False)[1].astype(np.int64)
    roots = np.unique(pieces, return_index=True)[1].astype(np.int64)
    parent = np.full(n, -1, dtype=np.int64)
    depth = np.zeros(n, dtype=np.int64)
    for root in roots:
        order, before = breadth_first_order(graph, root, directed=False)
        parent[order[1:]] = before[order[1:]]
        for vertex in order[1:].tolist():
            depth[vertex] = depth[parent[vertex]] + 1
    parent_edge = np.full(n, -1, dtype=np.int64)
    child = np.flatnonzero(parent >= 0)
    keys = edges[:, 0] * n + edges[:, 1]
    low, high = np.minimum(child, parent[child]), np.maximum(child, parent[child])
    # Edges are sorted, so their keys are too.
    parent_edge[child] = np.searchsorted(keys, low * n + high)
    levels = tuple(np.flatnonzero(depth == level) for level in range(int(depth.max()) + 1))
    return SpanningForest(roots, pieces, levels, parent, parent_edge)


def open_loops(topology: Topology, forest: SpanningForest) -> list[Loop]:
    """Loops that, together with the boundaries of the faces, generate all closed walks.

    The boundary loops of each piece but its longest, and two for each handle: none on a disc or
    a sphere, one on an annulus, two on a torus. What adds up to zero around the faces and around
    these loops adds up to zero around every closed walk.

    References: tree and cotree decomposition [eppstein2003].

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_faces
    >>> torus = Topology(grid_faces(3, 4, closed=(True, True)), 12)
    >>> len(open_loops(torus, spanning_forest(torus)))
    2
    """
    rims = topology.boundary_loops
    sides = np.array(topology.edge_faces)
    edges = [_rim_edges(topology, rim) for rim in rims]
    # A lid on every rim makes the pieces closed: a node beyond each boundary loop.
    for number, rim in enumerate(edges):
        sides[rim] = np.where(sides[rim] < 0, topology.n_faces + number, sides[rim])
    left = np.ones(topology.n_edges, dtype=np.bool_)
    left[forest.parent_edge[forest.parent_edge >= 0]] = False
    candidates = np.flatnonzero(left)
    pairs = np.sort(sides[candidates], axis=1)
    # Of several edges between two faces one may be crossed, the others stay open.
    size = topology.n_faces + len(rims)
    _, first = np.unique(pairs[:, 0] * size + pairs[:, 1], return_index=True)
    graph = coo_array((candidates[first] + 1, pairs[first].T), shape=(size, size)).tocsr()
    left[minimum_spanning_tree(graph).data.astype(np.int64) - 1] = False
    longest: dict[int, int] = {}
    for number, rim in enumerate(rims):
        piece = int(forest.pieces[rim[0]])
        if piece not in longest or len(rim) > len(rims[longest[piece]]):
            longest[piece] = number
    inner = sorted(set(range(len(rims))) - set(longest.values()))
    walks = [Loop(edges[k], np.where(rims[k] < np.roll(rims[k], -1), 1.0, -1.0)) for k in inner]
    return walks + [_closed_walk(topology, forest, int(edge)) for edge in np.flatnonzero(left)]


def _rim_edges(topology: Topology, rim: Indices) -> Indices:
    """Edges from each vertex of a boundary loop to the next."""
    following = np.roll(rim, -1)
    n = topology.n_vertices
    keys = topology.edges[:, 0] * n + topology.edges[:, 1]
    # Edges are sorted, so their keys are too.
    return np.searchsorted(keys, np.minimum(rim, following) * n + np.maximum(rim, following))


def _closed_walk(topology: Topology, forest: SpanningForest, edge: int) -> Loop:
    """The edge, and the tree from its head back to its tail."""
    low, high = topology.edges[edge].tolist()
    out, back = forest.path(high), forest.path(low)
    while out and back and out[-1] == back[-1]:
        out.pop()
        back.pop()
    steps = [(low, high, edge), *out, *[(b, a, e) for a, b, e in reversed(back)]]
    numbers = np.array([e for _, _, e in steps], dtype=np.int64)
    return Loop(numbers, np.array([1.0 if a < b else -1.0 for a, b, _ in steps]))
