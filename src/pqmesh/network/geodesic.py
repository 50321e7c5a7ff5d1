"""A network of geodesics at right angles to two geodesics that cross at right angles."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.errors import NetworkError
from pqmesh.network.crossings import crossings
from pqmesh.network.curves import CurveNetwork, Focus
from pqmesh.network.fields import STEEPEST, plan_tangents
from pqmesh.network.given import Given
from pqmesh.network.jacobi import trace_geodesics
from pqmesh.network.lines import Lines, selected, shortened
from pqmesh.network.patch import UMBILIC_GAP, Seeds, extent, line_samples, sampled, seeds_across
from pqmesh.network.spaced import MOST_LINES, tracing_limits
from pqmesh.network.walker import End, Inside, Limits
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, Indices, cross, norm, unit

# Lines end where neighbours have come this near to each other, in steps of their start curve:
# panels a fifth as wide as wanted are no panels, and on the way to the focal point itself the
# lines only crowd more. On a sphere this is 78 degrees away from the start curve, of 90.
NARROWEST = 0.2


def trace_geodesic_network(
    surface: Surface, edge: tuple[float, float], inside: Inside | None, given: Given
) -> CurveNetwork:
    """Network of two families of geodesics, each at right angles to a start geodesic.

    Two geodesics start at a point at right angles. At equal steps along each, geodesics leave it
    at right angles: family 0 beside the first start curve, family 1 beside the second one. Each
    family covers every place once, and ends before it focuses.

    Parameters
    ----------
    surface : Surface
    edge : (float, float), model unit
        Steps along the first and along the second start curve.
    inside : callable, optional
    given : Given
        The plan point, by default the middle of the region, and the plan direction of the first
        start curve, by default the first principal direction, or u where there is none.

    Raises
    ------
    NetworkError
        When the region or the point misses the surface, when it stands upright where a plan
        direction is wanted, or when too many lines are needed.

    References: [thesis] figure 6.1; [docarmo1976] sections 4.4 and 5.5.

    Examples
    --------
    >>> from pqmesh.surface.analytic import cylinder
    >>> network = trace_geodesic_network(cylinder(), (0.2, 0.2), None, Given())
    >>> [len(lines) for lines in network.families], bool(network.families[1].closed.all())
    ([31, 5], True)
    """
    within, uv, jet = sampled(surface, inside)
    spacing = (float(edge[1]), float(edge[0]))
    _check_count(extent(jet.point), min(spacing))
    limits = tracing_limits(extent(jet.point), within, spacing)[2]
    centre = _centre(surface, uv, jet.point, given.through)
    starts = _start_curves(surface, centre, _axes(surface, centre, given.direction), limits)
    families, focal = [], []
    for family in (0, 1):
        rail = starts[1 - family]
        uv, across = seeds_across(surface, rail, *_steps(rail, centre, spacing[family]))
        lines = _once(surface, rail, trace_geodesics(surface, uv, across, limits, NARROWEST), uv)
        near = _near(surface, lines, within)
        families.append(selected(lines, near))
        focal += _foci(surface, family, families[-1], (uv[near], across[near]), limits)
    found = crossings(surface, families[0], families[1])
    return CurveNetwork(surface, (families[0], families[1]), found, "geodesic", focal=tuple(focal))


def _check_count(size: float, step: float) -> None:
    """Refuse steps that make lines beyond counting."""
    if size / step > MOST_LINES:
        raise NetworkError(
            f"A network may have up to {MOST_LINES} lines in a family; steps of {step:g} on a "
            f"region of size {size:.4g} need more. Choose longer edges."
        )


def _centre(
    surface: Surface, uv: Floats, points: Floats, through: tuple[float, float] | None
) -> Floats:
    """Parameters (2,) of the point where the start curves cross."""
    if through is None:
        return np.asarray(uv[norm(points - points.mean(axis=0)).argmin()])
    plan = np.array(through, dtype=np.float64)
    away = norm(points[:, :2] - plan)
    gaps = np.asarray(cKDTree(points).query(points, k=2)[0])[:, 1]
    near = away < 2.0 * max(float(np.median(gaps)), float(away.min()))
    # Of several sheets the highest one is meant.
    best = uv[np.where(near, points[:, 2], -np.inf).argmax()]
    for _ in range(20):
        jet = surface.jet(best[None])
        gap = plan - jet.point[0, :2]
        step = np.linalg.lstsq(np.stack([jet.du[0, :2], jet.dv[0, :2]], 1), gap, rcond=1e-9)[0]
        best = surface.domain.reduce(best + step)
    missed = float(norm(plan - surface.jet(best[None]).point[0, :2]))
    if not missed < 1e-6 * extent(points):
        raise NetworkError(
            f"The start curves must go through a point of the surface; over "
            f"{plan.tolist()} in plan there is none, the nearest found is {missed:.4g} away. "
            f"Move the point over the surface, and check its units."
        )
    return np.asarray(best)


def _axes(surface: Surface, uv: Floats, direction: float | None) -> Floats:
    """Orthonormal tangent vectors (2, 3) along the two start curves."""
    jet = surface.jet(uv[None])
    shape = shape_data(jet)
    gap, bend = float(shape.k[0, 0] - shape.k[0, 1]), float(np.abs(shape.k).max())
    if direction is not None:
        plan = np.array([[np.cos(direction), np.sin(direction)]])
        first = plan_tangents(jet, plan)
        if abs(shape.normal[0, 2]) < STEEPEST:
            raise NetworkError(
                f"A direction in plan must be seen from above; the surface stands upright at "
                f"{np.round(jet.point[0], 4).tolist()}, where the start curves cross. Give "
                f"another point, or leave the direction out."
            )
    else:
        first = shape.directions[:, 0] if gap > UMBILIC_GAP * bend else shape.frame[:, 0]
    first = unit(first)
    return np.concatenate([first, cross(shape.normal, first)])


def _start_curves(
    surface: Surface, centre: Floats, axes: Floats, limits: Limits
) -> tuple[Lines, Lines]:
    """The two start curves; where they meet again, the one with the longer way ends half way.

    They go on beyond places where their families focus: lines that leave them there may be of
    use farther off.
    """
    both = trace_geodesics(surface, np.tile(centre, (2, 1)), axes, limits)
    point = surface.jet(centre[None]).point[0]
    if not both.total.min() > 0.0:
        raise NetworkError(
            f"The start curves must run over the surface; through "
            f"{np.round(point, 4).tolist()} one of them leaves it at once. Move the point "
            f"inwards, or turn the direction."
        )
    curves = [selected(both, np.array([i])) for i in (0, 1)]
    here = np.array([_seed_arc(both, i, centre) for i in (0, 1)])
    reach = _reach(both, here)
    arcs = crossings(surface, curves[0], curves[1]).arcs
    ways, sides = np.abs(arcs - here), (arcs > here).astype(np.int64)
    for row in ways.max(axis=1).argsort():
        way, side = ways[row], sides[row]
        longer = int(way.argmax())
        met = (way <= reach[[0, 1], side]).all() and way.max() > _tiny(both)
        if met and not both.closed[longer]:
            reach[longer, side[longer]] = 0.5 * way[longer]
    both = _within(both, here, reach)
    return selected(both, np.array([0])), selected(both, np.array([1]))


def _steps(start: Lines, centre: Floats, step: float) -> tuple[Indices, Floats]:
    """Line 0 and arc lengths along a start curve at equal steps, one of them at the centre."""
    total = float(start.total[0])
    if start.closed[0]:
        count = max(round(total / step), 3)
        arcs = total / count * np.arange(count)
    else:
        here = _seed_arc(start, 0, centre)
        arcs = here + step * np.arange(-(here // step), (total - here) // step + 1.0)
    return np.zeros(len(arcs), dtype=np.int64), np.asarray(arcs, dtype=np.float64)


def _seed_arc(lines: Lines, line: int, seed: Floats) -> float:
    """Arc length at which a line passes its seed, one of its joints."""
    away = norm(lines.joints(line) - seed) if lines.start[line] < lines.start[line + 1] else [0.0]
    arcs = lines.arc[lines.start[line] : lines.start[line + 1]]
    return float(np.append(arcs, lines.total[line])[int(np.argmin(away))])


def _foci(surface: Surface, family: int, lines: Lines, seeds: Seeds, limits: Limits) -> list[Focus]:
    """Focal points of the lines that end before one, where they reach it."""
    ended = np.flatnonzero((lines.ends == End.FOCAL).any(axis=1))
    longer = trace_geodesics(surface, seeds[0][ended], seeds[1][ended], limits, 0.0)
    found = []
    for row, line in enumerate(ended):
        joints = surface.domain.reduce(longer.joints(row)[[0, -1]])
        for side in np.flatnonzero(
            (lines.ends[line] == End.FOCAL) & (longer.ends[row] == End.FOCAL)
        ):
            uv = joints[side]
            found.append((family, uv, surface.jet(uv[None]).point[0]))
    return found


def _once(surface: Surface, start: Lines, lines: Lines, seeds: Floats) -> Lines:
    """Lines ended where others of their family have come from nearer: every place covered once.

    A line that comes back to the start curve ends half way: from there the other half is covered
    by lines that leave the curve on its other side. Of two lines that meet, the one with the
    longer way from the start curve ends.
    """
    here = np.array([_seed_arc(lines, i, seed) for i, seed in enumerate(seeds)])
    reach, tiny = _reach(lines, here), _tiny(lines)
    back = crossings(surface, start, lines)
    for line, arc in zip(back.lines[:, 1], back.arcs[:, 1], strict=True):
        side, way = int(arc > here[line]), abs(arc - here[line])
        if way > tiny and not lines.closed[line]:
            reach[line, side] = min(reach[line, side], 0.5 * way)
    met = crossings(surface, lines, lines)
    apart = met.lines[:, 0] < met.lines[:, 1]
    pairs, arcs = met.lines[apart], met.arcs[apart]
    ways, sides = np.abs(arcs - here[pairs]), (arcs > here[pairs]).astype(np.int64)
    for row in np.argsort(ways.max(axis=1)):
        pair, way, side = pairs[row], ways[row], sides[row]
        if (way <= reach[pair, side]).all():
            longer = (way >= way.max() - tiny) & ~lines.closed[pair]
            reach[pair[longer], side[longer]] = way[longer]
    return _within(lines, here, reach)


def _reach(lines: Lines, here: Floats) -> Floats:
    """Lengths of lines (L, 2) before and after their seeds, without bound where they close."""
    reach = np.stack([here, lines.total - here], axis=1)
    reach[lines.closed] = np.inf
    return reach


def _tiny(lines: Lines) -> float:
    """Way from a seed below which a crossing is that of the seed itself."""
    return 1e-6 * float(lines.total.max(initial=0.0))


def _within(lines: Lines, here: Floats, reach: Floats) -> Lines:
    """Parts of lines within a reach (L, 2) before and after their seeds."""
    low, high = np.maximum(here - reach[:, 0], 0.0), np.minimum(here + reach[:, 1], lines.total)
    return shortened(lines, low, high, End.COVERED)


def _near(surface: Surface, lines: Lines, inside: Inside) -> Indices:
    """Lines that come into the region, and one beyond on either side."""
    uv, owner = line_samples(surface, lines)
    within = np.zeros(len(lines), dtype=np.bool_)
    within[owner[inside(uv)]] = True
    near = within.copy()
    near[1:] |= within[:-1]
    near[:-1] |= within[1:]
    return np.flatnonzero(near)
