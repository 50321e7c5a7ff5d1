"""The example runs, its table holds, and its pictures are drawn."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "koebe" / "edge_offsets.py"
PAGE = Path(__file__).parents[2] / "docs" / "methods" / "koebe.md"


def loaded():
    spec = importlib.util.spec_from_file_location("edge_offsets", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_table_of_the_page_is_what_the_example_prints(tmp_path, capsys):
    found = loaded().main(str(tmp_path))
    assert "dome, 560 faces" in capsys.readouterr().out
    bounds = {
        "dome 560": 0.02,
        "saddle 256": 1e-3,
        "free-dome 528": 0.7,
        "free-saddle 288": 1.0,
    }
    for name, percent in bounds.items():
        assert found[name]["deviation_max_pct"] < percent
        assert found[name]["offset_error_max"] < 1e-13
        shown = f"| {name.split()[1]} |"
        assert shown in PAGE.read_text("utf-8")
    drawn = sorted(path.name for path in tmp_path.glob("*.png"))
    pictures = sorted(path.name for path in (PAGE.parents[1] / "pictures" / "koebe").glob("*.png"))
    assert drawn == pictures
