# Plumbline. `make help` lists what there is; every variable below can be given on the command line,
# as in `make demo ARGS="--help"`. The targets set up a Debian or Ubuntu machine that has Rust themselves.

CARGO ?= cargo
# Flags of every build: the profile, and that Cargo.lock is taken as it is.
FLAGS ?= --release --locked
# Arguments of the demo, of the bench and of nextest.
ARGS ?=
# Where the Python environment and the cargo tools are put.
VENV ?= .venv
# Length of the long flight of the soak tests; the others follow it or have a length of their own.
SOAK_MINUTES ?= 30
# What `make fuzz` runs, and for how long.
TARGET ?=
SECONDS ?= 60
# The processor that packages are for, as Debian names it: amd64 or arm64.
ARCH ?= $(shell dpkg --print-architecture)
# How long `make vm` lets the cameras fly, s.
VM_SECONDS ?= 60

SHELL := bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
export VENV
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)
# On a build server every failure is shown.
export NEXTEST_PROFILE ?= $(if $(CI),ci,make)
# Property tests draw the same cases every time; `PROPTEST_RNG_SEED=$RANDOM make checked` looks for others.
export PROPTEST_RNG_SEED ?= 1
# Two threads for each processor: a test that computes takes two of them, one that waits takes one (.config/nextest.toml).
export NEXTEST_TEST_THREADS ?= $(shell echo $$((2 * $$(nproc))))

# The steps are in order; cargo is parallel itself.
.NOTPARALLEL:
.PHONY: help demo build calibration test tests tests-built forget-skips checked check lint fmt fmt-check clippy deny vendored advisories oracle soak loops digests bench bench-instructions bench-against count-arm64 doc doctests setup tools clean \
	fuzz fuzz-all fuzz-smoke vm arm64 oldest capi capi-header messages capi-valgrind deb tarball packages deb-test wheel wheel-test wheel-soak realtime faults

help: ## this list
	@grep -hE '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## /  make \1\t/' | expand -t 28

demo: ## simulated flight with its ground station in the browser
	@scripts/setup base
	$(CARGO) run $(FLAGS) -p plumbline -- demo $(ARGS)

build: ## the product
	@scripts/setup base
	$(CARGO) build $(FLAGS) -p plumbline

# A build with OpenCV.
OPENCV = --config scripts/opencv.toml

calibration: ## the product with `plumbline calibrate camera`, which needs OpenCV
	@scripts/setup calibration
	$(CARGO) build $(FLAGS) $(OPENCV) -p plumbline --features calibration

# `cargo build` of the product for ARCH.
PRODUCT = $(CARGO) build $(FLAGS) -p plumbline $(if $(filter $(ARCH),$(shell dpkg --print-architecture)),,--target $(TRIPLE_$(ARCH)))
TRIPLE_amd64 = x86_64-unknown-linux-gnu
TRIPLE_arm64 = aarch64-unknown-linux-gnu

# Where cargo puts what it builds for ARCH.
BUILT = target/$(if $(filter $(ARCH),$(shell dpkg --print-architecture)),,$(TRIPLE_$(ARCH))/)release
TOOLS_arm64 = $(if $(filter arm64,$(shell dpkg --print-architecture)),,aarch64-linux-gnu-)

capi: ## C library in target/capi/ARCH: shared, static, headers, pkg-config file (ARCH=arm64)
	@scripts/setup $(if $(filter arm64,$(ARCH)),arm64,base)
	$(subst -p plumbline,-p plumbline-capi,$(PRODUCT))
	rm -rf target/capi/$(ARCH)
	STRIP=$(TOOLS_$(ARCH))strip scripts/c-library target/capi/$(ARCH) $(BUILT)/libplumbline_capi.so $(BUILT)/libplumbline_capi.a

capi-header: ## writes the C library's header anew, after a change of runtime/capi
	PLUMBLINE_WRITE_HEADER=1 $(CARGO) nextest run $(FLAGS) -p plumbline-capi -E 'test(=tests::the_header_is_current)'

messages: ## writes anew what is made of declarations: schemas and their messages in Rust, tables of the documents, names in Python
	PLUMBLINE_WRITE_MESSAGES=1 $(CARGO) nextest run $(FLAGS) -p plumbline-record -p plumbline-capi made layout
	PLUMBLINE_WRITE_MESSAGES=1 $(CARGO) nextest run $(FLAGS) -p plumbline-test-support --test generated

