"""Valid and invalid content of a foreign .ssp: all its errors at once."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import pytest

from inkloop.errors import FmuError, ScenarioError
from inkloop.exchange.ssp.reading import scenario_of
from inkloop.exchange.ssp.ssd import SCENARIO
from inkloop.fmu.reading import fmu_file
from support.fmus import amplifier

pytestmark = pytest.mark.compiled

NAMES = " ".join(
    f'xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{long}"'
    for short, long in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
)
JOB = """
title = "two FMUs of others"
grid = { nx = 4, ny = 4 }
part = { shape = "cuboid", height_um = 10.0, size_x_um = 500.0, size_y_um = 500.0 }
[components.first]
kind = "OpenLoop"
[[connections]]
source = "second.y"
target = "first.x"
gain = 7.0
"""
FIRST, SECOND = (f'<ssd:Component name="{name}" source="resources/amplifier2.fmu">' for name in ("first", "second"))
BOTH = f"{FIRST}</ssd:Component>{SECOND}</ssd:Component>"


def wires(source: str, target: str, inside: str = "", elements: int = 3) -> str:
    """Connections of the arrays of two ports, element by element."""
    ((a, x), (b, y)) = (place.split(".") for place in (source, target))
    return "".join(
        f'<ssd:Connection startElement="{a}" startConnector="{x}[{n}]" endElement="{b}" endConnector="{y}[{n}]">'
        f"{inside}</ssd:Connection>"
        for n in range(1, elements + 1)
    )


def packed(folder: Path, elements: str = BOTH, connections: str = "", bindings: str = "", job: str = JOB) -> Path:
    """An .ssp with a foreign FMU, as another tool might write it."""
    path = folder / "theirs.ssp"
    structure = f"""<ssd:SystemStructureDescription {NAMES} version="1.0" name="theirs"><ssd:System name="root">
<ssd:ParameterBindings>{bindings}</ssd:ParameterBindings><ssd:Elements>{elements}</ssd:Elements>
<ssd:Connections>{connections}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", structure)
        archive.write(amplifier.build(folder, 2), "resources/amplifier2.fmu")
        if job:
            archive.writestr(SCENARIO, job)
    return path


def bound(*parameters: str) -> str:
    """A parameter set in the structure itself."""
    entries = "".join(parameters)
    return f"""<ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="set">
<ssv:Parameters>{entries}</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>"""


def parameter(name: str, value: str, kind: str = "Real", more: str = "") -> str:
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}" {more}/></ssv:Parameter>'


def errors_of(path: Path) -> str:
    with pytest.raises(ScenarioError) as caught:
        scenario_of(path)
    return str(caught.value)


def test_every_error_of_the_structure_is_named_at_once(tmp_path: Path) -> None:
    elements = f"""{BOTH}<ssd:SignalDictionaryReference name="bus"/>
<ssd:Component name="a.b" source="resources/amplifier2.fmu"/>
<ssd:Component name="lost" source="resources/amplifier.fmu"/>
<ssd:Component name="packet" source="x.ssp" type="application/x-ssp-package"/>"""
    connections = (
        wires("first.y", "second.x", elements=2)
        + wires("second.y", "first.X", elements=1)
        + wires("second.y", "third.x", elements=1)
        + wires("second.y", "first.x", "<ssc:BooleanMappingTransformation/>")
    )
    bindings = bound(
        parameter("first.gian", "1"),
        parameter("second.gain", "much"),
        parameter("third.gain", "1"),
        parameter("first.mode", "", "Enumeration"),
        parameter("first.gain", "1", more='unit="m"'),
    )
    bindings += '<ssd:ParameterBinding source="resources/none.ssv"/>'
    bindings += '<ssd:ParameterBinding source="x.ssv" sourceBase="component"/>'
    bindings += '<ssd:ParameterBinding><ssd:ParameterMapping source="none.ssm"/></ssd:ParameterBinding>'
    text = errors_of(packed(tmp_path, elements, connections, bindings))
    for message in (
        "bus is a SignalDictionaryReference; inkloop takes components and systems",
        "a.b has a dot in its name",
        "lost is 'resources/amplifier.fmu', which is not in the .ssp; did you mean resources/amplifier2.fmu?",
        "packet is of type 'application/x-ssp-package'; inkloop takes FMUs",
        "first.y to second.x: 2 of 3 elements are connected",
        "a connection names first.X[1]; did you mean x[1]",
        "a connection names component 'third'",
        "from second.y to first.x has a BooleanMappingTransformation",
        "parameter first.gian is none of first; did you mean gain?",
        "parameter second.gain is 'much'; expected Real",
        "parameter first.mode is ''; expected Enumeration",
        "parameter third.gain: there is no component 'third'",
        "parameter first.gain is in [m]; gain is in [1]",
        "parameters 'resources/none.ssv' cannot be read",
        "mappings 'none.ssm' cannot be read",
        "parameters 'x.ssv' lie in an FMU (sourceBase)",
    ):
        assert message in text, text


