"""What a user should know of a roof before building it, in sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.job import Panelization
from pqmesh.vectors import Floats


def roof_warnings(result: Panelization, origin: Floats) -> list[str]:
    """What a user should know before building."""
    found = _network_warnings(result, origin)
    if result.network_mesh.separate:
        found.append(
            f"{result.network_mesh.separate} panels hang together with the rest by no edge and "
            f"were left out"
        )
    if result.trimmed is not None:
        panels = result.trimmed.panels
        if len(panels.slivers):
            place = _place(panels.sliver_places[0], origin)
            found.append(
                f"{len(panels.slivers)} cut panels are slivers (small, or with a short side) and "
                f"have no neighbour in their plane to merge with; the first at ({place})"
            )
        if panels.covered_share < 1.0 - 1e-6:
            network = result.network_mesh
            broken = network.unusable or network.separate or result.umbilics.umbilics
            why = (
                "its network is broken there"
                if broken
                else "the surface does not reach over the rest (surface.extend continues it)"
            )
            found.append(
                f"the panels cover {100 * panels.covered_share:.4g} % of the outline: {why}"
            )
    for layer in result.layers:
        bound = layer.first_reversed_edge_distance
        if bound is not None and abs(layer.distance) >= abs(bound):
            found.append(
                f"layer {layer.distance:g} lies beyond the focal set: its first edge reverses at "
                f"{bound:.4g}"
            )
    if not result.solution.converged:
        found.append(f"the optimisation did not converge: {result.solution.reason}")
    return found


def _network_warnings(result: Panelization, origin: Floats) -> list[str]:
    """What the network says of the surface."""
    found = []
    network = result.network
    if len(network.narrow):
        first = int(network.narrow[0])
        found.append(
            f"the families of the network meet under {np.degrees(network.angles[first]):.3g} deg "
            f"at least, near ({_place(network.points[first], origin)}): panels become slender"
        )
    for family in (0, 1):
        places = [point for k, _, point in network.focal if k == family]
        if places:
            found.append(
                f"geodesics of family {family + 1} focus: {len(places)} lines end, the first near "
                f"({_place(places[0], origin)})"
            )
    if network.kind != "principal":
        return found
    for umbilic in result.umbilics.umbilics:
        place = _place(umbilic.point, origin)
        found.append(
            f"umbilic ({umbilic.kind}, index {umbilic.index:+g}) at ({place}): no principal "
            f"network passes it; the panels stop around it"
        )
    if result.umbilics.degenerate_fraction > 0:
        found.append(
            f"{100 * result.umbilics.degenerate_fraction:.2g} % of the surface has no principal "
            f"directions (plane or spherical)"
        )
    if 0 < result.umbilics.viability < 0.35:
        found.append(
            f"viability {result.umbilics.viability:.2f} is below 0.35: panel sizes will vary by "
            f"more than a factor of 4"
        )
    return found


def _place(point: ArrayLike, origin: Floats) -> str:
    """A place in space, to six digits of what is near the origin."""
    return ", ".join(f"{x:.12g}" for x in np.round(np.asarray(point), 3) + origin + 0.0)
