"""What a method made of a mesh: the same few numbers for every method, computed here.

Written apart from the measures and the guard of pqmesh, so that they do not judge themselves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.meshes import Case
from pqmesh.mesh.topology import Topology

Floats = NDArray[np.float64]

# A corner whose sine, seen against the face's area, is smaller is closed, flat or turned in.
LEAST_SINE = 0.01
# An edge below this share of the mean edge has collapsed, and its faces are broken.
LEAST_EDGE = 0.01


def judged(case: Case, points: Floats) -> dict[str, float]:
    """Numbers of moved vertices (V, 3) against the start; lengths are in mean edges of the start.

    Returns
    -------
    dict
        planarity and balance (radians) before and after, moved_max, deviation_rms from the start
        surface, edge_ratio (the edge that shrank most), shortest_ratio (shortest edge after over
        shortest before), broken_before, broken_new, boundary_drift.
    """
    start, topology = case.mesh.vertices, case.mesh.topology
    if points.shape != start.shape or not np.isfinite(points).all():
        raise ArithmeticError(f"the result must be finite, of shape {start.shape}")
    length = case.mesh.mean_edge_length
    edges_before, edges_after = edge_lengths(start, topology), edge_lengths(points, topology)
    broken = broken_faces(start, start, topology)
    feet = case.reference.closest(points)[0]
    return {
        "planarity_before": planarity(start, topology),
        "planarity_after": planarity(points, topology),
        "balance_before": balance(start, topology),
        "balance_after": balance(points, topology),
        "moved_max": float(np.linalg.norm(points - start, axis=1).max() / length),
        "deviation_rms": float(np.sqrt(np.mean(np.sum((points - feet) ** 2, axis=1))) / length),
        "edge_ratio": float((edges_after / edges_before).min()),
        "shortest_ratio": float(edges_after.min() / edges_before.min()),
        "broken_before": int(broken.sum()),
        "broken_new": int((broken_faces(points, start, topology) & ~broken).sum()),
        "boundary_drift": boundary_drift(start, points, topology) / length,
    }


def edge_lengths(points: Floats, topology: Topology) -> Floats:
    """Lengths of all edges, (E,)."""
    ends = points[topology.edges]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def planarity(points: Floats, topology: Topology) -> float:
    """Largest distance of a quad's diagonals over their mean length; 0 for parallel ones."""
    a, b, c, d = np.moveaxis(points[topology.quads], 1, 0)
    across = np.cross(c - a, d - b)
    area = np.linalg.norm(across, axis=1)
    size = 0.5 * (np.linalg.norm(c - a, axis=1) + np.linalg.norm(d - b, axis=1))
    volume = np.abs(np.sum((b - a) * across, axis=1))
    return float((volume / np.where(area * size > 0, area * size, np.inf)).max())


def balance(points: Floats, topology: Topology) -> float:
    """Largest |w1 - w2 + w3 - w4| at interior vertices of valence 4, radians."""
    worst = 0.0
    for star in topology.stars():
        if star.neighbors.shape[1] == 4:
            spokes = points[star.neighbors] - points[star.vertices][:, None]
            following = np.roll(spokes, -1, axis=1)
            sine = np.linalg.norm(np.cross(spokes, following), axis=2)
            angles = np.arctan2(sine, np.sum(spokes * following, axis=2))
            worst = float(np.abs(angles @ [1.0, -1.0, 1.0, -1.0]).max())
    return worst


def broken_faces(points: Floats, start: Floats, topology: Topology) -> NDArray[np.bool_]:
    """Faces (F,) with a corner closed, flat or reflex, a collapsed edge, or turned over.

    Turned over: by more than a right angle against their start; no method turns the whole mesh.
    """
    shortest = LEAST_EDGE * edge_lengths(start, topology).mean()
    turns, sizes, outgoing = _corner_turns(points[topology.quads])
    areas, areas_before = turns.sum(axis=1), _corner_turns(start[topology.quads])[0].sum(axis=1)
    normals = areas / np.maximum(np.linalg.norm(areas, axis=1), 1e-300)[:, None]
    sines = np.sum(turns * normals[:, None], axis=2) / np.maximum(sizes, 1e-300)
    collapsed = (np.linalg.norm(outgoing, axis=2) < shortest).any(axis=1)
    turned = np.sum(areas * areas_before, axis=1) < 0
    return collapsed | (sines.min(axis=1) < LEAST_SINE) | turned


def _corner_turns(quads: Floats) -> tuple[Floats, Floats, Floats]:
    """Cross products of the edges at the corners (F, 4, 3), products of their lengths, edges.

    The cross products of a quad sum to four times its area vector.
    """
    outgoing = np.roll(quads, -1, axis=1) - quads
    incoming = np.roll(outgoing, 1, axis=1)
    sizes = np.linalg.norm(incoming, axis=2) * np.linalg.norm(outgoing, axis=2)
    return np.cross(incoming, outgoing), sizes, outgoing


def boundary_drift(start: Floats, points: Floats, topology: Topology) -> float:
    """Largest distance of a boundary vertex from the start boundary, model unit."""
    first, last = np.moveaxis(start[topology.edges[topology.is_boundary_edge]], 1, 0)
    along = last - first
    square = np.sum(along**2, axis=1)
    worst = 0.0
    for point in points[topology.is_boundary_vertex]:
        share = np.clip(np.sum((point - first) * along, axis=1) / square, 0.0, 1.0)
        gaps = np.linalg.norm(point - first - share[:, None] * along, axis=1)
        worst = max(worst, float(gaps.min()))
    return worst
