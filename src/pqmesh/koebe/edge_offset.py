"""Edge offsets: whether a mesh has them, its Gauss image, and the offset meshes.

A mesh M has edge offsets exactly when there is a mesh S parallel to M, without zero edges, all of
whose edge lines touch the unit sphere (Koebe mesh); then M + dS has all edge lines at distance |d|.
Contact may lie outside an edge. For three coordinates a vertex there is one equation an edge
beside those of P(M): a general planar mesh has no edge offset at all, and where one exists, it is
as a rule the only one up to its side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.koebe.edge_start import start_image
from pqmesh.linear import SymmetricPattern
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.offset.spaces import OffsetSpace, turned_edges
from pqmesh.offset.vectors import OffsetVectors
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm

# Largest error at which an image counts as one.
EXACT = 1e-9
MOST_STEPS, FEW_STEPS, DAMPING, ENOUGH = 60, 4, 1e-8, 1e-15
# Near an exact image the squares fall by orders; so many steps that keep this share end it.
STALLED, PATIENCE = 0.98, 3
# Free dimensions are counted by singular values, up to this many unknowns.
DENSE, RANK_TOLERANCE = 900, 1e-7
# An image with a shorter edge is none: translations have all edges of length 0.
COLLAPSED = 1e-7


@dataclass(frozen=True, eq=False)
class EdgeOffset:
    """Answer to whether a mesh has edge offsets.

    Attributes
    ----------
    exists : bool
    image : (V, 3) or None
        Vertices of the Gauss image S, on the side of the normals; None when there is none.
    error : float
        Of the best image found, per unit of offset: largest error of the distance of an edge's
        line, or distance of its two ends' moves across the edge.
    family_dimension : int or None
        Dimension of the family of images around this one, None when there is none or the mesh is
        too large to count (more than 300 vertices).
    """

    exists: bool
    image: Floats | None
    error: float
    family_dimension: int | None


def edge_offset_test(mesh: PolyMesh, tolerance: float = EXACT) -> EdgeOffset:
    """Whether a planar mesh has edge offsets, and its Gauss image.

    Parameters
    ----------
    mesh : QuadMesh
        Planar, without edges of length 0.
    tolerance : float
        Largest error per unit of offset at which an image counts.

    Raises
    ------
    MeshError
        For an edge of length 0.

    References: [thesis] section 4.2 and theorem 3.1.1 (2); errata page, E10 and E18.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> box = cube().with_vertices(cube().vertices * [1.0, 2.0, 3.0])
    >>> found = edge_offset_test(box)
    >>> found.exists, found.family_dimension
    (True, 0)
    >>> bool(np.allclose(found.image, cube().vertices / 2**0.5))
    True
    """
    image = nearest_image(mesh)
    error = image_error(mesh, image)
    if not error <= tolerance or _collapsed(mesh, image):
        return EdgeOffset(False, None, error, None)
    return EdgeOffset(True, image, error, _free_dimensions(mesh, image))


def edge_offset_space(mesh: PolyMesh, tolerance: float) -> OffsetSpace:
    """The edge offsets of a mesh, as `offset.spaces` has those of vertices and faces.

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> space = edge_offset_space(cube(), 1e-6)
    >>> space.exists, space.family_dimension, space.error < 1e-12
    (True, 0, True)
    """
    # A mesh that is not flat has none, and how near it comes need not be known to many digits.
    is_flat = float(planarity(mesh).max()) <= tolerance
    image = nearest_image(mesh, MOST_STEPS if is_flat else FEW_STEPS)
    error = image_error(mesh, image)
    exists = is_flat and error <= tolerance and not _collapsed(mesh, image)
    family = _free_dimensions(mesh, image) if exists else None
    return OffsetSpace("edge", exists, family, image, error, *turned_edges(mesh, image))


def edge_offset_vectors(mesh: PolyMesh) -> OffsetVectors:
    """Vectors s whose edge lines have distance 1 from the origin, as nearly as the mesh allows.

    `error` is that of `edge_offset_test`: rounding on a mesh with edge offsets.
    """
    image = nearest_image(mesh)
    return OffsetVectors("edge", image, image_error(mesh, image))


def edge_offset(mesh: QuadMesh, distance: float) -> QuadMesh:
    """Parallel mesh whose edges' lines lie at a constant distance, where the mesh has one.

    Elsewhere the nearest there is; `offset.offsets.edge_distance` tells how the distance varies.

    Parameters
    ----------
    mesh : QuadMesh
    distance : float, model unit
        Positive goes to the side of the normals.

    References: [thesis] theorem 3.1.1 (2) with erratum E10.

    Examples
    --------
    >>> from pqmesh.koebe.families import discrete_catenoid
    >>> from pqmesh.offset.distances import edge_distance
    >>> catenoid = discrete_catenoid(8, -0.8, 3)
    >>> bool(np.allclose(edge_distance(catenoid, edge_offset(catenoid, 0.1)), 0.1))
    True
    """
    return mesh.with_vertices(mesh.vertices + distance * nearest_image(mesh))


def image_error(mesh: PolyMesh, image: Floats) -> float:
    """Largest error of offset vectors as an edge offset, per unit of offset."""
    along, (i, j) = _directions(mesh), mesh.edges.T
    across = norm(cross(image[j] - image[i], along))
    first, second = norm(cross(image[i], along)), norm(cross(image[j], along))
    return float(np.abs(np.concatenate([across, first - 1.0, second - 1.0])).max(initial=0.0))


def nearest_image(mesh: PolyMesh, most_steps: int = MOST_STEPS) -> Floats:
    """Vectors s that come nearest to edges parallel to the mesh's and touching the sphere.

    Least squares over all edges, by Gauss and Newton, from the cones through the edges of interior
    vertices and the normals at the rim. Shape (V, 3).
    """
    short = np.flatnonzero(mesh.edge_lengths <= TINY)
    if len(short):
        a, b = mesh.edges[short[0]]
        raise MeshError(
            f"Edges must have a direction; edge {a}-{b} has length 0 ({len(short)} such edges). "
            f"Merge its ends."
        )
    start, best, least = start_image(mesh), np.empty((0, 3)), np.inf
    for swell in _swells(mesh):
        swollen = start + swell * (mesh.vertices - mesh.vertices.mean(axis=0))
        image = _fitted(mesh, swollen, most_steps)
        error = image_error(mesh, image) + (np.inf if _collapsed(mesh, image) else 0.0)
        if error < least or not len(best):
            best, least = image, error
        if least < EXACT:
            break
    return best


def _swells(mesh: PolyMesh) -> list[float]:
    """Shares of the mesh to add to the start: without interior vertices it has no width."""
    if not mesh.topology.is_boundary_vertex.all():
        return [0.0]
    normals, (i, j) = mesh.vertex_normals, mesh.edges.T
    turn = float(norm(normals[j] - normals[i]).mean())
    share = max(turn, 0.1) / mesh.mean_edge_length
    return [0.0, share, -share]


def _collapsed(mesh: PolyMesh, image: Floats) -> bool:
    """Whether an edge of the image is as good as a point: a translation has only such edges."""
    i, j = mesh.edges.T
    return bool(norm(image[j] - image[i]).min() <= COLLAPSED)


def _fitted(mesh: PolyMesh, image: Floats, most_steps: int) -> Floats:
    """Least-squares image near a start, by Gauss and Newton."""
    columns = (3 * mesh.edges[:, :, None] + np.arange(3)).reshape(-1, 6)
    pattern = _pattern(columns, image.size)
    residual, damping, idle = _residual(mesh, image), DAMPING, 0
    for _ in range(most_steps):
        slopes = _slopes(mesh, image)
        rhs = -np.bincount(
            columns.ravel(), np.einsum("era,er->ea", slopes, residual).ravel(), image.size
        )
        local = np.einsum("era,erb->eab", slopes, slopes).ravel()
        step = pattern.factor(
            pattern.values(np.concatenate([local, np.full(image.size, damping)]))
        ).solve(np.asarray(rhs, dtype=np.float64))
        moved = image + step.reshape(-1, 3)
        found = _residual(mesh, moved)
        before, after = (residual**2).sum(), (found**2).sum()
        if after < before:
            image, residual, damping = moved, found, max(0.1 * damping, 1e-14)
            idle = idle + 1 if after > STALLED * before else 0
            if idle == PATIENCE:
                break
        elif damping > 1e3 or norm(step) <= 1e-14 * norm(image.ravel()):
            break
        else:
            damping *= 100.0
        if norm(step) <= ENOUGH * norm(image.ravel()):
            break
    return image


def _directions(mesh: PolyMesh) -> Floats:
    """Unit vectors of the edges, (E, 3)."""
    return np.asarray(mesh.edge_vectors / mesh.edge_lengths[:, None])


def _pattern(columns: Indices, size: int) -> SymmetricPattern:
    """Pattern of the normal equations of elements with these columns, and the diagonal."""
    rows, k, diagonal = columns, columns.shape[1], np.arange(size)
    return SymmetricPattern(
        np.concatenate([np.repeat(rows, k, axis=1).ravel(), diagonal]),
        np.concatenate([np.tile(rows, (1, k)).ravel(), diagonal]),
        size,
    )


def _residual(mesh: PolyMesh, image: Floats) -> Floats:
    """Moves across the edge, then the errors of distance at both ends, (E, 5)."""
    along, (i, j) = _directions(mesh), mesh.edges.T
    across = cross(along, image[j] - image[i])
    first, second = norm(cross(image[i], along)), norm(cross(image[j], along))
    return np.column_stack([across, first - 1.0, second - 1.0])


def _slopes(mesh: PolyMesh, image: Floats) -> Floats:
    """Derivatives of the residuals by both ends, (E, 5, 6)."""
    along, ends = _directions(mesh), mesh.edges
    slopes = np.zeros((len(ends), 5, 6))
    # u x s as a matrix on s.
    x, y, z = along.T
    zero = np.zeros(len(ends))
    turned = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    slopes[:, :3, :3], slopes[:, :3, 3:] = -turned, turned
    for k in (0, 1):
        point = image[ends[:, k]]
        away = point - dot(point, along)[:, None] * along
        slopes[:, 3 + k, 3 * k : 3 * k + 3] = away / np.maximum(norm(away), TINY)[:, None]
    return slopes


def _free_dimensions(mesh: PolyMesh, image: Floats) -> int | None:
    """Dimension of the solutions of the linearised equations at an image."""
    if image.size > DENSE:
        return None
    slopes, columns = _slopes(mesh, image), 3 * mesh.edges[:, :, None] + np.arange(3)
    matrix = np.zeros((len(slopes), 5, image.size))
    np.put_along_axis(matrix, columns.reshape(-1, 1, 6), slopes, axis=2)
    rows = matrix.reshape(-1, image.size)
    values = np.linalg.eigvalsh(rows.T @ rows)
    return int((values <= RANK_TOLERANCE**2 * values[-1]).sum())
