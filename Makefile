# `make report` builds results/report.html; every target first sets up .venv from the lock file.
PYTHON ?= python3
CORES ?= 2
BIN := .venv/bin
READY := .venv/.ready
PEERS := build/peers

.PHONY: report picture settings test nightly cluster lint format bench a-day factory bench-noise study fuzz fuzz-chain processors setup setup-cluster lock wheel api licences clean

# of the devices of config.yaml, or of another config: make report CONFIG=my.yaml; with VERBOSE=1
# what Snakemake says of each job
QUIET := PYTHONPATH=workflow/logger $(BIN)/snakemake --logger imuloop
report: setup
	@$(if $(VERBOSE),$(BIN)/snakemake,$(QUIET)) $(if $(CONFIG),--configfile $(CONFIG)) -c$(CORES) \
		results/report.html
	@echo "Open results/report.html"

# docs/report.png, the first screen of the report of config.yaml; needs Chromium
BROWSER ?= chromium
picture: report
	$(BROWSER) --headless --no-sandbox --hide-scrollbars --window-size=1400,880 \
		--screenshot=docs/report.png file://$(CURDIR)/results/report.html
	$(BIN)/python -c 'from PIL import Image; \
		Image.open("docs/report.png").quantize(48).save("docs/report.png", optimize=True)'

# the config's schema and docs/settings.md, from the models of its keys
settings: setup
	PYTHONPATH=workflow/lib $(BIN)/python docs/settings.py

test: setup
	$(BIN)/pytest -n $(CORES)

# what takes too long for every change: statistical tests with all their seeds, published figures of
# all devices, every kind of processor, mutated and harmed logs; recordings by IMULOOP_MIRROR
nightly: setup
	$(BIN)/pytest -n $(CORES) -m study
	$(MAKE) processors
	$(MAKE) fuzz CASES=15
	$(MAKE) fuzz-chain FUZZ_CASES=2

# tests against a real SLURM and an S3 on this machine; what cannot be had is skipped with the reason
cluster: setup-cluster
	.venv-cluster/bin/pytest -n $(CORES) tests/cluster

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/snakemake --lint

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile workflow

# What measures writes build/bench/NAME.md, with its commit in the first line.
MEASURE := OPENBLAS_NUM_THREADS=1 PYTHONPATH=workflow/lib $(BIN)/python -m

# times and errors beside other packages: peers.md, five minutes
bench: setup $(PEERS)/.ready
	$(MEASURE) bench.peers

# a day at rest from CSV to noise.json, time and memory: day_200.md; RATE=200 or 1000
RATE ?= 200
a-day: setup
	$(MEASURE) bench.workflow day --rate $(RATE)

# a factory's devices, simulated: dry run, full run, one device added, one default changed, one
# script edited: factory.md
DEVICES ?= 20,200
factory: setup
	$(MEASURE) bench.workflow factory --devices $(DEVICES)

# the other packages in an environment of their own; the table names one that does not install
$(PEERS)/.ready: bench/requirements.txt
	$(PYTHON) -m venv --clear $(PEERS)
	-grep -v '^#' $< | while read each; do $(PEERS)/bin/pip install --quiet $$each; done
	touch $@

# noise coefficients beside truth, bound and common tools: noise.md, ten minutes on two cores; for a
# part of it OPTIONS="--parts accuracy --seeds 10"
bench-noise: setup
	$(MEASURE) bench.noise --workers $(CORES) $(OPTIONS)

# undeclared effects in simulated devices: are they found? study.md; a file per device in STUDY, with
# which an interrupted study goes on. For a part of it
# OPTIONS="--effects g_sensitivity,control --seeds 3"
STUDY ?= build/study
study: setup
	$(MEASURE) bench.study --workers $(CORES) --keep $(STUDY) $(or $(OPTIONS),--first 8200 --seeds 6)

# mutated logs and configs through ingest and the config check, so many of each of 33
CASES ?= 500
fuzz: setup
	$(BIN)/pytest -n $(CORES) bench/fuzz/test_logs.py --cases $(CASES)

# harmed stretches of recordings through the whole chain, so many of each device; recordings by
# IMULOOP_MIRROR
FUZZ_CASES ?= 300
fuzz-chain: setup
	$(BIN)/pytest -n $(CORES) bench/fuzz/test_chain.py --cases $(FUZZ_CASES)

# the measured devices by the code of each kind of processor, the numeric tests by the oldest: same
# figures, same verdicts; recordings by IMULOOP_MIRROR
processors: setup
	PYTHONPATH=workflow/lib $(BIN)/python -m bench.processors --workers $(CORES)

setup: $(BIN)/imuloop

NEW_ENOUGH := 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed")'
# pip and setuptools first, pinned: a package that is no wheel is built with them, with nothing fetched
PINNED := pip install --quiet --require-hashes
$(READY): requirements-build.lock requirements.lock
	@$(PYTHON) -c $(NEW_ENOUGH)
	@test ! -L .venv || { echo ".venv is a link, and set-up empties what it leads to: remove it"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m $(PINNED) --only-binary :all: -r requirements-build.lock
	$(BIN)/$(PINNED) --no-build-isolation -r requirements.lock
	touch $@

# the command, and the library as it is in workflow/lib: an edit needs no new set-up
LIBRARY := pip install --quiet --no-index --no-deps --no-build-isolation --editable .
$(BIN)/imuloop: $(READY) pyproject.toml
	$(BIN)/$(LIBRARY)

# .venv with Snakemake's plugins for SLURM and S3, an environment of its own: each call loads them
setup-cluster: .venv-cluster/.ready

.venv-cluster/.ready: requirements-build.lock requirements-cluster.lock
	@$(PYTHON) -c $(NEW_ENOUGH)
	$(PYTHON) -m venv --clear .venv-cluster
	.venv-cluster/bin/python -m $(PINNED) --only-binary :all: -r requirements-build.lock
	.venv-cluster/bin/$(PINNED) --no-deps --no-compile --no-build-isolation -r requirements-cluster.lock
	touch $@

# exact versions and hashes of everything, for all platforms; run by hand after a change of pyproject.toml
COMPILE = build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--custom-compile-command "make lock"
EVERYTHING := pyproject.toml --extra all --extra dev
lock:
	$(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet uv
	printf 'pip\nsetuptools\n' | $(COMPILE) - -o requirements-build.lock
	$(COMPILE) $(EVERYTHING) -o requirements.lock
	sed '/^python-dateutil==/d' requirements.lock | grep -v -e --hash >build/lock/shared.txt
	$(COMPILE) $(EVERYTHING) --extra slurm --extra s3 --extra moto -c build/lock/shared.txt -o requirements-cluster.lock

# what pip installs, build/wheel
wheel: setup
	rm -rf build/wheel
	$(BIN)/pip wheel --quiet --no-index --no-deps --no-build-isolation --wheel-dir build/wheel .

# build/api.md: the Python reference, from docstrings
api: setup
	$(BIN)/python docs/api.py

# build/licences.md: the licence of each installed package
licences: setup
	$(BIN)/python docs/licences.py

# results and logs only; downloads in data/cache and .venv stay
clean:
	rm -rf results logs benchmarks data/simulated .snakemake build
