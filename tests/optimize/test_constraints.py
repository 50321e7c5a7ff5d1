"""What a designer asks beside the kind: met to rounding, in any unit, or refused with the place."""

import numpy as np
import pytest
from shapes import curved_mesh

from pqmesh.errors import MeshError, SpecError
from pqmesh.io.formats import read_quad_mesh
from pqmesh.mesh.exact import grid_mesh, rotational_mesh
from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.optimize.constraints import (
    Axis,
    Constraints,
    Corners,
    Curve,
    EdgeLengths,
    Fixed,
    FlatPolylines,
    Glide,
    Level,
    Mirror,
    PanelSizes,
    Plane,
    Rotation,
    Within,
)
from pqmesh.optimize.polylines import Polylines
from pqmesh.optimize.problem import Goal
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.schedule import optimized
from pqmesh.optimize.selection import Where, selected
from pqmesh.optimize.solver import solve
from pqmesh.optimize.terms import Planarity
from pqmesh.surface.reference import TriangleReference

SIDE = 9


def dome(height, noise=0.02, seed=0):
    """Grid of 8 x 8 cells about 1 wide over a dome, vertices about 2 % of an edge astray."""
    x, y = np.meshgrid(np.linspace(-4, 4, SIDE), np.linspace(-4, 4, SIDE), indexing="ij")
    points = np.stack([x, y, height(x, y)], axis=-1)
    points += noise * np.random.default_rng(seed).normal(size=points.shape)
    return grid_mesh(points)


ROOF = dome(lambda x, y: 3 - 0.05 * x * x - 0.04 * y * y)
ROUND = dome(lambda x, y: 3 - 0.05 * (x * x + y * y))
# Vertex (i, j) has number 9 i + j: x rises with i, y with j.
WEST, SOUTH = np.arange(SIDE), SIDE * np.arange(SIDE)
MIDDLE = 40


def reference_of(mesh):
    return TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())


def solved(start, parts, kind="planar", **options):
    wanted = Constraints(parts)
    problem = problem_for(kind, start, reference_of(start), constraints=wanted, **options)
    found = solve(problem, start)
    return start.with_vertices(found.blocks["vertices"]), found


def scaled(mesh, unit):
    return mesh.with_vertices(unit * mesh.vertices)


# --- constraints as functions of the unit, and how far a mesh of unit 1 misses them -------------


def west(unit):
    """The western side, by its place."""
    return Where("boundary", box=unit * np.array([[-5, -5, -9], [-3.5, 5, 9]]))


ARC_X = np.linspace(-4.6, 4.6, 60)
ARC = np.stack([ARC_X, -4 - 0.3 * np.cos(ARC_X / 3), 2.36 - 0.05 * ARC_X**2], axis=-1)


def off_plane(points):
    """Distances of points from their best plane."""
    away = points - points.mean(axis=0)
    return np.abs(away @ np.linalg.svd(away)[2][2])


def to_polyline(points, chain):
    """Distances of points to a polyline, by brute force."""
    start, along = chain[:-1], np.diff(chain, axis=0)
    square = (along**2).sum(axis=1)
    share = np.clip(np.einsum("nsi,si->ns", points[:, None] - start, along) / square, 0, 1)
    places = start + share[:, :, None] * along
    return np.linalg.norm(points[:, None] - places, axis=2).min(axis=1)


def outside(sizes, least, most):
    return np.maximum(np.maximum(least - sizes, sizes - most), 0.0)


def rim_of(start):
    """The boundary of the start, as a closed polyline."""
    loop = start.topology.boundary_loops[0]
    return start.vertices[np.append(loop, loop[0])]


def widths(mesh):
    sides = np.linalg.norm(np.roll(mesh.corners, -1, axis=1) - mesh.corners, axis=2)
    return 0.5 * (sides[:, :2] + sides[:, 2:])


def spread_about(mesh, vertex, axis):
    along = mesh.face_normals[mesh.topology.star(vertex)[1]] @ axis / np.linalg.norm(axis)
    return np.ptp(along)


