# All targets set up what they need: a virtual environment in .venv, from the package registry
# that pip is configured for. Nothing outside this folder is touched.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
EXTRAS := fast,viz,aec
OUT := out
# Tests run in so many processes, those of a file in one.
JOBS ?= 2
TESTS := $(BIN)/python -m pytest -n $(JOBS) --dist loadfile

.DEFAULT_GOAL := help
.PHONY: help setup roof test check verify bench docs clean

help:
	@echo "make roof    set up, panel the example roof into $(OUT)/roof, and run its case study"
	@echo "make test    set up and run the tests"
	@echo "make check   format, lint, types, layers, doctests, tests"
	@echo "make verify  every machine-checkable promise, as one table"
	@echo "make bench   benchmarks against peers, as one table;  make docs  the documentation"

# One stamp a set of extras: set-up runs again only when the project file changes.
$(VENV)/run.stamp: pyproject.toml
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'pqmesh needs Python 3.11 or newer; set PYTHON=...')"
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[$(EXTRAS)]"
	@touch $@

$(VENV)/test.stamp: $(VENV)/run.stamp
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[$(EXTRAS),test]"
	@touch $@

$(VENV)/dev.stamp: $(VENV)/test.stamp
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[$(EXTRAS),test,dev,docs]"
	@touch $@

# Peers have no wheels everywhere; the table names those that are missing.
$(VENV)/bench.stamp: $(VENV)/test.stamp
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[$(EXTRAS),test,bench]" \
	|| echo "Not all peers could be installed; the table will name them."
	@touch $@

setup: $(VENV)/dev.stamp

roof: $(VENV)/run.stamp
	$(BIN)/pqmesh panelize examples/roof/roof.toml -o $(OUT)/roof
	$(BIN)/python examples/roof/case_study.py $(OUT)/roof

test: $(VENV)/test.stamp
	$(TESTS)

check: $(VENV)/dev.stamp
	$(BIN)/ruff format --check src tests examples benchmarks
	$(BIN)/ruff check src tests examples benchmarks
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(TESTS)

verify: $(VENV)/bench.stamp
	$(BIN)/python benchmarks/verify

bench: $(VENV)/bench.stamp
	$(BIN)/python benchmarks/bench

docs: $(VENV)/dev.stamp
	$(BIN)/sphinx-build --quiet --fail-on-warning docs docs/_build

clean:
	rm -rf $(VENV) $(OUT) docs/_build .pytest_cache .mypy_cache .ruff_cache
