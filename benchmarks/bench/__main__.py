"""Benchmarks in one table: pqmesh, a plain baseline and installable peers on the same meshes.

Usage: python benchmarks/bench [--quick] [--only NAME] [--json FILE] [--docs].
Figures are of this machine;
`docs/benchmarks.md` says what is measured and how.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

# As the command does, before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

from bench import measured
from bench.chart import draw
from bench.meshes import DATA, FILES, ROOT
from bench.methods import METHODS, PEERS
from bench.stages import shown, stages
from bench.table import LEGEND, heading, line, markdown

OUT = ROOT / "out" / "bench"
PICTURE = ROOT / "docs" / "pictures" / "bench" / "time.png"
CONICAL_FILES = ("six", "inspired")
TABLE = ROOT / "docs" / "benchmarks-table.txt"


class Asked(NamedTuple):
    """One row to be measured."""

    mesh: str
    method: str
    kind: str
    repeats: int


def rows(sizes: tuple[int, ...], peer_sizes: tuple[int, ...], files: list[str]) -> list[Asked]:
    """All rows of the table."""
    every = [method for method in METHODS if method not in ("pqmesh-mkl", "pqmesh-scipy")]
    groups = [
        *(
            (f"ellipsoid-{n}", "conical", ["pqmesh", "pqmesh-mkl", "pqmesh-scipy", "baseline"])
            for n in sizes
        ),
        *((f"roof-{n}", "conical", ["pqmesh", "baseline"]) for n in sizes),
        *((name, "conical", ["pqmesh", "baseline"]) for name in CONICAL_FILES if name in files),
        *(
            (f"roof-{n}", "planar", ["pqmesh", "baseline", *(PEERS if n in peer_sizes else ())])
            for n in sizes
        ),
        *((name, "planar", every) for name in files),
    ]
    # Peers are slow: once each.
    return [
        Asked(mesh, method, kind, 1 if method in PEERS else 3)
        for mesh, kind, methods in groups
        for method in methods
    ]


def main(words: list[str]) -> int:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(prog="python benchmarks/bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small meshes, one run, 30 s each")
    parser.add_argument("--only", metavar="NAME", help="a mesh, a family, a method, or stages")
    parser.add_argument("--json", metavar="FILE", type=Path, help="also write the figures here")
    parser.add_argument("--docs", action="store_true", help="put table and chart into the manual")
    options = parser.parse_args(words)
    if options.docs and (options.quick or options.only or not DATA.is_dir()):
        parser.error("--docs needs the whole table: no --quick or --only, and the real meshes")

    sizes, peer_sizes, limit = (21, 41, 81, 121), (21, 41), 120.0
    files = list(FILES)
    if options.quick:
        sizes, peer_sizes, limit = (21, 41), (21,), 30.0
        files = ["six", "thrust", "tubemesh", "hypar"]
    if not DATA.is_dir():
        print("Real meshes are skipped: their folder is missing; set PQMESH_DATA to it.\n")
        files = []
    asked = [row for row in rows(sizes, peer_sizes, files) if _wanted(row, options.only)]
    with_stages = options.only in (None, "stages")
    if not asked and not with_stages:
        parser.error(f"--only must name a mesh, a method or stages; found {options.only!r}")

    began = time.perf_counter()
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}\n")
    found = []
    if asked:
        print(heading(), flush=True)
    for row in asked:
        repeats = 1 if options.quick else row.repeats
        found.append(measured(row.mesh, row.method, row.kind, repeats, limit))
        print(line(found[-1]), flush=True)
    if asked:
        print(f"\n{LEGEND}\n")
    stage_rows = stages(sizes, 1 if options.quick else 3) if with_stages else []
    if stage_rows:
        print(shown(stage_rows), flush=True)

    if options.json:
        content = {"limit": limit, "measurements": [asdict(m) for m in found], "stages": stage_rows}
        options.json.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    if options.docs:
        TABLE.write_text(markdown(found) + "\n", encoding="utf-8")
    picture = PICTURE if options.docs else OUT / PICTURE.name
    if found:
        drawn = draw(found, limit, picture)
        print(f"\nChart: {picture}" if drawn else "\nNo chart: matplotlib is not installed.")
    print(f"\n{time.perf_counter() - began:.0f} s in all")
    return 0


def _wanted(row: Asked, name: str | None) -> bool:
    return name is None or name in (row.mesh, row.method, row.mesh.rpartition("-")[0])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
