"""Editing: drag vertices of an exact mesh, and it stays exact.

What depends on the pattern of the problem alone is worked out once, when the editing begins: where
the contributions go, the fill-reducing order, the limits of the guard. A drag is then a step or
two from the last mesh, with its factor used for the rounds of Newton's method that follow.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import SpecError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.assembly import Assembly
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.problem import Goal, Problem
from pqmesh.optimize.recipes import hard_goals
from pqmesh.optimize.solver import Solution, solve
from pqmesh.optimize.terms import Combination, anchor, fairness, held_edges
from pqmesh.vectors import Floats, Indices, Mask, norm, read_only, unit

# A drag ends once the hard goals are this well met and no vertex moves further than the second
# number, in mean edges: the next drag goes on from there.
TOLERANCE, RESTING = 1e-7, 0.3
# First penalty of a drag: a drag bends the goals, and a bolder one would hold the handles back.
BOLD = 1e6
# Weights, on mean squares in mean edges. The handles reach their targets where the mesh has the
# freedom. Smoothness counts more than lengths, so that a drag bends a region and makes no peak.
HANDLES, EDGES, FAIRNESS, ANCHOR = 1e2, 1e-2, 1e1, 1e-3
MOST_STEPS = 12
# One drag leads a handle no further than this, in mean edges. The steps of a drag have an end, and
# where they end on the way no exact mesh has been found. Then the next drags go less far: half as
# far each, down to the second number.
REACH, LEAST_REACH = 1.0, 0.05


@dataclass(frozen=True, eq=False)
class Editing:
    """A mesh with handles, and the work that its pattern needs only once.

    Attributes
    ----------
    mesh : PolyMesh
        As it is now.
    rest : PolyMesh
        Where the editing began: edges and fairness hold on to it, so that a drag and its way back
        lead to where it was.
    handles : (n,)
        Vertices that are dragged.
    """

    mesh: PolyMesh
    rest: PolyMesh
    handles: Indices
    _problem: Problem
    _assembly: Assembly
    _guard: Guard
    _reach: float = REACH

    @classmethod
    def of(
        cls, kind: str, mesh: PolyMesh, handles: ArrayLike, *, fixed: Mask | None = None
    ) -> Editing:
        """Begin to edit a mesh.

        Parameters
        ----------
        kind : 'planar', 'conical', 'circular' or 'conical-circular'
            What the mesh is and stays.
        mesh : PolyMesh
        handles : (n,)
            Numbers of the vertices to drag, each once; targets come in the same order.
        fixed : (V,) bool, optional
            Vertices that stay where they are.

        Raises
        ------
        SpecError
            For an unknown kind, and for handles that are not vertices, are named twice, or are
            fixed.

        Examples
        --------
        >>> from pqmesh.mesh.exact import rotational_mesh
        >>> from pqmesh.mesh.measure import measures
        >>> profile = np.array([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.8]])
        >>> vase = rotational_mesh(profile, 0.3 * np.arange(8))
        >>> editing = Editing.of("conical", vase, [10])
        >>> editing, solution = editing.dragged(vase.vertices[[10]] + [0.1, 0.0, 0.05])
        >>> solution.converged, measures(editing.mesh)["cone_spread_max"] < 1e-6
        (True, True)
        """
        given, count = np.asarray(handles).reshape(-1), mesh.topology.n_vertices
        whole = given.size and np.issubdtype(given.dtype, np.integer)
        once = len(np.unique(given)) == len(given)
        if not whole or given.min() < 0 or given.max() >= count or not once:
            raise SpecError(
                f"Handles must be vertices 0..{count - 1} of the mesh, at least one, each once; "
                f"found {given.tolist()}. Choose them among these."
            )
        chosen = given.astype(np.int64)
        if fixed is not None and fixed[chosen].any():
            raise SpecError(
                f"Handles must be free to move; vertex {int(chosen[fixed[chosen]][0])} is fixed. "
                f"Free it, or drag another."
            )
        hard, blocks = hard_goals(kind, mesh)
        goals = (
            *(replace(goal, tolerance=TOLERANCE) for goal in hard),
            Goal("handles", anchor(mesh, chosen), HANDLES),
            Goal("edges", held_edges(mesh), EDGES),
            Goal("fairness", fairness(mesh), FAIRNESS),
            Goal("anchor", anchor(mesh), ANCHOR),
        )
        problem = Problem(blocks, goals, {} if fixed is None else {"vertices": fixed})
        return cls(
            mesh,
            mesh,
            read_only(chosen, np.int64),
            problem,
            Assembly(problem, mesh),
            Guard.of(mesh),
        )

    def dragged(self, targets: ArrayLike) -> tuple[Editing, Solution]:
        """The editing with its handles near targets (n, 3), and how the step went.

        Targets farther away than a mean edge are neared by that much, or by less where the mesh
        does not follow; drag again while there are `gaps`. Where the solution did not converge, its
        mesh is the best one found, and no face of it is broken: the caller may keep it or go back.

        Raises
        ------
        SpecError
            For targets that are not one finite point for each handle.
        """
        wanted = np.array(targets, dtype=np.float64)
        if wanted.shape != (len(self.handles), 3) or not np.isfinite(wanted).all():
            raise SpecError(
                f"Targets must be one finite point for each of the {len(self.handles)} handles, "
                f"shape ({len(self.handles)}, 3); found shape {wanted.shape}. Give a row for each."
            )
        way = wanted - self.mesh.vertices[self.handles]
        gaps, edge = norm(way), self.rest.mean_edge_length
        far = gaps > self._reach * edge
        wanted[far] = self.mesh.vertices[self.handles[far]] + self._reach * edge * unit(way[far])
        goals = tuple(
            replace(goal, term=_aimed(goal.term, wanted)) if goal.name == "handles" else goal
            for goal in self._problem.goals
        )
        problem = replace(self._problem, goals=goals)
        solution = solve(
            problem,
            self.rest,
            most_steps=MOST_STEPS,
            resting=RESTING,
            bold=BOLD,
            enough=1.0,
            assembly=self._assembly,
            guard=self._guard,
        )
        mesh = self.mesh.with_vertices(solution.blocks["vertices"])
        following = replace(problem, blocks={**problem.blocks, **solution.blocks})
        stays = gaps.max() > LEAST_REACH * edge and (mesh.vertices == self.mesh.vertices).all()
        reach = max(0.5 * self._reach, LEAST_REACH) if stays else min(2.0 * self._reach, REACH)
        return replace(self, mesh=mesh, _problem=following, _reach=reach), solution

    def gaps(self, targets: ArrayLike) -> Floats:
        """Distances (n,) of the handles from targets (n, 3), model unit."""
        return norm(self.mesh.vertices[self.handles] - np.asarray(targets, dtype=np.float64))


def _aimed(term: object, targets: Floats) -> Combination:
    """The term of the handles with new targets."""
    assert isinstance(term, Combination)
    return replace(term, targets=targets)
