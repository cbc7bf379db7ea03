"""Descriptions with the traits of the Reference FMUs of the Modelica Association are read, or refused with a message.

Their binaries are in no package registry: with INKLOOP_REFERENCE_FMUS=FOLDER all FMUs below a folder are run too,
variable by variable against FMPy.
"""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import numpy as np
import pytest

from inkloop.components import catalog
from inkloop.errors import ComponentError, FmuError
from inkloop.fmu import FmuComponent, describe
from inkloop.testing import job
from support.fmus import amplifier
from support.fmus.fmpy_rows import Row, row_of
from support.places import ROOT

FOLDER = os.environ.get("INKLOOP_REFERENCE_FMUS", "")
_DIMENSIONS = "".join(
    f'<UInt64 name="{name}" valueReference="{number}" causality="structuralParameter" variability="tunable" start="3"/>'
    for number, name in enumerate("mnr", start=1)
)
_CO_SIMULATION = '<CoSimulation modelIdentifier="x" canHandleVariableCommunicationStepSize="true"/>'
DESCRIPTIONS = {
    "Roberts": (  # a structural parameter that is no size
        _CO_SIMULATION,
        '<Boolean name="dae" valueReference="1" causality="structuralParameter" variability="tunable" start="false"/>'
        '<Float64 name="y1" valueReference="2" causality="output" initial="exact" start="1"/>',
    ),
    "StateSpace": (  # arrays of one and two dimensions, with a start value for each element
        _CO_SIMULATION,
        f'{_DIMENSIONS}<Float64 name="A" valueReference="4" causality="parameter" variability="tunable" '
        'start="1 0 0 0 1 0 0 0 1"><Dimension valueReference="2"/><Dimension valueReference="2"/></Float64>'
        '<Float64 name="u" valueReference="9" causality="input" start="1 2 3"><Dimension valueReference="1"/></Float64>'
        '<Float64 name="y" valueReference="10" causality="output"><Dimension valueReference="3"/></Float64>',
    ),
    "Feedthrough": (  # texts and binaries, which take no part
        _CO_SIMULATION,
        '<Float32 name="a" valueReference="1" causality="input" start="0"/>'
        '<UInt64 name="b" valueReference="25" causality="input" start="18446744073709551615"/>'
        '<String name="c" valueReference="29" causality="input"><Start value="Set me!"/></String>'
        '<Binary name="d" valueReference="31" causality="input"><Start value="666f6f"/></Binary>',
    ),
    "BouncingBall": (  # an alias
        _CO_SIMULATION,
        '<Float64 name="h" valueReference="1" causality="output" initial="exact" start="1">'
        '<Alias name="h_ft"/></Float64>',
    ),
    "Clocks": (
        '<ScheduledExecution modelIdentifier="x"/>',
        '<Clock name="tick" valueReference="1" causality="input" intervalVariability="triggered"/>',
    ),
}


def described(folder: Path, name: str) -> Path:
    """An FMU without binaries."""
    interface, variables = DESCRIPTIONS[name]
    with zipfile.ZipFile(folder / f"{name}.fmu", "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            f'<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="x">{interface}'
            f"<ModelVariables>{variables}</ModelVariables><ModelStructure/></fmiModelDescription>",
        )
    return folder / f"{name}.fmu"


@pytest.mark.parametrize("name", sorted({*DESCRIPTIONS} - {"Clocks"}))
def test_description_is_read_and_only_the_binary_is_missing(name: str, tmp_path: Path) -> None:
    path = described(tmp_path, name)
    assert any(line.startswith(name) for line in describe(path).lines())
    (error,) = catalog.check("Fmu", job(), {"file": str(path)}).errors
    assert "which holds binaries for none, this machine needs" in error


def test_traits_of_the_reference_fmus_are_understood(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"Clocks\.fmu: offers scheduled execution only; export it for co-simulation"):
        describe(described(tmp_path, "Clocks"))
    switch = describe(described(tmp_path, "Roberts"))
    assert switch.default_sizes == {}
    *_, error = catalog.check("Fmu", job(), {"file": str(switch.path), "dae": 1}).errors
    assert error == "dae is 1; expected true or false"
    arrays = describe(described(tmp_path, "StateSpace"))
    variables, sizes = arrays.variables, arrays.default_sizes
    assert variables["u"].port(sizes).start_value().tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(variables["A"].port(sizes).start_value(), np.eye(3))
    ports = describe(described(tmp_path, "Feedthrough")).ports("input", {})
    (start,) = (port.start_value() for port in ports if port.name == "b")
    assert int(start) == 2**64 - 1  # exact beyond floating point


@pytest.mark.compiled
def test_fmu_that_crashes_is_a_row_of_the_table(tmp_path: Path) -> None:
    crashing, sound = amplifier.build(tmp_path, 2, crashes="SIGSEGV"), amplifier.build(tmp_path, 2)
    assert row_of(crashing).text == "| amplifier2-SIGSEGV | - | - | - | crashed |"
    assert row_of(sound) == Row("amplifier2", "2.0", 3, tool="gcc")


@pytest.mark.long
@pytest.mark.skipif(not FOLDER, reason="INKLOOP_REFERENCE_FMUS names no folder with FMUs of others")
def test_fmus_of_others_give_what_fmpy_gets_or_are_refused() -> None:
    """A table of them, in build/fmus-of-others.md; those of the Modelica Association to the last bit."""
    rows = [row_of(path) for path in sorted(Path(FOLDER).rglob("*.fmu"))]
    head = ("| FMU | FMI | variables | largest relative difference | not run |", "|---|---|---:|---:|---|")
    table = "\n".join((*head, *(row.text for row in rows)))
    (ROOT / "build" / "fmus-of-others.md").write_text(table + "\n", encoding="utf-8")
    assert any(row.variables for row in rows), table
    assert not [row for row in rows if row.difference > (0.0 if row.tool.startswith("Reference FMUs") else 1e-6)], table
    assert {row.name for row in rows if row.reason and row.name in DESCRIPTIONS} <= {"Clocks"}, table


@pytest.mark.skipif(not FOLDER, reason="INKLOOP_REFERENCE_FMUS names no folder with Reference FMUs")
def test_stair_ends_the_simulation_after_ten_seconds() -> None:
    for path in sorted(Path(FOLDER).rglob("Stair.fmu")):
        part = FmuComponent(path)
        part.initialize(0, {})
        with pytest.raises(ComponentError, match="the FMU asks to end the simulation"):
            step_to(part, 10)
        part.terminate()


def step_to(part: FmuComponent, seconds: int) -> None:
    for second in range(seconds):
        part.do_step(second * 10**9, 10**9, {})
