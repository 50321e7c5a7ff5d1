"""Seconds against faces, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from bench.measurement import Measurement
from bench.methods import PEERS

# Planarity and balance that count as reached, wide enough for every method that gets there at all.
FLAT = 1e-8
COLORS = {
    "pqmesh": "#0b5fa5",
    "pqmesh-glide": "#5aa9e6",
    "pqmesh-mkl": "#123a6b",
    "pqmesh-scipy": "#39a78e",
    "baseline": "#d1495b",
    "libigl-100": "#c0a36e",
    "libigl-500": "#8a6d3b",
    "shapeop": "#8e6bbf",
    "mpfp": "#555555",
}


def draw(rows: Sequence[Measurement], limit: float, path: Path) -> bool:
    """Two panels, conical and planar; False where matplotlib is not installed.

    Meshes that come in several sizes are joined by lines, single ones are dots; crosses on the
    limit are methods that took longer, and open marks are results that did not converge, broke
    faces or stayed above FLAT.
    """
    try:
        import matplotlib
    except ImportError:
        return False
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(11, 4.6), sharey=True, layout="constrained")
    for panel, kind in zip(panels, ("conical", "planar"), strict=True):
        chosen = [row for row in rows if row.kind == kind and row.faces]
        for method, color in COLORS.items():
            _method(panel, [row for row in chosen if row.method == method], method, color, limit)
        panel.set(xscale="log", yscale="log", xlabel="faces", title=f"{kind} meshes")
        panel.grid(which="major", color="0.9")
        if chosen:
            panel.legend(fontsize=8, frameon=False)
    panels[0].set_ylabel("seconds")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)
    plt.close(figure)
    return True


def _method(panel, rows: list[Measurement], method: str, color: str, limit: float) -> None:
    """One method's lines, dots and crosses."""
    timed = [row for row in rows if row.seconds is not None]
    for family, members in groupby(timed, key=lambda row: row.mesh.rpartition("-")[0]):
        line = sorted(members, key=lambda row: row.faces)
        if family in ("ellipsoid", "roof") and len(line) > 1:
            style = "-" if family == "ellipsoid" else "--"
            panel.plot([r.faces for r in line], [r.seconds for r in line], style, color=color, lw=1)
    marker = "s" if method in PEERS else "o"
    for good, face in ((True, color), (False, "white")):
        part = [row for row in timed if is_good(row) == good]
        if part:
            label = method if good or not any(map(is_good, timed)) else None
            panel.plot(
                [row.faces for row in part],
                [row.seconds for row in part],
                marker,
                ms=5,
                color=color,
                markerfacecolor=face,
                label=label,
            )
    over = [row for row in rows if row.status.startswith("over")]
    panel.plot([row.faces for row in over], [limit] * len(over), "x", color=color)


def is_good(row: Measurement) -> bool:
    """Whether a measurement is a result to go on with: flat enough, nothing broken."""
    return (
        row.converged is not False
        and row.broken_new == 0
        and row.planarity_after is not None
        and row.planarity_after <= FLAT
        and (row.kind != "conical" or (row.balance_after or 0.0) <= FLAT)
    )
