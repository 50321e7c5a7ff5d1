"""Polyhedral graphs and sphere-type meshes for the Koebe tests."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from pqmesh.mesh.topology import Topology


def divided_cube(n):
    """Cube whose faces are n x n quads: 6 n^2 faces, eight vertices of valence 3."""
    number, faces = {}, []
    for axis in range(3):
        for side in (0, n):
            for i, j in np.ndindex(n, n):
                face = []
                for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
                    place = [0, 0, 0]
                    place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3] = side, i + a, j + b
                    face.append(number.setdefault(tuple(place), len(number)))
                faces.append(face if side else face[::-1])
    return Topology(np.array(faces), len(number))


def random_triangles(n, seed=0):
    """Convex hull of n random points of a sphere: all faces triangles."""
    points = np.random.default_rng(seed).normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    hull = ConvexHull(points)
    a, b, c = np.moveaxis(points[hull.simplices], 1, 0)
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces = hull.simplices.copy()
    faces[inward] = faces[inward][:, ::-1]
    return Topology(faces, n)


def dual(topology):
    """Vertices and faces of a closed mesh exchanged."""
    faces = [topology.star(v)[1].tolist() for v in range(topology.n_vertices)]
    return Topology(faces, topology.n_faces)


def pyramid(n):
    return Topology([list(range(n))[::-1], *([i, (i + 1) % n, n] for i in range(n))], n + 1)


def prism(n):
    walls = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    return Topology([list(range(n))[::-1], list(range(n, 2 * n)), *walls], 2 * n)
