"""Lets tests import the modules that stand beside them, and finds the real files."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# As the command does, before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parent))

# The same cases on every run; HYPOTHESIS_PROFILE=default looks for new ones.
settings.register_profile("same", derandomize=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder of the real files: the variable PQMESH_DATA, else shared/data beside the checkout."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    folder = Path(os.environ.get("PQMESH_DATA", beside))
    if not folder.is_dir():
        pytest.skip("the real files are not here; set PQMESH_DATA to their folder")
    return folder
