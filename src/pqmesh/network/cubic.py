"""Exactly planar meshes on conjugate cubics: the sampling of appendix A that needs no solver."""

from __future__ import annotations

from typing import Any

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.surface.analytic import conjugate_cubic


def conjugate_cubic_mesh(steps: int, c1: float = 1.0, c2: float = 1.0, **shape: Any) -> QuadMesh:
    """PQ mesh of parameter lines on a conjugate cubic, planar to rounding as it is.

    A cell of steps h and k in u and v has six times the volume -(c1/6c2) h^2 k^2 (c1^2 k^2 -
    c2^2 h^2) det(a10, a01, a20): it is plane if and only if h|c2| = k|c1|. So the step in v
    follows from that in u, and v is covered as far as whole steps reach, from its lower bound.
    All these surfaces are saddles; none models a dome.

    Parameters
    ----------
    steps : int
        Steps in u, at least 1.
    c1, c2 : float
        Not 0.
    **shape
        Further parameters of `conjugate_cubic`: vectors a00, a10, a01, a20, ranges u, v.

    Raises
    ------
    SpecError
        As `conjugate_cubic`.
    NetworkError
        When not one step fits into the range of v.

    References: [thesis] appendix A; errata page, E35 and E36.

    Examples
    --------
    >>> from pqmesh.mesh.measure import planarity
    >>> bool(planarity(conjugate_cubic_mesh(8, c1=1.0, c2=2.0)).max() < 1e-13)
    True
    """
    surface = conjugate_cubic(c1, c2, **shape)
    domain = surface.domain
    h = float(domain.size[0]) / max(int(steps), 1)
    k = h * abs(c2 / c1)
    rows = int(np.floor(float(domain.size[1]) / k + 1e-9))
    if steps < 1 or rows < 1:
        raise NetworkError(
            f"At least one step must fit in u and in v; {steps} steps of {h:.4g} in u need steps "
            f"of {k:.4g} in v, and v runs over {domain.size[1]:.4g}. Take more steps, or widen v."
        )
    u = domain.u[0] + h * np.arange(steps + 1)
    v = domain.v[0] + k * np.arange(rows + 1)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    points = surface.jet(uv.reshape(-1, 2)).point
    return grid_mesh(points.reshape(steps + 1, rows + 1, 3))
