"""Trimmed faces as a region of their surface, and their rim in plan."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Surface
from pqmesh.surface.face import Patch, ring_distance
from pqmesh.surface.plan import PlanSurface
from pqmesh.vectors import Floats, Mask

# Rims of neighbouring faces that are this near, in extents, are one seam: twice what trim loops
# may be off their edges.
SEAM = 3e-4

# An outer ring and its holes, (n, 2) each.
Rings = tuple[Floats, tuple[Floats, ...]]


@dataclass(frozen=True, eq=False)
class FaceRegion:
    """The part of a surface that its trimmed faces take, and what lies near to it.

    Attributes
    ----------
    surface : Surface
        A `PlanSurface` of the faces, or the surface of the only one.
    patches : tuple of Patch
    extend : float, model unit
        Plan distance around the faces that counts as theirs.
    """

    surface: Surface
    patches: tuple[Patch, ...]
    extend: float = 0.0

    def within(self, uv: Floats, reach: float = 0.0) -> Mask:
        """Truth for parameters (N, 2) on the faces, or within a plan distance of them."""
        if isinstance(self.surface, PlanSurface):
            inside = self.surface.contains(uv)
        else:
            inside = self.patches[0].contains(uv)
        reach += self.extend
        beyond = np.flatnonzero(~inside)
        if reach > 0.0 and len(beyond):
            places = self.surface.jet(uv[beyond]).point[:, :2]
            gaps = [ring_distance(ring, places) for ring in self._rings]
            inside[beyond] = np.min(gaps, axis=0) <= reach
        return inside

    @cached_property
    def _rings(self) -> tuple[Floats, ...]:
        return tuple(ring for patch in self.patches for ring in patch.plan_rings())


def plan_rims(patches: tuple[Patch, ...], outline: Any = None) -> list[Rings] | None:
    """Rings around the union of faces in plan, largest first; None where a face folds in plan.

    Parameters
    ----------
    patches : tuple of Patch
    outline : object with `rings`, optional
        Plan region to intersect with.

    Raises
    ------
    SurfaceError
        When the library for it (extra `aec`) is not installed.
    """
    try:
        shapely = import_module("shapely")
    except ImportError:
        raise SurfaceError(
            "Joining the rims of faces needs the library shapely; it is not installed. Install it "
            "with: pip install 'pqmesh[aec]', or give an outline."
        ) from None
    shapes = []
    for patch in patches:
        outer, *holes = patch.plan_rings()
        shape = shapely.Polygon(outer, holes)
        if not shape.is_valid:
            return None
        shapes.append(shape)
    union = shapes[0]
    if len(shapes) > 1:
        low, high = np.array(shapely.total_bounds(shapes)).reshape(2, 2)
        close = SEAM * float((high - low).max())
        grown = shapely.unary_union([shapely.buffer(s, close, join_style="mitre") for s in shapes])
        union = shapely.buffer(grown, -close, join_style="mitre")
    if outline is not None:
        first, *holes = outline.rings
        union = shapely.intersection(union, shapely.Polygon(first, holes))
    parts = [p for p in getattr(union, "geoms", [union]) if p.geom_type == "Polygon" and p.area]
    parts.sort(key=lambda part: -part.area)
    return [(_ring(part.exterior), tuple(_ring(hole) for hole in part.interiors)) for part in parts]


def _ring(line: Any) -> Floats:
    """Corners without repetition."""
    return np.asarray(line.coords, dtype=np.float64)[:-1, :2]
