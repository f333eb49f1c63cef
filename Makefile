# indent-sim: `make demo` and `make test` do everything on a fresh Debian 12 or 13.

SHELL := /bin/bash
VENV := .venv/bin

# One BLAS thread per rank. Tests start their own ranks: more than there are cores, as root in containers, on one
# machine (no TCP), beside other work (unbound, and yielding while they wait). OMPI_* is Open MPI 4 and 5, PRTE_* 5.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
export OMPI_MCA_rmaps_base_oversubscribe := 1
export PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe
export OMPI_MCA_hwloc_base_binding_policy := none
export PRTE_MCA_hwloc_default_binding_policy := none
export OMPI_MCA_mpi_yield_when_idle := 1
export OMPI_MCA_btl := ^tcp

.PHONY: help setup demo check test system lint proofs verify stress pages site foreign debian13 pypi clean
.DEFAULT_GOAL := help

help: ## this list
	@sed -nE 's/^([a-z0-9]+):.*## (.*)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 18

setup: ## install what is missing: Debian packages, .venv, .venv/bin/indent-sim; AFM=1: readers of AFM files
	@AFM=$(AFM) scripts/setup

demo: setup ## run configs/hertz.yaml and show its last row beside Hertz
	@$(VENV)/indent-sim run configs/hertz.yaml --overwrite

check: setup lint ## ruff, mypy, and the tests that run nothing: a minute
	$(VENV)/python -m pytest -q tests/unit tests/laws

test: setup lint ## ruff, mypy, and all tests but `system`
	$(VENV)/python -m pytest -q -n 2 --dist loadfile --durations=15 tests/unit tests/laws tests/physics tests/regression

system: setup ## commands, ranks, signals, kills, full disks, batch jobs, studies, pictures
	$(VENV)/python -m pytest -q -n 2 --durations=15 tests/system

lint: setup ## ruff (rules and format) and mypy only
	$(VENV)/ruff check .
	$(VENV)/ruff format --check .
	$(VENV)/mypy

proofs: setup ## all of `verify` and `stress`, on two processes; SLICE=3/12: the third of twelve slices of them
	$(VENV)/python -m pytest -q -n 2 --durations=15 -m "verify or stress" $(if $(SLICE),--slice $(SLICE))

verify: setup ## accuracy against closed forms and converged references, and the full form of long tests
	$(VENV)/python -m pytest -q -m verify --durations=15

stress: setup ## extremes of geometry, material and size; hostile files, kills, random scenes
	$(VENV)/python -m pytest -q -m stress --durations=15

pages: setup ## all pages of docs/ that are measured, each with the commit that it was measured at
	$(VENV)/python scripts/make_pages

site: setup ## the documentation as a site in build/site/html, with the gallery and the pages of releases; strict
	@SITE=1 scripts/setup
	$(VENV)/python scripts/make_site

foreign: ## fits of other programs' curves, fetched from the internet, into docs/foreign_curves.md
	@AFM=1 scripts/setup
	$(VENV)/python scripts/make_foreign_curves_page

debian13: ## `make test` inside a Debian 13 root (needs root and debootstrap)
	@scripts/debian13

pypi: setup ## `pip install '.[solver]'` inside a bare Debian 13 root, compared with .venv (needs root and debootstrap)
	@scripts/pypi

clean: ## remove .venv and the caches; results stay
	rm -rf .venv build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find indent_sim tests -name __pycache__ -type d -prune -exec rm -rf {} +
