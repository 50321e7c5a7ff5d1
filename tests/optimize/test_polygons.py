"""Faces of any size: what flatness of a polygon is, and meshes of triangles, quads and n-gons."""

import numpy as np
import pytest
from shapes import crown, curved_mesh, dodecahedron, football, lantern, polygon_mesh

from pqmesh.io.formats import read_mesh
from pqmesh.mesh.exact import translational_mesh
from pqmesh.mesh.measure import (
    circularity_defect,
    corner_angles,
    fitted_cones,
    mean_diagonals,
    measures,
    nonconvex_faces,
    planarity,
    planarity_deviation,
    plane_deviation,
)
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.solids import sphere_tangent_mesh
from pqmesh.optimize.guard import Guard, least_sines
from pqmesh.optimize.problem import gathered
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.solver import solve
from pqmesh.optimize.terms import TERMS, Circularity, Cone, Planarity, PolygonPlanarity
from pqmesh.optimize.terms.planarity import area_vectors, warp_modes
from pqmesh.surface.reference import TriangleReference


def noisy(mesh, share, seed=0):
    rng = np.random.default_rng(seed)
    step = share * mesh.mean_edge_length * rng.normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + step)


def reference_of(mesh):
    return TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())


def optimised(kind, start, target=None):
    found = solve(problem_for(kind, start, reference_of(target or start)), start)
    return start.with_vertices(found.blocks["vertices"]), found


def convex_polygon(k, rng):
    """Corners of a convex polygon in the plane z = 0, in a random affine image of the circle."""
    turn = np.sort(2 * np.pi * (np.arange(k) + 0.8 * rng.uniform(size=k)) / k)
    plane = np.column_stack([np.cos(turn), np.sin(turn)]) @ (np.eye(2) + 0.3 * rng.normal(size=2))
    return np.column_stack([plane, np.zeros(k)])


def single(points):
    return PolyMesh.of(points, [list(range(len(points)))])


# --- flatness of a polygon --------------------------------------------------------------------


@pytest.mark.parametrize("k", [4, 5, 6, 7, 8, 12, 13])
def test_a_polygon_has_k_minus_3_orthonormal_warps(k):
    modes = warp_modes(k)
    assert modes.shape == (k - 3, k)
    # A few roundings.
    assert np.abs(modes @ modes.T - np.eye(k - 3)).max() < 1e-14
    # Moving, tilting and stretching a regular polygon is no warp.
    turn = 2 * np.pi * np.arange(k) / k
    affine = np.column_stack([np.ones(k), np.cos(turn), np.sin(turn)])
    assert np.abs(modes @ affine).max() < 1e-13


def test_the_warp_of_a_quad_is_the_distance_of_its_diagonals():
    mesh = noisy(curved_mesh(4, 3), 0.05)
    blocks = {"vertices": mesh.vertices}
    general, own = PolygonPlanarity.on(mesh, 4), Planarity.on(mesh)
    first = general.evaluate(gathered(general, blocks))
    second = own.evaluate(gathered(own, blocks))
    # Two formulas for one number, and for its gradient, up to the sign.
    assert np.abs(first[0] + second[0]).max() < 1e-14
    assert np.abs(first[1] + second[1]).max() < 1e-13


@pytest.mark.parametrize("k", [5, 6, 7, 9, 12])
@pytest.mark.parametrize("seed", range(4))
def test_warps_vanish_on_flat_convex_polygons_and_nowhere_near_them_else(k, seed):
    rng = np.random.default_rng(seed)
    points = convex_polygon(k, rng)
    mesh = single(points)
    term = PolygonPlanarity.on(mesh, k)
    value, jacobian = term.evaluate(points[None])
    assert np.abs(value).max() < 1e-14
    # The k - 3 equations are independent there: well away from rank deficiency.
    values = np.linalg.svd(jacobian[0].reshape(k - 3, 3 * k), compute_uv=False)
    assert values[-1] > 0.05 * values[0]
    lifted = points + 0.05 * rng.normal(size=(k, 1)) * [0, 0, 1]
    warp = np.linalg.norm(term.evaluate(lifted[None])[0]) * mesh.mean_edge_length
    assert warp > 0.2 * plane_deviation(lifted)


def differences(term, rows, step):
    """Derivatives (m, r, k, 3) by central differences, extrapolated once."""

    def central(h):
        result = []
        for corner in range(rows.shape[1]):
            for axis in range(3):
                moved = np.zeros_like(rows)
                moved[:, corner, axis] = h
                rise = term.evaluate(rows + moved)[0] - term.evaluate(rows - moved)[0]
                result.append(rise / (2 * h))
        m, r = result[0].shape
        return np.stack(result, axis=-1).reshape(m, r, rows.shape[1], 3)

    return (4 * central(step) - central(2 * step)) / 3


