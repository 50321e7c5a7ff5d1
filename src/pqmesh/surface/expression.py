"""Smooth expressions in two variables: shared nodes, exact derivatives, fast evaluation.

An expression is a row of a `Graph`, in which equal rows are stored once. The derivative rules
therefore add a bounded number of rows for each row: second derivatives cost no more than
forward-mode differentiation, and terms that vanish are never computed.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from pqmesh.errors import SurfaceError
from pqmesh.surface.base import Jet
from pqmesh.vectors import Floats

# Points evaluated at once: the intermediate columns of a block stay in the processor's cache.
BLOCK = 4096

Operand: TypeAlias = "Term | float"


class Graph:
    """Table of the distinct rows (operation, arguments) of some expressions."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, tuple[Any, ...]]] = []
        self._index: dict[tuple[str, tuple[Any, ...]], int] = {}
        self._slopes: dict[tuple[int, int], Term] = {}

    def variable(self, place: int) -> Term:
        """Term of the first (0) or second (1) variable."""
        return self._row("variable", (place,))

    def constant(self, value: float) -> Term:
        """Term of a number."""
        return self._row("constant", (float(value),))

    def call(self, name: str, *operands: Operand) -> Term:
        """Term of a function or an operator; constant parts are computed at once."""
        terms = [a if isinstance(a, Term) else self.constant(a) for a in operands]
        values = [t.value for t in terms]
        if all(value is not None for value in values):
            with np.errstate(all="ignore"):
                return self.constant(float(FUNCTIONS[name].value(*map(np.float64, values))))
        short = _shortened(name, terms, values)
        return self._row(name, tuple(t.index for t in terms)) if short is None else short

    def slope(self, term: Term, place: int) -> Term:
        """Derivative of a term by the first (0) or second (1) variable."""
        # Arguments stand before their users, so one pass upwards meets known slopes only.
        for i in sorted(_reached(self.rows, [term.index])):
            if (i, place) not in self._slopes:
                self._slopes[i, place] = self._slope_of_row(i, place)
        return self._slopes[term.index, place]

    def _slope_of_row(self, i: int, place: int) -> Term:
        """Chain rule over the arguments of one row."""
        name, arguments = self.rows[i]
        if name in ("constant", "variable"):
            return self.constant(float(name == "variable" and arguments[0] == place))
        inner = [self._slopes[j, place] for j in arguments]
        terms = [Term(self, j) for j in arguments]
        total = self.constant(0.0)
        for position, slope in enumerate(inner):
            if slope.value != 0.0:
                total = total + FUNCTIONS[name].slopes[position](*terms) * slope
        return total

    def _row(self, name: str, arguments: tuple[Any, ...]) -> Term:
        key = (name, arguments)
        if key not in self._index:
            self._index[key] = len(self.rows)
            self.rows.append(key)
        return Term(self, self._index[key])


@dataclass(frozen=True, eq=False)
class Term:
    """One expression of a graph, with the operators of arithmetic."""

    graph: Graph
    index: int

    @property
    def value(self) -> float | None:
        """The number this term is, or None if it depends on the variables."""
        name, arguments = self.graph.rows[self.index]
        return float(arguments[0]) if name == "constant" else None

    def __add__(self, other: Operand) -> Term:
        return self.graph.call("+", self, other)

    def __radd__(self, other: Operand) -> Term:
        return self.graph.call("+", other, self)

    def __sub__(self, other: Operand) -> Term:
        return self.graph.call("-", self, other)

    def __rsub__(self, other: Operand) -> Term:
        return self.graph.call("-", other, self)

    def __mul__(self, other: Operand) -> Term:
        return self.graph.call("*", self, other)

    def __rmul__(self, other: Operand) -> Term:
        return self.graph.call("*", other, self)

    def __truediv__(self, other: Operand) -> Term:
        return self.graph.call("/", self, other)

    def __rtruediv__(self, other: Operand) -> Term:
        return self.graph.call("/", other, self)

    def __pow__(self, other: Operand) -> Term:
        return self.graph.call("**", self, other)

    def __neg__(self) -> Term:
        return self.graph.call("*", -1.0, self)

    def __getattr__(self, name: str) -> Callable[..., Term]:
        """A function of the table applied to this term: `a.sin()` is sin(a)."""
        if name not in FUNCTIONS:
            raise AttributeError(name)
        return lambda *others: self.graph.call(name, self, *others)


