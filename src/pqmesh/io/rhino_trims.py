"""Trim curves of a Brep face as polylines in the parameters of its surface.

The library gives no curves in the parameter plane. The edges in space are sampled and each
sample is carried back to the surface as its closest point.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from pqmesh.errors import FormatError
from pqmesh.io.rhino_file import row_from_point
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.closest import closest_point
from pqmesh.surface.regular import bounds_grid
from pqmesh.vectors import Floats, norm

# Loops keep this close to the edges, in shares of the size of the surface.
CHORD = 1e-4
LEVELS = 6
SAMPLES = 17
# A parameter this close to a bound, in shares of the domain, stands on it.
ON_BOUND = 1e-6


class Frame(NamedTuple):
    """The surface that loops are drawn on, with its scales.

    Attributes
    ----------
    surface : BSplineSurface
    origin : (3,)
        Taken off all points of the file.
    tolerance : float
        Within which the file's edges meet the surface.
    reach : float
        Extent of the surface.
    speed : (2,)
        Mean length of the tangents.
    closed : (bool, bool)
        Directions in which both ends are the same curve, smooth or not.
    """

    surface: BSplineSurface
    origin: Floats
    tolerance: float
    reach: float
    speed: Floats
    closed: tuple[bool, bool]


class Trim(NamedTuple):
    """One edge of a loop on its way into the parameter plane.

    Attributes
    ----------
    edge : object or None
        None where the loop runs along a pole.
    reverse : bool
    share : (k,)
        Sampled parameters, 0 to 1 in the direction of the loop.
    uv : (k, 2)
    """

    edge: Any
    reverse: bool
    share: Floats
    uv: Floats


def rectangle(surface: BSplineSurface) -> Floats:
    """Corners of the domain, counterclockwise."""
    (a, b), (c, d) = surface.domain.u, surface.domain.v
    return np.array([[a, c], [b, c], [b, d], [a, d]])


def loops_of_face(
    face: Any, edges: Any, surface: BSplineSurface, origin: Floats, tolerance: float
) -> tuple[Floats, ...]:
    """Loops of a face, the outer one first and counterclockwise, holes clockwise.

    Parameters
    ----------
    face : BrepFace
    edges : BrepEdgeList
        Of the whole Brep.
    surface : BSplineSurface
        The face's surface, moved by -origin.
    origin : (3,), unit of the file
    tolerance : float, unit of the file

    Raises
    ------
    FormatError
        When an edge does not lie on the surface, or a loop does not close in its parameters.
    """
    frame = _frame(surface, origin, tolerance)
    outer: list[Floats] = []
    holes: list[Floats] = []
    for i in range(len(face.Loops)):
        loop = face.Loops[i]
        if loop.LoopType.name in ("Outer", "Inner"):
            (outer if loop.LoopType.name == "Outer" else holes).append(_loop(loop, edges, frame))
    if not outer:
        outer = [rectangle(surface)]
    if len(outer) > 1:
        raise FormatError(
            f"A face must have one outer loop; found {len(outer)}. Rebuild it in Rhino."
        )
    return (_turned(outer[0], 1.0), *(_turned(hole, -1.0) for hole in holes))


def _frame(surface: BSplineSurface, origin: Floats, tolerance: float) -> Frame:
    """Scales of a surface, from 17 x 17 samples."""
    grid = bounds_grid(surface.domain, 17)
    jet = surface.jet(grid.reshape(-1, 2))
    points = jet.point.reshape(17, 17, 3)
    reach = float(np.ptp(jet.point, axis=0).max())
    speed = np.array([norm(jet.du).mean(), norm(jet.dv).mean()]) + 1e-300
    near = max(tolerance, 1e-9 * reach)
    gaps = [points[0] - points[-1], points[:, 0] - points[:, -1]]
    closed = [bool(norm(gap).max() <= near) for gap in gaps]
    return Frame(surface, origin, tolerance, reach, speed, (closed[0], closed[1]))


def _loop(loop: Any, edges: Any, frame: Frame) -> Floats:
    """One loop as a polyline, closed without repetition."""
    trims = _sampled(loop, edges, frame)
    placed = [_placed(_refined(trim, frame), frame) if trim.edge else None for trim in trims]
    chain: list[Floats] = []
    over_pole = True
    for uv in placed:
        if uv is None:
            over_pole = True
            continue
        if not over_pole:
            uv = _continued(uv, chain[-1][-1], frame)
        chain.append(uv)
        over_pole = False
    if not chain:
        raise FormatError("A loop must have an edge; found none. Rebuild the face in Rhino.")
    if all(uv is not None for uv in placed):
        _check_closing(chain, frame)
    return _cleaned(np.concatenate([_snapped(uv, frame) for uv in chain]), frame)


def _sampled(loop: Any, edges: Any, frame: Frame) -> list[Trim]:
    """The trims of a loop; all samples are carried to the surface at once."""
    trims, points = [], []
    for trim in loop.Trims:
        index = int(trim.EdgeIndex)
        edge = edges[index] if 0 <= index < len(edges) else None
        is_back = bool(trim.IsReversed)
        share = np.empty(0) if edge is None else _shares(edge, is_back)
        trims.append(Trim(edge, is_back, share, np.empty((len(share), 2))))
        points.append(_points(trims[-1], share, frame))
    uv = _inverted(np.concatenate(points), None, frame)
    ends = np.cumsum([len(trim.share) for trim in trims])
    return [
        trim._replace(uv=uv[end - len(trim.share) : end])
        for trim, end in zip(trims, ends, strict=True)
    ]


def _shares(edge: Any, is_back: bool) -> Floats:
    """Where to sample an edge first: at its knots, where it may have corners, and between.

    A corner between two samples would be cut off, and no sample of chords would tell.
    """
    low, high = float(edge.Domain.T0), float(edge.Domain.T1)
    if not high > low:
        return np.linspace(0.0, 1.0, SAMPLES)
    form = edge.ToNurbsCurve()
    knots = [] if form is None else form.Knots.ToList()
    place = (np.unique([low, *knots, high]) - low) / (high - low)
    place = place[(place >= 0.0) & (place <= 1.0)]
    place = place[np.diff(place, prepend=-1.0) > 1e-12]
    place[-1] = 1.0
    between = max(2, -(-(SAMPLES - 1) // (len(place) - 1)))
    steps = np.arange((len(place) - 1) * between + 1) / between
    share = np.interp(steps, np.arange(len(place)), place)
    return 1.0 - share[::-1] if is_back else share


def _points(trim: Trim, share: Floats, frame: Frame) -> Floats:
    """Points of an edge in the direction of the loop."""
    if trim.edge is None:
        return np.empty((0, 3))
    low, high = float(trim.edge.Domain.T0), float(trim.edge.Domain.T1)
    along = 1.0 - share if trim.reverse else share
    rows = [row_from_point(trim.edge.PointAt(low + t * (high - low))) for t in along.tolist()]
    points = np.array(rows, dtype=np.float64).reshape(-1, 3)
    if not np.isfinite(points).all():
        raise FormatError("Edges must be finite; one is not. Rebuild the face in Rhino.")
    return points - frame.origin


def _inverted(points: Floats, start: Floats | None, frame: Frame) -> Floats:
    """Parameters of points on the surface."""
    # At a pole the search meets singular matrices and gets over them.
    with np.errstate(all="ignore"):
        foot = closest_point(frame.surface, points, start)
    worst = int(np.argmax(foot.distance)) if len(points) else 0
    allowed = max(10.0 * min(frame.tolerance, 0.01 * frame.reach), CHORD * frame.reach)
    if len(points) and foot.distance[worst] > allowed:
        place = ", ".join(f"{x:.6g}" for x in points[worst] + frame.origin)
        raise FormatError(
            f"Edges must lie on their surface; at ({place}) one is {foot.distance[worst]:.3g} "
            f"away. Rebuild the edges in Rhino."
        )
    return foot.uv


def _refined(trim: Trim, frame: Frame) -> Trim:
    """The trim with samples added until its chords are as good as the curve."""
    share, uv = trim.share, _unwrapped(trim.uv, frame)
    for _ in range(LEVELS):
        half = 0.5 * (share[1:] + share[:-1])
        chord = 0.5 * (uv[1:] + uv[:-1])
        near = frame.surface.domain.reduce(chord)
        middle = _aligned(_inverted(_points(trim, half, frame), near, frame), chord, frame)
        a, b, c = (part * frame.speed for part in (uv[:-1], middle, uv[1:]))
        new = np.flatnonzero(_distances(a, b, c) > CHORD * frame.reach)
        if len(new) == 0:
            break
        share = np.insert(share, new + 1, half[new])
        uv = np.insert(uv, new + 1, middle[new], axis=0)
    return trim._replace(share=share, uv=uv)


def _distances(a: Floats, b: Floats, c: Floats) -> Floats:
    """Distances of points b from the segments a to c, rows of the plane."""
    along, over = c - a, b - a
    square = (along**2).sum(axis=1)
    t = np.clip((along * over).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    return np.asarray(np.hypot(*(over - t[:, None] * along).T))


def _aligned(uv: Floats, near: Floats, frame: Frame) -> Floats:
    """Parameters moved by whole turns to be near others."""
    turns = np.round((near - uv) / frame.surface.domain.size)
    return np.asarray(uv + np.where(frame.closed, turns, 0.0) * frame.surface.domain.size)


def _unwrapped(uv: Floats, frame: Frame) -> Floats:
    """Samples of one edge without jumps: not over the seam, and not at poles."""
    uv = uv.copy()
    domain = frame.surface.domain
    jet = frame.surface.jet(uv)
    for axis, tangent in enumerate((jet.du, jet.dv)):
        # Where the tangent vanishes the parameter is anything; its neighbour knows better.
        firm = np.flatnonzero(norm(tangent) * domain.size[axis] > 1e-6 * frame.reach)
        if 0 < len(firm) < len(uv):
            gap = np.abs(np.arange(len(uv))[:, None] - firm)
            uv[:, axis] = uv[firm[gap.argmin(axis=1)], axis]
        if frame.closed[axis]:
            middle = len(uv) // 2
            flat = np.unwrap(uv[:, axis], period=domain.size[axis])
            uv[:, axis] = flat - flat[middle] + uv[middle, axis]
    return uv


def _placed(trim: Trim, frame: Frame) -> Floats:
    """The trim's parameters, an edge along a seam on the side where the loop runs it.

    Outer loops run counterclockwise: up along the end of u and down along its start, right
    along the start of v and left along its end.
    """
    uv = trim.uv
    domain = frame.surface.domain
    for axis in (0, 1):
        turns = (uv[:, axis] - domain.low[axis]) / domain.size[axis]
        if frame.closed[axis] and (np.abs(turns - np.round(turns)) <= ON_BOUND).all():
            forward = uv[-1, 1 - axis] > uv[0, 1 - axis]
            side = domain.high if forward == (axis == 0) else domain.low
            uv[:, axis] = side[axis]
    return uv


def _continued(uv: Floats, last: Floats, frame: Frame) -> Floats:
    """A trim moved by whole turns to go on where the one before ended."""
    return np.asarray(uv + (_aligned(uv[:1], last, frame) - uv[:1]))


def _check_closing(chain: list[Floats], frame: Frame) -> None:
    """A loop that goes once around a closed surface bounds nothing there."""
    gap = np.abs(chain[-1][-1] - chain[0][0]) / frame.surface.domain.size
    if (gap[list(frame.closed)] > 0.5).any():
        raise FormatError(
            "A loop must close in the parameters of its surface; one goes around a closed surface "
            "without a seam edge. Split the surface at its seam in Rhino."
        )


def _snapped(uv: Floats, frame: Frame) -> Floats:
    """Parameters within tolerance of a bound put onto it."""
    domain = frame.surface.domain
    near = min(2.0 * frame.tolerance, CHORD * frame.reach) / (frame.speed * domain.size)
    near = np.maximum(near, ON_BOUND) * domain.size
    uv = np.where(np.abs(uv - domain.low) <= near, domain.low, uv)
    return np.where(np.abs(uv - domain.high) <= near, domain.high, uv)


def _cleaned(uv: Floats, frame: Frame) -> Floats:
    """The ring without repeated points and without points on a straight line."""
    scaled = uv / frame.surface.domain.size
    uv = uv[np.hypot(*(np.roll(scaled, -1, axis=0) - scaled).T) > 1e-9]
    scaled = uv / frame.surface.domain.size
    if len(uv) > 3:
        away = _distances(np.roll(scaled, 1, axis=0), scaled, np.roll(scaled, -1, axis=0))
        uv = uv[away > 1e-9]
    if len(uv) < 3:
        raise FormatError("A loop must enclose area; one has none. Rebuild the face in Rhino.")
    return uv


def _turned(ring: Floats, sign: float) -> Floats:
    """The ring counterclockwise for sign 1, clockwise for -1."""
    x, y = (ring - ring[0]).T
    area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    return ring if area * sign > 0.0 else ring[::-1].copy()
