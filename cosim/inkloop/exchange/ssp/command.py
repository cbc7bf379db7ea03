"""`inkloop export ssp`: a scenario as a system of FMUs for other tools."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from inkloop.errors import ScenarioError
from inkloop.exchange.ssp import VERSIONS, folder, ssd
from inkloop.exchange.ssp.system import System, system_of
from inkloop.files import temporary_folder
from inkloop.fmu_writer.archive import DEFINITION, pack, unpack
from inkloop.fmu_writer.export import with_platforms
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario


def export(scenario: Scenario, options: argparse.Namespace, console: Terminal) -> int:
    """Write the system and print the remaining steps; returns the exit code. Raises ScenarioError, FmuError."""
    fmi = _fmi(options)
    stem = Path(scenario.source).stem
    with temporary_folder("export") as place:
        system = system_of(scenario, fmi, place)
        if options.platforms is not None:
            _set_platforms(system, options.platforms)
        if options.to == "ssp":
            out = options.out or Path(f"{stem}.ssp")
            ssd.write(system, options.ssp, out)
        else:
            out = options.out or Path(f"{stem}-{options.to}")
            folder.write(system, options.to, out)
    notes, next_line = system.notes(), next_step(options.to, out, system.step_s)
    console.sentence(f"wrote {out}: {', '.join(part.name for part in system.parts)}")
    for note in notes:
        console.sentence(f"  {note}")
    console.sentence(f"  next: {next_line}")
    console.result(path=out, notes=list(notes), next=next_line)
    return 0


def next_step(to: str, out: Path, step_s: float) -> str:
    """Advice to run the file or folder that was written, in one line."""
    jar = "java -jar maestro.jar import sg1 --interpret -output=out --fmu-search-path=."
    return {
        "ssp": f"inkloop run {out} prints it; in another tool import it, communication step {step_s:g} s",
        "osp": f"libcosimpy: CosimExecution.from_osp_config_file(osp_path={str(out)!r}), then simulate_until",
        "maestro": f"cd {out} && {jar} {folder.CONFIGURATION} {folder.MULTI_MODEL}",
    }[to]


def _fmi(options: argparse.Namespace) -> str:
    """The requested version of FMI, if the format supports it. Raises ScenarioError."""
    wanted = options.fmi or (VERSIONS[options.ssp] if options.to == "ssp" else "2")
    if wanted == "3" and (options.to != "ssp" or options.ssp == "1.0"):
        what = "SSP 1.0" if options.to == "ssp" else options.to
        advice = "add --ssp 2.0, or leave --fmi out" if options.to == "ssp" else "leave --fmi out"
        raise ScenarioError(str(options.scenario), [f"--fmi 3: {what} takes FMI 2 only; {advice}"])
    return wanted


def _set_platforms(system: System, platforms: Sequence[str]) -> None:
    """Compile our FMUs for the platforms; those of others stay as they are. Raises FmuError."""
    for part in system.parts:
        members = unpack(part.file)
        if DEFINITION in members:
            pack(part.file, with_platforms(members, str(part.description.fmi), platforms))
