"""The table as text, a row printed when it is measured; the same rows for the documentation."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.measurement import Measurement

# Heading, width, and what stands below it.
HEADINGS = (
    "mesh",
    "kind",
    "method",
    "faces",
    "planarity",
    "balance, rad",
    "moved",
    "rms",
    "edge",
    "broken",
    "drift",
    "s",
    "MB",
    "ended",
)
WIDTHS = (20, 7, 12, 6, 17, 17, 7, 7, 6, 6, 7, 8, 6, 0)
LEGEND = """\
planarity, balance: worst face and vertex, before > after (diagonal distance over mean diagonal;
|w1-w2+w3-w4|). moved: longest move of a vertex; rms: deviation from the start surface; drift: of
the boundary from the start boundary; all three in mean edges. edge: smallest ratio of an edge to
itself before. broken: faces newly turned over, with a closed, flat or reflex corner, or with a
collapsed edge. s: the method alone, median. MB: peak of its process, interpreter and libraries
included."""


def cells(found: Measurement) -> list[str]:
    """A measurement as the cells of its row."""
    return [
        found.mesh,
        found.kind,
        found.method,
        _number(found.faces, "d"),
        _pair(found.planarity_before, found.planarity_after),
        _pair(found.balance_before, found.balance_after) if found.kind == "conical" else "",
        _number(found.moved_max, ".3f"),
        _number(found.deviation_rms, ".2g"),
        _number(found.edge_ratio, ".2f"),
        _number(found.broken_new, "d"),
        _number(found.boundary_drift, ".3f"),
        _number(found.seconds, ".2f" if (found.seconds or 0.0) >= 0.1 else ".3f"),
        _number(found.megabytes, ".0f"),
        ended(found),
    ]


def ended(found: Measurement) -> str:
    """How it ended, in a few words."""
    if found.status:
        return found.status
    if found.converged:
        return "converged"
    return found.reason if found.converged is None else f"NOT converged: {found.reason}"


def heading() -> str:
    """First line of the table."""
    return _line(HEADINGS)


def line(found: Measurement) -> str:
    """Line of a measurement."""
    return _line(cells(found))


def markdown(rows: Sequence[Measurement]) -> str:
    """The table for the documentation."""
    plain = [[word.replace("|", "\\|") for word in cells(row)] for row in rows]
    lines = [HEADINGS, ["---"] * len(HEADINGS), *plain]
    return "\n".join(f"| {' | '.join(words)} |" for words in lines)


def _line(words: Sequence[str]) -> str:
    padded = [
        word.ljust(width) if width in WIDTHS[:3] or not width else word.rjust(width)
        for word, width in zip(words, WIDTHS, strict=True)
    ]
    return "  ".join(padded).rstrip()


def _number(value: float | None, form: str) -> str:
    if value is None:
        return ""
    text = format(value, form)
    # Runaway results keep their columns.
    return text if len(text) <= 7 or not math.isfinite(value) else f"{value:.0e}"


def _pair(before: float | None, after: float | None) -> str:
    if before is None or after is None:
        return ""
    return f"{before:.1e} > {after:.1e}"
