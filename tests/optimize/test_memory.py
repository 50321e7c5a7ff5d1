"""Too little memory: the best mesh so far is kept, and the reason says so."""

from typing import Any

import pytest
from shapes import curved_mesh

from pqmesh import linear
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.optimize import assembly
from pqmesh.optimize.ending import OUT_OF_MEMORY
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.solver import Solution, solve
from pqmesh.surface.reference import TriangleReference


def short_after(monkeypatch: pytest.MonkeyPatch, count: int, what: type = MemoryError) -> None:
    """Let so many matrices be factorised and no more."""
    real, calls = linear.BlockPattern.factor, []

    def factor(self: Any, blocks: Any) -> Any:
        calls.append(1)
        if len(calls) > count:
            raise what("memory")
        return real(self, blocks)

    monkeypatch.setattr(linear.BlockPattern, "factor", factor)


def solved(start: PolyMesh, kind: str = "conical") -> Solution:
    itself = TriangleReference.of_polygons(start.vertices, start.topology.face_lists())
    return solve(problem_for(kind, start, itself), start)


def test_start_is_kept_where_not_even_one_step_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    short_after(monkeypatch, 0)
    start = curved_mesh()
    found = solved(start)
    assert (found.converged, found.reason, found.steps) == (False, OUT_OF_MEMORY, ())
    assert (found.blocks["vertices"] == start.vertices).all()
    assert found.residuals["planarity"] > 1e-3


def test_best_mesh_so_far_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    start = curved_mesh()
    whole = solved(start)
    assert whole.converged
    short_after(monkeypatch, 3)
    found = solved(start)
    assert (found.converged, found.reason) == (False, OUT_OF_MEMORY)
    assert 1 <= len(found.steps) < len(whole.steps)
    short_after(monkeypatch, 0)
    assert max(found.residuals.values()) < 0.5 * max(solved(start).residuals.values())
    mesh = start.with_vertices(found.blocks["vertices"])
    assert planarity(mesh).max() < planarity(start).max()


def test_assembly_that_does_not_fit_leaves_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: Any) -> None:
        raise MemoryError

    monkeypatch.setattr(assembly, "BlockPattern", none)
    start = curved_mesh()
    found = solved(start)
    assert (found.converged, found.reason) == (False, OUT_OF_MEMORY)
    assert (found.blocks["vertices"] == start.vertices).all()


def test_size_that_no_machine_has_is_refused_before_the_back_end_is_asked() -> None:
    linear.check_room(1 << 20)
    with pytest.raises(MemoryError):
        linear.check_room(1 << 60)


def test_back_end_is_not_asked_for_more_than_there_is(
    monkeypatch: pytest.MonkeyPatch, backend: str
) -> None:
    if backend == "_SuperLU":
        pytest.skip("SuperLU says itself that memory does not suffice")
    asked: list[int] = []

    def refuse(size: int) -> None:
        asked.append(size)
        raise MemoryError

    monkeypatch.setattr(linear, "check_room", refuse)
    found = solved(curved_mesh())
    assert found.reason == OUT_OF_MEMORY
    assert asked


def test_words_of_a_back_end_tell_memory_from_a_singular_matrix() -> None:
    assert isinstance(linear._failure(RuntimeError("SUPERLU_MALLOC fails")), MemoryError)
    assert isinstance(linear._failure(ValueError("matrix is singular")), ArithmeticError)
