# `make report` builds results/report.html; every target first sets up .venv from the lock files: what
# users need, and for what is a developer's the rest on top.
PYTHON ?= python3
CORES ?= 2
BIN := .venv/bin
READY := .venv/.ready
DEV_READY := .venv/.ready-dev
PEERS := build/peers

.PHONY: report picture settings test nightly cluster lint format bench a-day factory vqf study setup setup-dev setup-cluster lock environment wheel api licences clean

# of the devices of config.yaml, or of another config: make report CONFIG=my.yaml; with VERBOSE=1
# what Snakemake says of each job
QUIET := PYTHONPATH=workflow/logger $(BIN)/snakemake --logger imuloop
report: setup
	@$(if $(CONFIG),$(BIN)/python -m imuloop.config_text $(CONFIG))
	@$(if $(VERBOSE),$(BIN)/snakemake,$(QUIET)) $(if $(CONFIG),--configfile $(CONFIG)) -c$(CORES) \
		results/report.html
	@echo "Open results/report.html"

# docs/report.png and docs/report_390.png, the first screen of the report of config.yaml; needs Chromium
BROWSER ?= /usr/bin/chromium
picture: report setup-dev
	$(BIN)/python docs/picture.py results/report.html $(BROWSER)

# the config's schema and docs/settings.md, from the models of its keys
settings: setup
	PYTHONPATH=workflow/lib $(BIN)/python docs/settings.py

test: setup-dev
	$(BIN)/pytest -n $(CORES) --dist loadfile

# what takes too long for every change: statistical tests with all their seeds, published figures of
# all devices; recordings by IMULOOP_MIRROR
nightly: setup-dev
	$(BIN)/pytest -n $(CORES) -m study

# tests against a real SLURM and an S3 on this machine; what cannot be had is skipped with the reason
cluster: .venv-cluster/.ready-dev
	.venv-cluster/bin/pytest -n $(CORES) tests/cluster

lint: setup-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/snakemake --lint

format: setup-dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile workflow

# What measures writes build/bench/NAME.md, with its commit in the first line.
MEASURE := OPENBLAS_NUM_THREADS=1 PYTHONPATH=workflow/lib $(BIN)/python -m

# times and errors beside other packages: peers.md, ten minutes
bench: setup-dev $(if $(BASE),,$(PEERS)/.ready)
	$(MEASURE) $(if $(BASE),bench.since $(BASE),bench.peers)

# a day at rest from CSV to noise.json, time and memory: day_200.md; RATE=200 or 1000
RATE ?= 200
a-day: setup-dev
	$(MEASURE) bench.workflow day --rate $(RATE)

# a factory's devices, simulated: dry run, full run, one device added, one default changed, one
# script edited: factory.md
DEVICES ?= 20,200
factory: setup-dev
	$(MEASURE) bench.workflow factory --devices $(DEVICES)

# the other packages in an environment of their own; the table names one that does not install
$(PEERS)/.ready: bench/requirements.txt
	$(PYTHON) -m venv --clear $(PEERS)
	-grep -v '^#' $< | while read each; do $(PEERS)/bin/pip install --quiet $$each; done
	touch $@

# the error of a filter of others on eight trials of BROAD, before and after the offset that imuloop
# finds on three others: vqf.md, two minutes; recordings by IMULOOP_MIRROR
vqf: setup
	@$(QUIET) --configfile config/reference.yaml -c$(CORES) results/broad/diagnosis.json
	$(MEASURE) bench.vqf_offset results/broad/diagnosis.json

# undeclared effects in simulated devices: are they found? study.md; a file per device in STUDY, with
# which an interrupted study goes on. For a part of it
# OPTIONS="--effects g_sensitivity,control --seeds 3"
STUDY ?= build/study
study: setup-dev
	$(MEASURE) bench.study --workers $(CORES) --keep $(STUDY) $(or $(OPTIONS),--first 8200 --seeds 6)

setup: $(BIN)/imuloop

setup-dev: $(DEV_READY)

