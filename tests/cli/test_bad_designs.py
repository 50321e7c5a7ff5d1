"""Designs, nets and options that are wrong: code 2, one line, nothing touched."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pqmesh.design import Design
from pqmesh.errors import FormatError, NetworkError, SpecError, SurfaceError
from pqmesh.source import opened

Refused = Callable[..., str]
TORUS = 'shape = {kind = "torus"}'
NET = [[[i, j, 0.25 * i * j] for j in range(4)] for i in range(4)]


def design(surface: str = TORUS, panels: str = "edge = 0.9", rest: str = "") -> str:
    return f"[surface]\n{surface}\n[panels]\n{panels}\n[output]\nfigures = false\n{rest}\n"


@pytest.fixture
def message(tmp_path: Path, refused: Refused) -> Callable[[str], str]:
    """The line about a design; an earlier result stands beside it and stays."""
    earlier = tmp_path / "out"
    earlier.mkdir()
    (earlier / "mesh.obj").write_text("an earlier result")
    (earlier / "report.json").write_text("{}")

    def run(text: str | bytes, *options: str) -> str:
        raw = text if isinstance(text, bytes) else text.encode()
        (tmp_path / "roof.toml").write_bytes(raw)
        return refused("panelize", "roof.toml", "-o", "out", *options)

    return run


# --- formulas -------------------------------------------------------------------------------

FORMULAS = {
    "__import__('os')": 'character "\'" (column 12',
    "1/0": "must be finite",
    "x(": "cannot be read (column 2",
    "9**9**9**9": "must be finite",
    "x" * 10_000: "at most 2000 characters; it has 10000",
    "+" * 1900 + "x": "nested",
    "print(x)": "calls 'print', no known function",
    "open": "unknown name 'open'",
    "eval": "unknown name 'eval'",
    "x.real": "a dot after a name",
    "nan": "unknown name 'nan'",
    "1e400*x": "a number above 1e+100",
    "1e308*x": "a number above 1e+100",
    "lambda": "cannot be read (column 1",
    "x if y else 1": "IfExp",
    "2j*x": "no real number",
    "": "is empty",
    "x; y": "character ';'",
    "x^2": "a power is written **",
    "sine(x)": "did you mean 'sin",
    "atan2(x)": "1 arguments where it takes 2",
    "sqrt(x)": "z is nan at x = -1",
    "1/x": "z is inf at x = 0",
    "abs(x)": "the first derivative of z is nan at x = 0",
    "exp(exp(exp(9*x)))": "z is inf at x =",
}


@pytest.mark.parametrize("formula", FORMULAS, ids=lambda text: text[:16])
def test_text_that_is_no_formula_is_refused_with_its_place(
    message: Callable[[str], str], formula: str
) -> None:
    graph = f"graph = {{z = {json.dumps(formula)}, x = [-1, 1], y = [-1, 1]}}"
    assert FORMULAS[formula] in message(design(graph, "edge = 0.3"))


# --- surfaces -------------------------------------------------------------------------------

SURFACES = {
    'shape = {kind = "sphere", v = [-1.5707963267948966, 1.5]}': "this is a pole",
    'formula = {x="u*cos(v)", y="u*sin(v)", z="u**2", u=[0,1], v=[0,6]}': "this is a pole",
    'formula = {x="u**3", y="v", z="u**3*v", u=[-1,1], v=[-1,1]}': "have a normal everywhere; at",
    'formula = {x="0", y="0", z="0", u=[-1,1], v=[-1,1]}': "have a normal everywhere; at",
    'formula = {x="u", y="0", z="0", u=[-1,1], v=[-1,1]}': "tangent to each other",
    'shape = {kind = "sphere", radius = 2.0}': "a plane or a sphere has no principal",
    'graph = {z = "x + y", x = [0, 3], y = [0, 3]}': "a plane or a sphere has no principal",
    'graph = {z = "x*y", x = [0, 1e300], y = [0, 1]}': "below 1e+150 everywhere; at u =",
    'graph = {z = "x*y", x = [1, 0], y = [0, 1]}': "from 1.0 to 0.0",
    'graph = {z = "x*y", x = [0, nan], y = [0, 1]}': "surface.graph.x.1 must be a finite number",
    'graph = {z = "x*y", x = [0, 1, 2], y = [0, 1]}': "surface.graph.x must be a list of two",
    'graph = {z = "x*y", x = "all", y = [0, 1]}': "surface.graph.x must be a list; found 'all'",
    "graph = {z = 3, x = [0, 1], y = [0, 1]}": "surface.graph.z must be text; found 3",
    'graph = {z = "x*y"}': "surface.graph.x must be given",
    'graph = {z = "c*x*y", x=[0,1], y=[0,1], constants = {c = nan}}': "c must be a finite number",
    'graph = {z = "c*x*y", x=[0,1], y=[0,1], constants = {c = 1e308}}': "c is 1e+308",
    'graph = {z = "x*y", x=[0,1], y=[0,1], constants = {pi = 3}}': "found 'pi'",
    "shape = {R = 3}": "kind of a shape must be known; found ''",
    "shape = {}": "kind of a shape must be known",
    "shape = 3": "surface.shape must be a table",
    'shape = {kind = "torsu"}': "did you mean 'torus'?",
    'shape = {kind = ["torus"]}': "kind of a shape must be known",
    'shape = {kind = "torus", Q = 1}': "no parameter 'Q'",
    'shape = {kind = "torus", R = nan}': "R a finite number; found nan",
    'shape = {kind = "torus", R = 1e308}': "R a finite number; found 1e+308",
    'shape = {kind = "torus", R = 1e60}': "extent between 1e-50 and 1e+50",
    'shape = {kind = "torus", R = "3"}': "R a finite number; found 3",
    'shape = {kind = "torus", R = 1, r = 2}': "0 < r < R; found (1, 2)",
    'shape = {kind = "torus", u = [0, nan]}': "u must be a range",
    'shape = {kind = "torus"}\nunits = "furlong"': "units must be one of m, mm, cm, km, ft, in",
    'shape = {kind = "torus"}\nunits = 3': "surface.units must be text; found 3",
    'shape = {kind = "torus"}\nselect = "roof"': "select chooses an object",
    'shape = {kind = "torus"}\ngraph = {z="x*y", x=[0,1], y=[0,1]}': "found graph, shape",
    'units = "m"': "found none",
    'file = "roof.3dm"': "roof.3dm: the file must exist; found none",
    'net = {file = "none.json"}': "none.json must exist",
    'net = {file = "\\u0000.json"}': ".json",
    "net = {}": "either a file or points",
    'net = {file = "a.json", points = []}': "either a file or points",
    "net = {points = [[[nan, 0, 0]]]}": "points.0.0.0 must be a finite number",
    "net = {points = [[[0, 0, 0]], [[0, 0, 0], [1, 0, 0]]]}": "rows differ in length",
}


@pytest.mark.parametrize("surface", SURFACES, ids=lambda text: text[:50])
def test_surface_without_sense_is_refused(
    message: Callable[[str], str], tmp_path: Path, surface: str
) -> None:
    assert SURFACES[surface] in message(design(surface, "edge = 0.3"))


PANELS = {
    "edge = 0": "above 0; found 0",
    "edge = -1": "above 0; found -1",
    "edge = nan": "a length such as 1.5 or '0.1 mm', or a list of two; found nan",
    "edge = inf": "or a list of two; found inf",
    "edge = 1e308": "panels.edge must be below 1e+100",
    "edge = 100": "must be shorter than the roof; found 100 for a roof of extent 11.45",
    "edge = 1e-3": "at most 1000000 panels; edges of 0.001 and 0.001",
    "edge = 1e-300": "at most 1000000 panels",
    "edge = [1e-3, 1]": "at most 4000 lines",
    "edge = [1, 2, 3]": "or a list of two; found [1, 2, 3]",
    "edge = []": "or a list of two; found []",
    "edge = [0.5, -1]": "above 0; found -1",
    "edge = true": "or a list of two; found True",
    'edge = "abc m"': "panels.edge must be a length such as 1.5 or '0.1 mm'; found 'abc m'",
    'edge = "5 parsec"': "Known units are m, mm, cm, km, ft, in",
    'edge = "1e999 m"': "below 1e+100",
    "edge = 1979-05-27": "found datetime.date",
    "edge = " + "9" * 400: "a number of more than 60 digits",
    "edge = " + "9" * 5000: "numbers of at most 1000 digits",
    "egde = 1": "panels.egde is not a known key; did you mean 'edge'?",
    "": "panels.edge must be given",
    'edge = 1\nkind = "conic"': "'circular', 'conical-circular' or 'edge-offset'; found 'conic'",
    'edge = 1\nnetwork = "curved"': "'geodesic' or 'conjugate'; found 'curved'",
    'edge = 1\nnetwork = "conjugate"': "needs the family of lines that is given; found none",
    "edge = 1\ncurves = {direction_deg = 1}": "curves belong to a conjugate or geodesic network",
    'edge = 1\nnetwork = "conjugate"\ncurves = {direction_deg = 1, file = "a.dxf"}': "Keep one",
    'edge = 1\nnetwork = "conjugate"\ncurves = {direction = 1}': "did you mean 'direction_deg'?",
    "edge = 1\nflat = -1": "panels.flat must be above 0",
    'edge = 1\nnetwork = "geodesic"\ncurves = {points = [[[0, 0], [1, 0]]]}': (
        "panels: a geodesic network starts from a point"
    ),
    "edge = 1\nwithin = 0": "panels.within must be above 0",
    "edge = 1\nwithin = nan": "panels.within must be a length",
    'edge = 1\n"a\\u001b[31mb\\n" = 2': "panels.'a\\x1b[31mb\\n' is not a known key",
}


@pytest.mark.parametrize("panels", PANELS, ids=lambda text: text[:30])
def test_panels_without_sense_are_refused(message: Callable[[str], str], panels: str) -> None:
    assert PANELS[panels] in message(design(panels=panels))


SECTIONS = {
    "[pannels]\nedge = 1": "pannels is not a known key; did you mean 'panels'?",
    "[layers]\ndistances = 'x'": "layers.distances must be a list; found 'x'",
    "[layers]\ndistances = ['x']": "layers.distances must be a length",
    "[layers]\ndistances = [nan]": "layers.distances.0 must be a length",
    "[layers]\ndistances = [1e308]": "layers.distances must be below 1e+100",
    "[layers]\ndistances = [true]": "layers.distances.0 must be a length",
    "[tolerance]\nflta = 1": "tolerance.flta is not a known key; did you mean 'flat'?",
    "[tolerance]\nflat = 0": "tolerance.flat must be above 0",
    "[tolerance]\nflat = nan": "tolerance.flat must be a length",
    "[tolerance]\ntwist = '1 m'": "tolerance.twist must be an angle",
    "[tolerance]\ntwist = inf": "tolerance.twist must be an angle",
    "[tolerance]\ntwist = 'inf'": "tolerance.twist must be an angle",
    "[tolerance]\ntwist = '1e999'": "tolerance.twist must be an angle",
    "[tolerance]\nconical = -1": "tolerance.conical must be above 0",
    "[boundary]\nmode = 'loose'": "boundary.mode must be 'free', 'fixed' or 'glide'",
    "[run]\nseed = 1.5": "run.seed must be a whole number",
    "[run]\nmost_panels = 0": "run.most_panels must be above 0",
    "[run]\nmost_panels = 10": "at most 10 panels",
    "[outline]\npolygon = [[50,50],[60,50],[60,60]]": "outline must lie over the surface",
    "[outline]\npolygon = [[0,0],[1,1]]": "at least three points",
    "[outline]\npolygon = [[0,0],[1,1],[2,2]]": "must enclose area",
    "[outline]\npolygon = [[0,0],[1,nan],[2,2]]": "outline.polygon.1.1 must be a finite number",
    "[outline]\npolygon = [[-9,-9],[1e308,-9],[9,1e308]]": "must stay below 1e+100",
    "[outline]\npolygon = 3": "outline.polygon must be a list",
    "[outline]\nfile = 'site.dxf'": "site.dxf: the file must exist; found none",
    "[outline]\npolygon = [[0,0],[1,0],[0,1]]\nfile = 'site.dxf'": "either a file or a polygon",
    "[outline]\nholes = []": "either a file or a polygon",
    "[outline]\nfile = 'site.pdf'": "must be one of .dxf, .svg, .3dm, .csv; found '.pdf'",
    "[tolerance]\ncover = 0": "tolerance.cover must be above 0",
}


@pytest.mark.parametrize("section", SECTIONS, ids=lambda text: text[:40].replace("\n", " "))
def test_section_without_sense_is_refused(message: Callable[[str], str], section: str) -> None:
    assert SECTIONS[section] in message(design(rest=section))


TEXTS = {
    "empty": (b"", "must not be empty"),
    "blank": (b" \n\n", "must not be empty"),
    "cut short": (design().encode()[:18], "is not: "),
    "binary": (b"\x00\xff\xfe", "must be UTF-8 text"),
    "section is a number": (b"panels = 3\n[surface]\nshape = {}", "panels must be a table of keys"),
    "section is a list": (b"surface = []\n[panels]\nedge = 1", "surface must be a table of keys"),
    "no surface": (b"[panels]\nedge = 1", "surface must be given"),
    "brackets": (b"a = " + b"[" * 20_000, "nested too deep"),
    "braces": (b"a = " + b"{a = " * 20_000, "nested too deep"),
    "dotted key": (b"[" + b"a." * 200_000 + b"a]", "too many dots"),
    "many dotted keys": ((b"a." * 900 + b"a = 1\n") * 400, "too many dots"),
    "deep value": (b"[surface]\nshape=" + b"[" * 300 + b"]" * 300, "surface.shape must be a table"),
    "too large": (b"#" * 4_100_000, "must be below 4 MB"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_text_that_is_no_design_is_refused(message: Callable[[bytes], str], name: str) -> None:
    text, expected = TEXTS[name]
    assert expected in message(text)


# --- nets -----------------------------------------------------------------------------------


def net_text(**changes: object) -> str:
    return json.dumps({"degree": [3, 3], "points": NET} | changes)


def with_corner(corner: str) -> str:
    return net_text().replace("[3, 3, 2.25]", f"[3, 3, {corner}]")


NETS = {
    "empty": ("", "must not be empty"),
    "cut short": (net_text()[:60], "must be JSON; it is not"),
    "nan": (with_corner("NaN"), "points.3.3.2 must be a finite number; found nan"),
    "infinite": (with_corner("1e400"), "points.3.3.2 must be a finite number; found inf"),
    "huge": (with_corner("1e300"), "must stay below 1e+150 everywhere; at u ="),
    "ragged": (net_text(points=[NET[0], NET[1][:2], *NET[2:]]), "rows differ in length"),
    "list": ("[1, 2]", "it holds a list"),
    "brackets": ("[" * 100_000, "nested too deep"),
    "braces": ('{"points":' * 3000, "nested too deep"),
    "digits": ('{"degree": [3, 3], "points": ' + "9" * 5000 + "}", "thousands of digits"),
    "high degree": (net_text(degree=[10**30, 3]), "control points; found 4"),
    "broken degree": (net_text(degree=[2.5, 3]), "degree.0 must be a whole number"),
    "degree 0": (net_text(degree=[0, 3]), "at least 1"),
    "degree 1": (net_text(degree=[1, 3]), "degree 1 has a crease"),
    "plane points": (net_text(points=[[[0, 0], [1, 1]]]), "shape (n, m, 3); found (1, 2, 2)"),
    "no points": (net_text(points=[]), "shape (n, m, 3); found (0,)"),
    "one place": (net_text(points=[[[0, 0, 0]] * 4] * 4), "must have a normal everywhere"),
    "negative weight": (net_text(weights=[[-1] * 4] * 4), "weight [0, 0] is -1"),
    "huge weights": (net_text(weights=[[1e308] * 4] * 4), "must be finite everywhere"),
    "few weights": (net_text(weights=[[1] * 4] * 3), "shape (4, 4); found (3, 4)"),
    "few knots": (net_text(knots=[[0, 1], [0, 1]]), "need 8 knots"),
    "falling knots": (net_text(knots=[[1] * 4 + [0] * 4, [0] * 4 + [1] * 4]), "must not decrease"),
    "misspelt": ('{"pionts": []}', "pionts is not a known key; did you mean 'points'?"),
    "another file": ('{"file": "net.json"}', "it names another file"),
    "utf-16": (net_text().encode("utf-16"), "must be UTF-8 text"),
}


@pytest.mark.parametrize("name", NETS)
def test_file_that_is_no_net_is_refused(tmp_path: Path, refused: Refused, name: str) -> None:
    text, expected = NETS[name]
    (tmp_path / "net.json").write_bytes(text if isinstance(text, bytes) else text.encode())
    line = refused("panelize", "net.json", "-o", "out", "--edge", "0.6")
    assert expected in line
    (tmp_path / "roof.toml").write_text(design('net = {file = "net.json"}', "edge = 0.6"))
    assert refused("panelize", "roof.toml", "-o", "out") == line


# --- inputs, outputs and options --------------------------------------------------------------

INPUTS = {
    "none.toml": "none.toml must exist",
    "none.json": "none.json must exist",
    "none.3dm": "none.3dm must exist",
    "model.3dm": "Add --edge LENGTH",
    "model.obj": "must be a design (.toml), a Rhino model (.3dm), or a control net",
    "model": "found 'no suffix'",
    "folder": "found a folder",
    "folder.toml": "it is a folder",
    "folder.json": "found a folder",
    "net.json": "Add --edge LENGTH",
    "new\nline.toml": "must exist",
}


@pytest.mark.parametrize("name", INPUTS)
def test_input_that_cannot_be_read_is_refused(tmp_path: Path, refused: Refused, name: str) -> None:
    for folder in ("folder", "folder.toml", "folder.json"):
        (tmp_path / folder).mkdir()
    for file in ("model.3dm", "model.obj", "model"):
        (tmp_path / file).write_bytes(b"model")
    (tmp_path / "net.json").write_text(net_text())
    assert INPUTS[name] in refused("panelize", name, "-o", "out")


def test_bad_group_of_real_files_is_no_surface(data_folder: Path, refused: Refused) -> None:
    for name in ("QuadMesh.off", "suzanne.ply", "faces_reversed.obj", "joined_tetrahedra.obj"):
        assert "a surface must be a design" in refused(
            "panelize", data_folder / name, "--edge", "1"
        )


OPTIONS = {
    ("--edge", "nan"): "roof.toml with --edge: panels.edge must be a length",
    ("--edge", "1,2,3"): "found [1.0, 2.0, 3.0]",
    ("--edge", ""): "found []",
    ("--edge", "0.6,"): "found ''",
    ("--edge", "-1"): "above 0; found -1",
    ("--layers", "0.1,,x"): "layers.distances must be a length such as 1.5 or '0.1 mm'; found ''",
    ("--layers", "x"): "found 'x'",
    ("--layers", "inf"): "layers.distances.0 must be a length",
    ("--tolerance", "flat"): "must be KEY=VALUE; found 'flat'",
    ("--tolerance", "flat="): "must be KEY=VALUE",
    ("--tolerance", "foo=1"): "with --tolerance foo: tolerance.foo is not a known key",
    ("--tolerance", "flat=nan"): "tolerance.flat must be a length",
    ("--units", "furlong"): "found 'furlong'",
    ("--units", ""): "found ''",
    ("--within", "nan"): "with --within: panels.within must be a length",
    ("--within", "-1"): "above 0",
    (
        "--kind",
        "conic",
    ): "'conic' is not one of 'planar', 'conical', 'circular', 'conical-circular', ",
    ("--boundary", "loose"): "'loose' is not one of",
    ("--network", "curved"): "'curved' is not one of",
    ("--seed", "x"): "'--seed'",
    ("--frob",): "No such option: --frob",
    ("--edge",): "requires an argument",
    ("more.toml",): "extra argument",
}


@pytest.mark.parametrize("options", OPTIONS, ids=" ".join)
def test_option_without_sense_is_refused(
    message: Callable[..., str], options: tuple[str, ...]
) -> None:
    assert OPTIONS[options] in message(design(), *options)


def test_flag_allows_many_panels_but_not_more_lines_than_a_network_holds(
    message: Callable[..., str],
) -> None:
    flag = message(design(), "--edge", "1e-3", "--allow-many")
    assert "at most 4000 lines in a family" in flag


@pytest.mark.parametrize("output", ["roof.toml", "roof.toml/out", "roof.toml/a/b"])
def test_output_at_or_below_a_file_is_refused_before_the_work(
    tmp_path: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch, output: str
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("the work began")

    monkeypatch.setattr("pqmesh.job.trace_network", never)
    (tmp_path / "roof.toml").write_text(design())
    line = refused("panelize", "roof.toml", "-o", output)
    assert "results must go to a folder" in line
    assert "is a file" in line


def test_missing_command_and_misspelt_command_are_one_line(refused: Refused) -> None:
    assert "did you mean 'panelize'?" in refused("panelise").lower()
    assert "'INPUT'" in refused("panelize")


# --- random tables --------------------------------------------------------------------------

NUMBERS = st.one_of(st.integers(-3, 3), st.floats(), st.sampled_from([10**400, 1e308, -1e-320]))
SCRAPS = st.one_of(
    NUMBERS,
    st.text(max_size=5),
    st.booleans(),
    st.none(),
    st.sampled_from(["torus", "1 m", "u*v", "x", "conical", "free", "m", "net.json"]),
)
VALUES = st.recursive(
    SCRAPS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=8,
)
KNOWN = {
    "surface": ["formula", "graph", "net", "shape", "file", "units", "select"],
    "panels": ["kind", "edge", "network", "within"],
    "outline": ["polygon", "holes"],
    "boundary": ["mode"],
    "layers": ["distances"],
    "tolerance": ["flat", "offset", "twist", "deviation", "conical", "cover"],
    "output": ["formats", "figures"],
    "run": ["seed", "most_panels"],
}
INNER = ["kind", "R", "r", "u", "v", "x", "y", "z", "points", "degree", "weights", "knots", "file"]
TABLES = st.fixed_dictionaries(
    {
        "surface": st.one_of(
            st.just({"shape": {"kind": "torus"}}),
            st.fixed_dictionaries(
                {},
                optional={
                    key: st.one_of(VALUES, st.dictionaries(st.sampled_from(INNER), VALUES))
                    for key in KNOWN["surface"]
                },
            ),
        ),
        "panels": st.one_of(
            st.just({"edge": 0.9}), st.dictionaries(st.sampled_from(KNOWN["panels"]), VALUES)
        ),
    },
    optional={
        name: st.one_of(st.dictionaries(st.sampled_from(KNOWN[name]), VALUES, max_size=3), VALUES)
        for name in ("outline", "boundary", "layers", "tolerance", "output", "run")
    },
)


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(table=TABLES)
def test_random_tables_give_a_surface_or_a_refusal_of_one_line(table: dict[str, object]) -> None:
    try:
        opened(Design.of(table), Path("no such folder"))
    except (SpecError, SurfaceError, NetworkError, FormatError) as error:
        text = " ".join(str(error).split())
        assert text
        assert len(text) < 700
