"""Rig and links between real processes: the emulator, the process that owns the adapter, and this one."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor.inquiry import links
from inkloop_hardware.errors import AnotherMaster, BusError, NodeRefused, NodeStopped
from inkloop_hardware.link.link import Link
from inkloop_hardware.link.node_watch import E2eMonitor, Verdict
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.node_state import NodeTimes
from inkloop_hardware.protocol.records import MasterAlive, Node, State, unpack
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from support.benches import node_bench

FULL = np.ones((9, 9), np.uint8)
LIMIT = 600.0
"""Ends a test that hangs; every wait is for an event."""
SILENCE_S = 1.0
"""Of a node and of the master, until the other side takes it for lost: a busy machine is no fault of the bench."""
OFF_WITHIN = SILENCE_S * 350 / 300
"""Seconds after the last MasterAlive, by the node's own clock: 350 ms where nodes wait 300 ms for it."""
LONG_CURE_MS = round(3e3 * SILENCE_S)


@pytest.fixture(scope="module")
def program() -> Path:
    return node_bench.process()


@contextmanager
def bench(program: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The running bench and its channel."""
    patient = [f"{name}={1e3 * SILENCE_S:g}" for name in ("alive_ms", "watchdog_ms")]
    running = subprocess.Popen([program, "pass_ms=5", *patient, *arguments], stdout=subprocess.PIPE, text=True)
    assert running.stdout
    try:
        yield running, running.stdout.readline().strip()
    finally:
        running.kill()
        running.wait()
        running.stdout.close()


@pytest.fixture
def channel(program: Path) -> Iterator[str]:
    with bench(program) as (_, name):
        yield name


@pytest.fixture
def rig(channel: str) -> Iterator[Rig]:
    with Rig(settings(channel)) as made:
        cleared(made)
        yield made


def settings(channel: str, **others: object) -> BusSettings:
    return BusSettings("slcan", channel, 500_000, **{"silence_s": SILENCE_S, **others})  # type: ignore[arg-type]


def cleared(rig: Rig) -> None:
    rig.wait_for(Node, LIMIT)
    for node in Node:
        assert rig.link(node).routine(Routine.CLEAR, Key(rig.job, 0), b"\0", limit_s=LIMIT) is Outcome.DONE


def print_layer(rig: Rig, layer: int, blob: bytes) -> None:
    rig.link(Node.HEAD).download(layer, blob)
    for number, colour in enumerate(node_bench.RASTER):
        key = Key(rig.job, layer, number)
        with rig.enabled(gate=True, motion=True):
            assert rig.link(Node.HEAD).routine(Routine.PASS, key, bytes([colour]), limit_s=LIMIT) is Outcome.DONE
        with rig.enabled(lamp=True):
            assert rig.link(Node.CURE).routine(Routine.CURE, key, b"\0\x14", limit_s=LIMIT) is Outcome.DONE


def scan(rig: Rig, layer: int) -> bytes:
    assert rig.link(Node.PROFILER).routine(Routine.SCAN, Key(rig.job, layer), limit_s=LIMIT) is Outcome.DONE
    return rig.link(Node.PROFILER).upload(layer)


class Observer:
    """A separate adapter on the bench's bus, which sends requests and never MasterAlive."""

    def __init__(self, channel: str) -> None:
        self.adapter, self.codec = Adapter(settings(channel)), Codec()

    def wait_for_lamp(self) -> None:
        """Until the lamp's node reports that it is on. Nothing is asked: two clients of one node disturb each other."""
        status, until = self.codec.message("CureStatus").frame_id, time.monotonic() + LIMIT
        while True:
            assert time.monotonic() < until
            for message in self.adapter.receive(LIMIT):
                frame = Frame(message.arbitration_id, bytes(message.data))
                if frame.arbitration_id == status and self.codec.decode(frame).values["LampOn"]:
                    return

    def link(self, node: Node) -> Link:
        return links(self.adapter, self.codec, [node])[0]


def lamp_after_the_master_is_gone(channel: str) -> NodeTimes:
    """Times of the lamp's node, once it takes its master for lost; it must be off."""
    observer = Observer(channel)
    link = observer.link(Node.CURE)
    times = link.times()
    while times.now - times.master_alive < 1.25 * SILENCE_S:
        time.sleep(0.05)
        times = link.times()
    assert link.state().state is State.SAFE
    observer.adapter.close()
    assert times.lamp_on > 0.0
    return times


def test_layer_is_printed_scanned_and_fetched_as_by_the_nodes_themselves(
    program: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    blob = node_bench.pattern_blob(FULL)
    with (
        bench(program) as (_, channel),
        Rig(settings(channel)) as rig,
        node_bench.NodeBench(nx=9, ny=9, pass_ms=5) as same,
    ):
        cleared(rig)
        print_layer(rig, 1, blob)
        found = scan(rig, 1)
        same.ready().print_layer(FULL, 1)
        assert same.scan(1) == node_bench.DONE
        assert found == same.upload(1)
        state, journal = rig.link(Node.HEAD).state(), rig.link(Node.HEAD).journal()
        assert (state.job, state.session, state.gate_pulses) == (rig.job, rig.session, 4)
        assert state.pattern_crc == zlib.crc32(blob)
        assert [int(record.kind) for record in journal] == [4, 3, 4, 3, 4, 3, 4, 3, 2, 1]
        again = rig.link(Node.HEAD).routine(Routine.PASS, Key(rig.job, 1, 2), b"\2", limit_s=LIMIT)
        assert again is Outcome.DONE_BEFORE
        status = rig.status(Node.HEAD)
        assert status is not None
        assert (status.protocol_version, status.boot_count) == (rig.codec.protocol_version, 1)
    assert {"head: off", "stage: off", "cure: off", "profiler: off"} <= set(caplog.messages)


@pytest.mark.parametrize("suffix", ["blf", "asc"])
def test_traffic_log_is_read_by_stock_tools_and_shows_what_was_enabled(
    program: Path, tmp_path: Path, suffix: str
) -> None:
    began = time.time()
    log = Path("run") / f"traffic.{suffix}"
    with bench(program) as (_, channel), Rig(settings(channel, traffic_log=log), folder=tmp_path) as rig:
        cleared(rig)
        with pytest.raises(RuntimeError), rig.enabled(lamp=True, motion=True):
            raise RuntimeError("a step that fails")
        with rig.enabled(gate=True):
            rig.keep_alive()
    codec, monitor = Codec(), E2eMonitor()
    enables, others = [], set()
    options = {"relative_timestamp": False} if suffix == "asc" else {}
    with can.LogReader(tmp_path / log, **options) as reader:
        for message in reader:
            assert began - 1 <= message.timestamp <= time.time() + 1
            others.add(message.arbitration_id)
            if message.arbitration_id < 0x600:
                reading = codec.decode(Frame(message.arbitration_id, bytes(message.data)))
                if message.arbitration_id == 0x20:
                    assert monitor.take(reading.intact, reading.counter or 0) in (Verdict.FIRST, Verdict.GOOD)
                    alive = unpack(codec, reading)
                    assert isinstance(alive, MasterAlive)
                    enables.append((alive.lamp_enable, alive.gate_enable, alive.motion_enable))
    changes = [one for number, one in enumerate(enables) if number == 0 or one != enables[number - 1]]
    off = (False, False, False)
    assert changes == [off, (True, False, True), off, (False, True, False), off]
    assert {0x20, 0x101, 0x640, 0x641} <= others


def test_hanging_loop_loses_its_enables_and_its_heartbeat(
    rig: Rig, channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The loop hangs while the lamp is on; then it comes back, and the step is not enabled again."""
    found: list[NodeTimes] = []
    lives = rig.supervision.keep_alive

    def hang() -> None:
        status = rig.status(Node.CURE)
        lives()
        if status is not None and status.lamp_on and not found:
            found.append(lamp_after_the_master_is_gone(channel))

    monkeypatch.setattr(rig.supervision, "keep_alive", hang)
    key = Key(rig.job, 0)
    with rig.enabled(lamp=True), pytest.raises((NodeStopped, NodeRefused)):
        rig.link(Node.CURE).routine(Routine.CURE, key, LONG_CURE_MS.to_bytes(2, "big"), limit_s=LIMIT)
    times = found[0]
    assert times.lamp_off - times.lamp_on < LONG_CURE_MS / 1e3
    assert times.lamp_off - times.master_alive <= OFF_WITHIN
    assert times.off - times.master_alive <= OFF_WITHIN


MASTER = """
import sys
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.records import Node

channel, silence_s, cure_ms = sys.argv[1:]
with Rig(BusSettings("slcan", channel, 500_000, silence_s=float(silence_s))) as rig:
    rig.wait_for(Node, 30)
    lamp = rig.link(Node.CURE)
    lamp.routine(Routine.CLEAR, Key(rig.job, 0), bytes(1), limit_s=30)
    with rig.enabled(lamp=True):
        lamp.routine(Routine.CURE, Key(rig.job, 0), int(cure_ms).to_bytes(2, "big"), limit_s=30)
"""


def wait_until(true: Callable[[], bool]) -> None:
    until = time.monotonic() + LIMIT
    while not true():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_killed_master_leaves_nothing_on(channel: str) -> None:
    """SIGKILL: nothing can clean up, and the process that owns the adapter ends on its own."""
    observer = Observer(channel)
    with subprocess.Popen([sys.executable, "-c", MASTER, channel, str(SILENCE_S), str(LONG_CURE_MS)]) as master:
        observer.wait_for_lamp()
        master.send_signal(signal.SIGKILL)
    times = lamp_after_the_master_is_gone(channel)
    assert times.lamp_off - times.master_alive <= OFF_WITHIN
    assert times.off - times.master_alive <= OFF_WITHIN
    observer.adapter.close()


def test_killed_bus_process_leaves_nothing_enabled_and_is_reported(rig: Rig, channel: str) -> None:
    observer = Observer(channel)
    with rig.enabled(lamp=True):
        cure = b"\x31\x01\x02\x04" + bytes(Key(rig.job, 0)) + LONG_CURE_MS.to_bytes(2, "big")
        rig.link(Node.CURE).requests.client.conn.send(cure)
        observer.wait_for_lamp()
        os.kill(rig.supervision.bus.process_id, signal.SIGKILL)
        times = lamp_after_the_master_is_gone(channel)
    assert times.lamp_off - times.master_alive <= OFF_WITHIN
    for call in (rig.keep_alive, rig.link(Node.HEAD).state):
        with pytest.raises(BusError, match=r"bus process of slcan on socket.*ended without a message"):
            call()
    observer.adapter.close()


def test_ended_bus_process_closes_its_log(program: Path, tmp_path: Path) -> None:
    with bench(program) as (_, channel), Rig(settings(channel, traffic_log=tmp_path / "t.blf")) as rig:
        cleared(rig)
        os.kill(rig.supervision.bus.process_id, signal.SIGTERM)
        with pytest.raises(BusError, match="ended without a message"):
            wait_until(lambda: rig.keep_alive() is not None)
        with can.LogReader(tmp_path / "t.blf") as reader:
            assert {0x20, 0x640, 0x641} <= {message.arbitration_id for message in reader}


def test_ctrl_c_in_the_terminal_is_left_to_the_master(rig: Rig) -> None:
    assert os.getpgid(rig.supervision.bus.process_id) != os.getpgid(0)
    os.kill(rig.supervision.bus.process_id, signal.SIGINT)
    assert rig.link(Node.HEAD).state().state is State.IDLE


def test_second_master_does_not_begin_and_disturbs_nothing(rig: Rig, channel: str) -> None:
    other = Rig(settings(channel))
    with pytest.raises(AnotherMaster, match=f"session {rig.session}: end it"):
        other.attach()
    assert not other.is_open
    assert {rig.link(node).state().state for node in Node} == {State.IDLE}


def test_master_that_follows_another_one_needs_no_person(channel: str) -> None:
    """The second one begins at the end of the first, before the nodes have forgotten that one."""
    first = Rig(settings(channel))
    first.attach()
    cleared(first)
    first.detach()
    with Rig(settings(channel)) as second:
        cleared(second)
        assert second.link(Node.HEAD).state().session == second.session != first.session


def test_files_of_the_present_folder_are_not_taken_for_libraries(
    channel: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "can.py").write_text("raise SystemExit('a script of the user')\n")
    monkeypatch.chdir(tmp_path)
    with Rig(settings(channel)) as rig:
        rig.wait_for(Node, LIMIT)


@pytest.mark.parametrize("cells", [100, pytest.param(1000, marks=pytest.mark.long)])
def test_pattern_and_map_of_any_size_go_through(program: Path, cells: int) -> None:
    pattern = np.random.default_rng(0).integers(0, 3, (cells, cells)).astype(np.uint8)
    blob = node_bench.pattern_blob(pattern)
    size = f"nx={cells}", f"ny={cells}", "noise_std=1e-6"
    with bench(program, *size) as (_, channel), Rig(settings(channel)) as rig:
        cleared(rig)
        rig.link(Node.HEAD).download(1, blob)
        assert rig.link(Node.HEAD).state().pattern_crc == zlib.crc32(blob)
        found = scan(rig, 0)
    with node_bench.NodeBench(nx=cells, ny=cells, noise_std=1e-6) as same:
        assert same.ready().scan(0) == node_bench.DONE
        assert found == same.upload(0)
