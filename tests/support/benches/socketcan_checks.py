"""Checks of `tests/system/test_socketcan.py` in a guest with SocketCAN: prints over the interfaces of its kernel.

The emulator speaks slcan on a terminal; the kernel makes the interface slcan0 of it, and its gateway joins others.
"""

from __future__ import annotations

import logging
import re
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import pack
from typing import Any

import can
import numpy as np
import pytest

from inkloop.bench.commands import emulation_of
from inkloop.errors import ComponentError
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_hardware.bus.adapter import BUS_OFF
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor.adapter_check import before_opening
from inkloop_hardware.doctor.findings import Grade
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Routine
from support.benches import foreign_rig
from support.benches.bench_run import FAST, assert_same_print, printed_with_fmus, write

EXACT = {"part.height_um": 6.0, "components.profiler": {"noise_std_um": 0.0, "dropout_rate": 0.0}}
SLCAN, VCAN, LEFT, RIGHT = "slcan0", "vcan0", "vxcan0", "vxcan1"
LIMIT_S = 60.0
RECEIVERS = Path("/proc/net/can/rcvlist_all")
SOCKETCAND_PORT = 29536
SCAN_MS = 1500
"""Of prints that are disturbed in a scan: long against the time in which a program starts."""


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)


@contextmanager
def prepared_ip() -> Iterator[Callable[[str], None]]:
    """`ip link set` that takes its words at once: a start of a program takes seconds on a busy machine."""
    with subprocess.Popen(["ip", "-batch", "-"], stdin=subprocess.PIPE, text=True, bufsize=1) as running:
        assert running.stdin is not None
        yield lambda words: print("link set", words, file=running.stdin)
    assert running.returncode == 0


def is_open(interface: str) -> bool:
    """Whether a socket receives all frames of an interface."""
    return re.search(rf"^ +{interface} ", RECEIVERS.read_text(encoding="ascii"), re.MULTILINE) is not None


@contextmanager
def process(*words: str) -> Iterator[None]:
    with subprocess.Popen(words) as running:
        try:
            yield
        finally:
            running.terminate()


@contextmanager
def bench(path: Path, **times: float) -> Iterator[None]:
    """The emulator of a scenario, as slcan0."""
    emulation = emulation_of(Scenario.load(path, EXACT))
    with (
        EmulatedBench(emulation.parameters | FAST | times, terminal=True, surface=emulation.surface) as running,
        process("slcand", "-F", "-o", "-s6", running.channel, SLCAN),
    ):
        until = time.monotonic() + LIMIT_S
        while not Path(f"/sys/class/net/{SLCAN}").exists():
            assert time.monotonic() < until, "the kernel made no slcan0"
            time.sleep(0.02)
        ip("set", SLCAN, "txqueuelen", "1000", "up")
        yield


@contextmanager
def joined(*names: str) -> Iterator[None]:
    """Interfaces of which each passes its frames on to the other."""
    for source, target in (names, names[::-1]):
        subprocess.run(["cangw", "-A", "-s", source, "-d", target, "-e"], check=True)
    try:
        yield
    finally:
        subprocess.run(["cangw", "-F"], check=True)


@contextmanager
def virtual(*words: str) -> Iterator[None]:
    """A virtual interface, up."""
    ip("add", *words)
    try:
        yield
    finally:
        ip("del", words[0])


@contextmanager
def pair() -> Iterator[None]:
    """Two interfaces with a cable between them: when one is down, the other has no carrier."""
    with virtual(LEFT, "type", "vxcan", "peer", "name", RIGHT):
        for name in (LEFT, RIGHT):
            ip("set", name, "up")
        yield


@contextmanager
def in_scan(number: int, channel: str, act: Callable[[], None]) -> Iterator[threading.Event]:
    """Acts once, in the `number`-th scan, while nothing else is done; the event: it has acted."""
    profiler, start = Codec().request_id(Node.PROFILER), pack(">BBH", 0x31, 1, Routine.SCAN)
    acted, over = threading.Event(), threading.Event()

    def watch() -> None:
        left = number
        with can.Bus(interface="socketcan", channel=channel) as bus:
            while left and not over.is_set():
                message = bus.recv(0.1)
                left -= message is not None and message.arbitration_id == profiler and message.data[2:6] == start
        if not left:
            act()
            acted.set()

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        yield acted
    finally:
        over.set()
        watcher.join()


def printed(path: Path, channel: str) -> Result:
    bus = {"bench.interface": "socketcan", "bench.channel": channel}
    return print_part(Scenario.load(path, {**bus, **EXACT}), folder=path.parent / "run")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write(tmp_path)


