"""Picture of one node: its faces in each layer, webs, axis and distances."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import fitted_cones
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import Floats, Indices, dot, norm, unit
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.layered import (
    BASE,
    BASE_LINE,
    GLASS,
    GLASS_LINE,
    WEB,
    WEB_LINE,
    checked,
    layer_distances,
    lit,
    stacked,
)
from pqmesh.view.scene import Scene, polygon_normals, rgba
from pqmesh.view.sheet import GREY, INK, Sheet, number, paper

AXIS = "#c2452d"
# A typical node is at least this share of the greatest distance away from the boundary.
CENTRAL = 0.6


def node_figure(
    mesh: QuadMesh,
    layers: Sequence[QuadMesh],
    support: Floats | None,
    vertex: int,
    *,
    units: str,
    title: str = "",
    caption: str | None = None,
) -> bytes:
    """PNG of one node: its faces in each layer, webs along its edges, axis and distances.

    Parameters are those of `layers_figure`, and the vertex. The distances drawn are those
    between face planes.

    Raises
    ------
    MeshError
        When a layer or the support does not fit the mesh, or the vertex is not interior.
    PqmeshError
        When matplotlib is not installed.
    """
    webs = checked(mesh, layers, support)
    topology = mesh.topology
    if not 0 <= vertex < topology.n_vertices or topology.is_boundary_vertex[vertex]:
        raise MeshError(
            f"A node picture needs an interior vertex below {topology.n_vertices}; found vertex "
            f"{vertex}. Choose another, or the one that typical_node names."
        )
    distances = layer_distances(mesh, layers)
    stack = stacked(mesh, layers, distances)
    neighbors, faces = topology.star(vertex)
    edges = _edges_to(mesh, vertex, neighbors)
    up = _node_up(mesh, stack, vertex)
    if caption is None:
        shown = ", ".join(f"{number(d)} {units}".strip() for d in distances)
        edge = mesh.edge_lengths[edges].mean()
        caption = f"vertex {vertex}, {len(neighbors)} beams, mean edge {number(edge)} {units}"
        caption += f"  ·  layers at {shown}"
    size = float(mesh.edge_lengths[edges].max())
    target = np.mean([layer.vertices[vertex] for layer in stack], axis=0)
    opening = unit(mesh.face_centers[faces] - mesh.vertices[vertex])
    front = opening[int(np.argmax(opening @ np.array([0.35, -0.94, 0.0])))]
    camera = Camera.at_node(target, up, front, 6.0 * size)
    corners = np.concatenate([layer.corners[faces].reshape(-1, 3) for layer in stack])
    axis = _axis(stack, vertex, up, 0.35 * size)
    with paper(title or f"Node {vertex}", caption) as sheet:
        view = View.fitted(camera, np.concatenate([corners, axis]), Box(130, 130, 1400, 860))
        scene = Scene(view)
        _add_node(scene, stack, None if webs is None else webs[edges], faces, edges, up)
        scene.paint(sheet)
        _draw_axis(sheet, view, stack, vertex, axis)
        _draw_distances(sheet, view, stack, faces, units)
        entries = [(BASE_LINE, "mesh"), (GLASS_LINE, "layers")]
        entries += [(WEB, "support webs")] if webs is not None else []
        sheet.legend([*entries, (AXIS, "node axis")], 1330)
        return sheet.png()


def typical_node(mesh: QuadMesh) -> int:
    """The interior vertex of clearest curvature near the middle of the mesh, of usual valence.

    Raises
    ------
    MeshError
        When the mesh has no interior vertex.

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_mesh
    >>> x, y = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    >>> typical_node(grid_mesh(np.stack([x, y, -((x - 2) ** 2) - (y - 2) ** 2], -1)))
    12
    """
    cones = fitted_cones(mesh)
    if not len(cones.vertices):
        raise MeshError(
            "A node needs an interior vertex; this mesh has none. Give a mesh of at least two by "
            "two panels."
        )
    valence = mesh.topology.valence[cones.vertices]
    usual = valence == np.bincount(valence).argmax()
    ring = _rings(mesh)[cones.vertices]
    near = usual & (ring >= CENTRAL * ring[usual].max())
    return int(cones.vertices[np.argmax(np.where(near, np.round(cones.theta, 9), -1.0))])


def _rings(mesh: QuadMesh) -> Indices:
    """Number of edges from each vertex to the boundary; 1 everywhere on a closed piece."""
    rings = np.where(mesh.topology.is_boundary_vertex, 0, -1)
    ends = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
    for ring in range(1, len(rings)):
        fresh = ends[(rings[ends[:, 0]] == ring - 1) & (rings[ends[:, 1]] < 0), 1]
        if not len(fresh):
            break
        rings[fresh] = ring
    return np.where(rings < 0, 1, rings)


def _edges_to(mesh: QuadMesh, vertex: int, neighbors: Indices) -> Indices:
    """Numbers of the edges from a vertex to its neighbours."""
    ends = np.sort(np.column_stack([np.full(len(neighbors), vertex), neighbors]), axis=1)
    n = mesh.topology.n_vertices
    return np.asarray(np.searchsorted(mesh.edges @ np.array([n, 1]), ends @ np.array([n, 1])))


def _node_up(mesh: QuadMesh, stack: Sequence[QuadMesh], vertex: int) -> Floats:
    """Unit axis of the node, on the side of the normals."""
    axis = stack[-1].vertices[vertex] - stack[0].vertices[vertex]
    normal = mesh.vertex_normals[vertex]
    axis = unit(axis) if float(norm(axis)) > 1e-9 * mesh.mean_edge_length else normal
    return np.asarray(axis if float(axis @ normal) >= 0 else -axis)


def _axis(stack: Sequence[QuadMesh], vertex: int, up: Floats, beyond: float) -> Floats:
    """Ends of the drawn node axis, (2, 3)."""
    return np.stack([stack[0].vertices[vertex], stack[-1].vertices[vertex] + beyond * up])


def _add_node(
    scene: Scene,
    stack: Sequence[QuadMesh],
    webs: Floats | None,
    faces: Indices,
    edges: Indices,
    up: Floats,
) -> None:
    """Faces and webs, ordered as sectors around the axis, and in each from below upwards."""
    towards = scene.view.camera.axes[2]
    level_way = towards - float(dot(towards, up)) * up
    base = stack[0]
    sector = base.face_centers[faces] @ level_way
    step = 1e-3 * base.mean_edge_length
    for level, layer in enumerate(stack):
        light = scene.view.camera.light(layer.face_normals[faces])
        color, line, alpha = (BASE, BASE_LINE, 1.0) if level == 0 else (GLASS, GLASS_LINE, 0.42)
        fill = lit(color, light, alpha)
        scene.add(layer.corners[faces], fill, rgba(line), 2.6, nearness=sector + level * step)
    if webs is not None:
        middle = base.vertices[base.edges[edges]].mean(axis=1) @ level_way
        light = scene.view.camera.light(polygon_normals(webs))
        scene.add(webs, lit(WEB, light, 0.88), rgba(WEB_LINE), 2.6, nearness=middle)


def _draw_axis(
    sheet: Sheet, view: View, stack: Sequence[QuadMesh], vertex: int, axis: Floats
) -> None:
    """Dash-dotted axis with a dot at each layer's vertex."""
    ends = view.pixels(axis)[:, :2]
    sheet.line(ends, "white", 6.0)
    sheet.line(ends, AXIS, 3.0, linestyle=(0, (6, 1.6, 1.2, 1.6)), dash_capstyle="round")
    for layer in stack:
        at = view.pixels(layer.vertices[vertex])[:2]
        sheet.circle(at, 8.0, facecolor="white", edgecolor=AXIS, linewidth=3.0)


