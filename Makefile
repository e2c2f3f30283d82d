# Two commands do everything on a fresh machine: `make demo` and `make test`.
# A sourced ROS 2 Jazzy is used where there is one; otherwise its wheels are installed from PyPI.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# With ROS sourced the environment sees its packages, and the wheels stay out.
HAVE_ROS := $(shell $(PYTHON) -c "import rclpy" 2>/dev/null && echo yes)
comma := ,
EXTRAS := $(if $(HAVE_ROS),vision,ros$(comma)vision),report

.DEFAULT_GOAL := help
.PHONY: help demo suite test install install-dev lint types imports tests unit robustness coverage ros nightly generated docs package bench clean

help:
	@echo "make demo      install, then run specs/apriltag_node.r2b.yaml on real ROS 2"
	@echo "make test      install, then run every check and test"
	@echo "              its parts: lint, types, imports, tests (unit, robustness, ros)"
	@echo "make nightly   the same with every test at its full size"
	@echo "make coverage  show which lines the tests without ROS do not reach"
	@echo "make suite     run specs/suite and print its table (SMOKE=1: one short iteration of each)"
	@echo "make generated write schemas, reference tables and expected outputs anew"
	@echo "make docs      build the site of the documentation in build/site"
	@echo "make package   build and check wheel and sdist in dist"
	@echo "make bench     measure the harness, and rewrite the tables of docs/performance.md"
	@echo "make clean     remove the environment and everything that was generated"

# What a busy machine alone leaves open (exit status 3) is no failure of the demo; the run says so.
demo: install
	@report=$$(mktemp) || exit; \
	$(BIN)/r2bspec run specs/apriltag_node.r2b.yaml --report markdown=$$report; status=$$?; \
	if [ $$status -eq 3 ] && grep -q "not shown on this busy machine\|Host interference in" $$report; then \
	    echo "demo: everything ran; the verdict is open, and other programs used the machine" >&2; status=0; fi; \
	rm -f $$report; exit $$status

# Six specs, about ten minutes; SMOKE=1 plays one short iteration of each and judges nothing.
SMOKE ?=

suite: install
	$(BIN)/r2bspec run specs/suite $(if $(SMOKE),--smoke)

test: install-dev lint types imports tests

install: $(VENV)/.installed
install-dev: $(VENV)/.installed-dev

$(VENV)/bin/python:
	$(PYTHON) -m venv $(if $(HAVE_ROS),--system-site-packages) $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$(EXTRAS)]'
	@touch $@

$(VENV)/.installed-dev: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$(EXTRAS),dev]'
	@touch $@ $(VENV)/.installed

lint: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@! git grep -nE '^(<<<<<<<|>>>>>>>) '

types: install-dev
	$(BIN)/mypy

imports: install-dev
	$(BIN)/lint-imports

# Four files at a time on two processors, the longest first (tests/conftest.py): those on real ROS 2
# wait for a third of their time, and assert what is true on a busy machine, too. Faults fill disks
# and shared memory of their own.
PYTEST = $(BIN)/pytest -n $$(( $$(nproc) + 2 )) --dist loadfile --no-loadscope-reorder

tests: install-dev
	$(PYTEST)

UNIT := tests/unit tests/property tests/golden tests/editors
# Simulated runs of known truth, hostile and damaged files, and pages in a browser.
ROBUSTNESS := tests/simulation tests/fuzz tests/browser

unit: install-dev
	$(PYTEST) $(UNIT)

robustness: install-dev
	$(PYTEST) $(ROBUSTNESS)

# Apart from the tests, which it would make half as long again.
coverage: install-dev
	$(BIN)/pytest tests --ignore=tests/ros --ignore=tests/fault --ignore=tests/fleet --cov --cov-report=term:skip-covered

ros: install-dev
	$(PYTEST) tests/ros tests/fault tests/fleet

# Every test at its full size: whole simulations, every kind of pull request through every recipe.
# Hours; before a release, and where a pipeline asks for it.
nightly: export R2BSPEC_NIGHTLY := 1
nightly: test

# Read the difference before it is committed: a golden is what somebody wanted.
generated: install-dev
	PYTHONPATH=tests/support $(BIN)/python tests/support/generated_files.py
	R2BSPEC_REWRITE=1 $(BIN)/pytest -q tests/golden

# A link that leads nowhere is an error.
docs: $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[site]'
	$(BIN)/sphinx-build -q -n -W --keep-going -c site docs build/site

package: $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check build twine
	rm -rf dist
	$(BIN)/python -m build
	$(BIN)/twine check --strict dist/*

# BENCH=--quick prints a short one and writes nothing.
BENCH ?=

bench: install-dev
	$(BIN)/python benchmarks/harness_floor.py $(BENCH) $(if $(filter --quick,$(BENCH)),,--write docs/performance.md)

clean:
	rm -rf $(VENV) .coverage .mypy_cache .ruff_cache .pytest_cache .hypothesis runs
