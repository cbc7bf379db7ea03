"""Tables of peers.md: `make peers`."""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tools.figures.pages import DOCS, Texts, block, read_json, table, write_json

from inkloop.errors import InkloopError
from inkloop.fmu import describe
from inkloop.fmu_writer.export import find_fmu
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.protocol.vocabulary import Node
from support.fmus.fmu_checkers import CHECKERS
from support.fmus.fmu_driver import FORMS, MODELS
from support.fmus.modelica_compilers import COMPILERS, FILES
from support.fmus.modelica_compilers import MODELS as LIBRARY_MODELS
from support.masters.loops import ONE_BLOCK, THREE_FMUS, Loop
from support.masters.other_masters import MASTERS, Master, layers_by
from support.masters.other_programs import CARINGCARIBOU, SCAPY
from support.masters.six_by_six import STEPS_S, TEXT, difference, our_run, scenario_in
from support.masters.uds_scanners import by_caringcaribou, by_scapy, servers_by_caringcaribou

PAGE = DOCS / "reference" / "peers.md"
RECORD = PAGE.with_suffix(".json")
LOOPS = {"three FMUs": THREE_FMUS, "one block": ONE_BLOCK}
HEADS = ("master", "version", "FMI", "algorithm", "starts from", *(f"step {step_s:g} s" for step_s in STEPS_S))
CHECKER_HEADS = ("checker", "version", "FMUs", "found")
FOUND_HEADS = ("services", "identifiers", "routines", "refusals", "wrong answers")
COMPILER_HEADS = ("compiler", "version", "files read", "models compiled", "models run", "messages")
SCAN_HEADS = ("scanner", "version", "node", "requests", *FOUND_HEADS)
SCANNED_IDENTIFIERS = (*range(0x0200), *range(0xF180, 0xF1A0))
SCANNED_ROUTINES = range(0x01FF, 0x020A)
SERVER_HEADS = ("version", "requests to", "answers from", "services", "identifiers")
DISCOVERED, DUMPED = range(0x630, 0x660), range(0x0200)


