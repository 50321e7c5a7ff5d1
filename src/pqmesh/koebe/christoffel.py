"""The Christoffel dual of a Koebe mesh: a discrete minimal surface parallel to it.

An edge e of the mesh, seen from the tangent lengths r = sqrt(|s|^2 - 1) of its ends, becomes
+e / (r r') in one family and -e / (r r') in the other. The dual edges close around every face, and
the dual M has mixed area A(M, S) = 0 on each: mean curvature zero with respect to S. It has exact
edge offsets with Gauss image S.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Topology
from pqmesh.vectors import Floats, cross, dot, norm

# Gap over the dual's size at which the edges no longer count as closed.
CLOSED = 1e-8


def christoffel_dual(image: QuadMesh, *, flip: bool = False) -> QuadMesh:
    """Discrete minimal surface with the given Koebe mesh as Gauss image, vertex 0 at the origin.

    Parameters
    ----------
    image : QuadMesh
        Koebe mesh, in one piece, with contacts inside the edges.
    flip : bool
        Exchange the two families: the dual times -1.

    Raises
    ------
    MeshError
        When an edge does not touch the sphere, the edges do not split into two families (interior
        vertices of odd valence), or the dual does not close around a hole.

    References: [bobenko2006].

    Examples
    --------
    >>> from pqmesh.koebe.families import square_koebe
    >>> image = square_koebe(5, 5, 0.2, (-0.4, -0.4))
    >>> bool(np.abs(mixed_areas(christoffel_dual(image), image)).max() < 1e-12)
    True
    """
    length = np.sqrt(np.maximum(dot(image.vertices, image.vertices) - 1.0, 0.0))
    i, j = image.edges.T
    # Where both contacts coincide inside the edge, its length is r + r'.
    gap = np.abs(length[i] + length[j] - image.edge_lengths)
    worst = int(gap.argmax())
    if gap[worst] > CLOSED:
        raise MeshError(
            f"Every edge must touch the unit sphere between its ends; edge {i[worst]}-{j[worst]} "
            f"is off by {gap[worst]:.3g}. Use a Koebe mesh."
        )
    signs = edge_families(image.topology) * (-1.0 if flip else 1.0)
    steps = signs[:, None] * image.edge_vectors / (length[i] * length[j])[:, None]
    points = _summed(image.topology, steps)
    rest = norm(points[j] - points[i] - steps)
    if rest.max() > CLOSED * max(float(np.ptp(points)), 1e-300):
        edge = int(rest.argmax())
        raise MeshError(
            f"The dual must close along every loop; at edge {i[edge]}-{j[edge]} it misses by "
            f"{rest[edge]:.3g}. Cut the mesh into a disc."
        )
    return image.with_vertices(points)


def edge_families(topology: Topology) -> Floats:
    """Signs +1 and -1 of the two families of edges, alternating around every quad; (E,).

    Raises
    ------
    MeshError
        When there are no two such families: an interior vertex of odd valence, or a loop that
        exchanges them.
    """
    sides = topology.face_edges[: 4 * len(topology.quads)].reshape(-1, 4)
    size = topology.n_edges
    ahead, across = sides.ravel(), np.roll(sides, -1, axis=1).ravel()
    graph = coo_array((np.ones(len(ahead)), (ahead, across)), shape=(size, size)).tocsr()
    order, before = breadth_first_order(graph, 0, directed=False)
    signs = np.zeros(size)
    signs[order[0]] = 1.0
    for edge in order[1:].tolist():
        signs[edge] = -signs[before[edge]]
    clash = np.flatnonzero(signs[ahead] * signs[across] >= 0.0)
    if len(order) < size or len(clash):
        odd = np.flatnonzero(~topology.is_boundary_vertex & (topology.valence % 2 == 1))
        place = f"vertex {odd[0]} has odd valence" if len(odd) else "a loop exchanges them"
        raise MeshError(
            f"The edges must split into two families that alternate around every face; {place}. "
            f"Take a part of the mesh with even valences inside."
        )
    return signs


def mixed_areas(mesh: QuadMesh, image: QuadMesh) -> Floats:
    """Mixed area A(M, S) of the faces of two parallel quad meshes, along image normals; (F,).

    Half the change of area: A(M + dS) = A(M) + 2d A(M, S) + d^2 A(S).
    """
    a, b = mesh.corners, image.corners
    first, second = a[:, 2] - a[:, 0], a[:, 3] - a[:, 1]
    third, fourth = b[:, 2] - b[:, 0], b[:, 3] - b[:, 1]
    area = 0.25 * (cross(first, fourth) + cross(third, second))
    return np.asarray(dot(area, image.face_normals))


def _summed(topology: Topology, steps: Floats) -> Floats:
    """Points whose differences along a spanning tree are the given steps, vertex 0 at 0."""
    n = topology.n_vertices
    low, high = topology.edges.T
    entries = (np.arange(1, len(low) + 1), (low, high))
    numbers = coo_array(entries, shape=(n, n)).tocsr()
    order, before = breadth_first_order(numbers, 0, directed=False)
    if len(order) < n:
        raise MeshError(
            f"The mesh must be one piece; only {len(order)} of {n} vertices hang together with "
            f"vertex 0. Split it into its pieces."
        )
    ends = order[1:]
    parents = before[ends]
    tree = np.asarray(numbers[np.minimum(ends, parents), np.maximum(ends, parents)])
    signs = np.where(parents < ends, 1.0, -1.0)
    moves = signs[:, None] * steps[tree.astype(np.int64).ravel() - 1]
    points = np.zeros((n, 3))
    for vertex, parent, move in zip(ends.tolist(), parents.tolist(), moves, strict=True):
        points[vertex] = points[parent] + move
    return points
