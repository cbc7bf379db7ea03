"""A scenario as a system of FMUs for other tools: valid, readable by others, and the same print from there."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd, read_ssv
from lxml import etree
from pyssp_standard import SSP
from pyssp_standard.standard import ModelicaStandard

from inkloop import __version__
from inkloop.cli import main
from inkloop.errors import ScenarioError
from inkloop.exchange.ssp import omsimulator, ssd
from inkloop.exchange.ssp.folder import CONFIGURATION, MULTI_MODEL, maestro_tables, osp_structure
from inkloop.exchange.ssp.reading import scenario_of
from inkloop.exchange.ssp.system import System, system_of
from inkloop.fmu import describe
from inkloop.fmu_writer.export import export_fmu
from inkloop.master.wiring import Connection
from inkloop.printing.print import Print
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from support.benches.bench_run import BLOCK
from support.fmus import amplifier

VERSIONS = {"1.0": "2", "2.0": "3"}
EVERY_VERSION = pytest.mark.parametrize("version", VERSIONS)
TEXT = """
title = "a small block"
seed = 5
grid = { nx = 6, ny = 5 }
part = { shape = "cuboid", height_um = 15.2, size_x_um = 700.0, size_y_um = 500.0 }
process = { passes = 4, pass_order = "diagonal" }
[components.controller]
kind = "LayerMpc"
horizon = 2
sweeps = 2
[components.printer]
kind = "LayerDeposition"
variation = 0.2
[components.profiler]
kind = "ProfileSensor"
noise_std_um = 0.2
scan_duration_s = 0.0
"""
OPEN_LOOP = TEXT.replace('kind = "LayerMpc"\nhorizon = 2\nsweeps = 2', 'kind = "OpenLoop"\nlayers = 3')
PLANT_OF_ONE_PASS = TEXT.replace("variation = 0.2", "variation = 0.2\npasses = 1")
"""Start value of the plant; that of the job is four."""
MAPS = ("pattern", "height", "measured_height")


def scenario_in(folder: Path, text: str = TEXT) -> Scenario:
    (folder / "block.toml").write_text(text, encoding="utf-8")
    return Scenario.load(folder / "block.toml")


def exported(folder: Path, version: str, text: str = TEXT) -> tuple[Path, System]:
    """An .ssp of a scenario, and the system that it was written from."""
    fmus = folder / f"fmus-{version}"
    fmus.mkdir()
    system = system_of(scenario_in(folder, text), VERSIONS[version], fmus)
    ssd.write(system, version, folder / f"block-{version}.ssp")
    return folder / f"block-{version}.ssp", system


@EVERY_VERSION
@pytest.mark.parametrize("text", [TEXT, OPEN_LOOP], ids=["with its controller", "without"])
def test_files_are_valid_by_the_schemas_of_their_version(version: str, text: str, tmp_path: Path) -> None:
    path, _ = exported(tmp_path, version, text)
    with zipfile.ZipFile(path) as opened:
        for member, kind in (("SystemStructure.ssd", "ssd"), ("resources/parameters.ssv", "ssv")):
            schema = ModelicaStandard.schemas[kind if version == "1.0" else f"{kind}2"]
            etree.XMLSchema(file=str(schema)).assertValid(etree.fromstring(opened.read(member)))


@EVERY_VERSION
def test_omsimulator_finds_identifiers_and_its_master(version: str, tmp_path: Path) -> None:
    """Its rules: identifiers as names (ComRef), and the annotation of oms.xsd of its sources, from which it takes the
    kind of a system. The title is the description."""
    path, system = exported(tmp_path, version, TEXT.replace("a small block", "Block, 6 x 5 droplets"))
    with zipfile.ZipFile(path) as opened:
        roots = {name: etree.fromstring(opened.read(name)) for name in ("SystemStructure.ssd", ssd.PARAMETERS)}
    for root in roots.values():
        assert re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", root.get("name"))
        assert (root.get("name"), root.get("description")) == ("block", "Block, 6 x 5 droplets")
        assert root.get("generationTool") == f"inkloop {__version__}"
    (top,) = roots["SystemStructure.ssd"].iterfind("{*}System")
    names = [top.get("name"), *(element.get("name") for element in top.iterfind("{*}Elements/{*}Component"))]
    assert omsimulator.refused(names) == []
    (annotation,) = top.iterfind("{*}Annotations/{*}Annotation")
    (own,) = annotation
    (master,) = own.iterfind("{*}SimulationInformation/{*}FixedStepMaster")
    assert annotation.get("type") == "org.openmodelica"
    assert (own.prefix, etree.QName(own).namespace) == ("oms", omsimulator.NAMESPACE)
    assert float(master.get("stepSize")) == system.step_s
    assert set(master.attrib) == {"description", "stepSize", "relativeTolerance"}
    assert "e" not in master.get("stepSize")


@pytest.mark.parametrize(
    ("text", "name"), [("cuboid", "cuboid"), ("two-ink 3", "two_ink_3"), ("3d", "system_3d"), ("ä", "system")]
)
def test_any_text_has_an_identifier(text: str, name: str) -> None:
    assert omsimulator.identifier(text) == name
    assert omsimulator.refused([name, "print-head"]) == ["print-head"]


@EVERY_VERSION
def test_pyssp_reads_all_of_it(version: str, tmp_path: Path) -> None:
    """Its components, parameters and connectors are those of the system and of its FMUs."""
    path, system = exported(tmp_path, version)
    assert system.part("controller").values["sweeps_max"] == 2  # by the name that the FMU has for it
    expected = {
        f"{part.name}.{scalar}" for part in system.parts for name in part.values for scalar in part.scalars(name)
    }
    known = set()
    with SSP(path, mode="r") as opened:
        (parameters,) = opened.ssv
        with parameters as values:
            assert values.version == version
            assert {entry["name"] for entry in values.parameters} == expected
        with opened.system_structure as structure:
            assert structure.version == version
            assert [element.name for element in structure.system.elements] == [part.name for part in system.parts]
            for component in structure.system.elements:
                model = fmpy.read_model_description(str(opened.unpacked_path / component.source), validate=False)
                causalities = {variable.name: variable.causality for variable in model.modelVariables}
                assert component.connectors
                assert all(causalities[connector.name] == connector.kind for connector in component.connectors)
                known |= {(component.name, connector.name) for connector in component.connectors}
            wires = structure.system.connections
    ends = {(wire.start_element, wire.start_connector) for wire in wires}
    ends |= {(wire.end_element, wire.end_connector) for wire in wires}
    assert ends
    assert ends <= known
    if version == "2.0":
        with zipfile.ZipFile(path) as packed:
            root = ET.fromstring(packed.read("SystemStructure.ssd"))
        sizes = {
            (part.get("name"), connector.get("name")): [size.get("size") for size in connector[1:]]
            for part in root.iterfind(".//{*}Component")
            for connector in part.iterfind(".//{*}Connector")
        }
        assert sizes["printer", "pattern"] == sizes["printer", "height"] == sizes["profiler", "valid"] == ["6", "5"]
        assert sizes["printer", "layer_command"] == sizes["profiler", "layers_scanned"] == []


@EVERY_VERSION
@pytest.mark.parametrize(
    "text", [TEXT, OPEN_LOOP, PLANT_OF_ONE_PASS], ids=["with its controller", "without", "plant of its own"]
)
def test_print_from_an_ssp_is_that_of_its_scenario(version: str, text: str, tmp_path: Path) -> None:
    path, _ = exported(tmp_path, version, text)
    expected = Print(Scenario.load(tmp_path / "block.toml")).run()
    found = Print(scenario_of(path)).run()
    assert found.stop_reason == expected.stop_reason == "done"
    for name in MAPS:
        np.testing.assert_array_equal(found.dataset[name].values, expected.dataset[name].values)


@EVERY_VERSION
@pytest.mark.parametrize("text", [TEXT, OPEN_LOOP], ids=["with its controller", "without"])
def test_system_that_pyssp_has_written_again_is_the_same(version: str, text: str, tmp_path: Path) -> None:
    path, _ = exported(tmp_path, version, text)
    first = scenario_of(path)
    with SSP(path, mode="a") as opened, opened.system_structure:
        pass  # its parameter set stays: pyssp 0.9.1 writes no real number without a unit
    with zipfile.ZipFile(path) as packed:
        assert b"generationDateAndTime" in packed.read("SystemStructure.ssd")
    again = scenario_of(path)
    assert again.tables == first.tables
    assert again.connections == first.connections
    assert again.connections
    expected, found = Print(Scenario.load(tmp_path / "block.toml")).run(), Print(again).run()
    for name in MAPS:
        np.testing.assert_array_equal(found.dataset[name].values, expected.dataset[name].values)


def test_what_an_fmu_cannot_express_stays_outside_with_a_message(tmp_path: Path) -> None:
    path, system = exported(tmp_path, "1.0", OPEN_LOOP)
    assert system.notes() == ["controller is not in it: kind OpenLoop is no FMU"]
    structure = read_ssd(str(path))
    connectors = {connector.name: connector.kind for connector in structure.system.connectors}
    assert connectors["pattern[1,1]"] == connectors["layer_command"] == "input"
    assert connectors["measured_height[6,5]"] == connectors["layers_scanned"] == "output"
    assert "controller is not in it" in structure.system.description
    certified = TEXT.replace("horizon = 2", "horizon = 1\nalpha = 1.0\ncertified = true")
    event = '[[events]]\nat_layer = 1\naction = "override"\nport = "printer.pattern"\nvalue = 0\ncells = [[0, 0]]\n'
    controller, events = system_of(scenario_in(tmp_path, certified + event), "2", tmp_path).notes()
    assert "LayerController.fmu cannot stand in for it: certified is no option" in controller
    assert "the events of the scenario are not in it" in events


def test_foreign_fmu_of_scalars_goes_with_scalars_of_ours(tmp_path: Path) -> None:
    export_fmu("LayerDeposition", fmi="2", nx=6, ny=5, fixed=True, out=tmp_path / "theirs.fmu")
    text = TEXT.replace('kind = "LayerDeposition"', 'kind = "Fmu"\nfile = "theirs.fmu"')
    scenario = scenario_in(tmp_path, text)
    with pytest.raises(ScenarioError, match=r"one is an array, .* --fmi 2 exports inkloop's FMUs with scalars"):
        system_of(scenario, "3", tmp_path)
    assert [part.name for part in system_of(scenario, "2", tmp_path).parts] == ["controller", "printer", "profiler"]
    mapped = text.replace("[components.profiler]", 'ports = { height = "height" }\n[components.profiler]')
    notes = system_of(scenario_in(tmp_path, mapped), "2", tmp_path).notes()
    assert notes == [
        "printer is not in it: inkloop translates its names, units and gains (ports), which a system file does not hold"
    ]


def test_grid_beyond_what_is_quick_in_fmi_2_is_written_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = OPEN_LOOP.replace("nx = 6, ny = 5", "nx = 33, ny = 32")
    system = system_of(scenario_in(tmp_path, text), "2", tmp_path)
    assert len(system.part("printer").scalars("height")) == 33 * 32
    assert "some importers take minutes to read that" in caplog.text


def test_names_that_other_tools_refuse_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"components.my printer: other tools take letters"):
        exported(tmp_path, "1.0", TEXT.replace("[components.printer]", '[components."my printer"]'))


def test_what_no_system_file_can_say_is_an_error(tmp_path: Path) -> None:
    turned = '[[connections]]\nsource = "printer.height"\ntarget = "profiler.height"\nmirror = "x"\n'
    with pytest.raises(ScenarioError) as caught:
        system_of(scenario_in(tmp_path, TEXT + turned), "2", tmp_path)
    assert caught.value.errors == ("connections: printer.height to profiler.height turns a map, which SSP cannot say",)
    (tmp_path / "block.toml").write_text(BLOCK.replace('"LayerMpc"\nhorizon = 1', '"OpenLoop"'), encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        system_of(Scenario.load(tmp_path / "block.toml"), "2", tmp_path)
    first, *others = caught.value.errors
    assert first == "none of its components is an FMU that could be packed"
    assert others == [
        f"{name}: kind {kind} is no FMU"
        for name, kind in {
            "controller": "OpenLoop",
            "printer": "hardware.printer",
            "profiler": "hardware.profiler",
        }.items()
    ]


def test_foreign_fmu_of_fmi_3_stays_out_of_a_system_of_fmi_2(tmp_path: Path) -> None:
    amplifier.build(tmp_path, 3)
    lamp = '[components.lamp]\nkind = "Fmu"\nfile = "amplifier3.fmu"\n'
    scenario = scenario_in(tmp_path, TEXT + lamp)
    (note,) = system_of(scenario, "2", tmp_path).notes()
    assert re.fullmatch(r"lamp is not in it: .*amplifier3\.fmu is FMI 3, all else FMI 2", note)
    assert system_of(scenario, "3", tmp_path).part("lamp").description.fmi == 3


def test_fmpy_runs_the_system_with_the_controller_outside(tmp_path: Path) -> None:
    """Three full layers, commanded from outside at every third step, are the layers of the open loop."""
    path, _ = exported(tmp_path, "1.0", OPEN_LOOP.replace("passes = 4, ", "").replace("diagonal", "raster"))
    expected = Print(Scenario.load(tmp_path / "block.toml")).run().dataset
    with zipfile.ZipFile(path) as opened:
        opened.extract("resources/parameters.ssv", tmp_path)
    pattern = expected["pattern"].values[1]
    inputs: dict[str, Any] = {"layer_command": lambda time: min(3, int(time // 3))}
    for (i, j), value in np.ndenumerate(pattern):
        inputs[f"pattern[{i + 1},{j + 1}]"] = lambda time, value=value: int(value)
        inputs[f"drop_level[{i + 1},{j + 1}]"] = lambda time: 1
    values = read_ssv(str(tmp_path / "resources/parameters.ssv"))
    rows = simulate_ssp(str(path), stop_time=14.0, step_size=1.0, parameter_set=values, input=inputs)
    for (i, j), height in np.ndenumerate(expected["height"].values[-1]):
        assert rows[f"printer.height[{i + 1},{j + 1}]"][-1] == height


@pytest.fixture
def amplified(tmp_path: Path) -> Scenario:
    """Two FMUs of others, the second fed with a gain and an offset."""
    amplifier.build(tmp_path, 2)
    both = "".join(
        f'[components.{name}]\nkind = "Fmu"\nfile = "amplifier2.fmu"\ngain = {g}\n'
        for name, g in (("first", 3.0), ("second", 2.0))
    )
    job = TEXT.split("[components")[0]
    wires = '[[connections]]\nsource = "first.y"\ntarget = "second.x"\ngain = 2.5\noffset_um = 4.0\n'
    wires += '[[connections]]\nsource = "second.y"\ntarget = "first.x"\n'
    return scenario_in(tmp_path, job + both + wires)


def test_gain_offset_and_parameters_of_foreign_fmus_go_and_come_back(amplified: Scenario, tmp_path: Path) -> None:
    (tmp_path / "block.toml").write_text((tmp_path / "block.toml").read_text() + "offset_um = -1.5\n")
    system = system_of(Scenario.load(tmp_path / "block.toml"), "2", tmp_path)
    ssd.write(system, "1.0", tmp_path / "two.ssp")
    read_ssd(str(tmp_path / "two.ssp"))
    again = scenario_of(tmp_path / "two.ssp")
    assert again.connections == [
        Connection("first.y", "second.x", 2.5, pytest.approx(4e-6, rel=1e-9, abs=0.0)),  # type: ignore[arg-type]
        Connection("second.y", "first.x", None, pytest.approx(-1.5e-6, rel=1e-9, abs=0.0)),  # type: ignore[arg-type]
    ]
    assert again.tables.components["first"].options["gain"] == 3.0
    assert "gain" not in again.tables.components["second"].options  # 2 is what the FMU begins with


def test_files_of_libcosim_state_gain_and_offset_of_each_element(amplified: Scenario, tmp_path: Path) -> None:
    root = ET.fromstring(osp_structure(system_of(amplified, "2", tmp_path)))
    begin = "{http://opensimulationplatform.com/MSMI/OSPSystemStructure}"
    lines = root.findall(f"{begin}Functions/{begin}LinearTransformation")
    assert [(line.get("factor"), line.get("offset")) for line in lines] == [("2.5", "4e-06")] * 3
    assert len(root.findall(f"{begin}Connections/{begin}SignalConnection")) == 6
    assert len(root.findall(f"{begin}Connections/{begin}VariableConnection")) == 3
    ways: dict[str, list[tuple[str, str, str]]] = {}
    for connection in root.findall(f"{begin}Connections/{begin}SignalConnection"):
        (variable,), (signal,) = (connection.findall(f"{begin}{kind}") for kind in ("Variable", "Signal"))
        end = (signal.attrib["name"], variable.attrib["simulator"], variable.attrib["name"])
        ways.setdefault(signal.attrib["function"], []).append(end)
    assert set(ways) == {line.attrib["name"] for line in lines}
    assert len({tuple(way) for way in ways.values()}) == 3
    for (give, source, output), (take, target, port) in ways.values():
        assert (give, take) == ("in", "out")
        assert source != target
        assert output.partition("[")[2] == port.partition("[")[2]


def test_file_of_maestro_names_scalars_of_the_fmus(tmp_path: Path) -> None:
    system = system_of(scenario_in(tmp_path), "2", tmp_path)
    tables = maestro_tables(system)
    model = tables[MULTI_MODEL]
    known = {
        f"{{{part.name}}}.{part.name}.{scalar}": variable.causality
        for part in system.parts
        for variable in part.description.variables.values()
        for scalar in (variable.elements or (variable.name,))
    }
    assert {known[source] for source in model["connections"]} == {"output"}
    assert {known[end] for ends in model["connections"].values() for end in ends} == {"input"}
    assert sum(len(ends) for ends in model["connections"].values()) == 5 * 30 + 4
    assert {known[name] for name in model["parameters"]} == {"parameter"}
    assert model["parameters"]["{controller}.controller.mask[1,1]"] is False
    assert tables[CONFIGURATION]["algorithm"] == {"type": "fixed-step", "size": 1.0}


def test_fmus_of_a_folder_begin_with_the_parameters(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario_in(tmp_path)
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--to", "osp", "-o", str(tmp_path / "out")]) == 0
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--to", "osp", "-o", str(tmp_path / "out")]) == 1
    assert "out: is there already; name another place, or remove it" in capsys.readouterr().err
    printer = describe(tmp_path / "out" / "printer.fmu").variables
    controller = describe(tmp_path / "out" / "controller.fmu").variables
    assert (printer["variation"].start, printer["passes"].start) == (("0.2",), ("4",))
    assert controller["mask"].start[0] == "false"
    assert sorted(set(map(float, controller["target_height"].start))) == pytest.approx(
        [0.0, 15.2e-6], rel=1e-9, abs=0.0
    )


@pytest.mark.parametrize(
    ("to", "words"),
    [
        ("ssp", "inkloop run {out} prints it; in another tool import it, communication step 1 s"),
        ("osp", "libcosimpy: CosimExecution.from_osp_config_file(osp_path='{out}'), then simulate_until"),
        (
            "maestro",
            "cd {out} && java -jar maestro.jar import sg1 --interpret -output=out --fmu-search-path=. "
            "simulation.json multimodel.json",
        ),
    ],
)
def test_export_ends_with_what_comes_next(
    to: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario_in(tmp_path)
    out = tmp_path / ("block.ssp" if to == "ssp" else "block")
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--to", to, "-o", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"  next: {words.format(out=out)}"
    if to == "maestro":
        assert all((out / name).is_file() for name in words.split()[-2:])
    if to != "ssp":
        assert describe(out / "printer.fmu").variables["status"].type == (
            "Integer" if to == "maestro" else "Enumeration"
        )


def test_folder_has_the_name_of_scenario_and_format_and_others_fmus_keep_their_binaries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    amplifier.build(tmp_path, 2)
    scenario_in(tmp_path, TEXT + '[components.lamp]\nkind = "Fmu"\nfile = "amplifier2.fmu"\n')
    monkeypatch.chdir(tmp_path)
    native = fmpy.platform_tuple
    assert main(["export", "ssp", "block.toml", "--to", "osp", "--platforms", native]) == 0
    assert describe(tmp_path / "block-osp" / "lamp.fmu").platforms == (fmpy.platform,)
    assert describe(tmp_path / "block-osp" / "printer.fmu").platforms == (fmpy.platform,)


@EVERY_VERSION
def test_job_of_another_grid_is_reported_with_both_grids(version: str, tmp_path: Path) -> None:
    path, _ = exported(tmp_path, version)
    job = tmp_path / "wide.toml"
    job.write_text(TEXT.replace("nx = 6, ny = 5", "nx = 8, ny = 7"), encoding="utf-8")
    message = (
        "controller, printer, profiler: of a grid of 6 x 5 cells, {} of {}; export the .ssp again for that grid, or {}"
    )
    with pytest.raises(ScenarioError) as caught:
        scenario_of(path, job=job)
    assert caught.value.errors == (message.format(job, "8 x 7", "take another job"),)
    with pytest.raises(ScenarioError) as caught:
        scenario_of(path, {"grid.nx": 9})
    assert caught.value.errors == (message.format("the scenario in it", "9 x 5", "leave its grid as it is"),)
    assert scenario_of(path, {"grid.nx": 6}).job().nx == 6
    with pytest.raises(ScenarioError, match=r"grid\.nx is 0; expected") as caught:
        scenario_of(path, {"grid.nx": 0})
    assert "of a grid of" not in str(caught.value)


@pytest.mark.usefixtures("without_pictures")
def test_command_line_exports_and_runs_an_ssp(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario_in(tmp_path)
    path, run = str(tmp_path / "b.ssp"), str(tmp_path / "run")
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "-o", path, "--ssp", "2.0"]) == 0
    assert main(["validate", path]) == 0
    assert main(["run", path, "--no-isolate", "--out", run]) == 0
    assert Result.load(Path(run)).stop_reason == "done"
    assert main(["resume", run, "--no-isolate"]) == 0  # the .ssp is found again: nothing left to do
    assert "the run is finished" in capsys.readouterr().out
    assert main(["validate", str(tmp_path / "block.toml"), "--job", path]) == 1
    assert "--job goes with an .ssp" in capsys.readouterr().err
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--fmi", "3"]) == 1
    assert "SSP 1.0 takes FMI 2 only; add --ssp 2.0" in capsys.readouterr().err
    assert main(["export", "ssp", str(tmp_path / "block.toml"), "--to", "osp", "--fmi", "3", "--ssp", "2.0"]) == 1
    assert "--fmi 3: osp takes FMI 2 only; leave --fmi out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("scan_duration_s = 0.0", "scan_duration_s = 0.0", 34.0),
        ("scan_duration_s = 0.0", "scan_duration_s = 2.5", 34.0 + 11 * 2.5),
        ("variation = 0.2", "variation = 0.2\nlayer_duration_s = 0.5", 34.0 + 11 * 0.5),
        ("[components.controller]", "run = { step_s = 0.5 }\n[components.controller]", 17.0),
        ("[components.controller]", "run = { layers_max = 2 }\n[components.controller]", 7.0),
        ("[components.controller]", "run = { time_max_s = 50.0 }\n[components.controller]", 50.0),
        ("height_um = 15.2", "height_um = 14.0", 34.0),  # 1.8 layers
        ("height_um = 15.2", "height_um = 10.6", 25.0),  # 1.4
        ("scan_duration_s = 0.0", "scan_duration_s = 2.5\n[run]\nlayers_max = 2", 7.0 + 2 * 2.5),
    ],
)
def test_experiment_ends_when_a_print_ought_to_be_over(old: str, new: str, expected: float, tmp_path: Path) -> None:
    """15.2 um are two layers; three times as many and five, in three steps each, and one step."""
    path, _ = exported(tmp_path, "2.0", TEXT.replace(old, new))
    with zipfile.ZipFile(path) as packed:
        (experiment,) = ET.fromstring(packed.read("SystemStructure.ssd")).findall("{*}DefaultExperiment")
    assert (float(experiment.attrib["startTime"]), float(experiment.attrib["stopTime"])) == (0.0, expected)
