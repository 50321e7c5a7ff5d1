"""The benchmark's own arithmetic: the baseline, the judge, and what becomes of a bad run."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from shapes import curved_mesh

from pqmesh.mesh.exact import grid_faces, rotational_mesh
from pqmesh.mesh.measure import conicality_defect, planarity_deviation
from pqmesh.mesh.quadmesh import QuadMesh

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
baseline, judge, measurement, meshes, table = (
    import_module(f"bench.{name}")
    for name in ("baseline", "judge", "measurement", "meshes", "table")
)

PROFILE = np.array([[2, 0], [2.4, 0.5], [2.5, 1.2], [1.9, 1.5], [1.4, 2.3], [1.2, 3.0]])
# Conical and circular: 6 x 6 vertices.
EXACT = rotational_mesh(PROFILE, 0.3 * np.arange(6))


def noisy(mesh, share=0.05):
    step = np.random.default_rng(4).normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + share * mesh.mean_edge_length * step)


@pytest.mark.parametrize(
    ("residual", "corners"), [(baseline.diagonal_distance, 4), (baseline.angle_balance, 5)]
)
def test_gradients_of_the_baseline_agree_with_central_differences(residual, corners):
    flat = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    spokes = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
    shape = flat if corners == 4 else spokes
    rows = shape + 0.2 * np.random.default_rng(1).normal(size=(7, corners, 3))
    gradient, step = residual(rows)[1], 1e-6
    numeric = np.empty_like(gradient)
    for k in range(corners):
        for i in range(3):
            shift = np.zeros_like(rows)
            shift[:, k, i] = step
            numeric[:, k, i] = (residual(rows + shift)[0] - residual(rows - shift)[0]) / (2 * step)
    assert np.abs(numeric - gradient).max() < 1e-8


def test_the_baseline_and_the_judge_measure_what_pqmesh_measures():
    mesh = curved_mesh(noise=0.03)
    distances = baseline.diagonal_distance(mesh.corners)[0]
    assert np.abs(np.abs(distances) - planarity_deviation(mesh)).max() < 1e-14
    vertices, expected = conicality_defect(mesh)
    star = next(s for s in mesh.topology.stars() if s.neighbors.shape[1] == 4)
    rows = mesh.vertices[np.column_stack([star.vertices, star.neighbors])]
    assert (star.vertices == vertices).all()
    assert np.abs(baseline.angle_balance(rows)[0] - expected).max() < 1e-13
    assert judge.balance(mesh.vertices, mesh.topology) == pytest.approx(np.abs(expected).max())


@pytest.mark.parametrize("kind", ["planar", "conical"])
def test_the_baseline_finds_back_from_a_perturbed_exact_mesh(kind):
    start = noisy(EXACT)
    found = baseline.gauss_newton(start, kind)
    assert found.converged, found.reason
    assert found.planarity <= 1e-12
    assert judge.planarity(found.vertices, start.topology) <= 1e-12
    if kind == "conical":
        assert judge.balance(found.vertices, start.topology) <= 1e-12
    assert np.abs(found.vertices - start.vertices).max() < 0.5 * start.mean_edge_length


def test_the_baseline_takes_as_many_steps_as_on_record():
    steps = [
        baseline.gauss_newton(meshes.case(name).mesh, "conical").steps
        for name in ("ellipsoid-21", "ellipsoid-41", "roof-21")
    ]
    assert steps == [5, 5, 7]


def test_the_start_meshes_have_the_errors_on_record():
    for name, planarity, degrees in (("ellipsoid-21", 2.04e-6, 0.216), ("roof-21", 2.78e-2, 26.3)):
        mesh = meshes.case(name).mesh
        assert judge.planarity(mesh.vertices, mesh.topology) == pytest.approx(planarity, rel=0.02)
        found = np.degrees(judge.balance(mesh.vertices, mesh.topology))
        assert found == pytest.approx(degrees, rel=0.01)


def test_the_judge_counts_each_way_a_face_can_break():
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0), indexing="ij")
    mesh = QuadMesh.of(np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), grid_faces(5, 5))

    def broken(vertices, move):
        points = np.array(mesh.vertices)
        points[vertices] += move
        return int(judge.broken_faces(points, mesh.vertices, mesh.topology).sum())

    assert broken(14, (0.0, 0.0, 0.3)) == 0
    assert broken(14, (0.6, 0.6, 0.0)) == 1, "a corner turned in"
    assert broken(14, (0.995, 0.0, 0.0)) == 2, "an edge between two faces collapsed"
    assert broken(np.arange(6), (2.0, 0.0, 0.0)) == 5, "a row folded over, its faces convex"


def test_moves_along_the_boundary_are_no_drift():
    case = meshes.case("roof-21")
    points = np.array(case.mesh.vertices)
    points[5] = 0.5 * (points[5] + points[6])
    assert judge.boundary_drift(case.mesh.vertices, points, case.mesh.topology) < 1e-12
    points[5] += (0.0, 0.0, 0.25)
    assert judge.judged(case, points)["boundary_drift"] > 0.1


def test_a_measurement_runs_in_its_own_process():
    found = measurement.measured("ellipsoid-21", "baseline", "conical", repeats=2)
    assert (found.status, found.runs, found.faces, found.converged) == ("", 2, 400, True)
    assert found.planarity_after <= 1e-12
    assert 10 < found.megabytes < 1000
    assert "converged" in table.line(found)


def test_a_slow_method_is_named_as_slow(monkeypatch):
    slow = measurement.measured("ellipsoid-21", "baseline", "conical", limit=1e-3)
    assert (slow.status, slow.seconds, slow.faces) == ("over 0.001 s", None, 400)
    monkeypatch.setattr(measurement, "AROUND", 0.0)
    stopped = measurement.measured("ellipsoid-21", "baseline", "conical", limit=0.01)
    assert stopped.status == "over 0.01 s"


def test_a_failing_and_a_missing_method_are_results(monkeypatch, tmp_path):
    found = measurement.measured("ellipsoid-21", "baseline", "hexagonal")
    assert found.status.startswith("failed: ValueError: The baseline makes")
    (tmp_path / "mpfp.py").write_text("raise ModuleNotFoundError(name='mpfp')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    found = measurement.measured("ellipsoid-21", "mpfp", "planar")
    assert found.status == "not installed: mpfp"
    (tmp_path / "mpfp.py").write_text("import os\nos.abort()\n")
    assert measurement.measured("ellipsoid-21", "mpfp", "planar").status == "crashed: signal 6"
