"""A surface on a larger domain than its own: continued by the formula or polynomials it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.surface.base import Domain, Jet, Surface
from pqmesh.vectors import Floats, norm

# Samples along each bound, and how much slower than usual a bound may be for a full extension.
SAMPLES, SLOWEST = 64, 0.25


@dataclass(frozen=True, eq=False)
class ExtendedSurface:
    """The same surface, asked for parameters beyond its bounds.

    Attributes
    ----------
    surface : Surface
        Whose jet answers beyond its domain: formulas, and B-splines by their end spans.
    domain : Domain
        The larger domain.
    """

    surface: Surface
    domain: Domain

    def jet(self, uv: Floats) -> Jet:
        """Second-order jet at parameters uv of shape (N, 2)."""
        return self.surface.jet(uv)


def extended(surface: Surface, length: float) -> Surface:
    """The surface continued smoothly by a length beyond each bound that it has.

    Directions in which the surface closes have no bound and stay. Formulas go on as they are,
    B-splines as the polynomials of their end spans: small lengths are safe, large ones are not.

    Parameters
    ----------
    surface : Surface
    length : float, model unit
        Measured along the lines that cross the bound, where they are slowest; where they nearly
        stand still (a pole) they go on by less.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> extended(graph_surface("x*y", (-1, 1), (0, 1)), 0.5).domain.u
    (-1.5, 1.5)
    """
    domain = surface.domain
    bounds = [domain.u, domain.v]
    share = np.linspace(0.0, 1.0, SAMPLES)
    for axis in (0, 1):
        if domain.periodic[axis]:
            continue
        margins = []
        for place in bounds[axis]:
            uv = domain.low + share[:, None] * domain.size
            uv[:, axis] = place
            jet = surface.jet(uv)
            speed = norm(jet.dv if axis else jet.du)
            slow = max(float(speed.min()), SLOWEST * float(np.median(speed)))
            margins.append(length / slow)
        low, high = bounds[axis]
        bounds[axis] = (low - margins[0], high + margins[1])
    return ExtendedSurface(surface, Domain(bounds[0], bounds[1], domain.periodic))
