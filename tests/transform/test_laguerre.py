"""Laguerre transformations: the group, conical meshes, their limits, refusals, and text."""

import time
from pathlib import Path

import numpy as np
import pytest
from sphere_samples import cyclide_mesh, planes, rotational, spheres, torus_mesh

from pqmesh.errors import FormatError, MeshError
from pqmesh.job import Spec, panelize
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.mesh.measure import conicality_defect, fitted_cones, planarity
from pqmesh.mesh.planes import face_planes
from pqmesh.mesh.solids import deltoidal_icositetrahedron, rhombic_triacontahedron
from pqmesh.offset.offsets import edge_factors, face_offset, parallel_error, valid_range
from pqmesh.offset.vectors import face_offset_vectors
from pqmesh.source import read_design, spec_of
from pqmesh.surface.formula import graph_surface
from pqmesh.transform.conical import rapidity_range
from pqmesh.transform.laguerre import LaguerreTransform
from pqmesh.transform.lie import LORENTZ, LieTransform, lie_coordinates, lie_coordinates_of_planes
from pqmesh.transform.lie import planes_of as planes_from
from pqmesh.transform.lie import spheres_of as spheres_from
from pqmesh.vectors import dot, norm

EXACT = 1e-12
BUILDERS = {"rotational": rotational, "cyclide": cyclide_mesh, "torus": torus_mesh}


def sample(seed=0, rapidity=0.4):
    return LaguerreTransform.random(np.random.default_rng(seed), rapidity, distance=0.1)


def centered(mesh):
    """The mesh about its middle, where boosts can go furthest."""
    return mesh.with_vertices(mesh.vertices - mesh.vertices.mean(axis=0))


# --- the group ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_composition_and_inverse_act_as_they_say(seed):
    first, second = sample(seed), LaguerreTransform.similarity(1.3) @ sample(seed + 100, -0.7)
    rng = np.random.default_rng(seed)
    ball, wall = spheres(rng), planes(rng)
    both = second @ first
    np.testing.assert_allclose(
        both.on_spheres(ball), second.on_spheres(first.on_spheres(ball)), atol=1e-12 * 10
    )
    np.testing.assert_allclose(
        both.on_planes(wall), second.on_planes(first.on_planes(wall)), atol=1e-12 * 10
    )
    np.testing.assert_allclose(both.inverse.on_spheres(both.on_spheres(ball)), ball, atol=1e-11)
    np.testing.assert_allclose((both.inverse @ both).matrix, np.eye(4), atol=1e-12)
    written = second.matrix @ first.translation * second.scale + second.translation
    np.testing.assert_allclose(both.translation, written, atol=1e-13)
    np.testing.assert_allclose(both.inverse.matrix, LORENTZ @ both.matrix.T @ LORENTZ, atol=0)


@pytest.mark.parametrize("seed", range(20))
def test_contact_of_spheres_and_planes_is_kept(seed):
    found, rng = LaguerreTransform.similarity(0.7) @ sample(seed), np.random.default_rng(seed)
    wall = planes(rng)
    centers = rng.normal(size=(len(wall), 3))
    ball = np.column_stack([centers, dot(wall[:, :3], centers) - wall[:, 3]])
    image, side = found.on_spheres(ball), found.on_planes(wall)
    np.testing.assert_allclose(norm(side[:, :3]), 1.0, atol=EXACT)
    touch = dot(side[:, :3], image[:, :3]) - image[:, 3] - side[:, 3]
    assert np.abs(touch).max() < 1e-11


@pytest.mark.parametrize("seed", range(20))
def test_as_lie_transformation_it_does_the_same_and_comes_back(seed):
    found, rng = LaguerreTransform.similarity(2.1) @ sample(seed), np.random.default_rng(seed)
    lie = found.lie
    assert lie.is_laguerre
    assert not lie.is_moebius
    ball, wall = spheres(rng), planes(rng)
    images = spheres_from(lie.on(lie_coordinates(ball)))
    np.testing.assert_allclose(images, found.on_spheres(ball), atol=1e-10)
    images = planes_from(lie.on(lie_coordinates_of_planes(wall)))
    np.testing.assert_allclose(images, found.on_planes(wall), atol=1e-10)
    for matrix in (lie.matrix, -lie.matrix):
        back = LaguerreTransform.of_lie(LieTransform(matrix))
        np.testing.assert_allclose(back.matrix, found.matrix, atol=1e-10)
        np.testing.assert_allclose(back.translation, found.translation, atol=1e-10)
        assert back.scale == pytest.approx(found.scale)
    both = (found @ sample(seed + 1)).lie
    assert both.is_same(found.lie @ sample(seed + 1).lie)