@pytest.fixture
def log(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    return caplog


def test_print_over_the_serial_line_of_the_kernel(path: Path) -> None:
    with bench(path):
        found = printed(path, SLCAN)
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_print_over_a_virtual_interface_behind_a_gateway(path: Path) -> None:
    with bench(path), virtual(VCAN, "type", "vcan"):
        ip("set", VCAN, "mtu", "72", "up")
        with joined(SLCAN, VCAN):
            found = printed(path, VCAN)
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_print_through_the_server_of_socketcand(path: Path) -> None:
    if shutil.which("socketcand") is None:
        pytest.skip("socketcand is not on the PATH; Debian 12 does not have it: build it from its public source")
    bus: dict[str, Any] = {"bench.interface": "socketcand", "bench.channel": SLCAN}
    bus["bench.options"] = {"host": "127.0.0.1", "port": SOCKETCAND_PORT}
    with bench(path), process("socketcand", "-i", SLCAN, "-l", "lo", "-p", f"{SOCKETCAND_PORT}", "-n"):
        found = print_part(Scenario.load(path, {**bus, **EXACT}), folder=path.parent / "run")
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_rig_of_can_fd_and_long_ids(path: Path) -> None:
    bus = f'interface = "socketcan"\nchannel = "{VCAN}"\nbit_rate_switch = true'
    text = foreign_rig.SCENARIO.replace('interface = "slcan"\nchannel = "CHANNEL"', bus)
    path.write_text(text, encoding="utf-8")
    (path.parent / "rig.dbc").write_text(foreign_rig.wide_dbc())
    (path.parent / "rig.toml").write_text(foreign_rig.wide_mapping())
    with virtual(VCAN, "type", "vcan"):
        ip("set", VCAN, "mtu", "72", "up")
        with foreign_rig.running(VCAN, "wide"):
            found = print_part(Scenario.load(path)).dataset
    heights = foreign_rig.DROPLET_UM * 1e-6 * np.cumsum(found.pattern.values != 0, axis=0)
    assert heights.any()
    np.testing.assert_allclose(found.measured_height, np.where(found.valid, heights, 0.0), atol=1e-12)


def test_interface_that_is_taken_down_for_a_second(path: Path, log: pytest.LogCaptureFixture) -> None:
    def act() -> None:
        ip("set", SLCAN, "down")
        time.sleep(1.0)
        ip("set", SLCAN, "up")

    with bench(path, scan_ms=SCAN_MS), in_scan(2, SLCAN, act) as acted:
        found = printed(path, SLCAN)
    assert acted.is_set()
    assert "connected again after" in log.text
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_bus_off_that_a_controller_reports(path: Path, log: pytest.LogCaptureFixture) -> None:
    def act() -> None:
        with can.Bus(interface="socketcan", channel=VCAN) as bus:
            bus.send(can.Message(arbitration_id=BUS_OFF, is_error_frame=True, data=bytes(8)))

    with bench(path, scan_ms=SCAN_MS), virtual(VCAN, "type", "vcan"):
        ip("set", VCAN, "up")
        with joined(SLCAN, VCAN), in_scan(2, VCAN, act) as acted:
            found = printed(path, VCAN)
    assert acted.is_set()
    assert "connected again after" in log.text
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_controller_that_has_left_the_bus_without_a_frame(path: Path, log: pytest.LogCaptureFixture) -> None:
    """An interface that is up without a carrier, as the kernel leaves one that is bus-off; its queue drops frames."""

    with bench(path, scan_ms=SCAN_MS), pair(), joined(SLCAN, RIGHT), prepared_ip() as set_link:

        def act() -> None:
            set_link(f"{RIGHT} down")
            until = time.monotonic() + LIMIT_S
            while is_open(LEFT) and time.monotonic() < until:
                time.sleep(0.01)
            set_link(f"{RIGHT} up")

        with in_scan(2, LEFT, act) as acted:
            found = printed(path, LEFT)
    assert acted.is_set()
    assert "connected again after" in log.text
    assert_same_print(found, printed_with_fmus(path, EXACT))


def test_controller_that_does_not_return_is_reported(path: Path) -> None:
    with (
        bench(path, scan_ms=SCAN_MS),
        pair(),
        joined(SLCAN, RIGHT),
        in_scan(2, LEFT, lambda: ip("set", RIGHT, "down")) as acted,
    ):
        with pytest.raises(ComponentError, match=r"vxcan0.*has no carrier.*ip link set vxcan0 type can restart"):
            printed(path, LEFT)
        assert acted.is_set()
        found = list(before_opening(BusSettings("socketcan", LEFT)))
    assert found[-1].grade is Grade.ERROR
    assert "has no carrier" in found[-1].found


def test_queue_of_one_frame_that_others_fill(path: Path, log: pytest.LogCaptureFixture) -> None:
    with bench(path):
        ip("set", SLCAN, "txqueuelen", "1")
        with process("cangen", SLCAN, "-g", "2", "-i", "-I", "7FF", "-L", "8"):
            found = printed(path, SLCAN)
    assert "frames sent again so far" in log.text
    assert_same_print(found, printed_with_fmus(path, EXACT))
