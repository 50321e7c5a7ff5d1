"""The Laguerre image of a simple conical mesh that comes nearest to points or to a surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.surface.reference import Reference
from pqmesh.transform.conical import LaguerreImage, laguerre_image, rapidity_range
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.lorentz import boost_matrix, rotation_matrix
from pqmesh.vectors import Floats, dot, norm

# Directions of the Lie algebra: 3 rotations, 3 boosts, 3 translations, an offset, a scaling.
N_PARAMETERS = 11
# Starts: no boost, and boosts along the axes by this share of what the mesh can bear.
START_SHARE = 0.4
# Rounds of every start towards a surface, and how many of the best go on to the end.
SCREENED, FINALISTS = 8, 2
# Steps of the fit to the surface itself at the end.
FINISH = 12
# How strongly vertices are held to their closest points within the surface, less every round.
HOLD, SOFTER = 0.2, 0.7
# A round that changes the sum of squares by less than this share ends them; nearer is nothing.
SETTLED, NOTHING = 1e-10, 1e-28
# Two starts whose deviations differ by less than this share are equally good: the first counts.
SAME = 1e-6
# Relative changes that end a fit.
END = 1e-14
# Step of the derivatives; the model has size 1.
DIFFERENCE = 1e-7
# c' is held above this share of its start, so that no trial divides by nothing.
LEAST_GROWTH = 1e-3


@dataclass(frozen=True, eq=False)
class NearestImage:
    """The best Laguerre image found, and how near it comes.

    Attributes
    ----------
    transform : LaguerreTransform
    image : LaguerreImage
    deviation_rms, deviation_max : float, model unit
        Of the vertices from their target points, or from the surface.
    start_rms : float, model unit
        The same of the mesh itself, before the search.
    start : int
        Which of the starts led here, counted from 0.
    converged : bool
        False when the search ended at its limit of steps: nearer images may exist.
    """

    transform: LaguerreTransform
    image: LaguerreImage
    deviation_rms: float
    deviation_max: float
    start_rms: float
    start: int
    converged: bool


class _Fit(NamedTuple):
    """Where a start has led: parameters and half the sum of squares, in the model."""

    start: int
    x: Floats
    cost: float
    converged: bool


class _Model(NamedTuple):
    """The mesh about its own middle, in units of its size."""

    vertices: Floats
    vectors: Floats
    middle: Floats
    size: float


def nearest_image(
    mesh: QuadMesh, target: Floats | Reference, *, most_steps: int = 60
) -> NearestImage:
    """Laguerre image of a conical mesh with its vertices nearest to a target, by least squares.

    The transformation is a similarity, a boost, an offset and a motion, 11 parameters:
    exp(rotation) exp(boost), translation and offset, exp(scale), about the middle of the mesh.
    Levenberg-Marquardt from seven fixed starts, the best one wins: the same input gives the same
    answer. Towards a surface the scale stays (a mesh shrunk to a point would be nearest), and
    each round fits the tangent planes at the closest points. What the group cannot do stays as
    deviation: spheres stay spheres, tori become Dupin cyclides.

    Parameters
    ----------
    mesh : QuadMesh
        Conical; a few hundred faces are plenty.
    target : (V, 3) or Reference
        A point for each vertex, or a surface near the mesh.
    most_steps : int
        Limit for each start.

    Raises
    ------
    MeshError
        When the points do not fit the mesh, or every image found fails; names the failure.

    References: [thesis] section 5.3; errata page, E29.

    Examples
    --------
    >>> from pqmesh.mesh.exact import rotational_mesh
    >>> roof = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5))
    >>> wanted = LaguerreTransform.boost([1, 0, 1], 0.2).of_mesh(roof).mesh.vertices
    >>> bool(nearest_image(roof, wanted).deviation_max < 1e-7)
    True
    """
    _check_target(mesh, target)
    model = _model(mesh)
    starts = _starts(mesh, model)
    if isinstance(target, np.ndarray):
        fits = _point_fits(model, starts, target, most_steps)
    else:
        fits = _surface_fits(model, starts, target, most_steps)
    failure = None
    for number in _by_cost([fit.cost for fit in fits]):
        fit = fits[number]
        transform = _transform(model, fit.x)
        try:
            image = laguerre_image(transform, mesh)
        except MeshError as error:
            failure = failure or error
            continue
        rms, largest = _deviation(image.mesh.vertices, target)
        start_rms, _ = _deviation(mesh.vertices, target)
        return NearestImage(transform, image, rms, largest, start_rms, fit.start, fit.converged)
    raise MeshError(
        f"The nearest image must be a mesh; all of {len(fits)} found fail, the best one so: "
        f"{failure}"
    )


# --- parameters -----------------------------------------------------------------------------


def _model(mesh: QuadMesh) -> _Model:
    """The mesh about its middle."""
    vectors = face_offset_vectors(mesh).vectors
    middle = mesh.vertices.mean(axis=0)
    size = float(np.sqrt(np.mean(norm(mesh.vertices - middle) ** 2)))
    return _Model((mesh.vertices - middle) / size, vectors, middle, size)


def _parts(x: Floats) -> tuple[Floats, Floats, float]:
    """Lorentz matrix exp(rotation) exp(boost), translation and scale, for the model."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(x[:3])
    scale = float(np.exp(x[10])) if len(x) == N_PARAMETERS else 1.0
    return matrix @ boost_matrix(x[3:6]), x[6:10], scale