def test_motions_and_similarities_are_laguerre_and_moebius_at_once():
    motion = LaguerreTransform.rotation([1, 2, 3], 0.4) @ LaguerreTransform.similarity(2.0)
    moved = (LaguerreTransform.shift([1, 2, 3]) @ motion).lie
    assert moved.is_laguerre
    assert moved.is_moebius


def test_lie_transformation_that_moves_the_improper_point_is_refused():
    with pytest.raises(MeshError, match="must fix the improper point"):
        LaguerreTransform.of_lie(LieTransform.random(np.random.default_rng(1)))


@pytest.mark.parametrize("seed", range(10))
def test_inversions_are_their_own_inverse_and_fix_their_hyperplane(seed):
    rng = np.random.default_rng(seed)
    vector, level = np.append(rng.normal(size=3), 0.3), 0.7
    found = LaguerreTransform.inversion(vector, level)
    ball = spheres(rng)
    np.testing.assert_allclose(found.on_spheres(found.on_spheres(ball)), ball, atol=1e-11)
    step = (level - ball @ LORENTZ @ vector) / (vector @ LORENTZ @ vector)
    fixed = ball + step[:, None] * vector
    np.testing.assert_allclose(found.on_spheres(fixed), fixed, atol=1e-11)


def test_rotation_follows_the_right_hand_rule():
    turned = LaguerreTransform.rotation([0, 0, 2], np.pi / 2)
    ball = turned.on_spheres(np.array([[1.0, 0, 0, 5]]))
    np.testing.assert_allclose(ball, [[0, 1, 0, 5]], atol=1e-15)


def test_boost_about_a_center_fixes_its_point_sphere():
    center = [5e3, -2e3, 40.0]
    found = LaguerreTransform.boost([1, 1, 0], 0.3, center)
    np.testing.assert_allclose(found.on_spheres(np.append(center, 0.0)), [*center, 0], atol=1e-9)


def test_random_element_has_the_rapidity_asked():
    for seed in range(10):
        found = sample(seed, 0.6)
        assert found.rapidity == pytest.approx(0.6)
        assert np.linalg.det(found.matrix) == pytest.approx(1.0)
        assert found.matrix[3, 3] > 0


