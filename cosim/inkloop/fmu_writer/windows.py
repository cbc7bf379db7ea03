"""The binary of an FMU for 64-bit Windows, compiled on this machine by mingw-w64 from the sources in the FMU.

It needs no DLL but KERNEL32.dll and msvcrt.dll, which every Windows has.
"""

from __future__ import annotations

import importlib.util
import logging
import shutil
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from inkloop.errors import FmuError
from inkloop.files import temporary_folder

COMPILER = "x86_64-w64-mingw32-gcc"
FLAGS = (
    *("-std=c11", "-O3", "-DNDEBUG", "-Wall", "-Wextra", "-Wpedantic"),
    *("-ffp-contract=off", "-fno-trapping-math"),  # as in all of inkloop: the same bits
    *("-shared", "-static-libgcc", "-s"),
    "-Wl,--no-insert-timestamp",  # the same sources give the same bytes
)

_log = logging.getLogger(__name__)


def with_windows_binary(members: Mapping[str, bytes], fmi: str) -> dict[str, bytes]:
    """The members of an FMU of version `fmi` ("2", "3") and binaries/win64 or binaries/x86_64-windows.

    Raises FmuError where the compiler or the headers are not installed, or the compiler refuses the sources.
    """
    if shutil.which(COMPILER) is None:
        raise FmuError(
            f"a binary for Windows needs the cross compiler {COMPILER}, which is not installed; "
            "Debian and Ubuntu have it in gcc-mingw-w64-x86-64, Fedora in mingw64-gcc, Homebrew in mingw-w64"
        )
    description = ET.fromstring(members["modelDescription.xml"])
    identifier = next(description.iter("CoSimulation")).get("modelIdentifier", "")
    listed = ET.fromstring(members["sources/buildDescription.xml"]) if fmi == "3" else description
    names = [file.get("name", "") for file in listed.iter("SourceFile" if fmi == "3" else "File")]
    folder = "x86_64-windows" if fmi == "3" else "win64"
    return {**members, f"binaries/{folder}/{identifier}.dll": _compiled(members, names, identifier)}


def _compiled(members: Mapping[str, bytes], names: list[str], identifier: str) -> bytes:
    """The DLL; compiler warnings are logged."""
    with temporary_folder("windows") as folder:
        for name, content in members.items():
            if name.startswith("sources/"):
                file = Path(folder, name)
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(content)
        out = Path(folder, f"{identifier}.dll")
        command = [COMPILER, *FLAGS, "-isystem", _headers(), "-o", str(out), *names, "-lm"]
        done = subprocess.run(command, cwd=Path(folder, "sources"), capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise FmuError(f"{COMPILER} refuses the sources of {identifier}:\n{done.stderr.rstrip()}")
        if done.stderr:
            _log.warning("%s on the sources of %s:\n%s", COMPILER, identifier, done.stderr.rstrip())
        return out.read_bytes()


def _headers() -> str:
    """The folder of the FMI headers, which the package fmpy brings; it is not imported for that."""
    package = importlib.util.find_spec("fmpy")
    for place in (package.submodule_search_locations or []) if package else []:
        if (headers := Path(place) / "c-code").is_dir():
            return str(headers)
    raise FmuError("the FMI headers come with the Python package fmpy, which is not installed: pip install fmpy")
