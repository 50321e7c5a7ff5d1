"""What a smooth surface answers: its domain and its second-order jet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from pqmesh.errors import SurfaceError
from pqmesh.vectors import Floats, Mask


@dataclass(frozen=True)
class Domain:
    """Rectangle of the parameter plane, with the directions in which the surface closes.

    Parameters
    ----------
    u, v : (float, float)
        Lower and upper bound of each parameter.
    periodic : (bool, bool)
        True where the surface closes smoothly over the bound.
    """

    u: tuple[float, float]
    v: tuple[float, float]
    periodic: tuple[bool, bool] = (False, False)

    def __post_init__(self) -> None:
        for name, (low, high) in (("u", self.u), ("v", self.v)):
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise SurfaceError(
                    f"The domain must run upwards between finite bounds; {name} runs from "
                    f"{low} to {high}. Give {name} = [low, high]."
                )

    @property
    def low(self) -> Floats:
        """Lower corner, shape (2,)."""
        return np.array([self.u[0], self.v[0]])

    @property
    def high(self) -> Floats:
        """Upper corner, shape (2,)."""
        return np.array([self.u[1], self.v[1]])

    @property
    def size(self) -> Floats:
        """Extent in u and v, shape (2,)."""
        return self.high - self.low

    def inside(self, uv: Floats, slack: float = 0.0) -> Mask:
        """Truth of `low - slack*size <= uv <= high + slack*size`; periodic bounds never end."""
        margin = slack * self.size
        within = (uv >= self.low - margin) & (uv <= self.high + margin)
        return np.asarray((within | np.array(self.periodic)).all(axis=-1))

    def reduce(self, uv: Floats) -> Floats:
        """Parameters moved into the domain: wrapped where periodic, clamped elsewhere."""
        wrapped = self.low + np.mod(uv - self.low, self.size)
        clamped = np.clip(uv, self.low, self.high)
        return np.where(np.array(self.periodic), wrapped, clamped)

    def grid(self, n_u: int, n_v: int) -> Floats:
        """Centres of n_u x n_v equal cells, shape (n_u, n_v, 2)."""
        u = self.u[0] + (np.arange(n_u) + 0.5) / n_u * self.size[0]
        v = self.v[0] + (np.arange(n_v) + 0.5) / n_v * self.size[1]
        return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)


class Jet(NamedTuple):
    """Point and first and second parameter derivatives, each of shape (N, 3)."""

    point: Floats
    du: Floats
    dv: Floats
    duu: Floats
    duv: Floats
    dvv: Floats


@runtime_checkable
class Surface(Protocol):
    """A parametric surface: everything else (normals, curvature, closest point) follows.

    `jet` is given parameters inside the domain (periodic ones already wrapped) and returns
    derivatives that are exact, never differences.
    """

    @property
    def domain(self) -> Domain:
        """The parameter rectangle."""
        ...

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet at parameters uv of shape (N, 2)."""
        ...
