"""Cells of crossings, filling of rows and columns, manifold parts: by hand-made arrangements."""

import numpy as np
import pytest

from pqmesh.mesh.topology import Topology
from pqmesh.network.crossings import Crossings
from pqmesh.network.lines import Lines
from pqmesh.network.quads import cells, filled, manifold_part, touching
from pqmesh.surface.base import Domain


def grid_quads(m, n):
    """Quads of an m x n grid, vertex (i, j) = i (n+1) + j; quad (i, j) = i n + j."""
    i, j = (a.ravel() for a in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
    a = i * (n + 1) + j
    return np.stack([a, a + n + 1, a + n + 2, a + 1], axis=1)


def mask(picture):
    """Choice of quads of a grid from rows of x and dots; first index downwards."""
    return np.array([c == "x" for row in picture for c in row])


def picture(chosen, n):
    return ["".join("x" if c else "." for c in row) for row in chosen.reshape(-1, n)]


def plain_lines(count, closed=False):
    """Lines without geometry: only their number and whether they close matter to cells."""
    return Lines(
        np.arange(count + 1),
        np.zeros((count, 5, 2)),
        np.zeros(count),
        np.full(count, 100.0),
        np.full(count, closed),
        np.zeros((count, 2), dtype=np.int64),
    )


def arrangement(rows):
    """Crossings of lines a (rows) and b (columns) at the given (i, j); a runs along j."""
    pairs = np.array(sorted(rows))
    arcs = np.stack([pairs[:, 1], pairs[:, 0]], axis=1).astype(float)
    uv = arcs.copy()
    return Crossings(pairs, arcs, uv, np.ones(len(pairs)))


def test_cells_of_a_full_grid_are_its_quads():
    found = arrangement([(i, j) for i in range(4) for j in range(5)])
    quads = cells(found, plain_lines(4), plain_lines(5))
    assert len(quads) == 12
    corners = found.uv[quads]
    # Counterclockwise unit squares.
    x, y = corners[..., 0], corners[..., 1]
    area = 0.5 * (x * np.roll(y, -1, 1) - np.roll(x, -1, 1) * y).sum(axis=1)
    assert area == pytest.approx(1.0)


def test_cells_do_not_depend_on_the_direction_of_lines():
    found = arrangement([(i, j) for i in range(4) for j in range(5)])
    arcs, side = found.arcs.copy(), found.side.copy()
    turned = found.lines[:, 0] == 2
    arcs[turned, 0] *= -1.0
    side[turned] *= -1.0
    turned = found.lines[:, 1] == 3
    arcs[turned, 1] *= -1.0
    side[turned] *= -1.0
    other = cells(Crossings(found.lines, arcs, found.uv, side), plain_lines(4), plain_lines(5))
    same = cells(found, plain_lines(4), plain_lines(5))
    assert {frozenset(q) for q in other.tolist()} == {frozenset(q) for q in same.tolist()}


def test_line_that_ends_inside_leaves_a_pentagon_out():
    # Line a1 ends after column 2: the cells beside its end are no quads.
    nodes = [(i, j) for i in range(3) for j in range(5) if not (i == 1 and j > 2)]
    quads = cells(arrangement(nodes), plain_lines(3), plain_lines(5))
    # Left of its end two rows of two cells, right of it one row of one: the pentagon is missing.
    assert len(quads) == 4 + 1


def test_cells_run_around_closed_lines():
    n = 6
    found = arrangement([(i, j) for i in range(3) for j in range(n)])
    lines = plain_lines(3, closed=True)
    quads = cells(found, lines, plain_lines(n))
    assert len(quads) == 2 * n
    topology = Topology(quads.tolist(), len(found))
    assert topology.euler_characteristic == 0
    assert len(topology.boundary_loops) == 2


def test_cells_of_both_families_closed_are_a_torus():
    found = arrangement([(i, j) for i in range(4) for j in range(6)])
    quads = cells(found, plain_lines(4, closed=True), plain_lines(6, closed=True))
    topology = Topology(quads.tolist(), len(found))
    assert len(quads) == 24
    assert topology.euler_characteristic == 0
    assert not topology.boundary_loops


def test_cells_of_no_crossings_are_none():
    empty = Crossings(np.empty((0, 2), int), np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
    assert cells(empty, plain_lines(1), plain_lines(1)).shape == (0, 4)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (["x.x", "xxx"], ["xxx", "xxx"]),  # notch
        (["xxx", "x.x", "xxx"], ["xxx", "xxx", "xxx"]),  # hole
        (["x..", "...", "..x"], ["x..", "...", "..x"]),  # nothing between in row or column
        (["x..x", "....", "x..x"], ["xxxx", "xxxx", "xxxx"]),  # a gap filled opens another
        (["xx..", ".xx.", "..xx"], ["xx..", ".xx.", "..xx"]),  # a staircase is convex
    ],
)
def test_filled_completes_rows_and_columns(before, after):
    m, n = len(before), len(before[0])
    usable = np.ones(m * n, dtype=bool)
    assert picture(filled(grid_quads(m, n), mask(before), usable), n) == after


