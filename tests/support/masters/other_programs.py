"""Programs of other people that the tests run, or the reason why one is absent."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol


class Program(Protocol):
    """A program that pip or Maven Central brings."""

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""


@dataclass(frozen=True)
class PythonPackage:
    """A Python package and a module in it that loads what it stands on."""

    package: str
    module: str

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""
        try:
            import_module(self.module)
        except ImportError:
            return f"{self.package} is not installed; make peers"
        except OSError as error:  # a shared library that it stands on
            return f"{self.package} does not load: {error}; Debian has libtbb.so.12 in libtbb12 (make tools)"
        return ""


@dataclass(frozen=True)
class Executable:
    """A program on the PATH."""

    command: str

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""
        return "" if shutil.which(self.command) else f"{self.command} is not on the PATH; build it from its sources"


FMPY = PythonPackage("fmpy", "fmpy")
FMUTOOL = PythonPackage("fmu-manipulation-toolbox", "fmu_manipulation_toolbox")
LIBCOSIM = PythonPackage("libcosimpy", "libcosimpy")
ECOS = PythonPackage("ecospy", "ecospy")
SCAPY = PythonPackage("scapy", "scapy.contrib.automotive.uds_scan")
OMSIMULATOR = Executable("OMSimulator")
CARINGCARIBOU = PythonPackage("caringcaribou", "caringcaribou.modules.uds")
