"""The gallery runs, and its printed numbers hold."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))

# In `three_offsets`: layer -> panels, kinds of distance that are the same everywhere, and distances
# of vertices, edges and faces. Exact are the smallest and the largest; `BELOW` and `ABOVE` the
# asked distance they vary, as a vertex moves no less than an edge through it, nor that than a face.
BELOW = ((0.99, 0.999), (0.999, 1 + 1e-12))
ABOVE = ((1 - 1e-12, 1.0005), (1.0005, 1.01))
ONE = (1.0, 1.0)
OFFSETS = {
    # Half the box is 6 x 3 x 2, and 7 from the middle to a corner.
    "box_vertex": (6, 1, ONE, (13**0.5 / 7, 45**0.5 / 7), (2 / 7, 6 / 7)),
    "box_edge": (6, 3, (1.5**0.5, 1.5**0.5), ONE, (0.5**0.5, 0.5**0.5)),
    "box_face": (6, 3, (3**0.5, 3**0.5), (2**0.5, 2**0.5), ONE),
    "vault_vertex": (224, 1, ONE, BELOW, BELOW),
    "dome_edge": (85, 1, ABOVE, ONE, BELOW),
    "roof_face": (421, 1, ABOVE, ABOVE, ONE),
}


def bounds_of_offsets():
    """Bounds of `three_offsets`; the number of panels of a roof may differ by a tenth."""
    bounds = {}
    for name, (panels, kinds, *distances) in OFFSETS.items():
        slack = 0 if name.startswith("box") else panels / 10
        found = {"panels": (panels - slack, panels + slack), "kinds": (kinds, kinds)}
        for kind, ends in zip(("vertex", "edge", "face"), distances, strict=True):
            for end, value in zip(("min", "max"), ends, strict=True):
                is_exact = isinstance(value, float)
                found[f"{kind}_{end}"] = (value - 1e-12, value + 1e-12) if is_exact else value
        bounds |= {f"{name}_offset:{key}": value for key, value in found.items()}
    return bounds


# Script -> number -> lowest and highest value that is right. Counts and invariants are exact;
# bounds of errors are about a hundred times what rounding gives.
BOUNDS = {
    "circular_vertex_offsets": {
        "panels": (50, 150),
        "circularity_before_deg": (0.01, 1.0),
        "circularity_deg": (0.0, 1e-9),
        "circle_deviation": (-1e-13, 1e-13),
        "planarity": (0.0, 1e-12),
        "vertex_distance_error": (0.0, 1e-13),
        "face_distance_range": (1e-5, 1e-2),
        "twist_deg": (0.0, 1e-10),
    },
    "conical_roof": {
        "panels": (50, 150),
        "planarity_before": (1e-7, 1e-4),
        "planarity": (0.0, 1e-11),
        "cone_spread": (0.0, 1e-9),
        "distance_error": (0.0, 1e-13),
        "twist_deg": (0.0, 1e-8),
        "deviation": (0.0, 1e-4),
    },
    "constrained_shell": {
        "panels": (96, 96),
        "planarity_before": (0.01, 0.03),
        "planarity": (0.0, 1e-12),
        "arch_error": (0.0, 1e-11),
        "level_error": (0.0, 1e-11),
        "mirror_error": (0.0, 1e-11),
        "rim_error": (0.0, 1e-11),
        "moved_max": (0.1, 2.0),
    },
    "ellipsoid_curvature_lines": {
        "crossings": (20, 200),
        "coordinate_drift": (0.0, 1e-8),
        "umbilics": (4, 4),
        "umbilic_error": (0.0, 1e-12),
        "order_of_deviation": (3.9, 4.1),
    },
    "three_offsets": bounds_of_offsets(),
    "torus_closed_mesh": {
        "panels": (300, 700),
        "boundary_loops": (0, 0),
        "euler_characteristic": (0, 0),
        "planarity": (0.0, 1e-13),
        "cone_spread": (0.0, 1e-11),
        "distance_error": (0.0, 1e-13),
        "parallel_error": (0.0, 1e-11),
        "twist_deg": (0.0, 1e-9),
        # The tube has radius 1; a chord of it turns a little earlier.
        "first_reversed_edge": (-1.0, -0.9),
    },
    "unrolled_strips": {
        "strips": (3, 8),
        "length_error": (0.0, 1e-12),
        "area_error": (0.0, 1e-11),
    },
    "torus_to_cyclide": {
        "panels": (648, 648),
        # Where the tube of radius 1 about the ring of radius 3 becomes a point: artanh(1/3).
        "rapidity_limit": (0.3465, 0.3467),
        "planarity": (0.0, 1e-12),
        "cone_spread": (0.0, 1e-11),
        "layer_distance_error": (0.0, 1e-13),
        # cosh - 3 sinh of 0.8 of the limit, on the smooth cyclide.
        "thinnest_tube_radius": (0.190, 0.200),
    },
}


def test_every_script_has_its_bounds():
    assert [script.stem for script in SCRIPTS] == sorted(BOUNDS)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_example_runs_and_its_numbers_hold(script, capsys):
    found = loaded(script).main()
    printed = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in printed] == list(found)
    assert sorted(found) == sorted(BOUNDS[script.stem])
    outside = {
        name: found[name]
        for name, (low, high) in BOUNDS[script.stem].items()
        if not low <= found[name] <= high
    }
    assert not outside


def loaded(script):
    """Module of a script, without running its last lines."""
    spec = importlib.util.spec_from_file_location(f"example_{script.stem}", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
