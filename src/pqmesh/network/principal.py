"""The principal network of a surface: lines of both families, spaced for even panels."""

from __future__ import annotations

from pqmesh.network.curves import CurveNetwork as CurveNetwork
from pqmesh.network.patch import principal_patch
from pqmesh.network.spaced import check_edge, spaced_network
from pqmesh.network.walker import Inside as Inside
from pqmesh.surface.base import Surface


def trace_principal_network(
    surface: Surface,
    edge: tuple[float, float],
    inside: Inside | None = None,
    *,
    most_lines: int = 4000,
) -> CurveNetwork:
    """Network of curvature lines spaced so that panels come out as even as the surface allows.

    A coarse network all over the region measures how the distance of neighbouring lines
    varies; the final lines stand where its geometric mean equals the wanted edge. They reach
    beyond the region by up to a panel where the surface does.

    Parameters
    ----------
    surface : Surface
    edge : (float, float), model unit
        Wanted panel edge along the lines of larger and of smaller principal curvature.
    inside : callable, optional
        Truth at parameters (N, 2): the region to cover; default the whole domain.
    most_lines : int
        Refuse beyond this many lines in a family.

    Raises
    ------
    NetworkError
        When the region misses the surface, when there are no principal directions (sphere,
        plane), or when too many lines are needed.

    References: [thesis] section 6.2; errata page, E33 and E37.
    """
    check_edge(edge)
    return spaced_network("principal", principal_patch(surface, inside), edge, most_lines)
