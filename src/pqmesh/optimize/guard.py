"""The guard: a face that starts valid stays valid, whatever the solver would like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import TINY, Floats, Mask, cross, dot, norm

# A corner may close or open until the sine between its edges, signed by the face normal, is
# this small; a face that starts below keeps half of what it has.
LEAST_SINE = 0.1
# Edges keep this share of the mesh's shortest start edge, and of their own start length.
LEAST_EDGE = 0.32
LEAST_OWN_EDGE = 0.2


@dataclass(frozen=True, eq=False)
class Guard:
    """Limits that every accepted position must keep.

    Attributes
    ----------
    mesh : QuadMesh
        The start.
    least_sine : (F,)
        Lower bound for the signed sines of each face's corners; -inf for faces that start
        broken (they are free, the report names them).
    least_edge : (E,)
        Lower bound of each edge length, model unit.
    normals : (F, 3)
        Face normals at the start; a face must not turn by more than a right angle.
    """

    mesh: QuadMesh
    least_sine: Floats
    least_edge: Floats
    normals: Floats

    @classmethod
    def of(cls, mesh: QuadMesh) -> Guard:
        """Limits for a start mesh."""
        sines = _corner_sines(mesh.corners).min(axis=1)
        least = np.where(sines > 0, np.minimum(LEAST_SINE, 0.5 * sines), -np.inf)
        lengths = mesh.edge_lengths
        edges = np.maximum(LEAST_EDGE * lengths.min(), LEAST_OWN_EDGE * lengths)
        return cls(mesh, least, edges, mesh.face_normals)

    def corner_sines(self, vertices: Floats) -> Floats:
        """Smallest signed sine of each face's corners at the given positions, shape (F,)."""
        return np.asarray(_corner_sines(vertices[self.mesh.faces]).min(axis=1))

    def broken(self, vertices: Floats) -> tuple[Mask, Mask]:
        """Faces (F,) and edges (E,) beyond their limits at the given positions."""
        corners = vertices[self.mesh.faces]
        faces = _corner_sines(corners).min(axis=1) < self.least_sine
        area = cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        turned = dot(area, self.normals) <= 0
        faces |= turned & np.isfinite(self.least_sine)
        ends = vertices[self.mesh.edges]
        edges = norm(ends[:, 1] - ends[:, 0]) < self.least_edge
        return faces, edges

    def beside(self, edges: Mask) -> Mask:
        """Faces (F,) with an edge among those given (E,)."""
        topology = self.mesh.topology
        found = np.zeros(topology.n_faces, dtype=np.bool_)
        found[topology.corner_faces[edges[topology.face_edges].ravel()]] = True
        return found


def _corner_sines(corners: Floats) -> Floats:
    """Sines of the corner angles (F, 4), negative where a corner is reflex or folded."""
    outgoing = np.roll(corners, -1, axis=1) - corners
    incoming = np.roll(corners, 1, axis=1) - corners
    area = cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal = area / np.maximum(norm(area), TINY)[:, None]
    scale = np.maximum(norm(outgoing) * norm(incoming), TINY)
    return np.asarray(dot(cross(outgoing, incoming), normal[:, None]) / scale)
