"""Meshes with positions: PolyMesh for faces of any length, QuadMesh where all are quads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.mesh.topology import Faces, Topology
from pqmesh.vectors import Floats, Indices, cross, norm, read_only, unit

# Squares of larger coordinates overflow in areas and lengths.
LARGEST_COORDINATE = 1e150


@dataclass(frozen=True, eq=False, repr=False)
class PolyMesh:
    """Vertex positions on a topology; faces of any length.

    Parameters
    ----------
    vertices : (V, 3), model unit
        Finite. Kept as a read-only copy.
    topology : Topology

    Raises
    ------
    MeshError
        When the shape is wrong or a coordinate is not finite; names the vertex.

    References: [thesis] definition 2.1.2.

    Examples
    --------
    >>> square = PolyMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> square.face_normals
    array([[0., 0., 1.]])
    """

    vertices: Floats
    topology: Topology

    def __post_init__(self) -> None:
        points = read_only(self.vertices)
        if points.shape != (self.topology.n_vertices, 3):
            raise MeshError(
                f"Vertices must have shape ({self.topology.n_vertices}, 3) to fit the topology; "
                f"found {points.shape}. Give one row x, y, z for each vertex."
            )
        bad = np.flatnonzero(~(np.abs(points) <= LARGEST_COORDINATE).all(axis=1))
        if len(bad):
            raise MeshError(
                f"Coordinates must be finite and below {LARGEST_COORDINATE:g}; vertex {bad[0]} is "
                f"{points[bad[0]].tolist()}. Mend or remove it."
            )
        object.__setattr__(self, "vertices", points)

    @classmethod
    def of(cls, vertices: ArrayLike, faces: Faces) -> Self:
        """Mesh of vertex positions and face indices."""
        points = np.asarray(vertices, dtype=np.float64)
        return cls(points, Topology(faces, len(points)))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.topology!r})"

    def with_vertices(self, vertices: Floats) -> Self:
        """The same combinatorics at other positions: another element of C(M)."""
        return type(self)(vertices, self.topology)

    def reversed(self) -> Self:
        """The mesh with every face, and so every normal, turned over."""
        faces = [face[::-1] for face in self.topology.face_lists()]
        return type(self)(self.vertices, Topology(faces, self.topology.n_vertices))

    @property
    def edges(self) -> Indices:
        """Vertex pairs, shape (E, 2)."""
        return self.topology.edges

    @cached_property
    def edge_vectors(self) -> Floats:
        """Vectors from the lower to the higher vertex of each edge, shape (E, 3)."""
        return read_only(self.vertices[self.edges[:, 1]] - self.vertices[self.edges[:, 0]])

    @cached_property
    def edge_lengths(self) -> Floats:
        """Edge lengths, shape (E,), model unit."""
        return read_only(norm(self.edge_vectors))

    @cached_property
    def mean_edge_length(self) -> float:
        """Mean edge length, model unit."""
        return float(self.edge_lengths.mean())

    @cached_property
    def face_area_vectors(self) -> Floats:
        """Vector areas of the faces, right-hand rule, shape (F, 3); exact for any polygon.

        For a quad this is half the cross product of the diagonals, so the normal is the one
        perpendicular to both diagonals.
        """
        topology = self.topology
        # Corners are taken from the face's first vertex, so far-away origins cost no digits.
        base = self.vertices[topology.indices[topology.offsets[:-1]]]
        relative = self.vertices[topology.indices] - base[topology.corner_faces]
        products = cross(relative, relative[topology.corner_next])
        return read_only(0.5 * np.add.reduceat(products, topology.offsets[:-1], axis=0))

    @cached_property
    def face_normals(self) -> Floats:
        """Unit face normals, shape (F, 3); zero for a face without area."""
        return read_only(unit(self.face_area_vectors))

    @cached_property
    def face_centers(self) -> Floats:
        """Means of the corners, shape (F, 3)."""
        topology = self.topology
        sums = np.add.reduceat(self.vertices[topology.indices], topology.offsets[:-1], axis=0)
        return read_only(sums / topology.face_sizes[:, None])

    @cached_property
    def vertex_normals(self) -> Floats:
        """Unit sums of the area vectors around each vertex, shape (V, 3)."""
        topology = self.topology
        sums = np.zeros((topology.n_vertices, 3))
        np.add.at(sums, topology.indices, self.face_area_vectors[topology.corner_faces])
        return read_only(unit(sums))


class QuadMesh(PolyMesh):
    """A mesh of quads only: the object that pqmesh optimises and offsets.

    Raises
    ------
    MeshError
        When a face is not a quad; names the count and the first one.

    Examples
    --------
    >>> square = QuadMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    >>> square.faces
    array([[0, 1, 2, 3]])
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.topology.quads

    @property
    def faces(self) -> Indices:
        """Corners of each face, shape (F, 4)."""
        return self.topology.quads

    @cached_property
    def corners(self) -> Floats:
        """Corner positions, shape (F, 4, 3)."""
        return read_only(self.vertices[self.faces])
