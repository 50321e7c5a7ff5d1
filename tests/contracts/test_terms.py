"""What every term of the registry must keep, and that a term from outside is as good as ours."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from shapes import (
    crown,
    curved_mesh,
    dodecahedron,
    lantern,
    polygon_mesh,
    random_rotation,
    vertex_fan,
    zoo,
)

from pqmesh.errors import MeshError
from pqmesh.mesh import solids
from pqmesh.mesh.exact import mirror_plane_mesh, rotational_mesh, stereographic_mesh
from pqmesh.mesh.measure import circularity_defect, conicality_defect, planarity
from pqmesh.mesh.quadmesh import QuadMesh
from pqmesh.optimize.problem import ByItself, Goal, Problem, Refreshing, Term, gathered
from pqmesh.optimize.recipes import problem_for
from pqmesh.optimize.solver import solve
from pqmesh.optimize.terms import TERMS, Cone, PlanarPolyline
from pqmesh.optimize.terms.sizes import Range
from pqmesh.surface.reference import TriangleReference

# --- how each constructor is called -----------------------------------------------------------


def reference_of(mesh):
    return TriangleReference.of_polygons(mesh.vertices, mesh.topology.face_lists())


@dataclass(frozen=True)
class Ball:
    """A sphere around the first vertex: smooth, so the nearest point is never a matter of luck."""

    center: np.ndarray
    radius: float

    def closest(self, points):
        away = points - self.center
        normals = away / np.linalg.norm(away, axis=1, keepdims=True)
        return self.center + self.radius * normals, normals, self


def ball_of(mesh):
    return Ball(2 * mesh.vertices[0] - mesh.vertices[-1], 3.0 * mesh.mean_edge_length)


def boundary_of(mesh):
    return np.flatnonzero(mesh.topology.is_boundary_vertex)


def every(rows):
    return np.arange(len(rows))


def frame_of(mesh):
    """A point, a direction and a matrix that move with the mesh."""
    point, one, other = mesh.vertices[:3]
    direction = one - point
    mirror = np.eye(3) - 2.0 * np.outer(direction, direction) / (direction @ direction)
    return point + 0.3 * (other - point), direction, mirror


def curves_of(mesh):
    """A drawn curve that crosses the mesh and a closed one, away from the vertices."""
    open_one = mesh.vertices[: len(mesh.vertices) // 2] + 0.2 * frame_of(mesh)[1]
    ring = mesh.vertices[mesh.topology.face(mesh.topology.n_faces - 1)] + 0.3 * frame_of(mesh)[1]
    return [open_one, np.vstack([ring, ring[:1]])]


def chains_of(mesh):
    """Chains of at least four vertices, the closed ones repeating their first."""
    return [chain for chain in mesh.topology.polylines if len(chain) > 4] or [every(mesh.vertices)]


def inner_edges_of(mesh):
    return np.flatnonzero(~mesh.topology.is_boundary_vertex[mesh.edges].any(axis=1))


def range_of(mesh, power=1):
    return Range.of(0.6 * mesh.mean_edge_length**power, None, mesh.mean_edge_length**power)


ON_CURVES = ("gliding", "on_curve")
# What each constructor takes beside the mesh, as a function of the mesh.
ARGUMENTS = {
    "closeness": lambda mesh: (reference_of(mesh),),
    "within": lambda mesh: (reference_of(mesh), 1e-3 * mesh.mean_edge_length),
    "gliding": lambda mesh: (boundary_of(mesh),),
    "on_curve": lambda mesh: (every(mesh.vertices), curves_of(mesh)),
    "on_planes": lambda mesh: (every(mesh.vertices), *frame_of(mesh)[:2]),
    "planar_polyline": lambda mesh: (chains_of(mesh),),
    "symmetry": lambda mesh: (mesh.edges, frame_of(mesh)[2], frame_of(mesh)[0]),
    "node_axis": lambda mesh: (every(mesh.vertices), frame_of(mesh)[1]),
    "edge_length": lambda mesh: (
        Range.of(0.5 * mesh.mean_edge_length, mesh.mean_edge_length, mesh.mean_edge_length),
        every(mesh.edges),
    ),
    "edge_parallel": lambda mesh: (inner_edges_of(mesh),),
    "panel_width": lambda mesh: (range_of(mesh), np.arange(mesh.topology.n_faces)),
    "panel_area": lambda mesh: (range_of(mesh, 2), np.arange(mesh.topology.n_faces)),
}


def built(name, mesh, start=None):
    """The term on a mesh; a second argument belongs to `start`, by default the mesh itself."""
    if name in ("closeness", "within") and start is not None:
        return TERMS[name](mesh, ball_of(start), *ARGUMENTS[name](mesh)[1:])
    return TERMS[name](mesh, *ARGUMENTS.get(name, lambda mesh: ())(mesh))


def blocks_of(mesh):
    return {
        "vertices": mesh.vertices,
        "axes": Cone.start_axes(mesh, every(mesh.vertices)),
        "planes": PlanarPolyline.start_planes(mesh, chains_of(mesh)),
    }


def noisy(mesh, share=0.03, seed=0):
    rng = np.random.default_rng(seed)
    step = share * mesh.mean_edge_length * rng.normal(size=mesh.vertices.shape)
    return mesh.with_vertices(mesh.vertices + step)


def fan(k):
    """A curved vertex of valence k in the middle."""
    turn = 2 * np.pi * np.arange(k) / k
    return vertex_fan(np.column_stack([np.cos(turn), np.sin(turn), np.full(k, -0.3)]))


MESHES = {
    "polygons": polygon_mesh(),
    "crown": crown(),
    "lantern": lantern(),
    "dodecahedron": dodecahedron(),
    "grid": curved_mesh(4, 3),
    "annulus": zoo()["annulus"][0],
    "torus": zoo()["torus"][0],
    "cube": solids.cube(),
    "valences_3_4_5": solids.deltoidal_hexecontahedron(),
    "valence_5": fan(5),
    "valence_6": fan(6),
    "window": zoo()["window"][0],
}
QUADS_ONLY = ("node_axis", "panel_width", "panel_area")
# A closed mesh has no boundary curve to glide on.
PAIRS = [
    (name, key)
    for name in TERMS
    for key, mesh in MESHES.items()
    if (name != "gliding" or mesh.topology.is_boundary_vertex.any())
    and (name not in QUADS_ONLY or mesh.topology.is_quad)
]
every_term_and_mesh = pytest.mark.parametrize(("name", "key"), PAIRS)


@pytest.mark.parametrize("name", QUADS_ONLY)
def test_term_of_quads_refuses_other_faces(name):
    with pytest.raises(MeshError, match="Every face must be a quad"):
        built(name, MESHES["polygons"])


# --- shape and stencils -----------------------------------------------------------------------


@every_term_and_mesh
def test_term_has_stencils_of_valid_rows_and_matching_shapes(name, key):
    mesh = noisy(MESHES[key])
    term, blocks = built(name, mesh), blocks_of(mesh)
    assert isinstance(term, Term)
    counts = {len(rows) for rows in term.stencils.values()}
    assert len(counts) == 1
    for block, rows in term.stencils.items():
        assert np.issubdtype(rows.dtype, np.integer)
        assert rows.ndim == 2
        if rows.size:
            assert rows.min() >= 0
            assert rows.max() < len(blocks[block])
    rows = gathered(term, blocks)
    before = rows.copy()
    value, jacobian = term.evaluate(rows)
    m, k = rows.shape[:2]
    assert m == counts.pop()
    assert value.shape[0] == m
    assert jacobian.shape == (*value.shape, k, 3)
    assert np.isfinite(value).all()
    assert np.isfinite(jacobian).all()
    # Input is not touched, and the same input gives the same answer.
    assert (rows == before).all()
    assert (term.evaluate(rows)[0] == value).all()
    if isinstance(term, ByItself):
        assert np.abs(term.residual(rows) - value).max(initial=0.0) < 1e-14


def test_every_term_acts_on_some_mesh():
    for name in TERMS:
        assert any(
            len(next(iter(built(name, MESHES[key]).stencils.values())))
            for other, key in PAIRS
            if other == name
        )


def test_cone_acts_above_valence_four_only():
    # Three planes always touch a cone, four are balanced by angles.
    assert len(Cone.on(MESHES["cube"]).stencils["axes"]) == 0
    assert len(Cone.on(MESHES["grid"]).stencils["axes"]) == 0
    assert len(Cone.on(MESHES["valences_3_4_5"]).stencils["axes"]) == 12 * 5


# --- Jacobian ---------------------------------------------------------------------------------


def differences(term, rows, step):
    """Derivatives (m, r, k, 3) by central differences, extrapolated once (error step^4)."""

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


def near_an_end(term, rows, distance):
    """Elements that come near an end of their segment, where the residual has a kink."""
    start, end = term.curves.starts[term.segments], term.curves.ends[term.segments]
    along = end - start
    length = np.linalg.norm(along, axis=1)
    place = np.einsum("ni,ni->n", rows[:, 0] - start, along) / length
    return np.minimum(np.abs(place), np.abs(place - length)) < distance


@every_term_and_mesh
@pytest.mark.parametrize("seed", [0, 1])
def test_jacobian_equals_central_differences(name, key, seed):
    # The term is built on one mesh and evaluated on another: no residual is zero by luck.
    start = noisy(MESHES[key], seed=seed)
    mesh = noisy(start, seed=seed + 10)
    # The distance to facets has kinks where two are equally near.
    term = built(name, start, start if name == "within" else None)
    rows = gathered(term, blocks_of(mesh))
    if not len(rows):
        return
    step = 1e-3 * mesh.mean_edge_length
    smooth = ~near_an_end(term, rows, 2.5 * step) if name in ON_CURVES else np.full(len(rows), True)
    assert smooth.mean() > 0.5
    jacobian = term.evaluate(rows)[1][smooth]
    found = differences(term, rows, step)[smooth]
    # Fourth-order differences at a thousandth of an edge: 1e-11 from truncation, 1e-12 from
    # rounding; 1e-7 leaves room for the short edges of the solids.
    assert np.abs(jacobian - found).max() < 1e-7 * np.abs(jacobian).max()


# --- moves and scale --------------------------------------------------------------------------


@every_term_and_mesh
@pytest.mark.parametrize("scale", [1.0, 1000.0, 1e-3])
def test_residuals_stay_when_mesh_and_reference_move_and_scale_together(name, key, scale):
    rng = np.random.default_rng(5)
    turn, shift = random_rotation(rng), rng.normal(size=3)
    start = noisy(MESHES[key])
    mesh = noisy(start, seed=1)

    def placed(each):
        return each.with_vertices(scale * (each.vertices @ turn.T + shift))

    plain, other = built(name, mesh, start), built(name, placed(mesh), placed(start))
    value = plain.evaluate(gathered(plain, blocks_of(mesh)))[0]
    image = other.evaluate(gathered(other, blocks_of(placed(mesh))))[0]
    if name in ("held_edges", "fairness", "anchor"):
        # Built on the mesh they are zero; vectors turn with the mesh, so their length counts.
        plain, other = built(name, start), built(name, placed(start))
        value = plain.evaluate(gathered(plain, blocks_of(mesh)))[0]
        image = other.evaluate(gathered(other, blocks_of(placed(mesh))))[0]
        value, image = (np.linalg.norm(each, axis=1) for each in (value, image))
        assert value.max(initial=1.0) > 1e-3
    if name in (*ON_CURVES, "symmetry", "edge_parallel"):
        value, image = (np.linalg.norm(each, axis=1) for each in (value, image))
    # Rounding of coordinates a few edges from the origin, at corners of down to a degree.
    assert np.abs(value - image).max(initial=0.0) < 1e-12


# --- exact meshes -----------------------------------------------------------------------------

CONICAL = {
    "rotational": rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], 0.3 * np.arange(5)),
    "mirrors": mirror_plane_mesh(
        [[1, 0.2, z, 2 + 0.1 * z * z] for z in (-0.6, -0.1, 0.3, 0.8)],
        [[-0.5, 1, 0, 0.1], [-1, 1, 0.1, 0], [-1.5, 1, 0, 0]],
    ),
    "rhombic_triacontahedron": solids.rhombic_triacontahedron(),
    "deltoidal_hexecontahedron": solids.deltoidal_hexecontahedron(),
    "trapezohedron": solids.trapezohedron(6),
}
CIRCULAR = {
    "rotational": rotational_mesh([[2, 0], [2.4, 0.5], [2.5, 1.2]], [0, 0.2, 0.6, 0.9]),
    "stereographic": stereographic_mesh([-0.5, -0.2, 0.1, 0.5], [-0.4, 0.0, 0.3]),
}


def largest(name, mesh):
    term = built(name, mesh)
    return np.abs(term.evaluate(gathered(term, blocks_of(mesh)))[0]).max(initial=0.0)


@pytest.mark.parametrize("key", CONICAL)
@pytest.mark.parametrize("name", ["planarity", "conicality", "cone"])
def test_conical_terms_vanish_on_exact_conical_mesh(name, key):
    # Vertices are intersections of planes some 20 degrees apart: rounding times 100.
    assert largest(name, CONICAL[key]) < 1e-12
    assert largest(name, noisy(CONICAL["rotational"])) > 1e-3 or name == "cone"


@pytest.mark.parametrize("key", CIRCULAR)
@pytest.mark.parametrize("name", ["planarity", "circularity"])
def test_circular_terms_vanish_on_exact_circular_mesh(name, key):
    # A few roundings.
    assert largest(name, CIRCULAR[key]) < 1e-13
    assert largest(name, noisy(CIRCULAR[key])) > 1e-3


@pytest.mark.parametrize("key", MESHES)
def test_relative_terms_vanish_on_the_mesh_they_are_built_on(key):
    mesh = noisy(MESHES[key])
    for name in ("held_edges", "fairness", "anchor", "closeness", "gliding"):
        if (name, key) in PAIRS:
            # A foot point on a triangle of the mesh itself: rounding.
            assert largest(name, mesh) < 1e-14


def test_geometric_terms_are_the_measures_of_the_mesh():
    mesh = noisy(MESHES["grid"])
    blocks = blocks_of(mesh)

    def values(name):
        term = built(name, mesh)
        return term.evaluate(gathered(term, blocks))[0][:, 0]

    diagonals = mesh.corners[:, 2:] - mesh.corners[:, :2]
    size = np.linalg.norm(diagonals, axis=2).mean(axis=1) / mesh.mean_edge_length
    # Two formulas for one number.
    assert np.allclose(np.abs(values("planarity")), planarity(mesh) * size, rtol=0, atol=1e-14)
    assert np.allclose(values("conicality"), conicality_defect(mesh)[1], rtol=0, atol=1e-14)
    assert np.allclose(values("circularity"), circularity_defect(mesh), rtol=0, atol=1e-14)


# --- terms that follow ------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["closeness", "within"])
def test_refreshed_term_measures_the_distance_of_the_current_vertices(name):
    start = MESHES["grid"]
    mesh = noisy(start, 0.02)
    term = built(name, start).refreshed(blocks_of(mesh))
    assert isinstance(term, Refreshing)
    for block, rows in built(name, start).stencils.items():
        assert (term.stencils[block] == rows).all()
    rows = gathered(term, blocks_of(mesh))
    value = np.linalg.norm(term.evaluate(rows)[0], axis=1) * start.mean_edge_length
    distance = np.linalg.norm(rows[:, 0] - term.feet, axis=1)
    # Never more than the true distance: the tangent plane passes through the foot.
    assert (value <= distance * (1 + 2e-2) + 1e-12).all()
    assert value.max() > 1e-3
    if name == "within":
        # Beyond the rim, too.
        assert np.allclose(value, distance, rtol=0, atol=1e-13)


@pytest.mark.parametrize("name", ON_CURVES)
def test_refreshed_term_measures_the_distance_to_the_curve(name):
    start = MESHES["grid"]
    mesh = noisy(start, 0.02)
    term = built(name, start).refreshed(blocks_of(mesh))
    assert isinstance(term, Refreshing)
    points = gathered(term, blocks_of(mesh))[:, 0]
    value = np.linalg.norm(term.evaluate(points[:, None])[0], axis=1) * start.mean_edge_length
    segments = np.stack([term.curves.starts, term.curves.ends], axis=1)
    least = [min(distance_to_segment(point, *ends) for ends in segments) for point in points]
    # Found by walking along from the start, and by brute force.
    assert np.abs(value - least).max() < 1e-14 * start.mean_edge_length
    assert max(least) > 1e-3


def distance_to_segment(point, start, end):
    along = end - start
    share = np.clip((point - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(point - start - share * along)


# --- a term from outside ----------------------------------------------------------------------


@dataclass(frozen=True)
class Midpoints:
    """Each edge's midpoint lies at a row of the block `middles`: nothing pqmesh knows of."""

    stencils: Mapping[str, np.ndarray]
    length: float

    @classmethod
    def on(cls, mesh):
        rows = np.arange(len(mesh.edges))[:, None]
        return cls({"vertices": mesh.edges, "middles": rows}, mesh.mean_edge_length)

    def evaluate(self, rows):
        value = (0.5 * (rows[:, 0] + rows[:, 1]) - rows[:, 2]) / self.length
        block = np.einsum("k,ij->ikj", [0.5, 0.5, -1.0], np.eye(3)) / self.length
        return value, np.broadcast_to(block, (len(rows), 3, 3, 3))


