"""Seconds of the main stages by size, on curvature lines of an ellipsoid and on the example roof.

Usage: python benchmarks/bench.py [LARGEST_COUNT]. Median of three; figures are of this machine.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.measure import measures
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.network.meshing import quads_from_network
from pqmesh.network.principal import trace_principal_network
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.solver import solve
from pqmesh.surface.analytic import ellipsoid
from pqmesh.surface.reference import SurfaceReference

SIZES = (20, 40, 80, 120)


def median(work: Callable[[], object]) -> float:
    """Median seconds of three runs."""
    taken = []
    for _ in range(3):
        began = time.perf_counter()
        work()
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def curvature_grid(n: int) -> tuple[QuadMesh, SurfaceReference]:
    """n x n quads of curvature lines of the ellipsoid 3, 2, 1 (squared axes 9, 4, 1)."""
    surface = ellipsoid(3.0, 2.0, 1.0, lines="curvature", u=(0.15, 1.2), v=(0.35, 1.35))
    u = np.linspace(*surface.domain.u, n + 1)
    v = np.linspace(*surface.domain.v, n + 1)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    mesh = QuadMesh.of(surface.jet(uv).point, grid_faces(n, n))
    return mesh, SurfaceReference(surface, uv)


def main(largest: int) -> None:
    """Print the table."""
    print(
        f"{'faces':>7} {'conical s':>10} {'steps':>6} {'planarity':>10} "
        f"{'balance rad':>12} {'offset s':>9}"
    )
    for n in [size for size in SIZES if size <= largest]:
        mesh, reference = curvature_grid(n)
        solution = solve(problem_for("conical", mesh, reference), mesh)
        seconds = median(lambda m=mesh, r=reference: solve(problem_for("conical", m, r), m))
        moved = mesh.with_vertices(solution.blocks["vertices"])
        found = measures(moved)
        offset = median(lambda m=moved: face_offset_vectors(m.with_vertices(m.vertices)))
        print(
            f"{n * n:7d} {seconds:10.3f} {len(solution.steps):6d} {found['planarity_max']:10.1e} "
            f"{np.radians(found['conicality_max_deg']):12.1e} {offset:9.3f}"
        )
    surface = ellipsoid(3.0, 2.0, 1.2, u=(0.2, 1.2), v=(0.15, 1.1))
    print(f"\n{'edge':>7} {'panels':>7} {'network s':>10}")
    for edge in (0.2, 0.1, 0.05):
        network = trace_principal_network(surface, (edge, edge))
        panels = quads_from_network(network).mesh.topology.n_faces
        seconds = median(lambda e=edge: trace_principal_network(surface, (e, e)))
        print(f"{edge:7g} {panels:7d} {seconds:10.2f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else max(SIZES))
