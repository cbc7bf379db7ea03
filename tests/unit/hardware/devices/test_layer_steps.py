"""Steps of a layer: their keys, their times, what is recorded of them, and what of a begun layer is not repeated.

The nodes are a double that does whatever it is asked.
"""

from __future__ import annotations

import logging
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.testing import job
from inkloop_hardware.devices.layer_steps import LOGGED_FROM_BYTES, LayerSteps, PrintedLayer, _log_quarters
from inkloop_hardware.devices.master_journal import Asked, Event, MasterJournal
from inkloop_hardware.devices.readiness import MARGIN_S, NotReady
from inkloop_hardware.errors import NodeRefused, TransferError
from inkloop_hardware.protocol.node_state import Flags, LayerFlags, NodeLimits, NodeState
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from inkloop_hardware.protocol.transfer_bytes import PatternBytes
from support.benches.node_status import node_state

JOB, CURE_MS = 7, 20
FOUR = replace(job(), passes=4)
FULL = np.ones((FOUR.nx, FOUR.ny), np.int32)
MADE = PatternBytes.of(FULL, passes=4, materials=1)
LIMITS = NodeLimits(pattern_bytes=100, alive=1.0, lamp=2.0, gate=3.0, pass_=4.0, motion=50.0, scan=60.0, block=7)


class Rig:
    """`asked`: node, routine, key, limit [s]; `sent`: layer and form of each pattern; `maps`: results of uploads."""

    def __init__(self, **layer: Any) -> None:
        self.job = JOB
        self.asked: list[tuple[Node, Routine, Key, float]] = []
        self.sent: list[tuple[int, bool]] = []
        self.maps: list[bytes | Exception] = []
        self.refuses_coded = self.refuses_pass = 0
        self.state = node_state(**layer)

    @contextmanager
    def enabled(self, **_: bool) -> Iterator[None]:
        yield

    def link(self, node: Node) -> Any:
        return Link(self, node)

    def status(self, node: Node) -> Any:
        return SimpleNamespace(ready=False, gate_closed=True, gate_open=False)

    def of(self, routine: Routine) -> list[Key]:
        return [key for _, asked, key, _ in self.asked if asked is routine]


class Link:
    def __init__(self, rig: Rig, node: Node) -> None:
        self._rig, self._node = rig, node

    def state(self) -> NodeState:
        return self._rig.state

    def download(self, layer: int, blob: bytes, *, coded: bool, progress: Any) -> None:
        assert blob == (MADE.coded if coded else MADE.plain)
        self._rig.sent.append((layer, coded))
        if coded and self._rig.refuses_coded:
            raise NodeRefused("head: refuses", self._rig.refuses_coded)

    def upload(self, layer: int, *, progress: Any) -> bytes:
        found = self._rig.maps.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    def routine(self, routine: Routine, key: Key, option: bytes = b"", *, limit_s: float) -> Outcome:
        self._rig.asked.append((self._node, routine, key, limit_s))
        if routine is Routine.PASS and self._rig.refuses_pass:
            raise NodeRefused("head: refuses", self._rig.refuses_pass)
        return Outcome.DONE


def steps(rig: Rig, **options: Any) -> LayerSteps:
    return LayerSteps(rig, FOUR, dict.fromkeys(Node, LIMITS), cure_ms=CURE_MS, **options)  # type: ignore[arg-type]


def begun(**layer: Any) -> Rig:
    """Layer 3 of this job, of which the head has the pattern."""
    whole = {"job": JOB, "layer": 3, "passes": 4, "flags": Flags.PATTERN_LOADED, "pattern_crc": zlib.crc32(MADE.coded)}
    return Rig(**{**whole, **layer})


def test_each_step_may_take_what_its_node_allows_and_no_two_have_one_key() -> None:
    rig = Rig()
    assert steps(rig).print_layer(3, FULL) == PrintedLayer((0, 1, 2, 3))
    rig.maps = [b"map"]
    assert steps(rig).scan(3) == b"map"
    allowed = {Routine.MOVE: 50.0, Routine.PASS: 4.0 + 2 * 3.0, Routine.CURE: 2.0 + 3.0, Routine.SCAN: 60.0}
    assert {routine: limit_s - MARGIN_S for _, routine, _, limit_s in rig.asked} == allowed
    assert len({(routine, key) for _, routine, key, _ in rig.asked}) == len(rig.asked) == 4 * 4 + 2


def test_map_that_does_not_arrive_is_scanned_again_by_a_key_of_its_own() -> None:
    rig = Rig()
    rig.maps = [TransferError("altered"), b"map"]
    assert steps(rig).scan(3) == b"map"
    assert rig.of(Routine.SCAN) == [Key(JOB, 3, 0, 1), Key(JOB, 3, 0, 2)]


def test_dry_run_is_not_recorded() -> None:
    journal, dry, rig = MasterJournal(), MasterJournal(), Rig()
    rig.maps = [b"map", b"map"]
    for kept, options in ((journal, {}), (dry, {"dry": True})):
        made = steps(rig, journal=kept, **options)
        made.print_layer(3, FULL)
        made.scan(3)
    recorded = [record.asked for record in journal.records if record.event is Event.DONE]
    assert recorded == [Asked.PATTERN, *[Asked.PASS, Asked.CURE] * 4, Asked.SCAN]
    assert {record.asked for record in dry.records} == {Asked.PATTERN}


