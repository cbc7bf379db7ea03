# make            set everything up in .venv and print scenarios/cylinder.toml
# make test       lint, C and Python tests
# make test-long  the proofs that take minutes
# make benchmarks measured comparisons, printed as ratios
# make benchmarks-hardware  a layer on the emulated bench, beside the time of its frames on a real bus
# make peers      docs/reference/peers.md: the loop in masters of other people
# make fuzz       twenty minutes of libFuzzer on the inputs of the firmware and the calls of the FMUs
# make sanitize   all FMUs under sanitizers (about ten minutes)
# make firmware-cortex-m  the emulated bench as an image for a Cortex-M3, with its size
# make tools      compilers, emulators and masters of others that some tests use and skip without (Debian)
# make gallery    docs/gallery: every scenario with one picture; the pictures of docs/explanation
PYTHON ?= python3.11
BIN    := .venv/bin
# what decides about the compiled parts: C sources, their tables, and the modules that run while building
BUILD_MODULES := $(wildcard cosim/inkloop/fmu_writer/*.py) \
                 $(addprefix hardware/inkloop_hardware/protocol/,c_codec.py inkloop.dbc)
PIP    := $(PYTHON) -m pip --python $(BIN)/python install --quiet --disable-pip-version-check

.PHONY: run test lint format test-long benchmarks benchmarks-hardware peers fuzz sanitize firmware-cortex-m tools gallery clean
run: .venv/installed
	$(BIN)/inkloop run scenarios/cylinder.toml

.venv/installed: pyproject.toml CMakeLists.txt $(shell find fmus controller/core hardware/firmware -type f -not -path '*/fuzz/*') $(BUILD_MODULES)
	@command -v $(PYTHON) >/dev/null || { echo "inkloop needs $(PYTHON) (or: make PYTHON=/path/to/python)"; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv --without-pip .venv
	@echo "installing into .venv: two to four minutes the first time ..."
	$(PIP) 'scikit-build-core>=0.11' 'fmpy>=0.3.29' 'cantools>=45'
	$(PIP) --no-build-isolation --editable '.[dev]'
	@touch $@

test: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile

lint: .venv/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run --Werror $(shell git ls-files '*.c' '*.h')

format: .venv/installed
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(shell git ls-files '*.c' '*.h')

test-long: .venv/installed
	$(BIN)/python -m pytest -m long -n 2 --dist loadfile

benchmarks: .venv/installed
	$(BIN)/python -m benchmarks

benchmarks-hardware: .venv/installed
	$(BIN)/python -m benchmarks hardware bench_faults

peers: .venv/installed
	$(PIP) 'ecospy>=0.7.2'   # of use nowhere else; it also needs libtbb12
	$(BIN)/python tests/support/masters/java_programs.py
	PYTHONPATH=tests $(BIN)/python tools/figures/peers.py

sanitize: .venv/installed
	$(BIN)/python -m pytest -m long -n 2 tests/contract/test_fmu_sanitizers.py tests/unit/controller/core/test_search_threads.py

fuzz: .venv/installed
	$(BIN)/python tests/support/fmus/fuzzing.py

firmware-cortex-m: .venv/installed
	@if command -v arm-none-eabi-gcc >/dev/null; then $(MAKE) --no-print-directory -C hardware/firmware/cortex_m; \
	else echo "arm-none-eabi-gcc is not installed: the firmware was not compiled for a Cortex-M; make tools"; fi

# what some tests use and skip without: the firmware on a Cortex-M, libFuzzer, binaries for Windows, masters of others
TOOLS := gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm clang \
         gcc-mingw-w64-x86-64 wine64 libtbb12 default-jre-headless
tools:
	@if command -v apt-get >/dev/null; then apt-get install --yes --no-install-recommends $(TOOLS); \
	else echo "install with your own package manager what Debian calls: $(TOOLS)"; fi
	$(PYTHON) tests/support/masters/java_programs.py

# every scenario with one picture, docs/gallery; pictures and tables of docs/explanation
gallery: .venv/installed
	$(BIN)/python tools/figures/gallery.py
	$(BIN)/python tools/figures/layer_problem.py
	$(BIN)/python tools/figures/height_maps.py
	$(BIN)/python tools/figures/modelica_library.py
	$(BIN)/python tools/figures/identified_ink.py
	$(BIN)/python tools/figures/the_papers.py

clean:
	rm -rf build .venv
