"""Planar quad meshes in general position, of any topology, for tests."""

from __future__ import annotations

import numpy as np

from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.quadmesh import QuadMesh


def pq_rows(rows, columns, seed=0, *, closed=False):
    """Grid (or annulus) of rows x columns planar quads without symmetry, row by row.

    The first row is any polygon. A plane is chosen through each edge of a row; the vertices of
    the next row lie where the planes of neighbouring edges meet.
    """
    rng = np.random.default_rng(seed)
    count = columns if closed else columns + 1
    spread = 2 * np.pi if closed else 0.3 * count
    turn = spread * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    size = max(count / 6, 1.5) + 0.1 * rng.normal(size=count)
    row = np.column_stack([size * np.cos(turn), size * np.sin(turn), 0.1 * rng.normal(size=count)])
    points = [row]
    for level in range(rows):
        following = np.roll(row, -1, axis=0) if closed else row[1:]
        before = row if closed else row[:-1]
        middle = 0.5 * (before + following)
        out = middle * [1, 1, 0] / np.linalg.norm(middle[:, :2], axis=1)[:, None]
        rise = np.array([0, 0, 1.0]) + (0.5 - 0.3 * level) * out
        rise = rise + 0.05 * rng.normal(size=rise.shape)
        normals = np.cross(following - before, rise)
        if closed:
            ways = np.cross(np.roll(normals, 1, axis=0), normals)
        else:
            inner = np.cross(normals[:-1], normals[1:])
            ways = np.vstack([rise[:1], inner, rise[-1:]])
        ways *= np.sign(ways[:, 2:]) / np.linalg.norm(ways, axis=1)[:, None]
        row = row + rng.uniform(0.5, 0.8, (len(row), 1)) * ways
        points.append(row)
    faces = grid_faces(rows, columns, (False, closed))
    return QuadMesh.of(np.concatenate(points), faces[:, ::-1])


def planarised(mesh, noise=0.0, seed=0, rounds=30):
    """The mesh moved by noise and then, by Newton steps of least size, to planar faces."""
    rng = np.random.default_rng(seed)
    points = mesh.vertices + noise * rng.normal(size=mesh.vertices.shape)
    faces, count = mesh.faces, len(mesh.faces)
    for _ in range(rounds):
        a, b, c, d = np.moveaxis(points[faces], 1, 0)
        volume = np.einsum("fi,fi->f", np.cross(b - a, c - a), d - a)
        gradients = [np.cross(c - a, d - a), np.cross(d - a, b - a), np.cross(b - a, c - a)]
        gradients = [-sum(gradients), *gradients]
        jacobian = np.zeros((count, len(points), 3))
        for corner, gradient in enumerate(gradients):
            jacobian[np.arange(count), faces[:, corner]] += gradient
        flat = jacobian.reshape(count, -1)
        step = np.linalg.lstsq(flat, -volume, rcond=1e-10)[0]
        points = points + step.reshape(-1, 3)
        if np.abs(step).max() < 1e-15:
            break
    return mesh.with_vertices(points)
