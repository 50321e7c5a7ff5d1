"""The nearest Laguerre image: found where it exists, honest where it does not."""

import numpy as np
import pytest
from shapes import cyclide, sampled
from sphere_samples import tangential, torus_mesh

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import tangent_plane_mesh
from pqmesh.mesh.measure import fitted_cones, planarity
from pqmesh.surface.analytic import shape_surface
from pqmesh.surface.reference import SurfaceReference, TriangleReference
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.search import nearest_image


def changed(mesh, rapidity, distance=0.08):
    """A moderate Laguerre transformation about the middle of a mesh."""
    middle = mesh.vertices.mean(axis=0)
    boost = LaguerreTransform.boost([0.5, 0.7, 0.4], rapidity, middle)
    motion = LaguerreTransform.shift([0.3, -0.2, 0.1]) @ LaguerreTransform.rotation([1, 2, 0], 0.2)
    return motion @ LaguerreTransform.offset(distance) @ boost


@pytest.mark.parametrize("rapidity", [0.1, -0.3, 0.45])
def test_hidden_transformation_is_found_from_its_points(rapidity):
    mesh = torus_mesh()
    hidden = LaguerreTransform.similarity(1.4) @ changed(mesh, rapidity)
    wanted = hidden.of_mesh(mesh).mesh
    found = nearest_image(mesh, wanted.vertices)
    assert found.converged
    assert found.start_rms > 0.3
    assert found.deviation_max < 1e-9
    assert found.transform.rapidity == pytest.approx(hidden.rapidity, abs=1e-6)
    np.testing.assert_allclose(found.image.mesh.vertices, wanted.vertices, atol=1e-9)


def test_torus_is_bent_onto_a_cyclide_of_the_same_focal_conics():
    # A scale of 1 keeps the focal ellipse's smaller axis: R^2 = a^2 - c^2 = 8.
    u, v = 0.2 * np.arange(8) - 0.7, 0.25 * np.arange(8) - 0.8
    point = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    normal = np.stack(
        [
            np.cos(point[..., 0]) * np.cos(point[..., 1]),
            np.sin(point[..., 0]) * np.cos(point[..., 1]),
            np.sin(point[..., 1]),
        ],
        axis=-1,
    )
    heights = np.sqrt(8.0) * np.cos(point[..., 1]) + 1.0
    mesh = tangent_plane_mesh(np.concatenate([normal, heights[..., None]], axis=-1))
    # What a cyclide's own mesh of tangent planes leaves is the measure of success.
    surface = SurfaceReference(shape_surface("cyclide"))
    own = tangential(cyclide, u, v)
    feet = surface.closest(own.vertices)[0]
    floor = np.sqrt(((own.vertices - feet) ** 2).sum(axis=1).mean())
    found = nearest_image(mesh, surface, most_steps=25)
    assert found.start_rms > 20 * floor
    assert found.deviation_rms < 1.5 * floor
    assert planarity(found.image.mesh).max() < 1e-12
    assert fitted_cones(found.image.mesh).relative_spread.max() < 1e-10


def test_mesh_that_lies_on_the_target_stays():
    mesh = torus_mesh()
    target = TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())
    found = nearest_image(mesh, target, most_steps=5)
    assert found.deviation_max < 1e-12
    np.testing.assert_allclose(found.image.mesh.vertices, mesh.vertices, atol=1e-9)


@pytest.mark.parametrize("rapidity", [0.1, 0.3])
def test_hidden_transformation_is_found_from_the_panels_of_its_image(rapidity):
    mesh = torus_mesh()
    wanted = changed(mesh, rapidity).of_mesh(mesh).mesh
    target = TriangleReference.of_polygons(wanted.vertices, wanted.topology.face_lists())
    found = nearest_image(mesh, target)
    assert found.converged
    assert found.start_rms > 0.2
    assert found.deviation_max < 1e-9


def test_what_the_group_cannot_do_stays_as_deviation():
    mesh = torus_mesh()
    saddle = sampled(lambda x, y: np.stack([3 + 0 * x, x, y], axis=-1), np.arange(7), np.arange(7))
    wanted = saddle.reshape(-1, 3) + 0.4 * np.sin(saddle.reshape(-1, 3)[:, [1, 2, 1]])
    found = nearest_image(mesh, wanted)
    assert 1e-3 < found.deviation_rms < found.start_rms
    assert planarity(found.image.mesh).max() < 1e-11


def test_same_input_gives_the_same_answer():
    mesh = torus_mesh()
    wanted = changed(mesh, 0.2).of_mesh(mesh).mesh.vertices + 0.01
    first, second = (nearest_image(mesh, wanted) for _ in range(2))
    assert (first.transform.matrix == second.transform.matrix).all()
    assert (first.image.mesh.vertices == second.image.mesh.vertices).all()


def test_points_that_do_not_fit_are_refused():
    mesh = torus_mesh()
    with pytest.raises(MeshError, match=r"must have shape \(49, 3\)"):
        nearest_image(mesh, mesh.vertices[:-1])
    with pytest.raises(MeshError, match="one finite row"):
        nearest_image(mesh, np.full_like(mesh.vertices, np.nan))
