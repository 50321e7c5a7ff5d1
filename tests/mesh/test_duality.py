"""Contact elements: from conical to circular meshes and back."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cyclide, sampled, torus, without_faces, zoo

from pqmesh.errors import MeshError
from pqmesh.mesh.duality import contact_point_mesh, propagated_points
from pqmesh.mesh.exact import (
    contact_element_mesh,
    grid_mesh,
    propagated_normals,
    rotational_mesh,
    tangent_plane_mesh,
)
from pqmesh.mesh.measure import circle_deviation, fitted_cones, planarity
from pqmesh.mesh.quadmesh import QuadMesh

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.2, 1.9], [1.5, 2.3]])


def tangent_mesh(seed):
    rng = np.random.default_rng(seed)
    u, v = 0.2 + np.cumsum(rng.uniform(0.15, 0.3, 6)), -1.2 + np.cumsum(rng.uniform(0.15, 0.3, 6))
    point, normal, _ = sampled(cyclide, u, v)
    planes = np.concatenate([normal, (point * normal).sum(-1, keepdims=True)], axis=-1)
    return tangent_plane_mesh(planes)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31 - 1), shift=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)))
def test_points_reflected_through_a_conical_mesh_form_a_circular_mesh(seed, shift):
    mesh = tangent_mesh(seed)
    a, b = mesh.corners[0, 1] - mesh.corners[0, 0], mesh.corners[0, 3] - mesh.corners[0, 0]
    start = mesh.face_centers[0] + shift[0] * a + shift[1] * b
    points, gap = propagated_points(mesh, start)
    # Every edge closes, not only those of the tree; planes meet at 5 degrees.
    assert gap < 1e-10
    assert np.abs(points[0] - start).max() < 1e-14
    heights = ((points - mesh.face_centers) * mesh.face_normals).sum(axis=1)
    assert np.abs(heights).max() < 1e-10
    dual = contact_point_mesh(mesh, start)
    circular = QuadMesh(dual.vertices, dual.topology)
    assert planarity(circular).max() < 1e-9
    assert np.abs(circle_deviation(circular)).max() < 1e-9
    # The axis of each circle is that of the cone whose faces carry its points.
    cones = fitted_cones(mesh)
    axes = cones.vectors / np.linalg.norm(cones.vectors, axis=1)[:, None]
    assert np.abs(np.abs((axes * circular.face_normals).sum(axis=1)) - 1).max() < 1e-8


def test_circular_mesh_comes_back_from_its_contact_elements():
    u, v = np.array([0.2, 0.5, 1.1, 1.3, 1.9, 2.2]), np.array([0.4, 0.6, 1.2, 2.0, 2.2, 2.5])
    point, normal = sampled(torus, u, v)
    mesh = grid_mesh(point)
    start = normal[0, 0] + 0.1 * np.array([0.3, -1.0, 0.5])
    conical = contact_element_mesh(mesh, start)
    assert fitted_cones(conical).relative_spread.max() < 1e-6
    inner = np.flatnonzero(~mesh.topology.is_boundary_vertex)
    # Faces of the conical mesh are the interior vertices in their order.
    points, gap = propagated_points(conical, mesh.vertices[inner[0]])
    assert gap < 1e-8
    assert np.abs(points - mesh.vertices[inner]).max() < 1e-8
    normals = propagated_normals(mesh, start)[inner]
    facing = (normals * conical.face_normals).sum(axis=1)
    assert np.abs(np.abs(facing) - 1).max() < 1e-8
    # And the circular mesh of these points is the inner part of the one it came from.
    dual = contact_point_mesh(conical, mesh.vertices[inner[0]])
    near = np.linalg.norm(dual.vertices[:, None] - mesh.vertices[inner][None], axis=2).min(axis=1)
    assert near.max() < 1e-8


def test_ring_closes_for_starts_in_the_plane_of_symmetry_only():
    angles = 2 * np.pi / 7 * np.arange(7)
    mesh = rotational_mesh(PROFILE, angles, closed=True)
    middle = mesh.face_centers[0]
    along = np.cross(middle * [1, 1, 0], [0, 0, 1.0])
    along /= np.linalg.norm(along)
    assert propagated_points(mesh, middle)[1] < 1e-12
    # Seven reflections turn the point over to the other side of the middle.
    assert propagated_points(mesh, middle + 0.1 * along)[1] == pytest.approx(0.2, abs=1e-9)


def test_flat_edges_reflect_within_their_plane():
    x, y = np.meshgrid([0.0, 1, 2.5, 3], [0.0, 0.7, 1.5, 2], indexing="ij")
    flat = grid_mesh(np.stack([x, y, 0 * x], axis=-1))
    points, gap = propagated_points(flat, [0.3, 0.2, 5.0])
    assert gap < 1e-14
    assert np.abs(points[:, 2]).max() < 1e-15
    # Rectangles: the mirror images of the start in the grid lines.
    assert np.abs(points[3] - [2 - 0.3, 0.2, 0]).max() < 1e-14


def test_pieces_and_strips_are_refused():
    with pytest.raises(MeshError, match="face 30 cannot be reached from face 0"):
        propagated_points(zoo()["two_pieces"][0], [0, 0, 0])
    mesh = rotational_mesh(PROFILE, 0.3 * np.arange(5))
    strip = without_faces(mesh, np.arange(4, 16))
    with pytest.raises(MeshError, match="needs an interior vertex"):
        contact_point_mesh(strip, [0, 0, 0])
