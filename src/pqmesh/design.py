"""The design: what a user asks for, read from TOML, checked, and turned into values."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pqmesh.design_text import check_tokens, parse_reason, text_of
from pqmesh.design_words import LENGTH_HINT, LENGTH_WORDS, UNITS, first_message, shown
from pqmesh.errors import FormatError, SpecError
from pqmesh.io.atomic import shown_path
from pqmesh.network.region import PlanOutline
from pqmesh.surface.base import Domain, Surface
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.surface.regular import check_regular, closes

# Larger ones are no designs and no control nets, and would take minutes and gigabytes to parse.
LARGEST_DESIGN, LARGEST_NET = 4_000_000, 8_000_000
# Above this, squares and cubes of lengths leave the range of doubles.
LARGEST_LENGTH = 1e100

_LENGTH = re.compile(r"\s*([-+0-9.eE]+)\s*([a-z]*)\s*")
_ANGLE = re.compile(r"\s*([-+0-9.eE]+)\s*(°|deg|rad)?\s*")

# Strict: a truth value or a text is no number.
Number = Annotated[float, Field(strict=True)]
Whole = Annotated[int, Field(strict=True)]
Truth = Annotated[bool, Field(strict=True)]
Length = Number | str


class _Part(BaseModel):
    """A section of the design: immutable, and strict about its keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class FormulaSpec(_Part):
    """A surface x, y, z of u, v."""

    x: str
    y: str
    z: str
    u: tuple[Number, Number]
    v: tuple[Number, Number]
    constants: dict[str, Number] = Field(default_factory=dict)


class GraphSpec(_Part):
    """A surface z = f(x, y)."""

    z: str
    x: tuple[Number, Number]
    y: tuple[Number, Number]
    constants: dict[str, Number] = Field(default_factory=dict)


class NetSpec(_Part):
    """A control net, in the design or in a JSON file of the same keys."""

    file: str | None = None
    degree: tuple[Whole, Whole] = (3, 3)
    points: list[list[list[Number]]] | None = None
    weights: list[list[Number]] | None = None
    knots: tuple[list[Number], list[Number]] | None = None
    periodic: tuple[Truth, Truth] = (False, False)

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.points is None):
            raise ValueError("a net has either a file or points. Give one of the two")
        return self


class SurfaceSpec(_Part):
    """One surface, given in one way."""

    formula: FormulaSpec | None = None
    graph: GraphSpec | None = None
    net: NetSpec | None = None
    shape: dict[str, Any] | None = None
    file: str | None = None
    select: str | None = None
    units: str = "m"

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        ways = ("formula", "graph", "net", "shape", "file")
        given = [name for name in ways if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "a surface is given in exactly one of the ways formula, graph, net, shape, file; "
                f"found {', '.join(given) or 'none'}. Keep one"
            )
        if self.select is not None:
            raise ValueError(
                f"select chooses an object of a model file, which is not readable yet; found "
                f"{self.select!r}. Leave it out"
            )
        if self.units not in UNITS:
            raise ValueError(
                f"units must be one of {', '.join(UNITS)}; found {self.units!r}. Choose one"
            )
        return self


class OutlineSpec(_Part):
    """Plan polygon that the panels must cover."""

    polygon: list[tuple[Number, Number]]
    holes: list[list[tuple[Number, Number]]] = Field(default_factory=list)


class PanelsSpec(_Part):
    """What panels are wanted."""

    kind: Literal["planar", "conical", "circular"] = "conical"
    edge: Length | tuple[Length, Length]
    network: Literal["principal"] = "principal"
    within: Length | None = None


class BoundarySpec(_Part):
    """What the rim may do during optimisation."""

    mode: Literal["free", "fixed", "glide"] = "free"


class LayersSpec(_Part):
    """Signed offset distances."""

    distances: list[Length] = Field(default_factory=list)


class ToleranceSpec(_Part):
    """What counts as reached; lengths and angles may carry a unit."""

    flat: Length = "0.1 mm"
    offset: Length = "0.1 mm"
    twist: Length = "0.01 deg"
    deviation: Length | None = None
    conical: Number = 1e-6


class OutputSpec(_Part):
    """What is written."""

    formats: tuple[Literal["obj"], ...] = ("obj",)
    figures: Truth = True


