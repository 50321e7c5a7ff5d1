"""Cones of revolution through the edges of a vertex: what an edge offset asks of one node.

If a mesh has an edge offset with Gauss image s, all edge lines at a vertex make one angle with s:
for the outgoing directions u_i there are signs with (a . e_i u_i) = cos t for all edges, where
a = s/|s|, and s = a / sin t lies where lines of these directions touch the unit sphere. The tips
e_i u_i lie in one plane across a, which is one condition for each edge past the third. Signs ++++
make an elliptic vertex, +-+- a saddle; one sign against three occurs where the curvature along one
polyline changes its sign.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Stars
from pqmesh.vectors import Floats, Indices, dot, unit

# Tips that nearly lie on a line leave the axis open; an axis must stand upright on the vertex. An
# exact cone needs neither: folded vertices have axes at any angle.
SPREAD, UPRIGHT, EXACT, LEAST_SPREAD = 0.2, 0.5, 1e-9, 1e-2
# Classes whose misfits agree to this are told apart by how upright the axis stands.
AS_GOOD = 1e-9
# All classes of signs are tried up to this valence, of higher ones those that nature has.
MOST_SIGNS = 6


class EdgeCones(NamedTuple):
    """Best cone through the edges of each interior vertex.

    Attributes
    ----------
    vertices : (n,)
    vectors : (n, 3)
        The vector s of the Gauss image, on the side of the vertex normal; length 1 or more.
    signs : tuple of str
        Class of each vertex, as `++++` or `+-+-`, the first edge always with `+`.
    misfit : (n,), radians
        Largest difference between the edges' angles and their mean.
    """

    vertices: Indices
    vectors: Floats
    signs: tuple[str, ...]
    misfit: Floats


def edge_cones(mesh: PolyMesh) -> EdgeCones:
    """Best cones of revolution through the edges at all interior vertices, in rising order.

    Three edges lie on a cone for all signs; the most upright one is taken.

    References: theory: [pottmann2007].

    Examples
    --------
    >>> from pqmesh.mesh.solids import cube
    >>> cones = edge_cones(cube())
    >>> set(cones.signs), bool(np.allclose(cones.vectors, cube().vertices / 2.0**0.5))
    ({'+++'}, True)
    """
    vertices: list[Indices] = []
    vectors: list[Floats] = []
    misfits: list[Floats] = []
    names: dict[int, str] = {}
    for star in mesh.topology.stars():
        found, best, misfit = _best(mesh, star)
        vertices.append(star.vertices)
        vectors.append(np.asarray(found, dtype=np.float64))
        misfits.append(np.asarray(misfit, dtype=np.float64))
        classes = sign_classes(star.neighbors.shape[1])
        for vertex, row in zip(star.vertices.tolist(), classes[best], strict=True):
            names[vertex] = "".join("+" if sign > 0 else "-" for sign in row)
    if not vertices:
        return EdgeCones(np.empty(0, np.int64), np.empty((0, 3)), (), np.empty(0))
    which = np.concatenate(vertices)
    order = np.argsort(which)
    signs = tuple(names[vertex] for vertex in which[order].tolist())
    return EdgeCones(
        which[order], np.concatenate(vectors)[order], signs, np.concatenate(misfits)[order]
    )


def sign_classes(valence: int) -> Floats:
    """Signs of the edges up to a common one, one class a row, (c, valence)."""
    if valence <= MOST_SIGNS:
        rest = itertools.product((1.0, -1.0), repeat=valence - 1)
        return np.array([(1.0, *row) for row in rest])
    classes: list[Floats] = [np.ones(valence)]
    if valence % 2 == 0:
        classes.append(np.asarray((-1.0) ** np.arange(valence), dtype=np.float64))
    return np.array(classes)


def _best(mesh: PolyMesh, star: Stars) -> tuple[Floats, Indices, Floats]:
    """Vector, class and misfit of each vertex of a star group."""
    spokes = unit(mesh.vertices[star.neighbors] - mesh.vertices[star.vertices][:, None])
    normals = mesh.vertex_normals[star.vertices]
    classes = sign_classes(spokes.shape[1])
    tips = classes[None, :, :, None] * spokes[:, None]
    mean = tips.mean(axis=2)
    _, spread, axes = np.linalg.svd(tips - mean[:, :, None], full_matrices=False)
    axis = axes[:, :, -1]
    upright = dot(axis, normals[:, None])
    axis = axis * np.where(upright < 0, -1.0, 1.0)[..., None]
    slope = dot(mean, axis)
    angles = np.arccos(np.clip(np.einsum("nckj,ncj->nck", tips, axis), -1.0, 1.0))
    misfit = np.abs(angles - angles.mean(axis=2, keepdims=True)).max(axis=2)
    usable = (spread[:, :, 1] > SPREAD) & (np.abs(upright) > UPRIGHT)
    if spokes.shape[1] > 3:
        usable |= (spread[:, :, 1] > LEAST_SPREAD) & (misfit < EXACT)
    rank = np.where(usable, misfit, misfit + np.pi)
    near = rank <= rank.min(axis=1, keepdims=True) + AS_GOOD
    best = np.where(near, np.abs(upright), -1.0).argmax(axis=1)
    row = np.arange(len(best))
    sine = np.sqrt(np.maximum(1.0 - slope[row, best] ** 2, 1e-6))
    return axis[row, best] / sine[:, None], best, misfit[row, best]
