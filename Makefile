# make help lists the targets.

PYTHON ?= python3
VENV ?= .venv
# With a sourced ROS installation, python-ros sets its environment.
PY = $(shell test -x $(VENV)/bin/python-ros && echo $(VENV)/bin/python-ros || echo $(VENV)/bin/python)

# Tests start many processes: without compiled files each of them would compile the package.
export PYTHONDONTWRITEBYTECODE =

.PHONY: help setup demo test test-long lint bench paper faults soak fuzz interop docs pages clean

help:
	@echo 'make setup      set up the environment (make setup PYTHON=python3.12 for another interpreter)'
	@echo 'make demo       everything end to end: bags, learning, streaming, simulated arm, report'
	@echo 'make test       style, types and all tests but the long ones'
	@echo 'make test-long  fault table, soak, fuzzing, the commands of every page'
	@echo 'make bench      speed, accuracy and smoothness beside the peers, with pictures in out/bench'
	@echo 'make paper      every experiment of the paper, with pictures in out/paper'
	@echo 'make faults     faults on the nodes, one after another, in out/faults'
	@echo 'make soak       half an hour of operation, watched, in out/soak'
	@echo 'make fuzz       a coverage-guided fuzzer on every entrance (hours), in out/fuzz'
	@echo 'make interop    files of other programs, written and read by their real libraries (gigabytes)'
	@echo 'make docs       the documentation as a site, in out/site'
	@echo 'make pages      every command of every page, and the Docker image where an engine is there (hours)'
	@echo 'make clean      remove the environment and all results'

# -S: the start-up hooks of an active environment are not for the new one.
setup:
	@$(PYTHON) -S .ci/bootstrap.py --venv $(VENV)

demo: setup
	@$(VENV)/bin/gdmp demo --out out/demo

test: setup lint
	@$(PY) -m pytest -m 'not long' -n 2 --dist loadfile

test-long: setup
	@$(PY) -m pytest -m long -n 2 --dist loadfile

lint: setup
	@$(PY) -m ruff check .
	@$(PY) -m mypy
	@$(VENV)/bin/lint-imports --no-logo

bench: setup
	@$(PY) -m experiments bench all --out out/bench --jobs 2

paper: setup
	@$(PY) -m experiments paper all --out out/paper

faults: setup
	@$(PY) -m experiments faults --out out/faults
	@$(PY) -m experiments limits --jobs 2 --json out/faults/limits.json

soak: setup
	@$(PY) -m experiments soak --minutes 30 --out out/soak

fuzz: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check 'atheris>=3'
	@$(PY) -m test.fuzz.run --out out/fuzz

interop: setup
	@$(PY) -m test.interop.run --out out/interop

docs: setup
	@$(PY) docs/figures.py
	@$(PY) -m sphinx -q -W docs out/site
	@echo out/site/index.html

pages: setup
	@GDMP_TEST_PAGES=1 $(PY) -m pytest test/docs/test_pages.py -m 'long or not long' -v

clean:
	rm -rf $(VENV) .venv-franka-sim out build install log