class RunSpec(_Part):
    """How it is run."""

    seed: Whole = 0
    most_panels: Whole = Field(default=1_000_000, gt=0)


class Design(_Part):
    """All of a design, as read; `Design.read` and `Design.of` are the doors.

    Examples
    --------
    >>> design = Design.of({"surface": {"shape": {"kind": "torus"}}, "panels": {"edge": 0.3}})
    >>> design.edges, design.panels.kind
    ((0.3, 0.3), 'conical')
    """

    surface: SurfaceSpec
    panels: PanelsSpec
    outline: OutlineSpec | None = None
    boundary: BoundarySpec = Field(default_factory=BoundarySpec)
    layers: LayersSpec = Field(default_factory=LayersSpec)
    tolerance: ToleranceSpec = Field(default_factory=ToleranceSpec)
    output: OutputSpec = Field(default_factory=OutputSpec)
    run: RunSpec = Field(default_factory=RunSpec)

    # --- doors ------------------------------------------------------------------------------

    @classmethod
    def of(cls, table: Mapping[str, Any], where: str = "the design") -> Design:
        """Design of nested tables; raises SpecError with the first thing that is wrong."""
        try:
            design = cls.model_validate(table)
        except ValidationError as error:
            raise SpecError(first_message(error, where, cls)) from None
        try:
            _ = design.edges, design.distances, design.tolerances
        except SpecError as error:
            raise SpecError(f"{where}: {error}") from None
        return design

    @classmethod
    def read(cls, path: str | Path) -> tuple[dict[str, Any], Path]:
        """Tables of a design file, not checked yet, and the folder its files are sought in."""
        text, name = text_of(Path(path), LARGEST_DESIGN), shown_path(Path(path).name)
        check_tokens(text, name)
        try:
            return tomllib.loads(text), Path(path).parent
        except (ValueError, RecursionError) as error:
            raise SpecError(
                f"A design must be a TOML file; {name} is not: {parse_reason(error)}. Mend that "
                f"place."
            ) from None

    # --- values in the model unit -----------------------------------------------------------

    @property
    def units(self) -> str:
        """The model unit."""
        return self.surface.units

    @property
    def edges(self) -> tuple[float, float]:
        """Wanted edge along the lines of larger and of smaller principal curvature."""
        edge = self.panels.edge
        pair = edge if isinstance(edge, tuple) else (edge, edge)
        first, second = (self.length(value, "panels.edge") for value in pair)
        for value in (first, second):
            if value <= 0:
                raise SpecError(
                    f"panels.edge must be above 0; found {value:g}. Give the wanted panel edge."
                )
        return first, second

    @property
    def distances(self) -> list[float]:
        """Layer distances."""
        return [self.length(value, "layers.distances") for value in self.layers.distances]

    @property
    def within(self) -> float | None:
        """Largest allowed distance from the surface, if asked for."""
        if self.panels.within is None:
            return None
        return self._positive(self.panels.within, "panels.within")

    @property
    def tolerances(self) -> dict[str, float]:
        """Tolerances in model units and degrees."""
        asked = self.tolerance
        deviation = self.within or 0.05 * sum(self.edges) / 2
        if asked.deviation is not None:
            deviation = self._positive(asked.deviation, "tolerance.deviation")
        conical = asked.conical
        if conical <= 0:
            raise SpecError(f"tolerance.conical must be above 0; found {conical:g}. Raise it.")
        return {
            "flat": self._positive(asked.flat, "tolerance.flat"),
            "offset": self._positive(asked.offset, "tolerance.offset"),
            "twist": _degrees(asked.twist),
            "deviation": deviation,
            "conical": conical,
        }

    def length(self, value: Length, key: str) -> float:
        """A length in the model unit, from a number or a text such as '0.1 mm'."""
        if not isinstance(value, str):
            number = float(value)
        else:
            match = _LENGTH.fullmatch(value)
            unit = match.group(2) if match else ""
            try:
                number = float(match.group(1)) if match else math.nan
            except ValueError:
                number = math.nan
            if not match or (unit and unit not in UNITS) or math.isnan(number):
                raise SpecError(
                    f"{key} must be {LENGTH_WORDS}; found {shown(value)}. {LENGTH_HINT}"
                )
            number *= UNITS[unit] / UNITS[self.units] if unit else 1.0
        if not abs(number) <= LARGEST_LENGTH:
            raise SpecError(
                f"{key} must be below {LARGEST_LENGTH:g}; found {shown(value)}. Check the units."
            )
        return number

    def _positive(self, value: Length, key: str) -> float:
        number = self.length(value, key)
        if number <= 0:
            raise SpecError(f"{key} must be above 0; found {shown(value)}. Raise it.")
        return number

    # --- objects ----------------------------------------------------------------------------

    def build_surface(self, folder: Path) -> Surface:
        """The surface, checked to be regular; files are sought from the folder."""
        surface = _surface(self.surface, folder)
        check_regular(surface)
        return surface

    def build_outline(self) -> PlanOutline | None:
        """The outline, if any."""
        if self.outline is None:
            return None
        rings = [np.array(ring) for ring in (self.outline.polygon, *self.outline.holes)]
        largest = max(float(np.abs(ring).max(initial=0.0)) for ring in rings)
        if largest > LARGEST_LENGTH:
            raise SpecError(
                f"An outline must stay below {LARGEST_LENGTH:g}; found a coordinate of "
                f"{largest:g}. Check the units."
            )
        return PlanOutline(rings[0], tuple(rings[1:]))