@pytest.mark.parametrize("k", [3, 4, 5, 6, 7, 12])
def test_jacobians_of_polygon_terms_equal_central_differences(k):
    rng = np.random.default_rng(k)
    rows = convex_polygon(k, rng) + 0.1 * rng.normal(size=(3, k, 3))
    with_axis = np.concatenate([rows, rng.normal(size=(3, 1, 3))], axis=1)
    terms = [(Cone({"vertices": np.empty((0, k)), "axes": np.empty((0, 1))}, 1.0), with_axis)]
    if k > 3:
        terms.append((PolygonPlanarity({}, warp_modes(k), 0.7), rows))
    for term, at in terms:
        jacobian = term.evaluate(at)[1]
        found = differences(term, at, 1e-3)
        # Fourth order at a thousandth of the size: 1e-11.
        assert np.abs(jacobian - found).max() < 1e-8 * np.abs(jacobian).max()
    area, chords = area_vectors(rows)
    step = 1e-3 * rng.normal(size=rows.shape)
    # The area is quadratic: its mean slope over a symmetric step is the slope.
    rise = 0.5 * (area_vectors(rows + step)[0] - area_vectors(rows - step)[0])
    assert np.allclose(rise, np.cross(step, chords).sum(axis=1), rtol=0, atol=1e-15)
    assert np.allclose(area[0], single(rows[0]).face_area_vectors[0], rtol=0, atol=1e-15)


# --- measures ---------------------------------------------------------------------------------


def test_triangles_are_flat_and_circular():
    mesh = noisy(lantern(), 0.1)
    triangles = mesh.topology.face_sizes == 3
    assert triangles.sum() == 12
    assert (planarity(mesh)[triangles] == 0).all()
    assert (circularity_defect(mesh)[triangles] == 0).all()
    assert (planarity(mesh)[~triangles] > 0).all()


def test_deviation_of_a_polygon_is_its_height_across_its_plane():
    # Corners of a regular hexagon, up and down in turn: the plane is z = 0 by symmetry.
    turn = np.pi / 3 * np.arange(6)
    zigzag = np.column_stack([np.cos(turn), np.sin(turn), 0.02 * (-1.0) ** np.arange(6)])
    mesh = single(zigzag)
    assert np.isclose(planarity_deviation(mesh)[0], 0.04, rtol=0, atol=1e-15)
    assert np.isclose(planarity_deviation(mesh)[0], 2 * plane_deviation(zigzag))
    assert np.isclose(mean_diagonals(mesh)[0], 2 * np.hypot(1, 0.02))
    # A crossed hexagon without area has no plane of its own, but it is not flat.
    eight = np.array([[0, 0, 0], [2, 0, 0.3], [2, 1, 0], [0, -1, 0], [0, 0, 0.1], [2, 0, -0.2]])
    crossed = np.vstack([eight[:3], eight[:3] * [-1, 1, 1]])
    assert planarity_deviation(single(crossed))[0] > 0.0


def test_measures_of_polygons_depend_on_no_first_corner_and_no_unit():
    mesh = noisy(football(), 0.03)
    lists = [face[2:] + face[:2] for face in mesh.topology.face_lists()]
    turned = PolyMesh.of(1e3 * mesh.vertices, lists)
    # Rounding.
    assert np.abs(planarity(turned) - planarity(mesh)).max() < 1e-14
    gap = np.abs(circularity_defect(turned)) - np.abs(circularity_defect(mesh))
    assert np.abs(gap).max() < 1e-13


def test_measures_of_an_exact_mesh_of_polygons_are_zero():
    table = measures(lantern())
    for key in ("planarity_max", "cone_spread_max", "circularity_max_deg", "offset_misfit_max"):
        # Degrees over rounding.
        assert table[key] < 1e-11, key
    assert set(table) == set(measures(curved_mesh()))
    # Circles of a regular polygon: moved corners leave it.
    bent = lantern().vertices.copy()
    top = lantern().topology.face(36)
    bent[top[0], :2] *= 1.05
    assert measures(lantern().with_vertices(bent))["circularity_max_deg"] > 0.5


# --- problems ---------------------------------------------------------------------------------


