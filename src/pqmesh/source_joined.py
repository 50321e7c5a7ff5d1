"""Which faces are one surface together, and which are panelled each on its own."""

from __future__ import annotations

import numpy as np

from pqmesh.errors import SurfaceError
from pqmesh.surface.face import Patch
from pqmesh.surface.plan import PlanSurface, Seam, seams

# Faces that meet within these are one surface: a gap in shares of the extent, an angle.
SMOOTH_GAP, SMOOTH_ANGLE = 1e-5, np.radians(0.5)
# A jump of curvature beyond this share of the largest curvature is worth a word.
CURVATURE_JUMP = 0.05


def joined_faces(patches: tuple[Patch, ...]) -> list[tuple[tuple[Patch, ...], tuple[str, ...]]]:
    """Faces that are one surface together, with notes: all of them, or each alone."""
    if len(patches) == 1:
        return [(patches, ())]
    try:
        joined = PlanSurface(patches)
    except SurfaceError as error:
        why = f"the faces cannot be joined over the plan ({error})"
        return _alone(patches, why)
    met = seams(joined)
    extent = float(joined.domain.size.max())
    rough = [s for s in met if s.gap > SMOOTH_GAP * extent or s.angle > SMOOTH_ANGLE]
    if rough:
        return _alone(patches, f"the faces do not join smoothly ({_seam(rough[0])})")
    if len(met) < len(patches) - 1:
        return _alone(patches, "the faces do not all meet")
    bend = _largest_bend(joined)
    notes = [f"{len(patches)} faces joined to one surface"]
    notes += [
        f"curvature jumps at a seam ({_seam(s)}): panels across it are less even"
        for s in met
        if s.curvature > CURVATURE_JUMP * bend
    ]
    return [(patches, tuple(notes))]


def _alone(patches: tuple[Patch, ...], why: str) -> list[tuple[tuple[Patch, ...], tuple[str, ...]]]:
    return [((patch,), (f"each face is panelled on its own: {why}",)) for patch in patches]


def _seam(seam: Seam) -> str:
    return (
        f"{seam.first} and {seam.second}: gap {seam.gap:.3g}, angle "
        f"{np.degrees(seam.angle):.3g} deg, curvature jump {seam.curvature:.3g}"
    )


def _largest_bend(surface: PlanSurface) -> float:
    """Largest second derivative of the height at samples of the faces."""
    uv = surface.domain.grid(40, 40).reshape(-1, 2)
    jet = surface.jet(uv[surface.contains(uv)])
    return float(max(np.abs(row[:, 2]).max(initial=0.0) for row in (jet.duu, jet.duv, jet.dvv)))
