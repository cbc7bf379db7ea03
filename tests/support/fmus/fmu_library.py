"""The libraries inside the FMUs: built once more from their own sources, with sanitizers, and described to C programs.

`tests/fuzz/fmus` holds the programs: `calls.c`, which makes calls from the bytes of a fuzzer, and `side_by_side.c`,
which prints on several instances at once. Each reads a table with the variables of one FMU, from `write_table`.
"""

from __future__ import annotations

import os
import random
import re
import subprocess
import zipfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy

from inkloop.fmu_writer import archive, definition
from inkloop.fmu_writer.definition import ModelDefinition, VariableDefinition
from inkloop.fmu_writer.export import find_fmu, job_template
from support.compiled import run
from support.fmus import layer_jobs
from support.fmus.fmu_driver import MODELS
from support.places import ROOT

HEADERS = Path(fmpy.__file__).parent / "c-code"
FUZZ = ROOT / "tests" / "fuzz"
FORMS = ("fmi3", "fmi2")  # one library each; that of fmi3-fixed is the one of fmi3
JOB = "LayerJob"
BUS = "BenchBus"
PAIRS = (*((model, form) for model in (*MODELS, JOB) for form in FORMS), (BUS, "fmi3"))
NAMES = tuple(f"{model}-{form}" for model, form in PAIRS)
PARTS = ("fmu", "version_2", "version_3", "subject", "events")
LETTERS = {"clock": "k", "binary": "y"}
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
ROLES = {"input": "i", "parameter": "p", "structural": "s"}
WORK = {
    **{"nx": 4, "ny": 4, "region_intervals": 3},
    **{"horizon": 2, "annealing_sweeps": 1, "iterations": 1, "sweeps_max": 2, "cells_per_pitch": 6},
}
"""Parameters that only mean more work: limits for the tests, so that thousands of inputs are tried."""
BAKED: Any = (
    "cuboid",
    *(("run.layers_max", 3), ("grid.nx", 3), ("grid.ny", 2)),
    *(("part.size_x_um", 526.512), ("part.size_y_um", 263.256)),
    *((f"components.controller.{name}", count) for name, count in (("horizon", 1), ("iterations", 1))),
    ("components.controller.annealing_sweeps", 0),
)
"""The print in the block that is tried: little work for the same reason."""
GRID = (3, 2)
NO_COMPARISONS = "-fno-sanitize-coverage=trace-cmp"  # two thirds of the time; numbers of a model are no magic bytes
FUZZ_SANITIZERS = "-fsanitize=address,undefined,float-cast-overflow"


@dataclass(frozen=True)
class Library:
    """A compiled FMU: where its library is, and the folder of its resources."""

    model: str
    form: str
    library: Path
    resources: Path


def archive_of(model: str, form: str) -> Path:
    """The FMU with a library; a print in one block has a fixed grid only."""
    if model == JOB:
        return job_template("fmi3-fixed" if form == "fmi3" else form)
    return find_fmu(model, form)


def described(path: Path) -> ElementTree.Element:
    """The description in an FMU."""
    with zipfile.ZipFile(path) as fmu:
        return ElementTree.fromstring(fmu.read("modelDescription.xml"))


def unpacked(model: str, form: str, folder: Path) -> Path:
    """The folder into which an FMU was unpacked."""
    place = folder / f"{model}-{form}"
    if not place.exists():
        fmpy.extract(str(archive_of(model, form)), str(place))
    return place


def shipped(model: str, form: str, folder: Path) -> Library:
    """The library as it is shipped."""
    place = unpacked(model, form, folder)
    (library,) = (path for path in (place / "binaries").rglob("*") if path.is_file())
    return Library(model, form, library, place / "resources")


def rebuilt(model: str, form: str, folder: Path, compiler: str, flags: Sequence[str]) -> Library:
    """The library once more, from the sources in the FMU."""
    place = unpacked(model, form, folder)
    library = place / f"{model}.so"
    sources = sorted((place / "sources").glob("*.c"))
    fixed = ("-std=c11", "-g", "-O1", "-fPIC", "-shared", "-ffp-contract=off", "-fvisibility=hidden")
    places = (f"-isystem{HEADERS}", f"-I{place / 'sources'}")
    run((compiler, *fixed, *flags, *places, *sources, "-lm", "-o", library))
    return Library(model, form, library, place / "resources")


def all_rebuilt(pairs: Sequence[tuple[str, str]], folder: Path, compiler: str, flags: Sequence[str]) -> list[Library]:
    """Each (model, form)."""
    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(lambda pair: rebuilt(*pair, folder, compiler, flags), pairs))  # type: ignore[call-arg]


def packed(libraries: Sequence[Library], folder: Path) -> None:
    """A set of FMUs in all forms with these libraries in place of their own, for INKLOOP_FMU_DIR."""
    for built in libraries:
        fixed = ("fmi3-fixed",) if built.model == JOB else ("fmi3", "fmi3-fixed")
        for form in fixed if built.form == "fmi3" else ("fmi2",):
            place = archive_of(built.model, form)
            members = archive.unpack(place)
            (binary,) = (name for name in members if name.startswith("binaries/"))
            path = folder / form / place.name
            path.parent.mkdir(parents=True, exist_ok=True)
            archive.pack(path, {**members, binary: built.library.read_bytes()})


