"""P(M), the linear space of all meshes parallel to a mesh: its dimension, gap and bases.

A parallel mesh multiplies every edge by a factor, e' = f e. The factors close around every face,
and around the loops that faces do not fill; the vertices follow by adding up edges, but for a
translation of each piece. So the unknowns are the E factors, and P(M) is the null space of a
sparse matrix with three rows a face, three a loop, plus three translations a piece.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import qr
from scipy.sparse import coo_array

from pqmesh.errors import MeshError
from pqmesh.linear import SymmetricPattern
from pqmesh.mesh.loops import SpanningForest, open_loops, spanning_forest
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Topology
from pqmesh.spectrum import LowSpectrum, low_spectrum, orthonormal
from pqmesh.vectors import Floats, Indices, dot, read_only

# Edges below this share of the mean have no direction.
ZERO_EDGE = 1e-9
# Singular values up to so many times the planarity may be zeros of a flat mesh, and at least
# those up to rounding.
ZERO_BAND, ZERO_FLOOR = 10.0, 1e-9
# Beyond this planarity the band would reach values that are not zero on flat meshes either.
LARGEST_PLANARITY = 5e-3
# Faces that are all further from flat than this are not meant to be flat.
NEVER_PLANAR = 1e-3
# The next singular value must be this many times larger than the last zero.
SMALLEST_GAP = 30.0
# Rounding of singular values, which are of order 1: no zero counts as smaller.
ROUNDING = 1e-13
# Of seeds of a local basis: a member then has few digits less than its coefficients.
WELL_CONDITIONED = 100.0
# Sums along the tree that close to this share of the mesh need no correction.
CLOSED = 1e-12
# Edges whose gaps are looked at together.
FEW = 256


@dataclass(frozen=True, eq=False)
class ParallelSpace:
    """P(M): all meshes whose edges are multiples of those of a mesh, zero and negative included.

    Attributes
    ----------
    mesh : PolyMesh
        M, without zero edges.
    factors : (E, k)
        Orthonormal basis of the edge factors: column c stands for the mesh with edges f e.
    zero, next : float
        Largest singular value that counts as zero, and the smallest that does not. They measure
        by how much faces and loops fail to close, for factors and edges of size 1.
    forest : SpanningForest
    """

    mesh: PolyMesh
    factors: Floats
    zero: float
    next: float
    forest: SpanningForest

    @property
    def dimension(self) -> int:
        """Dimension of P(M), translations included; at least 4."""
        return int(self.factors.shape[1]) + 3 * len(self.forest.roots)

    @property
    def gap(self) -> float:
        """Ratio of the singular values that decided the dimension; above 1e7 for exact meshes."""
        return self.next / max(self.zero, ROUNDING)

    @cached_property
    def basis(self) -> Floats:
        """Orthonormal basis of P(M) in vertex coordinates, shape (3V, dimension).

        Row 3 i + c is coordinate c of vertex i. The first columns are the translations, three a
        piece; the others keep the mean of each piece at the origin.
        """
        pieces, count = self.forest.pieces, len(self.forest.roots)
        shifts = np.zeros((len(pieces), 3, count, 3))
        size = np.sqrt(np.bincount(pieces))
        for axis in range(3):
            shifts[np.arange(len(pieces)), axis, pieces, axis] = 1.0 / size[pieces]
        positions = self.positions(self.factors)
        columns = positions.reshape(3 * len(pieces), -1)
        return read_only(np.column_stack([shifts.reshape(len(columns), -1), orthonormal(columns)]))

    def positions(self, factors: Floats) -> Floats:
        """Vertices with edges f e, the mean of each piece at the origin.

        Parameters
        ----------
        factors : (E,) or (E, c)

        Returns
        -------
        (V, 3) or (V, 3, c), model unit
            The least-squares solution where the factors do not close exactly.
        """
        columns = np.asarray(factors, dtype=np.float64).reshape(len(factors), -1)
        edges = self.mesh.edge_vectors[:, :, None] * columns[:, None, :]
        points = _integrated(self.mesh.topology, self.forest, edges)
        means = np.zeros((len(self.forest.roots), *points.shape[1:]))
        np.add.at(means, self.forest.pieces, points)
        means /= np.bincount(self.forest.pieces)[:, None, None]
        points -= means[self.forest.pieces]
        return points[:, :, 0] if np.ndim(factors) == 1 else points

    def member(self, coordinates: Floats) -> PolyMesh:
        """The parallel mesh with these coordinates (dimension,) in the orthonormal basis."""
        return self.mesh.with_vertices((self.basis @ coordinates).reshape(-1, 3))

    def coordinates(self, vertices: Floats) -> Floats:
        """Coordinates (dimension,) of the member of P(M) nearest to the vertices (V, 3)."""
        return np.asarray(self.basis.T @ np.asarray(vertices, dtype=np.float64).ravel())

    def edge_factors(self, member: PolyMesh) -> Floats:
        """Factors f of a parallel mesh, e' = f e, shape (E,)."""
        edges = self.mesh.edge_vectors
        return np.asarray(dot(member.edge_vectors, edges) / dot(edges, edges))

    @cached_property
    def local_factors(self) -> tuple[Any, Indices]:
        """Sparse basis of the edge factors, and the seed edges it belongs to.

        Returns
        -------
        sparse (E, k), and (k,) edges
            Column c has factor 1 on its seed and 0 on all other seeds. On a grid the seeds are
            the middle edges of the strips: a column then lives on one side of the middle lines
            and beyond its strip, a quarter of the edges. Where these seeds would make the basis
            ill-conditioned, pivoting chooses others. Entries below the largest zero, or 1e-12,
            are left out.

        Examples
        --------
        >>> from pqmesh.mesh.exact import translational_mesh
        >>> roof = translational_mesh([[0, 0, 0], [1, 0, 1], [2, 0, 1]], [[0, 0, 0], [0, 1, 0.5]])
        >>> parallel_space(roof).local_factors[0].toarray().sum(axis=0)
        array([3., 2., 2.])
        """
        seeds = self._middle_edges()
        if seeds is None or np.linalg.cond(self.factors[seeds]) > WELL_CONDITIONED:
            order = qr(self.factors.T, mode="economic", pivoting=True)[2]
            seeds = np.sort(order[: self.factors.shape[1]]).astype(np.int64)
        local = np.linalg.solve(self.factors[seeds].T, self.factors.T).T
        local[np.abs(local) < max(self.zero, 1e-12)] = 0.0
        return coo_array(local).tocsc(), seeds

    def _middle_edges(self) -> Indices | None:
        """Middle edge of each open strip when there are as many as unknowns."""
        topology = self.mesh.topology
        if not topology.is_quad:
            return None
        strips = [strip for strip in topology.strips if topology.is_boundary_edge[strip[0]]]
        if len(strips) != self.factors.shape[1]:
            return None
        return np.array([strip[len(strip) // 2] for strip in strips], dtype=np.int64)


def parallel_space(mesh: PolyMesh) -> ParallelSpace:
    """P(M) of a mesh of any topology.

    Parameters
    ----------
    mesh : PolyMesh
        Without zero edges. Faces either flat, or none of them flat.

    Raises
    ------
    MeshError
        When an edge has no length; or when the faces are too far from flat, yet not all far
        from it, so that no gap of the singular values tells which of them are zero.

    References: [thesis] proposition 2.2.1; errata page, E5 and E6; [pottmann2007].

    Examples
    --------
    >>> from pqmesh.mesh.exact import translational_mesh
    >>> roof = translational_mesh([[0, 0, 0], [1, 0, 1], [2, 0, 1]], [[0, 0, 0], [0, 1, 0.5]])
    >>> parallel_space(roof).dimension
    6
    """
    check_edges(mesh)
    flatness = planarity(mesh)
    is_bent = float(flatness.min()) > NEVER_PLANAR
    worst = 0.0 if is_bent else float(flatness.max())
    if worst > LARGEST_PLANARITY:
        raise _undecided(flatness, f"It must be below {LARGEST_PLANARITY:g} for a decision.")
    topology = mesh.topology
    forest = spanning_forest(topology)
    band = max(ZERO_BAND * worst, ZERO_FLOOR)
    expected = max(topology.n_edges - 2 * topology.n_faces, 1)
    spectrum = low_spectrum(closing_matrix(mesh, forest), band, expected)
    rank, ratio = _widest_gap(spectrum, band, max(worst, ROUNDING))
    if ratio < SMALLEST_GAP:
        raise _undecided(
            flatness,
            f"The singular values then rise without a gap: by a factor of {ratio:.3g} at most, "
            f"where {SMALLEST_GAP:g} is needed.",
        )
    vectors = read_only(spectrum.vectors[:, :rank])
    return ParallelSpace(
        mesh, vectors, float(spectrum.values[rank - 1]), float(spectrum.values[rank]), forest
    )


def generic_dimension(topology: Topology) -> int:
    """Dimension of P(M) for planar faces in general position, whatever their topology.

    Each face takes two of the E factors, each open loop three; on a closed piece three of these
    equations follow from the others. Symmetric meshes may have more.

    References: [thesis] section 2.2; theory: [pottmann2007].

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_faces
    >>> generic_dimension(Topology(grid_faces(3, 5), 24))
    11
    """
    forest = spanning_forest(topology)
    pieces = len(forest.roots)
    is_closed = np.ones(pieces, dtype=np.bool_)
    is_closed[forest.pieces[topology.is_boundary_vertex]] = False
    free = topology.n_edges - 2 * topology.n_faces + 3 * int(is_closed.sum())
    return 3 * pieces + max(free - 3 * len(open_loops(topology, forest)), pieces)


def closing_matrix(mesh: PolyMesh, forest: SpanningForest) -> Any:
    """Sparse matrix (3F + 3 loops, E) whose null space are the edge factors of P(M).

    Rows of a face are divided by the size of its edges, those of a loop also by the root of its
    length, so that all singular values are without dimension.
    """
    topology = mesh.topology
    signs = np.where(topology.indices == topology.edges[topology.face_edges, 0], 1.0, -1.0)
    walks = [(topology.corner_faces, topology.face_edges, signs)]
    for number, loop in enumerate(open_loops(topology, forest), topology.n_faces):
        walks.append((np.full(len(loop.edges), number), loop.edges, loop.signs))
    walk, edge, sign = (np.concatenate(part) for part in zip(*walks, strict=True))
    square = np.bincount(walk, mesh.edge_lengths[edge] ** 2)
    count = np.bincount(walk)
    is_loop = np.arange(len(count)) >= topology.n_faces
    size = np.sqrt(square / np.where(is_loop, 4.0, count))
    values = (sign / size[walk])[:, None] * mesh.edge_vectors[edge]
    rows = 3 * walk[:, None] + np.arange(3)
    shape = (3 * len(count), topology.n_edges)
    return coo_array((values.ravel(), (rows.ravel(), np.repeat(edge, 3))), shape=shape).tocsr()


def check_edges(mesh: PolyMesh) -> None:
    """Refuse a mesh with an edge that has no direction."""
    short = np.flatnonzero(mesh.edge_lengths <= ZERO_EDGE * mesh.mean_edge_length)
    if len(short):
        a, b = mesh.edges[short[0]].tolist()
        raise MeshError(
            f"Edges must have length to be parallel to anything; edge {a}-{b} has "
            f"{mesh.edge_lengths[short[0]]:.3g} ({len(short)} such edges). Merge its ends, or move "
            f"one."
        )


def _widest_gap(spectrum: LowSpectrum, band: float, floor: float) -> tuple[int, float]:
    """Number of zeros, and ratio of the next value to the last: the widest gap in the band."""
    values = np.maximum(spectrum.values, floor)
    ratios = np.where(spectrum.values[:-1] <= band, values[1:] / values[:-1], 0.0)
    place = int(np.argmax(ratios))
    return place + 1, float(ratios[place])


def _undecided(flatness: Floats, reason: str) -> MeshError:
    """The refusal of a mesh that is neither flat nor bent enough."""
    worst = int(np.argmax(flatness))
    return MeshError(
        f"Faces must be planar to decide which meshes are parallel; the planarity of face {worst} "
        f"is {flatness[worst]:.2g}, the mean is {flatness.mean():.2g} (distance of the diagonals "
        f"over their mean length). {reason} Optimise the mesh to planar faces first."
    )


# --- from edges to vertices -------------------------------------------------------------------


def _integrated(topology: Topology, forest: SpanningForest, edges: Floats) -> Floats:
    """Vertices (V, 3, c) whose edge vectors come nearest to (E, 3, c); roots at the origin."""
    points = np.zeros((topology.n_vertices, *edges.shape[1:]))
    for level in forest.levels[1:]:
        before, edge = forest.parent[level], forest.parent_edge[level]
        sign = np.where(before < level, 1.0, -1.0)
        points[level] = points[before] + sign[:, None, None] * edges[edge]
    if _largest_gap(topology, forest, edges, points) > CLOSED * _largest(points):
        low, high = topology.edges.T
        points += _least_squares_step(topology, forest, edges - (points[high] - points[low]))
    return points


def _largest_gap(
    topology: Topology, forest: SpanningForest, edges: Floats, points: Floats
) -> float:
    """Largest coordinate missing between ends and edges, of the edges that are in no tree."""
    beside = np.ones(len(edges), dtype=np.bool_)
    beside[forest.parent_edge[forest.parent >= 0]] = False
    gap = 0.0
    # A few at a time: all of them for a large basis would be copied several times.
    rows = np.flatnonzero(beside)
    for part in np.split(rows, range(FEW, len(rows), FEW)):
        low, high = topology.edges[part].T
        gap = max(gap, _largest(edges[part] - (points[high] - points[low])))
    return gap


def _largest(values: Floats) -> float:
    """Largest absolute value."""
    return max(float(values.max(initial=0.0)), -float(values.min(initial=0.0)))


def _least_squares_step(topology: Topology, forest: SpanningForest, missing: Floats) -> Floats:
    """Vertex moves (V, 3, c) that take up what is missing on the edges, in least squares."""
    n, (low, high) = topology.n_vertices, topology.edges.T
    weight = np.ones(len(low))
    pattern = SymmetricPattern(
        np.concatenate([low, high, low, high, forest.roots]),
        np.concatenate([low, high, high, low, forest.roots]),
        n,
    )
    held = np.ones(len(forest.roots))
    factor = pattern.factor(
        pattern.values(np.concatenate([weight, weight, -weight, -weight, held]))
    )
    pull = np.zeros((n, *missing.shape[1:]))
    np.add.at(pull, high, missing)
    np.add.at(pull, low, -missing)
    flat = pull.reshape(n, -1)
    solved = [factor.solve(np.ascontiguousarray(column)) for column in flat.T]
    return np.column_stack(solved).reshape(pull.shape)
