# make            set everything up in .venv and print scenarios/cylinder.toml
# make check      format, types, and every unit test that needs no compiler, process, bench or whole print: minutes
# make test       everything that continuous integration runs; names each test that is skipped
# make test-long  the proofs that take minutes, the properties with random examples, and the FMUs in INKLOOP_REFERENCE_FMUS
# make benchmarks measured comparisons, next to floors and peers, for docs/reference/performance.md
# make peers      the loop in masters of others, the Modelica library in compilers of others, the nodes under scanners of
#                 others; with OMSimulator on the PATH, JModelica in JMODELICA_HOME, cofmupy in COFMUPY_HOME, where there are any
# make fuzz       twenty minutes of libFuzzer on the inputs of the firmware and the calls of the FMUs
# make sanitize   all FMUs under sanitizers (about ten minutes)
# make firmware-cortex-m  the emulator as an image for a Cortex-M3, with its size
# make tools      compilers, emulators and masters of others that some tests use and skip without (Debian)
# make site       build/site: all pages as HTML with search, to be read without a network; a warning or a dead link is an error
# make release    build/release: sdist, a wheel for each platform, SHA-256 sums, SBOM; PLATFORMS="x86_64-linux ..." for some
# make figures    tables and pictures of pages that come from the code, from scenarios and from the papers
# make weight     lines, words, modules, packages, commands: the size of the project
# make upgrade    the newest packages that pyproject.toml allows, into .venv; then make check test test-long constraints
# make constraints  constraints.txt: the versions in .venv, which make installs
# make clean      remove .venv and build
BIN := .venv/bin

# PYTHON=/path/to/python chooses the Python of a new .venv; else the first of these that is new enough.
IS_NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 11))
ifndef PYTHON
PYTHON := $(shell for each in python3 python3.13 python3.12 python3.11; do \
                    $$each -c '$(IS_NEW_ENOUGH)' 2>/dev/null && echo $$each && break; done)
endif
# .venv has no pip of its own: where .venv is activated, the Python that it was made from.
MADE_FROM := import os, sys; print(sys._base_executable if os.path.realpath(sys.prefix) == os.path.realpath(".venv") else "")
override PYTHON := $(or $(shell "$(PYTHON)" -c '$(MADE_FROM)' 2>/dev/null),$(PYTHON))
PIP := $(PYTHON) -m pip --python $(BIN)/python install --disable-pip-version-check --no-compile --constraint constraints.txt

