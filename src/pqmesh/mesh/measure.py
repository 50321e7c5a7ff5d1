"""What a mesh achieves: planarity, balance of angles, cones, circles, corners, edges."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.topology import Stars
from pqmesh.vectors import TINY, Floats, Indices, Mask, angle, cross, dot, norm, unit

# Normals closer together than this cannot tell a cone from a plane (contract: flat vertex).
FLAT_VERTEX = 1e-6
# Below this relative singular value the normals of a vertex lie in one plane through 0.
RANK_TOLERANCE = 1e-10
# Diagonals at a smaller angle (radians) count as parallel: a crossed or folded quad.
PARALLEL_DIAGONALS = 1e-9
# A mean of unit normals shorter than this has no direction.
ALL_WAYS = 0.25


class Cones(NamedTuple):
    """Best common cone of the face planes at each interior vertex.

    Attributes
    ----------
    vertices : (n,)
    vectors : (n, 3)
        w with n_f . w = 1 in the least-squares sense: the move of the vertex when every face
        moves by 1 along its normal. Its direction is the node axis.
    misfit : (n,)
        max |n_f . w - 1|: error of the face distance per unit of offset.
    spread : (n,)
        Largest minus smallest signed angle between the fitted axis and the planes of the faces
        at the vertex, radians.
    theta : (n,)
        Angular radius of those planes' normals about the axis, radians.
    """

    vertices: Indices
    vectors: Floats
    misfit: Floats
    spread: Floats
    theta: Floats

    @property
    def is_flat(self) -> Mask:
        """Vertices whose faces are one plane for our purposes: theta below 1e-6."""
        return np.asarray(self.theta < FLAT_VERTEX)

    @property
    def relative_spread(self) -> Floats:
        """Spread / theta, 0 where the vertex is flat; conical means all within tolerance."""
        safe = np.where(self.is_flat, 1.0, self.theta)
        return np.where(self.is_flat, 0.0, self.spread / safe)


# --- faces ----------------------------------------------------------------------------------


def planarity_deviation(mesh: PolyMesh) -> Floats:
    """Distance between the two diagonals' lines of each quad, shape (F,), model unit.

    Zero when the quad is flat, folded or crossed quads included: see `nonconvex_faces`. A
    triangle is flat. Of a polygon with more corners it is the height across its plane, that of
    the area vector: between the two planes of that direction which enclose it, and so the
    distance of the diagonals of a quad.

    References: [thesis] definition 2.1.4 as amended in the errata page, E2.

    Examples
    --------
    >>> saddle = QuadMesh.of([[-1, -1, 1], [1, -1, -1], [1, 1, 1], [-1, 1, -1]], [[0, 1, 2, 3]])
    >>> planarity_deviation(saddle)
    array([2.])
    """
    deviation = np.zeros(mesh.topology.n_faces)
    for faces, corners in mesh.topology.face_groups:
        points = mesh.vertices[corners]
        if corners.shape[1] == 4:
            deviation[faces] = _diagonal_distance(points)
        elif corners.shape[1] > 4:
            heights = dot(points - points[:, :1], mesh.face_normals[faces][:, None])
            deviation[faces] = np.ptp(heights, axis=1)
            for row in np.flatnonzero(norm(mesh.face_area_vectors[faces]) <= TINY):
                # No area, so no direction of its own: a folded or crossed polygon.
                deviation[faces[row]] = 2.0 * plane_deviation(points[row])
    return deviation


def _diagonal_distance(corners: Floats) -> Floats:
    """Distance between the two diagonals' lines of quads (n, 4, 3)."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    normal = cross(c - a, d - b)
    length = norm(normal)
    volume = np.abs(dot(b - a, normal))
    # Parallel diagonals lie in one plane: deviation 0. Their cross product is rounding noise,
    # whose direction would give any distance.
    crossing = length > PARALLEL_DIAGONALS * norm(c - a) * norm(d - b)
    return np.where(crossing, volume / np.where(crossing, length, 1.0), 0.0)


def mean_diagonals(mesh: PolyMesh) -> Floats:
    """Mean of the two diagonal lengths of each quad, shape (F,), model unit.

    Of other faces twice the mean distance of the corners from their mean: the same for a
    parallelogram.
    """
    size = np.empty(mesh.topology.n_faces)
    for faces, corners in mesh.topology.face_groups:
        points = mesh.vertices[corners]
        if corners.shape[1] == 4:
            a, b, c, d = np.moveaxis(points, 1, 0)
            size[faces] = 0.5 * (norm(c - a) + norm(d - b))
        else:
            out = points - points.mean(axis=1, keepdims=True)
            size[faces] = 2.0 * norm(out).mean(axis=1)
    return size


def planarity(mesh: PolyMesh) -> Floats:
    """Planarity deviation over mean diagonal of each face, shape (F,), dimensionless."""
    size = mean_diagonals(mesh)
    return np.where(size > TINY, planarity_deviation(mesh) / np.where(size > TINY, size, 1.0), 0.0)


