"""The main job: a surface becomes a panelled roof with its layers and its support structure."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.fabricate.edgebeams import EdgeBeam, edge_beams
from pqmesh.fabricate.trim import TrimmedPanels, TrimmedWebs, trimmed_panels, trimmed_webs
from pqmesh.fabricate.walls import outline_walls
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.kinds import Given, trace_network
from pqmesh.network.meshing import NetworkMesh, quads_from_network
from pqmesh.network.principal import CurveNetwork, Inside
from pqmesh.network.region import PlanOutline, region_samples
from pqmesh.offset.offsets import Layer, offset_layer, offset_vectors
from pqmesh.offset.support import SupportStructure, support_structure
from pqmesh.offset.vectors import OffsetVectors
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import Solution, Step
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import first_form
from pqmesh.surface.faces import FaceRegion
from pqmesh.surface.reference import SurfaceReference
from pqmesh.surface.umbilics import UmbilicReport, find_umbilics
from pqmesh.vectors import Floats, Mask, cross, norm, unit

# The network stops at as many lines in a family, but only after it has traced them.
MOST_LINES = 4000
# Sizes beyond this, or below its inverse, leave the range of doubles when squared twice.
LARGEST_EXTENT = 1e50
# A surface may turn over on this share of the outline, as by rounding at a rim, and its area in
# plan may exceed the outline's by this factor, beside what the samples along the rim leave open.
FOLDED, STACKED = 0.002, 1.02
SHEET_SAMPLES = (120, 120)

# Told the stage that begins and, while optimising, the last step.
Progress = Callable[[str, Step | None], None]


@dataclass(frozen=True)
class Spec:
    """What is wanted of a roof, lengths in the model unit.

    Attributes
    ----------
    edges : (float, float)
        Wanted panel edge along the lines of the first and of the second family; of larger and
        of smaller principal curvature in a principal network.
    kind : 'planar', 'conical' or 'circular'
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
    flip: bool = False
    most_panels: int = 1_000_000


@dataclass(frozen=True, eq=False)
class TrimmedRoof:
    """The roof cut by the vertical prism over its outline: mesh, layers, webs, edge beams."""

    panels: TrimmedPanels
    layers: tuple[TrimmedPanels, ...]
    webs: TrimmedWebs | None
    beams: tuple[EdgeBeam, ...]


@dataclass(frozen=True, eq=False)
class Panelization:
    """One field a stage; later stages never write into earlier ones.

    Attributes
    ----------
    orientation : str
        Which way the normals look, and whether faces were reversed for it.
    start : QuadMesh
        The mesh of the network before optimisation.
    inside : callable or None
        Truth at parameters: the region that was to be covered.
    uv : (V, 2)
        Surface parameters of the start's vertices.
    seconds : mapping of stage to seconds
    """

    surface: Surface
    spec: Spec
    outline: PlanOutline | None
    inside: Inside | None
    umbilics: UmbilicReport
    network: CurveNetwork
    network_mesh: NetworkMesh
    orientation: str
    start: QuadMesh
    solution: Solution
    mesh: QuadMesh
    vectors: OffsetVectors
    layers: tuple[Layer, ...]
    support: SupportStructure | None
    trimmed: TrimmedRoof | None
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def uv(self) -> Floats:
        """Surface parameters of the start vertices."""
        return self.network_mesh.uv


