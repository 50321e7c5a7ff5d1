"""What an optimised mesh is held to: limits, what was reached, and the place that decides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.mesh.measure import circularity_defect, fitted_cones, planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.constrained import Missed
from pqmesh.optimize.ending import Solution
from pqmesh.report_mesh import judged
from pqmesh.vectors import Floats, Indices, norm

# Dimensionless, but the twist, which is in degrees.
EXACT = {
    "planar": 1e-9,
    "conical": 1e-8,
    "offset": 1e-9,
    "twist": 1e-5,
    "circular": 1e-6,
    "edge-offset": 1e-6,
}
# The rms distance to the surface, in mean edges of the start; flat faces alone are often asked of
# nets that are no conjugate ones, and pay for it.
NEAR, NEAR_PLANAR = 0.10, 0.15
# Relative change of the total area.
AREA = 0.03
# The largest distance of a mesh with edge offsets, in mean edges: the exact mesh may lie anywhere.
EDGE_OFFSET_WITHIN = 0.05
# Constraints are met within this share of the mean edge.
CONSTRAINTS_MET = 1e-9


def limits_of(
    kind: str,
    start: PolyMesh,
    given: Mapping[str, float] | None = None,
    within: float | None = None,
    *,
    is_placed: bool = True,
) -> dict[str, float]:
    """What a mesh of a kind is judged by: the limits, given ones before their defaults.

    Parameters
    ----------
    kind : str
    start : PolyMesh
        As it is before the optimisation.
    given : mapping of key to limit
        Lengths in the model unit, the twist in degrees.
    within : float, optional, model unit
        The largest distance that was asked for. The rms distance may then be as large.
    is_placed : bool
        The mesh is to stay where it is. Where constraints or a surface say where it goes, the
        area is judged only if a limit is given.

    Raises
    ------
    SpecError
        For a key that this kind is not judged by.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> limits_of("planar", cube(), {"area": 0.5})
    {'planar': 1e-09, 'deviation_rms': 0.3, 'area': 0.5}
    """
    given = given or {}
    edge = start.mean_edge_length
    if kind == "edge-offset" and within is None:
        within = EDGE_OFFSET_WITHIN * edge
    keys = ["planar"]
    keys += ["conical", "offset", "twist"] if "conical" in kind else []
    keys += ["circular"] if "circular" in kind else []
    keys += ["edge-offset"] if kind == "edge-offset" else []
    limits = {key: EXACT[key] for key in keys}
    if within is not None:
        limits["deviation"] = within
    near = (NEAR_PLANAR if kind == "planar" else NEAR) * edge
    limits |= {"deviation_rms": max(near, within or 0.0), "area": AREA}
    for key in given:
        if key not in limits or key == "deviation":
            known = ", ".join(name for name in limits if name != "deviation")
            say = "Use --within for it" if key == "deviation" else "Choose one of them"
            raise SpecError(
                f"A tolerance of --kind {kind} must be one of {known}; found {key!r}. {say}."
            )
    if not is_placed:
        del limits["area"]
    return limits | dict(given)


class Reached(NamedTuple):
    """Values at faces, vertices or edges, what they come to, and where they stand.

    Attributes
    ----------
    total : float or None
        None where there is nothing to judge.
    values : (n,)
        The largest one names the place.
    names : (n,) or (n, 2)
    at : (n, 3), model unit
    noun : 'face', 'vertex' or 'edge'
    """

    total: float | None
    values: Floats
    names: Indices
    at: Floats
    noun: str

    def worst(self, origin: Floats | float = 0.0) -> dict[str, Any] | None:
        """The place of the largest value, an origin (3,) added; None where all are 0."""
        if not len(self.values) or not self.values.max() > 0.0:
            return None
        row = int(self.values.argmax())
        return {
            self.noun: self.names[row].tolist(),
            "value": float(self.values[row]),
            "at": (self.at[row] + origin).tolist(),
        }


def limit_rows(
    limits: Mapping[str, float],
    start: PolyMesh,
    mesh: PolyMesh,
    solution: Solution,
    distances: Floats,
    twists: Floats | None,
) -> list[dict[str, Any]]:
    """A row `key`, `asked`, `reached`, `pass` and `worst` of each limit.

    Parameters
    ----------
    limits : mapping
        From `limits_of`.
    start, mesh : PolyMesh
        Before and after.
    solution : Solution
    distances : (V,), model unit
        Of the vertices to the surface.
    twists : (E,), degrees, or None
    """
    found = _reached(start, mesh, solution, distances, twists)
    rows = []
    for key, limit in limits.items():
        here = found[key]
        rows.append(judged(key, limit, here.total, here.worst()))
    return rows


def constraint_row(missed: Missed, mesh: PolyMesh, origin: Floats | float = 0.0) -> dict[str, Any]:
    """The row of the constraints, with the name of the one that is missed by most."""
    worst = {
        "vertex": missed.vertex,
        "value": missed.value,
        "at": (mesh.vertices[missed.vertex] + origin).tolist(),
        "constraint": missed.name,
    }
    return judged("constraints", CONSTRAINTS_MET, missed.value, worst if missed.name else None)


def area_change(start: PolyMesh, mesh: PolyMesh) -> Reached:
    """Relative change of the total area; the face that changed most, by its own area."""
    before, after = norm(start.face_area_vectors), norm(mesh.face_area_vectors)
    total = abs(float(after.sum()) / float(before.sum()) - 1.0)
    change = np.abs(after - before) / before.mean()
    return Reached(total, change, np.arange(len(change)), mesh.face_centers, "face")


def spread_of_cones(mesh: PolyMesh) -> Reached:
    """Cone spread at the interior vertices."""
    cones = fitted_cones(mesh)
    spread = cones.relative_spread
    total = float(spread.max()) if len(spread) else None
    return Reached(total, spread, cones.vertices, mesh.vertices[cones.vertices], "vertex")


def distances_to_surface(mesh: PolyMesh, distances: Floats) -> Reached:
    """Distances of the vertices."""
    total = float(distances.max())
    return Reached(total, distances, np.arange(len(distances)), mesh.vertices, "vertex")


def _reached(
    start: PolyMesh,
    mesh: PolyMesh,
    solution: Solution,
    distances: Floats,
    twists: Floats | None,
) -> dict[str, Reached]:
    """Everything that may be judged."""
    faces, centers = np.arange(mesh.topology.n_faces), mesh.face_centers
    flat, circular = planarity(mesh), np.abs(circularity_defect(mesh))
    cones = fitted_cones(mesh)
    # Three faces at a vertex of the rim fix its axis, four leave none: no cone is asked for there.
    inner = mesh.topology.has_inner_ends
    edges = mesh.edges[inner]
    middles = mesh.vertices[edges].mean(axis=1)
    nothing, nowhere = np.empty(0), np.empty((0, 3))
    away = distances_to_surface(mesh, distances)
    twist = nothing if twists is None else twists[inner]
    return {
        "planar": Reached(float(flat.max()), flat, faces, centers, "face"),
        "conical": spread_of_cones(mesh),
        "offset": Reached(
            float(cones.misfit.max()) if len(cones.misfit) else None,
            cones.misfit,
            cones.vertices,
            mesh.vertices[cones.vertices],
            "vertex",
        ),
        "twist": Reached(float(twist.max()) if len(twist) else None, twist, edges, middles, "edge"),
        "circular": Reached(float(circular.max()), circular, faces, centers, "face"),
        "edge-offset": Reached(
            solution.residuals.get("edge distance"), nothing, faces[:0], nowhere, "edge"
        ),
        "deviation": away,
        "deviation_rms": away._replace(total=float(np.sqrt(np.mean(distances**2)))),
        "area": area_change(start, mesh),
    }
