"""Angle between two edges at a corner, with its gradient; and the two balances built of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Indices, angle, cross, dot, norm

_ALTERNATING = np.array([1.0, -1.0, 1.0, -1.0])


def angle_gradient(p: Floats, q: Floats) -> tuple[Floats, Floats, Floats]:
    """Angle between rows p and q, and its gradients with respect to p and to q.

    The gradient lies in the plane of p and q, across p, of length 1/|p|.
    """
    normal = cross(p, q)
    sine = norm(normal)
    value = np.arctan2(sine, dot(p, q))
    normal = normal / np.where(sine > TINY, sine, 1.0)[..., None]
    by_p = cross(p, normal) / np.maximum(dot(p, p), TINY)[..., None]
    by_q = -cross(q, normal) / np.maximum(dot(q, q), TINY)[..., None]
    return value, by_p, by_q


@dataclass(frozen=True, eq=False)
class Conicality:
    """Balance w1 - w2 + w3 - w4 at each interior vertex of valence 4, radians.

    References: [thesis] theorem 4.1.1; errata page, E15 and E26 (the printed functional is wrong).
    """

    stencils: Mapping[str, Indices]

    @classmethod
    def on(cls, mesh: PolyMesh) -> Conicality:
        """One element for each interior vertex of valence 4: the vertex and its neighbours."""
        rows = [
            np.column_stack([star.vertices, star.neighbors])
            for star in mesh.topology.stars()
            if star.neighbors.shape[1] == 4
        ]
        return cls({"vertices": np.concatenate(rows) if rows else np.empty((0, 5), np.int64)})

    def residual(self, rows: Floats) -> Floats:
        """Residuals (n, 1) alone."""
        spokes = rows[:, 1:] - rows[:, :1]
        return np.asarray(angle(spokes, np.roll(spokes, -1, axis=1)) @ _ALTERNATING)[:, None]

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 1) and Jacobian (n, 1, 5, 3)."""
        spokes = rows[:, 1:] - rows[:, :1]
        value, by_p, by_q = angle_gradient(spokes, np.roll(spokes, -1, axis=1))
        signed = _ALTERNATING[:, None]
        outer = signed * by_p + np.roll(signed * by_q, 1, axis=1)
        jacobian = np.concatenate([-outer.sum(axis=1, keepdims=True), outer], axis=1)
        return (value @ _ALTERNATING)[:, None], jacobian[:, None]


@dataclass(frozen=True, eq=False)
class Circularity:
    """Alternating sum of the corner angles of each quad, radians.

    Triangles have a circle. A polygon is a fan of k - 3 quads from its first corner, each sharing
    three corners, and so its circle, with the next.

    References: [thesis] section 3.2; errata page, E12 (for flat, uncrossed quads).
    """

    stencils: Mapping[str, Indices]

    @classmethod
    def on(cls, mesh: PolyMesh) -> Circularity:
        """One element for each quad, k - 3 for a polygon of k corners."""
        quads = [np.empty((0, 4), dtype=np.int64)]
        for _, corners in mesh.topology.face_groups:
            for i in range(1, corners.shape[1] - 2):
                quads.append(corners[:, [0, i, i + 1, i + 2]])
        return cls({"vertices": np.concatenate(quads)})

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, 1) and Jacobian (m, 1, 4, 3)."""
        following = np.roll(rows, -1, axis=1) - rows
        previous = np.roll(rows, 1, axis=1) - rows
        value, by_p, by_q = angle_gradient(following, previous)
        by_p, by_q = _ALTERNATING[:, None] * by_p, _ALTERNATING[:, None] * by_q
        jacobian = np.roll(by_p, 1, axis=1) + np.roll(by_q, -1, axis=1) - by_p - by_q
        return (value @ _ALTERNATING)[:, None], jacobian[:, None]