@pytest.mark.parametrize("place", range(40, 400, 60))
def test_damaged_ssp_is_reported(place: int, tmp_path: Path) -> None:
    whole = packed(tmp_path)
    path = tmp_path / "packed.ssp"
    with zipfile.ZipFile(whole) as members, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in members.namelist():
            archive.writestr(name, members.read(name))
    content = bytearray(path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(bytes(content))
    assert re.search(r"is no \.ssp, or a damaged one|is no XML|holds no|cannot be read", errors_of(path))


def test_fmu_in_an_ssp_is_named_by_its_place_there(tmp_path: Path) -> None:
    path = packed(tmp_path)
    with fmu_file(path / "resources" / "amplifier2.fmu") as found:
        assert found.read_bytes() == (tmp_path / "amplifier2.fmu").read_bytes()
    assert not found.exists()
    (tmp_path / "folder.ssp").mkdir()
    with fmu_file(tmp_path / "folder.ssp" / "it.fmu") as found:
        assert found == tmp_path / "folder.ssp" / "it.fmu"
    with pytest.raises(FmuError, match=r"theirs\.ssp/resources/none\.fmu: cannot be read"):
        fmu_file(path / "resources" / "none.fmu").__enter__()


def test_components_parameters_and_connections_take_the_place_of_the_scenario_s(tmp_path: Path) -> None:
    """Nothing of the job goes to a parameter that no set names; a source is a URI relative to the structure."""
    written = BOTH.replace('source="resources', 'source="./resources/../resources').replace("lifier2", "lifi%65r2")
    inside = bound(parameter("gain", "4.5"), parameter("mode", "squared", "Enumeration"))
    bindings = f"<ssd:ParameterBindings>{inside}</ssd:ParameterBindings></ssd:Component>"
    both = wires("first.y", "second.x") + wires("second.y", "first.x")
    path = packed(
        tmp_path, written.replace("</ssd:Component>", bindings, 1), both, bound(parameter("second.gain", "3"))
    )
    scenario = scenario_of(path)
    tables = scenario.tables.components
    assert {(table.kind, table.options["job_parameters"]) for table in tables.values()} == {("Fmu", False)}
    assert scenario.foreign_fmus == ["components.first", "components.second"]
    assert (tables["first"].options["gain"], tables["first"].options["mode"]) == (4.5, "squared")
    assert (tables["second"].options["gain"], "mode" in tables["second"].options) == (3.0, False)
    found = [(wire.source, wire.target, wire.gain) for wire in scenario.tables.connections]
    assert found == [("first.y", "second.x", None), ("second.y", "first.x", None)]


def test_job_is_the_one_that_is_named(tmp_path: Path) -> None:
    job = tmp_path / "jobs" / "other.toml"
    job.parent.mkdir()
    job.write_text(JOB.replace("two FMUs of others", "another job"), encoding="utf-8")
    path = packed(tmp_path, job="")
    assert "name a scenario with --job FILE" in errors_of(path)
    scenario = scenario_of(path, {"seed": 9}, job)
    assert (scenario.tables.title, scenario.tables.seed) == ("another job (seed = 9)", 9)
    assert scenario.source == str(job), "files that it names lie next to it"
    assert scenario.foreign_fmus == ["components.first", "components.second"]
    path = packed(tmp_path, job=JOB.replace("nx = 4", 'nx = "four"'))
    assert "grid.nx is 'four'; expected a whole number" in errors_of(path)


def test_file_that_is_no_ssp_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "x.ssp"
    assert "cannot be read" in errors_of(path)
    path.write_bytes(b"PK")
    assert "is no .ssp" in errors_of(path)
    for text in ("", "<a", "<a/>"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr(SCENARIO, JOB)
            if text:
                archive.writestr("SystemStructure.ssd", text)
        assert "SystemStructure.ssd" in errors_of(path)


def test_parameter_with_the_name_of_an_option_is_refused(tmp_path: Path) -> None:
    path = packed(tmp_path, bindings=bound(parameter("first.file", "3")))
    theirs = tmp_path / "named.fmu"
    amplifier.altered(tmp_path / "amplifier2.fmu", theirs, ('name="gain"', 'name="file"'))
    other = tmp_path / "other.ssp"
    with zipfile.ZipFile(path) as ours, zipfile.ZipFile(other, "w") as archive:
        for name in ours.namelist():
            archive.writestr(name, theirs.read_bytes() if name.endswith(".fmu") else ours.read(name))
    with pytest.raises(ScenarioError, match=r"parameter first\.file has the name of an option of a scenario"):
        scenario_of(other)


def test_connections_of_the_job_to_other_inputs_stay(tmp_path: Path) -> None:
    other = '[[connections]]\nsource = "first.y"\ntarget = "second.x"\noffset_um = 4.0\n'
    scenario = scenario_of(packed(tmp_path, connections=wires("second.y", "first.x"), job=JOB + other))
    found = [(wire.source, wire.target, wire.gain) for wire in scenario.tables.connections]
    assert found == [("first.y", "second.x", None), ("second.y", "first.x", None)]
    assert scenario.connections[0].offset == pytest.approx(4e-6, rel=1e-12, abs=0.0)


def renamed(folder: Path, path: Path, *changes: tuple[str, str]) -> Path:
    """The .ssp with another description of its FMU."""
    theirs, other = folder / "named.fmu", folder / "other.ssp"
    amplifier.altered(folder / "amplifier2.fmu", theirs, *changes)
    with zipfile.ZipFile(path) as ours, zipfile.ZipFile(other, "w") as archive:
        for name in ours.namelist():
            archive.writestr(name, theirs.read_bytes() if name.endswith(".fmu") else ours.read(name))
    return other


def test_parameter_in_a_unit_of_its_fmu_keeps_its_value(tmp_path: Path) -> None:
    """A scenario has it in um: 2 inches are 50800."""
    units = '<UnitDefinitions><Unit name="inch"><BaseUnit m="1" factor="0.0254"/></Unit></UnitDefinitions>'
    changes = ("<TypeDefinitions>", f"{units}<TypeDefinitions>"), ('<Real start="2"', '<Real unit="inch" start="2"')
    path = renamed(tmp_path, packed(tmp_path, bindings=bound(parameter("first.gain", "2"))), *changes)
    options = scenario_of(path).tables.components["first"].options
    assert options["gain_um"] == pytest.approx(50_800.0, rel=1e-12, abs=0.0)


def test_kind_is_no_name_of_a_parameter_and_a_grid_without_cells_is_an_error_of_the_job(tmp_path: Path) -> None:
    path = renamed(tmp_path, packed(tmp_path, bindings=bound(parameter("first.kind", "3"))), ('"gain"', '"kind"'))
    assert "parameter first.kind has the name of an option of a scenario" in errors_of(path)
