# SPDX-License-Identifier: Apache-2.0
# Each target installs what it needs by scripts/bootstrap.py, which prints its stages.
PYTHON ?= python3
ARGS ?=

help:
	@echo 'make demo    simulate a ball robot before a step; ARGS are passed to "ballbot demo"'
	@echo 'make demo-hardware  the same through an emulated motor controller and a serial line;'
	@echo '                    ARGS="--protocol vesc"'
	@echo 'make test    all tests; ARGS are passed to pytest'
	@echo 'make test-quick  the unit tests of less than about 0.5 s of CPU time, with few inputs'
	@echo 'make test-kilted  the unit tests with ROS 2 Kilted from wheels, in .venv-kilted'
	@echo 'make bench   measure speed and accuracy'
	@echo 'make docs    the documentation as a site, in build/site'
	@echo 'make time-demo  the time of each stage of the first demo of a fresh clone'
	@echo 'make extremes  20,000 extreme cases; some minutes'
	@echo 'make fuzz    coverage-guided fuzzing of the serial protocols; some minutes'
	@echo 'make mutants  mutation tests of one package, with cosmic-ray; ARGS=control'
	@echo 'make lint    style and types only'
	@echo 'make setup   prepare .venv for all targets except bench, fuzz, mutants and test-kilted'
	@echo 'make clean   remove .venv and everything built'

setup: setup-test

setup-%:
	@command -v $(PYTHON) >/dev/null || { \
	  echo '$(PYTHON) is missing: sudo apt-get install python3 python3-venv python3-dev' \
	       'build-essential' >&2; exit 1; }
	@$(PYTHON) scripts/bootstrap.py $*

demo: setup-run
	@.venv/bin/ballbot demo $(ARGS)

demo-hardware: setup-run
	@.venv/bin/ballbot demo --hardware $(ARGS)

test: setup
	@.venv/bin/python -m pytest -n 2 --dist loadfile test $(ARGS)

test-quick: setup
	@.venv/bin/python -m pytest -n 2 --dist loadfile -m "not slow" test/unit test/test_layers.py $(ARGS)

test-kilted:
	@BALLBOT_DISTRO=kilted $(PYTHON) scripts/bootstrap.py test
	@.venv-kilted/bin/python -m pytest -n 2 --dist loadfile test/unit $(ARGS)

time-demo:
	@$(PYTHON) scripts/time_demo.py

bench: setup-bench
	@.venv/bin/python bench/run.py $(ARGS)

docs: setup
	@.venv/bin/python scripts/make_docs.py $(ARGS)

extremes: setup
	@.venv/bin/python extremes/run.py $(ARGS)

fuzz: setup-fuzz
	@.venv/bin/python fuzz/run.py $(ARGS)

mutants: setup-mutants
	@.venv/bin/python scripts/mutants.py $(ARGS)

lint: setup
	@.venv/bin/python -m pytest -q test/test_lint.py test/test_layers.py $(ARGS)

clean:
	rm -rf .venv .venv-old .venv-kilted .venv-kilted-old build install log .mypy_cache .pytest_cache .ruff_cache .hypothesis

.PHONY: help setup demo demo-hardware test test-quick test-kilted time-demo bench docs extremes fuzz mutants lint clean
