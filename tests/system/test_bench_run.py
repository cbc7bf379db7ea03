"""A scenario on devices, between processes: this one, that of the bus, and the emulator.

What the devices ask of the nodes step by step is in `tests/unit/hardware/devices/test_devices.py`.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import can
import cantools
import isotp
import numpy as np
import pytest
import udsoncan
from tools import parts
from udsoncan.client import Client
from udsoncan.connections import PythonIsoTpConnection
from udsoncan.exceptions import UnexpectedResponseException

import inkloop_hardware
from inkloop.cli import main
from inkloop.printing.print import Print
from inkloop.printing.run import print_part
from inkloop.results.recorder import LayerRow
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from support.benches.bench_run import (
    BLOCK,
    PATIENCE_S,
    TWO_INKS,
    assert_same_print,
    emulated,
    printed_with_fmus,
    started,
    wait_for_word,
    write,
)
from support.benches.stock_tools import Raw

pytestmark = pytest.mark.usefixtures("without_pictures")

BRIDGE = TWO_INKS.replace(
    BLOCK[BLOCK.index('shape = "cuboid"') : BLOCK.index("[process]")],
    'shape = "mesh"\nfile = "bridge.stl"\nunit = "mm"\n',
)
DBC = Path(inkloop_hardware.__file__).parent / "protocol" / "inkloop.dbc"


@pytest.mark.parametrize("text", [BLOCK, BRIDGE], ids=["one ink", "two inks, part from a file"])
def test_run_on_a_bench_is_the_run_with_fmus_to_the_bit(text: str, tmp_path: Path) -> None:
    path = write(tmp_path, text)
    legs = [parts.box((at, at + 0.55), (0.0, 1.7), 0.0, 0.0076) for at in (0.0, 1.15)]
    deck = parts.box((0.0, 1.7), (0.0, 1.7), 0.0076, 0.015)
    (tmp_path / "bridge.stl").write_bytes(parts.stl(np.concatenate([*legs, deck])))
    with emulated(path) as (_, channel):
        bench = print_part(Scenario.load(path, {"bench.channel": channel}), folder=tmp_path / "run")
    fmus = printed_with_fmus(path)
    assert fmus.dataset.sizes["layer"] > 3
    assert np.count_nonzero(~fmus.dataset.valid.values) > 0
    pattern = fmus.dataset.pattern.values
    assert ((pattern[1] == 2) & (pattern[2:] == 1).any(axis=0)).any() == (text == BRIDGE), "the deck is on support"
    assert_same_print(bench, fmus)


def test_uneven_substrate_is_under_the_bench_too(tmp_path: Path) -> None:
    overrides = {"substrate": {"wave_um": 3.0, "tilt_x": 1e-3}, "part.height_um": 6.0}
    path = write(tmp_path)
    with emulated(path, overrides) as (_, channel):
        bench = print_part(Scenario.load(path, {"bench.channel": channel, **overrides}))
    assert float(bench.dataset.measured_height[0].std()) > 1e-6
    assert_same_print(bench, printed_with_fmus(path, overrides))


@pytest.mark.long
def test_stock_tools_watch_a_run_and_read_a_journal_in_it(tmp_path: Path) -> None:
    """can.logger is another adapter on the bus, cantools decodes what it saw, udsoncan asks the head between layers."""
    path, seen, kinds = write(tmp_path), tmp_path / "seen.log", list[list[int]]()
    with emulated(path) as (bench, channel):
        words = ["-i", "slcan", "-c", bench.channel, "-b", "500000", "-f", str(seen)]
        logger = subprocess.Popen([sys.executable, "-u", "-m", "can.logger", *words], stdout=subprocess.PIPE, text=True)
        assert logger.stdout
        assert "Connected" in logger.stdout.readline()
        bus = can.Bus(interface="slcan", channel=bench.channel, bitrate=500000, sleep_after_open=0.0)
        notifier = can.Notifier(bus, [])
        ids = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x640, rxid=0x641)
        stack = isotp.NotifierBasedCanStack(bus, notifier, address=ids, params={"tx_padding": 0xCC})
        settings: Any = dict(udsoncan.configs.default_client_config)
        settings |= {"data_identifiers": {"default": Raw()}, "request_timeout": 600, "p2_timeout": 60}

        def read_journal(row: LayerRow) -> None:
            """The answers of the head to the run have the same id; those that are read late are not this one."""
            data = b""
            while not data:
                with suppress(UnexpectedResponseException):
                    data = client.read_data_by_identifier(0x0110).service_data.values[0x0110]
            kinds.append([data[at + 4] for at in range(0, len(data), 40)])

        with Client(PythonIsoTpConnection(stack), config=settings) as client:
            result = Print(
                Scenario.load(path, {"bench.channel": channel}), tmp_path / "run", on_layer=read_journal
            ).run()
        notifier.stop()
        bus.shutdown()
        logger.send_signal(signal.SIGINT)
        logger.communicate(timeout=PATIENCE_S)
    assert result.stop_reason == "done"
    assert len(kinds) == result.dataset.sizes["layer"]
    assert kinds[-1][:8] == [4, 3, 4, 3, 4, 3, 4, 3], "four passes, each an intent and a done"
    database = cantools.database.load_file(DBC)
    for log in (seen, tmp_path / "run" / "traffic.blf"):
        frames = list(can.LogReader(log))
        decoded = {database.get_message_by_frame_id(frame.arbitration_id).name for frame in frames}
        assert {"MasterAlive", "HeadStatus", "HeadRequest", "ProfilerAnswer"} <= decoded
        for frame in frames:
            assert database.decode_message(frame.arbitration_id, bytes(frame.data))


def test_first_interrupt_ends_after_the_layer_and_resume_continues(tmp_path: Path) -> None:
    path, folder = write(tmp_path, BLOCK.replace("height_um = 15.0", "height_um = 9.0")), tmp_path / "run"
    with emulated(path, pass_ms=50) as (_, channel):
        running = started("run", str(path), "--out", str(folder), "--set", f"bench.channel={channel}")
        wait_for_word(folder / "bench.log", "layer 2", running)
        running.send_signal(signal.SIGINT)
        output, _ = running.communicate(timeout=PATIENCE_S)
        assert running.returncode == 130, output
        assert "resume" in output
        layers = Result.load(folder).dataset.sizes["layer"] - 1
        assert main(["resume", str(folder)]) == 0
    assert layers >= 2
    assert_same_print(Result.load(folder), printed_with_fmus(path))


def test_second_interrupt_ends_at_once_with_everything_off(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, folder = write(tmp_path), tmp_path / "run"
    with emulated(path, pass_ms=20_000) as (_, channel):
        running = started("run", str(path), "--out", str(folder), "--set", f"bench.channel={channel}")
        wait_for_word(folder / "bench.log", "pass 1 of 4, layer 1", running)
        for _ in range(2):
            running.send_signal(signal.SIGINT)
            time.sleep(0.3)
        output, _ = running.communicate(timeout=PATIENCE_S)
        assert running.returncode == 130, output
        assert main(["bench", "status", str(path), "--json", "--set", f"bench.channel={channel}"]) == 0
        shown = capsys.readouterr()
        assert "1 unknown, needs a person" in shown.err
        head, *others = json.loads(shown.out)["nodes"]
        assert (head["node"], head["layer"], head["passes"], head["done"], head["unknown"]) == ("head", 1, 4, 0, 1)
        assert "needs a person to clear it" in head["conditions"]
        assert [other["node"] for other in others] == ["stage", "cure", "profiler"]
        assert main(["resume", str(folder)]) == 1
        assert "pass 1 of layer 1" in capsys.readouterr().err


def test_person_stops_a_run_and_releases_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From another terminal, while a pass is jetted: the run ends with a message."""
    path, folder = write(tmp_path), tmp_path / "run"
    with emulated(path, pass_ms=60_000) as (_, channel):
        words = ["--set", f"bench.channel={channel}"]
        running = started("run", str(path), "--out", str(folder), *words)
        wait_for_word(folder / "bench.log", "pass 1", running)
        assert main(["bench", "clear", str(path), *words]) == 1
        assert f"another inkloop prints there (process {running.pid} since" in capsys.readouterr().err
        assert main(["bench", "status", str(path), *words]) == 0
        first, *nodes = capsys.readouterr().out.splitlines()
        assert re.fullmatch(r"session \d+ prints job \d+: nothing was sent, this was heard in \d\.\d s", first)
        assert [line.partition(",")[0] for line in nodes[:2]] == ["head: pass 1 of layer 1", "stage: idle"]
        assert running.poll() is None
        assert main(["bench", "stop", str(path), "--json", *words]) == 0
        assert "head: SAFE because of STOP_REQUEST" in json.loads(capsys.readouterr().out)["lines"]
        output, _ = running.communicate(timeout=PATIENCE_S)
        assert running.returncode == 1
        assert "stop request" in output
        assert main(["bench", "release", str(path), *words]) == 0
        time.sleep(1.0)  # for 300 ms the session of the ended run counts as another master
        assert main(["bench", "clear", str(path), *words]) == 0


