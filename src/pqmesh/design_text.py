"""Texts of design and net files: read whole, or refused with one clear line."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pqmesh.errors import FormatError, SpecError
from pqmesh.io.atomic import shown_path

# The TOML reader needs time by the square of a dotted key's length, and a kilobyte for each
# hundred digits of a number.
MOST_KEY_WORK, MOST_DIGITS = 10_000_000, 1000


_HEADER = re.compile(r"\s*\[\s*([A-Za-z0-9_.\s-]+?)\s*\]\s*(#.*)?")
# A table of a list of tables.
_ROW = re.compile(r"\s*\[\[\s*([A-Za-z0-9_.\s-]+?)\s*\]\]\s*(#.*)?")
_KEY = re.compile(r"\s*([A-Za-z0-9_.-]+)\s*=")
_STRINGS = re.compile(r'"(?:[^"\\]|\\.)*"|' + r"'[^']*'|#.*")


class Where(NamedTuple):
    """What a source is called in messages, and on which line each of its keys stands.

    Attributes
    ----------
    name : str
    lines : mapping of key path to line, counted from 1; 0 for keys given elsewhere
    """

    name: str
    lines: Mapping[tuple[str, ...], int] = {}

    def at(self, path: tuple[str, ...]) -> str:
        """The source with the line of a key, or of the table that holds it."""
        for count in range(len(path), 0, -1):
            if path[:count] in self.lines:
                line = self.lines[path[:count]]
                return f"{self.name}, line {line}" if line else self.name
        return self.name

    def of_message(self, text: str) -> str:
        """A message behind the place of the first key that it names."""
        for word in re.findall(r"[a-z]+(?:\.[a-z_0-9]+)+", text):
            path = tuple(word.split("."))
            # A key within braces has no line of its own; the table that holds it has.
            if path in self.lines or path[:3] in self.lines:
                return f"{self.at(path)}: {text}"
        return f"{self.name}: {text}"

    def without(self, paths: list[tuple[str, ...]]) -> Where:
        """The same with keys that were given elsewhere, which have no line."""
        return self._replace(lines=dict(self.lines) | dict.fromkeys(paths, 0))


class DesignText(NamedTuple):
    """A design file as read: its tables, the folder its files are sought in, its lines."""

    tables: dict[str, Any]
    folder: Path
    where: Where


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    r"""Line of each section and of each key at the start of a line, by path.

    Keys inside braces stand on the line of the table that holds them.

    Examples
    --------
    >>> key_lines("[panels]\nedge = [1,\n 2]\n")
    {('panels',): 1, ('panels', 'edge'): 2}
    """
    found: dict[tuple[str, ...], int] = {}
    section: tuple[str, ...] = ()
    depth, closing = 0, ""
    for number, line in enumerate(text.splitlines(), start=1):
        if closing:
            closing = "" if closing in line else closing
            continue
        plain = _STRINGS.sub("", re.sub(r'""".*?"""|' + r"'''.*?'''", "", line))
        if depth == 0 and (header := _HEADER.fullmatch(plain)):
            section = tuple(part.strip() for part in header[1].split("."))
            found.setdefault(section, number)
        elif depth == 0 and (row := _ROW.fullmatch(plain)):
            table = tuple(part.strip() for part in row[1].split("."))
            found.setdefault(table, number)
            count = sum(path[:-1] == table and path[-1].isdigit() for path in found)
            section = (*table, str(count))
            found[section] = number
        elif depth == 0 and (key := _KEY.match(plain)):
            found.setdefault((*section, *key[1].split(".")), number)
        depth = max(depth + sum(map(plain.count, "[{")) - sum(map(plain.count, "]}")), 0)
        depth = 0 if _HEADER.fullmatch(plain) or _ROW.fullmatch(plain) else depth
        closing = next((mark for mark in ('"""', "'''") if mark in plain), "")
    return found


def text_of(path: Path, most_bytes: int) -> str:
    """A text file's content, or one clear refusal."""
    shown = shown_path(path)
    try:
        if not path.exists():
            raise FormatError(f"The file {shown} must exist; it does not. Check the path.")
        # A pipe or device would be waited for without end.
        if not path.is_file():
            what = "a folder" if path.is_dir() else "a pipe or device"
            raise FormatError(f"{shown} must be a file; it is {what}. Name the file.")
        if path.stat().st_size > most_bytes:
            raise FormatError(
                f"{shown} must be below {most_bytes // 1_000_000} MB; it is larger. Is it "
                f"the right file?"
            )
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise FormatError(f"{shown} must be UTF-8 text; it is not. Is it the right file?") from None
    except OSError as error:
        raise FormatError(
            f"{shown} must be readable; {error.strerror}. Check its name and rights."
        ) from None
    except ValueError as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{shown} must be the name of a file; {error}. Mend it.") from None
    if not text.strip():
        raise FormatError(f"{shown} must not be empty; it is. Is it the right file?")
    return text


def check_tokens(text: str, name: str) -> None:
    """Refuse keys and numbers so long that the TOML reader would not come back."""
    if sum(part.count(".") ** 2 for part in re.split(r"[=,{}\n]", text)) > MOST_KEY_WORK:
        raise SpecError(
            f"A design must have short keys; {name} has one with too many dots. Mend it."
        )
    if any(run.end() - run.start() > MOST_DIGITS for run in re.finditer(r"[0-9_]+", text)):
        raise SpecError(
            f"A design must have numbers of at most {MOST_DIGITS} digits; {name} has a longer one. "
            f"Mend it."
        )


def parse_reason(error: Exception) -> str:
    """Why a text could not be parsed, in one line."""
    if isinstance(error, RecursionError):
        return "its brackets are nested too deep"
    if isinstance(error, tomllib.TOMLDecodeError | json.JSONDecodeError):
        return str(error)
    return "it has a whole number of thousands of digits"
