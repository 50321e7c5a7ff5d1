"""Start meshes with broken faces: mended where possible, by moving little, and named."""

import numpy as np
import pytest
from shapes import curved_mesh, dodecahedron, football, lantern

from pqmesh.io.formats import read_mesh
from pqmesh.mesh.exact import grid_mesh, rotational_mesh
from pqmesh.mesh.measure import fitted_cones, flipped_faces, nonconvex_faces, planarity
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.optimize.faults import broken_faces, faces_touching, surroundings
from pqmesh.optimize.guard import LEAST_SINE, Guard, least_sines
from pqmesh.optimize.mending import LEAST_MENDED, mended
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import solve
from pqmesh.optimize.untangling import PRESSURES, _Energy
from pqmesh.surface.reference import TriangleReference

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])
TURN = 2 * np.pi
CIRCLE = np.column_stack([3 + np.cos(0.2 * np.pi * np.arange(10)),
                          np.sin(0.2 * np.pi * np.arange(10))])  # fmt: skip
EXACT = {
    "piece": rotational_mesh(PROFILE, 0.3 * np.arange(8)),
    "ring": rotational_mesh(PROFILE, TURN / 16 * np.arange(16), closed=True),
    "torus": rotational_mesh(CIRCLE, TURN / 16 * np.arange(16), closed=True, closed_profile=True),
}
POLYGONS = {"dodecahedron": dodecahedron(), "football": football(), "lantern": lantern()}


def pulled(mesh, vertex, target, share):
    """The mesh with a vertex moved by a share of the way to another."""
    points = mesh.vertices.copy()
    points[vertex] += share * (points[target] - points[vertex])
    return mesh.with_vertices(points)


