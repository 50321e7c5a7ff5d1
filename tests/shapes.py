"""Points, meshes and moves that several tests share; closed formulas only."""

from __future__ import annotations

import numpy as np

from pqmesh.mesh.exact import grid_faces, grid_mesh, rotational_mesh
from pqmesh.mesh.quadmesh import PolyMesh, QuadMesh
from pqmesh.mesh.solids import sphere_tangent_mesh
from pqmesh.mesh.topology import Topology, drop_unused

# --- smooth surfaces --------------------------------------------------------------------------


def sampled(formula, u, v):
    """Values of formula(u, v) on the grid of two lists, shape (len(u), len(v), ...)."""
    return formula(*np.meshgrid(np.asarray(u, float), np.asarray(v, float), indexing="ij"))


def torus(u, v, big=3.0, small=1.0):
    """Points and unit normals; u runs around the axis."""
    normal = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=-1)
    center = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=-1)
    return big * center + small * normal, normal


def cyclide(u, v, a=3.0, c=1.0, d=1.7):
    """Dupin cyclide in curvature parameters: points, unit normals, principal curvatures."""
    b = np.sqrt(a * a - c * c)
    q = a - c * np.cos(u) * np.cos(v)
    point = np.stack(
        [
            d * (c - a * np.cos(u) * np.cos(v)) + b * b * np.cos(u),
            b * np.sin(u) * (a - d * np.cos(v)),
            b * np.sin(v) * (c * np.cos(u) - d),
        ],
        axis=-1,
    )
    point = point / q[..., None]
    center = np.stack([a * np.cos(u), b * np.sin(u), np.zeros_like(u)], axis=-1)
    normal = (point - center) / (d - c * np.cos(u))[..., None]
    curvature = np.stack([-np.cos(v) / (d * np.cos(v) - a), -1.0 / (d - c * np.cos(u))], axis=-1)
    return point, normal, curvature


def ellipsoid(s, t, axes=(3.0, 2.0, 1.2)):
    """Points of the ellipsoid in curvature parameters, and mu, nu of the confocal family."""
    a, b, c = axes
    k = (a * a - b * b) / (a * a - c * c)
    point = np.stack(
        [
            a * np.cos(t) * np.sqrt(np.cos(s) ** 2 + k * np.sin(s) ** 2),
            b * np.cos(s) * np.sin(t),
            c * np.sin(s) * np.sqrt(np.sin(t) ** 2 + (1 - k) * np.cos(t) ** 2),
        ],
        axis=-1,
    )
    mu = c * c * np.cos(s) ** 2 + b * b * np.sin(s) ** 2
    nu = b * b * np.cos(t) ** 2 + a * a * np.sin(t) ** 2
    return point, mu, nu


# --- meshes -----------------------------------------------------------------------------------


def curved_mesh(m=6, n=5, noise=0.0, seed=0):
    """A dome that is neither planar nor circular nor conical, cells about 1 wide."""
    x, y = np.meshgrid(np.arange(m + 1.0), np.arange(n + 1.0), indexing="ij")
    z = 0.11 * x * y - 0.07 * x**2 - 0.09 * y**2 + 0.01 * x**3
    points = np.stack([x + 0.03 * y**2, y - 0.02 * x * y, z], axis=-1)
    points += noise * np.random.default_rng(seed).normal(size=points.shape)
    return grid_mesh(points)


def vertex_fan(spokes):
    """Interior vertex 0 at the origin with the given edges; faces are parallelograms.

    Neighbours are 1..k, face i lies between edges i and i+1.
    """
    p = np.asarray(spokes, float)
    k = len(p)
    following = np.roll(np.arange(k), -1)
    points = np.vstack([np.zeros((1, 3)), p, p + p[following]])
    faces = np.column_stack([np.zeros(k, int), 1 + np.arange(k), 1 + k + np.arange(k),
                             1 + following])  # fmt: skip
    return QuadMesh.of(points, faces)


def voxel_surface(cells):
    """Outer surface of a set of unit cubes (i, j, k), all quads, normals outwards."""
    solid = {tuple(cell) for cell in cells}
    steps = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    numbers: dict[tuple[int, ...], int] = {}
    faces = []
    for cell in sorted(solid):
        for axis in range(3):
            for side in (0, 1):
                if tuple(np.array(cell) + (2 * side - 1) * steps[axis]) in solid:
                    continue
                along, beside = steps[(axis + 1) % 3], steps[(axis + 2) % 3]
                corner = np.array(cell) + side * steps[axis]
                ring = [corner, corner + along, corner + along + beside, corner + beside]
                ring = ring if side else ring[::-1]
                faces.append([numbers.setdefault(tuple(x.tolist()), len(numbers)) for x in ring])
    return QuadMesh.of(np.array(list(numbers), float), faces)


def ring_of_cells(width, height, holes):
    """A slab of cubes one thick, without those at the holes."""
    return [(i, j, 0) for i in range(width) for j in range(height) if (i, j) not in holes]


def without_faces(mesh, gone):
    """The mesh without some faces and without the vertices that only they used."""
    faces = np.delete(mesh.faces, gone, axis=0)
    used, flat = np.unique(faces, return_inverse=True)
    return QuadMesh.of(mesh.vertices[used], flat.reshape(-1, 4))


