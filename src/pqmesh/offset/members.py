"""Members of P(M) with wanted properties: nearest ones, prescribed lengths and places, dragging.

In the orthonormal basis Q of P(M) a mesh nearest to a target t is Q Q't, a place of a vertex and a
signed length of an edge are linear in the coordinates, and the nearest member that keeps them is
the smallest correction of the nearest one. All is linear algebra with a few hundred unknowns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.offset.distances import same_topology
from pqmesh.offset.parallel import ParallelSpace
from pqmesh.vectors import Floats, Indices, angle, norm

# Wishes whose relative singular value is below this contradict or repeat each other.
REPEATED = 1e-9


@dataclass(frozen=True)
class Wishes:
    """What a member of P(M) is to have.

    Parameters
    ----------
    places : vertex -> (3,), model unit
    lengths : (vertex, vertex) -> float, model unit
        Of edges, by their ends in any order; negative turns the edge round.
    """

    places: Mapping[int, ArrayLike] = field(default_factory=dict)
    lengths: Mapping[tuple[int, int], float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Member:
    """A mesh of P(M), and how well it has what was wished.

    Attributes
    ----------
    mesh : PolyMesh
    error : float, model unit
        Largest difference of a place or a length from its wish: zero unless the wishes
        contradict each other or the parallel edges.
    moved : float, model unit
        Root mean square distance of the vertices from the target.
    """

    mesh: PolyMesh
    error: float
    moved: float


def combined(meshes: list[PolyMesh], weights: ArrayLike) -> PolyMesh:
    """Linear combination of combinatorially equivalent meshes, an element of C(M).

    Of meshes in P(M) it is again in P(M).

    Parameters
    ----------
    meshes : list of PolyMesh
        On the same faces.
    weights : (n,)

    References: [thesis] definition 2.2.2, proposition 2.2.1.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> bool((combined([cube(), cube()], [2.0, -1.0]).vertices == cube().vertices).all())
    True
    """
    values = np.asarray(weights, dtype=np.float64)
    if not meshes or values.shape != (len(meshes),):
        raise MeshError(
            f"A combination needs one weight for each of at least one mesh; found {len(meshes)} "
            f"meshes and weights of shape {values.shape}. Give as many weights as meshes."
        )
    for other in meshes[1:]:
        same_topology(meshes[0], other)
    points = np.einsum("n,nvi->vi", values, np.stack([mesh.vertices for mesh in meshes]))
    return meshes[0].with_vertices(points)


def nearest_member(
    space: ParallelSpace, target: ArrayLike | None = None, wishes: Wishes | None = None
) -> Member:
    """The member of P(M) nearest to target vertices, of those that fulfil the wishes best.

    Parameters
    ----------
    space : ParallelSpace
    target : (V, 3), model unit
        By default the mesh itself, so that as little as possible changes.
    wishes : Wishes, optional
        Fulfilled before the target is looked at; in least squares where they contradict.

    Raises
    ------
    MeshError
        For a target of wrong shape, a vertex that does not exist or a pair that is no edge.

    References: [pottmann2007].

    Examples
    --------
    >>> from pqmesh.mesh.exact import translational_mesh
    >>> from pqmesh.offset.parallel import parallel_space
    >>> roof = translational_mesh([[0, 0, 0], [1, 0, 1], [2, 0, 1]], [[0, 0, 0], [0, 1, 0.5]])
    >>> longer = nearest_member(parallel_space(roof), wishes=Wishes(lengths={(0, 1): 2.0}))
    >>> round(float(longer.mesh.edge_lengths[0]), 9), longer.error < 1e-12
    (2.0, True)
    """
    mesh = space.mesh
    goal = mesh.vertices if target is None else np.asarray(target, dtype=np.float64)
    if goal.shape != mesh.vertices.shape:
        raise MeshError(
            f"A target must have one row for each vertex, shape {mesh.vertices.shape}; found "
            f"{goal.shape}. Give a mesh on the same topology."
        )
    coordinates = space.coordinates(goal)
    error = 0.0
    if wishes is not None and (wishes.places or wishes.lengths):
        rows, values = _wish_rows(space, wishes)
        missing = values - rows @ coordinates
        coordinates = coordinates + np.linalg.pinv(rows, rcond=REPEATED) @ missing
        # What rounding left of the first correction.
        missing = values - rows @ coordinates
        coordinates = coordinates + np.linalg.pinv(rows, rcond=REPEATED) @ missing
        error = float(np.abs(rows @ coordinates - values).max())
    found = space.member(coordinates)
    moved = float(np.sqrt(np.mean(norm(found.vertices - goal) ** 2)))
    return Member(found, error, moved)


def dragged(space: ParallelSpace, places: Mapping[int, ArrayLike], held: ArrayLike = ()) -> Member:
    """The mesh with some vertices dragged to new places, others held, all edges kept parallel.

    The tool of an editor: the rest of the mesh follows with the smallest moves, and faces stay
    planar, circular faces circular and conical vertices conical, since these are properties of
    P(M). Where the wanted places are out of reach the nearest reachable ones are taken, and
    `error` says how far they are.

    Parameters
    ----------
    space : ParallelSpace
        Of the mesh before the first drag; it can be used for all that follow.
    places : vertex -> (3,), model unit
    held : sequence of vertices
        Stay where they are in the mesh of the space.

    Examples
    --------
    >>> from pqmesh.mesh.exact import translational_mesh
    >>> from pqmesh.offset.parallel import parallel_space
    >>> roof = translational_mesh([[0, 0, 0], [1, 0, 1], [2, 0, 1]], [[0, 0, 0], [0, 1, 0.5]])
    >>> moved = dragged(parallel_space(roof), {4: [4.0, 0.0, 1.0]}, held=[0])
    >>> bool(np.allclose(moved.mesh.vertices[4], [4.0, 0.0, 1.0])), moved.error < 1e-12
    (True, True)
    """
    standing = {int(v): space.mesh.vertices[v] for v in np.asarray(held, dtype=np.int64).tolist()}
    return nearest_member(space, wishes=Wishes(places={**standing, **places}))


@dataclass(frozen=True, eq=False)
class NodeAxes:
    """A member of P(M) as vectors at the vertices: axes without torsion where no offset exists.

    Attributes
    ----------
    vectors : (V, 3)
        Node axes; neighbouring ones are coplanar with their edge.
    tilt : (V,), radians
        Angle between the axis and the vertex normal.
    scale : (V,)
        Length of the vector: 1 would be an even height.
    """

    vectors: Floats
    tilt: Floats
    scale: Floats


def nearest_axes(space: ParallelSpace, normals: Floats | None = None) -> NodeAxes:
    """The member of P(M) nearest to the vertex normals, in least squares: node axes.

    Parameters
    ----------
    space : ParallelSpace
    normals : (V, 3), unit vectors
        By default those of the mesh.

    References: [pottmann2007]; [thesis] definition 2.1.9.
    """
    wanted = space.mesh.vertex_normals if normals is None else normals
    vectors = nearest_member(space, wanted).mesh.vertices
    return NodeAxes(vectors, angle(vectors, wanted), norm(vectors))


def _wish_rows(space: ParallelSpace, wishes: Wishes) -> tuple[Floats, Floats]:
    """Wishes as linear equations in the coordinates of the basis: rows (n, k), values (n,)."""
    mesh = space.mesh
    basis = space.basis.reshape(len(mesh.vertices), 3, -1)
    places = _known_vertices(mesh, list(wishes.places))
    edges = _known_edges(mesh, list(wishes.lengths))
    low, high = mesh.edges[edges].T
    along = mesh.edge_vectors[edges] / mesh.edge_lengths[edges][:, None]
    stretched = np.einsum("ei,eik->ek", along, basis[high] - basis[low])
    points = np.array([np.asarray(place, dtype=np.float64) for place in wishes.places.values()])
    lengths = np.array([float(length) for length in wishes.lengths.values()])
    rows = np.concatenate([basis[places].reshape(3 * len(places), basis.shape[2]), stretched])
    values = np.concatenate([points.ravel(), lengths])
    if not np.isfinite(values).all():
        raise MeshError("Wanted places and lengths must be finite; one is not. Mend it.")
    return rows, values


def _known_vertices(mesh: PolyMesh, wanted: list[int]) -> Indices:
    """Vertex numbers, refused when they do not exist."""
    for vertex in wanted:
        if not 0 <= vertex < len(mesh.vertices):
            raise MeshError(
                f"A wanted place must belong to a vertex 0..{len(mesh.vertices) - 1}; found vertex "
                f"{vertex}. Give its number."
            )
    return np.array(wanted, dtype=np.int64)


def _known_edges(mesh: PolyMesh, wanted: list[tuple[int, int]]) -> Indices:
    """Numbers of edges given by their ends."""
    number = {(a, b): k for k, (a, b) in enumerate(mesh.edges.tolist())}
    found = []
    for a, b in wanted:
        key = (min(a, b), max(a, b))
        if key not in number:
            raise MeshError(
                f"A wanted length must belong to an edge; vertices {a} and {b} are not joined. "
                f"Give the two ends of an edge."
            )
        found.append(number[key])
    return np.array(found, dtype=np.int64)
