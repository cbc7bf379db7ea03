"""A print over buses that python-can reaches by a network is that over an adapter."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import Any

import pytest

from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from support.benches import bridges
from support.benches.bench_run import assert_same_print, emulated, printed_with_fmus, write

ONE_LAYER = {"part.height_um": 3.0}


def assert_printed(path: Path, interface: str, channel: str, options: dict[str, Any]) -> None:
    bus = {"bench.interface": interface, "bench.channel": channel, "bench.options": options}
    found = print_part(Scenario.load(path, {**bus, **ONE_LAYER}), folder=path.parent / "run")
    assert_same_print(found, printed_with_fmus(path, ONE_LAYER))
    assert found.dataset.pattern.values.any()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("", 0))
        port: int = one.getsockname()[1]
        return port


def test_print_through_a_socketcand_server(tmp_path: Path) -> None:
    path = write(tmp_path)
    with emulated(path, ONE_LAYER) as (_, channel), bridges.socketcand(channel) as port:
        assert_printed(path, "socketcand", "can0", {"host": "127.0.0.1", "port": port})


def test_print_over_udp_multicast(tmp_path: Path) -> None:
    path, port = write(tmp_path), free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        try:
            one.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            one.sendto(b"", (bridges.GROUP, port))
        except OSError as error:
            pytest.skip(f"this machine has no route for multicast: {error}")
    with emulated(path, ONE_LAYER) as (_, channel), bridges.multicast(channel, port):
        assert_printed(path, "udp_multicast", bridges.GROUP, {"port": port, **bridges.STAYS_HERE})
