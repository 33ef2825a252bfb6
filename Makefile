# Needs Python 3.11 or newer, and make. Everything else is installed into .venv.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready

NPM := $(shell command -v npm 2> /dev/null)
ESLINT := node_modules/.package-lock.json

.PHONY: help set-up demo test lint lint-js test-js types unit-test docs docs-build docs-examples bench acceptance lock clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1: /p' Makefile

set-up: $(READY) ## install the package, its extras and the tools into .venv, in the versions of requirements.lock

demo: $(READY) ## run the main job on a simulated recording; results in the folder demo
	$(BIN)/trackprofile demo -o demo

test: lint types test-js unit-test ## check style and types, run all tests except the acceptance tests

lint: $(READY) ## check style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

ifdef NPM
lint-js: $(ESLINT) ## check the style of the scripts of web viewer and report (needs Node.js)
	npm run --silent lint

test-js: ## test the functions of these scripts (needs Node.js)
	npm test --silent
else
lint-js test-js:
	@echo "SKIPPED: make $@ needs Node.js 20 or newer, which is not installed"
endif

types: $(READY) ## check types
	$(BIN)/pyright

unit-test: $(READY) ## run all tests except the acceptance tests
	$(BIN)/pytest -q -rs -n auto --dist loadscope

docs: docs-build docs-examples ## build the manual into docs/_build/html and run its examples

docs-build: $(READY) ## build the manual into docs/_build/html
	$(BIN)/sphinx-build -q -W --keep-going -n -E -d docs/_build/doctrees docs docs/_build/html

docs-examples: $(READY) ## run the commands that the manual shows and compare their output
	$(BIN)/pytest -q -rs -n auto -m "" tests/test_manual.py

bench: $(READY) ## measure the speed and memory figures that the README states
	$(BIN)/trackprofile bench

acceptance: $(READY) ## run the slow tests and the tests on data that are not part of the repository
	$(BIN)/pytest -q -rs -m acceptance

lock: $(READY) ## update requirements.lock to the newest versions (needs uv: https://docs.astral.sh/uv)
	uv pip compile --quiet --universal --generate-hashes --upgrade --no-annotate --python-version 3.11 --extra dev \
		--extra docs --extra mdf --extra network --extra plot --extra tdms --custom-compile-command "make lock" --output-file requirements.lock pyproject.toml

$(ESLINT): package.json package-lock.json
	npm ci --silent --no-audit --no-fund
	@touch $@

clean: ## remove the files that these targets create
	rm -rf .venv demo dist node_modules docs/_build .pytest_cache .ruff_cache .hypothesis .benchmarks

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
