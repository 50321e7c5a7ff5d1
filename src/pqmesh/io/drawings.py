"""Plan curves of DXF, SVG, 3dm and CSV files, each in the unit of its file."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from pqmesh.errors import FormatError, PqmeshError
from pqmesh.io.atomic import PathLike
from pqmesh.io.choice import BLOCK, Item, choose
from pqmesh.io.foreign import DAMAGE, METRES, file_bytes, library
from pqmesh.io.rhino_file import open_rhino
from pqmesh.io.strokes import Curve, Drawing, polyline
from pqmesh.vectors import Floats

# --- DXF ------------------------------------------------------------------------------------

# Codes of $INSUNITS that architects use; 0 is "no unit".
UNIT_OF_DXF = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 7: "km"}

_DXF_CURVES = frozenset({"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"})


def drawing_from_dxf(path: PathLike, select: str | None) -> Drawing:
    """Curves of the model space of a DXF file; `select` is a layer."""
    content = file_bytes(path, "a drawing")
    if content.startswith(b"AC10"):
        raise FormatError("An outline must be DXF, not DWG; found DWG. Save it as DXF.")
    ezdxf = library("ezdxf", ".dxf")
    try:
        document = ezdxf.readfile(str(path))
        items = [_dxf_item(entity) for entity in document.modelspace()]
        layers = [str(layer.dxf.name) for layer in document.layers]
        code = int(document.header.get("$INSUNITS", 0))
    except (ezdxf.DXFError, *DAMAGE) as error:
        raise FormatError(_damaged("DXF drawing", error)) from None
    if code and code not in UNIT_OF_DXF:
        raise FormatError(
            f"The unit of a drawing must be one of {', '.join(UNIT_OF_DXF.values())}; found "
            f"$INSUNITS = {code}. Set the drawing unit."
        )
    chosen = choose(items, layers, select, "curve")
    try:
        strokes = [list(_dxf_curves(item.content)) for item in chosen]
    except PqmeshError:
        raise
    except (ezdxf.DXFError, *DAMAGE) as error:
        raise FormatError(_damaged("DXF drawing", error)) from None
    return Drawing(strokes, METRES[UNIT_OF_DXF[code]] if code else None)


def _dxf_item(entity: Any) -> Item:
    """One entity; meshes are polylines to DXF but not here."""
    kind = str(entity.dxftype())
    is_curve = kind in _DXF_CURVES
    if kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline):
        is_curve = False
    word = "curve" if is_curve else BLOCK if kind == "INSERT" else kind.lower()
    return Item(word, "", str(entity.dxf.get("layer", "0")), entity)


def _dxf_curves(entity: Any) -> Iterator[Curve]:
    """Curves of an entity, bulges as arcs."""
    kind = entity.dxftype()
    if kind == "LINE":
        ends = (entity.dxf.start, entity.dxf.end)
        yield polyline(np.array([[p.x, p.y] for p in ends]))
    elif kind in ("LWPOLYLINE", "POLYLINE"):
        parts = list(entity.virtual_entities())
        if not parts:
            corners = entity.points("xy") if kind == "LWPOLYLINE" else entity.points()
            yield polyline(np.array([[p[0], p[1]] for p in corners]).reshape(-1, 2))
        for part in parts:
            yield from _dxf_curves(part)
    elif kind == "SPLINE":
        spline = entity.construction_tool()
        breaks = np.unique(np.array(spline.knots(), dtype=np.float64))
        low, high = (float(spline.knots()[i]) for i in (spline.degree, spline.count))
        inside = breaks[(breaks >= low) & (breaks <= high)]
        yield Curve(_sampler(lambda t: next(iter(spline.points([t])))), inside)
    else:
        full = kind == "CIRCLE"
        name = "param" if kind == "ELLIPSE" else "angle"
        unit = 1.0 if kind == "ELLIPSE" else 180.0 / math.pi
        start = 0.0 if full else float(entity.dxf.get(f"start_{name}")) / unit
        end = math.tau if full else float(entity.dxf.get(f"end_{name}")) / unit
        # An end before the start, or equal to it, is reached after a full turn.
        turn = (end - start) % math.tau
        turn = math.tau if turn < 1e-12 else turn
        place = _sampler(lambda t: next(iter(entity.vertices([t * unit]))))
        yield Curve(place, start + turn * np.linspace(0.0, 1.0, 5))


def _sampler(place: Callable[[float], Any]) -> Callable[[Floats], Floats]:
    """A function of many parameters from one that gives a point with x and y."""

    def point_at(t: Floats) -> Floats:
        points = [place(value) for value in t.tolist()]
        return np.array([[p.x, p.y] for p in points], dtype=np.float64).reshape(-1, 2)

    return point_at


# --- SVG ------------------------------------------------------------------------------------

_SIZE = re.compile(r"\s*([0-9.eE+-]+)\s*(mm|cm|m|in|pt|pc|Q)\s*")
_METRES_OF_SVG = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254} | {
    **{"pt": 0.0254 / 72, "pc": 0.0254 / 6, "Q": 0.25e-3},
}
_INKSCAPE_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"


def drawing_from_svg(path: PathLike, select: str | None) -> Drawing:
    """Curves of an SVG file; `select` is a group or the id of an element.

    y points up here. Without a width in mm, cm, in or the like the file has no unit.
    """
    content = file_bytes(path, "a drawing")
    svgelements = library("svgelements", ".svg")
    try:
        root = ElementTree.fromstring(content)
        if root.tag.rpartition("}")[2] != "svg":
            raise FormatError("An SVG drawing must begin with <svg>; this one does not.")
        metres = _svg_metres(root)
        # Size and view box are applied here, exactly; the library rounds pixels.
        for name in ("width", "height", "viewBox", "preserveAspectRatio"):
            root.attrib.pop(name, None)
        plain = io.BytesIO(ElementTree.tostring(root))
        tree = svgelements.SVG.parse(plain, reify=True, width=1000, height=1000)
        items = list(_svg_items(tree, "", svgelements))
        layers = sorted({item.layer for item in items})
        chosen = choose(items, layers, select, "curve")
        strokes = [part for item in chosen for part in _svg_strokes(item.content, svgelements)]
    except PqmeshError:
        raise
    except (ElementTree.ParseError, *DAMAGE) as error:
        raise FormatError(_damaged("SVG drawing", error)) from None
    return Drawing(strokes, metres)


def _svg_metres(root: ElementTree.Element) -> float | None:
    """Metres in a user unit, when the drawing has a size in the world."""
    sizes = [_SIZE.fullmatch(root.get(name, "")) for name in ("width", "height")]
    found = [float(size[1]) * _METRES_OF_SVG[size[2]] for size in sizes if size]
    if not found:
        return None
    box = root.get("viewBox")
    if box is None:
        return 0.0254 / 96.0
    sides = [float(word) for word in box.replace(",", " ").split()][2:4]
    shares = [
        float(size[1]) * _METRES_OF_SVG[size[2]] / side
        for size, side in zip(sizes, sides, strict=True)
        if size
    ]
    if not all(math.isfinite(share) and share > 0.0 for share in shares):
        raise FormatError("The size and the view box of an SVG drawing must be above 0.")
    return min(shares)


def _svg_items(node: Any, layer: str, svgelements: Any) -> Iterator[Item]:
    """Shapes below a node; the layer of a shape is the path of its named groups."""
    for child in node:
        values = getattr(child, "values", None) or {}
        if values.get("display") == "none" or values.get("visibility") == "hidden":
            continue
        own = values.get("attributes") or {}
        name = own.get(_INKSCAPE_LABEL) or own.get("id") or ""
        if isinstance(child, (svgelements.Group, svgelements.Use)):
            inner = "::".join(part for part in (layer, name) if part)
            yield from _svg_items(child, inner, svgelements)
        elif isinstance(child, svgelements.Shape):
            yield Item("curve", str(name), layer, child)
        elif isinstance(child, (svgelements.Text, svgelements.Image)):
            yield Item("text or picture", str(name), layer, child)


def _svg_strokes(shape: Any, svgelements: Any) -> list[list[Curve]]:
    """Subpaths of a shape, segment by segment, with y turned up."""
    strokes: list[list[Curve]] = [[]]
    for segment in svgelements.Path(shape):
        if isinstance(segment, svgelements.Move):
            strokes.append([])
            continue
        if isinstance(segment, (svgelements.Line, svgelements.Close)):
            if segment.start is None or segment.end is None:
                continue
            ends = [(segment.start.x, -segment.start.y), (segment.end.x, -segment.end.y)]
            if ends[0] != ends[1]:
                strokes[-1].append(polyline(np.array(ends)))
            continue
        strokes[-1].append(Curve(_svg_sampler(segment), np.linspace(0.0, 1.0, 5)))
    return [stroke for stroke in strokes if stroke]


def _svg_sampler(segment: Any) -> Callable[[Floats], Floats]:
    """Points of one segment."""

    def point_at(t: Floats) -> Floats:
        points = [segment.point(value) for value in t.tolist()]
        return np.array([[p.x, -p.y] for p in points], dtype=np.float64).reshape(-1, 2)

    return point_at


# --- 3dm ------------------------------------------------------------------------------------


def drawing_from_rhino(path: PathLike, select: str | None) -> Drawing:
    """Curves of a .3dm file seen from above; `select` is a layer or the name of objects."""
    file = open_rhino(path)
    chosen = choose(file.items, file.layers, select, "curve")
    try:
        strokes = [[_rhino_curve(item.content)] for item in chosen]
    except PqmeshError:
        raise
    except DAMAGE as error:
        raise FormatError(_damaged("Rhino model", error)) from None
    return Drawing(strokes, METRES[file.units])


def _rhino_curve(curve: Any) -> Curve:
    """One curve: a polyline exactly, others by their NURBS form."""
    nurbs = curve.ToNurbsCurve()
    if nurbs is None:
        raise FormatError("A curve must have a NURBS form; one has none. Rebuild it in Rhino.")
    degree, knots = int(nurbs.Degree), np.array(nurbs.Knots.ToList(), dtype=np.float64)
    # Rhino leaves the first and the last knot out.
    breaks = np.unique(knots[degree - 1 : len(knots) - degree + 1])

    def point_at(t: Floats) -> Floats:
        points = [nurbs.PointAt(value) for value in t.tolist()]
        return np.array([[p.X, p.Y] for p in points], dtype=np.float64).reshape(-1, 2)

    return Curve(point_at, breaks, degree == 1)


# --- CSV ------------------------------------------------------------------------------------


def drawing_from_csv(path: PathLike, select: str | None) -> Drawing:
    """Rings of a text file of rows x, y; blank lines separate them.

    The first row of the file may be a header, a third column is ignored, and the last row of a
    ring need not repeat the first. Separators are commas, semicolons (then the
    numbers may have decimal commas), tabs or blanks.
    """
    if select is not None:
        raise FormatError(
            f"A CSV file has no layers to select from; found {select!r}. Leave it out."
        )
    content = file_bytes(path, "rows x, y")
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise FormatError("Rows x, y must be UTF-8 text; they are not. Export as CSV.") from None
    rings: list[list[tuple[float, float]]] = [[]]
    for number, line in enumerate(lines, start=1):
        cells = _cells(line)
        if not any(cells):
            rings.append([])
            continue
        pair = _pair(cells)
        if pair is None and number == 1:
            continue
        if pair is None:
            raise FormatError(
                f"Line {number}: a row must be two numbers x, y; found {line.strip()[:60]!r}. "
                f"Mend the row."
            )
        if len(cells) > 3 and all(map(_is_number, cells)):
            raise FormatError(
                f"Line {number}: a row of numbers must be x, y or x, y, z; found {len(cells)} in "
                f"{line.strip()[:60]!r}. Write decimal points, or semicolons between the numbers."
            )
        rings[-1].append(pair)
    strokes = [[polyline(np.array([*ring, ring[0]]))] for ring in rings if ring]
    if not strokes:
        raise FormatError("An outline must have rows x, y; found none. Export it again.")
    return Drawing(strokes, None)


def _cells(line: str) -> list[str]:
    """Cells of a row by the separator that it has."""
    if ";" in line:
        line = line.replace(",", ".").replace(";", ",")
    elif "," not in line:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line]), [])]


def _pair(cells: list[str]) -> tuple[float, float] | None:
    """Two finite numbers, if that is what the first cells are."""
    try:
        x, y = (float(cell) for cell in cells[:2])
    except ValueError:
        return None
    return (x, y) if math.isfinite(x) and math.isfinite(y) else None


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


# --- all ------------------------------------------------------------------------------------


def _damaged(what: str, error: BaseException) -> str:
    """One line for whatever a library says."""
    text = " ".join(str(error).split())[:120]
    article = "An" if what.startswith("SVG") else "A"
    found = (text or type(error).__name__).rstrip(".")
    return f"{article} {what} must be whole; this one cannot be read: {found}. Export it again."
