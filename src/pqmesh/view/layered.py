"""Picture of layers and support, cut open in terraces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats, Indices, Mask, dot
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.measures import panel_line
from pqmesh.view.scene import Scene, add_shadow, face_polygons, ground, polygon_normals, rgba
from pqmesh.view.sheet import INK, STAGE, Sheet, count, number, paper

BASE, GLASS, WEB = "#e7ddca", "#8fc3d6", "#9c6a3c"
BASE_LINE, GLASS_LINE, WEB_LINE = "#6b6255", "#2f6377", "#5d3c1e"
# Lens of the whole view: its magnification and its radius in pixels.
LENS, LENS_RADIUS = 3.4, 205.0
# The first terrace ends at this share of the faces, the next ones this much further each.
FIRST_STEP, STEP = 0.36, 0.11


def layers_figure(
    mesh: QuadMesh,
    layers: Sequence[QuadMesh],
    support: Floats | None = None,
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of all layers, cut open in terraces, with the support webs and a lens on the cut.

    From one side of the picture to the other stand the mesh alone, the webs upon it, then one
    layer more on each terrace.

    Parameters
    ----------
    mesh : QuadMesh
    layers : sequence of QuadMesh
        On the topology of the mesh.
    support : (E, 4, 3), optional
        One quad for each edge of the mesh, in its order.
    units : str
        Model unit.

    Raises
    ------
    MeshError
        When a layer or the support does not fit the mesh.
    PqmeshError
        When matplotlib is not installed.
    """
    webs = checked(mesh, layers, support)
    distances = layer_distances(mesh, layers)
    stack = stacked(mesh, layers, distances)
    if caption is None:
        shown = ", ".join(f"{number(d)} {units}".strip() for d in distances)
        caption = f"{count(mesh.topology.n_faces, 'panel')} a layer  ·  layers at {shown}"
        caption += f"  ·  {count(len(webs), 'support web')}" if webs is not None else ""
    camera = camera or Camera.around(mesh.vertices, mesh.face_normals)
    points = np.concatenate([layer.vertices for layer in (mesh, *layers)])
    polygons = face_polygons(mesh)
    with paper(title or "Layers and support", caption) as sheet:
        box = Box(STAGE.left, STAGE.bottom, 1190, STAGE.top)
        dropped = ground(polygons).reshape(-1, 3)
        view = View.fitted(camera, np.concatenate([points, dropped]), box)
        scene = Scene(view)
        add_shadow(scene, polygons)
        terrace = _terraces(view, mesh, len(stack) + (webs is not None))
        _add_terraces(scene, stack, webs, terrace)
        scene.paint(sheet)
        _lens(sheet, view, mesh, stack, webs, terrace)
        sheet.scale_bar(view, units)
        entries = [(BASE_LINE, "mesh"), (GLASS_LINE, "layers")]
        sheet.legend(entries + ([(WEB, "support webs")] if webs is not None else []), 1330)
        return sheet.png()


def layer_distances(mesh: QuadMesh, layers: Sequence[QuadMesh]) -> list[float]:
    """Mean signed distance of each layer's face planes from those of the mesh, model unit."""
    return [
        float(dot(mesh.face_normals, layer.face_centers - mesh.face_centers).mean())
        for layer in layers
    ]


# --- what is asked and shown ------------------------------------------------------------------


def checked(mesh: QuadMesh, layers: Sequence[QuadMesh], support: Floats | None) -> Floats | None:
    """The support, after a look at what does not fit."""
    if not layers:
        raise MeshError("A picture of layers needs at least one layer; found none. Give offsets.")
    for i, layer in enumerate(layers):
        if not np.array_equal(layer.topology.indices, mesh.topology.indices):
            raise MeshError(
                f"Every layer must have the faces of the mesh; layer {i + 1} has others. Give "
                f"offsets of this mesh."
            )
    if support is None:
        return None
    webs = np.asarray(support, dtype=np.float64)
    if webs.shape != (mesh.topology.n_edges, 4, 3):
        raise MeshError(
            f"The support must have shape ({mesh.topology.n_edges}, 4, 3), a quad for each edge "
            f"of the mesh; found {webs.shape}. Give the support before trimming."
        )
    return webs


