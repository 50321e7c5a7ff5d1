"""P(M) on real and large meshes: figures, refusals, bases, time and memory."""

import resource
import sys
import time

import numpy as np
import pytest
from pq import pq_rows
from shapes import curved_mesh, zoo

from pqmesh.errors import MeshError
from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.exact import grid_mesh
from pqmesh.mesh.loops import spanning_forest
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.mesh.solids import sphere_tangent_mesh
from pqmesh.offset.distances import parallel_error
from pqmesh.offset.parallel import (
    FEW,
    _largest_gap,
    closing_matrix,
    generic_dimension,
    parallel_space,
)


def large_grid(n):
    """n x n planar faces: a projective image of sums of two polylines."""
    rng = np.random.default_rng(0)
    first = np.cumsum(np.column_stack([np.ones(n + 1), 0.3 * rng.normal(size=(n + 1, 2))]), axis=0)
    second = np.cumsum(
        np.column_stack([0.3 * rng.normal(size=n + 1), np.ones(n + 1), np.zeros(n + 1)]), axis=0
    )
    second[:, 2] = 0.1 / n * second[:, 1] ** 2
    points = first[:, None] + second[None]
    return grid_mesh(points / (1 + points @ np.array([0.2, 0.3, 0.5]) / n)[..., None])


# --- real meshes ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "dimension", "gap"),
    [("conical1.obj", 69, 1e3), ("formfinding-circular.off", 38, 1e2), ("hypar.obj", 4, 1e9)],
)
def test_real_mesh_has_its_dimension_with_a_clear_gap(data_folder, name, dimension, gap):
    mesh = read_quad_mesh(data_folder / name)
    start = time.process_time()
    space = parallel_space(mesh)
    assert time.process_time() - start < 2.0
    assert space.dimension == dimension
    assert space.gap > gap
    # Members turn edges by no more than the mesh is out of plane.
    step = np.random.default_rng(0).normal(size=dimension)
    other = mesh.with_vertices(mesh.vertices + 0.1 * space.member(step).vertices)
    noise = 1e-3 if dimension > 4 else 1e-12
    assert parallel_error(mesh, other).max() < noise


@pytest.mark.parametrize(("name", "planarity"), [("six.off", "0.051"), ("YasIsland.off", "0.0013")])
def test_real_mesh_that_is_neither_flat_nor_bent_is_refused_with_its_planarity(
    data_folder, name, planarity
):
    mesh = read_quad_mesh(data_folder / name)
    with pytest.raises(MeshError, match=rf"planarity of face \d+ is {planarity},"):
        parallel_space(mesh)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least", "most"), [("YasIsland.off", 107, 107), ("six.off", 64, 70)]
)
def test_optimised_real_mesh_has_the_generic_dimension(data_folder, name, least, most):
    from pqmesh.optimize.schedule import optimized
    from pqmesh.surface.reference import TriangleReference

    start = read_quad_mesh(data_folder / name)
    reference = TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    mesh = start.with_vertices(optimized("planar", start, reference).blocks["vertices"])
    begun = time.process_time()
    space = parallel_space(mesh)
    assert time.process_time() - begun < 2.0
    assert least <= space.dimension <= most
    assert generic_dimension(mesh.topology) == least


def test_planar_mesh_between_two_decisions_names_the_missing_gap():
    # Noise of a thousandth: far from flat by rounding, but not bent on purpose either.
    mesh = pq_rows(8, 8)
    rng = np.random.default_rng(0)
    noisy = mesh.with_vertices(mesh.vertices + 1e-3 * rng.normal(size=mesh.vertices.shape))
    with pytest.raises(MeshError, match="Optimise the mesh to planar faces first"):
        parallel_space(noisy)
    # A thousand times less is still decided, and the gap tells of the noise.
    slight = mesh.with_vertices(mesh.vertices + 1e-6 * rng.normal(size=mesh.vertices.shape))
    space = parallel_space(slight)
    assert space.dimension == parallel_space(mesh).dimension
    assert 1e2 < space.gap < 1e7


