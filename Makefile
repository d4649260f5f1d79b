# SPDX-FileCopyrightText: 2026 The fusionslam authors
# SPDX-License-Identifier: Apache-2.0
.PHONY: demo test test-ros fuzz bench bench-quick bench-ros reproduce reproduce-quick sanitize sanitize-quick lint tidy docs nightly wheel release format setup ros ros2 fleet clean

# Another Python: make test PYTHON=python3.13 VENV=.venv-3.13
export PYTHON ?= python3
export VENV ?= .venv
BIN := $(VENV)/bin
SOURCES := $(wildcard cpp/include/fusionslam/*.hpp cpp/include/fusionslam/*/*.hpp cpp/src/*/*.?pp cpp/src/*/*/*.?pp cpp/src/*/*.inc bindings/*.?pp tests/cpp/*.?pp examples/cpp/*.cpp fuzz/core/*.cpp benchmarks/peers/*.?pp)

# Installs what the demo needs, a tenth of what the tests do.
demo:
	@mkdir -p build
	@scripts/setup.sh demo
	$(BIN)/fusionslam demo -o out/demo

# Without ROS 1 and 2 the tests of the nodes are skipped; test-ros installs both.
test: setup
	scripts/test.sh $(PYTEST)

test-ros:
	scripts/ros.sh
	@$(MAKE) --no-print-directory setup
	scripts/ros2.sh
	$(BIN)/python -m pytest -n $$(nproc) --dist loadfile -m 'ros and not nightly' tests/python

bench: setup
	scripts/bench.sh --write

bench-ros: ros
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m benchmarks.ros --write

bench-quick: setup
	scripts/bench.sh --quick

reproduce: setup
	$(BIN)/python -m benchmarks.theses -o out/reproduce

reproduce-quick: setup
	$(BIN)/python -m benchmarks.theses -o out/reproduce-quick --quick

sanitize: setup
	scripts/sanitize.sh

sanitize-quick: setup
	scripts/sanitize.sh --quick

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	PYTHONPATH=python $(BIN)/lint-imports
	$(BIN)/clang-format --dry-run --Werror $(SOURCES)

docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo out/site/index.html

# What takes too long for every change. Tests run with Python 3.13, too, where it runs (a pyenv shim may not).
nightly: lint docs sanitize tidy ros ros2
	FUSIONSLAM_FLIPS=40 $(MAKE) --no-print-directory test PYTEST="-m ''"
	! python3.13 -c '' || $(MAKE) --no-print-directory test PYTHON=python3.13 VENV=.venv-3.13
	scripts/bench.sh
	test -z "$$FUSIONSLAM_TEST_DATA" || $(BIN)/python -m benchmarks.accuracy.checks

# For which Pythons: make wheel PYTHONS="python3.11 python3.13"; by default those on PATH.
export PYTHONS
wheel: setup
	scripts/wheel.sh

# Python and C++; hours with --inputs 100000. CI tries a little of each target with the tests.
fuzz: setup
	scripts/fuzz.sh --core $(FUZZ)

# Wheels and sdist, each installed away from the source and used.
release: setup
	scripts/release.sh

# About ten minutes of one core, so a part of nightly, not of lint.
tidy: setup
	cmake -S . -B build/tidy -G Ninja -DCMAKE_BUILD_TYPE=Release -DFUSIONSLAM_BINDINGS=ON -DCMAKE_EXPORT_COMPILE_COMMANDS=ON -DPython_EXECUTABLE=$$PWD/$(BIN)/python -Dpybind11_DIR=$$($(BIN)/python -m pybind11 --cmakedir) > build/tidy-configure.log 2>&1 || (cat build/tidy-configure.log; exit 1)
	$(BIN)/run-clang-tidy.py -p build/tidy -clang-tidy-binary $(BIN)/clang-tidy -quiet '/(cpp/src|bindings)/'

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(SOURCES)

setup:
	@mkdir -p build
	@scripts/setup.sh

ros:
	@scripts/ros.sh
	@$(MAKE) --no-print-directory setup

ros2: setup
	@scripts/ros2.sh

# A small fleet in made towns, by Ray on this machine; ends with the path of its page.
fleet: setup
	$(BIN)/fusionslam fleet demo -o out/fleet --engine ray

clean:
	rm -rf build .venv .venv-* out
