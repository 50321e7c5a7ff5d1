"""What an earlier run has left in a folder, and how it is cleared away: our own files only."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from pathlib import Path

# Files that an earlier run of the same command may have left and this one does not replace.
_OURS = re.compile(
    r"(mesh|panels|(layer-\d+|support)(-panels)?)\.obj|report\.json|figures/[a-z-]+\.png"
)

# Folders of parts, as `part_folders` names them.
_PART = re.compile(r"\d+-[A-Za-z0-9._-]+")


def earlier_parts(folder: Path) -> set[str]:
    """Folders of the parts that an earlier run has written, by its report."""
    try:
        index = json.loads((folder / "report.json").read_bytes())
        names = {part["folder"] for part in index.get("parts", ())}
    except (OSError, ValueError, RecursionError, AttributeError, LookupError, TypeError):
        return set()
    return {name for name in names if isinstance(name, str) and _PART.fullmatch(name)}


def remove_parts(folder: Path, names: set[str]) -> None:
    """Remove our files from the folders of parts that are no more."""
    for name in sorted(names):
        remove_leftovers(folder / name, set())
        with suppress(OSError):
            (folder / name).rmdir()


def remove_leftovers(folder: Path, kept: set[str]) -> None:
    """Remove what an earlier run of ours left and this run has not made."""
    for path in [*folder.glob("*.obj"), *folder.glob("report.json"), *folder.glob("figures/*.png")]:
        name = path.relative_to(folder).as_posix()
        if name not in kept and _OURS.fullmatch(name):
            # The result stands; what cannot be removed is no reason to call it failed.
            with suppress(OSError):
                path.unlink()
    with suppress(OSError):
        (folder / "figures").rmdir()
