"""Several faces as one surface over the plan: found, told apart, continued and refused."""

import numpy as np
import pytest

from pqmesh.errors import SpecError, SurfaceError
from pqmesh.surface.analytic import cylinder
from pqmesh.surface.base import Domain
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.formula import FormulaSurface, graph_surface
from pqmesh.surface.plan import Patch, PlanSurface, ring_distance, seams

HEIGHT = "0.3*x*x - 0.2*y*y + 0.1*x*y + 0.05*x*x*x"


def heights(xy: np.ndarray) -> np.ndarray:
    """z and its five derivatives of HEIGHT, (6, N)."""
    x, y = xy.T
    return np.stack(
        [
            0.3 * x * x - 0.2 * y * y + 0.1 * x * y + 0.05 * x**3,
            0.6 * x + 0.1 * y + 0.15 * x * x,
            -0.4 * y + 0.1 * x,
            0.6 + 0.3 * x,
            np.full_like(x, 0.1),
            np.full_like(x, -0.4),
        ]
    )


def skewed(u: tuple[float, float], v: tuple[float, float], name: str = "") -> Patch:
    """HEIGHT with parameters that stand askew and unevenly over the plan."""
    x, y = "u + 0.2*sin(v) + 0.05*u*u", "v + 0.15*u"
    z = HEIGHT.replace("x", f"({x})").replace("y", f"({y})")
    return Patch(FormulaSurface(x, y, z, Domain(u, v)), name=name)


def places(patch: Patch, n: int, seed: int = 1) -> np.ndarray:
    domain = patch.surface.domain
    uv = domain.low + np.random.default_rng(seed).random((n, 2)) * domain.size
    return patch.surface.jet(uv).point[:, :2]


def square(low: tuple[float, float], high: tuple[float, float]) -> np.ndarray:
    (a, c), (b, d) = low, high
    return np.array([[a, c], [b, c], [b, d], [a, d]])


def test_heights_and_derivatives_are_those_of_the_formula() -> None:
    parts = skewed((-2, 0), (-1, 1)), skewed((0, 1), (-1, 1)), skewed((1, 3), (-1, 1))
    surface = PlanSurface(parts)
    xy = np.concatenate([places(part, 400, i) for i, part in enumerate(parts)])
    assert surface.contains(xy).all()
    jet = surface.jet(xy)
    assert np.stack(jet)[..., 2] == pytest.approx(heights(xy), abs=1e-12)
    assert (jet.point[:, :2] == xy).all()
    assert (jet.du[:, :2] == [1, 0]).all()
    assert (jet.dv[:, :2] == [0, 1]).all()
    assert not np.stack(jet)[3:, :, :2].any()


def test_surface_goes_on_beyond_the_rim_by_its_own_formula() -> None:
    surface = PlanSurface((skewed((-1, 1), (-1, 1)),), margin=0.2)
    rim = skewed((-1.1, 1.1), (-1.1, 1.1))
    edge = np.linspace(-1.1, 1.1, 50)
    ring = np.concatenate([np.column_stack([edge, 0 * edge + s]) for s in (-1.1, 1.1)])
    xy = rim.surface.jet(np.concatenate([ring, ring[:, ::-1]])).point[:, :2]
    assert not surface.contains(xy).any()
    assert surface.jet(xy).point[:, 2] == pytest.approx(heights(xy)[0], abs=1e-12)
    assert surface.domain.inside(xy).all()


def test_no_points_give_no_jets() -> None:
    jet = PlanSurface((skewed((-1, 1), (-1, 1)),)).jet(np.empty((0, 2)))
    assert np.stack(jet).shape == (6, 0, 3)


def test_face_much_smaller_than_its_surface_is_found() -> None:
    big = graph_surface(HEIGHT, (-50, 50), (-50, 50))
    loop = square((0.1, 0.1), (0.6, 0.5))
    surface = PlanSurface((Patch(big, (loop,)),))
    xy = np.random.default_rng(0).uniform((0.1, 0.1), (0.6, 0.5), (300, 2))
    assert surface.contains(xy).all()
    assert surface.jet(xy).dvv[:, 2] == pytest.approx(-0.4, abs=1e-12)
    assert surface.domain.size == pytest.approx([0.5, 0.4], abs=0.1)


def test_coarse_and_dense_faces_are_told_apart() -> None:
    # Beside the seam the nearest samples all belong to the small face.
    wide = Patch(graph_surface(HEIGHT, (-4, 0), (-2, 2)), name="wide")
    narrow = Patch(graph_surface(HEIGHT, (0, 0.1), (-0.1, 0.1)), name="narrow")
    surface = PlanSurface((wide, narrow))
    xy = np.random.default_rng(3).uniform((-3.99, -1.99), (-1e-4, 1.99), (4000, 2))
    near = np.column_stack([np.linspace(-0.03, -1e-4, 200), np.linspace(-0.09, 0.09, 200)])
    points = np.concatenate([xy, near])
    assert surface.contains(points).all()
    assert surface.jet(points).point[:, 2] == pytest.approx(heights(points)[0], abs=1e-12)


