"""Polygons as meshes and files."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from roofs import square, vault

from pqmesh.fabricate.panels import obj_from_polygons, polygons_mesh
from pqmesh.fabricate.trim import trimmed_panels
from pqmesh.io.obj import polygons_from_obj
from pqmesh.mesh.quadmesh import PolyMesh


def test_trimmed_panels_weld_into_one_mesh():
    panels = trimmed_panels(vault(), square(1.3, 8.9), 1.0)
    mesh = PolyMesh.of(*polygons_mesh(panels.polygons))
    assert mesh.topology.euler_characteristic == 1
    assert len(mesh.topology.boundary_loops) == 1


def test_panels_that_meet_in_a_corner_can_be_written():
    square_ = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    found = polygons_from_obj(obj_from_polygons([square_, square_ + np.array([1.0, 1.0, 0.0])]))
    assert found.face_lists() == [[0, 1, 2, 3], [2, 4, 5, 6]]


def test_obj_keeps_every_bit():
    panels = trimmed_panels(vault(), square(1.3, 8.9), 1.0)
    found = polygons_from_obj(obj_from_polygons(panels.polygons))
    for face, points in zip(found.face_lists(), panels.polygons, strict=True):
        assert np.array_equal(found.vertices[face], points)


def test_minus_zero_welds_with_zero():
    a = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    vertices, faces = polygons_mesh([a, np.array([[-0.0, 0, 0], [0, 1, -0.0], [-1, 0, 0]])])
    assert faces == [[0, 1, 2], [0, 2, 3]]
    assert not np.signbit(vertices[0]).any()


def test_no_polygons_give_an_empty_mesh():
    vertices, faces = polygons_mesh([])
    assert vertices.shape == (0, 3)
    assert faces == []