def _draw_distances(
    sheet: Sheet,
    view: View,
    stack: Sequence[QuadMesh],
    faces: Indices,
    units: str,
) -> None:
    """Dimension line from layer to layer at the rightmost rim of the faces.

    It stands on a corner and runs along the face normal, so that its length is the distance
    of the face planes.
    """
    base = stack[0]
    corners = base.corners[faces]
    corner = int(np.argmax(view.pixels(corners)[..., 0]))
    face, foot = int(faces[corner // 4]), corners.reshape(-1, 3)[corner]
    normal = base.face_normals[face]
    heights = [float((m.face_centers[face] - base.face_centers[face]) @ normal) for m in stack]
    points = view.pixels(foot + np.array(heights)[:, None] * normal)[:, :2]
    aside = points + np.array([70.0, -14.0])
    for on, off in zip(points, aside, strict=True):
        sheet.line(np.array([on + 0.12 * (off - on), off + 0.12 * (off - on)]), GREY, 1.2)
    sheet.line(aside, INK, 1.6)
    for tick in aside:
        sheet.line(tick + np.array([[-6.0, -6.0], [6.0, 6.0]]), INK, 2.4)
    for low, high, a, b in zip(aside[:-1], aside[1:], heights[:-1], heights[1:], strict=True):
        x, y = (0.5 * (low + high)).tolist()
        sheet.text(x + 20, y - 7, f"{number(b - a)} {units}".strip(), "caption", halo=True)
