"""The guard, the ends of the iteration, odd inputs and the linear algebra underneath."""

import sys
from dataclasses import dataclass

import numpy as np
import pytest
from shapes import curved_mesh, zoo

from pqmesh.io.formats import read_quad_mesh
from pqmesh.linear import SymmetricPattern
from pqmesh.mesh import solids
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import flipped_faces, nonconvex_faces, planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.ending import Best
from pqmesh.optimize.guard import LEAST_EDGE, LEAST_OWN_EDGE, Guard
from pqmesh.optimize.recipes import Weights, problem_for
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import solve
from pqmesh.surface.reference import TriangleReference

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3]])


def reference_of(mesh):
    return TriangleReference.of_polygons(mesh.vertices, mesh.faces.tolist())


@dataclass(frozen=True)
class Ball:
    """A sphere as reference: its normals never jump."""

    center: np.ndarray
    radius: float

    def closest(self, points):
        away = points - self.center
        normals = away / np.linalg.norm(away, axis=1, keepdims=True)
        return self.center + self.radius * normals, normals, self


def noisy(mesh, share, seed):
    rng = np.random.default_rng(seed)
    step = share * mesh.mean_edge_length * rng.normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + step)


def hyperbolic_paraboloid(n=8):
    """Grid along the rulings, twisted by 40 degrees: asymptotic lines, no start for flat quads."""
    s = np.linspace(-1, 1, n + 1)
    x, y = np.meshgrid(s, s, indexing="ij")
    mesh = rotational_mesh(np.column_stack([2 + s, s]), 0.1 * np.arange(n + 1))
    return QuadMesh(np.stack([x, y, 0.6 * x * y], axis=-1).reshape(-1, 3), mesh.topology)


@pytest.fixture
def visited(monkeypatch):
    """Positions at the start and after every accepted step of the next `solve`."""
    places = []
    offer = Best.offer

    def recorded(self, blocks, goals, values):
        places.append(blocks["vertices"].copy())
        offer(self, blocks, goals, values)

    monkeypatch.setattr(Best, "offer", recorded)
    return places


# --- the guard --------------------------------------------------------------------------------


def assert_guarded(start, visited):
    lengths = start.edge_lengths
    least = np.maximum(LEAST_EDGE * lengths.min(), LEAST_OWN_EDGE * lengths)
    broken = set(nonconvex_faces(start).tolist())
    for place in visited:
        mesh = start.with_vertices(place)
        assert set(nonconvex_faces(mesh).tolist()) <= broken
        assert (mesh.edge_lengths >= least * (1 - 1e-12)).all()
        turned = np.einsum("fi,fi->f", mesh.face_normals, start.face_normals) <= 0
        assert set(np.flatnonzero(turned).tolist()) <= broken


@pytest.mark.parametrize("closeness", [1.0, 100.0])
@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_no_face_breaks_at_any_step_on_a_twisted_grid(kind, closeness, visited):
    start = hyperbolic_paraboloid()
    problem = problem_for(kind, start, reference_of(start), weights=Weights(closeness=closeness))
    steps = []
    found = solve(problem, start, progress=lambda number, step: steps.append((number, step)))
    assert len(visited) == len(steps) + 1
    assert [number for number, _ in steps] == list(range(len(steps)))
    assert tuple(step for _, step in steps) == found.steps
    assert_guarded(start, visited)
    # The reason says that it is done, or names what is in the way.
    words = ("reached",) if found.converged else ("guard", "no further progress", "stopped after")
    assert any(word in found.reason for word in words)


@pytest.mark.parametrize("name", ["hypar.obj", "tubemesh.obj", "M2_eq_quad2.obj"])
def test_no_face_breaks_at_any_step_on_twisted_real_meshes(name, visited, data_folder):
    start = read_quad_mesh(data_folder / name)
    problem = problem_for(
        "planar", start, reference_of(start), weights=Weights(closeness=1.0, anchor=0.1)
    )
    found = solve(problem, start)
    assert_guarded(start, visited)
    assert len(flipped_faces(start.with_vertices(found.blocks["vertices"]))) == 0
    assert found.reason
    # Braking single faces lets the others go on: all three end flat.
    assert found.converged
    assert planarity(start.with_vertices(found.blocks["vertices"])).max() < 2e-12


