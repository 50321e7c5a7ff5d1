"""What every reader of foreign files needs: the file's bytes, its library, its length unit."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import Any

from pqmesh.errors import FormatError, PqmeshError
from pqmesh.io.atomic import PathLike, shown_path

# Metres in a unit.
METRES = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": 0.3048, "in": 0.0254}

# What libraries raise on damaged files; `Exception` would hide our own faults as well.
DAMAGE = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError),
    *(OSError, RuntimeError, TypeError, ValueError),
)


def library(name: str, suffix: str) -> Any:
    """A library of the extra `aec`, imported when a file asks for it.

    Raises
    ------
    FormatError
        When it is not installed; says how to install it.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise FormatError(
            f"Reading {suffix} needs the library {name.partition('.')[0]}; it is not installed. "
            f"Install it with: pip install 'pqmesh[aec]'."
        ) from None


def file_bytes(path: PathLike, holds: str) -> bytes:
    """Content of a regular file that is not empty.

    Parameters
    ----------
    path : str or path
    holds : str
        What the file must hold, for messages.

    Raises
    ------
    FormatError
        Naming the file.
    """
    shown = shown_path(path)
    try:
        # A pipe or device would be waited for without end.
        if os.path.exists(path) and not os.path.isfile(path):
            raise FormatError(
                f"{shown}: {holds} must be read from a file; found a folder or a device. Name a "
                f"file in it."
            )
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise FormatError(
            f"{shown}: the file must exist; found none. Check the name and the folder."
        ) from None
    except FormatError:
        raise
    except (OSError, ValueError) as error:
        raise FormatError(
            f"{shown}: the file must be readable; found: "
            f"{getattr(error, 'strerror', None) or error}. Check its name and permissions."
        ) from None
    if not content:
        raise FormatError(f"{shown}: the file must hold {holds}; it is empty. Export it again.")
    return content


def named(path: PathLike, error: PqmeshError) -> PqmeshError:
    """The error with the name of its file in front, once."""
    shown, text = shown_path(path), str(error)
    return type(error)(text if text.startswith(f"{shown}: ") else f"{shown}: {text}")
