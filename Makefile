# leonav. `make` alone lists what there is to make. Every target sets itself up.
#
# Variables: PYTHON  interpreter for the virtual environment (default: the first of CANDIDATES that will do)
#            RUN     folder that `make console` looks at (default: runs/nominal)
#            LEONAV_CACHE_DIR  where compiled kernels are kept (default: the user's cache directory)
#            LEONAV_DATA       folder of real orbits for the tests that use them (default: ../shared/data)

.DEFAULT_GOAL := help
SHELL := /bin/bash

VENV := .venv
PY := $(VENV)/bin/python
STAMP := $(VENV)/.leonav-setup
CANDIDATES := python3.11 python3.12 python3.13 python3
RUN ?= runs/nominal
OUT := build/test
OUTSIDE := tests/real_data tests/packaging

export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: help
help:  ## list the targets
	@echo "leonav: navigation flight software that bounds its own error"
	@echo
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | \
	  while IFS='|' read -r target text; do printf '%-22s %s\n' "$$target" "$$text"; done
	@echo
	@echo "Scenarios: $(PY) -m hil_sim list     One run: $(PY) -m hil_sim run SCENARIO"

# The stamp stands for an environment that agrees with pyproject.toml and constraints.txt. While it does, nothing is
# asked of any package index. Without a network, pip's own variables (PIP_NO_INDEX, PIP_FIND_LINKS) are honoured.
# Modules are compiled when they are first imported: most never are, and to compile them all is most of an installation.
$(STAMP): pyproject.toml constraints.txt
	@python=; \
	for candidate in $(or $(PYTHON),$(CANDIDATES)); do \
	  if "$$candidate" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	    python=$$candidate; break; \
	  fi; \
	done; \
	if [ -x $(PY) ] && $(PY) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	  echo "setup: using $(VENV)"; \
	elif [ -n "$$python" ]; then \
	  echo "setup: creating $(VENV) with $$($$python --version)"; \
	  "$$python" -m venv --clear $(VENV); \
	else \
	  echo "setup: no Python 3.11 or later with venv among: $(or $(PYTHON),$(CANDIDATES))." >&2; \
	  echo "setup: install one, or name it: make setup PYTHON=/path/to/python3" >&2; \
	  exit 1; \
	fi
	@echo "setup: installing pinned dependencies (the satellite data alone are some 100 MB)"
	@$(PY) -m pip install --quiet --no-compile -c constraints.txt -e '.[sim,ground,dev]'
	@touch $@

.PHONY: setup
setup: $(STAMP)  ## virtual environment with everything; nothing to do while it is up to date

.PHONY: sil
sil: setup  ## fly the nominal scenario: two orbits, a GNSS outage, a verdict and figures in runs/nominal
	@$(PY) -m hil_sim run nominal --out runs/nominal

.PHONY: test
# Lanes run beside one another: what one waits for, another computes. The longest, which also has what runs in real time,
# goes first where processors are short; its output comes last, so that its summary is the last line. What is outside
# flies with the kernels that it has compiled by then. Every lane runs even if another has failed.
# The log of the plain lane is not named coverage.*: those files coverage deletes.
test: setup  ## all tests: kernels with bounds checks, as plain Python with coverage, outside; beside them the rest
	@mkdir -p $(OUT); \
	$(MAKE) --no-print-directory test-default >$(OUT)/default.log 2>&1 & default=$$!; \
	nice -n 5 $(MAKE) --no-print-directory test-coverage >$(OUT)/plain.log 2>&1 & coverage=$$!; \
	trap 'kill $$default $$coverage 2>/dev/null' INT TERM; \
	status=0; \
	for lane in test-bounds test-outside; do \
	  nice -n 5 $(MAKE) --no-print-directory $$lane || { echo "$$lane: FAILED"; status=1; }; \
	done; \
	wait $$coverage || { echo "test-coverage: FAILED"; status=1; }; \
	cat $(OUT)/plain.log; \
	echo "== everything, as it flies"; \
	tail -n +1 -f --pid=$$default $(OUT)/default.log & \
	wait $$default || { wait; echo "test-default: FAILED"; status=1; }; \
	wait; exit $$status

.PHONY: test-default
test-default: setup  ## everything but test-outside, as it flies: kernels compiled
	@$(PY) -m pytest $(addprefix --ignore=,$(OUTSIDE))

.PHONY: test-outside
test-outside: setup  ## real orbits and receivers; the wheel in an environment of its own
	@echo "== real data, packaging"
	@$(PY) -m pytest $(OUTSIDE)