def _vertices(model: _Model, x: Floats) -> Floats:
    """Vertices of the image in the model; c' is held off zero."""
    matrix, shift, scale = _parts(x)
    start = scale * (model.vertices @ matrix[:, :3].T) + shift
    along = model.vectors @ matrix[:, :3].T + matrix[:, 3]
    growth = np.maximum(along[:, 3:], LEAST_GROWTH * matrix[3, 3])
    return np.asarray(start[:, :3] - start[:, 3:] / growth * along[:, :3])


def _transform(model: _Model, x: Floats) -> LaguerreTransform:
    """The transformation in the place of the mesh."""
    matrix, shift, scale = _parts(x)
    place = np.append(model.middle, 0.0)
    moved = model.size * shift + place - scale * (matrix @ place)
    return LaguerreTransform(matrix, moved, scale)


def _starts(mesh: QuadMesh, model: _Model) -> list[Floats]:
    """Nothing, then boosts along both senses of the three axes."""
    starts = [np.zeros(N_PARAMETERS)]
    for axis in range(3):
        low, high = rapidity_range(mesh, np.eye(3)[axis], model.middle)
        for bound in (low, high):
            start = np.zeros(N_PARAMETERS)
            start[3 + axis] = START_SHARE * np.clip(bound, -1.0, 1.0)
            starts.append(start)
    return starts


# --- fits -----------------------------------------------------------------------------------


def _fitted(residuals: Callable[[Floats], Floats], start: Floats, most_steps: int) -> Any:
    """Least squares by Levenberg and Marquardt; SciPy's result."""

    def jacobian(x: Floats) -> Floats:
        here = residuals(x)
        steps = np.eye(len(x)) * DIFFERENCE
        return np.stack([(residuals(x + step) - here) / DIFFERENCE for step in steps], axis=1)

    return least_squares(
        residuals, start, jacobian, method="lm", xtol=END, ftol=END, gtol=END, max_nfev=most_steps
    )


def _point_fits(model: _Model, starts: list[Floats], points: Floats, most_steps: int) -> list[_Fit]:
    """From every start to target points."""
    goal = (points - model.middle) / model.size

    def residuals(x: Floats) -> Floats:
        return np.asarray((_vertices(model, x) - goal).ravel())

    fits = []
    for number, start in enumerate(starts):
        found = _fitted(residuals, start, most_steps)
        fits.append(_Fit(number, found.x, float(found.cost), bool(found.status > 0)))
        if found.cost <= NOTHING * len(points):
            break
    return fits


