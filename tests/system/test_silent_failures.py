"""Failures that stock can-isotp reports as successes; a link on the bench detects them, and recovers or reports
them.
"""

from __future__ import annotations

import threading
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

import can
import isotp
import pytest

from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.protocol.records import Node
from support.benches.fault_run import BLOB, JOB, faulty, looked_at
from support.benches.stock_tools import adapter

BLOCK = b"\x36\x01" + BLOB
"""TransferData, less than one block of flow control: the node sends nothing between its first and its last frame."""
SEND_TIMEOUT = 3.0


@contextmanager
def stock_stack(bench: EmulatedBench) -> Iterator[tuple[isotp.NotifierBasedCanStack, list[Exception]]]:
    """A stock stack to the head behind a stock adapter, the pattern announced, and the errors that it reports."""
    reported: list[Exception] = []
    with adapter(bench.channel) as bus:
        ids = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x640, rxid=0x641)
        parameters = {"tx_padding": 0xCC, "blocking_send": True}
        stack = isotp.NotifierBasedCanStack(
            bus.bus, bus.notifier, address=ids, error_handler=reported.append, params=parameters
        )
        stack.start()
        for request in (b"\x31\x01\x02\x00" + JOB.to_bytes(4, "big") + b"\0\0\0\1\0", head_of(1)):
            stack.send(request, send_timeout=SEND_TIMEOUT)
            assert stack.recv(block=True, timeout=SEND_TIMEOUT)[0] != 0x7F  # type: ignore[index]
        yield stack, reported
        stack.stop()


def head_of(layer: int) -> bytes:
    return b"\x34\x00\x44" + layer.to_bytes(4, "big") + len(BLOB).to_bytes(4, "big")


@pytest.mark.parametrize(
    "fault", ["loss:id=0x640,step=download,nth=4", "corruption:id=0x640,step=download,nth=3,byte=4"]
)
def test_stock_stack_reports_success_for_a_block_that_was_lost_or_altered(fault: str) -> None:
    """Sent "blocking", without an exception and without a reported error; the node has other bytes."""
    assert len(BLOCK) < 6 + 16 * 7
    with EmulatedBench({}, faults=[fault]) as bench, stock_stack(bench) as (stack, reported):
        stack.send(BLOCK, send_timeout=SEND_TIMEOUT)
        assert reported == []
        if fault.startswith("loss"):
            assert stack.recv(block=True, timeout=0.5) is None, "the node never had it"
        else:
            assert stack.recv(block=True, timeout=SEND_TIMEOUT) == b"\x76\x01", "the node took it as good"
            stack.send(b"\x37" + zlib.crc32(BLOB).to_bytes(4, "big"), send_timeout=SEND_TIMEOUT)
            assert stack.recv(block=True, timeout=SEND_TIMEOUT) == b"\x7f\x37\x72", "only the checksum shows it"


@pytest.mark.parametrize(
    "fault",
    [
        "loss:id=0x640,step=download,nth=4",
        "corruption:id=0x640,step=download,nth=3,byte=4",
        "burst:id=0x640,step=download,nth=3,count=3",
    ],
)
def test_link_finds_it_and_sends_the_pattern_again(fault: str) -> None:
    with faulty(fault) as run:
        link = run.rig.link(Node.HEAD)
        link.download(1, BLOB)
        assert run.state().pattern_crc == zlib.crc32(BLOB)
        assert link.counts.repeated + link.counts.restarted >= 1


@pytest.mark.parametrize(
    "fault",
    [
        "corruption:id=0x640,step=download,nth=3,byte=4,count=1000000",
        pytest.param("loss:id=0x640,step=download,nth=4,count=10", marks=pytest.mark.long),
    ],
)
def test_link_never_reports_success_for_what_cannot_be_recovered(fault: str) -> None:
    with faulty(fault) as run:
        with pytest.raises((LinkTimeout, TransferError, NodeRefused), match=r"head \(0x641.*(pattern|are you there)"):
            run.rig.link(Node.HEAD).download(1, BLOB)
        with looked_at(run) as after:
            assert after.state().passes == 0


class Refusing(can.BusABC):
    """A virtual bus that takes no frame after the first ones."""

    def __init__(self) -> None:
        self.channel_info, self.left = "a bus that fails", 0
        super().__init__(channel=None)  # type: ignore[arg-type]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.left == 0:
            raise can.CanOperationError("No buffer space available", 105)
        self.left -= 1

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        threading.Event().wait(min(timeout or 0.0, 0.01))
        return None, False


def test_stock_stack_loses_its_thread_in_silence_where_the_bus_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """The exception ends the thread; the send that it hit returns as if it had gone out, the next one never ends."""
    ended: list[object] = []
    monkeypatch.setattr(threading, "excepthook", lambda args: ended.append(args.exc_value))
    bus = Refusing()
    ids = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x640, rxid=0x641)
    stack = isotp.CanStack(bus, address=ids, params={"blocking_send": True})
    stack.start()
    stack.send(b"\x3e\x00", send_timeout=SEND_TIMEOUT)
    assert any(isinstance(error, can.CanOperationError) for error in ended)
    with pytest.raises(isotp.BlockingSendTimeout):
        stack.send(b"\x3e\x00", send_timeout=0.5)
    bus.shutdown()
