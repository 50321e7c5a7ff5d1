import contextlib
import math
import time
import warnings

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pqmesh.errors import SpecError, SurfaceError
from pqmesh.surface.base import Domain, Surface
from pqmesh.surface.expression import FUNCTIONS, Graph, jet_program
from pqmesh.surface.formula import MAX_NUMBER, FormulaSurface, graph_surface, parse_formula

BOX = Domain((0.2, 0.8), (0.2, 0.8))
TYPED = """0.3*sin(u*v) + cos(u - v)**3 - tan(v/2) + asin(u*v/2) + acos(v/2) + atan(u/v)
 + atan2(v, u - 1) + sinh(u)*cosh(v) - tanh(u + v) + asinh(u) + acosh(1 + u) + atanh(u*v)
 + exp(-u*v) + log(u + v) + sqrt(u)*abs(v - 2) + hypot(u, v) + u**v + u**-1.5 + 2**u + (-u)**3"""


def typed_in_mpmath(u, v):
    m = mpmath
    return (
        m.mpf("0.3") * m.sin(u * v)
        + m.cos(u - v) ** 3
        - m.tan(v / 2)
        + m.asin(u * v / 2)
        + m.acos(v / 2)
        + m.atan(u / v)
        + m.atan2(v, u - 1)
        + m.sinh(u) * m.cosh(v)
        - m.tanh(u + v)
        + m.asinh(u)
        + m.acosh(1 + u)
        + m.atanh(u * v)
        + m.exp(-u * v)
        + m.log(u + v)
        + m.sqrt(u) * abs(v - 2)
        + m.hypot(u, v)
        + u**v
        + u ** m.mpf("-1.5")
        + m.mpf(2) ** u
        + (-u) ** 3
    )


def test_jet_of_every_function_agrees_with_mpmath():
    used = {name for name in FUNCTIONS if name.isalnum() and name != "sign"}
    assert all(f"{name}(" in TYPED for name in used)
    surface = FormulaSurface("u", "v", TYPED, BOX)
    u, v = 0.37, 0.61
    found = [row[0, 2] for row in surface.jet(np.array([[u, v]]))]
    with mpmath.workdps(40):
        orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
        wanted = [
            float(mpmath.diff(typed_in_mpmath, (mpmath.mpf(u), mpmath.mpf(v)), order))
            if any(order)
            else float(typed_in_mpmath(mpmath.mpf(u), mpmath.mpf(v)))
            for order in orders
        ]
    # A dozen terms of size up to 50: rounding alone.
    assert np.allclose(found, wanted, rtol=1e-13, atol=1e-13)


def test_text_with_u_in_function_names_is_read_as_typed():
    surface = FormulaSurface("u", "v", "h*u - -v", BOX, {"h": 3})
    assert isinstance(surface, Surface)
    assert np.allclose(surface.jet(np.array([[0.5, 0.25]])).point[0], [0.5, 0.25, 1.75], atol=0)


def test_constant_components_broadcast():
    jet = FormulaSurface("u", "v", "2", BOX).jet(np.array([[0.3, 0.4]] * 5))
    assert all(row.shape == (5, 3) for row in jet)
    assert (jet.point[:, 2] == 2.0).all()
    assert (jet.dvv == 0.0).all()


def test_no_points_give_an_empty_jet():
    assert FormulaSurface("u", "v", "u*v", BOX).jet(np.empty((0, 2))).dvv.shape == (0, 3)


def test_long_arrays_are_evaluated_as_short_ones():
    surface = FormulaSurface("u", "v", "sin(u)*v", BOX)
    uv = np.random.default_rng(1).uniform(0.2, 0.8, size=(9001, 2))
    whole, part = surface.jet(uv), surface.jet(uv[8000:])
    assert all((a[8000:] == b).all() for a, b in zip(whole, part, strict=True))


def test_equal_parts_of_formulas_are_computed_once():
    program = FormulaSurface("cos(u)*cos(v)", "sin(u)*cos(v)", "sin(v)", BOX)._program
    names = [name for name, _ in program.steps]
    assert names.count("sin") == 2
    assert names.count("cos") == 2


