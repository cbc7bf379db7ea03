"""Our FMUs: the installed set, and export for any grid size without a compiler: a binary serves every grid.

Binaries for other platforms are compiled on this machine by `zig cc` from the sources in the FMU.
"""

from __future__ import annotations

import importlib.util
import logging
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from inkloop.errors import FmuError, near, require
from inkloop.files import temporary_folder
from inkloop.fmu_writer import FORMS
from inkloop.fmu_writer.targets import Target, targets_of, universal
from inkloop.limits import memory_error, size_text

FMI2_CELLS = 32 * 32
"""Cells up to which every importer that was tried reads an FMI 2 description in seconds."""

FMI2_CELLS_MAX = 100 * 100
"""Cells beyond which an FMI 2 description is only written when it is asked for by `force`."""

FMI2_XML_OF_A_CELL = 1_150
"""Bytes of an FMI 2 description for each cell (measured, 184 MB for 400 x 400)."""

BYTES_OF_A_CELL = {"2": 20_000, "3": 100}
"""Version of FMI -> memory that an importer takes for a cell: of FMI 2 to read the description (measured, 3.0 GiB
for 400 x 400), of FMI 3 for the maps that a model keeps and gives (assumed)."""

INTERVALS = "region_intervals"
"""Structural parameter: number of height intervals of the region of ink A on a cell."""

INTERVALS_MAX = 64
"""Its largest value, as variables.toml has it."""

_MAPS = 12
"""Maps of LayerController with two intervals, the basis for estimating more of them."""

LAYER_JOB = "LayerJob"
"""The model that prints the job in its resources: it is exported with a scenario only."""

JOB_TEMPLATE = f"{LAYER_JOB}.template"
"""Its archive without the job; not named as an FMU, because no importer can instantiate it."""

COMPILER = "ziglang"
"""The Python package that brings the compiler, and C libraries and headers of all targets."""

FLAGS = (
    *("-std=c11", "-O3", "-DNDEBUG", "-Wall", "-Wextra", "-Wpedantic"),
    *("-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno"),  # as in all of inkloop, so that the bits agree
    *("-fvisibility=hidden", "-shared", "-s"),
)

_log = logging.getLogger(__name__)


def find_fmu(model: str, form: str = "fmi3") -> Path:
    """One of the built FMUs, `form` being "fmi3", "fmi3-fixed" or "fmi2". Raises FmuError.

    They are looked for in $INKLOOP_FMU_DIR, else in the installed package inkloop_fmus.
    """
    if form not in FORMS:
        raise FmuError(f"form of an FMU is {form!r}; expected one of {', '.join(FORMS)}")
    folder = _folder()
    path = folder / form / f"{model}.fmu"
    if model == LAYER_JOB:
        raise FmuError(f"{LAYER_JOB} prints a scenario: inkloop export job SCENARIO writes it")
    if not path.is_file():
        there = sorted(found.stem for found in (folder / form).glob("*.fmu"))
        models = f"did you mean {' or '.join(close)}? Models" if (close := near(model, there)) else "models"
        raise FmuError(f"there is no FMU {model!r} in {folder / form}; {models} there: {', '.join(there) or 'none'}")
    return path


def job_template(form: str) -> Path:
    """The archive that `inkloop export job` puts a job into, `form` being "fmi3-fixed" or "fmi2". Raises FmuError."""
    path = _folder() / form / JOB_TEMPLATE
    if not path.is_file():
        raise FmuError(f"there is no {path}; run `make`, or install inkloop again")
    return path


