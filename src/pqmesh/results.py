"""The files of a result: meshes, report and pictures, all or none of them."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

import pqmesh
from pqmesh.errors import PqmeshError
from pqmesh.fabricate.panels import obj_from_polygons
from pqmesh.io.atomic import write_all
from pqmesh.io.obj import obj_from_mesh
from pqmesh.job import Panelization
from pqmesh.leftovers import earlier_parts, remove_leftovers, remove_parts
from pqmesh.mesh.measure import conicality_defect, fitted_cones, planarity_deviation
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.support import SupportStructure
from pqmesh.outputs import json_bytes
from pqmesh.source import Source
from pqmesh.vectors import Floats

NETWORK_WORDS = {
    "principal": "Lines of curvature",
    "uv": "Parameter lines",
    "geodesic": "Geodesics",
    "conjugate": "Conjugate lines",
}


@dataclass(frozen=True, eq=False)
class Roof:
    """A result with its report, before its files are written.

    Attributes
    ----------
    result : Panelization
    report : dict
        But `timing`.
    origin : (3,)
        To be added to all coordinates.
    figures : bool
        Draw the pictures.
    """

    result: Panelization
    report: dict[str, Any]
    origin: Floats
    figures: bool


def panelization_files(result: Panelization, origin: Floats) -> dict[str, bytes]:
    """Mesh files of a roof by name: whole, and cut by the outline where there is one.

    The origin (3,) is added here, after all work near it is done.
    """

    def mesh_file(mesh: QuadMesh) -> bytes:
        return obj_from_mesh(mesh.with_vertices(mesh.vertices + origin))

    def panel_file(polygons: Sequence[Floats], what: str = "panels") -> bytes:
        return obj_from_polygons([polygon + origin for polygon in polygons], what)

    files = {"mesh.obj": mesh_file(result.mesh)}
    for number, layer in enumerate(result.layers, start=1):
        files[f"layer-{number}.obj"] = mesh_file(layer.mesh)
    if result.support is not None:
        files["support.obj"] = _quads_obj(result.support, origin)
    cut = result.trimmed
    if cut is None:
        # Without an outline the panels are whole.
        stems = [name.removesuffix(".obj") for name in files]
        for stem in stems:
            panels = "panels.obj" if stem == "mesh" else f"{stem}-panels.obj"
            files[panels] = files[f"{stem}.obj"]
        return files
    files["panels.obj"] = panel_file(cut.panels.polygons)
    for number, trimmed in enumerate(cut.layers, start=1):
        files[f"layer-{number}-panels.obj"] = panel_file(trimmed.polygons)
    if cut.webs is not None:
        files["support-panels.obj"] = panel_file(cut.webs.polygons, "webs")
    return files


def _quads_obj(support: SupportStructure, origin: Floats) -> bytes:
    """Webs as an OBJ file: four vertices of its own for each, in the order of the edges."""
    corners = support.quads.reshape(-1, 3) + origin
    rows = [
        f"# pqmesh geometric support structure: {len(support.quads)} quads, one an edge\n",
        *(f"v {x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in corners.tolist()),
        *(
            f"f {4 * i + 1} {4 * i + 2} {4 * i + 3} {4 * i + 4}\n"
            for i in range(len(support.quads))
        ),
    ]
    return "".join(rows).encode("ascii")


def figures_available() -> bool:
    """Whether the drawing library (extra `viz`) is installed."""
    return find_spec("matplotlib") is not None


def panelization_figures(result: Panelization, units: str) -> dict[str, bytes]:
    """Pictures of network, measures, layers and one node, by name."""
    from pqmesh.view import figures

    mesh, start = result.mesh, result.start
    flat = _in_small_units(planarity_deviation(mesh), units)
    pictures = {
        "network": figures.network_figure(
            result.network,
            result.network_mesh,
            region=result.outline,
            umbilics=result.umbilics.umbilics,
            units=units,
            title=f"{NETWORK_WORDS[result.network.kind]} and the mesh they give",
        ),
        "flatness": figures.measure_figure(
            mesh,
            flat[0],
            label="distance of the diagonals",
            unit=flat[1],
            units=units,
            log=True,
            at="face",
            title="Flatness of the panels after optimisation",
        ),
        "surface-curvature": figures.viability_figure(
            result.surface, result.outline, result.umbilics.umbilics, units=units
        ),
    }
    vertices, balance = conicality_defect(mesh)
    if len(vertices):
        before = np.zeros(mesh.topology.n_vertices)
        before[vertices] = np.degrees(np.abs(conicality_defect(start)[1]))
        after = np.zeros(mesh.topology.n_vertices)
        after[vertices] = np.degrees(np.abs(balance))
        pictures["balance"] = figures.comparison_figure(
            start,
            mesh,
            before,
            after,
            label="balance of angles",
            unit="deg",
            units=units,
            log=True,
            at="vertex",
            title="Balance of angles at the nodes, before and after",
        )
    if result.layers and result.support is not None and len(fitted_cones(mesh).vertices):
        layers = [layer.mesh for layer in result.layers]
        quads = result.support.quads
        pictures["layers"] = figures.layers_figure(
            mesh, layers, quads, units=units, title="Layers and support structure"
        )
        pictures["node"] = figures.node_figure(
            mesh, layers, quads, figures.typical_node(mesh), units=units, title="One node"
        )
    return {f"figures/{name}.png": data for name, data in sorted(pictures.items())}


def _in_small_units(lengths: Any, units: str) -> tuple[Any, str]:
    """Lengths in millimetres where the model is metric, in the model unit elsewhere."""
    factor = {"m": 1e3, "cm": 10.0, "mm": 1.0, "km": 1e6}.get(units)
    return (lengths * factor, "mm") if factor else (lengths, units)


def write_panelization(folder: Path, roof: Roof, *, began: float) -> dict[str, Any]:
    """Write all files of a roof into a folder, and return the report with its timing.

    Files of an earlier run that this one does not make (a third layer, a picture) are removed
    after the new ones stand.

    Parameters
    ----------
    folder : path
    roof : Roof
    began : float, seconds
        Spent on reading.
    """
    result, report = roof.result, roof.report
    clock = time.perf_counter()
    files = panelization_files(result, roof.origin)
    if roof.figures:
        try:
            files |= panelization_figures(result, report["units"])
        except PqmeshError as error:
            # The roof itself is sound, and the work behind it is long.
            report = report | {"warnings": [*report["warnings"], f"no pictures: {error}"]}
    seconds = result.seconds
    report = report | {
        "timing": {
            "read": began,
            "network": seconds["network"],
            "optimize": seconds["optimize"],
            "offset": seconds["offset"],
            "fabricate": seconds["fabricate"],
            "write": time.perf_counter() - clock,
            "total": began + sum(seconds.values()) + time.perf_counter() - clock,
        }
    }
    files["report.json"] = json_bytes(report)
    earlier = earlier_parts(folder)
    write_all(folder, files)
    remove_leftovers(folder, set(files))
    remove_parts(folder, earlier)
    return report


def part_folders(folder: Path, names: Sequence[str]) -> list[Path]:
    """A folder of its own for each part of a result, called after it."""
    stems = [re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "part" for name in names]
    return [folder / f"{number}-{stem}"[:80] for number, stem in enumerate(stems, start=1)]


def write_index(
    folder: Path, sources: Sequence[Source], folders: Sequence[Path], codes: Sequence[int]
) -> None:
    """Write the report of several parts: which there are, where, and how each ended.

    Files of an earlier run, of one roof or of other parts, are removed.
    """
    index = {
        "schema": 1,
        "version": pqmesh.__version__,
        "units": sources[0].design.units,
        "parts": [
            {"name": source.name, "folder": place.name, "exit_code": code}
            for source, place, code in zip(sources, folders, codes, strict=True)
        ],
        "warnings": sorted({note for source in sources for note in source.notes}),
    }
    earlier = earlier_parts(folder)
    write_all(folder, {"report.json": json_bytes(index)})
    remove_leftovers(folder, {"report.json"})
    remove_parts(folder, earlier - {place.name for place in folders})
