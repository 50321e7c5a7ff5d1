"""What the documents say holds: snippets run, links lead somewhere, public names exist."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import typer
from pydantic import BaseModel

import pqmesh
from pqmesh.check import check_report
from pqmesh.cli import app
from pqmesh.design import Design
from pqmesh.job import Spec, panelize
from pqmesh.mesh.exact import rotational_mesh
from pqmesh.report import panelization_report

ROOT = Path(__file__).parents[2]
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted(path for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts),
]
# [text](target) and ![text](target), but nothing inside backquotes.
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
PUBLIC = [name for name in pqmesh.__all__ if not name.startswith("__")]


def snippets(page, language):
    """Blocks of code of a language in a page."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.M)


def run(*words, folder):
    """Outcome of the Python of this environment on these words, in a fresh process."""
    return subprocess.run(
        [sys.executable, *words], cwd=folder, capture_output=True, text=True, timeout=300
    )


def test_python_snippets_of_the_readme_run(tmp_path):
    blocks = snippets(ROOT / "README.md", "python")
    assert blocks
    for block in blocks:
        done = run("-c", block, folder=tmp_path)
        assert done.returncode == 0, done.stderr


def test_python_snippets_of_getting_started_run_in_order(tmp_path):
    blocks = snippets(ROOT / "docs" / "getting-started.md", "python")
    assert blocks
    done = run("-c", "\n".join(blocks), folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_python_snippets_of_the_methods_run(tmp_path):
    pages = [page for page in PAGES if page.parent.name == "methods" and snippets(page, "python")]
    assert pages
    for page in pages:
        done = run("-c", "\n".join(snippets(page, "python")), folder=tmp_path)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_relative_links_lead_to_files(page):
    text = CODE.sub("", page.read_text("utf-8"))
    targets = [target.partition("#")[0] for target in LINK.findall(text)]
    local = [target for target in targets if target and "://" not in target]
    missing = [t for t in local if not t.startswith("mailto:") and not (page.parent / t).exists()]
    assert not missing


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_imports_and_has_a_docstring(name):
    value = getattr(import_module(f"pqmesh.{pqmesh._PUBLIC[name]}"), name)
    assert (value.__doc__ or "").strip()


def test_public_names_are_the_same_whatever_was_imported_before(tmp_path):
    lines = ["import pqmesh", "from importlib import import_module as module"]
    for name in PUBLIC:
        if name != "panelize":
            place = f"pqmesh.{pqmesh._PUBLIC[name]}"
            lines.append(f"assert module({place!r}).{name} is pqmesh.{name}, {name!r}")
    done = run("-c", "\n".join(lines), folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_public_name_panelize_is_the_function_after_another_name_of_its_module(tmp_path):
    done = run(
        "-c", "from pqmesh import Spec, panelize; assert callable(panelize)", folder=tmp_path
    )
    assert done.returncode == 0


def test_architecture_names_every_module():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    folder, named = "", set()
    for line in page.split("```text")[1].split("```")[0].splitlines()[2:]:
        indent, words = len(line) - len(line.lstrip()), line.split()
        if indent == 2:
            folder = words[0] if words[0].endswith("/") else ""
        named |= {folder + word for word in words if word.endswith(".py")}
    package = ROOT / "src" / "pqmesh"
    here = {path.relative_to(package).as_posix() for path in package.rglob("*.py")}
    # A folder's own file goes without saying, and terms/ is named as a folder.
    assert named == {p for p in here if not p.endswith("/__init__.py") and "terms/" not in p}


def documented(name):
    """Words in backquotes, in tables and text, of a page."""
    text = (ROOT / "docs" / name).read_text("utf-8")
    return {
        word for code in re.findall(r"`([^`\n]+)`", text) for word in re.findall(r"[\w-]+", code)
    }


def design_keys(model):
    """Sections and keys of a design, those of its parts included."""
    for key, field in model.model_fields.items():
        yield key
        for part in [field.annotation, *getattr(field.annotation, "__args__", ())]:
            if isinstance(part, type) and issubclass(part, BaseModel):
                yield from design_keys(part)


def test_every_key_of_a_design_is_documented():
    page = (ROOT / "docs" / "design.md").read_text("utf-8")
    known = documented("design.md") | set(re.findall(r"^## \[(\w+)\]", page, re.M))
    assert set(design_keys(Design)) <= known


def test_every_option_is_documented():
    known = documented("commands.md")
    commands = typer.main.get_command(app).commands
    page = (ROOT / "docs" / "commands.md").read_text("utf-8")
    assert set(re.findall(r"^## (\w+)$", page, re.M)) == set(commands)
    options = {
        option
        for command in commands.values()
        for parameter in command.params
        for option in [*parameter.opts, *parameter.secondary_opts]
        if option.startswith("--")
    }
    assert {option.lstrip("-") for option in options} <= {word.lstrip("-") for word in known}


def report_keys(table):
    """Keys of a report, nested ones included; the design repeats other keys."""
    for key, value in table.items():
        yield key
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, dict) and key != "design":
                yield from report_keys(part)


def test_every_key_of_a_report_is_documented():
    torus = pqmesh.shape_surface("torus")
    roof = panelize(torus, Spec(edges=(1.2, 1.2), distances=(0.1,)))
    design = Design.of({"surface": {"shape": {"kind": "torus"}}, "panels": {"edge": 1.2}})
    report = panelization_report(roof, source="", design=design, origin=np.zeros(3))
    keys = set(report_keys(report))
    skew = rotational_mesh([[2.0, 0.0], [2.4, 0.5], [2.5, 1.2]], np.array([0.0, 0.3, 0.7, 1.0]))
    keys |= set(report_keys(check_report(skew, source="", units=None, tolerance=1e-6)))
    assert keys <= documented("report.md")
