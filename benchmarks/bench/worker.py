"""The process of one measurement: python -m bench.worker MESH METHOD KIND REPEATS LIMIT ANSWER."""

from __future__ import annotations

import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path

from bench.measurement import UNFINISHED, Measurement, written

# A mesh that every method is run on once before it is timed.
WARM_UP = "ellipsoid-21"


def main(
    mesh: str, method: str, kind: str, repeats: int, limit: float, answer: Path
) -> Measurement:
    """Run and judge; the size of the mesh is answered before, should the run not come back."""
    from bench.judge import judged
    from bench.meshes import case
    from bench.methods import METHODS

    found = Measurement(mesh, method, kind)
    try:
        start = case(mesh)
        run = METHODS[method](start, kind)
    except ImportError as error:
        return replace(found, status=f"not installed: {error.name}")
    topology = start.mesh.topology
    found = replace(found, vertices=topology.n_vertices, faces=topology.n_faces)
    written(replace(found, status=UNFINISHED), answer)
    seconds, cpu = [], []
    try:
        # Imports and first calls are no part of what a method takes.
        METHODS[method](case(WARM_UP), kind)()
        # Runs that would not fit are left out, so that the limit is one for all of them.
        while len(seconds) < repeats and (not seconds or (1 + len(seconds)) * max(seconds) < limit):
            began, worked = time.perf_counter(), time.process_time()
            ended = run()
            seconds.append(time.perf_counter() - began)
            cpu.append(time.process_time() - worked)
        megabytes = peak_megabytes()
        numbers = judged(start, ended.vertices)
    except Exception as error:  # noqa: BLE001 - whatever a method raises is its result
        return replace(found, status=f"failed: {type(error).__name__}: {error}"[:120])
    return replace(
        found,
        seconds=statistics.median(seconds),
        cpu_seconds=statistics.median(cpu),
        runs=len(seconds),
        megabytes=megabytes,
        converged=ended.converged,
        reason=ended.reason,
        **numbers,
    )


def peak_megabytes() -> float:
    """Largest memory this process held so far."""
    status = Path("/proc/self/status")
    if status.exists():
        # The system's account of a process starts with the peak of the one that started it; this
        # mark is the process's own.
        for line in status.read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    *names, repeats, limit, answer = sys.argv[1:]
    written(main(*names, int(repeats), float(limit), Path(answer)), Path(answer))