def inner_vertex(mesh):
    """An inner vertex, a neighbour, and the vertex across a face."""
    star = next(star for star in mesh.topology.stars() if star.neighbors.shape[1] == 4)
    among_quads = np.flatnonzero((mesh.topology.face_sizes[star.faces] == 4).all(axis=1))
    row = among_quads[len(among_quads) // 2]
    vertex = int(star.vertices[row])
    face = mesh.topology.face(star.faces[row, 0]).tolist()
    across = face[(face.index(vertex) + 2) % 4]
    return vertex, int(star.neighbors[row, 0]), across


def assert_mended(start, found):
    """Every face is valid now, and what was valid keeps the limits of the guard."""
    mesh = found.mesh
    assert not broken_faces(mesh).any()
    assert len(nonconvex_faces(mesh)) == 0
    assert len(flipped_faces(mesh)) == 0
    assert found.left.size == 0
    fault = np.zeros(mesh.topology.n_faces, dtype=bool)
    fault[found.mended] = True
    assert (broken_faces(start) <= fault).all()
    assert (least_sines(mesh)[fault] >= LEAST_SINE).all()
    edges = np.flatnonzero(mesh.edge_lengths < LEAST_MENDED * mesh.mean_edge_length)
    assert edges.size == 0
    if start.topology.is_quad:
        # Beside a fault a polygon may have a re-entrant corner that closes.
        assert not (Guard.of(start).broken(mesh.vertices)[0] & ~fault).any()
    moves = np.linalg.norm(mesh.vertices - start.vertices, axis=1)
    assert np.flatnonzero(moves).tolist() == found.moved.tolist()
    assert moves.max() == pytest.approx(found.moved_max, rel=1e-14)


# --- planted faults ---------------------------------------------------------------------------

FAULTS = {
    "dart": ("across", 0.7),
    "fold": ("across", 1.2),
    "far fold": ("across", 2.5),
    "collapsed edge": ("neighbor", 1 - 1e-6),
    "past its neighbour": ("neighbor", 1.5),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("name", EXACT)
def test_fault_of_one_vertex_is_mended_by_moving_that_vertex_back(name, fault):
    exact = EXACT[name]
    vertex, neighbor, across = inner_vertex(exact)
    which, share = FAULTS[fault]
    start = pulled(exact, vertex, across if which == "across" else neighbor, share)
    assert broken_faces(start).any()
    found = mended(start)
    assert_mended(start, found)
    assert found.moved.tolist() == [vertex]
    # Back among its neighbours, not to the old place, which nobody knows.
    back = np.linalg.norm(found.mesh.vertices[vertex] - exact.vertices[vertex])
    assert back < 0.75 * exact.mean_edge_length
    assert back < 0.5 * np.linalg.norm(start.vertices[vertex] - exact.vertices[vertex])


@pytest.mark.parametrize("fault", ["fold", "collapsed edge"])
@pytest.mark.parametrize("name", EXACT)
def test_mended_mesh_becomes_conical_and_no_face_of_it_is_broken(name, fault):
    exact = EXACT[name]
    vertex, neighbor, across = inner_vertex(exact)
    which, share = FAULTS[fault]
    start = mended(pulled(exact, vertex, across if which == "across" else neighbor, share)).mesh
    reference = TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    found = solve(problem_for("conical", start, reference), start)
    mesh = start.with_vertices(found.blocks["vertices"])
    assert found.converged
    assert planarity(mesh).max() < 1e-11
    assert fitted_cones(mesh).misfit.max() < 1e-10
    assert len(nonconvex_faces(mesh)) == 0


@pytest.mark.parametrize("share", [1.1, 1 - 1e-6])
@pytest.mark.parametrize("name", POLYGONS)
def test_faults_of_polygons_are_mended(name, share):
    exact = POLYGONS[name]
    face = exact.topology.face(0)
    start = pulled(exact, face[0], face[2 if share > 1 else 1], share)
    assert broken_faces(start).any()
    assert_mended(start, mended(start))


def test_faults_at_the_boundary_are_mended():
    exact = EXACT["piece"]
    star = next(s for s in exact.topology.stars(boundary=True) if s.neighbors.shape[1] == 3)
    vertex, (along, inwards, _) = star.vertices[3], star.neighbors[3]
    for target, share in ((along, 1.4), (inwards, 1.4)):
        start = pulled(exact, vertex, target, share)
        assert broken_faces(start).any()
        assert_mended(start, mended(start))


def test_many_faults_at_once_are_mended():
    profile = np.column_stack([2 + 0.3 * np.sin(np.linspace(0, 3, 31)), np.linspace(0, 2.4, 31)])
    exact = rotational_mesh(profile, np.linspace(0, 1.2, 31))
    rng = np.random.default_rng(0)
    step = 0.25 * exact.mean_edge_length * rng.normal(size=exact.vertices.shape)
    start = exact.with_vertices(exact.vertices + step)
    assert np.count_nonzero(broken_faces(start)) > 20
    found = mended(start)
    assert_mended(start, found)
    assert len(found.moved) < 0.25 * exact.topology.n_vertices
    assert found.moved_max < 3 * exact.mean_edge_length


# --- what stays -------------------------------------------------------------------------------


@pytest.mark.parametrize("mesh", [*EXACT.values(), *POLYGONS.values(), curved_mesh(noise=0.05)])
def test_valid_mesh_is_left_alone(mesh):
    found = mended(mesh)
    assert found.mesh is mesh
    assert found.mended.size == found.left.size == found.moved.size == 0
    assert found.words == []


def test_slender_and_straight_quads_are_no_fault():
    grid = EXACT["piece"]
    assert not broken_faces(grid.with_vertices(grid.vertices * [1, 1e-3, 1])).any()
    # A corner of 180 degrees, to the six digits of a file.
    square = [[0, 0, 0], [2, 0, 0], [1, 1.000001, 0], [0, 2, 0]]
    assert not broken_faces(QuadMesh.of(square, [[0, 1, 2, 3]])).any()


def test_what_cannot_be_mended_is_named_and_nothing_moves():
    exact = EXACT["piece"]
    vertex, _, across = inner_vertex(exact)
    start = pulled(exact, vertex, across, 1.2)
    found = mended(start, np.ones(exact.topology.n_vertices, dtype=bool))
    assert found.mesh.vertices.tobytes() == start.vertices.tobytes()
    assert set(found.left) >= set(np.flatnonzero(broken_faces(start)))
    assert found.mended.size == found.moved.size == 0
    assert len(found.words) == 1
    assert "could not be mended" in found.words[0]
    assert str(found.left[0]) in found.words[0]


def test_fixed_vertices_stay_and_others_make_room():
    exact = EXACT["piece"]
    vertex, _, across = inner_vertex(exact)
    start = pulled(exact, vertex, across, 0.7)
    fixed = np.zeros(exact.topology.n_vertices, dtype=bool)
    fixed[vertex] = True
    found = mended(start, fixed)
    assert vertex not in found.moved
    assert_mended(start, found)


def test_one_fault_is_mended_and_another_that_cannot_be_is_left():
    exact = EXACT["ring"]
    topology = exact.topology
    vertex, _, across = inner_vertex(exact)
    start = pulled(exact, vertex, across, 1.2)
    # Far from there a boundary vertex in the wrong place, that may not move, nor its neighbours.
    loop = topology.boundary_loops[0]
    far = loop[np.linalg.norm(exact.vertices[loop] - exact.vertices[vertex], axis=1).argmax()]
    star = next(s for s in topology.stars(boundary=True) if far in s.vertices)
    row = int(np.flatnonzero(star.vertices == far)[0])
    start = pulled(start, far, star.neighbors[row, 1], 1.4)
    held = np.linalg.norm(exact.vertices - exact.vertices[far], axis=1) < 2.5
    assert not held[vertex]
    found = mended(start, held)
    assert vertex in found.moved
    assert found.mended.size > 0
    assert found.left.size > 0
    assert set(found.left) <= set(np.flatnonzero(faces_touching(topology, held)))
    assert set(np.flatnonzero(broken_faces(found.mesh))) <= set(found.left)
    assert len(found.words) == 2


# --- rules ------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**10])
def test_mending_depends_on_no_unit_and_is_the_same_every_time(scale):
    exact = EXACT["ring"]
    vertex, _, across = inner_vertex(exact)
    start = pulled(exact, vertex, across, 1.2)
    plain, again = mended(start), mended(start)
    assert plain.mesh.vertices.tobytes() == again.mesh.vertices.tobytes()
    other = mended(start.with_vertices(scale * start.vertices))
    assert other.mended.tolist() == plain.mended.tolist()
    # A power of two rounds nothing; roots of it, in the length of an edge, may.
    gap = np.abs(other.mesh.vertices / scale - plain.mesh.vertices).max()
    assert gap < 1e-6 * exact.mean_edge_length


def test_gradient_of_the_energy_equals_central_differences():
    rng = np.random.default_rng(0)
    mesh = curved_mesh(3, 3)
    energy = _Energy(
        points=mesh.vertices,
        start=mesh.vertices + 0.1,
        chosen=np.arange(3, 9),
        stencil=rng.integers(0, 16, size=(3, 20)),
        normals=rng.normal(size=(20, 3)),
        full=rng.uniform(1, 2, size=20),
        wanted=rng.uniform(1, 3, size=20),
        rows=np.arange(4, 8),
        umbrella=np.abs(rng.normal(size=(4, 16))),
        umbrellas=rng.normal(size=(4, 3)),
        sizes=rng.uniform(1, 2, size=16),
    )
    x = mesh.vertices[3:9].ravel() + 0.01
    gradient = energy(x, PRESSURES[0])[1]
    for k in range(len(x)):
        step = 1e-5 * np.eye(len(x))[k]
        rise = energy(x + step, PRESSURES[0])[0] - energy(x - step, PRESSURES[0])[0]
        # Second order at 1e-5, values of some hundred.
        assert np.isclose(rise / 2e-5, gradient[k], rtol=1e-5, atol=1e-5)


def test_surroundings_lend_normals_sizes_and_umbrellas_of_a_grid():
    x, y = np.meshgrid(np.arange(7.0), 2 * np.arange(7.0), indexing="ij")
    flat = QuadMesh.of(
        np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), curved_mesh(6, 6).topology.quads
    )
    start = pulled(flat, 24, 32, 1.2)
    around = surroundings(start, broken_faces(start))
    assert np.allclose(around.normals, [0, 0, 1])
    # Edges of 1 and 2: squares of the same area.
    assert np.allclose(around.sizes[24], 2.0)
    assert np.allclose(around.umbrellas[24], 0.0)


# --- real faces -------------------------------------------------------------------------------


def test_darts_of_a_real_file_are_mended(data_folder):
    # 500 faces that hang together nowhere; two of them have a corner of 193 degrees.
    start = read_mesh(data_folder / "suzanne.ply")
    assert np.flatnonzero(broken_faces(start)).tolist() == [464, 465]
    found = mended(start)
    assert found.mended.tolist() == [464, 465]
    assert set(found.moved) <= set(start.topology.face(464)) | set(start.topology.face(465))
    assert_mended(start, found)
    assert found.moved_max < 0.5 * start.mean_edge_length


def test_real_meshes_have_no_faults(data_folder):
    names = ["M2_eq_quad2.obj", "Intersection.off", "tubemesh.obj", "six.off", "YasIsland.off"]
    for name in names:
        mesh = read_mesh(data_folder / name)
        assert isinstance(mesh, PolyMesh)
        assert mended(mesh).mesh is mesh


def test_fault_planted_in_a_real_mesh_is_mended_and_it_becomes_planar(data_folder):
    mesh = read_mesh(data_folder / "Intersection.off")
    vertex, neighbor, across = inner_vertex(mesh)
    for target, share in ((neighbor, 1 - 1e-6), (across, 1.3)):
        start = pulled(mesh, vertex, target, share)
        found = mended(start)
        assert_mended(start, found)
        assert found.moved.tolist() == [vertex]
    start = found.mesh
    reference = TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    solution = solve(problem_for("planar", start, reference), start)
    result = start.with_vertices(solution.blocks["vertices"])
    assert solution.converged
    assert planarity(result).max() <= 1e-11
    assert len(nonconvex_faces(result)) == len(flipped_faces(result)) == 0


@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-9, 1e-4])
def test_quad_that_starts_with_a_straight_corner_does_not_become_a_dart(off):
    x, y = np.meshgrid(np.linspace(-2, 2, 9), np.linspace(-2, 2, 9), indexing="ij")
    height = 0.4 * x * x - 0.1 * x * y + 0.25 * y * y + 0.05 * np.sin(3 * x + 1)
    start = grid_mesh(np.stack([x, y, height], axis=-1))
    points = start.vertices.copy()
    points[40] = 0.5 * (points[39] + points[49]) + np.array([off, 0.0, 0.0])
    start = start.with_vertices(points)
    itself = TriangleReference.of_polygons(points, start.topology.face_lists())
    found = optimized("planar", start, itself, boundary="fixed")
    assert found.converged
    assert not len(nonconvex_faces(start.with_vertices(found.blocks["vertices"])))
