"""Meshes without every second line, and the interpolation back."""

import numpy as np
import pytest
from shapes import (
    curved_mesh,
    observed_orders,
    sampled,
    torus,
    torus_grid,
    vertex_fan,
    without_faces,
    zoo,
)

from pqmesh.mesh.coarse import coarsened
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.isomorphism import isomorphism
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.topology import Topology


def plan_grid(m, n, height=lambda x, y: 0.0 * x):
    x, y = np.meshgrid(np.arange(m + 1.0), np.arange(n + 1.0), indexing="ij")
    return grid_mesh(np.stack([x, y, height(x, y)], axis=-1))


def tube(m, n):
    """m faces along, n around."""
    return grid_mesh(
        sampled(torus, 0.3 * np.arange(m + 1), 2 * np.pi / n * np.arange(n))[0], (False, True)
    )


def closed_torus(m, n):
    points, _ = sampled(torus, 2 * np.pi / m * np.arange(m), 2 * np.pi / n * np.arange(n))
    return grid_mesh(points, (True, True))


def subdivided(mesh):
    """Every quad cut into four at the middles of its edges; old vertices come first."""
    topology = mesh.topology
    edges = topology.face_edges.reshape(-1, 4) + topology.n_vertices
    centers = topology.n_vertices + len(topology.edges) + np.arange(topology.n_faces)
    points = [
        mesh.vertices,
        mesh.vertices[topology.edges].mean(axis=1),
        mesh.vertices[mesh.faces].mean(axis=1),
    ]
    faces = [
        np.stack([mesh.faces[:, k], edges[:, k], centers, edges[:, k - 1]], axis=1)
        for k in range(4)
    ]
    return QuadMesh.of(np.concatenate(points), np.concatenate(faces))


