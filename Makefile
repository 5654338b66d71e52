# Two commands do all the set-up on a machine with Python >= 3.11 and make:
#   make demo   environment, install, then the main job on the bundled capture
#   make test   the same environment with the test tools, then lint, types and tests
#   make bench  frames per second of an animated head
#   make package      wheel and sdist, and the wheel in an empty environment
#   make test-oldest  the lowest versions that pyproject.toml promises (Python 3.11)
# make test VENV=.venv-3.13 PYTHON=python3.13 runs the tests on another Python;
# make regress compares the accuracy of every method with the baselines, make studies reruns some studies.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
PIP_FLAGS ?=
DEMO ?= demo
OLDEST ?= .venv-oldest
OLDEST_PYTHON ?= python3.11
FIGURES ?= figures
# Two workers on two cores: threads of BLAS would spend most of their time waiting for each other.
ONE_THREAD := OMP_NUM_THREADS=1

.PHONY: demo docs notebooks figures bench test test-slow studies regress test-oldest package lint types check lab clean

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "evalkit needs Python 3.11 or newer; run: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

# A stamp each, so that a second run does not install again unless the project files changed.
$(VENV)/installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install $(PIP_FLAGS) -c constraints.txt -e .
	@touch $@

$(VENV)/installed-test: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install $(PIP_FLAGS) -c constraints.txt -e '.[test]'
	@touch $@ $(VENV)/installed

# The MakeHuman head is somebody else's, free to use, and a download; without it the demo shows the built-in head alone.
demo: $(VENV)/installed
	-$(BIN)/evalkit head get makehuman
	$(BIN)/evalkit demo -o $(DEMO)

test: $(VENV)/installed-test lint types
	$(ONE_THREAD) $(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow and not timing"
	$(BIN)/python -m pytest -m "timing and not slow"

test-slow: $(VENV)/installed-test
	$(BIN)/python -m pytest -m slow

# Warnings of old packages about newer ones that they use are not evalkit's.
OLDEST_TESTS := tests/contracts/test_pose_contract.py tests/contracts/test_kernel_contract.py tests/test_cli.py \
  tests/test_render.py tests/test_study.py tests/test_doctests.py
test-oldest: $(OLDEST)/installed-test
	$(ONE_THREAD) $(OLDEST)/bin/python -m pytest -n 2 --dist worksteal -m "not slow and not timing" \
	  -W ignore::DeprecationWarning -W ignore::PendingDeprecationWarning $(OLDEST_TESTS)

$(OLDEST)/installed-test: pyproject.toml constraints-oldest.txt
	$(OLDEST_PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python -m pip --disable-pip-version-check --quiet install $(PIP_FLAGS) -c constraints-oldest.txt -e '.[test]'
	@touch $@

package: $(VENV)/installed-test
	rm -rf dist
	$(BIN)/python -m build --no-isolation --outdir dist .
	PYTHON=$(BIN)/python .ci/try-wheel dist/*.whl

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
	rm -rf build/docs
	$(BIN)/sphinx-build --fail-on-warning --keep-going --nitpicky --jobs 2 --quiet docs build/docs
	EVALKIT_SITE=build/docs $(ONE_THREAD) $(BIN)/python -m pytest -n 2 -m "" tests/test_docs.py -k "site or entry or recipe"

$(VENV)/installed-docs: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) install $(PIP_FLAGS) -c constraints.txt -e '.[test,docs]'
	@touch $@ $(VENV)/installed $(VENV)/installed-test

regress: $(VENV)/installed-test
	$(BIN)/evalkit regress

lint: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/installed-test
	$(BIN)/mypy

lab: $(VENV)/installed-test
	$(BIN)/jupyter lab notebooks

# Executed copies with their outputs, which the documentation shows; 'make -j2 notebooks' runs two at a time.
NOTEBOOKS := $(patsubst notebooks/%,build/notebooks/%,$(wildcard notebooks/*.ipynb))
notebooks: $(NOTEBOOKS)
	@! grep -l '"name": "stderr"' $(NOTEBOOKS) || { echo "these notebooks show warnings"; exit 1; }

build/notebooks/%.ipynb: notebooks/%.ipynb $(shell find evalkit -name '*.py') | $(VENV)/installed-test
	@rm -f $@
	PYVISTA_JUPYTER_BACKEND=static $(BIN)/jupyter nbconvert --execute --CoalesceStreamsPreprocessor.enabled=True --to notebook \
	  --output-dir $(@D) --log-level WARN $<

clean:
	rm -rf $(VENV) $(OLDEST) dist $(DEMO) .pytest_cache .mypy_cache .ruff_cache .hypothesis
