# Every target that runs something sets the workspace up first; that takes minutes once, and a moment from then on.
.DEFAULT_GOAL := help
.PHONY: help setup demo rig-demo reproduce test test-slow test-graph floor quick measured stress soak validate leaving fuzz fuzz-files bench bench-regions bench-ident bench-explained bench-view bench-robust bench-verdicts docs lint clean
SHELL := /bin/bash
RUN := source scripts/env.sh &&

help:  ## print this
	@grep -E '^[a-z-]+: .*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 12

EXTRAS ?=
setup:  ## make .venv with ROS 2 Jazzy, build the packages (EXTRAS="ross foxglove" adds ROSS, the server for Foxglove)
	@EXTRAS="$(EXTRAS)" bash scripts/setup.sh

demo: setup  ## the paper's main experiment over ROS topics; leaves results/demo
	@$(RUN) amb demo

rig-demo: setup  ## the first session with a rig, on an emulated target; leaves results/rig-demo
	@$(RUN) amb rig demo

reproduce: setup  ## the paper's figures and claims on the simulator; leaves results/paper/index.html
	@$(RUN) amb reproduce

WORKERS ?= 4
test: setup  ## all tests but the slow ones; WORKERS=4 processes, since tests of graphs wait more than they compute
	@$(RUN) python -m pytest -m "not slow" --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder

test-slow: setup  ## the slow tests
	@$(RUN) python -m pytest -m slow

quick: setup  ## every program and command at its smallest size, and the keys of its results; leaves results/quick
	@$(RUN) python -m tests.front_door.run $(if $(AGAIN),--again)

measured: setup  ## the measured figures of the documentation, with date and commit: which are older than their code
	@$(RUN) python -m docs.generators.measured

COUNT ?= 10
test-graph: setup  ## the graph tests COUNT=10 times, with a summary of the failures; leaves results/stress
	@$(RUN) python -m tests.stress --idle $(COUNT) $(if $(ANEW),--anew) tests/graph

IDLE ?= 10
NICE ?= 3
stress: setup  ## what `make test` runs, IDLE=10 times alone, LOADED=5 under load, NICE=3 with low priority (hours); resumes on the same commit; writes results/stress.json
	@$(RUN) python -m tests.stress --idle $(IDLE) --loaded $(or $(LOADED),5) --nice $(NICE) $(if $(ANEW),--anew)

floor:  ## the unit tests with the oldest versions allowed, those of a stock Jazzy (half an hour); makes .floor
	@bash scripts/floor.sh

ENDS ?= 400
leaving: setup  ## ends of graphs at the worst moment, ENDS=400 idle and LOADED=100 under load (hours); resumes on the same commit; writes results/leaving.json
	@$(RUN) python -m tests.stress_leaving --ends $(ENDS) --loaded $(or $(LOADED),100) $(if $(ANEW),--anew)

validate: setup  ## the plant against independent solutions; writes results/validation.json
	@$(RUN) python -m tests.validation.run

soak: setup  ## a rig under stress: losses, kills, trips, hostile frames (an hour); writes results/soak.json
	@$(RUN) python -m tests.soak.run

MINUTES ?= 10
SEED ?= 1
fuzz: setup  ## hostile messages to the whole graph (MINUTES=60 SEED=2 for more); writes results/fuzz.json
	@$(RUN) python -m tests.fuzz.run --minutes $(MINUTES) --seed $(SEED)

MUTANTS ?= 20000
fuzz-files: setup  ## hostile files (MUTANTS=500 for less), a stranger's node, hostile names on pages; adds to results/security.json
	@$(RUN) python -m tests.fuzz.files --mutants $(MUTANTS) --seed $(SEED)

bench: setup  ## speed of plant and loop; writes results/bench.json
	@$(RUN) python -m tests.benchmarks.run

bench-regions: setup  ## regions, excitation design and identification on random cases; writes results/bench_regions.json
	@$(RUN) python -m tests.benchmarks.regions.run

bench-ident: setup .venv-peers/.complete  ## identification next to other packages, and its stated errors (hours); writes results/bench_ident.json and bench_uncertainty.json
	@$(RUN) python -m tests.benchmarks.uncertainty && python -m tests.benchmarks.ident.run

bench-explained: setup  ## figures of the pages that explain, on the paper's bearing and a few others; writes results/bench_explained.json
	@$(RUN) python -m tests.benchmarks.explained.run

bench-view: setup  ## a user's first hour: live page, pages, files, new bearings; writes results/first_hour.json
	@$(RUN) python -m tests.benchmarks.first_hour.run

RUNS ?= 200
bench-robust: setup  ## the robustness certificate on RUNS=200 loops and experiments (hours; RUNS=20: minutes); resumes after an interruption; writes results/bench_robust.json
	@$(RUN) python -m tests.benchmarks.robust.run --runs $(RUNS)
	@$(RUN) python -m tests.benchmarks.robust.emulator

bench-verdicts: setup  ## verdicts on true and wrong models of random bearings; writes results/bench_verdicts.json
	@$(RUN) python -m tests.benchmarks.verdicts.run

.venv-peers/.complete: tests/benchmarks/ident/peers.txt .venv/.root | setup
	@$(RUN) python -m venv .venv-peers && .venv-peers/bin/python -m pip install -q -r $< && touch $@

.venv/.root: | setup ;

.venv-docs/.complete: docs/requirements.hashes .venv/.root | setup  # an environment of its own that sees the packages of .venv
	@.venv/bin/python -m venv --clear .venv-docs && .venv-docs/bin/python -m pip install -q --disable-pip-version-check --no-deps --require-hashes -r $<
	@cd .venv-docs/lib/python3*/site-packages && ls -d ../../../../.venv/lib/python3*/site-packages > workbench.pth
	@touch $@

docs: setup .venv-docs/.complete  ## the documentation site, without network once set up; leaves results/docs/index.html
	@$(RUN) .venv-docs/bin/python -m sphinx -q -W --keep-going -n -d results/docs-doctrees docs results/docs && \
	  echo "results/docs/index.html"

lint: setup  ## ruff, mypy and the direction of imports
	@$(RUN) ruff check --no-cache . && ruff format --no-cache --check . && mypy && lint-imports

clean:  ## remove everything that the targets above made
	rm -rf .venv .venv-peers .venv-docs .floor build install log results docs/repository docs/reference/api .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