def outcome(master: Master, loop: Loop, fmi: str, algorithm: str, step_s: float, ours: Any) -> str:
    """ "equal", or a message with the difference."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = layers_by(master, loop, fmi, algorithm, step_s, Path(folder))
        except (InkloopError, RuntimeError, OSError, ValueError) as error:
            return f"stopped: {error}"
    return difference(found, loop.layers_of(ours)) or "equal"


def results(loop: Loop, ours: Any, masters: Sequence[Master]) -> Iterator[list[str]]:
    """One row for each way of running a master; stderr names each as it runs, since some take minutes."""
    for master in masters:
        absent = master.program.reason_it_is_absent()
        release = "-" if absent else master.program.version
        for fmi, algorithm in master.forms_of(loop):
            print(f"{loop.name} by {master.name}, FMI {fmi}, {algorithm}", file=sys.stderr)
            found = [absent or outcome(master, loop, fmi, algorithm, step_s, ours) for step_s in STEPS_S]
            yield [master.name, release, fmi, algorithm, master.starts_from, *found]


def checks(blocks: Sequence[Path]) -> Iterator[list[str]]:
    """One row for each checker, on the FMUs of the package and on blocks of a print."""
    for checker in CHECKERS:
        if absent := checker.program.reason_it_is_absent():
            yield [checker.name, "-", "-", absent]
            continue
        files = [find_fmu(model, form) for form in FORMS if form[3] in checker.versions for model in MODELS]
        files += [block for block in blocks if describe(block).fmi in map(int, checker.versions)]
        faults = [f"{file.parent.name}/{file.name}: {text}" for file in files for text in checker.check(file)]
        yield [checker.name, checker.program.version, f"{len(files)}", "<br>".join(faults) or "nothing"]


def scans() -> Iterator[list[str]]:
    """One row for each node of the emulator."""
    if absent := SCAPY.reason_it_is_absent():
        yield [absent, *("-" for _ in SCAN_HEADS[1:])]
        return
    for node in Node:
        print(f"{node} by scapy", file=sys.stderr)
        with EmulatedBench({}) as bench:
            scan = by_scapy(bench.channel, node, SCANNED_IDENTIFIERS, SCANNED_ROUTINES)
        found = (" ".join(f"{number:0{width}X}" for number in sorted(numbers)) for numbers, width in scan.found)
        refused = ", ".join(f"{code:02X}: {count}" for code, count in sorted(scan.refused.items()))
        wrong = "<br>".join(scan.wrong) or "none"
        yield ["scapy, `UDS_Scanner`", SCAPY.version, node.lower(), f"{scan.asked}", *found, refused, wrong]


def servers() -> Iterator[list[str]]:
    """One row for each server that caringcaribou discovers on the bus of the emulator."""
    if absent := CARINGCARIBOU.reason_it_is_absent():
        yield [absent, *("-" for _ in SERVER_HEADS[1:])]
        return
    with EmulatedBench({}) as bench:
        for request_id, answer_id in servers_by_caringcaribou(bench.channel, DISCOVERED):
            print(f"{request_id:03X} by caringcaribou", file=sys.stderr)
            services, identifiers = by_caringcaribou(bench.channel, request_id, answer_id, DUMPED)
            found = (" ".join(f"{each:02X}" for each in services), " ".join(f"{each:04X}" for each in identifiers))
            yield [CARINGCARIBOU.version, f"{request_id:03X}", f"{answer_id:03X}", *found]


def compilers() -> Iterator[list[str]]:
    """One row for each compiler of Modelica, on the library."""
    for compiler in COMPILERS:
        if absent := compiler.program.reason_it_is_absent():
            yield [compiler.name, "-", "-", "-", "-", absent]
            continue
        print(f"the Modelica library by {compiler.name}", file=sys.stderr)
        with tempfile.TemporaryDirectory() as folder:
            found = compiler.read(Path(folder))
        asked = ((found.files, FILES), (found.compiled, LIBRARY_MODELS), (found.run, LIBRARY_MODELS))
        counts = ["-" if count is None else f"{count} of {len(of)}" for count, of in asked]
        messages = "<br>".join(f"{text} ({count})" for text, count in Counter(found.messages).items())
        yield [compiler.name, compiler.program.version, *counts, messages or "none"]


def run(*parts: str) -> None:
    """Run everything, or these parts, and keep the outcomes. A part may also be the name of a master."""
    record = read_json(RECORD)
    for part in parts or PARTS:
        record |= PARTS[part]() if part in PARTS else rows_of_a_master(part, record)
    write_json(RECORD, record)


def rows_of_a_master(name: str, record: Mapping[str, list[list[str]]]) -> dict[str, list[list[str]]]:
    """The tables of the loops with new rows of one master. Raises ValueError for a name that none has."""
    masters = [master for master in MASTERS if master.name == name]
    if not masters:
        raise ValueError(f"no part called {name}; there are {', '.join((*PARTS, *(each.name for each in MASTERS)))}")
    order = [master.name for master in MASTERS]
    with tempfile.TemporaryDirectory() as folder:
        ours = our_run(Path(folder))
    tables = {}
    for shape, loop in LOOPS.items():
        heads, *rows = record[shape]
        kept = [row for row in rows if row[0] != name]
        tables[shape] = [heads, *sorted([*kept, *results(loop, ours, masters)], key=lambda row: order.index(row[0]))]
    return tables


def loops() -> dict[str, list[list[str]]]:
    """The loops in masters of others, and what their checkers find in its FMUs."""
    with tempfile.TemporaryDirectory() as folder:
        ours = our_run(Path(folder))
        blocks = [Path(folder, version, f"{ONE_BLOCK.part}.fmu") for version in ("2", "3")]
        for version in ("2", "3"):
            Path(folder, version).mkdir()
            ONE_BLOCK.system_of(scenario_in(Path(folder)), version, Path(folder, version))
        found = {name: [list(HEADS), *results(loop, ours, MASTERS)] for name, loop in LOOPS.items()}
        return found | {"checkers": [list(CHECKER_HEADS), *checks(blocks)]}


PARTS: dict[str, Callable[[], dict[str, list[list[str]]]]] = {
    "loops": loops,
    "scapy": lambda: {"scanners": [list(SCAN_HEADS), *scans()]},
    "modelica": lambda: {"compilers": [list(COMPILER_HEADS), *compilers()]},
    "caringcaribou": lambda: {"servers": [list(SERVER_HEADS), *servers()]},
}


def texts() -> Texts:
    """The outcomes, and the scenario."""
    tables = {name: table(heads, rows) for name, (heads, *rows) in read_json(RECORD).items()}
    return {PAGE: {**tables, "scenario": block(["```toml", TEXT.strip(), "```"])}}
