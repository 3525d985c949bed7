# `make city` and `make test` do everything, set-up included; `make help` lists the rest.
.DEFAULT_GOAL := help
.PHONY: help setup city helsinki test check format fuzz kills bench proven study compare-demo docs docs-full lock clean

PY := .venv/bin/python
LOCK := --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
    --no-emit-find-links --upgrade --custom-compile-command "make lock" -q
# A process a core; one that is done takes tests over from another.
PARALLEL := -n auto --dist worksteal
SOURCES := harness triangulators scenes scripts tests

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1|/' | column -t -s '|'

setup:  ## make .venv and see that OpenGL works without a screen
	@scripts/setup.sh

city: setup  ## measure a city of 500 footprints; prints the table, writes results/
	$(PY) -m harness run --scene city

helsinki: setup  ## measure real footprints of Helsinki, (c) OpenStreetMap contributors
	$(PY) -m harness run --scene helsinki

test:  ## run the test suite
	@scripts/setup.sh test
	$(PY) -m pytest $(PARALLEL)

FUZZ_SECONDS ?= 600

fuzz: setup  ## search for inputs that break a promise, at random, for FUZZ_SECONDS
	FUZZ_SECONDS=$(FUZZ_SECONDS) $(PY) -m pytest tests/fuzz/search.py -n logical --dist load --maxschedchunk 1

check: setup  ## ruff and mypy
	$(PY) -m ruff check $(SOURCES)
	$(PY) -m ruff format --check $(SOURCES)
	$(PY) -m mypy

format: setup  ## let ruff format the code
	$(PY) -m ruff check --fix $(SOURCES)
	$(PY) -m ruff format $(SOURCES)

compare-demo: setup  ## what CI does: a baseline, an equal run, a regression; writes the reports
	@scripts/compare-demo.sh

KILLS ?= 100

kills: setup  ## kill workers, scheduler and command KILLS times over 1,000,000 footprints
	PYTHONPATH=. $(PY) scripts/kills.py --kills $(KILLS)

bench: setup  ## the benchmarks and long sweeps; needs a quiet machine
	$(PY) -m pytest tests/benchmarks --benchmark-enable -s

proven: setup  ## prove the optimum for H of every scene's polygons; prints a table
	PYTHONPATH=. $(PY) scripts/proven.py

study: setup  ## the studies behind docs/findings.md; more than an hour on a quiet machine
	scripts/study.sh

docs: setup  ## build the documents into site/, warnings as errors
	$(PY) -m mkdocs build --strict --quiet

docs-full: setup  ## run every command of README and docs, the slow ones too
	DOCS_FULL=1 $(PY) -m pytest tests/docs

lock:  ## pin all packages again, with hashes and without addresses; needs uv
	uv pip compile pyproject.toml --extra manifold --extra geoparquet --extra pyrender --extra webgpu --extra dask --extra studies --extra dev \
	    --override overrides.txt $(LOCK) -o requirements.lock
	uv pip compile requirements-data.in --no-deps $(LOCK) -o requirements-data.lock

clean:  ## remove what set-up and tests made
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .hypothesis
