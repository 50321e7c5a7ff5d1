"""One line for what is wrong in a design: where, what must be, what was found, what to do."""

from __future__ import annotations

import math
import re
from typing import Any

from pydantic import BaseModel, ValidationError

from pqmesh.design_text import Where
from pqmesh.errors import SpecError
from pqmesh.surface.formula import nearest_name

# Metres in a unit.
UNITS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": 0.3048, "in": 0.0254}

# What a key must be and what to do, by the kind of pydantic's complaint.
LENGTH_WORDS = "a length such as 1.5 or '0.1 mm'"
# Above this, squares and cubes of lengths leave the range of doubles.
LARGEST_LENGTH = 1e100
_LENGTH = re.compile(r"\s*([-+0-9.eE]+)\s*([a-z]*)\s*")
LENGTH_HINT = f"Known units are {', '.join(UNITS)}."
_COMPLAINTS = {
    "finite": ("a finite number", "Give a number."),
    "float": ("a number", "Give a number."),
    "int": ("a whole number", "Give one."),
    "string": ("text", "Put it between quotation marks."),
    "bool": ("true or false", "Choose one, without quotation marks."),
    "dict": ("a table of keys and values", "Write it as a section."),
    "model": ("a table of keys and values", "Write it as a section."),
    "list": ("a list", "Put it between brackets."),
    "tuple": ("a list", "Put it between brackets."),
    "greater": ("above 0", "Raise it."),
}


def first_message(error: ValidationError, place: Where, model: type[BaseModel]) -> str:
    """One line for the first thing that is wrong: where, what, and the nearest known key."""
    found = error.errors(include_url=False)
    # A misspelt key tells more than the key that is missing because of it.
    extra = [row for row in found if row["type"] == "extra_forbidden"]
    first = (extra or found)[0]
    path = [step for step in first["loc"] if not _is_branch(step)]
    key = ".".join(step if str(step).isprintable() else repr(step) for step in map(str, path))
    where = place.at(tuple(map(str, path)))
    if extra:
        known = sorted(_known_keys(model, [str(step) for step in path[:-1]]))
        hint = nearest_name(str(path[-1]), known) or "."
        return f"{where}: {key} is not a known key{hint} Known here: {', '.join(known)}."
    if first["type"] == "missing" and isinstance(path[-1], str):
        return f"{where}: {key} must be given; it is missing. Add it."
    if first["type"] == "value_error":
        text = first["msg"].removeprefix("Value error, ").rstrip(".")
        return f"{where}: {key or 'design'}: {text}."
    must, remedy = _complaint(first, is_length=len(path) < len(first["loc"]))
    if path[-1] == "edge":
        must += ", or a list of two"
    if "vertices" in path:
        must, remedy = "a group such as 'boundary', or a list of whole numbers", "Mend it."
    if path[-1] == "twist":
        must, remedy = "an angle such as 0.01 or '0.01 deg'", "Change it."
    return f"{where}: {key} must be {must}; found {shown(first['input'])}. {remedy}"


def _complaint(first: Any, *, is_length: bool) -> tuple[str, str]:
    """What must be, and what to do, for one complaint of pydantic."""
    kind, bounds = first["type"], first.get("ctx", {})
    if is_length:
        return LENGTH_WORDS, LENGTH_HINT
    if kind == "literal_error":
        return bounds["expected"], "Choose that."
    if kind == "missing" or kind.startswith("too_"):
        return "a list of two", "Give two values."
    return _COMPLAINTS.get(kind.split("_")[0], ("as documented", "Mend it."))


def _is_branch(step: str | int) -> bool:
    """Whether a step of pydantic's path names a branch of a union, not a key."""
    return isinstance(step, str) and (step in ("float", "str") or step.startswith("tuple["))


def shown(value: Any) -> str:
    """A value as a message of one line may show it."""
    if isinstance(value, int) and abs(value) >= 10**60:
        return "a number of more than 60 digits"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _known_keys(model: type[BaseModel], path: list[str]) -> list[str]:
    """Keys of the section that a path leads to."""
    for step in path:
        field = model.model_fields.get(step)
        inner = field.annotation if field else None
        parts = [inner, *getattr(inner, "__args__", ())]
        nested = [p for p in parts if isinstance(p, type) and issubclass(p, BaseModel)]
        if not nested:
            break
        model = nested[0]
    # A net's file names no further file.
    return [
        key for key in model.model_fields if (model.__name__, key) != ("NetSpec", "file") or path
    ]


def length_in(units: str | None, value: float | str, key: str) -> float:
    """A length in a model unit; without one only plain numbers have a meaning."""
    if not isinstance(value, str):
        number = float(value)
    else:
        match = _LENGTH.fullmatch(value)
        unit = match.group(2) if match else ""
        try:
            number = float(match.group(1)) if match else math.nan
        except ValueError:
            number = math.nan
        if not match or (unit and unit not in UNITS) or math.isnan(number):
            raise SpecError(f"{key} must be {LENGTH_WORDS}; found {shown(value)}. {LENGTH_HINT}")
        if unit and units is None:
            raise SpecError(
                f"{key} has a unit, so the unit of the mesh must be known; found {shown(value)}. "
                f"Add units = 'm', say, or leave the unit out."
            )
        number *= UNITS[unit] / UNITS[units or unit] if unit else 1.0
    if not abs(number) <= LARGEST_LENGTH:
        raise SpecError(
            f"{key} must be below {LARGEST_LENGTH:g}; found {shown(value)}. Check the units."
        )
    return number
