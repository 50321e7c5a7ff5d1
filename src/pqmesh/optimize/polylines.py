"""Polylines as curves: the nearest segment of each point, found at once or by walking along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from pqmesh.vectors import TINY, Floats, Indices, dot, norm

# So many distances from points to segments are computed at once.
MOST_PAIRS = 500_000
# A neighboring segment must be nearer by more than rounding to be walked to.
NEARER = 1.0 - 1e-12


@dataclass(frozen=True, eq=False)
class Polylines:
    """Segments of one or several polylines, each knowing those beside it.

    Attributes
    ----------
    starts, ends : (S, 3), model unit
    before, after : (S,)
        Segments that meet the start and the end of each; -1 where the polyline ends.
    """

    starts: Floats
    ends: Floats
    before: Indices
    after: Indices

    @classmethod
    def of(cls, curves: list[Floats]) -> Polylines:
        """Segments of polylines (n, 3), n >= 2; one whose ends coincide is closed."""
        before, after, count = [], [], 0
        for points in curves:
            rows = count + np.arange(len(points) - 1)
            previous, following = rows - 1, rows + 1
            closed = bool((points[0] == points[-1]).all())
            previous[0], following[-1] = (rows[-1], rows[0]) if closed else (-1, -1)
            before.append(previous)
            after.append(following)
            count += len(rows)
        return cls(
            np.concatenate([points[:-1] for points in curves]),
            np.concatenate([points[1:] for points in curves]),
            np.concatenate(before),
            np.concatenate(after),
        )

    def feet(self, points: Floats, segments: Indices) -> tuple[Floats, Floats]:
        """Nearest points (N, 3) on one segment each, and by how much the points lie beyond it.

        Beyond is the part (N, 3) of the way from the segment's line that runs along it: zero
        between the ends.
        """
        start = self.starts[segments]
        along = self.ends[segments] - start
        share = dot(points - start, along) / np.maximum(dot(along, along), TINY)
        kept = np.clip(share, 0.0, 1.0)
        return start + kept[:, None] * along, (share - kept)[:, None] * along

    def gaps(self, points: Floats, segments: Indices) -> Floats:
        """Distances (N,) of points to one segment each."""
        return norm(points - self.feet(points, segments)[0])

    def nearest(self, points: Floats) -> Indices:
        """Nearest segment of each point, the first of equal ones.

        Pieces of segments no longer than the mean are sought by their middles, more of them
        until none can be missed.
        """
        lengths = norm(self.ends - self.starts)
        counts = np.maximum(np.ceil(lengths / max(lengths.mean(), TINY)), 1).astype(np.int64)
        owner = np.repeat(np.arange(len(lengths)), counts)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (number + 0.5) / counts[owner]
        middles = self.starts[owner] + share[:, None] * (self.ends - self.starts)[owner]
        reach = 0.5 * float((lengths / counts).max())
        tree, found = cKDTree(middles), np.zeros(len(points), dtype=np.int64)
        rows, count = np.arange(len(points)), min(8, len(middles))
        while len(rows):
            still = []
            for part in np.array_split(rows, -(-len(rows) * count // MOST_PAIRS)):
                query = tree.query(points[part], k=count)
                distance, near = (np.asarray(each).reshape(-1, count) for each in query)
                candidates = np.sort(owner[near], axis=1)
                pairs = np.repeat(points[part], count, axis=0)
                gaps = self.gaps(pairs, candidates.ravel()).reshape(-1, count)
                best = gaps.argmin(axis=1)
                row = np.arange(len(part))
                found[part] = candidates[row, best]
                # A small allowance for the rounding of both distances.
                missed = gaps[row, best] > (distance[:, -1] - reach) * (1.0 - 1e-12)
                still.append(part[missed])
            if count == len(middles):
                break
            rows, count = np.concatenate(still), min(4 * count, len(middles))
        return found

    def walked(self, points: Floats, segments: Indices) -> Indices:
        """Segments reached by stepping to a nearer neighbor as long as there is one."""
        segments = segments.copy()
        rows, gaps = np.arange(len(points)), self.gaps(points, segments)
        for _ in range(len(self.starts)):
            at, here = segments[rows], gaps[rows]
            for beside in (self.before[at], self.after[at]):
                there = self.gaps(points[rows], np.maximum(beside, 0))
                nearer = (beside >= 0) & (there < NEARER * here)
                at, here = np.where(nearer, beside, at), np.where(nearer, there, here)
            went = at != segments[rows]
            rows, at, here = rows[went], at[went], here[went]
            segments[rows], gaps[rows] = at, here
            if not len(rows):
                break
        return segments
