"""The networks by name: which lines of a surface become the edges of panels.

References: [thesis] figure 6.1 and definition 2.1.7.
"""

from __future__ import annotations

from collections.abc import Callable

from pqmesh.errors import SpecError
from pqmesh.network.conjugate import trace_conjugate_network
from pqmesh.network.curves import CurveNetwork
from pqmesh.network.fields import parameter_pair
from pqmesh.network.geodesic import trace_geodesic_network
from pqmesh.network.given import Given as Given
from pqmesh.network.patch import paired_patch
from pqmesh.network.principal import trace_principal_network
from pqmesh.network.spaced import check_edge, spaced_network
from pqmesh.network.walker import Inside
from pqmesh.surface.base import Surface

Tracer = Callable[[Surface, tuple[float, float], Inside | None, Given], CurveNetwork]


def _principal(
    surface: Surface, edge: tuple[float, float], inside: Inside | None, given: Given
) -> CurveNetwork:
    return trace_principal_network(surface, edge, inside)


def _parameter(
    surface: Surface, edge: tuple[float, float], inside: Inside | None, given: Given
) -> CurveNetwork:
    return spaced_network("uv", paired_patch(surface, inside, parameter_pair), edge)


# Name of each network, and how it is traced.
NETWORKS: dict[str, Tracer] = {
    "principal": _principal,
    "uv": _parameter,
    "geodesic": trace_geodesic_network,
    "conjugate": trace_conjugate_network,
}


def trace_network(
    kind: str,
    surface: Surface,
    edge: tuple[float, float],
    inside: Inside | None = None,
    given: Given | None = None,
) -> CurveNetwork:
    """Network of a kind in `NETWORKS`.

    Parameters
    ----------
    kind : str
        `principal`: lines of curvature. `uv`: parameter lines. `geodesic`: geodesics at right
        angles to two geodesics that meet at right angles. `conjugate`: curves along a given
        direction or given curves, and those conjugate to them.
    surface : Surface
    edge : (float, float), model unit
        Wanted panel edge along family 0 and along family 1.
    inside : callable, optional
        Truth at parameters (N, 2): the region to cover; default the whole domain.
    given : Given, optional
        A direction or curves for a conjugate network; a point and a direction for a geodesic
        one, where they are not to be chosen.

    Raises
    ------
    SpecError
        When the kind is unknown, or what is given does not fit it.
    NetworkError
        When there is no such network on the surface.

    Examples
    --------
    >>> from pqmesh.surface.analytic import sphere
    >>> network = trace_network("uv", sphere(), (0.3, 0.3))
    >>> bool(abs(network.angles - 1.5707963).max() < 1e-6)
    True
    """
    if kind not in NETWORKS:
        raise SpecError(
            f"The kind of a network must be known; found {kind!r}. Known are {', '.join(NETWORKS)}."
        )
    given = given or Given()
    _check_given(kind, given)
    check_edge(edge)
    return NETWORKS[kind](surface, edge, inside, given)


def _check_given(kind: str, given: Given) -> None:
    """Refuse what the kind has no use for, and the lack of what it needs."""
    direction, curves, through = (
        given.direction is not None,
        bool(given.curves),
        given.through is not None,
    )
    if kind == "conjugate" and direction == curves:
        raise SpecError(
            f"A conjugate network needs a plan direction or curves for family 0, and not both; "
            f"found {'both' if curves else 'neither'}. Give one of them."
        )
    useless = [
        name
        for name, found, kinds in (
            ("direction", direction, ("conjugate", "geodesic")),
            ("curves", curves, ("conjugate",)),
            ("through", through, ("geodesic",)),
        )
        if found and kind not in kinds
    ]
    if useless:
        raise SpecError(
            f"What is given must be of use to the network; a {kind} network has no use for "
            f"{' and '.join(useless)}. Leave it out, or choose another kind."
        )
