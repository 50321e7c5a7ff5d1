"""The guard: a face that starts valid stays valid, whatever the solver would like."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pqmesh.mesh.measure import corner_angles
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Mask, cross, dot, norm

# A corner may close or open until the sine between its edges, signed by the face normal, is
# this small; a face that starts below keeps half of what it has.
LEAST_SINE = 0.1
# Sines of corners above this are straight to the digits of a file: sound, and no reason to mend.
# Such a corner may bend back by the second number more, so that it is not held by roundings.
BENT_BACK, YIELD = -1e-3, 1e-6
# A face has no area up to this share of the square of its longest edge.
NO_AREA = 1e-12
# Corners of polygons within this angle of pi, in radians, are straight.
STRAIGHT = 0.2
# Edges keep this share of the mesh's shortest start edge, and of their own start length.
LEAST_EDGE = 0.401
LEAST_OWN_EDGE = 0.2


class Bends(NamedTuple):
    """What the corners of the faces of one size keep, beyond being convex.

    A polygon of more than four corners may start with straight ones, where a neighbour ends, and
    re-entrant ones, as in the shape of an L: they are meant.

    Attributes
    ----------
    signs : (n, k)
        -1 at re-entrant corners, which stay so; 1 elsewhere.
    room : (n, k)
        Added to the sine of straight corners, which may bend to either side; 0 elsewhere.
    """

    signs: Floats
    room: Floats


@dataclass(frozen=True, eq=False)
class Guard:
    """Limits that every accepted position must keep.

    Attributes
    ----------
    mesh : PolyMesh
        The start.
    least_sine : (F,)
        Lower bound for the signed sines of each face's corners; -inf for faces that start
        broken (they are free, the report names them).
    bends : tuple of Bends
        Which corners may be re-entrant, for each group of faces.
    least_edge : (E,)
        Lower bound of each edge length, model unit.
    normals : (F, 3)
        Face normals at the start; a face must not turn by more than a right angle.
    """

    mesh: PolyMesh
    least_sine: Floats
    bends: tuple[Bends, ...]
    least_edge: Floats
    normals: Floats

    @classmethod
    def of(cls, mesh: PolyMesh) -> Guard:
        """Limits for a start mesh."""
        bends = _bends(mesh)
        sines, areas = _sines_and_areas(mesh, mesh.vertices, bends)
        lengths = mesh.edge_lengths
        # Faces without area have no sines.
        longest = np.maximum.reduceat(lengths[mesh.topology.face_edges], mesh.topology.offsets[:-1])
        sound = (sines > BENT_BACK) & (norm(areas) > NO_AREA * longest**2)
        straight = np.where(sound, sines - YIELD, -np.inf)
        least = np.where(sines > YIELD, np.minimum(LEAST_SINE, 0.5 * sines), straight)
        edges = np.maximum(LEAST_EDGE * lengths.min(), LEAST_OWN_EDGE * lengths)
        return cls(mesh, least, bends, edges, mesh.face_normals)

    def corner_sines(self, vertices: Floats) -> Floats:
        """Smallest signed sine of each face's corners at the given positions, shape (F,)."""
        return _sines_and_areas(self.mesh, vertices, self.bends)[0]

    def broken(self, vertices: Floats) -> tuple[Mask, Mask]:
        """Faces (F,) and edges (E,) beyond their limits at the given positions."""
        sines, areas = _sines_and_areas(self.mesh, vertices, self.bends)
        faces = sines < self.least_sine
        turned = dot(areas, self.normals) <= 0
        faces |= turned & np.isfinite(self.least_sine)
        ends = vertices[self.mesh.edges]
        edges = norm(ends[:, 1] - ends[:, 0]) < self.least_edge
        return faces, edges

    def blocked(self, vertices: Floats) -> Mask:
        """Faces (F,) beyond their limits at the given positions, or with an edge that is."""
        faces, edges = self.broken(vertices)
        topology = self.mesh.topology
        around = np.logical_or.reduceat(edges[topology.face_edges], topology.offsets[:-1])
        return np.asarray(faces | around)


def least_sines(mesh: PolyMesh) -> Floats:
    """Smallest signed sine of a corner of each face, shape (F,): not positive where it is broken.

    A quad breaks when a corner is re-entrant: it is then folded, or a dart. A polygon of more
    corners may have straight and re-entrant ones as long as it winds once around its inside
    (`Bends`).
    """
    return _sines_and_areas(mesh, mesh.vertices, _bends(mesh))[0]


def _bends(mesh: PolyMesh) -> tuple[Bends, ...]:
    """What the corners keep, by groups of faces."""
    topology = mesh.topology
    angles = corner_angles(mesh)
    total = np.add.reduceat(angles, topology.offsets[:-1])
    # Once around: the corners of a flat face then sum to (k - 2) pi, else to pi more or less.
    simple = np.abs(total - (topology.face_sizes - 2) * np.pi) < np.pi
    bends = []
    for faces, corners in topology.face_groups:
        size = corners.shape[1]
        own = angles[topology.offsets[faces][:, None] + np.arange(size)]
        may = simple[faces][:, None] & np.full(own.shape, size > 4)
        straight = may & (np.abs(own - np.pi) < STRAIGHT)
        signs = np.where(may & ~straight & (own > np.pi), -1.0, 1.0)
        bends.append(Bends(signs, np.where(straight, LEAST_SINE + STRAIGHT, 0.0)))
    return tuple(bends)


def _sines_and_areas(
    mesh: PolyMesh, vertices: Floats, bends: tuple[Bends, ...]
) -> tuple[Floats, Floats]:
    """Smallest corner sine (F,) and area vector (F, 3) of each face at the given positions."""
    sines, areas = np.empty(mesh.topology.n_faces), np.empty((mesh.topology.n_faces, 3))
    for (faces, corners), bend in zip(mesh.topology.face_groups, bends, strict=True):
        points = vertices[corners]
        area = _area_vectors(points)
        sines[faces] = (bend.signs * _corner_sines(points, area) + bend.room).min(axis=1)
        areas[faces] = area
    return sines, areas


def _area_vectors(corners: Floats) -> Floats:
    """Vectors along the area vectors of faces (n, k, 3), shape (n, 3)."""
    if corners.shape[1] == 4:
        return cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    out = corners[:, 1:] - corners[:, :1]
    return np.asarray(cross(out[:, :-1], out[:, 1:]).sum(axis=1))


def _corner_sines(corners: Floats, area: Floats) -> Floats:
    """Sines of the corner angles (n, k), negative where a corner is reflex or folded."""
    outgoing = np.roll(corners, -1, axis=1) - corners
    incoming = np.roll(outgoing, 1, axis=1)
    normal = area / np.maximum(norm(area), TINY)[:, None]
    lengths = norm(outgoing)
    scale = np.maximum(lengths * np.roll(lengths, 1, axis=1), TINY)
    return np.asarray(dot(cross(incoming, outgoing), normal[:, None]) / scale)
