"""Surfaces typed as formulas: a safe reader of arithmetic, and surfaces with exact jets.

The text is parsed, never executed: a walk over its syntax tree accepts numbers, known names, the
arithmetic operators and calls of known functions, and refuses all else.
"""

from __future__ import annotations

import ast
import difflib
import math
import re
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.surface.base import Domain, Jet
from pqmesh.surface.expression import FUNCTIONS, Graph, JetProgram, Term, jet_program
from pqmesh.vectors import Floats

MAX_LENGTH = 2000
MAX_DEPTH = 200
MAX_NUMBER = 1e100

_OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "**",
}
_ARITY = {
    name: len(function.slopes)
    for name, function in FUNCTIONS.items()
    if name.isalnum() and name != "sign"
}
_NUMBERS = {"pi": math.pi, "e": math.e}
_ALLOWED = (
    "numbers, + - * / **, brackets, pi, e, the variables, the constants and the functions "
    + " ".join(sorted(_ARITY))
)
_STRANGE = re.compile(r"[^A-Za-z0-9_.,()+\-*/ ]")


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Hint "; did you mean ...?" for a misspelt name, or the empty string.

    Examples
    --------
    >>> nearest_name("torsu", ["torus", "sphere"])
    "; did you mean 'torus'?"
    """
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def parse_formula(
    graph: Graph,
    text: str,
    label: str,
    names: Mapping[str, Term | float],
) -> Term:
    """Term of a formula, or a refusal that names the place.

    Parameters
    ----------
    graph : Graph
        Receives the operations.
    text : str
        At most 2000 characters.
    label : str
        What the formula gives, for messages.
    names : mapping
        Meaning of each variable and constant; `pi` and `e` are known besides.

    Raises
    ------
    SpecError
        Naming the column, counted from 1, and what is allowed there.

    Examples
    --------
    >>> graph = Graph()
    >>> parse_formula(graph, "2*cos(0) + h", "z", {"h": 0.5}).value
    2.5
    """
    return _Reader(graph, text, label, names).read()


class _Reader:
    """One walk over the syntax tree of one formula."""

    def __init__(
        self, graph: Graph, text: str, label: str, names: Mapping[str, Term | float]
    ) -> None:
        self.graph = graph
        self.text = text
        self.label = label
        self.names: dict[str, Term | float] = {**_NUMBERS, **names}

    def read(self) -> Term:
        """Check the text, parse it, and translate its tree."""
        if not isinstance(self.text, str):
            raise SpecError(
                f"The formula for {self.label} must be text; found {self.text!r}. "
                "Put it between quotation marks."
            )
        if len(self.text) > MAX_LENGTH:
            raise SpecError(
                f"The formula for {self.label} must have at most {MAX_LENGTH} characters; it "
                f"has {len(self.text)}. Shorten it, for example by named constants."
            )
        plain = re.sub(r"\s", " ", self.text)
        if not plain.strip():
            raise self.refusal("is empty", 0)
        strange = _STRANGE.search(plain)
        if strange:
            hint = "; a power is written **" if strange[0] == "^" else ""
            raise self.refusal(f"has the character {strange[0]!r}{hint}", strange.start())
        return self.term(self.tree(plain), 0)

    def tree(self, plain: str) -> ast.expr:
        """Syntax tree; all that the parser of Python may raise becomes a refusal."""
        indent = len(plain) - len(plain.lstrip())
        try:
            with warnings.catch_warnings():
                # "1if" and the like only warn today; the walk refuses what they mean.
                warnings.simplefilter("ignore")
                return ast.parse(plain.strip(), mode="eval").body
        except SyntaxError as error:
            place = indent + max((error.offset or 1) - 1, 0)
            raise self.refusal("cannot be read", min(place, len(self.text))) from None
        except (ValueError, MemoryError, RecursionError, OverflowError):
            raise self.refusal("is nested too deep or has too long a number", indent) from None

    def term(self, node: ast.expr, depth: int) -> Term:
        """Translate one node of the tree and all below it."""
        if depth > MAX_DEPTH:
            raise self.refusal(f"is nested deeper than {MAX_DEPTH}", self.column(node))
        if isinstance(node, ast.Constant):
            return self.number(node)
        if isinstance(node, ast.Name):
            return self.name(node)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
            inner = self.term(node.operand, depth + 1)
            return -inner if isinstance(node.op, ast.USub) else inner
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            operands = [self.term(node.left, depth + 1), self.term(node.right, depth + 1)]
            return self.checked(self.graph.call(_OPERATORS[type(node.op)], *operands), node)
        if isinstance(node, ast.Call):
            name = self.function(node)
            operands = [self.term(argument, depth + 1) for argument in node.args]
            return self.checked(self.graph.call(name, *operands), node)
        raise self.refusal(f"has {_plain_name(node)}", self.column(node))

    def number(self, node: ast.Constant) -> Term:
        """A literal of moderate size; truth values and imaginary numbers are refused."""
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refusal(f"has {str(value)[:20]}, no real number", self.column(node))
        if abs(value) > MAX_NUMBER:
            raise self.refusal(f"has a number above {MAX_NUMBER:g}", self.column(node))
        return self.graph.constant(float(value))

    def name(self, node: ast.Name) -> Term:
        """A variable or a constant."""
        if node.id not in self.names:
            if node.id in _ARITY:
                raise self.refusal(f"has {node.id} without brackets", self.column(node))
            hint = nearest_name(node.id, self.names)
            raise self.refusal(
                f"has the unknown name {node.id!r}{hint or ';'} known here are "
                + " ".join(sorted(self.names)),
                self.column(node),
            )
        meaning = self.names[node.id]
        return meaning if isinstance(meaning, Term) else self.graph.constant(meaning)

    def function(self, node: ast.Call) -> str:
        """The name of the function called, once its arguments are known to fit."""
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name not in _ARITY:
            what = f"calls {name!r}, no known function" if name else "calls what is no function"
            raise self.refusal(what + nearest_name(name, _ARITY), self.column(node))
        if node.keywords or len(node.args) != _ARITY[name]:
            count = len(node.args) + len(node.keywords)
            raise self.refusal(
                f"gives {name} {count} arguments where it takes {_ARITY[name]}", self.column(node)
            )
        return name

    def checked(self, term: Term, node: ast.expr) -> Term:
        """The term, unless it is a constant that is not finite or absurdly large."""
        if term.value is not None and not abs(term.value) <= MAX_NUMBER:
            raise self.refusal(
                f"has a constant part of value {term.value:g}; it must be finite and below "
                f"{MAX_NUMBER:g}",
                self.column(node),
            )
        return term

    def column(self, node: ast.expr) -> int:
        """Place of a node in the text as typed."""
        return node.col_offset + len(self.text) - len(self.text.lstrip())

    def refusal(self, what: str, place: int) -> SpecError:
        """The error for what was found at a place of the text."""
        shown = self.text if len(self.text) <= 60 else self.text[:57] + "..."
        return SpecError(
            f"The formula for {self.label} {what} (column {place + 1} of {shown!r}). "
            f"Allowed are {_ALLOWED}."
        )


def _plain_name(node: ast.expr) -> str:
    """What a refused piece of syntax is called."""
    names = {"Attribute": "a dot after a name", "Tuple": "a comma outside a function"}
    kind = type(node).__name__
    return names.get(kind, f"an operation of kind {kind}")


def checked_constants(
    constants: Mapping[str, float], variables: tuple[str, str]
) -> dict[str, float]:
    """Constants as floats, in the order given.

    Raises
    ------
    SpecError
        If a name is no identifier or already means something, or a value is not finite.
    """
    taken = {*variables, *_ARITY, *_NUMBERS}
    for name, value in constants.items():
        if not (isinstance(name, str) and name.isascii() and name.isidentifier()):
            raise SpecError(
                f"A constant must be named by ASCII letters, digits and _; found {name!r}. "
                "Rename it."
            )
        if name in taken:
            raise SpecError(
                f"A constant must not take the name of a variable, a function, pi or e; "
                f"found {name!r}. Rename it."
            )
        real = isinstance(value, int | float | np.integer | np.floating)
        if isinstance(value, bool) or not real or not abs(value) <= MAX_NUMBER:
            # Python refuses to print integers of thousands of digits.
            shown = "a longer integer" if type(value) is int else repr(value)[:40]
            raise SpecError(
                f"A constant must be a finite number below {MAX_NUMBER:g}; {name} is {shown}. "
                "Give a number."
            )
    return {name: float(value) for name, value in constants.items()}


@dataclass(frozen=True)
class FormulaSurface:
    """Surface whose coordinates are formulas of two variables.

    Parameters
    ----------
    x, y, z : str
        Formulas of the variables and the constants, model unit.
    domain : Domain
        Range of the variables. State what is periodic; `check_regular` verifies it.
    constants : mapping of str to float
        Named numbers.
    variables : (str, str)
        Names of the two parameters.

    Raises
    ------
    SpecError
        For text that is not such a formula, naming the column.
    SurfaceError
        From `jet`, naming the first parameters where a formula is not finite.

    Examples
    --------
    >>> dome = FormulaSurface("u", "v", "h - u**2 - v**2", Domain((-1, 1), (-1, 1)), {"h": 2.0})
    >>> dome.jet(np.array([[0.5, 0.0]])).du
    array([[ 1.,  0., -1.]])
    """

    x: str
    y: str
    z: str
    domain: Domain
    constants: Mapping[str, float] = field(default_factory=dict)
    variables: tuple[str, str] = ("u", "v")
    _program: JetProgram = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        constants = checked_constants(self.constants, self.variables)
        graph = Graph()
        names: dict[str, Term | float] = {
            **{name: graph.variable(i) for i, name in enumerate(self.variables)},
            **constants,
        }
        x, y, z = (
            parse_formula(graph, text, label, names)
            for label, text in (("x", self.x), ("y", self.y), ("z", self.z))
        )
        object.__setattr__(self, "constants", constants)
        object.__setattr__(self, "_program", jet_program((x, y, z), self.variables))

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet at parameters uv of shape (N, 2)."""
        return self._program.jet(uv)


def graph_surface(
    z: str,
    x: tuple[float, float],
    y: tuple[float, float],
    constants: Mapping[str, float] | None = None,
) -> FormulaSurface:
    """Graph of a height z = f(x, y) over a rectangle of the plane.

    Parameters
    ----------
    z : str
        Formula of x, y and the constants, model unit.
    x, y : (float, float)
        Sides of the rectangle, model unit.
    constants : mapping of str to float, optional
        Named numbers.

    Raises
    ------
    SpecError
        As `FormulaSurface`.

    Examples
    --------
    >>> saddle = graph_surface("x*y", (-1, 1), (-1, 1))
    >>> saddle.jet(np.array([[0.5, 0.5]])).point
    array([[0.5 , 0.5 , 0.25]])
    """
    return FormulaSurface("x", "y", z, Domain(x, y), dict(constants or {}), ("x", "y"))
