"""The bench of a scenario: its emulator, one action on it, and what a replay reports."""

from __future__ import annotations

import argparse
import re
import sys
import types
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr

from inkloop.bench import commands
from inkloop.bench.commands import emulation_of
from inkloop.bench.replay import differences
from inkloop.cli import main
from inkloop.component import Job, Port, Values
from inkloop.components import catalog
from inkloop.components.devices import KINDS
from inkloop.components.kind import Bench
from inkloop.errors import ComponentError, ScenarioError
from inkloop.fmu import describe
from inkloop.fmu_writer.archive import unpack
from inkloop.printing.on_devices import check_listening, local_port
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.tables.schema import BenchTable
from inkloop.testing import job
from inkloop_hardware.devices import commands as actions
from support.benches.bench_run import FMUS, TWO_INKS, write
from support.places import ROOT, SCENARIOS


@pytest.mark.parametrize("overrides", [{}, FMUS], ids=["devices", "FMUs"])
def test_bench_has_grid_ink_sensor_and_seeds_of_the_scenario(overrides: dict[str, str], tmp_path: Path) -> None:
    scenario = Scenario.load(write(tmp_path, TWO_INKS), overrides)
    found = emulation_of(scenario).parameters
    assert (found["nx"], found["ny"]) == (12, 11)
    assert (found["h1_a"], found["h1_b"]) == (4.4e-6, 3.9e-6)
    assert (found["variation"], found["variation_kind"], found["resolution"]) == (0.2, 1, 1e-7)
    assert found["printer_seed"] == scenario.job("printer").seed
    assert found["sensor_seed"] == scenario.job("profiler").seed
    assert (found["alive_ms"], found["watchdog_ms"]) == (1000, 1000)  # a second of silence
    assert emulation_of(scenario).surface is None
    uneven = Scenario.load(tmp_path / "block.toml", {"substrate.wave_um": 3.0})
    np.testing.assert_array_equal(emulation_of(uneven).surface, uneven.job("printer").height_start)


def test_exported_bench_begins_with_surface_and_faults_of_the_scenario(tmp_path: Path) -> None:
    """Cell (i, j) at 11 i + j, in the description and in the file that the binary reads."""
    out, uneven = tmp_path / "out" / "it.fmu", "substrate.wave_um=3.0"
    faults = "bench.faults=[{kind='loss', probability=0.5}, {kind='unplugged'}]"
    words = ["--out", str(out), "--set", uneven, "--set", faults]
    assert main(["export", "bench", str(write(tmp_path)), *words]) == 0
    surface = Scenario.load(tmp_path / "block.toml", {"substrate.wave_um": 3.0}).job("printer").height_start
    assert surface is not None
    assert surface.shape == (12, 11)
    variables = describe(out).variables
    np.testing.assert_array_equal([float(text) for text in variables["height_start"].start], surface.ravel())
    assert variables["faults"].start == ("loss:probability=0.5; unplugged",)
    members = unpack(out)
    assert surface.astype("<f8").tobytes() in members["resources/bench.bin"]
    assert b"wave_um = 3.0" in members["documentation/scenario.toml"]


def test_grid_has_as_many_cells_as_a_node_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    firmware = (ROOT / "hardware/firmware/node/pattern.h").read_text(encoding="utf-8")
    factors = re.findall(r"PATTERN_CELLS_MAX = (\d+) \* (\d+)", firmware)
    assert [int(one) * int(other) for one, other in factors] == [commands.NODE_CELLS_MAX]
    scenario = Scenario.load(write(tmp_path))
    monkeypatch.setattr(commands, "NODE_CELLS_MAX", 12 * 11)
    assert emulation_of(scenario).faults == ()
    monkeypatch.setattr(commands, "NODE_CELLS_MAX", 12 * 11 - 1)
    with pytest.raises(ScenarioError, match="grid of 12 x 11 cells: the nodes of the bench hold up to 131 cells"):
        emulation_of(scenario)


def test_job_of_the_printer_is_that_of_its_table_and_without_one_that_of_the_scenario(tmp_path: Path) -> None:
    options = {"components.printer.passes": 1, "components.controller.horizon": 2}
    scenario = Scenario.load(write(tmp_path), options)
    assert (commands.job_of_printer(scenario).passes, scenario.job().passes) == (1, 4)
    assert commands.job_of_printer(scenario).seed == scenario.job("printer").seed
    assert commands.job_of_printer(Scenario.load(tmp_path / "block.toml", FMUS)).passes == 4


def test_options_that_only_the_fmus_have_are_all_named(tmp_path: Path) -> None:
    overrides = {"components.printer": {"roller_step_um": 3.0, "layer_period_s": 2.0}}
    with pytest.raises(ScenarioError, match="2 errors") as refused:
        emulation_of(Scenario.load(write(tmp_path), overrides))
    assert "components.printer.roller_step is not emulated" in str(refused.value)