# --- conical meshes -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["rotational", "cyclide"])
def test_thousand_random_images_are_planar_and_conical(name):
    mesh = centered(BUILDERS[name]())
    limit = rapidity_range(mesh)[1]
    planes_there, corners = face_planes(mesh), mesh.topology.indices
    flat = fit = spread = 0.0
    for seed in range(1000):
        rng = np.random.default_rng(seed)
        found = LaguerreTransform.random(rng, 0.5 * limit * rng.uniform(-1, 1))
        image = found.of_mesh(mesh)
        normals = found.on_planes(planes_there)[mesh.topology.corner_faces, :3]
        flat = max(flat, planarity(image.mesh).max())
        fit = max(fit, np.abs(dot(normals, image.vectors[corners]) - 1.0).max())
        cones = fitted_cones(image.mesh)
        spread = max(spread, cones.relative_spread.max(), cones.misfit.max())
        assert (image.orientation, image.warnings) == (1, ())
    assert flat <= 1e-10
    assert fit <= 1e-9
    assert spread <= 1e-9


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_image_does_not_depend_on_the_second_sphere(name, seed):
    mesh = centered(BUILDERS[name]())
    w = face_offset_vectors(mesh).vectors
    found = LaguerreTransform.random(np.random.default_rng(seed), 0.2)
    cones = found.on_cones(mesh.vertices, w)
    for t in (-1.3, 0.4, 7.0):
        first = found.on_spheres(np.column_stack([mesh.vertices, np.zeros(len(w))]))
        second = found.on_spheres(np.column_stack([mesh.vertices + t * w, np.full(len(w), t)]))
        share = first[:, 3:] / (first[:, 3:] - second[:, 3:])
        np.testing.assert_allclose(
            (first + share * (second - first))[:, :3], cones.vertices, atol=1e-11
        )
    # The image of the vertex itself, a sphere, is not the new vertex.
    assert norm(first[:, :3] - cones.vertices).max() > 0.01


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_image_vectors_are_a_face_offset_of_the_image_with_parallel_boundary(name):
    mesh = centered(BUILDERS[name]())
    image = LaguerreTransform.random(np.random.default_rng(4), 0.25).of_mesh(mesh)
    moved = image.mesh.with_vertices(image.mesh.vertices + 0.05 * image.vectors)
    assert parallel_error(image.mesh, moved).max() < 1e-11
    levels = dot(moved.face_centers - image.mesh.face_centers, image.mesh.face_normals)
    np.testing.assert_allclose(levels, 0.05, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_image_of_an_edge_is_as_long_as_the_sphere_that_touches_its_faces_is_large(name, seed):
    # The sphere (v - w/k, -1/k) touches all faces at both ends; its image has radius r', and
    # the image of the edge is -r' (w'_j - w'_i).
    mesh = centered(BUILDERS[name]())
    w = face_offset_vectors(mesh).vectors
    factors, (i, j) = edge_factors(mesh, w), mesh.edges.T
    curved = np.abs(factors) > 1e-3
    i, j, factors = i[curved], j[curved], factors[curved, None]
    found = LaguerreTransform.random(np.random.default_rng(seed), 0.2, distance=0.1)
    touching = np.column_stack([mesh.vertices[i] - w[i] / factors, -1 / factors])
    radius = found.on_spheres(touching)[:, 3:]
    cones = found.on_cones(mesh.vertices, w)
    np.testing.assert_allclose(
        cones.vertices[j] - cones.vertices[i],
        -radius * (cones.vectors[j] - cones.vectors[i]),
        atol=1e-9,
    )


@pytest.mark.parametrize("distance", [0.1, -0.15, 0.3])
@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_offset_of_a_mesh_is_its_face_offset(name, distance):
    mesh = BUILDERS[name]()
    image = LaguerreTransform.offset(distance).of_mesh(mesh)
    assert (image.mesh.vertices == face_offset(mesh, distance).vertices).all()
    np.testing.assert_allclose(image.vectors, face_offset_vectors(mesh).vectors, atol=0)


def test_positive_offset_moves_every_face_along_its_normal():
    mesh = rotational()
    image = LaguerreTransform.offset(0.1).of_mesh(mesh).mesh
    np.testing.assert_allclose(face_planes(image)[:, 3] - face_planes(mesh)[:, 3], 0.1, atol=1e-12)
    np.testing.assert_allclose(
        LaguerreTransform.offset(0.1).on_planes(face_planes(mesh))[:, 3],
        face_planes(image)[:, 3],
        atol=1e-12,
    )


def test_composed_offsets_boosts_and_motions_agree_with_one_after_the_other():
    mesh = centered(cyclide_mesh())
    parts = [
        LaguerreTransform.boost([1, 2, 0], 0.1),
        LaguerreTransform.offset(0.05),
        sample(3, 0.1),
    ]
    whole, step, vectors, anew = LaguerreTransform(), mesh, face_offset_vectors(mesh).vectors, mesh
    for part in parts:
        image = part.of_mesh(step, vectors)
        step, vectors, anew, whole = (
            image.mesh,
            image.vectors,
            part.of_mesh(anew).mesh,
            part @ whole,
        )
    once = whole.of_mesh(mesh)
    np.testing.assert_allclose(once.mesh.vertices, step.vertices, atol=1e-10)
    np.testing.assert_allclose(once.vectors, vectors, atol=1e-10)
    back = whole.inverse.of_mesh(once.mesh, once.vectors).mesh
    np.testing.assert_allclose(back.vertices, mesh.vertices, atol=1e-10)
    # Vectors chosen anew for every step leave inner vertices alone, and slide those at the rim.
    inner = ~mesh.topology.is_boundary_vertex
    np.testing.assert_allclose(once.mesh.vertices[inner], anew.vertices[inner], atol=1e-10)
    assert 1e-6 < norm(once.mesh.vertices - anew.vertices).max() < 0.01


def worst_losses(mesh, seeds):
    """Largest planarity and cone spread of random images over theirs times cosh^2, of a mesh.

    Flatter than a rounding of its coordinates a mesh is by chance; no image could keep that.
    """
    rounding = np.finfo(float).eps * np.abs(mesh.vertices).max() / mesh.mean_edge_length
    before = max(planarity(mesh).max(), rounding), fitted_cones(mesh).relative_spread.max()
    limit, worst = rapidity_range(mesh)[1], np.zeros(2)
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        rapidity = 0.5 * limit * rng.uniform(-1, 1)
        image = LaguerreTransform.random(rng, rapidity).of_mesh(mesh).mesh
        after = planarity(image).max(), fitted_cones(image).relative_spread.max()
        worst = np.maximum(worst, np.array(after) / before / np.cosh(rapidity) ** 2)
    return worst


def test_optimised_vault_loses_no_more_than_the_boost_stretches():
    surface = graph_surface("5 - y**2/16 + x**2/50 + x*y/60", (-9, 9), (-6, 6))
    vault = panelize(surface, Spec(edges=(1.5, 1.5))).mesh
    assert (worst_losses(centered(vault), 40) <= 10).all()


@pytest.mark.slow
def test_optimised_roof_loses_no_more_than_the_boost_stretches():
    source = read_design(Path(__file__).parents[2] / "examples" / "roof" / "roof.toml")
    roof = panelize(source.surface, spec_of(source), source.outline, region=source.region).mesh
    assert roof.topology.n_faces > 1000
    assert (worst_losses(centered(roof), 200) <= 10).all()


@pytest.mark.parametrize("build", [deltoidal_icositetrahedron, rhombic_triacontahedron])
def test_meshes_about_a_sphere_stay_about_a_sphere_at_any_valence(build):
    mesh = build()
    found = sample(2, 0.5)
    image = found.of_mesh(mesh)
    wanted = found.on_spheres(np.array([0.0, 0, 0, -1]))  # outward normals
    planes_there = face_planes(image.mesh)
    touch = dot(planes_there[:, :3], wanted[:3]) - wanted[3] - planes_there[:, 3]
    assert np.abs(touch).max() < 1e-12
    assert fitted_cones(image.mesh).spread.max() < 1e-12


def test_cylinder_of_revolution_goes_to_a_cone_of_revolution():
    mesh = rotational_mesh([[2, 0], [2, 0.7], [2, 1.5]], 0.4 * np.arange(5))
    found = LaguerreTransform.boost([0.3, 0, 1], 0.4)
    image = found.of_mesh(mesh).mesh
    line = found.matrix @ [0, 0, 1, 0]
    np.testing.assert_allclose(image.face_normals @ line[:3], line[3], atol=1e-12)
    planes_there = face_planes(image)
    apex = np.linalg.lstsq(planes_there[:, :3], planes_there[:, 3], rcond=1e-9)[0]
    np.testing.assert_allclose(planes_there[:, :3] @ apex, planes_there[:, 3], atol=1e-12)


def test_turning_all_orientations_turns_all_faces_and_moves_nothing():
    mesh = rotational()
    image = LaguerreTransform(np.diag([1.0, 1.0, 1.0, -1.0])).of_mesh(mesh)
    assert image.orientation == -1
    np.testing.assert_allclose(image.mesh.vertices, mesh.vertices, atol=1e-15)
    np.testing.assert_allclose(image.mesh.face_normals, -mesh.face_normals, atol=1e-12)
    np.testing.assert_allclose(image.vectors, -face_offset_vectors(mesh).vectors, atol=1e-12)


def test_reflection_keeps_the_sides_by_turning_the_faces():
    mesh = cyclide_mesh()
    image = LaguerreTransform.inversion([1.0, 0.5, 0.2, 0.0]).of_mesh(mesh)
    assert image.orientation == -1
    mirrored = LaguerreTransform.inversion([1.0, 0.5, 0.2, 0.0]).on_planes(face_planes(mesh))
    np.testing.assert_allclose(image.mesh.face_normals, mirrored[:, :3], atol=1e-10)


def fails_or_warns(found, mesh):
    """Whether an image beyond its focal set is refused as folded, or warned about."""
    try:
        return any("run backwards" in text for text in found.of_mesh(mesh).warnings)
    except MeshError as error:
        return "turns over" in str(error) or "one sign" in str(error)


# --- limits and refusals --------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_boost_to_the_pole_is_refused_with_the_vertex_and_its_growth(name):
    mesh = BUILDERS[name]()
    w = face_offset_vectors(mesh).vectors
    vertex = int(norm(w).argmax())
    length = norm(w[vertex])
    pole = LaguerreTransform.boost(-w[vertex], np.arctanh(1 / length), mesh.vertices.mean(axis=0))
    assert np.isnan(pole.on_cones(mesh.vertices, w).vertices[vertex]).all()
    with pytest.raises(
        MeshError, match=r"that of vertex \d+ is a cylinder, c' = (0 |-?[0-9.]+e-1)"
    ):
        pole.of_mesh(mesh)
    beyond = LaguerreTransform.boost(-w[vertex], np.arctanh(1 / length) + 0.02)
    with pytest.raises(MeshError, match="c' must have one sign on the whole mesh"):
        beyond.of_mesh(mesh)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("name", sorted(BUILDERS))
def test_rapidity_range_ends_where_an_edge_collapses_or_a_cone_opens(name, sense):
    mesh = BUILDERS[name]()
    direction = -sense * face_offset_vectors(mesh).vectors[0] + [0.1, 0.0, -0.05]
    bound = rapidity_range(mesh, direction)[0 if sense < 0 else 1]
    assert 0 < sense * bound < np.inf
    inside = LaguerreTransform.boost(direction, 0.999 * bound).of_mesh(mesh)
    assert not any("backwards" in text for text in inside.warnings)
    with pytest.raises(MeshError, match=r"collapses to a point|is a cylinder"):
        LaguerreTransform.boost(direction, bound).of_mesh(mesh)
    assert fails_or_warns(LaguerreTransform.boost(direction, 1.001 * bound), mesh)


def test_range_of_all_directions_is_within_that_of_each():
    mesh = centered(cyclide_mesh())
    low, high = rapidity_range(mesh)
    assert -low == high > 0.1
    for direction in np.random.default_rng(0).normal(size=(20, 3)):
        one = rapidity_range(mesh, direction)
        assert one[0] <= low + 1e-12
        assert one[1] >= high - 1e-12


def test_flat_mesh_bears_every_boost():
    flat = rotational_mesh([[1, 0], [2, 0], [3, 0]], 0.2 * np.arange(4))
    assert rapidity_range(flat, center=flat.vertices.mean(axis=0)) == (-np.inf, np.inf)
    assert planarity(LaguerreTransform.boost([1, 0, 1], 2.0).of_mesh(flat).mesh).max() < 1e-12


def test_collapse_of_a_mesh_about_a_sphere_is_refused_with_the_edge():
    with pytest.raises(MeshError, match=r"edge 0-\d+ collapses to a point \(48 of 48 edges\)"):
        LaguerreTransform.offset(-1.0).of_mesh(deltoidal_icositetrahedron())


def test_fold_is_refused_with_the_face():
    # Between the two focal sheets of the inner faces only some of the faces have turned over.
    mesh = torus_mesh()
    factors = edge_factors(mesh, face_offset_vectors(mesh).vectors)
    low, _ = valid_range(mesh, face_offset_vectors(mesh).vectors)
    assert low == pytest.approx(-1 / factors.max())
    assert not fails_or_warns(LaguerreTransform.offset(0.99 * low), mesh)
    assert fails_or_warns(LaguerreTransform.offset(1.02 * low), mesh)
    cone = rotational_mesh([[0.5, 0.0], [1.0, 0.5], [1.5, 1.0]], 0.4 * np.arange(5))
    with pytest.raises(MeshError, match=r"face \d+ turns over against the others \(\d+ of 8 faces"):
        LaguerreTransform.offset(-1.05).of_mesh(cone)


def test_mesh_that_is_not_conical_is_warned_about_with_the_vertex():
    skew = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], [0.0, 0.3, 0.7, 1.0])
    image = LaguerreTransform.boost([1, 0, 0], 0.1, [2, 1, 0.5]).of_mesh(skew)
    assert any("conical only to" in text and "vertex" in text for text in image.warnings)
    assert planarity(image.mesh).max() > 1e-6


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: LaguerreTransform(np.eye(3)), r"must have shape \(4, 4\)"),
        (lambda: LaguerreTransform(np.full((4, 4), np.nan)), "entries that are not finite"),
        (lambda: LaguerreTransform(np.eye(4) * 1.000001), r"entry \(0, 0\) is off by 2e-06"),
        (lambda: LaguerreTransform(translation=np.zeros(3)), "must be 4 finite numbers"),
        (lambda: LaguerreTransform(scale=0.0), "scale .* must be a number above 0"),
        (lambda: LaguerreTransform.boost([0, 0, 0], 1.0), "must not be zero"),
        (lambda: LaguerreTransform.boost([0, 0, 1], np.inf), "rapidity of a boost"),
        (lambda: LaguerreTransform.offset(np.nan), "must be 4 finite numbers"),
        (lambda: LaguerreTransform.inversion([0, 3.0, 4.0, 5.0]), r"\(v, v\) other than 0"),
    ],
)
def test_what_is_no_laguerre_transformation_is_refused(make, message):
    with pytest.raises(MeshError, match=message):
        make()


