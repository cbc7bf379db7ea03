"""A scanner of others finds the services of a node, and no answer that ISO 14229-1 does not allow."""

from __future__ import annotations

import sys

import pytest

from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.protocol.node_state import NodeState, Roles
from inkloop_hardware.protocol.records import Node
from support.masters.other_programs import CARINGCARIBOU, SCAPY
from support.masters.uds_scanners import (
    SERVICES,
    answers_by_scapy,
    by_caringcaribou,
    by_scapy,
    objection,
    servers_by_caringcaribou,
)


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("22 02 00", "7f 22 11"),
        ("22 01 00", None),
        ("31 02 02 00", "7f 31 13"),
        ("31 01 02 00", "7f 31 99"),
        ("31 01 02", "71 01 02 00"),
        ("10 83", "50 03"),
        ("27 01", "7f 27 31"),
    ],
)
def test_answers_that_the_standard_does_not_allow_are_found(request_: str, answer: str | None) -> None:
    assert objection(Node.HEAD, bytes.fromhex(request_), None if answer is None else bytes.fromhex(answer))


@pytest.mark.parametrize(
    ("request_", "answer"),
    [("22 02 00", "7f 22 31"), ("31 00", "7f 31 12"), ("10 83", None), ("3e 00", "7e 00"), ("35 00 44", "7f 35 11")],
)
def test_answers_of_the_standard_are_right(request_: str, answer: str | None) -> None:
    assert not objection(Node.HEAD, bytes.fromhex(request_), None if answer is None else bytes.fromhex(answer))


@pytest.mark.long
@pytest.mark.skipif(bool(SCAPY.reason_it_is_absent()), reason="scapy is not installed; make peers")
def test_scapy_finds_the_services_of_the_profiler_and_nothing_wrong() -> None:
    with EmulatedBench({}) as bench:
        scan = by_scapy(bench.channel, Node.PROFILER, range(0x0100, 0x0104), range(0x0204, 0x0207))
    assert not scan.wrong
    assert (scan.services, scan.identifiers) == (SERVICES[Node.PROFILER], set(range(0x0100, 0x0104)))
    assert scan.routines == {0x0205, 0x0206}


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="slcan on a pseudo-terminal")
@pytest.mark.skipif(bool(SCAPY.reason_it_is_absent()), reason="scapy is not installed; make peers")
def test_every_answer_of_several_frames_reaches_isotp_of_scapy() -> None:
    """On a terminal: over socket:// python-can returns a byte to a reader that does not wait, see peers.md."""
    with EmulatedBench({}, terminal=True) as bench:
        answers = answers_by_scapy(bench.channel, Node.HEAD, [b"\x22\x01\x00"] * 4)
    assert [NodeState.of(answer[3:]).roles for answer in answers] == [Roles.HEAD] * 4


@pytest.mark.long
@pytest.mark.skipif(bool(CARINGCARIBOU.reason_it_is_absent()), reason="caringcaribou is not installed; make peers")
def test_caringcaribou_finds_the_nodes_and_the_services_of_the_head() -> None:
    with EmulatedBench({}) as bench:
        servers = servers_by_caringcaribou(bench.channel, range(0x63F, 0x649))
        services, identifiers = by_caringcaribou(bench.channel, *servers[0], range(0x0100, 0x0112))
    assert servers == [(request, request + 1) for request in (0x640, 0x642, 0x644, 0x646)]
    assert set(services) == SERVICES[Node.HEAD]
    assert identifiers == [0x0100, 0x0101, 0x0102, 0x0104, 0x0110]