# what decides about the compiled parts: C sources, their tables, and the modules that run while building
BUILD_MODULES := $(wildcard cosim/inkloop/fmu_writer/*.py) \
                 $(addprefix hardware/inkloop_hardware/protocol/,c_codec.py inkloop.dbc)
C_FILES := $(shell find controller cosim fmus hardware tests -name '*.[ch]')

# Compiled modules are kept, whatever the environment says: the tests start hundreds of processes that import them.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run check test lint format test-long benchmarks peers fuzz sanitize firmware-cortex-m tools site release figures weight \
        upgrade constraints clean
run: .venv/installed
	@echo "inkloop: printing scenarios/cylinder.toml (about ten seconds) ..."
	$(BIN)/inkloop run scenarios/cylinder.toml

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "inkloop needs Python 3.11 or later, and no python3 here is that new; \
	install one, or: make PYTHON=/path/to/python"; exit 1; }
	@command -v "$(PYTHON)" >/dev/null || { echo "there is no $(PYTHON); inkloop needs Python 3.11 or later"; exit 1; }
	@"$(PYTHON)" -c '$(IS_NEW_ENOUGH)' || { echo "$(PYTHON) is $$("$(PYTHON)" --version 2>&1); \
	inkloop needs Python 3.11 or later: make PYTHON=/path/to/python"; exit 1; }
	@"$(PYTHON)" -m pip --version >/dev/null 2>&1 || { echo "$(PYTHON) has no pip: install it (Debian: python3-pip)"; exit 1; }
	@command -v "$${CC:-cc}" >/dev/null || { echo "there is no C compiler ($${CC:-cc}): install gcc or clang"; exit 1; }
	"$(PYTHON)" -m venv --without-pip .venv   # which Debian has without a further package

# what the build, a print, its pictures and the formats of files need, and pip for the extras that messages name
.venv/requirements: pyproject.toml constraints.txt | $(BIN)/python
	@echo "inkloop: downloading and installing what a print needs into .venv (250 MB; half a minute after the downloads) ..."
	@$(BIN)/python -c 'import tomllib; file = tomllib.load(open("pyproject.toml", "rb")); \
	extras = file["project"]["optional-dependencies"]; \
	print(*file["build-system"]["requires"], *file["project"]["dependencies"], *extras["report"], *extras["formats"], "pip", sep="\n")' \
	> $@.txt
	$(PIP) --requirement $@.txt
	@touch $@

.venv/installed: .venv/requirements CMakeLists.txt \
                 $(shell find fmus controller/core cosim/columns hardware/firmware -type f) $(BUILD_MODULES)
	@echo "inkloop: compiling the FMUs, the controller and the emulator (about half a minute the first time) ..."
	$(PIP) --quiet --no-deps --no-build-isolation --editable .
	@touch $@

# what tests and checks need in addition
.venv/developer: .venv/installed
	@echo "inkloop: downloading and installing what the tests need into .venv (half a minute after the downloads) ..."
	$(PIP) --quiet 'inkloop[dev]'   # inkloop itself is there; its extras are missing
	@touch $@

check: lint
	INKLOOP_EXAMPLES_PERCENT=20 $(BIN)/python -m pytest -n 2 --dist loadfile -m 'not long and not system and not compiled' tests/unit

test: lint
	INKLOOP_EXAMPLES_PERCENT=20 $(BIN)/python -m pytest -n 2 --dist loadfile

lint: .venv/developer
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run --Werror $(C_FILES)

format: .venv/developer
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(C_FILES)

test-long: .venv/developer
	$(BIN)/python -m pytest -m 'long or hypothesis' --hypothesis-profile=random -n 2 --dist loadfile

benchmarks: .venv/developer
	$(PIP) 'numba>=0.66'   # of use nowhere else
	-$(PIP) 'embreex>=4.4'   # nor is this; there are wheels for some platforms only, and what follows runs without it
	$(BIN)/python -m tools.figures performance

CARINGCARIBOU := caringcaribou @ git+https://github.com/CaringCaribou/caringcaribou@092eff3c2c95bb7952a2a92ac12b6c1c29035b70
peers: .venv/developer
	$(PIP) 'ecospy>=0.7.2' 'scapy>=2.6'   # of use nowhere else; the first one also needs libtbb12
	-$(PIP) '$(CARINGCARIBOU)'   # not on PyPI; what follows runs without it too
	$(BIN)/python tests/support/masters/java_programs.py
	$(BIN)/python -m pytest -m "long or not long" -n 2 tests/system/test_other_masters.py tests/system/test_uds_scan.py \
	tests/unit/kernels/test_modelica_library.py

sanitize: .venv/developer
	$(BIN)/python -m pytest -m long -n 2 tests/contract/test_fmu_sanitizers.py tests/unit/controller/core/test_core_threads.py

fuzz: .venv/developer
	PYTHONPATH=tests $(BIN)/python -m support.fmus.fuzzing $(TARGETS)

firmware-cortex-m: .venv/developer
	@if command -v arm-none-eabi-gcc >/dev/null; then $(MAKE) --no-print-directory -C hardware/firmware/cortex_m; \
	else echo "arm-none-eabi-gcc is not installed: the firmware was not compiled for a Cortex-M; make tools"; fi

# what some tests use and skip without: the firmware on a Cortex-M, libFuzzer, binaries for other platforms, masters of others,
# a kernel with SocketCAN as a process, a browser, JavaScript without one
TOOLS := gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm clang libclang-rt-dev \
         qemu-user-static libc6-arm64-cross wine64 libtbb12 default-jre-headless user-mode-linux can-utils iproute2 kmod chromium \
         nodejs
tools: .venv/developer
	@if command -v apt-get >/dev/null; then apt-get install --yes --no-install-recommends $(TOOLS); \
	else echo "install with your own package manager what Debian calls: $(TOOLS)"; fi
	$(PIP) 'inkloop[cross,dask]'
	$(PYTHON) tests/support/masters/java_programs.py

# Everything is read and written afresh: a page that is gone leaves nothing.
site: .venv/developer
	rm -rf build/site
	$(BIN)/python -m sphinx --fresh-env --fail-on-warning --keep-going --quiet \
	--conf-dir tools/site --doctree-dir build/site-doctrees . build/site
	@echo "inkloop: open build/site/index.html"

# All C by zig, on this machine, for every platform; the first time zig also compiles the C library of each, which takes minutes.
release: .venv/developer
	$(PIP) --quiet 'inkloop[release]'
	$(BIN)/python -m tools.release $(PLATFORMS)

# NAMES="house gallery/cylinder" takes some of them; NAMES="--written" runs nothing and writes the pages from the records
figures: .venv/developer
	$(BIN)/python -m tools.figures $(NAMES)

weight: .venv/installed
	@$(BIN)/python tools/weight.py

# Without constraints: the newest packages, to be tested before `make constraints` keeps their versions.
upgrade: .venv/developer
	$(subst --constraint constraints.txt,,$(PIP)) --upgrade --upgrade-strategy eager --no-build-isolation \
	--requirement .venv/requirements.txt --editable '.[dev]'

constraints: .venv/developer
	@{ echo "# Versions that the tests passed with, on every Python of the project; written by make constraints."; \
	$(PYTHON) -m pip --python $(BIN)/python freeze --all $(addprefix --exclude ,inkloop ecospy scapy caringcaribou); } > constraints.txt

clean:
	rm -rf build .venv
