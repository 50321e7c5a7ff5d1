"""Meshes parallel to a Koebe mesh: all have edge offsets, and one is nearest to a target."""

from __future__ import annotations

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.linear import Factor, SymmetricPattern
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.vectors import TINY, Floats, Indices, norm

# Soft goals over parallel edges; rounds of multipliers, and when they end.
SOFT, ROUNDS, PARALLEL = 1e-6, 60, 1e-14


def parallel_member(
    image: QuadMesh, targets: Floats, normals: Floats | None = None, slide: float = 0.05
) -> QuadMesh:
    """Member of P(image) nearest to target points, edges parallel to rounding error.

    Least squares of the distances; with normals, of the distances along these, and `slide` times
    those across. Every member whose edges have a length has exact edge offsets when the image is a
    Koebe mesh: M + dS.

    Parameters
    ----------
    image : QuadMesh
        Planar, without edges of length 0.
    targets : (V, 3), model unit
    normals : (V, 3), optional
        Unit vectors.
    slide : float
        Weight of a length across the normal against one along it.

    Raises
    ------
    MeshError
        When the image has an edge of length 0.

    References: [thesis] section 2.2; errata page, E5.

    Examples
    --------
    >>> from pqmesh.koebe.families import square_koebe
    >>> image = square_koebe(4, 4, 0.2, (-0.3, -0.3))
    >>> bool(np.allclose(parallel_member(image, 3 * image.vertices).vertices, 3 * image.vertices))
    True
    """
    short = np.flatnonzero(image.edge_lengths <= TINY)
    if len(short):
        raise MeshError(
            f"Edges of the image must have a direction; edge {image.edges[short[0]].tolist()} has "
            f"length 0. Merge its ends."
        )
    along = image.edge_vectors / image.edge_lengths[:, None]
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    stiff = np.concatenate([-across, across], axis=2)
    links = (3 * image.edges[:, :, None] + np.arange(3)).reshape(-1, 6)
    weights = np.tile(np.eye(3), (len(targets), 1, 1))
    if normals is not None:
        outer = normals[:, :, None] * normals[:, None, :]
        weights = outer + slide**2 * (weights - outer)
    factor = _factored(stiff, links, weights)
    # Unknown is the move from the targets, so that far-away origins cost no digits.
    gaps = np.einsum("era,ea->er", stiff, targets.reshape(-1)[links])
    size, forces, moves = float(np.ptp(targets, axis=0).max()), np.zeros_like(gaps), np.empty(0)
    for _ in range(ROUNDS):
        pull = np.einsum("era,er->ea", stiff, gaps + forces)
        held = np.bincount(links.ravel(), pull.ravel(), 3 * len(targets))
        moves = factor.solve(-np.asarray(held, dtype=np.float64))
        rest = gaps + np.einsum("era,ea->er", stiff, moves[links])
        forces = forces + rest
        if norm(rest).max() <= PARALLEL * size:
            break
    return image.with_vertices(targets + moves.reshape(-1, 3))


def _factored(stiff: Floats, links: Indices, weights: Floats) -> Factor:
    """Factor of the normal equations: stiff rows (E, 3, 6), soft weights (V, 3, 3)."""
    count = len(weights)
    spots = (3 * np.arange(count)[:, None] + np.arange(3)).reshape(-1, 3)
    pattern = SymmetricPattern(
        np.concatenate([np.repeat(t, t.shape[1], axis=1).ravel() for t in (links, spots)]),
        np.concatenate([np.tile(t, (1, t.shape[1])).ravel() for t in (links, spots)]),
        3 * count,
    )
    local = np.einsum("era,erb->eab", stiff, stiff)
    return pattern.factor(pattern.values(np.concatenate([local.ravel(), SOFT * weights.ravel()])))
