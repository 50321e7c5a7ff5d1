"""The models that tests write: what stands in them, and that it comes back."""

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pqmesh.errors import FormatError, PqmeshError, SpecError, SurfaceError
from pqmesh.io.rhino import SurfaceFile, read_rhino_surfaces
from pqmesh.surface.base import Jet
from pqmesh.surface.bspline import BSplineSurface
from pqmesh.surface.closest import closest_point
from pqmesh.surface.plan import Patch, PlanSurface, ring_distance, seams
from pqmesh.vectors import norm

rhino3dm = pytest.importorskip("rhino3dm", reason="rhino3dm (extra aec) is not installed")

import brep_archive  # noqa: E402
import models  # noqa: E402
import roof_brep  # noqa: E402

ORIGIN = (5e8, 3e8, 0.0)
FACES = range(3)


def far(points: np.ndarray) -> np.ndarray:
    return 1000.0 * points + np.array(ORIGIN)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return models.write_roof_model(tmp_path_factory.mktemp("models") / "roof.3dm")


@pytest.fixture(scope="module")
def roof(path: Path) -> SurfaceFile:
    return read_rhino_surfaces(path, "ROOF")


def plan(file: SurfaceFile) -> PlanSurface:
    return PlanSurface(tuple(Patch(p.surface, p.loops, f"{p.name} {p.face}") for p in file.patches))


def whole(file: SurfaceFile, scale: float = 1000.0) -> BSplineSurface:
    """The roof before it was split, in the unit of the file and about its origin."""
    net = models.roof_net()
    place = np.array(ORIGIN if file.origin.any() else (0.0, 0.0, 0.0))
    return BSplineSurface(scale * net.points + (place - file.origin), net.degrees, net.knots)


def slopes(jet: Jet) -> np.ndarray:
    """Derivatives of z by x and y of a parametric jet, by the chain rule; shape (5, N)."""
    plane = np.stack([jet.du[:, :2], jet.dv[:, :2]], axis=1)
    first = np.linalg.solve(plane, np.stack([jet.du[:, 2:], jet.dv[:, 2:]], axis=1))
    rows = []
    for row in (jet.duu, jet.duv, jet.dvv):
        rows.append(row[:, 2] - (row[:, :2] * first[..., 0]).sum(axis=1))
    bend = np.stack([rows[0], rows[1], rows[1], rows[2]], axis=1).reshape(-1, 2, 2)
    half = np.linalg.solve(plane, bend)
    second = np.linalg.solve(plane, half.swapaxes(1, 2))
    return np.stack([*first[..., 0].T, second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]])


# --- the archive ----------------------------------------------------------------------------


def test_archive_is_what_rhino_writes_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[bytes] = []
    real = brep_archive.archive_bytes

    def kept(*parts: Any) -> bytes:
        written.append(real(*parts))
        return written[-1]

    monkeypatch.setattr(brep_archive, "archive_bytes", kept)
    made = models.roof_brep(far)
    again = base64.b64decode(made.Encode()["data"])
    assert again == written[0]


def test_roof_is_one_valid_joined_brep() -> None:
    made = models.roof_brep(far)
    assert made.IsValidWithLog == (True, "")
    assert made.IsManifold
    assert not made.IsSurface
    assert (len(made.Faces), len(made.Edges), len(made.Vertices)) == (3, 6, 4)
    assert [made.Faces[i].OrientationIsReversed for i in FACES] == [False, True, False]


# --- the roof -------------------------------------------------------------------------------


def test_roof_has_three_faces_on_its_layer(roof: SurfaceFile) -> None:
    assert [(p.name, p.layer, p.face) for p in roof.patches] == [("roof", "ROOF", i) for i in FACES]
    assert roof.units == "mm"
    assert (roof.origin == np.round(roof.origin)).all()
    assert np.abs(roof.origin - ORIGIN).max() < 1000.0


def test_patches_are_parts_of_the_roof(roof: SurfaceFile) -> None:
    net = models.roof_net()
    original = BSplineSurface(net.points, net.degrees, net.knots)
    rng = np.random.default_rng(2)
    for patch, longer, exchanged in zip(
        roof.patches, (1.0, 1.0, 60.0), (False, True, False), strict=True
    ):
        domain = patch.surface.domain
        uv = domain.low + rng.random((200, 2)) * domain.size
        own = (uv[:, ::-1] if exchanged else uv) / longer
        gap = patch.surface.jet(uv).point + roof.origin - far(original.jet(own).point)
        # Coordinates of 5e8 are rounded to 6e-8.
        assert np.abs(gap).max() < 3e-7


