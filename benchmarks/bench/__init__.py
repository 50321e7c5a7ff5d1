"""Benchmarks: pqmesh, a plain baseline and installable peers on the same meshes, in one table."""

from bench.measurement import Measurement, measured

__all__ = ["Measurement", "measured"]