MIRRORED = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)[::-1].ravel()
TURNED = np.rot90(np.arange(SIDE * SIDE).reshape(SIDE, SIDE), -1).ravel()
TILTED = np.array([1.0, 0.0, 0.2]) / np.sqrt(1.04)

CASES = {
    "fixed": (
        ROOF,
        lambda unit: (Fixed((MIDDLE, MIDDLE + 1)),),
        lambda mesh: np.abs((mesh.vertices - ROOF.vertices)[MIDDLE : MIDDLE + 2]),
    ),
    "corners": (
        ROOF,
        lambda unit: (Corners(),),
        lambda mesh: np.abs((mesh.vertices - ROOF.vertices)[[0, 8, 72, 80]]),
    ),
    "glide": (
        ROOF,
        lambda unit: (Glide(),),
        lambda mesh: to_polyline(mesh.vertices[mesh.topology.is_boundary_vertex], rim_of(ROOF)),
    ),
    "curve": (
        ROOF,
        lambda unit: (Curve(tuple(SOUTH), unit * ARC),),
        lambda mesh: to_polyline(mesh.vertices[SOUTH], ARC),
    ),
    "level": (
        ROOF,
        lambda unit: (Level(west(unit), 1.5 * unit), Level((72,), 1.0 * unit)),
        lambda mesh: np.append(mesh.vertices[WEST, 2] - 1.5, mesh.vertices[72, 2] - 1.0),
    ),
    "plane": (
        ROOF,
        lambda unit: (Plane(west(unit), (-3.6 * unit, 0, 2 * unit), TILTED),),
        lambda mesh: (mesh.vertices[WEST] - [-3.6, 0, 2]) @ TILTED,
    ),
    "mirror": (
        ROOF,
        lambda unit: (Mirror((0, 0, 0), (1, 0, 0)),),
        lambda mesh: mesh.vertices[MIRRORED] * [-1, 1, 1] - mesh.vertices,
    ),
    "rotation": (
        ROUND,
        lambda unit: (Rotation((0, 0, 0), (0, 0, 1), 4),),
        # (x, y) -> (-y, x) takes vertex (i, j) to (8 - j, i).
        lambda mesh: mesh.vertices @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] - mesh.vertices[TURNED],
    ),
    "axis": (
        ROOF,
        lambda unit: (Axis((MIDDLE, 30, 50, 4), (0, 0.1, 1)),),
        lambda mesh: np.array([spread_about(mesh, v, [0, 0.1, 1]) for v in (MIDDLE, 30, 50, 4)]),
    ),
    "edge range": (
        ROOF,
        lambda unit: (EdgeLengths(0.99 * unit, 1.06 * unit),),
        lambda mesh: outside(mesh.edge_lengths, 0.99, 1.06),
    ),
    "longest edge": (
        ROOF,
        lambda unit: (EdgeLengths(most=1.05 * unit, vertices=tuple(range(45))),),
        lambda mesh: outside(mesh.edge_lengths[(mesh.edges < 45).all(axis=1)], 0, 1.05),
    ),
    "shortest edge": (
        ROOF,
        lambda unit: (EdgeLengths(least=0.99 * unit),),
        lambda mesh: outside(mesh.edge_lengths, 0.99, np.inf),
    ),
    "edges of their own": (
        ROOF,
        lambda unit: (EdgeLengths(0.99, 1.01, relative=True),),
        lambda mesh: outside(mesh.edge_lengths / ROOF.edge_lengths, 0.99, 1.01),
    ),
    "equal edges": (
        ROOF,
        lambda unit: (EdgeLengths(1.02 * unit, 1.02 * unit, vertices=tuple(SOUTH)),),
        lambda mesh: np.linalg.norm(np.diff(mesh.vertices[SOUTH], axis=0), axis=1) - 1.02,
    ),
    "panel width": (
        ROOF,
        lambda unit: (PanelSizes(0.99 * unit, 1.05 * unit),),
        lambda mesh: outside(widths(mesh), 0.99, 1.05),
    ),
    "panel area": (
        ROOF,
        lambda unit: (PanelSizes(least=1.0 * unit**2, measure="area"),),
        lambda mesh: outside(np.linalg.norm(mesh.face_area_vectors, axis=1), 1.0, np.inf),
    ),
    "within": (
        ROOF,
        lambda unit: (Within(0.015 * unit),),
        lambda mesh: outside(
            np.linalg.norm(
                mesh.vertices - reference_of(ROOF).closest(mesh.vertices)[0], axis=1
            ), 0, 0.015,
        ),
    ),
    "flat polylines": (
        ROOF,
        lambda unit: (FlatPolylines(),),
        lambda mesh: np.array([off_plane(mesh.vertices[p]).max() for p in mesh.topology.polylines]),
    ),
    "flat boundary": (
        ROOF,
        lambda unit: (FlatPolylines("boundary"),),
        lambda mesh: np.append(off_plane(mesh.vertices[WEST]), off_plane(mesh.vertices[SOUTH])),
    ),
    "flat line through a point": (
        ROOF,
        lambda unit: (FlatPolylines(through=[[0, 0.5 * unit, 3 * unit]]),),
        lambda mesh: off_plane(mesh.vertices[36:45]),
    ),
    "all at once": (
        ROOF,
        lambda unit: (
            Mirror((0, 0, 0), (1, 0, 0)),
            Level("corners", 1.5 * unit),
            FlatPolylines("boundary"),
            Within(0.2 * unit),
        ),
        lambda mesh: np.concatenate(
            [
                (mesh.vertices[MIRRORED] * [-1, 1, 1] - mesh.vertices).ravel(),
                mesh.vertices[[0, 8, 72, 80], 2] - 1.5,
                off_plane(mesh.vertices[WEST]),
            ]
        ),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_constraint_and_planarity_hold_to_rounding(name):
    start, parts, missed = CASES[name]
    mesh, found = solved(start, parts(1.0))
    assert found.converged
    # Hard goals have a tolerance of 1e-12 mean edges, about 1 here.
    assert np.abs(missed(mesh)).max() <= 1e-11
    assert planarity(mesh).max() <= 1e-11
    # Without the constraint it does not hold, or it would be no test.
    free, _ = solved(start, ())
    assert np.abs(missed(free)).max() > 1e-4


@pytest.mark.parametrize("name", CASES)
def test_result_is_the_same_in_metres_and_millimetres(name):
    start, parts, _ = CASES[name]
    metres, _ = solved(start, parts(1.0))
    millimetres, _ = solved(scaled(start, 1000.0), parts(1000.0))
    assert np.abs(millimetres.vertices / 1000.0 - metres.vertices).max() < 1e-7


def test_soft_constraint_pulls_the_more_the_larger_its_weight_whatever_the_unit():
    far = []
    for unit in (1.0, 1000.0):
        for weight in (1.0, 100.0, 1e4):
            part = Level(west(unit), 1.5 * unit, hard=False, weight=weight)
            mesh, found = solved(scaled(ROOF, unit), (part,))
            assert found.converged
            far.append(np.abs(mesh.vertices[WEST, 2] / unit - 1.5).max())
    assert far[0] > 2 * far[1] > 4 * far[2] > 0
    assert np.allclose(far[:3], far[3:], rtol=1e-6)


def test_axis_of_a_conical_mesh_is_the_one_prescribed():
    mesh, found = solved(ROOF, (Axis((MIDDLE,), (0.01, 0.02, 1)),), kind="conical")
    assert found.converged
    normals = mesh.face_normals[mesh.topology.star(MIDDLE)[1]]
    vector = np.linalg.lstsq(normals, np.ones(4), rcond=None)[0]
    assert np.linalg.norm(np.cross(vector, [0.01, 0.02, 1])) < 1e-10


def test_vertices_stay_on_a_curve_with_kinks_and_ends():
    # A zigzag of right angles, too short for the side: its ends hold the last vertices.
    zigzag = np.array([[-3.8, -4.2, 2], [-2, -3.9, 2.2], [0, -4.3, 2.4], [2, -3.9, 2.2],
                       [3.9, -4.1, 2]])  # fmt: skip
    mesh, found = solved(ROOF, (Curve(tuple(SOUTH), zigzag),))
    assert found.converged
    assert to_polyline(mesh.vertices[SOUTH], zigzag).max() < 1e-11
    assert planarity(mesh).max() <= 1e-11


def test_flat_polyline_chooses_its_plane_and_does_not_keep_the_first():
    # A side on a tilted plane turns the plane of the line beside it, too.
    start = dome(lambda x, y: 3 - 0.05 * x * x - 0.04 * y * y, noise=0.1, seed=3)
    line = np.arange(36, 45)
    mesh, found = solved(start, (FlatPolylines(through=[[0.0, 0.5, 3]]),))
    assert found.converged
    away = start.vertices[line] - start.vertices[line].mean(axis=0)
    first = np.linalg.svd(away)[2][2]
    now = np.linalg.svd(mesh.vertices[line] - mesh.vertices[line].mean(axis=0))[2][2]
    turned = np.degrees(np.arccos(min(abs(first @ now), 1.0)))
    assert turned > 0.1
    assert off_plane(mesh.vertices[line]).max() < 1e-11


def test_real_shell_stands_on_the_ground_and_is_symmetric(data_folder):
    start = read_quad_mesh(data_folder / "conical1.obj")
    length = start.mean_edge_length
    feet = Where("boundary", level=0.0, distance=0.35)
    parts = (Level(feet, 0.0), Mirror((0, 0, 0), (1, 0, 0), tolerance=0.5))
    mesh, found = solved(start, parts)
    assert found.converged
    rows = selected(feet, start)
    assert len(rows) > 50
    assert np.abs(start.vertices[rows, 2]).max() > 0.1 * length
    assert np.abs(mesh.vertices[rows, 2]).max() <= 1e-10 * length
    mirrored = mesh.vertices * [-1, 1, 1]
    gaps = np.linalg.norm(mirrored[:, None] - mesh.vertices, axis=2).min(axis=1)
    assert gaps.max() <= 1e-10 * length
    assert planarity(mesh).max() <= 1e-11


def test_real_roof_has_a_line_in_one_plane(data_folder):
    start = read_quad_mesh(data_folder / "conical1.obj")
    point = start.vertices[600]
    mesh, found = solved(start, (FlatPolylines(through=[point]),))
    assert found.converged
    chains = [c for c in start.topology.polylines if (start.vertices[c] == point).all(1).any()]
    off = [off_plane(mesh.vertices[c]).max() for c in chains]
    assert min(off) <= 1e-10 * start.mean_edge_length
    assert planarity(mesh).max() <= 1e-11


# --- the boundary ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["six.off", "formfinding-circular.off", "conical1.obj"])
def test_real_mesh_with_gliding_boundary_is_planar_and_on_the_curve(name, data_folder):
    start = read_quad_mesh(data_folder / name)
    found = optimized("planar", start, reference_of(start), boundary="glide")
    assert found.converged
    mesh = start.with_vertices(found.blocks["vertices"])
    assert planarity(mesh).max() <= 1e-11
    rim = start.topology.is_boundary_vertex
    far = np.full(int(rim.sum()), np.inf)
    for loop in start.topology.boundary_loops:
        chain = start.vertices[np.append(loop, loop[0])]
        far = np.minimum(far, to_polyline(mesh.vertices[rim], chain))
    assert far.max() <= 1e-11 * start.mean_edge_length
    assert np.abs(mesh.vertices - start.vertices)[rim].max() > 1e-6 * start.mean_edge_length


@pytest.mark.slow
def test_boundary_of_steps_names_the_faces_that_it_forbids(data_folder):
    start = read_quad_mesh(data_folder / "inspired_mesh_quads_Conjugate.off")
    found = optimized("planar", start, reference_of(start), boundary="glide")
    assert not found.converged
    assert "(4 such: 1476, 2, 1527, 26)" in found.reason
    mesh = start.with_vertices(found.blocks["vertices"])
    rest = np.delete(planarity(mesh), [2, 26, 1476, 1527])
    assert rest.max() <= 1e-11


def test_face_held_by_the_boundary_is_named_and_the_rest_becomes_planar():
    # A strip one face wide between two wider parts: faces 1 and 2 have no free corner.
    start = curved_mesh(4, 4)
    hole = QuadMesh.of(*_without(start, [4, 5, 6, 8, 9, 10]))
    found = optimized("planar", hole, reference_of(hole), boundary="fixed")
    assert not found.converged
    assert "held by the boundary at all their vertices: face " in found.reason
    mesh = hole.with_vertices(found.blocks["vertices"])
    stuck = hole.topology.is_boundary_vertex[hole.faces].all(axis=1)
    assert stuck.any()
    assert f"({stuck.sum()} such" in found.reason
    assert found.residuals["planarity"] > 1e-3
    assert planarity(mesh)[~stuck].max(initial=0.0) <= 1e-11


def test_faces_that_the_boundary_forbids_have_their_own_numbers_beside_triangles_and_polygons():
    points = [[-1, 0.5, 0], [0, 0, 0], [0, 1, 0.3], [1, 0, 0], [1, 1, 0], [2, 0, 0.2], [2, 1, 0],
              [3, 0, 0], [4, 0.5, 0.2], [3, 1, 0.3]]  # fmt: skip
    faces = [[0, 1, 2], [1, 3, 4, 2], [3, 5, 6, 4], [5, 7, 8, 9, 6]]
    strip = PolyMesh.of(points, faces)
    found = optimized("circular", strip, reference_of(strip), boundary="fixed")
    assert not found.converged
    assert "face 1 (1, 3, 4, 2) is not flat" in found.reason
    assert "(2 such: 1, 2)" in found.reason
    assert "face 3 (5, 7, 8, 9, 6) is not flat, its corners are" in found.reason
    assert "face 3 (5, 7, 8, 9, 6) has no circle" in found.reason


def skew_bowl():
    """A net that is not conjugate, on a bowl."""
    x, y = np.meshgrid(np.linspace(-2, 2, 9), np.linspace(-2, 2, 9), indexing="ij")
    height = 0.4 * x * x - 0.1 * x * y + 0.25 * y * y + 0.05 * np.sin(3 * x + 1)
    return grid_mesh(np.stack([x, y, height], axis=-1))


def test_distance_that_no_pull_reaches_is_kept_by_a_bound():
    start = skew_bowl()
    free = optimized("planar", start, reference_of(start))
    asked = 0.4 * far_from(start, free)
    found = optimized("planar", start, reference_of(start), within=asked)
    assert found.converged
    assert far_from(start, found) <= asked
    assert planarity(start.with_vertices(found.blocks["vertices"])).max() <= 1e-11


def test_distance_that_a_fixed_rim_forbids_leaves_the_best_mesh():
    start = skew_bowl()
    above = start.with_vertices(start.vertices + np.array([0.0, 0.0, 0.3]))
    found = optimized("planar", start, reference_of(above), boundary="fixed", within=0.05)
    assert found.converged
    rim = start.topology.is_boundary_vertex
    assert (found.blocks["vertices"][rim] == start.vertices[rim]).all()


def far_from(surface, found):
    """Largest distance of the vertices of a solution to a mesh."""
    vertices = found.blocks["vertices"]
    return np.linalg.norm(reference_of(surface).closest(vertices)[0] - vertices, axis=1).max()


def _without(mesh, gone):
    faces = np.delete(mesh.faces, gone, axis=0)
    used, flat = np.unique(faces, return_inverse=True)
    return mesh.vertices[used], flat.reshape(-1, 4)


def test_mesh_without_room_within_its_boundary_names_the_worst_faces(data_folder):
    # Lines along asymptotic directions: flat faces need another surface, and another rim.
    start = read_quad_mesh(data_folder / "hypar.obj")
    found = optimized("planar", start, reference_of(start), boundary="glide")
    assert not found.converged
    mesh = start.with_vertices(found.blocks["vertices"])
    worst = np.argsort(-planarity(mesh) * np.linalg.norm(
        mesh.corners[:, 2:] - mesh.corners[:, :2], axis=2).mean(axis=1))  # fmt: skip
    assert f"the worst are {worst[0]}, {worst[1]}" in found.reason
    assert "faces are not flat" in found.reason


# --- selections and curves ------------------------------------------------------------------


def test_vertices_are_selected_by_group_box_level_and_curve():
    assert selected("corners", ROOF).tolist() == [0, 8, 72, 80]
    assert len(selected("boundary", ROOF)) == 32
    assert len(selected("inside", ROOF)) == 49
    assert selected((5, 3, 3), ROOF).tolist() == [3, 5]
    assert selected(west(1.0), ROOF).tolist() == WEST.tolist()
    assert selected(Where(curve=ARC, distance=0.5), ROOF).tolist() == SOUTH.tolist()
    top = selected(Where("inside", level=3.0, distance=0.1), ROOF)
    assert MIDDLE in top
    assert np.abs(ROOF.vertices[top, 2] - 3.0).max() <= 0.1


@pytest.mark.parametrize("seed", range(3))
def test_nearest_segments_are_those_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    chains = [rng.normal(size=(n, 3)).cumsum(axis=0) for n in (2, 40, 7)]
    # One segment far longer than the others.
    chains[1][-1] += 60.0
    lines = Polylines.of(chains)
    points = rng.normal(size=(200, 3)) * 10.0
    gaps = lines.gaps(points, lines.nearest(points))
    least = np.min([to_polyline(points, chain) for chain in chains], axis=0)
    assert np.abs(gaps - least).max() < 1e-12
    walked = lines.walked(points, lines.nearest(points))
    assert np.abs(lines.gaps(points, walked) - least).max() < 1e-12


# --- refusals -------------------------------------------------------------------------------

FLAT = object()
CROOKED = dome(lambda x, y: 3 - 0.05 * x * x - 0.04 * y * y)
REFUSED = {
    r"weight of a constraint \(level\) must be a finite number above 0; found 0": lambda: Level(
        "corners", 1.0, weight=0.0
    ),
    r"weight of a constraint \(fixed\).*found -1": lambda: Fixed("corners", weight=-1.0),
    "weight.*found nan": lambda: Glide(weight=float("nan")),
    "height of a level must be finite; found nan": lambda: Level("corners", float("nan")),
    "An axis of nodes must have a length above 0": (lambda: Axis((1,), (0, 0, 0))),
    "normal of a plane must have a length above 0": lambda: Plane((1,), (0, 0, 0), (0, 0, 0)),
    "normal of a mirror must have a length above 0": lambda: Mirror((0, 0, 0), (1e-320, 0, 0)),
    "curve for vertices must be at least 2 points of 3 coordinates; found 7": (
        lambda: Curve((1,), 7)
    ),
    "least must not exceed most; found 2 and 1": lambda: EdgeLengths(2.0, 1.0),
    "needs least or most; found neither": lambda: PanelSizes(),
    "bound of panel sizes must be a finite number above 0": lambda: PanelSizes(least=0.0),
    "measure of panels must be one of width, area": lambda: PanelSizes(1.0, measure="weight"),
    "group of vertices must be one of all, boundary": lambda: Fixed("border"),
    "list of vertices must be whole numbers": lambda: Fixed((1.5,)),
    "order of a rotation must be a whole number from 2 to 1000": (
        lambda: Rotation((0, 0, 0), (0, 0, 1), 1)
    ),
    "at least four different vertices": lambda: FlatPolylines([[1, 2, 3, 1]]),
    "distance from the surface is a bound, so it is hard": lambda: Within(1.0, hard=False),
    "distance from the surface must be a finite number above 0": lambda: Within(-1.0),
    "curve for vertices must be at least 2 points": lambda: Curve((1,), [[0, 0, 0]]),
    "points of a curve must differ": lambda: Curve((1,), [[0, 0, 0], [0, 0, 0], [1, 0, 0]]),
    "must have finite coordinates below 1e\\+50; point 1 is": lambda: Curve(
        (1,), [[0, 0, 0], [0, 0, np.inf]]
    ),
    "box must be its lowest and its highest corner": (
        lambda: Fixed(Where(box=[[1, 0, 0], [0, 1, 1]]))
    ),
    "distance above 0 belongs to a level or a curve": lambda: Fixed(Where(level=1.0)),
    "turn of a corner must be an angle from 0 to below 180": lambda: Corners(turn=4.0),
}


@pytest.mark.parametrize("text", REFUSED)
def test_value_that_makes_no_sense_is_refused_with_what_was_found(text):
    with pytest.raises(SpecError, match=text):
        REFUSED[text]()


CONTRADICTIONS = {
    r"numbered 0\.\.80; a constraint names 81": (Fixed((81,)),),
    "none of the 81 vertices is of the group 'all' and in the box": (
        Fixed(Where(box=[[90, 90, 90], [91, 91, 91]])),
    ),
    r"vertex 72 misses the level by 0\.5": (
        Fixed((72,)),
        Level((72,), CROOKED.vertices[72, 2] - 0.5),
    ),
    r"planes and levels of vertex 3 have none: the nearest point misses one by 0\.5": (
        Level((3,), 1.0),
        Level((3,), 2.0),
    ),
    "vertex 4 misses the curve by": (Fixed((4,)), Curve((4,), [[0, 0, 0], [1, 0, 0]])),
    r"curve and the planes of a vertex must meet; the curve of vertex 5 stays 1 away": (
        Curve((5,), [[0, 0, 0], [1, 0, 0]]),
        Level((5,), 1.0),
    ),
    r"face 0 \(0, 9, 10, 1\) is not flat, its diagonals are 0\.0": (Fixed((0, 1, 9, 10)),),
    "takes vertex 0 to .*, and the nearest vertex lies": (Mirror((9, 0, 0), (1, 0, 0)),),
    "mirror takes vertex .* raise the tolerance": (Mirror((0, 0, 0), (1, 0.2, 0)),),
    r"vertex 72 is 0\.\d+ away from the image of its partner 0|vertex 0 is .* partner 72": (
        Fixed((0, 72)),
        Mirror((0, 0, 0), (1, 0, 0)),
    ),
    r"edge 0-1 \(edge lengths\) is out of range": (Fixed((0, 1)), EdgeLengths(2.0, 3.0)),
    "vertex 40 has another axis": FLAT,
    "no edge has all its vertices among the 2": (EdgeLengths(1.0, vertices=(0, 80)),),
    "vertex 40 lies inside": (Glide((40,)),),
    "A node axis must have two faces or more at its vertex; vertex 0 has one": (
        Axis((0,), (0, 0, 1)),
    ),
    "takes vertex .* near itself, .* from the axis": (Rotation((0, 0, 0), (0, 0, 1), 1000),),
    "Flat polylines must be at least one of more than three vertices": None,
}


@pytest.mark.parametrize("text", CONTRADICTIONS)
def test_contradiction_is_found_before_the_run_and_named(text):
    parts, start = CONTRADICTIONS[text], CROOKED
    if parts is FLAT:
        # Flat faces about an upright axis.
        parts = (Fixed(tuple(range(30, 51))), Axis((40,), (1, 0, 1)))
        start = dome(lambda x, y: 0.1 * np.maximum(x, 0) + 0.1 * np.maximum(y, 0), noise=0.0)
    if parts is None:
        parts, start = (FlatPolylines(),), curved_mesh(2, 2)
    with pytest.raises(SpecError, match=text):
        problem_for("planar", start, reference_of(start), constraints=Constraints(parts))


def test_conical_vertex_whose_star_is_fixed_is_named():
    rows = (30, 31, 32, 39, 40, 41, 48, 49, 50)
    flat = rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2], [2.4, 2]], [0.0, 0.3, 0.8, 1.0])
    with pytest.raises(SpecError, match=r"vertex 5 has no cone, its angles are off by .* rad"):
        problem_for(
            "conical",
            flat,
            reference_of(flat),
            constraints=Constraints((Fixed((0, 1, 2, 4, 5, 6, 8, 9, 10)),)),
        )
    with pytest.raises(SpecError, match=r"face .* is not flat"):
        problem_for("conical", ROOF, reference_of(ROOF), constraints=Constraints((Fixed(rows),)))


