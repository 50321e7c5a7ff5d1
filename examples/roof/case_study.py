"""The case study: from the architect's sketch to the layout of the panels, with every figure.

A sketch that has no viable network is changed a little; the changed surface becomes a conical
mesh with layers, support structure and trimmed panels. Three networks, the parts of a builder and
the price of flatness are compared on the way. Run it after `make roof`:
python examples/roof/case_study.py out/roof
It prints its tables and writes case-study.json and the pictures in case-study/.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import does_it_pay
import measured
import networks
import numpy as np
import pictures

from pqmesh.io.atomic import write_all
from pqmesh.io.drawings import drawing_from_svg
from pqmesh.io.outlines import read_outline
from pqmesh.io.strokes import flattened
from pqmesh.job import Panelization, Spec, panelize
from pqmesh.network.region import PlanOutline
from pqmesh.outputs import json_bytes
from pqmesh.report import deviation
from pqmesh.source import read_design, spec_of
from pqmesh.surface.base import Surface
from pqmesh.surface.reference import SurfaceReference
from pqmesh.view.plan import Surroundings

HERE = Path(__file__).parent


def read_site() -> tuple[PlanOutline, Surroundings]:
    """The roof's outline and what stands around it, from the drawing of the site, metres."""
    drawing = HERE / "site.svg"
    outline = read_outline(drawing, "roof", units="m")
    buildings = flattened(drawing_from_svg(drawing, "buildings").strokes)
    labels = ElementTree.parse(drawing).iterfind(".//{*}g[@id='labels']/{*}text")
    names = tuple((t.text or "", (float(t.get("x", 0)), -float(t.get("y", 0)))) for t in labels)
    return outline, Surroundings(tuple(buildings), names)


def read_surface(name: str) -> tuple[Surface, Spec]:
    """Surface of a design file beside this script, and what is wanted of it."""
    source = read_design(HERE / name)
    return source.surface, spec_of(source)


def modified(roof: Panelization, sketch: Surface) -> dict[str, Any]:
    """The roof that is built: how far from the sketch, how curved, how viable, how exact."""
    assert roof.outline is not None
    assert roof.support is not None
    surface, outline = roof.surface, roof.outline
    uv = surface.domain.grid(300, 300).reshape(-1, 2)
    away = measured.height_between(surface, sketch, uv[outline.on(surface)(uv)])
    reference = SurfaceReference(surface, roof.uv)
    found = measured.Traced(surface, roof.umbilics, roof.network, roof.network_mesh)
    return {
        "away_from_sketch_max": float(away.max()),
        "away_from_sketch_mean": float(away.mean()),
        **measured.character(surface, outline),
        "viability": measured.viability(found, outline),
        "before_after": measured.before_after(roof),
        "deviation_max": deviation(roof.start, roof.mesh, reference)["max"],
        "layers": [
            {"distance": layer.distance, "distance_error_max": layer.distance_error_max}
            for layer in roof.layers
        ],
        "webs": len(roof.support.quads),
        "twist_max_deg": float(np.degrees(roof.support.twist.max())),
        "built": measured.built(roof),
    }


def compare(surface: Surface, outline: PlanOutline) -> tuple[networks.Comparison, dict[str, bytes]]:
    """Three networks on the roof, and their pictures."""
    starts, found = networks.study(surface, outline)
    return found, pictures.networks_picture(starts, found, outline) | pictures.warp_picture(found)


def main(folder: Path) -> dict[str, Any]:
    """Run the study, print its tables, write its files into the folder, return its figures."""
    began = time.perf_counter()
    outline, around = read_site()
    surface, spec = read_surface("roof.toml")
    with ProcessPoolExecutor(1) as pool:
        # Half of the work, and independent of the rest.
        aside = pool.submit(compare, surface, outline)
        drawn, _ = read_surface("sketch.toml")
        sketch = measured.traced(drawn, outline, spec.edges)
        roof = panelize(surface, spec, outline)
        grid = networks.start_of("uv", surface, outline, spec.edges[0])
        images = pictures.sketch_pictures(sketch, outline, around)
        images |= pictures.roof_pictures(roof, drawn, around) | pictures.optimised_pictures(roof)
        compared, more = aside.result()
    images |= more
    study = {
        "sketch": {"dome": measured.SKETCH_DOME, **measured.viability(sketch, outline)},
        "way": measured.way(outline),
        "roof": modified(roof, drawn),
        "networks": compared.rows,
        "warp": compared.curves,
        "does_it_pay": does_it_pay.compared(roof.mesh, grid.mesh),
    }
    print_study(study)
    files = {f"case-study/{name}.png": data for name, data in sorted(images.items())}
    write_all(folder, files | {"case-study.json": json_bytes(study)})
    seconds = time.perf_counter() - began
    print(f"\n{len(images)} pictures and case-study.json in {folder}, {seconds:.0f} s")
    return study


