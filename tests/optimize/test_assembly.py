"""The normal equations against plain dense sums over the Jacobians of all elements."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from shapes import curved_mesh, polygon_mesh, random_rotation, zoo

from pqmesh.optimize.assembly import Assembly, Part
from pqmesh.optimize.problem import Goal, Problem, gathered
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.terms import anchor, held_edges
from pqmesh.surface.reference import TriangleReference


@dataclass(frozen=True)
class Springs:
    """A term whose elements read rows twice, and rows of two blocks."""

    rows: np.ndarray
    others: np.ndarray

    @property
    def stencils(self):
        return {"vertices": self.rows, "axes": self.others}

    def evaluate(self, rows):
        seed = np.random.default_rng(len(rows))
        jacobian = seed.normal(size=(len(rows), 2, rows.shape[1], 3))
        return np.einsum("mrki,mki->mr", jacobian, rows), jacobian


@dataclass(frozen=True)
class Alike(Springs):
    """The same Jacobian for every element, once and for all; its blocks are of any kind."""

    @property
    def is_linear(self):
        return True

    def evaluate(self, rows):
        one = np.random.default_rng(8).normal(size=(2, rows.shape[1], 3))
        jacobian = np.broadcast_to(one, (len(rows), *one.shape))
        return np.einsum("mrki,mki->mr", jacobian, rows), jacobian


def problems():
    """Problems of several terms and blocks by name, with meshes and fixed rows."""
    dome = curved_mesh(4, 3)
    fan = zoo()["irregular_disc"][0]
    rng = np.random.default_rng(3)
    found = {}
    for name, kind, mesh in (
        ("planar", "planar", dome),
        ("conical", "conical", dome),
        ("circular", "circular", dome),
        ("axes", "conical", fan),
        ("polygons", "planar", polygon_mesh()),
    ):
        bent = mesh.with_vertices(mesh.vertices + 0.1 * rng.normal(size=mesh.vertices.shape))
        reference = TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())
        problem = problem_for(kind, bent, reference)
        fixed = rng.random(len(mesh.vertices)) < 0.3
        found[name] = (replace(problem, fixed={"vertices": fixed}), bent)
        found[f"{name}, all free"] = (problem, bent)
    blocks = {"vertices": dome.vertices, "axes": rng.normal(size=(5, 3))}
    twice = Springs(rng.integers(0, 20, (30, 4)), rng.integers(0, 5, (30, 2)))
    fixed = {"vertices": np.arange(20) % 3 == 0, "axes": np.arange(5) == 2}
    goals = (Goal("springs", twice, 2.0), Goal("edges", held_edges(dome), hard=True, slack=0.1))
    found["rows twice"] = (Problem(blocks, goals, fixed), dome)
    alike = Goal("alike", Alike(twice.rows, twice.others), 2.0)
    found["one Jacobian"] = (Problem(blocks, (alike,), fixed), dome)
    return found


PROBLEMS = problems()


def parts_of(problem, seed=0):
    """Parts with weights of their own, their residuals and Jacobians over all rows, dense."""
    rng = np.random.default_rng(seed)
    starts = dict(
        zip(problem.blocks, np.cumsum([0, *map(len, problem.blocks.values())]), strict=False)
    )
    count = sum(map(len, problem.blocks.values()))
    parts, residuals, jacobians = [], [], []
    for goal in problem.goals:
        residual, jacobian = goal.term.evaluate(gathered(goal.term, problem.blocks))
        m, r = residual.shape
        dense = np.zeros((m, r, count, 3))
        rows = [starts[name] + stencil for name, stencil in goal.term.stencils.items()]
        rows = np.concatenate(rows, axis=1)
        for element in range(m):
            for place, row in enumerate(rows[element]):
                dense[element, :, row] += jacobian[element, :, place]
        parts.append(Part(float(rng.uniform(0.1, 3.0)), jacobian))
        residuals.append(residual)
        jacobians.append(dense)
    return parts, residuals, jacobians


def free_rows(problem):
    return np.concatenate(
        [
            ~problem.fixed.get(name, np.zeros(len(block), dtype=bool))
            for name, block in problem.blocks.items()
        ]
    )


def dense_sum(problem, parts, jacobians):
    """Matrix of the normal equations (n, 3, n, 3) over the free rows."""
    free = free_rows(problem)
    total = 0.0
    for part, jacobian in zip(parts, jacobians, strict=True):
        flat = jacobian[:, :, free].reshape(-1, 3 * free.sum())
        total = total + part.scale * flat.T @ flat
    return total.reshape(free.sum(), 3, free.sum(), 3)


class Shown:
    """A back end that shows the matrix it is given."""

    def factor(self, matrix):
        return matrix.whole().toarray()


def assembled(problem, mesh, parts, damping=0.0, brakes=None):
    """The assembled matrix, dense, and the assembly."""
    assembly = Assembly(problem, mesh)
    assembly.pattern._backend = Shown()
    brakes = np.zeros(mesh.topology.n_faces) if brakes is None else brakes
    matrix = assembly.factor(assembly.matrix(parts, damping, brakes))
    return matrix.reshape(assembly.size // 3, 3, assembly.size // 3, 3), assembly


def close(found, wanted):
    # Sums of some tens of products in another order.
    return np.abs(found - wanted).max() < 1e-13 * np.abs(wanted).max()


# --- sums -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PROBLEMS)
def test_matrix_is_the_sum_of_the_squares_of_all_jacobians(name):
    problem, mesh = PROBLEMS[name]
    parts, _, jacobians = parts_of(problem)
    matrix, assembly = assembled(problem, mesh, parts)
    assert assembly.size == 3 * free_rows(problem).sum()
    assert close(matrix, dense_sum(problem, parts, jacobians))


def test_jacobian_of_an_inequality_may_change_even_where_it_is_linear():
    # Rows that hold with room to spare are taken out, so nothing is added up beforehand.
    problem, mesh = PROBLEMS["rows twice"]
    parts, _, jacobians = parts_of(problem)
    assert problem.goals[1].term.is_linear
    parts[1] = replace(parts[1], jacobian=np.where(np.arange(len(parts[1].jacobian)) % 2 == 0, 1, 0)
                       [:, None, None, None] * parts[1].jacobian)  # fmt: skip
    jacobians[1][1::2] = 0.0
    matrix, _ = assembled(problem, mesh, parts)
    assert close(matrix, dense_sum(problem, parts, jacobians))


@pytest.mark.parametrize("name", PROBLEMS)
def test_descent_is_the_negative_gradient_of_the_weighted_squares(name):
    problem, mesh = PROBLEMS[name]
    parts, residuals, jacobians = parts_of(problem)
    assembly = Assembly(problem, mesh)
    wanted = -sum(
        part.scale * np.einsum("mrki,mr->ki", jacobian, residual)
        for part, residual, jacobian in zip(parts, residuals, jacobians, strict=True)
    )
    found = assembly.descent(parts, residuals)
    assert close(found, wanted[free_rows(problem)].ravel())
    # Goals without a residual do not count.
    none = [residuals[0], *(None for _ in residuals[1:])]
    alone = -parts[0].scale * np.einsum("mrki,mr->ki", jacobians[0], residuals[0])
    assert close(assembly.descent(parts, none), alone[free_rows(problem)].ravel())


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_descent_is_the_slope_of_the_merit(kind):
    problem, mesh = PROBLEMS[kind]
    parts, residuals, _ = parts_of(problem)
    assembly = Assembly(problem, mesh)
    slope = -assembly.descent(parts, residuals)
    way = np.random.default_rng(1).normal(size=assembly.size)

    def merit(step):
        there = problem.residuals(assembly.moved(dict(problem.blocks), step * way)).values()
        return sum(0.5 * p.scale * (r**2).sum() for p, r in zip(parts, there, strict=True))

    # Central differences: errors of step^2 times third derivatives, and of rounding / step.
    numeric = (merit(1e-5) - merit(-1e-5)) / 2e-5
    assert abs(numeric - slope @ way) < 1e-7 * abs(slope @ way)


@pytest.mark.parametrize("name", PROBLEMS)
def test_changes_are_jacobians_times_the_step(name):
    problem, mesh = PROBLEMS[name]
    parts, residuals, jacobians = parts_of(problem)
    assembly = Assembly(problem, mesh)
    step = np.random.default_rng(2).normal(size=assembly.size)
    rows = np.zeros((len(assembly.free), 3))
    rows[free_rows(problem)] = step.reshape(-1, 3)
    like = [None, *residuals[1:]]
    found = assembly.changes(parts, step, like)
    assert found[0] is None
    for change, jacobian in zip(found[1:], jacobians[1:], strict=True):
        wanted = np.einsum("mrki,ki->mr", jacobian, rows)
        if wanted.size:
            assert close(change, wanted)


def test_step_moves_free_rows_and_no_others():
    problem, mesh = PROBLEMS["rows twice"]
    assembly = Assembly(problem, mesh)
    step = np.arange(1.0, assembly.size + 1)
    moved = assembly.moved(dict(problem.blocks), step)
    for name, block in problem.blocks.items():
        fixed = problem.fixed[name]
        assert (moved[name][fixed] == block[fixed]).all()
        assert (moved[name][~fixed] != block[~fixed]).all()
    whole = np.concatenate([moved[n] - b for n, b in problem.blocks.items()])
    assert np.abs(whole[assembly.free].ravel() - step).max() < 1e-13


# --- damping and brakes -----------------------------------------------------------------------


@pytest.mark.parametrize("name", PROBLEMS)
def test_damping_adds_a_share_of_the_mean_diagonal_of_each_row(name):
    problem, mesh = PROBLEMS[name]
    parts, _, jacobians = parts_of(problem)
    plain = dense_sum(problem, parts, jacobians)
    n = len(plain)
    mean = np.einsum("kiki->k", plain) / 3
    added = 0.7 * np.maximum(mean, 1e-12 * mean.max())
    wanted = plain + np.einsum("k,kl,ij->kilj", added, np.eye(n), np.eye(3))
    matrix, _ = assembled(problem, mesh, parts, damping=0.7)
    assert close(matrix, wanted)


def test_rows_that_no_goal_reads_are_damped_all_the_same():
    mesh = curved_mesh(3, 3)
    problem = Problem({"vertices": mesh.vertices}, (Goal("hold", anchor(mesh, np.array([5]))),))
    parts, _, _ = parts_of(problem)
    matrix, assembly = assembled(problem, mesh, parts, damping=0.5)
    diagonal = np.einsum("kiki->ki", matrix)
    held = diagonal[5, 0]
    others = np.delete(diagonal, 5, axis=0)
    assert np.allclose(others, 0.5e-12 * held / 1.5, rtol=1e-12, atol=0)
    assert assembly.size == 48


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_matrix_and_descent_turn_with_the_mesh(kind, damping):
    rng = np.random.default_rng(4)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    mesh = PROBLEMS[kind][1]
    fixed = {"vertices": np.arange(len(mesh.vertices)) % 4 == 0}
    found = []
    for place in (mesh, mesh.with_vertices(mesh.vertices @ turn.T + shift)):
        reference = TriangleReference.of_polygons(place.vertices, place.topology.face_lists())
        problem = replace(problem_for(kind, place, reference), fixed=fixed)
        parts, residuals, _ = parts_of(problem)
        brakes = np.linspace(0, 2, mesh.topology.n_faces)
        matrix, assembly = assembled(problem, place, parts, damping, brakes)
        found.append((matrix, assembly.descent(parts, residuals).reshape(-1, 3)))
    (matrix, descent), (turned, turned_descent) = found
    wanted = np.einsum("ai,kilj,bj->kalb", turn, matrix, turn)
    # Angles and normals are computed anew from turned and shifted points.
    assert np.abs(turned - wanted).max() < 1e-12 * np.abs(matrix).max()
    assert np.abs(turned_descent - descent @ turn.T).max() < 1e-12 * np.abs(descent).max()


@pytest.mark.parametrize("name", ["planar", "conical", "polygons", "polygons, all free", "axes"])
def test_brakes_resist_what_moves_the_corners_of_a_face_apart(name):
    problem, mesh = PROBLEMS[name]
    parts, _, jacobians = parts_of(problem)
    free = free_rows(problem)
    brakes = np.random.default_rng(5).uniform(0, 3, mesh.topology.n_faces)
    brakes[::3] = 0.0
    # A hard goal of weight 1 counts 1 / F for each face, with residuals in mean edges.
    unit = 1.0 / mesh.topology.n_faces / mesh.mean_edge_length**2
    stiff = np.zeros((len(free), len(free)))
    for corners, brake in zip(mesh.topology.face_lists(), brakes, strict=True):
        k = len(corners)
        stiff[np.ix_(corners, corners)] += unit * brake * (np.eye(k) - 1.0 / k)
    stiff = stiff[np.ix_(free, free)]
    wanted = dense_sum(problem, parts, jacobians) + np.einsum("kl,ij->kilj", stiff, np.eye(3))
    matrix, _ = assembled(problem, mesh, parts, brakes=brakes)
    assert close(matrix, wanted)


def test_rows_of_an_element_come_in_the_order_of_its_blocks():
    problem, _ = PROBLEMS["one Jacobian"]
    term = problem.goals[0].term
    rows = gathered(term, problem.blocks)
    assert (rows[:, :4] == problem.blocks["vertices"][term.rows]).all()
    assert (rows[:, 4:] == problem.blocks["axes"][term.others]).all()


def test_fixed_mesh_has_no_columns():
    problem, mesh = PROBLEMS["planar"]
    assembly = Assembly(replace(problem, fixed={"vertices": np.ones(20, dtype=bool)}), mesh)
    assert assembly.size == 0
    moved = assembly.moved(dict(problem.blocks), np.zeros(0))
    assert (moved["vertices"] == problem.blocks["vertices"]).all()
