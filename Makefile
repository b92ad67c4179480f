# Plumbline. `make help` lists what there is; every variable below can be given on the command line,
# as in `make demo ARGS="--help"`. The targets set up a Debian or Ubuntu machine that has Rust themselves.

CARGO ?= cargo
# Flags of every build: the profile, and that Cargo.lock is taken as it is.
FLAGS ?= --release --locked
# Arguments of the demo, of the bench and of nextest.
ARGS ?=
# Where the Python environment and the cargo tools are put.
VENV ?= .venv
# Length of the soak test.
SOAK_MINUTES ?= 30

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
export VENV
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)
# On a build server every failure is shown.
export NEXTEST_PROFILE ?= $(if $(CI),ci,default)

# The steps are in order; cargo is parallel itself.
.NOTPARALLEL:
.PHONY: help demo build test check lint fmt fmt-check clippy deny soak bench doc setup clean

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 20

demo: ## simulated flight with its ground station in the browser
	@scripts/setup base
	$(CARGO) run $(FLAGS) -p plumbline -- demo $(ARGS)

build: ## the product
	@scripts/setup base
	$(CARGO) build $(FLAGS) -p plumbline

test: setup fmt-check deny ## format, lints, licences, then every test but the soak
	RUSTC_WORKSPACE_WRAPPER=$(CURDIR)/scripts/rustc-clippy \
		$(CARGO) nextest run $(FLAGS) --workspace --all-targets -E 'not kind(bench)' $(ARGS)

check: ## the tests alone, without the lints
	@scripts/setup test
	$(CARGO) nextest run $(FLAGS) --workspace $(ARGS)

lint: setup fmt-check deny clippy ## format, licences and lints, without the tests

soak: setup ## long flights: memory, drift of time, restarts (SOAK_MINUTES=30)
	PLUMBLINE_SOAK_MINUTES=$(SOAK_MINUTES) $(CARGO) nextest run $(FLAGS) --workspace --profile soak \
		--run-ignored all -E 'test(/soak/)' $(ARGS)

bench: setup ## benchmarks of the stages
	$(CARGO) bench --locked -p plumbline-tests $(ARGS)

fmt: ## format the sources
	$(CARGO) fmt --all

doc: ## the documentation of the code
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc $(FLAGS) --workspace --no-deps

clean: ## remove what was built
	$(CARGO) clean

setup: ## install what tests and lints need
	@scripts/setup test

fmt-check:
	$(CARGO) fmt --all --check

clippy:
	$(CARGO) clippy $(FLAGS) --workspace --all-targets -- -D warnings

# Advisories are left out: their database is not on crates.io.
deny:
	$(CARGO) deny --workspace --locked check bans licenses sources
