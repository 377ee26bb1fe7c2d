# Every target sets up what it needs; nothing but Python 3.11+ and make is needed first.
PYTHON ?= python3
BIN := .venv/bin
STAMP := .venv/.ready
DEMO ?= demo
PYTEST := $(BIN)/python -m pytest -q -n auto --dist loadfile --no-loadscope-reorder
KERNELS := tests/vision tests/geometry tests/mechanics tests/limits tests/simulation tests/estimators/test_svr.py tests/estimators/test_rod.py \
	tests/estimators/test_rod_track.py
# Jobs that run side by side print one after the other where this make can do that.
ONE_AT_A_TIME := $(if $(filter output-sync,$(.FEATURES)),--output-sync=target)
export NO_MKDOCS_2_WARNING := 1
# Python keeps what it compiles: otherwise each process compiles all libraries again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help setup demo test walkthrough check types contracts pages docs bench prove clean

help:            ## what there is
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

setup: $(STAMP)  ## make .venv with pinned versions

$(STAMP): pyproject.toml constraints.txt scripts/setup.sh
	@PYTHON="$(PYTHON)" sh scripts/setup.sh

demo: $(STAMP)   ## a simulated bench, from recording to report, in minutes
	$(BIN)/tipforce demo -o $(DEMO)

test: $(STAMP)   ## the tests
	$(PYTEST) -m "not slow and not walkthrough" $(TEST_OPTIONS)

walkthrough: $(STAMP)  ## the pages of the documentation that tests run command by command
	$(PYTEST) -m walkthrough

check: $(STAMP)  ## lint, format, types, import contracts, docs
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@$(MAKE) --no-print-directory -j 2 $(ONE_AT_A_TIME) types contracts pages

types: $(STAMP)
	$(BIN)/pyright

contracts: $(STAMP)
	$(BIN)/python -m pytest -q tests/project

pages: $(STAMP)
	$(BIN)/python -m mkdocs --quiet build --strict

docs: $(STAMP)   ## this documentation as a site, in build/site
	$(BIN)/python -m mkdocs build --strict

bench: $(STAMP)  ## speed and accuracy, in one run
	$(BIN)/python -m bench

prove: $(STAMP)  ## the slow tests, the property tests on new examples, kernels with bounds checked, spoiled inputs
	$(PYTEST) -m "slow or walkthrough"
	$(PYTEST) -m "not slow and not walkthrough" --hypothesis-profile=explore
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=$(CURDIR)/build/numba-bounds $(PYTEST) \
		-m "not slow and not walkthrough" $(KERNELS)
	$(BIN)/python -m tests.fuzz --cases 2000

clean:           ## remove .venv and what the demo wrote
	rm -rf .venv $(DEMO) build dist
