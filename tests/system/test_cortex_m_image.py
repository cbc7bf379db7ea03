"""The bench's firmware and world on an emulated Cortex-M3, one layer printed over its serial adapter."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from inkloop_hardware.protocol.codec import Codec
from support.benches import node_bench
from support.benches.stock_tools import FULL, adapter, print_and_scan, read_map, start

TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
LIMIT_S = 60.0
"""Of a wait that fails."""
absent = [tool for tool in TOOLS if shutil.which(tool) is None]
pytestmark = pytest.mark.skipif(bool(absent), reason=f"{' and '.join(absent)} not installed; `make tools` installs it")


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("image")
    place = node_bench.FIRMWARE / "cortex_m"
    options = [f"OUT={folder}", f"PYTHON={sys.executable}", f"ALIVE_MS={1e3 * LIMIT_S:.0f}"]
    subprocess.run(["make", "-C", place, *options], check=True, stdout=subprocess.DEVNULL)
    return folder / "inkloop_bench.elf"


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


@contextmanager
def machine(image: Path, *options: str) -> Iterator[str]:
    """The serial port of a running machine. Its time is that of its instructions: it waits where the host is busy."""
    port = free_port()
    line = ["-display", "none", "-monitor", "none", "-serial", f"tcp:127.0.0.1:{port},server=on,wait=on"]
    program: list[str | Path] = ["qemu-system-arm", "-machine", "mps2-an385", "-icount", "auto", "-kernel", image]
    running = subprocess.Popen([*program, *line, *options], stderr=subprocess.PIPE, text=True)
    assert running.stderr
    try:
        first = running.stderr.readline()
        assert "waiting for connection" in first, first
        yield f"socket://127.0.0.1:{port}"
    finally:
        running.kill()
        running.wait()
        running.stderr.close()


@pytest.fixture
def channel(image: Path) -> Iterator[str]:
    with machine(image) as name:
        yield name


def hang(image: Path, port: int) -> None:
    """Have the machine execute the endless loop behind `main`, as a debugger can."""
    symbols = subprocess.run(["arm-none-eabi-nm", image], check=True, capture_output=True, text=True).stdout
    (loop,) = (line.split()[0] for line in symbols.splitlines() if line.split()[1:] == ["t", "stop"])
    describe = "qXfer:features:read:target.xml:0,fff"  # without it no register can be set
    jump = "P0f=" + bytes.fromhex(loop)[::-1].hex()
    with socket.create_connection(("127.0.0.1", port), LIMIT_S) as debugger, debugger.makefile("rb") as answers:
        for command, wanted in ((describe, rb"\$l.*#"), (jump, rb"\$OK#"), ("D", rb"\$OK#")):
            debugger.sendall(f"${command}#{sum(command.encode()) % 256:02x}".encode())
            answer = b""
            while not re.search(wanted, answer):  # a message that the machine has stopped may come before it
                answer += answers.read(1)
            debugger.sendall(b"+")


def statuses(channel: str, count: int) -> None:
    """Wait for so many statuses of the head. BootCount is 1 each time: the journal lies in memory."""
    codec = Codec()
    with can.Bus(interface="slcan", channel=channel, bitrate=500_000, sleep_after_open=0.0) as bus:
        while count:
            message = bus.recv(LIMIT_S)
            assert message, "the machine hangs"
            count -= message.arbitration_id == codec.message("HeadStatus").frame_id


@pytest.mark.long
def test_image_that_hangs_is_reset_by_the_watchdog_of_the_board(image: Path) -> None:
    port = free_port()
    with machine(image, "-gdb", f"tcp:127.0.0.1:{port}") as channel:
        statuses(channel, 5)
        hang(image, port)
        statuses(channel, 5)


@pytest.mark.long
def test_machine_boots_the_image_and_its_head_clears_its_start(channel: str) -> None:
    with adapter(channel) as bus, bus.client(0) as head:
        assert start(head, node_bench.Routine.CLEAR, b"\0") == node_bench.DONE


@pytest.mark.long
def test_layer_printed_by_the_image_measures_as_on_the_host(channel: str) -> None:
    with (
        adapter(channel) as bus,
        bus.client(0) as head,
        bus.client(2) as lamp,
        bus.client(3) as profiler,
        node_bench.NodeBench(nx=FULL.shape[0], ny=FULL.shape[1]) as same,
    ):
        print_and_scan(head, lamp, profiler)
        same.ready().print_layer(FULL, 1)
        assert same.scan(1) == node_bench.DONE
        assert read_map(profiler, 1) == same.upload(1)
