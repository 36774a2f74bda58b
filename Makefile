# Every target sets up what it needs from a bare checkout and skips what is already done.

PYTHON ?= python3
PYTHON_313 ?= python3.13
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.installed
CLEAN_ENV := PYTHONUTF8=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
# tests/conftest.py says which file goes first.
PYTEST := $(CLEAN_ENV) $(BIN)/python -m pytest
TEST := $(PYTEST) -n 2 --dist loadfile --no-loadscope-reorder
# The programs that tests start find the byte code of the modules that others have read.
unexport PYTHONDONTWRITEBYTECODE

# What builds the firmware and emulates its boards: Debian packages, for tests and the twin only.
EMULATOR := gcc-avr avr-libc avrdude libsimavr-dev gcc libc6-dev make
SUDO := $(shell test "$$(id -u)" = 0 || echo sudo)

RCLPY := build/rclpy

# What tests look at pages with.
BROWSER := chromium

.PHONY: browser rclpy demo test test-realtime test-313 test-all examples package lint bench docs results films clean help emulator firmware

help:
	@echo "make demo      planned and learned policies drive a wheelchair; prints where the report is"
	@echo "make test      the laws of the project, under 10 minutes on two cores"
	@echo "make test-realtime  the tests that need real time, one after the other"
	@echo "make test-313  make test with Python 3.13, in .venv-3.13"
	@echo "make test-all  all of these, and the long ones"
	@echo "make examples  runs the programs in examples/"
	@echo "make package   wheel and sdist, and a plan with the wheel alone"
	@echo "make rclpy     ROS 2 from PyPI (Linux, Python 3.11) in build/rclpy, for one test of test-all"
	@echo "make lint      ruff, mypy and the budget of lines"
	@echo "make bench     how fast it is on this machine"
	@echo "make docs      builds the documentation into build/docs; a warning is an error"
	@echo "make results   measures the figures of the documentation anew (hours; NAMES=\"league speed\": these)"
	@echo "make films     draws the films and pictures of the documentation"
	@echo "make emulator  compilers and emulator of the chair's boards (Debian; root or sudo)"
	@echo "make browser   Chromium, with which tests look at pages (Debian; root or sudo)"
	@echo "make firmware  builds the boards' firmware and prints its sizes"

$(READY): pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

demo: $(READY)
	$(BIN)/wheelchair compare --suite demo

test: $(READY)
	$(TEST) -m "not long and not realtime"

# Alone: what runs beside these tests would take their time.
test-realtime: $(READY)
	$(PYTEST) -m "realtime and not long"

test-313:
	@if $(PYTHON_313) -c '' 2>/dev/null; \
	then $(MAKE) PYTHON=$(PYTHON_313) VENV=.venv-3.13 test; \
	else echo "make test-313: skipped, $(PYTHON_313) is absent (set PYTHON_313 to its path)"; fi

test-all: $(READY)
	$(TEST) -m "not realtime"
	$(PYTEST) -m realtime
	$(MAKE) test-313

# The wheel alone, from a folder in which there is nothing else.
package: $(READY)
	rm -rf dist build/wheel
	$(BIN)/python -m build --quiet --outdir dist .
	$(BIN)/python -m pip install --quiet --no-deps --target build/wheel dist/*.whl
	cd build && PYTHONPATH=wheel ../$(BIN)/python -P -m wheelchair_gym plan \
	  --map wheelchair_gym/maps/data/clinic.yaml --planner visibility --start 2,2 --goal 13,8
	cd build && PYTHONPATH=wheel ../$(BIN)/python -P -c \
	  "from wheelchair_gym.envs.settings import env_settings as e; e('configs/env.json', model='rear')"

examples: $(READY)
	$(TEST) tests/test_examples.py

lint: $(READY)
	$(BIN)/python .ci/budget.py
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(READY)
	$(BIN)/wheelchair bench env
	$(BIN)/wheelchair bench planners --only floor_plan,clutter,thesis_5 --seeds 5 --plot runs/bench/planners.png

docs: $(READY)
	$(CLEAN_ENV) $(BIN)/python -m sphinx -b html -j 2 -W --keep-going -q docs build/docs
	@echo "build/docs/index.html"

# NAMES="league speed": these result files only; WHAT=try: one episode of each, nothing is taken;
# MAPS: a folder with barn_60.json, BARN's own worlds. The speed needs the extra peers, too.
results: $(READY)
	cd $(or $(MAPS),.) && $(abspath $(BIN))/python $(CURDIR)/docs/tables.py $(or $(WHAT),run) $(NAMES)

films: $(READY)
	$(BIN)/python docs/films.py

emulator:
	@command -v apt-get >/dev/null || { echo "make emulator knows Debian and its kin only;" \
	  "install the like of: $(EMULATOR)" >&2; exit 2; }
	@dpkg -s $(EMULATOR) >/dev/null 2>&1 || { $(SUDO) apt-get update -qq \
	  && $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(EMULATOR); }

browser:
	@command -v $(BROWSER) >/dev/null || { command -v apt-get >/dev/null || \
	  { echo "make browser knows Debian and its kin only; install Chromium" >&2; exit 2; }; \
	  $(SUDO) apt-get update -qq \
	  && $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(BROWSER); }

# Beside the project: third-party wheels of ROS 2 Kilted (ros-python-wheels).
rclpy: $(RCLPY)/.installed

$(RCLPY)/.installed:
	python3.11 -m venv $(RCLPY)
	$(RCLPY)/bin/python -m pip install --quiet 'ros-rclpy[fastrtps]' ros-geometry-msgs \
	  ros-nav-msgs ros-rosgraph-msgs ros-sensor-msgs
	touch $@

firmware: emulator
	$(MAKE) -C wheelchair_gym/hardware/firmware

clean:
	rm -rf $(VENV) .venv-3.13 wheelchair_gym/hardware/firmware/build runs build dist docs/generated .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
