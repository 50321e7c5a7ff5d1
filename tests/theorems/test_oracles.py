"""Which test shows which exact oracle of parts A to E, from planarity to spheres, and number 59.

The numbers are those of the list of oracles that pqmesh was built against; each entry names the
tests that hold it at its tolerance, by file and function. A test that is renamed or removed shows
up here.
"""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]

ORACLES = {
    1: ("hyperbolic paraboloid", "theorems/test_planarity.py", [
        "test_volume_of_hyperbolic_paraboloid_cell_is_the_same_anywhere",
        "test_square_cell_of_hyperbolic_paraboloid_has_closed_values"]),
    2: ("volume law, closest planar quad", "theorems/test_planarity.py", [
        "test_volume_is_area_times_diagonal_distance_over_three",
        "test_projection_to_the_best_plane_is_the_closest_planar_quad"]),
    3: ("translational mesh", "theorems/test_planarity.py", [
        "test_translational_mesh_is_planar",
        "test_translational_mesh_is_circular_exactly_when_edges_are_perpendicular"]),
    4: ("projective image", "theorems/test_planarity.py", [
        "test_projective_image_of_planar_mesh_is_planar"]),
    "4b": ("of a parallel pair", "theorems/test_parallel.py", [
        "test_projective_image_of_a_parallel_pair_is_not_parallel"]),
    5: ("Gamma net", "theorems/test_planarity.py", [
        "test_gamma_net_is_planar_and_has_published_values"]),
    6: ("conjugate cubic", "theorems/test_planarity.py", [
        "test_conjugate_cubic_cells_have_the_same_volume_and_are_flat_for_matching_steps",
        "test_conjugate_cubic_has_its_published_point",
        "test_conjugate_cubic_is_a_saddle_of_closed_curvature"]),
    7: ("dim P(M)", "theorems/test_parallel.py", [
        "test_dimension_of_the_parallel_meshes",
        "test_discs_and_spheres_in_general_position_have_the_generic_dimension"]),
    8: ("all pairs instead of edges", "theorems/test_errata_meshes.py", [
        "test_e06_equations_over_all_pairs_leave_translations_and_scaling_only"]),
    9: ("members of P(M)", "theorems/test_parallel.py", [
        "test_mesh_plus_a_member_is_parallel_and_planar",
        "test_linear_map_carries_the_space_with_it"]),
    10: ("Gauss and Bonnet", "theorems/test_planarity.py", [
        "test_gauss_bonnet_holds_on_planar_convex_faces",
        "test_gauss_bonnet_fails_where_faces_are_not_planar"]),
    11: ("numbers of parameters", "theorems/test_parallel.py", [
        "test_planar_grids_have_their_number_of_parameters",
        "test_circular_grids_have_their_number_of_parameters",
        "test_conical_grids_have_their_number_of_parameters",
        "test_koebe_grids_have_their_number_of_parameters"]),
    12: ("rotational mesh", "theorems/test_circular.py", [
        "test_rotational_mesh_of_any_profile_and_any_angles_is_circular",
        "test_rotational_mesh_is_conical_for_equal_steps_and_not_otherwise",
        "test_rotational_mesh_with_straight_or_vertical_profile_is_conical_for_any_steps"]),
    13: ("mirror mesh", "theorems/test_circular.py", [
        "test_mirror_mesh_of_space_polyline_in_any_mirrors_is_circular",
        "test_polyline_that_crosses_the_mirror_gives_crossed_cyclic_quads"]),
    14: ("inversion", "theorems/test_circular.py", [
        "test_inversion_keeps_circular_and_the_cross_ratio",
        "test_matrix_of_the_inversion_gives_the_same_points_and_composes"]),
    15: ("stereographic image", "theorems/test_circular.py", [
        "test_stereographic_mesh_is_circular_on_the_sphere"]),
    16: ("torus and cyclide", "theorems/test_circular.py", [
        "test_cyclide_formula_has_published_values",
        "test_torus_and_cyclide_sampled_anyhow_are_exactly_circular"]),
    17: ("vertex offsets", "theorems/test_offsets.py", [
        "test_reflected_normals_of_a_circular_disc_close_for_every_start",
        "test_faces_off_the_circle_leave_a_gap_of_order_one"]),
    18: ("holonomy", "theorems/test_offsets.py", [
        "test_rotational_annulus_has_vertex_offsets_along_the_meridian_plane_at_least",
        "test_prism_over_a_quad_without_circumcircle_has_the_degenerate_vertex_offset_only"]),
    "18b": ("number of vertex offsets", "offset/test_spaces.py", [
        "test_number_of_vertex_offsets_follows_the_loops",
        "test_prism_over_a_quad_without_circumcircle_has_no_vertex_offset"]),
    19: ("crossed and tetrahedral quads", "theorems/test_circular.py", [
        "test_crossed_cyclic_quad_has_equal_opposite_angles_and_is_not_taken_for_circular",
        "test_tetrahedron_quad_balances_and_is_not_planar"]),
    20: ("Ptolemy", "theorems/test_circular.py", [
        "test_ptolemy_residual_is_never_negative",
        "test_ptolemy_residual_vanishes_only_for_a_circle_in_order"]),
    21: ("rotational, equal steps", "theorems/test_conical.py", [
        "test_offset_profile_has_published_values",
        "test_rotational_mesh_with_equal_steps_is_conical",
        "test_cone_vectors_of_rotational_mesh_are_those_of_the_closed_face_offset"]),
    22: ("hyperboloid", "theorems/test_conical.py", [
        "test_rotational_hyperboloid_has_conical_saddle_vertices"]),
    23: ("mirror planes", "theorems/test_conical.py", [
        "test_mirror_plane_mesh_is_conical_for_any_strip_and_mirrors",
        "test_blocks_of_reflected_planes_are_concurrent"]),
    24: ("tangent planes", "theorems/test_conical.py", [
        "test_tangent_planes_at_any_curvature_parameters_span_a_conical_mesh"]),
    25: ("contact elements", "theorems/test_circular.py", [
        "test_contact_elements_of_circular_mesh_span_a_conical_mesh",
        "test_contact_elements_of_a_torus_give_cones"]),
    "25b": ("and back", "mesh/test_duality.py", [
        "test_points_reflected_through_a_conical_mesh_form_a_circular_mesh",
        "test_circular_mesh_comes_back_from_its_contact_elements"]),
    26: ("around a sphere", "theorems/test_conical.py", [
        "test_mesh_around_a_sphere_is_conical_and_its_face_offset_is_a_scaling"]),
    "26b": ("its offset", "theorems/test_offsets.py", [
        "test_face_offset_of_a_mesh_around_a_ball_is_a_scaling"]),
    27: ("angle classes", "theorems/test_conical.py", [
        "test_each_class_of_orientations_has_its_own_angle_identity",
        "test_only_the_oriented_class_counts_as_conical"]),
    28: ("four-bar", "theorems/test_conical.py", [
        "test_angle_sum_of_360_degrees_is_not_conical"]),
    29: ("flat vertex and flat edge", "theorems/test_conical.py", [
        "test_flat_vertex_is_conical_with_any_angles",
        "test_flat_edge_is_always_conical_and_balances_only_along_the_generator"]),
    30: ("sheared cylinder", "offset/test_spaces.py", [
        "test_sheared_cylinder_has_a_parallel_offset_though_its_vertices_do_not_balance"]),
    31: ("valence 6", "theorems/test_conical.py", [
        "test_vertex_of_valence_six_may_balance_without_a_cone"]),
    32: ("freedom of face offsets", "theorems/test_offsets.py", [
        "test_conical_grid_has_a_four_parameter_family_of_face_offsets",
        "test_every_planar_strip_has_a_four_parameter_family_of_face_offsets"]),
    33: ("edge law", "offset/test_distances.py", [
        "test_edges_of_an_offset_are_multiples_to_rounding_error"]),
    "33b": ("Steiner", "theorems/test_offsets.py", [
        "test_face_areas_of_the_offset_follow_steiner",
        "test_mesh_around_a_ball_has_the_curvatures_of_the_ball",
        "test_valid_range_of_a_torus_tends_to_its_focal_set"]),
    34: ("imbalance law", "theorems/test_conical.py", [
        "test_imbalance_law_of_nearly_flat_vertices"]),
    35: ("solids with a midsphere", "koebe/test_polyhedron.py", [
        "test_solids_with_a_midsphere_come_out_as_themselves",
        "test_coordinates_of_the_cube_and_the_rhombic_dodecahedron",
        "test_regular_prism_has_its_closed_form",
        "test_faces_have_incircles_and_edges_the_sum_of_tangent_lengths"]),
    36: ("rotational Koebe mesh", "koebe/test_families.py", [
        "test_rotational_koebe_mesh_touches_the_sphere",
        "test_rotational_koebe_mesh_has_published_values"]),
    37: ("square-grid Koebe mesh", "koebe/test_families.py", [
        "test_square_grid_of_circles_gives_a_koebe_mesh",
        "test_square_koebe_mesh_has_published_values"]),
    38: ("members of P(Koebe)", "koebe/test_families.py", [
        "test_every_member_of_p_of_a_koebe_mesh_has_constant_edge_distance"]),
    39: ("discrete catenoid", "koebe/test_families.py", [
        "test_discrete_catenoid_has_published_values",
        "test_discrete_catenoid_is_minimal_with_exact_edge_offsets",
        "test_discrete_catenoid_tends_to_the_catenoid_in_second_order"]),
    40: ("discrete Enneper surface", "koebe/test_families.py", [
        "test_discrete_enneper_closes_and_is_minimal",
        "test_discrete_enneper_tends_to_enneper_s_surface"]),
    41: ("cube and box", "theorems/test_parallel.py", [
        "test_box_with_the_cube_as_its_image_has_all_three_distances_constant"]),
    42: ("quadric and contact", "theorems/test_lie_spheres.py", [
        "test_definition_5_1_1_lightlike_vectors_are_spheres_planes_and_the_improper_point",
        "test_printed_sphere_has_the_published_coordinates",
        "test_oriented_spheres_touch_exactly_when_centers_are_apart_by_the_difference_of_radii"]),
    43: ("worked example", "theorems/test_lie_spheres.py", [
        "test_worked_example_corrected_is_a_boost",
        "test_worked_example_as_printed_is_refused"]),
    44: ("Laguerre image of a conical mesh", "transform/test_laguerre.py", [
        "test_thousand_random_images_are_planar_and_conical",
        "test_image_does_not_depend_on_the_second_sphere",
        "test_image_vectors_are_a_face_offset_of_the_image_with_parallel_boundary"]),
    45: ("offset as a Laguerre transformation", "transform/test_laguerre.py", [
        "test_offset_of_a_mesh_is_its_face_offset",
        "test_positive_offset_moves_every_face_along_its_normal"]),
    46: ("tangential distance", "theorems/test_lie_spheres.py", [
        "test_laguerre_transformations_keep_the_square_of_the_tangential_distance",
        "test_lemma_5_3_2_spheres_have_a_common_tangent_plane_exactly_when_not_timelike",
        "test_lemma_5_3_2_lightlike_pairs_have_one_plane_only"]),
    "46b": ("composition and inverse", "transform/test_laguerre.py", [
        "test_composition_and_inverse_act_as_they_say"]),
    47: ("planted rotation", "theorems/test_lie_spheres.py", [
        "test_theorem_5_3_3_fails_for_linear_maps_that_are_not_lorentzian"]),
    48: ("trivial images", "transform/test_laguerre.py", [
        "test_meshes_about_a_sphere_stay_about_a_sphere_at_any_valence",
        "test_cylinder_of_revolution_goes_to_a_cone_of_revolution"]),
    49: ("pole", "transform/test_laguerre.py", [
        "test_boost_to_the_pole_is_refused_with_the_vertex_and_its_growth"]),
    59: ("holes and notches", "offset/test_spaces.py", [
        "test_conical_mesh_of_any_outline_has_its_face_offset"]),
}  # fmt: skip

