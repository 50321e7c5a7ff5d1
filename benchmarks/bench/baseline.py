"""The plain method to be measured against: Gauss-Newton in the 3 V coordinates, without control.

Residuals are the diagonal distance of each quad and, for conical meshes, the balance of angles at
each interior vertex of valence 4; fairness (second differences) and closeness (tangent planes),
both relative to the start, hold the rest with weights that fade tenfold each step. Each step
solves the damped normal equations with SciPy's SuperLU and is taken in full: no line search, no
guard, no second try. It shares no code with the terms of pqmesh: the derivatives here are derived
and written on their own.

References: [liu2006], [wang2007] for the residuals; [nocedal2006] chapter 10 for the method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array, csr_array, eye_array, kron
from scipy.sparse.linalg import splu

from pqmesh.mesh.quadmesh import QuadMesh

Floats = NDArray[np.float64]

# Weights of fairness and closeness at the first step, and how they fade from step to step; the
# damping fades more gently. All multiply residuals, so their squares stand in the equations.
FAIRNESS, CLOSENESS, FADING = 0.1, 0.05, 0.1
DAMPING, DAMPING_FADING = 1e-3, 0.5
# Reached: planarity, and balance in radians. Given up: after so many steps, or so many of them
# without a better result.
PLANARITY, BALANCE = 1e-12, 1e-12
MOST_STEPS, PATIENCE = 20, 3
# Not better for a while counts as a stall only so near the end, in tolerances: rounding. Farther
# out the plain method goes on.
NEARLY = 1e3
KINDS = ("planar", "conical")


@dataclass(frozen=True)
class Outcome:
    """Where the baseline ended.

    Attributes
    ----------
    vertices : (V, 3), model unit
        The best positions met where that was reached or stalled, else the last.
    planarity : float
        Largest diagonal distance over the mean diagonal of its quad.
    balance : float
        Largest balance, radians; 0 for planar meshes.
    steps : int
    converged : bool
    reason : str
    """

    vertices: Floats
    planarity: float
    balance: float
    steps: int
    converged: bool
    reason: str


def gauss_newton(mesh: QuadMesh, kind: str) -> Outcome:
    """Planar or conical mesh by plain Gauss-Newton steps from a start mesh."""
    if kind not in KINDS:
        raise ValueError(f"The baseline makes meshes {' or '.join(KINDS)}; found {kind!r}.")
    length, origin = mesh.mean_edge_length, mesh.vertices.mean(axis=0)
    start = points = (mesh.vertices - origin) / length
    system = _System(mesh, kind)
    hold_fair, hold_close = _fairness(mesh), _closeness(mesh)
    identity = eye_array(start.size, format="csc")
    best, best_step, reason = (np.inf, points, np.inf, np.inf), 0, ""
    for step in range(MOST_STEPS + 1):
        with np.errstate(all="ignore"):
            residual, jacobian = system.linearised(points)
            found = system.judged(points, residual)
        score = max(found[0] / PLANARITY, found[1] / BALANCE)
        if not np.isfinite(score):
            reason = "diverged"
            break
        if score < best[0]:
            best, best_step = (score, points, *found), step
        if score <= 1.0 or (step - best_step >= PATIENCE and best[0] <= NEARLY):
            reason = "reached" if score <= 1.0 else "stalled"
            break
        if step == MOST_STEPS:
            reason = f"not reached in {MOST_STEPS} steps"
            break
        fading = FADING ** (2 * step)
        soft = FAIRNESS**2 * fading * hold_fair + CLOSENESS**2 * fading * hold_close
        damped = soft + DAMPING**2 * DAMPING_FADING ** (2 * step) * identity
        gradient = jacobian.T @ residual + soft @ (points - start).reshape(-1)
        move = _solved(csc_array(jacobian.T @ jacobian) + damped, gradient)
        if move is None:
            reason = "singular"
            break
        points = points - move.reshape(-1, 3)
    if reason in ("reached", "stalled"):
        _, points, *found = best
    return Outcome(origin + length * points, *found, step, reason == "reached", reason)


def _solved(matrix: csc_array, rhs: Floats) -> Floats | None:
    """Solution of the normal equations, None where they are singular."""
    try:
        factor = splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:
        return None
    return factor.solve(rhs)


class _System:
    """Residuals and their sparse Jacobian; its pattern is built once."""

    def __init__(self, mesh: QuadMesh, kind: str) -> None:
        self.faces = mesh.faces
        stars = [s for s in mesh.topology.stars() if s.neighbors.shape[1] == 4]
        self.stars = np.empty((0, 5), np.int64)
        if kind == "conical" and stars:
            self.stars = np.column_stack([stars[0].vertices, stars[0].neighbors])
        columns = [
            (3 * rows[:, :, None] + np.arange(3)).reshape(len(rows), 3 * rows.shape[1])
            for rows in (self.faces, self.stars)
        ]
        self._columns = np.concatenate([part.reshape(-1) for part in columns]).astype(np.int32)
        counts = np.concatenate([np.full(len(part), part.shape[1]) for part in columns])
        self._starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        self._shape = (len(counts), mesh.vertices.size)

    def linearised(self, points: Floats) -> tuple[Floats, csr_array]:
        distance, by_corner = diagonal_distance(points[self.faces])
        balance, by_star = angle_balance(points[self.stars])
        values = np.concatenate([by_corner.reshape(-1), by_star.reshape(-1)])
        jacobian = csr_array((values, self._columns, self._starts), shape=self._shape)
        return np.concatenate([distance, balance]), jacobian

    def judged(self, points: Floats, residual: Floats) -> tuple[float, float]:
        """Largest planarity and largest balance."""
        a, b, c, d = np.moveaxis(points[self.faces], 1, 0)
        diagonals = 0.5 * (np.linalg.norm(c - a, axis=1) + np.linalg.norm(d - b, axis=1))
        flat, rest = np.split(np.abs(residual), [len(self.faces)])
        return float((flat / diagonals).max()), float(rest.max(initial=0.0))


def diagonal_distance(quads: Floats) -> tuple[Floats, Floats]:
    """Signed distances (F,) of the diagonals of quads (F, 4, 3), and gradients (F, 4, 3).

    The quotient det(b - a, c - a, d - b) / |(c - a) x (d - b)| is differentiated as it stands.
    """
    a, b, c, d = np.moveaxis(quads, 1, 0)
    p, q, w = c - a, d - b, b - a
    across = _cross(p, q)
    size = np.sqrt(np.einsum("fi,fi->f", across, across))[:, None]
    normal = across / size
    value = np.einsum("fi,fi->f", w, normal)
    # A turning normal counts by what of w lies across it.
    tilt = (w - value[:, None] * normal) / size
    by_p, by_q = _cross(q, tilt), _cross(tilt, p)
    return value, np.stack([-normal - by_p, normal - by_q, by_p, by_q], axis=1)


def angle_balance(stars: Floats) -> tuple[Floats, Floats]:
    """Balance w1 - w2 + w3 - w4 (n,) of stars (n, 5, 3), centre first, and gradients (n, 5, 3)."""
    spokes = stars[:, 1:] - stars[:, :1]
    lengths = np.sqrt(np.einsum("nki,nki->nk", spokes, spokes))[..., None]
    here = spokes / lengths
    there = np.roll(here, -1, axis=1)
    cosine = np.einsum("nki,nki->nk", here, there)[..., None]
    # The rejections have length sine, with full accuracy near 0 and pi.
    of_there, of_here = there - cosine * here, here - cosine * there
    sine = np.sqrt(np.einsum("nki,nki->nk", of_there, of_there))[..., None]
    sign = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    value = np.arctan2(sine, cosine)
    by_here = -sign * of_there / (lengths * sine)
    by_there = -sign * of_here / (np.roll(lengths, -1, axis=1) * sine)
    outer = by_here + np.roll(by_there, 1, axis=1)
    gradient = np.concatenate([-outer.sum(axis=1, keepdims=True), outer], axis=1)
    return (sign * value).sum(axis=(1, 2)), gradient


def _fairness(mesh: QuadMesh) -> csc_array:
    """Normal matrix of the change of second differences along mesh lines, (3V, 3V)."""
    triples = mesh.topology.straight_triples
    rows = np.repeat(np.arange(len(triples)), 3)
    values = np.tile([1.0, -2.0, 1.0], len(triples))
    shape = (len(triples), mesh.topology.n_vertices)
    differences = csr_array((values, (rows, triples.reshape(-1))), shape=shape)
    return csc_array(kron(differences.T @ differences, eye_array(3)))


def _closeness(mesh: QuadMesh) -> csc_array:
    """Normal matrix of the distances to the tangent planes of the start, (3V, 3V)."""
    normals = mesh.vertex_normals
    count = len(normals)
    row = 3 * np.arange(count)[:, None, None] + np.arange(3)[:, None]
    rows = np.broadcast_to(row, (count, 3, 3))
    values = np.einsum("vi,vj->vij", normals, normals)
    places = (rows.reshape(-1), rows.transpose(0, 2, 1).reshape(-1))
    return csc_array((values.reshape(-1), places), shape=(3 * count, 3 * count))


def _cross(a: Floats, b: Floats) -> Floats:
    """Cross products of rows."""
    ax, ay, az = a[:, 0], a[:, 1], a[:, 2]
    bx, by, bz = b[:, 0], b[:, 1], b[:, 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
