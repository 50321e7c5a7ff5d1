"""Whether two abstract meshes are the same up to the numbering of vertices and faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Indices, Mask

# Colour rounds stop here: more rounds only narrow the candidates, never decide.
COLOR_ROUNDS = 6
# A colour worn by no more corners than this is rare enough to start from.
FEW = 4


def isomorphism(a: Topology, b: Topology, *, reversed_orientation: bool = False) -> Indices | None:
    """Vertex of b for each vertex of a, shape (V,), or None when the meshes differ.

    The map carries every face of a to a face of b as an oriented cycle. Orientation counts:
    a mesh and its mirror image are different unless the mesh has a symmetry that reverses it.
    Several maps may exist; the same input gives the same one.

    Parameters
    ----------
    a, b : Topology
        Connected or not, with faces of any length.
    reversed_orientation : bool
        Also accept a map that turns over all faces of a; one that keeps them is preferred.

    References: [thesis] section 2.1 (combinatorial equivalence).

    Examples
    --------
    >>> strip = Topology([[0, 1, 2, 3], [3, 2, 4, 5]], 6)
    >>> isomorphism(strip, Topology([[5, 4, 1, 0], [0, 1, 2, 3]], 6)).tolist()
    [5, 4, 1, 0, 2, 3]
    """
    found = _oriented(a, b)
    if found is None and reversed_orientation:
        turned = Topology([face[::-1] for face in b.face_lists()], b.n_vertices)
        found = _oriented(a, turned)
    return found


@dataclass(frozen=True, eq=False)
class _Corners:
    """A mesh as corners with two moves: along the face, and over the edge (-1 outside)."""

    follow: Indices
    twin: Indices
    piece: Indices
    color: Indices

    @classmethod
    def of(cls, mesh: Topology) -> _Corners:
        """Corners coloured by face size, valence, boundary and size of the connected piece."""
        order = np.argsort(mesh.face_edges, kind="stable")
        edge = mesh.face_edges[order]
        pair = np.flatnonzero(edge[1:] == edge[:-1])
        twin = np.full(len(order), -1, dtype=np.int64)
        twin[order[pair]], twin[order[pair + 1]] = order[pair + 1], order[pair]
        piece = mesh.components[mesh.corner_faces]
        traits = [
            mesh.face_sizes[mesh.corner_faces],
            mesh.valence[mesh.indices],
            mesh.is_boundary_vertex[mesh.indices],
            np.bincount(piece)[piece],
        ]
        return cls(mesh.corner_next, twin, piece, np.stack(traits, axis=1).astype(np.int64))


def _oriented(a: Topology, b: Topology) -> Indices | None:
    """Orientation-preserving map of the vertices, or None."""
    counts = [(m.n_vertices, m.n_edges, m.n_faces, len(m.indices)) for m in (a, b)]
    if counts[0] != counts[1]:
        return None
    first, second = _Corners.of(a), _Corners.of(b)
    colors = _refined(first, second)
    if colors is None:
        return None
    worn = np.bincount(colors[0])
    images = np.full(len(a.indices), -1, dtype=np.int64)
    free = np.ones(len(b.indices), dtype=np.bool_)
    for piece in range(int(first.piece.max()) + 1):
        members = np.flatnonzero(first.piece == piece)
        seed = int(members[np.argmin(worn[colors[0][members]])])
        candidates = np.flatnonzero((colors[1] == colors[0][seed]) & free)
        found = _search(first, seed, second, candidates)
        # Being isomorphic is transitive: whichever equal piece is taken, the rest still fits.
        if found is None:
            return None
        images[members] = found[members]
        free[found[members]] = False
    vertices = np.empty(a.n_vertices, dtype=np.int64)
    vertices[a.indices] = b.indices[images]
    return vertices


def _refined(first: _Corners, second: _Corners) -> tuple[Indices, Indices] | None:
    """Colours that every isomorphism keeps, or None when the two meshes wear different ones."""
    split = len(first.follow)
    follow = np.concatenate([first.follow, second.follow + split])
    twin = np.concatenate([first.twin, np.where(second.twin < 0, -1, second.twin + split)])
    table = np.concatenate([first.color, second.color])
    n_colors = 0
    for _ in range(COLOR_ROUNDS):
        _, colors = np.unique(table, axis=0, return_inverse=True)
        colors = colors.reshape(-1)
        size = int(colors.max()) + 1
        worn = np.bincount(colors[:split], minlength=size)
        if (worn != np.bincount(colors[split:], minlength=size)).any():
            return None
        if size == n_colors or worn.min() <= FEW:
            break
        n_colors = size
        across = np.where(twin < 0, -1, colors[twin])
        table = np.stack([colors, colors[follow], across], axis=1)
    return colors[:split], colors[split:]


def _search(first: _Corners, seed: int, second: _Corners, candidates: Indices) -> Indices | None:
    """Map of the seed's piece whose image of the seed is a candidate.

    A failed candidate rules out all that symmetries of its own piece carry it to; without
    that, two torus grids of equal size would take a full pass for every corner.
    """
    hopeless = np.zeros(len(second.follow), dtype=np.bool_)
    failed: dict[int, int] = {}
    symmetries: list[Indices] = []
    for candidate in candidates.tolist():
        if hopeless[candidate]:
            continue
        found = _propagated(first, seed, second, candidate)
        if found is not None:
            return found
        hopeless[candidate] = True
        earlier = failed.setdefault(int(second.piece[candidate]), candidate)
        if earlier != candidate:
            symmetry = _propagated(second, earlier, second, candidate)
            if symmetry is not None:
                symmetries.append(symmetry)
        hopeless = _spread(hopeless, symmetries)
    return None


def _spread(marked: Mask, symmetries: list[Indices]) -> Mask:
    """The mask, made constant along the orbits of the symmetries."""
    if not symmetries:
        return marked
    n = len(marked)
    moved = [np.flatnonzero(symmetry >= 0) for symmetry in symmetries]
    tails = np.concatenate(moved)
    heads = np.concatenate([s[m] for s, m in zip(symmetries, moved, strict=True)])
    graph = coo_array((np.ones(len(tails)), (tails, heads)), shape=(n, n))
    count, orbit = connected_components(graph, directed=False)
    hit = np.zeros(count, dtype=np.bool_)
    hit[orbit[marked]] = True
    return np.asarray(hit[orbit])


def _propagated(first: _Corners, seed: int, second: _Corners, image: int) -> Indices | None:
    """The only map of the seed's piece with seed -> image, -1 elsewhere; None when it fails.

    Pieces of equal size: a map that respects both moves is then one to one.
    """
    images = np.full(len(first.follow), -1, dtype=np.int64)
    images[seed] = image
    front = np.array([seed], dtype=np.int64)
    while len(front):
        across = first.twin[front]
        across_image = second.twin[images[front]]
        outside = across < 0
        if (outside != (across_image < 0)).any():
            return None
        source = np.concatenate([first.follow[front], across[~outside]])
        target = np.concatenate([second.follow[images[front]], across_image[~outside]])
        fresh = source[images[source] < 0]
        images[source] = np.where(images[source] < 0, target, images[source])
        if (images[source] != target).any():
            return None
        front = np.unique(fresh)
    return images
