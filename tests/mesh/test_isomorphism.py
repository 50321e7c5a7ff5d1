import importlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import curved_mesh, polygon_mesh, renumbered, torus_grid, without_faces, zoo

from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.isomorphism import isomorphism
from pqmesh.mesh.solids import deltoidal_icositetrahedron, rhombic_dodecahedron, trapezohedron
from pqmesh.mesh.topology import Topology

module = importlib.import_module("pqmesh.mesh.isomorphism")

ZOO = {name: mesh.topology for name, (mesh, _, _) in zoo().items()}
ZOO["polygons"] = polygon_mesh().topology


def cycles(topology, vertices=None):
    """Faces as oriented cycles, each from its smallest vertex."""
    found = set()
    for face in topology.face_lists():
        ring = face if vertices is None else vertices[np.asarray(face)].tolist()
        start = ring.index(min(ring))
        found.add(tuple(ring[start:] + ring[:start]))
    return found


def carries(a, b, vertices):
    return sorted(vertices.tolist()) == list(range(b.n_vertices)) and cycles(a, vertices) == cycles(
        b
    )


def turned(topology):
    return Topology([face[::-1] for face in topology.face_lists()], topology.n_vertices)


@pytest.mark.parametrize("name", sorted(ZOO))
def test_isomorphism_finds_renumbered_mesh(name):
    a = ZOO[name]
    b, _ = renumbered(a, np.random.default_rng(len(name)))
    found = isomorphism(a, b)
    assert found is not None
    assert carries(a, b, found)
    assert carries(b, a, isomorphism(b, a))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 6), st.integers(2, 6), st.integers(0, 6))
def test_isomorphism_finds_renumbered_disc_with_random_holes(seed, m, n, holes):
    rng = np.random.default_rng(seed)
    faces = grid_faces(m, n).tolist()
    for _ in range(holes):
        trial = [f for k, f in enumerate(faces) if k != rng.integers(len(faces))]
        used = sorted({v for f in trial for v in f})
        try:
            Topology([[used.index(v) for v in f] for f in trial], len(used))
        except ValueError:
            continue
        faces = trial
    used = sorted({v for f in faces for v in f})
    a = Topology([[used.index(v) for v in f] for f in faces], len(used))
    b, _ = renumbered(a, rng)
    assert carries(a, b, isomorphism(a, b))


def test_isomorphism_recovers_the_numbering_where_it_is_unique():
    # A pentagon, hexagon, triangle and quad around a vertex have no symmetry.
    a = ZOO["polygons"]
    b, place = renumbered(a, np.random.default_rng(1))
    assert isomorphism(a, b).tolist() == place.tolist()


def test_reversed_mesh_counts_only_when_asked():
    # Four different faces in this turn: the mirror image is another oriented mesh.
    a = ZOO["polygons"]
    b, place = renumbered(a, np.random.default_rng(2))
    assert isomorphism(a, turned(b)) is None
    found = isomorphism(a, turned(b), reversed_orientation=True)
    assert found.tolist() == place.tolist()


def test_meshes_with_a_mirror_symmetry_are_isomorphic_to_their_reverse():
    for name in ("grid", "torus", "cube", "annulus", "window"):
        a = ZOO[name]
        assert carries(a, turned(a), isomorphism(a, turned(a)))


