"""Constraints as goals and fixed rows of a problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import singledispatch
from typing import NamedTuple

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize import constraints as asked
from pqmesh.optimize.conflicts import check_consistent
from pqmesh.optimize.ending import Solution
from pqmesh.optimize.problem import Goal, Problem, Refreshing, Term, residual
from pqmesh.optimize.selection import boundary_corners, chosen_polylines, selected
from pqmesh.optimize.symmetric import partners, reflection, rotation
from pqmesh.optimize.terms import (
    EdgeLength,
    Gliding,
    NodeAxis,
    OnCurve,
    OnPlanes,
    PanelArea,
    PanelWidth,
    PlanarPolyline,
    Symmetry,
    Within,
    anchor,
)
from pqmesh.optimize.terms.sizes import Range
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats, Indices, Mask, unit


@dataclass(frozen=True, eq=False)
class _Wanted:
    """A term that a constraint makes: its slack, the tolerance if hard, the blocks it needs."""

    term: Term
    slack: float = 0.0
    tolerance: float = 1e-12
    blocks: Mapping[str, Floats] = field(default_factory=dict)


def constrained(
    problem: Problem, mesh: PolyMesh, reference: Reference, constraints: asked.Constraints
) -> Problem:
    """A problem with constraints added.

    Parameters
    ----------
    problem : Problem
        Its block `vertices` is the mesh.
    mesh : PolyMesh
        The start.
    reference : Reference
    constraints : Constraints

    Returns
    -------
    Problem
        With a goal, named as the constraint is, for each; hard fixed vertices as fixed rows.

    Raises
    ------
    SpecError
        For a selection that is empty or out of range, a symmetry that the start has not, and
        constraints that contradict each other, named with the vertex or face and the distance.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> from pqmesh.optimize.constraints import Constraints, Level
    >>> from pqmesh.optimize.recipes import problem_for
    >>> from pqmesh.optimize.solver import solve
    >>> from pqmesh.surface.reference import TriangleReference
    >>> start = rotational_mesh([[2, 0.1], [2.4, 0.5], [2.5, 1.2]], [0, 0.3, 0.6, 0.9])
    >>> surface = TriangleReference.of_polygons(start.vertices, start.faces.tolist())
    >>> wanted = Constraints((Level((0, 1, 2, 3), 0.0),))
    >>> problem = constrained(problem_for("planar", start, surface), start, surface, wanted)
    >>> found = solve(problem, start)
    >>> found.converged, bool(abs(found.blocks["vertices"][:4, 2]).max() < 1e-12)
    (True, True)
    """
    fixed = np.zeros(mesh.topology.n_vertices, dtype=np.bool_)
    fixed |= problem.fixed.get("vertices", False)
    goals, blocks = list(problem.goals), dict(problem.blocks)
    names = {goal.name for goal in goals}
    for part in constraints.parts:
        stay = _staying(part, mesh)
        if part.hard:
            fixed[stay] = True
        wanted = list(_wanted(part, mesh, reference))
        if len(stay) and not part.hard:
            wanted.append(_Wanted(anchor(mesh, stay)))
        for each in wanted:
            name = _fresh(part.name, names)
            names.add(name)
            named = {_fresh(block, set(blocks)): rows for block, rows in each.blocks.items()}
            term = _renamed(each.term, dict(zip(each.blocks, named, strict=True)))
            blocks |= named
            goals.append(Goal(name, term, part.weight, part.hard, each.tolerance, each.slack))
    result = Problem(blocks, tuple(goals), {**problem.fixed, "vertices": fixed})
    check_consistent(result, mesh)
    return result


class Missed(NamedTuple):
    """The constraint that is missed by most: its name, by how much, and a vertex of the place.

    The value is in mean edges or radians.
    """

    name: str
    value: float
    vertex: int


def constraint_miss(
    start: PolyMesh,
    reference: Reference,
    constraints: asked.Constraints | None,
    solution: Solution,
) -> Missed | None:
    """By how much the hard constraints are missed, beyond their slack, and where.

    Parameters
    ----------
    start : PolyMesh
    reference : Reference
    constraints : Constraints, optional
    solution : Solution
        Of a problem with these constraints, its vertices where the start's were.

    Returns
    -------
    Missed, or None without constraints
    """
    if constraints is None:
        return None
    problem = constrained(Problem({"vertices": start.vertices}, ()), start, reference, constraints)
    worst = Missed("", 0.0, 0)
    for goal in problem.goals:
        if goal.hard:
            term = goal.term
            if isinstance(term, Refreshing):
                term = term.refreshed(solution.blocks)
            beyond = goal.beyond(residual(term, solution.blocks))
            each = np.abs(beyond).max(axis=1, initial=0.0)
            if each.max(initial=0.0) > worst.value:
                element = int(each.argmax())
                vertex = int(term.stencils["vertices"][element, 0])
                worst = Missed(goal.name, float(each[element]), vertex)
    return worst


def _fresh(name: str, taken: set[str]) -> str:
    """A name, with a number behind it where it is taken."""
    if name not in taken:
        return name
    number = 2
    while f"{name} {number}" in taken:
        number += 1
    return f"{name} {number}"


def _renamed(term: Term, names: Mapping[str, str]) -> Term:
    """The term with its blocks of unknowns under other names."""
    if all(old == new for old, new in names.items()):
        return term
    stencils = {names.get(block, block): rows for block, rows in term.stencils.items()}
    return replace(term, stencils=stencils)  # type: ignore[type-var]


def _staying(part: asked.Constraint, mesh: PolyMesh) -> Indices:
    """Vertices that a constraint keeps where they are."""
    if isinstance(part, asked.Fixed):
        return selected(part.vertices, mesh)
    if isinstance(part, asked.Corners):
        return np.flatnonzero(boundary_corners(mesh, part.turn))
    if isinstance(part, asked.Glide):
        return _gliding(part, mesh)[1]
    return np.empty(0, dtype=np.int64)


def _gliding(part: asked.Glide, mesh: PolyMesh) -> tuple[Indices, Indices]:
    """Vertices that glide, and corners of the boundary among those chosen."""
    chosen = selected(part.vertices, mesh)
    inside = chosen[~mesh.topology.is_boundary_vertex[chosen]]
    if len(inside):
        raise SpecError(
            f"Only vertices of the boundary can glide on it; vertex {inside[0]} lies inside "
            f"({len(inside)} such). Choose among the boundary."
        )
    corners = boundary_corners(mesh)[chosen]
    return chosen[~corners], chosen[corners]


# --- the goals of each constraint -----------------------------------------------------------


@singledispatch
def _wanted(part: asked.Constraint, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    """Terms of a constraint; none for those that only keep vertices where they are."""
    return []


@_wanted.register
def _(part: asked.Glide, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    gliding, _ = _gliding(part, mesh)
    return [_Wanted(Gliding.on(mesh, gliding))] if len(gliding) else []


@_wanted.register
def _(part: asked.Curve, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    return [_Wanted(OnCurve.on(mesh, selected(part.vertices, mesh), [np.array(part.curve)]))]


@_wanted.register
def _(part: asked.Plane, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    return [_Wanted(OnPlanes.on(mesh, selected(part.vertices, mesh), part.point, part.normal))]


@_wanted.register
def _(part: asked.Level, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    point = (0.0, 0.0, part.height)
    return [_Wanted(OnPlanes.on(mesh, selected(part.vertices, mesh), point, (0.0, 0.0, 1.0)))]


@_wanted.register
def _(part: asked.Mirror, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    normal = unit(np.array(part.normal))
    return _symmetric(part, mesh, reflection(part.normal), 2, [normal])


@_wanted.register
def _(part: asked.Rotation, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    matrix = rotation(part.direction, part.order)
    # Two directions across the axis: vertices on it lie in both planes.
    across = np.linalg.svd(np.array([part.direction]))[2][1:]
    return _symmetric(part, mesh, matrix, part.order, list(across))


def _symmetric(
    part: asked.Mirror | asked.Rotation,
    mesh: PolyMesh,
    matrix: Floats,
    order: int,
    across: list[Floats],
) -> list[_Wanted]:
    """Partners onto each other, and those that are their own into the planes that stay."""
    point = np.array(part.point)
    tolerance = part.tolerance * mesh.mean_edge_length
    found = partners(mesh, matrix, point, order, tolerance, part.name)
    wanted = []
    if len(found.pairs):
        wanted.append(_Wanted(Symmetry.on(mesh, found.pairs, matrix, point)))
    if len(found.own):
        off = np.linalg.norm((mesh.vertices[found.own] - point) @ np.array(across).T, axis=1)
        if off.max() > tolerance:
            vertex = int(found.own[off.argmax()])
            raise SpecError(
                f"A vertex near its own image must lie near the axis; the {part.name} takes vertex "
                f"{vertex} near itself, {off.max():.4g} from the axis. Lower the order or the "
                f"tolerance."
            )
        wanted += [_Wanted(OnPlanes.on(mesh, found.own, point, normal)) for normal in across]
    return wanted


@_wanted.register
def _(part: asked.Axis, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    chosen = selected(part.vertices, mesh)
    term = NodeAxis.on(mesh, chosen, part.direction)
    if not len(term.axes):
        raise SpecError(
            f"A node axis must have two faces or more at its vertex; vertex {chosen[0]} has one. "
            f"Choose others, or leave the constraint out."
        )
    return [_Wanted(term, tolerance=1e-11)]


@_wanted.register
def _(part: asked.EdgeLengths, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    vertices = selected(part.vertices, mesh)
    first, second = np.isin(mesh.edges, vertices).T
    edges = _between(first & second, vertices, "edge")
    unit_length = 1.0 if part.relative else mesh.mean_edge_length
    bounds = Range.of(part.least, part.most, unit_length)
    term = EdgeLength.on(mesh, bounds, edges, relative=part.relative)
    return [_Wanted(term, bounds.slack)]


@_wanted.register
def _(part: asked.PanelSizes, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    vertices, topology = selected(part.vertices, mesh), mesh.topology
    chosen = np.isin(topology.indices, vertices)
    whole = np.logical_and.reduceat(chosen, topology.offsets[:-1])
    faces = _between(whole, vertices, "face")
    length = mesh.mean_edge_length
    if part.measure == "width":
        bounds = Range.of(part.least, part.most, length)
        return [_Wanted(PanelWidth.on(mesh, bounds, faces), bounds.slack)]
    bounds = Range.of(part.least, part.most, length**2)
    return [_Wanted(PanelArea.on(mesh, bounds, faces), bounds.slack)]


@_wanted.register
def _(part: asked.Within, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    term = Within.on(mesh, reference, part.distance)
    return [_Wanted(term, part.distance / mesh.mean_edge_length)]


@_wanted.register
def _(part: asked.FlatPolylines, mesh: PolyMesh, reference: Reference) -> list[_Wanted]:
    chains = chosen_polylines(part.polylines, part.through, mesh)
    blocks = {"planes": PlanarPolyline.start_planes(mesh, chains)}
    return [_Wanted(PlanarPolyline.on(mesh, chains), tolerance=1e-11, blocks=blocks)]


def _between(chosen: Mask, vertices: Indices, name: str) -> Indices:
    """Numbers of the edges or faces all of whose vertices are chosen; there has to be one."""
    found = np.flatnonzero(chosen)
    if not len(found):
        raise SpecError(
            f"A range of sizes must act on something; no {name} has all its vertices among the "
            f"{len(vertices)} chosen ones. Choose more."
        )
    return found
