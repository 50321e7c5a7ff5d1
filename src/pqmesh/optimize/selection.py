"""Which vertices a constraint means: by number, by their place in the mesh or in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import SpecError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize.given import finite_points, frozen_points, whole_numbers
from pqmesh.optimize.polylines import Polylines
from pqmesh.vectors import Floats, Indices, Mask, cross, dot, norm

# A boundary vertex whose edges turn by more than this is a corner.
CORNER_TURN = float(np.radians(30.0))
GROUPS = ("all", "boundary", "inside", "corners")


@dataclass(frozen=True)
class Where:
    """Vertices of a group for which all that is said of their place holds.

    Attributes
    ----------
    among : 'all', 'boundary', 'inside' (not on the boundary), 'corners', or numbers of vertices
    box : two points of 3 coordinates, optional
        Lowest and highest corner of a box, model unit.
    level : float, optional
        Height z that they lie within `distance` of.
    curve : points (n, 3), optional
        Polyline that they lie within `distance` of.
    distance : float, optional, model unit

    Raises
    ------
    SpecError
        For an unknown group, a box turned over, a place that is not finite, or a level or curve
        without a distance above 0.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> selected(Where(level=1.0, distance=0.1), cube()).tolist()
    [0, 2, 4, 6]
    """

    among: str | tuple[int, ...] = "all"
    box: Any = None
    level: float | None = None
    curve: Any = None
    distance: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.among, str):
            if self.among not in GROUPS:
                raise SpecError(
                    f"A group of vertices must be one of {', '.join(GROUPS)}; found "
                    f"{self.among!r}. Choose one."
                )
        else:
            object.__setattr__(self, "among", whole_numbers(self.among, "vertices"))
        if self.box is not None:
            box = finite_points(self.box, "A box", least=2)
            if len(box) != 2 or not (box[0] <= box[1]).all():
                raise SpecError(
                    f"A box must be its lowest and its highest corner; found {box.tolist()}. "
                    f"Give the smaller coordinates first."
                )
            object.__setattr__(self, "box", frozen_points(box))
        if self.curve is not None:
            curve = finite_points(self.curve, "A curve to select by", least=2)
            object.__setattr__(self, "curve", frozen_points(curve))
        if self.level is not None and not math.isfinite(self.level):
            raise SpecError(f"A level must be finite; found {self.level}. Mend it.")
        near = self.level is not None or self.curve is not None
        if near != (self.distance is not None) or not 0 < (self.distance or 1.0) < math.inf:
            raise SpecError(
                f"A distance above 0 belongs to a level or a curve to select by, and to nothing "
                f"else; found {self.distance} with level {self.level} and "
                f"{'a' if self.curve else 'no'} curve. Give both, or leave both out."
            )

    def about(self, origin: Floats) -> Where:
        """The same with places counted from an origin (3,)."""
        return replace(
            self,
            box=None if self.box is None else np.asarray(self.box) - origin,
            level=None if self.level is None else self.level - float(origin[2]),
            curve=None if self.curve is None else np.asarray(self.curve) - origin,
        )


# What a constraint takes for vertices.
Selection: TypeAlias = str | Sequence[int] | Where


def as_where(selection: Selection) -> Where:
    """A selection in its full form."""
    if isinstance(selection, Where):
        return selection
    if isinstance(selection, str):
        return Where(selection)
    return Where(tuple(selection))


def selected(selection: Selection, mesh: PolyMesh) -> Indices:
    """Numbers of the vertices of a mesh that a selection means, rising.

    Parameters
    ----------
    selection : 'all', 'boundary', 'inside', 'corners', numbers of vertices, or Where
    mesh : PolyMesh

    Raises
    ------
    SpecError
        When a number is out of range, or nothing is selected.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> grid = rotational_mesh([[2, 0], [2.1, 1], [2, 2]], [0, 0.3, 0.6])
    >>> selected("corners", grid).tolist(), selected("inside", grid).tolist()
    ([0, 2, 6, 8], [4])
    """
    where, count = as_where(selection), mesh.topology.n_vertices
    chosen = _among(where, mesh)
    points = mesh.vertices
    if where.box is not None:
        low, high = np.asarray(where.box)
        chosen &= ((points >= low) & (points <= high)).all(axis=1)
    distance = where.distance or 0.0
    if where.level is not None:
        chosen &= np.abs(points[:, 2] - where.level) <= distance
    if where.curve is not None:
        lines = Polylines.of([np.asarray(where.curve)])
        chosen &= lines.gaps(points, lines.nearest(points)) <= distance
    found = np.flatnonzero(chosen)
    if not len(found):
        raise SpecError(
            f"A constraint must act on something; none of the {count} vertices is {_said(where)}. "
            f"Widen the selection, or leave the constraint out."
        )
    return found


def _among(where: Where, mesh: PolyMesh) -> Mask:
    """Vertices (V,) of the group or of the numbers."""
    boundary, count = mesh.topology.is_boundary_vertex, mesh.topology.n_vertices
    if where.among == "all":
        return np.ones(count, dtype=np.bool_)
    if where.among == "boundary":
        return boundary.copy()
    if where.among == "inside":
        return ~boundary
    if where.among == "corners":
        return boundary_corners(mesh)
    rows = np.array(where.among, dtype=np.int64)
    outside = rows[(rows < 0) | (rows >= count)]
    if len(outside):
        raise SpecError(
            f"Vertices must be numbered 0..{count - 1}; a constraint names {outside[0]}. (Vertices "
            f"count from 0.) Mend the number."
        )
    chosen = np.zeros(count, dtype=np.bool_)
    chosen[rows] = True
    return chosen


def _said(where: Where) -> str:
    """A selection in words."""
    words = [f"of the group {where.among!r}" if isinstance(where.among, str) else "one of those"]
    if where.box is not None:
        words.append(f"in the box {np.asarray(where.box).tolist()}")
    if where.level is not None:
        words.append(f"within {where.distance:g} of the level {where.level:g}")
    if where.curve is not None:
        words.append(f"within {where.distance:g} of the curve")
    return " and ".join(words)


def boundary_corners(mesh: PolyMesh, turn: float = CORNER_TURN) -> Mask:
    """Boundary vertices at which the boundary turns by more than an angle, shape (V,).

    Parameters
    ----------
    mesh : PolyMesh
    turn : float, radians
    """
    corners = np.zeros(mesh.topology.n_vertices, dtype=np.bool_)
    for loop in mesh.topology.boundary_loops:
        points = mesh.vertices[loop]
        ahead, behind = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
        corners[loop[np.arctan2(norm(cross(behind, ahead)), dot(behind, ahead)) > turn]] = True
    return corners


def chosen_polylines(
    wanted: str | tuple[tuple[int, ...], ...], through: Any, mesh: PolyMesh
) -> list[Indices]:
    """Polylines of more than three different vertices, as lists of vertices.

    Parameters
    ----------
    wanted : 'all', 'boundary', or lists of vertices
    through : points (n, 3), optional
        Instead: the polylines of the mesh that pass nearest to these points.
    mesh : PolyMesh

    Raises
    ------
    SpecError
        When a number is out of range, or there is no such polyline.
    """
    topology = mesh.topology
    if not isinstance(wanted, str):
        for chain in wanted:
            selected(chain, mesh)
        return [np.array(chain, dtype=np.int64) for chain in wanted]
    chains = topology.polylines
    if through is not None:
        middles = [0.5 * (mesh.vertices[chain[1:]] + mesh.vertices[chain[:-1]]) for chain in chains]
        owner = np.repeat(np.arange(len(chains)), [len(chain) - 1 for chain in chains])
        near = cKDTree(np.concatenate(middles)).query(np.array(through))[1]
        chains = [chains[k] for k in np.unique(owner[near])]
    elif wanted == "boundary":
        rim = {tuple(pair) for pair in mesh.edges[topology.is_boundary_edge].tolist()}
        chains = [chain for chain in chains if tuple(sorted(chain[:2].tolist())) in rim]
    long = [chain for chain in chains if len(np.unique(chain)) > 3]
    if not long:
        raise SpecError(
            "Flat polylines must be at least one of more than three vertices; found none. Choose "
            "others, or leave the constraint out."
        )
    return long
