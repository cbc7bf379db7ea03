"""The bench's firmware and world on an emulated Cortex-M3, one layer printed over its serial adapter."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.benches import node_bench
from support.benches.stock_tools import FULL, adapter, print_and_scan, read_map, start

TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
absent = [tool for tool in TOOLS if shutil.which(tool) is None]
pytestmark = pytest.mark.skipif(bool(absent), reason=f"{' and '.join(absent)} not installed; `make tools` installs it")


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image, linked."""
    place, out = node_bench.FIRMWARE / "cortex_m", tmp_path_factory.mktemp("cortex-m")
    subprocess.run(
        ["make", "-C", place, f"OUT={out}", f"PYTHON={sys.executable}"], check=True, stdout=subprocess.DEVNULL
    )
    return out / "inkloop_bench.elf"


@pytest.fixture
def channel(image: Path) -> Iterator[str]:
    """The serial port of a running machine."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    machine: list[str | Path] = ["qemu-system-arm", "-machine", "mps2-an385", "-kernel", image]
    line = ["-display", "none", "-monitor", "none", "-serial", f"tcp:127.0.0.1:{port},server=on,wait=on"]
    running = subprocess.Popen([*machine, *line], stderr=subprocess.PIPE, text=True)
    assert running.stderr
    try:
        first = running.stderr.readline()
        assert "waiting for connection" in first, first
        yield f"socket://127.0.0.1:{port}"
    finally:
        running.kill()
        running.wait()
        running.stderr.close()


def test_machine_boots_the_image_and_its_head_clears_its_start(channel: str) -> None:
    with adapter(channel) as bus, bus.client(0) as head:
        assert start(head, node_bench.CLEAR, b"\0") == node_bench.DONE


@pytest.mark.long
def test_layer_printed_by_the_image_measures_as_on_the_host(channel: str) -> None:
    with (
        adapter(channel) as bus,
        bus.client(0) as head,
        bus.client(2) as lamp,
        bus.client(3) as profiler,
        node_bench.NodeBench() as same,
    ):
        print_and_scan(head, lamp, profiler)
        same.ready().print_layer(FULL, 1)
        assert same.scan(1) == node_bench.DONE
        assert read_map(profiler, 1) == same.upload(1)
