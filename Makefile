# `make demo` and `make test` do everything on a fresh machine that has Python 3.11 or newer, pip and a package index.
.DELETE_ON_ERROR:
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
# Python is started many times, by tests above all, and keeps byte code for the next one.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo demo-volume demo-texture demo-warp3d demo-scale figures media test test-all test-lowest test-prereleases test-faults fuzz mutants bench scores guard kernels first-pictures lint audit docs docs-check docs-links sdist wheel plugins lock clean
# Side by side, as most of a first run is the compiler's, on one core each; -O keeps what they print apart.
demo: $(VENV)/.run
	@$(MAKE) --no-print-directory -j3 -O demo-volume demo-texture demo-warp3d
demo-volume demo-texture: demo-%: $(VENV)/.run
	$(BIN)/resample-$* demo --output demo
demo-warp3d: $(VENV)/.run
	$(BIN)/resample-warp3d demo --output demo/warp3d
# A volume larger than its budget of memory, generated in a temporary folder (docs/scale.md); SIZE=512 is quicker.
SIZE ?= 1024
demo-scale: $(VENV)/.dev
	$(BIN)/python -m benchmarks.scale --size 256 --size $(SIZE) --memory 2GiB --workers 2
# The paper's figures; DATA is a folder with its volumes, else those that `resample-volume fetch` has stored.
figures: $(VENV)/.run
	$(BIN)/resample-volume figures --output figures $(if $(DATA),--data $(DATA))
	$(BIN)/resample-texture figures --output figures
	$(BIN)/resample-warp3d figures --output figures
# Pictures of pages, moving ones and crops, in docs/images; wants a Chromium, and VTK's wheel; DATA is a folder of volumes,
# PHOTOS one of photographs.
media: $(VENV)/.dev
	$(BIN)/python tools/crops.py $(if $(PHOTOS),--data $(PHOTOS))
	$(BIN)/python tools/media.py $(if $(DATA),--data $(DATA))
# docs/testing.md tells what `test` leaves to `test-all`; WORKERS=1 is one process, ARGS="-k corners" some tests.
WORKERS ?= auto
PYTEST  := $(BIN)/python -m pytest -n $(WORKERS) --maxprocesses 8 --dist worksteal
test: $(VENV)/.dev
	$(PYTEST) -m "not sweep" $(ARGS)
test-all: $(VENV)/.dev
	$(PYTEST) $(ARGS)
# The same with the lowest versions of dependencies that pyproject.toml admits, and with pre-releases of them.
test-lowest: VERSIONS := --resolution lowest-direct
test-prereleases: VERSIONS := --prerelease allow
test-lowest test-prereleases: $(BIN)/uv
	$(BIN)/uv pip install -q --python $(BIN)/python $(VERSIONS) -e '.[film,depth,dicom,vtk,view,notebook,las,e57]'
	$(BIN)/uv pip install -q --python $(BIN)/python --group dev
	$(PYTEST) -m "not sweep" $(ARGS)