def test_loops_follow_the_trim_curves(roof: SurfaceFile) -> None:
    edges = models.roof_brep(far).Edges
    own = ((3, 4), (4, 2, 5, 0), (1, 5))
    for patch, numbers in zip(roof.patches, own, strict=True):
        (loop,) = patch.loops
        domain = patch.surface.domain
        assert domain.inside(loop, 1e-12).all()
        assert 0.3 < area(loop) / float(np.prod(domain.size)) < 0.99
        for edge in (edges[i] for i in numbers):
            at = np.linspace(edge.Domain.T0, edge.Domain.T1, 301).tolist()
            points = np.array([[p.X, p.Y, p.Z] for p in map(edge.PointAt, at)]) - roof.origin
            foot = closest_point(patch.surface, points)
            assert foot.distance.max() < 1e-6
            # The curves in the parameter plane are straight between corners, as the loop is.
            assert ring_distance(loop / domain.size, foot.uv / domain.size).max() < 1e-9


def area(ring: np.ndarray) -> float:
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def test_faces_reach_about_three_metres_over_the_site(roof: SurfaceFile) -> None:
    site = far(np.column_stack([models.roof_outline(), np.zeros(8)]))[:, :2] - roof.origin[:2]
    for patch in roof.patches:
        loop = patch.loops[0]
        lifted = patch.surface.jet(loop).point[:, :2]
        on_seam = (np.abs(lifted[:, 1]) < 1.0) | seam_ends(patch.surface, loop)
        gaps = ring_distance(site, lifted[~on_seam])
        assert 2900.0 < gaps.min() <= gaps.max() < 3100.0


def seam_ends(surface: BSplineSurface, loop: np.ndarray) -> np.ndarray:
    """Truth for corners of a loop on a bound of its surface."""
    return ((loop == surface.domain.low) | (loop == surface.domain.high)).any(axis=1)


@pytest.mark.parametrize(("origin", "limit"), [(ORIGIN, 5e-9), ((0.0, 0.0, 0.0), 1e-11)])
def test_faces_are_one_smooth_surface_over_the_plan(
    tmp_path: Path, origin: tuple[float, float, float], limit: float
) -> None:
    path = models.write_roof_model(tmp_path / "a.3dm", origin=origin)
    file = read_rhino_surfaces(path, "ROOF")
    surface, original = plan(file), whole(file)
    rng = np.random.default_rng(4)
    uv = rng.uniform((0.05, 0.1), (0.95, 0.9), (3000, 2))
    jet = original.jet(uv)
    assert surface.contains(jet.point[:, :2]).all()
    found = surface.jet(jet.point[:, :2])
    assert np.abs(found.point - jet.point).max() < 1e-11 * 70_000
    expected = slopes(jet)
    mine = np.stack(found)[1:, :, 2]
    size = np.abs(expected).max(axis=1)
    # Rounding at 5e8, 6e-8 mm, is 1e-12 of the roof; second derivatives magnify it.
    assert (np.abs(mine - expected).max(axis=1) < limit * size).all()


def test_seams_are_as_smooth_as_the_roof(roof: SurfaceFile) -> None:
    found = seams(plan(roof))
    assert [(s.first, s.second) for s in found] == [("roof 0", "roof 1"), ("roof 1", "roof 2")]
    for seam in found:
        assert seam.gap < 1e-7
        assert seam.angle < 1e-9
        # Curvatures of the roof are about 1e-4 a millimetre.
        assert seam.curvature < 1e-12


def test_seam_points_belong_to_the_roof(roof: SurfaceFile) -> None:
    surface, original = plan(roof), whole(roof)
    v = np.linspace(0.1, 0.9, 4001)
    for u in (0.26, 0.73):
        on = original.jet(np.column_stack([np.full_like(v, u), v])).point[:, :2]
        assert surface.contains(on).all()


@pytest.mark.parametrize(
    ("unit", "name", "scale"), [("Meters", "m", 1.0), ("Feet", "ft", 1 / 0.3048)]
)
def test_roof_in_other_units(tmp_path: Path, unit: str, name: str, scale: float) -> None:
    path = models.write_roof_model(tmp_path / "a.3dm", unit, (0.0, 0.0, 0.0))
    file = read_rhino_surfaces(path, "roof")
    assert file.units == name
    assert not file.origin.any()
    left = file.patches[0].surface
    assert left.points[0, 0] == pytest.approx(scale * models.roof_net().points[0, 0], rel=1e-15)


