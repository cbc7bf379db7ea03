"""Names of SSP: namespaces as ElementTree writes them, and variable and element of a scalar's name."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from typing import TypeAlias
from urllib.parse import unquote

from inkloop.fmu import FmuDescription

_NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
SSC = f"{{{_NAMESPACE}Common}}"
SSD = f"{{{_NAMESPACE}Description}}"
SSV = f"{{{_NAMESPACE}ParameterValues}}"

Places: TypeAlias = Mapping[str, tuple[str, int]]
"""Name in the .ssp -> variable in inkloop, and the index of its element."""


def places(description: FmuDescription) -> dict[str, tuple[str, int]]:
    """The names of an FMU's variables; one that FMI 2 scatters has a name for each element."""
    return {
        name: (variable.name, number)
        for variable in description.variables.values()
        for number, name in enumerate(variable.elements or (variable.name,))
    }


def member_of(source: str) -> str:
    """The member of the archive that a URI relative to the .ssd names, `./resources/a%20b.fmu` for example."""
    return posixpath.normpath(unquote(source))
