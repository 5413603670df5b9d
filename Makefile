# Everything runs in .venv, made on first use with nothing but Python 3.11 or newer: `make help` lists the targets.
# `make dev` and the targets of development install the source tree itself, so that an edit counts at once; before that,
# the others install a copy, again whenever a source has changed.

PYTHON ?= python3
JOBS ?= 2
OUT ?=
ARGS ?=

VENV := .venv
BIN := $(VENV)/bin
# Modules are compiled when they are imported: most of what pip brings never is.
INSTALL := $(BIN)/python -m pip --quiet --disable-pip-version-check install --no-compile
DEV := $(wildcard $(VENV)/.installed-dev)
EDITABLE := $(if $(DEV),--editable)
COPIED := $(if $(DEV),,README.md LICENSE $(shell find agvjax tuning -name '*.pyc' -o -name __pycache__ -prune -o -print))
SOURCES := pyproject.toml $(COPIED)

.DEFAULT_GOAL := help
.PHONY: help tune sweep reproduce compare vehicles bench compilers dev test fuzz slow check lint types docs notebooks format clean

help: ## this list
	@grep -E '^[a-z]+:.*##' Makefile | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 12
	@echo "Variables: PYTHON=$(PYTHON) OUT=$(OUT) JOBS=$(JOBS) ARGS=\"$(ARGS)\""

tune: $(VENV)/.installed ## tune the gains of the paper's controller; results in runs/tune-TIME, or in OUT; more options in ARGS
	$(BIN)/agvjax tune $(if $(OUT),--out $(OUT)) $(ARGS)

sweep: $(VENV)/.installed ## where do the gains fail? results in runs/sweep-TIME, or in OUT; more options in ARGS
	$(BIN)/agvjax sweep $(if $(OUT),--out $(OUT)) $(ARGS)

reproduce: $(VENV)/.installed ## rebuild the paper's tables and figures; results in runs/reproduce-TIME, or in OUT
	$(BIN)/agvjax reproduce $(if $(OUT),--out $(OUT)) $(ARGS)

compare: $(VENV)/.installed ## tune every law to one command budget; results in runs/compare-TIME, or in OUT
	$(BIN)/agvjax compare $(if $(OUT),--out $(OUT)) $(ARGS)

vehicles: $(VENV)/.installed-vehicles ## unicycle, car and robot with limits, delay and sampling; results in runs/vehicles-TIME, or in OUT
	$(BIN)/agvjax vehicles $(if $(OUT),--out $(OUT)) $(ARGS)

bench: $(VENV)/.installed-bench ## measure speed, memory, accuracy beside every peer (half an hour); one part: ARGS=rollout
	$(BIN)/python -m benchmarks $(ARGS)

compilers: $(VENV)/.installed-dev ## the same results on the oldest and the newest jaxlib and Python? environments in build/compilers
	$(BIN)/python -m benchmarks.compilers

dev: $(VENV)/.installed-dev ## .venv with the package and the tools for development

test: $(VENV)/.installed-dev ## quick tests, JOBS at a time; more options in ARGS
	$(BIN)/pytest -n $(JOBS) $(ARGS)

fuzz: $(VENV)/.installed-dev ## calls of the command line that no user should have to make; more options in ARGS (--seed, --count)
	$(BIN)/python tests/fuzz $(ARGS)

slow: $(VENV)/.installed-dev ## the tests left out of `make test`
	$(BIN)/pytest -n $(JOBS) -m slow $(ARGS)

check: ## lint, format, types, documentation, notebooks, two at a time
	$(MAKE) -j2 lint types docs notebooks

lint: $(VENV)/.installed-dev ## ruff, and no outputs in the notebooks; `make format` mends most of it
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/nbstripout --keep-id --verify notebooks/*.ipynb

types: $(VENV)/.installed-dev ## pyright
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(VENV)/.installed-dev ## the documentation as a site, build/site/index.html; warnings are errors
	$(BIN)/python -m mkdocs --quiet build --strict

# Once in a while the client misses that a cell is done, and looks again only when the time of a cell is over: 150 s here,
# by default 300 (pyzmq 27.3, jupyter_client 8.10, 2026-11-30).
notebooks: $(VENV)/.installed-dev ## run every notebook from start to end
	$(BIN)/pytest --nbmake --nbmake-timeout=150 -n $(JOBS) notebooks/

format: $(VENV)/.installed-dev ## mend what ruff and nbstripout can mend by themselves
	$(BIN)/ruff check --fix --exit-zero --quiet
	$(BIN)/ruff format
	$(BIN)/nbstripout --keep-id notebooks/*.ipynb

clean: ## remove .venv and caches; runs/ stays
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .hypothesis
	find agvjax tuning tests -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.made:
	@command -v $(PYTHON) >/dev/null || { echo "'$(PYTHON)' not found; name a Python 3.11 or newer: make PYTHON=/path/to/python3 $(MAKECMDGOALS)" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "agvjax needs Python 3.11 or newer, '$(PYTHON)' is $$($(PYTHON) --version 2>&1); name another: make PYTHON=/path/to/python3 $(MAKECMDGOALS)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.installed: $(VENV)/.made $(SOURCES)
	$(INSTALL) $(EDITABLE) .
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.made pyproject.toml
	$(INSTALL) --editable '.[dev]'
	@touch $(VENV)/.installed $@

$(VENV)/.installed-vehicles: $(VENV)/.made $(SOURCES)
	$(INSTALL) $(EDITABLE) '.[vehicles]'
	@touch $(VENV)/.installed $@

$(VENV)/.installed-bench: $(VENV)/.made $(SOURCES)
	$(INSTALL) $(EDITABLE) '.[benchmarks]'
	@touch $(VENV)/.installed $@