def test_points_on_a_seam_belong_to_the_roof() -> None:
    bent = square((-1, -1), (0, 1)), square((0, -1), (1, 1))
    # Loops that follow a common curve by different chords leave cracks between them.
    side = np.linspace(-1, 1, 40)
    curve = [np.column_stack([1e-2 * np.cos(side[::k] * 1.5), side[::k]]) for k in (1, 3)]
    left = np.concatenate([bent[0][:1] * [1, 1], curve[0], bent[0][3:]])
    right = np.concatenate([bent[1][1:3], curve[1][::-1]])
    whole = graph_surface(HEIGHT, (-1, 1), (-1, 1))
    surface = PlanSurface((Patch(whole, (left,)), Patch(whole, (right,))))
    y = np.linspace(-0.99, 0.99, 999)
    xy = np.column_stack([1e-2 * np.cos(1.5 * y), y])
    assert surface.contains(xy).all()
    assert surface.jet(xy).point[:, 2] == pytest.approx(heights(xy)[0], abs=1e-12)


def test_hole_is_no_part_of_the_face() -> None:
    whole = graph_surface(HEIGHT, (-1, 1), (-1, 1))
    hole = square((-0.2, -0.2), (0.3, 0.4))[::-1]
    surface = PlanSurface((Patch(whole, (square((-1, -1), (1, 1)), hole)),))
    xy = np.random.default_rng(5).uniform(-0.99, 0.99, (2000, 2))
    inside = ((xy > [-0.2, -0.2]) & (xy < [0.3, 0.4])).all(axis=1)
    clear = ring_distance(hole, xy) > 1e-3
    assert (surface.contains(xy) == ~inside)[clear].all()


def test_face_over_the_bound_of_a_closed_surface() -> None:
    angles = 2 * np.pi * np.arange(12) / 12
    ring = np.stack([0 * angles, 5 * np.sin(angles), 5 * np.cos(angles)], axis=1)
    tube = BSplineSurface(
        np.stack([ring + 2.0 * k * np.eye(3)[0] for k in range(5)], axis=1),
        (3, 3),
        periodic=(True, False),
    )
    # The top stands at a twelfth before the bound.
    u0, u1 = 11 / 12 - 0.15, 11 / 12 + 0.15
    straight = np.array([[u0, 0.0], [u1, 0.0], [u1, 1.0], [u0, 1.0]])
    surface = PlanSurface((Patch(tube, (straight,)),))
    uv = np.random.default_rng(6).uniform((u0, 0.0), (u1, 1.0), (500, 2))
    expected = tube.jet(tube.domain.reduce(uv)).point
    assert surface.contains(expected[:, :2]).all()
    assert surface.jet(expected[:, :2]).point == pytest.approx(expected, abs=1e-11)


def test_orientation_of_a_face_does_not_matter() -> None:
    right = skewed((0, 1), (-1, 1)).surface
    words = [w.replace("sin", "S").translate({117: "v", 118: "u"}).replace("S", "sin")
             for w in (right.x, right.y, right.z)]  # fmt: skip
    turned = Patch(FormulaSurface(*words, Domain((-1, 1), (0, 1))))
    surface = PlanSurface((skewed((-2, 0), (-1, 1)), turned))
    xy = np.random.default_rng(7).uniform((0.2, -0.9), (0.9, 0.9), (100, 2))
    assert np.stack(surface.jet(xy))[..., 2] == pytest.approx(heights(xy), abs=1e-12)


@pytest.mark.parametrize(
    ("patches", "text"),
    [
        ((Patch(cylinder(radius=2.0), name="tube"),), "stands upright or turns over"),
        (
            (
                skewed((-1, 1), (-1, 1), "a"),
                Patch(graph_surface("5", (-0.3, 0.3), (-0.2, 0.2)), name="b"),
            ),
            "face 0 'a' lies over face 1 'b' near .* Select one",
        ),
        (
            (Patch(graph_surface("x", (-1, 1), (-1, 1)), (square((2, 2), (3, 3)) * 0.0,), "flat"),),
            "must enclose part of its surface; face 0 'flat'",
        ),
    ],
)  # fmt: skip
def test_faces_that_are_no_graph_are_refused(patches: tuple[Patch, ...], text: str) -> None:
    with pytest.raises((SpecError, SurfaceError), match=text):
        PlanSurface(patches)


def test_neighbours_that_overlap_a_little_are_accepted() -> None:
    left, right = graph_surface(HEIGHT, (-1, 0.01), (-1, 1)), graph_surface(HEIGHT, (0, 1), (-1, 1))
    surface = PlanSurface((Patch(left), Patch(right)))
    xy = np.array([[0.005, 0.3], [-0.5, 0.2], [0.5, 0.1]])
    assert surface.jet(xy).point[:, 2] == pytest.approx(heights(xy)[0], abs=1e-13)


@pytest.mark.parametrize(
    ("second", "gap", "angle", "curvature"),
    [
        ("x*x - y*y", 0.0, 0.0, 0.0),
        ("x*x - y*y + 0.01", 0.01, 0.0, 0.0),
        ("x*x - y*y + 0.1*x", 0.0, np.arctan(0.1), 0.0),
        ("3*x*x - y*y", 0.0, 0.0, 4.0),
    ],
)
def test_seams_are_measured(second: str, gap: float, angle: float, curvature: float) -> None:
    left = Patch(graph_surface("x*x - y*y", (-1, 0), (-1, 1)), name="left")
    right = Patch(graph_surface(second, (0, 1), (-1, 1)), name="right")
    far = Patch(graph_surface("0", (5, 6), (-1, 1)), name="far")
    (seam,) = seams(PlanSurface((left, right, far)))
    assert (seam.first, seam.second) == ("left", "right")
    assert seam.gap == pytest.approx(gap, abs=1e-13)
    # The angle is full where the slope along the seam is zero.
    assert seam.angle == pytest.approx(angle, abs=1e-4 * (angle > 0) + 1e-13)
    assert seam.curvature == pytest.approx(curvature, abs=1e-12)