@dataclass(frozen=True)
class Function:
    """How to compute a function, and its derivative by each argument as a term."""

    value: Callable[..., Any]
    slopes: tuple[Callable[..., Operand], ...]


def _power_by_base(a: Term, b: Term) -> Term:
    return b * a ** (b - 1.0)


FUNCTIONS: dict[str, Function] = {
    "+": Function(operator.add, (lambda a, b: 1.0, lambda a, b: 1.0)),
    "-": Function(operator.sub, (lambda a, b: 1.0, lambda a, b: -1.0)),
    "*": Function(operator.mul, (lambda a, b: b, lambda a, b: a)),
    "/": Function(operator.truediv, (lambda a, b: 1.0 / b, lambda a, b: -a / (b * b))),
    "**": Function(operator.pow, (_power_by_base, lambda a, b: a**b * a.log())),
    "sin": Function(np.sin, (lambda a: a.cos(),)),
    "cos": Function(np.cos, (lambda a: -a.sin(),)),
    "tan": Function(np.tan, (lambda a: 1.0 + a.tan() ** 2.0,)),
    "asin": Function(np.arcsin, (lambda a: 1.0 / (1.0 - a * a).sqrt(),)),
    "acos": Function(np.arccos, (lambda a: -1.0 / (1.0 - a * a).sqrt(),)),
    "atan": Function(np.arctan, (lambda a: 1.0 / (1.0 + a * a),)),
    "atan2": Function(
        np.arctan2, (lambda a, b: b / (a * a + b * b), lambda a, b: -a / (a * a + b * b))
    ),
    "sinh": Function(np.sinh, (lambda a: a.cosh(),)),
    "cosh": Function(np.cosh, (lambda a: a.sinh(),)),
    "tanh": Function(np.tanh, (lambda a: 1.0 - a.tanh() ** 2.0,)),
    "asinh": Function(np.arcsinh, (lambda a: 1.0 / (1.0 + a * a).sqrt(),)),
    "acosh": Function(np.arccosh, (lambda a: 1.0 / (a * a - 1.0).sqrt(),)),
    "atanh": Function(np.arctanh, (lambda a: 1.0 / (1.0 - a * a),)),
    "exp": Function(np.exp, (lambda a: a.exp(),)),
    "log": Function(np.log, (lambda a: 1.0 / a,)),
    "sqrt": Function(np.sqrt, (lambda a: 0.5 / a.sqrt(),)),
    "hypot": Function(np.hypot, (lambda a, b: a / a.hypot(b), lambda a, b: b / a.hypot(b))),
    "abs": Function(np.abs, (lambda a: a.sign(),)),
    # 0/0 at a crease is meant: there the surface has no tangent plane and must be refused.
    "sign": Function(lambda a: a / np.abs(a), (lambda a: 0.0,)),
}


def _shortened(name: str, terms: list[Term], values: list[float | None]) -> Term | None:
    """An equal, simpler term for the neutral elements and for small powers."""
    if len(terms) != 2:
        return None
    (a, b), (a_value, b_value) = terms, values
    if name == "+" and 0.0 in values:
        return b if a_value == 0.0 else a
    if name == "-" and b_value == 0.0:
        return a
    if name == "*" and (0.0 in values or 1.0 in values):
        return a.graph.constant(0.0) if 0.0 in values else (b if a_value == 1.0 else a)
    if name == "/" and b_value == 1.0:
        return a
    if name == "**":
        powers = {0.0: lambda: a.graph.constant(1.0), 1.0: lambda: a, 2.0: lambda: a * a}
        powers[3.0] = lambda: a * a * a
        return powers[b_value]() if b_value in powers else None
    return None


def _reached(rows: Sequence[tuple[str, tuple[Any, ...]]], roots: Sequence[int]) -> set[int]:
    """Indices of all rows that the roots need."""
    reached: set[int] = set()
    waiting = list(roots)
    while waiting:
        i = waiting.pop()
        if i not in reached:
            reached.add(i)
            if rows[i][0] not in ("constant", "variable"):
                waiting.extend(rows[i][1])
    return reached