def export_fmu(
    model: str,
    *,
    out: Path | str,
    nx: int = 9,
    ny: int = 9,
    fmi: Literal["2", "3"] = "3",
    intervals: int | None = None,
    fixed: bool = False,
    platforms: Sequence[str] | None = None,
    force: bool = False,
) -> Path:
    """Write one of our FMUs for a grid of nx * ny cells to the file `out`; returns its path. Raises FmuError.

    intervals: of height that the region of ink A may have on a cell, for LayerController; None: 2. FMI 3 without
    `fixed` keeps structural parameters, with these numbers as start values. platforms: exactly these
    (`inkloop.fmu_writer.targets.TARGETS`) or "all"; None: those of the installed FMU. Missing binaries are compiled by
    the package ziglang. force: also as FMI 2 for a grid whose description many tools cannot read.
    """
    from inkloop import __version__
    from inkloop.fmu_writer.archive import definition_in, described, pack, unpack

    if fmi not in ("2", "3"):
        raise FmuError(f"FMI version is {fmi!r}; expected '2' or '3'")
    if nx < 1 or ny < 1:
        raise FmuError(f"the grid is {nx} x {ny} cells; expected at least 1 x 1")
    form = "fmi2" if fmi == "2" else "fmi3-fixed" if fixed else "fmi3"
    further_maps = 2 * max(0, (intervals or 2) - 2)
    if reason := memory_error(nx * ny * BYTES_OF_A_CELL[fmi] * (_MAPS + further_maps) // _MAPS):
        fits = "choose a smaller grid" + ("" if fmi == "3" else ", or FMI 3, whose description does not grow with it")
        raise FmuError(f"{model} as FMI {fmi} of {nx} x {ny} cells {reason}, for what reads and runs it; {fits}")
    if form == "fmi2" and nx * ny > FMI2_CELLS_MAX and not force:
        xml, memory = (size_text(nx * ny * each) for each in (FMI2_XML_OF_A_CELL, BYTES_OF_A_CELL["2"]))
        raise FmuError(
            f"{model} as FMI 2 of {nx} x {ny} cells has a modelDescription.xml of about {xml}, and what reads it takes "
            f"about {memory} of memory; use FMI 3, whose description does not grow with the grid, or at most "
            f"{FMI2_CELLS_MAX:,} cells (`inkloop export fmu --force` writes it all the same)"
        )
    if form == "fmi2" and nx * ny > FMI2_CELLS:
        _log.warning(
            "%s as FMI 2 with %d x %d cells has %d scalars per map: some importers take minutes to read that; "
            "FMI 3 has no such cost",
            model,
            nx,
            ny,
            nx * ny,
        )
    members = unpack(find_fmu(model, form))
    sizes = {"nx": nx, "ny": ny}
    if intervals is not None:
        sizes[INTERVALS] = intervals
        if INTERVALS not in {v.name for v in definition_in(members).exposed}:
            raise FmuError(f"{model} has no region of ink A; leave the number of its intervals out")
        if not 1 <= intervals <= INTERVALS_MAX:
            raise FmuError(f"intervals of the region of ink A are {intervals}; expected 1 to {INTERVALS_MAX}")
    members = described(members, form, sizes, __version__)
    if platforms is not None:
        members = with_platforms(members, fmi, platforms)
    path = Path(out)
    path.parent.mkdir(parents=True, exist_ok=True)
    pack(path, members)
    return path


def _folder() -> Path:
    if named := os.environ.get("INKLOOP_FMU_DIR"):
        return Path(named)
    package = importlib.util.find_spec("inkloop_fmus")
    for place in (package.submodule_search_locations or []) if package else []:
        if any((Path(place) / form).is_dir() for form in FORMS):
            return Path(place)
    raise FmuError("the built FMUs (package inkloop_fmus) are not installed; run `make`, or set INKLOOP_FMU_DIR")


def with_platforms(members: Mapping[str, bytes], fmi: str, names: Iterable[str]) -> dict[str, bytes]:
    """The members of an FMU of FMI `fmi` ("2", "3") with binaries for exactly the named platforms, or "all".

    Binaries that it has already are kept; the others are compiled. Raises FmuError if a name is unknown, if the
    compiler or the FMI headers are not installed, or if the compiler refuses the sources.
    """
    description = ET.fromstring(members["modelDescription.xml"])
    identifier = next(description.iter("CoSimulation")).get("modelIdentifier", "")
    listed = ET.fromstring(members["sources/buildDescription.xml"]) if fmi == "3" else description
    sources = [file.get("name", "") for file in listed.iter("SourceFile" if fmi == "3" else "File")]
    found = {name: content for name, content in members.items() if not name.startswith("binaries/")}
    for folder, targets in targets_of(names, fmi).items():
        name = f"binaries/{folder}/{identifier}{targets[0].suffix}"
        if name in members:
            found[name] = members[name]
        else:
            found[name] = universal([_compiled(members, sources, identifier, target) for target in targets])
    return found


def _compiled(members: Mapping[str, bytes], sources: list[str], identifier: str, target: Target) -> bytes:
    """The library; compiler warnings are logged."""
    compiler, headers = compiler_command(), _headers()
    with temporary_folder("cross") as folder:
        for name, content in members.items():
            if name.startswith("sources/"):
                file = Path(folder, name)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
        out = Path(folder, f"{identifier}{target.suffix}")
        mathematics = () if target.system == "Windows" else ("-lm",)
        # else the library would be named by the path of this temporary folder
        identity = ("-install_name", f"@rpath/{out.name}") if target.system == "Darwin" else ()
        options = ("-target", target.triple, *FLAGS, "-isystem", headers, "-o", str(out))
        command = [*compiler, "cc", *options, *sources, *mathematics, *identity]
        done = subprocess.run(command, cwd=Path(folder, "sources"), capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise FmuError(f"zig cc refuses the sources of {identifier} for {target.name}:\n{done.stderr.rstrip()}")
        if done.stderr:
            _log.warning("zig cc on the sources of %s for %s:\n%s", identifier, target.name, done.stderr.rstrip())
        return out.read_bytes()


def compiler_command() -> list[str]:
    """The command that runs zig. Raises FmuError if it is not installed."""
    require(COMPILER, "a binary for another platform", FmuError)
    return [sys.executable, "-m", COMPILER]


def _headers() -> str:
    """The folder of the FMI headers in the package fmpy, which is not imported for that."""
    package = importlib.util.find_spec("fmpy")
    for place in (package.submodule_search_locations or []) if package else []:
        if (headers := Path(place) / "c-code").is_dir():
            return os.fspath(headers)
    raise FmuError("the FMI headers come with the Python package fmpy, which is not installed: pip install fmpy")
