"""Polygons as one mesh with common corners, and as OBJ text whatever way they meet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.vectors import Floats


def polygons_mesh(polygons: Sequence[Floats]) -> tuple[Floats, list[list[int]]]:
    """Vertices (V, 3) and faces of polygons, corners with equal coordinates made one.

    Equal means bit for bit (0 and -0 are equal): nothing is moved. Vertices come in the order
    in which the polygons first use them. The faces need not form a manifold: trimmed panels
    may meet in a single corner, and a whole panel may have a cut corner of its neighbour on
    its side. `PolyMesh` takes them where they do not.

    Parameters
    ----------
    polygons : sequence of (k, 3), model unit

    Examples
    --------
    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> vertices, faces = polygons_mesh([square, square[:3] + [1.0, 0.0, 0.0]])
    >>> len(vertices), faces
    (6, [[0, 1, 2, 3], [1, 4, 5]])
    """
    if not polygons:
        return np.empty((0, 3)), []
    place: dict[tuple[float, float, float], int] = {}
    faces = []
    for points in polygons:
        # Adding 0 turns -0 into 0; tuples of equal numbers are one key.
        rows = (points + 0.0).tolist()
        faces.append([place.setdefault((x, y, z), len(place)) for x, y, z in rows])
    return np.array(list(place)), faces


def obj_from_polygons(polygons: Sequence[Floats], title: str = "panels") -> bytes:
    r"""OBJ text of polygons with common corners: 17 significant digits.

    Parameters
    ----------
    polygons : sequence of (k, 3), model unit
    title : str
        What they are, for the comment line.

    Examples
    --------
    >>> print(obj_from_polygons([np.array([[0.0, 0, 0], [1, 0, 0], [0, 0.5, 0]])]).decode())
    # Written by pqmesh: panels, 3 vertices, 1 faces
    v 0 0 0
    v 1 0 0
    v 0 0.5 0
    f 1 2 3
    """
    vertices, faces = polygons_mesh(polygons)
    rows = [
        f"# Written by pqmesh: {title}, {len(vertices)} vertices, {len(faces)} faces\n",
        *(f"v {x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in vertices.tolist()),
        *("f " + " ".join(str(k + 1) for k in face) + "\n" for face in faces),
    ]
    return "".join(rows).encode("ascii")
