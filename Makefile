# Everything runs in .venv; `make demo` and `make test` set it up first.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
RUNS ?= runs
# Linear algebra, element kernels and networks share these cores.
THREADS ?= $(shell nproc 2>/dev/null || echo 2)
DATA ?= ../shared/data/patient1
CONFIG ?= configs/patient1.toml
PROBE ?= $(wildcard $(DATA)/paper/probe_collision.stl)
# The mesher CGAL is licensed under the GPL; EXTRAS=dicom,distributed,dev,docs leaves it out, and fTetWild is used.
EXTRAS ?= cgal,dicom,distributed,dev,docs

# `make drill` repeats the property tests with so many seeds. What has passed on this commit is not run again: a drill
# that was stopped goes on where it was. Remove build/drill to begin anew.
SEEDS ?= 5
DRILL := build/drill/$(shell git rev-parse --short HEAD 2>/dev/null || echo tree)

.PHONY: demo test static check docs all static-docs lint drill patient1 install clean help

help: ## Show this list
	@grep -hE '^[a-z0-9]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

install: $(STAMP) ## Make .venv with everything pinned

$(STAMP): pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "Python 3.11 is needed: install it or pass PYTHON=/path/to/python"; exit 2; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[$(EXTRAS)]'
	touch $@

demo: $(STAMP) ## The whole pipeline on the built-in phantom, from label map to report
	$(BIN)/mixpinn demo --out $(RUNS)/demo

patient1: $(STAMP) ## The same pipeline on a real patient (DATA=folder with one NIfTI a structure, PROBE=its .stl)
	$(BIN)/mixpinn run $(CONFIG) --set anatomy.path=$(DATA) \
		$(if $(PROBE),--set simulation.probe=$(PROBE)) --out $(RUNS)/$(basename $(notdir $(CONFIG)))

# The matrices of a test are small: with a thread for each of two processes, none waits for the other's.
test drill: export OMP_NUM_THREADS = 1

test: $(STAMP) ## The test suite
	$(BIN)/python -m pytest -n 2 --dist loadfile

static: $(STAMP) ## Types and layers
	$(BIN)/mypy
	$(BIN)/lint-imports

lint: $(STAMP)
	$(BIN)/ruff check src tests benchmarks validation $(wildcard examples) docs/*.py

# Tests wait for processes, clocks and sockets now and then; types are checked, and the site is built, in that time.
check: lint ## Linter, types, layers, tests
	$(MAKE) -j 2 static test

all: lint ## The same, and the site
	$(MAKE) -j 2 static-docs test

static-docs: static
	$(MAKE) docs

docs: $(STAMP) ## The site, in build/docs/index.html; a warning is an error
	$(BIN)/python -m sphinx -W --keep-going --quiet -b html -d build/doctrees docs build/docs
	@echo build/docs/index.html

drill: $(STAMP) ## What takes too long for every change: examples at full size, fuzzing, flips, kills, soak, a patient's mesh
	@mkdir -p $(DRILL)
	for seed in $$(seq $(SEEDS)); do \
		test -e $(DRILL)/seed-$$seed || $(BIN)/python -m pytest -m hypothesis --hypothesis-seed=$$seed -n 2 || exit 1; \
		touch $(DRILL)/seed-$$seed; done
	for part in $$(ls tests/drill/test_*.py $(wildcard tests/test_examples.py); \
			grep -lr "only in 'make drill'" tests --include='test_*.py' | grep -v tests/drill/ | sort); do \
		test -e $(DRILL)/$$(basename $$part) || $(BIN)/python -m pytest --drill $$part -n 2 || exit 1; \
		touch $(DRILL)/$$(basename $$part); done

clean: ## Remove what the commands here have made
	rm -rf $(VENV) $(RUNS) build docs/gallery docs/generated src/*.egg-info
