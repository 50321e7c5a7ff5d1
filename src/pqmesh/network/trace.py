"""Integral curves of direction fields on a surface: whole families at once, in arrays."""

from __future__ import annotations

import numpy as np

from pqmesh.network.lines import Lines
from pqmesh.network.walker import End as End
from pqmesh.network.walker import Field as Field
from pqmesh.network.walker import Heading as Heading
from pqmesh.network.walker import Inside as Inside
from pqmesh.network.walker import Limits as Limits
from pqmesh.network.walker import Walker
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, Indices


def principal_field(gap: float) -> Field:
    """Field of curvature lines that follows the family nearest to the reference direction.

    Parameters
    ----------
    gap : float, 1/length
        The field ends where k1 - k2 falls below this: an umbilic has no direction.

    References: [thesis] section 6.2; sign and family by continuity (errata page, E33).
    """

    def heading(surface: Surface, uv: Floats, reference: Floats, _: Indices) -> Heading:
        shape = shape_data(surface.jet(uv))
        along = np.einsum("nfi,ni->nf", shape.directions, reference)
        family = np.abs(along).argmax(axis=1)
        row = np.arange(len(uv))
        sign = np.where(along[row, family] < 0, -1.0, 1.0)[:, None]
        return Heading(
            sign * shape.directions_uv[row, family],
            shape.directions_uv[row, 1 - family],
            sign * shape.directions[row, family],
            family,
            shape.k[:, 0] - shape.k[:, 1] - gap,
        )

    return heading


def trace(
    surface: Surface,
    field: Field,
    seeds: Floats,
    directions: Floats,
    limits: Limits,
) -> Lines:
    """Lines of a field through seed points, followed both ways to their exact ends.

    All lines advance together with their own step lengths (Dormand-Prince 5(4) in the
    parameter plane, error measured on the surface).

    Parameters
    ----------
    seeds : (L, 2)
        Parameters inside the domain.
    directions : (L, 3)
        Start directions; the field decides the exact ones.
    """
    family = np.zeros(len(seeds), dtype=np.int64)
    return Walker(surface, field, limits, seeds, family).followed(directions)
