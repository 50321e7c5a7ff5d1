"""Surfaces from files: their derivatives, and three trimmed faces as one surface over the plan."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import iges
import jets
import models
import numpy as np
from table import DATA, Row, at_most, holds, note, skipped

from pqmesh.io.compas import read_compas_surface
from pqmesh.io.rhino import SurfaceFile, read_rhino_surfaces
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.plan import Patch, PlanSurface, seams

LIMIT = 1e-10
ORIGIN = np.array([5e8, 3e8, 0.0])


def derivatives_of_files() -> list[Row]:
    """Points and first and second derivatives against geomdl and scipy, over their size."""
    rows = []
    with tempfile.TemporaryDirectory(prefix="pqmesh-files-") as name:
        place = Path(name)
        for title, make in jets.OWN.items():
            net = make()
            rows += _against_both(f"{title}.3dm", [(net, *_saved(net, place / "own.3dm"))])
        if not DATA.is_dir():
            return [*rows, skipped("real files", "the data folder is missing")]
        path = DATA / "surface_from_rhino.json"
        table = json.loads(path.read_text(encoding="utf-8"))["data"]
        u, v = (np.repeat(table[f"knots_{x}"], table[f"mults_{x}"]) for x in "uv")
        degrees = table["degree_u"], table["degree_v"]
        net = jets.Nurbs(np.array(table["points"]), degrees, (u, v))
        rows += _against_both(path.name, [(net, read_compas_surface(path), np.zeros(3))])
        _, found = iges.read_iges_surfaces(DATA / "sunglasses_lens.igs")
        lens = []
        for surface in found:
            net = jets.Nurbs(surface.points, surface.degrees, surface.knots, surface.weights)
            lens.append((net, *_saved(net, place / "lens.3dm")))
        rows += _against_both("sunglasses_lens.igs, nine patches by .3dm", lens)
    return rows


def _saved(net: jets.Nurbs, path: Path) -> tuple[BSplineSurface, np.ndarray]:
    """A net written to a Rhino model and read again: the surface and the file's origin."""
    models.Model("Inches").add(models.nurbs(*net), "SURFACE").write(path)
    file = read_rhino_surfaces(path)
    return file.patches[0].surface, file.origin


def _against_both(title: str, parts: list[tuple[jets.Nurbs, BSplineSurface, np.ndarray]]) -> list:
    """A row for each of the other programs: the worst of point and five derivatives."""
    worst = {"geomdl": 0.0, "scipy": 0.0}
    count = 0
    for net, surface, origin in parts:
        uv = jets.places(net)
        count += len(uv)
        found = np.stack(surface.jet(uv))
        found[0] += origin
        for name, other in (("geomdl", jets.geomdl_jets), ("scipy", jets.scipy_jets)):
            gap = float(jets.differences(found, other(net, uv)).max())
            worst[name] = max(worst[name], gap)
    return [
        at_most(f"{title}: jets at {count} places against {name}", LIMIT, gap)
        for name, gap in worst.items()
    ]


def roof_of_three_faces() -> list[Row]:
    """The example roof in millimetres at 5e8, from three trimmed faces of one joined Brep."""
    with tempfile.TemporaryDirectory(prefix="pqmesh-files-") as name:
        path = models.write_roof_model(Path(name) / "roof.3dm", origin=tuple(ORIGIN))
        began = time.perf_counter()
        file = read_rhino_surfaces(path, "ROOF")
        seconds = time.perf_counter() - began
    surface = PlanSurface(
        tuple(Patch(p.surface, p.loops, f"{p.name} {p.face}") for p in file.patches)
    )
    original = _whole_roof(file)
    uv = np.random.default_rng(8).uniform((0.05, 0.1), (0.95, 0.9), (10_000, 2))
    jet = original.jet(uv)
    xy = jet.point[:, :2]
    height = float(np.abs(surface.jet(xy).point - jet.point).max())
    joints = seams(surface)
    rows = [
        holds("faces, unit", "3, mm", f"{len(file.patches)}, {file.units}",
              len(file.patches) == 3 and file.units == "mm"),
        at_most("reading the three faces, s", 2.0, seconds),
        at_most("heights against the roof before it was split, mm", 1e-6, height),
        holds("points of the roof that no face holds", "0", int((~surface.contains(xy)).sum()),
              bool(surface.contains(xy).all())),
        at_most("largest gap of the seams, mm", 1e-6, max(s.gap for s in joints)),
        at_most("largest angle of the seams, rad", 1e-9, max(s.angle for s in joints)),
        at_most("largest curvature jump of the seams, 1/mm", 1e-12,
                max(s.curvature for s in joints)),
    ]  # fmt: skip
    for n in (100, 10_000):
        whole = _median_seconds(lambda n=n: original.jet(uv[:n]))
        faces = _median_seconds(lambda n=n: surface.jet(xy[:n]))
        rows.append(
            note(
                f"jets of {n} points: three faces, one surface",
                f"{1e3 * faces:.2f} ms, {1e3 * whole:.2f} ms ({faces / whole:.1f} times)",
            )
        )
    return rows


def _whole_roof(file: SurfaceFile) -> BSplineSurface:
    """The roof as one surface, about the file's origin."""
    net = models.roof_net()
    return BSplineSurface(1000.0 * net.points + (ORIGIN - file.origin), net.degrees, net.knots)


def _median_seconds(call: Callable[[], object], times: int = 15) -> float:
    taken = []
    for _ in range(times):
        began = time.perf_counter()
        call()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


groups = {
    "derivatives of files": derivatives_of_files,
    "a roof of three faces": roof_of_three_faces,
}
