"""Meshes, outlines and checks that the trimming tests share."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np

from pqmesh.fabricate.clip import cut_faces
from pqmesh.fabricate.panels import polygons_mesh
from pqmesh.fabricate.tidy import area_vector
from pqmesh.fabricate.walls import outline_walls
from pqmesh.mesh.exact import rotational_mesh, translational_mesh
from pqmesh.network.region import PlanOutline

U_SHAPE = [[0.5, 0.5], [3.5, 0.5], [3.5, 3.5], [2.6, 3.5], [2.6, 1.5], [1.3, 1.5], [1.3, 3.5],
           [0.5, 3.5]]  # fmt: skip


def plane_grid(m=4, n=4, slope=(0.0, 0.0), start=(0.0, 0.0)):
    """Unit squares in plan on the plane z = slope . (x, y), number i * n + j."""
    a = [[start[0] + i, 0, slope[0] * i] for i in range(m + 1)]
    b = [[0, start[1] + j, slope[1] * j] for j in range(n + 1)]
    return translational_mesh(a, b)


def vault(m=12, n=10):
    """A plane quad mesh curved in both directions, cells about 1 wide over [0, m] x [0, n]."""
    a = [[i + 0.1 * np.sin(i), 0.07 * i, 0.4 * np.sin(0.4 * i)] for i in range(m + 1)]
    b = [[0.05 * j, j + 0.1 * np.cos(2 * j), 0.3 * np.cos(0.5 * j)] for j in range(n + 1)]
    return translational_mesh(a, b)


def dome(rows=37, columns=40):
    """Part of a mesh of revolution: conical, seen as a roof from above."""
    turns = np.linspace(0.2, 1.3, rows + 1)
    profile = np.column_stack([40 * np.sin(turns), 30 * np.cos(turns)])
    return rotational_mesh(profile[::-1], np.arange(columns + 1) * 0.04)


def square(low, high):
    """Square outline."""
    return PlanOutline([[low, low], [high, low], [high, high], [low, high]])


def cut_pieces(mesh, outline):
    """Polygons and faces before slivers are merged."""
    pieces = cut_faces(mesh.vertices, mesh.faces, outline_walls(outline))
    return [pieces.nodes.at(loop) for loop in pieces.loops], pieces.face


def flatness(points):
    """Largest distance from the mean plane over the size."""
    normal = area_vector(points)
    away = points - points.mean(axis=0)
    size = np.linalg.norm(np.ptp(points, axis=0))
    return float(np.abs(away @ normal).max() / np.linalg.norm(normal) / size)


def open_sides(panels):
    """Ends (n, 2, 3) of the sides that no neighbour runs back along, bit for bit."""
    points, faces = polygons_mesh(panels.polygons)
    count = Counter(side for face in faces for side in pairwise([*face, face[0]]))
    assert max(count.values()) == 1
    sides = [side for side in count if side[::-1] not in count]
    return points[np.array(sides).reshape(-1, 2)]


def outline_gap(points, outline):
    """Distance in plan from the nearest side of the outline, (n,)."""
    gaps = []
    for ring in outline.rings:
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            share = np.clip((points[:, :2] - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            gaps.append(np.linalg.norm(points[:, :2] - a - share[:, None] * (b - a), axis=1))
    return np.min(gaps, axis=0)
