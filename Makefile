# Needs Python 3.11 or newer, and make. Everything else is installed into .venv.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready

.PHONY: help set-up demo test docs bench acceptance lock clean

help: ## these lines
	@sed -n 's/^\([a-z-]*\):.*## /\1: /p' Makefile

set-up: $(READY) ## install into .venv exactly what requirements.lock says

demo: $(READY) ## the main job on a built-in recording, into the folder demo
	$(BIN)/trackprofile demo -o demo

test: $(READY) ## style, types, and all tests but those of acceptance
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/pytest -q -rs -n auto --dist loadscope

docs: $(READY) ## the manual, into docs/_build/html, and all its examples run (minutes)
	$(BIN)/sphinx-build -q -W --keep-going -n -E -d docs/_build/doctrees docs docs/_build/html
	$(BIN)/sphinx-build -q -W --keep-going -n -b doctest -d docs/_build/doctrees docs docs/_build/doctest
	$(BIN)/pytest -q -rs -m "" tests/test_manual.py

bench: $(READY) ## the figures of speed that the README quotes
	$(BIN)/trackprofile bench

acceptance: $(READY) ## the slow tests, and those on data that stand beside the project
	$(BIN)/pytest -q -rs -m acceptance

lock: $(READY) ## choose the versions anew (needs uv: https://docs.astral.sh/uv)
	uv pip compile --quiet --universal --generate-hashes --upgrade --no-annotate --python-version 3.11 --extra dev \
		--extra docs --extra mdf --extra network --extra plot --extra tdms --custom-compile-command "make lock" --output-file requirements.lock pyproject.toml

clean: ## remove what the targets above made
	rm -rf .venv demo dist docs/_build .pytest_cache .ruff_cache .hypothesis .benchmarks

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("trackprofile needs \
	Python 3.11 or newer, and $(PYTHON) is %d.%d; run: make $(MAKECMDGOALS) PYTHON=python3.11" \
	% sys.version_info[:2])'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes \
		-r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
		--no-build-isolation --editable .
	@touch $@
