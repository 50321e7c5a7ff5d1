"""Flat edges of conical meshes: axes at their ends in one plane with them, or left and told."""

import numpy as np
import pytest

from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import flipped_faces, measures, nonconvex_faces
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.solids import cube
from pqmesh.offset.offsets import offset_vectors
from pqmesh.offset.support import twist
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import solve
from pqmesh.optimize.twist import flat_edges, is_skew
from pqmesh.surface.reference import TriangleReference


def star(sectors, n, height):
    """Sectors of n x n quads around one vertex in the middle of a surface z = height(x, y)."""
    turn = 2 * np.pi * np.arange(sectors) / sectors
    ways = np.column_stack([np.cos(turn), np.sin(turn)])
    numbers, faces = {}, []

    def at(sector, i, j):
        point = i * ways[sector] + j * ways[(sector + 1) % sectors]
        return numbers.setdefault(tuple(np.round(point, 6) + 0.0), len(numbers))

    for sector in range(sectors):
        for i in range(n):
            for j in range(n):
                corners = ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
                faces.append([at(sector, *corner) for corner in corners])
    xy = np.array(list(numbers))
    return QuadMesh.of(np.column_stack([xy, height(*xy.T)]), faces)


# Gauss images of the middle vertex are narrow: its six faces fall into two or three planes.
NARROW = {
    "cylinder": star(6, 3, lambda x, y: -0.08 * x * x + 0.01 * x * y),
    "saddle": star(6, 3, lambda x, y: 0.06 * (x * x - y * y) + 0.02 * x),
    "monkey saddle": star(6, 3, lambda x, y: 0.02 * (x**3 - 3 * x * y * y) + 0.05 * x * x),
}


def reference_of(mesh):
    return TriangleReference.of_polygons(mesh.vertices, mesh.faces.tolist())


def inner_twist(mesh):
    """Largest twist of an edge between inner vertices, radians."""
    inner = ~mesh.topology.is_boundary_vertex[mesh.edges].any(axis=1)
    return twist(mesh, offset_vectors(mesh, "conical").axes)[inner].max()


@pytest.mark.parametrize("name", NARROW)
def test_conical_mesh_has_no_twisted_beam_at_flat_edges(name):
    start = NARROW[name]
    reference = reference_of(start)
    first = solve(problem_for("conical", start, reference), start)
    bare = start.with_vertices(first.blocks["vertices"])
    # Every vertex has its cone, and beams are twisted all the same: that is what is mended.
    assert first.converged
    assert is_skew(bare, flat_edges(bare))
    assert inner_twist(bare) > 0.05
    found = optimized("conical", start, reference)
    mesh = start.with_vertices(found.blocks["vertices"])
    assert found.converged
    assert not is_skew(mesh, flat_edges(mesh))
    assert inner_twist(mesh) < 1e-9
    reached = measures(mesh)
    assert reached["planarity_max"] < 1e-11
    assert reached["offset_misfit_max"] < 1e-9
    assert len(nonconvex_faces(mesh)) == len(flipped_faces(mesh)) == 0


def test_flat_edges_of_a_cylinder_are_not_skew():
    height = np.linspace(0.0, 2.0, 6)
    tube = rotational_mesh(np.column_stack([np.ones(6), height]), 0.3 * np.arange(9))
    flat = flat_edges(tube)
    # Edges across the rulings, between inner vertices: 4 circles of 6 edges.
    assert len(flat) == 4 * 6
    assert not is_skew(tube, flat)


def test_box_has_no_flat_edges():
    assert len(flat_edges(cube())) == 0
    assert not is_skew(cube(), flat_edges(cube()))
