# make demo   everything end to end: bags, learning, streaming, simulated arm, report
# make test   every test
# make bench  speed, accuracy and calm beside the peers, with pictures in out/bench
# make paper  every experiment of the paper, with pictures, in out/paper
# make faults everything that can go wrong on the nodes, tried, in out/faults
# make soak   half an hour of work, watched, in out/soak
# make fuzz   a coverage-guided fuzzer on every entrance (hours), in out/fuzz
# make docs   the documentation as a site, in out/site
# make setup  only the environment (make setup PYTHON=python3.12 for another interpreter)

PYTHON ?= python3
VENV ?= .venv
# With a sourced ROS the environment's Python needs what was sourced: python-ros carries it.
PY = $(shell test -x $(VENV)/bin/python-ros && echo $(VENV)/bin/python-ros || echo $(VENV)/bin/python)

.PHONY: setup demo test lint bench paper faults soak fuzz docs clean

# -S: what an environment runs when its Python starts is not for the one that is made.
setup:
	@$(PYTHON) -S .ci/bootstrap.py --venv $(VENV)

demo: setup
	@$(VENV)/bin/gdmp demo --out out/demo

test: setup lint
	@$(PY) -m pytest

lint: setup
	@$(PY) -m ruff check .
	@$(PY) -m mypy

bench: setup
	@$(VENV)/bin/gdmp bench all --out out/bench --jobs 2

paper: setup
	@$(VENV)/bin/gdmp paper all --out out/paper

faults: setup
	@$(VENV)/bin/gdmp faults --out out/faults

soak: setup
	@$(VENV)/bin/gdmp soak --minutes 30 --out out/soak

fuzz: setup
	@$(PY) -m pip install --quiet --disable-pip-version-check 'atheris>=3'
	@$(PY) -m test.fuzz.run --out out/fuzz

docs: setup
	@$(PY) -m sphinx -q -W docs out/site
	@echo out/site/index.html

clean:
	rm -rf $(VENV) out build install log
