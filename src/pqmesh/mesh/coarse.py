"""Coarser meshes by leaving out every second line, and smooth interpolation back.

A line is a mesh polyline that runs between two boundary vertices, or closes, through regular
vertices only. Leaving out lines no two of which bound the same strip merges strips in pairs. The
vertices are then of three sorts, by how many of the lines through them are left out: corners of
the coarser mesh, points on its edges, and centres of its faces.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, Indices, Mask

CORNER, ON_EDGE, CENTER = 0, 1, 2
# A closed row has at least so many faces.
FEWEST_IN_RING = 3


class Coarse(NamedTuple):
    """A coarser mesh, and how to go back.

    Attributes
    ----------
    mesh : QuadMesh
    kept : (n,)
        Fine vertices that are the coarse ones, in the order of the coarse mesh.
    prolongation : sparse (V, n)
        Interpolation of values at coarse vertices to all fine ones, by cubics in the number of
        the line, and by parabolas or straight where lines end.
    """

    mesh: QuadMesh
    kept: Indices
    prolongation: csr_array


def coarsened(mesh: QuadMesh) -> Coarse | None:
    """The mesh without every second line, None where no line can be left out.

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_faces
    >>> x, y = np.meshgrid(np.arange(5.0), np.arange(8.0), indexing="ij")
    >>> points = np.stack([x, y, x * x - y], axis=-1).reshape(-1, 3)
    >>> coarse = coarsened(QuadMesh.of(points, grid_faces(4, 7)))
    >>> coarse.mesh.topology.n_faces
    8
    >>> bool(np.abs(coarse.prolongation @ coarse.mesh.vertices - points).max() < 1e-12)
    True

    References: coarse to fine for planar quads [liu2006]; interpolation by cubics [dyn1987].
    """
    topology = mesh.topology
    left_out = _left_out(topology)
    if not left_out.any():
        return None
    sorts = _sorts(topology, left_out)
    kept = np.flatnonzero(sorts == CORNER)
    number = np.full(topology.n_vertices, -1)
    number[kept] = np.arange(len(kept))
    faces = number[_merged_faces(topology, left_out, sorts)]
    coarse = QuadMesh(mesh.vertices[kept], Topology(faces, len(kept)))
    corners = coo_array(
        (np.ones(len(kept)), (kept, np.arange(len(kept)))), shape=(topology.n_vertices, len(kept))
    ).tocsr()
    # First the points on edges, from the corners beside them; then the centres, from those.
    outlined = corners + _between(topology, sorts, ON_EDGE, CORNER) @ corners
    return Coarse(coarse, kept, outlined + _between(topology, sorts, CENTER, ON_EDGE) @ outlined)


def _left_out(topology: Topology) -> Mask:
    """Edges (E,) on the lines that are left out."""
    lines = topology.polylines
    line_of = topology.polyline_of_edge
    beside = _lines_beside(topology, line_of, len(lines))
    boundary = topology.is_boundary_vertex
    may_go = np.ones(len(lines), dtype=np.bool_)
    may_go[line_of[topology.is_boundary_edge]] = False
    for index, line in enumerate(lines):
        ends, closed = line[[0, -1]], line[0] == line[-1]
        met = line[:-1] if closed else line
        regular = topology.valence[ends] == np.where(boundary[ends], 3, 4)
        whole = regular.all() and (closed or boundary[ends].all())
        may_go[index] &= whole and len(np.unique(met)) == len(met) and index not in beside[index]
    gone = np.zeros(len(lines), dtype=np.bool_)
    for index in _from_outside(may_go, beside):
        gone[index] = may_go[index] and not any(gone[other] for other in beside[index])
    # A closed row of fewer than three faces would be no mesh: all of its lines stay.
    crossings = np.unique(np.column_stack([topology.edges.ravel(), np.repeat(line_of, 2)]), axis=0)
    for index, line in enumerate(lines):
        if line[0] == line[-1] and not gone[index]:
            across = crossings[np.isin(crossings[:, 0], line) & (crossings[:, 1] != index), 1]
            if np.count_nonzero(~gone[across]) < FEWEST_IN_RING:
                gone[across] = False
    return np.asarray(gone[line_of])


def _lines_beside(topology: Topology, line_of: Indices, count: int) -> list[list[int]]:
    """Lines that bound a strip together with each line."""
    sides = line_of[topology.face_edges.reshape(-1, 4)]
    pairs = np.concatenate([sides[:, [0, 2]], sides[:, [1, 3]]])
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    beside: list[list[int]] = [[] for _ in range(count)]
    for line, other in pairs.tolist():
        beside[line].append(other)
    return beside


def _from_outside(may_go: Mask, beside: list[list[int]]) -> list[int]:
    """Lines in the order of their distance from those that must stay."""
    seen = ~may_go
    queue = deque(np.flatnonzero(seen).tolist())
    order: list[int] = []
    for start in range(len(beside)):
        if not queue and not seen[start]:
            # A family of closed lines without a border: its first line stays.
            seen[start] = True
            queue.extend(other for other in beside[start] if not seen[other])
            seen[beside[start]] = True
            order += list(queue)
        while queue:
            for other in beside[queue.popleft()]:
                if not seen[other]:
                    seen[other] = True
                    order.append(other)
                    queue.append(other)
    return order


def _sorts(topology: Topology, left_out: Mask) -> Indices:
    """Number of lines left out through each vertex, shape (V,)."""
    ends = np.bincount(topology.edges[left_out].ravel(), minlength=topology.n_vertices)
    # A line has two edges at a vertex, one where it ends.
    return np.asarray((ends + 1) // 2)


def _merged_faces(topology: Topology, left_out: Mask, sorts: Indices) -> Indices:
    """Fine corners (n, 4) of the coarse faces."""
    quads = topology.quads
    whole = quads[(sorts[quads] == CORNER).all(axis=1)]
    # Four faces about a centre.
    stars = [star for star in topology.stars() if star.faces.shape[1] == 4]
    fours = np.empty((0, 4), dtype=np.int64)
    for star in stars:
        around = quads[star.faces[sorts[star.vertices] == CENTER]]
        at = (sorts[around] == CORNER).argmax(axis=2)
        fours = np.take_along_axis(around, at[:, :, None], axis=2)[:, :, 0]
    # Two faces on either side of an edge between points on edges.
    rows = np.flatnonzero(left_out & (sorts[topology.edges] == ON_EDGE).all(axis=1))
    pairs = topology.edge_faces[rows]
    halves = []
    for side in (0, 1):
        corners = quads[pairs[:, side]]
        is_corner = sorts[corners] == CORNER
        # The first of the two neighbouring corners, in the order of the face.
        first = (is_corner & ~np.roll(is_corner, 1, axis=1)).argmax(axis=1)
        row = np.arange(len(rows))
        halves += [corners[row, first], corners[row, (first + 1) % 4]]
    twos = np.stack(halves, axis=1)
    return np.concatenate([whole, twos, fours])


def _between(topology: Topology, sorts: Indices, target: int, source: int) -> csr_array:
    """Interpolation (V, V) to the vertices of a sort from those of another on their lines."""
    size = topology.n_vertices
    triples = topology.straight_triples
    left, middle, right = triples[
        (sorts[triples[:, 1]] == target)
        & (sorts[triples[:, 0]] == source)
        & (sorts[triples[:, 2]] == source)
    ].T
    before = _next_of_sort(topology, sorts, middle, left)
    ahead = _next_of_sort(topology, sorts, middle, right)
    places = np.stack(
        [-1.0 - before.steps, np.full(len(middle), -1.0), np.ones(len(middle)), 1.0 + ahead.steps]
    )
    sources = np.stack([before.vertices, left, right, ahead.vertices])
    shares = _lagrange_at_zero(places, sources >= 0) / np.bincount(middle, minlength=size)[middle]
    known = sources >= 0
    rows = np.broadcast_to(middle, sources.shape)[known]
    return coo_array((shares[known], (rows, sources[known])), shape=(size, size)).tocsr()


class _Next(NamedTuple):
    """The next vertices (n,) on lines, -1 where there is none, and how many edges on."""

    vertices: Indices
    steps: Floats


def _next_of_sort(topology: Topology, sorts: Indices, tail: Indices, head: Indices) -> _Next:
    """The next vertex, one or two edges straight on, that is of the sort of the head."""
    size = np.int64(topology.n_vertices)
    triples = np.concatenate([topology.straight_triples, topology.straight_triples[:, ::-1]])
    keys = triples[:, 0] * size + triples[:, 1]
    order = np.argsort(keys)
    keys, thirds = keys[order], triples[order, 2]

    def onward(tail: Indices, head: Indices) -> Indices:
        key = tail * size + head
        at = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
        return np.where((keys[at] == key) & (tail >= 0) & (head >= 0), thirds[at], -1)

    first = onward(tail, head)
    second = onward(head, first)
    same = (first >= 0) & (sorts[first] == sorts[head])
    further = ~same & (second >= 0) & (sorts[second] == sorts[head])
    vertices = np.where(same, first, np.where(further, second, -1))
    return _Next(vertices, np.where(same, 1.0, 2.0))


def _lagrange_at_zero(places: Floats, known: Mask) -> Floats:
    """Weights (k, n) at 0 of the polynomials through the known places (k, n)."""
    weights = known.astype(np.float64)
    for i in range(len(places)):
        for j in range(len(places)):
            if i != j:
                factor = places[j] / (places[j] - places[i])
                weights[i] *= np.where(known[j], factor, 1.0)
    return weights
