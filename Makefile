# Set-up is part of every target: a machine with Python 3.10 to 3.13, make and git is enough.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

BLENDER := $(VENV)/blender/bin/python

.PHONY: demo test slow blender lint clean

demo: $(VENV)/.runtime
	$(BIN)/dynhair demo

test: $(VENV)/.dev
	$(BIN)/python -m pytest

slow: $(VENV)/.dev
	$(if $(wildcard $(BLENDER)),DYNHAIR_BLENDER=$(abspath $(BLENDER))) $(BIN)/python -m pytest -m slow

# What reads exported scenes in the slow tests: Blender's module, which wants another NumPy than ours and Python 3.11.
blender: $(VENV)/.blender

$(VENV)/.blender: | $(BIN)/python
	$(PYTHON) -m venv $(VENV)/blender
	$(BLENDER) -m pip install --quiet bpy==5.0.1
	@touch $@

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 10) <= v <= (3, 13) else "dynhair needs Python 3.10 to 3.13, this is %d.%d: make PYTHON=python3.11 ..." % v)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.runtime: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@ $(VENV)/.runtime

clean:
	rm -rf $(VENV) demo