def test_third_derivatives_by_slopes_of_slopes_are_exact():
    graph = Graph()
    u = graph.variable(0)
    third = graph.slope(graph.slope(graph.slope(u.sin() * u, 0), 0), 0)
    value = jet_program((third, 0.0, 0.0)).jet(np.array([[0.7, 0.0]])).point[0, 0]
    assert value == pytest.approx(-3 * math.sin(0.7) - 0.7 * math.cos(0.7), abs=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("__import__('os')", 'character "\'"'),
        ("__import__(u)", "calls '__import__'"),
        ("u.tofile", "a dot after a name"),
        ("u.__class__", "a dot after a name"),
        ("u[0]", r"character '\['"),
        ("x(", "cannot be read"),
        ("sin(u", "cannot be read"),
        ("u +", "cannot be read"),
        ("u v", "cannot be read"),
        ("", "is empty"),
        ("  \n", "is empty"),
        ("u^2", r"a power is written \*\*"),
        ("1/0", "constant part of value"),
        ("0/0", "constant part of value nan"),
        ("log(0)", "constant part"),
        ("sqrt(-1)", "constant part"),
        ("9**9**9**9", "constant part of value inf"),
        ("u + 10**200", "constant part"),
        ("1" * 400, "number above"),
        ("1e400", "number above"),
        ("u" * 10_000, "at most 2000 characters"),
        ("(" * 150 + "u" + ")" * 150 + "(", "cannot be read"),
        ("+".join(["u"] * 900), "deeper than 200"),
        ("-" * 1500 + "u", "deep"),
        ("sine(u)", "did you mean 'sin'"),
        ("height*u", "did you mean 'hight'"),
        ("sin", "without brackets"),
        ("sin(u, v)", "gives sin 2 arguments where it takes 1"),
        ("atan2(u)", "gives atan2 1 arguments"),
        ("min(u, v)", "calls 'min'"),
        ("sin(*u)", "Starred"),
        ("u if v else 1", "IfExp"),
        ("u and v", "BoolOp"),
        ("not u", "UnaryOp"),
        ("u // v", "BinOp"),
        ("True*u", "no real number"),
        ("2j*u", "no real number"),
        ("u, v", "comma outside a function"),
        ("(u)(v)", "calls 'u'"),
        ("(u + v)(v)", "calls what is no function"),
        ("lambda: u", "character ':'"),
        ("1if u else 2", "IfExp"),
        ("x", "unknown name 'x'"),
    ],
)
def test_formula_refuses_all_but_arithmetic(text, message):
    with pytest.raises(SpecError, match=message) as caught:
        FormulaSurface("u", "v", text, BOX, {"hight": 1.0})
    assert "formula for z" in str(caught.value)


def test_refusal_names_the_column_as_typed():
    with pytest.raises(SpecError, match=r"column 9 of '  1 \+ 2\*hut'"):
        FormulaSurface("u", "v", "  1 + 2*hut", BOX)
    with pytest.raises(SpecError, match="column 5"):
        FormulaSurface("u", "v", "1 + * u", BOX)


def test_formula_refuses_what_is_not_text():
    with pytest.raises(SpecError, match="must be text; found 3"):
        FormulaSurface("u", "v", 3, BOX)


def test_largest_formulas_are_ready_in_a_moment():
    # The rules add a bounded number of operations per operation, so length and depth bound all.
    start = time.perf_counter()
    texts = ["**".join([f"(u+v*{i})"] * 190) for i in (2, 3, 4)]
    assert len(FormulaSurface(*texts, BOX)._program.steps) < 40_000
    assert time.perf_counter() - start < 5.0


@pytest.mark.parametrize(
    ("constants", "message"),
    [
        ({"u": 1.0}, "must not take the name"),
        ({"sin": 1.0}, "must not take the name"),
        ({"pi": 3.0}, "must not take the name"),
        ({"2a": 1.0}, "must be named by"),
        ({"a b": 1.0}, "must be named by"),
        ({"a": math.nan}, "must be a finite number"),
        ({"a": math.inf}, "must be a finite number"),
        ({"a": "1"}, "must be a finite number"),
        ({"a": True}, "must be a finite number"),
        ({"a": 10**5000}, "a longer integer"),
    ],
)
def test_constants_must_be_finite_numbers_with_names_of_their_own(constants, message):
    with pytest.raises(SpecError, match=message):
        FormulaSurface("u", "v", "0*u", BOX, constants)


@pytest.mark.parametrize(
    ("z", "message"),
    [
        ("log(x)", r"the first derivative of z is nan|z is nan|z is -inf"),
        ("1/x", "at x = 0, y = 0.5"),
        ("sqrt(x)", "the first derivative of z is inf at x = 0"),
        ("abs(x)", "the first derivative of z is nan at x = 0"),
        ("x**0.5", "the first derivative of z is inf"),
        ("x**1.5", "the second derivative of z is inf"),
        ("exp(1e9*(y + x))", "z is inf"),
        ("atan2(x, 0)", "derivative of z"),
    ],
)
def test_jet_names_the_first_place_that_is_not_finite(z, message):
    surface = graph_surface(z, (-1, 1), (0, 1))
    with pytest.raises(SurfaceError, match=message):
        surface.jet(np.array([[0.0, 0.5], [-1.0, 0.0]]))


def test_evaluation_gives_no_numpy_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(SurfaceError):
            graph_surface("log(x)/x", (-1, 1), (0, 1)).jet(np.array([[0.0, 0.0]]))


def test_numbers_stay_below_the_limit():
    term = parse_formula(Graph(), "1e99*9", "z", {})
    assert abs(term.value) < MAX_NUMBER


WORDS = st.one_of(
    st.sampled_from(["u", "v", "pi", "e", "k", "9", "1e3", "0", "0.5", "2", "_", ".", "é", "u"]),
    st.sampled_from(["(", ")", ")", "+", "-", "*", "/", "**", "sin(", "log(", "hypot(", ",", " "]),
    st.sampled_from([" if ", " else ", "lambda", "'", "[", "]", ":", "=", "^", "\\", "\n", "\0"]),
)


@settings(max_examples=300, deadline=2000)
@given(st.one_of(st.text(max_size=60), st.lists(WORDS, max_size=30).map("".join)))
def test_any_text_is_a_surface_or_a_clear_refusal(text):
    start = time.perf_counter()
    with contextlib.suppress(SpecError, SurfaceError):
        FormulaSurface("u", "v", text, BOX, {"k": 1.5}).jet(np.array([[0.3, 0.4], [0.5, 0.6]]))
    assert time.perf_counter() - start < 2.0
