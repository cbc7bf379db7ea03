"""A run on a bench, repeated from its log: the same requests, patterns and maps, or the first difference."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import can
import numpy as np
import pytest
from can.io import BLFWriter

from inkloop.bench.commands import emulation_of
from inkloop.cli import main
from inkloop.commands.options import overrides_of
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_hardware.emulated_bench import EmulatedBench
from support.benches.bench_run import BLOCK, FAST, PATIENCE_S, TWO_INKS, started, wait_for_word, write

pytestmark = pytest.mark.usefixtures("without_pictures")

ARRAYS = ("pattern", "measured_height", "valid", "estimated_height", "droplets_a", "droplets_b")


def recorded(folder: Path, text: str = BLOCK, faults: tuple[str, ...] = (), *overrides: str) -> Path:
    """A run on a bench, with its log."""
    path = write(folder, text)
    emulation = emulation_of(Scenario.load(path, overrides_of(overrides, str(path))))
    with EmulatedBench(emulation.parameters | FAST, surface=emulation.surface, faults=faults) as bench:
        channel = f"bench.channel={bench.channel}"
        words = [word for override in (channel, *overrides) for word in ("--set", override)]
        assert main(["run", str(path), "--no-pictures", "--out", str(folder / "run"), *words]) == 0
    return folder / "run"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("recorded"))


@pytest.fixture
def replayed(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """The command: its exit code, and its whole output, of both streams, in one line."""

    def replay(folder: Path, *words: str) -> tuple[int, str]:
        code = main(["bench", "replay", str(folder), *words])
        captured = capsys.readouterr()
        return code, " ".join((captured.out + captured.err).split())

    return replay


def assert_same(run: Path, again: Path) -> None:
    """All arrays to the bit."""
    one, other = Result.load(run).dataset, Result.load(again).dataset
    for name in ARRAYS:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


def test_master_does_the_same_again_without_a_bus(run: Path, replayed: Callable[..., tuple[int, str]]) -> None:
    code, output = replayed(run, "--json", "--out", str(run.parent / "again"))
    assert code == 0
    assert output.startswith('{ "same": true, "differences": [] }')
    assert "3 layers replayed: every request of the master is that of" in output
    assert_same(run, run.parent / "again")
    log = (run.parent / "again" / "bench.log").read_text()
    assert "replay on" in log
    assert "head: pass 4 of 4, layer 3" in log


@pytest.mark.parametrize(
    ("text", "faults", "overrides"),
    [
        pytest.param(TWO_INKS, (), ['bench.traffic_log="traffic.asc"', "part.height_um=9.0"], marks=pytest.mark.long),
        pytest.param(BLOCK, ("loss:probability=1e-2",), ["part.height_um=9.0"], marks=pytest.mark.long),
        (BLOCK, ("corruption:id=0x647,way=from-nodes,nth=9,byte=3",), ["part.height_um=9.0"]),
    ],
    ids=["two inks, ASC", "one frame in a hundred lost", "a map that was altered on the way"],
)
def test_retries_and_repeats_of_the_recorded_run_are_gone(
    text: str,
    faults: tuple[str, ...],
    overrides: list[str],
    tmp_path: Path,
    replayed: Callable[..., tuple[int, str]],
) -> None:
    run = recorded(tmp_path, text, faults, *overrides)
    assert bool(faults) == ("requests sent again" in (run / "bench.log").read_text())
    code, output = replayed(run, "--out", str(tmp_path / "again"))
    assert code == 0, output
    assert_same(run, tmp_path / "again")


def test_other_controller_is_reported_with_the_first_differing_cell(
    run: Path, replayed: Callable[..., tuple[int, str]]
) -> None:
    code, output = replayed(run, "--set", "components.controller.alpha=0.2")
    assert code == 1
    assert "the pattern of layer" in output
    assert "differs at byte" in output
    assert "(cell " in output


def test_other_order_of_passes_is_reported_with_layer_and_pass(
    run: Path, replayed: Callable[..., tuple[int, str]]
) -> None:
    code, output = replayed(run, "--set", "process.pass_rotation=2", "--set", "components.controller.alpha=0.8")
    assert code == 1
    assert "of layer 1" in output
    assert "their first differing byte" in output or "differs at byte" in output


def test_replay_is_chosen_by_the_interface_of_the_scenario(run: Path) -> None:
    scenario = Scenario.load(
        run.parent / "block.toml", {"bench": {"interface": "replay", "channel": f"{run}/traffic.blf"}}
    )
    again = print_part(scenario).dataset
    for name in ARRAYS:
        np.testing.assert_array_equal(Result.load(run).dataset[name], again[name], err_msg=name)


@pytest.mark.long
def test_run_that_was_interrupted_and_resumed_is_replayed_from_both_logs(
    tmp_path: Path, replayed: Callable[..., tuple[int, str]]
) -> None:
    path, folder = write(tmp_path), tmp_path / "run"
    emulation = emulation_of(Scenario.load(path))
    with EmulatedBench(emulation.parameters | FAST | {"pass_ms": 50}) as bench:
        running = started("run", str(path), "--out", str(folder), "--set", f"bench.channel={bench.channel}")
        wait_for_word(folder / "bench.log", "layer 1", running)
        running.send_signal(signal.SIGINT)
        output, _ = running.communicate(timeout=PATIENCE_S)
        assert running.returncode == 130, output
        assert replayed(folder)[0] == 0, "as far as it came"
        assert main(["resume", str(folder)]) == 0
    assert (folder / "traffic-2.blf").exists()
    code, output = replayed(folder)
    assert code == 0, output
    assert "3 layers replayed" in output


@pytest.mark.long
def test_run_that_was_killed_and_resumed_is_replayed_from_both_logs(
    tmp_path: Path, replayed: Callable[..., tuple[int, str]]
) -> None:
    """It is killed while the lamp is lit: a person has to clear the node, which the log of the run does not hold."""
    path, folder = write(tmp_path, BLOCK.replace("cure_ms = 2", "cure_ms = 300")), tmp_path / "run"
    words = ["--set", "part.height_um=6.0"]
    emulation = emulation_of(Scenario.load(path))
    with EmulatedBench(emulation.parameters | FAST) as bench:
        words += ["--set", f"bench.channel={bench.channel}"]
        running = started("run", str(path), "--out", str(folder), *words)
        wait_for_word(folder / "bench.log", "lamp on for 300 ms after pass 2", running)
        running.kill()
        running.communicate()
        assert main(["bench", "clear", str(path), *words]) == 0
        assert main(["resume", str(folder)]) == 0
    code, output = replayed(folder, "--out", str(tmp_path / "again"))
    assert code == 0, output
    assert_same(folder, tmp_path / "again")


def test_log_that_ends_too_early_is_reported_with_the_step(
    run: Path, tmp_path: Path, replayed: Callable[..., tuple[int, str]]
) -> None:
    frames = list(can.LogReader(run / "traffic.blf"))
    writer = BLFWriter(tmp_path / "half.blf")
    for frame in frames[: len(frames) // 2]:
        writer.on_message_received(frame)
    writer.stop()
    code, output = replayed(run, "--log", str(tmp_path / "half.blf"))
    assert code == 1
    assert "half.blf ends here: the master asks the" in output
    assert "of layer" in output


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("no.blf", None, "there is no traffic log"),
        ("noise.blf", b"LOGG" + bytes(200), "noise.blf"),
        ("empty.asc", b"", "contains no request to a node"),
        ("traffic.csv", b"1,2,3\n", "expected .blf or .asc"),
    ],
)
def test_file_that_is_no_log_is_refused_with_a_message(
    name: str,
    content: bytes | None,
    message: str,
    run: Path,
    tmp_path: Path,
    replayed: Callable[..., tuple[int, str]],
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    code, output = replayed(run, "--log", str(tmp_path / name))
    assert code == 1
    assert message in output
    assert "Traceback" not in output


def test_run_without_devices_cannot_be_replayed(tmp_path: Path, replayed: Callable[..., tuple[int, str]]) -> None:
    path, folder = write(tmp_path), tmp_path / "fmus"
    words = [
        *("--set", "components.printer.kind=LayerDeposition", "--set", "components.profiler.kind=ProfileSensor"),
        *("--set", "part.height_um=6.0"),
    ]
    assert main(["run", str(path), "--out", str(folder), *words]) == 0
    code, output = replayed(folder)
    assert code == 1
    assert "no component of this run is a device" in output
