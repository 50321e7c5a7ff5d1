"""Conical and circular meshes, and spheres, that the tests of transformations share."""

import numpy as np
from shapes import cyclide, sampled, torus

from pqmesh.mesh.exact import rotational_mesh, tangent_plane_mesh

PROFILE = np.array([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9], [1.8, 2.3]])


def rotational():
    """Conical mesh of revolution, 4 x 6 faces, normals outwards."""
    return rotational_mesh(PROFILE, 0.3 * np.arange(7))


def tangential(formula, u, v):
    """Mesh of tangent planes at curvature parameters, conical without symmetry."""
    points, normals = sampled(formula, u, v)[:2]
    heights = np.einsum("uvi,uvi->uv", points, normals)[..., None]
    return tangent_plane_mesh(np.concatenate([normals, heights], axis=-1))


def cyclide_mesh():
    """7 x 6 faces in tangent planes of a Dupin cyclide, unevenly spaced."""
    u = np.array([-0.7, -0.45, -0.2, 0.1, 0.35, 0.55, 0.8, 1.1, 1.3])
    v = np.array([-0.9, -0.6, -0.35, 0.0, 0.2, 0.5, 0.75, 1.0])
    return tangential(cyclide, u, v)


def torus_mesh():
    """6 x 6 faces in tangent planes of a torus."""
    return tangential(torus, 0.2 * np.arange(8), 0.25 * np.arange(8) - 0.8)


def spheres(rng, n=50):
    """Oriented spheres (p, r), sizes about 1."""
    return rng.normal(size=(n, 4))


def planes(rng, n=50):
    """Oriented planes (n, h)."""
    rows = rng.normal(size=(n, 4))
    rows[:, :3] /= np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    return rows
