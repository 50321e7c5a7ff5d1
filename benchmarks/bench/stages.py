"""Seconds of the stages before and after the optimiser: the network, and the face offset."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

from bench.meshes import case
from bench.methods import optimized_by_pqmesh
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import trace_principal_network
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.surface.analytic import ellipsoid

EDGES = (0.2, 0.1, 0.05)


def stages(sizes: tuple[int, ...], repeats: int = 3) -> list[dict[str, object]]:
    """Rows `stage`, `of`, `panels`, `seconds` (median).

    Parameters
    ----------
    sizes : tuple of int
        Vertices a side of the ellipsoid grids whose conical mesh is offset; as many networks are
        traced, each twice as fine as the one before.
    """
    rows: list[dict[str, object]] = []
    surface = ellipsoid(3.0, 2.0, 1.2, u=(0.2, 1.2), v=(0.15, 1.1))
    for edge in EDGES[: len(sizes)]:
        network = trace_principal_network(surface, (edge, edge))
        panels = quads_from_network(network).mesh.topology.n_faces
        seconds = _median(lambda e=edge: trace_principal_network(surface, (e, e)), repeats)
        rows.append(_row("network", f"ellipsoid, edge {edge:g}", panels, seconds))
    for n in sizes:
        start = case(f"ellipsoid-{n}")
        moved = start.mesh.with_vertices(optimized_by_pqmesh(start, "conical", "free").vertices)
        seconds = _median(lambda m=moved: face_offset_vectors(m.with_vertices(m.vertices)), repeats)
        rows.append(_row("offset", start.name, moved.topology.n_faces, seconds))
    return rows


def shown(rows: list[dict[str, object]]) -> str:
    """The rows as text."""
    lines = [f"{'stage':8}  {'of':24}  {'panels':>7}  {'s':>8}"]
    lines += [f"{r['stage']:8}  {r['of']:24}  {r['panels']:7d}  {r['seconds']:8.3f}" for r in rows]
    return "\n".join(lines)


def _row(stage: str, of: str, panels: int, seconds: float) -> dict[str, object]:
    return {"stage": stage, "of": of, "panels": panels, "seconds": seconds}


def _median(work: Callable[[], object], repeats: int) -> float:
    taken = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)