deb: ## Debian packages in target/package, with that of the C library (ARCH=arm64 for 64-bit ARM)
	@scripts/setup package $(ARCH)
	$(PRODUCT) -p plumbline-capi
	scripts/package deb $(ARCH)

tarball: ## the same as an archive for other systems with the GNU C library (ARCH=arm64)
	@scripts/setup package $(ARCH)
	$(PRODUCT)
	scripts/package tarball $(ARCH)

# What starts a program for 64-bit ARM on this machine: as on the first of that kind, so that no instruction of later ones is in it.
QEMU_arm64 = qemu-aarch64-static -cpu cortex-a53 -L /usr/aarch64-linux-gnu

# Every test of the two crates, as it is compiled for the product: an emulator is slow enough without overflow checks.
arm64: setup ## the product for 64-bit ARM; under qemu its flights have the same bits, logs verify both ways, and the estimator's tests pass
	@scripts/setup arm64
	$(CARGO) build $(FLAGS) -p plumbline -p plumbline-capi --target $(TRIPLE_arm64)
	PLUMBLINE_OTHER="$(QEMU_arm64) target/$(TRIPLE_arm64)/release/plumbline" $(OTHER_PROCESSOR)
	PLUMBLINE_C_LIBRARY=target/$(TRIPLE_arm64)/release/libplumbline_capi.so PLUMBLINE_C_COMPILER=aarch64-linux-gnu-gcc \
		PLUMBLINE_C_RUNNER="$(QEMU_arm64)" $(OTHER) -E 'test(/^c_library::elsewhere::/)'
	CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="$(QEMU_arm64)" $(CARGO) nextest run $(FLAGS) --target $(TRIPLE_arm64) \
		-p plumbline-config -p plumbline-estimator --all-features --lib --profile soak --success-output never -E 'not $(TIMED)' $(ARGS)

# The oldest x86-64 that qemu knows: SSE3 and no more.
QEMU_oldest = qemu-x86_64-static -cpu Opteron_G1
OLDEST = target/oldest/release/plumbline

oldest: setup ## the product for every x86-64, without AVX2: it runs on the oldest, its flights have the same bits, and logs verify both ways
	RUSTFLAGS="-C target-cpu=x86-64" $(CARGO) build $(FLAGS) -p plumbline --target-dir target/oldest
	$(QEMU_oldest) $(OLDEST) replay sim:room --start 2 --duration 1 --scale 0.5
	PLUMBLINE_OTHER=$(OLDEST) $(OTHER_PROCESSOR)

# valgrind up to 3.19 cannot decode one form of AVX: it runs the build for every x86-64. LD_LIBRARY_PATH is the test's.
capi-valgrind: setup ## the C library under valgrind: no error, no leak, the same bits, and what a call costs in instructions
	@scripts/setup valgrind
	RUSTFLAGS="-C target-cpu=x86-64" $(CARGO) build $(FLAGS) -p plumbline-capi --target-dir target/oldest
	PLUMBLINE_C_LIBRARY=target/oldest/release/libplumbline_capi.so \
		PLUMBLINE_C_RUNNER="valgrind --quiet --error-exitcode=9 --leak-check=full --errors-for-leak-kinds=definite,possible" \
		$(OTHER) --success-output final -E 'test(/^c_library::(elsewhere|counted)::/)'

# The build that PLUMBLINE_OTHER starts, against that of this machine.
OTHER = $(CARGO) nextest run $(PACKAGES) --test process --profile soak --run-ignored only $(ARGS)
OTHER_PROCESSOR = $(OTHER) --success-output never -E 'test(/^other_processor::/)'


packages: ## lists the packages that were made: sizes, contents, what they depend on
	scripts/package list

deb-test: ## the package of ARCH: lintian; installed, flown, removed and purged in a fresh Debian (SUITE=trixie)
	@scripts/setup package $(ARCH)
	@scripts/setup deb-test
	scripts/deb-test $(ARCH)

wheel: ## wheel of the Python package in target/wheels, for any Linux with glibc 2.28, and what it asks of a system (ARCH=arm64)
	@scripts/setup wheel $(ARCH)
	scripts/wheel build $(ARCH)

wheel-test: ## that wheel in fresh environments without a compiler: the tests of the package, with the oldest and the newest Python (ARGS=python3.12); ARCH=arm64 flies it under qemu
	@scripts/setup python
