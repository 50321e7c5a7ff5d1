"""The design: what a user asks for, read from TOML, checked, and turned into values."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field, ValidationError

from pqmesh.design_constraints import ConstraintsFile, ConstraintsSpec, constraints_of
from pqmesh.design_keys import (
    BoundarySpec,
    LayersSpec,
    Length,
    OutlineSpec,
    OutputSpec,
    PanelsSpec,
    Part,
    RunSpec,
    SurfaceSpec,
    ToleranceSpec,
)
from pqmesh.design_text import DesignText, Where, check_tokens, key_lines, parse_reason, text_of
from pqmesh.design_words import UNITS, first_message, length_in, shown
from pqmesh.errors import SpecError
from pqmesh.io.atomic import shown_path
from pqmesh.optimize.constraints import Constraints
from pqmesh.vectors import Floats

# Larger ones are no designs, and would take minutes and gigabytes to parse.
LARGEST_DESIGN = 4_000_000
DEFAULT_FLAT = "0.1 mm"
# Relative change of the area by the optimisation.
AREA = 0.03

_ANGLE = re.compile(r"\s*([-+0-9.eE]+)\s*(°|deg|rad)?\s*")


class Design(Part):
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
    constraints: ConstraintsSpec = Field(default_factory=ConstraintsSpec)
    layers: LayersSpec = Field(default_factory=LayersSpec)
    tolerance: ToleranceSpec = Field(default_factory=ToleranceSpec)
    output: OutputSpec = Field(default_factory=OutputSpec)
    run: RunSpec = Field(default_factory=RunSpec)

    # --- doors ------------------------------------------------------------------------------

    @classmethod
    def of(cls, table: Mapping[str, Any], where: str | Where = "the design") -> Design:
        """Design of nested tables; raises SpecError with the first thing that is wrong.

        Parameters
        ----------
        table : mapping
        where : str or Where
            What to call the source in messages, with the lines of its keys where they are known.
        """
        place = where if isinstance(where, Where) else Where(where)
        try:
            design = cls.model_validate(table)
        except ValidationError as error:
            raise SpecError(first_message(error, place, cls)) from None
        design.check_values(place)
        return design

    @classmethod
    def read(cls, path: str | Path) -> DesignText:
        """Tables of a design file, not checked yet, with its folder and the lines of its keys."""
        text, name = text_of(Path(path), LARGEST_DESIGN), shown_path(Path(path).name)
        check_tokens(text, name)
        try:
            tables = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise SpecError(
                f"A design must be a TOML file; {name} is not: {parse_reason(error)}. Mend that "
                f"place."
            ) from None
        return DesignText(tables, Path(path).parent, Where(name, key_lines(text)))

    def check_values(self, place: Where) -> None:
        """Nothing, once all lengths, angles and the keys beside each other make sense."""
        try:
            _ = self.edges, self.distances, self.tolerances, self.extend
            _ = self.constraints_about(np.zeros(3))
            self._check_together()
        except SpecError as error:
            raise SpecError(place.of_message(str(error))) from None

    def in_units(self, units: str) -> Design:
        """The same design in a model unit that a file brings."""
        surface = self.surface.model_copy(update={"units": units})
        return self.model_copy(update={"surface": surface})

    # --- values in the model unit -----------------------------------------------------------

    @property
    def units(self) -> str:
        """The model unit; metres where nothing says another."""
        return self.surface.units or "m"

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
    def flat(self) -> float:
        """How far panels may be out of plane: 0, or what the mode `flat` allows."""
        return 0.0 if self.panels.flat is None else self._positive(self.panels.flat, "panels.flat")

    @property
    def extend(self) -> float:
        """How far the surface is continued beyond its bounds."""
        if self.surface.extend is None:
            return 0.0
        return self._positive(self.surface.extend, "surface.extend")

    @property
    def tolerances(self) -> dict[str, float]:
        """Tolerances in model units and degrees."""
        asked = self.tolerance
        deviation = self.within or 0.05 * sum(self.edges) / 2
        if asked.deviation is not None:
            deviation = self._positive(asked.deviation, "tolerance.deviation")
        # The largest distance decides, where nothing else is said.
        near = max(0.1 * sum(self.edges) / 2, deviation)
        if asked.deviation_rms is not None:
            near = self._positive(asked.deviation_rms, "tolerance.deviation_rms")
        for key in ("area", "conical", "cover"):
            value = getattr(asked, key)
            if value is not None and value <= 0:
                raise SpecError(f"tolerance.{key} must be above 0; found {value:g}. Raise it.")
        flat = max(self.flat, self.length(DEFAULT_FLAT, "tolerance.flat"))
        if asked.flat is not None:
            flat = self._positive(asked.flat, "tolerance.flat")
        return {
            "flat": flat,
            "offset": self._positive(asked.offset, "tolerance.offset"),
            "twist": _degrees(asked.twist),
            "deviation": deviation,
            "conical": asked.conical,
            "cover": asked.cover,
            "deviation_rms": near,
            "area": AREA if asked.area is None else asked.area,
        }

    def constraints_about(self, origin: Floats) -> Constraints | None:
        """What is asked of the mesh beside its kind, places counted from an origin (3,)."""
        return constraints_of(self.constraints, self.length, origin, by_number=False)

    def _check_together(self) -> None:
        """Refuse keys that contradict each other."""
        tolerances = self.tolerances
        given = {
            "panels.flat": bool(self.flat),
            f"boundary.mode = {self.boundary.mode!r}": self.boundary.mode != "free",
            "constraints": self.constraints != ConstraintsSpec(),
        }
        if self.panels.kind == "edge-offset" and any(given.values()):
            found = next(key for key, is_given in given.items() if is_given)
            raise SpecError(
                f"panels.kind = 'edge-offset' fits a flat mesh with a free boundary; found "
                f"{found} beside it. Leave that out, or choose another kind."
            )
        if self.flat > tolerances["flat"]:
            raise SpecError(
                f"panels.flat must not allow more than tolerance.flat accepts; found "
                f"{shown(self.panels.flat)} and {shown(self.tolerance.flat)}. Raise the tolerance, "
                f"or leave it out."
            )
        if self.within is not None and self.within > tolerances["deviation"]:
            raise SpecError(
                f"panels.within must not ask for less than tolerance.deviation accepts; found "
                f"{shown(self.panels.within)} and {shown(self.tolerance.deviation)}. Make them "
                f"equal, or leave one out."
            )

    def length(self, value: Length, key: str) -> float:
        """A length in the model unit, from a number or a text such as '0.1 mm'."""
        return length_in(self.units, value, key)

    def _positive(self, value: Length, key: str) -> float:
        number = self.length(value, key)
        if number <= 0:
            raise SpecError(f"{key} must be above 0; found {shown(value)}. Raise it.")
        return number


def read_constraints(path: str | Path) -> Constraints:
    """The constraints in a file of their own, for a mesh that exists.

    Parameters
    ----------
    path : str or path
        A .toml with the section `constraints` of a design and, for lengths with a unit, the key
        `units`: the unit of the mesh.

    Raises
    ------
    PqmeshError
        Naming the file, the line and the key.
    """
    text = Design.read(path)
    try:
        file = ConstraintsFile.model_validate(text.tables)
    except ValidationError as error:
        raise SpecError(first_message(error, text.where, ConstraintsFile)) from None
    if file.units is not None and file.units not in UNITS:
        raise SpecError(
            f"{text.where.at(('units',))}: units must be one of {', '.join(UNITS)}; found "
            f"{shown(file.units)}. Choose one."
        )
    try:
        found = constraints_of(
            file.constraints,
            lambda value, key: length_in(file.units, value, key),
            np.zeros(3),
            by_number=True,
        )
    except SpecError as error:
        raise SpecError(text.where.of_message(str(error))) from None
    if found is None:
        raise SpecError(
            f"{text.where.name}: a file of constraints must have some; found none. Add one, or "
            f"leave the file out."
        )
    return found


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