def _surface(spec: SurfaceSpec, folder: Path) -> Surface:
    """Surface of its description."""
    if spec.formula is not None:
        f = spec.formula
        found: Surface = FormulaSurface(f.x, f.y, f.z, Domain(f.u, f.v), f.constants)
        periodic = closes(found)
        if any(periodic):
            found = FormulaSurface(f.x, f.y, f.z, Domain(f.u, f.v, periodic), f.constants)
        return found
    if spec.graph is not None:
        return graph_surface(spec.graph.z, spec.graph.x, spec.graph.y, spec.graph.constants)
    if spec.shape is not None:
        from pqmesh.surface.analytic import shape_surface

        parameters = {key: value for key, value in spec.shape.items() if key != "kind"}
        kind = spec.shape.get("kind", "")
        return shape_surface(kind if isinstance(kind, str) else shown(kind), **parameters)
    net = spec.net or NetSpec(file=spec.file)
    if net.file is not None:
        net = _net_file(folder / net.file)
    knots = None if net.knots is None else (np.array(net.knots[0]), np.array(net.knots[1]))
    return BSplineSurface(
        _rectangular(net.points or [], "points"),
        net.degree,
        knots,
        None if net.weights is None else _rectangular(net.weights, "weights"),
        net.periodic,
    )


def _rectangular(rows: list[Any], name: str) -> Any:
    """Nested lists as an array, refused when ragged."""
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError:
        raise SpecError(
            f"The {name} of a net must form a rectangle; rows differ in length. Complete them."
        ) from None


def _net_file(path: Path) -> NetSpec:
    """Control net of a JSON file."""
    name = shown_path(path.name)
    if path.suffix.lower() != ".json":
        raise FormatError(
            f"A surface file must be a control net in .json; {name} cannot be read yet. Export "
            f"the control points, degrees, knots and weights, or give a formula."
        )
    try:
        table = json.loads(text_of(path, LARGEST_NET))
    except (ValueError, RecursionError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(
            f"{name} must be JSON; it is not: {parse_reason(error)}. Mend it."
        ) from None
    if not isinstance(table, dict):
        raise FormatError(
            f"{name} must hold a JSON object with degree and points; it holds a "
            f"{type(table).__name__}. Mend it."
        )
    if "file" in table:
        raise FormatError(
            f"{name} must hold the control points themselves; it names another file. Name that "
            f"one in the design."
        )
    try:
        return NetSpec.model_validate(table)
    except ValidationError as error:
        raise SpecError(first_message(error, name, NetSpec)) from None


def _degrees(value: Length) -> float:
    """An angle in degrees, from a number of degrees or a text such as '0.01°'."""
    match = _ANGLE.fullmatch(value) if isinstance(value, str) else None
    try:
        number = float(match.group(1) if match else value)
    except ValueError:
        number = math.nan
    if match and match.group(2) == "rad":
        number = math.degrees(number)
    if not 0 < number <= 360:
        raise SpecError(
            f"tolerance.twist must be an angle above 0 such as 0.01 or '0.01 deg'; found "
            f"{shown(value)}. Change it."
        )
    return number