def test_flat_fixed_face_contradicts_nothing():
    flat = dome(lambda x, y: 0.1 * x, noise=0.0)
    mesh, found = solved(flat, (Fixed((0, 1, 9, 10)),))
    assert found.converged
    assert planarity(mesh).max() < 1e-11


@pytest.mark.parametrize("weight", [0.0, -1.0, float("nan"), float("inf")])
def test_goal_refuses_a_weight_that_is_no_number_above_zero(weight):
    with pytest.raises(SpecError, match="A weight must be a finite number above 0; that of 'x'"):
        Goal("x", Planarity.on(ROOF), weight)


def test_goal_refuses_a_slack_below_zero():
    with pytest.raises(SpecError, match="The slack of a goal must be a finite number"):
        Goal("x", Planarity.on(ROOF), slack=-1.0)


def test_far_away_constraints_mean_the_same_places():
    start = curved_mesh(6, 5)
    rim = start.vertices[selected("boundary", start)]
    curve = rim[:2] + np.array([[0, 0, 0.01], [0, 0, 0.02]])
    wanted = Constraints(
        (
            Level(Where(box=[[-9, -9, -9], start.vertices[6] + 1e-6]), 0.1, weight=0.5, hard=False),
            Plane([len(start.vertices) - 1], start.vertices[-1] + [0.0, 0.01, 0.0], (0, 1, 0)),
            Curve([0], curve, hard=False),
            FlatPolylines(through=start.vertices[14:15]),
            EdgeLengths(least=0.5, relative=True),
        )
    )
    shift = np.array([3e6, -2e6, 5e5])
    here = optimized("planar", start, reference_of(start), constraints=wanted)
    moved = start.with_vertices(start.vertices + shift)
    there = optimized(
        "planar", moved, reference_of(moved), constraints=wanted.about(-shift), boundary="free"
    )
    assert here.converged
    assert there.converged
    # The start there is rounded to 5e-10.
    assert np.abs(there.blocks["vertices"] - shift - here.blocks["vertices"]).max() < 5e-7