# --- bases ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["annulus", "torus", "two_handles", "irregular_disc", "l_shape"])
def test_basis_is_orthonormal_and_spans_what_the_closing_matrix_annihilates(name):
    mesh = zoo()[name][0]
    space = parallel_space(mesh)
    identity = np.eye(space.dimension)
    assert np.abs(space.basis.T @ space.basis - identity).max() < 1e-13
    assert np.abs(closing_matrix(mesh, space.forest) @ space.factors).max() < 1e-13
    # The same space by the definition, u x (v'_j - v'_i) = 0 over all edges, densely.
    low, high = mesh.edges.T
    members = space.basis.reshape(-1, 3, space.dimension)
    u = mesh.edge_vectors / mesh.edge_lengths[:, None]
    turned = np.cross(u[:, None, :], np.moveaxis(members[high] - members[low], 2, 1))
    assert np.abs(turned).max() < 1e-13
    rows = np.zeros((len(u), 3, len(mesh.vertices), 3))
    skew = np.stack([np.cross(u, axis) for axis in np.eye(3)], axis=-1)
    rows[np.arange(len(u)), :, high] = skew
    rows[np.arange(len(u)), :, low] = -skew
    values = np.linalg.svd(rows.reshape(3 * len(u), -1), compute_uv=False)
    full = 3 * len(mesh.vertices)
    assert full - np.count_nonzero(values > 1e-9) == space.dimension


def test_exact_factors_are_added_up_without_correction(monkeypatch):
    def never(*_):
        raise AssertionError("the sums along the tree did not close")

    monkeypatch.setattr("pqmesh.offset.parallel._least_squares_step", never)
    for name in ("cube", "l_shape", "two_handles"):
        # Corners with whole coordinates: sums of edges are exact.
        mesh = zoo()[name][0]
        points = parallel_space(mesh).positions(np.full(len(mesh.edges), 2.0))
        assert np.ptp(2 * mesh.vertices - points, axis=0).max() < 1e-14


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_largest_gap_is_found_wherever_and_however_edges_do_not_close(sign):
    topology = large_grid(20).topology
    forest, points = spanning_forest(topology), np.zeros((21 * 21, 3, 2))
    beside = np.setdiff1d(np.arange(topology.n_edges), forest.parent_edge[forest.parent >= 0])
    assert len(beside) > FEW
    for edge in (beside[0], beside[FEW - 1], beside[FEW], beside[-1]):
        edges = np.zeros((topology.n_edges, 3, 2))
        edges[edge, 1, 1] = 3.0 * sign
        assert _largest_gap(topology, forest, edges, points) == 3.0


def test_factors_that_do_not_close_are_met_in_least_squares():
    mesh = zoo()["two_handles"][0]
    space = parallel_space(mesh)
    factors = np.random.default_rng(0).normal(size=(len(mesh.edges), 2))
    points = space.positions(factors)
    low, high = mesh.edges.T
    missing = mesh.edge_vectors[:, :, None] * factors[:, None] - (points[high] - points[low])
    assert np.abs(missing).max() > 0.1
    # What is missing balances at every vertex: the condition of least squares.
    pull = np.zeros_like(points)
    np.add.at(pull, high, missing)
    np.add.at(pull, low, -missing)
    assert np.abs(pull).max() < 1e-12
    assert np.abs(points.mean(axis=0)).max() < 1e-14
    assert np.abs(space.positions(factors[:, 1]) - points[:, :, 1]).max() < 1e-14


def test_coordinates_give_members_back():
    space = parallel_space(zoo()["torus"][0])
    wanted = np.random.default_rng(0).normal(size=space.dimension)
    found = space.coordinates(space.member(wanted).vertices)
    assert np.abs(found - wanted).max() < 1e-13


