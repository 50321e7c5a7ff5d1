"""Before an optimisation: is the net fit for it, how far must vertices move, where is it worst."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pqmesh.mesh.conjugacy import Conjugacy, conjugacy
from pqmesh.mesh.measure import nonconvex_faces
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.assembly import Assembly, Part
from pqmesh.optimize.problem import Problem, gathered
from pqmesh.optimize.recipes import KINDS, LOOSE, Weights, problem_for
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats, Indices, Mask, dot, norm, read_only

# Soft goals count so little against the hard ones in the step that is looked ahead.
SOFT_SHARE = 1e-6
# Larger meshes are not solved in advance: a look must stay cheap.
MOST_FACES = 50_000
# An edge below this share of the edges opposite to it in its faces is short.
SHORT_EDGE = 0.1


@dataclass(frozen=True, eq=False)
class Region:
    """Faces that hang together and whose lines are far from conjugate.

    Attributes
    ----------
    faces : (n,)
        Rising.
    worst : int
        The face whose lines must turn most.
    at : (3,)
        Its middle, model unit.
    turn : float
        By how much, radians.
    asymptotic : float
        Share of the faces whose lines are nearer to asymptotic than to conjugate directions.
    """

    faces: Indices
    worst: int
    at: Floats
    turn: float
    asymptotic: float


@dataclass(frozen=True, eq=False)
class Broken:
    """What is broken at the start: faces that are 'not convex' or 'turned over', a 'short' edge.

    Attributes
    ----------
    what : str
    where : tuple of int
        The face, or the two ends of the edge.
    at : (3,)
        Middle, model unit.
    """

    what: str
    where: tuple[int, ...]
    at: Floats


@dataclass(frozen=True, eq=False)
class Outlook:
    """What is to be expected of an optimisation.

    Attributes
    ----------
    kind : str
    verdict : str
        'conjugate', 'nearly conjugate', 'far from conjugate', 'asymptotic' or 'undecided'.
    conjugacy : Conjugacy
    moves : (V, 3) or None
        Predicted move of each vertex, model unit; None where it cannot be predicted.
    normals : (V, 3)
        Of the start.
    mean_edge : float, model unit
    regions : tuple of Region
        Largest sum of turns first.
    broken : tuple of Broken
    """

    kind: str
    verdict: str
    conjugacy: Conjugacy
    moves: Floats | None
    normals: Floats
    mean_edge: float
    regions: tuple[Region, ...]
    broken: tuple[Broken, ...]

    @property
    def move_max(self) -> float | None:
        """Largest predicted move, model unit."""
        return None if self.moves is None else float(norm(self.moves).max())

    @property
    def move_rms(self) -> float | None:
        """Root mean square of the predicted moves, model unit."""
        return None if self.moves is None else float(np.sqrt(np.mean(norm(self.moves) ** 2)))

    @property
    def move_edges(self) -> float | None:
        """Largest predicted move in mean edges."""
        return None if self.move_max is None else self.move_max / self.mean_edge

    @property
    def off_surface(self) -> float | None:
        """Largest predicted move along the normal, model unit: a lower bound, see `outlook`."""
        return None if self.moves is None else float(np.abs(dot(self.moves, self.normals)).max())


def outlook(
    kind: str, mesh: PolyMesh, reference: Reference | None = None, *, boundary: str = "free"
) -> Outlook:
    """What an optimisation will meet: one sparse linear solve, no iteration.

    Whether the lines are conjugate is judged by `conjugacy`. How far vertices must move is the
    step of least size, in the metric of the soft goals, that meets the linearised hard goals: as
    far as they must slide if they stay near the surface. Measured against what the optimisation
    did, on exact and real meshes, the largest move is

    - right to 10 % on nets of conjugate lines, down to moves of 3e-5 edges;
    - 0.65 to 1.5 times the real one on other nets, up to moves of 5 edges, and on rough meshes.

    It does not see faces that break on the way, and grows with refinement: the slide is a length,
    not a number of edges. The part along the normal is a lower bound: a long slide leaves the
    surface to second order, and the rim slides beyond it.

    Parameters
    ----------
    kind : 'planar', 'conical', 'circular' or 'edge-offset'
        For edge offsets no move is predicted, nor for more than 50 000 faces.
    mesh : PolyMesh
        The start.
    reference : Reference, optional
        The surface to stay close to; the mesh's own tangent planes without.
    boundary : 'free', 'fixed' or 'glide'

    Raises
    ------
    SpecError
        For an unknown boundary.

    References: [liu2006]; [thesis] section 6.1.

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_mesh
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), indexing="ij")
    >>> found = outlook("planar", grid_mesh(np.stack([x, y, 0.2 * x * y], axis=-1)))
    >>> found.verdict, len(found.regions), bool(found.move_edges > 0.5)
    ('asymptotic', 1, True)
    """
    found = conjugacy(mesh)
    moves = None
    if kind in KINDS and mesh.topology.n_faces <= MOST_FACES:
        own = _TangentPlanes(mesh.vertices, mesh.vertex_normals)
        weights = LOOSE if found.lines_are_far else Weights()
        problem = problem_for(kind, mesh, reference or own, boundary=boundary, weights=weights)
        moves = _looked_ahead(problem, mesh)
    return Outlook(
        kind=kind,
        verdict=found.verdict,
        conjugacy=found,
        moves=moves,
        normals=mesh.vertex_normals,
        mean_edge=mesh.mean_edge_length,
        regions=tuple(_regions(mesh, found)),
        broken=tuple(_broken(mesh)),
    )


@dataclass(frozen=True, eq=False)
class _TangentPlanes:
    """The start as its own reference: each vertex on the plane through it."""

    feet: Floats
    normals: Floats

    def closest(self, points: Floats) -> tuple[Floats, Floats, _TangentPlanes]:
        """The start itself, whatever the points."""
        return self.feet, self.normals, self

    def about(self, origin: Floats) -> _TangentPlanes:
        """The same with places counted from an origin (3,)."""
        return _TangentPlanes(self.feet - origin, self.normals)


def _looked_ahead(problem: Problem, mesh: PolyMesh) -> Floats | None:
    """Moves (V, 3) of the first step of Gauss and Newton; None where it does not exist."""
    parts, residuals = [], []
    for goal in problem.goals:
        residual, jacobian = goal.term.evaluate(gathered(goal.term, problem.blocks))
        parts.append(
            Part(goal.weight / max(len(residual), 1) * (1.0 if goal.hard else SOFT_SHARE), jacobian)
        )
        residuals.append(goal.beyond(residual))
    still = np.zeros(mesh.topology.n_faces)
    blocks = {name: np.zeros_like(block) for name, block in problem.blocks.items()}
    try:
        assembly = Assembly(problem, mesh)
        if not assembly.size:
            return read_only(blocks["vertices"])
        factor = assembly.factor(assembly.matrix(parts, 0.0, still))
    except (ArithmeticError, MemoryError):
        return None
    step = factor.solve(assembly.descent(parts, residuals))
    if not np.isfinite(step).all():
        return None
    return read_only(assembly.moved(blocks, step)["vertices"])


def _regions(mesh: PolyMesh, found: Conjugacy) -> list[Region]:
    """Groups of far faces that share edges, largest sum of turns first."""
    far = found.is_far
    label = _pieces(mesh, far)
    chosen = np.flatnonzero(far)
    if not len(chosen):
        return []
    order = np.argsort(label[chosen], kind="stable")
    groups = np.split(chosen[order], np.flatnonzero(np.diff(label[chosen][order])) + 1)
    # Rounded, so that mirrored regions come in the order of their faces.
    groups.sort(key=lambda faces: (-round(float(found.turn[faces].sum()), 6), int(faces[0])))
    result = []
    for faces in groups:
        worst = int(faces[found.turn[faces].argmax()])
        result.append(
            Region(
                faces=read_only(faces, np.int64),
                worst=worst,
                at=mesh.face_centers[worst],
                turn=float(found.turn[worst]),
                asymptotic=float(found.is_asymptotic[faces].mean()),
            )
        )
    return result


def _pieces(mesh: PolyMesh, chosen: Mask) -> Indices:
    """Label of the connected piece of each chosen face, shape (F,)."""
    pairs = mesh.topology.edge_faces[~mesh.topology.is_boundary_edge]
    pairs = pairs[chosen[pairs].all(axis=1)]
    shape = (len(chosen), len(chosen))
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=shape)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _broken(mesh: PolyMesh) -> list[Broken]:
    """Broken faces and short edges."""
    centers, ends = mesh.face_centers, mesh.edges
    middles = mesh.vertices[ends].mean(axis=1)
    reflex, turned = nonconvex_faces(mesh).tolist(), _turned_over(mesh).tolist()
    return [
        *(Broken("not convex", (face,), centers[face]) for face in reflex),
        *(Broken("turned over", (face,), centers[face]) for face in turned),
        *(
            Broken("short", (int(ends[edge, 0]), int(ends[edge, 1])), middles[edge])
            for edge in _short_edges(mesh).tolist()
        ),
    ]


def _turned_over(mesh: PolyMesh) -> Indices:
    """Faces whose normals look against those of their neighbours, beyond 120 degrees; rising.

    By the mean of the cosines: the neighbours of a cube's face look nowhere on average.
    """
    pairs = mesh.topology.edge_faces[~mesh.topology.is_boundary_edge]
    cosines = dot(mesh.face_normals[pairs[:, 0]], mesh.face_normals[pairs[:, 1]])
    number = mesh.topology.n_faces
    total = np.bincount(pairs.ravel(), np.repeat(cosines, 2), minlength=number)
    return np.flatnonzero(
        total < -0.5 * np.maximum(np.bincount(pairs.ravel(), minlength=number), 1)
    )


def _short_edges(mesh: PolyMesh) -> Indices:
    """Edges much shorter than those opposite to them in their faces; rising."""
    topology = mesh.topology
    quads = np.flatnonzero(topology.face_sizes == 4)
    sides = topology.face_edges[topology.offsets[quads][:, None] + np.arange(4)]
    opposite = mesh.edge_lengths[np.roll(sides, 2, axis=1)]
    number = mesh.topology.n_edges
    total = np.bincount(sides.ravel(), opposite.ravel(), minlength=number)
    count = np.bincount(sides.ravel(), minlength=number)
    return np.flatnonzero(mesh.edge_lengths < SHORT_EDGE * total / np.maximum(count, 1))