def tetrahedron_volume(mesh: QuadMesh) -> Floats:
    """Signed volume of the four corners of each quad, shape (F,), model unit cubed."""
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    return np.asarray(dot(b - a, cross(c - a, d - a)) / 6.0)


def corner_angles(mesh: PolyMesh) -> Floats:
    """Angle in [0, 2 pi) at each corner, aligned with `topology.indices`; reflex beyond pi.

    Measured counterclockwise about the face normal, so a folded or crossed face shows angles
    above pi.
    """
    topology = mesh.topology
    points = mesh.vertices[topology.indices]
    outgoing = points[topology.corner_next] - points
    incoming = np.empty_like(outgoing)
    incoming[topology.corner_next] = -outgoing
    normals = mesh.face_normals[topology.corner_faces]
    plain = angle(outgoing, incoming)
    turned = dot(cross(outgoing, incoming), normals) < 0
    return np.where(turned, 2.0 * np.pi - plain, plain)


def nonconvex_faces(mesh: PolyMesh) -> Indices:
    """Faces that are not strictly convex: reflex, folded, crossed or without area; sorted.

    A corner of exactly pi is legal (collinear consecutive edges); a face without area is not.
    """
    topology = mesh.topology
    reflex = corner_angles(mesh) > np.pi * (1.0 + 1e-12)
    area = norm(mesh.face_area_vectors)
    perimeter = np.add.reduceat(mesh.edge_lengths[topology.face_edges], topology.offsets[:-1])
    broken = area <= 1e-12 * perimeter**2
    broken[topology.corner_faces[reflex]] = True
    return np.flatnonzero(broken)


def flipped_faces(mesh: PolyMesh) -> Indices:
    """Faces turned over against their neighbours: normal beyond 120 degrees of their mean.

    Neighbours that look all ways, as around a face of a box, have no mean to judge by.
    """
    topology = mesh.topology
    pairs = topology.edge_faces[~topology.is_boundary_edge]
    around = np.zeros((topology.n_faces, 3))
    np.add.at(around, pairs[:, 0], mesh.face_normals[pairs[:, 1]])
    np.add.at(around, pairs[:, 1], mesh.face_normals[pairs[:, 0]])
    count = np.bincount(pairs.ravel(), minlength=topology.n_faces)
    judged = norm(around) > ALL_WAYS * count
    return np.flatnonzero(judged & (dot(unit(around), mesh.face_normals) < -0.5))


def circularity_defect(mesh: PolyMesh) -> Floats:
    """Alternating sum a1 - a2 + a3 - a4 of each face's corner angles, shape (F,), radians.

    Zero on a convex flat quad exactly when its corners lie on a circle; corners are unsigned,
    so flatness and convexity are judged apart. Triangles have a circle. Of a polygon with more
    corners it is the sum of largest size among the quads of four consecutive corners.

    References: [thesis] section 3.2; errata page, E12.
    """
    defect = np.zeros(mesh.topology.n_faces)
    for faces, corners in mesh.topology.face_groups:
        size = corners.shape[1]
        if size > 3:
            first = np.arange(1 if size == 4 else size)
            quads = corners[:, (first[:, None] + np.arange(4)) % size]
            points = mesh.vertices[quads]
            outgoing = np.roll(points, -1, axis=2) - points
            incoming = np.roll(points, 1, axis=2) - points
            sums = angle(outgoing, incoming) @ np.array([1.0, -1.0, 1.0, -1.0])
            worst = np.abs(sums).argmax(axis=1)
            defect[faces] = sums[np.arange(len(faces)), worst]
    return defect


def circle_deviation(mesh: QuadMesh) -> Floats:
    """Ptolemy residual |ab||cd| + |bc||da| - |ac||bd| over the product of diagonals, (F,).

    Zero exactly when the corners lie on one circle in this order; never negative but for
    rounding. Detects non-planar and crossed quads as well.
    """
    a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
    diagonals = norm(c - a) * norm(d - b)
    sides = norm(b - a) * norm(d - c) + norm(c - b) * norm(a - d)
    return np.asarray((sides - diagonals) / np.where(diagonals > TINY, diagonals, 1.0))


def plane_deviation(polygon: Floats) -> float:
    """Largest distance of a polygon's corners (k, 3) from their best plane, model unit."""
    centred = polygon - polygon.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    return float(np.abs(centred @ normal).max())


# --- vertices -------------------------------------------------------------------------------


def star_angles(mesh: PolyMesh, star: Stars) -> Floats:
    """Angles between consecutive edges around each vertex of an interior star, (n, k)."""
    spokes = mesh.vertices[star.neighbors] - mesh.vertices[star.vertices][:, None]
    return angle(spokes, np.roll(spokes, -1, axis=1))