# Kernels compiled with bounds checks live in a cache folder of their own (flightsw/kernels/kernel_cache.py).
.PHONY: test-bounds
test-bounds: setup  ## tests of the kernels, compiled with bounds checks
	@echo "== kernels with bounds checks"
	@NUMBA_BOUNDSCHECK=1 $(PY) -m pytest -p tests.lanes --lane=bounds --durations=5

.PHONY: test-coverage
test-coverage: setup  ## tests of the kernels as plain Python, with line coverage
	@echo "== kernels as plain Python, coverage"
	@mkdir -p $(OUT)
	@NUMBA_DISABLE_JIT=1 COVERAGE_FILE=$(OUT)/coverage $(PY) -m pytest -p tests.lanes --lane=coverage --durations=5 \
	  --cov --cov-config=pyproject.toml --cov-report=term

.PHONY: test-long
test-long: setup  ## more days, steps and walks of what make test looks at in few; the wheel from cold
	@$(PY) -m pytest -m long
	@LEONAV_COLD=1 $(PY) -m pytest tests/packaging/test_wheel.py

.PHONY: check
check: setup  ## lint, format, types
	@$(PY) -m ruff check .
	@$(PY) -m ruff format --check .
	@$(PY) -m mypy

.PHONY: format
format: setup  ## rewrite the sources in the project's format
	@$(PY) -m ruff check --fix .
	@$(PY) -m ruff format .

.PHONY: timing
timing: setup  ## what a tick, a kernel, a start and the ground link cost here, in lockstep and in real time: half an hour
	@$(PY) -m ground timing $(QUICK)

.PHONY: soak
# An hour or two on two quiet processors: world beside flight. QUICK=1: 20,000 ticks, a minute. EXPECT=soak.json of another
# soak: its telemetry must come again. ctrl-C tells what was flown until then.
soak: setup  ## ten million ticks with every function on and faults (TICKS=1e7): memory flat, no slips, digests stable
	@$(PY) -m hil_sim soak --ticks $(or $(TICKS),$(if $(QUICK),20000,1e7)) $(if $(EXPECT),--expect $(EXPECT))

.PHONY: kill
kill: setup  ## kill -9 while tables are written and activated, 200 times: a bootable pair every time
	@LEONAV_KILLS=200 $(PY) -m pytest -q tests/unit/test_table_store.py -k kill_9

.PHONY: fuzz
fuzz: setup  ## ten million bytes of nonsense of each kind into the ground link (LEONAV_FUZZ_BYTES): minutes
	@LEONAV_FUZZ_BYTES=$(or $(LEONAV_FUZZ_BYTES),10000000) $(PY) -m pytest -q -s \
	  tests/property/test_link_garbage.py tests/property/test_link_signed_garbage.py

.PHONY: tune
# What was flown is kept: the same command goes on where it was stopped. Full campaigns: python -m ground tune --help.
tune: setup  ## a quick tuning by both methods, minutes; prints how to fly the sets that come of it
	@$(PY) -m ground tune --method paper --quick --out runs/tune/paper
	@$(PY) -m ground tune --method overbound --quick --out runs/tune/overbound

.PHONY: certify
# What was flown is kept: the same command goes on where it was stopped. Hours on two processors; QUICK=--quick: minutes.
certify: setup  ## certify the bound of a table set (SET=flight): long outages, then 12,000 of 2000 s; report in runs/certify
	@$(PY) -m ground certify --set $(or $(SET),flight) --long $(QUICK)
	@$(PY) -m ground certify --set $(or $(SET),flight) $(QUICK)

.PHONY: accuracy
# Finished orbits are kept: the same command goes on where it was stopped. About an hour on two processors.
accuracy: setup  ## the flight filter on real and simulated orbits: figures, plots and verdict in runs/accuracy
	@$(PY) -m ground accuracy bench --out runs/accuracy --oscillator

.PHONY: console
console: setup  ## replay a recorded run (RUN=runs/nominal) on the console, 60 times as fast as it was flown
	@test -f $(RUN)/link.tlog || { echo "console: no $(RUN)/link.tlog; fly one with make sil, or name it: RUN=DIR"; exit 1; }
	@$(PY) -m ground console --tlog $(RUN)/link.tlog --speed 60

.PHONY: demo
demo: setup  ## world, CAN bus, flight and console in real time (SPEED=1, SCENARIO=demo); ctrl-C or q ends all
	@$(PY) -m hil_sim demo $(or $(SCENARIO),demo) --speed $(or $(SPEED),1)

.PHONY: clean
clean:  ## remove build products and caches; .venv and runs/ stay
	@rm -rf build dist leonav.egg-info .pytest_cache .hypothesis .ruff_cache .mypy_cache .coverage htmlcov
	@find flightsw ground hil_sim tests -name __pycache__ -type d -prune -exec rm -rf {} +
