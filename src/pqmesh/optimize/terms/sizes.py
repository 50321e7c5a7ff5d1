"""Terms of size: lengths of edges, widths and areas of panels, each compared with a bound."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from pqmesh.errors import MeshError
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, norm


class Range(NamedTuple):
    """A size between bounds as |residual| <= slack.

    The residual is size / scale - target, or scale / size where only a least size is asked for:
    that is as good a measure near the bound, and has no upper bound.

    Attributes
    ----------
    scale, target, slack : float
    inverse : bool
    """

    scale: float
    target: float
    slack: float
    inverse: bool

    @classmethod
    def of(cls, least: float | None, most: float | None, unit: float) -> Self:
        """Range from least to most, at least one of them given, measured in a unit.

        Examples
        --------
        >>> Range.of(1.0, 3.0, 2.0)
        Range(scale=2.0, target=1.0, slack=0.5, inverse=False)
        """
        if most is None:
            if least is None:
                raise ValueError("one of least and most must be given")
            return cls(least, 0.0, 1.0, True)
        if least is None:
            return cls(unit, 0.0, most / unit, False)
        return cls(unit, 0.5 * (least + most) / unit, 0.5 * (most - least) / unit, False)

    def compared(self, size: Floats, gradient: Floats, own: Floats) -> tuple[Floats, Floats]:
        """Residuals (m, r) of sizes (m, r) in units `own` (m, 1), and Jacobian (m, r, k, 3)."""
        scale = self.scale * own
        if self.inverse:
            size = np.maximum(size, TINY)
            slope = -scale / size**2
            return scale / size - self.target, slope[:, :, None, None] * gradient
        slope = np.broadcast_to(1.0 / scale, size.shape)
        return size / scale - self.target, slope[:, :, None, None] * gradient


@dataclass(frozen=True, eq=False)
class EdgeLength:
    """Length of each edge against a range: of lengths, or of shares of its own start length."""

    stencils: Mapping[str, Indices]
    bounds: Range
    own: Floats

    @classmethod
    def on(cls, mesh: PolyMesh, bounds: Range, edges: Indices, *, relative: bool = False) -> Self:
        """One element for each of the given edges (numbers of edges)."""
        own = mesh.edge_lengths[edges] if relative else np.ones(len(edges))
        return cls({"vertices": mesh.edges[edges]}, bounds, own[:, None])

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 1) and Jacobian (n, 1, 2, 3)."""
        length, along = _lengths(rows[:, 1] - rows[:, 0])
        return self.bounds.compared(
            length[:, None], np.stack([-along, along], axis=1)[:, None], self.own
        )


@dataclass(frozen=True, eq=False)
class PanelWidth:
    """Both widths of each panel, means of the lengths of opposite edges, against a range."""

    stencils: Mapping[str, Indices]
    bounds: Range

    @classmethod
    def on(cls, mesh: PolyMesh, bounds: Range, faces: Indices) -> Self:
        """One element for each of the given faces (numbers of quads)."""
        return cls({"vertices": _corners(mesh, faces)}, bounds)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 2) and Jacobian (n, 2, 4, 3)."""
        length, along = _lengths(np.roll(rows, -1, axis=1) - rows)
        sizes = 0.5 * (length[:, :2] + length[:, 2:])
        gradient = np.zeros((len(rows), 2, 4, 3))
        for side in range(4):
            gradient[:, side % 2, side] -= 0.5 * along[:, side]
            gradient[:, side % 2, (side + 1) % 4] += 0.5 * along[:, side]
        return self.bounds.compared(sizes, gradient, np.ones((len(rows), 1)))


@dataclass(frozen=True, eq=False)
class PanelArea:
    """Area of each panel, half the cross product of its diagonals, against a range."""

    stencils: Mapping[str, Indices]
    bounds: Range

    @classmethod
    def on(cls, mesh: PolyMesh, bounds: Range, faces: Indices) -> Self:
        """One element for each of the given faces (numbers of quads)."""
        return cls({"vertices": _corners(mesh, faces)}, bounds)

    def evaluate(self, rows: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 1) and Jacobian (n, 1, 4, 3)."""
        p, q = rows[:, 2] - rows[:, 0], rows[:, 3] - rows[:, 1]
        double, normal = _lengths(cross(p, q))
        by_p, by_q = 0.5 * cross(q, normal), 0.5 * cross(normal, p)
        gradient = np.stack([-by_p, -by_q, by_p, by_q], axis=1)[:, None]
        return self.bounds.compared(0.5 * double[:, None], gradient, np.ones((len(rows), 1)))


def _corners(mesh: PolyMesh, faces: Indices) -> Indices:
    """Corners (n, 4) of quads; raises MeshError for other faces."""
    topology = mesh.topology
    odd = faces[topology.face_sizes[faces] != 4]
    if len(odd):
        raise MeshError(
            f"Every face must be a quad where panel sizes are asked for; {len(odd)} of "
            f"{len(faces)} are not, the first is face {odd[0]} with "
            f"{topology.face_sizes[odd[0]]} corners. Choose the vertices of quads."
        )
    return np.asarray(topology.indices[topology.offsets[faces][:, None] + np.arange(4)])


def _lengths(vectors: Floats) -> tuple[Floats, Floats]:
    """Lengths of vectors (..., 3), and their directions, which are the gradients."""
    length = np.asarray(norm(vectors))
    return length, vectors / np.maximum(length, TINY)[..., None]
