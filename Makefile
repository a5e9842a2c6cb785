# Two commands set everything up: `make demo` runs the main job, `make test` passes the tests.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RIVALS := build/rivals

.PHONY: demo quick slow test test-all processors fuzz mutants lint format types stubs notebooks docs package bench rivals clean

demo: $(VENV)/installed
	mkdir -p build
	$(BIN)/python examples/02_motion_between_postures.py build/panda_motion.csv
	$(BIN)/jounce info examples/panda.urdf
	$(BIN)/jounce run examples/panda.urdf build/panda_motion.csv -o build/panda_forces.csv
	$(BIN)/jounce plot build/panda_forces.csv -o build/panda_forces.png
	$(BIN)/jounce demo -o build/demo

# Workers begin with a half each, so that tests of one file share what is traced and compiled, and then steal.
# Bytecode is kept even where the environment says not to: tests start many processes, each of which would compile all.
# `make quick` is for the loop of writing: the first case of each test that tests/slow_tests.txt does not list. `make test`
# leaves pages, examples of docstrings, notebooks, browsers, other languages, what tests/long_tests.txt lists, and most
# cases of long sweeps to `make test-all`, which CI runs (tests/conftest.py). `make slow` writes both lists on a machine
# that does nothing else.
quick slow test test-all: export PYTHONDONTWRITEBYTECODE =
quick test: $(VENV)/installed-dev
	$(BIN)/pytest -n auto --dist worksteal --tier $@

slow: $(VENV)/installed-dev
	$(BIN)/pytest -n auto --dist worksteal --tier test --list-slow

test-all: $(VENV)/installed-dev
	$(BIN)/pytest -n auto --dist worksteal

# Data of robots with the BLAS of another processor, which adds products in another order: tests that compare what BLAS
# computes with what a file states to the last bit fail here. Elsewhere than on x86 it is the BLAS of the machine.
processors: export OPENBLAS_CORETYPE = Prescott
processors: $(VENV)/installed-dev
	$(BIN)/pytest -n auto --dist worksteal tests/io tests/model tests/spatial

# Attacks all readers, commands, forces, verdicts on limits, retiming and workers of clusters for so long, from a random
# seed (SEED=... for that of an earlier run); inputs that were not taken well are kept in build/fuzz. Then properties
# are tested with five times the examples of `make test`.
SECONDS := 600
fuzz: $(VENV)/installed-dev
	$(BIN)/pytest -n auto tests/fuzz --fuzz-seconds $(SECONDS) $(if $(SEED),--fuzz-seed $(SEED))
	$(BIN)/pytest -n auto --dist worksteal --ignore tests/fuzz -m hypothesis --hypothesis-profile thorough

# Changes lines that decide, one at a time, and writes to benchmarks/MUTANTS.md which changes the tests notice. Which test
# calls what is kept in build/mutants; `python -m benchmarks.mutants --survivors` judges again only what survived.
mutants: $(VENV)/installed-dev
	$(BIN)/python -m benchmarks.mutants

lint: $(VENV)/installed-dev
	$(BIN)/ruff check

format: $(VENV)/installed-dev
	$(BIN)/ruff format --check

types: $(VENV)/installed-dev
	$(BIN)/mypy

# The methods of robots and the names that follow from the table of quantities; a test compares them with the table.
stubs: $(VENV)/installed-dev
	$(BIN)/python tests/support/stubs.py

# The outputs that notebooks keep; a test runs them again and compares what they print.
notebooks: $(VENV)/installed-dev
	$(BIN)/python docs/hooks/notebooks.py

# Figures are those of the machine: leave it alone meanwhile. JOUNCE_PEERS names a folder of further C to compare with.
bench: $(VENV)/installed-bench
	$(BIN)/python -m benchmarks

# Other libraries beside jounce, in an environment of their own: two of them want an older jax. About twenty minutes.
rivals: $(RIVALS)/installed
	$(RIVALS)/bin/python -m benchmarks.rivals

# not --quiet, which hides warnings from --strict too
docs: $(VENV)/installed-docs
	$(BIN)/mkdocs build --strict

# What users install: wheel and sdist are built and checked, and the README's Python runs in an environment of its own,
# first without any extra.
PACKAGE := build/package
package: $(VENV)/installed-package
	rm -rf dist $(PACKAGE)
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*
	$(BIN)/check-wheel-contents dist
	$(BIN)/python -m venv $(PACKAGE)/env
	$(PACKAGE)/env/bin/python -m pip install --quiet dist/jounce-*.whl
	cp -r README.md examples $(PACKAGE)
	cd $(PACKAGE) && env/bin/jounce run iiwa14 examples/iiwa14.csv --degree 7 -o forces.csv
	$(PACKAGE)/env/bin/python -m pip install --quiet "$$(echo dist/jounce-*.whl)[sympy]"
	cd $(PACKAGE) && env/bin/python -m doctest README.md

clean:
	rm -rf $(VENV) build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "jounce needs Python 3.11 or later: make PYTHON=python3.11 ...")'
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[figures]'
	touch $@

$(VENV)/installed-dev: pyproject.toml tests/models.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	$(BIN)/python -m pip install --quiet --no-deps -r tests/models.txt
	touch $@ $(VENV)/installed

$(VENV)/installed-package: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[package]'
	touch $@

$(VENV)/installed-bench: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[bench]'
	touch $@ $(VENV)/installed

$(RIVALS)/installed: pyproject.toml
	$(PYTHON) -m venv $(RIVALS)
	$(RIVALS)/bin/python -m pip install --quiet --editable '.[rivals]'
	touch $@

$(VENV)/installed-docs: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@
