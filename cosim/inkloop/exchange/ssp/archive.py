"""Write an .ssp: the system's structure, its parameters, its FMUs, and the scenario that it was made from."""

from __future__ import annotations

import zipfile
from pathlib import Path

from inkloop.exchange.ssp import ssd
from inkloop.exchange.ssp.system import System
from inkloop.files import replaced

STRUCTURE = "SystemStructure.ssd"
SCENARIO = "extra/org.inkloop/scenario.toml"
"""Path of the embedded scenario, with the content that an .ssd cannot express: the part, the run, components
outside."""


def write(system: System, version: str, out: Path) -> None:
    """Write the system to `out`, whole or not at all; version: of SSP, "1.0" or "2.0"."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with replaced(out) as partial, zipfile.ZipFile(partial, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(STRUCTURE, ssd.description(system, version))
        archive.writestr(ssd.PARAMETERS, ssd.parameters(system, version))
        archive.writestr(SCENARIO, system.scenario_text)
        for part in system.parts:
            archive.write(part.file, f"resources/{part.name}.fmu")