@pytest.mark.parametrize(
    ("channel", "port"),
    [("socket://127.0.0.1:28550", 28550), ("socket://10.0.0.7:28550", None), ("can0", None), (None, None)],
)
def test_only_a_port_of_this_machine_is_one_for_the_emulator(channel: str | None, port: int | None) -> None:
    assert local_port(channel) == port


def test_run_without_a_bench_leaves_no_folder_and_the_message_names_what_to_start(tmp_path: Path) -> None:
    path = write(tmp_path)
    scenario = Scenario.load(path, {"bench.channel": "socket://127.0.0.1:9"})
    with pytest.raises(ComponentError, match=rf"`inkloop bench emulate {path}` in another terminal"):
        check_listening(scenario)
    assert main(["run", str(path), "--out", str(tmp_path / "run"), "--set", "bench.channel=socket://127.0.0.1:9"]) == 1
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("overrides", "word"), [([], "bench.channel are not set"), (["bench.channel=can0"], "bench.channel is 'can0'")]
)
def test_bench_without_a_channel_is_an_error(
    overrides: list[str], word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = [piece for override in overrides for piece in ("--set", override)]
    assert main(["bench", "emulate", str(write(tmp_path)), *sets]) == 1
    assert word in capsys.readouterr().err


def test_options_of_a_device_are_those_of_the_model_in_its_place() -> None:
    for kind, device in KINDS.items():
        assert not catalog.check(kind, job(), {"seed": 3}).errors
        of_device, of_model = (
            catalog.check(name, job(), {"bla": 1, "nx": "x"}).errors for name in (kind, device.model)
        )
        assert of_device == of_model


def test_passes_of_the_options_are_those_that_the_printer_jets() -> None:
    options = {"passes": 4, "pass_order": "diagonal", "pass_rotation": 3}
    printer = catalog.make("hardware.printer", job(), options, Bench(BenchTable(cure_ms=70)))
    own = printer._job  # type: ignore[attr-defined]
    assert (own.passes, own.pass_order, own.pass_rotation, printer._cure_ms) == (4, 2, 3, 70)  # type: ignore[attr-defined]


def test_every_key_of_the_bench_arrives_at_its_bus(tmp_path: Path) -> None:
    """Each with a value of its own."""
    keys = {
        "interface": "socketcan", "channel": "can3", "bitrate": 250_000, "data_bitrate": 2_000_000,
        "bit_rate_switch": True, "loop_timeout_s": 11.0, "grace_s": 0.75, "answer_s": 1.25, "silence_s": 0.5,
    }  # fmt: skip
    more = {"options": {"fd": True}, "valid_share": 0.625, "on_part": True}
    rig = Bench(BenchTable.model_validate(keys | more), tmp_path).rig
    assert {key: getattr(rig.settings, key) for key in keys} == keys
    assert rig.settings.options == {"fd": True}
    assert (rig.folder, rig.valid_share, rig.on_part) == (tmp_path, 0.625, True)


def test_traffic_of_a_resumed_run_does_not_replace_that_of_its_first_part(tmp_path: Path) -> None:
    names = []
    for _ in range(3):
        names.append(str(Bench(BenchTable(), tmp_path).rig.settings.traffic_log))
        (tmp_path / names[-1]).touch()
    assert names == ["traffic.blf", "traffic-2.blf", "traffic-3.blf"]
    assert Bench(BenchTable(traffic_log=""), tmp_path).rig.settings.traffic_log is None
    assert Bench(BenchTable()).rig.settings.traffic_log is None


class Blower:
    """A third party's device."""

    inputs = ()
    outputs = (Port("speed", "m/s"),)

    def __init__(self, job: Job, *, speed: float = 1.0) -> None:
        self.rig: Any = None

    def use_rig(self, rig: Any) -> None:
        self.rig = rig

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return {}

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        return {}

    def terminate(self) -> None: ...


def test_device_of_a_third_party_is_given_the_rig_of_its_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "blowers", types.SimpleNamespace(Blower=Blower))
    bench = Bench(BenchTable(channel="can0"))
    assert catalog.make("blowers:Blower", job(), {"speed": 2.0}, bench).rig is bench.rig  # type: ignore[attr-defined]


def test_dry_run_takes_the_passes_of_the_printer_and_the_light_of_the_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    """They may stand in the table of the printer alone."""
    given: list[tuple[Job, int]] = []

    def dry_run(rig: Any, job: Job, *, cure_ms: int) -> list[str]:
        given.append((job, cure_ms))
        return ["done"]

    monkeypatch.setattr(actions, "dry_run", dry_run)
    monkeypatch.setattr(commands, "Bench", lambda table: Mock(rig=nullcontext()))
    monkeypatch.setattr(commands, "check_listening", Mock())
    monkeypatch.setattr(commands, "live_words", lambda *_: nullcontext())
    options = {"passes": 4, "pass_order": "diagonal", "pass_rotation": 1}
    overrides = {f"components.printer.{name}": value for name, value in options.items()}
    scenario = Scenario.load(SCENARIOS / "bench.toml", {**overrides, "bench.cure_ms": 70})
    commands.act(scenario, "dry-run", Mock())
    ((job, cure_ms),) = given
    assert (job.passes, job.pass_order, job.pass_rotation, cure_ms) == (4, 2, 1, 70)


