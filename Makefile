# Treenail: `make sim` shows a peg learn its hole, `make test` checks and tests it; both set up what they need in .venv.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
ARGS ?=
# A worker for each core, but not for each of many.
PYTEST := $(BIN)/pytest --numprocesses auto --maxprocesses 8 --durations 15

.PHONY: help setup sim reproduce chaos test test-all check performance fuzz skill lock lock-check docs clean

help:  ## show this
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

setup: $(VENV)/ready  ## make .venv from the pinned requirements.lock

$(VENV)/ready: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "make: Python 3.11 or newer is needed, $(PYTHON) is older; use PYTHON=..." >&2; exit 2; }
	@$(PYTHON) -m venv $(VENV) || { echo "make: cannot make a virtual environment; on Debian: apt install python3-venv" >&2; exit 2; }
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@case "$$($(BIN)/python -c 'import platform; print(platform.machine())')" in x86_64) ;; *) \
	  echo "make: without the simulator, for which SAPIEN has wheels for x86_64 only; all else runs here, see README.md" ;; esac
	@rm -rf *.egg-info # an old one here would hide the installed list of plug-ins
	@touch $@

sim: setup  ## a whole cell on this machine: watch a peg learn its hole; ARGS="--episodes 60 --seed 1"
	@trap : INT; $(BIN)/treenail up sim $(ARGS) || [ $$? = 130 ]

reproduce: setup  ## the thesis's tables and figures anew, as report/index.html; QUICK=1 for a rough one
	@exec $(BIN)/treenail reproduce $(if $(QUICK),--quick) $(ARGS)

chaos: setup  ## kill a learning cell's processes 500 times, and more, and compare; ARGS="--kills 20" for a short one
	@exec $(BIN)/treenail chaos run --kills 500 $(ARGS)

check: setup  ## formatting, lint, types (of the tests too), import contracts
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: check  ## check, then all that is quick, and one real cell of each kind; ARGS="-k art2" goes to pytest
	$(PYTEST) --dist worksteal $(ARGS)

test-all: test  ## test, then all the rest: every test that starts processes (containers: see CONTRIBUTING.md)
	$(PYTEST) --dist loadfile -o testpaths=tests/system --ignore tests/system/smoke $(ARGS)

fuzz: setup  ## a million hostile inputs for all that reads, then 20000 for a living cell; ARGS="--inputs 50000"
	$(BIN)/python -m experiments.fuzz $(ARGS)
	TREENAIL_FUZZ_CELL=20000 $(BIN)/pytest -s --timeout 1200 tests/system/integration/test_fuzz_cell.py

performance: setup  ## measure all there is to measure, in under ten minutes, and add it to docs/performance.md
	$(BIN)/treenail bench all --page docs

# Seeds 200 to 204, first 20 insertions on twelve tasks: 10 of 1200 fail from nothing, none with it (docs/learning.md).
skill: setup  ## learn the skill that comes with Treenail again, to the same bytes (why this task: docs/learning.md)
	$(BIN)/treenail experiment run suite-square --set learner.follow_fade=0.0 --episodes 300 --seed-list 7 --out build/skill --force
	cp build/skill/seed7.skill services/rules/skills/builtin.skill

docs: setup  ## write docs/contract.md, definition.md and state_machines.md again from the code
	$(BIN)/python -m services.wire.contract > docs/contract.md
	$(BIN)/python -m services.wire.definition_page > docs/definition.md
	$(BIN)/python -m services.robot_link.machine > docs/state_machines.md

lock:  ## resolve requirements.lock again (needs pip-tools)
	pip-compile --quiet --all-extras --generate-hashes --allow-unsafe --strip-extras --no-emit-index-url --no-emit-find-links \
	    --no-emit-trusted-host --no-header --output-file requirements.lock pyproject.toml

lock-check: setup  ## whether all of requirements.lock can be had for Python 3.11, 3.12 and 3.13
	.ci/lock-check

clean:  ## remove what setup and tests made
	rm -rf $(VENV) build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