def lines_kept(n):
    """Lines of n strips side by side that stay: the rims, and every second one between them."""
    return n + 1 - (n // 2)


# --- what stays -------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [2, 3, 4, 5, 8])
@pytest.mark.parametrize("n", [1, 2, 3, 6, 7])
def test_grids_keep_their_rims_and_at_least_half_of_their_lines(m, n):
    mesh = plan_grid(m, n)
    coarse, kept, _ = coarsened(mesh)
    assert (coarse.vertices == mesh.vertices[kept]).all()
    assert coarse.topology.n_faces == (lines_kept(m) - 1) * (lines_kept(n) - 1)
    x, y = (np.unique(coarse.vertices[:, axis]) for axis in (0, 1))
    for places, count in ((x, m), (y, n)):
        assert len(places) == lines_kept(count)
        assert (places[0], places[-1]) == (0, count)
        # Strips are merged in pairs; of an odd number one stays single.
        assert sorted(np.diff(places)) == [1] * (count % 2) + [2] * (count // 2)
    # A product of the two sets of lines, every face the right way round.
    assert len(coarse.vertices) == len(x) * len(y)
    assert (coarse.face_area_vectors[:, 2] > 0.5).all()
    assert coarse.face_area_vectors[:, 2].sum() == m * n


@pytest.mark.parametrize(("m", "n"), [(4, 6), (5, 8), (3, 7), (6, 5)])
def test_tubes_keep_their_ends_and_at_least_half_of_their_meridians(m, n):
    mesh = tube(m, n)
    coarse, kept, _ = coarsened(mesh)
    around = (n + 1) // 2
    assert coarse.topology.n_faces == (lines_kept(m) - 1) * around
    assert coarse.topology.euler_characteristic == 0
    rings, places = np.divmod(kept, n)
    assert len(coarse.topology.boundary_loops) == 2
    assert set(rings) >= {0, m}
    # No two lines that are left out bound the same strip.
    gone = np.setdiff1d(np.arange(n), places)
    assert len(gone) == n - around
    assert not np.isin((gone + 1) % n, gone).any()


@pytest.mark.parametrize(("m", "n"), [(6, 6), (7, 5), (8, 9), (12, 7)])
def test_tori_keep_at_least_half_of_both_families(m, n):
    coarse = coarsened(closed_torus(m, n)).mesh
    assert isomorphism(coarse.topology, torus_grid((m + 1) // 2, (n + 1) // 2)) is not None


@pytest.mark.parametrize("k", [3, 5, 6])
def test_subdivided_discs_about_irregular_vertices_come_back(k):
    turn = 2 * np.pi * np.arange(k) / k
    disc = vertex_fan(np.column_stack([np.cos(turn), np.sin(turn), np.full(k, -0.4)]))
    coarse, kept, _ = coarsened(subdivided(disc))
    assert sorted(kept) == list(range(len(disc.vertices)))
    assert isomorphism(coarse.topology, disc.topology) is not None


@pytest.mark.parametrize("name", ["cube", "l_shape", "two_handles", "window", "two_windows"])
def test_subdivided_meshes_of_any_topology_come_back(name):
    mesh = zoo()[name][0]
    fine = subdivided(mesh)
    coarse, kept, _ = coarsened(fine)
    assert isomorphism(coarse.topology, mesh.topology) is not None
    assert sorted(kept) == list(range(len(mesh.vertices)))
    assert (coarse.vertices == fine.vertices[kept]).all()


def test_lines_that_end_at_an_irregular_vertex_stay():
    # Eight strips a side are halved three times; then all lines run through corners of the cube.
    fine = zoo()["cube"][0]
    for _ in range(3):
        fine = subdivided(fine)
    counts = [fine.topology.n_faces]
    while (coarse := coarsened(fine)) is not None:
        fine = coarse.mesh
        counts.append(fine.topology.n_faces)
    assert counts == [384, 96, 24, 6]
    assert (fine.topology.valence == 3).all()


def test_pieces_are_coarsened_each_on_its_own():
    coarse = coarsened(zoo()["two_pieces"][0]).mesh
    assert coarse.topology.n_faces == 2 * 9
    assert coarse.topology.euler_characteristic == 2


def test_windows_and_notches_keep_their_rims():
    grid = curved_mesh(6, 6)
    for gone in ([14, 15, 20, 21], [5, 11]):
        mesh = without_faces(grid, gone)
        coarse, kept, _ = coarsened(mesh)
        valence = mesh.topology.valence
        corners = np.flatnonzero(mesh.topology.is_boundary_vertex & (valence != 3))
        assert np.isin(corners, kept).all()
        assert len(coarse.topology.boundary_loops) == len(mesh.topology.boundary_loops)
        assert coarse.topology.euler_characteristic == mesh.topology.euler_characteristic


# --- the way back -----------------------------------------------------------------------------

FINE = {
    "even": plan_grid(8, 6),
    "odd": plan_grid(7, 5),
    "strip": plan_grid(1, 6),
    "tube": tube(5, 8),
    "torus": closed_torus(8, 7),
    "window": zoo()["window"][0],
    "cube": subdivided(subdivided(zoo()["cube"][0])),
    "two_handles": subdivided(zoo()["two_handles"][0]),
}


@pytest.mark.parametrize("name", FINE)
def test_rows_sum_to_one_and_kept_vertices_keep_their_values(name):
    mesh = FINE[name]
    coarse, kept, prolongation = coarsened(mesh)
    count = len(coarse.vertices)
    assert prolongation.shape == (len(mesh.vertices), count)
    assert np.abs(prolongation @ np.ones(count) - 1).max() < 1e-15
    assert (prolongation[kept].toarray() == np.eye(count)).all()
    # Parabolas beside a single strip have the largest weights, 1/3, 1 and -1/3, once for each
    # family: noise at the coarse vertices is hardly amplified.
    assert np.abs(prolongation).sum(axis=1).max() < (5 / 3) ** 2 + 1e-12


PLANS = {
    "even": plan_grid(8, 6),
    "odd": plan_grid(7, 5),
    "mixed": plan_grid(4, 9),
    "strip": plan_grid(1, 6),
    "window": without_faces(plan_grid(6, 5), [11, 12, 16, 17]),
    "notch": without_faces(plan_grid(6, 5), [2, 7]),
}


@pytest.mark.parametrize("name", PLANS)
def test_linear_functions_of_the_places_come_back(name):
    mesh = PLANS[name]
    _, kept, prolongation = coarsened(mesh)
    wave = mesh.vertices @ np.array([0.7, -1.3, 0.0]) + 2.0
    assert np.abs(prolongation @ wave[kept] - wave).max() < 1e-14


@pytest.mark.parametrize(("m", "n"), [(8, 8), (7, 6), (9, 12)])
def test_cubics_come_back_inside_and_parabolas_everywhere(m, n):
    def square(x, y):
        return x * x - 0.5 * y * y + x * y

    def cube(x, y):
        return x**3 - 2 * y**3 + x * x * y

    for height, inner in ((square, False), (cube, True)):
        mesh = plan_grid(m, n, height)
        coarse, _, prolongation = coarsened(mesh)
        x, y, z = mesh.vertices.T
        gap = np.abs(prolongation @ coarse.vertices[:, 2] - z)
        far = np.ones(len(z), dtype=bool)
        if inner:
            # Two lines that stay on either side: three strips from the rim do.
            far = (np.minimum(x, m - x) >= 3) & (np.minimum(y, n - y) >= 3)
            assert gap.max() > 0.1
        assert far.any()
        # Sums of a few numbers of the size of z.
        assert gap[far].max() < 1e-15 * 10 * np.abs(z).max()


def test_points_of_a_circle_are_met_to_the_fourth_order():
    # Cubic interpolation: halving the edges divides the error by 16.
    gaps = []
    for n in (16, 32, 64):
        mesh = tube(1, n)
        coarse, _, prolongation = coarsened(mesh)
        gaps.append(np.abs(prolongation @ coarse.vertices - mesh.vertices).max())
    assert np.abs(observed_orders(gaps) - 4.0).max() < 0.1


# --- what cannot be coarsened -----------------------------------------------------------------


@pytest.mark.parametrize("name", ["one_face", "cube", "l_shape", "two_handles", "irregular_disc"])
def test_meshes_whose_lines_all_meet_the_rim_or_an_irregular_vertex_stay(name):
    assert coarsened(zoo()[name][0]) is None


def test_line_that_lies_beside_itself_stays():
    # A helix around a torus: its steps are one closed line, those across are six.
    n, pitch = 24, 6
    turn = 2 * np.pi * np.arange(n) / n
    points, _ = torus(turn, pitch * turn)
    i = np.arange(n)
    faces = np.stack([i, i + 1, i + 1 + pitch, i + pitch], axis=1) % n
    coarse, kept, _ = coarsened(QuadMesh.of(points, faces))
    assert len(np.unique(kept % 2)) == 1
    assert coarse.topology.n_faces == n // 2
    i = np.arange(n // 2)
    half = np.stack([i, i + 1, i + 1 + pitch // 2, i + pitch // 2], axis=1) % (n // 2)
    assert isomorphism(coarse.topology, Topology(half, n // 2)) is not None


@pytest.mark.parametrize("mesh", [tube(6, 4), tube(6, 3), closed_torus(8, 4)])
def test_closed_rows_keep_three_faces(mesh):
    coarse = coarsened(mesh)
    assert coarse is None or coarse.mesh.topology.n_faces < mesh.topology.n_faces
