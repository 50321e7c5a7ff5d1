"""Laguerre transformations of spheres, planes and cones: they keep oriented contact and planes."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.transform.conical import CYLINDER, ConeImages, LaguerreImage, laguerre_image
from pqmesh.transform.json_text import numbers, table_from_json
from pqmesh.transform.lie import IMPROPER_POINT, LORENTZ, LieTransform, checked_matrix, trusted
from pqmesh.transform.lie import lorentz_product as product
from pqmesh.transform.lorentz import boost_matrix, rotation_matrix
from pqmesh.vectors import Floats, read_only

_KEYS = {
    "matrix": "a Lorentz matrix, 4 x 4 numbers",
    "translation": "4 numbers",
    "scale": "a number above 0",
}


def _identity() -> Floats:
    return np.eye(4)


@dataclass(frozen=True, eq=False)
class LaguerreTransform:
    """X -> scale T X + B on oriented spheres X = (p, r): planes to planes, cones to cones.

    Parameters
    ----------
    matrix : (4, 4)
        T with T' J T = J, J = diag(1, 1, 1, -1).
    translation : (4,), model unit
        B; its last entry adds to all radii, so that every plane moves by *minus* it along its
        normal. `offset` minds the sign.
    scale : float
        Above 0. The Laguerre group proper has scale 1; similarities come with it.

    Raises
    ------
    MeshError
        When the matrix is not Lorentzian to 1e-12 cosh(rapidity)^2, or a value is not finite.

    References: [thesis] section 5.3; errata page, E20, E24, E25.

    Examples
    --------
    >>> boost = LaguerreTransform.boost([0, 0, 1], 0.1)
    >>> boost.on_spheres(np.array([[1.0, 2.0, 3.0, 5.0]])).round(6)
    array([[1.      , 2.      , 3.515846, 5.325521]])
    >>> LaguerreTransform.offset(0.5).on_planes(np.array([[0.0, 0.0, 1.0, 2.0]]))
    array([[0. , 0. , 1. , 2.5]])
    """

    matrix: Floats = field(default_factory=_identity)
    translation: Floats = field(default_factory=lambda: np.zeros(4))
    scale: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", checked_matrix(self.matrix, LORENTZ, "Laguerre"))
        object.__setattr__(self, "translation", read_only(_finite(self.translation, 4, "B")))
        if not 0 < self.scale < np.inf:
            raise MeshError(
                f"The scale of a Laguerre transformation must be a number above 0; found "
                f"{self.scale!r}. To turn orientations use the matrix diag(1, 1, 1, -1)."
            )

    # --- generators -------------------------------------------------------------------------

    @classmethod
    def offset(cls, distance: float) -> Self:
        """Moves every plane by a distance along its normal: B = (0, 0, 0, -distance).

        References: errata page, E20, E30.
        """
        return cls(translation=np.array([0.0, 0.0, 0.0, -distance]))

    @classmethod
    def shift(cls, vector: ArrayLike) -> Self:
        """Translation by a vector (3,)."""
        return cls(translation=np.append(_finite(vector, 3, "The vector"), 0.0))

    @classmethod
    def rotation(cls, axis: ArrayLike, angle: float) -> Self:
        """Rotation about an axis (3,) through the origin, by the right-hand rule, radians."""
        a = _direction(axis)
        matrix = np.eye(4)
        matrix[:3, :3] = rotation_matrix(angle * a)
        return cls(matrix)

    @classmethod
    def similarity(cls, factor: float) -> Self:
        """Scaling from the origin: (p, r) -> factor (p, r)."""
        return cls(scale=factor)

    @classmethod
    def boost(cls, direction: ArrayLike, rapidity: float, center: ArrayLike = (0, 0, 0)) -> Self:
        """The transformation that is neither motion nor offset, about a point (3,).

        Along the direction, (s, r) -> (s cosh + r sinh, s sinh + r cosh). Spheres of radius 0 grow
        with their height over the center, so a mesh far from it is offset by much.
        """
        b = _direction(direction)
        if not abs(rapidity) < 300:
            raise MeshError(
                f"The rapidity of a boost must be a number below 300; found {rapidity!r}. Use "
                f"values of about 1."
            )
        matrix = boost_matrix(rapidity * b)
        fixed = np.append(_finite(center, 3, "The center"), 0.0)
        return cls(matrix, fixed - matrix @ fixed)

    @classmethod
    def inversion(cls, vector: ArrayLike, level: float = 0.0) -> Self:
        """Reflection X - 2 ((X, v) - level)/(v, v) v in a hyperplane (X, v) = level.

        Parameters
        ----------
        vector : (4,)
            v with (v, v) other than 0. (n, 0) reflects in a plane, (0, 0, 0, 1) turns all
            orientations over, a general one is a Laguerre inversion.
        level : float, model unit
        """
        v = _finite(vector, 4, "The vector")
        square = float(product(v, v))
        if not abs(square) > 1e-12 * float(v @ v):
            raise MeshError(
                f"The vector of a Laguerre inversion must have (v, v) other than 0; {v.tolist()} "
                f"has {square:.3g}. Change its last entry."
            )
        matrix = np.eye(4) - (2.0 / square) * np.outer(v, LORENTZ @ v)
        return cls(matrix, (2.0 * level / square) * v)

    @classmethod
    def random(cls, rng: np.random.Generator, rapidity: float, distance: float = 0.0) -> Self:
        """A random motion after a boost of this rapidity along a random direction.

        Parameters
        ----------
        rng : numpy Generator
        rapidity : float
        distance : float, model unit
            Offset after the boost.
        """
        motion = np.eye(4)
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        motion[:3, :3] = q * np.sign(np.diag(r)) * np.sign(np.linalg.det(q) * np.diag(r).prod())
        moved = cls(motion, np.append(rng.normal(size=3), -distance))
        return moved @ cls.boost(rng.normal(size=3), rapidity)

    # --- the group --------------------------------------------------------------------------

    def __matmul__(self, other: LaguerreTransform) -> Self:
        """First `other`, then this one."""
        shift = self.scale * (self.matrix @ other.translation) + self.translation
        matrix, scale = self.matrix @ other.matrix, self.scale * other.scale
        return trusted(type(self), matrix=matrix, translation=shift, scale=scale)

    @cached_property
    def inverse(self) -> Self:
        """The transformation that undoes this one: T becomes J T' J."""
        back = LORENTZ @ self.matrix.T @ LORENTZ
        shift = -(back @ self.translation) / self.scale
        return trusted(type(self), matrix=back, translation=shift, scale=1.0 / self.scale)

    @property
    def rapidity(self) -> float:
        """Rapidity of the boost in it: cosh(rapidity) = |T44|."""
        return float(np.arccosh(max(abs(self.matrix[3, 3]), 1.0)))

    @cached_property
    def lie(self) -> LieTransform:
        """The same as a Lie sphere transformation, fixing the improper point."""
        shift, scale = self.translation, self.scale
        # In (x1 + x2, x1 - x2, X): 1 -> 1/scale, (X, X) -> scale (X, X) + 2 (TX, B) + ...
        inner = np.zeros((6, 6))
        inner[0, 0] = 1.0 / scale
        inner[1, 0] = product(shift, shift) / scale
        inner[1, 1] = scale
        inner[1, 2:] = 2.0 * (LORENTZ @ shift) @ self.matrix
        inner[2:, 0] = shift / scale
        inner[2:, 2:] = self.matrix
        change, back = np.eye(6), np.eye(6)
        change[:2, :2] = [[1.0, 1.0], [1.0, -1.0]]
        back[:2, :2] = 0.5 * change[:2, :2]
        return trusted(LieTransform, matrix=back @ inner @ change)

    @classmethod
    def of_lie(cls, transform: LieTransform) -> Self:
        """The Laguerre transformation that a Lie transformation is.

        Raises
        ------
        MeshError
            When it moves the improper point.
        """
        if not transform.is_laguerre:
            image = (transform.matrix @ IMPROPER_POINT).round(6).tolist()
            raise MeshError(
                f"A Laguerre transformation must fix the improper point; this Lie transformation "
                f"takes it to {image}. Use it on spheres only."
            )
        scale = float(transform.matrix[0] @ IMPROPER_POINT)
        matrix = transform.matrix * np.sign(scale)
        start = abs(scale) * 0.5 * (matrix[:, 0] + matrix[:, 1])
        return trusted(cls, matrix=matrix[2:, 2:], translation=start[2:], scale=abs(scale))

    # --- what it does -----------------------------------------------------------------------

    def on_spheres(self, spheres: Floats) -> Floats:
        """Images of oriented spheres (p, r), shape (N, 4), model unit."""
        return np.asarray(self.scale * (spheres @ self.matrix.T) + self.translation)

    def on_planes(self, planes: Floats) -> Floats:
        """Images of oriented planes (n, h), shape (N, 4); normals stay of length 1.

        With (m, s) = T (n, 1): n' = m/s, h' = (scale h + ((m, s), B))/s.
        """
        carried = planes[..., :3] @ self.matrix[:, :3].T + self.matrix[:, 3]
        heights = self.scale * planes[..., 3] + carried @ (LORENTZ @ self.translation)
        rows = np.concatenate([carried[..., :3], heights[..., None]], axis=-1)
        return np.asarray(rows / carried[..., 3:])

    def on_cones(self, vertices: Floats, vectors: Floats) -> ConeImages:
        """Images of cones with apexes v (n, 3) that touch the planes with n . w = 1, w (n, 3).

        The cone is the line of spheres (v, 0) + t (w, 1). With (q, s) the image of (v, 0) and
        (m, c') that of the direction (w, 1): v' = q - (s/c') m, w' = m/c'. An image of a point
        is a sphere, and not the new apex.

        References: [thesis] theorem 5.3.3; errata page, E28.
        """
        start = self.on_spheres(np.column_stack([vertices, np.zeros(len(vertices))]))
        along = vectors @ self.matrix[:, :3].T + self.matrix[:, 3]
        growth = along[:, 3]
        size = np.abs(self.matrix[3, 3]) * (1.0 + np.sqrt(np.einsum("ni,ni->n", vectors, vectors)))
        is_cone = np.abs(growth) > CYLINDER * size
        turned = along[:, :3] / np.where(is_cone, growth, np.nan)[:, None]
        return ConeImages(start[:, :3] - start[:, 3:] * turned, turned, growth)

    def of_mesh(self, mesh: QuadMesh, vectors: Floats | None = None) -> LaguerreImage:
        """Image of a conical mesh, and of its vectors w; see `conical.laguerre_image`."""
        return laguerre_image(self, mesh, vectors)

    # --- text -------------------------------------------------------------------------------

    def to_json(self) -> str:
        """JSON text that `from_json` reads back, to the last digit."""
        table = {
            "matrix": self.matrix.tolist(),
            "translation": self.translation.tolist(),
            "scale": self.scale,
        }
        return json.dumps(table, indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Self:
        """The transformation of a JSON object with matrix and, if any, translation and scale.

        Raises
        ------
        FormatError
            For text that is not such an object.
        MeshError
            For a matrix that is not Lorentzian.

        Examples
        --------
        >>> turn = LaguerreTransform.rotation([0, 0, 1], 0.5)
        >>> bool((LaguerreTransform.from_json(turn.to_json()).matrix == turn.matrix).all())
        True
        """
        table = table_from_json(text, _KEYS)
        matrix = numbers(table, "matrix", (4, 4))
        shift = numbers(table, "translation", (4,)) if "translation" in table else np.zeros(4)
        scale = float(numbers(table, "scale", ())) if "scale" in table else 1.0
        return cls(matrix, shift, scale)


def _finite(values: ArrayLike, count: int, name: str) -> Floats:
    """A vector of so many finite numbers."""
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise MeshError(
            f"{name} of a Laguerre transformation must be {count} finite numbers; found "
            f"{array.tolist()}. Mend it."
        )
    return array


def _direction(values: ArrayLike) -> Floats:
    """A vector (3,) other than zero, scaled to length 1."""
    vector = _finite(values, 3, "The direction")
    largest = float(np.abs(vector).max())
    if not largest > 0:
        raise MeshError(
            "The direction of a Laguerre transformation must not be zero; found [0, 0, 0]. Give "
            "three coordinates."
        )
    scaled = vector / largest
    return np.asarray(scaled / np.sqrt(scaled @ scaled))
