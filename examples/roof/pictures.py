"""The pictures of the case study, by the numbers that its figures have in the thesis."""

from __future__ import annotations

from typing import Any

import numpy as np
from measured import Traced, height_between
from networks import EDGE, Comparison, Start

from pqmesh.job import Panelization
from pqmesh.mesh.measure import conicality_defect, planarity_deviation
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.region import PlanOutline
from pqmesh.surface.base import Surface
from pqmesh.view import figures
from pqmesh.view.camera import Camera
from pqmesh.view.plan import Surroundings

TITLES = {"geodesic": "geodesics", "uv": "parameter lines", "principal": "lines of curvature"}
COLORS = {"geodesic": "#3f7d4e", "uv": "#c2452d", "principal": "#1d5b94"}


def sketch_pictures(sketch: Traced, outline: PlanOutline, around: Surroundings) -> dict[str, bytes]:
    """Figures 7.1 to 7.3: the site, the principal directions, and lines that fail."""
    umbilics = sketch.umbilics.umbilics
    return {
        "7-1-site": figures.site_figure(
            sketch.surface, outline, around, units="m", title="The site and the first sketch"
        ),
        "7-2-directions": figures.directions_figure(
            sketch.surface,
            outline,
            umbilics,
            units="m",
            title="Principal directions of the sketch",
        ),
        "7-3-sketch-lines": figures.network_figure(
            sketch.network,
            region=outline,
            umbilics=umbilics,
            units="m",
            title="Lines of curvature of the sketch: no network for panels",
        ),
    }


def roof_pictures(roof: Panelization, sketch: Surface, around: Surroundings) -> dict[str, bytes]:
    """Figures 7.4, 7.6 and 7.7: the modified surface, a node, the layout of the panels."""
    assert roof.support is not None
    assert roof.trimmed is not None
    layers = [layer.mesh for layer in roof.layers]
    node = figures.typical_node(roof.mesh)
    return {
        "7-4-modified": figures.difference_figure(
            roof.network,
            lambda uv: height_between(roof.surface, sketch, uv),
            region=roof.outline,
            label="below the sketch",
            units="m",
            title="The modified surface and its lines of curvature",
        ),
        "7-6-node": figures.node_figure(
            roof.mesh, layers, roof.support.quads, node, units="m", title="A conical node"
        ),
        "7-7-panels": figures.layout_figure(
            roof.trimmed.panels, around, units="m", title="The final layout of the panels"
        ),
    }


def optimised_pictures(roof: Panelization) -> dict[str, bytes]:
    """Figure 7.5: flatness of the panels and balance at the nodes, before and after."""
    start, mesh = roof.start, roof.mesh

    def balance(of: QuadMesh) -> np.ndarray:
        vertices, values = conicality_defect(of)
        every = np.full(of.topology.n_vertices, np.nan)
        every[vertices] = np.degrees(np.abs(values))
        return every

    flat = [1e3 * planarity_deviation(of) for of in (start, mesh)]
    names = ("before optimisation", "after optimisation")
    common: dict[str, Any] = {"units": "m", "log": True, "names": names}
    return {
        "7-5-planarity": figures.comparison_figure(
            start,
            mesh,
            *flat,
            label="distance of the diagonals",
            unit="mm",
            at="face",
            title="Flatness of the panels",
            **common,
        ),
        "7-5-balance": figures.comparison_figure(
            start,
            mesh,
            balance(start),
            balance(mesh),
            label="balance of angles",
            unit="deg",
            at="vertex",
            title="Angle condition at the nodes",
            **common,
        ),
    }


def networks_picture(
    starts: list[Start], compared: Comparison, outline: PlanOutline
) -> dict[str, bytes]:
    """Figure 6.1: three networks, and how far their meshes move until they are flat."""
    shown = []
    for start in starts:
        of = {row["goal"]: row for row in compared.rows if row["network"] == start.kind}
        words = (
            f"{of['planar']['panels']} panels, {of['planar']['flat_before_mm']:.2g} mm from flat",
            f"made flat: moved {of['planar']['moved_edges']:.2g} edges",
            f"made conical: moved {of['conical']['moved_edges']:.2g} edges",
        )
        shown.append(figures.NamedNetwork(TITLES[start.kind], start.network, words))
    picture = figures.networks_figure(
        shown,
        region=outline,
        units="m",
        title="Three networks on the roof",
        caption=f"panels of {EDGE:g} m, and how far their nodes move until all panels are flat, "
        "or flat and conical",
        camera=Camera.orbit(np.zeros(3), np.radians(-105.0), np.radians(62.0)),
    )
    return {"6-1-networks": picture}


def warp_picture(compared: Comparison) -> dict[str, bytes]:
    """The distance from the surface that flatness costs, against the warp allowed."""
    series = [
        figures.Series(
            TITLES[kind],
            COLORS[kind],
            {row["warp_mm"]: row["deviation_mm"] for row in curve},
            frozenset(row["warp_mm"] for row in curve if not row["reached"]),
        )
        for kind, curve in compared.curves.items()
    ]
    picture = figures.chart_figure(
        series,
        across="panels may be out of plane by (mm)",
        up="largest distance from the surface (mm)",
        least=1e-2,
        title="What flatness costs",
        caption=f"the roof in panels of {EDGE:g} m, made flat up to the warp that is allowed",
        hollow="warp not reached",
    )
    return {"warp": picture}
