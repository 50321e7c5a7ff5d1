"""The main job: a surface becomes a panelled roof with its layers and its support structure."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from pqmesh.errors import MeshError, NetworkError
from pqmesh.fabricate.edgebeams import EdgeBeam, edge_beams
from pqmesh.fabricate.trim import TrimmedPanels, TrimmedWebs, trimmed_panels, trimmed_webs
from pqmesh.fabricate.walls import outline_walls
from pqmesh.job_spec import EDGE_OFFSET, check_edges, check_sheets
from pqmesh.job_spec import Spec as Spec
from pqmesh.koebe.best import edge_offset_solution
from pqmesh.koebe.square_patch import square_edges
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.kinds import trace_network
from pqmesh.network.meshing import NetworkMesh, quads_from_network
from pqmesh.network.principal import CurveNetwork, Inside
from pqmesh.network.region import PlanOutline, region_samples
from pqmesh.offset.offsets import Layer, offset_layer, offset_vectors
from pqmesh.offset.support import SupportStructure, support_structure
from pqmesh.offset.vectors import OffsetVectors
from pqmesh.optimize.recipes import SURFACE
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import Solution, Step
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.surface.faces import FaceRegion
from pqmesh.surface.reference import SurfaceReference
from pqmesh.surface.umbilics import UmbilicReport, find_umbilics
from pqmesh.vectors import Floats, Mask, cross, norm, unit

# Told the stage that begins and, while optimising, the last step.
Progress = Callable[[str, Step | None], None]


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
    notes : tuple of str
        What could not be done, and why.
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
    layers: tuple[Layer[QuadMesh], ...]
    support: SupportStructure | None
    trimmed: TrimmedRoof | None
    seconds: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

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
    check_edges(surface, spec, inside, outline)
    wide = inside
    if outline is not None:
        # A crooked outline is refused now, not after the work.
        outline_walls(outline)
        check_sheets(surface, outline, inside)
        wide = _inside(surface, outline, region, _overhang(surface, spec, inside))
    tell("network", None)
    umbilics = find_umbilics(surface, wide)
    edges = _edges(surface, spec, wide, outline)
    network = trace_network(spec.network, surface, edges, wide, spec.given)
    network_mesh = quads_from_network(network, wide)
    start, orientation = _oriented(network_mesh.mesh, flip=spec.flip)
    clock.lap("network")
    tell("optimize", None)
    solution, vectors = _solved(
        surface, spec, start, network_mesh.uv, lambda step: tell("optimize", step)
    )
    mesh = start.with_vertices(solution.blocks["vertices"])
    clock.lap("optimize")
    tell("offset", None)
    layers = tuple(offset_layer(mesh, vectors, distance) for distance in spec.distances)
    support = _support(mesh, vectors, spec.distances)
    clock.lap("offset")
    trimmed: TrimmedRoof | None = None
    notes: tuple[str, ...] = ()
    if outline is not None:
        tell("trim", None)
        try:
            trimmed = _trimmed(mesh, layers, support, vectors, outline, min(spec.edges))
        except MeshError as error:
            # A mesh that did not come right is an answer too; its faces cannot be cut.
            notes = (f"the panels are not cut by the outline: {error}",)
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
        notes,
    )


def _edges(
    surface: Surface, spec: Spec, inside: Inside | None, outline: PlanOutline | None
) -> tuple[float, float]:
    """Wanted edges: one length for a mesh with edge offsets is shared between the families.

    Its Gauss image has faces near to squares. Where a curvature changes its sign there is none,
    and the edges stay as they are.
    """
    first, second = spec.edges
    if spec.kind != EDGE_OFFSET or spec.network != "principal" or first != second:
        return spec.edges
    with suppress(NetworkError):
        return square_edges(surface, region_samples(surface, inside, outline, 40)[0], first)
    return spec.edges


def _solved(
    surface: Surface, spec: Spec, start: QuadMesh, uv: Floats, told: Callable[[Step], None]
) -> tuple[Solution, OffsetVectors]:
    """The optimised vertices, and the offset vectors of the mesh."""
    reference = SurfaceReference(surface, uv)
    if spec.kind == EDGE_OFFSET:
        normals = shape_data(surface.jet(uv)).normal
        # A start that was turned over has its normals on the other side.
        side = np.sign(float(np.einsum("vi,vi->", normals, start.vertex_normals)))
        return edge_offset_solution(start, reference, side * normals, told)
    solution = optimized(
        spec.kind,
        start,
        reference,
        boundary=spec.boundary,
        weights=SURFACE,
        within=spec.within,
        warp=spec.flat,
        constraints=spec.constraints,
        progress=told,
    )
    mesh = start.with_vertices(solution.blocks["vertices"])
    return solution, offset_vectors(mesh, spec.kind)


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
    layers: tuple[Layer[QuadMesh], ...],
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
