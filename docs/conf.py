"""Settings of the documentation; it builds without a network."""

from __future__ import annotations

import re
from typing import Any

import pqmesh

project = "pqmesh"
author = "The pqmesh developers"
project_copyright = author
version = release = pqmesh.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"pqmesh {release}"
html_copy_source = False
default_role = "code"
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_param = False
napoleon_use_rtype = False

_CODE = re.compile(r"(`[^`]*`)")


def _plain_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Bars are absolute values and stars are products here, not markup."""
    for i, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = _CODE.split(line)
            parts[::2] = [re.sub(r"(?<!\\)([|*]|\w_(?!\w))", _escaped, part) for part in parts[::2]]
            lines[i] = "".join(parts)


def _escaped(found: re.Match[str]) -> str:
    return found[0][:-1] + "\\" + found[0][-1]


def _hidden(app: Any, what: str, name: str, obj: Any, skip: bool, options: Any) -> bool | None:
    """Fields of named tuples say nothing of their own."""
    return True if (getattr(obj, "__doc__", "") or "").startswith("Alias for field") else None


def setup(app: Any) -> None:
    """Register what is above."""
    app.connect("autodoc-process-docstring", _plain_bars, priority=400)
    app.connect("autodoc-skip-member", _hidden)
