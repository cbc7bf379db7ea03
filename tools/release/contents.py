"""What a release must hold: in each wheel every compiled part for its platform, and FMUs with a binary for each."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from inkloop.errors import InkloopError
from inkloop.fmu_writer.targets import Target, platforms_in

LIBRARIES = (
    "inkloop/geometry/{}inkloop_columns{}",
    "inkloop_lab/models/{}inkloop_models{}",
    "inkloop_controller/{}inkloop_core{}",
)
"""What Python loads: prefix and suffix differ by system."""
EMULATOR = "inkloop_hardware/inkloop_bench_nodes"
"""It needs POSIX: there is none for Windows."""
SUMS = "SHA256SUMS"
FMU_FOLDERS = {"fmi2": "2", "fmi3": "3", "fmi3-fixed": "3"}
FMU_SUFFIXES = (".fmu", ".template")


def earlier_files(folder: Path) -> list[Path]:
    """The files of an earlier release in a folder. Raises InkloopError if it holds anything else."""
    if not folder.exists():
        return []
    if not folder.is_dir():
        raise InkloopError(f"{folder} is a file; name a folder for the release")
    sums = folder / SUMS
    lines = sums.read_text("utf-8").splitlines() if sums.is_file() else []
    named = {SUMS, *(line.partition("  ")[2] for line in lines)}
    found = sorted(folder.iterdir())
    if others := [path.name for path in found if path.name not in named or not path.is_file()]:
        raise InkloopError(
            f"{folder} holds {', '.join(others[:5])}{', ...' if len(others) > 5 else ''}, which no release wrote; "
            "name an empty folder, or move this away"
        )
    return found


def check_wheel(wheel: Path, target: Target, targets: Sequence[Target]) -> None:
    """Raises InkloopError with everything that a wheel for `target` lacks, or has for another platform."""
    with zipfile.ZipFile(wheel) as archive:
        faults = list(wheel_faults(archive, target, targets))
    if faults:
        raise InkloopError("\n  ".join([f"{wheel.name} is not whole:", *faults]))


def wheel_faults(archive: zipfile.ZipFile, target: Target, targets: Sequence[Target]) -> Iterator[str]:
    """What is wrong with the wheel, a sentence for each."""
    names = set(archive.namelist())
    for name in compiled_parts(target):
        if name not in names:
            yield f"{name} is missing"
        elif (found := platforms_in(archive.read(name))) != [target.name]:
            yield f"{name} is for {found or 'no known platform'}; expected {target.name}"
    fmus = sorted(name for name in names if name.startswith("inkloop_fmus/") and name.endswith(FMU_SUFFIXES))
    for folder in FMU_FOLDERS:
        if not any(name.startswith(f"inkloop_fmus/{folder}/") for name in fmus):
            yield f"inkloop_fmus/{folder} has no FMU"
    for name in fmus:
        with zipfile.ZipFile(io.BytesIO(archive.read(name))) as fmu:
            yield from (f"{name}: {fault}" for fault in fmu_faults(fmu, FMU_FOLDERS[name.split("/")[1]], targets))


def compiled_parts(target: Target) -> list[str]:
    """Members of a wheel that were compiled for its platform."""
    prefix = "" if target.system == "Windows" else "lib"
    found = [name.format(prefix, target.suffix) for name in LIBRARIES]
    return found if target.system == "Windows" else [*found, EMULATOR]


def fmu_faults(archive: zipfile.ZipFile, fmi: str, targets: Sequence[Target]) -> Iterator[str]:
    """What is wrong with the binaries of an FMU that is for all of the targets."""
    known = {target.name for target in targets if target.folder(fmi) is not None}
    found: list[str] = []
    for name in archive.namelist():
        if name.startswith("binaries/"):
            platforms = platforms_in(archive.read(name))
            found += platforms
            if not platforms:
                yield f"{name} is for no known platform"
    if set(found) != known or len(found) != len(known):
        yield f"has binaries for {', '.join(sorted(found)) or 'nothing'}; expected {', '.join(sorted(known))}"
