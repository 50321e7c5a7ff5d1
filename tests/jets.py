"""Second-order jets of NURBS surfaces by two other programs: geomdl, and scipy with our quotients.

geomdl's surfaces are right inside spans and, at knots, take the derivative from the right as
`BSplineSurface.jet` does; that makes second derivatives at double knots comparable as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import NdBSpline

ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class Nurbs(NamedTuple):
    """A net as it was before it went into a file; weights None when polynomial."""

    points: np.ndarray
    degrees: tuple[int, int]
    knots: tuple[np.ndarray, np.ndarray]
    weights: np.ndarray | None = None

    @property
    def rows(self) -> np.ndarray:
        """Homogeneous control points, (n, m, 4)."""
        mass = np.ones(self.points.shape[:2]) if self.weights is None else self.weights
        return np.dstack([self.points * mass[..., None], mass])


def places(net: Nurbs, n: int = 60, seed: int = 0) -> np.ndarray:
    """Random parameters, then all pairs of knots and bounds, then knots paired with random ones."""
    rng = np.random.default_rng(seed)
    lines = []
    for axis in (0, 1):
        line, p = net.knots[axis], net.degrees[axis]
        lines.append(np.unique(line[p : len(line) - p]))
    low, high = (np.array([line[i] for line in lines]) for i in (0, -1))
    free = low + rng.random((n, 2)) * (high - low)
    pairs = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
    mixed = [
        np.column_stack([lines[0], low[1] + rng.random(len(lines[0])) * (high - low)[1]]),
        np.column_stack([low[0] + rng.random(len(lines[1])) * (high - low)[0], lines[1]]),
    ]
    return np.concatenate([free, pairs, *mixed])


def geomdl_jets(net: Nurbs, uv: np.ndarray) -> np.ndarray:
    """Point and derivatives by geomdl, (6, N, 3)."""
    from geomdl import NURBS, BSpline

    kind = BSpline if net.weights is None else NURBS
    other = kind.Surface(normalize_kv=False)
    other.degree_u, other.degree_v = net.degrees
    rows = net.points if net.weights is None else net.rows
    n, m = rows.shape[:2]
    other.set_ctrlpts(rows.reshape(n * m, -1).tolist(), n, m)
    other.knotvector_u, other.knotvector_v = (line.tolist() for line in net.knots)
    tables = [other.derivatives(u, v, order=2) for u, v in uv.tolist()]
    return np.array([[table[a][b] for table in tables] for a, b in ORDERS])


def scipy_jets(net: Nurbs, uv: np.ndarray) -> np.ndarray:
    """Point and derivatives by scipy's splines of the homogeneous net, (6, N, 3)."""
    spline = NdBSpline(net.knots, net.rows, net.degrees)
    x, xu, xv, xuu, xuv, xvv = (spline(uv, nu=order) for order in ORDERS)
    w, wu, wv, wuu, wuv, wvv = (row[:, 3:] for row in (x, xu, xv, xuu, xuv, xvv))
    x, xu, xv, xuu, xuv, xvv = (row[:, :3] for row in (x, xu, xv, xuu, xuv, xvv))
    # x = s w, differentiated twice and solved for s.
    s = x / w
    su, sv = (xu - s * wu) / w, (xv - s * wv) / w
    suu = (xuu - 2 * su * wu - s * wuu) / w
    suv = (xuv - su * wv - sv * wu - s * wuv) / w
    svv = (xvv - 2 * sv * wv - s * wvv) / w
    return np.stack([s, su, sv, suu, suv, svv])


def differences(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Largest difference of each derivative, (6,), over the largest of its lengths.

    A derivative that is zero everywhere, as second ones of degree 1, is measured by the point.
    """
    sizes = np.sqrt((expected**2).sum(axis=2)).max(axis=1)
    sizes = np.where(sizes > 1e-9 * sizes[0], sizes, sizes[0])
    return np.abs(found - expected).max(axis=(1, 2)) / sizes


# --- nets that try every kind ---------------------------------------------------------------


def torus_net(big: float = 7.0, small: float = 2.0) -> Nurbs:
    """A whole torus of four by four rational arcs: double knots, second derivatives that jump."""
    half = np.sqrt(0.5)
    ring = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]])
    mass = np.array([1, half] * 4 + [1])
    line = np.array([0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4.0])
    out = big + small * ring[:, 0]
    points = np.empty((9, 9, 3))
    points[..., 0], points[..., 1] = ring[:, :1] * out, ring[:, 1:] * out
    points[..., 2] = small * ring[:, 1]
    return Nurbs(points, (2, 2), (line, line), mass[:, None] * mass)


def weighted_net() -> Nurbs:
    """Cubic by quadratic with weights from 0.5 to 2 and uneven knots."""
    rng = np.random.default_rng(21)
    u = np.array([0, 0, 0, 0, 0.2, 0.25, 0.7, 1, 1, 1, 1.0])
    v = np.array([-1, -1, -1, 0.5, 1.5, 2, 3, 3, 3.0])
    return Nurbs(_hills(7, 6, rng), (3, 2), (u, v), 0.5 + 1.5 * rng.random((7, 6)))


def periodic_net() -> Nurbs:
    """Cubic and periodic in u: knots that are not clamped, the first rows once more at the end."""
    rng = np.random.default_rng(22)
    angles = 2 * np.pi * np.arange(9) / 9
    ring = np.stack([5 * np.cos(angles), 5 * np.sin(angles), 0 * angles], axis=1)
    rows = np.stack([ring * (1 + 0.2 * rng.random((9, 1))) + 2.0 * k * np.eye(3)[2]
                     for k in range(5)], axis=1)  # fmt: skip
    knots = np.arange(-3.0, 13.0), np.array([0, 0, 0, 0, 1, 2, 2, 2, 2.0])
    return Nurbs(np.concatenate([rows, rows[:3]]), (3, 3), knots)


def quintic_net() -> Nurbs:
    """Degree 5 both ways, uneven knots, some of them repeated."""
    rng = np.random.default_rng(23)
    u = np.array([0] * 6 + [0.3, 0.3, 0.35, 0.8] + [1] * 6, dtype=np.float64)
    v = np.array([0] * 6 + [10, 40, 40, 40] + [60] * 6, dtype=np.float64)
    return Nurbs(_hills(10, 10, rng), (5, 5), (u, v))


def _hills(n: int, m: int, rng: np.random.Generator) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 30, n), np.linspace(0, 20, m), indexing="ij")
    return np.stack([x, y, 4 * rng.random((n, m))], axis=-1) + 0.5 * rng.random((n, m, 3))


OWN = {
    "torus": torus_net,
    "weighted": weighted_net,
    "periodic": periodic_net,
    "degree 5": quintic_net,
}
