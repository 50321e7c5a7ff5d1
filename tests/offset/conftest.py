"""The folder of real meshes."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Folder named by PQMESH_DATA, else shared/data beside the checkout."""
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    folder = Path(os.environ.get("PQMESH_DATA", beside))
    if not folder.is_dir():
        pytest.skip("the real meshes are not here; set PQMESH_DATA to their folder")
    return folder
