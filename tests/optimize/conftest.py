"""Back ends of the linear algebra, one after the other, whatever is installed."""

import pytest

from pqmesh import linear

MODULES = {"_SuperLU": None, "_Rslab": "rslab", "_Pardiso": "pymklpardiso"}


def only(monkeypatch, module):
    """Hide every module but one from the choice of a back end."""
    monkeypatch.setattr(linear, "is_usable", lambda name: name == module)


@pytest.fixture(params=MODULES)
def backend(request, monkeypatch):
    """One back end after the other."""
    module = MODULES[request.param]
    if module and not linear.is_usable(module):
        pytest.skip(f"{module} is not installed")
    only(monkeypatch, module)
    assert type(linear._backend(1)).__name__ == request.param
    return request.param


@pytest.fixture
def without_extras(monkeypatch):
    """A function that leaves SciPy alone from then on."""
    return lambda: only(monkeypatch, None)
