"""`optimize` in too little memory: it writes the best mesh, says so, and ends in 3."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapes import curved_mesh

from pqmesh import linear
from pqmesh.io.formats import read_mesh, write_mesh
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.optimize.ending import OUT_OF_MEMORY


@pytest.mark.parametrize("count", [0, 3])
def test_command_writes_the_best_mesh_and_ends_in_3(
    monkeypatch: pytest.MonkeyPatch, pqmesh: Callable[..., Any], tmp_path: Path, count: int
) -> None:
    start = curved_mesh()
    write_mesh(start, tmp_path / "start.obj")
    real, calls = linear.BlockPattern.factor, []

    def factor(self: Any, blocks: Any) -> Any:
        calls.append(1)
        # The first matrix is that of the look ahead.
        if len(calls) > 1 + count:
            raise MemoryError
        return real(self, blocks)

    monkeypatch.setattr(linear.BlockPattern, "factor", factor)
    result = pqmesh("optimize", "start.obj", "-o", "o.obj", "--report", "o.json")
    assert result.code == 3, result.err
    assert OUT_OF_MEMORY in result.err
    assert "not reached: planar " in result.err
    report, moved = json.loads((tmp_path / "o.json").read_text()), read_mesh(tmp_path / "o.obj")
    assert report["solver"]["reason"] == OUT_OF_MEMORY
    assert report["solver"]["converged"] is False
    assert np.isfinite(moved.vertices).all()
    assert planarity(moved).max() <= planarity(start).max()


def test_memory_that_does_not_suffice_to_begin_is_one_line(
    monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str], tmp_path: Path
) -> None:
    # A start of which there is nothing else to say.
    profile = [[2.0, 0.0], [2.4, 0.5], [2.5, 1.2], [2.3, 1.8]]
    write_mesh(rotational_mesh(profile, 0.3 * np.arange(6)), tmp_path / "start.obj")

    def none(*_: Any, **__: Any) -> None:
        raise MemoryError

    monkeypatch.setattr("pqmesh.optimize.schedule.problem_for", none)
    line = refused("optimize", "start.obj", "-o", "o.obj")
    assert "must fit into memory" in line
    assert "coarser mesh" in line