@pytest.mark.parametrize(
    ("mesh", "fill"),
    [(large_grid(20), 0.27), (pq_rows(4, 6), 1.0), (pq_rows(3, 7, closed=True), 1.0)],
    ids=["grid by strips", "bent grid", "annulus"],
)
def test_local_basis_is_well_conditioned_spans_the_same_space_and_is_sparse_on_grids(mesh, fill):
    space = parallel_space(mesh)
    local, seeds = space.local_factors
    dense = local.toarray()
    # On a grid an element reaches to one side of the middle lines only: a quarter.
    assert local.nnz <= fill * dense.size
    assert np.abs(dense[seeds] - np.eye(len(seeds))).max() < 1e-12
    assert np.linalg.cond(dense) < 200
    across = dense - space.factors @ (space.factors.T @ dense)
    assert np.abs(across).max() < 1e-10
    # Sums of them are members of P(M), also by the definition.
    factors = local @ np.random.default_rng(0).normal(size=len(seeds))
    member = mesh.with_vertices(space.positions(factors))
    assert np.abs(np.cross(mesh.edge_vectors, member.edge_vectors)).max() < 1e-9
    assert np.abs(space.edge_factors(member) - factors).max() < 1e-9


def test_polygon_meshes_have_parallel_meshes_too():
    points = np.random.default_rng(1).normal(size=(14, 3))
    mesh = sphere_tangent_mesh(points)
    assert mesh.topology.face_sizes.max() > 4
    assert planarity(mesh).max() < 1e-13
    assert parallel_space(mesh).dimension == 14


def test_planarity_of_polygons_is_near_that_of_quads():
    mesh = curved_mesh(4, 4, noise=0.05)
    pair = QuadMesh.of(mesh.vertices, mesh.faces)
    split = [*pair.topology.face_lists()[:-1]]
    a, b, c, d = pair.topology.face_lists()[-1]
    from pqmesh.mesh.quadmesh import PolyMesh

    mixed = PolyMesh.of(mesh.vertices, [*split, [a, b, c], [a, c, d]])
    found = planarity(mixed)
    assert np.allclose(found[:-2], planarity(pair)[:-1], rtol=0.1)
    assert found[-2:].max() < 1e-15


# --- size -------------------------------------------------------------------------------------


def test_basis_of_ten_thousand_faces_takes_seconds_and_fits_in_a_gigabyte():
    mesh = large_grid(100)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    space = parallel_space(mesh)
    assert space.dimension == 203
    assert space.gap > 1e9
    # A second and a half on one core, twice that in two threads; the rest is for busy machines.
    assert time.process_time() - start < 8.0
    assert space.basis.shape == (3 * 101 * 101, 203)
    # Kilobytes on Linux, bytes on a Mac.
    unit = 1 if sys.platform == "darwin" else 1024
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * unit < 1024**3


def test_same_mesh_gives_the_same_bytes():
    mesh = large_grid(24)
    first, second = parallel_space(mesh), parallel_space(mesh)
    assert first.factors.tobytes() == second.factors.tobytes()
    assert first.basis.tobytes() == second.basis.tobytes()


def test_dimension_does_not_depend_on_unit_place_or_numbering():
    mesh = pq_rows(4, 5, closed=True)
    wanted = parallel_space(mesh)
    for scale, shift in ((1e-3, 0.0), (1e3, 0.0), (1.0, 1e4)):
        moved = parallel_space(mesh.with_vertices(scale * mesh.vertices + shift))
        assert moved.dimension == wanted.dimension
        # Coordinates 1e4 from the origin have lost four digits.
        assert moved.next == pytest.approx(wanted.next, rel=1e-8)
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    points = np.empty_like(mesh.vertices)
    points[order] = mesh.vertices
    other = parallel_space(QuadMesh.of(points, order[mesh.faces][::-1]))
    assert other.dimension == wanted.dimension
