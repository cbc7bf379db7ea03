"""Binaries of an FMU for other platforms, compiled on this machine by `zig cc` from the sources in the FMU."""

from __future__ import annotations

import importlib.util
import logging
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from pathlib import Path

from inkloop.errors import FmuError, require
from inkloop.files import temporary_folder
from inkloop.fmu_writer.targets import Target, targets_of, universal

COMPILER = "ziglang"
"""The Python package that brings the compiler, and C libraries and headers of all targets."""

FLAGS = (
    *("-std=c11", "-O3", "-DNDEBUG", "-Wall", "-Wextra", "-Wpedantic"),
    *("-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno"),  # as in all of inkloop, so that the bits agree
    *("-fvisibility=hidden", "-shared", "-s"),
)

_log = logging.getLogger(__name__)


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