ORACLES |= {
    f"{number}c": (
        "circle fit",
        "mesh/test_circles.py",
        ["test_exact_circular_mesh_fits_its_circles_to_rounding_error"],
    )
    for number in (12, 13, 15, 16)
}

STATEMENTS = ("proposition_2_1_1", "proposition_2_2_1", "theorem_3_1_1", "theorem_4_1_1",
              "lemma_4_1_2", "theorem_5_2_1", "corollary_5_2_2", "lemma_5_3_1", "lemma_5_3_2",
              "theorem_5_3_3")  # fmt: skip


def names_in(path):
    """Names of the test functions of a file."""
    tree = ast.parse((TESTS / path).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("number", ORACLES, ids=str)
def test_oracle_has_its_tests(number):
    _, path, names = ORACLES[number]
    assert names
    assert set(names) <= names_in(path)


def test_no_oracle_of_the_five_parts_is_left_out():
    numbers = {number for number in ORACLES if isinstance(number, int)}
    assert numbers == {*range(1, 50), 59}


@pytest.mark.parametrize("statement", STATEMENTS)
def test_numbered_statement_has_tests_named_after_it(statement):
    files = ("theorems/test_statements.py", "theorems/test_lie_spheres.py")
    names = {name for path in files for name in names_in(path)}
    named = [name for name in names if name.startswith(f"test_{statement}")]
    assert named