def run(layers: int = 3) -> Result:
    """A run with a cell that was never measured."""
    height = np.arange(layers * 6, dtype=np.float64).reshape(layers, 2, 3)
    height[:, 1, 2] = np.nan
    dims = ("layer", "x", "y")
    return Result(
        xr.Dataset({"pattern": (dims, np.ones((layers, 2, 3), np.int32)), "measured_height": (dims, height)}), {}
    )


def test_replay_that_differs_is_reported_with_layer_and_cell_or_as_too_short() -> None:
    again = run()
    assert differences(run(), again) == []
    again.dataset["pattern"].values[1:, 0, 1] = 2
    again.dataset["pattern"].values[2, 1, 0] = 0
    again.dataset["measured_height"].values[2, 1, 2] = 1.0
    patterns, scans = differences(run(), again)
    assert "from layer 1 on: 1 cells, the first is (0, 1), 1 in the run and 2 in the replay" in patterns
    assert "from layer 2 on: 1 cells, the first is (1, 2), nan in the run and 1 in the replay" in scans
    assert differences(run(3), run(2)) == ["the replay has 1 layer, the run 2 layers"]
    assert differences(run(2), run(1)) == ["the replay has 0 layers, the run 1 layer"]
    assert differences(run(2), run(3)) == []


class Emulated:
    """Stands for the emulator at once ended by Ctrl-C; `given` are its arguments, `channel` where it listens."""

    given: dict[str, Any]

    def __init__(self, parameters: dict[str, float], **given: Any) -> None:
        Emulated.given = {"parameters": parameters, **given}
        self.channel = f"socket://127.0.0.1:{given['port'] or 4711}"

    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...

    def wait(self) -> int:
        raise KeyboardInterrupt


def emulated(scenario: Scenario | None, **chosen: Any) -> tuple[dict[str, Any], list[str], dict[str, Any]]:
    """Arguments of the emulator, the lines that are shown, and the result."""
    options = argparse.Namespace(**{"port": None, "pty": False, "folder": None, "fault": [], **chosen})
    console = Mock()
    assert commands.emulate(scenario, options, console) == 0
    return Emulated.given, [each.args[0] for each in console.sentence.mock_calls], console.result.call_args.kwargs


def test_emulator_listens_where_it_is_asked_to_and_says_what_to_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inkloop_hardware.emulated_bench.EmulatedBench", Emulated)
    here = {"bench.channel": "socket://127.0.0.1:28550", "bench.faults": [{"kind": "unplugged"}]}
    scenario = Scenario.load(write(tmp_path), here)
    given, lines, result = emulated(scenario, fault=["loss:probability=0.5"], folder=Path("kept"))
    assert (given["port"], given["terminal"], given["folder"]) == (28550, False, Path("kept"))
    assert [fault.partition(":")[0] for fault in given["faults"]] == ["unplugged", "loss"]
    assert [line for line in lines if line.startswith("injected fault: ")] == [
        f"injected fault: {fault}" for fault in given["faults"]
    ]
    assert f"in another terminal: inkloop run {scenario.source}" in lines
    assert lines[1] == f"12 x 11 cells, ink and sensor from {scenario.source}"
    assert lines[-1] == "Ctrl-C ends it; journals and surface are kept in kept"
    assert result == {"channel": "socket://127.0.0.1:28550"}
    given, lines, _ = emulated(scenario, port=0)
    assert given["port"] == 0
    assert lines[-2] == (
        f"in another terminal: inkloop run {scenario.source} --set bench.interface=slcan "
        "--set bench.channel=socket://127.0.0.1:4711"
    )
    assert lines[-1] == "Ctrl-C ends it; the next start is a new part"
    given, lines, _ = emulated(None)
    assert (given["parameters"], given["port"], given["faults"], given["surface"]) == ({}, 0, [], None)
    assert not any("cells" in line for line in lines)


def test_lines_of_an_action_are_shown_and_the_records_of_nodes_are_json_too() -> None:
    console = Mock()
    commands._show(["done"], console)
    console.result.assert_called_once_with(lines=["done"])
    record = BusEvent("head", 3)
    commands._show(["done", record], console)
    console.result.assert_called_with(lines=["done", str(record)], nodes=[{"node": "head", "count": 3}])
    assert [each.args[0] for each in console.sentence.mock_calls] == ["done", "done", str(record)]


@dataclass(frozen=True)
class BusEvent:
    """A record of a node."""

    node: str
    count: int
