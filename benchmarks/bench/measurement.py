"""One measurement: a method on a mesh, in a process of its own with a time limit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path

HOME = Path(__file__).resolve().parents[1]
# Seconds a process may take to start, read its mesh and judge the result, beyond the limit.
AROUND = 20.0
# Status of a measurement whose process has not said how it ended.
UNFINISHED = "unfinished"


@dataclass(frozen=True)
class Measurement:
    """What a method did to a mesh; None where it did not get so far.

    Attributes
    ----------
    mesh, method, kind : str
    status : str
        '' when it ran; else 'over 120 s', 'not installed: ...', 'crashed: ...', 'failed: ...'.
    vertices, faces : int
    seconds, cpu_seconds : float
        Medians over `runs` runs in one process, of the method alone.
    runs : int
        Fewer than asked for where they would not fit the limit.
    megabytes : float
        Peak memory of the process up to the end of the runs, interpreter and libraries included.
    converged : bool
        What the method says itself; None where it does not.
    reason : str
        How it ended, in its own words.
    planarity_before, planarity_after : float
        Distance of the diagonals over their mean length, worst face.
    balance_before, balance_after : float
        Worst balance of angles at interior vertices of valence 4, radians.
    moved_max, deviation_rms, boundary_drift : float
        Mean edges of the start: longest move of a vertex, rms distance from the start surface,
        largest distance of a boundary vertex from the start boundary.
    edge_ratio, shortest_ratio : float
        Smallest ratio of an edge to itself, and of the shortest edge to the shortest at the start.
    broken_before, broken_new : int
        Faces turned over, with a corner closed, flat or reflex, or with a collapsed edge; new ones
        were sound at the start.
    """

    mesh: str
    method: str
    kind: str
    status: str = ""
    vertices: int | None = None
    faces: int | None = None
    seconds: float | None = None
    cpu_seconds: float | None = None
    runs: int = 0
    megabytes: float | None = None
    converged: bool | None = None
    reason: str = ""
    planarity_before: float | None = None
    planarity_after: float | None = None
    balance_before: float | None = None
    balance_after: float | None = None
    moved_max: float | None = None
    deviation_rms: float | None = None
    edge_ratio: float | None = None
    shortest_ratio: float | None = None
    broken_before: int | None = None
    broken_new: int | None = None
    boundary_drift: float | None = None


def measured(
    mesh: str, method: str, kind: str, repeats: int = 1, limit: float = 120.0
) -> Measurement:
    """A method measured on a mesh; slow, crashing and missing methods are results, not errors.

    Parameters
    ----------
    mesh : str
        A name `bench.meshes.case` knows.
    method : str
        A key of `bench.methods.METHODS`.
    kind : 'planar' or 'conical'
    repeats : int
        Runs in the one process, of which the median counts.
    limit : float, seconds
        For all runs together; a first run that leaves no room for the others stands alone.
    """
    unknown = Measurement(mesh, method, kind, UNFINISHED)
    with tempfile.TemporaryDirectory(prefix="pqmesh-bench-") as folder:
        answer = Path(folder) / "answer.json"
        words = [mesh, method, kind, str(repeats), str(limit), str(answer)]
        path = os.pathsep.join([str(HOME), *filter(None, [os.environ.get("PYTHONPATH")])])
        environment = os.environ | {"PYTHONPATH": path}
        # As the command does, for every method alike: dense kernels in one thread.
        environment.setdefault("OPENBLAS_NUM_THREADS", "1")
        over = f"over {limit:g} s"
        try:
            # Peers print as they please.
            done = subprocess.run(
                [sys.executable, "-m", "bench.worker", *words],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                timeout=limit + AROUND,
            )
        except subprocess.TimeoutExpired:
            return replace(_answer(answer, unknown), status=over)
        found = _answer(answer, unknown)
    if found.status == UNFINISHED:
        last = (done.stderr.decode(errors="replace").strip().splitlines() or [""])[-1]
        how = f"signal {-done.returncode}" if done.returncode < 0 else last[:80]
        return replace(found, status=f"crashed: {how}")
    if found.seconds is not None and found.seconds > limit:
        return replace(unknown, vertices=found.vertices, faces=found.faces, status=over)
    return found


def written(found: Measurement, path: Path) -> None:
    """Write a measurement for `measured`, whole or not at all."""
    beside = path.with_suffix(".part")
    beside.write_text(json.dumps(asdict(found)), encoding="utf-8")
    beside.replace(path)


def _answer(path: Path, unknown: Measurement) -> Measurement:
    """What the process wrote last."""
    if not path.exists():
        return unknown
    return Measurement(**json.loads(path.read_text(encoding="utf-8")))
