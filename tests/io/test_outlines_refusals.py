"""Every refusal of an outline, by its text, with the smallest bad drawing."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pqmesh.errors import FormatError, PqmeshError, SpecError
from pqmesh.io.outlines import OUTLINE_FORMATS, plausible_units, read_outline
from pqmesh.io.rings import outline_from_strokes
from pqmesh.network.region import PlanOutline

SQUARE = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10], [0, 0]])


def refused(
    kind: type[PqmeshError], path: Path, select: str | None = None, units: str = "m"
) -> str:
    with pytest.raises(kind) as caught:
        read_outline(path, select, units=units)
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    assert text.endswith((".", "?"))
    return text


def bad_rings(*strokes: object) -> str:
    with pytest.raises(SpecError) as caught:
        outline_from_strokes([np.array(stroke, dtype=float) for stroke in strokes])
    return str(caught.value)


# --- rings ----------------------------------------------------------------------------------


def test_open_outline_names_place_and_gap() -> None:
    text = bad_rings([[0, 0], [10, 0], [10, 10], [0, 0.5]])
    assert "it is open at (0, 0), where the nearest other end is 0.5 away. Close it there." in text


def test_branching_outline_is_refused() -> None:
    text = bad_rings([[0, 0], [10, 0], [5, 9]], [[5, 9], [0, 0]], [[5, 9], [5, 20]])
    assert "at (5, 9) 3 ends meet" in text


def test_line_drawn_twice_is_refused() -> None:
    corner = [[0, 0], [10, 0], [5, 9]]
    assert "drawn twice" in bad_rings(corner, [[5, 9], [0, 0]], [[0, 0], [5, 9]])


@pytest.mark.parametrize("x", [0.0, 1e9])
def test_point_is_refused(x: float) -> None:
    assert f"all of it lies at the point ({x:.9g}, 2)" in bad_rings([[x, 2], [x, 2], [x, 2]])
    assert "the ring at (3, 3) is a point" in bad_rings(SQUARE, [[3, 3], [3, 3]])


def test_line_there_and_back_is_refused() -> None:
    assert "runs back on itself" in bad_rings([[0, 0], [5, 5], [0, 0]])
    assert "turns back onto itself at (5, 0)" in bad_rings([[0, 0], [5, 0], [2, 0], [2, 2], [0, 0]])


def test_crossing_outline_names_the_place() -> None:
    text = bad_rings([[0, 0], [10, 10], [10, 0], [0, 10], [0, 0]])
    assert "one ring meets itself at (5, 5)" in text


def test_touching_outline_is_refused() -> None:
    assert "meets itself at (5, 0)" in bad_rings([[0, 0], [10, 0], [10, 8], [5, 0], [0, 8], [0, 0]])


def test_crossing_is_found_among_many_segments() -> None:
    t = np.linspace(0, 2 * np.pi, 20_001)
    ring = np.stack([np.cos(t), np.sin(t)], axis=1)
    ring[-1] = ring[0]
    assert outline_from_strokes([ring]).area == pytest.approx(np.pi, rel=1e-6)
    ring[7000] *= 0.999
    ring[7001] = ring[7000] + 1.5 * (ring[6999] - ring[7000])
    assert "one ring meets itself" in bad_rings(ring) or "turns back" in bad_rings(ring)


def test_hole_outside_is_refused() -> None:
    assert "the one at (20, 20) lies outside" in bad_rings(SQUARE, SQUARE * 0.1 + 20)


def test_hole_in_a_hole_is_refused() -> None:
    text = bad_rings(SQUARE, SQUARE * 0.5 + 2, SQUARE * 0.1 + 4)
    assert "the one at (4, 4) lies inside another" in text


def test_hole_over_the_rim_is_refused() -> None:
    text = bad_rings(SQUARE, SQUARE * 0.3 + 9)
    assert "meets another ring at (10, 9)" in text or "meets another ring at (9, 10)" in text


def test_same_ring_twice_is_refused() -> None:
    assert "meets another ring" in bad_rings(SQUARE, SQUARE)


def test_no_line_is_refused() -> None:
    assert "must have lines; found none" in bad_rings()


# --- files ----------------------------------------------------------------------------------


def test_unknown_suffix_unit_and_missing_file(tmp_path: Path) -> None:
    assert "must be one of .dxf, .svg, .3dm, .csv; found '.pdf'" in refused(
        FormatError, tmp_path / "a.pdf"
    )
    assert "found 'none'" in refused(FormatError, tmp_path / "a")
    assert "The model unit must be one of m, mm, cm, km, ft, in; found 'yd'." in refused(
        SpecError, tmp_path / "a.csv", units="yd"
    )
    for suffix in OUTLINE_FORMATS:
        path = tmp_path / f"a{suffix}"
        assert "must exist" in refused(FormatError, path)
        path.write_bytes(b"")
        assert "is empty" in refused(FormatError, path)
        path.unlink()
        path.mkdir()
        assert "found a folder" in refused(FormatError, path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0\n1,0\na,b\n", "Line 3: a row must be two numbers x, y; found 'a,b'"),
        ("x,y\nx,y\n", "Line 2"),
        ("0,0\n5\n", "Line 2"),
        ("0,0\nnan,1\n", "Line 2"),
        ("0,0\n1e999,1\n", "Line 2"),
        ("x,y\n\n", "must have rows x, y; found none"),
        ("1,1\n2,2\n", "runs back on itself"),
        ("1,1\n", "lies at the point (1, 1)"),
    ],
)
def test_bad_csv(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert message in refused(PqmeshError, path)


def test_csv_has_no_layers_and_is_text(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"0,0\n\xff\xfe\n")
    assert "no layers to select from; found 'roof'" in refused(FormatError, path, "roof")
    assert "UTF-8" in refused(FormatError, path)


def test_bad_dxf(tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf", reason="ezdxf (extra aec) is not installed")
    path = tmp_path / "a.dxf"
    path.write_bytes(b"AC1032\0\0\0")
    assert "found DWG. Save it as DXF." in refused(FormatError, path)
    path.write_text("hello\n" * 20)
    assert "A DXF drawing must be whole" in refused(FormatError, path)
    document = ezdxf.new()
    document.header["$INSUNITS"] = 6
    document.saveas(path)
    assert "must hold a curve; it holds no objects" in refused(FormatError, path)
    space = document.modelspace()
    space.add_text("roof")
    block = document.blocks.new("B")
    block.add_circle((0, 0), 1)
    space.add_blockref("B", (0, 0), dxfattribs={"layer": "Rooms"})
    document.saveas(path)
    assert "it holds 1 text, 1 block instance. Explode" in refused(FormatError, path)
    assert "holds 1 block instance. Explode the blocks" in refused(SpecError, path, "rooms")
    for layer in ("Outline", "Axes"):
        space.add_circle((0, 0), 5, dxfattribs={"layer": layer})
    document.saveas(path)
    text = refused(SpecError, path)
    assert "curves on several layers" in text
    assert "'Outline' (1), 'Axes' (1)" in text
    assert "did you mean 'Outline'?" in refused(SpecError, path, "outlne")
    document.header["$INSUNITS"] = 3
    document.saveas(path)
    assert "found $INSUNITS = 3. Set the drawing unit." in refused(FormatError, path, "Axes")


def test_open_dxf_line_is_refused(tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf", reason="ezdxf (extra aec) is not installed")
    document = ezdxf.new()
    document.modelspace().add_lwpolyline([(0, 0), (4, 0), (4, 3)])
    path = tmp_path / "a.dxf"
    document.saveas(path)
    assert "open at (0, 0), where the nearest other end is 5 away" in refused(SpecError, path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<svg", "An SVG drawing must be whole"),
        ("<html/>", "must begin with <svg>"),
        ("<svg/>", "must hold a curve; it holds no objects"),
        ("<svg xmlns='http://www.w3.org/2000/svg'><text>a</text></svg>", "must hold a curve"),
        (
            "<svg xmlns='http://www.w3.org/2000/svg' width='1mm' viewBox='0 0 0 0'/>",
            "An SVG drawing must be whole",
        ),
        (
            "<!DOCTYPE s [<!ENTITY a 'aaaaaaaaaaaaaaaaaaaa'>"
            + "".join(f"<!ENTITY a{i} '{f'&a{i - 1 if i else str()};' * 20}'>" for i in range(9))
            + "]><svg>&a8;</svg>",
            "An SVG drawing must be whole",
        ),
    ],
)
def test_bad_svg(text: str, message: str, tmp_path: Path) -> None:
    pytest.importorskip("svgelements", reason="svgelements (extra aec) is not installed")
    path = tmp_path / "a.svg"
    path.write_text(text)
    assert message in refused(FormatError, path)


def test_bad_rhino_outline(tmp_path: Path) -> None:
    rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")
    path = tmp_path / "a.3dm"
    path.write_bytes(b"3D Geometry File Format        8")
    assert "it is cut off, damaged or encrypted" in refused(FormatError, path)
    file = rhino3dm.File3dm()
    file.Objects.AddPoint(rhino3dm.Point3d(0, 0, 0))
    file.Write(str(path), 8)
    assert "must hold a curve; it holds 1 point. Export a curve." in refused(FormatError, path)


@pytest.mark.parametrize(
    ("suffix", "module"), [(".dxf", "ezdxf"), (".svg", "svgelements"), (".3dm", "rhino3dm")]
)
def test_missing_library_names_the_extra(
    suffix: str, module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"x")
    monkeypatch.setitem(sys.modules, module, None)
    text = refused(FormatError, path)
    assert f"Reading {suffix} needs the library {module}" in text
    assert "pip install 'pqmesh[aec]'" in text


# --- units ----------------------------------------------------------------------------------


@pytest.mark.parametrize("factor", [1000.0, 700.0, 1 / 1000, 304.8, 1 / 304.8, 25.4, 1 / 25.4, 100])
def test_sizes_of_other_units_are_refused(factor: float) -> None:
    outline = PlanOutline(SQUARE[:-1] * factor)
    with pytest.raises(SpecError, match=r"must fit the surface; .*Say in which unit each is"):
        plausible_units(outline, 10.0)


@pytest.mark.parametrize("factor", [1.0, 0.1, 10.0, 0.06, 15.0, 50.0, 5000.0])
def test_other_sizes_are_plausible(factor: float) -> None:
    plausible_units(PlanOutline(SQUARE[:-1] * factor), 10.0)


# --- fuzz -----------------------------------------------------------------------------------


def seeds() -> dict[str, bytes]:
    csv = b"x,y\n0,0\n10,0\n10,10\n\n2,2\n3,2\n3,3\n"
    svg = b'<svg xmlns="http://www.w3.org/2000/svg" width="9mm" viewBox="0 0 9 9"><g id="a" '
    svg += b'transform="rotate(9)"><path d="M0 0h9v9zM5 2a1 1 0 0 1 2 0z"/></g></svg>'
    parts = ["0", "SECTION", "2", "ENTITIES", "0", "LWPOLYLINE", "8", "0", "90", "3", "70", "1"]
    for x, y in ((0, 0), (4, 0), (4, 3)):
        parts += ["10", f"{x}", "20", f"{y}", "42", "0.5"]
    parts += ["0", "CIRCLE", "8", "0", "10", "3", "20", "1", "40", "0.1", "0", "ENDSEC", "0", "EOF"]
    return {".csv": csv, ".svg": svg, ".dxf": "\n".join(parts).encode()}


@settings(
    max_examples=120,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(st.data())
def test_anything_gives_an_outline_or_one_clear_error(tmp_path: Path, data: st.DataObject) -> None:
    for name in ("ezdxf", "svgelements"):
        pytest.importorskip(name, reason=f"{name} (extra aec) is not installed")
    suffix, text = data.draw(st.sampled_from(sorted(seeds().items())))
    at = data.draw(st.integers(0, len(text)))
    nasty = [b"", b"-", b"nan", b"1e999", b"\0", b"\xff", b"999999999", b"\n", b"<", b"a", b"0"]
    tail = text[at + data.draw(st.integers(0, 5)) :] if data.draw(st.booleans()) else b""
    path = tmp_path / f"fuzz{suffix}"
    path.write_bytes(text[:at] + data.draw(st.sampled_from(nasty)) + tail)
    message = ""
    try:
        read_outline(path, units="m")
    except PqmeshError as error:
        message = str(error)
    assert "\n" not in message
    assert len(message) < 700 + len(str(path))