def stacked(
    mesh: QuadMesh, layers: Sequence[QuadMesh], distances: Sequence[float]
) -> list[QuadMesh]:
    """Mesh and layers from the innermost to the outermost, those upon the mesh left out."""
    least = 1e-9 * mesh.mean_edge_length
    parts = [(0.0, -1, mesh)]
    parts += [(d, i, m) for i, (d, m) in enumerate(zip(distances, layers, strict=True))]
    return [m for d, i, m in sorted(parts, key=lambda p: p[:2]) if i < 0 or abs(d) > least]


# --- the whole --------------------------------------------------------------------------------


def _terraces(view: View, mesh: QuadMesh, levels: int) -> Indices:
    """Level 0..levels-1 of each face, rising across the picture, one level for each column."""
    column, across = _columns(view, mesh)
    counts = np.bincount(column)
    along = view.pixels(mesh.face_centers)[:, :2] @ across
    place = np.bincount(column, along) / np.maximum(counts, 1)
    order = np.argsort(place[column], kind="stable")
    share = np.empty(len(along))
    share[order] = (np.arange(len(along)) + 0.5) / len(along)
    middle = np.bincount(column, share) / np.maximum(counts, 1)
    bounds = FIRST_STEP + STEP * np.arange(levels - 1)
    return np.asarray(np.searchsorted(bounds, middle[column], side="right"))


def _columns(view: View, mesh: QuadMesh) -> tuple[Indices, Floats]:
    """Strip of each face in the family that spreads less across the picture, and its normal.

    Strips that cross belong to different families, as far as irregular vertices allow.
    """
    topology = mesh.topology
    strip = np.empty(topology.n_edges, dtype=np.int64)
    for index, edges in enumerate(topology.strips):
        strip[edges] = index
    sides = topology.face_edges.reshape(-1, 4)
    pairs = strip[sides[:, :2]]
    family = _two_families(len(topology.strips), pairs)
    seen = view.pixels(mesh.vertices[mesh.edges].mean(axis=1))[:, :2]
    steps = np.stack([seen[sides[:, i + 2]] - seen[sides[:, i]] for i in (0, 1)], axis=1)
    chosen, best = 0, np.inf
    for color in (0, 1):
        spread = float(np.abs(steps[family[pairs] == color][:, 0]).sum())
        if spread < best:
            chosen, best = color, spread
    side = np.where(family[pairs[:, 0]] == chosen, 0, 1)
    rows = np.arange(len(pairs))
    run = steps[rows, side]
    heading = run * np.where(run[:, 1:] < 0, -1.0, 1.0)
    along = heading.sum(axis=0)
    across = np.array([along[1], -along[0]])
    across /= max(float(np.hypot(*across)), 1e-300)
    return pairs[rows, side], across


def _two_families(count: int, pairs: Indices) -> Indices:
    """0 or 1 for each strip, so that crossing strips differ where that is possible."""
    crossing: list[set[int]] = [set() for _ in range(count)]
    for a, b in np.unique(pairs, axis=0).tolist():
        crossing[a].add(b)
        crossing[b].add(a)
    family = np.full(count, -1, dtype=np.int64)
    for start in range(count):
        if family[start] >= 0:
            continue
        family[start], waiting = 0, [start]
        while waiting:
            strip = waiting.pop()
            fresh = [other for other in sorted(crossing[strip]) if family[other] < 0]
            family[fresh] = 1 - family[strip]
            waiting.extend(fresh)
    return family


