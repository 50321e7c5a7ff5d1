"""A .3dm file opened: its unit, its tolerance, and its objects with layers and names."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from pqmesh.errors import FormatError
from pqmesh.io.atomic import PathLike
from pqmesh.io.choice import BLOCK, Item
from pqmesh.io.foreign import DAMAGE, file_bytes, library
from pqmesh.vectors import Floats

MAGIC = b"3D Geometry File Format "

UNIT_OF_RHINO = {
    **{"Meters": "m", "Millimeters": "mm", "Centimeters": "cm", "Kilometers": "km"},
    **{"Feet": "ft", "Inches": "in"},
}

# Rhino's words for what architects call otherwise.
_KINDS = {"InstanceReference": BLOCK, "Brep": "surface", "Surface": "surface"} | {
    **{"Extrusion": "surface", "SubD": "SubD", "PointSet": "point cloud", "TextDot": "text dot"},
}


class RhinoFile(NamedTuple):
    """What a .3dm file holds.

    Attributes
    ----------
    rhino3dm : module
    units : str
        "mm", "m", "cm", "km", "ft" or "in".
    tolerance : float, unit of the file
        Within which faces and edges meet.
    items : tuple of Item
        Every object outside block definitions; hidden and locked ones too.
    layers : tuple of str
        Full paths, levels separated by "::".
    archive : File3dm
        Kept, since geometry must not outlive it.
    """

    rhino3dm: Any
    units: str
    tolerance: float
    items: tuple[Item, ...]
    layers: tuple[str, ...]
    archive: Any


def open_rhino(path: PathLike) -> RhinoFile:
    """The objects of a .3dm file.

    Hidden and locked objects and layers count like all others; what stands inside block
    definitions does not.

    Parameters
    ----------
    path : str or path

    Raises
    ------
    FormatError
        When the file is no .3dm file, damaged, too new, or in a unit that is not known.
    """
    content = file_bytes(path, "a Rhino model")
    rhino3dm = library("rhino3dm", ".3dm")
    _check_head(content, str(getattr(rhino3dm, "__version__", "8")))
    try:
        archive = rhino3dm.File3dm.FromByteArray(content)
        if archive is None:
            raise FormatError(
                "A Rhino model must be whole; this one cannot be read: it is cut off, damaged or "
                "encrypted. Save it again in Rhino, without a password, and copy all of it."
            )
        layers = tuple(str(layer.FullPath) for layer in archive.Layers)
        items = tuple(
            _item(found, layers)
            for found in archive.Objects
            if not found.Attributes.IsInstanceDefinitionObject
        )
        unit = archive.Settings.ModelUnitSystem.name
        tolerance = float(archive.Settings.ModelAbsoluteTolerance)
    except FormatError:
        raise
    except DAMAGE as error:
        raise FormatError(
            f"A Rhino model must be whole; this one cannot be read: {type(error).__name__}. Save "
            f"it again in Rhino."
        ) from None
    if not items:
        raise FormatError("A Rhino model must hold objects; this one is empty. Save it again.")
    if unit not in UNIT_OF_RHINO:
        raise FormatError(
            f"The unit of a Rhino model must be one of {', '.join(UNIT_OF_RHINO.values())}; found "
            f"{unit}. Set the model unit in Rhino."
        )
    if not (math.isfinite(tolerance) and tolerance > 0.0):
        tolerance = 0.0
    return RhinoFile(rhino3dm, UNIT_OF_RHINO[unit], tolerance, items, layers, archive)


def row_from_point(point: Any) -> tuple[float, float, float]:
    """Coordinates of a point of rhino3dm."""
    return point.X, point.Y, point.Z


def full_knots(knots: Any) -> Floats:
    """Knots with the first and the last one, which Rhino leaves out, repeated."""
    line = np.array(knots.ToList(), dtype=np.float64)
    return np.concatenate([line[:1], line, line[-1:]])


def _item(found: Any, layers: tuple[str, ...]) -> Item:
    """One object; a layer that does not exist shows as such."""
    index = int(found.Attributes.LayerIndex)
    layer = layers[index] if 0 <= index < len(layers) else ""
    rhino_kind = str(found.Geometry.ObjectType.name) if found.Geometry is not None else "unknown"
    kind = _KINDS.get(rhino_kind, rhino_kind.lower())
    return Item(kind, str(found.Attributes.Name or ""), layer, found.Geometry)


def _check_head(content: bytes, version: str) -> None:
    """Refuse what is no Rhino model, or one of a Rhino that the library does not know."""
    if not content.startswith(MAGIC):
        raise FormatError(
            f"A Rhino model must begin with {MAGIC.decode().strip()!r}; this file does not. Is it "
            f"another format, compressed or encrypted? Save it as .3dm in Rhino."
        )
    number = content[len(MAGIC) : len(MAGIC) + 8].strip()
    newest = int(version.partition(".")[0]) if version.partition(".")[0].isdigit() else 8
    saved = int(number) if number.isdigit() else 0
    # Versions 1 to 4 stand as such, later ones times ten.
    saved = saved // 10 if saved >= 10 else saved
    if saved > newest:
        raise FormatError(
            f"A Rhino model must be of version {newest} or earlier; this one is of version "
            f"{saved}. Save it as Rhino {newest}, or install a newer rhino3dm."
        )
