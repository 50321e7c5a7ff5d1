"""Start meshes to compare with: the thesis' own tracing, and the grid of parameter lines."""

from __future__ import annotations

import numpy as np

from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.quads import manifold_part
from pqmesh.network.region import PlanOutline
from pqmesh.surface.base import Surface
from pqmesh.surface.closest import closest_point
from pqmesh.surface.curvature import shape_data


def euler_mesh(surface: Surface, outline: PlanOutline, edge: float) -> tuple[QuadMesh, np.ndarray]:
    """Mesh of steps along principal directions, each projected back to the surface.

    This is the tracing of the thesis, section 6.2 (Euler's method): one line of the first family,
    and from each of its nodes a line of the second; nodes are steps, not intersections.
    """
    domain = surface.domain
    start = np.array([[sum(domain.u) / 2, sum(domain.v) / 2]])
    spine = _walk(surface, start, 0, edge)
    rows = [_walk(surface, uv[None], 1, edge, reference=_across(surface, uv[None])) for uv in spine]
    # Rows are aligned at the spine: index 0 of each is its spine node.
    offsets = [
        int(np.argmin(np.abs(row - uv).sum(axis=1))) for row, uv in zip(rows, spine, strict=True)
    ]
    low = -max(offsets)
    high = max(len(row) - k for row, k in zip(rows, offsets, strict=True))
    table = np.full((len(rows), high - low, 2), np.nan)
    for i, (row, k) in enumerate(zip(rows, offsets, strict=True)):
        table[i, -k - low : len(row) - k - low] = row
    return _grid_mesh(surface, outline, table)


def parameter_mesh(
    surface: Surface, outline: PlanOutline, edge: float
) -> tuple[QuadMesh, np.ndarray]:
    """Mesh of parameter lines with about the wanted edge."""
    domain = surface.domain
    jet = surface.jet(domain.grid(40, 40).reshape(-1, 2))
    counts = [
        max(int(size * np.linalg.norm(d, axis=1).mean() / edge), 1)
        for size, d in zip(domain.size, (jet.du, jet.dv), strict=True)
    ]
    u = np.linspace(*domain.u, counts[0] + 1)
    v = np.linspace(*domain.v, counts[1] + 1)
    table = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    return _grid_mesh(surface, outline, table)


def _across(surface: Surface, uv: np.ndarray) -> np.ndarray:
    """One direction of the second family, the same way round for every node."""
    shape = shape_data(surface.jet(uv))
    direction = shape.directions[:, 1]
    return direction * np.sign(direction @ np.array([0.0, 1.0, 0.0]))[:, None]


def _walk(
    surface: Surface,
    start: np.ndarray,
    family: int,
    edge: float,
    reference: np.ndarray | None = None,
) -> np.ndarray:
    """Parameters of the steps both ways from a start, in order."""
    arms = []
    for sign in (-1.0, 1.0):
        uv, arm = start, []
        shape = shape_data(surface.jet(uv))
        last = sign * (shape.directions[:, family] if reference is None else reference)
        while len(arm) < 400:
            jet = surface.jet(uv)
            direction = shape_data(jet).directions[:, family]
            direction = direction * np.sign((direction * last).sum())
            uv, _, _ = closest_point(surface, jet.point + edge * direction, uv)
            at_bound = (uv <= surface.domain.low) | (uv >= surface.domain.high)
            if at_bound.any():
                break
            last = direction
            arm.append(uv[0])
        arms.append(arm)
    return np.array([*arms[0][::-1], start[0], *arms[1]])


def _grid_mesh(
    surface: Surface, outline: PlanOutline, table: np.ndarray
) -> tuple[QuadMesh, np.ndarray]:
    """Quads of a table of parameters (rows, columns, 2) that touch the outline."""
    m, n = table.shape[:2]
    known = np.isfinite(table).all(axis=2)
    points = np.full((m, n, 3), np.nan)
    points[known] = surface.jet(table[known]).point
    index = np.arange(m * n).reshape(m, n)
    quads = np.stack(
        [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    flat = points.reshape(-1, 3)
    good = np.isfinite(flat[quads]).all(axis=(1, 2))
    good[good] &= outline.contains(flat[quads[good]].mean(axis=1))
    quads = quads[manifold_part(quads, good)]
    used, corners = np.unique(quads, return_inverse=True)
    mesh = QuadMesh.of(flat[used], corners.reshape(-1, 4))
    if mesh.face_area_vectors[:, 2].sum() < 0:
        mesh = mesh.reversed()
    return mesh, table.reshape(-1, 2)[used]
