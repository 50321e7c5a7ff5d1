import dataclasses

import numpy as np
import pytest
from shapes import curved_mesh, moebius_strip, polygon_mesh, torus_grid, voxel_surface, zoo

from pqmesh.errors import MeshError
from pqmesh.mesh.exact import grid_faces
from pqmesh.mesh.solids import (
    deltoidal_hexecontahedron,
    rhombic_triacontahedron,
    sphere_tangent_mesh,
)
from pqmesh.mesh.topology import Topology, drop_unused

ZOO = zoo()


@pytest.fixture(params=sorted(ZOO))
def named(request):
    return ZOO[request.param]


# --- counts and incidence ---------------------------------------------------------------------


def test_topology_counts_euler_characteristic_and_boundary_loops(named):
    mesh, euler, loops = named
    assert mesh.topology.euler_characteristic == euler
    assert len(mesh.topology.boundary_loops) == loops


def test_edges_and_faces_name_each_other(named):
    t = named[0].topology
    assert t.n_edges == len({frozenset(e) for e in t.edges.tolist()})
    assert (t.edges[:, 0] < t.edges[:, 1]).all()
    for face, corners in enumerate(t.face_lists()):
        for corner, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
            edge = t.face_edges[t.offsets[face] + corner]
            assert set(t.edges[edge]) == {a, b}
            # Run from low to high the face lies on the left, else on the right.
            assert t.edge_faces[edge, 0 if a < b else 1] == face
    sides = (t.edge_faces >= 0).sum()
    assert sides == len(t.indices)
    assert (t.is_boundary_edge == ((t.edge_faces >= 0).sum(axis=1) == 1)).all()


def test_valence_counts_edges_and_boundary_vertices_lie_on_loops(named):
    t = named[0].topology
    valence = [sum(v in e for e in t.edges.tolist()) for v in range(t.n_vertices)]
    assert t.valence.tolist() == valence
    on_loops = np.concatenate([np.empty(0, int), *t.boundary_loops])
    assert len(on_loops) == len(set(on_loops.tolist()))
    assert sorted(on_loops.tolist()) == np.flatnonzero(t.is_boundary_vertex).tolist()


def test_boundary_loops_have_the_mesh_on_their_left(named):
    t = named[0].topology
    directed = set()
    for face in t.face_lists():
        directed |= set(zip(face, [*face[1:], face[0]], strict=True))
    for loop in t.boundary_loops:
        for step in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True):
            assert step in directed
            assert step[::-1] not in directed


def test_components_tell_two_pieces_apart():
    assert np.bincount(ZOO["two_pieces"][0].topology.components).tolist() == [30, 30]
    assert set(ZOO["torus"][0].topology.components.tolist()) == {0}


def test_irregular_vertices_are_interior_with_valence_other_than_four():
    assert ZOO["irregular_disc"][0].topology.irregular_vertices.tolist() == [0]
    assert len(ZOO["torus"][0].topology.irregular_vertices) == 0
    assert len(ZOO["cube"][0].topology.irregular_vertices) == 8
    handles = ZOO["two_handles"][0].topology
    # Sum over the vertices of 4 - valence is 4 chi on any closed quad mesh.
    assert (4 - handles.valence).sum() == 4 * handles.euler_characteristic


def test_topology_accepts_faces_of_any_length():
    t = polygon_mesh().topology
    assert t.face_sizes.tolist() == [5, 6, 3, 4]
    assert t.euler_characteristic == 1
    assert not t.is_quad
    assert t.face(1).tolist() == [0, 4, 5, 6, 7, 8]
    neighbors, faces = t.star(0)
    # Corner 0 of each face is the center; its last corner is the next edge counterclockwise.
    start = neighbors.tolist().index(1)
    assert np.roll(neighbors, -start).tolist() == [1, 4, 8, 9]
    assert np.roll(faces, -start).tolist() == [0, 1, 2, 3]


