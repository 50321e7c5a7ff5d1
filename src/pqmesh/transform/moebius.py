"""Moebius transformations of points, spheres and circles: circles go to circles."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from pqmesh.errors import FormatError, MeshError
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.transform.circular import Circles, MoebiusImage, moebius_image
from pqmesh.transform.json_text import numbers, table_from_json
from pqmesh.transform.lie import LIE, LieTransform, checked_matrix, lie_coordinates, trusted
from pqmesh.vectors import Floats, dot, norm, read_only, unit

# Signature (4, 1): Lie coordinates without the radius.
MOEBIUS = read_only(LIE[:5, :5])
# Below this share of its largest possible size the image of infinity counts as infinity.
AT_INFINITY = 1e-14

_KEYS = {
    "matrix": "5 x 5 numbers",
    "inversions": "a list of {center, radius}, the first one applied first",
}
_INVERSION_KEYS = {"center": "3 numbers", "radius": "a number above 0"}


class Pieces(NamedTuple):
    """x -> end + linear (x - pole)/|x - pole|^2, or end + linear x without a pole.

    Attributes
    ----------
    linear : (3, 3)
        A rotation or reflection times a number above 0.
    end : (3,), model unit
        Where infinity goes; without a pole, where the origin goes.
    pole : (3,) or None, model unit
        What goes to infinity.
    """

    linear: Floats
    end: Floats
    pole: Floats | None


@dataclass(frozen=True, eq=False)
class MoebiusTransform:
    """A Moebius transformation of space: a similarity, or one after an inversion.

    Parameters
    ----------
    matrix : (5, 5)
        A with A' M A = M, M = diag(-1, 1, 1, 1, 1), on ((1 + x^2)/2, (1 - x^2)/2, x). A and -A
        are the same.
    known : Pieces, optional
        The same in space, where it is known: then no digits are lost far from the origin.

    Raises
    ------
    MeshError
        When the matrix does not keep the metric; names the error.

    References: [thesis] section 5.4; errata page, E22, E31.

    Examples
    --------
    >>> turned = MoebiusTransform.inversion([0, 0, 0], 2.0)
    >>> turned.on_points(np.array([[1.0, 0.0, 0.0], [0.0, 8.0, 0.0]]))
    array([[4. , 0. , 0. ],
           [0. , 0.5, 0. ]])
    """

    matrix: Floats
    known: Pieces | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", checked_matrix(self.matrix, MOEBIUS, "Moebius"))

    @cached_property
    def pieces(self) -> Pieces:
        """The transformation in space: pole, image of infinity, and the part between."""
        return _pieces(self.matrix) if self.known is None else self.known

    # --- generators -------------------------------------------------------------------------

    @classmethod
    def inversion(cls, center: ArrayLike, radius: float) -> Self:
        """The inversion x -> c + radius^2 (x - c)/|x - c|^2 about a center (3,)."""
        c = np.asarray(center, dtype=np.float64)
        if c.shape != (3,) or not np.isfinite(c).all():
            raise MeshError(
                f"The center of an inversion must be 3 finite numbers; found {c.tolist()}. Mend it."
            )
        if not 0 < radius < np.inf:
            raise MeshError(
                f"The radius of an inversion must be a number above 0; found {radius!r}. Raise it."
            )
        mirror = lie_coordinates(np.append(c, radius))[:5] / radius
        matrix = np.eye(5) - 2.0 * np.outer(mirror, MOEBIUS @ mirror)
        return cls(matrix, Pieces(radius**2 * np.eye(3), c, c))

    @classmethod
    def random(cls, rng: np.random.Generator, size: float = 0.3) -> Self:
        """Exponential of a random element of the Lie algebra, with entries of about `size`."""
        square = size * rng.normal(size=(5, 5))
        return cls(expm(MOEBIUS @ (square - square.T)))

    # --- the group --------------------------------------------------------------------------

    def __matmul__(self, other: MoebiusTransform) -> Self:
        """First `other`, then this one."""
        pieces = _composed(self.pieces, other.pieces)
        return trusted(type(self), matrix=self.matrix @ other.matrix, known=pieces)

    @cached_property
    def inverse(self) -> Self:
        """The transformation that undoes this one."""
        linear, end, pole = self.pieces
        square = float(np.abs(np.linalg.det(linear))) ** (2.0 / 3.0)
        # linear = s Q: the inverse of x/|x|^2 is itself, so s Q' comes out in both cases.
        back = linear.T if pole is not None else linear.T / square
        start = pole if pole is not None else -(back @ end)
        pieces = Pieces(back, start, end if pole is not None else None)
        return trusted(type(self), matrix=MOEBIUS @ self.matrix.T @ MOEBIUS, known=pieces)

    @property
    def pole(self) -> Floats | None:
        """The point (3,) that goes to infinity; None for a similarity."""
        return self.pieces.pole

    @property
    def keeps_orientation(self) -> bool:
        """Whether right hands stay right hands; inversions do not keep it."""
        is_proper = np.linalg.det(self.pieces.linear) > 0
        return bool(is_proper) == (self.pieces.pole is None)

    @cached_property
    def lie(self) -> LieTransform:
        """A Lie sphere transformation that does the same to points, and keeps radius signs.

        References: errata page, E22: the other one turns every sphere over.
        """
        sign = np.sign((self.matrix[0] + self.matrix[1]) @ self._witness)
        matrix = np.eye(6)
        matrix[:5, :5] = sign * self.matrix
        return trusted(LieTransform, matrix=matrix)

    @property
    def _witness(self) -> Floats:
        """Coordinates of a point that is not the pole."""
        away = np.zeros(3) if self.pole is None else self.pole + 1.0
        return lie_coordinates(away)[:5]

    @classmethod
    def of_lie(cls, transform: LieTransform) -> Self:
        """The Moebius transformation that a Lie transformation is on points.

        Raises
        ------
        MeshError
            When it takes points to spheres of radius other than 0.
        """
        if not transform.is_moebius:
            raise MeshError(
                f"A Moebius transformation must take points to points; this Lie transformation "
                f"has {transform.matrix[5, :5].round(6).tolist()} in its last row. Use it on "
                f"spheres only."
            )
        return trusted(cls, matrix=transform.matrix[:5, :5], known=None)

    # --- what it does -----------------------------------------------------------------------

    def on_points(self, points: Floats) -> Floats:
        """Images of points, shape (N, 3), model unit; infinite at the pole."""
        linear, end, pole = self.pieces
        if pole is None:
            return np.asarray(points @ linear.T + end)
        gap = points - pole
        with np.errstate(divide="ignore", invalid="ignore"):
            turned = np.where(dot(gap, gap)[:, None] > 0, gap / dot(gap, gap)[:, None], np.inf)
            return np.asarray(turned @ linear.T + end)

    def on_spheres(self, spheres: Floats) -> Floats:
        """Images of spheres (p, r), shape (N, 4), model unit.

        The radius keeps its sign where the pole lies outside, and changes it where the inside
        becomes the outside.

        Raises
        ------
        MeshError
            When a sphere runs through the pole and becomes a plane; names the row.
        """
        linear, end, pole = self.pieces
        size = float(np.abs(np.linalg.det(linear))) ** (1.0 / 3.0)
        if pole is None:
            return np.column_stack([spheres[:, :3] @ linear.T + end, size * spheres[:, 3]])
        gap, radius = spheres[:, :3] - pole, spheres[:, 3]
        power = dot(gap, gap) - radius**2
        flat = np.flatnonzero(np.abs(power) <= 1e-12 * (dot(gap, gap) + radius**2))
        if len(flat):
            raise MeshError(
                f"No sphere may run through the pole {pole.tolist()}; row {flat[0]} does, and "
                f"becomes a plane ({len(flat)} such rows). Move the center of inversion."
            )
        center = (gap / power[:, None]) @ linear.T + end
        return np.column_stack([center, size * radius / power])

    def on_circles(self, circles: Circles) -> Circles:
        """Images of circles; the axis follows the sense of running around.

        Of a circle with center m, axis n and radius r, with g = m - pole, h = n . g and
        D = g^2 - r^2, an inversion of radius 1 makes one with center (D g + 2 h r^2 n)/Q and
        radius r/sqrt(Q), Q = D^2 + 4 h^2 r^2. Q = 0 where the circle runs through the pole:
        there center and radius are infinite.
        """
        linear, end, pole = self.pieces
        size = float(np.abs(np.linalg.det(linear))) ** (1.0 / 3.0)
        turn = linear / size * np.sign(np.linalg.det(linear))
        centers, axes, radii = circles
        if pole is None:
            return Circles(centers @ linear.T + end, axes @ turn.T, size * radii)
        gap = centers - pole
        height, power = dot(axes, gap), dot(gap, gap) - radii**2
        root = np.hypot(power, 2.0 * height * radii)
        with np.errstate(divide="ignore", invalid="ignore"):
            middle = power[:, None] * gap + (2.0 * height * radii**2)[:, None] * axes
            placed = (middle / (root**2)[:, None]) @ linear.T + end
            # Running around is reversed in the plane of a circle whose inside stays inside.
            axis = (2.0 * height[:, None] * gap - power[:, None] * axes) / root[:, None]
            return Circles(placed, axis @ turn.T, size * radii / root)

    def of_mesh(self, mesh: QuadMesh) -> MoebiusImage:
        """Image of a circular mesh, with its vertex offset; see `circular.moebius_image`."""
        return moebius_image(self, mesh)

    # --- text -------------------------------------------------------------------------------

    def to_json(self) -> str:
        """JSON text that `from_json` reads back, to the last digit of the matrix."""
        return json.dumps({"matrix": self.matrix.tolist()}, indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The transformation of a JSON object with a matrix, or with a list of inversions.

        Raises
        ------
        FormatError
            For text that is not such an object.
        MeshError
            For a matrix that does not keep the metric, or a radius that is not above 0.

        Examples
        --------
        >>> text = '{"inversions": [{"center": [0, 0, 0], "radius": 2}]}'
        >>> MoebiusTransform.from_json(text).on_points(np.array([[1.0, 0.0, 0.0]]))
        array([[4., 0., 0.]])
        """
        table = table_from_json(text, _KEYS)
        if len(table) != 1:
            raise FormatError(
                f"A Moebius transformation must have exactly one of the keys matrix and "
                f"inversions; found {', '.join(table) or 'none'}. Write one of them."
            )
        if "matrix" in table:
            return cls(numbers(table, "matrix", (5, 5)))
        listed = table["inversions"]
        if not isinstance(listed, list) or not listed:
            raise FormatError(
                'The key \'inversions\' must hold a list like [{"center": [0, 0, 9], "radius": 3}];'
                f" found {json.dumps(listed)[:60]}. Write one."
            )
        whole = cls(np.eye(5))
        for part in listed:
            one = table_from_json(json.dumps(part), _INVERSION_KEYS)
            radius = float(numbers(one, "radius", ()))
            whole = cls.inversion(numbers(one, "center", (3,)), radius) @ whole
        return whole


