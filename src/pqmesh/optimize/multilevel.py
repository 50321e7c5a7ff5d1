"""Coarse to fine, for nets that start far from where they have to go.

A net that is far from conjugate must slide or leave the surface by a length that does not fall
with its edges. On the mesh of every second line, and again, this length is an edge or two: there
it is found in a few steps, and the displacement is interpolated to the next finer mesh as its
start. Closeness, which counts distances in edges, is lowered with the square of the edge, so that
the same displacement costs the same on every level and the levels agree.

References: subdivision and optimisation in turns [liu2006].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pqmesh.mesh.coarse import Coarse, coarsened
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.recipes import LOOSE, problem_for
from pqmesh.optimize.solver import Solution, Step, solve
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats

# The coarsest mesh has at least as many faces, and the finest at least four times as many.
FEWEST_FACES = 16
# An interpolated displacement that breaks a face is shortened by this factor, so often at most.
CUT, MOST_CUTS = 0.8, 12


def coarse_to_fine(
    kind: str,
    start: QuadMesh,
    reference: Reference,
    *,
    boundary: str = "free",
    warp: float = 0.0,
    progress: Callable[[Step], None] | None = None,
) -> Solution | None:
    """Solution by way of coarser meshes, None where the mesh cannot be coarsened.

    The soft goals of each level hold on to what the coarser one found.

    Parameters
    ----------
    kind : 'planar', 'conical' or 'circular'
    start : QuadMesh
    reference : Reference
    boundary : 'free' or 'fixed'
    warp : float, model unit
        Panels may be out of plane by so much.
    progress : callable, optional
        Called with every step on every level.
    """
    levels: list[Coarse] = []
    meshes = [start]
    while (coarse := coarsened(meshes[-1])) and coarse.mesh.topology.n_faces >= FEWEST_FACES:
        levels.append(coarse)
        meshes.append(coarse.mesh)
    if not levels:
        return None
    solution: Solution | None = None
    for mesh in reversed(meshes):
        # Its own faces are the measure, not those that the interpolation leaves.
        first, guard = mesh, Guard.of(mesh)
        if solution is not None:
            coarse = levels.pop()
            moved = solution.blocks["vertices"] - coarse.mesh.vertices
            first = _moved(mesh, coarse.prolongation @ moved, guard)
        finer = mesh.mean_edge_length / meshes[-1].mean_edge_length
        weights = replace(LOOSE, closeness=LOOSE.closeness * finer**2)
        problem = problem_for(kind, first, reference, boundary=boundary, weights=weights, warp=warp)
        solution = solve(
            problem,
            first,
            guard=guard,
            progress=lambda _, step: progress(step) if progress else None,
        )
    return solution


def _moved(mesh: QuadMesh, way: Floats, guard: Guard) -> QuadMesh:
    """The mesh moved along a way, as far as no face breaks."""
    for _ in range(MOST_CUTS):
        moved = mesh.with_vertices(mesh.vertices + way)
        if not any(part.any() for part in guard.broken(moved.vertices)):
            return moved
        way = CUT * way
    return mesh
