"""The design: what a user asks for, read from TOML, checked, and turned into values."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pqmesh.errors import FormatError, SpecError
from pqmesh.network.region import PlanOutline
from pqmesh.surface.base import Domain, Surface
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.formula import FormulaSurface, graph_surface, nearest_name
from pqmesh.surface.regular import check_regular, closes

# Metres in a unit.
UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": 0.3048, "in": 0.0254}
LARGEST_FILE = 64_000_000

_LENGTH = re.compile(r"\s*([-+0-9.eE]+)\s*([a-z]*)\s*")
_ANGLE = re.compile(r"\s*([-+0-9.eE]+)\s*(°|deg|rad)?\s*")

Length = float | str
Number = float


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
    degree: tuple[int, int] = (3, 3)
    points: list[list[list[Number]]] | None = None
    weights: list[list[Number]] | None = None
    knots: tuple[list[Number], list[Number]] | None = None
    periodic: tuple[bool, bool] = (False, False)

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
        given = [
            name for name in ("formula", "graph", "net", "shape", "file") if getattr(self, name)
        ]
        if len(given) != 1:
            raise ValueError(
                "a surface is given in exactly one of the ways formula, graph, net, shape, file; "
                f"found {', '.join(given) or 'none'}. Keep one"
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
    figures: bool = True


class RunSpec(_Part):
    """How it is run."""

    seed: int = 0
    most_panels: int = Field(default=1_000_000, gt=0)


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
            raise SpecError(_first_message(error, where)) from None
        _ = design.edges, design.distances, design.tolerances
        return design

    @classmethod
    def read(cls, path: str | Path) -> tuple[dict[str, Any], Path]:
        """Tables of a design file, not checked yet, and the folder its files are sought in."""
        text = _text(Path(path))
        try:
            return tomllib.loads(text), Path(path).parent
        except tomllib.TOMLDecodeError as error:
            raise SpecError(
                f"A design must be a TOML file; {Path(path).name} is not: {error}. Mend that place."
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
        deviation = (
            0.05 * sum(self.edges) / 2
            if asked.deviation is None
            else self._positive(asked.deviation, "tolerance.deviation")
        )
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
                    f"{key} must be a length such as 1.5 or '0.1 mm'; found {value!r}. "
                    f"Known units are {', '.join(UNITS)}."
                )
            number *= UNITS[unit] / UNITS[self.units] if unit else 1.0
        if not math.isfinite(number):
            raise SpecError(f"{key} must be finite; found {value}. Give a number.")
        return number

    def _positive(self, value: Length, key: str) -> float:
        number = self.length(value, key)
        if number <= 0:
            raise SpecError(f"{key} must be above 0; found {value!r}. Raise it.")
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
        holes = tuple(np.array(hole) for hole in self.outline.holes)
        return PlanOutline(np.array(self.outline.polygon), holes)


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
        return shape_surface(str(spec.shape.get("kind", "")), **parameters)
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
    if path.suffix.lower() != ".json":
        raise FormatError(
            f"A surface file must be a control net in .json; found {path.name!r}. Export the "
            f"control points, degrees, knots and weights, or give a formula."
        )
    try:
        table = json.loads(_text(path))
    except (json.JSONDecodeError, RecursionError) as error:
        raise FormatError(f"{path.name} must be JSON; it is not: {error}. Mend it.") from None
    if not isinstance(table, dict):
        raise FormatError(
            f"{path.name} must hold a JSON object with degree and points; it holds a "
            f"{type(table).__name__}. Mend it."
        )
    try:
        return NetSpec.model_validate(table)
    except ValidationError as error:
        raise SpecError(_first_message(error, path.name, NetSpec)) from None


def _text(path: Path) -> str:
    """A text file's content, or one clear refusal."""
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise FormatError(
                f"{path.name} must be below {LARGEST_FILE // 1_000_000} MB; it is larger. Is it "
                f"the right file?"
            )
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise FormatError(f"The file {path} must exist; it does not. Check the path.") from None
    except IsADirectoryError:
        raise FormatError(f"{path} must be a file; it is a folder. Name the file.") from None
    except UnicodeDecodeError:
        raise FormatError(
            f"{path.name} must be UTF-8 text; it is not. Is it the right file?"
        ) from None
    except OSError as error:
        raise FormatError(f"{path} must be readable; {error.strerror}. Check its rights.") from None


def _degrees(value: Length) -> float:
    """An angle in degrees, from a number of degrees or a text such as '0.01°'."""
    match = _ANGLE.fullmatch(value) if isinstance(value, str) else None
    try:
        number = float(match.group(1)) if match else float(value)
    except ValueError:
        number = math.nan
    if match and match.group(2) == "rad":
        number = math.degrees(number)
    if not number > 0:
        raise SpecError(
            f"tolerance.twist must be an angle above 0 such as 0.01 or '0.01 deg'; found {value!r}."
        )
    return number


def _first_message(error: ValidationError, where: str, model: type[BaseModel] = Design) -> str:
    """One line for the first thing that is wrong: where, what, and the nearest known key."""
    first = error.errors()[0]
    path = [str(step) for step in first["loc"]]
    key = ".".join(path)
    if first["type"] == "extra_forbidden":
        known = _known_keys(model, path[:-1])
        hint = nearest_name(path[-1], known)
        return f"{where}: {key} is not a known key{hint}. Known here: {', '.join(sorted(known))}."
    if first["type"] == "missing":
        return f"{where}: {key} must be given; it is missing. Add it."
    message = first["msg"].removeprefix("Value error, ").rstrip(".")
    found = "" if first["type"] == "value_error" else f"; found {str(first['input'])[:60]!r}"
    return f"{where}: {key or 'design'}: {message}{found}."


def _known_keys(model: type[BaseModel], path: list[str]) -> list[str]:
    """Keys of the section that a path leads to."""
    for step in path:
        field = model.model_fields.get(step)
        inner = field.annotation if field else None
        parts = [inner, *getattr(inner, "__args__", ())]
        nested = [p for p in parts if isinstance(p, type) and issubclass(p, BaseModel)]
        if not nested:
            break
        model = nested[0]
    return list(model.model_fields)
