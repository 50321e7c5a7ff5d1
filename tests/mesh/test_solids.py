import numpy as np
import pytest

from pqmesh.errors import MeshError
from pqmesh.mesh import solids
from pqmesh.mesh.isomorphism import isomorphism
from pqmesh.mesh.measure import nonconvex_faces, planarity

GOLDEN = (1 + 5**0.5) / 2

SOLIDS = {
    "cube": (solids.cube(), 6, {3: 8}),
    "rhombic_dodecahedron": (solids.rhombic_dodecahedron(), 12, {3: 8, 4: 6}),
    "deltoidal_icositetrahedron": (solids.deltoidal_icositetrahedron(), 24, {3: 8, 4: 18}),
    "rhombic_triacontahedron": (solids.rhombic_triacontahedron(), 30, {3: 20, 5: 12}),
    "deltoidal_hexecontahedron": (solids.deltoidal_hexecontahedron(), 60, {3: 20, 4: 30, 5: 12}),
    "trapezohedron_3": (solids.trapezohedron(3), 6, {3: 8}),
    "trapezohedron_4": (solids.trapezohedron(4), 8, {3: 8, 4: 2}),
    "trapezohedron_9": (solids.trapezohedron(9), 18, {3: 18, 9: 2}),
}


@pytest.mark.parametrize("name", sorted(SOLIDS))
def test_solid_has_its_faces_and_valences_and_touches_the_unit_sphere(name):
    mesh, n_faces, valences = SOLIDS[name]
    assert mesh.topology.n_faces == n_faces
    assert mesh.topology.euler_characteristic == 2
    found = np.unique(mesh.topology.valence, return_counts=True)
    assert dict(zip(*(column.tolist() for column in found), strict=True)) == valences
    # A handful of products of numbers near 1.
    assert planarity(mesh).max() < 1e-14
    assert np.abs((mesh.face_normals * mesh.face_centers).sum(axis=1) - 1).max() < 1e-14
    assert len(nonconvex_faces(mesh)) == 0


def test_rhombi_have_their_published_diagonal_ratios():
    for mesh, ratio in [
        (solids.rhombic_dodecahedron(), 2**0.5),
        (solids.rhombic_triacontahedron(), GOLDEN),
    ]:
        a, b, c, d = np.moveaxis(mesh.corners, 1, 0)
        diagonals = np.linalg.norm([c - a, d - b], axis=-1)
        assert np.allclose(diagonals.max(axis=0) / diagonals.min(axis=0), ratio, atol=1e-13)
        assert np.allclose(mesh.edge_lengths, mesh.edge_lengths[0], atol=1e-13)


def test_kites_have_two_edge_lengths_in_published_ratio():
    # Deltoidal icositetrahedron 1 : (2 - 1/sqrt 2) = 1.2929; hexecontahedron 1 : (7 + sqrt 5)/6.
    for mesh, ratio in [
        (solids.deltoidal_icositetrahedron(), 2 - 0.5**0.5),
        (solids.deltoidal_hexecontahedron(), (7 + 5**0.5) / 6),
    ]:
        lengths = np.unique(np.round(mesh.edge_lengths, 10))
        assert len(lengths) == 2
        assert np.isclose(lengths[1] / lengths[0], ratio, atol=1e-9)


def test_trapezohedron_of_three_is_the_cube():
    assert isomorphism(solids.trapezohedron(3).topology, solids.cube().topology) is not None
    lengths = solids.trapezohedron(3).edge_lengths
    assert np.allclose(lengths, 2.0, atol=1e-14)


def test_trapezohedron_needs_three():
    with pytest.raises(MeshError, match=r"needs n >= 3; found 2\. Give a larger n"):
        solids.trapezohedron(2)


def test_contacts_in_one_half_of_the_sphere_are_refused():
    with pytest.raises(MeshError, match="must surround the origin; they lie in one half"):
        solids.sphere_tangent_mesh([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.5, 0.5]])