def _pieces(matrix: Floats) -> Pieces:
    """What a matrix does in space."""
    infinity = np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    image = matrix @ infinity
    depth = float(image[0] + image[1])
    if abs(depth) <= AT_INFINITY * float(np.abs(matrix).max()):
        # Fixes infinity: image = k (1, -1, 0), and the rest scales by k.
        k = 0.5 * (image[0] - image[1])
        start = matrix @ lie_coordinates(np.zeros(3))[:5]
        return Pieces(k * matrix[2:, 2:], start[2:] / (start[0] + start[1]), None)
    back = MOEBIUS @ matrix.T @ MOEBIUS @ infinity
    pole, end = back[2:] / (back[0] + back[1]), image[2:] / depth
    # Points as far from the pole as their images are from `end`, on both sides of it.
    reach = np.sqrt(2.0 / abs(depth))
    steps = pole + reach * np.concatenate([np.eye(3), -np.eye(3)])
    images = lie_coordinates(steps)[:, :5] @ matrix.T
    points = images[:, 2:] / (images[:, :1] + images[:, 1:2])
    return Pieces(0.5 * reach * (points[:3] - points[3:]).T, end, pole)


def _composed(second: Pieces, first: Pieces) -> Pieces:
    """The pieces of the first transformation followed by the second.

    With g the way from the second pole to the first end, the composition has its pole where the
    first one reaches the second pole, and sends infinity where the second one sends the first
    end.
    """
    square = float(np.abs(np.linalg.det(first.linear))) ** (2.0 / 3.0)
    if second.pole is None:
        return Pieces(
            second.linear @ first.linear, second.linear @ first.end + second.end, first.pole
        )
    g = first.end - second.pole
    if first.pole is None:
        pole = -(first.linear.T @ g) / square
        return Pieces(second.linear @ first.linear / square, second.end, pole)
    far = float(dot(g, g))
    size = float(norm(first.end) + norm(second.pole)) + square**0.25
    if far <= (1e-12 * size) ** 2:
        linear = second.linear @ first.linear / square
        return Pieces(linear, second.end - linear @ first.pole, None)
    way = first.linear.T @ g
    mirror = np.eye(3) - 2.0 * np.outer(unit(way), unit(way))
    return Pieces(
        second.linear @ first.linear @ mirror / far,
        second.end + second.linear @ g / far,
        first.pole - way / far,
    )