def test_every_face_has_its_flatness_and_all_share_one_weight():
    mesh = polygon_mesh()
    problem = problem_for("circular", mesh, reference_of(mesh))
    hard = {goal.name: goal for goal in problem.goals if goal.hard}
    assert set(hard) == {
        "planarity",
        "planarity of 5-gons",
        "planarity of 6-gons",
        "circularity",
    }
    assert sum(hard[name].weight for name in hard if "planarity" in name) == pytest.approx(1.0)
    # 1 for the quad, 2 for the pentagon, 3 for the hexagon.
    assert len(hard["circularity"].term.stencils["vertices"]) == 6
    assert hard["planarity of 6-gons"].term.evaluate(np.zeros((1, 6, 3)))[0].shape == (1, 3)


def test_cones_read_every_face_at_a_vertex_above_valence_four():
    mesh = crown()
    problem = problem_for("conical", mesh, reference_of(mesh))
    hard = {goal.name: goal.term for goal in problem.goals if goal.hard}
    counts = {name: len(hard[name].stencils["axes"]) for name in hard if "cone" in name}
    assert counts == {"cone": 2, "cone of 3-gons": 2, "cone of 5-gons": 1}
    # A quad mesh has the goals it always had.
    names = [goal.name for goal in problem_for("conical", quads(), reference_of(quads())).goals]
    assert names == [
        "planarity",
        "conicality",
        "closeness",
        "edges",
        "fairness",
        "anchor",
    ]
    assert {"polygon_planarity", "planarity"} <= set(TERMS)
    assert len(Circularity.on(mesh).stencils["vertices"]) == 4


def quads():
    return curved_mesh(3, 3)


# --- meshes -----------------------------------------------------------------------------------


def patched():
    """A translational mesh, flat, with quads cut into triangles and pairs joined to hexagons.

    The first polyline has three points on a line, so the quads on both sides are in one plane.
    """
    x, y = np.linspace(0, 1, 9), np.linspace(0, 1, 8)
    first = np.column_stack([8 * x, 0 * x, 2 * np.sin(2.5 * x)])
    first[3] = 0.5 * (first[2] + first[4])
    mesh = translational_mesh(first, np.column_stack([0.5 * y * y, 7 * y, -2 * y * y]))
    faces, joined = mesh.faces.tolist(), {14 + j: 21 + j for j in (1, 2, 4)}
    lists = []
    for number, face in enumerate(faces):
        if number in joined:
            other = faces[joined[number]]
            k = next(k for k in range(4) if {face[k], face[(k + 1) % 4]} <= set(other))
            place = other.index(face[k])
            lists.append([face[(k + 1 + i) % 4] for i in range(4)]
                         + [other[(place + 1 + i) % 4] for i in range(2)])  # fmt: skip
        elif number in joined.values():
            continue
        elif number % 5 == 0:
            lists += [face[:3], [face[0], face[2], face[3]]]
        else:
            lists.append(face)
    return PolyMesh.of(mesh.vertices, lists)


EXACT = {"dodecahedron": dodecahedron(), "football": football(), "patched": patched()}


@pytest.mark.parametrize("share", [1e-3, 0.05])
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("name", EXACT)
def test_noisy_polygons_become_flat(name, seed, share):
    exact = EXACT[name]
    assert planarity(exact).max() < 1e-14
    start = noisy(exact, share, seed)
    mesh, found = optimised("planar", start, exact)
    assert found.converged
    # The hard goals' tolerance, 1e-12 of the mean edge for each warp, of which there are 3 here.
    assert planarity(mesh).max() < 2e-12
    assert (least_sines(mesh) > 0).all()
    if name != "patched":
        assert len(nonconvex_faces(mesh)) == 0
    moved = np.linalg.norm(mesh.vertices - start.vertices, axis=1).max() / start.mean_edge_length
    # A pentagon among triangles of noise: a few times the noise.
    assert moved < 10 * share


def test_polyhedron_with_faces_of_all_sizes_becomes_flat():
    exact = sphere_tangent_mesh(np.random.default_rng(0).normal(size=(60, 3)))
    assert set(exact.topology.face_sizes) >= {3, 4, 5, 6, 7, 8}
    mesh, found = optimised("planar", noisy(exact, 1e-3), exact)
    assert found.converged
    # Edges of down to a hundredth of the mean beside it.
    assert planarity(mesh).max() < 2e-12
    assert len(nonconvex_faces(mesh)) == 0
    assert set(found.residuals) == {"planarity", *(f"planarity of {k}-gons" for k in range(5, 10))}


