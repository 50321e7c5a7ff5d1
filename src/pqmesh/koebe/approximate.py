"""The mesh with exact edge offsets that comes nearest to a given surface patch.

Meshes with edge offsets are few: on a grid of m x n faces the Koebe mesh S has 2m + 2n + 3 degrees
of freedom and the mesh M in P(S) another m + n + 3, against mn distances from a surface. In the
limit the surface must be L-isothermic (`square_patch`). The best such pair is sought among exact
ones only:

1. S near the normals of a start mesh of curvature lines, by its circle pattern;
2. M in P(S) nearest to the start, linear least squares;
3. steps of M and S together, along the linearised conditions e(M) x e(S) = 0, S tangent and planar,
   to smaller distances; each step is brought back to an exact pair before it is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.koebe.discs import exact_image, koebe_near
from pqmesh.koebe.edge_offset import image_error
from pqmesh.koebe.members import parallel_member
from pqmesh.koebe.polyhedron import tangency_deviation
from pqmesh.koebe.terms import Tangency
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.assembly import Assembly, Part
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.problem import Goal, Problem, Refreshing, gathered
from pqmesh.optimize.terms import Closeness, Planarity, anchor, fairness
from pqmesh.optimize.terms.linear import Combination
from pqmesh.optimize.terms.parallel import EdgeParallel
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.reference import Reference, SurfaceReference, TriangleReference
from pqmesh.vectors import Floats, Mask, dot, norm

# Weight of the exact conditions in a step; what they leave over is removed afterwards.
STIFF = 1e12
# Steps end when they lower the sum of squares by less than this share.
WORTH, LEAST_SHARE, TRIES = 1e-3, 1e-3, 20
# Faces that a step would break are braked, more at each try, and less from step to step.
FIRST_BRAKE, BRAKE_GROWTH, BRAKE_EASE, LAST_BRAKE = 1e2, 10.0, 0.1, 1e8


@dataclass(frozen=True)
class FitWeights:
    """Weights of the goals, on mean squares of residuals in mean edges.

    `closeness` is the distance from the surface; `fairness` that second differences of M stay as
    they are at the start, `image_fairness` those of S in its own mean edges; `anchor` that vertices
    stay where they are. `slide` is that of `parallel_member` in step 2.
    """

    closeness: float = 1e4
    fairness: float = 10.0
    image_fairness: float = 1e-3
    anchor: float = 0.1
    slide: float = 0.1


@dataclass(frozen=True, eq=False)
class EdgeOffsetFit:
    """A mesh with exact edge offsets near a surface patch, and how near it is.

    Attributes
    ----------
    mesh, image : QuadMesh
        The mesh M and its Gauss image S; M + dS are the edge offsets.
    start : QuadMesh
        What was to be approximated, vertices on the surface.
    deviation : (V,), model unit
        Distance of the vertices of M from the surface.
    member_deviation : (V,), model unit
        The same after step 2: what linear fitting alone gives.
    panel_deviation : (F,), model unit
        Distance of the middles of the panels from the surface: mostly that panels are flat.
    steps : int
        Joint steps taken.
    """

    mesh: QuadMesh
    image: QuadMesh
    start: QuadMesh
    deviation: Floats
    member_deviation: Floats
    panel_deviation: Floats
    steps: int

    @cached_property
    def uncovered(self) -> Floats:
        """Distance of each start vertex from the mesh, shape (V,), model unit.

        Large where the mesh fits well because it has shrunk or slid away.
        """
        faces = self.mesh.topology.face_lists()
        reference = TriangleReference.of_polygons(self.mesh.vertices, faces)
        return norm(self.start.vertices - reference.closest(self.start.vertices)[0])

    @cached_property
    def figures(self) -> dict[str, float]:
        """Table of what was reached: deviations in per cent of the mean edge.

        `tangency_max` and `parallel_max` are errors of the image; `offset_error_max` the largest
        error of an offset edge's distance per unit of offset; `edge_min`, `edge_max` are over the
        mean edge; `moved_max_pct` is the largest way of a vertex from its start.
        """
        edge = self.mesh.mean_edge_length / 100.0
        along = self.mesh.edge_vectors / self.mesh.edge_lengths[:, None]
        across = self.image.edge_vectors - dot(self.image.edge_vectors, along)[:, None] * along
        return {
            "deviation_max_pct": float(self.deviation.max()) / edge,
            "deviation_rms_pct": _rms(self.deviation) / edge,
            "member_max_pct": float(self.member_deviation.max()) / edge,
            "member_rms_pct": _rms(self.member_deviation) / edge,
            "panel_max_pct": float(self.panel_deviation.max()) / edge,
            "uncovered_max_pct": float(self.uncovered.max()) / edge,
            "moved_max_pct": float(norm(self.mesh.vertices - self.start.vertices).max()) / edge,
            "tangency_max": float(np.abs(tangency_deviation(self.image)).max()),
            "parallel_max": float(norm(across).max()),
            "planarity_max": float(planarity(self.mesh).max()),
            "offset_error_max": image_error(self.mesh, self.image.vertices),
            "edge_min": float(self.mesh.edge_lengths.min()) / self.mesh.mean_edge_length,
            "edge_max": float(self.mesh.edge_lengths.max()) / self.mesh.mean_edge_length,
        }


def approximate_edge_offset(
    surface: Surface,
    start: QuadMesh,
    uv: Floats,
    *,
    weights: FitWeights | None = None,
    most_steps: int = 40,
    progress: Callable[[int, float], None] | None = None,
) -> EdgeOffsetFit:
    """Best mesh with exact edge offsets near a surface patch.

    Not to come near is an answer: `EdgeOffsetFit.figures` tells how far it stays away.

    Parameters
    ----------
    surface : Surface
    start : QuadMesh
        A disc of curvature lines with vertices on the surface: `square_patch`, or a network with
        the edges of `square_edges`. One whose Gauss image has long faces has to slide far first,
        and may end far away.
    uv : (V, 2)
        Parameters of its vertices.
    weights : FitWeights, optional
    most_steps : int
        Of the joint optimisation.
    progress : callable, optional
        Called with the number of each step and the sum of squares.

    Raises
    ------
    MeshError
        When the start is no disc.

    References: the question is [thesis] section 4.2; theory: [pottmann2007], [pottmann2010].

    Examples
    --------
    >>> from pqmesh.koebe.square_patch import square_patch
    >>> from pqmesh.surface.formula import graph_surface
    >>> bowl = graph_surface("0.2*x**2+0.1*y**2", (-1.5, 1.5), (-1.5, 1.5))
    >>> patch = square_patch(bowl, np.array([0.0, 0.0]), (0.5, 0.9), 4)
    >>> fit = approximate_edge_offset(bowl, patch.mesh, patch.uv)
    >>> fit.figures["deviation_max_pct"] < 0.01, fit.figures["offset_error_max"] < 1e-12
    (True, True)
    """
    normals = shape_data(surface.jet(uv)).normal
    return fitted_edge_offset(
        start,
        SurfaceReference(surface, uv),
        normals,
        weights=weights,
        most_steps=most_steps,
        progress=progress,
    )


def fitted_edge_offset(
    start: QuadMesh,
    reference: Reference,
    normals: Floats,
    *,
    weights: FitWeights | None = None,
    most_steps: int = 40,
    progress: Callable[[int, float], None] | None = None,
) -> EdgeOffsetFit:
    """The same near any reference, from unit normals (V, 3) at the vertices of the start.

    Raises
    ------
    MeshError
        When the start is no disc, or its normals lead to no pattern of circles.
    """
    weights = weights or FitWeights()
    image = QuadMesh(koebe_near(start.topology, normals), start.topology)
    mesh = parallel_member(image, start.vertices, normals, weights.slide)
    before = _distances(reference, mesh.vertices)
    search = _Search.of(start, mesh, image, reference, weights)
    value = search.value
    for number in range(most_steps):
        moved = search.stepped()
        if moved is None:
            break
        search, before_value = moved, value
        value = search.value
        if progress is not None:
            progress(number, value)
        if value > (1.0 - WORTH) * before_value:
            break
    mesh = search.mesh
    after = _distances(reference, mesh.vertices)
    panels = _distances(reference, mesh.face_centers)
    return EdgeOffsetFit(mesh, search.image, start, after, before, panels, search.count)


@dataclass(frozen=True, eq=False)
class _Search:
    """An exact pair, and what a better one is looked for by."""

    mesh: QuadMesh
    image: QuadMesh
    problem: Problem
    assembly: Assembly
    guard: Guard
    brakes: Floats
    damping: float = 1e-6
    count: int = 0

    @classmethod
    def of(
        cls,
        start: QuadMesh,
        mesh: QuadMesh,
        image: QuadMesh,
        reference: Reference,
        weights: FitWeights,
    ) -> _Search:
        """The search from a first pair."""
        triples, bend = image.topology.straight_triples, np.array([1.0, -2.0, 1.0])
        bent = np.einsum("k,mki->mi", bend, image.vertices[triples])
        smooth = Combination({"image": triples}, bend, bent, image.mean_edge_length)
        flat = Planarity({"image": image.faces}, image.mean_edge_length)
        goals = (
            Goal("parallel", EdgeParallel.on(mesh, image), hard=True),
            Goal("tangency", Tangency.on(image), hard=True),
            Goal("planarity", flat, hard=True),
            Goal("closeness", Closeness.on(mesh, reference), weights.closeness),
            Goal("fairness", fairness(start), weights.fairness),
            Goal("image fairness", smooth, weights.image_fairness),
            Goal("anchor", anchor(start), weights.anchor),
        )
        problem = Problem({"vertices": mesh.vertices, "image": image.vertices}, goals)
        brakes = np.zeros(mesh.topology.n_faces)
        return cls(mesh, image, problem, Assembly(problem, mesh), Guard.of(mesh), brakes)

    @property
    def value(self) -> float:
        """Weighted sum of the soft goals' mean squares."""
        residuals = self.problem.residuals(self.problem.blocks)
        return sum(
            goal.weight * float((residuals[goal.name] ** 2).mean(axis=0).sum())
            for goal in self.problem.goals
            if not goal.hard
        )

    def stepped(self) -> _Search | None:
        """The pair after a step that lowers the value, None when there is none."""
        blocks = self.problem.blocks
        parts, residuals = [], []
        for goal in self.problem.goals:
            residual, jacobian = goal.term.evaluate(gathered(goal.term, blocks))
            scale = (STIFF if goal.hard else goal.weight) / max(len(residual), 1)
            parts.append(Part(scale, jacobian))
            residuals.append(residual)
        brakes, damping, before = BRAKE_EASE * self.brakes, self.damping, self.value
        for _ in range(TRIES):
            step = self._solved(parts, residuals, brakes, damping)
            found, blocking = (None, None) if step is None else self._tried(step)
            if found is not None and found.value < before:
                eased = max(0.2 * damping, 1e-9)
                return replace(found, damping=eased, brakes=brakes, count=self.count + 1)
            if blocking is not None and brakes[blocking].max() < LAST_BRAKE:
                # Only the faces in the way are held back; the others go on.
                stiffer = np.maximum(BRAKE_GROWTH * brakes, FIRST_BRAKE)
                brakes = np.where(blocking, stiffer, brakes)
            else:
                damping *= 10.0
        return None

    def _solved(
        self, parts: list[Part], residuals: list[Floats], brakes: Floats, damping: float
    ) -> Floats | None:
        """Step of the normal equations, with a resistance to all moves in mean edges."""
        values = self.assembly.matrix(parts, 0.0, brakes)
        size = len(self.assembly.free)
        lengths = np.repeat(
            [self.mesh.mean_edge_length, self.image.mean_edge_length], 3 * (size // 2)
        )
        self.assembly.add_diagonal(values, (damping / (lengths**2 * size)).reshape(-1, 3))
        try:
            step = self.assembly.factor(values).solve(self.assembly.descent(parts, residuals))
        except ArithmeticError:
            return None
        return step if np.isfinite(step).all() else None

    def _tried(self, step: Floats) -> tuple[_Search | None, Mask | None]:
        """The exact pair nearest to a step, or the faces (F,) that it would break."""
        blocks = self.assembly.moved(dict(self.problem.blocks), step)
        try:
            image, error = exact_image(self.image.with_vertices(blocks["image"]))
        except MeshError:
            return None, None
        if not error < LEAST_SHARE * self.image.mean_edge_length**2:
            return None, None
        mesh = parallel_member(image, blocks["vertices"])
        blocked = self.guard.blocked(mesh.vertices)
        if blocked.any():
            return None, blocked
        found = {"vertices": mesh.vertices, "image": image.vertices}
        goals = tuple(
            replace(goal, term=goal.term.refreshed(found))
            if isinstance(goal.term, Refreshing)
            else goal
            for goal in self.problem.goals
        )
        return replace(self, mesh=mesh, image=image, problem=Problem(found, goals)), None


def _distances(reference: Reference, points: Floats) -> Floats:
    """Distances of points from a surface."""
    return norm(points - reference.closest(points)[0])


def _rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt((values**2).mean()))
