"""Measures against the same quantities at 50 digits, on a curved and noisy mesh."""

import high_precision as exactly
import numpy as np
import pytest
from shapes import curved_mesh, cyclide, sampled

from pqmesh.mesh import measure
from pqmesh.mesh.exact import grid_mesh

EPS = np.finfo(float).eps


def noisy_cyclide():
    """A generic curved mesh with faces of many shapes: 1 % noise on a Dupin cyclide."""
    u, v = np.cumsum(np.r_[0.2, np.tile([0.11, 0.23, 0.17], 7)]), np.linspace(0.3, 2.9, 18)
    points, _, _ = sampled(cyclide, u, v)
    mesh = grid_mesh(points)
    noise = 0.01 * mesh.mean_edge_length * np.random.default_rng(7).normal(size=(22 * 18, 3))
    return mesh.with_vertices(mesh.vertices + noise)


MESHES = {"cyclide": noisy_cyclide(), "dome": curved_mesh(14, 12, noise=0.02, seed=3)}


@pytest.fixture(params=sorted(MESHES))
def mesh(request):
    return MESHES[request.param]


@pytest.fixture
def faces(mesh):
    return np.random.default_rng(11).choice(mesh.topology.n_faces, 100, replace=False)


def largest(exact, found):
    return max(abs(float(e - f)) for e, f in zip(exact, found.tolist(), strict=True))


def test_planarity_agrees_with_50_digits(mesh, faces):
    corners = mesh.corners[faces]
    exact = [exactly.planarity_deviation(c) for c in corners]
    found = measure.planarity_deviation(mesh)[faces]
    # 1e-12 of an edge: the stated bound; corners are read as they are, differences round.
    assert largest(exact, found) < 1e-12 * mesh.edge_lengths.min()
    sizes = [exactly.mean_diagonal(c) for c in corners]
    assert largest(sizes, measure.mean_diagonals(mesh)[faces]) < 1e-12 * mesh.edge_lengths.min()


def test_circle_measures_agree_with_50_digits(mesh, faces):
    corners = mesh.corners[faces]
    defects = [exactly.circularity_defect(c) for c in corners]
    assert largest(defects, measure.circularity_defect(mesh)[faces]) < 1e-12
    residuals = [exactly.circle_deviation(c) for c in corners]
    assert largest(residuals, measure.circle_deviation(mesh)[faces]) < 1e-12


def test_face_normals_agree_with_50_digits(mesh, faces):
    for face in faces:
        normal = [float(x) for x in exactly.face_normal(mesh.corners[face])]
        assert np.abs(mesh.face_normals[face] - normal).max() < 1e-12


def test_balance_and_cones_agree_with_50_digits(mesh):
    (star,) = mesh.topology.stars()
    _, defect = measure.conicality_defect(mesh)
    cones = measure.fitted_cones(mesh)
    assert (cones.vertices == star.vertices).all()
    chosen = np.random.default_rng(12).choice(len(star.vertices), 100, replace=False)
    for k in chosen.tolist():
        near = mesh.vertices[star.neighbors[k]]
        exact = exactly.balance(mesh.vertices[star.vertices[k]], near)
        assert abs(float(exact - defect[k])) < 1e-12
        w, misfit, _, _ = exactly.cone(list(mesh.corners[star.faces[k]]))
        # Least squares: relative error eps * (cond + cond^2 * residual) in w, a few operations.
        cond = np.linalg.cond(mesh.face_normals[star.faces[k]])
        size = float(sum(x * x for x in w)) ** 0.5
        bound = 20 * EPS * (cond + cond**2 * float(misfit)) * size
        assert max(abs(float(x - y)) for x, y in zip(w, cones.vectors[k].tolist(), strict=True)) < (
            bound
        )
        assert abs(float(misfit - cones.misfit[k])) < bound
        # Spread and theta speak of the planes at the vertex: triangles of it and two neighbours.
        center = mesh.vertices[star.vertices[k]]
        turned = np.roll(near, -1, axis=0)
        corners = [np.stack([center, p, q]) for p, q in zip(near, turned, strict=True)]
        _, misfit, spread, theta = exactly.cone(corners)
        cond = np.linalg.cond(measure.corner_normals(mesh, star)[k])
        bound = 20 * EPS * (cond + cond**2 * float(misfit)) * size
        assert abs(float(spread - cones.spread[k])) < bound
        assert abs(float(theta - cones.theta[k])) < bound
        # The conditioning bound stays small on these meshes: no empty promise.
        assert bound < 1e-11
