"""Functions that a library offers and libraries that it needs, as LIEF reads them from ELF, PE and Mach-O files."""

from __future__ import annotations

import re
from typing import Any

import pytest

from inkloop.fmu_writer.targets import platforms_in
from support.fmus.foreign_run import HEADERS

MACHO_LABELS = {"__mh_dylib_header", "___dso_handle"}
"""Symbols that zig's linker writes into every library for macOS: places in its header, not functions."""


def declared(fmi: str) -> set[str]:
    """The functions of the standard for co-simulation, and in FMI 3 for all kinds."""
    header = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    if fmi == "2":
        *_, co_simulation = header.split("Functions for FMI2 for Co-Simulation")
        header = header.split("Functions for FMI2 for Model Exchange")[1] + co_simulation
    return set(re.findall(rf"FMI{fmi}_Export fmi\w+TYPE\s+(fmi\w+);", header))


def parsed(binary: bytes) -> list[Any]:
    """The binary as LIEF reads it, one for each processor."""
    lief = pytest.importorskip("lief", reason="needs lief")
    found = lief.parse(list(binary))
    if platforms_in(binary)[0].endswith("darwin"):
        universal = lief.MachO.parse(list(binary))
        return [universal.take(processor) for processor in [each.header.cpu_type for each in universal]]
    return [found]


def exports(image: Any) -> set[str]:
    """Names of functions that a library offers, without the underscore of macOS."""
    names = {str(function.name) for function in image.exported_functions}
    is_macho = type(image).__module__.endswith("MachO")
    return {name.removeprefix("_") for name in names - MACHO_LABELS} if is_macho else names


def newest_glibc(image: Any) -> tuple[int, ...]:
    """The newest version of a symbol of the C library that a Linux binary asks for."""
    versions = [
        tuple(int(number) for number in version.name.removeprefix("GLIBC_").split("."))
        for requirement in image.symbols_version_requirement
        for version in requirement.get_auxiliary_symbols()
    ]
    return max(versions)


def assert_of_the_standard(binary: bytes, fmi: str) -> None:
    """A binary for Linux offers the functions of the standard and no other, and needs the C library alone."""
    (image,) = parsed(binary)
    functions = declared(fmi)
    assert len(functions) > 30
    assert exports(image) == functions
    assert {str(library).split(".")[0] for library in image.libraries} <= {"libc", "libm"}