@pytest.mark.long
def test_killed_run_resumes_where_it_was_once_a_person_has_looked(tmp_path: Path) -> None:
    """It is killed while the lamp is lit, so that nothing is jetted: the outcome of that cure is unknown."""
    path, folder = write(tmp_path, BLOCK.replace("cure_ms = 2", "cure_ms = 500")), tmp_path / "run"
    with emulated(path, {"part.height_um": 6.0}) as (_, channel):
        words = ["--set", f"bench.channel={channel}", "--set", "part.height_um=6.0"]
        running = started("run", str(path), "--out", str(folder), *words)
        wait_for_word(folder / "bench.log", "lamp on", running)
        running.kill()
        running.communicate()
        assert main(["bench", "clear", str(path), *words]) == 0
        assert main(["resume", str(folder)]) == 0
    assert_same_print(Result.load(folder), printed_with_fmus(path, {"part.height_um": 6.0}))


def test_what_a_person_asks_of_the_nodes_leaves_the_part_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An exact sensor: the scan of the dry run is one of those that its noise is counted by."""
    path, exact = write(tmp_path), {"components.profiler": {"noise_std_um": 0.0, "dropout_rate": 0.0}}
    with emulated(path, exact) as (_, channel):
        for action in ("status", "home", "purge", "dry-run", "stop", "release", "clear"):
            assert main(["bench", action, str(path), "--set", f"bench.channel={channel}"]) == 0
        assert "nothing was jetted or lit" in capsys.readouterr().out
        bench = print_part(Scenario.load(path, {"bench.channel": channel, **exact}))
    assert_same_print(bench, printed_with_fmus(path, exact))


def test_bench_command_runs_until_it_is_interrupted_and_prints_what_to_type(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path)
    running = started("bench", "emulate", str(path), "--port", "0")
    assert running.stdout
    lines = [running.stdout.readline() for _ in range(4)]
    channel = lines[0].partition(" on ")[2].partition(": ")[0]
    second = main(["bench", "emulate", str(path), "--port", channel.rpartition(":")[2]])
    running.send_signal(signal.SIGINT)
    running.communicate(timeout=PATIENCE_S)
    assert f"inkloop run {path} --set bench.interface=slcan --set bench.channel={channel}" in lines[2]
    assert second == 1
    assert "a bench runs there already" in capsys.readouterr().err
    assert running.returncode == 0


@pytest.mark.parametrize(
    ("overrides", "word"),
    [
        (["bench.channel=socket://127.0.0.1:9"], "nothing listens at socket://127.0.0.1:9.*inkloop bench emulate"),
        (["bench.channel=/dev/no-such-adapter"], "no-such-adapter"),
    ],
)
def test_missing_bus_is_reported(
    overrides: list[str], word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path)
    sets = [piece for override in overrides for piece in ("--set", override)]
    assert main(["run", str(path), "--out", str(tmp_path / "run"), *sets]) == 1
    output, error = capsys.readouterr()
    assert ("of computing" in output) == (tmp_path / "run").exists()  # of a folder that is made
    assert "Traceback" not in error
    assert re.search(word, error), error


@pytest.mark.long
@pytest.mark.parametrize(("size", "inks"), [(300, 2), (1000, 1), (1000, 2)])
def test_large_grids_cross_the_bus_whole(size: int, inks: int, tmp_path: Path) -> None:
    side_um = 263.256 * (size - 6)
    changes = {
        "grid": {"nx": size, "ny": size},
        "part": {"size_x_um": side_um, "size_y_um": side_um},
        "run.layers_max": 1,
        "process.passes": 1,
        "components.controller.kind": "OpenLoop",
        "bench.silence_s": 10.0,  # a million cells are scanned in one go; a second scan would have other noise
    }
    text = (TWO_INKS if inks == 2 else BLOCK).replace("horizon = 1\n", "")
    path = write(tmp_path, text)
    with emulated(path, changes) as (_, channel):
        bench = print_part(Scenario.load(path, {"bench.channel": channel, **changes}))
    fmus = printed_with_fmus(path, changes)
    for name in ("pattern", "measured_height", "valid"):
        np.testing.assert_array_equal(bench.dataset[name], fmus.dataset[name], err_msg=name)
