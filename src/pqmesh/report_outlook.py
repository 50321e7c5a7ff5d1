"""What a report says of an optimisation before it and after: keys `outlook` and `worst`."""

from __future__ import annotations

from typing import Any

import numpy as np

from pqmesh.mesh.conjugacy import Conjugacy
from pqmesh.optimize.advice import advice
from pqmesh.optimize.outlook import Outlook
from pqmesh.optimize.worst import Place, Worst
from pqmesh.vectors import Floats

# Regions and broken places that are listed.
MOST = 10


def conjugacy_keys(found: Conjugacy) -> dict[str, Any]:
    """How far the lines are from conjugate."""
    turn = found.turn_median
    return {
        "verdict": found.verdict,
        "conjugacy_ratio_median": found.ratio_median,
        "conjugacy_turn_median_deg": None if turn is None else float(np.degrees(turn)),
        "far_share": found.far_share,
    }


def outlook_keys(found: Outlook, origin: Floats | float = 0.0) -> dict[str, Any]:
    """The key `outlook`; places get the origin (3,) added, lists end after 10 entries."""
    return {
        **conjugacy_keys(found.conjugacy),
        "predicted_move_max": found.move_max,
        "predicted_move_rms": found.move_rms,
        "predicted_off_surface": found.off_surface,
        "regions": [
            {
                "faces": region.faces.tolist(),
                "worst": region.worst,
                "at": (region.at + origin).tolist(),
                "turn_deg": float(np.degrees(region.turn)),
                "asymptotic_share": region.asymptotic,
            }
            for region in found.regions[:MOST]
        ],
        "broken": [
            {"what": entry.what, "where": list(entry.where), "at": (entry.at + origin).tolist()}
            for entry in found.broken[:MOST]
        ],
        "advice": list(advice(found, origin)),
    }


def worst_keys(found: Worst) -> dict[str, Any]:
    """The key `worst`."""
    return {
        "limits": list(found.limits),
        "faces": [{"face": entry.where[0], **_measured(entry)} for entry in found.faces],
        "vertices": [{"vertex": entry.where[0], **_measured(entry)} for entry in found.vertices],
        "edges": [{"edge": list(entry.where), **_measured(entry)} for entry in found.edges],
    }


def _measured(entry: Place) -> dict[str, Any]:
    """Measure, value and place."""
    return {"measure": entry.measure, "value": entry.value, "at": entry.at.tolist()}
