# SPDX-License-Identifier: LGPL-3.0-or-later
# Everything runs in .venv; "make setup" is idempotent and part of every other goal.
BIN := .venv/bin
RANKS ?= 2
PYTEST ?=
WORKERS ?= 2
export PATH := $(CURDIR)/$(BIN):$(PATH)
# one thread per rank: BLAS threads would fight over the cores of the other ranks
export OMP_NUM_THREADS ?= 1

KERNEL := $(wildcard contact/kernel/*.[ch] forms/native/*.[ch] CMakeLists.txt)

.PHONY: help setup demo docs test test-all lint format clean
.DEFAULT_GOAL := help

help:
	@echo "make demo   run the main job (scene flange-transition, coarse) into demo/, with figures and report"
	@echo "make test   linters, type check and the test suite (PYTEST='-m \"not slow\"' for less)"
	@echo "make test-all  the same with the long tests: rows once more at finer sizes"
	@echo "make lint   linters and type check only;  make format  lay out Python and C"
	@echo "make docs   the documentation into build/docs, without network; a warning is an error"
	@echo "make setup  make .venv ready (PYTHON=... picks the interpreter)"
	@echo "make clean  remove what was built, caches and demo/;  .venv stays"

setup: .venv/.ready

.venv/.ready: .ci/setup pyproject.toml $(KERNEL)
	@sh .ci/setup

demo: setup
	rm -rf demo
	$(BIN)/squealx run flange-transition --out demo --ranks $(RANKS)
	$(BIN)/squealx report demo

docs: setup
	$(BIN)/sphinx-build -q -W --keep-going docs build/docs
	@echo "build/docs/index.html"

# one worker per file, the longest files first
SUITE := $(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test: lint
	$(SUITE) -m "not long" $(PYTEST)

test-all: lint
	$(SUITE) $(PYTEST)

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(if $(KERNEL),$(BIN)/clang-format --dry-run --Werror $(filter %.c %.h,$(KERNEL)))
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo

format: setup
	$(BIN)/ruff check --fix --exit-zero
	$(BIN)/ruff format
	$(BIN)/clang-format -i $(filter %.c %.h,$(KERNEL))

clean:
	rm -rf build demo docs/made .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -path ./.venv -prune -o -name __pycache__ -type d -exec rm -rf {} +
