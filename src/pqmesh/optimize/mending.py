"""Mending: broken faces of a start mesh made valid by moving a few vertices, before it is solved.

A face is broken where it is folded, a dart, without area, or has a collapsed edge; and where it
lies on its back beside such a face. The vertices to blame are moved first: in each broken face the
one that stands out most from its neighbours; then all vertices of broken faces, then one ring and
two rings around them (`untangling`). What became valid without breaking another face is kept, the
rest is left and named.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Topology
from pqmesh.optimize.faults import (
    Surround,
    corners_of,
    faces_touching,
    faulty,
    surroundings,
    umbrella_means,
)
from pqmesh.optimize.guard import LEAST_SINE, Guard, least_sines
from pqmesh.optimize.untangling import untangled
from pqmesh.vectors import Floats, Indices, Mask, dot, norm

# Edges of a mended face have at least this share of its longest one.
LEAST_MENDED = 0.02


@dataclass(frozen=True, eq=False)
class Mending:
    """A mesh after mending.

    Attributes
    ----------
    mesh : PolyMesh
        The start itself where nothing was to be done, or could be.
    mended : (n,)
        Faces that were broken and are valid now.
    left : (m,)
        Faces that stay broken.
    moved : (k,)
        Vertices that were moved.
    moved_max : float, model unit
        The longest of these moves.
    """

    mesh: PolyMesh
    mended: Indices
    left: Indices
    moved: Indices
    moved_max: float

    @property
    def words(self) -> list[str]:
        """What a user should know of it, in sentences; none where every face was valid."""
        found = []
        if len(self.mended):
            found.append(
                f"{_counted(self.mended, 'face')} started broken (folded, without area, or with a "
                f"collapsed edge) and {'was' if len(self.mended) == 1 else 'were'} mended: "
                f"{_counted(self.moved, 'vertex', 'vertices')} moved by up to "
                f"{self.moved_max:.3g} before the optimisation"
            )
        if len(self.left):
            found.append(
                f"{_counted(self.left, 'face')} started broken (folded, without area, or with a "
                f"collapsed edge) and could not be mended: check the mesh there"
            )
        return found


def mended(mesh: PolyMesh, fixed: Mask | None = None) -> Mending:
    """The mesh with its broken faces made valid where that is possible; no valid face breaks.

    Parameters
    ----------
    mesh : PolyMesh
    fixed : (V,) bool, optional
        Vertices that must stay.

    Returns
    -------
    Mending
        A mesh that cannot be mended is no error: `left` names the faces.

    References: signed areas as in mesh untangling [knupp2001].

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_mesh
    >>> x, y = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    >>> flat = grid_mesh(np.stack([x, y, 0 * x], axis=-1))
    >>> folded = flat.vertices.copy()
    >>> folded[12] += [1.4, 1.2, 0.0]
    >>> found = mended(flat.with_vertices(folded))
    >>> found.mended.tolist(), found.left.tolist(), found.moved.tolist()
    ([6, 9, 10], [], [12])
    """
    free = np.ones(mesh.topology.n_vertices, dtype=np.bool_) if fixed is None else ~fixed
    start, fault = mesh, faulty(mesh)
    if not fault.any():
        none = np.empty(0, dtype=np.int64)
        return Mending(mesh, none, none, none, 0.0)
    surround = surroundings(mesh, fault)
    guard = Guard.of(mesh)
    # What is broken has no limits of its own; nor have its edges, which may be far too long.
    guard = replace(guard, least_sine=np.where(fault, -np.inf, guard.least_sine))
    open_faces = fault
    for level in range(4):
        movable = _movable(mesh, open_faces, level, surround) & free
        if not movable.any():
            continue
        moved = untangled(mesh, start, movable, fault, surround)
        mesh = _accepted(mesh, moved, movable, fault, open_faces, guard, surround.normals)
        open_faces = open_faces & _still_broken(mesh, open_faces, surround.normals)
        if not open_faces.any():
            break
    moves = norm(mesh.vertices - start.vertices)
    return Mending(
        mesh,
        np.flatnonzero(fault & ~open_faces),
        np.flatnonzero(open_faces),
        np.flatnonzero(moves > 0),
        float(moves.max()),
    )


# --- where vertices go ------------------------------------------------------------------------


def _movable(mesh: PolyMesh, faces: Mask, level: int, surround: Surround) -> Mask:
    """Vertices to move at a level: those to blame, those of the faces, and rings around."""
    topology = mesh.topology
    if level == 0:
        means = (
            umbrella_means(topology, np.ones(topology.n_vertices, dtype=np.bool_)) @ mesh.vertices
        )
        out = norm(mesh.vertices - means - surround.umbrellas) / np.sqrt(surround.sizes)
        # A corner of the outline stands out by nature.
        out[topology.is_boundary_vertex & (topology.valence == 2)] = 0.0
        worst = np.maximum.reduceat(out[topology.indices], topology.offsets[:-1])
        blamed = (out[topology.indices] == worst[topology.corner_faces]) & faces[
            topology.corner_faces
        ]
        movable = np.zeros(topology.n_vertices, dtype=np.bool_)
        movable[topology.indices[blamed]] = True
        return movable
    vertices = corners_of(topology, faces)
    for _ in range(level - 1):
        vertices = corners_of(topology, faces_touching(topology, vertices))
    return vertices


# --- what is kept -----------------------------------------------------------------------------


def _accepted(
    mesh: PolyMesh,
    points: Floats,
    movable: Mask,
    fault: Mask,
    open_faces: Mask,
    guard: Guard,
    normals: Floats,
) -> PolyMesh:
    """The mesh with those groups of moves that mend faces and break none."""
    topology = mesh.topology
    active = faces_touching(topology, movable)
    group = _groups(topology, movable, active)
    moved = mesh.with_vertices(points)
    broken, short = guard.broken(points)
    # A re-entrant corner beside a fault may well close.
    bent = np.zeros(topology.n_faces, dtype=np.bool_)
    for group_of, bend in zip(topology.face_groups, guard.bends, strict=True):
        bent[group_of.faces] = (bend.signs < 0).any(axis=1)
    broken = np.where(bent, least_sines(moved) <= 0, broken)
    # An edge of a broken face has no length that it must keep.
    bound = topology.edge_faces
    exempt = ((bound >= 0) & open_faces[bound]).any(axis=1)
    around = np.logical_or.reduceat((short & ~exempt)[topology.face_edges], topology.offsets[:-1])
    broken |= _still_broken(moved, fault, normals)
    harmed = active & (broken | around) & ~open_faces
    before = open_faces & active
    after = before & _still_broken(moved, open_faces, normals)
    count = topology.n_faces + topology.n_vertices
    gained = np.bincount(group[np.flatnonzero(before)], minlength=count)
    gained -= np.bincount(group[np.flatnonzero(after)], minlength=count)
    bad = np.bincount(group[np.flatnonzero(harmed)], minlength=count)
    kept = (gained > 0) & (bad == 0)
    taken = movable & kept[group[topology.n_faces :]]
    return mesh.with_vertices(np.where(taken[:, None], points, mesh.vertices))


def _still_broken(mesh: PolyMesh, faces: Mask, normals: Floats) -> Mask:
    """Which of the faces are not mended: corners, area and edges with room to spare."""
    topology = mesh.topology
    lengths = mesh.edge_lengths[topology.face_edges]
    longest = np.maximum.reduceat(lengths, topology.offsets[:-1])
    shortest = np.minimum.reduceat(lengths, topology.offsets[:-1])
    bad = least_sines(mesh) < LEAST_SINE
    bad |= shortest < LEAST_MENDED * longest
    bad |= dot(mesh.face_normals, normals) <= 0
    return np.asarray(faces & bad)


def _groups(topology: Topology, movable: Mask, active: Mask) -> Indices:
    """Number of the connected group of each face, then of each vertex: (F + V,)."""
    used = movable[topology.indices] & active[topology.corner_faces]
    rows = topology.corner_faces[used]
    columns = topology.n_faces + topology.indices[used]
    count = topology.n_faces + topology.n_vertices
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _counted(numbers: Indices, one: str, many: str | None = None) -> str:
    """A few of the numbers, said: "3 faces (4, 7, 9)"."""
    shown = ", ".join(map(str, numbers[:6].tolist())) + (", ..." if len(numbers) > 6 else "")
    word = one if len(numbers) == 1 else many or one + "s"
    return f"{len(numbers)} {word} ({shown})"
