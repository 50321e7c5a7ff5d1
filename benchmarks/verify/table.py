"""Rows of the verification table, and the little machinery that collects them."""

from __future__ import annotations

import math
import os
import statistics
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("PQMESH_DATA", ROOT.parent / "shared" / "data"))
COMMAND = [sys.executable, "-m", "pqmesh"]


@dataclass(frozen=True)
class Row:
    """One promise: what was asked, what was reached, whether it holds (None: not judged)."""

    line: str
    asked: str
    reached: str
    passed: bool | None


def at_most(line: str, limit: float, value: float) -> Row:
    return Row(line, f"<= {limit:g}", f"{value:.4g}", bool(value <= limit))


def at_least(line: str, limit: float, value: float) -> Row:
    return Row(line, f">= {limit:g}", f"{value:.4g}", bool(value >= limit))


def between(line: str, low: float, high: float, value: float) -> Row:
    return Row(line, f"{low:g} .. {high:g}", f"{value:.4g}", bool(low <= value <= high))


def holds(line: str, asked: str, reached: object, passed: bool) -> Row:
    return Row(line, asked, str(reached), bool(passed))


def note(line: str, reached: object) -> Row:
    return Row(line, "printed", str(reached), None)


def skipped(line: str, why: str) -> Row:
    return Row(line, "-", f"skipped: {why}", None)


@dataclass(frozen=True)
class Run:
    """A finished command."""

    code: int
    seconds: float
    megabytes: float
    out: str
    err: str


def run(*arguments: str | Path, cwd: Path | None = None) -> Run:
    """The program as its own process: exit code, wall seconds, peak megabytes, output."""
    return measured_command([*COMMAND, *map(str, arguments)], cwd)


def measured_command(words: list[str], cwd: Path | None = None) -> Run:
    """A command with its own accounting: a small parent of its own reaps it and reports."""
    watcher = (
        "import resource, subprocess, sys, time;"
        "b = time.perf_counter(); c = subprocess.run(sys.argv[1:]).returncode;"
        "sys.stderr.write(f'\\n{c} {time.perf_counter() - b}"
        " {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024}')"
    )
    done = subprocess.run(
        [sys.executable, "-c", watcher, *words], capture_output=True, text=True, cwd=cwd, check=True
    )
    err, _, last = done.stderr.rpartition("\n")
    code, seconds, megabytes = last.split()
    return Run(int(code), float(seconds), float(megabytes), done.stdout, err)


def median_seconds(words: list[str], times: int = 3) -> float:
    """Median wall time of a command."""
    taken = []
    for _ in range(times):
        began = time.perf_counter()
        subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def show(title: str, rows: list[Row]) -> bool:
    """Print rows as a table; False when one fails."""
    width = max(len(row.line) for row in rows)
    middle = max(len(row.asked) for row in rows)
    print(f"\n{title}")
    for row in rows:
        mark = "-" if row.passed is None else ("pass" if row.passed else "FAIL")
        print(f"{row.line:{width}}  {row.asked:{middle}}  {row.reached}  {mark}", flush=True)
    return all(row.passed is not False for row in rows)


def order(errors: list[float], sizes: list[float]) -> float:
    """Observed order of the last refinement."""
    return math.log(errors[-2] / errors[-1]) / math.log(sizes[-2] / sizes[-1])
