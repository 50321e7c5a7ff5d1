"""Distances of parallel meshes: of vertices, of edges' lines, of faces' planes; what is an offset.

Constant distances make an offset. Face distances are signed, along the face normals: without the
sign a mesh whose faces move to and fro like a chessboard would count.
"""

from __future__ import annotations

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, cross, dot, norm, unit

KINDS = ("vertex", "edge", "face")
# Lines at a smaller sine count as parallel: their common perpendicular is not determined.
PARALLEL_LINES = 1e-6


def vertex_distance(mesh: PolyMesh, other: PolyMesh) -> Floats:
    """Distances d_v of corresponding vertices, shape (V,), model unit.

    References: [thesis] definition 2.3.1.
    """
    return norm(other.vertices - mesh.vertices)


def edge_distance(mesh: PolyMesh, other: PolyMesh) -> Floats:
    """Distances d_e of the lines that carry corresponding edges, shape (E,), model unit.

    That of the lines and not of the segments, which need not overlap. Between lines that are
    not parallel it is the length of the common perpendicular. A collapsed edge of `other` keeps
    the direction of its counterpart.

    References: [thesis] definition 2.3.1; errata page, E7.

    Examples
    --------
    >>> square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    >>> mesh = PolyMesh.of(square, [[0, 1, 2, 3]])
    >>> edge_distance(mesh, PolyMesh.of(np.array(square) + [5, 0, 2], [[0, 1, 2, 3]])).round(3)
    array([2.   , 5.385, 5.385, 2.   ])
    """
    low, high = mesh.edges.T
    first = unit(mesh.edge_vectors)
    collapsed = other.edge_lengths <= PARALLEL_LINES * mesh.edge_lengths
    second = np.where(collapsed[:, None], first, unit(other.edge_vectors))
    moves = other.vertices - mesh.vertices
    between = 0.5 * (moves[low] + moves[high])
    normal = cross(first, second)
    sine = norm(normal)
    skew = np.abs(dot(between, normal)) / np.maximum(sine, TINY)
    return np.where(sine > PARALLEL_LINES, skew, norm(cross(first, between)))


def face_distance(mesh: PolyMesh, other: PolyMesh) -> Floats:
    """Signed distances n_f . (v' - v) at the corners of each face, model unit.

    For parallel meshes those of a face agree: the distance d_f of the carrier planes.

    Returns
    -------
    (F, 4) for quads, one entry a corner otherwise

    References: [thesis] definition 2.3.1; signed, errata page, E7.
    """
    moves = other.vertices - mesh.vertices
    topology = mesh.topology
    reached = dot(moves[topology.indices], mesh.face_normals[topology.corner_faces])
    return reached.reshape(-1, 4) if topology.is_quad else reached


def parallel_error(mesh: PolyMesh, other: PolyMesh) -> Floats:
    """Sine between corresponding edges, shape (E,)."""
    product = norm(cross(mesh.edge_vectors, other.edge_vectors))
    return np.asarray(product / np.maximum(mesh.edge_lengths * other.edge_lengths, 1e-300))


def is_parallel(mesh: PolyMesh, other: PolyMesh, tolerance: float = 1e-9) -> bool:
    """Whether corresponding edges are parallel: sines within the tolerance.

    Reversed and collapsed edges count, as P(M) is a linear space with them only.

    References: [thesis] definition 2.2.1; errata page, E5.
    """
    same_topology(mesh, other)
    across = norm(cross(unit(mesh.edge_vectors), other.edge_vectors))
    # An edge shorter than rounding makes of the others has no direction of its own.
    size = np.maximum(other.edge_lengths, 1e-6 * other.mean_edge_length)
    return bool((across <= tolerance * size).all())


def constant_distance(mesh: PolyMesh, other: PolyMesh, kind: str) -> tuple[float, float]:
    """Mean distance of a kind and the largest deviation from it, model unit.

    Signed along the normals for faces, not signed for vertices and edges.
    """
    if kind not in KINDS:
        raise MeshError(
            f"The kind of a distance must be one of {', '.join(KINDS)}; found {kind!r}. Choose one."
        )
    same_topology(mesh, other)
    measured = {"vertex": vertex_distance, "edge": edge_distance, "face": face_distance}[kind]
    reached = measured(mesh, other)
    mean = float(reached.mean())
    return mean, float(np.abs(reached - mean).max())


def is_offset(mesh: PolyMesh, other: PolyMesh, kind: str, tolerance: float = 1e-9) -> bool:
    """Whether `other` is an offset of a mesh: parallel, at a constant distance that is not zero.

    A translation has constant vertex distances from every mesh; it counts for vertices and
    edges only where it is one for the faces too.

    Parameters
    ----------
    mesh, other : PolyMesh
        On the same topology.
    kind : 'vertex', 'edge' or 'face'
    tolerance : float
        Of the sines between edges, and of the distance over its mean.

    References: [thesis] definition 2.3.2; errata page, E7 and E8.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> larger = cube().with_vertices(1.5 * cube().vertices)
    >>> [is_offset(cube(), larger, kind) for kind in KINDS]
    [True, True, True]
    >>> is_offset(cube(), cube().with_vertices(cube().vertices + 1.0), "vertex")
    False
    """
    mean, deviation = constant_distance(mesh, other, kind)
    size = abs(mean)
    if size <= TINY or deviation > tolerance * size or not is_parallel(mesh, other, tolerance):
        return False
    image = (other.vertices - mesh.vertices) / size
    spread = norm(image[mesh.edges[:, 1]] - image[mesh.edges[:, 0]]).max()
    if kind != "face" and spread <= max(tolerance, 1e-12):
        reached = face_distance(mesh, other)
        return bool(np.abs(reached - reached.mean()).max() <= tolerance * size)
    return True


def same_topology(mesh: PolyMesh, other: PolyMesh) -> None:
    """Refuse two meshes whose vertices and faces do not correspond."""
    first, second = mesh.topology, other.topology
    if first is second:
        return
    if not (
        np.array_equal(first.indices, second.indices)
        and np.array_equal(first.offsets, second.offsets)
    ):
        raise MeshError(
            f"Meshes must have the same faces to correspond; found {first!r} and {second!r} with "
            f"different corners. Build the second with `with_vertices`, or renumber it by "
            f"`isomorphism`."
        )


# --- how far ----------------------------------------------------------------------------------


def edge_factors(mesh: PolyMesh, vectors: Floats) -> Floats:
    """Change kappa_e of each edge per unit of offset, e(d) = (1 + d kappa_e) e; shape (E,)."""
    i, j = mesh.edges[:, 0], mesh.edges[:, 1]
    return np.asarray(dot(vectors[j] - vectors[i], mesh.edge_vectors) / mesh.edge_lengths**2)


def valid_range(mesh: PolyMesh, vectors: Floats) -> tuple[float, float]:
    """Offset distances between which no edge reverses: (low <= 0, high >= 0), model unit.

    Edges turn at the focal set of the surface; self-intersection further apart is not judged.
    """
    factors = edge_factors(mesh, vectors)
    low = -1.0 / factors[factors > 0].max() if (factors > 0).any() else -np.inf
    high = -1.0 / factors[factors < 0].min() if (factors < 0).any() else np.inf
    return float(low), float(high)