@dataclass(frozen=True)
class JetProgram:
    """The jets of three coordinate expressions, ready to be evaluated.

    Parameters
    ----------
    steps : tuple of (operation, arguments)
        In order; an argument is the number of an earlier step.
    outputs : tuple of int
        Steps of the six derivatives, in the order of `Jet`, for each of x, y, z in turn.
    variables : (str, str)
        Names of the parameters, for messages.

    Examples
    --------
    >>> graph = Graph()
    >>> u, v = graph.variable(0), graph.variable(1)
    >>> program = jet_program((u, v, u * v.sin()))
    >>> program.jet(np.array([[2.0, 0.0]])).duv
    array([[0., 0., 1.]])
    """

    steps: tuple[tuple[str, tuple[Any, ...]], ...]
    outputs: tuple[int, ...]
    variables: tuple[str, str]

    def jet(self, uv: Floats) -> Jet:
        """Jet at uv of shape (N, 2); raises SurfaceError at the first value not finite."""
        uv = np.asarray(uv, dtype=np.float64)
        rows = np.empty((6, len(uv), 3))
        for start in range(0, len(uv), BLOCK):
            self._fill(uv[start : start + BLOCK], rows[:, start : start + BLOCK])
        # One sum finds out cheaply that all is well; an overflowing sum only costs a closer look.
        with np.errstate(all="ignore"):
            well = np.isfinite(rows.sum())
        if not (well or np.isfinite(rows).all()):
            self._refuse(uv, rows)
        return Jet(*rows)

    def _fill(self, uv: Floats, rows: Floats) -> None:
        """Evaluate all steps at a block of parameters."""
        columns = (np.ascontiguousarray(uv[:, 0]), np.ascontiguousarray(uv[:, 1]))
        values: list[Any] = []
        with np.errstate(all="ignore"):
            for name, arguments in self.steps:
                if name == "constant":
                    values.append(arguments[0])
                elif name == "variable":
                    values.append(columns[arguments[0]])
                else:
                    values.append(FUNCTIONS[name].value(*(values[i] for i in arguments)))
        for place, step in enumerate(self.outputs):
            rows[place % 6, :, place // 6] = values[step]

    def _refuse(self, uv: Floats, rows: Floats) -> None:
        """Raise for the first point that is not finite."""
        bad = ~np.isfinite(rows)
        first = int(np.argmax(bad.any(axis=(0, 2))))
        order, axis = (int(i[0]) for i in np.nonzero(bad[:, first]))
        what = ("", "the first derivative of ", "the second derivative of ")[
            (order > 0) + (order > 2)
        ]
        u, v = self.variables
        raise SurfaceError(
            f"A formula must be finite and smooth on its whole domain; {what}{'xyz'[axis]} is "
            f"{rows[order, first, axis]} at {u} = {uv[first, 0]:.6g}, {v} = {uv[first, 1]:.6g}. "
            "Change the formula, or narrow the domain."
        )


def jet_program(
    terms: tuple[Operand, Operand, Operand], variables: tuple[str, str] = ("u", "v")
) -> JetProgram:
    """Program that computes a point and its first and second derivatives."""
    graph = next(term.graph for term in terms if isinstance(term, Term))
    outputs: list[int] = []
    for operand in terms:
        x = operand if isinstance(operand, Term) else graph.constant(operand)
        by_u, by_v = graph.slope(x, 0), graph.slope(x, 1)
        second = (graph.slope(by_u, 0), graph.slope(by_u, 1), graph.slope(by_v, 1))
        outputs += [term.index for term in (x, by_u, by_v, *second)]
    order = sorted(_reached(graph.rows, outputs))
    place = {old: new for new, old in enumerate(order)}
    steps = []
    for i in order:
        name, arguments = graph.rows[i]
        leaf = name in ("constant", "variable")
        steps.append((name, arguments if leaf else tuple(place[j] for j in arguments)))
    return JetProgram(tuple(steps), tuple(place[i] for i in outputs), variables)