def _add_terraces(
    scene: Scene, stack: Sequence[QuadMesh], webs: Floats | None, terrace: Indices
) -> None:
    """Faces and webs as far as their terrace shows them."""
    mesh, camera = stack[0], scene.view.camera
    width = panel_line(scene.view, mesh)
    first = 1 if webs is None else 2
    for level, layer in enumerate(stack):
        shown = (
            np.ones(len(terrace), dtype=np.bool_) if level == 0 else terrace >= first + level - 1
        )
        light = camera.light(layer.face_normals)[shown]
        color, line, alpha = (BASE, BASE_LINE, 1.0) if level == 0 else (GLASS, GLASS_LINE, 0.5)
        fill = lit(color, light, alpha)
        scene.add(layer.corners[shown], fill, rgba(line, 0.9), width)
    if webs is not None:
        up = _web_mask(mesh, terrace >= 1)
        light = camera.light(polygon_normals(webs))[up]
        scene.add(webs[up], lit(WEB, light, 1.0), rgba(WEB_LINE, 0.8), 0.8 * width)


def _web_mask(mesh: QuadMesh, shown: Mask) -> Mask:
    """Edges with a shown face."""
    faces = mesh.topology.edge_faces
    return np.asarray((shown[faces] & (faces >= 0)).any(axis=1))


def lit(color: str, light: Floats, alpha: float) -> Floats:
    """One colour under a light (n,), shape (n, 4)."""
    rgb = np.clip(rgba(color)[:3] * light[:, None], 0.0, 1.0)
    return np.column_stack([rgb, np.full(len(light), alpha)])


def _lens(
    sheet: Sheet,
    view: View,
    mesh: QuadMesh,
    stack: Sequence[QuadMesh],
    webs: Floats | None,
    terrace: Indices,
) -> None:
    """Magnified round detail of the place where most terraces meet."""
    face = _busiest(view, mesh, terrace)
    spot = mesh.face_centers[face]
    factor = max(LENS, 70.0 / max(mesh.mean_edge_length * view.scale, 1e-9))
    radius, place = LENS_RADIUS, (1600.0 - 30.0 - LENS_RADIUS, 395.0)
    near = view.magnified(spot, factor, place)
    at = view.pixels(spot)[:2]
    small = radius / factor
    away = np.array(place) - at
    distance = float(np.hypot(*away))
    away = away / distance
    sheet.circle(at, small, facecolor="none", edgecolor=INK, linewidth=1.6)
    sheet.line(np.array([at + small * away, at + (distance - radius) * away]), INK, 1.2)
    back = sheet.circle(np.array(place), radius, facecolor="white", edgecolor="none")
    close = np.hypot(*(near.pixels(mesh.face_centers)[:, :2] - np.array(place)).T) < 1.6 * radius
    scene = Scene(near)
    _add_terraces(scene, _part(stack, close), _web_part(mesh, webs, close), terrace[close])
    scene.paint(sheet, back)
    sheet.circle(np.array(place), radius, facecolor="none", edgecolor=INK, linewidth=2.2)


def _busiest(view: View, mesh: QuadMesh, terrace: Indices) -> int:
    """Face on the middle terrace that faces the viewer, nearest to the middle of the sight."""
    seen = view.pixels(mesh.face_centers)[:, :2]
    facing = mesh.face_normals @ view.camera.axes[2]
    wanted = (int(terrace.max()) + 1) // 2
    levels = np.unique(terrace)
    on_it = terrace == levels[np.argmin(np.abs(levels - wanted))]
    place = 0.5 * (seen[on_it].min(axis=0) + seen[on_it].max(axis=0))
    away = np.hypot(*(seen - place).T)
    # A face that is seen well, if there is one.
    cost = away + 2000.0 * (facing < 0.35) + 1e6 * ~on_it
    return int(np.argmin(cost))


def _part(stack: Sequence[QuadMesh], chosen: Mask) -> list[QuadMesh]:
    """The chosen faces of each layer as meshes of their own."""
    faces = stack[0].faces[chosen]
    used, flat = np.unique(faces, return_inverse=True)
    first = QuadMesh.of(stack[0].vertices[used], flat.reshape(-1, 4))
    return [first, *(first.with_vertices(layer.vertices[used]) for layer in stack[1:])]


def _web_part(mesh: QuadMesh, webs: Floats | None, chosen: Mask) -> Floats | None:
    """Webs of the edges of the chosen faces, in the order of the part's edges."""
    if webs is None:
        return None
    edges = np.unique(mesh.topology.face_edges.reshape(-1, 4)[chosen])
    return np.asarray(webs[edges])