def panelize(
    surface: Surface,
    spec: Spec,
    outline: PlanOutline | None = None,
    progress: Progress | None = None,
    region: FaceRegion | None = None,
) -> Panelization:
    """Network, mesh, optimisation, layers and support structure of a surface.

    Parameters
    ----------
    surface : Surface
    spec : Spec
    outline : PlanOutline, optional
        The plan region to cover; the whole surface otherwise.
    progress : callable, optional
    region : FaceRegion, optional
        The faces of the surface, where it is to be used on these only.

    Raises
    ------
    SpecError
        When the edge does not fit the surface, or the surface stands more than once over a
        point of the outline.
    NetworkError
        When the surface has no network, or none in the region.

    Examples
    --------
    >>> from pqmesh.surface.analytic import torus
    >>> roof = panelize(torus(3.0, 1.0), Spec(edges=(0.6, 0.6), distances=(0.1,)))
    >>> roof.solution.converged, roof.layers[0].distance_error_max < 1e-12
    (True, True)
    """
    tell = progress or (lambda stage, step: None)
    clock = _Clock()
    inside = _inside(surface, outline, region)
    _check_edges(surface, spec, inside, outline)
    wide = inside
    if outline is not None:
        # A crooked outline is refused now, not after the work.
        outline_walls(outline)
        _check_sheets(surface, outline, inside)
        wide = _inside(surface, outline, region, _overhang(surface, spec, inside))
    tell("network", None)
    umbilics = find_umbilics(surface, wide)
    network = trace_network(spec.network, surface, spec.edges, wide, spec.given)
    network_mesh = quads_from_network(network, wide)
    start, orientation = _oriented(network_mesh.mesh, flip=spec.flip)
    clock.lap("network")
    tell("optimize", None)
    solution = optimized(
        spec.kind,
        start,
        SurfaceReference(surface, network_mesh.uv),
        boundary=spec.boundary,
        within=spec.within,
        warp=spec.flat,
        progress=lambda step: tell("optimize", step),
    )
    mesh = start.with_vertices(solution.blocks["vertices"])
    clock.lap("optimize")
    tell("offset", None)
    vectors = offset_vectors(mesh, spec.kind)
    layers = tuple(offset_layer(mesh, vectors, distance) for distance in spec.distances)
    support = _support(mesh, vectors, spec.distances)
    clock.lap("offset")
    trimmed = None
    if outline is not None:
        tell("trim", None)
        trimmed = _trimmed(mesh, layers, support, vectors, outline, min(spec.edges))
    clock.lap("fabricate")
    return Panelization(
        surface,
        spec,
        outline,
        inside,
        umbilics,
        network,
        network_mesh,
        orientation,
        start,
        solution,
        mesh,
        vectors,
        layers,
        support,
        trimmed,
        clock.seconds,
    )


def _inside(
    surface: Surface, outline: PlanOutline | None, region: FaceRegion | None, reach: float = 0.0
) -> Inside | None:
    """Truth at parameters over the outline and on the faces, both wider by a plan distance."""
    if region is None:
        return None if outline is None else outline.on(surface, reach)
    if outline is None:
        return lambda uv: region.within(uv, reach)
    over = outline.on(surface, reach)

    def inside(uv: Floats) -> Mask:
        both = over(uv)
        rows = np.flatnonzero(both)
        both[rows] = region.within(uv[rows], reach)
        return both

    return inside


class _Clock:
    """Seconds of each stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now


def _check_edges(
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


def _check_sheets(surface: Surface, outline: PlanOutline, inside: Inside | None) -> None:
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


def _oriented(mesh: QuadMesh, *, flip: bool) -> tuple[QuadMesh, str]:
    """Mesh with its normals upwards on average (downwards with flip), and words for it."""
    up = float(mesh.face_area_vectors[:, 2].sum())
    # A closed or upright mesh has no upper side: it keeps the surface's own.
    clear = abs(up) > 1e-6 * float(norm(mesh.face_area_vectors).sum())
    reverse = (clear and up < 0) != flip
    side = "upwards" if not flip else "downwards"
    words = (
        f"normals {side}" if clear else "normals as the surface's" + (", turned" if flip else "")
    )
    return (mesh.reversed() if reverse else mesh), words


def _overhang(surface: Surface, spec: Spec, inside: Inside | None) -> float:
    """Plan distance by which the mesh reaches over the outline where the surface does.

    A panel, so that no corner of the outline is missed and the rim's freedom is cut away, and as
    much as the layers shift in plan.
    """
    uv = surface.domain.grid(40, 40).reshape(-1, 2)
    uv = uv if inside is None else uv[inside(uv)]
    jet = surface.jet(uv)
    normal = unit(cross(jet.du, jet.dv))
    aside = float(norm(normal[:, :2]).max(initial=0.0))
    shift = aside * max((abs(d) for d in spec.distances), default=0.0)
    return max(1.05 * max(spec.edges), 1.1 * shift)


def _trimmed(
    mesh: QuadMesh,
    layers: tuple[Layer, ...],
    support: SupportStructure | None,
    vectors: OffsetVectors,
    outline: PlanOutline,
    edge: float,
) -> TrimmedRoof:
    """Everything cut by the prism over the outline."""
    panels = trimmed_panels(mesh, outline, edge)
    return TrimmedRoof(
        panels,
        tuple(trimmed_panels(layer.mesh, outline, edge) for layer in layers),
        trimmed_webs(support, outline) if support is not None else None,
        tuple(edge_beams(panels, mesh, vectors.axes)),
    )


def _support(
    mesh: QuadMesh, vectors: OffsetVectors, distances: tuple[float, ...]
) -> SupportStructure | None:
    """Webs from the lowest to the highest layer, the mesh itself at 0; none without layers."""
    if not distances:
        return None
    lower, upper = (
        mesh.with_vertices(mesh.vertices + d * vectors.vectors)
        for d in (min(0.0, *distances), max(0.0, *distances))
    )
    return support_structure(mesh, vectors.axes, lower, upper)
