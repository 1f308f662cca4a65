# Two commands do all the set-up on a fresh machine:
#   make demo   installs rigctl and runs its main job on the simulated bench, ending in a page
#   make test   installs what the tests need (Debian packages too, where it may) and runs them
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
export PIP_DISABLE_PIP_VERSION_CHECK = 1

.PHONY: demo test check lint types imports unit bench docs pictures site wheel clean system constraints torture lying loggers explore mutants windows

demo: $(VENV)/.installed
	$(BIN)/rigctl demo demo

# Two package managers need a core each; the checks read the sources with one while the tests begin.
test:
	$(MAKE) --no-print-directory --jobs=2 $(VENV)/.installed-dev system
	$(MAKE) --no-print-directory --jobs=4 lint types imports unit

check: lint types imports

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check src rigctl-validation examples tests benchmarks
	$(BIN)/ruff format --check src rigctl-validation examples tests benchmarks

types: $(VENV)/.installed-dev
	$(BIN)/mypy

imports: $(VENV)/.installed-dev
	$(BIN)/lint-imports

# One more than the two cores it is meant for: some tests wait for a process or a line, and leave their core to others.
# One or two that fail are repeated alone: what passes then is named at the end, and does not stop everything else.
WORKERS ?= 3
unit: $(VENV)/.installed-dev
	$(BIN)/python tools/run_tests.py -n $(WORKERS) --dist worksteal

# Debian packages that the tests use: a browser to open the report in, an emulator of the board's microcontroller
# and the compiler for its program, an MQTT broker. Elsewhere: install Chromium, simavr, avr-gcc, Mosquitto by hand.
system:
	sh tools/install-system-packages chromium libsimavr2 gcc-avr binutils-avr avr-libc mosquitto

bench: $(VENV)/.installed
	HATCH_BUILD_NO_HOOKS=true $(BIN)/pip install --quiet --constraint constraints.txt --editable '.[benchmarks]' --editable ./rigctl-validation
	$(BIN)/python -m benchmarks

# Hours of random damage; its minute is among the tests. SEED and what it takes are printed with what was found.
# TORTURE says how many, e.g. "--endings 500 --files 0".
SEED ?= 0
TORTURE ?=
torture: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python -m torture --seed $(SEED) $(TORTURE)

# Devices that lie, are exchanged or go stale, 2000 endings behind each protocol unless LYING says otherwise, e.g.
# "--cpu 60": prints "not refuted (N)", or each ending that left an output on without saying so.
LYING ?=
lying: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python -m torture.lying --seed $(SEED) $(LYING)

# Changed files of loggers alone, 10 000 unless LOGGERS says otherwise, e.g. "--files 500".
LOGGERS ?=
loggers: $(VENV)/.installed-dev
	PYTHONPATH=tests $(BIN)/python -m torture.logger_files --seed $(SEED) $(LOGGERS)

# New examples for every property that leaves their number open; those of `make test` are the same each time.
explore: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m hypothesis --hypothesis-profile=explore

# Faults planted one at a time, 150 for each room of tools/mutants.toml unless MUTANTS says otherwise, e.g. "units
# --sample 0" or "--since main": prints those that no test finds, and the score of each room.
MUTANTS ?=
mutants: $(VENV)/.installed-dev
	$(BIN)/python tools/mutants.py $(MUTANTS)

# Tests on Windows' own Python under Wine, in .windows: the core, or what WINDOWS says, e.g. "tests all" or "endings 200".
WINDOWS ?= core
windows: $(VENV)/.installed-dev
	tools/windows-under-wine $(WINDOWS)

docs: $(VENV)/.installed-dev
	$(BIN)/python tools/generate_docs.py

# The pictures of README, and those of the workbench, taken anew on all records of the tutorial; a test says when they are out of date.
pictures: $(VENV)/.installed-dev
	$(BIN)/python tools/readme_pictures.py
	$(BIN)/python tools/workbench_pictures.py

# The site of the documentation, in build/site: `rigctl serve` shows it, and it opens from its folder.
site: $(VENV)/.installed-dev
	$(BIN)/python tools/make_site.py

# A wheel with the site in it, in dist.
wheel: $(VENV)/.installed-dev
	$(BIN)/python -m build --wheel

# Python brings the pip of its own release; a newer one resolves and unpacks in half the processor time.
$(BIN)/python:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "rigctl needs Python 3.11 or newer")'
	@echo "Making a Python environment in $(VENV)"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade --constraint constraints.txt pip

# Both install the versions that constraints.txt names: what was tested is what runs.
# With the site of the documentation, for which pip gets its builder into a folder of its own.
$(VENV)/.installed: pyproject.toml rigctl-validation/pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing rigctl and what it needs into $(VENV): 0.6 GB, one or two minutes"
	$(BIN)/pip install --progress-bar on --constraint constraints.txt --editable . --editable ./rigctl-validation
	touch $@

# The plug-ins that show how to write one are installed as a user's would be.
EXAMPLES := $(wildcard examples/plugins/rigctl-*)
# The tests import a small part of what is installed, and Python compiles that by itself; all of it would take most
# of the installation.
$(VENV)/.installed-dev: pyproject.toml rigctl-validation/pyproject.toml $(EXAMPLES:%=%/pyproject.toml) constraints.txt | $(BIN)/python
	HATCH_BUILD_NO_HOOKS=true $(BIN)/pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev]' --editable ./rigctl-validation $(EXAMPLES:%=--editable ./%)
	touch $@ $(VENV)/.installed

# The newest versions that pyproject.toml allows, tried in an environment of their own, become the named ones.
constraints:
	rm -rf build/newest && $(PYTHON) -m venv build/newest
	build/newest/bin/python -m pip install --quiet --upgrade pip
	HATCH_BUILD_NO_HOOKS=true build/newest/bin/pip install --quiet --editable '.[dev,benchmarks]' --editable ./rigctl-validation $(EXAMPLES:%=--editable ./%)
	(sed -n '/^#/p' constraints.txt && build/newest/bin/pip freeze --all --exclude-editable) > build/constraints.txt
	mv build/constraints.txt constraints.txt

clean:
	rm -rf $(VENV) build dist demo .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
