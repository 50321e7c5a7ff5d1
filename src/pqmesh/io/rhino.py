"""Surfaces of Rhino's .3dm files: NURBS, Breps with trimmed faces, extrusions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pqmesh.errors import FormatError, PqmeshError, SurfaceError
from pqmesh.io.atomic import PathLike
from pqmesh.io.choice import Item, choose
from pqmesh.io.foreign import DAMAGE, named
from pqmesh.io.nurbs import surface_from_nurbs
from pqmesh.io.rhino_file import RhinoFile, full_knots, open_rhino
from pqmesh.io.rhino_trims import loops_of_face, rectangle
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.vectors import Floats, far_origin, read_only


@dataclass(frozen=True, eq=False)
class Patch:
    """One face of a file.

    Parameters
    ----------
    surface : BSplineSurface
        The whole surface that the face is cut from, moved by minus the file's origin.
    loops : tuple of (n, 2)
        Outline of the face in (u, v), the outer loop first and counterclockwise, then holes
        clockwise; closed without repetition. A face that is not trimmed has the rectangle.
        Within 1e-4 of the surface's extent of the edges in the file.
    name : str
        Of the object; empty when it has none.
    layer : str
        Full path, levels separated by "::".
    face : int
        Number of the face in its object, from 0.
    """

    surface: BSplineSurface
    loops: tuple[Floats, ...]
    name: str
    layer: str
    face: int


@dataclass(frozen=True, eq=False)
class SurfaceFile:
    """The surfaces read from a file.

    Parameters
    ----------
    units : str
        "mm", "m", "cm", "km", "ft" or "in": unit of the patches and of the origin.
    patches : tuple of Patch
        In the order of the file.
    origin : (3,)
        Whole numbers; add them to what is built on the patches. Zero unless the geometry lies
        farther from the origin than ten of its extents.
    """

    units: str
    patches: tuple[Patch, ...]
    origin: Floats


def read_rhino_surfaces(path: PathLike, select: str | None = None) -> SurfaceFile:
    """Surfaces of a .3dm file: NURBS surfaces, faces of Breps, extrusions.

    Hidden and locked objects are read like all others. Meshes, curves, points and block
    instances beside the surfaces are ignored. Rational arcs are raised to degree 5 where that
    shows that their pieces meet smoothly; points and parameters stay the same.

    Parameters
    ----------
    path : str or path
    select : str, optional
        A layer (full path or last part; not the layers below it) or the name of objects, in
        upper or lower case. Without it all surfaces of the file, which must be on one layer.

    Raises
    ------
    FormatError
        When there is no such file, or it is damaged, too new, in an unknown unit, or without
        a surface.
    SpecError
        When the selection names nothing, several layers, or a block instance; says what is
        there.
    SurfaceError
        When a surface has a crease or is otherwise not fit; names the object and the face.

    References: [piegl1997] ch. 4 and 5.
    """
    try:
        file = open_rhino(path)
        chosen = choose(file.items, file.layers, select, "surface")
        return _built(file, [face for item in chosen for face in _read_faces(file, item)])
    except PqmeshError as error:
        raise named(path, error) from None


class _Net(NamedTuple):
    """A surface's numbers as they stand in the file."""

    points: Floats
    degrees: tuple[int, int]
    knots: tuple[Floats, Floats]
    weights: Floats


class _Face(NamedTuple):
    """A face before the common origin is known; `face` and `brep` are None when untrimmed."""

    item: Item
    number: int
    net: _Net
    face: Any
    brep: Any

    @property
    def shown(self) -> str:
        """The face for messages."""
        name = repr(self.item.name) if self.item.name else "without a name"
        layer = f"layer {self.item.layer!r}" if self.item.layer else "no layer"
        return f"Object {name} on {layer}, face {self.number}"


def _built(file: RhinoFile, faces: list[_Face]) -> SurfaceFile:
    """All patches about their common origin."""
    origin = read_only(
        far_origin(np.concatenate([face.net.points.reshape(-1, 3) for face in faces]))
    )
    patches = []
    for face in faces:
        try:
            patches.append(_patch(face, origin, file.tolerance))
        except PqmeshError as error:
            raise type(error)(f"{face.shown}: {error}") from None
    return SurfaceFile(file.units, tuple(patches), origin)


def _patch(face: _Face, origin: Floats, tolerance: float) -> Patch:
    """One patch with its loops."""
    net = face.net
    surface = surface_from_nurbs(net.points - origin, net.degrees, net.knots, net.weights)
    loops: tuple[Floats, ...] = (rectangle(surface),)
    if face.face is not None:
        loops = loops_of_face(face.face, face.brep.Edges, surface, origin, tolerance)
    frozen = tuple(read_only(loop) for loop in loops)
    return Patch(surface, frozen, face.item.name, face.item.layer, face.number)


def _read_faces(file: RhinoFile, item: Item) -> list[_Face]:
    """Faces of an object, whatever the library makes of it."""
    try:
        return list(_faces(file, item))
    except PqmeshError:
        raise
    except DAMAGE as error:
        raise FormatError(
            f"Objects must be whole; {item.name!r} on layer {item.layer!r} cannot be read: "
            f"{type(error).__name__}. Mend what Rhino's command SelBadObjects finds."
        ) from None


def _faces(file: RhinoFile, item: Item) -> Iterator[_Face]:
    """Faces of an object: of a Brep, of an extrusion made one, or a bare surface."""
    geometry = item.content
    if isinstance(geometry, file.rhino3dm.Extrusion):
        geometry = geometry.ToBrep(True)
    if geometry is None:
        raise FormatError(f"Object {item.name!r} has no geometry. Rebuild it in Rhino.")
    if not isinstance(geometry, file.rhino3dm.Brep):
        yield _Face(item, 0, _net(geometry), None, None)
        return
    if len(geometry.Faces) == 0:
        raise FormatError(f"Object {item.name!r} must have a face; it has none. Rebuild it.")
    for number in range(len(geometry.Faces)):
        face = geometry.Faces[number]
        yield _Face(item, number, _net(face.UnderlyingSurface()), face, geometry)


def _net(surface: Any) -> _Net:
    """Control net of any surface, weights taken out of the homogeneous points."""
    nurbs = None if surface is None else surface.ToNurbsSurface()
    if nurbs is None:
        raise SurfaceError("A surface must have a NURBS form; one has none. Rebuild it in Rhino.")
    n, m = int(nurbs.Points.CountU), int(nurbs.Points.CountV)
    rows = np.empty((n, m, 4))
    for i in range(n):
        for j in range(m):
            point = nurbs.Points.GetControlPoint(i, j)
            rows[i, j] = point.X, point.Y, point.Z, point.W
    weights = rows[..., 3]
    with np.errstate(all="ignore"):
        points = rows[..., :3] / weights[..., None]
    degrees = int(nurbs.Degree(0)), int(nurbs.Degree(1))
    return _Net(points, degrees, (full_knots(nurbs.KnotsU), full_knots(nurbs.KnotsV)), weights)
