"""Trim loops of Brep faces: they lie on the edges, close, and turn the right way."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.errors import FormatError
from pqmesh.io.rhino import Patch, read_rhino_surfaces
from pqmesh.io.rhino_trims import loops_of_face
from pqmesh.surface.bspline import BSplineSurface

rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")


def area(ring: np.ndarray) -> float:
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def circle(radius: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    round_one = rhino3dm.Circle(rhino3dm.Point3d(x, y, z), radius)
    return rhino3dm.NurbsCurve.CreateFromCircle(round_one)


def patches(geometry: Any, path: Path, unit: str = "Meters") -> tuple[Patch, ...]:
    file = rhino3dm.File3dm()
    file.Settings.ModelUnitSystem = getattr(rhino3dm.UnitSystem, unit)
    file.Objects.Add(geometry, rhino3dm.ObjectAttributes())
    assert file.Write(str(path), 8)
    return read_rhino_surfaces(path).patches


def rectangle_area(patch: Patch) -> float:
    return float(np.prod(patch.surface.domain.size))


def test_plane_trimmed_by_a_circle(tmp_path: Path) -> None:
    made = rhino3dm.Brep.CreateTrimmedPlane(rhino3dm.Plane.WorldXY(), circle(2.0, 3.0, 1.0))
    (patch,) = patches(made, tmp_path / "a.3dm")
    (ring,) = patch.loops
    at = patch.surface.jet(ring).point
    assert np.hypot(at[:, 0] - 3.0, at[:, 1] - 1.0) == pytest.approx(2.0, abs=1e-12)
    assert area(ring) == pytest.approx(4 * np.pi, rel=2e-3)
    assert not ring.flags.writeable
    middle = patch.surface.jet(0.5 * (ring + np.roll(ring, 1, axis=0))).point
    assert 2.0 - np.hypot(middle[:, 0] - 3, middle[:, 1] - 1).min() < 1e-4 * 4


def test_plane_trimmed_by_a_polygon_keeps_its_corners(tmp_path: Path) -> None:
    corners = [(0, 0), (5, 0), (5, 2), (2, 2), (2, 6), (0, 6)]
    line = rhino3dm.Polyline(len(corners) + 1)
    for x, y in [*corners, corners[0]]:
        line.Add(x, y, 0)
    curve = line.ToPolylineCurve()
    made = rhino3dm.Brep.CreateTrimmedPlane(rhino3dm.Plane.WorldXY(), curve)
    (patch,) = patches(made, tmp_path / "a.3dm")
    at = patch.surface.jet(patch.loops[0]).point[:, :2]
    assert len(at) == 6
    assert {tuple(p) for p in at.round(9).tolist()} == {(float(x), float(y)) for x, y in corners}


def test_box_has_six_untrimmed_faces(tmp_path: Path) -> None:
    box = rhino3dm.Box(rhino3dm.BoundingBox(0, 0, 0, 1, 2, 3))
    found = patches(rhino3dm.Extrusion.CreateBoxExtrusion(box, True), tmp_path / "a.3dm")
    assert [patch.face for patch in found] == list(range(6))
    for patch in found:
        (ring,) = patch.loops
        assert len(ring) == 4
        assert area(ring) == pytest.approx(rectangle_area(patch), rel=1e-12)


def test_pipe_has_caps_with_holes(tmp_path: Path) -> None:
    axis = rhino3dm.Cylinder(rhino3dm.Circle(rhino3dm.Point3d(1, 2, 0), 2.0), 5.0)
    made = rhino3dm.Extrusion.CreatePipeExtrusion(axis, 1.0, True, True)
    found = patches(made, tmp_path / "a.3dm")
    assert sorted(len(patch.loops) for patch in found) == [1, 1, 2, 2]
    for patch in found:
        if len(patch.loops) == 1:
            assert True in patch.surface.domain.periodic
            assert area(patch.loops[0]) == pytest.approx(rectangle_area(patch), rel=1e-12)
            continue
        outer, hole = patch.loops
        assert area(outer) > 0 > area(hole)
        for ring, radius in ((outer, 2.0), (hole, 1.0)):
            at = patch.surface.jet(ring).point
            assert np.hypot(at[:, 0] - 1, at[:, 1] - 2) == pytest.approx(radius, abs=1e-9)


def test_closed_cylinder_is_cut_at_its_seam(tmp_path: Path) -> None:
    axis = rhino3dm.Cylinder(rhino3dm.Circle(rhino3dm.Point3d(0, 0, 0), 2.0), 5.0)
    found = patches(rhino3dm.Brep.CreateFromCylinder(axis, True, True), tmp_path / "a.3dm")
    assert found[0].surface.domain.periodic == (True, False)
    assert area(found[0].loops[0]) == pytest.approx(rectangle_area(found[0]), rel=1e-12)
    assert all(area(patch.loops[0]) == pytest.approx(4 * np.pi, rel=2e-3) for patch in found[1:])


def test_sphere_has_the_whole_rectangle(tmp_path: Path) -> None:
    ball = rhino3dm.Sphere(rhino3dm.Point3d(0, 0, 0), 3.0)
    (patch,) = patches(rhino3dm.Brep.CreateFromSphere(ball), tmp_path / "a.3dm")
    assert area(patch.loops[0]) == pytest.approx(rectangle_area(patch), rel=1e-12)


@pytest.mark.parametrize("turn", [1.0, 2.5, 2 * np.pi])
def test_revolved_brep(turn: float, tmp_path: Path) -> None:
    arc = rhino3dm.NurbsCurve.Create(
        *(False, 3),
        [rhino3dm.Point3d(3 + 0.3 * k * (3 - k), 0, 2 * k) for k in range(5)],
    )
    axis = rhino3dm.Line(rhino3dm.Point3d(0, 0, 0), rhino3dm.Point3d(0, 0, 1))
    made = rhino3dm.RevSurface.Create(arc, axis, 0.0, turn)
    closed = turn > 6
    brep = rhino3dm.Brep.CreateFromRevSurface(made, closed, closed)
    found = patches(brep, tmp_path / "a.3dm")
    assert (True in found[0].surface.domain.periodic) == closed
    assert area(found[0].loops[0]) == pytest.approx(rectangle_area(found[0]), rel=1e-9)
    uv = np.random.default_rng(0).random((20, 2)) * found[0].surface.domain.size
    at = found[0].surface.jet(uv + found[0].surface.domain.low).point
    radius = np.hypot(at[:, 0], at[:, 1])
    assert radius.min() > 1.0
    assert len(found) == (3 if closed else 1)


def test_untrimmed_nurbs_brep_has_the_rectangle(tmp_path: Path) -> None:
    wave = rhino3dm.NurbsSurface.Create(3, False, 4, 4, 5, 5)
    for i in range(5):
        for j in range(5):
            wave.Points[i, j] = rhino3dm.Point4d(2.0 * i, 2.0 * j, float((i * j) % 3), 1.0)
    wave.KnotsU.CreateUniformKnots(1.0)
    wave.KnotsV.CreateUniformKnots(1.0)
    (patch,) = patches(rhino3dm.Brep.CreateFromSurface(wave), tmp_path / "a.3dm")
    assert patch.loops[0].shape == (4, 2)
    assert area(patch.loops[0]) == pytest.approx(4.0)


def test_loops_hold_far_from_the_origin(tmp_path: Path) -> None:
    x, y = 5e8, 3e8
    plane = rhino3dm.Plane(rhino3dm.Point3d(x, y, 0), rhino3dm.Vector3d(0, 0, 1))
    made = rhino3dm.Brep.CreateTrimmedPlane(plane, circle(20_000.0, x, y))
    path = tmp_path / "a.3dm"
    (patch,) = patches(made, path, "Millimeters")
    origin = read_rhino_surfaces(path).origin
    assert origin.tolist() == [x, y, 0.0]
    at = patch.surface.jet(patch.loops[0]).point
    assert np.hypot(at[:, 0], at[:, 1]) == pytest.approx(20_000.0, abs=1e-6)


def test_edge_off_its_surface_is_refused(tmp_path: Path) -> None:
    outside = rhino3dm.Extrusion.Create(circle(2.0), 4.0, True)
    # Rhino counts inner profiles from the start of the outer one: this one sticks out.
    outside.AddInnerProfile(circle(1.0))
    with pytest.raises(FormatError, match=r"face 2: Edges must lie on their surface; at \(3, 0"):
        patches(outside, tmp_path / "a.3dm")


# --- faces that the library cannot make, in its own words -----------------------------------


class Interval:
    def __init__(self, low: float, high: float) -> None:
        self.T0, self.T1 = low, high


class Edge:
    """Stands for a BrepEdge: the image of a curve in the parameter plane."""

    def __init__(self, surface: Any, curve: Any) -> None:
        self.surface, self.curve, self.Domain = surface, curve, Interval(2.0, 4.0)

    def ToNurbsCurve(self) -> None:
        return None

    def PointAt(self, t: float) -> Any:
        uv = np.array([self.curve(0.5 * (t - 2.0))])
        inside = self.surface.domain.reduce(uv)
        return rhino3dm.Point3d(*self.surface.jet(inside).point[0].tolist())


class Word:
    def __init__(self, **entries: Any) -> None:
        self.__dict__.update(entries)


def loop(kind: str, *trims: tuple[int, bool]) -> Word:
    made = [Word(EdgeIndex=i, IsReversed=back) for i, back in trims]
    return Word(LoopType=Word(name=kind), Trims=made)


def loops(surface: Any, edges: list[Edge], *parts: Word) -> tuple[np.ndarray, ...]:
    return loops_of_face(Word(Loops=list(parts)), edges, surface, np.zeros(3), 1e-6)


def straight(a: tuple[float, float], b: tuple[float, float]) -> Any:
    start, end = np.array(a), np.array(b)
    return lambda t: start + t * (end - start)


def around(u: float, v: float, radius: float) -> Any:
    return lambda t: (
        np.array([u, v]) + radius * np.array([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)])
    )


def wave() -> BSplineSurface:
    x, y = np.meshgrid(np.linspace(0, 10, 6), np.linspace(0, 8, 6), indexing="ij")
    return BSplineSurface(np.stack([x, y, np.sin(x) + 0.5 * np.cos(y)], axis=-1), (3, 3))


def tube() -> BSplineSurface:
    angles = 2 * np.pi * np.arange(9) / 9
    ring = np.stack([4 * np.cos(angles), 4 * np.sin(angles), 0 * angles], axis=1)
    rows = np.stack([ring + 2.0 * k * np.eye(3)[2] for k in range(4)], axis=1)
    return BSplineSurface(rows, (3, 3), periodic=(True, False))


def test_curved_face_with_a_round_edge_and_a_hole() -> None:
    surface = wave()
    edges = [Edge(surface, around(0.5, 0.5, 0.4)), Edge(surface, around(0.4, 0.6, 0.1))]
    # The hole comes first and runs the other way; its edge is stored backwards.
    outer, hole = loops(surface, edges, loop("Inner", (1, False)), loop("Outer", (0, True)))
    for ring, middle, radius in ((outer, (0.5, 0.5), 0.4), (hole, (0.4, 0.6), 0.1)):
        assert np.hypot(*(ring - middle).T) == pytest.approx(radius, abs=1e-9)
    assert area(outer) == pytest.approx(np.pi * 0.16, rel=3e-3)
    assert area(hole) == pytest.approx(-np.pi * 0.01, rel=2e-2)


def test_reversed_edges_run_on_into_each_other() -> None:
    surface = wave()
    corners = [(0.1, 0.2), (0.9, 0.1), (0.7, 0.8)]
    edges = [
        Edge(surface, straight(corners[0], corners[1])),
        Edge(surface, straight(corners[2], corners[1])),
        Edge(surface, straight(corners[2], corners[0])),
    ]
    (ring,) = loops(surface, edges, loop("Outer", (0, False), (1, True), (2, False)))
    assert ring == pytest.approx(np.array(corners), abs=1e-9)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("start", [0.0, 0.5])
def test_half_of_a_closed_tube(start: float, first: int) -> None:
    surface = tube()
    end = start + 0.5
    box = [(start, 0.2), (end, 0.2), (end, 0.9), (start, 0.9)]
    edges = [Edge(surface, straight(a, b)) for a, b in zip(box, [*box[1:], box[0]], strict=True)]
    turned = [(i % 4, False) for i in range(first, first + 4)]
    (ring,) = loops(surface, edges, loop("Outer", *turned))
    assert ring == pytest.approx(np.roll(np.array(box), -first, axis=0), abs=1e-9)


def test_hole_of_two_edges_over_the_seam() -> None:
    surface = tube()
    corners = [(0.9, 0.3), (1.1, 0.3), (1.2, 0.6), (1.0, 0.8)]
    pairs = zip(corners, [*corners[1:], corners[0]], strict=True)
    edges = [Edge(surface, straight(a, b)) for a, b in pairs]
    _, hole = loops(surface, edges, loop("Inner", *((i, False) for i in range(4))))
    assert np.ptp(hole, axis=0) == pytest.approx([0.3, 0.5], abs=1e-9)
    x, y = np.array(corners).T
    expected = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert area(hole) == pytest.approx(-expected, abs=1e-9)


def test_hole_over_the_seam_goes_on_beyond_the_bound() -> None:
    surface = tube()
    edges = [Edge(surface, around(0.0, 0.5, 0.1))]
    _, hole = loops(surface, edges, loop("Inner", (0, False)))
    assert np.ptp(hole, axis=0) == pytest.approx(0.2, abs=1e-2)
    assert area(hole) == pytest.approx(-np.pi * 0.01, rel=2e-2)


def test_loop_once_around_is_refused() -> None:
    surface = tube()
    edges = [Edge(surface, straight((0.0, 0.5), (1.0, 0.5)))]
    with pytest.raises(FormatError, match="goes around a closed surface"):
        loops(surface, edges, loop("Outer", (0, False)))


def test_two_outer_loops_are_refused() -> None:
    surface = wave()
    edges = [Edge(surface, around(0.3, 0.3, 0.1)), Edge(surface, around(0.7, 0.7, 0.1))]
    with pytest.raises(FormatError, match="one outer loop; found 2"):
        loops(surface, edges, loop("Outer", (0, False)), loop("Outer", (1, False)))


def test_loop_without_area_or_edges_is_refused() -> None:
    surface = wave()
    line = Edge(surface, straight((0.2, 0.2), (0.8, 0.8)))
    with pytest.raises(FormatError, match="must enclose area"):
        loops(surface, [line], loop("Outer", (0, False), (0, True)))
    with pytest.raises(FormatError, match="must have an edge"):
        loops(surface, [line], loop("Outer", (-1, False)))