def test_pentagons_close_to_a_dodecahedron():
    golden = (1 + 5**0.5) / 2
    rows = [np.roll([0, s, r * golden], k) for s in (1, -1) for r in (1, -1) for k in range(3)]
    t = sphere_tangent_mesh(rows).topology
    assert (t.n_vertices, t.n_edges, t.n_faces, t.euler_characteristic) == (20, 30, 12, 2)
    assert (t.face_sizes == 5).all()
    assert (t.valence == 3).all()


def test_faces_given_as_array_or_lists_make_the_same_topology():
    faces = grid_faces(3, 2)
    a, b = Topology(faces, 12), Topology(faces.tolist(), 12)
    assert (a.indices == b.indices).all()
    assert (a.offsets == b.offsets).all()
    assert a.face_lists() == faces.tolist()


def test_topology_cannot_be_written_to():
    faces = grid_faces(2, 2)
    t = Topology(faces, 9)
    faces[0, 0] = 7
    assert t.indices[0] == 0
    for name in ("indices", "offsets", "edges", "edge_faces", "face_edges", "valence", "quads"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(t, name)[0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        t.n_vertices = 3


def test_drop_unused_renumbers_in_rising_order():
    faces, used = drop_unused([[9, 4, 2], [2, 4, 7]], 12)
    assert faces == [[3, 1, 0], [0, 1, 2]]
    assert used.tolist() == [2, 4, 7, 9]


# --- stars ------------------------------------------------------------------------------------


def check_star(topology, vertex, neighbors, faces, *, boundary):
    """Face i holds ... -> neighbor i+1 -> vertex -> neighbor i -> ... as oriented cycle."""
    k = len(neighbors)
    assert len(faces) == k - boundary
    assert len(set(neighbors.tolist())) == k
    for i, face in enumerate(faces.tolist()):
        corners = topology.face(face).tolist()
        at = corners.index(vertex)
        assert corners[(at + 1) % len(corners)] == neighbors[i]
        assert corners[at - 1] == neighbors[(i + 1) % k]


def test_stars_walk_faces_and_neighbors_in_order(named):
    t = named[0].topology
    seen = []
    for boundary in (False, True):
        for star in t.stars(boundary=boundary):
            for row, vertex in enumerate(star.vertices.tolist()):
                assert t.is_boundary_vertex[vertex] == boundary
                check_star(t, vertex, star.neighbors[row], star.faces[row], boundary=boundary)
                neighbors, faces = t.star(vertex)
                assert neighbors.tolist() == star.neighbors[row].tolist()
                assert faces.tolist() == star.faces[row].tolist()
                seen.append(vertex)
    assert sorted(seen) == list(range(t.n_vertices))


def test_stars_of_polygons_walk_in_order():
    t = polygon_mesh().topology
    for vertex in range(t.n_vertices):
        neighbors, faces = t.star(vertex)
        check_star(t, vertex, neighbors, faces, boundary=bool(t.is_boundary_vertex[vertex]))


@pytest.mark.parametrize(
    "mesh",
    [rhombic_triacontahedron(), deltoidal_hexecontahedron(), ZOO["torus"][0], curved_mesh()],
    ids=["triacontahedron", "hexecontahedron", "torus", "grid"],
)
def test_stars_turn_once_counterclockwise_seen_from_outside(mesh):
    for star in mesh.topology.stars():
        center = mesh.vertices[star.vertices]
        normal = mesh.vertex_normals[star.vertices]
        spokes = mesh.vertices[star.neighbors] - center[:, None]
        flat = spokes - np.einsum("nki,ni->nk", spokes, normal)[..., None] * normal[:, None]
        nxt = np.roll(flat, -1, axis=1)
        sine = np.einsum("nki,ni->nk", np.cross(flat, nxt), normal)
        turn = np.arctan2(sine, (flat * nxt).sum(axis=-1))
        assert (turn > 0).all()
        # One full turn: a star in wrong order would turn twice or more. Rounding only.
        assert np.allclose(turn.sum(axis=1), 2 * np.pi, atol=1e-12)


def test_boundary_star_starts_at_the_edge_with_its_face_on_the_left():
    t = Topology(grid_faces(2, 2), 9)
    # Vertex 1 is (0, 1): counterclockwise about i x j come (0,0)=0, (1,1)=4, (0,2)=2.
    assert t.star(1)[0].tolist() == [0, 4, 2]
    assert t.star(1)[1].tolist() == [0, 1]


# --- strips and polylines ---------------------------------------------------------------------


def test_strips_cover_every_edge_once_and_step_across_quads(named):
    t = named[0].topology
    covered = []
    sides = t.face_edges.reshape(-1, 4)
    across = {(a, b) for q in sides.tolist() for a, b in zip(q, q[2:] + q[:2], strict=True)}
    for strip in t.strips:
        is_closed = len(strip) > 1 and strip[0] == strip[-1]
        covered.extend(strip[:-1].tolist() if is_closed else strip.tolist())
        for a, b in zip(strip[:-1].tolist(), strip[1:].tolist(), strict=True):
            assert (a, b) in across
        if not is_closed:
            assert t.is_boundary_edge[strip[[0, -1]]].all()
    assert sorted(covered) == list(range(t.n_edges))


def test_strips_and_polylines_of_known_meshes_have_known_numbers():
    expected = {
        "grid": (6 + 5, 7 + 6, 0, 0),
        "torus": (12, 12, 12, 12),
        "annulus": (3 + 6, 4 + 6, 3, 4),
        "cube": (3, 12, 3, 0),
    }
    for name, (n_strips, n_polylines, closed_strips, closed_polylines) in expected.items():
        t = ZOO[name][0].topology
        assert (len(t.strips), len(t.polylines)) == (n_strips, n_polylines), name
        assert sum(s[0] == s[-1] for s in t.strips) == closed_strips, name
        assert sum(p[0] == p[-1] for p in t.polylines) == closed_polylines, name


def test_polylines_cover_every_edge_once_and_end_where_they_must(named):
    t = named[0].topology
    covered = []
    for line in t.polylines:
        covered.extend(tuple(sorted(step)) for step in zip(line[:-1].tolist(), line[1:].tolist(),
                                                          strict=True))  # fmt: skip
        if line[0] != line[-1]:
            ends = line[[0, -1]]
            assert (t.is_boundary_vertex[ends] | (t.valence[ends] != 4)).all()
    assert sorted(covered) == sorted(map(tuple, t.edges.tolist()))
    for edge, line in zip(t.edges.tolist(), t.polyline_of_edge.tolist(), strict=True):
        steps = zip(t.polylines[line][:-1].tolist(), t.polylines[line][1:].tolist(), strict=True)
        assert tuple(edge) in {tuple(sorted(step)) for step in steps}


def test_polylines_go_straight_through_regular_vertices(named):
    t = named[0].topology
    for line in t.polylines:
        closed = line[0] == line[-1]
        cycle = np.concatenate([line, line[1:2]]) if closed else line
        for before, middle, after in zip(cycle, cycle[1:], cycle[2:], strict=False):
            neighbors = t.star(int(middle))[0].tolist()
            gap = abs(neighbors.index(before) - neighbors.index(after))
            if t.is_boundary_vertex[middle]:
                # Straight along a smooth boundary, or a closed polyline that ends at a corner.
                assert gap == 2
                assert len(neighbors) == 3
            elif len(neighbors) == 4:
                assert gap == 2


def test_straight_triples_pass_each_regular_vertex_twice():
    t = ZOO["torus"][0].topology
    assert len(t.straight_triples) == 2 * t.n_vertices
    assert np.bincount(t.straight_triples[:, 1]).tolist() == [2] * t.n_vertices
    assert len(ZOO["cube"][0].topology.straight_triples) == 0


def test_window_boundary_breaks_polylines_at_reentrant_corners():
    t = ZOO["window"][0].topology
    inner = next(loop for loop in t.boundary_loops if len(loop) == 8)
    corners = inner[t.valence[inner] == 4]
    assert len(corners) == 4
    ends = [v for line in t.polylines for v in (line[0], line[-1])]
    for corner in corners:
        # Two boundary polylines and two inner ones end there.
        assert ends.count(corner) == 4


# --- refusals ---------------------------------------------------------------------------------

CUBE = voxel_surface([(0, 0, 0)]).topology.face_lists()


def glued(vertex_map, faces):
    return [[vertex_map.get(v, v + 20) for v in face] for face in faces]


def compact(faces):
    out, used = drop_unused(faces, 100)
    return out, len(used)


@pytest.mark.parametrize(
    ("faces", "n", "text"),
    [
        ([], 0, "at least one face; found none. Add faces"),
        (np.empty((0, 4), int), 4, "at least one face; found none"),
        ([[0, 1]], 2, "at least 3 corners; face 0 has 2"),
        ([[0, 1, 2], []], 3, "at least 3 corners; face 1 has 0"),
        ([[0, 1, 2, 3]], 3, r"index vertices 0..2; face 0 has vertex 3"),
        ([[0, 1, 2], [0, 2, -1]], 3, "face 1 has vertex -1"),
        ([[0, 1, 2, 1]], 3, "must not repeat a vertex; face 0 has vertex 1 twice"),
        ([[0, 1, 2], [1, 0, 3], [0, 1, 4]], 5, "at most two faces; edge 0-1 has 3"),
        ([[0, 1, 2], [0, 1, 3]], 4, "faces 0 and 1 both run along edge 0-1 from 0 to 1"),
        ([[0, 1, 2]], 4, "Every vertex must belong to a face; vertex 3 has none"),
        ([[0, 1, 2], [0, 3, 4]], 5, "one fan; at vertex 0 they form several"),
        ([[0, 1, 2], [[1], [2]]], 3, "A face must be a list of vertex numbers; face 1 is"),
        ([[0, 1, 2.5]], 3, "A face must be a list of vertex numbers; face 0 is"),
        (np.array([[0.0, 1.0, 2.0]]), 3, "integers; found float64"),
        (*compact(CUBE + glued({0: 0}, CUBE)), "at vertex 0 they form several"),
        (*compact([*CUBE, [0, 50, 51]]), "at vertex 0 they form several"),
    ],
    ids=[
        "no_faces", "no_rows", "two_corners", "empty_face", "too_large", "negative", "repeated",
        "three_faces", "incoherent", "unused", "two_open_fans", "nested", "float_list",
        "float_array", "two_closed_fans", "closed_and_open_fan",
    ],
)  # fmt: skip
def test_topology_refuses(faces, n, text):
    with pytest.raises(MeshError, match=text):
        Topology(faces, n)


@pytest.mark.parametrize("n", [3, 4, 7])
def test_topology_refuses_moebius_strip_as_not_coherently_oriented(n):
    faces, size = moebius_strip(n)
    with pytest.raises(MeshError, match="Faces must be coherently oriented; faces"):
        Topology(faces, size)
    # The untwisted strip of the same quads is an annulus.
    annulus = Topology([*faces[:-1], [2 * n - 2, 2 * n - 1, 1, 0]], size)
    assert annulus.euler_characteristic == 0
    assert len(annulus.boundary_loops) == 2


def test_quads_are_refused_of_other_polygons():
    with pytest.raises(MeshError, match=r"must be a quad; 3 of 4 are not, the first is face 0 wi"):
        _ = polygon_mesh().topology.quads


def test_large_torus_is_built_quickly():
    t = torus_grid(150, 150)
    assert t.euler_characteristic == 0
    assert all(len(star.vertices) == t.n_vertices for star in t.stars())
