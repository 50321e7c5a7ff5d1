"""Where vertices go so that the faces around them are valid: where a sum of squares is smallest.

    pressure * what each corner lacks to its least signed area
    + umbrella of each vertex (its place among its neighbours) against that of its surroundings
    + a little of its move

Signed areas are seen along the normals, and measured in the sizes, that the valid faces around
lend to the broken ones. Being quadratic in the edges at a corner they have a slope where an edge
has collapsed or a face is folded, unlike angles. The pressure grows until areas hardly lack.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Topology
from pqmesh.optimize.faults import Surround, face_means, faces_touching, umbrella_means
from pqmesh.vectors import Floats, Indices, Mask, cross, dot, norm

# Signed area to aim for at a corner, as a share of what surrounds it; and the share of its own
# that a valid corner keeps.
AIM, KEEP = 0.4, 0.6
# Weights of the umbrella and of the move, against growing ones of the missing areas.
SMOOTH, HOLD, PRESSURES = 1.0, 1e-2, (1e1, 1e2, 1e3, 1e4)
# Steps of the minimisation for each pressure.
STEPS = 200
# The outline has a corner where the cosine of its turn is less than this.
RIM_TURN = 0.85


def untangled(
    mesh: PolyMesh, start: PolyMesh, movable: Mask, fault: Mask, surround: Surround
) -> Floats:
    """Positions (V, 3) after the movable vertices went where the faces at them are valid.

    Parameters
    ----------
    mesh : PolyMesh
        Where to begin.
    start : PolyMesh
        From where moves are counted.
    movable : (V,) bool
    fault : (F,) bool
        Faces to be made valid; the others have limits of their own.
    surround : Surround
    """
    topology = mesh.topology
    corners = np.flatnonzero(faces_touching(topology, movable)[topology.corner_faces])
    faces = topology.corner_faces[corners]
    stencil = np.stack(
        [
            topology.indices[corners],
            topology.indices[topology.corner_next[corners]],
            _previous(topology)[corners],
        ]
    )
    squares = face_means(topology, surround.sizes[:, None])[:, 0]
    full = squares[faces] * np.sin(2.0 * np.pi / np.maximum(topology.face_sizes[faces], 4))
    own = _corner_areas(mesh.vertices, stencil, surround.normals[faces])
    wanted = np.where(fault[faces], AIM * full, np.minimum(AIM * full, KEEP * own))
    used = (own > 0) | fault[faces]
    smooth = movable & (~topology.is_boundary_vertex | _along_rim(start))
    rows = np.flatnonzero(smooth)
    umbrella = umbrella_means(topology, smooth)[rows]
    # All that has a part in it, numbered anew: the rest of the mesh costs nothing.
    part = np.unique(np.concatenate([stencil.ravel(), umbrella.indices, np.flatnonzero(movable)]))
    place = np.full(topology.n_vertices, -1, dtype=np.int64)
    place[part] = np.arange(len(part))
    chosen = np.flatnonzero(movable)
    # In units of a typical edge, so that the steps do not depend on the unit.
    length = float(np.sqrt(surround.sizes[chosen].mean()))
    energy = _Energy(
        points=mesh.vertices[part] / length,
        start=start.vertices[part] / length,
        chosen=place[chosen],
        stencil=place[stencil[:, used]],
        normals=surround.normals[faces[used]],
        full=full[used] / length**2,
        wanted=wanted[used] / length**2,
        rows=place[rows],
        umbrella=umbrella[:, part],
        umbrellas=surround.umbrellas[rows] / length,
        sizes=surround.sizes[part] / length**2,
    )
    x = energy.points[energy.chosen].ravel()
    for pressure in PRESSURES:
        found = minimize(energy, x, (pressure,), "L-BFGS-B", jac=True, options={"maxiter": STEPS})
        x = np.asarray(found.x, dtype=np.float64)
    points = mesh.vertices.copy()
    points[chosen] = length * x.reshape(-1, 3)
    return points


@dataclass(frozen=True, eq=False)
class _Energy:
    """The sum of squares as a function of the chosen points; lengths in typical edges."""

    points: Floats
    start: Floats
    chosen: Indices
    stencil: Indices
    normals: Floats
    full: Floats
    wanted: Floats
    rows: Indices
    umbrella: Any
    umbrellas: Floats
    sizes: Floats

    def __call__(self, x: Floats, pressure: float) -> tuple[float, Floats]:
        """Value and gradient."""
        points = self.points.copy()
        points[self.chosen] = x.reshape(-1, 3)
        at, ahead, behind = self.stencil
        out, back = points[ahead] - points[at], points[behind] - points[at]
        missing = np.maximum(self.wanted - dot(self.normals, cross(out, back)), 0.0) / self.full
        pull = (-2.0 * pressure * missing / self.full)[:, None]
        by_out, by_back = pull * cross(back, self.normals), pull * cross(self.normals, out)
        gradient = np.zeros_like(points)
        np.add.at(gradient, ahead, by_out)
        np.add.at(gradient, behind, by_back)
        np.add.at(gradient, at, -by_out - by_back)
        rough = points[self.rows] - self.umbrella @ points - self.umbrellas
        size = self.sizes[self.rows, None]
        soft = 2.0 * SMOOTH * rough / size
        gradient[self.rows] += soft
        gradient -= self.umbrella.T @ soft
        away = points[self.chosen] - self.start[self.chosen]
        reach = self.sizes[self.chosen, None]
        gradient[self.chosen] += 2.0 * HOLD * away / reach
        value = (
            pressure * np.sum(missing**2)
            + SMOOTH * np.sum(rough**2 / size)
            + HOLD * np.sum(away**2 / reach)
        )
        return float(value), gradient[self.chosen].ravel()


def _corner_areas(points: Floats, stencil: Indices, normals: Floats) -> Floats:
    """Signed areas of the parallelograms at corners (3, n): vertex, next and one before."""
    at, ahead, behind = stencil
    return dot(normals, cross(points[ahead] - points[at], points[behind] - points[at]))


def _along_rim(mesh: PolyMesh) -> Mask:
    """Boundary vertices (V,) at which the boundary runs on smoothly: no corners."""
    keep = np.zeros(mesh.topology.n_vertices, dtype=np.bool_)
    for loop in mesh.topology.boundary_loops:
        points = mesh.vertices[loop]
        ahead, behind = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
        runs_on = dot(ahead, behind) >= RIM_TURN * norm(ahead) * norm(behind)
        keep[loop[runs_on & (mesh.topology.valence[loop] > 2)]] = True
    return keep


def _previous(topology: Topology) -> Indices:
    """Vertex before each corner in its face, aligned with `indices`."""
    before = np.empty_like(topology.indices)
    before[topology.corner_next] = topology.indices
    return before
