"""Plan outlines and curves from drawings: DXF, SVG, 3dm and CSV."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import FormatError, PqmeshError, SpecError
from pqmesh.io.atomic import PathLike
from pqmesh.io.drawings import (
    drawing_from_csv,
    drawing_from_dxf,
    drawing_from_rhino,
    drawing_from_svg,
)
from pqmesh.io.foreign import METRES, named
from pqmesh.io.rings import outline_from_strokes
from pqmesh.io.strokes import Drawing, flattened
from pqmesh.network.region import PlanOutline
from pqmesh.vectors import Floats

# The only list of outline formats.
OUTLINE_FORMATS: dict[str, Callable[[PathLike, str | None], Drawing]] = {
    ".dxf": drawing_from_dxf,
    ".svg": drawing_from_svg,
    ".3dm": drawing_from_rhino,
    ".csv": drawing_from_csv,
}

# Ratios of sizes that come from mistaken units, and how near a ratio must be to look so.
GROSS = {1000.0: ("mm", "m", 2.0), 304.8: ("mm", "ft", 1.7)}
MISTAKES = GROSS | {100.0: ("cm", "m", 1.3), 25.4: ("mm", "in", 1.3)}


def read_outline(
    path: PathLike,
    select: str | None = None,
    *,
    units: str,
    origin: ArrayLike = (0.0, 0.0, 0.0),
) -> PlanOutline:
    """The plan outline of a drawing, in the model unit and relative to an origin.

    The largest ring is the outline and the rings inside it are holes. Lines and arcs are joined
    where their ends are within 1e-5 of the drawing's extent; curves become polylines within
    1e-4 of that extent that turn by at most five degrees at a point.

    Units: DXF by $INSUNITS and 3dm by its model unit; SVG by its width and height when these
    are in mm, cm, in or pt. Files that do not say (CSV; DXF without $INSUNITS; SVG in pixels,
    one user unit for one) are in the model unit. `plausible_units` finds gross mistakes.

    Parameters
    ----------
    path : str or path
        The suffix tells the format: dxf, svg, 3dm or csv.
    select : str, optional
        Layer of a DXF or 3dm file, object name of a 3dm file, group or id of an SVG file. May
        be left out when all curves are on one layer.
    units : str
        The model unit: m, mm, cm, km, ft or in.
    origin : (3,), model unit
        Taken off, as `SurfaceFile.origin` is taken off the surfaces.

    Raises
    ------
    FormatError
        When there is no such file or format, or it cannot be read or holds no curve.
    SpecError
        When the selection or the unit is not known; when the outline is open, a point, crosses
        or touches itself or a hole, or a hole lies outside. Names the place in the file.
    """
    strokes, factor = _strokes(path, select, units)
    try:
        drawn = outline_from_strokes(strokes)
    except PqmeshError as error:
        raise named(path, error) from None
    base = np.asarray(origin, dtype=np.float64)[:2]
    first, *holes = (ring * factor - base for ring in drawn.rings)
    return PlanOutline(first, tuple(holes))


def read_curves(
    path: PathLike,
    select: str | None = None,
    *,
    units: str,
    origin: ArrayLike = (0.0, 0.0, 0.0),
) -> tuple[Floats, ...]:
    """Plan polylines (k, 2) of a drawing's curves, each as drawn, open or closed.

    Formats, selection, units, origin and errors as in `read_outline`; nothing is joined.
    """
    strokes, factor = _strokes(path, select, units)
    base = np.asarray(origin, dtype=np.float64)[:2]
    return tuple(stroke * factor - base for stroke in strokes)


def _strokes(path: PathLike, select: str | None, units: str) -> tuple[list[Floats], float]:
    """Polylines in the unit of the file, and what to multiply them by for the model unit."""
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    try:
        if units not in METRES:
            raise SpecError(
                f"The model unit must be one of {', '.join(METRES)}; found {units!r}. Choose one."
            )
        if suffix not in OUTLINE_FORMATS:
            raise FormatError(
                f"The suffix of an outline must be one of {', '.join(OUTLINE_FORMATS)}; found "
                f"{suffix or 'none'!r}. Rename or convert the file."
            )
        drawing = OUTLINE_FORMATS[suffix](path, select)
        strokes = flattened(drawing.strokes)
    except PqmeshError as error:
        raise named(path, error) from None
    return strokes, 1.0 if drawing.metres is None else drawing.metres / METRES[units]


def plausible_units(
    outline: PlanOutline, surface_extent: float, units: str = "m", *, is_stated: bool = False
) -> None:
    """Nothing, once the sizes of an outline and of its surface do not hint at mistaken units.

    Parameters
    ----------
    outline : PlanOutline
    surface_extent : float, model unit
        The larger extent of the surface in plan.
    units : str
        The model unit, for the message.
    is_stated : bool
        Units were said, not taken for granted: only the gross mistakes are asked about then.

    Raises
    ------
    SpecError
        When one is about 1000 or 304.8 times the size of the other; 100 or 25.4 times, too, where
        no unit was stated.

    Examples
    --------
    >>> plausible_units(PlanOutline([[0, 0], [30, 0], [30, 20]]), 40.0)
    >>> outline = PlanOutline([[0, 0], [30000, 0], [30000, 20000]])
    >>> plausible_units(outline, 40.0)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    pqmesh.errors.SpecError: The outline must fit ... as if one were in mm and the other in m. ...
    """
    size = float(np.ptp(outline.polygon, axis=0).max())
    if not (size > 0.0 and surface_extent > 0.0):
        return
    ratio = max(size / surface_extent, surface_extent / size)
    for factor, (small, large, margin) in (GROSS if is_stated else MISTAKES).items():
        if factor / margin <= ratio <= factor * margin:
            raise SpecError(
                f"The outline must fit the surface; it is {size:.6g} across and the surface "
                f"{surface_extent:.6g} (model unit {units}), as if one were in {small} and the "
                f"other in {large}. Say in which unit each is."
            )
