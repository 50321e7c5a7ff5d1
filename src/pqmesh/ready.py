"""Ready designs to begin with: what `pqmesh example` lists and writes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from pqmesh.errors import SpecError
from pqmesh.surface.formula import nearest_name

# Name of each example: what it shows, and its files below the folder of examples.
EXAMPLES: Mapping[str, tuple[str, tuple[str, ...]]] = MappingProxyType(
    {
        "vault": ("a small vault with every section of a design", ("designs/vault.toml",)),
        "roof": (
            "the freeform roof of the case study, and the sketch that fails",
            (
                *("roof/roof.toml", "roof/net.json", "roof/site.svg"),
                *("roof/sketch.toml", "roof/sketch.json"),
            ),
        ),
        "conjugate": ("a saddle along a direction of your own", ("designs/conjugate.toml",)),
        "dome": ("geodesics on a cap of a sphere", ("designs/dome.toml",)),
        "torus": ("a closed conical mesh", ("designs/torus.toml",)),
        "rhino": ("a design for a Rhino model of yours", ("designs/rhino.toml",)),
    }
)


def example_files(name: str) -> dict[str, bytes]:
    """Files of an example by name, as they are to be written.

    Raises
    ------
    SpecError
        When there is no such example; names the nearest and lists all.

    Examples
    --------
    >>> list(example_files("torus"))
    ['torus.toml']
    """
    if name not in EXAMPLES:
        raise SpecError(
            f"An example must be one of {', '.join(EXAMPLES)}; found {name!r}"
            f"{nearest_name(name, EXAMPLES) or '.'} Choose one."
        )
    here = Path(__file__).parent / "examples"
    # In a checkout the examples stand beside the sources.
    folder = here if here.is_dir() else Path(__file__).parents[2] / "examples"
    return {Path(path).name: (folder / path).read_bytes() for path in EXAMPLES[name][1]}
