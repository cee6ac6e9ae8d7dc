# make demo and make test need only Python >= 3.11 and make: each builds .venv first, once.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PYTEST_ARGS ?=
TEST_PROCESSES ?= 2
FUZZ_SECONDS ?= 60
SOAK_MINUTES ?= 120
REFERENCE_FUZZ_SECONDS ?= 20

.PHONY: help demo docs test test-slow test-usb test-usb-all test-page mutants firmware-mutants reference lint format vectors fuzz soak bench bench-peers clean
.DEFAULT_GOAL := help

help:            ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 14

demo: $(VENV)/ready          ## a sphere on a palm, through five emulated boards, back to pressure
	@$(BIN)/phasewire demo

test: $(VENV)/ready          ## the tests, without the slow ones
	@$(BIN)/pytest -q -n $(TEST_PROCESSES) --dist worksteal -m "not slow and not guest and not page" $(PYTEST_ARGS)

test-slow: $(VENV)/ready     ## the tests that take seconds each
	@$(BIN)/pytest -q -n $(TEST_PROCESSES) --dist worksteal -m "slow and not guest and not page" $(PYTEST_ARGS)

test-usb: $(VENV)/ready      ## a Linux kernel in QEMU uses the emulated device; it needs packages of Debian (see .ci/run)
	@timeout --foreground --kill-after=60 1800 $(BIN)/pytest -q -rs -n 0 -m "guest and not guest_slow and not guest_newest" tests/guest $(PYTEST_ARGS)

test-usb-all: $(VENV)/ready  ## the same on a newer kernel too, and the tests that take longer
	@timeout --foreground --kill-after=60 7200 $(BIN)/pytest -q -rs -n 0 -m "guest and not (guest_slow and guest_newest)" tests/guest $(PYTEST_ARGS)

test-page: $(VENV)/browser    ## the live page and the documents' site in a real Chromium, which must be installed
	@$(BIN)/pytest -q -rs -n 0 -m page tests/view tests/test_site.py $(PYTEST_ARGS)

fuzz: $(VENV)/fuzz           ## give random bytes to every decoder, FUZZ_SECONDS (60) for each group of decoders
	@$(BIN)/python -m tests.fuzz $(FUZZ_SECONDS)

soak: $(VENV)/ready          ## a stream with random faults, SOAK_MINUTES (120) of the device's time
	@$(BIN)/python -m tests.soak --minutes $(SOAK_MINUTES)

mutants: $(VENV)/ready       ## the conformance suite against every broken emulator, in some minutes
	@$(BIN)/phasewire conformance --mutants --jobs $(TEST_PROCESSES)

firmware-mutants: $(VENV)/ready ## the conformance suite against the chain processors' firmware, broken in many ways, in some minutes
	@$(BIN)/python -m phasewire.hil.conformance.mutants.processors

reference: $(VENV)/ready     ## the reference device in C: unit tests, sanitizers, a Cortex-M33, fuzzing, and bugs that the suite must catch
	@$(MAKE) -s -j $(TEST_PROCESSES) -O -C firmware check
	@$(MAKE) -s -j $(TEST_PROCESSES) -C firmware posix
	@if command -v arm-none-eabi-gcc qemu-system-arm >/dev/null; then $(MAKE) -s -j $(TEST_PROCESSES) -O -C firmware/cortex_m33 test size instructions; \
		else echo "no Cortex-M33: that needs arm-none-eabi-gcc, its C library and qemu-system-arm"; fi
	@$(MAKE) -s -j $(TEST_PROCESSES) -C firmware fuzz FUZZ_SECONDS=$(REFERENCE_FUZZ_SECONDS)
	@$(BIN)/python -m phasewire.hil.conformance.mutants.core

docs: $(VENV)/ready          ## the documents as a site, in build/docs/index.html; a broken link is an error
	@$(BIN)/python -m sphinx -q -W --keep-going -b html -c docs . build/docs
	@echo "build/docs/index.html"

lint: $(VENV)/ready          ## style, types, the import rules, and the English of texts
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/mypy tests benchmarks examples firmware/python firmware/tests
	@$(BIN)/lint-imports --no-cache
	@$(BIN)/python tests/style.py

format: $(VENV)/ready        ## format the code
	@$(BIN)/ruff check --fix .
	@$(BIN)/ruff format .

vectors: $(VENV)/ready       ## write protocol/vectors.json again
	@$(BIN)/phasewire vectors --output protocol/vectors.json

bench: $(VENV)/ready         ## the benchmarks; run them on a quiet machine
	@OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -q benchmarks $(PYTEST_ARGS)
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/solver.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/contact.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/scaling.py
	@$(BIN)/python benchmarks/sweeps.py
	@$(BIN)/python benchmarks/gpu.py
	@$(BIN)/python benchmarks/protocol.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/emulator.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/executed.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/streaming.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/touch.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/view.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/rendering.py --levels
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/feel.py
	@OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 $(BIN)/python benchmarks/hearing.py

bench-peers: $(VENV)/ready   ## comparison with autd3 and its emulators, acoustools and levitate, each in .peers (2 GB, made once)
	@$(BIN)/python benchmarks/peers/run.py
	@$(BIN)/python benchmarks/peers/run_emulation.py
	@$(BIN)/python benchmarks/peers/run_streaming.py

clean:           ## remove .venv, .peers and everything built
	rm -rf $(VENV) .peers build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis

$(VENV)/ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "phasewire needs Python 3.11 or newer; this is " + sys.version.split()[0] + ". Try: make PYTHON=python3.12 $(MAKECMDGOALS)")'
	@echo "Setting up $(VENV) (once) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

$(VENV)/fuzz: $(VENV)/ready
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --only-binary atheris --editable '.[fuzz]' \
		|| { echo "make fuzz needs atheris, which has wheels for Linux and Python 3.11 to 3.13"; exit 1; }
	@touch $@

$(VENV)/browser: $(VENV)/ready
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[browser]'
	@touch $@
