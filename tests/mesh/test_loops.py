"""Spanning trees and the loops that faces do not fill."""

import numpy as np
import pytest
from shapes import zoo

from pqmesh.mesh.loops import open_loops, spanning_forest
from pqmesh.mesh.solids import rhombic_triacontahedron


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("grid", 0),
        ("cube", 0),
        ("notch", 0),
        ("two_pieces", 0),
        ("annulus", 1),
        ("window", 1),
        ("two_windows", 2),
        ("torus", 2),
        ("two_handles", 4),
    ],
)
def test_number_of_open_loops_is_that_of_holes_and_handles(name, count):
    topology = zoo()[name][0].topology
    assert len(open_loops(topology, spanning_forest(topology))) == count


@pytest.mark.parametrize("name", sorted(zoo()))
def test_loops_are_closed_walks_independent_of_the_faces(name):
    topology = zoo()[name][0].topology
    loops = open_loops(topology, spanning_forest(topology))
    rows = np.zeros((topology.n_faces + len(loops), topology.n_edges))
    signs = np.where(topology.indices == topology.edges[topology.face_edges, 0], 1.0, -1.0)
    rows[topology.corner_faces, topology.face_edges] = signs
    for number, loop in enumerate(loops, topology.n_faces):
        np.add.at(rows[number], loop.edges, loop.signs)
        # As often into each vertex as out of it.
        ends = np.zeros(topology.n_vertices)
        np.add.at(ends, topology.edges[loop.edges, 0], -loop.signs)
        np.add.at(ends, topology.edges[loop.edges, 1], loop.signs)
        assert not ends.any()
        assert len(set(loop.edges.tolist())) == len(loop.edges)
    # All closed walks: E - V + pieces of them, spanned by faces and loops.
    pieces = int(topology.components.max()) + 1
    walks = topology.n_edges - topology.n_vertices + pieces
    assert np.linalg.matrix_rank(rows) == walks
    closed = not topology.is_boundary_edge.any()
    assert len(rows) == walks + (pieces if closed else 0)


def test_forest_reaches_every_vertex_over_edges_that_exist():
    topology = rhombic_triacontahedron().topology
    forest = spanning_forest(topology)
    assert sorted(np.concatenate(forest.levels).tolist()) == list(range(topology.n_vertices))
    for vertex in range(topology.n_vertices):
        for start, end, edge in forest.path(vertex):
            assert sorted((start, end)) == topology.edges[edge].tolist()
        assert len(forest.path(vertex)) == next(
            k for k, level in enumerate(forest.levels) if vertex in level
        )