@dataclass(frozen=True)
class Level:
    """Rows of a block lie at height 0.3; refreshed on the way, to see that it is."""

    stencils: Mapping[str, np.ndarray]
    calls: list = field(default_factory=list)

    def evaluate(self, rows):
        return rows[:, 0, 2:] - 0.3, np.broadcast_to([0.0, 0.0, 1.0], (len(rows), 1, 1, 3))

    def refreshed(self, blocks):
        self.calls.append(blocks["middles"].shape)
        return self


@pytest.mark.parametrize("hard", [True, False])
def test_term_from_outside_is_accepted_with_its_own_unknowns(hard):
    mesh = curved_mesh(4, 3)
    plain = problem_for("planar", mesh, reference_of(mesh))
    term = Midpoints.on(mesh)
    assert isinstance(term, Term)
    middles = np.zeros((len(mesh.edges), 3))
    level = Level({"middles": np.array([[0], [5]])})
    assert isinstance(level, Refreshing)
    goals = (*plain.goals, Goal("midpoints", term, 3.0, hard), Goal("level", level, 0.1, hard))
    problem = Problem({**plain.blocks, "middles": middles}, goals, plain.fixed)
    found = solve(problem, mesh)
    assert found.converged
    assert set(found.blocks) == {"vertices", "middles"}
    assert level.calls[0] == middles.shape
    ends = found.blocks["vertices"][mesh.edges]
    gap = np.abs(ends.mean(axis=1) - found.blocks["middles"]).max()
    if hard:
        assert set(found.residuals) == {"planarity", "midpoints", "level"}
        # Hard goals are met to their tolerance.
        assert gap < 1e-11
        assert np.abs(found.blocks["middles"][[0, 5], 2] - 0.3).max() < 1e-11
    else:
        assert set(found.residuals) == {"planarity"}
        # Soft ones pull: the middles start up to five edges away; two are held at a height.
        assert gap < 0.2
    assert planarity(mesh.with_vertices(found.blocks["vertices"])).max() < 1e-12


def test_term_without_elements_is_accepted():
    mesh = QuadMesh.of([[0, 0, 0], [1, 0, 0.2], [1, 1, 0], [0, 1, 0.1]], [[0, 1, 2, 3]])
    found = solve(problem_for("conical", mesh, reference_of(mesh)), mesh)
    assert found.residuals["conicality"] == 0.0
    assert found.converged


def test_problem_refuses_a_term_whose_block_or_row_is_missing():
    mesh = curved_mesh(2, 2)
    term = Midpoints.on(mesh)
    with pytest.raises(MeshError, match="'middles'"):
        Problem({"vertices": mesh.vertices}, (Goal("midpoints", term),))
    with pytest.raises(MeshError, match=r"0\.\.4 of block 'middles'.*row 11"):
        Problem({"vertices": mesh.vertices, "middles": np.zeros((5, 3))}, (Goal("x", term),))