# --- text and time --------------------------------------------------------------------------


def test_text_brings_the_transformation_back_to_the_last_bit():
    found = LaguerreTransform.similarity(1.1) @ sample(7)
    back = LaguerreTransform.from_json(found.to_json())
    assert (back.matrix == found.matrix).all()
    assert (back.translation == found.translation).all()
    assert back.scale == found.scale
    plain = LaguerreTransform.from_json('{"matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}')
    assert (plain.scale, plain.translation.tolist()) == (1.0, [0, 0, 0, 0])


UNIT = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1, column 1"),
        ("[1, 2]", "must be a JSON object; found list"),
        ("{}", "must have the key 'matrix' with 4 x 4 numbers"),
        (f'{{"matirx": {UNIT}}}', "Did you mean 'matrix'?"),
        (f'{{"matrix": {UNIT}, "zzz": 1}}', "found 'zzz'. Write matrix"),
        (f'{{"matrix": {UNIT}, "matrix": {UNIT}}}', "'matrix' twice"),
        ('{"matrix": [[1, 0], [0, 1]]}', "must hold 4 x 4 numbers"),
        (f'{{"matrix": {UNIT}, "scale": true}}', "'scale' must hold a number"),
        (f'{{"matrix": {UNIT}, "scale": "2"}}', "'scale' must hold a number"),
        (f'{{"matrix": {UNIT}, "scale": NaN}}', "found NaN"),
        (f'{{"matrix": {UNIT}, "scale": 1e999}}', "'scale' must hold a number"),
        (f'{{"matrix": {UNIT}, "scale": 1{"0" * 5000}}}', "one object of plain numbers"),
        (f'{{"matrix": {UNIT}, "translation": [1, 2, 3]}}', "must hold 4 numbers"),
        ("[" * 100_000, "one object of plain numbers"),
    ],
)
def test_text_that_is_no_transformation_is_refused_in_one_line(text, message):
    with pytest.raises(FormatError) as caught:
        LaguerreTransform.from_json(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


def test_ten_thousand_faces_take_less_than_a_second():
    z = np.linspace(-1, 1, 101)
    mesh = rotational_mesh(np.column_stack([2 + 0.3 * np.cos(2 * z), z]), 0.02 * np.arange(101))
    began = time.process_time()
    image = LaguerreTransform.boost([0, 1, 1], 0.1).of_mesh(mesh)
    assert time.process_time() - began < 1.0
    assert mesh.topology.n_faces == 10_000
    # Faces as narrow as 0.02 lie by 1e-15/theta^2 in their planes.
    assert planarity(image.mesh).max() < 1e-10
    assert np.abs(conicality_defect(image.mesh)[1]).max() < 1e-7
