"""How strongly to hold on to the reference: as strongly as the mesh can bear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.mesh.conjugacy import conjugacy
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.optimize.conflicts import Hopeless, answered, hopeless, without
from pqmesh.optimize.constraints import Constraints, Within
from pqmesh.optimize.ending import OUT_OF_MEMORY, SETTLED
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.multilevel import coarse_to_fine
from pqmesh.optimize.problem import Problem, Term, residual
from pqmesh.optimize.recipes import LOOSE, Weights, hard_goals, problem_for
from pqmesh.optimize.solver import Solution, Step, solve
from pqmesh.optimize.terms.curves import OnCurve
from pqmesh.optimize.twist import untwisted
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Indices, far_origin, norm

# A mesh that does not come right is tried again with less of a hold on surface and places.
LOOSER = (Weights(closeness=10.0, fairness=0.1, anchor=0.01), LOOSE)
# Vertices are free to slide where the weight of the anchor is not above this.
SLIDING = 0.1
# Meshes with panels as flat as this are solved where they are, whatever their lines.
NEARLY_FLAT = 1e-4
# To stay within a distance, closeness is raised by this factor between tries, up to the second;
# what came by way of coarser meshes starts at the last.
FACTOR, STRONGEST, WEAKEST = 10.0, 1e7, 1.0


def optimized(
    kind: str,
    start: PolyMesh,
    reference: Reference,
    *,
    boundary: str = "free",
    weights: Weights | None = None,
    within: float | None = None,
    warp: float = 0.0,
    constraints: Constraints | None = None,
    progress: Callable[[Step], None] | None = None,
) -> Solution:
    """Solution of a recipe with a closeness that the mesh can bear.

    A net that is far from conjugate goes by way of coarser meshes (`coarse_to_fine`).

    A strong pull to the reference keeps the design, but may hold a mesh that has far to go in
    front of a fold; then the pull is relaxed and the try repeated from the start. With `within`
    the pull is raised until every vertex is that close; where no pull does, the distance becomes a
    bound.

    Parameters
    ----------
    kind : 'planar', 'conical', 'circular' or 'conical-circular'
    start : PolyMesh
    reference : Reference
    boundary : 'free', 'fixed' or 'glide'
    weights : Weights, optional
        Those of the first try. By default vertices keep their places, which is for a mesh that
        is its own reference; `SURFACE` is for nets on a surface that matters more.
    within : float, optional, model unit
    warp : float, model unit
        Panels may be out of plane by so much; the rest of the freedom goes to the soft goals.
    constraints : Constraints, optional
        What is asked of the mesh beside.
    progress : callable, optional
        Called with every step.

    Returns
    -------
    Solution
        The first that converges; else the one with the smallest hard residuals. Where a boundary
        that stays forbids some faces, the rest is solved, and the reason names them; where it
        leaves too little room, the reason names the worst faces.

    Raises
    ------
    SpecError
        For an unknown kind or boundary, and for constraints that contradict each other.
    """
    origin = far_origin(start.vertices)
    if origin.any():
        # Far from the origin coordinates have few digits left for what is between them.
        found = optimized(
            kind,
            start.with_vertices(start.vertices - origin),
            reference.about(origin),
            boundary=boundary,
            weights=weights,
            within=within,
            warp=warp,
            constraints=None if constraints is None else constraints.about(origin),
            progress=progress,
        )
        moved = found.blocks | {"vertices": found.blocks["vertices"] + origin}
        return replace(found, blocks=moved)
    first_try = weights or Weights()
    asked = _Asked(kind, start, reference, boundary, first_try, warp, constraints, progress)
    impossible = asked.impossible
    best, held, first = asked.tried()
    if within is not None and best.converged:
        best = asked.nearer(best, held, first, within)
    if "conical" in kind and best.converged and not impossible:
        best = untwisted(best, start, partial(asked.with_flat_edges, held))
    if boundary == "free":
        return best
    best = _on_curves(best, without(asked.problem(held, start), impossible), start)
    return answered(best, impossible, start)


@dataclass(frozen=True, eq=False)
class _Asked:
    """What is asked for, and the ways to it."""

    kind: str
    start: PolyMesh
    reference: Reference
    boundary: str
    weights: Weights
    warp: float
    constraints: Constraints | None
    progress: Callable[[Step], None] | None

    @cached_property
    def impossible(self) -> list[Hopeless]:
        """What the boundary forbids."""
        if self.boundary == "free":
            return []
        return hopeless(self.problem(Weights(), self.start), self.start)

    @cached_property
    def guard(self) -> Guard:
        """The limits of all tries: those of the start."""
        return Guard.of(self.start)

    def problem(self, weights: Weights, first: PolyMesh, flat: Indices | None = None) -> Problem:
        """The problem whose soft goals hold on to a mesh."""
        return problem_for(
            self.kind,
            first,
            self.reference,
            boundary=self.boundary,
            weights=weights,
            warp=self.warp,
            constraints=self.constraints,
            flat_edges=flat,
        )

    def solved(self, problem: Problem, first: PolyMesh, resting: float = SETTLED) -> Solution:
        """Its solution from a mesh, without what is impossible."""
        return solve(
            without(problem, self.impossible),
            first,
            resting=resting,
            guard=self.guard,
            progress=lambda _, step: self.progress(step) if self.progress else None,
        )

    def with_flat_edges(
        self, weights: Weights, found: PolyMesh, flat: Indices, resting: float
    ) -> Solution:
        """The solution near a found mesh whose flat edges keep the axes of their ends aligned."""
        # What is soft holds on to the start, as before.
        held = self.problem(weights, self.start, flat)
        _, blocks = hard_goals(self.kind, found, flat_edges=flat)
        # Axes are measured in mean edges of the mesh that the goals are made for.
        blocks["axes"] = blocks["axes"] * (self.start.mean_edge_length / found.mean_edge_length)
        return self.solved(replace(held, blocks={**held.blocks, **blocks}), found, resting)

    def by_levels(self) -> Solution | None:
        """The solution by way of coarser meshes, where there is such a way."""
        if self.boundary == "glide" or self.constraints or not self.start.topology.is_quad:
            return None
        return coarse_to_fine(
            self.kind,
            QuadMesh(self.start.vertices, self.start.topology),
            self.reference,
            boundary=self.boundary,
            warp=self.warp,
            progress=self.progress,
        )

    def tried(self) -> tuple[Solution, Weights, PolyMesh]:
        """The first solution that converges, its weights, and the mesh that these hold on to."""
        # Vertices that may slide do so on the mesh itself; held ones would go zigzag there.
        first_levels = (
            self.weights.anchor > SLIDING
            and float(planarity(self.start).max()) > NEARLY_FLAT
            and conjugacy(self.start).lines_are_far
        )
        best = self.by_levels() if first_levels else None
        if best is not None and best.converged:
            # The design is where the levels led; from there it may be pulled closer.
            first = self.start.with_vertices(best.blocks["vertices"])
            return best, replace(self.weights, closeness=WEAKEST), first
        # Where the boundary forbids some faces it leaves the others little room.
        tight, *looser = LOOSER if self.impossible else (self.weights, *LOOSER)
        weights, found = tight, _better(self._attempt(tight, self.start), best)
        for weights in looser:
            if found.converged or found.reason == OUT_OF_MEMORY:
                break
            found = _better(self._attempt(weights, self.start), found)
        if not found.converged and not first_levels and found.reason != OUT_OF_MEMORY:
            found = _better(found, self.by_levels())
        return found, weights, self.start

    def nearer(self, best: Solution, weights: Weights, first: PolyMesh, within: float) -> Solution:
        """The solution pulled to the surface until it is so near, as far as that is possible."""
        distance = self._distance(best)
        while distance > within and weights.closeness * FACTOR <= STRONGEST:
            stronger = replace(weights, closeness=weights.closeness * FACTOR)
            solution = self._attempt(stronger, first)
            if not solution.converged or self._distance(solution) > distance:
                break
            best, weights, distance = solution, stronger, self._distance(solution)
        if distance <= within:
            return best
        return self._bounded(weights, first, within) or best

    def _bounded(self, weights: Weights, first: PolyMesh, within: float) -> Solution | None:
        """The solution that is kept so near by a bound, where there is one."""
        parts = () if self.constraints is None else self.constraints.parts
        bounded = replace(self, constraints=Constraints((*parts, Within(within))))
        try:
            solution = bounded._attempt(weights, first)
        except SpecError:
            return None  # Vertices that may not move are farther away.
        return solution if solution.converged else None

    def _attempt(self, weights: Weights, first: PolyMesh) -> Solution:
        return self.solved(self.problem(weights, first), first)

    def _distance(self, solution: Solution) -> float:
        """Largest distance of a vertex to the reference."""
        vertices = solution.blocks["vertices"]
        return float(norm(vertices - self.reference.closest(vertices)[0]).max())


def _on_curves(best: Solution, problem: Problem, start: PolyMesh) -> Solution:
    """A mesh that did not converge, put on the curves that it was to lie on.

    What cannot be met elsewhere is no reason to leave them: they are the joints to other parts.
    Where a face would break, its vertices stay.
    """
    curves = [goal.term for goal in problem.goals if goal.hard and isinstance(goal.term, OnCurve)]
    if best.converged or not curves:
        return best
    before, guard = best.blocks["vertices"], Guard.of(start)
    on_curves = before.copy()
    for each in curves:
        rows = each.stencils["vertices"][:, 0]
        on_curves[rows], _ = each.curves.feet(before[rows], each.curves.nearest(before[rows]))
    vertices = on_curves
    while (blocked := guard.blocked(vertices) & ~guard.blocked(before)).any():
        stays = np.isin(
            np.arange(len(before)), start.topology.indices[blocked[start.topology.corner_faces]]
        )
        vertices = np.where(stays[:, None], before, vertices)
    blocks = best.blocks | {"vertices": vertices}
    residuals = {}
    for goal in problem.goals:
        if goal.hard:
            term: Term = goal.term
            if isinstance(term, OnCurve):
                rows = term.stencils["vertices"][:, 0]
                term = replace(term, segments=term.curves.nearest(vertices[rows]))
            found = residual(term, blocks)
            residuals[goal.name] = float(np.abs(found).max(initial=0.0))
    return replace(best, blocks=blocks, residuals=residuals)


def _better(solution: Solution, other: Solution | None) -> Solution:
    """The one that converged, or else has the smaller residuals."""
    if other is None or (solution.converged and not other.converged):
        return solution
    if other.converged or _worst(other) < _worst(solution):
        return other
    return solution


def _worst(solution: Solution) -> float:
    """Largest hard residual."""
    return max(solution.residuals.values(), default=0.0)
