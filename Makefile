# Two commands do all the set-up on a machine with Python >= 3.11 and make:
#   make demo   environment, install, then the main job on the bundled capture
#   make test   the same environment with the test tools, then lint, types and tests
#   make bench  frames per second of an animated head
# and make regress compares the accuracy of every method with the baselines, make studies reruns some studies.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
DEMO ?= demo
FIGURES ?= figures

.PHONY: demo docs figures bench test test-slow studies regress lint types check lab clean

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "evalkit needs Python 3.11 or newer; run: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

# A stamp each, so that a second run does not install again unless the project files changed.
$(VENV)/installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install -c constraints.txt -e .
	@touch $@

$(VENV)/installed-test: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install -c constraints.txt -e '.[test]'
	@touch $@ $(VENV)/installed

# The MakeHuman head is somebody else's, free to use, and a download; without it the demo shows the built-in head alone.
demo: $(VENV)/installed
	-$(BIN)/evalkit head get makehuman
	$(BIN)/evalkit demo -o $(DEMO)

test: $(VENV)/installed-test lint types
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow and not timing"
	$(BIN)/python -m pytest -m "timing and not slow"

test-slow: $(VENV)/installed-test
	$(BIN)/python -m pytest -m slow

bench: $(VENV)/installed
	$(BIN)/evalkit bench

# A few studies with the small budget, under two minutes; 'evalkit study run --all' does every one in some four.
studies: $(VENV)/installed
	$(BIN)/evalkit study run pose-noise pivot-noise pivot-sway gaps outliers regions -o results

# Every figure measured anew with the small budget; 'evalkit figures' draws those of paper_figures/ from their tables.
figures: $(VENV)/installed
	$(BIN)/evalkit figures --run --budget small -o $(FIGURES)

# The site in build/docs, notebooks with their outputs included; opens from its files, without a server or a network.
docs: $(VENV)/installed-docs notebooks
	$(BIN)/sphinx-build --fail-on-warning --keep-going --nitpicky --fresh-env --quiet docs build/docs
	EVALKIT_SITE=build/docs $(BIN)/python -m pytest tests/test_docs.py -k "site or entry"

$(VENV)/installed-docs: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install -c constraints.txt -e '.[test,docs]'
	@touch $@ $(VENV)/installed $(VENV)/installed-test

regress: $(VENV)/installed
	$(BIN)/evalkit regress

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/installed-test
	$(BIN)/mypy

lab: $(VENV)/installed
	$(BIN)/jupyter lab notebooks

clean:
	rm -rf $(VENV) $(DEMO) .pytest_cache .mypy_cache .ruff_cache .hypothesis
