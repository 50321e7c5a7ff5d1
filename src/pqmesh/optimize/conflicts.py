"""Constraints that cannot hold together, found before the run and named."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.mesh.measure import planarity_deviation
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.ending import Solution
from pqmesh.optimize.problem import Goal, Problem, Term, residual
from pqmesh.optimize.terms import (
    Circularity,
    Conicality,
    EdgeLength,
    NodeAxis,
    OnCurve,
    OnPlanes,
    PanelArea,
    PanelWidth,
    Planarity,
    PolygonPlanarity,
    Symmetry,
    Within,
)
from pqmesh.vectors import Floats, Indices, norm

FIGURES = (Planarity, PolygonPlanarity, Circularity, Conicality)
# Terms whose residual is a length over the mean edge.
LENGTHS = (Planarity, PolygonPlanarity, OnCurve, OnPlanes, Symmetry, Within)
ROUNDINGS, EPSILON = 4.0, float(np.finfo(np.float64).eps)
# Planes of one vertex agree when their common point misses each by less, in mean edges.
AGREE = 1e-9
# Singular values below this say that planes are parallel.
PARALLEL = 1e-9
# Faces with diagonals nearer than this, in mean edges, are not named.
NOT_FLAT = 1e-9
# So many elements are named at most.
MOST_NAMED = 8


class Hopeless(NamedTuple):
    """Elements of a hard goal that only read fixed rows and do not hold.

    Attributes
    ----------
    goal : Goal
    elements : (n,)
    beyond : (n,)
        By how much each misses: residual beyond slack.
    """

    goal: Goal
    elements: Indices
    beyond: Floats


def hopeless(problem: Problem, mesh: PolyMesh) -> list[Hopeless]:
    """What no optimisation can reach, because fixed rows forbid it.

    Parameters
    ----------
    problem : Problem
    mesh : PolyMesh
        The start.
    """
    rounding = ROUNDINGS * EPSILON * np.abs(mesh.vertices).max() / mesh.mean_edge_length
    found = []
    for goal in problem.goals:
        if not goal.hard:
            continue
        held = np.ones(_count(goal.term), dtype=np.bool_)
        for block, rows in goal.term.stencils.items():
            fixed = problem.fixed.get(block)
            held &= False if fixed is None else fixed[rows].all(axis=1)
        value = residual(goal.term, problem.blocks)
        beyond = norm(goal.beyond(value))
        bad = np.flatnonzero(held & (beyond > max(goal.tolerance, rounding)))
        if len(bad):
            found.append(Hopeless(goal, bad, beyond[bad]))
    return found


def check_consistent(problem: Problem, mesh: PolyMesh) -> None:
    """Nothing, where no contradiction is found.

    Raises
    ------
    SpecError
        Naming the vertices or the face, and the distance.
    """
    for each in hopeless(problem, mesh):
        raise SpecError(
            f"Constraints must not contradict each other; {said(each, mesh)}, and what it reads "
            f"is fixed. Free one of these vertices, or leave one of the constraints out."
        )
    _check_planes(problem, mesh)
    _check_curves(problem, mesh)


def without(problem: Problem, found: list[Hopeless]) -> Problem:
    """The problem without figures that it cannot reach, so that the rest is reached all the same.

    Only of planarity, circularity and conicality, which know nothing of an element but its rows.
    """
    gone = {each.goal.name: each.elements for each in found}
    goals = []
    for goal in problem.goals:
        if goal.name in gone and isinstance(goal.term, FIGURES):
            rows = np.delete(goal.term.stencils["vertices"], gone[goal.name], axis=0)
            goal = replace(goal, term=replace(goal.term, stencils={"vertices": rows}))
        goals.append(goal)
    return replace(problem, goals=tuple(goals))


def answered(solution: Solution, found: list[Hopeless], mesh: PolyMesh) -> Solution:
    """The solution of a problem `without` what was found, its reason naming the faces.

    Where nothing was found and there is no convergence, those that are worst at the end.
    """
    if not found:
        return solution if solution.converged else _with_worst(solution, mesh)
    missed = {each.goal.name: float(each.beyond.max()) for each in found}
    residuals = {
        name: max(value, missed.get(name, 0.0)) for name, value in solution.residuals.items()
    }
    reason = forbidden(found, mesh)
    if not solution.converged:
        reason += f"; beside that: {solution.reason}"
    return replace(solution, converged=False, reason=reason, residuals=residuals)


def _with_worst(solution: Solution, mesh: PolyMesh) -> Solution:
    """The solution with its worst faces in the reason, and how many of them hang on the rim."""
    topology = mesh.topology
    found = mesh.with_vertices(solution.blocks["vertices"])
    off = planarity_deviation(found) / mesh.mean_edge_length
    worst = np.argsort(-off, kind="stable")[:MOST_NAMED]
    worst = worst[off[worst] > NOT_FLAT]
    if not len(worst):
        return solution
    at_rim = np.add.reduceat(
        topology.is_boundary_vertex[topology.indices].astype(np.int64), topology.offsets[:-1]
    )
    held = at_rim[off > NOT_FLAT]
    reason = (
        f"{solution.reason}; with this boundary {len(held)} faces are not flat, "
        f"{int((held > 0).sum())} of them at it, the worst are {', '.join(map(str, worst))}"
    )
    return replace(solution, reason=reason)


def said(found: Hopeless, mesh: PolyMesh) -> str:
    """The worst of what cannot be reached, in words."""
    worst = int(found.beyond.argmax())
    element, beyond = int(found.elements[worst]), float(found.beyond[worst])
    term = found.goal.term
    rows = np.concatenate([stencil[element] for stencil in term.stencils.values()])
    much = f"{beyond * mesh.mean_edge_length:.4g}" if isinstance(term, LENGTHS) else f"{beyond:.4g}"
    if isinstance(term, Planarity):
        return f"face {_face(mesh, rows)} is not flat, its diagonals are {much} apart"
    if isinstance(term, PolygonPlanarity):
        return f"face {_face(mesh, rows)} is not flat, its corners are {much} out of plane"
    if isinstance(term, Circularity):
        return f"face {_face(mesh, rows)} has no circle, its angles are off by {much} rad"
    if isinstance(term, Conicality):
        return f"vertex {rows[0]} has no cone, its angles are off by {much} rad"
    if isinstance(term, NodeAxis):
        return f"vertex {rows[0]} has another axis, its faces differ by {much}"
    if isinstance(term, Symmetry):
        return f"vertex {rows[1]} is {much} away from the image of its partner {rows[0]}"
    if isinstance(term, EdgeLength):
        return f"edge {rows[0]}-{rows[1]} ({found.goal.name}) is out of range by {much}"
    if isinstance(term, PanelWidth | PanelArea):
        return f"face {_face(mesh, rows)} ({found.goal.name}) is out of range by {much}"
    return f"vertex {rows[0]} misses the {found.goal.name} by {much}"


def _face(mesh: PolyMesh, rows: Indices) -> str:
    """Number and vertices of the face with the given corners."""
    number = _number(mesh, rows)
    return f"{number} ({', '.join(map(str, mesh.topology.face_lists()[number]))})"


def _number(mesh: PolyMesh, rows: Indices) -> int:
    """The face with the given corners, which may be some of a polygon's."""
    topology = mesh.topology
    same = np.isin(topology.indices, rows)
    inside = np.bincount(topology.corner_faces, same, minlength=topology.n_faces)
    with_all = np.flatnonzero(inside == len(rows))
    return int(with_all[topology.face_sizes[with_all].argmin()])


