"""The office's roof: a Rhino model far from the origin, and networks along given directions."""

from __future__ import annotations

import json
import tempfile
import time
from functools import cache
from pathlib import Path

import models
import numpy as np
from shapely.geometry import Polygon
from table import ROOT, Row, Run, at_least, at_most, between, holds, note, order, run

from pqmesh.errors import NetworkError
from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.measure import fitted_cones, planarity, plane_deviation
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.kinds import Given, trace_network
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.region import PlanOutline
from pqmesh.source import read_design
from pqmesh.surface.analytic import conjugate_cubic
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import dot, norm

ROOF = ROOT / "examples" / "roof" / "roof.toml"
ORIGIN = np.array([5e8, 3e8, 0.0])
DISTANCES = (-600.0, -80.0, 120.0)


@cache
def far_run() -> tuple[Path, dict, Run]:
    """One command on the model: folder, report, run."""
    folder = Path(tempfile.mkdtemp(prefix="pqmesh-office-"))
    model = models.write_roof_model(folder / "roof.3dm")
    done = run(
        *("panelize", model, "--select", "ROOF", "--outline", f"{model}:SITE"),
        *("--edge", "1500", f"--layers={','.join(map(str, DISTANCES))}", "-o", folder / "out"),
    )
    if done.code not in (0, 3):
        raise RuntimeError(f"panelize ended in {done.code}: {done.err[-500:]}")
    report = json.loads((folder / "out" / "report.json").read_text(encoding="utf-8"))
    return folder / "out", report, done


def far_roof() -> list[Row]:
    """Three joined trimmed faces in millimetres at (5e8, 3e8, 0), measured from the files."""
    folder, report, done = far_run()
    mesh = _near(folder / "mesh.obj")
    misfit = 0.0
    for number, distance in enumerate(DISTANCES, start=1):
        layer = _near(folder / f"layer-{number}.obj")
        shift = (layer.vertices - mesh.vertices)[mesh.faces]
        reached = dot(shift, mesh.face_normals[:, None])
        misfit = max(misfit, float(np.abs(reached - distance).max()))
    outline = Polygon(1000.0 * models.roof_outline())
    panels = _polygons(folder / "panels.obj")
    plan = sum(Polygon(panel[:, :2]).area for panel in panels)
    center = mesh.vertices.mean(axis=0)[:2]
    return [
        holds("one command ends in", "0", done.code, done.code == 0),
        holds("unit of the model", "mm", report["units"], report["units"] == "mm"),
        at_most("mesh lies over the model: centre, mm", 5000, float(norm(center))),
        holds(
            "faces joined",
            "3 faces joined to one surface",
            report["warnings"][0],
            report["warnings"][0] == "3 faces joined to one surface",
        ),
        at_least("panels", 700, report["panels"]["count"]),
        at_most("planarity of the files", 1e-9, float(planarity(mesh).max())),
        at_most("cone spread / theta of the files", 1e-6, fitted_cones(mesh).relative_spread.max()),
        at_most("offset distances of the files, mm", 1e-6, misfit),
        at_most("cut polygons flat, mm", 1e-6, max(plane_deviation(panel) for panel in panels)),
        at_most("plan areas against the outline, relative", 1e-6, abs(plan / outline.area - 1)),
        at_most("deviation, mm", 5, report["deviation"]["max"]),
        at_most(
            "edge_max / edge_min", 4, report["after"]["edge_max"] / report["after"]["edge_min"]
        ),
        note("the job, s", f"{done.seconds:.1f}"),
    ]


def failing_sketch() -> list[Row]:
    """The first sketch by the command: what stands in the way is named with its place."""
    with tempfile.TemporaryDirectory(prefix="pqmesh-sketch-") as name:
        folder = Path(name)
        done = run("panelize", ROOF.with_name("sketch.toml"), "-o", folder, "--no-figures")
        report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    named = [text for text in report["warnings"] if text.startswith("umbilic (")]
    return [
        holds("sketch by the command: ends in", "3", done.code, done.code == 3),
        at_least("umbilics named with their place", 2, len(named)),
        holds("the first of them", "a place", named[0][:60], "at (" in named[0]),
        holds(
            "tolerance that is not reached",
            "cover",
            ", ".join(row["key"] for row in report["tolerance"] if row["pass"] is False),
            any(row["key"] == "cover" and row["pass"] is False for row in report["tolerance"]),
        ),
    ]