def with_a_quad_split():
    """A bowl of 3 x 3 faces, the first in two triangles, and its vertices without one of theirs."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij")
    quads = grid_mesh(np.stack([x, y, 0.1 * (x * x + y * y)], axis=-1))
    a, b, c, d = quads.faces[0].tolist()
    faces = [[a, b, c], [a, c, d], *quads.faces[1:].tolist()]
    return PolyMesh.of(quads.vertices, faces), tuple(range(1, 16))


@pytest.mark.parametrize("measure", ["width", "area"])
def test_sizes_of_quads_are_kept_beside_triangles(measure):
    mesh, vertices = with_a_quad_split()
    reference = TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())
    wide = PanelSizes(1.1, 1.2, measure, vertices=vertices)
    found = optimized("planar", mesh, reference, constraints=Constraints((wide,)))
    assert found.converged
    corners = found.blocks["vertices"][
        [face for face in mesh.topology.face_lists() if len(face) == 4]
    ]
    lengths = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    sizes = 0.5 * (lengths[:, :2] + lengths[:, 2:])
    if measure == "area":
        across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        sizes = 0.5 * np.linalg.norm(across, axis=1)
    assert 1.1 - 1e-9 < sizes.min() <= sizes.max() < 1.2 + 1e-9


def test_sizes_of_panels_that_are_no_quads_are_refused_by_name():
    mesh, _ = with_a_quad_split()
    reference = TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())
    asked = Constraints((PanelSizes(1.1),))
    with pytest.raises(MeshError, match="where panel sizes are asked for; 2 of 10 are not, the fi"):
        optimized("planar", mesh, reference, constraints=asked)
