"""Members of P(M): nearest, prescribed, dragged; combinations; node axes without an offset."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pq import pq_rows
from scipy.optimize import minimize

from pqmesh.errors import MeshError
from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import circularity_defect, fitted_cones, planarity
from pqmesh.offset.distances import is_parallel, parallel_error
from pqmesh.offset.members import Wishes, combined, dragged, nearest_axes, nearest_member
from pqmesh.offset.parallel import parallel_space
from pqmesh.offset.support import twist

SPACE = parallel_space(pq_rows(4, 5, seed=3))
MESH = SPACE.mesh
PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def test_nearest_member_of_a_member_is_itself():
    other = SPACE.member(np.random.default_rng(0).normal(size=SPACE.dimension))
    found = nearest_member(SPACE, other.vertices)
    assert np.abs(found.mesh.vertices - other.vertices).max() < 1e-13
    assert found.moved < 1e-13


def test_nearest_member_is_nearer_than_any_other():
    target = MESH.vertices + 0.1 * np.random.default_rng(1).normal(size=MESH.vertices.shape)
    found = nearest_member(SPACE, target)
    assert is_parallel(MESH, found.mesh)
    away = target - found.mesh.vertices
    # What is left stands at right angles on the space: that is what nearest means.
    assert np.abs(SPACE.basis.T @ away.ravel()).max() < 1e-13
    assert found.moved == pytest.approx(np.sqrt((away**2).sum(axis=1).mean()))
    # A general minimiser finds the same from elsewhere.
    start = np.random.default_rng(2).normal(size=SPACE.dimension)
    by_hand = minimize(lambda c: ((SPACE.basis @ c - target.ravel()) ** 2).sum(), start)
    assert np.abs(SPACE.basis @ by_hand.x - found.mesh.vertices.ravel()).max() < 1e-5


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), factor=st.floats(0.3, 3.0))
def test_wished_edge_gets_its_length_and_little_else_changes(seed, factor):
    rng = np.random.default_rng(seed)
    edge = int(rng.integers(len(MESH.edges)))
    a, b = MESH.edges[edge].tolist()
    wanted = factor * MESH.edge_lengths[edge]
    found = nearest_member(SPACE, wishes=Wishes(lengths={(b, a): wanted}))
    assert found.error < 1e-12
    assert found.mesh.edge_lengths[edge] == pytest.approx(wanted, abs=1e-12)
    assert is_parallel(MESH, found.mesh)
    # Of all members with that edge none is nearer: the rest of the step is at right angles.
    basis = SPACE.basis.reshape(-1, 3, SPACE.dimension)
    row = (basis[b] - basis[a]).T @ (MESH.edge_vectors[edge] / MESH.edge_lengths[edge])
    step = SPACE.coordinates(found.mesh.vertices) - SPACE.coordinates(MESH.vertices)
    assert np.abs(step - row * (row @ step) / (row @ row)).max() < 1e-10


def test_dragged_vertices_go_where_told_and_held_ones_stay():
    place = MESH.vertices[29] + [0.05, -0.03, 0.04]
    found = dragged(SPACE, {29: place}, held=[0])
    assert found.error < 1e-12
    assert np.abs(found.mesh.vertices[29] - place).max() < 1e-12
    assert np.abs(found.mesh.vertices[0] - MESH.vertices[0]).max() < 1e-12
    assert parallel_error(MESH, found.mesh).max() < 1e-9
    assert planarity(found.mesh).max() < 1e-12


def test_drag_out_of_reach_ends_at_the_nearest_place_and_says_so():
    # Two ends of an edge: it cannot turn, so only the part along it is reached.
    a, b = MESH.edges[0].tolist()
    along = MESH.edge_vectors[0] / MESH.edge_lengths[0]
    side = np.cross(along, [0.3, 0.2, 1.0])
    side /= np.linalg.norm(side)
    place = MESH.vertices[b] + 0.2 * along + 0.3 * side
    found = dragged(SPACE, {b: place}, held=[a])
    assert is_parallel(MESH, found.mesh)
    assert 0.1 < found.error < 0.3
    # The sum of squares is smallest when both ends share the missing part.
    gap = found.mesh.vertices[[a, b]] - [MESH.vertices[a], place]
    assert np.abs(gap[0] - [-0.15, 0.15] @ np.array([0 * side, side])).max() < 1e-12
    assert np.abs(gap[1] + 0.15 * side).max() < 1e-12


def test_dragging_keeps_circular_faces_circular_and_conical_vertices_conical():
    mesh = rotational_mesh(PROFILE, 0.3 * np.arange(6))
    space = parallel_space(mesh)
    found = dragged(space, {8: mesh.vertices[8] + [0.04, 0.02, 0.05]}, held=[0, 29]).mesh
    assert np.abs(found.vertices - mesh.vertices).max() > 0.02
    assert np.abs(circularity_defect(found)).max() < 1e-10
    assert fitted_cones(found).relative_spread.max() < 1e-10


def test_contradicting_lengths_are_shared_in_least_squares():
    # A box: all four edges of one direction are one length.
    box = parallel_space(pq_rows(1, 1))
    edges = [tuple(pair) for pair in box.mesh.edges.tolist()]
    lengths = {edge: 1.0 + 0.3 * k for k, edge in enumerate(edges)}
    found = nearest_member(box, wishes=Wishes(lengths=lengths))
    # Four lengths of two free ones.
    assert found.error > 1e-2
    assert is_parallel(box.mesh, found.mesh)


def test_wishes_that_say_the_same_twice_are_fulfilled():
    a, b = MESH.edges[3].tolist()
    length = 1.3 * MESH.edge_lengths[3]
    way = length * MESH.edge_vectors[3] / MESH.edge_lengths[3]
    places = {a: MESH.vertices[a], b: MESH.vertices[a] + way}
    found = nearest_member(SPACE, wishes=Wishes(places=places, lengths={(a, b): length}))
    assert found.error < 1e-12


def test_combination_of_members_is_a_member_and_other_faces_are_refused():
    rng = np.random.default_rng(0)
    members = [SPACE.member(rng.normal(size=SPACE.dimension)) for _ in range(3)]
    assert is_parallel(MESH, combined(members, [0.5, -2.0, 1.0]))
    with pytest.raises(MeshError, match="same faces to correspond"):
        combined([MESH, pq_rows(3, 5)], [1.0, 1.0])
    with pytest.raises(MeshError, match="one weight for each"):
        combined([MESH], [1.0, 2.0])


def test_wishes_without_sense_are_refused():
    cases = [
        (Wishes(places={99: [0, 0, 0]}), "vertex 99"),
        (Wishes(lengths={(0, 29): 1.0}), "0 and 29 are not joined"),
        (Wishes(lengths={(0, 1): np.nan}), "must be finite"),
    ]
    for wishes, text in cases:
        with pytest.raises(MeshError, match=text):
            nearest_member(SPACE, wishes=wishes)
    with pytest.raises(MeshError, match=r"shape \(30, 3\); found \(2, 3\)"):
        nearest_member(SPACE, np.zeros((2, 3)))


def test_axes_of_a_circular_mesh_near_its_normals_are_close_and_free_of_twist():
    mesh = rotational_mesh(PROFILE, [0, 0.2, 0.5, 0.7, 1.0])
    axes = nearest_axes(parallel_space(mesh))
    assert twist(mesh, axes.vectors).max() < 1e-12
    assert np.degrees(axes.tilt).max() < 25
    assert 0.5 < axes.scale.min() < axes.scale.max() < 1.5


def test_planar_mesh_without_any_offset_has_axes_with_hardly_any_twist(data_folder):
    # A shell planar to 5e-5; its vertex normals twist beams by degrees, axes in P(M) by its noise.
    mesh = read_quad_mesh(data_folder / "formfinding-circular.off")
    axes = nearest_axes(parallel_space(mesh))
    plain = np.degrees(twist(mesh, mesh.vertex_normals).max())
    found = np.degrees(np.median(twist(mesh, axes.vectors)))
    assert plain > 1.0
    assert found < 0.01
