"""The report of a node is read as the firmware writes it; each change is logged once, with a message."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop_hardware.link.node_watch import NodeWatch, level_of, sentence
from inkloop_hardware.protocol.node_state import (
    Flags,
    Happening,
    Identifier,
    LayerFlags,
    NodeState,
    Roles,
    Step,
    TransferFlags,
    TransferState,
)
from inkloop_hardware.protocol.records import Fault, Node, NodeFault, State
from inkloop_hardware.protocol.services import ClearOption, Key, Outcome, Routine, is_answer
from support.benches.faulty_wire import FaultyWire
from support.benches.node_bench import HEAD, PROFILER, NodeBench, pattern_blob
from support.benches.node_status import IDLE_HEAD, node_state


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made.ready()


@pytest.mark.compiled
def test_state_of_a_printed_layer_is_read(bench: NodeBench) -> None:
    bench.power_up(HEAD)
    bench.tick(100)
    assert bench.clear() == Outcome.DONE
    bench.print_layer(np.ones((9, 8)), 1)
    state = FaultyWire(bench, HEAD).link().state()
    expected = NodeState(
        *(State.PRINTED, Fault.NONE, Roles.HEAD, Flags.PATTERN_LOADED),
        *(7, 1, 4, 0b1111, 0, 0),
        *(LayerFlags(0), Step.NONE, 2, 1),
        pattern_crc=bench.state().pattern_crc,
        clock=bench.clock / 1e3,
        gate_pulses=4,
    )
    assert state == expected
    assert state.layer_is_complete


@pytest.mark.compiled
def test_times_and_limits_are_in_seconds(bench: NodeBench) -> None:
    bench.print_layer(np.ones((9, 8)), 1)
    link = FaultyWire(bench, HEAD).link()
    times, ticks = link.times(), bench.times()
    assert times.now == bench.clock / 1e3
    assert (times.master_alive, times.gate_opened, times.gate_closed) == (
        ticks.master_alive / 1e3,
        ticks.gate_opened / 1e3,
        ticks.gate_closed / 1e3,
    )
    limits = link.limits()
    assert (limits.alive, limits.block, limits.pattern_bytes) == (0.3, 4095, 18)


@pytest.mark.compiled
def test_map_size_version_and_transfer_are_read(bench: NodeBench) -> None:
    link = FaultyWire(bench, PROFILER).link()
    assert (link.map_size().size, link.map_size().nx, link.map_size().ny) == (0, 9, 8)
    assert bench.scan(0) == 0
    link.upload(0)
    transfer = link.requests.read(Identifier.TRANSFER, TransferState.of)
    assert (transfer.flags, transfer.done, transfer.size) == (TransferFlags.UPLOAD, 165, 165)
    assert link.version()


@pytest.mark.compiled
def test_journal_is_read_newest_first(bench: NodeBench) -> None:
    bench.print_layer(np.ones((9, 8)), 1)
    records = FaultyWire(bench, HEAD).link().journal()
    assert [(record.kind, record.step, record.key.pass_) for record in reversed(records)] == bench.journal()
    newest = records[0]
    assert (newest.kind, newest.step, newest.key) == (Happening.DONE, Step.PASS, Key(7, 1, 3, 1))
    assert (newest.number, newest.done, newest.passes, newest.boots) == (len(records), 0b1111, 4, 1)
    assert newest.pattern_crc == bench.state().pattern_crc


@pytest.mark.compiled
def test_interrupted_pass_is_unknown_to_every_client(bench: NodeBench) -> None:
    link = FaultyWire(bench, HEAD).link()
    link.download(1, pattern_blob(np.ones((9, 8))))
    key = Key(7, 1, 0, 1)
    assert link.ask(Routine.PASS, key) is Outcome.NEVER
    bench.raw(bench.routine(Routine.PASS, layer=1, option=b"\0"))
    bench.tick(10)
    assert link.ask(Routine.PASS, key) is Outcome.UNDER_WAY
    bench.power_up(HEAD)
    bench.tick(100)
    assert link.ask(Routine.PASS, key) is Outcome.UNKNOWN
    assert link.state().flags & Flags.NEEDS_OPERATOR
    released = ClearOption.OPERATOR | ClearOption.ABANDON
    assert link.routine(Routine.CLEAR, Key(7, 1), bytes([released]), limit_s=5) is Outcome.DONE
    assert link.state().layer_flags == LayerFlags.ACKNOWLEDGED | LayerFlags.ABANDONED


PRINTING, OFF = {"state": State.PRINTING, "pass_mask": 1}, {"state": State.SAFE, "fault": Fault.ENABLE_DROPPED}
DARK, LIT = ({"node": Node.CURE, "state": State.CURING, "lamp_on": on} for on in (False, True))
RESTARTED = {"state": State.SAFE, "boot_count": 2}


@pytest.mark.parametrize(
    ("changes", "level", "lines"),
    [
        (({}, {}, PRINTING, PRINTING, OFF, OFF), logging.DEBUG, ["idle", "pass 2 of layer 3", "off (enable dropped)"]),
        (({}, PRINTING, OFF), logging.INFO, ["idle", "off (enable dropped)"]),
        (({}, RESTARTED, RESTARTED), logging.DEBUG, ["idle", "restarted", "off"]),
        ((DARK, LIT, DARK), logging.DEBUG, ["curing", "lamp on", "curing"]),
    ],
    ids=["each once", "steps are logged by who asks for them", "restart", "lamp"],
)
def test_change_of_a_node_is_logged_once(
    changes: Any, level: int, lines: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(level, "inkloop_hardware")
    node = changes[0].get("node", Node.HEAD)
    watch = NodeWatch(node)
    for number, change in enumerate(changes):
        watch.take_status(number / 10, replace(IDLE_HEAD, **change), number % 15)
    assert caplog.messages == [f"{node.lower()}: {line}" for line in lines]


@pytest.mark.parametrize("counter", [1, 9], ids=["repeated", "jumped"])
def test_status_with_a_wrong_counter_says_nothing_of_the_node(counter: int) -> None:
    watch = NodeWatch(Node.HEAD)
    for number in range(2):
        watch.take_status(number / 10, IDLE_HEAD, number)
    watch.take_status(0.2, replace(IDLE_HEAD, state=State.FAULT, fault=Fault.LAMP_TIME), counter)
    assert (watch.status, watch.at, watch.falls, watch.fault) == (IDLE_HEAD, 0.1, 0, Fault.NONE)


def test_fall_is_counted_once_whether_seen_in_status_or_fault_frame() -> None:
    fault = NodeFault(Node.HEAD, Fault.LAMP_TIME, 0, 3, 1.0)
    for by_frame in (True, False):
        watch = NodeWatch(Node.HEAD)
        watch.take_status(0.0, IDLE_HEAD, 0)
        assert watch.falls == 0
        if by_frame:
            watch.take_fault(fault)
        watch.take_status(0.1, replace(IDLE_HEAD, state=State.FAULT, fault=Fault.LAMP_TIME), 1)
        watch.take_fault(fault)
        assert (watch.falls, watch.fault) == (1, Fault.LAMP_TIME)
        watch.take_status(0.2, IDLE_HEAD, 2)
        watch.take_status(0.3, replace(IDLE_HEAD, state=State.FAULT, fault=Fault.LAMP_TIME), 3)
        assert watch.falls == 2


def test_fault_frame_of_a_cause_that_is_gone_is_no_fall() -> None:
    """A node sends one as well when it is cleared."""
    watch = NodeWatch(Node.HEAD)
    watch.take_status(0.0, replace(IDLE_HEAD, state=State.SAFE, fault=Fault.LAMP_TIME), 0)
    watch.take_status(0.1, IDLE_HEAD, 1)
    watch.take_fault(NodeFault(Node.HEAD, Fault.NONE, 0, 3, 1.0))
    assert (watch.falls, watch.fault) == (0, Fault.NONE)


def test_silence_after_which_a_node_is_lost_is_the_configured_one() -> None:
    watch = NodeWatch(Node.HEAD, silence_s=2.0)
    watch.take_status(0.0, IDLE_HEAD, 0)
    assert watch.trouble(2.0) is None
    assert "silent for 2.1 s" in (watch.trouble(2.1) or "")


@pytest.mark.parametrize(
    ("counters", "now", "message"),
    [
        ([], 1.0, "has sent no status"),
        ([0, 1, 2], 0.5, None),
        ([0, 1, 2], 0.501, "silent for 0.3 s"),
        ([0, 0, 0, 0, 0, 0], 0.5, "cannot be trusted"),
        ([0, 1, None, 3, None], 0.5, "cannot be trusted"),
    ],
)
def test_node_counts_as_lost_when_silent_stuck_or_damaged(
    counters: list[int | None], now: float, message: str | None
) -> None:
    watch = NodeWatch(Node.HEAD)
    for number, counter in enumerate(counters):
        watch.take_status(number / 10, None if counter is None else IDLE_HEAD, counter or 0)
    trouble = watch.trouble(now)
    assert trouble is None if message is None else message in (trouble or "")


@pytest.mark.parametrize(
    ("passes", "done", "unknown", "is_complete"),
    [(0, 0, 0, False), (1, 1, 0, True), (4, 0b0111, 0, False), (4, 0b1111, 0, True), (4, 0b1111, 0b1000, False)],
)
def test_layer_is_complete_whose_passes_are_all_done_and_known(
    passes: int, done: int, unknown: int, is_complete: bool
) -> None:
    assert node_state(passes=passes, done=done, unknown=unknown).layer_is_complete is is_complete


@pytest.mark.parametrize(
    ("status", "words", "level"),
    [
        ({"state": State.SAFE}, "off", logging.INFO),
        ({"state": State.IDLE}, "idle", logging.INFO),
        ({"state": State.RECEIVING}, "receiving a pattern", logging.DEBUG),
        ({"state": State.VERIFIED}, "pattern of layer 3 verified", logging.DEBUG),
        ({"state": State.PRINTING, "pass_mask": 0b0111}, "pass 4 of layer 3", logging.DEBUG),
        ({"state": State.PRINTED, "pass_mask": 0b0000}, "0 passes of layer 3 jetted", logging.DEBUG),
        ({"state": State.PRINTED, "pass_mask": 0b0001}, "1 pass of layer 3 jetted", logging.DEBUG),
        ({"state": State.PRINTED, "pass_mask": 0b0011}, "2 passes of layer 3 jetted", logging.DEBUG),
        ({"state": State.CURED}, "cured", logging.DEBUG),
        ({"state": State.SCANNING}, "scanning", logging.DEBUG),
        ({"state": State.MAP_READY}, "map ready", logging.DEBUG),
        ({"state": State.FAULT, "fault": Fault.LAMP_TIME}, "fault (lamp time)", logging.WARNING),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_status_is_a_sentence_and_a_fault_a_warning(status: dict[str, Any], words: str, level: int) -> None:
    found = replace(IDLE_HEAD, **status)
    assert (sentence(Node.STAGE, found), level_of(found.state)) == (f"stage: {words}", level)


@pytest.mark.parametrize(("attempt", "text"), [(1, "layer 7, pass 2"), (2, "layer 7, pass 2, attempt 2")])
def test_key_is_named_by_its_layer_and_pass_and_a_repeat_by_its_attempt(attempt: int, text: str) -> None:
    assert str(Key(9, 7, 2, attempt)) == text


def test_numbers_of_a_record_have_no_sign() -> None:
    found = TransferState.of(bytes.fromhex("03 ff ffff ffffffff 80000000 fffffffe"))
    assert found == TransferState(TransferFlags(3), 255, 65535, 2**32 - 1, 2**31, 2**32 - 2)
    assert Key.of(bytes.fromhex("ffffffff fffe fd fc")) == Key(2**32 - 1, 65534, 253, 252)


START = "31 01 0203 00000007 0001 02 03"


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ("71 01 0203 00 00000007 0001 02 03", True),
        ("71 01 0203 01 00000007 0001 02 03", True),
        ("71 03 0203 00 00000007 0001 02 03", False),
        ("71 01 0204 00 00000007 0001 02 03", False),
        ("71 01 0203 00 00000008 0001 02 03", False),
        ("71 01 0203 00 00000007 0002 02 03", False),
        ("71 01 0203 00 00000007 0001 01 03", False),
        ("71 01 0203 00 00000007 0001 02 02", False),
        ("71 01 0203 00 00000007 0001 02", False),
        ("7f 31 78", True),
        ("7f 22 78", False),
        ("62 01 00", False),
        ("", False),
    ],
)
def test_answer_of_a_routine_has_its_kind_number_and_key(message: str, expected: bool) -> None:
    assert is_answer(bytes.fromhex(START) + b"\1", bytes.fromhex(message)) is expected


@pytest.mark.parametrize(
    ("request_", "message", "expected"),
    [
        ("22 01 00", "62 01 00 05", True),
        ("22 01 00", "62 01 10 05", False),
        ("22 01 00", "62 02 00 05", False),
        ("36 05 aa bb", "76 05", True),
        ("36 05 aa bb", "76 04", False),
        ("36 05", "7f 36 73", True),
        ("36 05", "7f 37 73", False),
        ("3e 00", "7e 00", True),
        ("3e 00", "76 00", False),
        ("37", "77 12 34 56 78", True),
    ],
)
def test_answer_repeats_the_identifier_or_the_number_of_the_block(request_: str, message: str, expected: bool) -> None:
    assert is_answer(bytes.fromhex(request_), bytes.fromhex(message)) is expected
