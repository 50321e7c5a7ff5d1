"""What a designer asks of a mesh beside its kind: values, each checked by itself."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from pqmesh.errors import SpecError
from pqmesh.optimize.given import (
    above_zero,
    direction,
    finite_point,
    finite_points,
    frozen_points,
    whole_numbers,
)
from pqmesh.optimize.selection import CORNER_TURN, Selection, Where, as_where
from pqmesh.vectors import Floats

MEASURES = ("width", "area")
# A vertex counts as the partner of another within this share of the mean edge.
PARTNER = 0.25
LARGEST_ORDER = 1000


@dataclass(frozen=True)
class Constraint:
    """What all constraints have.

    Attributes
    ----------
    hard : bool
        Hard ones are met to rounding error, soft ones as well as these allow.
    weight : float
        On the mean square of residuals in mean edges (or radians): no unit.

    Raises
    ------
    SpecError
        When the weight is not a finite number above 0, or a value is out of range.
    """

    name: ClassVar[str]
    # Fields that are points, or selections that may hold some.
    _places: ClassVar[tuple[str, ...]] = ()
    _: KW_ONLY
    hard: bool = True
    weight: float = 1.0

    def __post_init__(self) -> None:
        above_zero(self.weight, f"The weight of a constraint ({self.name})")

    def about(self, origin: Floats) -> Self:
        """The same with places counted from an origin (3,)."""
        moved: dict[str, Any] = {}
        for key in self._places:
            value = getattr(self, key)
            if isinstance(value, Where):
                moved[key] = value.about(origin)
            elif value is not None:
                moved[key] = np.asarray(value) - origin
        return replace(self, **moved)


@dataclass(frozen=True)
class _OnVertices(Constraint):
    """A constraint of chosen vertices."""

    _places: ClassVar[tuple[str, ...]] = ("vertices",)

    vertices: Selection

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "vertices", as_where(self.vertices))


@dataclass(frozen=True)
class Fixed(_OnVertices):
    """Vertices stay where they are."""

    name: ClassVar[str] = "fixed"


@dataclass(frozen=True)
class Corners(Constraint):
    """Corners of the boundary, where it turns by more than an angle in radians, stay."""

    name: ClassVar[str] = "corners"

    turn: float = CORNER_TURN

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.turn < math.pi:
            raise SpecError(
                f"The turn of a corner must be an angle from 0 to below 180 degrees; found "
                f"{math.degrees(self.turn):g}. Mend it."
            )


@dataclass(frozen=True)
class Glide(_OnVertices):
    """Boundary vertices move along the boundary curve of the start; its corners stay."""

    name: ClassVar[str] = "glide"

    vertices: Selection = "boundary"


@dataclass(frozen=True)
class Curve(_OnVertices):
    """Vertices lie on a polyline (n, 3), closed where its ends coincide; model unit."""

    name: ClassVar[str] = "curve"
    _places: ClassVar[tuple[str, ...]] = ("vertices", "curve")

    curve: Any

    def __post_init__(self) -> None:
        super().__post_init__()
        points = finite_points(self.curve, "A curve for vertices", least=2)
        if (np.abs(np.diff(points, axis=0)).max(axis=1) == 0).any():
            raise SpecError(
                "The points of a curve must differ from one to the next; found two equal ones. "
                "Leave one out."
            )
        _set(self, "curve", frozen_points(points))


@dataclass(frozen=True)
class Plane(_OnVertices):
    """Vertices lie in a plane."""

    name: ClassVar[str] = "plane"
    _places: ClassVar[tuple[str, ...]] = ("vertices", "point")

    point: Any
    normal: Any

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "point", finite_point(self.point, "The point of a plane"))
        _set(self, "normal", direction(self.normal, "The normal of a plane"))


@dataclass(frozen=True)
class Level(_OnVertices):
    """Vertices lie at a height z."""

    name: ClassVar[str] = "level"

    height: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isfinite(self.height):
            raise SpecError(f"The height of a level must be finite; found {self.height}. Mend it.")

    def about(self, origin: Floats) -> Self:
        """The same with places counted from an origin (3,)."""
        return replace(super().about(origin), height=self.height - float(origin[2]))


@dataclass(frozen=True)
class Mirror(Constraint):
    """The mesh is its own mirror image in a plane.

    Partners are found at the start, within a share `tolerance` of the mean edge.
    """

    name: ClassVar[str] = "mirror"
    _places: ClassVar[tuple[str, ...]] = ("point",)

    point: Any
    normal: Any
    tolerance: float = PARTNER

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "point", finite_point(self.point, "The point of a mirror"))
        _set(self, "normal", direction(self.normal, "The normal of a mirror"))
        above_zero(self.tolerance, "The tolerance of a mirror")


@dataclass(frozen=True)
class Rotation(Constraint):
    """The mesh is its own image under a rotation by a full turn over `order`."""

    name: ClassVar[str] = "rotation"
    _places: ClassVar[tuple[str, ...]] = ("point",)

    point: Any
    direction: Any
    order: int
    tolerance: float = PARTNER

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "point", finite_point(self.point, "The point of a rotation"))
        _set(self, "direction", direction(self.direction, "The direction of a rotation"))
        above_zero(self.tolerance, "The tolerance of a rotation")
        whole = isinstance(self.order, int) and not isinstance(self.order, bool)
        if not (whole and 2 <= self.order <= LARGEST_ORDER):
            raise SpecError(
                f"The order of a rotation must be a whole number from 2 to {LARGEST_ORDER}; found "
                f"{self.order!r}. Mend it."
            )


@dataclass(frozen=True)
class Axis(_OnVertices):
    """The faces at a vertex touch a cone about a given direction: the node's axis."""

    name: ClassVar[str] = "axis"

    direction: Any

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "direction", direction(self.direction, "An axis of nodes"))


