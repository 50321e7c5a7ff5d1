"""Output files and folders: refused before the work, written whole or not at all."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from pqmesh.errors import FormatError
from pqmesh.io.atomic import shown_path, write_all, write_bytes


def json_bytes(report: dict[str, Any]) -> bytes:
    """A report as JSON: keys in their order, floats exact, a new line at the end."""
    finite = _finite(report)
    return (json.dumps(finite, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode()


def _finite(value: Any) -> Any:
    """The value with None for what is no finite number: JSON knows no other."""
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check_folder(folder: Path) -> None:
    """Refuse an output folder that cannot be made or written, before the work instead of after.

    Raises
    ------
    FormatError
        Naming the file in the way, or the folder that is write-protected.
    """
    stands = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not stands.is_dir():
        raise FormatError(
            f"{shown_path(folder)}: the results must go to a folder; {shown_path(stands)} is a "
            f"file. Choose another folder."
        )
    if not os.access(stands, os.W_OK | os.X_OK):
        raise FormatError(
            f"{shown_path(folder)}: the folder must be writable; {shown_path(stands)} is "
            f"write-protected. Allow writing, or choose another folder."
        )


def check_file(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse an output file of another format, or in a folder that does not stand.

    Raises
    ------
    FormatError
        Naming the suffixes, the folder, or what is in the way.
    """
    shown = shown_path(path)
    if path.suffix.lower() not in suffixes:
        raise FormatError(
            f"{shown}: the suffix of this output must be one of {', '.join(suffixes)}; found "
            f"{path.suffix or 'none'!r}. Rename it."
        )
    if path.is_dir():
        raise FormatError(f"{shown}: the output must be a file; it is a folder. Name a file in it.")
    folder = path.absolute().parent
    if not folder.is_dir():
        raise FormatError(
            f"{shown}: the folder of the output must exist; found none. Make it, or choose another."
        )
    if not os.access(path if path.exists() else folder, os.W_OK):
        raise FormatError(
            f"{shown}: the output must be writable; it is write-protected. Allow writing, or "
            f"choose another."
        )


def write_files(files: dict[Path, bytes]) -> None:
    """Write single files of one result: all of them, or those before come back.

    Raises
    ------
    FormatError
        As `write_bytes`.
    """
    earlier = {path: path.read_bytes() if path.is_file() else None for path in files}
    try:
        for path, data in files.items():
            write_bytes(path, data)
    except BaseException:
        for path, before in earlier.items():
            if before is None:
                with suppress(OSError):
                    path.unlink(missing_ok=True)
            elif path.read_bytes() != before:
                write_bytes(path, before)
        raise


def write_new(folder: Path, files: dict[str, bytes]) -> None:
    """Write files that must not stand yet: what a user has edited is never overwritten.

    Raises
    ------
    FormatError
        Naming the first file that is in the way.
    """
    for name in files:
        if os.path.lexists(folder / name):
            raise FormatError(
                f"{shown_path(folder / name)}: the file must not exist yet; it does. Name another "
                f"folder with -o, or remove it."
            )
    write_all(folder, files)
