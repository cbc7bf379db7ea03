"""The wire library in a process of its own, spoken to by stock python-can and can-isotp over a serial line on TCP."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import can
import isotp
import pytest

from support.benches.wire_library import ANSWER_ID, CAN, REQUEST_ID, WARNINGS
from support.compiled import program
from support.places import C_SOURCES

PATIENCE = 20.0
"""Seconds after which a test gives up; nothing is measured."""


@pytest.fixture
def bus() -> Iterator[can.BusABC]:
    sources = (C_SOURCES / "wire_echo.c", CAN / "isotp.c", CAN / "slcan.c")
    echo = program("echo", sources, ("-std=c11", "-O1", *WARNINGS, f"-I{CAN}"))
    with subprocess.Popen([echo], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        port = int(process.stdout.readline())
        with can.Bus(interface="slcan", channel=f"socket://127.0.0.1:{port}", sleep_after_open=0) as bus:
            yield bus
        assert process.wait(PATIENCE) == 0


@pytest.mark.parametrize("block_size", [0, 8])
def test_messages_go_there_and_back_between_two_processes(bus: can.BusABC, block_size: int) -> None:
    address = isotp.Address(isotp.AddressingMode.Normal_11bits, rxid=ANSWER_ID, txid=REQUEST_ID)
    errors: list[Exception] = []
    parameters = {"blocksize": block_size, "tx_padding": 0xCC, "blocking_send": True}
    stack = isotp.CanStack(bus, address=address, error_handler=errors.append, params=parameters)
    stack.start()
    try:
        for length in (1, 7, 8, 62, 509, 4095):
            message = bytes((3 * i + length) % 256 for i in range(length))
            stack.send(message, send_timeout=PATIENCE)
            assert stack.recv(block=True, timeout=PATIENCE) == message[::-1]
    finally:
        stack.stop()
    assert errors == []
