"""PQ strips in the plane: isometric face by face."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pqmesh.errors import MeshError
from pqmesh.fabricate.unroll import unrolled_strip
from pqmesh.mesh.exact import grid_mesh, mirror_plane_mesh, rotational_mesh, translational_mesh
from pqmesh.mesh.solids import cube
from pqmesh.vectors import norm


def lengths(rulings: np.ndarray) -> np.ndarray:
    """Rulings, rims and both diagonals of each face: six lengths fix a quad."""
    a, b = rulings[:-1], rulings[1:]
    pairs = [(a[:, 0], a[:, 1]), (b[:, 0], b[:, 1]), (a[:, 0], b[:, 0]), (a[:, 1], b[:, 1])]
    pairs += [(a[:, 0], b[:, 1]), (a[:, 1], b[:, 0])]
    return np.concatenate([norm(p - q) for p, q in pairs])


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_all_lengths_of_a_random_strip_are_kept(seed: int) -> None:
    rng = np.random.default_rng(seed)
    line, other = (np.cumsum(rng.normal(size=(n, 3)), axis=0) for n in (7, 5))
    mesh = translational_mesh(line, other)
    for strip in mesh.topology.strips:
        flat = unrolled_strip(mesh, strip)
        space = mesh.vertices[flat.vertices]
        assert np.abs(lengths(flat.points) - lengths(space)).max() < 1e-12


def test_neighbouring_faces_lie_on_different_sides_of_their_ruling() -> None:
    mesh = rotational_mesh([[1.0, 0.0], [1.6, 0.5], [1.7, 1.5]], 0.4 * np.arange(7))
    flat = unrolled_strip(mesh, max(mesh.topology.strips, key=len))
    for last, here, following in zip(
        flat.points[:-2], flat.points[1:-1], flat.points[2:], strict=True
    ):
        along = here[1] - here[0]
        sides = [
            along[0] * (p - here[0])[:, 1] - along[1] * (p - here[0])[:, 0]
            for p in (last, following)
        ]
        assert (sides[0] > 0).all()
        assert (sides[1] < 0).all()


def test_cone_strip_is_part_of_a_ring_about_its_apex() -> None:
    angles = 0.3 * np.arange(9)
    mesh = rotational_mesh([[1.0, 0.0], [2.0, 1.5]], angles)
    flat = unrolled_strip(mesh, max(mesh.topology.strips, key=len))
    slant = np.hypot(1.0, 1.5)
    # All rulings meet in the apex, at the slant heights of their ends.
    direction = (flat.points[0, 1] - flat.points[0, 0]) / slant
    near_end = 0 if norm(mesh.vertices[flat.vertices[0, 0]][:2]) < 1.5 else 1
    apex = flat.points[0, near_end] + (direction if near_end else -direction) * slant
    assert norm(flat.points[:, near_end] - apex) == pytest.approx(slant, abs=1e-12)
    assert norm(flat.points[:, 1 - near_end] - apex) == pytest.approx(2 * slant, abs=1e-12)


def test_closed_strip_of_a_cube_is_a_row_of_four_squares() -> None:
    mesh = cube()
    strip = mesh.topology.strips[0]
    flat = unrolled_strip(mesh, strip)
    assert len(flat.faces) == 4
    assert (flat.vertices[0] == flat.vertices[-1]).all()
    side = float(mesh.edge_lengths[0])
    assert flat.points[:, 0, 0] == pytest.approx(side * np.arange(5), abs=1e-12)
    assert flat.area == pytest.approx(4 * side**2)


def test_area_is_that_of_the_faces() -> None:
    mirrors = [[1.0, 0.0, 0.1, 1.0 + 0.4 * k] for k in range(4)]
    strip = [[0.3 * np.sin(t), np.cos(t), 1.0, 2.0] for t in (0.0, 0.3, 0.7, 1.2)]
    mesh = mirror_plane_mesh(strip, mirrors)
    for edges in mesh.topology.strips:
        flat = unrolled_strip(mesh, edges)
        assert flat.area == pytest.approx(float(norm(mesh.face_area_vectors)[flat.faces].sum()))


def test_bent_faces_are_refused_with_the_worst() -> None:
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0), indexing="ij")
    points = np.stack([x, y, 0.0 * x], -1)
    points[2, 1, 2] = 0.3
    mesh = grid_mesh(points)
    strip = max(mesh.topology.strips, key=len)
    with pytest.raises(MeshError, match=r"plane to 1e-06; face \d+ is 0\.\d+ of its diagonal"):
        unrolled_strip(mesh, strip)


def test_edges_that_are_no_strip_are_refused() -> None:
    mesh = rotational_mesh([[1.0, 0.0], [1.6, 0.5], [1.7, 1.5]], 0.4 * np.arange(4))
    strips = mesh.topology.strips
    with pytest.raises(MeshError, match="opposite sides of one face"):
        unrolled_strip(mesh, np.array([strips[0][0], strips[1][-1]]))
    with pytest.raises(MeshError, match="at least two edges"):
        unrolled_strip(mesh, strips[0][:1])
