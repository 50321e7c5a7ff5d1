"""Tangent cones by two methods, types of vertices, classes of signs."""

import itertools

import numpy as np
import pytest
from shapes import cyclide, polygon_mesh, random_rotation, sampled, vertex_fan

from pqmesh.errors import MeshError
from pqmesh.mesh.cones import (
    METHODS,
    VertexType,
    sign_class_residuals,
    vertex_cones,
    vertex_types,
)
from pqmesh.mesh.exact import grid_mesh, rotational_mesh, tangent_plane_mesh
from pqmesh.mesh.measure import fitted_cones
from pqmesh.mesh.solids import (
    cube,
    deltoidal_hexecontahedron,
    rhombic_triacontahedron,
    trapezohedron,
)

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def cone_of_planes(phi, tilt):
    """Edges of planes with normals at angle `tilt` from the z axis, in this order around it."""
    phi = np.asarray(phi)
    normals = np.stack(
        [np.sin(tilt) * np.cos(phi), np.sin(tilt) * np.sin(phi), np.cos(tilt) + 0 * phi], axis=-1
    )
    ways = np.cross(np.roll(normals, 1, axis=0), normals)
    return ways / np.linalg.norm(ways, axis=1)[:, None]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("valence", [3, 4, 5, 6])
def test_cone_of_known_axis_and_half_angle_is_found(method, valence):
    rng = np.random.default_rng(valence)
    phi = np.cumsum(rng.uniform(0.7, 1.3, valence))
    phi *= 2 * np.pi / (phi[-1] + 0.9)
    turn = random_rotation(rng)
    mesh = vertex_fan(cone_of_planes(phi, 0.4) @ turn.T)
    mesh = mesh.with_vertices(mesh.vertices + np.array([1.0, 2.0, 3.0]))
    cone = vertex_cones(mesh, method)
    assert cone.vertices.tolist() == [0]
    assert np.abs(cone.apex[0] - [1, 2, 3]).max() < 1e-15
    assert np.abs(cone.axis[0] - turn[:, 2]).max() < 1e-12
    assert cone.half_angle[0] == pytest.approx(np.pi / 2 - 0.4, abs=1e-12)
    assert cone.deviation[0] < 1e-12


@pytest.mark.parametrize("method", METHODS)
def test_cones_of_exact_meshes_agree_with_the_offset_vectors(method):
    u, v = np.meshgrid([0.2, 0.4, 0.7, 0.8, 1.1], [-1.1, -0.9, -0.6, -0.3, -0.1], indexing="ij")
    point, normal, _ = cyclide(u, v)
    planes = np.concatenate([normal, (point * normal).sum(-1, keepdims=True)], axis=-1)
    for mesh in (tangent_plane_mesh(planes), rotational_mesh(PROFILE, 0.3 * np.arange(6)),
                 deltoidal_hexecontahedron()):  # fmt: skip
        cone, fitted = vertex_cones(mesh, method), fitted_cones(mesh)
        assert (cone.vertices == fitted.vertices).all()
        # w = a / sin(half angle).
        length = np.linalg.norm(fitted.vectors, axis=1)
        assert np.abs(np.sin(cone.half_angle) - 1 / length).max() < 1e-10
        # Axes of nearly flat vertices are known to rounding over the square of theta.
        away = np.cross(cone.axis, fitted.vectors / length[:, None])
        assert np.abs(away).max() < 1e-9
        assert cone.deviation.max() < 1e-10


def test_axis_of_a_cylinder_vertex_stands_upright_and_that_of_a_flat_one_is_the_normal():
    phi = np.array([0.0, 0.4, 0.9, 1.3])
    points = np.stack([np.cos(phi)[:, None] + 0 * phi, np.sin(phi)[:, None] + 0 * phi,
                       0 * phi[:, None] + phi], axis=-1)  # fmt: skip
    mesh = grid_mesh(points).reversed()
    out = mesh.face_normals[0] @ mesh.face_centers[0] > 0
    mesh = mesh if out else mesh.reversed()
    for method in METHODS:
        cone = vertex_cones(mesh, method)
        assert cone.deviation.max() < 1e-12
        assert np.abs(cone.axis[:, 2]).max() < 1e-12
    t = np.array([0, 1.2, 2.9, 4.0])
    flat = vertex_fan(np.column_stack([np.cos(t), np.sin(t), 0 * t]))
    for method in METHODS:
        cone = vertex_cones(flat, method)
        assert np.abs(cone.axis[0] - [0, 0, 1]).max() < 1e-12
        assert cone.half_angle[0] == pytest.approx(np.pi / 2)


def test_methods_differ_where_there_is_no_cone_and_both_say_so():
    ways = cone_of_planes([0, 1.5, 3.0, 4.6], 0.4)
    ways[0] += [0.05, -0.1, 0.1]
    cones = [vertex_cones(vertex_fan(ways), method) for method in METHODS]
    assert min(cone.deviation[0] for cone in cones) > 1e-3
    assert np.abs(cones[0].axis - cones[1].axis).max() > 1e-4


def test_unknown_method_is_refused_and_no_interior_vertex_means_no_cone():
    with pytest.raises(MeshError, match="one of least squares, bisectors; found 'guess'"):
        vertex_cones(cube(), "guess")
    square = grid_mesh(np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.0]]]))
    assert len(vertex_cones(square).vertices) == 0
    assert vertex_types(square) == {}
    assert len(sign_class_residuals(square)[0]) == 0