def zoo():
    """Meshes of many topologies by name, with (Euler characteristic, boundary loops)."""
    grid = curved_mesh(6, 5)
    torus_points, _ = sampled(torus, np.arange(7) * 2 * np.pi / 7, np.arange(5) * 2 * np.pi / 5)
    tube, _ = sampled(torus, np.arange(4) * 0.3, np.arange(6) * 2 * np.pi / 6)
    five = np.arange(5) * 2 * np.pi / 5
    two = np.vstack([grid.vertices, grid.vertices + np.array([20.0, 0, 0])])
    return {
        "one_face": (grid_mesh(np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0.0]]])), 1, 1),
        "strip": (curved_mesh(1, 6), 1, 1),
        "grid": (grid, 1, 1),
        "annulus": (grid_mesh(tube, (False, True)), 0, 2),
        "torus": (grid_mesh(torus_points, (True, True)), 0, 0),
        "cube": (voxel_surface([(0, 0, 0)]), 2, 0),
        "l_shape": (voxel_surface([(0, 0, 0), (1, 0, 0), (0, 1, 0)]), 2, 0),
        "two_handles": (voxel_surface(ring_of_cells(5, 3, {(1, 1), (3, 1)})), -2, 0),
        "window": (without_faces(grid, [11, 12, 16, 17]), 0, 2),
        "two_windows": (without_faces(curved_mesh(7, 5), [6, 26]), -1, 3),
        "notch": (without_faces(grid, [2, 7]), 1, 1),
        "irregular_disc": (
            vertex_fan(np.column_stack([np.cos(five), np.sin(five), 0.1 * five])),
            1,
            1,
        ),
        "two_pieces": (QuadMesh.of(two, np.vstack([grid.faces, grid.faces + 42])), 2, 2),
    }


def polygon_mesh():
    """A pentagon, a hexagon, a triangle and a quad around one vertex."""
    faces = [[0, 1, 2, 3, 4], [0, 4, 5, 6, 7, 8], [0, 8, 9], [0, 9, 10, 1]]
    turns = np.arange(10) * 2 * np.pi / 10
    ring = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(10)])
    return PolyMesh.of(np.vstack([np.zeros((1, 3)), ring]), faces)


def crown(k=5):
    """A curved vertex of valence k >= 5: a pentagon, two triangles, and quads around it."""
    turn = 2 * np.pi * np.arange(k) / k
    inner = np.column_stack([np.cos(turn), np.sin(turn), np.full(k, -0.3)])
    outer = 1.9 * np.column_stack([np.cos(turn + np.pi / k), np.sin(turn + np.pi / k),
                                   np.full(k, -0.6)])  # fmt: skip
    aside = inner[1] + outer[0] - inner[0]
    points = np.vstack([np.zeros((1, 3)), inner, outer, aside])
    faces = [[0, 1, 1 + k, 1 + 2 * k, 2], [0, 2, 3], [0, 3, 4]]
    faces += [[0, 1 + i, 1 + k + i, 1 + (i + 1) % k] for i in range(3, k)]
    lists, used = drop_unused(faces, len(points))
    return PolyMesh.of(points[used], lists)


def icosahedron_corners():
    """The 12 corners of an icosahedron."""
    g = (1 + 5**0.5) / 2
    rows = [[0, a, b * g] for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    return np.array([np.roll(row, k) for row in rows for k in range(3)])


def dodecahedron():
    """12 pentagons, valence 3, around the unit sphere."""
    return sphere_tangent_mesh(icosahedron_corners())


def football():
    """12 pentagons and 20 hexagons of a truncated icosahedron, all touching the unit sphere."""
    corners = icosahedron_corners()
    return sphere_tangent_mesh(np.vstack([corners, dodecahedron().vertices]))


def icosahedron():
    """20 triangles, valence 5, around the unit sphere."""
    return sphere_tangent_mesh(dodecahedron().vertices)


def lantern(n=12, profile=((1.0, 1.2), (1.5, 0.8), (1.7, 0.2), (1.3, -0.6))):
    """A closed mesh of revolution: an n-gon on top, quads around, n triangles below.

    Conical and circular: its vertices have valence 3, 4 and n, and faces 3, 4 and n corners.
    """
    ring = rotational_mesh(profile, 2 * np.pi / n * np.arange(n), closed=True)
    loops = sorted(ring.topology.boundary_loops, key=lambda loop: -ring.vertices[loop[0], 2])
    pole = len(ring.vertices)
    top = loops[0][::-1].tolist()
    below = loops[1][::-1].tolist()
    fan = [[a, b, pole] for a, b in zip(below, below[1:] + below[:1], strict=True)]
    points = np.vstack([ring.vertices, [[0.0, 0.0, profile[-1][1] - 0.8]]])
    return PolyMesh.of(points, [*ring.topology.face_lists(), top, *fan])


def moebius_strip(n=5):
    """Faces of a strip of n quads closed with a half turn: no coherent orientation exists."""
    faces = [[2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2] for i in range(n - 1)]
    return [*faces, [2 * n - 2, 2 * n - 1, 0, 1]], 2 * n


# --- moves ------------------------------------------------------------------------------------


def renumbered(topology, rng):
    """The same abstract mesh with vertices, faces and first corners shuffled; and the map."""
    place = rng.permutation(topology.n_vertices)
    faces = []
    for face in topology.face_lists():
        turn = rng.integers(len(face))
        moved = place[np.asarray(face)].tolist()
        faces.append(moved[turn:] + moved[:turn])
    order = rng.permutation(len(faces))
    return Topology([faces[k] for k in order], topology.n_vertices), place


def torus_grid(m, n):
    """Abstract m x n torus grid."""
    return Topology(grid_faces(m, n, (True, True)), m * n)


def inverted(points, center, radius):
    """Points under the inversion in a sphere."""
    away = np.asarray(points) - center
    return center + radius**2 * away / (away**2).sum(axis=-1, keepdims=True)


def random_rotation(rng):
    """Rotation matrix, uniformly distributed."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def observed_orders(values):
    """Orders of a quantity measured at steps h, h/2, h/4, ..."""
    steps = np.abs(np.asarray(values, float))
    return np.log2(steps[:-1] / steps[1:])