def _near(path: Path) -> QuadMesh:
    """A mesh of a file, its origin taken off."""
    mesh = read_quad_mesh(path)
    return mesh.with_vertices(mesh.vertices - ORIGIN)


def _polygons(path: Path) -> list[np.ndarray]:
    """Polygons of an OBJ file, their origin taken off."""
    rows = path.read_text(encoding="ascii").splitlines()
    corners = np.array([row.split()[1:4] for row in rows if row.startswith("v ")], dtype=float)
    faces = [[int(i) - 1 for i in row.split()[1:]] for row in rows if row.startswith("f ")]
    return [corners[face] - ORIGIN for face in faces]


def conjugate_orders() -> list[Row]:
    """Planarity of conjugate networks along plan directions, before any optimisation."""
    cubic = conjugate_cubic()
    roof = read_design(ROOF)
    rows = []
    for name, surface, place, half, sizes in (
        ("cubic of appendix A", cubic, (0.0, 0.0), (0.12, 0.12), (0.04, 0.02, 0.01)),
        ("roof, its middle", roof.surface, (-2.0, -2.0), (8.0, 12.0), (1.5, 0.75, 0.375)),
    ):
        region = _box(place, half)
        principal = _principal_angle(surface, place)
        for turn in (0, 30, 60):
            given = Given(direction=principal + np.radians(turn))
            found, angle = [], 90.0
            for size in sizes:
                inside = region.on(surface)
                network = trace_network("conjugate", surface, (size, size), inside, given)
                mesh = quads_from_network(network, inside).mesh
                found.append(float(planarity(mesh)[region.contains(mesh.face_centers)].max()))
                angle = min(angle, float(np.degrees(network.angles.min())))
            rows.append(
                note(
                    f"{name}, {turn} deg: planarity at h, h/2, h/4",
                    ", ".join(f"{value:.1e}" for value in found)
                    + f"; families meet under {angle:.0f} deg at least",
                )
            )
            rows.append(between(f"{name}, {turn} deg: order", 2.7, 3.3, order(found, list(sizes))))
    rows.append(_refusal(roof.surface, roof.outline))
    return rows


def _box(middle: tuple[float, float], half: tuple[float, float]) -> PlanOutline:
    """A rectangle in plan."""
    (x, y), (a, b) = middle, half
    return PlanOutline([[x - a, y - b], [x + a, y - b], [x + a, y + b], [x - a, y + b]])


def _principal_angle(surface: Surface, place: tuple[float, float]) -> float:
    """Plan angle of the principal direction of the larger |k| at a place, radians."""
    uv = surface.domain.grid(200, 200).reshape(-1, 2)
    near = norm(surface.jet(uv).point[:, :2] - np.array(place)).argmin()
    shape = shape_data(surface.jet(uv[near : near + 1]))
    direction = shape.directions[0, int(np.abs(shape.k[0]).argmax())]
    return float(np.arctan2(direction[1], direction[0]))


def _refusal(surface: Surface, outline: PlanOutline | None) -> Row:
    """At 60 degrees the whole roof has asymptotic directions, and is refused with a place."""
    assert outline is not None
    direction = _principal_angle(surface, (-2.0, -2.0)) + np.radians(60)
    try:
        trace_network("conjugate", surface, (1.5, 1.5), outline.on(surface), Given(direction))
    except NetworkError as error:
        text = str(error)
        return holds(
            "whole roof, 60 deg: refused near an asymptotic direction",
            "named",
            text[:110],
            "asymptotic" in text and "near [" in text,
        )
    return holds("whole roof, 60 deg: refused near an asymptotic direction", "named", "no", False)


def three_networks() -> list[Row]:
    """How long each network of the roof takes, and what its panels are like."""
    roof = read_design(ROOF)
    assert roof.outline is not None
    inside = roof.outline.on(roof.surface)
    rows = []
    for kind in ("principal", "uv", "geodesic"):
        began = time.perf_counter()
        network = trace_network(kind, roof.surface, (1.5, 1.5), inside)
        mesh = quads_from_network(network, inside).mesh
        rows.append(
            note(
                f"{kind}, panels of 1.5 m",
                f"{mesh.topology.n_faces} panels, planarity {planarity(mesh).max():.1e}, angles of "
                f"the families {np.degrees(network.angles.min()):.1f} deg and more, "
                f"{time.perf_counter() - began:.1f} s",
            )
        )
    return rows


groups = {
    "Rhino model far away": far_roof,
    "failing sketch": failing_sketch,
    "conjugate orders": conjugate_orders,
    "networks of the roof": three_networks,
}