# --- tables -----------------------------------------------------------------------------------


def print_study(study: dict[str, Any]) -> None:
    """All tables of the study."""
    print_viability("The sketch", study["sketch"])
    print("\nWhile the dome is lowered\n  dome, m  umbilics  least |k1 - k2| over the median")
    for row in study["way"]:
        print(f"  {row['dome']:7.1f}  {row['umbilics']:8d}  {row['gap_min_over_median']:.3f}")
    print_roof(study["roof"])
    print_networks(study["networks"])
    print("\nDistance from the surface against the warp allowed, mm")
    for kind, curve in study["warp"].items():
        for row in curve:
            note = "" if row["reached"] else f"  (reached {row['flat_after_mm']:.3g} mm)"
            print(
                f"  {kind:10} warp {row['warp_mm']:4.3g}: deviation {row['deviation_mm']:8.3g}, "
                f"moved {row['moved_edges']:.3g} edges{note}"
            )
    print("\nDoes it pay?")
    does_it_pay.print_figures(study["does_it_pay"])


def print_viability(title: str, found: dict[str, Any]) -> None:
    """Umbilics by kind and place, and how even the panels are."""
    print(f"\n{title}: {'viable' if found['viable'] else 'not viable'}")
    for u in found["umbilics"]:
        place = ", ".join(f"{c:.2f}" for c in u["point"])
        print(f"  umbilic: {u['kind']} of index {u['index']:+g} at ({place}) m")
    print(f"  umbilics {len(found['umbilics'])}, least |k1 - k2| over the median ", end="")
    print(f"{found['gap_min_over_median']:.3f}")
    print(f"  {found['panels']} panels cover {100 * found['covered_share']:.1f} % of the outline;")
    print(f"  edges {found['edge_min']:.2f} to {found['edge_max']:.2f} m, ", end="")
    print(f"ratio {found['edge_ratio']:.1f}; {found['unusable_quads']} quads unusable")


def print_roof(roof: dict[str, Any]) -> None:
    """The modified surface, figure 7.5, and mesh and layers as they are cut."""
    print_viability("The modified surface", roof["viability"])
    print(
        f"  at most {roof['away_from_sketch_max']:.2f} m from the sketch; like a dome on ", end=""
    )
    print(f"{100 * roof['dome_share']:.0f} %, like a saddle on {100 * roof['saddle_share']:.0f} %")
    print("\nOptimisation            max out of plane, mm  angle condition, deg")
    for name, row in roof["before_after"].items():
        print(f"  {name:20}  {row['out_of_plane_mm']:20.2g}  ", end="")
        print(f"{row['angle_condition_deg']:20.2g}")
    print(f"  the mesh ends at most {1e3 * roof['deviation_max']:.2g} mm from the surface")
    print("\n  layer, mm  panels  cut  slivers  area, m2  out of plane, m  cover error")
    for row in roof["built"]:
        print(
            f"  {1e3 * row['distance']:9.0f}  {row['panels']:6d}  {row['cut']:3d}  "
            f"{row['slivers']:7d}  {row['area']:8.1f}  {row['flat_max']:15.1e}  "
            f"{row['plan_cover_error']:.1e}"
        )
    errors = max(layer["distance_error_max"] for layer in roof["layers"])
    print(f"  {roof['webs']} webs, largest twist {roof['twist_max_deg']:.1e} deg; ", end="")
    print(f"distances of the layers exact to {errors:.1e} m")


def print_networks(rows: list[dict[str, Any]]) -> None:
    """The three networks, each made planar and conical."""
    print(f"\nThree networks, panels of {networks.EDGE:g} m")
    print(
        "  network    made     panels  flat before  moved, edges  deviation, mm  twist, deg", end=""
    )
    print("  broken  converged")
    for row in rows:
        print(
            f"  {row['network']:9}  {row['goal']:7}  {row['panels']:6d}  {row['flat_before']:11.1e}"
            f"  {row['moved_edges']:12.3g}  {row['deviation_mm']:13.4g}  {row['twist_deg']:10.1e}"
            f"  {row['broken']:6d}  {'yes' if row['converged'] else 'no'}"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/roof"))
