"""Crossings of two families -> the all-quad mesh of the region they cover."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pqmesh.network.crossings import Crossings
from pqmesh.network.lines import Lines
from pqmesh.surface.base import Domain
from pqmesh.vectors import Floats, Indices, Mask


def cells(found: Crossings, a: Lines, b: Lines) -> Indices:
    """Quads of the arrangement: four crossings joined by consecutive pieces of lines, (F, 4).

    Counterclockwise in the parameter plane; corners 0-1 and 2-3 follow family a. No global
    numbering of the lines is needed, so families may branch, close or end anywhere.
    """
    next_a, last_a = _neighbors(found, 0, a)
    next_b, last_b = _neighbors(found, 1, b)
    north = np.where(found.side > 0, next_b, last_b)
    south = np.where(found.side > 0, last_b, next_b)
    west = np.flatnonzero(next_a >= 0)
    east = next_a[west]
    quads = np.concatenate(
        [
            np.stack([west, east, north[east], north[west]], axis=1),
            np.stack([east, west, south[west], south[east]], axis=1),
        ]
    )
    quads = quads[(quads >= 0).all(axis=1)]
    far, back = quads[:, 3], quads[:, 2]
    quads = quads[(next_a[far] == back) | (last_a[far] == back)]
    distinct = np.diff(np.sort(quads, axis=1), axis=1).all(axis=1)
    quads = quads[distinct]
    _, once = np.unique(np.sort(quads, axis=1), axis=0, return_index=True)
    return np.asarray(quads[np.sort(once)])


def _neighbors(found: Crossings, family: int, lines: Lines) -> tuple[Indices, Indices]:
    """Next and previous crossing along the family's lines, -1 past an end."""
    order = found.order_along(family)
    line = found.lines[order, family]
    following = np.full(len(found), -1, dtype=np.int64)
    before = np.full(len(found), -1, dtype=np.int64)
    same = line[1:] == line[:-1]
    following[order[:-1][same]] = order[1:][same]
    before[order[1:][same]] = order[:-1][same]
    for sequence in found.sequences[family]:
        if lines.closed[found.lines[sequence[0], family]] and len(sequence) > 2:
            following[sequence[-1]], before[sequence[0]] = sequence[0], sequence[-1]
    return following, before


def touching(
    quads: Indices, uv: Floats, domain: Domain, inside: Callable[[Floats], Mask], samples: int = 7
) -> Mask:
    """Quads of which any sample point lies inside the region."""
    base = uv[quads[:, 0]]
    period = np.where(np.array(domain.periodic), domain.size, np.inf)
    corners = uv[quads] - base[:, None]
    turns = np.round(corners / period)
    corners = corners - np.where(turns == 0, 0.0, turns * np.where(turns == 0, 0.0, period))
    t = np.linspace(0.0, 1.0, samples)
    s, t = (grid.ravel() for grid in np.meshgrid(t, t))
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1)
    points = np.einsum("sc,fci->fsi", weights, corners) + base[:, None]
    hits = inside(domain.reduce(points.reshape(-1, 2)))
    return np.asarray(hits.reshape(len(quads), -1).any(axis=1))


def filled(quads: Indices, chosen: Mask, usable: Mask) -> Mask:
    """The choice with rows and columns completed until no row or column has a gap.

    A boundary side between two re-entrant corners costs the parallel boundary edges of the
    offsets; a row- and column-convex region has none. Gaps that hold an unusable quad stay.
    """
    chosen = chosen & usable
    strips = _strips(quads)
    changed = True
    while changed:
        changed = False
        for strip in strips:
            marks = np.flatnonzero(chosen[strip])
            if len(marks) < 2:
                continue
            for low, high in itertools.pairwise(marks):
                gap = strip[low + 1 : high]
                if len(gap) and usable[gap].all():
                    chosen[gap] = True
                    changed = True
    return chosen