# What a first picture takes after `pip install` of the wheel, in an empty environment; ARGS="--without numba" leaves packages out.
first-pictures: wheel
	$(BIN)/python tools/first_pictures.py $(wildcard dist/*.whl) $(ARGS)
# Commands that are killed, on full disks, without streams, with little memory, two at a time; checks of memory in C.
test-faults: $(VENV)/.dev
	$(PYTEST) tests/faults $(ARGS)
# Files and arrays changed at random (docs/reliability.md); SECONDS=60 is a trial, ARGS="--seed 7" another way through.
fuzz: SECONDS ?= 600
fuzz: $(VENV)/.dev
	$(BIN)/python -m tests.fuzz --seconds $(SECONDS) $(ARGS)
# Small faults in the sources, which tests have to notice (docs/testing.md); ARGS="--seed 2 --stratum texture" are others.
mutants: $(VENV)/.dev
	$(BIN)/python -m tools.mutants $(ARGS)
# All of it takes long and wants a quiet machine; GROUPS="growth startup" are some of it, ARGS=--quick is a trial.
bench: $(VENV)/.dev
	$(BIN)/python -m benchmarks $(GROUPS) --json bench.json --markdown bench.md $(if $(DATA),--data $(DATA)) $(ARGS)
# What users get, beside other programs: docs/scores.json and the tables of README.md, docs/quality.md, docs/performance.md.
scores: $(VENV)/.dev
	$(BIN)/python -m benchmarks.scores $(GROUPS) $(if $(DATA),--data $(DATA)) $(ARGS)
# Kernels that have become half as fast, or worse, beside fixed NumPy code fail.
guard: $(VENV)/.dev
	$(BIN)/python -m benchmarks.guard
# The library of kernels (docs/developers.md): built from a list of commands; ARGS=--list prints what is in it, ARGS=--edits what an edit of each module compiles anew.
kernels: $(VENV)/.dev
	$(BIN)/python -m tools.kernels $(ARGS)
lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tools/house.py
	$(BIN)/python tools/licences.py
# Known faults of the locked dependencies. The index has to tell them, as PyPI does: what could not be audited fails.
audit: $(BIN)/uv
	$(BIN)/uv venv -q --clear $(VENV)/audit
	$(BIN)/uv pip install -q --python $(VENV)/audit --require-hashes -r requirements/audit.txt
	$(VENV)/audit/bin/pip-audit --strict --disable-pip --require-hashes -r requirements/run.txt
# The site, in docs/_build/html, offline and without warnings; examples that have not changed are not run again.
docs: $(VENV)/.docs
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
# The same without running examples: pages, docstrings and references, in a quarter of a minute.
docs-check: $(VENV)/.docs
	CHECK=1 $(BIN)/sphinx-build -W --keep-going -q -E -b html docs docs/_build/check
# What needs no Sphinx: pages, links, pictures, and that each command in the docs is one.
docs-links: $(VENV)/.dev
	$(BIN)/python -m pytest -q tests/core/test_docs.py
sdist: $(VENV)/.dev
	$(BIN)/uv build -q --sdist --no-build-isolation --python $(BIN)/python --out-dir dist
# With the library of kernels, where there is one for this machine.
wheel: kernels
	$(BIN)/uv build -q --wheel --no-build-isolation --python $(BIN)/python --out-dir dist

# Wheels of the packages in plugins/.
plugins: $(VENV)/.dev
	for plugin in $(PLUGINS); do $(BIN)/uv build -q --wheel --no-build-isolation --python $(BIN)/python --out-dir dist/plugins $$plugin; done

# --without-pip: works where Debian's python3-venv is missing; the machine's pip then installs uv into it, and what builds wheels.
$(BIN)/uv: requirements/build.txt
	$(PYTHON) -m venv --without-pip $(VENV)
	$(PYTHON) -m pip --python $(VENV) install -q --disable-pip-version-check --require-hashes -r requirements/build.txt
	touch $@
# The locks hold versions and hashes only, no addresses: whatever index the machine is set up for serves.
PLUGINS := $(patsubst %/pyproject.toml,%,$(wildcard plugins/*/pyproject.toml))
define install
	$(BIN)/uv pip install -q --python $(BIN)/python --require-hashes -r requirements/$(1).txt
	$(BIN)/uv pip install -q --python $(BIN)/python --no-deps --no-build-isolation -e . $(PLUGINS:%=-e %)
	$(BIN)/python -m compileall -q resample apps plugins
endef
$(VENV)/.run: requirements/run.txt pyproject.toml $(PLUGINS:%=%/pyproject.toml) | $(BIN)/uv
	$(call install,run)
	touch $@
# What tests start time and again is byte-compiled at once; a first run leaves that to Python, which imports a fifth of it.
$(VENV)/.dev $(VENV)/.docs: export UV_COMPILE_BYTECODE := 1
$(VENV)/.dev: requirements/dev.txt pyproject.toml $(PLUGINS:%=%/pyproject.toml) | $(BIN)/uv
	$(call install,dev)
	touch $@ $(VENV)/.run
# On top of the environment of tests, which `make .venv/.dev` alone leaves light.
$(VENV)/.docs: requirements/docs.txt $(VENV)/.dev
	$(BIN)/uv pip install -q --python $(BIN)/python --require-hashes -r requirements/docs.txt
	touch $@
lock: LOCK := $(BIN)/uv pip compile -q pyproject.toml --python-version 3.11 --universal --generate-hashes --no-header
lock: | $(BIN)/uv
	$(LOCK) -o requirements/run.txt
	$(LOCK) --extra film --extra depth --extra dicom --extra vtk --extra peers --extra notebook --extra las --extra e57 --group dev -c requirements/run.txt -o requirements/dev.txt
	$(LOCK) --group docs -c requirements/dev.txt -o requirements/docs.txt
	$(subst pyproject.toml,--group build,$(LOCK)) -c requirements/dev.txt -o requirements/build.txt
	$(subst pyproject.toml,--group audit,$(LOCK)) -o requirements/audit.txt
clean:
	rm -rf $(VENV) dist demo
