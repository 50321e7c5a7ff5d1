"""What is typed: texts of arguments and options as values of a design."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pqmesh.errors import FormatError, PqmeshError, SpecError

if TYPE_CHECKING:
    from pqmesh.design_text import DesignText
    from pqmesh.transform.laguerre import LaguerreTransform
    from pqmesh.transform.moebius import MoebiusTransform

# What `panelize` takes beside designs; the readers stand in source_faces.
SURFACE_SUFFIXES = (".3dm", ".json")


def design_text(source: Path) -> DesignText:
    """Tables of a design, or of a bare surface file."""
    from pqmesh.design import Design
    from pqmesh.design_text import DesignText, Where
    from pqmesh.io.atomic import shown_path

    suffix = source.suffix.lower()
    if suffix == ".toml":
        return Design.read(source)
    shown = shown_path(source)
    if not source.exists():
        raise FormatError(f"The file {shown} must exist; it does not. Check the path.")
    if suffix not in SURFACE_SUFFIXES or source.is_dir():
        found = "a folder" if source.is_dir() else f"{suffix or 'no suffix'!r}"
        raise FormatError(
            f"{shown}: a surface must be a design (.toml), a Rhino model (.3dm), or a control net "
            f"or COMPAS surface (.json); found {found}. Export it as one of these, or write it as "
            f"a formula."
        )
    table = {"surface": {"file": source.name}}
    return DesignText(table, source.parent, Where(shown_path(source.name)))


def put(table: dict[str, Any], path: tuple[str, ...], value: Any) -> None:
    """An option that was given wins over the file; a wrong section is left to the check."""
    for step in path[:-1]:
        inner = table.setdefault(step, {})
        if not isinstance(inner, dict):
            return
        table = inner
    table[path[-1]] = value.value if isinstance(value, StrEnum) else value


def drop(table: dict[str, Any], path: tuple[str, ...], keys: tuple[str, ...]) -> None:
    """Take keys out of a section that an option replaces."""
    for step in path:
        table = table.get(step, {})
        if not isinstance(table, dict):
            return
    for key in keys:
        table.pop(key, None)


def file_and_name(text: str | None, folder: Path) -> dict[str, str] | None:
    """Keys of FILE[:NAME]; the whole text is the file where such a file exists.

    Files of options are sought from where the command runs, those of a design from its folder.
    """
    if text is None:
        return None
    file, name = _split_name(text)
    path = Path(file).absolute()
    with contextlib.suppress(ValueError):  # another drive
        path = Path(os.path.relpath(path, folder.absolute()))
    return {"file": path.as_posix()} | ({"select": name} if name else {})


def _split_name(text: str) -> tuple[str, str]:
    """FILE and NAME of FILE[:NAME]; names may hold colons, as the full path of a layer does."""
    # A single letter before a colon is a drive.
    places = [k for k, letter in enumerate(text) if letter == ":" and k > 1]
    if not places or Path(text).exists():
        return text, ""
    files = [k for k in places if Path(text[:k]).is_file()]
    likely = [k for k in places if Path(text[:k]).suffix]
    first = (files or likely or places)[0]
    return text[:first], text[first + 1 :]


def length(text: str | None) -> float | str | None:
    """A length of an option."""
    return None if text is None else number_or_text(text)


def edge_of(text: str | None) -> Any:
    """One length, or a list of what stands between commas."""
    found = lengths(text)
    return found[0] if found and len(found) == 1 else found


def lengths(text: str | None) -> list[float | str] | None:
    """What stands between commas; nothing of an empty text."""
    if text is None:
        return None
    return [number_or_text(part) for part in text.split(",")] if text.strip() else []


def pairs(texts: list[str] | None) -> Iterator[tuple[str, float | str]]:
    """Keys and values of KEY=VALUE."""
    for text in texts or []:
        key, found, value = text.partition("=")
        if not found or not key.strip() or not value.strip():
            raise SpecError(
                f"A tolerance must be KEY=VALUE; found {text!r}. Write --tolerance flat=0.1mm, say."
            )
        yield key.strip(), number_or_text(value)


def limits(texts: list[str] | None) -> dict[str, float]:
    """Limits of KEY=VALUE, numbers above 0; one alone is that of planarity."""
    found = {}
    for text in texts or []:
        key, equals, value = text.rpartition("=")
        number = number_or_text(value)
        is_named = not equals or bool(key.strip())
        if not (is_named and isinstance(number, float) and 0 < number < math.inf):
            raise SpecError(
                f"--tolerance must be a number above 0, or KEY=NUMBER; found {text[:80]!r}. Write "
                f"--tolerance 1e-9 or --tolerance area=0.05, say."
            )
        found[key.strip() or "planar"] = number
    return found


def numbers_of(flag: str, form: str, text: str) -> list[float]:
    """The finite numbers between commas, as many as a form like X,Y,Z names."""
    count = form.count(",") + 1
    values = [number_or_text(part) for part in text.split(",")]
    numbers = [value for value in values if isinstance(value, float) and math.isfinite(value)]
    if len(values) != count or len(numbers) != count:
        raise SpecError(
            f"{flag} must be {form}, {count} finite numbers; found {text[:80]!r}. Write them with "
            f"commas and without units."
        )
    return numbers


def transform_of(
    options: dict[str, Any], center: str | None
) -> LaguerreTransform | MoebiusTransform:
    """The transformation that exactly one option names."""
    from pqmesh.transform.laguerre import LaguerreTransform
    from pqmesh.transform.moebius import MoebiusTransform

    given = [flag for flag, value in options.items() if value is not None]
    if len(given) != 1:
        raise SpecError(
            f"Exactly one of {', '.join(options)} must be given; found "
            f"{' and '.join(given) or 'none'}. Chain several in one file, or run one by one."
        )
    flag, value = given[0], options[given[0]]
    if center is not None and flag != "--boost":
        raise SpecError(f"--center belongs to --boost; found it with {flag}. Leave it out.")
    if flag == "--offset":
        return LaguerreTransform.offset(numbers_of(flag, "DISTANCE", str(value))[0])
    if flag == "--boost":
        *direction, rapidity = numbers_of(flag, "X,Y,Z,RAPIDITY", value)
        point = [0.0, 0.0, 0.0] if center is None else numbers_of("--center", "X,Y,Z", center)
        return LaguerreTransform.boost(direction, rapidity, point)
    if flag == "--invert":
        *middle, radius = numbers_of(flag, "X,Y,Z,R", value)
        return MoebiusTransform.inversion(middle, radius)
    kind = LaguerreTransform if flag == "--laguerre" else MoebiusTransform
    return _transform_file(kind, value)


def _transform_file(
    kind: type[LaguerreTransform] | type[MoebiusTransform], path: Path
) -> LaguerreTransform | MoebiusTransform:
    """The transformation in a JSON file; errors name the file."""
    from pqmesh.io.foreign import file_bytes, named

    try:
        text = file_bytes(path, "a transformation").decode("utf-8-sig")
        return kind.from_json(text)
    except UnicodeDecodeError:
        error: PqmeshError = FormatError(
            "A transformation must be JSON text in UTF-8; found other bytes. Export it again."
        )
    except PqmeshError as found:
        error = found
    raise named(path, error)


def number_or_text(part: str) -> float | str:
    """A plain number as such, all else as text that may carry a unit."""
    try:
        return float(part)
    except ValueError:
        return part.strip()
