"""All FMUs built once more from their own sources with sanitizers, to find errors that the shipped ones hide.

The contract suite under the address and undefined-behaviour sanitizers; whole lives and fuzzed calls without a leak;
four instances at once under the thread sanitizer. `make sanitize` runs this file.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from support.compiled import sanitizer_libraries
from support.fmus import fmu_library
from support.fmus.fmu_library import FORMS, NAMES, Library, drawn, feed
from support.places import ROOT

pytestmark = [
    pytest.mark.long,
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform != "linux" or not shutil.which("gcc"), reason="gcc for Linux is not installed"),
]
TESTS = (
    *("fmu_state", "fmu_handshake", "fmu_flags", "fmu_fuzz", "fmu_archive"),
    *("layer_controller_fmu", "component_contract", "closed_loop", "layer_job_fmu"),
)
ABOUT_THE_SHIPPED_BINARY = (
    "binary_has_the_standards_functions",
    "sources_compile",
    "checks_detect_broken",
    "calls_follow_the",
)
ADDRESS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
THREAD = ("-fsanitize=thread",)


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Library]:
    """Every library with the address and undefined-behaviour sanitizers."""
    folder = tmp_path_factory.mktemp("address")
    return dict(zip(NAMES, fmu_library.all_rebuilt(fmu_library.PAIRS, folder, "gcc", ADDRESS), strict=True))


def test_contract_suite_is_clean_under_the_address_sanitizer(checked: dict[str, Library], tmp_path: Path) -> None:
    """Leaks are looked for below: Python itself leaves much behind."""
    libraries = sanitizer_libraries()
    if libraries is None:
        pytest.skip("gcc with its address sanitizer for Linux is not installed")
    fmu_library.packed(list(checked.values()), tmp_path)
    chosen = {"INKLOOP_FMU_DIR": str(tmp_path), "LD_PRELOAD": libraries, "ASAN_OPTIONS": "detect_leaks=0"}
    others = " and ".join(f"not {name}" for name in ABOUT_THE_SHIPPED_BINARY)
    options = ["-q", "-x", "-p", "no:cacheprovider", "-k", others]
    command = [sys.executable, "-m", "pytest", *options, "tests/system/test_own_loop.py"]
    command += [f"tests/contract/test_{name}.py" for name in TESTS]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | chosen, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-5000:]


@pytest.fixture(scope="module")
def lives(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Library, tuple[str, ...]], str]:
    """Runs four instances in parallel, then one after the other; their findings, '' if none."""
    folder = tmp_path_factory.mktemp("lives")
    programs: dict[tuple[str, ...], Path] = {}

    def live(built: Library, flags: tuple[str, ...]) -> str:
        if flags not in programs:
            place = folder / str(len(programs))
            place.mkdir()
            programs[flags] = fmu_library.program(place, "side_by_side", "gcc", flags)
        table = fmu_library.write_table(built, folder / f"{built.model}-{built.form}.txt")
        done = subprocess.run([programs[flags], table], capture_output=True, text=True, check=False)
        return "" if done.returncode == 0 else done.stderr or f"ended with {done.returncode}"

    return live


@pytest.mark.parametrize("name", NAMES)
def test_whole_lives_leave_no_memory_behind(name, checked, lives) -> None:
    assert not lives(checked[name], ADDRESS)


@pytest.mark.parametrize("name", NAMES)
def test_four_instances_in_four_threads_share_nothing(name, lives, tmp_path) -> None:
    """And print what they print one after the other."""
    model, form = name.split("-")
    assert not lives(fmu_library.rebuilt(model, form, tmp_path, "gcc", THREAD), THREAD)


@pytest.mark.parametrize("flags", [ADDRESS, THREAD], ids=["address", "thread"])
@pytest.mark.parametrize("model", ["LayerDeposition", "LayerController"])
def test_loops_without_clones_are_clean_too(model, flags, lives, tmp_path) -> None:
    """The library for a processor without AVX2; the libraries above take AVX2 where this one has it."""
    baseline = (*flags, "-DINKLOOP_BASELINE")
    assert not lives(fmu_library.rebuilt(model, FORMS[0], tmp_path, "gcc", baseline), flags)


@pytest.mark.parametrize("name", NAMES)
def test_fuzzed_calls_leave_no_memory_behind(name, checked, tmp_path) -> None:
    feed(
        fmu_library.calls_program(tmp_path, ADDRESS),
        fmu_library.write_table(checked[name], tmp_path / "table.txt"),
        drawn(name),
    )


def edited(folder: Path, file: str, old: str, new: str) -> None:
    """A fault on purpose in the sources of an unpacked LayerDeposition."""
    source = fmu_library.unpacked("LayerDeposition", "fmi3", folder) / "sources" / file
    text = source.read_text()
    assert text.count(old) == 1
    source.write_text(text.replace(old, new))


COUNTING = "static void count_droplets(const LayerHandshake *h) {"


@pytest.mark.parametrize(
    ("flags", "fault", "message"),
    [
        (ADDRESS, ("storage.c", "    free(instance->block);\n", ""), "LeakSanitizer"),
        (
            ADDRESS,
            ("storage.c", "calloc(sized.saved_size, 1)", "calloc(sized.saved_size / 2, 1)"),
            "AddressSanitizer",
        ),
        (
            ADDRESS,
            ("layer_handshake.c", COUNTING, f"{COUNTING}\n    (void)(*h->nx << (62 + *h->nx));"),
            "runtime error",
        ),
        (
            ADDRESS,
            ("layer_handshake.c", COUNTING, f"{COUNTING}\n    h->height[*h->nx * *h->ny] = 0;"),
            "use-after-poison",
        ),
        (THREAD, ("layer_handshake.c", COUNTING, f"static long counted;\n{COUNTING}\n    counted++;"), "data race"),
    ],
)
def test_sanitizers_detect_planted_faults(flags, fault, message, lives, tmp_path) -> None:
    """A leak, a block too short, a shift beyond the word, a cell beyond its map, a counter that all instances share."""
    edited(tmp_path, *fault)
    built = fmu_library.rebuilt("LayerDeposition", FORMS[0], tmp_path, "gcc", flags)
    assert message in lives(built, flags)