def _surface_fits(
    model: _Model, starts: list[Floats], reference: Reference, most_steps: int
) -> list[_Fit]:
    """From every start a few rounds towards a surface, from the best ones to the end."""
    fits = [
        _rounds(model, reference, _Fit(number, start[:-1], np.inf, False), SCREENED)
        for number, start in enumerate(starts)
    ]
    for number in _by_cost([fit.cost for fit in fits])[:FINALISTS]:
        fits[number] = _rounds(model, reference, fits[number], most_steps)
        if not fits[number].converged:
            fits[number] = _finished(model, reference, fits[number])
    return fits


def _finished(model: _Model, reference: Reference, fit: _Fit) -> _Fit:
    """A fit to the surface itself, where its tangent planes lead no nearer (kinks, rims)."""
    points = model.size * _vertices(model, fit.x) + model.middle
    _, _, near = reference.closest(points)

    def residuals(x: Floats) -> Floats:
        points = model.size * _vertices(model, x) + model.middle
        return np.asarray((points - near.closest(points)[0]).ravel() / model.size)

    found = _fitted(residuals, fit.x, FINISH)
    return _Fit(fit.start, np.asarray(found.x), float(found.cost), bool(found.status > 0))


def _rounds(model: _Model, reference: Reference, fit: _Fit, most: int) -> _Fit:
    """The best of some rounds of closest points, each with a fit to the tangent planes there."""
    x, best, before = fit.x, fit, np.inf
    for step in range(most):
        points = model.size * _vertices(model, x) + model.middle
        feet, normals, reference = reference.closest(points)
        gaps = (points - feet) / model.size
        cost = 0.5 * float(dot(gaps, gaps).sum())
        settled = abs(before - cost) <= SETTLED * cost or cost <= NOTHING * len(points)
        if cost <= best.cost or settled:
            best = min(best, _Fit(fit.start, x, cost, settled), key=lambda known: known.cost)
        if settled:
            return best._replace(converged=True)
        before = cost
        x = _closer(model, x, (feet - model.middle) / model.size, normals, HOLD * SOFTER**step)
    return best


def _closer(model: _Model, x: Floats, feet: Floats, normals: Floats, hold: float) -> Floats:
    """Parameters after a fit to the tangent planes at feet (V, 3)."""
    gaps = _vertices(model, x) - feet
    # Beyond the rim the way to the foot is no normal: there the whole gap counts.
    is_within = norm(gaps) <= 1.01 * np.abs(dot(gaps, normals)) + 1e-14
    sideways = np.where(is_within, hold, 1.0)[:, None]

    def residuals(y: Floats) -> Floats:
        gap = _vertices(model, y) - feet
        across = dot(gap, normals)[:, None] * normals
        return np.asarray((across + sideways * (gap - across)).ravel())

    return np.asarray(_fitted(residuals, x, 3).x)


# --- targets --------------------------------------------------------------------------------


def _deviation(vertices: Floats, target: Floats | Reference) -> tuple[float, float]:
    """Root mean square and largest distance from the target, model unit."""
    feet = target if isinstance(target, np.ndarray) else target.closest(vertices)[0]
    square = dot(vertices - feet, vertices - feet)
    return float(np.sqrt(square.mean())), float(np.sqrt(square.max()))


def _by_cost(costs: list[float]) -> list[int]:
    """Starts from the best; equally good ones in their order."""
    best = min(costs)
    return sorted(range(len(costs)), key=lambda k: (costs[k] > best * (1 + SAME), costs[k], k))


def _check_target(mesh: QuadMesh, target: Floats | Reference) -> None:
    """Refuse target points that do not fit the mesh."""
    if not isinstance(target, np.ndarray):
        return
    wanted = (mesh.topology.n_vertices, 3)
    if target.shape != wanted or not np.isfinite(target).all():
        raise MeshError(
            f"Target points must have shape {wanted}, one finite row for each vertex; found "
            f"{target.shape}. Give a surface as target where there is no point for each vertex."
        )
