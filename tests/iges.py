"""NURBS surfaces (entity 128) of IGES files in their text form, read strictly."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

UNIT_OF_FLAG = {1: "in", 2: "mm", 4: "ft", 6: "m", 7: "km", 10: "cm"}
_TOKEN = re.compile(r"\s*(?:(\d+)H|([^,;]*))")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+)?\Z")


class IgesSurface(NamedTuple):
    """An entity 128: degrees, full knots, points (n, m, 3), weights (n, m) or None."""

    degrees: tuple[int, int]
    knots: tuple[np.ndarray, np.ndarray]
    points: np.ndarray
    weights: np.ndarray | None


def read_iges_surfaces(path: Path) -> tuple[str, list[IgesSurface]]:
    """The unit of an IGES file and its surfaces; anything but entities 128 is an error."""
    sections = _sections(path.read_text(encoding="ascii"))
    head = _fields("".join(line[:72] for line in sections["G"]))
    unit = UNIT_OF_FLAG[int(head[13])]
    directory = sections["D"]
    if len(directory) % 2:
        raise ValueError("Directory entries must be pairs of lines; their count is odd.")
    surfaces = []
    for number in range(0, len(directory), 2):
        first, second = (_columns(line) for line in directory[number : number + 2])
        if first[0] != 128 or second[0] != 128:
            raise ValueError(f"Entities must be 128; entry {number + 1} is {first[0]}.")
        lines = sections["P"][first[1] - 1 : first[1] - 1 + second[3]]
        if len(lines) != second[3] or any(int(line[64:72]) != number + 1 for line in lines):
            raise ValueError(f"Parameters must point back to entry {number + 1}; some do not.")
        surfaces.append(_surface([_number(f) for f in _fields("".join(x[:64] for x in lines))]))
    return unit, surfaces


def _sections(text: str) -> dict[str, list[str]]:
    """Lines by section; numbers of lines and the counts of the last line must be right."""
    found: dict[str, list[str]] = {letter: [] for letter in "SGDPT"}
    for line in text.splitlines():
        letter = line[72:73]
        if len(line) != 80 or letter not in found:
            raise ValueError(f"Lines must have 80 columns and a section; found {line!r}.")
        found[letter].append(line)
        if int(line[73:]) != len(found[letter]):
            raise ValueError(f"Lines must be numbered; found {line[72:]!r}.")
    last = found["T"][0]
    counts = {last[i]: int(last[i + 1 : i + 8]) for i in range(0, 32, 8)}
    if counts != {letter: len(found[letter]) for letter in "SGDP"}:
        raise ValueError(f"Sections must be complete; the last line counts {counts}.")
    return found


def _fields(text: str) -> list[str]:
    """Free-format fields up to the semicolon; strings are counted, as 3Habc."""
    fields, at = [], 0
    while True:
        match = _TOKEN.match(text, at)
        assert match is not None
        if match[1]:
            at = match.end() + int(match[1])
            fields.append(text[match.end() : at])
        else:
            at = match.end()
            fields.append(match[2].strip())
        if at >= len(text) or text[at] not in ",;":
            raise ValueError(f"Fields must end with a comma or semicolon, after {fields[-1]!r}.")
        if text[at] == ";":
            return fields
        at += 1


def _columns(line: str) -> list[int]:
    """The first five fields of eight columns of a directory line."""
    return [int(line[i : i + 8] or 0) for i in range(0, 40, 8)]


def _number(field: str) -> float:
    if not _NUMBER.match(field):
        raise ValueError(f"Parameters must be numbers; found {field!r}.")
    return float(field.replace("D", "E").replace("d", "e"))


def _surface(row: list[float]) -> IgesSurface:
    """Entity 128: counts, flags, knots, weights, points with u running first, bounds."""
    last_u, last_v, p, q = (int(x) for x in row[1:5])
    n, m, is_polynomial = last_u + 1, last_v + 1, row[7] == 1
    sizes = (10, n + p + 1, m + q + 1, n * m, 3 * n * m, 4)
    if len(row) != sum(sizes):
        raise ValueError(f"An entity 128 must have {sum(sizes)} numbers here; found {len(row)}.")
    parts = np.split(np.array(row), np.cumsum(sizes)[:-1])
    weights = parts[3].reshape(m, n).T
    if is_polynomial and np.ptp(weights) != 0.0:
        raise ValueError("Weights of a polynomial surface must be equal; they are not.")
    bounds = [parts[1][p], parts[1][n], parts[2][q], parts[2][m]]
    if parts[5].tolist() != bounds:
        raise ValueError(f"Bounds must be those of the knots, {bounds}; found {parts[5]}.")
    points = parts[4].reshape(m, n, 3).swapaxes(0, 1)
    return IgesSurface((p, q), (parts[1], parts[2]), points, None if is_polynomial else weights)
