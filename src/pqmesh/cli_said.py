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


def roof_summary(report: dict[str, Any], output: Path) -> str:
    """One line about a roof."""
    after, deviation = report["after"], report["deviation"]
    return (
        f"{report['panels']['count']} panels ({report['orientation']}), planarity "
        f"{after['planarity_max']:.1e}, twist "
        f"{after['twist_max_deg'] if after['twist_max_deg'] is not None else 0.0:.1e} deg, "
        f"deviation {deviation['max']:.3g} {report['units']}; written to {output}"
    )