def test_mesh_of_triangles_only_stays_where_it_is():
    points = np.random.default_rng(0).normal(size=(5, 3)) + 4 * np.eye(5)[:, :3]
    mesh = PolyMesh.of(points, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])
    for kind in ("planar", "circular", "conical"):
        result, found = optimised(kind, mesh)
        assert found.converged
        assert np.abs(result.vertices - mesh.vertices).max() < 1e-12


@pytest.mark.parametrize("kind", ["planar", "conical", "circular"])
def test_quad_mesh_gives_the_same_whether_it_is_called_one_or_not(kind):
    quad = noisy(curved_mesh(5, 4), 0.01)
    plain, _ = optimised(kind, quad)
    other, _ = optimised(kind, PolyMesh(quad.vertices, quad.topology))
    assert isinstance(plain, QuadMesh)
    assert plain.vertices.tobytes() == other.vertices.tobytes()


# --- the guard --------------------------------------------------------------------------------


def el_shapes():
    """Two hexagons in the shape of an L with a quad in the notch of each, bent."""
    points = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2], [2, 2], [4, 0], [4, 1], [3, 1],
              [3, 2], [4, 2]]  # fmt: skip
    faces = [[0, 1, 2, 3, 4, 5], [3, 2, 6, 4], [1, 7, 8, 9, 10, 6, 2], [9, 8, 11, 10]]
    flat = np.array(points, float)
    height = 0.1 * flat[:, 0] ** 2 - 0.08 * flat[:, 1] ** 2
    return PolyMesh.of(np.column_stack([flat, height]), faces)


def test_re_entrant_corners_of_polygons_stay_and_are_no_fault():
    start = el_shapes()
    assert nonconvex_faces(start).tolist() == [0, 2]
    assert (least_sines(start) > 0).all()
    guard = Guard.of(start)
    assert not guard.broken(start.vertices)[0].any()
    # The re-entrant corner pulled out: the L would turn into a convex hexagon.
    out = start.vertices.copy()
    out[3, :2] = [1.8, 1.9]
    assert guard.broken(out)[0][0]
    mesh, found = optimised("planar", start)
    assert found.converged
    assert planarity(mesh).max() < 2e-12
    before, after = corner_angles(start), corner_angles(mesh)
    straight = np.abs(before - np.pi) < 0.2
    assert straight.sum() == 1
    assert ((before > np.pi) == (after > np.pi))[~straight].all()


def test_guard_names_polygons_beyond_its_limits():
    mesh = football()
    guard = Guard.of(mesh)
    assert not guard.broken(mesh.vertices)[0].any()
    # A corner pulled over the opposite side of its face.
    points = mesh.vertices.copy()
    face = mesh.topology.face(20)
    points[face[0]] = 2.5 * mesh.face_centers[20] - 1.5 * points[face[0]]
    faces, _ = guard.broken(points)
    assert faces[20]
    assert guard.blocked(points)[20]
    # Shrunk edges block the faces beside them, and those only.
    points = mesh.vertices.copy()
    points[face[0]] = 0.9 * points[face[1]] + 0.1 * points[face[0]]
    faces, edges = guard.broken(points)
    assert [set(pair) for pair in mesh.edges[edges].tolist()] == [set(face[:2].tolist())]
    beside = mesh.topology.edge_faces[edges][0]
    assert set(np.flatnonzero(guard.blocked(points))) == set(beside) | set(np.flatnonzero(faces))
    # In a mirror every face of a flat mesh lies on its back.
    flat = polygon_mesh()
    assert Guard.of(flat).broken(flat.vertices * [-1, 1, 1])[0].all()


# --- a real mesh ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["planar", "conical"])
def test_real_mesh_of_quads_and_triangles_becomes_exact(kind, data_folder):
    start = read_mesh(data_folder / "Intersection.off")
    assert np.bincount(start.topology.face_sizes).tolist() == [0, 0, 0, 64, 1632]
    assert planarity(start).max() > 0.01
    found = optimized(kind, start, reference_of(start))
    mesh = start.with_vertices(found.blocks["vertices"])
    assert found.converged
    assert planarity(mesh).max() <= 1e-11
    if kind == "conical":
        assert fitted_cones(mesh).misfit.max() <= 1e-10
    before, after = measures(start), measures(mesh)
    assert after["nonconvex_faces"] == after["flipped_faces"] == 0
    assert after["edge_min"] > 0.3 * before["edge_min"]
    far = np.linalg.norm(mesh.vertices - reference_of(start).closest(mesh.vertices)[0], axis=1)
    assert np.sqrt((far**2).mean()) < 0.03 * start.mean_edge_length