def test_other_layers_hold_junk_and_the_site(path: Path) -> None:
    file = rhino3dm.File3dm.Read(str(path))
    kinds: dict[str, list[str]] = {layer.Name: [] for layer in file.Layers}
    for found in file.Objects:
        if not found.Attributes.IsInstanceDefinitionObject:
            kind = found.Geometry.ObjectType.name
            kinds[file.Layers[found.Attributes.LayerIndex].Name].append(kind)
    assert kinds == {
        "ROOF": ["Brep"],
        "SITE": ["Curve"],
        "CONTEXT": ["Surface", "Mesh"],
        "SURVEY": ["Point", "TextDot"],
        "TREES": ["InstanceReference"],
        "AXES": ["Curve"],
        "LIGHTS": [],
    }
    with pytest.raises(SpecError, match="several layers"):
        read_rhino_surfaces(path)


def test_hole_of_a_trimmed_face_is_read(tmp_path: Path) -> None:
    net = models.roof_net()
    rings = [circle((0.5, 0.5), 0.4, net), circle((0.4, 0.55), 0.1, net)[::-1]]
    curves = [roof_brep.lifted(net, ring, far) for ring in rings]
    edges = [brep_archive.Edge(curve, i, i) for i, curve in enumerate(curves)]
    loops = [[brep_archive.Trim(roof_brep.flat(ring, False), i, False)]
             for i, ring in enumerate(rings)]  # fmt: skip
    face = brep_archive.Face(brep_archive.Net(net.degrees, net.knots, far(net.points)), loops)
    made = brep_archive.brep(np.array([curve.points[0] for curve in curves]), edges, [face])
    assert made.IsValidWithLog == (True, "")
    path = models.Model("Millimeters").add(made, "ROOF").write(tmp_path / "a.3dm")
    (patch,) = read_rhino_surfaces(path).patches
    outer, hole = patch.loops
    assert area(outer) == pytest.approx(area(rings[0]), rel=1e-3)
    assert area(hole) == pytest.approx(area(rings[1]), rel=1e-3)
    for loop, ring in zip(patch.loops, rings, strict=True):
        # The trim curves are polygons, and keep each corner.
        assert ring_distance(ring, loop).max() < 1e-9
        assert ring_distance(loop, ring).max() < 1e-9


def circle(middle: tuple[float, float], radius: float, net: Any) -> np.ndarray:
    """A polygon of 40 corners, closed, with points where it crosses knots."""
    turn = 2 * np.pi * np.arange(41) / 40
    ring = middle + radius * np.column_stack([np.cos(turn), np.sin(turn)])
    ring[-1] = ring[0]
    return roof_brep.with_crossings(ring, net)


# --- models to refuse -----------------------------------------------------------------------


def test_zoo_is_written_under_its_names(tmp_path: Path) -> None:
    written = models.write_models_zoo(tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == set(written) == set(models.ZOO)


@pytest.mark.parametrize(
    ("name", "kind", "text"),
    [
        ("empty", FormatError, "this one is empty"),
        ("block", SpecError, "'ROOF' holds 1 block instance. Explode"),
        ("crease", SurfaceError, "face 0: .* this is a crease"),
        ("encrypted", FormatError, "damaged or encrypted"),
        ("truncated", FormatError, "cut off"),
        ("newer", FormatError, "of version 9"),
        ("text", FormatError, "must begin with"),
    ],
)
def test_bad_model_is_refused_when_read(
    tmp_path: Path, name: str, kind: type[PqmeshError], text: str
) -> None:
    with pytest.raises(kind, match=text):
        read_rhino_surfaces(models.ZOO[name](tmp_path / "a.3dm"), "ROOF")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("fold", "face 0 'roof 0' stands upright or turns over near"),
        ("upright", "face 0 'wall 0' stands upright or turns over near"),
        ("two_storeys", "face 0 'upper 0' lies over face 1 'lower 0' near"),
    ],
)
def test_model_that_is_no_graph_is_refused_by_the_plan(
    tmp_path: Path, name: str, text: str
) -> None:
    file = read_rhino_surfaces(models.ZOO[name](tmp_path / "a.3dm"), "ROOF")
    with pytest.raises((SpecError, SurfaceError), match=text):
        plan(file)


def test_two_layers_need_a_choice(tmp_path: Path) -> None:
    path = models.write_two_layers(tmp_path / "a.3dm")
    with pytest.raises(SpecError, match=r"'ROOF' \(1\), 'CEILING' \(1\)"):
        read_rhino_surfaces(path)
    assert len(read_rhino_surfaces(path, "ceiling").patches) == 1


def test_plain_model_is_good(tmp_path: Path) -> None:
    surface = plan(read_rhino_surfaces(models.write_plain(tmp_path / "a.3dm"), "ROOF"))
    corners = models.roof_outline()
    assert surface.contains(corners).all()
    points = surface.jet(corners).point
    foot = closest_point(surface.patches[0].surface, points)
    assert norm(foot.jet.point - points).max() < 1e-12 * 70
