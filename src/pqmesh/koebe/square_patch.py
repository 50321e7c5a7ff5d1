"""A principal patch whose Gauss image has squares, as nearly as the surface allows.

Koebe meshes of a square grid are discrete conformal maps: their faces are nearly squares. The Gauss
image of a mesh of curvature lines has right angles, and its faces can be made squares by spacing
the lines exactly when log(|dN| along one family / |dN| along the other) is a sum of a function of
either line: the surface is L-isothermic. Surfaces of revolution, quadrics and minimal surfaces are.
On others the best such sum is taken, and what it misses tells beforehand how far the surface is
from having edge offsets.

References: [musso2000].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import NetworkError
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.crossings import crossings
from pqmesh.network.lines import Lines, selected
from pqmesh.network.trace import Limits, principal_field, trace
from pqmesh.surface.base import Surface
from pqmesh.surface.curvature import shape_data
from pqmesh.vectors import Floats, norm

# Lines of each family by which the spacing is measured, and the tolerance of tracing over size.
PROBES, TOLERANCE = 25, 1e-10
# Lines are followed so much further than the patch reaches on the axis beside them.
REACH = 1.6


@dataclass(frozen=True, eq=False)
class SquarePatch:
    """A grid of curvature lines with a Gauss image of squares, as nearly as there is one.

    Attributes
    ----------
    mesh : QuadMesh
        m x n faces, normals along X_u x X_v.
    uv : (V, 2)
        Parameters of its vertices.
    defect : float
        Root mean square of what the logarithm of the aspect ratio of the Gauss image's faces keeps
        beyond all spacings; 0 on L-isothermic surfaces.
    """

    mesh: QuadMesh
    uv: Floats
    defect: float


def square_patch(
    surface: Surface, center: Floats, extent: tuple[float, float], faces: int
) -> SquarePatch:
    """Patch of curvature lines around a point, spaced for a Gauss image of squares.

    Parameters
    ----------
    surface : Surface
    center : (2,)
        Parameters of the middle.
    extent : (float, float), model unit
        Half the length of the patch along the lines of larger and of smaller curvature through
        the center.
    faces : int
        Number of faces along the first; that along the other follows.

    Raises
    ------
    NetworkError
        When the lines leave the surface or do not form a grid there, or a principal curvature
        vanishes, where the Gauss image has no width.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> bowl = graph_surface("0.2*x**2+0.1*y**2", (-1.5, 1.5), (-1.5, 1.5))
    >>> patch = square_patch(bowl, np.array([0.0, 0.0]), (0.5, 0.9), 6)
    >>> patch.mesh.topology.n_faces, patch.defect < 1e-3
    (30, True)
    """
    frame = _Frame.of(surface, center, extent)
    probe = [np.linspace(-1.0, 1.0, PROBES) * side for side in extent]
    _, normals = frame.grid(*probe)
    ratio, defect = _split(normals)
    steps = _even_steps(*ratio)
    count = max(2, round(faces * steps[1][-1] / steps[0][-1]))
    marks = [
        np.interp(np.linspace(0.0, 1.0, n + 1) * total[-1], total, line)
        for n, total, line in zip((faces, count), steps, probe, strict=True)
    ]
    uv, _ = frame.grid(*marks)
    points = surface.jet(uv.reshape(-1, 2)).point.reshape(*uv.shape[:2], 3)
    mesh = grid_mesh(points)
    if (mesh.face_normals * shape_data(surface.jet(uv[:1, 0])).normal).sum(axis=1).mean() < 0:
        mesh = mesh.reversed()
    return SquarePatch(mesh, uv.reshape(-1, 2), defect)


def square_edges(surface: Surface, uv: Floats, edge: float) -> tuple[float, float]:
    """Panel edges along both families whose Gauss image is a square in the mean, model unit.

    For `trace_network`, where a region with an outline is wanted instead of a patch: an edge e is
    turned into about |k| e on the sphere, so that e_1 / e_2 = |k_2 / k_1|. Their geometric mean is
    the given edge.

    Parameters
    ----------
    surface : Surface
    uv : (N, 2)
        Points of the region.
    edge : float, model unit

    Raises
    ------
    NetworkError
        When a principal curvature vanishes on the whole, or changes its sign, in the region.

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> bowl = graph_surface("x**2 + 0.25*y**2", (-1, 1), (-1, 1))
    >>> [round(e, 3) for e in square_edges(bowl, np.array([[0.0, 0.0]]), 0.1)]
    [0.05, 0.2]
    """
    k = shape_data(surface.jet(uv)).k
    if (np.sign(k) * np.sign(k[:1]) <= 0.0).any():
        worst = int(np.abs(k).min(axis=1).argmin())
        raise NetworkError(
            f"Both principal curvatures must keep their signs; near u, v = {uv[worst].tolist()} "
            f"one passes 0. Choose a region without parabolic lines."
        )
    ratio = float(np.exp(0.5 * np.log(np.abs(k[:, 1] / k[:, 0])).mean()))
    return edge * ratio, edge / ratio


@dataclass(frozen=True, eq=False)
class _Frame:
    """Two crossing lines of curvature, from whose points the families start."""

    surface: Surface
    axes: Lines
    middle: Floats
    extent: tuple[float, float]
    limits: Limits

    @classmethod
    def of(cls, surface: Surface, center: Floats, extent: tuple[float, float]) -> _Frame:
        """The lines through a point."""
        size = float(max(extent))
        limits = Limits(
            step=0.1 * size, length=2.0 * size, tolerance=TOLERANCE * size, turn=1e-6 * size
        )
        seed = np.asarray(center, dtype=np.float64)[None]
        shape = shape_data(surface.jet(seed))
        axes = trace(
            surface, principal_field(0.0), np.repeat(seed, 2, axis=0), shape.directions[0], limits
        )
        meeting = crossings(surface, _one(axes, 0), _one(axes, 1))
        if not len(meeting):
            raise NetworkError(
                f"The curvature lines through the center {seed[0].tolist()} must cross there; they "
                f"end. Choose a center away from umbilics and inside the surface."
            )
        nearest = int(norm(_flat(meeting.uv - seed)).argmin())
        arcs = meeting.arcs[nearest]
        return cls(surface, axes, arcs, extent, limits)

    def grid(self, first: Floats, second: Floats) -> tuple[Floats, Floats]:
        """Parameters (a, b, 2) and normals (a, b, 3) of the grid at these arc lengths."""
        seeds = [self._seeds(0, first), self._seeds(1, second)]
        families = [self._family(axis, uv) for axis, uv in enumerate(seeds)]
        found = crossings(self.surface, *families)
        # Around umbilics lines meet again: the crossing nearest to the axes is the wanted one.
        places = self.surface.jet(found.uv).point
        far = sum(
            norm(places - self.surface.jet(uv).point[found.lines[:, axis]])
            for axis, uv in enumerate(seeds)
        )
        order = np.argsort(-np.asarray(far), kind="stable")
        table = np.full((len(first), len(second), 2), np.nan)
        table[found.lines[order, 0], found.lines[order, 1]] = found.uv[order]
        missing = np.isnan(table[..., 0])
        if missing.any():
            raise NetworkError(
                f"The curvature lines around the center must form a grid; {int(missing.sum())} of "
                f"{missing.size} crossings are missing. Make the extent smaller, or the surface's "
                f"domain larger."
            )
        normal = shape_data(self.surface.jet(table.reshape(-1, 2))).normal
        return table, normal.reshape(*table.shape[:2], 3)

    def _seeds(self, axis: int, marks: Floats) -> Floats:
        """Parameters (n, 2) on an axis at arc lengths from the middle."""
        arcs = self.middle[axis] + marks
        total = float(self.axes.total[axis])
        if arcs.min() < 0.0 or arcs.max() > total:
            reach = min(self.middle[axis], total - self.middle[axis])
            raise NetworkError(
                f"The patch must lie on the surface; the line through the center ends after "
                f"{reach:.6g}, and {np.abs(marks).max():.6g} is wanted. Make the extent smaller."
            )
        where = self.axes.locate(np.full(len(arcs), axis), arcs)
        return self.surface.domain.reduce(self.axes.at(*where))

    def _family(self, axis: int, seeds: Floats) -> Lines:
        """Lines of curvature across an axis."""
        shape = shape_data(self.surface.jet(seeds))
        along = shape_data(self.surface.jet(seeds[:1])).directions[0, axis]
        # Across the axis is the direction of the other family, told apart by continuity.
        directions = np.empty((len(seeds), 3))
        for row, both in enumerate(shape.directions):
            best = both[np.abs(both @ along).argmax()]
            along = best * np.sign(best @ along)
            directions[row] = both[np.abs(both @ along).argmin()]
        limits = self.limits._replace(length=REACH * self.extent[1 - axis])
        return trace(self.surface, principal_field(0.0), seeds, directions, limits)


def _one(lines: Lines, which: int) -> Lines:
    """One line of a bundle."""
    return selected(lines, np.array([which]))


def _flat(uv: Floats) -> Floats:
    """Parameter differences as rows of three."""
    return np.column_stack([uv, np.zeros(len(uv))])


def _split(normals: Floats) -> tuple[tuple[Floats, Floats], float]:
    """Logarithm of the Gauss image's aspect ratio as a sum of terms of either family."""
    first = norm(np.diff(normals, axis=0))
    second = norm(np.diff(normals, axis=1))
    if min(first.min(), second.min()) < 1e-6 * max(first.max(), second.max()):
        raise NetworkError(
            "Both principal curvatures must differ from 0; along one family the normal hardly "
            "turns. Choose a part of the surface without parabolic lines."
        )
    log = np.log(0.5 * (first[:, 1:] + first[:, :-1])) - np.log(0.5 * (second[1:] + second[:-1]))
    rows, columns = log.mean(axis=1), log.mean(axis=0) - log.mean()
    rest = log - rows[:, None] - columns[None]
    return (rows, columns), float(np.sqrt((rest**2).mean()))


def _even_steps(rows: Floats, columns: Floats) -> tuple[Floats, Floats]:
    """Coordinates of the lines of either family in which the Gauss image has squares."""
    # log |dN_1| - log |dN_2| = rows + columns: dN_1 over exp(rows) is dN_2 over exp(-columns).
    first = np.concatenate([[0.0], np.cumsum(np.exp(rows))])
    second = np.concatenate([[0.0], np.cumsum(np.exp(-columns))])
    return first, second