def test_guard_names_what_is_beyond_its_limits():
    mesh = curved_mesh(3, 3)
    guard = Guard.of(mesh)
    faces, edges = guard.broken(mesh.vertices)
    assert not faces.any()
    assert not edges.any()
    # Vertex 5 pulled across the diagonal of face 0 makes that face reflex.
    points = mesh.vertices.copy()
    points[5] = 0.9 * points[0] + 0.1 * points[5]
    faces, edges = guard.broken(points)
    assert faces[0]
    assert not faces[8]
    # All edges shrunk beyond their share.
    faces, edges = guard.broken(0.1 * mesh.vertices)
    assert edges.all()
    assert not faces.any()
    # Mirrored, every face lies on its back.
    assert guard.broken(mesh.vertices * [-1, 1, 1])[0].all()


def test_broken_start_is_accepted_and_its_faces_are_free(visited):
    mesh = curved_mesh(6, 5)
    points = mesh.vertices.copy()
    points[16] = points[9] + 1.2 * (points[8] - points[9])
    start = mesh.with_vertices(points)
    broken = nonconvex_faces(start)
    assert broken.tolist() == [8, 13]
    guard = Guard.of(start)
    assert np.flatnonzero(~np.isfinite(guard.least_sine)).tolist() == [8, 13]
    found = solve(problem_for("planar", start, reference_of(start)), start)
    assert_guarded(start, visited)
    assert np.isfinite(found.blocks["vertices"]).all()
    after = nonconvex_faces(start.with_vertices(found.blocks["vertices"]))
    assert set(after.tolist()) <= {8, 13}
    assert max(found.residuals.values()) < np.abs(planarity(start)).max()


# --- ends -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
@pytest.mark.parametrize("boundary", ["free", "fixed", "glide"])
def test_mesh_of_a_single_quad(kind, boundary):
    start = QuadMesh.of([[0, 0, 0], [1, 0, 0.2], [1, 1, 0], [0, 1, 0.1]], [[0, 1, 2, 3]])
    found = solve(problem_for(kind, start, reference_of(start), boundary=boundary), start)
    if boundary == "free":
        assert found.converged
        # The tolerance of the hard goal.
        assert planarity(start.with_vertices(found.blocks["vertices"]))[0] < 2e-12
    else:
        # All four vertices are corners.
        assert found.reason == "every vertex is fixed"
        assert not found.converged
        assert found.steps == ()
        assert found.residuals["planarity"] > 0.1
        assert (found.blocks["vertices"] == start.vertices).all()


def test_fixed_flat_mesh_counts_as_converged():
    start = QuadMesh.of([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2, 3]])
    found = solve(problem_for("planar", start, reference_of(start), boundary="fixed"), start)
    assert found.converged


def test_few_steps_end_without_convergence_and_say_so():
    start = noisy(curved_mesh(5, 5), 0.03, 0)
    found = solve(problem_for("planar", start, reference_of(start)), start, most_steps=2)
    assert not found.converged
    assert found.reason == "stopped after 2 steps"
    assert len(found.steps) == 2
    assert found.residuals["planarity"] > 1e-12


def test_result_is_the_best_of_all_steps(visited):
    start = hyperbolic_paraboloid()
    problem = problem_for("planar", start, reference_of(start))
    found = solve(problem, start)
    worst = [np.abs(problem.residuals({"vertices": place})["planarity"]).max() for place in visited]
    value = np.abs(problem.residuals(found.blocks)["planarity"]).max()
    assert value == found.residuals["planarity"]
    assert value <= max(min(worst), 1e-12)


@pytest.mark.parametrize("name", sorted(zoo()))
@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_every_topology_is_accepted_and_gives_finite_numbers(name, kind):
    start = noisy(zoo()[name][0], 5e-3, 1)
    problem = problem_for(kind, start, reference_of(start))
    found = solve(problem, start)
    mesh = start.with_vertices(found.blocks["vertices"])
    assert np.isfinite(mesh.vertices).all()
    assert set(nonconvex_faces(mesh).tolist()) <= set(nonconvex_faces(start).tolist())
    hard = [goal.name for goal in problem.goals if goal.hard]
    before = problem.residuals(problem.blocks)
    worst = max(np.abs(before[name]).max(initial=0.0) for name in hard)
    assert max(found.residuals.values()) < worst


