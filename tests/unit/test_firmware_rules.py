"""Limits of a microcontroller: no memory taken, no global state, no operating system, the numbers of the DBC."""

from __future__ import annotations

import re
import shutil
import subprocess
from graphlib import TopologicalSorter
from pathlib import Path

import cantools
import pytest

from support.benches.node_bench import CORE, FIRMWARE, PLACES, ROOT, STRICT, WIRE, codec, firmware_objects
from support.compiled import object_of

ALL = [*CORE, *WIRE]
HOST_ONLY = sorted((FIRMWARE / "host").rglob("*.c"))
HEADER_FILES = [path for name in ("node", "can") for path in sorted((FIRMWARE / name).glob("*.h"))]
GENERATED = {"inkloop.h", "inkloop_protocol.h"}
HEADERS = {"stdbool.h", "stddef.h", "stdint.h", "string.h"}


@pytest.fixture(scope="module")
def symbols() -> dict[Path, list[tuple[str, str]]]:
    """(kind, name) of every symbol of each compiled source."""
    found, sources = {}, (*ALL, *HOST_ONLY)
    for source, path in zip(sources, firmware_objects(sources), strict=True):
        listed = subprocess.run(["nm", path], capture_output=True, text=True, check=True).stdout
        found[source] = [(line.split()[-2], line.split()[-1]) for line in listed.splitlines()]
    return found


@pytest.mark.compiled
def test_firmware_asks_for_nothing_but_bytes_to_be_copied(symbols: dict[Path, list[tuple[str, str]]]) -> None:
    """So it takes no memory after it was linked, and reads no clock and no file."""
    found = [symbol for source in ALL for symbol in symbols[source]]
    defined = {name for kind, name in found if kind != "U"}
    asked = {name for kind, name in found if kind == "U"} - defined - {"_GLOBAL_OFFSET_TABLE_"}
    assert "node_tick" in defined
    asked -= {name for name in asked if name.startswith("inkloop_")}  # the generated codec
    assert asked <= {"memcpy", "memset", "memcmp", "memmove", "__stack_chk_fail"}


@pytest.mark.compiled
def test_firmware_has_no_global_that_changes(symbols: dict[Path, list[tuple[str, str]]]) -> None:
    for source in ALL:
        assert not [name for kind, name in symbols[source] if kind in "BbDdCGgSs"], source


def test_firmware_includes_itself_and_the_freestanding_headers_only() -> None:
    own = {path.name for path in HEADER_FILES}
    for source in (*ALL, *HEADER_FILES):
        found = set(re.findall(r'#\s*include\s*[<"]([^">]+)', source.read_text(encoding="utf-8")))
        assert found <= own | HEADERS | GENERATED, source


def test_node_knows_no_frame() -> None:
    """Requests and answers are byte strings; only `node_frames.c` carries them."""
    wire = {"can_frame.h", "e2e.h", "e2e_monitor.h", "isotp.h", "slcan.h", "node_frames.h", *GENERATED}
    for source in CORE:
        for path in (source, source.with_suffix(".h")):
            assert not wire & set(re.findall(r'#\s*include\s*[<"]([^">]+)', path.read_text(encoding="utf-8"))), path


def unit(path: Path) -> str:
    """A source and its header are one."""
    return f"{path.parent.name}/{path.stem}"


@pytest.mark.compiled
def test_no_circle_joins_the_files_of_the_firmware(symbols: dict[Path, list[tuple[str, str]]]) -> None:
    """Neither by includes nor by calls, of the node and its frames as of the emulator and the image."""
    headers = {path.name: path for path in sorted(FIRMWARE.rglob("*.h"))}
    needs: dict[str, set[str]] = {}
    for path in (*headers.values(), *ALL, *HOST_ONLY, *(FIRMWARE / "cortex_m").glob("*.c")):
        found = re.findall(r'#include "(.*?)"', path.read_text(encoding="utf-8"))
        needs.setdefault(unit(path), set()).update(unit(headers[name]) for name in found if name in headers)
    owner = {name: source for source, listed in symbols.items() for kind, name in listed if kind in "TR"}
    for source, listed in symbols.items():
        needs[unit(source)].update(unit(owner[name]) for kind, name in listed if kind == "U" and name in owner)
    for name, below in needs.items():
        below.discard(name)
    assert needs["node/node"] >= {"node/interlocks", "node/steps", "node/services"}
    TopologicalSorter(needs).prepare()


@pytest.mark.compiled
def test_only_node_c_switches_everything_off(symbols: dict[Path, list[tuple[str, str]]]) -> None:
    """And sets SAFE and FAULT, in one function with one caller; all other parts return a cause."""
    callers = {source.stem for source in CORE if ("U", "interlocks_all_off") in symbols[source]}
    assert callers == {"node"}
    texts = {source.stem: source.read_text(encoding="utf-8") for source in CORE}
    assert {stem for stem, text in texts.items() if re.search(r"\bNODE_(SAFE|FAULT)\b", text)} == {"node", "node_state"}
    assert len(re.findall(r"\bde_energise\(", texts["node"])) == 2  # its definition and its call in enforce


def test_every_source_of_the_firmware_is_checked_here() -> None:
    elsewhere = ("host", "cortex_m")
    assert {path for path in FIRMWARE.rglob("*.c") if path.relative_to(FIRMWARE).parts[0] not in elsewhere} == set(ALL)


@pytest.mark.parametrize(("signal", "prefix"), [("State", "NODE_"), ("Fault", "CAUSE_")])
def test_states_and_faults_are_numbered_as_in_the_dbc(signal: str, prefix: str) -> None:
    dbc = cantools.database.load_file(ROOT / "hardware" / "inkloop_hardware" / "protocol" / "inkloop.dbc")
    choices = dbc.get_message_by_name("HeadStatus").get_signal_by_name(signal).choices
    text = (FIRMWARE / "node" / "node_state.h").read_text(encoding="utf-8")
    numbers: dict[int, str] = {}
    for name, number in re.findall(rf"^    {prefix}(\w+)(?: = (\d+))?[,\n]", text, re.MULTILINE):
        numbers[int(number) if number else max(numbers, default=-1) + 1] = name
    assert numbers == {number: str(name) for number, name in choices.items()}


def test_every_cause_is_given_somewhere() -> None:
    """So the value table of the DBC promises nothing that no node does."""
    text = (FIRMWARE / "node" / "node_state.h").read_text(encoding="utf-8")
    causes = set(re.findall(r"^    (CAUSE_\w+)", text, re.MULTILINE))
    given = "".join(source.read_text(encoding="utf-8") for source in CORE)
    assert causes
    assert causes == set(re.findall(r"(?:return|[?:]) (CAUSE_\w+)\b", given))


@pytest.mark.compiled
@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="arm-none-eabi-gcc is not installed")
def test_firmware_compiles_for_a_cortex_m3() -> None:
    flags = ("-mcpu=cortex-m3", "-mthumb", *STRICT, "-Wconversion", *PLACES, f"-I{codec()}")
    for source in ALL:
        assert object_of(source, flags, "arm-none-eabi-gcc").stat().st_size > 0
