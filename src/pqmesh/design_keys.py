"""The sections and keys of a design, with what can be said of each by itself."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from pqmesh.design_words import UNITS

# Strict: a truth value or a text is no number.
Number = Annotated[float, Field(strict=True)]
Whole = Annotated[int, Field(strict=True)]
Truth = Annotated[bool, Field(strict=True)]
Length = Number | str
PlanPoint = tuple[Number, Number]


class Part(BaseModel):
    """A section of the design: immutable, and strict about its keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class FormulaSpec(Part):
    """A surface x, y, z of u, v."""

    x: str
    y: str
    z: str
    u: tuple[Number, Number]
    v: tuple[Number, Number]
    constants: dict[str, Number] = Field(default_factory=dict)


class GraphSpec(Part):
    """A surface z = f(x, y)."""

    z: str
    x: tuple[Number, Number]
    y: tuple[Number, Number]
    constants: dict[str, Number] = Field(default_factory=dict)


class NetSpec(Part):
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


class SurfaceSpec(Part):
    """One surface, given in one way."""

    formula: FormulaSpec | None = None
    graph: GraphSpec | None = None
    net: NetSpec | None = None
    shape: dict[str, Any] | None = None
    file: str | None = None
    select: str | None = None
    units: str | None = None
    extend: Length | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        ways = ("formula", "graph", "net", "shape", "file")
        given = [name for name in ways if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(
                "a surface is given in exactly one of the ways formula, graph, net, shape, file; "
                f"found {', '.join(given) or 'none'}. Keep one"
            )
        if self.select is not None and self.file is None:
            raise ValueError(
                f"select chooses an object or a layer of a surface file; found "
                f"{self.select!r} beside a {given[0]}. Leave it out"
            )
        if self.units is not None and self.units not in UNITS:
            raise ValueError(
                f"units must be one of {', '.join(UNITS)}; found {self.units!r}. Choose one"
            )
        return self


class OutlineSpec(Part):
    """Plan region that the panels must cover: a polygon, or closed curves of a file."""

    file: str | None = None
    select: str | None = None
    polygon: list[PlanPoint] | None = None
    holes: list[list[PlanPoint]] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.file is None) == (self.polygon is None):
            raise ValueError("an outline has either a file or a polygon. Give one of the two")
        if self.file is None and self.select is not None:
            raise ValueError(
                f"select chooses a layer or an object of an outline file; found {self.select!r} "
                f"beside a polygon. Leave it out"
            )
        if self.file is not None and self.holes:
            raise ValueError(
                "the holes of an outline file are the rings inside its largest one; found holes "
                "beside a file. Draw them in the file"
            )
        return self


class CurvesSpec(Part):
    """The family of lines that a conjugate or a geodesic network starts from."""

    direction_deg: Number | None = None
    file: str | None = None
    select: str | None = None
    points: list[list[list[Number]]] | None = None
    through: PlanPoint | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = [
            key for key in ("direction_deg", "file", "points") if getattr(self, key) is not None
        ]
        if len(given) > 1:
            raise ValueError(
                f"a family is given in one of the ways direction_deg, file, points; found "
                f"{', '.join(given)}. Keep one"
            )
        if self.select is not None and self.file is None:
            raise ValueError(
                f"select chooses a layer or an object of a curve file; found {self.select!r} "
                f"without a file. Leave it out"
            )
        return self


class PanelsSpec(Part):
    """What panels are wanted."""

    kind: Literal["planar", "conical", "circular", "conical-circular", "edge-offset"] = "conical"
    edge: Length | tuple[Length, Length]
    network: Literal["principal", "uv", "geodesic", "conjugate"] = "principal"
    curves: CurvesSpec | None = None
    within: Length | None = None
    flat: Length | None = None

    @model_validator(mode="after")
    def _curves_fit(self) -> Self:
        curves = self.curves
        if self.network == "conjugate":
            family = curves and (curves.direction_deg is not None or curves.file or curves.points)
            if not family:
                raise ValueError(
                    "a conjugate network needs the family of lines that is given; found none. Add "
                    "curves = { direction_deg = 0 }, or curves of a file"
                )
            if curves and curves.through is not None:
                raise ValueError(
                    "through belongs to a geodesic network; found it with a conjugate one. Leave "
                    "it out"
                )
        elif self.network == "geodesic":
            if curves and (curves.file or curves.points):
                raise ValueError(
                    "a geodesic network starts from a point (through) and a direction "
                    "(direction_deg); found drawn curves. Leave them out"
                )
        elif curves is not None:
            raise ValueError(
                f"curves belong to a conjugate or geodesic network; found them with network = "
                f"{self.network!r}. Leave them out, or choose that network"
            )
        return self


class BoundarySpec(Part):
    """What the rim may do during optimisation."""

    mode: Literal["free", "fixed", "glide"] = "free"


class LayersSpec(Part):
    """Signed offset distances."""

    distances: list[Length] = Field(default_factory=list)


class ToleranceSpec(Part):
    """What counts as reached; lengths and angles may carry a unit."""

    flat: Length | None = None
    offset: Length = "0.1 mm"
    twist: Length = "0.01 deg"
    deviation: Length | None = None
    deviation_rms: Length | None = None
    area: Number | None = None
    conical: Number = 1e-6
    cover: Number = 1e-6


class OutputSpec(Part):
    """What is written."""

    formats: tuple[Literal["obj"], ...] = ("obj",)
    figures: Truth = True


class RunSpec(Part):
    """How it is run."""

    seed: Whole = 0
    most_panels: Whole = Field(default=1_000_000, gt=0)
