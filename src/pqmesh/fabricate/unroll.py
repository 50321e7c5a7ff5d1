"""PQ strips rolled out into the plane: discrete developable surfaces laid flat."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats, Indices, dot, norm, read_only, unit

# Faces farther from flat than this have no length-preserving image in the plane.
FLAT = 1e-6


@dataclass(frozen=True, eq=False)
class UnrolledStrip:
    """A strip of quads in the plane, congruent face by face.

    Attributes
    ----------
    points : (n+1, 2, 2), model unit
        The two ends of each ruling in the plane, in order along the strip; the first ruling
        starts at the origin and runs along the y axis.
    vertices : (n+1, 2)
        Mesh vertices of the same ends. A closed strip repeats its first ruling at the end.
    faces : (n,)
        Mesh face between each two rulings.
    """

    points: Floats
    vertices: Indices
    faces: Indices

    @property
    def area(self) -> float:
        """Area in the plane, model units squared."""
        a, b = self.points[:-1], self.points[1:]
        first, second = b[:, 1] - a[:, 0], a[:, 1] - b[:, 0]
        return float(0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]).sum())


def unrolled_strip(mesh: QuadMesh, strip: Indices) -> UnrolledStrip:
    """A PQ strip laid flat without stretching: every face keeps its shape.

    Each face is turned about its common ruling into the plane of the last one. Strips that turn
    far overlap in the plane; that is how they are, and cutting them is up to the user.

    Parameters
    ----------
    mesh : QuadMesh
        With plane faces along the strip.
    strip : (n+1,)
        Edges across the strip, as in `Topology.strips`: neighbours are opposite sides of a face.

    Raises
    ------
    MeshError
        When neighbouring edges are not opposite sides of one face, or a face is not plane.

    References: [thesis] section 2.1 (PQ strips represent developable surfaces); errata page, E3.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> drum = rotational_mesh([[1.0, 0.0], [1.0, 2.0]], 0.5 * np.arange(5))
    >>> strip = max(drum.topology.strips, key=len)
    >>> flat = unrolled_strip(drum, strip)
    >>> bool(np.abs(flat.area - 4 * 2 * 2 * np.sin(0.25)) < 1e-12)
    True
    """
    faces, vertices = _walked(mesh, np.asarray(strip, dtype=np.int64))
    bent = planarity(mesh)[faces]
    if len(bent) and bent.max() > FLAT:
        worst = int(bent.argmax())
        raise MeshError(
            f"Faces of a strip to unroll must be plane to {FLAT:g}; face {int(faces[worst])} is "
            f"{bent[worst]:.3g} of its diagonal out of plane. Make the mesh planar first."
        )
    ends = mesh.vertices[vertices]
    points = np.zeros((len(vertices), 2, 2))
    points[0, 1, 1] = norm(ends[0, 1] - ends[0, 0])
    for k in range(len(faces)):
        points[k + 1] = _laid(points[k], ends[k], ends[k + 1])
    return UnrolledStrip(
        read_only(points), read_only(vertices, np.int64), read_only(faces, np.int64)
    )


def _laid(ruling: Floats, here: Floats, there: Floats) -> Floats:
    """Plane places (2, 2) of the next ruling, right of the present one, from both in space."""
    along = unit(here[1] - here[0])
    # The face's own plane: across the ruling, towards the next one.
    reach = there - here[0]
    aside = reach.mean(axis=0) - 0.5 * (here[1] - here[0])
    across = unit(aside - dot(aside, along) * along)
    x, y = reach @ across, reach @ along
    up = unit(ruling[1] - ruling[0])
    right = np.array([up[1], -up[0]])
    return np.asarray(ruling[0] + x[:, None] * right + y[:, None] * up)


def _walked(mesh: QuadMesh, strip: Indices) -> tuple[Indices, Indices]:
    """Faces between neighbouring edges, and the edges' ends in one sense along the strip."""
    topology = mesh.topology
    if len(strip) < 2:
        raise MeshError(
            f"A strip must have at least two edges across it; found {len(strip)}. Take one of "
            f"Topology.strips."
        )
    faces: list[int] = []
    rows = [topology.edges[strip[0]]]
    for number, (edge, following) in enumerate(pairwise(strip)):
        shared = np.intersect1d(topology.edge_faces[edge], topology.edge_faces[following])
        shared = shared[shared >= 0]
        found = [face for face in shared if _are_opposite(mesh, int(face), int(edge), following)]
        # A strip of two faces around a tube shares both: take them in turn.
        fresh = [face for face in found if not faces or face != faces[-1]] or found
        if not fresh:
            raise MeshError(
                f"Neighbouring edges of a strip must be opposite sides of one face; edges "
                f"{int(edge)} and {int(following)}, at {number} of the strip, are not. Take one "
                f"of Topology.strips."
            )
        faces.append(fresh[0])
        rows.append(_turned(mesh, int(fresh[0]), rows[-1], topology.edges[following]))
    return np.array(faces, dtype=np.int64), np.array(rows, dtype=np.int64)


def _are_opposite(mesh: QuadMesh, face: int, edge: int, other: int) -> bool:
    """Whether two edges are opposite sides of a face."""
    sides = mesh.topology.face_edges.reshape(-1, 4)[face].tolist()
    return edge in sides and sides[(sides.index(edge) + 2) % 4] == other


def _turned(mesh: QuadMesh, face: int, ruling: Indices, other: Indices) -> Indices:
    """Ends of the next ruling, each joined to the same end of the last one by a side."""
    corners = mesh.faces[face].tolist()
    at = corners.index(int(ruling[0]))
    beside = {corners[at - 1], corners[(at + 1) % 4]}
    return other if int(other[0]) in beside - {int(ruling[1])} else other[::-1]
