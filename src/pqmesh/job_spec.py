"""What is wanted of a roof, and whether a surface and its outline can give it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.network.kinds import Given
from pqmesh.network.region import PlanOutline, region_samples
from pqmesh.network.walker import Inside
from pqmesh.optimize.constraints import Constraints
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import first_form
from pqmesh.vectors import cross, norm

# The network stops at as many lines in a family, but only after it has traced them.
MOST_LINES = 4000
# Sizes beyond this, or below its inverse, leave the range of doubles when squared twice.
LARGEST_EXTENT = 1e50
# A surface may turn over on this share of the outline, as by rounding at a rim, and its area in
# plan may exceed the outline's by this factor, beside what the samples along the rim leave open.
FOLDED, STACKED = 0.002, 1.02
SHEET_SAMPLES = (120, 120)
# The kind whose mesh is not solved for but fitted: see `koebe.best`.
EDGE_OFFSET = "edge-offset"


@dataclass(frozen=True)
class Spec:
    """What is wanted of a roof, lengths in the model unit.

    Attributes
    ----------
    edges : (float, float)
        Wanted panel edge along the lines of the first and of the second family; of larger and
        of smaller principal curvature in a principal network.
    kind : 'planar', 'conical', 'circular', 'conical-circular' or 'edge-offset'
    network : 'principal', 'uv', 'geodesic' or 'conjugate'
    given : Given, optional
        The family that a conjugate or geodesic network starts from.
    distances : tuple of float
        Signed offset distances of the layers.
    boundary : 'free', 'fixed' or 'glide'
    within : float, optional
        Stay this close to the surface.
    flat : float
        Panels may be out of plane by so much, and the mesh stays as close as that allows.
    constraints : Constraints, optional
        What is asked of the mesh beside its kind.
    flip : bool
        Turn the orientation: normals downwards.
    most_panels : int
        Refuse when more panels than this are to be expected.
    """

    edges: tuple[float, float]
    kind: str = "conical"
    network: str = "principal"
    given: Given | None = None
    distances: tuple[float, ...] = ()
    boundary: str = "free"
    within: float | None = None
    flat: float = 0.0
    constraints: Constraints | None = None
    flip: bool = False
    most_panels: int = 1_000_000


def check_edges(
    surface: Surface, spec: Spec, inside: Inside | None, outline: PlanOutline | None
) -> None:
    """Refuse edges longer than the region, and panels beyond counting."""
    uv, cell = region_samples(surface, inside, outline, 40)
    if not len(uv):
        raise SpecError(
            "The outline must lie over the surface; no sampled point of the surface is inside it"
            f"{_across(outline)}. Move or widen it, and check its units."
        )
    jet = surface.jet(uv)
    area = cell * float(np.sqrt(np.maximum(np.linalg.det(first_form(jet)), 0.0)).sum())
    size = float(np.linalg.norm(np.ptp(jet.point, axis=0)))
    if not 1 / LARGEST_EXTENT < size < LARGEST_EXTENT:
        raise SpecError(
            f"A roof must have an extent between {1 / LARGEST_EXTENT:g} and {LARGEST_EXTENT:g}; "
            f"found {size:.4g}. Check the numbers of the surface, and its units."
        )
    if max(spec.edges) >= size:
        raise SpecError(
            f"panels.edge must be shorter than the roof; found {max(spec.edges):g} for a roof of "
            f"extent {size:.4g}. Shorten it, and check the units."
        )
    panels = area / spec.edges[0] / spec.edges[1]
    if panels > spec.most_panels:
        raise SpecError(
            f"A roof may have at most {spec.most_panels} panels; edges of {spec.edges[0]:g} and "
            f"{spec.edges[1]:g} on {area:.4g} square units make about {panels:.3g}. Lengthen the "
            f"edge, or raise run.most_panels."
        )
    lines = area**0.5 / min(spec.edges)
    if lines > MOST_LINES:
        raise SpecError(
            f"A network may have at most {MOST_LINES} lines in a family; an edge of "
            f"{min(spec.edges):g} on {area:.4g} square units needs about {lines:.3g}. Lengthen the "
            f"edge, or split the roof."
        )


def _across(outline: PlanOutline | None) -> str:
    """The size of an outline in plan, for messages."""
    if outline is None:
        return ""
    width, depth = np.ptp(outline.polygon, axis=0)
    return f" ({width:.4g} by {depth:.4g})"


def check_sheets(surface: Surface, outline: PlanOutline, inside: Inside | None) -> None:
    """Refuse surfaces that stand over a point of the outline more than once."""
    grid = surface.domain.grid(*SHEET_SAMPLES)
    uv = grid.reshape(-1, 2)
    chosen = np.ones(len(uv), dtype=np.bool_) if inside is None else inside(uv)
    jet = surface.jet(uv[chosen])
    upright = cross(jet.du, jet.dv)[:, 2]
    cell = float(np.prod(surface.domain.size)) / len(uv)
    up, down = cell * float(upright[upright > 0].sum()), -cell * float(upright[upright < 0].sum())
    if min(up, down) > FOLDED * outline.area:
        lesser = upright < 0 if down < up else upright > 0
        place = jet.point[lesser][int(np.abs(upright[lesser]).argmax())]
        raise SpecError(
            f"Over its outline a surface must not turn over, seen from above; it does so near "
            f"({', '.join(f'{x:.6g}' for x in place)}). Draw the outline around the part that is "
            f"meant, or leave it out and panel the whole surface."
        )
    pace = float(np.sqrt((up + down) / max(int(chosen.sum()), 1)))
    rim = sum(float(norm(np.roll(ring, -1, axis=0) - ring).sum()) for ring in outline.rings)
    if up + down > STACKED * outline.area + pace * rim:
        raise SpecError(
            f"A surface must stand once over each point of its outline; its area in plan is "
            f"{up + down:.6g} over an outline of {outline.area:.6g}, so parts lie on top of each "
            f"other. Draw the outline around one of them."
        )
