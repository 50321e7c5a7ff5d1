"""The methods of the table: pqmesh, the baseline and what pip can install.

Each is a function of a case and a kind that makes ready (imports, other forms of the input) and
returns the run to be timed, which returns the moved vertices and how it ended. A run starts from
a mesh whose derived tables are not known yet.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.baseline import gauss_newton
from bench.meshes import Case
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.schedule import optimized


class Ended(NamedTuple):
    """Moved vertices (V, 3); whether the method says it is done (None: it does not), and why."""

    vertices: NDArray[np.float64]
    converged: bool | None
    reason: str


Run = Callable[[], Ended]
# Peers stop by themselves at this planarity: as deep as every method is asked for.
STOP = 1e-12


def _fresh(case: Case) -> QuadMesh:
    return QuadMesh.of(case.mesh.vertices, case.mesh.faces)


def optimized_by_pqmesh(case: Case, kind: str, boundary: str) -> Ended:
    """The one place where the table calls pqmesh."""
    found = optimized(kind, _fresh(case), case.reference, boundary=boundary)
    return Ended(found.blocks["vertices"], found.converged, found.reason)


def _pqmesh(*back_ends: str, boundary: str = "free") -> Callable[[Case, str], Run]:
    """With some of the optional back ends of the linear algebra."""

    def ready(case: Case, kind: str) -> Run:
        for name in {"rslab", "pymklpardiso"}.difference(back_ends):
            # As if it were not installed; the process is this measurement's own.
            sys.modules[name] = None  # type: ignore[assignment]
        for name in back_ends:
            import_module(name)
        return lambda: optimized_by_pqmesh(case, kind, boundary)

    return ready


def _baseline(case: Case, kind: str) -> Run:
    def run() -> Ended:
        found = gauss_newton(_fresh(case), kind)
        return Ended(found.vertices, found.converged, f"{found.reason}, {found.steps} steps")

    return run


def _libigl(steps: int) -> Callable[[Case, str], Run]:
    def ready(case: Case, kind: str) -> Run:
        import igl

        points, faces = np.array(case.mesh.vertices), case.mesh.faces.astype(np.int64)

        def run() -> Ended:
            found = igl.planarize_quad_mesh(points, faces, steps, STOP)
            return Ended(np.asarray(found), None, f"at most {steps} steps")

        return run

    return ready


def _shapeop(case: Case, kind: str) -> Run:
    from compas.datastructures import Mesh
    from compas_shapeop.meshsolver import MeshSolver

    points, faces = case.mesh.vertices.tolist(), case.mesh.faces.tolist()

    def run() -> Ended:
        solver = MeshSolver(Mesh.from_vertices_and_faces(points, faces))
        solver.constrain_face_planarity("plane")
        solver.fix_vertices(weight=1.0)
        solver.solve(1000)
        return Ended(np.array(solver.points), None, "1000 steps")

    return run


def _mpfp(case: Case, kind: str) -> Run:
    import mpfp

    points, faces = case.mesh.vertices.tolist(), case.mesh.faces.tolist()
    settings = mpfp.MakePlanarSettings()
    settings.verbose = False

    def run() -> Ended:
        found = mpfp.make_planar_faces(points, faces, [], settings)
        return Ended(np.array(found).reshape(-1, 3), None, "default settings")

    return run


METHODS: dict[str, Callable[[Case, str], Run]] = {
    "pqmesh": _pqmesh("rslab"),
    "pqmesh-glide": _pqmesh("rslab", boundary="glide"),
    "pqmesh-mkl": _pqmesh("rslab", "pymklpardiso"),
    "pqmesh-scipy": _pqmesh(),
    "baseline": _baseline,
    "libigl-100": _libigl(100),
    "libigl-500": _libigl(500),
    "shapeop": _shapeop,
    "mpfp": _mpfp,
}
PEERS = ("libigl-100", "libigl-500", "shapeop", "mpfp")