@dataclass(frozen=True)
class _Sized(Constraint):
    """Bounds for a size."""

    least: float | None = None
    most: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.least is None and self.most is None:
            raise SpecError(f"{self.name}: a range needs least or most; found neither. Give one.")
        for value in (self.least, self.most):
            if value is not None:
                above_zero(value, f"A bound of {self.name}")
        if self.least is not None and self.most is not None and self.least > self.most:
            raise SpecError(
                f"{self.name}: least must not exceed most; found {self.least:g} and "
                f"{self.most:g}. Exchange them, or widen the range."
            )


@dataclass(frozen=True)
class EdgeLengths(_Sized):
    """Edges between chosen vertices have a length in a range.

    Attributes
    ----------
    least, most : float, optional
        Model unit; shares of each edge's own start length where `relative`.
    """

    name: ClassVar[str] = "edge lengths"
    _places: ClassVar[tuple[str, ...]] = ("vertices",)

    vertices: Selection = "all"
    relative: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "vertices", as_where(self.vertices))


@dataclass(frozen=True)
class PanelSizes(_Sized):
    """Panels between chosen vertices have a size in a range.

    Attributes
    ----------
    measure : 'width' (both means of opposite edges, model unit) or 'area' (model unit squared)
    """

    name: ClassVar[str] = "panel sizes"
    _places: ClassVar[tuple[str, ...]] = ("vertices",)

    measure: str = "width"
    vertices: Selection = "all"

    def __post_init__(self) -> None:
        super().__post_init__()
        _set(self, "vertices", as_where(self.vertices))
        if self.measure not in MEASURES:
            raise SpecError(
                f"The measure of panels must be one of {', '.join(MEASURES)}; found "
                f"{self.measure!r}. Choose one."
            )


@dataclass(frozen=True)
class Within(Constraint):
    """Every vertex stays within a distance of the reference surface, model unit."""

    name: ClassVar[str] = "within"

    distance: float

    def __post_init__(self) -> None:
        super().__post_init__()
        above_zero(self.distance, "The distance from the surface")
        if not self.hard:
            raise SpecError(
                "A distance from the surface is a bound, so it is hard; found hard = false. Leave "
                "it out: closeness is a soft goal of every problem."
            )


@dataclass(frozen=True)
class FlatPolylines(Constraint):
    """Polylines of the mesh, each in a plane of its own: beams cut from one plate.

    Attributes
    ----------
    polylines : 'all', 'boundary' or lists of vertices
        All polylines of the mesh, those along the boundary, or given chains of at least four
        different vertices.
    through : points (n, 3), optional
        Instead: the polylines of the mesh that pass nearest to these points.
    """

    name: ClassVar[str] = "flat polylines"
    _places: ClassVar[tuple[str, ...]] = ("through",)

    polylines: Any = "all"
    through: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.through is not None:
            points = finite_points(self.through, "Points on polylines")
            _set(self, "through", frozen_points(points))
        if isinstance(self.polylines, str):
            if self.polylines not in ("all", "boundary"):
                raise SpecError(
                    f"Polylines must be 'all', 'boundary' or lists of vertices; found "
                    f"{self.polylines!r}. Choose one."
                )
            return
        chains = tuple(whole_numbers(row, "vertices") for row in self.polylines)
        short = [chain for chain in chains if len(set(chain)) < 4]
        if short or not chains:
            raise SpecError(
                f"A polyline to be flat must have at least four different vertices; found "
                f"{list(short[0]) if short else 'none'}. Three points always lie in a plane."
            )
        _set(self, "polylines", chains)


@dataclass(frozen=True)
class Constraints:
    """Constraints of one mesh, in any order.

    Examples
    --------
    >>> wanted = Constraints((Level("corners", 0.0), Mirror((0, 0, 0), (1, 0, 0))))
    >>> [part.name for part in wanted.parts]
    ['level', 'mirror']
    """

    parts: tuple[Constraint, ...]

    def __post_init__(self) -> None:
        _set(self, "parts", tuple(self.parts))
        for part in self.parts:
            if not isinstance(part, Constraint):
                raise SpecError(
                    f"A constraint must be a value of this module, such as Level; found "
                    f"{type(part).__name__}. Use one of them."
                )

    def about(self, origin: Floats) -> Constraints:
        """The same with places counted from an origin (3,)."""
        return Constraints(tuple(part.about(origin) for part in self.parts))


def _set(part: Any, key: str, value: Any) -> None:
    """A value of a frozen dataclass in its checked form."""
    object.__setattr__(part, key, value)
