"""Laguerre images of whole conical meshes: what they are, when they fail, and how far they go."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import nonconvex_faces
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.offsets import edge_factors
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.vectors import Floats, Indices, dot, norm, unit

if TYPE_CHECKING:
    from pqmesh.transform.laguerre import LaguerreTransform

# Below this share of its largest possible size, c' counts as 0: the cone is a cylinder.
CYLINDER = 1e-9
# An edge shorter than this share of the mean edge has collapsed.
COLLAPSED = 1e-9
# Error of n . w = 1 from which a mesh is not quite conical, which is worth a warning.
MISFIT = 1e-6


class ConeImages(NamedTuple):
    """Images of cones that touch planes from their apexes.

    Attributes
    ----------
    vertices : (n, 3), model unit
        Apexes; NaN where the image is a cylinder.
    vectors : (n, 3)
        w' with n' . w' = 1 for every plane that touches; NaN where the image is a cylinder.
    growth : (n,)
        c': how fast the radius grows along the image of the line (v, 0) + t (w, 1). 0 makes a
        cylinder, a negative value turns the cone over.
    """

    vertices: Floats
    vectors: Floats
    growth: Floats


@dataclass(frozen=True, eq=False)
class LaguerreImage:
    """Image of a conical mesh.

    Attributes
    ----------
    mesh : QuadMesh
        Its normals are those of the image planes.
    vectors : (V, 3)
        Images of the vectors w: n' . w' = 1, and mesh + d vectors is its face offset by d.
    orientation : int
        1 when the faces run as before, -1 when all had to be turned over.
    warnings : tuple of str
        What is unusual: input not quite conical, edges that run backwards, broken faces.
    """

    mesh: QuadMesh
    vectors: Floats
    orientation: int
    warnings: tuple[str, ...]


def laguerre_image(
    transform: LaguerreTransform, mesh: QuadMesh, vectors: Floats | None = None
) -> LaguerreImage:
    """Image of a conical mesh under a Laguerre transformation: conical again.

    Each vertex v is the apex of its cone, the line of spheres (v, 0) + t (w, 1) with n . w = 1,
    and the new vertex is the apex of the image cone. At the boundary w comes from the face
    offset, so that boundary edges stay in step with it.

    Parameters
    ----------
    transform : LaguerreTransform
    mesh : QuadMesh
        Conical; elsewhere the faces of the image are planar only nearly, and a warning says so.
    vectors : (V, 3), optional
        w, by default those of the face offset. Those of an earlier image make a chain of images
        that of the product: they also fix the rim, which its planes leave free.

    Raises
    ------
    MeshError
        When a cone becomes a cylinder or its vertex passes through infinity (names the vertex
        and c'), an edge collapses (names it), or some faces turn over against the others (names
        one).

    References: [thesis] theorem 5.3.3 with the conditions of the errata page, E27, E28.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> from pqmesh.transform.laguerre import LaguerreTransform
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> image = LaguerreTransform.boost([1, 0, 0], 0.2).of_mesh(roof)
    >>> from pqmesh.mesh.measure import fitted_cones, planarity
    >>> bool(planarity(image.mesh).max() < 1e-13 and fitted_cones(image.mesh).spread.max() < 1e-12)
    True
    """
    if vectors is None:
        vectors = face_offset_vectors(mesh).vectors
    cones = transform.on_cones(mesh.vertices, vectors)
    _check_cones(cones, transform.rapidity)
    moved = mesh.with_vertices(cones.vertices)
    _check_edges(mesh, moved, transform.scale)
    orientation = _orientation(moved, transform.on_planes(face_planes(mesh)))
    sense = np.sign(cones.growth[0])
    backward = np.flatnonzero(_edge_growth(transform, mesh, vectors) * sense <= 0)
    warnings = [*_misfit_words(mesh, vectors), *_edge_words(mesh, backward)]
    image = moved if orientation > 0 else moved.reversed()
    broken = np.setdiff1d(nonconvex_faces(image), nonconvex_faces(mesh))
    if len(broken):
        warnings.append(
            f"{len(broken)} faces are convex no more, the first is face {broken[0]}: the image "
            f"crosses its focal set there"
        )
    return LaguerreImage(image, cones.vectors, orientation, tuple(warnings))


def rapidity_range(
    mesh: QuadMesh, direction: ArrayLike | None = None, center: ArrayLike = (0.0, 0.0, 0.0)
) -> tuple[float, float]:
    """Rapidities (low <= 0, high >= 0) between which a boost leaves a conical mesh whole.

    Within, no cone becomes a cylinder and no edge collapses or turns back. An edge (i, j) of
    factor k collapses when the sphere (v - w/k, -1/k), which touches all planes at both its
    ends, becomes a point: sinh b . (k (v - c) - w) = cosh. A cone becomes a cylinder when
    sinh b . w = -cosh.

    Parameters
    ----------
    mesh : QuadMesh
        Conical.
    direction : (3,), optional
        b; without it the range holds for every direction.
    center : (3,), model unit
        c, the point about which is boosted.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> low, high = rapidity_range(roof, [0, 0, 1])
    >>> bool(low < -0.5 and high > 0.5)
    True
    """
    vectors = face_offset_vectors(mesh).vectors
    factors = edge_factors(mesh, vectors)
    ends = mesh.edges[:, 0]
    spheres = factors[:, None] * (mesh.vertices[ends] - np.asarray(center, dtype=np.float64))
    rows = np.concatenate([-vectors, spheres - vectors[ends]])
    if direction is None:
        high = _rapidity(float(norm(rows).max()))
        return -high, high
    along = rows @ unit(np.asarray(direction, dtype=np.float64))
    return -_rapidity(float((-along).max())), _rapidity(float(along.max()))


def _rapidity(largest: float) -> float:
    """Rapidity with tanh(rapidity) = 1/largest; infinite when there is none."""
    return float(np.arctanh(1.0 / largest)) if largest > 1.0 else float(np.inf)


# --- what may fail --------------------------------------------------------------------------


def _edge_growth(transform: LaguerreTransform, mesh: QuadMesh, vectors: Floats) -> Floats:
    """Of c' sign where an edge keeps its sense, 0 where it collapses; 1 + d k for an offset."""
    factors, ends = edge_factors(mesh, vectors), mesh.edges[:, 0]
    last = transform.matrix[3]
    spheres = factors[:, None] * mesh.vertices[ends] - vectors[ends]
    radii = transform.scale * (spheres @ last[:3] - last[3]) + factors * transform.translation[3]
    return np.asarray(-radii)