# --- types ------------------------------------------------------------------------------------


def spokes(angles, heights):
    return np.column_stack([np.cos(angles), np.sin(angles), heights])


QUARTERS = np.array([0.1, 1.6, 3.2, 4.8])
SIXTHS = 0.1 + np.pi / 3 * np.arange(6)
TYPES = {
    "dome": (spokes(QUARTERS, [-0.3, -0.4, -0.3, -0.5]), VertexType.ELLIPTIC),
    "bowl": (spokes(QUARTERS, [0.3, 0.4, 0.3, 0.5]), VertexType.ELLIPTIC),
    "saddle": (spokes(QUARTERS, [-0.3, 0.4, -0.3, 0.5]), VertexType.SADDLE),
    "three to one": (spokes([0.28, 1.41, 4.0, 5.57], [0.19, 0.15, 0.19, -0.11]),
                     VertexType.CROSSED),
    "flat": (spokes(QUARTERS, [0, 0, 0, 0]), VertexType.FLAT),
    "flat edge": (np.array([[1, 0, 0], [0.2, 1, 0], [-1, 0.3, 0], [-0.4, -1, 1.2]]),
                  VertexType.FLAT_EDGE),
    "valence 3": (spokes([0.2, 2.0, 4.5], [-0.3, -0.2, -0.5]), VertexType.ELLIPTIC),
    "valence 5": (spokes(2 * np.pi / 5 * np.arange(5), [-0.3] * 5), VertexType.ELLIPTIC),
    "valence 6": (spokes(SIXTHS, [-0.3] * 6), VertexType.ELLIPTIC),
    "monkey saddle": (spokes(SIXTHS, [0.4, -0.4] * 3), VertexType.MONKEY),
    "valence 6 saddle": (spokes(SIXTHS, 0.3 * np.cos(2 * SIXTHS)), VertexType.SADDLE),
}  # fmt: skip


@pytest.mark.parametrize("name", TYPES)
def test_vertex_has_its_type(name):
    ways, wanted = TYPES[name]
    assert vertex_types(vertex_fan(ways)) == {0: wanted}
    # The type knows no orientation and no first edge.
    assert vertex_types(vertex_fan(ways).reversed()) == {0: wanted}
    assert vertex_types(vertex_fan(np.roll(ways, 1, axis=0))) == {0: wanted}


def test_types_of_known_meshes():
    assert set(vertex_types(rhombic_triacontahedron()).values()) == {VertexType.ELLIPTIC}
    assert set(vertex_types(trapezohedron(5)).values()) == {VertexType.ELLIPTIC}
    z = np.array([-0.8, -0.5, -0.1, 0.2, 0.7])
    hyperboloid = rotational_mesh(np.column_stack([np.sqrt(1 + z * z), z]), 0.4 * np.arange(6))
    types = vertex_types(hyperboloid)
    assert set(types.values()) == {VertexType.SADDLE}
    # Interior vertices only; the boundary has no type.
    inner = np.flatnonzero(~hyperboloid.topology.is_boundary_vertex)
    assert list(types) == inner.tolist()
    assert vertex_types(polygon_mesh()).keys() == {0}


# --- classes of signs -------------------------------------------------------------------------


def test_each_choice_of_signs_fulfils_its_own_identity():
    rng = np.random.default_rng(5)
    seen = dict.fromkeys(("++++", "+-+-", "+--+", "++--"), 0)
    for _ in range(60):
        phi, tilt = rng.uniform(0, 2 * np.pi, 4), rng.uniform(0.2, 1.3)
        if np.abs(np.sin(0.5 * np.subtract.outer(phi, phi)[np.triu_indices(4, 1)])).min() < 0.1:
            continue
        base = cone_of_planes(phi, tilt)
        normals = np.stack([np.sin(tilt) * np.cos(phi), np.sin(tilt) * np.sin(phi),
                            np.cos(tilt) + 0 * phi], axis=-1)  # fmt: skip
        for signs in itertools.product((1, -1), repeat=3):
            ways = base * np.array([1, *signs])[:, None]
            corner = np.cross(ways, np.roll(ways, -1, axis=0))
            facing = np.sign((corner * normals).sum(axis=1))
            name = "".join("+" if x == facing[0] else "-" for x in facing)
            vertices, residuals = sign_class_residuals(vertex_fan(ways))
            assert vertices.tolist() == [0]
            assert abs(residuals[name][0]) < 1e-9
            seen[name] += 1
    assert min(seen.values()) > 20


def test_classes_are_told_apart_on_a_mesh_without_symmetry():
    mesh = tangent_plane_mesh(
        np.concatenate(
            [
                part if part.ndim == 3 else part[..., None]
                for part in _planes([0.2, 0.5, 0.9, 1.0], [0.1, 0.5, 0.8, 1.3])
            ],
            axis=-1,
        )
    )
    residuals = sign_class_residuals(mesh)[1]
    assert np.abs(residuals["++++"]).max() < 1e-11
    assert min(np.abs(values).min() for name, values in residuals.items() if name != "++++") > 1e-3


def _planes(u, v):
    point, normal, _ = sampled(cyclide, u, v)
    return normal, (point * normal).sum(axis=-1)
