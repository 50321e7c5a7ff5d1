"""Transformations as JSON text: strict about keys, shapes and numbers, errors in one line."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from pqmesh.errors import FormatError
from pqmesh.vectors import Floats

Shape = tuple[int, ...]


def table_from_json(text: str, known: Mapping[str, str]) -> dict[str, Any]:
    """The one object in a JSON text, with known keys only.

    Parameters
    ----------
    text : str
    known : mapping
        From each key to what it holds, for messages.

    Raises
    ------
    FormatError
        When the text is not JSON (with line and column), holds something else, a key twice, or a
        key that is not known (with the nearest known one).

    Examples
    --------
    >>> table_from_json('{"scale": 2}', {"scale": "a number"})
    {'scale': 2}
    """
    try:
        table = json.loads(text, object_pairs_hook=_once, parse_constant=_refuse_constant)
    except FormatError:
        raise
    except json.JSONDecodeError as error:
        raise FormatError(
            f"A transformation must be JSON; found at line {error.lineno}, column {error.colno}: "
            f"{error.msg}. Mend it there."
        ) from None
    except (RecursionError, ValueError) as error:
        raise FormatError(
            f"A transformation must be one object of plain numbers; found: {error!s:.60}. Mend it."
        ) from None
    if not isinstance(table, dict):
        raise FormatError(
            f"A transformation must be a JSON object; found {type(table).__name__}. Write "
            f'{{"{next(iter(known))}": ...}}.'
        )
    for key in table:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"Did you mean {near[0]!r}?" if near else f"Write {', '.join(known)}."
            raise FormatError(
                f"The keys of this transformation must be among {', '.join(known)}; found "
                f"{key[:40]!r}. {hint}"
            )
    return table


def numbers(table: Mapping[str, Any], key: str, shape: Shape) -> Floats:
    """The finite numbers under a key, as an array of a shape; () is a single number.

    Raises
    ------
    FormatError
        When the key is missing, the shape is another, or an entry is no finite number.

    Examples
    --------
    >>> numbers({"translation": [1, 2, 3, 0]}, "translation", (4,))
    array([1., 2., 3., 0.])
    """
    wanted = "a number" if not shape else f"{' x '.join(map(str, shape))} numbers"
    if key not in table:
        raise FormatError(
            f"A transformation must have the key {key!r} with {wanted}; found none. Add it."
        )
    value = table[key]
    if not _fits(value, shape):
        raise FormatError(
            f"{key!r} must hold {wanted}, all finite; found {json.dumps(value)[:60]}. Write plain "
            f"decimal numbers in nested lists."
        )
    return np.array(value, dtype=np.float64)


def _fits(value: Any, shape: Shape) -> bool:
    """Whether nested lists have a shape and hold finite numbers."""
    if not shape:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and abs(value) < 1e300 and math.isfinite(value)
    if not isinstance(value, list) or len(value) != shape[0]:
        return False
    return all(_fits(part, shape[1:]) for part in value)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object whose keys are all different."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise FormatError(f"A key must stand once; found {twice[:40]!r} twice. Remove one of them.")
    return table


def _refuse_constant(word: str) -> NoReturn:
    raise FormatError(f"Numbers must be finite; found {word}. Write plain decimal numbers.")
