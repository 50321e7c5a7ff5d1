"""The case study of the roof: what its script reaches, and its files measured once more."""

from __future__ import annotations

import json
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from shapely.geometry import Polygon
from table import ROOT, Row, at_least, at_most, holds, measured_command, note, run

from pqmesh.io.outlines import read_outline

ROOF = ROOT / "examples" / "roof"
PICTURES = (
    "6-1-networks",
    "7-1-site",
    "7-2-directions",
    "7-3-sketch-lines",
    "7-4-modified",
    "7-5-balance",
    "7-5-planarity",
    "7-6-node",
    "7-7-panels",
    "warp",
)


@cache
def study_run() -> tuple[Path, dict, float]:
    """The roof by the command and the study by its script: folder, figures, seconds of both."""
    folder = Path(tempfile.mkdtemp(prefix="pqmesh-study-"))
    first = run("panelize", ROOF / "roof.toml", "-o", folder)
    done = measured_command([sys.executable, str(ROOF / "case_study.py"), str(folder)])
    if done.code:
        raise RuntimeError(f"case_study.py ended in {done.code}: {done.err[-500:]}")
    return (
        folder,
        json.loads((folder / "case-study.json").read_text(encoding="utf-8")),
        first.seconds + done.seconds,
    )


def case_study() -> list[Row]:
    """From the sketch to the panels."""
    folder, study, seconds = study_run()
    sketch, roof = study["sketch"], study["roof"]
    named = [u for u in sketch["umbilics"] if u["kind"] in ("star", "lemon", "monstar")]
    places = "; ".join(
        f"{u['kind']} at ({', '.join(f'{c:.1f}' for c in u['point'])})" for u in named
    )
    before, after = roof["before_after"]["before"], roof["before_after"]["after"]
    exact = max(layer["distance_error_max"] for layer in roof["layers"])
    made = [name for name in PICTURES if (folder / "case-study" / f"{name}.png").is_file()]
    return [
        at_least("sketch: umbilics inside, named with their place", 2, len(named)),
        note("sketch: umbilics, m", places),
        holds("sketch: viable", "no", "yes" if sketch["viable"] else "no", not sketch["viable"]),
        note("sketch: longest over shortest edge", f"{sketch['edge_ratio']:.1f}"),
        note("sketch: share of the outline its panels cover", f"{sketch['covered_share']:.4f}"),
        at_most("modified: from the sketch, m", 3, roof["away_from_sketch_max"]),
        at_most("modified: umbilics", 0, len(roof["viability"]["umbilics"])),
        at_most("modified: longest over shortest edge", 4, roof["viability"]["edge_ratio"]),
        at_least("modified: share of area with K > 0", 0.10, roof["dome_share"]),
        at_least("modified: share of area with K < 0", 0.10, roof["saddle_share"]),
        at_least("modified: panels", 700, roof["viability"]["panels"]),
        at_least("balance before, deg", 2, before["angle_condition_deg"]),
        note("out of plane before, mm", f"{before['out_of_plane_mm']:.3g}"),
        at_most("balance after, deg", 1e-9, after["angle_condition_deg"]),
        at_most("out of plane after, mm", 1e-9, after["out_of_plane_mm"]),
        at_most("layers: error of their distances, m", 1e-10, exact),
        at_most("twist, deg", 1e-6, roof["twist_max_deg"]),
        holds("pictures", str(len(PICTURES)), len(made), len(made) == len(PICTURES)),
        at_most("the job of make roof, s", 30, seconds),
    ]


def panels_as_cut() -> list[Row]:
    """Trimmed panels of mesh and layers, measured from their files by other formulas."""
    folder, study, _ = study_run()
    outline = Polygon(read_outline(ROOF / "site.svg", "roof", units="m").polygon)
    files = [folder / "panels.obj"]
    files += [folder / f"layer-{i + 1}-panels.obj" for i in range(len(study["roof"]["layers"]))]
    rows = [holds("layers", "3", len(files) - 1, len(files) == 4)]
    for path in files:
        polygons = obj_polygons(path)
        plan = [Polygon(polygon[:, :2]) for polygon in polygons]
        total = sum(part.area for part in plan)
        beyond = max(part.difference(outline).area for part in plan)
        rows += [
            at_most(f"{path.name}: out of plane, m", 1e-9, max(map(out_of_plane, polygons))),
            at_most(f"{path.name}: plan areas add up to", 1e-6, abs(total / outline.area - 1)),
            at_most(f"{path.name}: a panel over the outline, m2", 1e-6, beyond),
        ]
    return rows


def obj_polygons(path: Path) -> list[np.ndarray]:
    """Corners of the faces of an OBJ file, read without the library."""
    lines = [line.split() for line in path.read_text(encoding="ascii").splitlines()]
    points = np.array([line[1:4] for line in lines if line[:1] == ["v"]], dtype=np.float64)
    faces = [line[1:] for line in lines if line[:1] == ["f"]]
    return [points[np.array(face, dtype=np.int64) - 1] for face in faces]


def out_of_plane(polygon: np.ndarray) -> float:
    """Largest distance from the plane of least squares."""
    base = polygon - polygon.mean(axis=0)
    return float(np.abs(base @ np.linalg.svd(base)[2][2]).max())


def networks() -> list[Row]:
    """Figure 6.1, the warp that is allowed, and the parts of a builder."""
    _, study, _ = study_run()
    table = {(row["network"], row["goal"]): row for row in study["networks"]}
    rows = [
        note(
            f"{kind} made {goal}",
            f"{row['panels']} panels; planarity {row['flat_before']:.1e}; moved "
            f"{row['moved_edges']:.3g} edges; deviation {row['deviation_mm']:.3g} mm; twist "
            f"{row['twist_deg']:.1e} deg; broken {row['broken']}; "
            f"{'converged' if row['converged'] else row['reason']}",
        )
        for (kind, goal), row in table.items()
    ]
    for goal in ("planar", "conical"):
        own = table["principal", goal]
        rows.append(at_most(f"principal made {goal}: moved, edges", 0.1, own["moved_edges"]))
        rows.append(at_most(f"principal made {goal}: broken faces", 0, own["broken"]))
        for kind in ("geodesic", "uv"):
            times = table[kind, goal]["moved_edges"] / own["moved_edges"]
            rows.append(at_least(f"{kind} made {goal}: moves further, times", 10, times))
    for kind, curve in study["warp"].items():
        shown = ", ".join(f"{p['warp_mm']:g}: {p['deviation_mm']:.3g}" for p in curve)
        rows.append(note(f"{kind}: deviation against warp, mm", shown))
    for name, parts in study["does_it_pay"].items():
        shown = ", ".join(f"{key} {value:.3g}" for key, value in parts.items())
        rows.append(note(name, shown))
    return rows


groups = {"case study": case_study, "panels as cut": panels_as_cut, "three networks": networks}