ifeq ($(ARCH),$(shell dpkg --print-architecture))
	scripts/wheel test $(ARGS)
else
	@scripts/setup deb-test
	@scripts/setup base
	$(CARGO) build $(FLAGS) -p plumbline
	scripts/wheel elsewhere $(ARCH)
endif

wheel-soak: ## that wheel for 10,000 frames: memory stays flat; and what a frame costs beside the same without Python
	@scripts/setup python
	scripts/wheel soak

# What tests skip is collected here, and printed at the end.
export PLUMBLINE_SKIPPED := $(CURDIR)/target/skipped.txt
# The last line of a recipe is $(call tell-skips,COMMAND), which fails as COMMAND does.
tell-skips = status=0; $(1) || status=$$?; scripts/skipped; exit $$status

# What tests start comes while they are compiled; examples of the documentation, one crate after the other, run beside the tests.
test: tools fmt-check deny vendored forget-skips ## format, lints, licences, documentation, and every test but those of time and the soak
	{ scripts/setup programs && scripts/setup python; } >target/setup.log 2>&1 & programs=$$!; \
	status=0; $(MAKE) tests-built || status=$$?; \
	wait $$programs || { cat target/setup.log; exit 1; }; exit $$status
	$(MAKE) doctests >target/doctests.log 2>&1 & doctests=$$!; \
	status=0; $(MAKE) tests || status=$$?; \
	wait $$doctests || { cat target/doctests.log; exit 1; }; exit $$status

forget-skips:
	@mkdir -p target && rm -f $(PLUMBLINE_SKIPPED)

# Each crate of ours is linted, and its documentation built, as it is compiled; tests are compiled with overflow checks and debug
# assertions, what they test beside them is the product.
LINTED = RUSTC_WORKSPACE_WRAPPER=$(CURDIR)/scripts/rustc-clippy
# The Python module has no tests in Rust, and could not be linked to any: it is built for the process tests, which hand it to an
# interpreter. What needs OpenCV or PX4's filter is `make oracle`.
PACKAGES = $(FLAGS) --workspace --exclude plumbline-python --exclude plumbline-oracle --exclude plumbline-boards
TARGETS = --lib --bins --tests --examples
TESTED = $(PACKAGES) $(TARGETS)
# The crates whose dependencies are few, and so built soon.
CHECKED = $(FLAGS) $(addprefix -p plumbline-,config estimator drivers simulator checkup) --all-features --lib --test '*' --examples
TESTS = $(TESTED) -E 'not $(TIMED)'
# Tests that measure time, or use a whole machine: `make realtime`.
TIMED = test(/(^|::)realtime::/)
# The command with faults on purpose, which no product has, in a folder of its own.
FAULTY = $(PACKAGES) --test process --features plumbline/sabotage \
	--target-dir target/faults

tests-built:
	$(LINTED) $(CARGO) nextest run $(TESTS) --no-run

tests:
	$(call tell-skips,$(LINTED) $(CARGO) nextest run $(TESTS) $(ARGS))

doctests: ## the examples in the documentation of the code
	$(LINTED) $(CARGO) test $(PACKAGES) --doc

oracle: setup forget-skips ## beside OpenCV and PX4's filter: projection, tracks, lines, calibration, odometry (CI runs it beside `make test`)
	$(call tell-skips,$(LINTED) $(CARGO) nextest run $(FLAGS) $(OPENCV) -p plumbline-boards -p plumbline-oracle --lib --tests -E 'not $(TIMED)' $(ARGS))

checked: setup ## the tests of configuration, estimator and drivers alone, whose build is short
	$(LINTED) $(CARGO) nextest run $(CHECKED) -E 'not $(TIMED)' $(ARGS)

realtime: setup forget-skips ## the tests that measure time, before a release: nothing else may run on the machine
	$(call tell-skips,$(LINTED) $(CARGO) nextest run $(TESTED) -E '$(TIMED)' $(ARGS))
	$(MAKE) faults

faults: setup forget-skips ## tasks that die or spin, power that fails, a process that is killed: by a build that can (part of `make realtime`)
	$(call tell-skips,$(CARGO) nextest run $(FAULTY) -E 'test(/^sabotage::/)' $(ARGS))

check: forget-skips ## the tests of `make test` alone, without the lints
	@scripts/setup test
	$(call tell-skips,$(CARGO) nextest run $(PACKAGES) -E 'not $(TIMED)' $(ARGS))

