"""Texts of design and net files: read whole, or refused with one clear line."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

from pqmesh.errors import FormatError, SpecError
from pqmesh.io.atomic import shown_path

# The TOML reader needs time by the square of a dotted key's length, and a kilobyte for each
# hundred digits of a number.
MOST_KEY_WORK, MOST_DIGITS = 10_000_000, 1000


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
