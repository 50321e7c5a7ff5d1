"""Moebius images of whole circular meshes: what they are, and when they fail."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.measure import circle_deviation
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.vectors import OffsetVectors, vertex_offset_vectors
from pqmesh.vectors import Floats, cross, dot, norm

if TYPE_CHECKING:
    from pqmesh.transform.moebius import MoebiusTransform

# Nearer to the pole than this share of its own size, a vertex or a circle lies on it.
AT_POLE = 1e-9
# Residual of Ptolemy's theorem, or gap of the vertex offset, that is worth a warning.
MISFIT = 1e-6


class Circles(NamedTuple):
    """Oriented circles in space.

    Attributes
    ----------
    centers : (n, 3), model unit
    axes : (n, 3)
        Unit vectors; seen from their tips the circles run counterclockwise.
    radii : (n,), model unit
    """

    centers: Floats
    axes: Floats
    radii: Floats


@dataclass(frozen=True, eq=False)
class MoebiusImage:
    """Image of a circular mesh.

    Attributes
    ----------
    mesh : QuadMesh
        Faces are the planar quads of the image points, in their old sense of running around.
    vectors : OffsetVectors or None
        Vertex offset of the image, computed anew: offsets are not mapped to offsets. None for a
        mesh in several pieces.
    warnings : tuple of str
        What is unusual: input not quite circular, no vertex offset.
    """

    mesh: QuadMesh
    vectors: OffsetVectors | None
    warnings: tuple[str, ...]


def face_circles(mesh: QuadMesh) -> Circles:
    """Circles through the corners of the faces, running as the faces do.

    Of four corners that are not on one circle, the one nearest in the sense of equal powers.

    Examples
    --------
    >>> square = QuadMesh.of([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]], [[0, 1, 2, 3]])
    >>> face_circles(square).radii.round(12)
    array([1.41421356])
    """
    normals, middle = mesh.face_normals, mesh.face_centers
    spokes = mesh.corners - middle[:, None]
    # |x|^2 = 2 x . c + const at the corners, c in the plane of the face.
    first = mesh.vertices[mesh.faces[:, 2]] - mesh.vertices[mesh.faces[:, 0]]
    first = first / norm(first)[:, None]
    basis = np.stack([first, cross(normals, first)], axis=1)
    flat = np.einsum("fki,fbi->fkb", spokes, basis)
    rows = np.concatenate([2.0 * flat, np.ones_like(flat[..., :1])], axis=-1)
    square = np.einsum("fkb,fkb->fk", flat, flat)
    solved = np.einsum("fbk,fk->fb", np.linalg.pinv(rows), square)
    centers = middle + np.einsum("fb,fbi->fi", solved[:, :2], basis)
    radii = norm(mesh.corners - centers[:, None]).mean(axis=1)
    return Circles(centers, normals, radii)


def moebius_image(transform: MoebiusTransform, mesh: QuadMesh) -> MoebiusImage:
    """Image of a circular mesh under a Moebius transformation: circular again.

    Only the vertices are mapped. Edges and faces are drawn anew between them: those of the
    smooth image would be arcs and pieces of spheres.

    Parameters
    ----------
    transform : MoebiusTransform
    mesh : QuadMesh
        Circular; the faces of other meshes do not stay planar, and a warning says so.

    Raises
    ------
    MeshError
        When a vertex lies on the pole, a face circle runs through it, or some faces turn over
        against the others: those with the pole inside the sphere about their circle. Names the
        first of them.

    References: [thesis] section 5.4; errata page, E31.

    Examples
    --------
    >>> from pqmesh.mesh.exact import stereographic_mesh
    >>> from pqmesh.transform.moebius import MoebiusTransform
    >>> ball = stereographic_mesh([-1, 0, 0.5], [-1, 0, 1])
    >>> image = MoebiusTransform.inversion([0, 0, 3], 2.0).of_mesh(ball)
    >>> bool(circle_deviation(image.mesh).max() < 1e-12), image.vectors.error < 1e-12
    (True, True)
    """
    if transform.pole is not None:
        _check_pole(mesh, transform.pole)
    image = mesh.with_vertices(transform.on_points(mesh.vertices))
    warnings = []
    residual = circle_deviation(mesh)
    if residual.max() > MISFIT:
        warnings.append(
            f"the mesh is circular only to {residual.max():.2g} (Ptolemy's residual), worst at "
            f"face {residual.argmax()}: faces of the image are planar only nearly"
        )
    if mesh.topology.components.max() > 0:
        return MoebiusImage(image, None, (*warnings, "a mesh in pieces has no vertex offset"))
    vectors = vertex_offset_vectors(image)
    if vectors.error > MISFIT:
        warnings.append(
            f"the image has no vertex offset: its vectors differ by {vectors.error:.2g} around a "
            f"face or a hole"
        )
    return MoebiusImage(image, vectors, tuple(warnings))


def _check_pole(mesh: QuadMesh, pole: Floats) -> None:
    """Refuse a pole on a vertex, on a face circle, or inside some of the spheres about them."""
    distance = norm(mesh.vertices - pole)
    if distance.min() <= AT_POLE * mesh.mean_edge_length:
        raise MeshError(
            f"No vertex may lie in the center of inversion {pole.tolist()}; vertex "
            f"{distance.argmin()} does, and goes to infinity. Move the center off the mesh."
        )
    centers, axes, radii = face_circles(mesh)
    gap = centers - pole
    power = dot(gap, gap) - radii**2
    # The image has this times its own radius as the inverse of the new one.
    root = np.hypot(power, 2.0 * dot(axes, gap) * radii)
    lost = np.flatnonzero(root <= AT_POLE * radii**2)
    if len(lost):
        raise MeshError(
            f"No face circle may run through the center of inversion {pole.tolist()}; that of "
            f"face {lost[0]} does, and becomes a line ({len(lost)} such faces). Move the center "
            f"off the mesh."
        )
    turned = np.flatnonzero(power < 0)
    if 0 < len(turned) < len(power):
        raise MeshError(
            f"All faces must keep their sides or all change them; face {turned[0]} turns over "
            f"against the others ({len(turned)} of {len(power)} faces): the center of inversion "
            f"{pole.tolist()} lies inside the sphere about its circle. Move it away from the mesh."
        )