def _strips(quads: Indices) -> list[Indices]:
    """Rows and columns: maximal sequences of quads joined across opposite sides."""
    n = len(quads)
    sides = np.stack([quads, np.roll(quads, -1, axis=1)], axis=2)
    keys = np.sort(sides, axis=2).reshape(-1, 2)
    _, edge = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(edge.reshape(-1), kind="stable")
    edge = edge.reshape(-1)[order]
    twin = np.full(4 * n, -1, dtype=np.int64)
    same = np.flatnonzero(edge[1:] == edge[:-1])
    twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]
    strips = []
    for direction in (0, 1):
        seen = np.zeros(n, dtype=np.bool_)
        for start in range(n):
            if seen[start]:
                continue
            seen[start] = True
            arms = []
            for side in (direction, direction + 2):
                arm, corner = [], 4 * start + side
                while twin[corner] >= 0 and not seen[twin[corner] // 4]:
                    face, entered = divmod(int(twin[corner]), 4)
                    seen[face] = True
                    arm.append(face)
                    corner = 4 * face + (entered + 2) % 4
                arms.append(arm)
            strips.append(np.array([*arms[0][::-1], start, *arms[1]], dtype=np.int64))
    return strips


def manifold_part(quads: Indices, chosen: Mask) -> Mask:
    """Largest piece joined over edges, less the quads that hang on a single vertex."""
    chosen = chosen.copy()
    while True:
        faces = np.flatnonzero(chosen)
        if not len(faces):
            return chosen
        label = _pieces(quads[faces])
        largest = np.bincount(label).argmax()
        chosen[faces[label != largest]] = False
        faces = faces[label == largest]
        loose = _pinched(quads[faces])
        if not len(loose):
            return chosen
        chosen[faces[loose]] = False


def _pieces(quads: Indices) -> Indices:
    """Label of the edge-connected piece of each quad."""
    first, second = _adjacent(quads)
    n = len(quads)
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(n, n))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _adjacent(quads: Indices) -> tuple[Indices, Indices]:
    """Pairs of quads that share an edge."""
    keys = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(edge.reshape(-1), kind="stable")
    ordered = edge.reshape(-1)[order]
    same = np.flatnonzero(ordered[1:] == ordered[:-1])
    return order[same] // 4, order[same + 1] // 4


def _pinched(quads: Indices) -> Indices:
    """Quads outside the largest fan of a vertex whose faces form several fans."""
    first, second = _adjacent(quads)
    shared = [set(quads[i]) & set(quads[j]) for i, j in zip(first, second, strict=True)]
    links: dict[int, list[tuple[int, int]]] = {}
    for i, j, vertices in zip(first.tolist(), second.tolist(), shared, strict=True):
        for vertex in vertices:
            links.setdefault(int(vertex), []).append((i, j))
    owners: dict[int, list[int]] = {}
    for face, corners in enumerate(quads.tolist()):
        for vertex in corners:
            owners.setdefault(vertex, []).append(face)
    loose: list[int] = []
    for vertex, faces in owners.items():
        pairs = links.get(vertex, [])
        # A fan of k faces has k-1 links, a closed one k; fewer means several fans.
        if len(pairs) >= len(faces) - 1:
            continue
        fans = _fans(faces, pairs)
        fans.sort(key=lambda fan: (-len(fan), fan[0]))
        loose.extend(face for fan in fans[1:] for face in fan)
    return np.unique(np.array(loose, dtype=np.int64))


def _fans(faces: list[int], pairs: list[tuple[int, int]]) -> list[list[int]]:
    """Groups of faces joined by the given pairs."""
    place = {face: i for i, face in enumerate(faces)}
    rows = [place[i] for i, _ in pairs]
    columns = [place[j] for _, j in pairs]
    n = len(faces)
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(n, n))
    label = connected_components(graph, directed=False)[1]
    return [
        sorted(face for face in faces if label[place[face]] == k) for k in range(max(label) + 1)
    ]