def forbidden(found: list[Hopeless], mesh: PolyMesh) -> str:
    """One line on all that fixed vertices forbid."""
    lines = []
    for each in found:
        line = said(each, mesh)
        if len(each.elements) > 1:
            line += f" ({len(each.elements)} such"
            if isinstance(each.goal.term, Planarity | PolygonPlanarity):
                worst = each.elements[np.argsort(-each.beyond, kind="stable")][:MOST_NAMED]
                corners = each.goal.term.stencils["vertices"][worst]
                line += f": {', '.join(str(_number(mesh, rows)) for rows in corners)}"
                line += ", ..." if len(each.elements) > MOST_NAMED else ""
            line += ")"
        lines.append(line)
    return "held by the boundary at all their vertices: " + "; ".join(lines)


# --- planes and curves ----------------------------------------------------------------------


def _check_planes(problem: Problem, mesh: PolyMesh) -> None:
    """Refuse a vertex whose planes have no common point."""
    rows, points, normals = _all_planes(problem)
    order = np.argsort(rows, kind="stable")
    rows, points, normals = rows[order], points[order], normals[order]
    vertices, first, counts = np.unique(rows, return_index=True, return_counts=True)
    for vertex, start, count in zip(
        vertices[counts > 1].tolist(),
        first[counts > 1].tolist(),
        counts[counts > 1].tolist(),
        strict=True,
    ):
        part = slice(start, start + count)
        here = mesh.vertices[vertex]
        heights = np.einsum("ni,ni->n", points[part] - here, normals[part])
        common = np.linalg.lstsq(normals[part], heights, rcond=PARALLEL)[0]
        misses = np.abs(normals[part] @ common - heights)
        if misses.max() > AGREE * mesh.mean_edge_length:
            raise SpecError(
                f"The planes of a vertex must have a common point; the {count} planes and levels "
                f"of vertex {vertex} have none: the nearest point misses one by "
                f"{misses.max():.4g}. Leave one of them out."
            )


def _all_planes(problem: Problem) -> tuple[Indices, Floats, Floats]:
    """Vertex, point and normal of every hard plane."""
    rows, points = [np.empty(0, dtype=np.int64)], [np.empty((0, 3))]
    normals = [np.empty((0, 3))]
    for goal in problem.goals:
        if goal.hard and isinstance(goal.term, OnPlanes):
            rows.append(goal.term.stencils["vertices"][:, 0])
            points.append(goal.term.points)
            normals.append(goal.term.normals)
    return np.concatenate(rows), np.concatenate(points), np.concatenate(normals)


def _check_curves(problem: Problem, mesh: PolyMesh) -> None:
    """Refuse a vertex whose curve lies on one side of one of its planes."""
    rows, points, normals = _all_planes(problem)
    for goal in problem.goals:
        if not (goal.hard and isinstance(goal.term, OnCurve)) or not len(rows):
            continue
        ends = np.concatenate([goal.term.curves.starts, goal.term.curves.ends])
        both = np.isin(rows, goal.term.stencils["vertices"][:, 0])
        planes = np.unique(np.column_stack([points, normals])[both], axis=0)
        for plane in planes:
            heights = (ends - plane[:3]) @ plane[3:]
            gap = max(float(heights.min()), float(-heights.max()))
            if gap > AGREE * mesh.mean_edge_length:
                same = (points == plane[:3]).all(axis=1) & (normals == plane[3:]).all(axis=1)
                vertex = int(rows[both & same][0])
                raise SpecError(
                    f"The curve and the planes of a vertex must meet; the {goal.name} of vertex "
                    f"{vertex} stays {gap:.4g} away from its plane or level. Leave one of them "
                    f"out, or move it."
                )


def _count(term: Term) -> int:
    """Number of elements."""
    return len(next(iter(term.stencils.values())))
