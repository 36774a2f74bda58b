# Every target sets up what it needs from a bare checkout and skips what is already done.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.installed
CLEAN_ENV := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1

.PHONY: demo test test-all lint bench clean help

help:
	@echo "make demo      planners drive a wheelchair through floor plans; prints where the report is"
	@echo "make test      the laws of the project, under 10 minutes on two cores"
	@echo "make test-all  the long ones, too"
	@echo "make lint      ruff and mypy"
	@echo "make bench     how fast it is on this machine"

$(READY): pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

demo: $(READY)
	$(BIN)/wheelchair compare --suite demo

test: $(READY)
	$(CLEAN_ENV) $(BIN)/python -m pytest -n 2 --dist loadfile -m "not long"

test-all: $(READY)
	$(CLEAN_ENV) $(BIN)/python -m pytest -n 2 --dist loadfile

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(READY)
	$(BIN)/wheelchair bench env
	$(BIN)/wheelchair bench planners --only floor_plan,clutter,thesis_5 --seeds 5 --plot runs/bench/planners.png
	$(BIN)/python -m tests.benchmarks.parts
	$(BIN)/python -m tests.benchmarks
	$(BIN)/python -m tests.benchmarks.maps

clean:
	rm -rf $(VENV) runs build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