def test_filled_leaves_gaps_that_hold_an_unusable_quad():
    usable = np.ones(6, dtype=bool)
    usable[1] = False
    assert picture(filled(grid_quads(2, 3), mask(["x.x", "x.x"]), usable), 3) == ["x.x", "xxx"]


def test_filled_drops_unusable_quads():
    usable = np.array([True, False, True])
    assert filled(grid_quads(1, 3), np.ones(3, bool), usable).tolist() == [True, False, True]


def test_manifold_part_keeps_the_largest_piece():
    chosen = mask(["xx.x", "xx.x", "xx.."])
    assert picture(manifold_part(grid_quads(3, 4), chosen), 4) == ["xx..", "xx..", "xx.."]


def test_manifold_part_cuts_what_hangs_on_a_vertex():
    # The two right quads join the rest only diagonally, through one vertex.
    chosen = mask(["xxx..", "xxx..", "...xx"])
    assert picture(manifold_part(grid_quads(3, 5), chosen), 5) == ["xxx..", "xxx..", "....."]


def test_manifold_part_opens_pinched_vertices():
    # A ring that touches itself: edge-connected, but one vertex with two fans.
    chosen = mask(["xxx", "x.x", "xx.", "xxx"])
    kept = manifold_part(grid_quads(4, 3), chosen)
    topology = Topology(grid_quads(4, 3)[kept].tolist(), 20) if kept.all() else None
    assert topology is None
    faces = grid_quads(4, 3)[kept]
    _, corners = np.unique(faces, return_inverse=True)
    # Topology refuses pinched vertices: to be accepted is the test.
    assert Topology(corners.reshape(-1, 4).tolist(), corners.max() + 1).n_faces == kept.sum()
    assert kept.sum() >= chosen.sum() - 2


def test_manifold_part_of_nothing_is_nothing():
    assert not manifold_part(grid_quads(2, 2), np.zeros(4, bool)).any()


def test_touching_quads_reach_into_the_region():
    quads = grid_quads(3, 3)
    uv = np.stack(np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), -1).reshape(-1, 2)
    domain = Domain((0, 3), (0, 3))
    hits = touching(quads, uv, domain, lambda p: (p[:, 0] < 0.9) & (p[:, 1] > 1.2))
    assert picture(hits, 3) == [".xx", "...", "..."]


def test_touching_works_over_a_period():
    domain = Domain((0, 4), (0, 1), (True, False))
    uv = np.array([[3.5, 0.2], [0.5, 0.2], [0.5, 0.8], [3.5, 0.8]])
    quads = np.array([[0, 1, 2, 3]])
    assert touching(quads, uv, domain, lambda p: (p[:, 0] > 3.6) | (p[:, 0] < 0.3)).all()
    assert not touching(quads, uv, domain, lambda p: np.abs(p[:, 0] - 2.0) < 1.0).any()
