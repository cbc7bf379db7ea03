"""Builds tests/c/rows_plant_fmu.c: a plant of another tool with 96 scalars and rows counted from the top."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy

from support import compiled
from support.places import C_SOURCES

ROWS, COLUMNS, HEIGHT = 8, 12, 100
UNITS = """<UnitDefinitions><Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>
<Unit name="nl"><BaseUnit m="3" factor="1e-12"/></Unit></UnitDefinitions>"""


def build(folder: Path, *, has_units: bool = True) -> Path:
    """Compile and pack; without units nothing in the description states them."""
    made = compiled.object_of(C_SOURCES / "rows_plant_fmu.c", ("-std=c11", "-Wall", "-Wextra", "-Werror", "-fPIC"))
    library = compiled.linked("rows_plant.so", [made], ("-shared",))
    path = folder / "rows.fmu"
    variables = "".join(
        _scalar(f"Bed.row{row}.{name}_{column}", first + row * COLUMNS + column, causality, unit if has_units else "")
        for name, first, causality, unit in (("Drop", 0, "input", "nl"), ("Level", HEIGHT, "output", "mm"))
        for row in range(ROWS)
        for column in range(COLUMNS)
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            f"""<fmiModelDescription fmiVersion="2.0" modelName="Rows" guid="rows">
<CoSimulation modelIdentifier="rows" canHandleVariableCommunicationStepSize="true"/>{UNITS if has_units else ""}
<ModelVariables>{variables}</ModelVariables><ModelStructure/></fmiModelDescription>""",
        )
        archive.write(library, f"binaries/{fmpy.platform}/rows.so")
    return path


def _scalar(name: str, reference: int, causality: str, unit: str) -> str:
    of_unit = f' unit="{unit}"' if unit else ""
    start = ' start="0"' if causality == "input" else ""
    real = f"<Real{of_unit}{start}/>"
    return f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}">{real}</ScalarVariable>'