def test_chiral_piece_is_not_mixed_up_with_its_mirror_image():
    # Four quads in the shape of an S: a half turn is its only symmetry.
    a = without_faces(curved_mesh(2, 3), [2, 3]).topology
    assert isomorphism(a, turned(a)) is None
    assert isomorphism(a, turned(a), reversed_orientation=True) is not None

    def pair(first, second):
        faces = first.face_lists() + np.add(second.face_lists(), first.n_vertices).tolist()
        return Topology(faces, first.n_vertices + second.n_vertices)

    # S and S against S and Z: reversing all faces turns both pieces, never one.
    assert isomorphism(pair(a, a), pair(a, turned(a)), reversed_orientation=True) is None
    assert isomorphism(pair(a, turned(a)), pair(turned(a), a)) is not None


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (torus_grid(4, 6), torus_grid(3, 8)),
        (torus_grid(12, 3), torus_grid(6, 6)),
        (Topology(grid_faces(2, 6), 21), Topology(grid_faces(3, 4), 20)),
        (ZOO["grid"], ZOO["torus"]),
        (deltoidal_icositetrahedron().topology, trapezohedron(12).topology),
        (rhombic_dodecahedron().topology, trapezohedron(6).topology),
    ],
    ids=["tori", "thin_tori", "grids", "grid_torus", "icositetrahedron", "dodecahedron"],
)
def test_isomorphism_tells_meshes_apart(a, b):
    assert isomorphism(a, b) is None
    assert isomorphism(a, b, reversed_orientation=True) is None


def test_isomorphism_tells_twisted_torus_from_straight_one():
    m, n = 6, 6
    straight = torus_grid(m, n)
    faces = grid_faces(m, n, (False, True)).reshape(m, n, 4)
    # The last row joins the first one shifted by `twist` columns.
    for twist in (1, 2, 3):
        ring = (np.arange(n) + twist) % n
        joined = faces.copy()
        joined[-1, :, 1], joined[-1, :, 2] = ring, np.roll(ring, -1)
        other = Topology(joined.reshape(-1, 4), m * n)
        assert isomorphism(straight, other) is None
        moved, _ = renumbered(other, np.random.default_rng(twist))
        assert carries(other, moved, isomorphism(other, moved))


def test_pieces_are_matched_whatever_their_order():
    parts = [grid_faces(2, 3), grid_faces(1, 6), grid_faces(2, 3), grid_faces(3, 2)]
    sizes = [12, 14, 12, 12]

    def joined(order):
        faces, first = [], 0
        for k in order:
            faces += (parts[k] + first).tolist()
            first += sizes[k]
        return Topology(faces, first)

    a, b = joined([0, 1, 2, 3]), joined([1, 3, 2, 0])
    assert carries(a, b, isomorphism(a, b))
    parts[3], sizes[3] = grid_faces(1, 6), 14
    assert isomorphism(a, joined([0, 1, 2, 3])) is None


def test_same_counts_in_pieces_of_other_sizes_are_not_isomorphic():
    def tubes(*columns):
        faces, first = [], 0
        for n in columns:
            faces += (grid_faces(2, n, (False, True)) + first).tolist()
            first += 3 * n
        return Topology(faces, first)

    assert isomorphism(tubes(3, 5), tubes(4, 4)) is None
    assert isomorphism(tubes(3, 5), tubes(5, 3)) is not None
    # A tube of 6 columns wraps twice around one of 3: a map, but not one to one.
    assert isomorphism(tubes(6, 6), tubes(3, 3, 6)) is None


def test_holes_at_other_places_are_not_isomorphic():
    dome = curved_mesh(30, 30)

    def pierced(*gone):
        return without_faces(dome, list(gone)).topology

    # Far from all boundaries: no short look around any vertex tells the two apart.
    assert isomorphism(pierced(30 * 12 + 14), pierced(30 * 12 + 13)) is None
    assert isomorphism(pierced(30 * 12 + 14), pierced(30 * 17 + 15)) is not None


def test_highly_symmetric_meshes_take_few_passes(monkeypatch):
    passes = []
    propagated = module._propagated
    monkeypatch.setattr(module, "_propagated", lambda *a: passes.append(0) or propagated(*a))
    assert isomorphism(torus_grid(60, 60), torus_grid(30, 120)) is None
    # 14 400 corners are candidates; symmetries of the torus rule out all but a few.
    assert len(passes) < 30
    b, _ = renumbered(torus_grid(60, 60), np.random.default_rng(5))
    passes.clear()
    assert carries(torus_grid(60, 60), b, isomorphism(torus_grid(60, 60), b))
    assert len(passes) == 1
