"""Outlines of each format: the same plan comes out, in the model unit and about the origin."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.io.outlines import read_outline
from pqmesh.network.region import PlanOutline


def size(outline: PlanOutline) -> np.ndarray:
    return np.ptp(outline.polygon, axis=0)


# --- CSV ------------------------------------------------------------------------------------

SQUARE = "0,0\n10,0\n10,10\n0,10\n"


@pytest.mark.parametrize(
    "text",
    [
        SQUARE,
        "x,y\n" + SQUARE,
        "\ufeffX [m],Y [m]\n" + SQUARE + "0,0\n",
        SQUARE.replace(",", ";"),
        SQUARE.replace("10,0\n", "10;0\n").replace("\n0,10", "\n0;10").replace("0,0", "0;0"),
        "0,0;0,0\n10,0;0\n10;10\n0;10,0\n",
        SQUARE.replace(",", "\t"),
        SQUARE.replace(",", " "),
        "0,0,5\n10,0,6\n10,10,7\n0,10,8\n",
        "\n\n" + SQUARE.replace("\n", "\r\n") + "\r\n\r\n",
    ],
)
def test_csv_square(text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    outline = read_outline(path, units="m")
    assert outline.polygon.tolist() == [[0, 0], [10, 0], [10, 10], [0, 10]]


def test_csv_blank_line_starts_a_hole_and_origin_is_taken_off(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("2,2\n3,2\n3,3\n\n" + SQUARE)
    outline = read_outline(path, units="mm", origin=[100.0, 200.0, 7.0])
    assert outline.polygon[0].tolist() == [-100.0, -200.0]
    assert outline.holes[0].tolist() == [[-98, -198], [-97, -198], [-97, -197]]
    assert outline.area == 99.5


# --- DXF ------------------------------------------------------------------------------------


class Dxf:
    def __init__(self, units: int = 4) -> None:
        ezdxf = pytest.importorskip("ezdxf", reason="ezdxf (extra aec) is not installed")
        self.document = ezdxf.new("R2010")
        self.document.header["$INSUNITS"] = units
        self.space = self.document.modelspace()

    def write(self, path: Path) -> Path:
        self.document.saveas(path)
        return path


@pytest.mark.parametrize(
    ("code", "unit", "factor"),
    [
        *((4, "m", 1e-3), (4, "mm", 1.0), (6, "mm", 1e3), (5, "m", 1e-2), (1, "m", 0.0254)),
        *((0, "m", 1.0), (2, "mm", 304.8), (7, "m", 1e3), (1, "ft", 1 / 12)),
    ],
)
def test_dxf_units_are_converted(code: int, unit: str, factor: float, tmp_path: Path) -> None:
    drawing = Dxf(code)
    drawing.space.add_lwpolyline([(0, 0), (40, 0), (40, 30)], close=True)
    outline = read_outline(drawing.write(tmp_path / "a.dxf"), units=unit)
    assert size(outline) == pytest.approx(np.array([40, 30]) * factor, rel=1e-14)


def test_dxf_bulges_are_arcs(tmp_path: Path) -> None:
    drawing = Dxf()
    # Bulge 1 is a half circle: a stadium of 10 x 4.
    drawing.space.add_lwpolyline(
        [(0, 0, 0), (10, 0, 1), (10, 4, 0), (0, 4, 1)], format="xyb", close=True
    )
    outline = read_outline(drawing.write(tmp_path / "a.dxf"), units="mm")
    assert outline.area == pytest.approx(40 + 4 * np.pi, rel=1e-4)
    assert size(outline) == pytest.approx([14, 4], rel=1e-4)


def test_dxf_lines_and_arcs_in_any_order_are_joined(tmp_path: Path) -> None:
    drawing = Dxf()
    drawing.space.add_line((10, 4), (0, 4))
    drawing.space.add_arc((0, 2), 2, 90, 270)
    drawing.space.add_line((0, 0), (10, 0))
    drawing.space.add_arc((10, 2), 2, -90, 90)
    outline = read_outline(drawing.write(tmp_path / "a.dxf"), units="mm")
    assert outline.area == pytest.approx(40 + 4 * np.pi, rel=1e-4)


def test_dxf_circles_ellipses_splines_and_old_polylines(tmp_path: Path) -> None:
    drawing = Dxf()
    drawing.space.add_polyline2d([(0, 0), (100, 0), (100, 60), (0, 60)], close=True)
    drawing.space.add_circle((20, 20), 10)
    drawing.space.add_ellipse((60, 20), (0, 10), 0.5)
    math = pytest.importorskip("ezdxf.math")
    frame = [(70, 40, 0), (90, 40, 0), (90, 55, 0), (70, 55, 0)]
    drawing.space.add_spline().apply_construction_tool(math.closed_uniform_bspline(frame))
    drawing.space.add_polyline3d([(5, 45, 3), (10, 45, 3), (10, 50, 3)], close=True)
    outline = read_outline(drawing.write(tmp_path / "a.dxf"), units="mm")
    areas = sorted(PlanOutline(hole).area for hole in outline.holes)
    assert areas[0] == pytest.approx(12.5)
    assert areas[1::2] == pytest.approx([np.pi * 50, np.pi * 100], rel=3e-3)
    assert size(outline).tolist() == [100, 60]
    for ring in outline.holes:
        if PlanOutline(ring).area > 20:
            steps = np.roll(ring, -1, axis=0) - ring
            turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
            assert np.abs(turns).max() < np.radians(7)


def test_dxf_mirrored_arcs_lie_where_they_are_seen(tmp_path: Path) -> None:
    drawing = Dxf()
    # An extrusion along -z mirrors x: the same half disc to the left of x = -5.
    drawing.space.add_arc((5, 0), 2, -90, 90, dxfattribs={"extrusion": (0, 0, -1)})
    drawing.space.add_line((-5, -2), (-5, 2))
    outline = read_outline(drawing.write(tmp_path / "a.dxf"), units="mm")
    assert outline.polygon[:, 0].min() == pytest.approx(-7, abs=1e-9)
    assert outline.polygon[:, 0].max() == pytest.approx(-5, abs=1e-9)


def test_dxf_layer_is_chosen_and_junk_is_ignored(tmp_path: Path) -> None:
    drawing = Dxf()
    corners = [(0, 0), (40, 0), (40, 30)]
    drawing.space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "Outline"})
    drawing.space.add_line((5, 5), (50, 50), dxfattribs={"layer": "Axes"})
    drawing.space.add_text("roof", dxfattribs={"layer": "Outline"})
    drawing.space.add_point((3, 3))
    path = drawing.write(tmp_path / "a.dxf")
    assert size(read_outline(path, "OUTLINE", units="mm")).tolist() == [40, 30]


# --- SVG ------------------------------------------------------------------------------------


def svg(path: Path, body: str, head: str = "") -> Path:
    pytest.importorskip("svgelements", reason="svgelements (extra aec) is not installed")
    space = 'xmlns="http://www.w3.org/2000/svg"'
    path.write_text(f"<?xml version='1.0'?><svg {space} {head}>{body}</svg>", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("head", "unit", "factor"),
    [
        ("", "m", 1.0),
        ('width="500" height="400" viewBox="0 0 250 200"', "m", 1.0),
        ('width="500px" height="400px"', "mm", 1.0),
        ('viewBox="-5 -5 100 50"', "mm", 1.0),
        ('width="200mm" height="100mm" viewBox="0 0 200 100"', "mm", 1.0),
        ('width="200mm" height="100mm" viewBox="0 0 200 100"', "m", 1e-3),
        ('width="20cm" viewBox="0 0 100 50"', "mm", 2.0),
        ('width="96in" height="1in"', "in", 1 / 96),
    ],
)
def test_svg_size_tells_the_unit(head: str, unit: str, factor: float, tmp_path: Path) -> None:
    path = svg(tmp_path / "a.svg", '<rect x="10" y="20" width="40" height="30"/>', head)
    outline = read_outline(path, units=unit)
    assert size(outline) == pytest.approx(np.array([40, 30]) * factor, rel=1e-12)
    assert outline.polygon.max(axis=0) == pytest.approx(np.array([50, -20]) * factor, rel=1e-12)


def test_svg_points_up(tmp_path: Path) -> None:
    path = svg(tmp_path / "a.svg", '<polygon points="0,0 10,0 0,-7"/>')
    assert read_outline(path, units="m").polygon[:, 1].max() == 7.0


def test_svg_paths_with_arcs_curves_and_holes(tmp_path: Path) -> None:
    body = '<path d="M 0 0 H 100 V 60 H 0 Z m 10 10 c 0 10 20 10 20 0 s -20 -10 -20 0 z"/>'
    body += '<path d="M 60 30 a 10 10 0 0 1 20 0 a 10 10 0 0 1 -20 0" fill="none"/>'
    body += '<circle cx="50" cy="30" r="5" transform="translate(0 10)"/><text x="3">roof</text>'
    outline = read_outline(svg(tmp_path / "a.svg", body), units="m")
    areas = sorted(PlanOutline(hole).area for hole in outline.holes)
    assert areas[0] == pytest.approx(np.pi * 25, rel=3e-3)
    assert areas[-1] == pytest.approx(np.pi * 100, rel=3e-3)
    assert len(areas) == 3


def test_svg_open_pieces_are_joined(tmp_path: Path) -> None:
    body = '<polyline points="0,0 10,0 10,10"/><line x1="0" y1="0" x2="10" y2="10"/>'
    assert read_outline(svg(tmp_path / "a.svg", body), units="m").area == 50.0


def test_svg_group_label_and_id_select(tmp_path: Path) -> None:
    label = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" inkscape:label="Roof"'
    body = f'<g {label} transform="scale(2)"><rect width="4" height="3"/></g>'
    body += '<rect id="site" width="90" height="80"/>'
    body += '<rect width="1" height="1" style="display:none"/>'
    path = svg(tmp_path / "a.svg", body)
    assert size(read_outline(path, "roof", units="m")).tolist() == [8, 6]
    assert size(read_outline(path, "site", units="m")).tolist() == [90, 80]


# --- 3dm ------------------------------------------------------------------------------------


def rhino(path: Path, curves: list[Any], unit: str = "Millimeters") -> Path:
    rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")
    file = rhino3dm.File3dm()
    file.Settings.ModelUnitSystem = getattr(rhino3dm.UnitSystem, unit)
    for name, curve in curves:
        attributes = rhino3dm.ObjectAttributes()
        attributes.Name = name
        file.Objects.Add(curve, attributes)
    assert file.Write(str(path), 8)
    return path


def test_rhino_curves_in_plan_with_units_and_origin(tmp_path: Path) -> None:
    rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")
    line = rhino3dm.Polyline(5)
    for x, y in ((0, 0), (40, 0), (40, 30), (0, 30), (0, 0)):
        line.Add(5e8 + 1000 * x, 3e8 + 1000 * y, 77.0)
    hole = rhino3dm.Circle(rhino3dm.Point3d(5e8 + 20_000, 3e8 + 10_000, 5), 5000.0)
    curves = [("rim", line.ToPolylineCurve()), ("eye", rhino3dm.NurbsCurve.CreateFromCircle(hole))]
    path = rhino(tmp_path / "a.3dm", curves)
    outline = read_outline(path, units="m", origin=[5e5, 3e5, 0])
    assert outline.polygon.tolist() == [[0, 0], [40, 0], [40, 30], [0, 30]]
    assert PlanOutline(outline.holes[0]).area == pytest.approx(25 * np.pi, rel=2e-3)
    alone = read_outline(path, "eye", units="m", origin=[5e5, 3e5, 0]).polygon
    assert np.hypot(*(alone - [20, 10]).T) == pytest.approx(5.0, abs=1e-6)


def test_rhino_polycurve_and_nurbs(tmp_path: Path) -> None:
    rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")
    top = [rhino3dm.Point3d(x, y, 0) for x, y in ((10, 0), (12, 8), (-2, 8), (0, 0))]
    whole = rhino3dm.PolyCurve()
    whole.AppendSegment(rhino3dm.LineCurve(rhino3dm.Point3d(0, 0, 0), top[0]))
    whole.AppendSegment(rhino3dm.NurbsCurve.Create(False, 3, top))
    outline = read_outline(rhino(tmp_path / "a.3dm", [("", whole)], "Meters"), units="m")
    t = np.linspace(0, 1, 4001)[:, None]
    corners = np.array([[p.X, p.Y] for p in top])
    shares = [(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]
    fine = sum(share * corner for share, corner in zip(shares, corners, strict=True))
    assert outline.area == pytest.approx(PlanOutline(fine).area, rel=1e-3)
    assert outline.polygon[:, 1].max() == pytest.approx(6.0, abs=2e-3)