def write_table(built: Library, path: Path, *, resizable: bool = True) -> Path:
    """Arguments of the C programs for an FMU: version, grid, paths, token, and a line per variable."""
    with zipfile.ZipFile(archive_of(built.model, built.form)) as fmu:
        model = definition.load(fmu.read(archive.DEFINITION).decode(), built.model)
    is_fmi2 = built.form == "fmi2"
    is_resizable = resizable and not is_fmi2 and built.model != JOB
    sizes = model.sizes(dict(zip(("nx", "ny"), GRID, strict=True)))
    token, resources = model.token(sizes, resizable=is_resizable), built.resources
    if built.model == JOB:
        baked = layer_jobs.unpacked(archive_of(JOB, built.form).parent.name, *BAKED)
        token, resources = fmpy.read_model_description(baked).guid, baked / "resources"
        sizes = dict(zip(sizes, map(int, re.findall(r"\d+", token.split("-")[2])), strict=True))
    location = resources.as_uri() if is_fmi2 else f"{resources}/"
    grid = f"{sizes['nx']} {sizes['ny']} {sizes.get('region_intervals', 1)}"
    lines = [f"{2 if is_fmi2 else 3} {int(is_resizable)} {grid}", str(built.library), location, token]
    scalar = {v.name: reference for v, reference in model.scalar_references(sizes)}
    for number, variable in enumerate(model.exposed):
        if is_fmi2 and variable.causality == "independent":
            continue
        reference = scalar[variable.name] if is_fmi2 else number
        lines.append(_line(model, variable, reference, is_resizable))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _line(model: ModelDefinition, variable: VariableDefinition, reference: int, is_resizable: bool) -> str:
    low, high = (0, 1) if variable.type == "boolean" else model.limits(variable)
    role = "t" if variable.is_tunable else ROLES.get(variable.causality, "-")
    role = "-" if role == "s" and not is_resizable else role
    limits = f"{'-inf' if low is None else repr(float(low))} {'inf' if high is None else repr(float(high))}"
    tried, shape = WORK.get(variable.name, "inf"), int(variable.is_grid) + int(variable.along is not None)
    letter = LETTERS.get(variable.type, variable.type[0])
    return f"{variable.name} {letter} {role} {shape} {reference} {float(variable.start)!r} {limits} {tried}"


def fuzzers(names: Sequence[str], folder: Path, compiler: str) -> tuple[Path, dict[str, Path]]:
    """`calls.c` with libFuzzer in it, and the table of each FMU, rebuilt with sanitizers, by names like Model-fmi3."""
    stop = "-fno-sanitize-recover=all"
    fuzzer = program(folder, "calls", compiler, (f"{FUZZ_SANITIZERS},fuzzer", stop, "-rdynamic"))

    def table(name: str) -> Path:
        model, form = name.split("-")
        built = rebuilt(model, form, folder, compiler, (f"{FUZZ_SANITIZERS},fuzzer-no-link", NO_COMPARISONS, stop))
        return write_table(built, folder / f"{name}.txt")

    with ThreadPoolExecutor(2) as pool:
        return fuzzer, dict(zip(names, pool.map(table, names), strict=True))


def program(folder: Path, name: str, compiler: str, flags: Sequence[str], *, others: Sequence[Path] = ()) -> Path:
    """One of the C programs: `calls` (with `others` a driver, unless a fuzzer is linked in) or `side_by_side`."""
    own = [FUZZ / "fmus" / f"{part}.c" for part in (name, *PARTS, *(("values",) if name == "calls" else ()))]
    path = folder / name
    fixed = ("-std=c11", "-D_POSIX_C_SOURCE=200809L", "-g", "-O1", *WARNINGS)
    places = (f"-I{FUZZ / 'fmus'}", f"-I{FUZZ / 'firmware'}", f"-isystem{HEADERS}")
    run((compiler, *fixed, *flags, *places, *own, *others, "-lm", "-ldl", "-lpthread", "-o", path))
    return path


DRAWN = 300
"""Inputs of the fuzz target that are drawn once and for all, for every FMU."""


def drawn(name: str, count: int = DRAWN) -> list[bytes]:
    """The inputs of one FMU."""
    generator = random.Random(name)
    return [generator.randbytes(400) for _ in range(count)]


def calls_program(folder: Path, flags: Sequence[str] = ()) -> Path:
    """The fuzz target as a program that is fed inputs."""
    return program(folder, "calls", "gcc", flags, others=[FUZZ / "firmware" / "replay.c"])


def feed(program: Path, table: Path, inputs: list[bytes]) -> str:
    """Output of the program for all inputs; it ends at the first that breaks an invariant."""
    given = b"".join(len(one).to_bytes(2, "little") + one for one in inputs)
    settings = {"INKLOOP_FMU_TABLE": str(table), "INKLOOP_FUZZ_SHOWS": "1"}
    done = subprocess.run([program], input=given, env=os.environ | settings, capture_output=True, check=False)
    output = done.stderr.decode(errors="replace")
    through = len(done.stdout)
    if done.returncode:
        hexadecimal = inputs[through].hex() if through < len(inputs) else ""
        raise AssertionError(f"input {through} ends with {done.returncode}: {output[-2000:]}\n{hexadecimal}")
    return output
