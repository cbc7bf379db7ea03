"""Rigs with other frames and services print by a mapping file: a foreign one, and the emulator."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import ComponentError
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.testing import CONTRACT_CHECKS, ContractCheck, same_inputs_give_the_same_bits
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.errors import HardwareError, LinkTimeout
from inkloop_hardware.protocol.codec import BENCH_DBC
from support.benches import foreign_rig

OUR_MAPPING = f"""
dbc = {str(BENCH_DBC)!r}
heartbeat = true

[peers.bench]
request = "HeadRequest"
answer = "HeadAnswer"

[pattern]
header = "01 01 {{nx:04x}} {{ny:04x}} 01 00"

[map]
header = "01 00 {{nx:04x}} {{ny:04x}} 0064 00000000"   # steps of 100 nm, datum 0
unit = "nm"
scale = 100.0
valid_bits = true
"""
OUR_STEPS: tuple[tuple[str, int | None, str, list[str]], ...] = (
    ("start", 0x0200, "00", []),
    ("start", 0x0201, "", ["motion"]),
    ("printer", None, "", []),
    ("printer", 0x0203, "FF", ["gate", "motion"]),
    ("printer", 0x0204, "0005", ["lamp"]),
    ("profiler", 0x0205, "", ["motion"]),
)


def our_mapping() -> str:
    """The emulator described by a mapping file: one node with all roles, layers of one pass."""
    text = OUR_MAPPING
    for section, routine, option, enables in OUR_STEPS:
        text += f'\n[[{section}]]\npeer = "bench"\n'
        if routine is None:
            text += 'do = "download"\naddress = "{layer}"\ncheck = "crc32"\n'
        else:
            text += f'do = "routine"\nroutine = {routine}\nenables = {enables}\nanswer = "00"\nlimit_s = 20.0\n'
            text += f'option = "{{job:08x}} {{layer:04x}} 00 01 {option}"\n'
    return text + '\n[[profiler]]\npeer = "bench"\ndo = "upload"\naddress = "{layer}"\ncheck = "crc32"\n'


def scenario(folder: Path, channel: str, mapping: str) -> Scenario:
    (folder / "rig.dbc").write_text(foreign_rig.DBC)
    (folder / "rig.toml").write_text(mapping)
    (folder / "part.toml").write_text(foreign_rig.SCENARIO.replace("CHANNEL", channel))
    return Scenario.load(folder / "part.toml")


def printed(folder: Path, channel: str, mapping: str) -> Result:
    return print_part(scenario(folder, channel, mapping))


@pytest.fixture(scope="module")
def bus() -> Iterator[str]:
    """A wire; the nodes of the emulator on it use other frames."""
    with EmulatedBench({"nx": 6, "ny": 5}) as bench:
        yield bench.channel


def test_rig_with_its_own_dbc_prints_what_is_commanded(bus: str, tmp_path: Path) -> None:
    with foreign_rig.running(bus), can.Bus(interface="slcan", channel=bus, sleep_after_open=0.0) as listener:
        heard: set[int] = set()
        notifier = can.Notifier(listener, [lambda message: heard.add(message.arbitration_id)])
        run = printed(tmp_path, bus, foreign_rig.MAPPING).dataset
        notifier.stop()
    assert {0x210, 0x220, 0x7A0, 0x7B0} <= heard
    assert not heard & {0x010, 0x020}, "a rig of another protocol is not to hear MasterAlive or StopRequest"
    assert run.sizes["layer"] == 3
    heights = foreign_rig.DROPLET_UM * 1e-6 * np.cumsum(run.pattern.values != 0, axis=0)
    assert heights.max() == pytest.approx(20e-6, rel=1e-9, abs=0.0)
    blind = np.zeros((6, 5), np.bool_)
    blind[2, 1] = True
    np.testing.assert_array_equal(run.valid.values, np.broadcast_to(~blind, run.valid.shape))
    np.testing.assert_allclose(run.measured_height, np.where(blind, 0.0, heights), atol=1e-12)
    np.testing.assert_allclose(run.bed_position[1:], 0.0125)


@contextmanager
def cable() -> Iterator[str]:
    """The channel of an adapter at either end: a line that one of them writes, the other reads."""
    listener = socket.create_server(("127.0.0.1", 0))
    ends: list[socket.socket] = []

    def join() -> None:
        ends.extend(listener.accept()[0] for _ in range(2))
        ways = [threading.Thread(target=pass_on, args=way) for way in (ends, ends[::-1])]
        for way in ways:
            way.start()
        for way in ways:
            way.join()

    def pass_on(source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):  # the other end has closed
            while found := source.recv(1 << 16):
                target.sendall(found)

    threading.Thread(target=join, daemon=True).start()
    try:
        yield f"socket://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        for one in (*ends, listener):
            one.close()


def test_rig_of_can_fd_and_long_ids_prints_what_is_commanded(tmp_path: Path) -> None:
    """Its frames have up to 64 bytes; the traffic log holds them, and its times never go back."""
    (tmp_path / "rig.dbc").write_text(foreign_rig.wide_dbc())
    (tmp_path / "rig.toml").write_text(foreign_rig.wide_mapping())
    with cable() as channel:
        table = f'bit_rate_switch = true\nbitrate = 500000\ndata_bitrate = 2000000\nchannel = "{channel}"'
        text = foreign_rig.SCENARIO.replace('channel = "CHANNEL"', table).replace('log = ""', 'log = "traffic.blf"')
        (tmp_path / "part.toml").write_text(text)
        with foreign_rig.running(channel, "wide"):
            run = print_part(Scenario.load(tmp_path / "part.toml"), folder=tmp_path / "run").dataset
    heights = foreign_rig.DROPLET_UM * 1e-6 * np.cumsum(run.pattern.values != 0, axis=0)
    assert heights.max() == pytest.approx(20e-6, rel=1e-9, abs=0.0)
    np.testing.assert_allclose(run.measured_height, np.where(run.valid, heights, 0.0), atol=1e-12)
    frames = list(can.LogReader(tmp_path / "run" / "traffic.blf"))
    assert {(one.is_extended_id, one.is_fd, one.bitrate_switch) for one in frames} == {(True, True, True)}
    assert {foreign_rig.LONG + number for number in (0x210, 0x220, 0x7A0, 0x7A8, 0x7B0, 0x7B8)} == {
        one.arbitration_id for one in frames
    }
    assert {12, 64} <= {len(one.data) for one in frames}
    times = [one.timestamp for one in frames]
    assert times == sorted(times)


def test_emulator_prints_by_a_mapping_of_its_own_dbc(tmp_path: Path) -> None:
    fast = {"pass_ms": 2, "scan_ms": 2, "move_ms": 2, "home_ms": 2, "gate_ms": 1, "one_node": 1}
    with EmulatedBench({"nx": 6, "ny": 5, "resolution": 1e-7, **fast}) as bench:
        run = printed(tmp_path, bench.channel, our_mapping()).dataset
    assert run.sizes["layer"] == 3
    assert run.valid.values.all()
    per_layer = float(run.measured_height[2].sum() - run.measured_height[1].sum())
    droplets = int((run.pattern[2].values != 0).sum())
    assert per_layer == pytest.approx(
        droplets * 7.6e-6, rel=0.2, abs=0.0
    )  # h1 + 4 h2 + 4 h3, less what leaves the grid


def component(made: Scenario) -> Any:
    return made.build()["rig"]


@pytest.mark.parametrize("check", [check for check in CONTRACT_CHECKS if check is not same_inputs_give_the_same_bits])
def test_mapped_rig_keeps(check: ContractCheck, bus: str, tmp_path: Path) -> None:
    """All checks but that of equal bits: what was printed on a real bed stays there."""
    made = scenario(tmp_path, bus, foreign_rig.MAPPING)
    with foreign_rig.running(bus):
        check(lambda: component(made))


def test_silence_of_a_rig_is_reported_with_its_ids(bus: str, tmp_path: Path) -> None:
    part = component(
        scenario(tmp_path, bus, foreign_rig.MAPPING.replace("[peers.scanner]", "[peers.scanner]\nanswer_s = 0.1"))
    )
    inputs = {port.name: port.start_value() for port in part.inputs}
    part.initialize(0, inputs)
    try:
        with pytest.raises(LinkTimeout, match=r"no answer of scanner \(0x7B0, 0x7B8\): routine 0x0310 .* is unknown"):
            part.do_step(0, 1, inputs)
    finally:
        part.terminate()


def test_rig_that_reports_failure_ends_the_wait_at_once(bus: str, tmp_path: Path) -> None:
    part = component(scenario(tmp_path, bus, foreign_rig.MAPPING.replace("Lamp = 37.5", "Lamp = 90")))
    inputs = {port.name: port.start_value() for port in part.inputs}
    with foreign_rig.running(bus):
        part.initialize(0, inputs)
        try:
            with pytest.raises(HardwareError, match=r"PlcState\.State is FAULT, expected BUSY; check the rig"):
                part.do_step(0, 1, {**inputs, "layer_command": np.asarray(1)})
        finally:
            part.terminate()


def test_state_is_restored_and_anything_else_is_refused(bus: str, tmp_path: Path) -> None:
    part = component(scenario(tmp_path, bus, foreign_rig.MAPPING))
    part.restore(part.save())
    with pytest.raises(ComponentError, match="not one of this rig"):
        part.restore(b"short")


def test_person_looks_at_a_mapped_rig_and_stops_it_by_its_steps(
    bus: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    steps = '[[stop]]\ndo = "send"\nmessage = "PlcCommand"\nsignals = { LayerNo = 0, Go = "HOLD", Lamp = 0 }\n'
    steps += '[[stop]]\ndo = "wait"\nmessage = "PlcState"\nsignal = "State"\nexpected = "FAULT"\n'
    part = str(tmp_path / "part.toml")
    with foreign_rig.running(bus):
        scenario(tmp_path, bus, foreign_rig.MAPPING)
        assert main(["bench", "stop", part]) == 1
        assert "has no [[stop]] steps, so nothing was sent: use the hard-wired stop" in capsys.readouterr().err
        assert main(["bench", "clear", part]) == 1
        assert "clear is for inkloop's own nodes" in capsys.readouterr().err
        assert main(["bench", "status", part]) == main(["bench", "doctor", part]) == 0
        shown = capsys.readouterr().out
        assert shown.count("PlcState (0x220): ") == 2
        assert "State: it is READY, LayersDone: it is 0" in " ".join(shown.split())
        scenario(tmp_path, bus, foreign_rig.MAPPING.replace("[outputs", f"{steps}\n[outputs"))
        assert main(["bench", "stop", part]) == 0
        assert "all 2 [[stop]] steps of rig.toml were made" in capsys.readouterr().out
    assert main(["bench", "doctor", part]) == 1
    assert "PlcState (0x220): none came in" in " ".join(capsys.readouterr().out.split())