lint: setup fmt-check deny clippy ## format, licences and lints, without the tests

soak: setup forget-skips ## long flights: memory, drift of time, restarts (SOAK_MINUTES=30)
	$(LINTED) $(CARGO) nextest run $(FLAGS) --workspace --test places --profile soak --run-ignored only -E 'test(/soak/)' $(ARGS)
	$(call tell-skips,PLUMBLINE_SOAK_MINUTES=$(SOAK_MINUTES) \
		$(LINTED) $(CARGO) nextest run $(FLAGS) $(OPENCV) --workspace --exclude plumbline-python $(TARGETS) --profile soak --run-ignored all -E 'test(/soak/) | test(/^faults::/) | test(/^calibration::/)' $(ARGS))
	$(call tell-skips,PLUMBLINE_SOAK_MINUTES=$(SOAK_MINUTES) \
		$(CARGO) nextest run $(FAULTY) --profile soak --run-ignored all -E 'test(/^sabotage::/)' $(ARGS))

vm: ## drivers of cameras and inertial sensors, and a flight, behind a real kernel in a virtual machine (VM_SECONDS=60)
	@scripts/setup base
	@scripts/vm setup
	PLUMBLINE_VM_SECONDS=$(VM_SECONDS) $(CARGO) test $(FLAGS) -p plumbline-drivers --test vm -- --nocapture --ignored realtime:: $(ARGS)
	PLUMBLINE_VM_SECONDS=$(VM_SECONDS) $(CARGO) test $(FLAGS) -p plumbline --test process -- --nocapture virtual_machine $(ARGS)

loops: setup ## simulated flights of two laps along recorded paths: what loops bring, and what is found (PLUMBLINE_LOOP_SEEDS=1)
	$(LINTED) $(CARGO) nextest run $(PACKAGES) --test system --profile soak --run-ignored only --no-capture -E 'test(/^loops::/)' $(ARGS)

digests: setup ## writes tests/digests.toml anew, after a change of the estimator that is meant
	$(CARGO) nextest run $(PACKAGES) --test process --run-ignored only -E 'test(=digests::record_digests)' $(ARGS)
	@git --no-pager diff --stat -- tests/digests.toml

fuzz: ## runs a fuzz target, guided by coverage: TARGET=config_toml SECONDS=60
	@scripts/fuzz "$(TARGET)" "$(SECONDS)"

fuzz-all: ## every fuzz target in turn, SECONDS each
	@scripts/fuzz all "$(SECONDS)"

fuzz-smoke: ## every fuzz target for 5000 runs; `make test` runs their seeds and mutations of them without this build
	@scripts/fuzz all runs=5000

bench: setup ## benchmarks of the stages
	$(CARGO) bench --locked $(OPENCV) -p plumbline-oracle $(ARGS)

bench-instructions: ## instructions of a frame by stage against tests/instructions.json (ARGS=--save writes them anew; needs valgrind)
	@scripts/setup base
	@scripts/bench-instructions $(ARGS)

count-arm64: ## instructions of a frame on 64-bit ARM by kind, counted under qemu
	@scripts/setup count-arm64
	@scripts/count-arm64

bench-against: ## times of a frame against another revision, in turns: REV=d8cfd9a
	@scripts/setup base
	@scripts/bench-against $(REV) $(ARGS)

fmt: ## format the sources
	$(CARGO) fmt --all

doc: ## the documentation of the code
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc $(FLAGS) --workspace --no-deps

clean: ## remove what was built
	$(CARGO) clean

setup: ## install what tests and lints need
	@scripts/setup test

tools:
	@scripts/setup tools

fmt-check:
	$(CARGO) fmt --all --check

clippy:
	$(CARGO) clippy $(FLAGS) $(OPENCV) --workspace --all-targets -- -D warnings
	$(CARGO) clippy $(FLAGS) $(OPENCV) --workspace --features plumbline/calibration -- -D warnings

# Advisories are apart: their database is not on crates.io, and changes from day to day.
deny:
	$(CARGO) deny --workspace --locked check bans licenses sources

vendored: ## the mended copies of Zenoh's crates are the published ones with their patches
	scripts/vendored

advisories: setup ## known vulnerabilities of the dependencies, but those listed with a reason in deny.toml (needs github.com)
	$(CARGO) deny --workspace --locked check advisories
