"""Boundaries that are fixed, that glide, that are free."""

import numpy as np
import pytest
from shapes import curved_mesh, zoo

from pqmesh.errors import SpecError
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.recipes import boundary_corners, problem_for
from pqmesh.optimize.schedule import optimized
from pqmesh.surface.reference import TriangleReference

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])
GRID = rotational_mesh(PROFILE, 0.3 * np.arange(9))
ANNULUS = rotational_mesh(PROFILE, 2 * np.pi / 16 * np.arange(16), closed=True)


def noisy(mesh, share, seed):
    rng = np.random.default_rng(seed)
    step = share * mesh.mean_edge_length * rng.normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + step)


def optimised(kind, mesh, boundary):
    reference = TriangleReference.of_polygons(mesh.vertices, mesh.faces.tolist())
    found = optimized(kind, mesh, reference, boundary=boundary)
    return mesh.with_vertices(found.blocks["vertices"]), found


def distance_to_boundary(start, points):
    """Distance of each point to the boundary curve, by brute force."""
    least = np.full(len(points), np.inf)
    for loop in start.topology.boundary_loops:
        for a, b in zip(start.vertices[loop], start.vertices[np.roll(loop, -1)], strict=True):
            share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            gap = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1)
            least = np.minimum(least, gap)
    return least


@pytest.mark.parametrize("name", ["grid", "window", "two_windows", "notch", "annulus"])
def test_fixed_boundary_stays_to_the_last_bit(name):
    start = noisy(ANNULUS if name == "annulus" else zoo()[name][0], 1e-2, 0)
    mesh, found = optimised("planar", start, "fixed")
    rim = start.topology.is_boundary_vertex
    assert mesh.vertices[rim].tobytes() == start.vertices[rim].tobytes()
    assert len(found.steps) > 0
    assert np.abs(mesh.vertices - start.vertices).max() > 1e-4
    assert planarity(mesh).max() < planarity(start).max()


def test_fixed_boundary_of_a_noisy_exact_mesh_leaves_room_for_planar_and_conical_faces():
    start = ANNULUS.with_vertices(
        np.where(
            ANNULUS.topology.is_boundary_vertex[:, None],
            ANNULUS.vertices,
            noisy(ANNULUS, 1e-2, 1).vertices,
        )
    )
    for kind in ("planar", "conical"):
        mesh, found = optimised(kind, start, "fixed")
        assert found.converged
        # The hard goal's tolerance.
        assert planarity(mesh).max() < 2e-12


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_gliding_boundary_stays_on_the_start_curve_and_its_corners_stay(kind, seed):
    # Circular faces leave a mesh between four crooked sides no room: see below.
    meshes = (ANNULUS, GRID) if kind != "circular" else (ANNULUS,)
    for exact in meshes:
        start = noisy(exact, 1e-2, seed)
        mesh, found = optimised(kind, start, "glide")
        assert found.converged
        rim, corners = start.topology.is_boundary_vertex, boundary_corners(start)
        assert mesh.vertices[corners].tobytes() == start.vertices[corners].tobytes()
        far = distance_to_boundary(start, mesh.vertices[rim]) / start.mean_edge_length
        # A hard goal: its tolerance, and rounding.
        assert far.max() < 2e-12
        along = np.linalg.norm((mesh.vertices - start.vertices)[rim & ~corners], axis=1)
        assert along.max() > 1e-3 * start.mean_edge_length


def test_circular_mesh_between_crooked_sides_ends_without_convergence_on_its_best():
    # Normals of a circular mesh are carried along a side without twist from corner to corner,
    # where they are given by both sides: a condition on the curves alone.
    start = noisy(GRID, 1e-2, 0)
    mesh, found = optimised("circular", start, "glide")
    assert not found.converged
    assert "no further progress" in found.reason
    rim = start.topology.is_boundary_vertex
    assert distance_to_boundary(start, mesh.vertices[rim]).max() < 5e-3 * start.mean_edge_length


def test_free_boundary_leaves_the_curve():
    start = noisy(ANNULUS, 1e-2, 0)
    mesh, _ = optimised("planar", start, "free")
    rim = start.topology.is_boundary_vertex
    far = distance_to_boundary(start, mesh.vertices[rim]) / start.mean_edge_length
    assert far.max() > 5e-3


def test_corners_of_the_boundary_turn_by_more_than_thirty_degrees():
    flat = np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij"), axis=-1)
    points = np.concatenate([flat, 0 * flat[..., :1]], axis=-1).reshape(-1, 3)
    faces = [[3 * i + j, 3 * i + 3 + j, 3 * i + 4 + j, 3 * i + 1 + j] for i in range(3)
             for j in range(2)]  # fmt: skip
    square = QuadMesh.of(points, faces)
    assert np.flatnonzero(boundary_corners(square)).tolist() == [0, 2, 9, 11]
    # Vertex 3 lies midway on a side of length 1 + 1: lifted by tan(t) it turns there by 2 t.
    for turn, is_corner in ((29.0, False), (31.0, True)):
        bent = points.copy()
        bent[3, 2] = np.tan(np.radians(turn / 2))
        assert boundary_corners(square.with_vertices(bent))[3] == is_corner
    # A closed mesh has none.
    assert not boundary_corners(zoo()["torus"][0]).any()


@pytest.mark.parametrize("boundary", ["free", "fixed", "glide"])
def test_closed_mesh_accepts_every_boundary(boundary):
    start = noisy(zoo()["torus"][0], 1e-2, 0)
    mesh, found = optimised("planar", start, boundary)
    assert found.converged
    assert planarity(mesh).max() < 2e-12


def test_unknown_kind_and_boundary_are_refused_by_name():
    mesh = curved_mesh(2, 2)
    reference = TriangleReference.of_polygons(mesh.vertices, mesh.faces.tolist())
    with pytest.raises(
        SpecError, match="planar, conical, circular, conical-circular; found 'flat'"
    ):
        problem_for("flat", mesh, reference)
    with pytest.raises(SpecError, match="free, fixed, glide; found 'loose'"):
        problem_for("planar", mesh, reference, boundary="loose")
