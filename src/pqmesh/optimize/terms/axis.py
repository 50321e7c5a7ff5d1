"""Term: nodes whose axis is prescribed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm, unit


@dataclass(frozen=True, eq=False)
class NodeAxis:
    """(n_f - n_g) . a for faces f, g that follow each other around a vertex with axis a.

    Where all of them vanish the faces make one angle with a: they touch a cone about a, and the
    vertex moves along a when all its faces move by the same distance.

    References: tangent cones and node axes [thesis] chapter 4.

    Attributes
    ----------
    axes : (m, 3)
        Unit axis of each element.
    """

    stencils: Mapping[str, Indices]
    axes: Floats

    @classmethod
    def on(cls, mesh: PolyMesh, vertices: Indices, axes: ArrayLike) -> Self:
        """One element for each two faces that follow each other; one axis, or one a vertex.

        The last and the first face of a closed star follow from the others.
        """
        wanted = np.broadcast_to(unit(np.asarray(axes, dtype=np.float64)), (len(vertices), 3))
        rows, owner = [np.empty((0, 6), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
        for number, vertex in enumerate(vertices.tolist()):
            neighbors, faces = mesh.topology.star(vertex)
            corners = mesh.topology.quads[faces]
            opposite = corners[np.arange(len(faces)), ((corners == vertex).argmax(axis=1) + 2) % 4]
            k = len(faces) - 1
            following = neighbors[np.arange(2, k + 2) % len(neighbors)]
            center = np.full(k, vertex)
            rows.append(
                np.stack(
                    [center, neighbors[:k], opposite[:k], neighbors[1 : k + 1], opposite[1:],
                     following], axis=1)
            )  # fmt: skip
            owner.append(np.full(k, number))
        return cls({"vertices": np.concatenate(rows)}, wanted[np.concatenate(owner)])

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, 1) and Jacobian (m, 1, 6, 3)."""
        center, first, before, spoke, after, last = np.moveaxis(rows, 1, 0)
        value, by_p, by_q = self._along(before - center, spoke - first)
        other, by_r, by_s = self._along(after - center, last - spoke)
        jacobian = np.stack([by_r - by_p, -by_q, by_p, by_q + by_s, -by_r, -by_s], axis=1)
        return (value - other)[:, None], jacobian[:, None]

    def _along(self, p: Floats, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Products n . a of faces with diagonals p, q, and its gradients with respect to them."""
        area = cross(p, q)
        length = np.maximum(norm(area), TINY)[:, None]
        normal = area / length
        along = dot(normal, self.axes)
        slope = (self.axes - along[:, None] * normal) / length
        return along, cross(q, slope), cross(slope, p)
