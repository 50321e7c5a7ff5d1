"""Tiny meshes of every kind of face."""

import numpy as np
import pytest

from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh

THIRD = 1.0 / 3.0


def _square() -> PolyMesh:
    return QuadMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, THIRD], [0, 1, 0]], [[0, 1, 2, 3]])


def _extreme_numbers() -> PolyMesh:
    # Doubles that lose digits in any shorter form; also -0.0 and a subnormal.
    points = [[0.1 + 0.2, -0.0, 5e-324], [np.nextafter(1.0, 2.0), 1e150, -1e-300]]
    points += [[np.pi * 1e17, 2**53 + 2, 1e22], [-THIRD, 1e-5, 123456789.123456789]]
    return PolyMesh.of(points, [[3, 1, 0, 2]])


def _strip_of_quads() -> PolyMesh:
    points = [[i, j, 0.1 * i * j] for i in range(4) for j in range(3)]
    quads = [
        [3 * i + j, 3 * i + 3 + j, 3 * i + 4 + j, 3 * i + 1 + j] for i in range(3) for j in (0, 1)
    ]
    return QuadMesh.of(points, quads)


def _triangle_quad_pentagon() -> PolyMesh:
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 2, THIRD], [2, 0, 0], [3, 1, 1]]
    points += [[2, 2, 0]]
    return PolyMesh.of(points, [[0, 1, 2, 3], [3, 2, 4], [1, 5, 6, 7, 2]])


def _large_polygon() -> PolyMesh:
    # More corners than a byte can count.
    angles = np.linspace(0.0, 2.0 * np.pi, 300, endpoint=False)
    points = np.stack([np.cos(angles), np.sin(angles), np.zeros(300)], axis=1)
    return PolyMesh.of(points, [list(range(300))])


def _closed_cube() -> PolyMesh:
    points = [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return QuadMesh.of(points, quads)


def _two_pieces() -> PolyMesh:
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [6, 0, 0], [5, 1, 0]]
    return PolyMesh.of(points, [[0, 1, 2], [3, 4, 5]])


ZOO = {
    "square": _square,
    "extreme numbers": _extreme_numbers,
    "strip of quads": _strip_of_quads,
    "triangle, quad, pentagon": _triangle_quad_pentagon,
    "large polygon": _large_polygon,
    "closed cube": _closed_cube,
    "two pieces": _two_pieces,
}


@pytest.fixture(params=list(ZOO))
def mesh(request: pytest.FixtureRequest) -> PolyMesh:
    return ZOO[request.param]()


@pytest.fixture
def mixed() -> PolyMesh:
    return _triangle_quad_pentagon()
