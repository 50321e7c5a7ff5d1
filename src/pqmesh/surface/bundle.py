"""Several surfaces evaluated together: a point each, on the surface that is its own.

A roof of many faces would else be evaluated face by face, a few points at a time, and the calls
would cost more than the sums. B-splines of equal degrees share one table of knots and points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pqmesh.surface.base import Surface
from pqmesh.surface.bspline import BLOCK, BSplineSurface, KnotLine, basis_functions, projected
from pqmesh.vectors import Floats, Indices


class Bundle:
    """Surfaces whose jets are asked for by number.

    Parameters
    ----------
    surfaces : sequence of Surface

    Examples
    --------
    >>> from pqmesh.surface.formula import graph_surface
    >>> pair = Bundle([graph_surface("x", (0, 1), (0, 1)), graph_surface("y*y", (0, 1), (0, 1))])
    >>> pair.jet(np.array([1, 0]), np.array([[0.5, 0.5], [0.5, 0.5]]))[0]
    array([[0.5 , 0.5 , 0.25],
           [0.5 , 0.5 , 0.5 ]])
    """

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        domains = [surface.domain for surface in surfaces]
        self.low = np.array([domain.low for domain in domains])
        self.size = np.array([domain.size for domain in domains])
        self._periodic = np.array([domain.periodic for domain in domains])
        kinds: dict[object, list[int]] = {}
        for number, surface in enumerate(surfaces):
            kind: object = number
            if isinstance(surface, BSplineSurface):
                kind = (surface.degrees, surface.weights is None)
            kinds.setdefault(kind, []).append(number)
        self._group = np.empty(len(surfaces), dtype=np.int64)
        self._within = np.empty(len(surfaces), dtype=np.int64)
        self._members: list[Surface | _Splines] = []
        for numbers in kinds.values():
            self._group[numbers] = len(self._members)
            self._within[numbers] = np.arange(len(numbers))
            own = [surfaces[number] for number in numbers]
            splines = [surface for surface in own if isinstance(surface, BSplineSurface)]
            self._members.append(_Splines(splines) if len(splines) > 1 else own[0])

    def jet(self, owner: Indices, uv: Floats) -> Floats:
        """Jets (6, N, 3) at parameters (N, 2) of the surfaces with numbers owner (N,).

        Parameters over a periodic bound are moved into the domain.
        """
        if self._periodic.any():
            low, size = self.low[owner], self.size[owner]
            uv = np.where(self._periodic[owner], low + np.mod(uv - low, size), uv)
        if len(self._members) == 1:
            return self._of_member(0, owner, uv)
        out = np.empty((6, len(uv), 3))
        group = self._group[owner]
        for number in np.unique(group).tolist():
            rows = np.flatnonzero(group == number)
            out[:, rows] = self._of_member(number, owner[rows], uv[rows])
        return out

    def _of_member(self, group: int, owner: Indices, uv: Floats) -> Floats:
        """Jets of surfaces of one group."""
        member = self._members[group]
        if isinstance(member, _Splines):
            return member.jet(self._within[owner], uv)
        return np.stack(member.jet(uv))


class _Splines:
    """B-spline surfaces of equal degrees, all rational or none."""

    def __init__(self, surfaces: Sequence[BSplineSurface]) -> None:
        self.is_rational = surfaces[0].weights is not None
        self.degrees = surfaces[0].degrees
        self.lines = (_Lines(surfaces, 0), _Lines(surfaces, 1))
        tables = [surface.rows for surface in surfaces]
        self.rows = np.concatenate(tables)
        self.first = np.cumsum([0, *map(len, tables[:-1])])
        self.width = np.array([surface.points.shape[1] for surface in surfaces])

    def jet(self, number: Indices, uv: Floats) -> Floats:
        """Jets (6, N, 3), by the same sums as those of `BSplineSurface`."""
        out = np.empty((6, len(uv), 3))
        for start in range(0, len(uv), BLOCK):
            part = slice(start, start + BLOCK)
            table = self._derivatives(number[part], uv[part])
            for k, (a, b) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
                out[k, part] = table[:, a, b, :3]
        return out

    def _derivatives(self, number: Indices, uv: Floats) -> Floats:
        """All derivatives up to order 2 in u and 2 in v at once, shape (N, 3, 3, d)."""
        (p, q), n = self.degrees, len(uv)
        (i, in_u), (j, in_v) = self._bases(number, uv)
        width = self.width[number, None]
        lines = (self.first[number] + j)[:, None] + width * (i[:, None] + np.arange(p + 1))
        rows = self.rows.take((lines[..., None] + np.arange(q + 1)).reshape(n, -1), axis=0)
        across = in_u @ rows.reshape(n, p + 1, -1)
        table: Floats = in_v[:, None] @ across.reshape(n, 3, q + 1, -1)
        return projected(table) if self.is_rational else table

    def _bases(self, number: Indices, uv: Floats) -> tuple[tuple[Indices, Floats], ...]:
        """First support index and basis functions, for u and for v."""
        (i, in_u), (j, in_v) = (self.lines[k].windows_of(number, uv[:, k]) for k in (0, 1))
        if self.degrees[0] == self.degrees[1]:
            # One recursion for both directions costs fewer calls.
            both = basis_functions(np.concatenate([in_u, in_v]), uv.T.reshape(-1))
            return (i, both[: len(uv)]), (j, both[len(uv) :])
        return (i, basis_functions(in_u, uv[:, 0])), (j, basis_functions(in_v, uv[:, 1]))


class _Lines:
    """The basis functions of one direction of several surfaces."""

    def __init__(self, surfaces: Sequence[BSplineSurface], axis: int) -> None:
        lines: list[KnotLine] = [surface.lines[axis] for surface in surfaces]
        self.degree = lines[0].degree
        longest = max(len(line.starts) for line in lines)
        # Spans that a shorter line does not have begin nowhere.
        self.starts = np.full((len(lines), longest), np.inf)
        for own, line in zip(self.starts, lines, strict=True):
            own[: len(line.starts)] = line.starts
        self.first = np.cumsum([0, *(len(line.spans) for line in lines[:-1])])
        self.spans = np.concatenate([line.spans for line in lines])
        self.windows = np.concatenate([line.windows for line in lines])

    def windows_of(self, number: Indices, t: Floats) -> tuple[Indices, Floats]:
        """First support index (N,) and knots about parameters (N,) of surfaces by number."""
        place = self.first[number] + (t[:, None] >= self.starts[number]).sum(axis=1)
        return self.spans[place] - self.degree, self.windows[place]