def conicality_defect(mesh: PolyMesh) -> tuple[Indices, Floats]:
    """Interior vertices of valence 4 and their balance w1 - w2 + w3 - w4, radians.

    Zero when the vertex is conical. A vertex with a flat edge may be conical with a defect
    (errata page, E15); `fitted_cones` decides in every case.

    References: [thesis] theorem 4.1.1; errata page, E15.
    """
    for star in mesh.topology.stars():
        if star.neighbors.shape[1] == 4:
            angles = star_angles(mesh, star)
            return star.vertices, np.asarray(angles @ np.array([1.0, -1.0, 1.0, -1.0]))
    return np.empty(0, dtype=np.int64), np.empty(0)


def common_vectors(normals: Floats, rank: float = RANK_TOLERANCE) -> Floats:
    """Minimum-norm least-squares w of n_f . w = 1 for each set of normals (n, k, 3) -> (n, 3).

    Directions whose relative singular value is not above `rank` count as free.
    """
    u, s, vt = np.linalg.svd(normals, full_matrices=False)
    keep = s > rank * s[:, :1]
    weights = np.where(keep, u.sum(axis=1) / np.where(keep, s, 1.0), 0.0)
    return np.asarray(np.einsum("nr,nri->ni", weights, vt))


def corner_normals(mesh: PolyMesh, star: Stars) -> Floats:
    """Unit normals of the faces as the vertex sees them: across the two edges there, (n, k, 3).

    On flat faces these are the face normals. On faces that are nearly flat they keep the
    flatness error, which is judged on its own, out of the cone. A corner of almost 0 or pi has
    no plane; it keeps the face normal.
    """
    spokes = unit(mesh.vertices[star.neighbors] - mesh.vertices[star.vertices][:, None])
    normals = mesh.face_normals[star.faces]
    products = cross(spokes, np.roll(spokes, -1, axis=1))
    clear = norm(products) > PARALLEL_DIAGONALS
    turned = unit(products) * np.where(dot(products, normals) < 0, -1.0, 1.0)[..., None]
    return np.where(clear[..., None], turned, normals)


def fitted_cones(mesh: PolyMesh) -> Cones:
    """Best common cone at every interior vertex of any valence, in rising vertex order.

    The offset vector and its misfit speak of the face planes; the spread and theta of the
    planes at the vertex (`corner_normals`).

    References: theory: [pottmann2007]; [thesis] definition 3.2.2 with errata E14 (oriented
    cones: one sign for all faces).
    """
    parts = []
    for star in mesh.topology.stars():
        normals = mesh.face_normals[star.faces]
        vectors = common_vectors(normals)
        along = np.einsum("nki,ni->nk", normals, vectors)
        local = corner_normals(mesh, star)
        axis = unit(common_vectors(local))
        across = norm(cross(local, axis[:, None]))
        tilt = np.arctan2(across, np.einsum("nki,ni->nk", local, axis))
        parts.append(
            (
                star.vertices,
                vectors,
                np.abs(along - 1.0).max(axis=1),
                np.ptp(tilt, axis=1),
                tilt.max(axis=1),
            )
        )
    if not parts:
        none = np.empty(0)
        return Cones(np.empty(0, dtype=np.int64), np.empty((0, 3)), none, none, none)
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(columns[0])
    vertices, vectors, misfit, spread, theta = (column[order] for column in columns)
    return Cones(vertices, vectors, misfit, spread, theta)


# --- the table of the report ----------------------------------------------------------------


def measures(mesh: PolyMesh) -> dict[str, float | int | None]:
    """All measures of the report but twist: angles in degrees, lengths in the model unit.

    A quantity that does not exist for this mesh (no interior vertex) is None.
    """
    cones = fitted_cones(mesh)
    balance = np.abs(conicality_defect(mesh)[1])
    corners = np.degrees(corner_angles(mesh))
    flatness = planarity(mesh)
    return {
        "planarity_max": float(flatness.max()),
        "planarity_mean": float(flatness.mean()),
        "planarity_max_length": float(planarity_deviation(mesh).max()),
        "cone_spread_max": _largest(cones.relative_spread),
        "conicality_max_deg": _largest(np.degrees(balance)),
        "conicality_mean_deg": float(np.degrees(balance).mean()) if len(balance) else None,
        "circularity_max_deg": float(np.degrees(np.abs(circularity_defect(mesh))).max()),
        "offset_misfit_max": _largest(cones.misfit),
        "min_corner_deg": float(corners.min()),
        "max_corner_deg": float(corners.max()),
        "nonconvex_faces": len(nonconvex_faces(mesh)),
        "flipped_faces": len(flipped_faces(mesh)),
        "edge_min": float(mesh.edge_lengths.min()),
        "edge_mean": mesh.mean_edge_length,
        "edge_max": float(mesh.edge_lengths.max()),
    }


def _largest(values: Floats) -> float | None:
    """Maximum, or None of nothing."""
    return float(values.max()) if len(values) else None
