# Every target makes the environment that it needs, and makes it anew when the dependencies changed.
PYTHON ?= python3
BIN := .venv/bin
LOWEST := .venv-lowest
NEWEST := .venv-newest
CLEAN := .venv-wheel
STAMP := .venv/installed
PIP := -m pip install --quiet --disable-pip-version-check

# The core, the losses, the metric, label maps, outlines, the command and its tables: what `make test-lowest` runs. TESTS=tests
# runs all.
SHORT := $(addprefix tests/test_,known_values.py distance.py field.py complexity.py entropy.py error_bound.py soft.py losses.py \
	labels.py polygons.py geodata.py cli.py tables.py) $(wildcard tests/test_metric*.py)
TESTS ?= $(SHORT)

.PHONY: venv demo test test-all test-gpu test-lowest test-newest lint types docs bench dist dist-check check clean

venv: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python $(PIP) -c constraints.txt -e ".[docs,dev]"
	touch $@

demo: $(STAMP)
	$(BIN)/python examples/demo.py

# Doctests of the package and the README run with the tests; pytest's settings are in pyproject.toml.
test: $(STAMP)
	$(BIN)/python -m pytest -m "not slow"

test-all: $(STAMP)
	$(BIN)/python -m pytest

# What needs a GPU: the tests marked gpu, then the benchmark that says where a mask on a GPU is solved soonest. Without a
# GPU it says so, and does nothing.
test-gpu: $(STAMP)
	$(BIN)/python tools/check_gpu.py

# The lowest versions that pyproject.toml declares, on the pinned torch. Old libraries beside new ones warn of what is
# deprecated, so warnings are no errors here. numba's cache is apart: another numba would write over it.
$(LOWEST)/installed: pyproject.toml constraints-lowest.txt
	$(PYTHON) -m venv --clear $(LOWEST)
	$(LOWEST)/bin/python $(PIP) -c constraints-lowest.txt -e ".[test]"
	touch $@

test-lowest: $(LOWEST)/installed
	NUMBA_CACHE_DIR=$(LOWEST)/numba $(LOWEST)/bin/python -m pytest -o filterwarnings=default -o cache_dir=$(LOWEST)/pytest \
		--disable-warnings -m "not slow" $(TESTS)

# The newest versions of everything; on another Python: make test-newest PYTHON=python3.13
test-newest:
	$(PYTHON) -m venv --clear $(NEWEST)
	$(NEWEST)/bin/python $(PIP) -e ".[test]"
	NUMBA_CACHE_DIR=$(NEWEST)/numba $(NEWEST)/bin/python -m pytest -o filterwarnings=default -m "not slow"

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# The library, and a program that uses it (tests/downstream), whose types must also pass pyright.
types: $(STAMP)
	$(BIN)/mypy
	$(BIN)/pyright --pythonpath $(BIN)/python tests/downstream

# Runs every gallery page in examples/ too: a page that fails, or a warning, fails the build.
docs: $(STAMP)
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

bench: $(STAMP)
	$(BIN)/python -m benchmarks

dist: $(STAMP)
	rm -rf dist
	$(BIN)/python -m build --outdir dist >/dev/null
	$(BIN)/python -m twine check --strict dist/*

# The wheel in an environment of its own: first the core alone, then the extras that the README names.
dist-check: dist
	$(BIN)/python tools/check_dist.py dist
	$(PYTHON) -m venv --clear $(CLEAN)
	$(CLEAN)/bin/python $(PIP) -c constraints.txt dist/*.whl
	cd tools && ../$(CLEAN)/bin/python run_readme.py core
	$(CLEAN)/bin/python $(PIP) -c constraints.txt "$$(echo dist/*.whl)[cli,plot,metrics,report]"
	cd tools && ../$(CLEAN)/bin/python run_readme.py all
	cd tests/downstream && ../../$(CLEAN)/bin/python user.py
	cd tests/downstream && ../../$(BIN)/mypy --strict --python-executable ../../$(CLEAN)/bin/python \
		--config-file= --cache-dir ../../.mypy_cache/downstream user.py

# All that CI runs. The tests come last, so that the output ends with their count.
check: venv lint types docs demo dist-check test-lowest test-all

clean:
	rm -rf .venv $(LOWEST) $(NEWEST) $(CLEAN) build dist demo docs/_build docs/gallery .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
