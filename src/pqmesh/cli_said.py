"""What the command says while it works: plain lines, or one live line on a terminal."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from pqmesh.optimize.solver import Step


# Tolerances that are lengths; and what their worst values are measured in.
LENGTHS = ("deviation", "deviation_rms")
UNITS = {"twist": " deg", "area": " of a mean face"}


class Session:
    """Options that hold for every command."""

    quiet = False
    debug = False


def say(text: str) -> None:
    """A line on standard error, unless quiet."""
    if not Session.quiet:
        typer.echo(text, err=True)


@contextlib.contextmanager
def progress() -> Iterator[Any]:
    """Told of stages and steps: a live line on a terminal, plain lines elsewhere."""
    if Session.quiet or not sys.stderr.isatty():
        seen: list[str] = []

        def plain(stage: str, step: Step | None) -> None:
            if step is None:
                say(f"{stage} ...")
            seen.append(stage)

        yield plain
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("read")

        def live(stage: str, step: Step | None) -> None:
            detail = "" if step is None else f"  worst residual {step.hard:.1e}"
            bar.update(task, description=stage + detail)

        yield live


def reached(summary: str, report: dict[str, Any]) -> bool:
    """Say what came out, what to know of it and what was missed; truth when nothing was."""
    from pqmesh.report_mesh import failed

    say(summary)
    for text in report.get("warnings", ()):
        say(f"note: {text}")
    missed = failed(report)
    for row in missed:
        say(_missed(row, report))
    return not missed


def _missed(row: dict[str, Any], report: dict[str, Any]) -> str:
    """A tolerance that was not reached, by how much, and its worst place."""
    key, reached, asked = row["key"], row["reached"], row["asked"]
    # As many digits as tell the two apart.
    digits = next((n for n in (3, 6, 10) if f"{reached:.{n}g}" != f"{asked:.{n}g}"), 17)
    share = ""
    if key in LENGTHS:
        share = f" ({100 * reached / report['before']['edge_mean']:.3g} % of an edge)"
    text = f"not reached: {key} {reached:.{digits}g}{share}, asked {asked:.{digits}g}"
    worst = row["worst"]
    if worst is None:
        return text
    noun = next(noun for noun in ("face", "vertex", "edge") if noun in worst)
    of = f" ({worst['constraint']})" if "constraint" in worst else ""
    return f"{text}; worst is {_named(noun, worst)}: {worst['value']:.3g}{UNITS.get(key, '')}{of}"


def _named(noun: str, entry: dict[str, Any]) -> str:
    """A face, vertex or edge with its place."""
    where = entry[noun]
    name = "-".join(map(str, where)) if isinstance(where, list) else where
    return f"{noun} {name} at ({', '.join(f'{x:.6g}' for x in entry['at'])})"


def roof_summary(report: dict[str, Any], output: Path) -> str:
    """One line about a roof."""
    after, deviation = report["after"], report["deviation"]
    return (
        f"{report['panels']['count']} panels ({report['orientation']}), planarity "
        f"{after['planarity_max']:.1e}, twist "
        f"{after['twist_max_deg'] if after['twist_max_deg'] is not None else 0.0:.1e} deg, "
        f"deviation {deviation['max']:.3g} {report['units']}; written to {output}"
    )


def optimized_summary(report: dict[str, Any], output: Path) -> str:
    """One line about an optimised mesh: what its kind asks for, how far it went, how it ended."""
    kind, before, after = report["kind"], report["before"], report["after"]
    deviation, mean = report["deviation"], before["edge_mean"]
    shown = [("planarity", "planarity_max", "")]
    shown += [("cone spread", "cone_spread_max", "")] if "conical" in kind else []
    shown += [("circularity", "circularity_max_deg", " deg")] if "circular" in kind else []
    # A mesh without inner vertices has no cones.
    measured = [
        f"{words} {before[key]:.2g} -> {after[key]:.2g}{unit}"
        for words, key, unit in shown
        if before[key] is not None
    ]
    broken = [
        f"{after[key]} {words}"
        for words, key in (
            ("faces not convex", "nonconvex_faces"),
            ("faces turned over", "flipped_faces"),
        )
        if after[key]
    ]
    parts = [
        *measured,
        f"moved {deviation['moved_max']:.3g} at most ({deviation['moved_max'] / mean:.2g} edges)",
        f"deviation rms {deviation['rms']:.3g} ({100 * deviation['rms'] / mean:.2g} % of an edge)",
        f"area {100 * (after['area_total'] / before['area_total'] - 1.0):+.2g} %",
        *broken,
    ]
    return f"{kind}: {', '.join(parts)}; {report['solver']['reason']}; written to {output}"


def optimized_notes(report: dict[str, Any]) -> list[str]:
    """What limits an optimised mesh, and its worst face, vertex and edge of each measure."""
    notes, told = list(report["worst"]["limits"]), set()
    for noun, key in (("face", "faces"), ("vertex", "vertices"), ("edge", "edges")):
        for entry in report["worst"][key]:
            # The lists of a measure begin with its worst.
            if entry["measure"] in told:
                continue
            told.add(entry["measure"])
            notes.append(f"worst {entry['measure']} is {entry['value']:.3g}, {_named(noun, entry)}")
    missed = {row["key"] for row in report["tolerance"] if row["pass"] is False}
    if "twist" in missed and not missed & {"conical", "offset"}:
        notes.append(
            "The mesh is conical, but where two faces lie in one plane their offsets do not hold "
            "the edge between them parallel: a beam there is twisted. Allow that (--tolerance "
            "twist=DEGREES), or bend the start there."
        )
    if missed and missed <= {*LENGTHS, "area"}:
        kind = report["kind"]
        ways = ["--within LENGTH"] if "deviation" in missed else []
        ways += ["--tolerance KEY=VALUE"] if missed != {"deviation"} else []
        less = "" if kind == "planar" else "ask for less (--kind planar), "
        notes.append(
            f"The mesh is {kind}, but not where it was. Allow that ({', '.join(ways)}), {less}or "
            f"panel the surface anew along its lines of curvature (pqmesh panelize)."
        )
    return notes


def moved_summary(report: dict[str, Any], output: Path) -> str:
    """One line about an offset or an image."""
    after = report["after"]
    return (
        f"{report['kind']}: planarity {after['planarity_max']:.2e}, cone spread "
        f"{after['cone_spread_max'] or 0.0:.2e}, edges {after['edge_min']:.4g} to "
        f"{after['edge_max']:.4g}; written to {output}"
    )
