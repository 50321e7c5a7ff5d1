"""Flat edges of a conical mesh whose ends have axes that do not lie in a plane with them.

An edge between faces of two planes is parallel to itself in every offset: it lies in both planes.
Where both faces of an edge lie in one plane, as they may at a vertex of valence above 4 whose
faces fall into three planes, each end goes where its own other faces take it, and the beam between
them is twisted although every vertex has its cone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.slides import edge_equations, fold_sines, least_squares, touching_vectors
from pqmesh.optimize.ending import SETTLED, Solution
from pqmesh.vectors import Indices

# Ridges may turn at vertices that are not regular so many times.
MOST_TURNS = 20
# Faces whose normals meet at less than this (radians) lie in one plane as far as axes go.
FLAT = 1e-5
# Axes are in a plane with their edge up to this angle, radians.
SKEW = 1e-8


def untwisted(
    best: Solution, start: PolyMesh, solved: Callable[[PolyMesh, Indices, float], Solution]
) -> Solution:
    """A conical mesh whose flat edges have ends with axes in a plane with them, if one is found.

    A vertex gives way by laying its faces into two planes, so that its axis may turn along their
    common line: its next edge is flat then, and so on, until a ridge has come to the boundary.
    So whole mesh polylines are asked for with each flat edge: where there is a fold, ends have
    their axes in a plane with the edge anyway.

    Parameters
    ----------
    best : Solution
    start : PolyMesh
    solved : callable
        Solution near a mesh with the axes of some edges aligned, from (mesh, edges, resting).
    """
    found, flat = best, np.empty(0, dtype=np.int64)
    for _ in range(MOST_TURNS):
        mesh = start.with_vertices(found.blocks["vertices"])
        known, new = flat, flat_edges(mesh)
        if not (len(known) or is_skew(mesh, new)):
            return best
        flat = np.union1d(known, _with_their_lines(mesh, new))
        ended = len(flat) == len(known)
        # Only the last solution is waited for to come to rest.
        found = solved(mesh, flat, SETTLED if ended else np.inf)
        if not found.converged:
            return best
        best = replace(best, steps=best.steps + found.steps)
        if ended:
            end = start.with_vertices(found.blocks["vertices"])
            return best if is_skew(end, flat) else replace(found, steps=best.steps)
    return best


def flat_edges(mesh: PolyMesh) -> Indices:
    """Edges between inner vertices whose faces lie in one plane, rising.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> flat_edges(cube())
    array([], dtype=int64)
    """
    return np.flatnonzero(mesh.topology.has_inner_ends & (fold_sines(mesh) < FLAT))


def _with_their_lines(mesh: PolyMesh, edges: Indices) -> Indices:
    """All edges between inner vertices on the mesh polylines of some, rising."""
    lines = mesh.topology.polyline_of_edge
    return np.flatnonzero(mesh.topology.has_inner_ends & np.isin(lines, lines[edges]))


def is_skew(mesh: PolyMesh, edges: Indices) -> bool:
    """Whether no axes, as far as the planes leave a choice, lie in a plane with each flat edge."""
    if not len(edges):
        return False
    touching = touching_vectors(mesh)
    matrix, gap = edge_equations(mesh, touching, edges)
    if matrix.nnz:
        gap = gap + matrix @ least_squares(matrix, -gap)
    return bool(np.abs(gap).max(initial=0.0) > SKEW)
