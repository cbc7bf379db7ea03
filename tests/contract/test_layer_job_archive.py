"""The FMU of a block: valid for all checkers, complete, usable in other masters, or refused with a message."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET
import zipfile
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import fmpy
import numpy as np
import pytest
from lxml import etree
from matplotlib.figure import Figure

from inkloop.cli import main
from inkloop.component import Ink, Job
from inkloop.errors import FmuError, ScenarioError
from inkloop.exchange import layer_job
from inkloop.exchange.job_picture import target_picture
from inkloop.exchange.layer_job import _obstacles, bake
from inkloop.exchange.ssp.system import System, Wire
from inkloop.fmu_writer.archive import unpack
from inkloop.fmu_writer.export import export_fmu
from inkloop.master.wiring import Transfer
from inkloop.scenario.file import Scenario
from support.fmus.fmu_checkers import by_fmpy, by_fmutool
from support.fmus.fmu_driver import OK, Driver
from support.fmus.layer_jobs import CUBOID, DONE, MODEL, printed, unpacked
from support.fmus.library_symbols import assert_of_the_standard
from support.masters.other_programs import LIBCOSIM
from support.places import SCENARIOS
from support.prints import quick_cuboid, scenario

FORMS = ("fmi2", "fmi3-fixed")
EVERY_FORM = pytest.mark.parametrize("form", FORMS, scope="module")


@pytest.fixture(scope="module")
def file(form, tmp_path_factory) -> Path:
    """The block of the cuboid, exported once per form; tests only read it."""
    path = tmp_path_factory.mktemp(form) / "cuboid.fmu"
    assert main(["export", "job", str(quick_cuboid()), "--fmi", form[3], "--out", str(path)]) == 0
    return path


@pytest.mark.system
@EVERY_FORM
def test_checkers_of_others_find_nothing_wrong_and_three_lines_print_the_part(file, form) -> None:
    assert by_fmpy(file) == by_fmutool(file) == []
    (binary,) = (content for name, content in unpack(file).items() if name.startswith("binaries/"))
    assert_of_the_standard(binary, form[3])
    result = fmpy.simulate_fmu(str(file))
    run = printed("cuboid", *CUBOID)
    assert result["status"][-1] == DONE
    assert result["layers_printed"][-1] == run.sizes["layer"] - 1
    assert result["std"][-1] == pytest.approx(float(run["std"][-1]), rel=1e-9, abs=0.0)


@pytest.mark.system
@EVERY_FORM
def test_steps_and_inputs_of_an_importer_count(file) -> None:
    signals = np.array([(0.0, False), (4.5, True)], dtype=[("time", float), ("start", bool)])
    result = fmpy.simulate_fmu(
        str(file), input=signals, step_size=0.5, output_interval=0.5, stop_time=30.0, start_values={"layer_period": 2.0}
    )
    begun = dict(zip(result["time"], result["layers_printed"], strict=True))
    assert (begun[6.0], begun[6.5], begun[8.5]) == (0, 1, 2)


@EVERY_FORM
def test_no_variable_is_an_array_and_none_lacks_a_description(file) -> None:
    description = fmpy.read_model_description(str(file))
    assert not [v.name for v in description.modelVariables if v.dimensions or "[" in v.name]
    assert all(v.description for v in description.modelVariables)
    errors = {"mean_error", "mae", "std", "height_mean", "objective"}
    scans = {"scan_shift_x", "scan_shift_y", "scan_spot_radius"}
    assert {v.name for v in description.modelVariables if v.unit == "m"} == errors | scans
    assert description.defaultExperiment.stepSize == "1.0"


@EVERY_FORM
def test_start_values_are_those_of_the_scenario(form, tmp_path) -> None:
    folder = unpacked(form, "noisy-sensor", ("components.controller.alpha", 0.7))
    with Driver(MODEL, form, folder=folder) as fmu:
        description = fmpy.read_model_description(folder)
        starts = {v.name: v.start for v in description.modelVariables if v.causality in ("parameter", "input")}
        words = {"true": 1.0, "false": 0.0}
        assert {name: float(words.get(text, text)) for name, text in starts.items()} == {
            name: float(fmu.get(name)) for name in starts
        }
        assert (starts["alpha"], starts["scan_duration"], starts["layer_period"]) == ("0.7", "6.0", "6.0")


@EVERY_FORM
def test_archive_states_what_is_baked(file) -> None:
    with zipfile.ZipFile(file) as archive:
        page = archive.read("documentation/index.html").decode()
        text = archive.read("documentation/scenario.toml").decode()
        assert archive.read("documentation/target.png").startswith(b"\x89PNG")
    assert Scenario.of_text(text, "it.toml").text == text
    assert "Cuboid, 8 x 8 droplets (" in page
    assert ": 12 x 12 cells of 263.256 µm, 64 of them printed, up to 40 µm high" in page
    assert 'src="target.png"' in page
    assert "<td>printer</td><td>LayerDeposition</td><td>variation</td><td>0.2</td>" in page


@pytest.mark.parametrize("form", ["fmi3-fixed"], scope="module")
def test_terminals_are_valid_and_name_every_input_and_output(file) -> None:
    schema = etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"))
    with zipfile.ZipFile(file) as archive:
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    schema.assertValid(root)
    variables = fmpy.read_model_description(str(file)).modelVariables
    members = [member.get("variableName") for member in root.iter("TerminalMemberVariable")]
    assert members == [v.name for v in variables if v.causality in ("input", "output")]


def test_same_scenario_gives_the_same_bytes_and_another_one_another_token(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    files = [tmp_path / f"{number}.fmu" for number in range(3)]
    for path, seed in zip(files, (1, 1, 2), strict=True):
        command = ["export", "job", str(quick_cuboid()), "--set", f"seed={seed}", "--out", str(path)]
        assert main(command) == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    guids = [ET.fromstring(zipfile.ZipFile(path).read("modelDescription.xml")).get("guid") for path in files]
    assert guids[0] == guids[1] != guids[2]


@pytest.mark.system
@pytest.mark.parametrize("form", ["fmi2"], scope="module")
@pytest.mark.skipif(bool(LIBCOSIM.reason_it_is_absent()), reason=LIBCOSIM.reason_it_is_absent())
def test_libcosim_prints_the_part(file) -> None:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(step_size=500_000_000)
    number = execution.add_local_slave(CosimLocalSlave(fmu_path=str(file), instance_name="job"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    references = {v.name: v.valueReference for v in fmpy.read_model_description(str(file)).modelVariables}
    while observer.last_integer_values(number, [references["status"]])[0] != DONE:
        assert execution.step()
    run = printed("cuboid", *CUBOID)
    layers = observer.last_integer_values(number, [references["layers_printed"]])[0]
    (mean,) = observer.last_real_values(number, [references["height_mean"]])
    assert (layers, mean) == (run.sizes["layer"] - 1, run["height_mean"].values[-1])


@pytest.mark.parametrize("converts", ["gain = 1.01", "offset_um = 2.0"])
def test_scenario_that_cannot_be_baked_is_answered_with_every_obstacle(converts: str) -> None:
    text = (SCENARIOS / "cuboid.toml").read_text()
    text = text.replace('kind = "LayerMpc"\nalpha = 0.8', 'kind = "OpenLoop"')
    text += '\n[[events]]\nport = "printer.volume_factor"\naction = "override"\nvalue = 0.9\nat_layer = 2\n'
    text += '\n[[connections]]\nsource = "printer.height"\ntarget = "profiler.height"\n' + converts
    with pytest.raises(ScenarioError) as raised:
        bake(Scenario.of_text(text, str(SCENARIOS / "it.toml")))
    errors = "\n".join(raised.value.errors)
    assert "components.controller: kind OpenLoop is no FMU; a block is made of LayerMpc, LayerDeposition" in errors
    assert "connections: printer.height to profiler.height has a gain or an offset" in errors
    assert "[[events]]" in errors
    with pytest.raises(ScenarioError, match=r"components\.printer: kind hardware\.printer is no FMU"):
        bake(scenario("bench"))


def test_picture_of_the_target_is_cut_through_the_middle_of_the_part(monkeypatch: pytest.MonkeyPatch) -> None:
    mask, drawn = np.zeros((20, 18), np.bool_), list[Figure]()
    mask[1:17, 5:8] = True
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda figure, *to, **how: [drawn.append(figure), save(figure, *to, **how)])
    picture = target_picture(Job(20, 18, 1e-4, np.where(mask, 3e-5, 0.0), mask), "Wall")
    assert picture.startswith(b"\x89PNG")
    above, cut, _ = drawn[0].axes
    assert above.lines[0].get_ydata() == pytest.approx([0.6, 0.6], rel=1e-9, abs=0.0)
    for axes, edges in ((above, [-0.05, 1.95, -0.05, 1.75]), (cut, [-0.05, 1.95, 0.0, 30.0])):
        assert axes.images[0].get_extent() == pytest.approx(edges, rel=1e-9, abs=0.0)
    assert above.images[0].get_array().count(axis=0).tolist() == [0, *[3] * 16, 0, 0, 0]


class Below:
    """Ink A lies below 20 um, and farther along x it reaches higher."""

    def contains(self, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        return z < np.where(x > 2.5e-4, 2.5e-5, 2e-5)

    def intervals(self, x: np.ndarray, y: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        raise NotImplementedError


def test_picture_of_two_inks_shows_each_where_it_belongs(monkeypatch: pytest.MonkeyPatch) -> None:
    """From above at half of the height; the cut goes through a quarter of the part, in 200 rows up to the top."""
    mask, drawn = np.zeros((6, 9), np.bool_), list[Figure]()
    mask[1:5, 2:7] = True
    target = np.where(mask, 4.8e-5, 0.0)
    target[1] /= 2.0
    monkeypatch.setattr(Figure, "savefig", lambda figure, *to, **how: drawn.append(figure))
    inks = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
    target_picture(Job(6, 9, 1e-4, target, mask, inks=inks, region=Below()), "Steps")
    above, cut = drawn[0].axes
    assert above.lines[0].get_ydata() == pytest.approx([0.3, 0.3], rel=1e-9, abs=0.0)
    shown: list[Any] = [axes.images[0].get_array() for axes in (above, cut)]
    ink, rows = (np.ma.filled(each, np.nan) for each in shown)
    np.testing.assert_array_equal(np.unique(ink[2:7, 1:3]), [1.0])  # at 24 um
    np.testing.assert_array_equal(np.unique(ink[2:7, 3:5]), [0.0])
    assert np.isfinite(ink).sum() == mask.sum()
    counts = [[int((column == ink).sum()) for ink in (0.0, 1.0)] for column in rows.T]
    expected = [[0, 0], [20, 4], [20, 28], [25, 23], [25, 23], [0, 0]]
    assert counts == [[pytest.approx(um * 200 / 48, abs=1) for um in each] for each in expected]


def test_block_without_a_scenario_is_not_exported(tmp_path) -> None:
    with pytest.raises(FmuError, match="inkloop export job SCENARIO"):
        export_fmu(MODEL, fmi="2", nx=9, ny=9, fixed=True, out=tmp_path / "it.fmu")


@EVERY_FORM
def test_state_of_another_print_is_refused(form) -> None:
    """Two blocks are of one binary; their layers are not."""
    with Driver(MODEL, form, folder=unpacked(form, "cuboid", *CUBOID)) as fmu:
        assert fmu.start().step(0.0, 3.0) == OK
        with Driver(MODEL, form, folder=unpacked(form, "cylinder")) as other:
            assert other.restore(fmu.save()) != OK


def test_layer_takes_as_long_as_printing_and_scanning_it() -> None:
    durations = {"components.printer.layer_duration_s": 2.0, "components.profiler.scan_duration_s": 6.0}
    limits = {"components.controller.alpha": 0.7, "components.controller.time_limit_s": 3.5}
    own = bake(Scenario.load(quick_cuboid(), durations | limits | {"run.step_s": 1.0})).own
    assert (own["alpha"], own["time_limit"]) == (0.7, 3.5)
    assert (own["layer_duration"], own["scan_duration"], own["layer_period"]) == (2.0, 6.0, 8.0)
    assert bake(Scenario.load(quick_cuboid(), durations | {"run.step_s": 30.0})).own["layer_period"] == 30.0


def test_importer_is_offered_the_period_of_a_layer_and_the_time_of_the_print(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    durations = {"components.printer.layer_duration_s": 2.0, "components.profiler.scan_duration_s": 6.0}
    own = bake(Scenario.load(quick_cuboid(), durations))
    found: list[Any] = []
    monkeypatch.setattr(layer_job, "described", lambda members, *more: found.append(more[-1]) or members)
    monkeypatch.setattr(layer_job, "pack", lambda out, members: None)
    layer_job.write(own, "2", tmp_path / "it.fmu", picture=False)
    (baked,) = found
    assert (baked.step_size, baked.stop_time) == (8.0, own.stop_s)
    assert own.stop_s > 8.0


def test_maps_of_a_job_lie_there_with_the_last_index_fastest() -> None:
    value = np.arange(6, dtype=np.int32).reshape(2, 3)
    assert layer_job._parameter(7, value) == struct.pack("<QQ6d", 7, 6, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0)


def obstacles(roles: dict[str, str], *wires: Wire, outside: dict[str, str] | None = None) -> list[str]:
    """Those of components of our kinds with these roles."""
    tables: Any = SimpleNamespace(components={name: SimpleNamespace(kind="LayerDeposition") for name in roles})
    scenario: Any = SimpleNamespace(tables=tables)
    return list(_obstacles(scenario, System("it", "It", (), wires, outside or {}, 1.0, 9.0, ""), roles))


def test_block_has_one_part_of_each_role_and_wires_of_the_contract() -> None:
    assert obstacles({"p": "printer", "q": "printer", "s": "profiler"}) == [
        "p and q are each a printer; a block has one: keep one",
        "no component is the controller of the block; add one of kind LayerController",
    ]
    lamp = "components.lamp: is no FMU; a block is made of "
    (error,) = obstacles({"p": "printer", "s": "profiler"}, outside={"lamp": "is no FMU"})
    assert error.startswith(lamp)
    whole = {"c": "controller", "p": "printer", "s": "profiler"}
    good = [
        Wire(one, other, 1.0, 0.0, Transfer())
        for one, other in ((("p", "height"), ("s", "height")), (("lamp", "on"), ("p", "pattern")))
    ]
    assert obstacles(whole, *good) == []
    odd = [
        Wire(("p", "height"), ("s", "bias"), 1.0, 0.0, Transfer()),
        Wire(("p", "surface"), ("s", "height"), 1.0, 0.0, Transfer()),
        Wire(("p", "droplets_a"), ("c", "droplets_a"), 1.0, 0.0, Transfer()),
        Wire(("s", "measured_height"), ("p", "measured_height"), 1.0, 0.0, Transfer()),
        Wire(("p", "height"), ("s", "height"), 2.0, 0.0, Transfer()),
        Wire(("p", "height"), ("s", "height"), 1.0, 1e-6, Transfer()),
    ]
    assert [error.partition("connections: ")[2].partition(",")[0] for error in obstacles(whole, *odd)] == [
        "p.height to s.bias is none of the layer contract",
        "p.surface to s.height is none of the layer contract",
        "p.droplets_a to c.droplets_a is none of the layer contract",
        "s.measured_height to p.measured_height is none of the layer contract",
        "p.height to s.height has a gain or an offset",
        "p.height to s.height has a gain or an offset",
    ]


def test_limit_of_time_stays_out_of_a_block_and_that_of_layers_is_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    limited = Scenario.load(quick_cuboid(), {"run.time_max_s": 50.0, "run.layers_max": 7})
    baked = bake(limited)
    assert (baked.own["layers_max"], baked.stop_s) == (7, 50.0)
    written: list[tuple[Any, ...]] = []
    monkeypatch.setattr(layer_job, "bake", lambda scenario: baked)
    monkeypatch.setattr(layer_job, "write", lambda *what, **how: written.append(what))
    for own, told in ((limited, True), (Scenario.load(quick_cuboid()), False)):
        console = Mock()
        assert layer_job.export(own, Namespace(out=None, fmi="2", platforms=None), console) == 0
        first, *others = [each.args[0] for each in console.sentence.mock_calls]
        assert first.endswith(".fmu: LayerDeposition, ProfileSensor, LayerController in one block, a layer each 1 s")
        assert any("time_max_s is not in it" in line for line in others) is told
    assert [what[:2] for what in written] == [(baked, "2")] * 2


def test_values_of_a_block_are_shown_by_size_and_range() -> None:
    assert layer_job._shown(np.arange(6.0).reshape(2, 3)) == "2 x 3 values, 0.0 to 5.0"
    assert layer_job._shown(np.asarray(True)) == "True"
