"""Pictures of a measure on a mesh: one mesh, or before and after."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import Floats, Indices
from pqmesh.view.camera import Box, Camera, View
from pqmesh.view.scene import Scene, add_shadow, face_polygons, ground, rgba
from pqmesh.view.sheet import GREY, INK, STAGE, ColorScale, Sheet, count, number, paper

LINE = rgba("#2b2f36")


def measure_figure(
    mesh: PolyMesh,
    values: ArrayLike,
    *,
    label: str,
    unit: str,
    units: str,
    log: bool = False,
    at: str | None = None,
    title: str = "",
    caption: str | None = None,
    camera: Camera | None = None,
) -> bytes:
    """PNG of a mesh coloured by a measure of its faces or of its vertices.

    A vertex value fills the quarters of the faces around the vertex. NaN, a value that does
    not exist, is grey. The largest value is marked.

    Parameters
    ----------
    values : (F,) or (V,)
        In the unit written at the colour bar.
    label, unit : str
        Name and unit of the measure; an empty unit for a dimensionless one.
    units : str
        Model unit, for the scale bar.
    log : bool
        Logarithmic colours over at most six decades.
    at : 'face' or 'vertex', optional
        Needed only where F = V.
    caption : str, optional
        Default: number of faces, largest and mean value.

    Raises
    ------
    MeshError
        When the values fit neither the faces nor the vertices.
    PqmeshError
        When matplotlib is not installed.
    """
    checked, place = _placed(mesh, values, at)
    scale = ColorScale.of(checked, log=log)
    words = _summary(mesh, checked, unit) if caption is None else caption
    with paper(title or label.capitalize(), words) as sheet:
        scene = _paint(sheet, mesh, checked, place, scale, STAGE, camera)
        view = scene.view
        _mark_largest(sheet, scene, mesh, checked, place, unit)
        sheet.scale_bar(view, units)
        sheet.color_bar(scale, label, unit)
        return sheet.png()


def comparison_figure(
    before: PolyMesh,
    after: PolyMesh,
    values_before: ArrayLike,
    values_after: ArrayLike,
    *,
    label: str,
    unit: str,
    units: str,
    log: bool = False,
    at: str | None = None,
    title: str = "",
    caption: str | None = None,
    names: tuple[str, str] = ("before", "after"),
    camera: Camera | None = None,
) -> bytes:
    """PNG of two meshes side by side under one colour scale and in one view.

    Parameters are those of `measure_figure`, twice.

    Raises
    ------
    MeshError
        When values do not fit their mesh.
    PqmeshError
        When matplotlib is not installed.
    """
    pair = [_placed(before, values_before, at), _placed(after, values_after, at)]
    scale = ColorScale.of(np.concatenate([values for values, _ in pair]), log=log)
    camera = camera or Camera.around(before.vertices, before.face_normals)
    reached = [_largest_words(values, unit) for values, _ in pair]
    words = f"{count(after.topology.n_faces, 'panel')}  ·  {label}: "
    words += f"{reached[0]} {names[0]}, {reached[1]} {names[1]}"
    with paper(title or label.capitalize(), words if caption is None else caption) as sheet:
        boxes = (Box(50, 185, 780, 865), Box(820, 185, 1550, 865))
        both = np.concatenate([before.vertices, after.vertices])
        for mesh, (values, place), box, name, most in zip(
            (before, after), pair, boxes, names, reached, strict=True
        ):
            view = _paint(sheet, mesh, values, place, scale, box, camera, frame=both).view
            sheet.text(box.middle[0], 150, name, "caption", ha="center", weight="bold")
            sheet.text(box.middle[0], 122, most, ha="center", color=GREY)
        sheet.scale_bar(view, units)
        sheet.color_bar(scale, label, unit)
        return sheet.png()


def _placed(mesh: PolyMesh, values: ArrayLike, at: str | None) -> tuple[Floats, str]:
    """Checked values and whether they belong to faces or to vertices."""
    array = np.asarray(values, dtype=np.float64)
    counts = {"face": mesh.topology.n_faces, "vertex": mesh.topology.n_vertices}
    if at is not None and at not in counts:
        raise MeshError(f"Values are given at 'face' or 'vertex'; found {at!r}. Choose one.")
    fitting = [place for place in counts if array.shape == (counts[place],)]
    fitting = [place for place in fitting if at in (None, place)]
    if not fitting:
        wanted = " or ".join(f"({n},) for each {p}" for p, n in counts.items() if at in (None, p))
        raise MeshError(
            f"Values must have shape {wanted}; found {array.shape}. Give one value for each."
        )
    if len(fitting) > 1:
        raise MeshError(
            f"This mesh has as many faces as vertices ({len(array)}), so the values fit both. "
            f"Say at='face' or at='vertex'."
        )
    return array, fitting[0]


def _summary(mesh: PolyMesh, values: Floats, unit: str) -> str:
    """Caption with the numbers of the picture."""
    known = values[np.isfinite(values)]
    if not len(known):
        return count(mesh.topology.n_faces, "panel")
    mean = f"{number(float(known.mean()))} {unit}".strip()
    panels = count(mesh.topology.n_faces, "panel")
    return f"{panels}  ·  {_largest_words(values, unit)}  ·  mean {mean}"


def _largest_words(values: Floats, unit: str) -> str:
    known = values[np.isfinite(values)]
    return f"max {number(float(known.max()))} {unit}".strip() if len(known) else "no value"


def _paint(
    sheet: Sheet,
    mesh: PolyMesh,
    values: Floats,
    place: str,
    scale: ColorScale,
    box: Box,
    camera: Camera | None,
    frame: Floats | None = None,
) -> Scene:
    """Draw the coloured mesh into a box."""
    camera = camera or Camera.around(mesh.vertices, mesh.face_normals)
    polygons = face_polygons(mesh)
    framed = polygons.reshape(-1, 3) if frame is None else frame
    view = View.fitted(camera, np.concatenate([framed, ground(framed)]), box)
    scene = Scene(view)
    add_shadow(scene, polygons)
    width = panel_line(view, mesh)
    light = camera.light(mesh.face_normals, depth=0.28)
    edge = LINE * np.array([1.0, 1.0, 1.0, 0.75])
    if place == "face":
        scene.add(polygons, _lit(scale.colors(values), light), edge, width)
    else:
        cells, owner, face = vertex_cells(mesh)
        fill = _lit(scale.colors(values[owner]), light[face])
        scene.add(cells, fill, fill, 0.6)
        pieces = np.stack([cells[:, 3], cells[:, 0], cells[:, 1]], axis=1)
        lift = 0.26 * mesh.mean_edge_length
        scene.add_lines(pieces, edge, width, lift)
    scene.paint(sheet)
    return scene


def vertex_cells(mesh: PolyMesh) -> tuple[Floats, Indices, Indices]:
    """Part of a face next to each corner: (C, 4, 3), its vertex (C,) and its face (C,).

    Corner 0 is the vertex, 1 and 3 are the middles of its two edges, 2 is the face's centre.
    """
    topology = mesh.topology
    here = mesh.vertices[topology.indices]
    following = 0.5 * (here + here[topology.corner_next])
    before = np.empty_like(following)
    before[topology.corner_next] = following
    centre = mesh.face_centers[topology.corner_faces]
    return np.stack([here, following, centre, before], 1), topology.indices, topology.corner_faces


def panel_line(view: View, mesh: PolyMesh) -> float:
    """Width of panel edges in pixels: thin, and thinner where panels are small."""
    return float(np.clip(0.035 * mesh.mean_edge_length * view.scale, 0.35, 2.2))


def _lit(rgb: Floats, light: Floats) -> Floats:
    """Opaque colours (n, 4) under a light (n,)."""
    return np.column_stack([np.clip(rgb * light[:, None], 0.0, 1.0), np.ones(len(rgb))])


def _mark_largest(
    sheet: Sheet, scene: Scene, mesh: PolyMesh, values: Floats, place: str, unit: str
) -> None:
    """Ring around the largest value, with a leader to it; grey where it is out of sight."""
    known = values[np.isfinite(values)]
    if not len(known) or known.max() <= known.min():
        return
    view = scene.view
    worst = int(np.nanargmax(values))
    points = mesh.face_centers if place == "face" else mesh.vertices
    behind = bool(scene.hides(points[worst : worst + 1], 1.5 * mesh.mean_edge_length)[0])
    color = GREY if behind else INK
    words = _largest_words(values, unit) + (", behind" if behind else "")
    middle = view.pixels(points[worst])[:2]
    radius = float(np.clip(0.75 * mesh.mean_edge_length * view.scale, 9.0, 60.0))
    sheet.circle(middle, radius, facecolor="none", edgecolor="white", linewidth=4.5)
    dashes = {"linestyle": (0, (2, 2))} if behind else {}
    sheet.circle(middle, radius, facecolor="none", edgecolor=color, linewidth=1.8, **dashes)
    # Away from the middle of the sheet, where the object is.
    side = 1.0 if middle[0] > 0.5 * (STAGE.left + STAGE.right) else -1.0
    start = middle + 0.71 * radius * np.array([side, 1.0])
    bend = start + np.array([side * 26.0, 26.0])
    sheet.line(np.array([start, bend, bend + np.array([side * 18.0, 0.0])]), color, 1.4)
    where = "left" if side > 0 else "right"
    sheet.text(bend[0] + side * 24.0, bend[1] - 6.0, words, halo=True, ha=where, color=color)
