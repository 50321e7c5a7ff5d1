"""The best edge-offset mesh that was found near a start, as a solution like any other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.koebe.approximate import FitWeights, fitted_edge_offset
from pqmesh.koebe.edge_offset import edge_offset_vectors, image_error
from pqmesh.mesh.measure import flipped_faces, nonconvex_faces, planarity
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.offset.vectors import OffsetVectors, parallel_offset_vectors
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import Solution, Step
from pqmesh.surface.reference import Reference
from pqmesh.vectors import Floats

# Errors of planarity and of edge distances per unit up to which a mesh has edge offsets.
EXACT = 1e-9
# Weights that keep a mesh where it is: 0.1 % of noise moves vertices by 1 % of an edge, and by 90 %
# with the weights for surfaces.
HELD = FitWeights(anchor=1e3)


def edge_offset_solution(
    start: QuadMesh,
    reference: Reference,
    normals: Floats,
    progress: Callable[[Step], None] | None = None,
    *,
    weights: FitWeights | None = None,
) -> tuple[Solution, OffsetVectors]:
    """Mesh with edge offsets nearest to a start, and its offset vectors.

    The mesh keeps its edge distances exactly; how far it is from the reference is the price, and
    is to be judged. Where there is no such mesh near (the Gauss image folds at a parabolic line,
    branches at an umbilic, or has a hole) the nearest planar mesh is taken with the parallel mesh
    nearest to constant distances: its edge distances vary, and the solution says so.

    Parameters
    ----------
    start : QuadMesh
    reference : Reference
    normals : (V, 3)
        Unit normals at the vertices of the start, on the side of its faces' normals.
    progress : callable, optional
    weights : FitWeights, optional
        A start that is its own reference needs a strong anchor (`HELD`): it would slide together,
        for a smaller mesh is nearer to any surface.

    References: the question is [thesis] section 4.2 and chapter 8; [pottmann2010].

    Examples
    --------
    >>> from pqmesh.network.kinds import trace_network
    >>> from pqmesh.network.meshing import quads_from_network
    >>> from pqmesh.surface.curvature import shape_data
    >>> from pqmesh.surface.formula import graph_surface
    >>> from pqmesh.surface.reference import SurfaceReference
    >>> bowl = graph_surface("0.2*x**2+0.15*y**2", (-1, 1), (-1, 1))
    >>> part = quads_from_network(trace_network("principal", bowl, (0.4, 0.5)))
    >>> normals = shape_data(bowl.jet(part.uv)).normal
    >>> found, vectors = edge_offset_solution(part.mesh, SurfaceReference(bowl, part.uv), normals)
    >>> found.converged, vectors.error < 1e-9
    (True, True)
    """
    try:
        fit = fitted_edge_offset(start, reference, normals, weights=weights)
    except (MeshError, ArithmeticError) as error:
        return _nearly(start, reference, progress, " ".join(str(error).split()))
    broken, before = (
        np.union1d(nonconvex_faces(mesh), flipped_faces(mesh)) for mesh in (fit.mesh, start)
    )
    if len(np.setdiff1d(broken, before)):
        return _nearly(start, reference, progress, f"the nearest has {len(broken)} broken faces.")
    image = fit.image.vertices
    if float(np.einsum("vi,vi->", image, normals)) < 0.0:
        image = -image
    gap = image_error(fit.mesh, image)
    flat = float(planarity(fit.mesh).max())
    residuals = {"planarity": flat, "edge distance": gap}
    exact = max(flat, gap) <= EXACT
    reason = (
        f"nearest mesh with edge offsets after {fit.steps} joint steps"
        if exact
        else f"edge offsets only to {max(flat, gap):.2g}"
    )
    blocks = {"vertices": fit.mesh.vertices, "image": image}
    return Solution(blocks, exact, reason, (), residuals), OffsetVectors("edge", image, gap)


def _nearly(
    start: QuadMesh, reference: Reference, progress: Callable[[Step], None] | None, why: str
) -> tuple[Solution, OffsetVectors]:
    """A planar mesh and parallel ones whose edge distances vary."""
    solution = optimized("planar", start, reference, progress=progress)
    vectors = _parallel(start.with_vertices(solution.blocks["vertices"]))
    reason = f"no mesh with edge offsets near: {why} Planar instead, beams differ in depth"
    residuals = solution.residuals | {"edge distance": vectors.error}
    found = Solution(solution.blocks, False, reason, solution.steps, residuals)
    return found, vectors


def best_edge_vectors(mesh: PolyMesh) -> OffsetVectors:
    """Edge offset of a mesh where there is one, else that of the nearest parallel mesh.

    A mesh that is parallel only nearly has skew edges and faces that are not flat: where the
    distance cannot be constant, parallel is worth more.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> from pqmesh.mesh.solids import cube
    >>> best_edge_vectors(cube()).error < 1e-12
    True
    >>> vase = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1]], [0, 1, 2])
    >>> best_edge_vectors(vase).error > 0.01
    True
    """
    vectors = edge_offset_vectors(mesh)
    return vectors if vectors.error <= EXACT else _parallel(mesh)


def _parallel(mesh: PolyMesh) -> OffsetVectors:
    """Nearest parallel mesh, as an edge offset with its error."""
    vectors = parallel_offset_vectors(mesh).vectors
    return OffsetVectors("edge", vectors, image_error(mesh, vectors))
