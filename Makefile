# Every target makes .venv when it is missing, and makes it anew when the dependencies changed.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/installed

.PHONY: venv demo test lint types docs bench check clean

venv: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[plot,docs,dev]"
	touch $@

demo: $(STAMP)
	$(BIN)/python examples/demo.py

# Doctests of the package and the README run with the tests; pytest's settings are in pyproject.toml.
test: $(STAMP)
	$(BIN)/python -m pytest

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

# Runs every gallery page in examples/ too: a page that fails, or a warning, fails the build.
docs: $(STAMP)
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

bench: $(STAMP)
	$(BIN)/python -m benchmarks

# All that CI runs. The tests come last, so that the output ends with their count.
check: venv lint types docs demo test

clean:
	rm -rf .venv build dist demo docs/_build docs/gallery .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
