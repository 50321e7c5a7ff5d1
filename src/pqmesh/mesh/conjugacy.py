"""Are the mesh lines conjugate, as flat faces need? Judged on one mesh, without its surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pqmesh.mesh.measure import planarity
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.mesh.topology import Stars
from pqmesh.vectors import TINY, Floats, Indices, Mask, cross, dot, norm, unit

# Planarity below which a face counts as flat, whatever its lines do.
FLAT_FACE = 1e-7
# Curvature times the radius of the mesh below which a place has no directions to speak of: it
# lies within an eighth of that of a plane over the whole mesh.
FLAT_PLACE = 1e-3
# A face whose lines must turn by more than this, radians, is far from conjugate; by more than
# the second, its lines are nearer to asymptotic than to conjugate directions.
FAR, ASYMPTOTIC = np.radians(10.0), np.radians(45.0)
# A net counts as conjugate up to this median turn, radians.
NEAR = np.radians(1.0)
# Between 2 (p ~ h) and 8 (p ~ h^3): from here on the faces become flat faster than they become
# small. Below the second the twist changes its sign from face to face: a rough mesh.
CONVERGING, ROUGH = 4.0, 1.0
# Fewer blocks, or lines that bend by more than this at a vertex (radians), decide nothing.
FEWEST_BLOCKS, COARSE = 4, 1.0
# A corner of the block whose sine is below this has no two directions.
LEAST_SINE = 1e-3

VERDICTS = ("conjugate", "nearly conjugate", "far from conjugate", "asymptotic", "undecided")


@dataclass(frozen=True, eq=False)
class Conjugacy:
    """How far the two families of mesh lines are from conjugate.

    Attributes
    ----------
    turn : (F,)
        Angle by which the two directions of each face must turn (root of the sum of squares) to
        be conjugate, to first order, radians in [0, pi/2]; 0 for flat faces and in flat places,
        NaN where the face has no regular interior vertex.
    ratio : (n,)
        Planarity of each block of 2 x 2 faces over the mean of its faces: 8 on a conjugate net,
        2 on another, below 1 where the mesh is rough; NaN for blocks of flat faces.
    family_angle : (n,)
        Angle between the families at the middle of each block, radians in [0, pi/2].
    bend : float
        Median over the blocks of the angle by which lines bend at a vertex, radians.
    """

    turn: Floats
    ratio: Floats
    family_angle: Floats
    bend: float

    @cached_property
    def decided(self) -> Mask:
        """Faces that could be judged, shape (F,)."""
        return np.isfinite(self.turn)

    @property
    def turn_median(self) -> float | None:
        """Median turn of the judged faces, radians."""
        return float(np.median(self.turn[self.decided])) if self.decided.any() else None

    @property
    def ratio_median(self) -> float | None:
        """Median ratio of the blocks that are not flat."""
        known = self.ratio[np.isfinite(self.ratio)]
        return float(np.median(known)) if len(known) else None

    @property
    def is_far(self) -> Mask:
        """Faces whose lines must turn by more than 10 degrees, shape (F,)."""
        return np.asarray(np.nan_to_num(self.turn) > FAR)

    @property
    def is_asymptotic(self) -> Mask:
        """Faces whose lines are nearer to asymptotic than to conjugate directions, (F,)."""
        return np.asarray(np.nan_to_num(self.turn) > ASYMPTOTIC)

    @property
    def far_share(self) -> float | None:
        """Share of the judged faces that are far from conjugate."""
        return float(self.is_far[self.decided].mean()) if self.decided.any() else None

    @property
    def is_rough(self) -> bool:
        """The twist changes its sign from face to face, and by more than the net explains."""
        return (self.ratio_median or CONVERGING) < ROUGH and (self.turn_median or 0.0) > NEAR

    @property
    def is_coarse(self) -> bool:
        """Too few blocks, or too strongly bent ones, to speak of directions."""
        return len(self.ratio) < FEWEST_BLOCKS or self.bend > COARSE

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        turn, ratio = self.turn_median, self.ratio_median
        if self.decided.all() and not self.turn.any():
            # Nothing has to turn, however few faces there are.
            return "conjugate"
        if turn is None or self.is_coarse:
            return "undecided"
        if ratio is None or turn <= NEAR or ratio >= CONVERGING:
            return "conjugate"
        if self.is_rough:
            return "undecided"
        if turn > ASYMPTOTIC:
            return "asymptotic"
        return "far from conjugate" if turn > FAR else "nearly conjugate"

    @property
    def lines_are_far(self) -> bool:
        """The lines as a whole are far from conjugate: they must slide, not only bend a little."""
        return self.verdict in ("far from conjugate", "asymptotic")


def conjugacy(mesh: PolyMesh) -> Conjugacy:
    """How far the mesh lines are from conjugate, from the twist of the faces and their blocks.

    Around every interior vertex of valence 4 lie four faces: a block of 2 x 2. The star gives the
    second fundamental form II along the two families, the twist of the faces (twice the signed
    distance of their diagonals, over their size) gives II(u, v), which must be 0. To first order
    the directions must turn by

        |II(u, v)| / sqrt(II(Ju, v)^2 + II(u, Jv)^2),    J the quarter turn,

    which depends neither on the size of the faces nor on the unit. It is a right angle where both
    families are asymptotic. The ratio of planarities is a test of its own: p falls with the third
    power of the edge on a conjugate net and with the first on any other.

    Parameters
    ----------
    mesh : PolyMesh
        Judged where four quads meet.

    References: planarity and conjugate directions [liu2006]; [thesis] section 2.1.

    Examples
    --------
    >>> from pqmesh.mesh.exact import grid_mesh
    >>> x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9), indexing="ij")
    >>> found = conjugacy(grid_mesh(np.stack([x, y, 0.2 * x * y], axis=-1)))
    >>> found.verdict, round(found.ratio_median, 1)
    ('asymptotic', 2.0)
    """
    star = _regular_star(mesh)
    if star is None:
        none = np.empty(0)
        flat = np.where(planarity(mesh) <= FLAT_FACE, 0.0, np.nan)
        return Conjugacy(flat, none, none, 0.0)
    form = _second_form(mesh, star)
    turn = np.arctan2(np.abs(form.mixed), form.pull)
    turn[form.curvature * _radius(mesh) <= FLAT_PLACE] = 0.0
    flat = planarity(mesh)
    faces = _mean_around(turn, form.sound, star.faces, mesh.topology.n_faces)
    faces[flat <= FLAT_FACE] = 0.0
    mean = flat[star.faces].mean(axis=1)
    clear = form.sound & (mean > FLAT_FACE)
    ratio = np.where(clear, form.block_planarity / np.where(clear, mean, 1.0), np.nan)
    bends = form.curvature[form.sound] * mesh.mean_edge_length
    bend = float(np.median(bends)) if len(bends) else 0.0
    return Conjugacy(faces, ratio[form.sound], form.angle[form.sound], bend)


class _Form(NamedTuple):
    """Second form at the middle of each block; curvatures in 1/length."""

    mixed: Floats
    pull: Floats
    curvature: Floats
    angle: Floats
    block_planarity: Floats
    sound: Mask


def _regular_star(mesh: PolyMesh) -> Stars | None:
    """Stars of the interior vertices at which four quads meet."""
    for star in mesh.topology.stars():
        if star.neighbors.shape[1] == 4:
            quads = (mesh.topology.face_sizes[star.faces] == 4).all(axis=1)
            return Stars(star.vertices[quads], star.neighbors[quads], star.faces[quads])
    return None


def _second_form(mesh: PolyMesh, star: Stars) -> _Form:
    """Directions, second form and block of each star."""
    center, near = mesh.vertices[star.vertices], mesh.vertices[star.neighbors]
    topology = mesh.topology
    around = topology.indices[topology.offsets[star.faces][..., None] + np.arange(4)]
    place = (around == star.vertices[:, None, None]).argmax(axis=-1)
    opposite = np.take_along_axis(around, ((place + 2) % 4)[..., None], axis=-1)[..., 0]
    far = mesh.vertices[opposite]
    normal = mesh.vertex_normals[star.vertices]
    spokes = near - center[:, None]
    length = norm(spokes)
    sound = length.min(axis=1) > 1e-9 * np.maximum(length.max(axis=1), TINY)
    # Normal curvature of a line through three points with unequal steps.
    ways = unit(spokes)
    height = dot(ways, normal[:, None])
    steps = np.maximum(length[:, :2] + length[:, 2:], TINY)
    along = 2.0 * (height[:, :2] + height[:, 2:]) / steps
    # Mixed difference of each face against its own normal: twice the distance of its diagonals.
    # Its sign follows the quarter of the block. The mean over the block leaves out noise.
    twist = dot(
        center[:, None] - near + far - np.roll(near, -1, axis=1), mesh.face_normals[star.faces]
    )
    signed = twist @ np.array([1.0, -1.0, 1.0, -1.0])
    size = (length * np.roll(length, -1, axis=1)).sum(axis=1)
    mixed = signed / np.maximum(size, TINY)
    u, v = unit(near[:, 0] - near[:, 2]), unit(near[:, 1] - near[:, 3])
    cosine, sine = dot(u, v), norm(cross(u, v))
    sound &= sine > LEAST_SINE
    sine = np.maximum(sine, LEAST_SINE)
    first, second = along[:, 0], along[:, 1]
    # Ju = (v - cos u) / sin and Jv = (cos v - u) / sin.
    pull = np.hypot((second - cosine * mixed) / sine, (cosine * mixed - first) / sine)
    # The form in the orthonormal frame u, Ju.
    across = (mixed - cosine * first) / sine
    last = (second - 2.0 * cosine * mixed + cosine**2 * first) / sine**2
    curvature = np.abs(0.5 * (first + last)) + np.hypot(0.5 * (first - last), across)
    block, sized = _block_planarity(far)
    sound &= sized & (norm(normal) > 0.5)
    return _Form(mixed, pull, curvature, np.arctan2(sine, np.abs(cosine)), block, sound)


def _block_planarity(corners: Floats) -> tuple[Floats, Mask]:
    """Diagonal distance over mean diagonal of the outer corners (n, 4, 3), and where it exists."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    normal = cross(c - a, d - b)
    first, second = norm(c - a), norm(d - b)
    sized = norm(normal) > LEAST_SINE * np.maximum(first * second, TINY)
    distance = np.abs(dot(b - a, unit(normal)))
    return np.where(sized, 2.0 * distance / np.maximum(first + second, TINY), 0.0), sized


def _mean_around(values: Floats, sound: Mask, faces: Indices, count: int) -> Floats:
    """Mean over the blocks that a face belongs to, NaN without one."""
    where = faces[sound].ravel()
    total = np.bincount(where, np.repeat(values[sound], 4), minlength=count)
    number = np.bincount(where, minlength=count)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def _radius(mesh: PolyMesh) -> float:
    """Largest distance of a vertex from the middle of the mesh, model unit."""
    return float(norm(mesh.vertices - mesh.vertices.mean(axis=0)).max())
