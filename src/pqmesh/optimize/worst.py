"""After an optimisation: what held it back, and which faces, vertices and edges are worst."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.measure import circularity_defect, corner_angles, fitted_cones, planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.advice import place
from pqmesh.optimize.guard import Guard
from pqmesh.optimize.solver import Solution
from pqmesh.surface.reference import Reference
from pqmesh.vectors import TINY, Floats, Indices, norm

# Places listed of each measure.
TOP = 5
# An edge or a corner this close to the guard's limit, as a factor, stands at it.
AT_LIMIT = 1.05
# Values up to this are rounding and name no place: planarity, spread, angles; shares of an edge.
NOTHING = 1e-12


@dataclass(frozen=True, eq=False)
class Place:
    """One bad place.

    Attributes
    ----------
    where : tuple of int
        The face or vertex, or the two ends of an edge.
    measure : str
    value : float
    at : (3,)
        Model unit.
    """

    where: tuple[int, ...]
    measure: str
    value: float
    at: Floats


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst places of an optimised mesh, five of each measure, worst first.

    Attributes
    ----------
    faces : tuple of Place
        'planarity', of circular meshes 'circularity_deg', 'corner_deg' (smallest distance of a
        corner angle from 0 and 180 degrees, negative where the face is not convex).
    vertices : tuple of Place
        Of conical meshes 'cone_spread'; 'deviation' and 'moved', model unit.
    edges : tuple of Place
        'length_ratio': length over that at the start, smallest first.
    limits : tuple of str
        What kept the optimisation from its goals; empty when it reached them.
    """

    faces: tuple[Place, ...]
    vertices: tuple[Place, ...]
    edges: tuple[Place, ...]
    limits: tuple[str, ...]


def worst_places(
    kind: str,
    start: PolyMesh,
    mesh: PolyMesh,
    solution: Solution,
    reference: Reference,
    origin: Floats | float = 0.0,
) -> Worst:
    """What limits an optimised mesh, and its worst faces, vertices and edges.

    Parameters
    ----------
    kind : str
    start, mesh : PolyMesh
        Before and after, of the same faces.
    solution : Solution
    reference : Reference
    origin : (3,) or 0
        Added to the places.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> from pqmesh.optimize.recipes import problem_for
    >>> from pqmesh.optimize.solver import solve
    >>> from pqmesh.surface.reference import TriangleReference
    >>> box = cube()
    >>> itself = TriangleReference.of_polygons(box.vertices, box.faces.tolist())
    >>> found = solve(problem_for("planar", box, itself), box)
    >>> [edge.value for edge in worst_places("planar", box, box, found, itself).edges]
    []
    """
    centers, points = mesh.face_centers + origin, mesh.vertices + origin
    faces = _largest("planarity", planarity(mesh), centers)
    if "circular" in kind:
        faces += _largest("circularity_deg", np.degrees(np.abs(circularity_defect(mesh))), centers)
    faces += _smallest("corner_deg", _corner_room(mesh), centers)
    vertices = []
    if "conical" in kind:
        cones = fitted_cones(mesh)
        vertices += _largest(
            "cone_spread", cones.relative_spread, points[cones.vertices], cones.vertices
        )
    feet, _, _ = reference.closest(mesh.vertices)
    least = NOTHING * start.mean_edge_length
    vertices += _largest("deviation", norm(mesh.vertices - feet), points, least=least)
    vertices += _largest("moved", norm(mesh.vertices - start.vertices), points, least=least)
    return Worst(
        tuple(faces),
        tuple(vertices),
        tuple(_shrunk(start, mesh, origin)),
        () if solution.converged else tuple(_limits(start, mesh, solution, origin)),
    )


# --- parts ----------------------------------------------------------------------------------


def _largest(
    measure: str,
    values: Floats,
    at: Floats,
    names: Indices | None = None,
    least: float = NOTHING,
) -> list[Place]:
    """The largest values above rounding."""
    order = np.argsort(-values, kind="stable")[:TOP]
    named = np.arange(len(values)) if names is None else names
    return [
        Place((int(named[i]),), measure, float(values[i]), at[i])
        for i in order
        if values[i] > least
    ]


def _smallest(measure: str, values: Floats, at: Floats) -> list[Place]:
    """The smallest values."""
    order = np.argsort(values, kind="stable")[:TOP]
    return [Place((int(i),), measure, float(values[i]), at[i]) for i in order]


def _corner_room(mesh: PolyMesh) -> Floats:
    """Smallest distance of a corner from 0 and 180 degrees in each face, negative beyond, (F,)."""
    corners = np.degrees(corner_angles(mesh))
    room = np.minimum(corners, 180.0 - corners)
    return np.asarray(np.minimum.reduceat(room, mesh.topology.offsets[:-1]))


def _shrunk(start: PolyMesh, mesh: PolyMesh, origin: Floats | float) -> list[Place]:
    """Edges that lost most of their length."""
    ratio = mesh.edge_lengths / np.maximum(start.edge_lengths, TINY)
    middles = mesh.vertices[mesh.edges].mean(axis=1) + origin
    order = np.argsort(ratio, kind="stable")[:TOP]
    return [
        Place(
            (int(mesh.edges[i, 0]), int(mesh.edges[i, 1])),
            "length_ratio",
            float(ratio[i]),
            middles[i],
        )
        for i in order
        if ratio[i] < 1.0 - NOTHING
    ]


def _limits(
    start: PolyMesh, mesh: PolyMesh, solution: Solution, origin: Floats | float
) -> list[str]:
    """What holds an optimisation that did not reach its hard goals."""
    said = []
    if solution.residuals:
        name = max(solution.residuals, key=lambda goal: solution.residuals[goal])
        said.append(f"the goal {name} is farthest off: {solution.residuals[name]:.3g}")
    guard = Guard.of(start)
    at_edge = (mesh.edge_lengths <= AT_LIMIT * guard.least_edge) & (
        mesh.edge_lengths < start.edge_lengths
    )
    if at_edge.any():
        share = np.where(at_edge, mesh.edge_lengths / start.edge_lengths, np.inf)
        first = int(share.argmin())
        a, b = mesh.edges[first]
        at = mesh.vertices[mesh.edges[first]].mean(axis=0) + origin
        said.append(
            f"{_counted(int(at_edge.sum()), 'edge stands', 'edges stand')} at the shortest length "
            f"allowed, first edge {a}-{b} at {place(at)}: {mesh.edge_lengths[first]:.3g}, "
            f"{share[first]:.2g} of its start"
        )
    sines, before = guard.corner_sines(mesh.vertices), guard.corner_sines(start.vertices)
    at_corner = (sines <= AT_LIMIT * guard.least_sine) & (sines < before)
    if at_corner.any():
        first = int(np.where(at_corner, sines, np.inf).argmin())
        said.append(
            f"{_counted(int(at_corner.sum()), 'face has', 'faces have')} a corner as flat or as "
            f"sharp as allowed, first face {first} at {place(mesh.face_centers[first] + origin)}"
        )
    return said


def _counted(number: int, one: str, many: str) -> str:
    """A number with its noun."""
    return f"{number} {one if number == 1 else many}"
