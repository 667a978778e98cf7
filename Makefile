# make demo   everything end to end: bags, learning, streaming, simulated arm, report
# make test   every test
# make bench  speed, accuracy and calm beside the peers, with pictures in out/bench
# make paper  every experiment of the paper, with pictures, in out/paper
# make setup  only the environment (make setup PYTHON=python3.12 for another interpreter)

PYTHON ?= python3
VENV ?= .venv
# With a sourced ROS the environment's Python needs what was sourced: python-ros carries it.
PY = $(shell test -x $(VENV)/bin/python-ros && echo $(VENV)/bin/python-ros || echo $(VENV)/bin/python)

.PHONY: setup demo test lint bench paper clean

setup:
	@$(PYTHON) .ci/bootstrap.py --venv $(VENV)

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

clean:
	rm -rf $(VENV) out build install log