def _check_cones(cones: ConeImages, rapidity: float) -> None:
    """Refuse images whose cones are not all cones of one sense."""
    growth = cones.growth
    lost = np.flatnonzero(~np.isfinite(cones.vertices).all(axis=1))
    if len(lost):
        raise MeshError(
            f"The image of every vertex cone must be a cone, c' other than 0; that of vertex "
            f"{lost[0]} is a cylinder, c' = {growth[lost[0]]:.3g} ({len(lost)} such vertices). "
            f"Use a rapidity smaller than {rapidity:.4g}."
        )
    sense = np.sign(growth[np.abs(growth).argmax()])
    turned = np.flatnonzero(growth * sense < 0)
    if len(turned):
        first = turned[np.abs(growth[turned]).argmax()]
        raise MeshError(
            f"c' must have one sign on the whole mesh; it is {growth[first]:.3g} at vertex "
            f"{first} and of the other sign at {len(growth) - len(turned)} vertices: its cone has "
            f"passed a cylinder, the vertex infinity. Use a rapidity smaller than {rapidity:.4g}."
        )


def _check_edges(mesh: QuadMesh, moved: QuadMesh, scale: float) -> None:
    """Refuse an image with an edge without length."""
    size = np.maximum(moved.mean_edge_length, scale * mesh.edge_lengths)
    lost = np.flatnonzero(moved.edge_lengths <= COLLAPSED * size)
    if len(lost):
        a, b = mesh.edges[lost[0]]
        raise MeshError(
            f"Every edge of the image must have length; edge {a}-{b} collapses to a point "
            f"({len(lost)} of {len(mesh.edges)} edges). Use a smaller rapidity or offset, or "
            f"boost about the middle of the mesh."
        )


def _orientation(moved: QuadMesh, planes: Floats) -> int:
    """1 where all face normals are those of the image planes, -1 where all are opposite."""
    along = dot(moved.face_normals, planes[:, :3])
    if (along > 0).all():
        return 1
    if (along < 0).all():
        return -1
    sense = 1.0 if 2 * (along > 0).sum() >= len(along) else -1.0
    folded = np.flatnonzero(along * sense <= 0)
    raise MeshError(
        f"All faces must keep their sides, or all change them; face {folded[0]} turns over "
        f"against the others ({len(folded)} of {len(along)} faces): the image is folded. Use a "
        f"smaller rapidity or offset, or boost about the middle of the mesh."
    )


def _misfit_words(mesh: QuadMesh, vectors: Floats) -> list[str]:
    """Warning about an input that is not quite conical."""
    corners = mesh.topology.indices
    fit = dot(mesh.face_normals[mesh.topology.corner_faces], vectors[corners])
    misfit = np.abs(fit - 1.0)
    if misfit.max() <= MISFIT:
        return []
    return [
        f"the mesh is conical only to {misfit.max():.2g} (n . w - 1), worst at vertex "
        f"{corners[misfit.argmax()]}: faces of the image are planar only nearly"
    ]


def _edge_words(mesh: QuadMesh, backward: Indices) -> list[str]:
    """Warning about edges that turned back."""
    if not len(backward):
        return []
    a, b = mesh.edges[backward[0]]
    return [
        f"{len(backward)} of {len(mesh.edges)} edges run backwards, the first is edge {a}-{b}: "
        f"the image lies beyond its focal set"
    ]
