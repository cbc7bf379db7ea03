"""Scanners of others that ask the nodes of the emulator for everything which ISO 14229-1 knows, and judge the answers.

scapy's enumerators make the requests; they travel by can-isotp and slcan. Each answer is compared with
what the standard demands of a server with the services of a node: that comparison is ours. caringcaribou is a program
with an ISO-TP of its own; it is taken at its word.
"""

from __future__ import annotations

import logging
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import can
import isotp

from inkloop_hardware.bus.slcan_bus import BulkSlcanBus
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.records import Node

EVERYWHERE, TRANSFER = {0x10, 0x22, 0x31, 0x3E}, {0x36, 0x37}
SERVICES = {
    Node.HEAD: EVERYWHERE | TRANSFER | {0x34},
    Node.STAGE: EVERYWHERE,
    Node.CURE: EVERYWHERE,
    Node.PROFILER: EVERYWHERE | TRANSFER | {0x35},
}
SESSIONS, SUPPRESS = {1, 3}, 0x80
IDENTIFIERS = {0x0100, 0x0101, 0x0102, 0x0103, 0x0104, 0x0110, 0xF186, 0xF195}
ROUTINES, ROUTINE_KINDS = set(range(0x0200, 0x0209)), {1, 3}
NOT_SUPPORTED, NO_SUBFUNCTION, LENGTH, RANGE = 0x11, 0x12, 0x13, 0x31
KNOWN = {0x10, 0x11, 0x12, 0x13, 0x21, 0x22, 0x24, 0x25, 0x26, 0x31, 0x33, 0x70, 0x71, 0x72, 0x73, 0x78, 0x7E, 0x7F}
"""Negative response codes of ISO 14229-1 that a node without security may send."""
ANSWER_LIMIT_S, SILENCE_S = 60.0, 0.05
DISCOVERY_S = 0.5
"""Of silence of an identifier without a server."""
TESTER_PRESENT = b"\x3e\x00"


@dataclass
class Scan:
    """Findings of a scan of one node. wrong: exchanges that ISO 14229-1 does not allow."""

    node: Node
    services: set[int] = field(default_factory=set)
    identifiers: set[int] = field(default_factory=set)
    routines: set[int] = field(default_factory=set)
    wrong: list[str] = field(default_factory=list)

    def take(self, request: bytes, answer: bytes | None) -> None:
        """Judge an answer and keep its service, identifier or routine."""
        code = answer[2] if answer is not None and answer[0] == 0x7F else 0
        if code != NOT_SUPPORTED:
            self.services.add(request[0])
        last = int.from_bytes(request[-2:], "big")
        if request[0] == 0x22 and len(request) == 3 and code != RANGE:
            self.identifiers.add(last)
        if request[0] == 0x31 and len(request) == 4 and code not in (NO_SUBFUNCTION, RANGE):
            self.routines.add(last)
        if (why := objection(self.node, request, answer)) is not None:
            said = answer[:8].hex(" ") if answer is not None else "nothing"
            self.wrong.append(f"{request.hex(' ')} -> {said}: {why}")


def is_suppressed(request: bytes) -> bool:
    """Whether no positive answer is wanted."""
    return request[0] in (0x10, 0x31, 0x3E) and len(request) > 1 and bool(request[1] & SUPPRESS)


def demanded(node: Node, request: bytes) -> int | None:
    """The negative code that ISO 14229-1 demands (figures 5 and 6: service, shortest length, sub-function, length,
    range), None where the state of the node decides.
    """
    service, kind = request[0], request[1] & ~SUPPRESS if len(request) > 1 else 0
    if service not in SERVICES[node]:
        return NOT_SUPPORTED
    if service in (0x10, 0x3E):
        allowed = SESSIONS if service == 0x10 else {0}
        return LENGTH if len(request) < 2 else NO_SUBFUNCTION if kind not in allowed else None
    if service == 0x31:
        if len(request) < 2:
            return LENGTH
        if kind not in ROUTINE_KINDS:
            return NO_SUBFUNCTION
        if len(request) < 4:
            return LENGTH
        return RANGE if int.from_bytes(request[2:4], "big") not in ROUTINES else None
    if service == 0x22:
        if len(request) != 3:
            return LENGTH
        return RANGE if int.from_bytes(request[1:], "big") not in IDENTIFIERS else None
    return None


def objection(node: Node, request: bytes, answer: bytes | None) -> str | None:
    """The error of an answer, None if it is right."""
    expected = demanded(node, request)
    if answer is None:
        return None if is_suppressed(request) and expected is None else "an answer is demanded"
    if answer[0] != 0x7F:
        if answer[0] != request[0] + 0x40 or is_suppressed(request):
            return "no such answer is wanted"
        return f"expected 7f {request[0]:02x} {expected:02x}" if expected is not None else None
    if len(answer) != 3 or answer[1] != request[0] or answer[2] not in KNOWN:
        return "no negative response of ISO 14229-1"
    return f"expected code {expected:02x}" if expected not in (None, answer[2]) else None


