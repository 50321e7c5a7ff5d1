"""The surface of a design as faces: formulas, shapes, nets, and the files of other programs."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from pqmesh.design_keys import NetSpec, SurfaceSpec
from pqmesh.design_text import Where, parse_reason, text_of
from pqmesh.design_words import first_message, shown
from pqmesh.errors import FormatError, SpecError
from pqmesh.io.atomic import shown_path
from pqmesh.io.compas import read_compas_surface
from pqmesh.io.rhino import read_rhino_surfaces
from pqmesh.surface.base import Domain, Surface
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.face import Patch
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.surface.regular import closes
from pqmesh.vectors import Floats, far_origin

# Larger ones are no control nets, and would take minutes and gigabytes to parse.
LARGEST_NET = 8_000_000


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of a surface, about an origin near them.

    Attributes
    ----------
    patches : tuple of Patch
        Loops only where a face is trimmed.
    origin : (3,)
        Whole numbers that were taken off all coordinates; zero for near surfaces.
    units : str or None
        What the file says; None where nothing does.
    """

    patches: tuple[Patch, ...]
    origin: Floats
    units: str | None = None


def faces_of(spec: SurfaceSpec, folder: Path) -> Faces:
    """Faces of a surface's description; files are sought from the folder.

    Raises
    ------
    PqmeshError
        When the description or the file gives no surface.
    """
    if spec.formula is not None:
        f = spec.formula
        found: Surface = FormulaSurface(f.x, f.y, f.z, Domain(f.u, f.v), f.constants)
        periodic = closes(found)
        if any(periodic):
            found = FormulaSurface(f.x, f.y, f.z, Domain(f.u, f.v, periodic), f.constants)
        return _single(found)
    if spec.graph is not None:
        g = spec.graph
        return _single(graph_surface(g.z, g.x, g.y, g.constants))
    if spec.shape is not None:
        from pqmesh.surface.analytic import shape_surface

        parameters = {key: value for key, value in spec.shape.items() if key != "kind"}
        kind = spec.shape.get("kind", "")
        return _single(shape_surface(kind if isinstance(kind, str) else shown(kind), **parameters))
    if spec.net is not None and spec.net.file is None:
        return _of_net(spec.net)
    path = folder / str(spec.file if spec.net is None else spec.net.file)
    reader = SURFACE_FILES.get(path.suffix.lower())
    if reader is None or (spec.net is not None and path.suffix.lower() != ".json"):
        known = ", ".join(SURFACE_FILES) if spec.net is None else ".json"
        raise FormatError(
            f"{shown_path(path.name)}: the suffix of a surface file must be one of {known}; found "
            f"{path.suffix or 'none'!r}. Export the surface as one of these, or give a formula."
        )
    return reader(path, spec.select)


def _single(surface: Surface) -> Faces:
    return Faces((Patch(surface),), np.zeros(3))


def _of_rhino(path: Path, select: str | None) -> Faces:
    """Faces of a Rhino model."""
    found = read_rhino_surfaces(path, select)
    patches = []
    for face in found.patches:
        corners = {tuple(corner) for corner in _corners(face.surface.domain).tolist()}
        whole = len(face.loops) == 1 and {tuple(p) for p in face.loops[0].tolist()} == corners
        name = f"{face.name or face.layer or 'surface'} (face {face.face})"
        patches.append(Patch(face.surface, () if whole else face.loops, name))
    return Faces(tuple(patches), found.origin, found.units)


def _corners(domain: Domain) -> Floats:
    """Corners of a domain, (4, 2)."""
    (a, b), (c, d) = domain.u, domain.v
    return np.array([[a, c], [b, c], [b, d], [a, d]])


def _of_json(path: Path, select: str | None) -> Faces:
    """A control net of our own keys, or a COMPAS surface."""
    name = shown_path(path.name)
    if select is not None:
        raise SpecError(
            f"{name}: a JSON file holds one surface and nothing to select; found select = "
            f"{shown(select)}. Leave it out."
        )
    try:
        table = json.loads(text_of(path, LARGEST_NET))
    except (ValueError, RecursionError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(
            f"{name} must be JSON; it is not: {parse_reason(error)}. Mend it."
        ) from None
    if not _is_net(table):
        surface = read_compas_surface(path)
        return _about_origin(
            *(surface.points, surface.degrees, surface.knots, surface.weights, surface.periodic)
        )
    if not isinstance(table, dict):
        raise FormatError(
            f"{name} must hold a JSON object with degree and points; it holds a "
            f"{type(table).__name__}. Mend it."
        )
    if "file" in table:
        raise FormatError(
            f"{name} must hold the control points themselves; it names another file. Name that "
            f"one in the design."
        )
    try:
        return _of_net(NetSpec.model_validate(table))
    except ValidationError as error:
        raise SpecError(first_message(error, Where(name), NetSpec)) from None


def _is_net(table: Any) -> bool:
    """Whether JSON is meant as a net of our own keys: COMPAS wraps surfaces and lists them."""
    if isinstance(table, list):
        return not any(isinstance(part, dict) for part in table)
    return not (isinstance(table, dict) and {"dtype", "data", "knots_u", "items"} & set(table))


def _of_net(net: NetSpec) -> Faces:
    """The surface of a control net, moved near the origin."""
    points = _rectangular(net.points or [], "points")
    knots = None if net.knots is None else (np.array(net.knots[0]), np.array(net.knots[1]))
    weights = None if net.weights is None else _rectangular(net.weights, "weights")
    return _about_origin(points, net.degree, knots, weights, net.periodic)


def _about_origin(
    points: Floats,
    degrees: tuple[int, int],
    knots: tuple[Floats, Floats] | None,
    weights: Floats | None,
    periodic: tuple[bool, bool] = (False, False),
) -> Faces:
    """One B-spline face, its far-away origin taken off."""
    origin = np.zeros(3)
    if points.ndim == 3 and points.shape[2] == 3:
        origin = far_origin(points.reshape(-1, 3))
        points = points - origin
    surface = BSplineSurface(points, degrees, knots, weights, periodic)
    return Faces((Patch(surface),), origin)


def _rectangular(rows: list[Any], name: str) -> Floats:
    """Nested lists as an array, refused when ragged."""
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError:
        raise SpecError(
            f"The {name} of a net must form a rectangle; rows differ in length. Complete them."
        ) from None


# The only list of surface files: suffix -> (path, selection) -> Faces.
SURFACE_FILES: dict[str, Callable[[Path, str | None], Faces]] = {
    ".3dm": _of_rhino,
    ".json": _of_json,
}