NEW_ENOUGH := 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed")'
# pip and setuptools first, pinned: a package that is no wheel is built with them, with nothing fetched
PINNED := pip install --quiet --require-hashes
# of a lock, which names all that is needed; nothing is compiled that is never imported
LOCKED := $(PINNED) --no-deps --no-compile --no-build-isolation
$(READY): locks/build.lock locks/users.lock
	@$(PYTHON) -c $(NEW_ENOUGH)
	@test ! -L .venv || { echo ".venv is a link, and set-up empties what it leads to: remove it"; exit 1; }
	$(PYTHON) -m venv --clear .venv
	$(BIN)/python -m $(PINNED) --only-binary :all: -r locks/build.lock
	$(BIN)/$(LOCKED) -r locks/users.lock
	touch $@

$(DEV_READY): $(READY) locks/dev.lock | setup
	$(BIN)/$(LOCKED) -r locks/dev.lock
	touch $@

# the command, and the library as it is in workflow/lib: an edit needs no new set-up
LIBRARY := pip install --quiet --no-index --no-deps --no-build-isolation --editable .
$(BIN)/imuloop: $(READY) pyproject.toml
	$(BIN)/$(LIBRARY)

# .venv with Snakemake's plugins for SLURM and S3, an environment of its own: each call loads them
setup-cluster: .venv-cluster/.ready

.venv-cluster/.ready: locks/build.lock locks/users.lock locks/cluster.lock
	@$(PYTHON) -c $(NEW_ENOUGH)
	$(PYTHON) -m venv --clear .venv-cluster
	.venv-cluster/bin/python -m $(PINNED) --only-binary :all: -r locks/build.lock
	.venv-cluster/bin/$(LOCKED) -r locks/users.lock -r locks/cluster.lock
	touch $@

.venv-cluster/.ready-dev: .venv-cluster/.ready locks/dev.lock locks/cluster-dev.lock
	.venv-cluster/bin/$(LOCKED) -r locks/dev.lock -r locks/cluster-dev.lock
	touch $@

# Exact versions and hashes, for all platforms; run by hand after a change of pyproject.toml. Versions
# stay as they are in the locks that are there. Everything is resolved at once, then told apart:
# locks/users.lock is for users, the others have what their group needs beside.
COMPILE = build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--no-annotate --custom-compile-command "make lock"
ALL = $(COMPILE) pyproject.toml --extra all
GROUP = $(ALL) -c build/lock/every.lock
# $(call WITHOUT,LOCKS): what these locks have for every platform that needs it
WITHOUT = $$(grep -Fxh -f build/lock/every.lock $(1) | sed -n 's/^\([a-z0-9-]*\)==.*/--no-emit-package \1/p')
CLUSTER := --extra slurm --extra s3
lock:
	$(PYTHON) -m venv build/lock
	build/lock/bin/pip install --quiet uv
	printf 'pip\nsetuptools\n' | $(COMPILE) - -o locks/build.lock
	sed -n '/==/s/ \\$$//p' locks/*.lock >build/lock/every.lock
	$(ALL) --extra dev $(CLUSTER) --extra moto -o build/lock/every.lock
	$(GROUP) -o locks/users.lock
	$(MAKE) environment
	$(GROUP) --extra dev $(call WITHOUT,locks/users.lock) -o locks/dev.lock
	$(GROUP) $(CLUSTER) $(call WITHOUT,locks/users.lock) -o locks/cluster.lock
	$(GROUP) --extra moto $(call WITHOUT,locks/users.lock locks/dev.lock locks/cluster.lock) \
		-o locks/cluster-dev.lock

# workflow/envs/imuloop.yaml, the Conda environment of the jobs: the versions of locks/users.lock
environment:
	$(PYTHON) docs/environment.py

# what pip installs, build/wheel; what an earlier build left would come along
wheel: setup
	rm -rf build/wheel build/lib workflow/lib/imuloop.egg-info
	$(BIN)/pip wheel --quiet --no-index --no-deps --no-build-isolation --wheel-dir build/wheel .

# build/api.md: the Python reference, from docstrings
api: setup
	$(BIN)/python docs/api.py

# build/licences.md: the licence of each installed package
licences: setup-dev
	$(BIN)/python docs/licences.py

# results and logs only; downloads in data/cache and .venv stay
clean:
	rm -rf results logs benchmarks data/simulated .snakemake build