def by_scapy(channel: str, node: Node, identifiers: Sequence[int], routines: Sequence[int]) -> Scan:
    """Sessions, services with 0 to 2 further bytes, identifiers, and routines with every sub-function."""
    from scapy.contrib.automotive import log_automotive, uds, uds_scan

    scan = Scan(node)
    log_automotive.setLevel(logging.ERROR)
    with _client(channel, node) as client:

        class IsoTpSocket:
            """Socket functions that the scanner needs, on can-isotp; scapy itself ensures that one request waits."""

            closed = False

            def sr1(self, packet: Any, **_: Any) -> Any:
                request = bytes(packet)
                answer = client(request)
                scan.take(request, answer)
                return None if answer is None else uds.UDS(answer)

            def send(self, packet: Any) -> int:
                """Of the thread that keeps a session."""
                client(bytes(packet))
                return len(packet)

            def close(self) -> None:
                self.closed = True

        cases = ("Service", "DSC", "TP", "RDBI", "RC")
        wire: Any = IsoTpSocket()
        made = uds_scan.UDS_Scanner(
            wire,
            test_cases=[getattr(uds_scan, f"UDS_{case}Enumerator") for case in cases],
            UDS_ServiceEnumerator_kwargs={"request_length": 3, "scan_range": range(256)},
            UDS_DSCEnumerator_kwargs={"scan_range": range(256), "overwrite_timeout": False},
            UDS_RDBIEnumerator_kwargs={"scan_range": identifiers},
            UDS_RCEnumerator_kwargs={"scan_range": routines, "type_list": list(range(256))},
        )
        made.scan()
    return scan


def answers_by_scapy(channel: str, node: Node, requests: Sequence[bytes]) -> list[bytes]:
    """Answers by scapy's own ISO-TP over python-can; empty for one that did not come."""
    from scapy.config import conf

    conf.contribs["ISOTP"] = {"use-can-isotp-kernel-module": False}
    conf.contribs["CANSocket"] = {"use-python-can": True}
    from scapy.contrib.cansocket_python_can import PythonCANSocket
    from scapy.contrib.isotp import ISOTPSoftSocket
    from scapy.packet import Raw

    request_id = Codec().request_id(node)
    options: dict[str, Any] = {"interface": "slcan", "channel": channel, "bitrate": 500_000}
    bus = PythonCANSocket(**options)
    found = []
    with bus, ISOTPSoftSocket(bus, tx_id=request_id, rx_id=request_id + 1, basecls=Raw, padding=True) as socket:
        for request in requests:
            answer = socket.sr1(Raw(request), timeout=ANSWER_LIMIT_S, verbose=False)
            found.append(b"" if answer is None else bytes(answer))
    return found


def servers_by_caringcaribou(channel: str, arbitration_ids: range) -> list[tuple[int, int]]:
    """Identifiers of requests and answers of the servers that it discovers."""
    span = ("-min", f"{arbitration_ids[0]}", "-max", f"{arbitration_ids[-1]}", "-d", f"{DISCOVERY_S}")
    rows = re.findall(r"^\| 0x(\w+) \| 0x(\w+) \|$", _caringcaribou(channel, "discovery", *span), re.MULTILINE)
    return [(int(request, 16), int(answer, 16)) for request, answer in rows]


def by_caringcaribou(channel: str, request_id: int, answer_id: int, identifiers: range) -> tuple[list[int], list[int]]:
    """Services and identifiers that it finds in a server."""
    ids = (f"{request_id}", f"{answer_id}", "-t", f"{ANSWER_LIMIT_S}")
    span = ("--min_did", f"{identifiers[0]}", "--max_did", f"{identifiers[-1]}")
    services = re.findall(r"^Supported service 0x(\w+)", _caringcaribou(channel, "services", *ids), re.MULTILINE)
    found = re.findall(r"^0x(\w{4}) \w", _caringcaribou(channel, "dump_dids", *ids, *span), re.MULTILINE)
    return [int(each, 16) for each in services], [int(each, 16) for each in found]


def _caringcaribou(channel: str, *words: str) -> str:
    """The output of the scanner. Raises CalledProcessError."""
    bus = {"CAN_INTERFACE": "slcan", "CAN_CHANNEL": channel, "CAN_BITRATE": "500000"}
    command = [sys.executable, "-m", "caringcaribou.caringcaribou", "uds", *words]
    return subprocess.run(command, env=os.environ | bus, check=True, capture_output=True, text=True).stdout


@contextmanager
def _client(channel: str, node: Node) -> Iterator[Callable[[bytes], bytes | None]]:
    """A function that sends a request and returns the final answer, None if there is none."""
    number = list(Node).index(node)
    with BulkSlcanBus(channel, bitrate=500_000) as bus:  # python-can's own loses frames on a busy machine
        notifier = can.Notifier(bus, [])
        ids = isotp.Address(isotp.AddressingMode.Normal_11bits, txid=0x640 + 2 * number, rxid=0x641 + 2 * number)
        stack = isotp.NotifierBasedCanStack(bus, notifier, address=ids, params={"tx_padding": 0xCC})
        stack.start()

        def receive(wait_s: float) -> bytes | None:
            while (answer := stack.recv(block=True, timeout=wait_s)) is not None and answer[::2] == b"\x7f\x78":
                pass
            return None if answer is None else bytes(answer)

        def ask(request: bytes) -> bytes | None:
            stack.send(request)
            if not is_suppressed(request):
                return receive(ANSWER_LIMIT_S)
            answer = receive(SILENCE_S)
            if answer is None:  # what comes late comes before the answer to the next request
                stack.send(TESTER_PRESENT)
                while (late := receive(ANSWER_LIMIT_S)) != bytes([0x7E, 0]):
                    if late is None:
                        raise RuntimeError(f"{node} does not answer {TESTER_PRESENT.hex(' ')}")
                    answer = late
            return answer

        try:
            yield ask
        finally:
            stack.stop()
            notifier.stop()
