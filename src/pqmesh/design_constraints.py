"""The section `constraints` of a design, and the constraints that it asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from pydantic import Field

from pqmesh.design_keys import Length, Number, Part, Truth, Whole
from pqmesh.errors import SpecError
from pqmesh.optimize.constraints import (
    Axis,
    Constraint,
    Constraints,
    Corners,
    Curve,
    EdgeLengths,
    Fixed,
    FlatPolylines,
    Glide,
    Level,
    Mirror,
    PanelSizes,
    Plane,
    Rotation,
    Within,
)
from pqmesh.optimize.selection import GROUPS, Where
from pqmesh.vectors import Floats

Point = tuple[Number, Number, Number]
# Reads a length, named by its key.
Measured = Callable[[Length, str], float]


class RoleSpec(Part):
    """How much a constraint counts."""

    hard: Truth = True
    weight: Number = 1.0


class PlaceSpec(RoleSpec):
    """Vertices: of a group or by number, and by their place."""

    vertices: str | list[Whole] | None = None
    box: tuple[Point, Point] | None = None
    near_level: Length | None = None
    near_curve: list[Point] | None = None
    near: Length | None = None


class CornersSpec(RoleSpec):
    """Corners of the boundary stay."""

    turn_deg: Number = 30.0


class CurveSpec(PlaceSpec):
    """Vertices on a polyline."""

    points: list[Point]


class LevelSpec(PlaceSpec):
    """Vertices at a height."""

    height: Length


class PlaneSpec(PlaceSpec):
    """Vertices in a plane."""

    point: Point
    normal: Point


class MirrorSpec(RoleSpec):
    """The mesh is its own mirror image."""

    point: Point = (0.0, 0.0, 0.0)
    normal: Point
    tolerance: Number | None = None


class RotationSpec(RoleSpec):
    """The mesh is its own image turned."""

    point: Point = (0.0, 0.0, 0.0)
    direction: Point = (0.0, 0.0, 1.0)
    order: Whole
    tolerance: Number | None = None


class AxisSpec(PlaceSpec):
    """Node axes."""

    direction: Point


class EdgeLengthsSpec(PlaceSpec):
    """Edge lengths in a range."""

    least: Length | None = None
    most: Length | None = None
    relative: Truth = False


class PanelSizesSpec(PlaceSpec):
    """Panel sizes in a range."""

    least: Length | None = None
    most: Length | None = None
    measure: str = "width"


class FlatPolylinesSpec(RoleSpec):
    """Polylines each in a plane."""

    polylines: str | list[list[Whole]] = "all"
    through: list[Point] | None = None


class ConstraintsSpec(Part):
    """What is asked of the mesh beside its kind."""

    fixed: list[PlaceSpec] = Field(default_factory=list)
    corners: CornersSpec | None = None
    glide: list[PlaceSpec] = Field(default_factory=list)
    curve: list[CurveSpec] = Field(default_factory=list)
    level: list[LevelSpec] = Field(default_factory=list)
    plane: list[PlaneSpec] = Field(default_factory=list)
    mirror: list[MirrorSpec] = Field(default_factory=list)
    rotation: list[RotationSpec] = Field(default_factory=list)
    axis: list[AxisSpec] = Field(default_factory=list)
    edge_lengths: list[EdgeLengthsSpec] = Field(default_factory=list)
    panel_sizes: list[PanelSizesSpec] = Field(default_factory=list)
    flat_polylines: list[FlatPolylinesSpec] = Field(default_factory=list)
    within: Length | None = None


class ConstraintsFile(Part):
    """A file of constraints beside a mesh."""

    constraints: ConstraintsSpec
    units: str | None = None


def constraints_of(
    spec: ConstraintsSpec, measured: Measured, origin: Floats, *, by_number: bool
) -> Constraints | None:
    """The constraints of a section, about an origin; None of an empty one.

    Parameters
    ----------
    spec : ConstraintsSpec
    measured : callable
        Length in the model unit of a value and its key.
    origin : (3,)
        Subtracted from all places.
    by_number : bool
        Whether vertices may be chosen by number: of a mesh that exists.

    Raises
    ------
    SpecError
        Naming the key.
    """
    parts = list(_parts(spec, _Reader(measured, origin, by_number)))
    return Constraints(tuple(parts)) if parts else None


def _parts(spec: ConstraintsSpec, reader: _Reader) -> Iterator[Constraint]:
    """Constraints in the order of the keys."""
    corners = spec.corners
    if corners is not None:
        turn = math.radians(corners.turn_deg)
        yield _named(
            "constraints.corners", lambda: Corners(turn, hard=corners.hard, weight=corners.weight)
        )
    for name, build in _BUILD.items():
        for number, row in enumerate(getattr(spec, name)):
            key = f"constraints.{name}.{number}"
            role = {"hard": row.hard, "weight": row.weight}
            yield _named(key, lambda: build(row, reader, key, role))  # noqa: B023
    if spec.within is not None:
        distance = reader.measured(spec.within, "constraints.within")
        yield _named("constraints.within", lambda: Within(distance))


def _named(key: str, build: Callable[[], Constraint]) -> Constraint:
    """A constraint; what is wrong with it behind its key."""
    try:
        return build()
    except SpecError as error:
        text = str(error)
        raise SpecError(text if text.startswith(key) else f"{key}: {text}") from None


class _Reader:
    """Lengths, places and selections of the section."""

    def __init__(self, measured: Measured, origin: Floats, by_number: bool) -> None:
        self.measured, self.origin, self.by_number = measured, origin, by_number

    def place(self, point: Point) -> Floats:
        return np.array(point) - self.origin

    def places(self, points: Any) -> Floats:
        return np.array(points, dtype=np.float64).reshape(-1, 3) - self.origin

    def bound(self, value: Length | None, key: str) -> float | None:
        return None if value is None else self.measured(value, key)

    def where(self, row: PlaceSpec, key: str, default: str | None = None) -> Where:
        given = [row.vertices, row.box, row.near_level, row.near_curve]
        if default is None and all(value is None for value in given):
            raise SpecError(
                f"{key}: vertices must be chosen; found no choice. Add vertices = 'boundary' (or "
                f"another of {', '.join(GROUPS)}), a box, near_level or near_curve."
            )
        if isinstance(row.vertices, list) and not self.by_number:
            raise SpecError(
                f"{key}: the vertices of a mesh that is yet to be made have no numbers; found "
                f"{row.vertices!r:.40}. Choose them by group, box, near_level or near_curve."
            )
        among = row.vertices if isinstance(row.vertices, str) else tuple(row.vertices or ())
        level = self.bound(row.near_level, f"{key}.near_level")
        return Where(
            among if row.vertices is not None else default or "all",
            None if row.box is None else self.places(row.box),
            None if level is None else level - float(self.origin[2]),
            None if row.near_curve is None else self.places(row.near_curve),
            self.bound(row.near, f"{key}.near"),
        )


# --- each kind ------------------------------------------------------------------------------

Role = dict[str, Any]


def _flat(row: FlatPolylinesSpec, reader: _Reader, key: str, role: Role) -> Constraint:
    if not isinstance(row.polylines, str) and not reader.by_number:
        raise SpecError(
            f"{key}: the vertices of a mesh that is yet to be made have no numbers; found lists of "
            f"them. Choose polylines by 'all', 'boundary' or through."
        )
    through = None if row.through is None else reader.places(row.through)
    return FlatPolylines(row.polylines, through, **role)


def _sizes(row: PanelSizesSpec, reader: _Reader, key: str, role: Role) -> Constraint:
    plain = "for areas, in the model unit squared" if row.measure == "area" else ""
    least, most = _range(row, reader, key, plain)
    return PanelSizes(least, most, row.measure, reader.where(row, key, "all"), **role)


def _lengths(row: EdgeLengthsSpec, reader: _Reader, key: str, role: Role) -> Constraint:
    plain = "where relative, a share of each edge" if row.relative else ""
    least, most = _range(row, reader, key, plain)
    return EdgeLengths(least, most, reader.where(row, key, "all"), row.relative, **role)


def _range(
    row: PanelSizesSpec | EdgeLengthsSpec, reader: _Reader, key: str, plain: str
) -> tuple[float | None, float | None]:
    """Bounds of a size, as plain numbers where there is a reason for it."""
    for name, value in (("least", row.least), ("most", row.most)):
        if plain and isinstance(value, str):
            raise SpecError(
                f"{key}.{name} must be a plain number {plain}; found {value!r}. Leave the unit out."
            )
    return reader.bound(row.least, f"{key}.least"), reader.bound(row.most, f"{key}.most")


def _partner(row: MirrorSpec | RotationSpec, role: Role) -> Role:
    return role if row.tolerance is None else {**role, "tolerance": row.tolerance}


_BUILD: dict[str, Callable[[Any, _Reader, str, Role], Constraint]] = {
    "fixed": lambda row, reader, key, role: Fixed(reader.where(row, key), **role),
    "glide": lambda row, reader, key, role: Glide(reader.where(row, key, "boundary"), **role),
    "curve": lambda row, reader, key, role: Curve(
        reader.where(row, key), reader.places(row.points), **role
    ),
    "level": lambda row, reader, key, role: Level(
        reader.where(row, key),
        reader.measured(row.height, f"{key}.height") - float(reader.origin[2]),
        **role,
    ),
    "plane": lambda row, reader, key, role: Plane(
        reader.where(row, key), reader.place(row.point), row.normal, **role
    ),
    "mirror": lambda row, reader, key, role: Mirror(
        reader.place(row.point), row.normal, **_partner(row, role)
    ),
    "rotation": lambda row, reader, key, role: Rotation(
        reader.place(row.point), row.direction, row.order, **_partner(row, role)
    ),
    "axis": lambda row, reader, key, role: Axis(reader.where(row, key), row.direction, **role),
    "edge_lengths": _lengths,
    "panel_sizes": _sizes,
    "flat_polylines": _flat,
}