def test_begun_layer_is_recorded_with_the_pattern_that_the_head_has() -> None:
    rig, journal = begun(done=0b0011), MasterJournal()
    assert steps(rig, journal=journal).print_layer(3, FULL) == PrintedLayer((0, 1, 2, 3))
    assert rig.sent == []
    assert [key.pass_ for key in rig.of(Routine.PASS)] == [2, 3]
    assert [key.pass_ for key in rig.of(Routine.CURE)] == [0, 1, 2, 3], "those of before may be wet"
    assert {record.pattern_crc for record in journal.records} == {zlib.crc32(MADE.coded)}


@pytest.mark.parametrize(
    ("layer", "sent"),
    [
        ({"done": 0b0011, "flags": Flags(0)}, [(3, True)]),
        ({"done": 0b0011, "flags": Flags(0), "pattern_crc": zlib.crc32(MADE.plain)}, [(3, False)]),
        ({"done": 0b1111, "flags": Flags(0)}, []),
        ({"done": 0b1111, "flags": Flags(0), "layer_flags": LayerFlags.ABANDONED}, []),
        ({"job": 8, "done": 0b0011}, [(3, True)]),
        ({"layer": 2, "done": 0b1111}, [(3, True)]),
        ({"passes": 0}, [(3, True)]),
        ({}, [(3, True)]),
    ],
    ids=["lost", "lost, plain", "complete", "complete, given up", "other job", "next", "no pattern", "not begun"],
)
def test_pattern_is_sent_where_the_head_lacks_it(layer: dict[str, Any], sent: list[tuple[int, bool]]) -> None:
    rig = begun(**layer)
    assert steps(rig).print_layer(3, FULL) == PrintedLayer((0, 1, 2, 3))
    assert rig.sent == sent


@pytest.mark.parametrize(
    ("layer", "whole", "cured"),
    [
        ({"done": 0b0001, "unknown": 0b0010}, (0,), [0, 1]),
        ({"done": 0b0111, "layer_flags": LayerFlags.ABANDONED}, (0, 1, 2), [0, 1, 2]),
        ({"layer_flags": LayerFlags.ABANDONED}, (), []),
    ],
)
def test_layer_that_was_given_up_is_cured_and_nothing_more(
    layer: dict[str, Any], whole: tuple[int, ...], cured: list[int]
) -> None:
    rig = begun(**layer)
    assert steps(rig).print_layer(3, FULL) == PrintedLayer(whole, is_unknown=True)
    assert rig.sent == rig.of(Routine.PASS) == []
    assert [key.pass_ for key in rig.of(Routine.CURE)] == cured


def test_head_without_the_coded_form_is_offered_it_once_and_another_refusal_is_an_error() -> None:
    rig, other = Rig(), Rig()
    rig.refuses_coded, other.refuses_coded = 0x31, 0x24
    made = steps(rig)
    for layer in (1, 2):
        made.print_layer(layer, FULL)
    assert rig.sent == [(1, True), (1, False), (2, False)]
    with pytest.raises(NodeRefused):
        steps(other).print_layer(1, FULL)
    assert other.sent == [(1, True)]


def test_light_as_long_as_the_limit_of_the_lamp_is_too_long() -> None:
    limits = {Node.CURE: replace(LIMITS, lamp=CURE_MS / 1e3)}
    with pytest.raises(NotReady, match=r"bench\.cure_ms is 20; this lamp switches itself off after 20 ms"):
        LayerSteps(Rig(), FOUR, limits, cure_ms=CURE_MS)  # type: ignore[arg-type]


def test_long_transfer_is_logged_by_quarters(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    for total in (LOGGED_FROM_BYTES - 1, LOGGED_FROM_BYTES):
        log = _log_quarters("head: pattern of layer 1")
        for through in range(0, total, 1000):
            log(through, total)
        log(total, total)
    assert caplog.messages == [f"head: pattern of layer 1: {kB} of 50 kB" for kB in (13, 25, 38, 50)]


def test_refusal_for_its_conditions_names_what_the_status_of_the_node_lacks() -> None:
    for code, words in (
        (
            0x22,
            r"^head: refuses\. By its status: not ready: ink temperature or back pressure; wait .* heater$",
        ),
        (0x24, r"^head: refuses$"),
    ):
        rig = Rig()
        rig.refuses_pass = code
        with pytest.raises(NodeRefused, match=words) as refused:
            steps(rig).print_layer(3, FULL)
        assert refused.value.code == code


def test_passes_of_a_layer_follow_the_rotation_of_the_job() -> None:
    part = replace(FOUR, pass_order=2, pass_rotation=1)
    limits = dict.fromkeys(Node, LIMITS)
    for layer, colours in ((1, (3, 1, 2, 0)), (2, (1, 2, 0, 3)), (3, (2, 0, 3, 1))):
        made = LayerSteps(Rig(), part, limits, cure_ms=CURE_MS)  # type: ignore[arg-type]
        assert made.print_layer(layer, FULL) == PrintedLayer(colours)


@pytest.mark.parametrize(("dry", "end"), [(False, ""), (True, ", dry")])
def test_steps_are_logged_by_the_numbers_of_pass_and_layer(
    dry: bool, end: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    rig = Rig()
    rig.maps = [TransferError("altered"), b"map"]
    made = steps(rig, dry=dry)
    made.print_layer(3, FULL)
    made.scan(3)
    passes = [f"pass {number} of 4, layer 3{end}" for number in (1, 2, 3, 4)]
    printed = [words for one in passes for words in (f"head: {one}", f"cure: lamp on for 20 ms after {one}")]
    assert caplog.messages == [
        *printed,
        "profiler: scan of layer 3",
        "profiler: the map of layer 3 is scanned again: altered",
        "profiler: scan of layer 3",
    ]