def test_thin_quads_are_accepted():
    mesh = curved_mesh(6, 5)
    start = mesh.with_vertices(mesh.vertices * [1, 1e-3, 1])
    for kind in ("planar", "conical", "circular"):
        found = solve(problem_for(kind, start, reference_of(start)), start)
        assert np.isfinite(found.blocks["vertices"]).all()
        assert found.residuals["planarity"] < planarity(start).max()


# --- how strongly to hold on ------------------------------------------------------------------


def test_schedule_relaxes_the_pull_where_it_holds_the_mesh_in_front_of_a_fold():
    start = hyperbolic_paraboloid(6)
    reference = reference_of(start)
    strong = solve(problem_for("planar", start, reference), start)
    found = optimized("planar", start, reference)
    assert max(found.residuals.values()) <= max(strong.residuals.values())


# --- linear algebra ---------------------------------------------------------------------------


def random_system(seed, n=40):
    """Contributions of a positive definite matrix, some of them twice, and the dense matrix."""
    rng = np.random.default_rng(seed)
    rows, columns, values = [np.arange(n)], [np.arange(n)], [np.full(n, 10.0)]
    dense = 10.0 * np.eye(n)
    for _ in range(3 * n):
        pair = rng.choice(n, 2, replace=False)
        local = rng.normal(size=2)
        block = np.outer(local, local)
        rows.append(np.repeat(pair, 2))
        columns.append(np.tile(pair, 2))
        values.append(block.ravel())
        dense[np.ix_(pair, pair)] += block
    return np.concatenate(rows), np.concatenate(columns), np.concatenate(values), dense


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pattern_adds_up_contributions_and_solves(backend, seed):
    rows, columns, values, dense = random_system(seed)
    pattern = SymmetricPattern(rows, columns, len(dense))
    assert type(pattern._backend).__name__ == backend
    stored = pattern.values(values)
    # Sums of a few numbers of size 10 in another order.
    assert np.abs(pattern.matrix(stored).toarray() - dense).max() < 1e-13
    assert (stored[pattern.diagonal] == pattern.matrix(stored).diagonal()).all()
    rhs = np.random.default_rng(seed + 9).normal(size=len(dense))
    for factor in (1.0, 2.0):
        # The second time with other values on the same pattern.
        found = pattern.factor(factor * stored).solve(rhs)
        assert np.abs(factor * dense @ found - rhs).max() < 1e-12


def test_singular_pattern_is_an_arithmetic_error(backend):
    pattern = SymmetricPattern(np.array([0, 1, 0, 1]), np.array([0, 1, 1, 0]), 2)
    with pytest.raises(ArithmeticError):
        pattern.factor(pattern.values(np.array([1.0, 1.0, 1.0, 1.0])))


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_all_back_ends_lead_to_the_same_mesh(kind, backend, without_extras):
    start = noisy(rotational_mesh(PROFILE, 0.3 * np.arange(9)), 1e-2, 2)
    problem = problem_for(kind, start, Ball(np.array([0.0, 0.0, 1.1]), 2.4))
    fast = solve(problem, start)
    without_extras()
    plain = solve(problem, start)
    assert fast.converged
    assert plain.converged
    gap = np.abs(fast.blocks["vertices"] - plain.blocks["vertices"]).max()
    # Two factorisations of matrices of condition 1e8 to 1e10.
    assert gap < 1e-6 * start.mean_edge_length


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_solver_works_without_the_extra_packages(kind, monkeypatch, without_extras):
    without_extras()
    monkeypatch.setitem(sys.modules, "rslab", None)
    monkeypatch.setitem(sys.modules, "pymklpardiso", None)
    solid = solids.deltoidal_icositetrahedron()
    start = noisy(solid if kind != "circular" else curved_mesh(5, 4), 1e-2, 0)
    found = solve(problem_for(kind, start, reference_of(start)), start)
    assert found.converged
