"""Which objects of a drawing are meant: by layer or by name, and one answer when none is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from pqmesh.errors import FormatError, SpecError
from pqmesh.surface.formula import nearest_name

BLOCK = "block instance"
LISTED = 12


class Item(NamedTuple):
    """One object of a drawing.

    Attributes
    ----------
    kind : str
        "surface", "curve", "block instance" or another word for people.
    name : str
        Empty when it has none.
    layer : str
        Full path; levels are separated by "::".
    content : object
        As the library gives it.
    """

    kind: str
    name: str
    layer: str
    content: Any


def choose(
    items: Sequence[Item], layers: Iterable[str], select: str | None, kind: str
) -> list[Item]:
    """The objects of a kind that a selection means, in the order of the file.

    A selection is a layer (full path or last part) or the name of objects, in upper or lower
    case; a layer wins over an object of the same name unless it holds nothing of the kind.
    Without a selection all objects of the kind are meant, and must lie on one layer.

    Parameters
    ----------
    items : sequence of Item
    layers : iterable of str
        All layers of the file, also empty ones.
    select : str or None
    kind : str

    Raises
    ------
    SpecError
        When nothing or several things have that name, with the nearest name and what is there;
        when a block instance is selected.
    FormatError
        When the file holds nothing of the kind.

    Examples
    --------
    >>> roof = Item("surface", "main", "Roof::Shell", 1)
    >>> choose([roof, Item("mesh", "", "Site", 2)], ["Roof::Shell", "Site"], "shell", "surface")
    [Item(kind='surface', name='main', layer='Roof::Shell', content=1)]
    """
    if select is None:
        return _all_of(items, kind)
    layer = _layer_of(select, [*layers, *(item.layer for item in items)])
    on_layer = [item for item in items if layer is not None and item.layer == layer]
    named = [item for item in items if item.name and _same(item.name, select)]
    for found in (on_layer, named):
        if any(item.kind == kind for item in found):
            _refuse_blocks(found, select)
            return [item for item in found if item.kind == kind]
    found = on_layer + [item for item in named if item.layer != layer]
    if found:
        _refuse_blocks(found, select)
        raise SpecError(
            f"{_word(select)} must hold a {kind}; it holds {_counts(found)}. {_there(items, kind)}"
        )
    if layer is not None:
        raise SpecError(f"The layer {_word(layer)} is empty. {_there(items, kind)}")
    known = {item.layer for item in items} | {item.name for item in items if item.name}
    known |= {_leaf(path) for path in known | set(layers)}
    by_fold = {word.casefold(): word for word in sorted(known)}
    hint = nearest_name(select.casefold(), by_fold)
    for fold, word in by_fold.items():
        hint = hint.replace(f"{fold!r}?", f"{_word(word)}?")
    raise SpecError(
        f"No layer or object is called {_word(select)}{hint.rstrip('?') + '?' if hint else '.'} "
        f"{_there(items, kind)}"
    )


def _all_of(items: Sequence[Item], kind: str) -> list[Item]:
    """All objects of a kind, when they lie on one layer."""
    found = [item for item in items if item.kind == kind]
    if not found:
        blocks = any(item.kind == BLOCK for item in items)
        advice = "Explode the blocks first" if blocks else f"Export a {kind}"
        raise FormatError(f"The file must hold a {kind}; it holds {_counts(items)}. {advice}.")
    if len({item.layer for item in found}) > 1:
        raise SpecError(
            f"The file holds {kind}s on several layers, and which are meant must be said. "
            f"{_there(items, kind)} Select one of them."
        )
    return found


def _layer_of(select: str, layers: list[str]) -> str | None:
    """The layer meant, by its full path or, when there is only one such, its last part."""
    whole = [path for path in layers if _same(path, select)]
    if whole:
        # Names that differ in case only are one layer to Rhino and to AutoCAD.
        return select if select in whole else whole[0]
    leaves = sorted({path for path in layers if _same(_leaf(path), select)})
    if len(leaves) > 1:
        raise SpecError(
            f"One layer must be meant; {_word(select)} are {len(leaves)}: "
            f"{', '.join(_word(path) for path in leaves[:LISTED])}. Give the full path."
        )
    return leaves[0] if leaves else None


def _refuse_blocks(found: list[Item], select: str) -> None:
    """Block instances have no shape of their own here."""
    blocks = sum(item.kind == BLOCK for item in found)
    if blocks:
        raise SpecError(
            f"The objects selected must be plain; {_word(select)} holds {blocks} block "
            f"instance{'s' * (blocks > 1)}. Explode the blocks, and save the file again."
        )


def _there(items: Sequence[Item], kind: str) -> str:
    """The layers and named objects of a kind, for messages."""
    layers = Counter(item.layer for item in items if item.kind == kind)
    names = Counter(item.name for item in items if item.kind == kind and item.name)
    if not layers:
        return f"The file holds {_counts(items)} and no {kind}."
    text = f"There are {kind}s on the layers {_listed(layers)}"
    return f"{text}; named objects: {_listed(names)}." if names else f"{text}; none has a name."


def _listed(counts: Counter[str]) -> str:
    """Names with counts, the first few."""
    words = [f"{_word(name)} ({count})" for name, count in list(counts.items())[:LISTED]]
    more = len(counts) - len(words)
    return ", ".join(words) + (f" and {more} more" if more else "")


def _counts(items: Sequence[Item]) -> str:
    """Such as "2 curves, 1 mesh"."""
    kinds = Counter(item.kind for item in items)
    plural = {word: word + ("es" if word.endswith("sh") else "s") for word in kinds}
    words = [f"{n} {kind if n == 1 else plural[kind]}" for kind, n in kinds.items()]
    return ", ".join(words) or "no objects"


def _leaf(path: str) -> str:
    return path.rpartition("::")[2]


def _same(a: str, b: str) -> bool:
    return a.casefold() == b.casefold()


def _word(text: str) -> str:
    """A name in quotes, short and on one line."""
    return repr(text if len(text) <= 60 else text[:57] + "...")
