"""The hardware watchdog of a node: kicked only by a node that finds itself well, it ends what a hanging one drives."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

import numpy as np
import pytest

from inkloop_hardware.protocol.records import Fault
from inkloop_hardware.protocol.services import Routine
from support.benches.node_bench import CURE, DONE, HEAD, Broken, NodeBench, Nrc, pattern_blob

FULL = np.ones((9, 8), np.uint8)
PASS_MS, PERIOD_MS = 900, 300
BOOT, INTENT, WATCHDOG = 1, 3, 7


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench(pass_ms=PASS_MS, gate_ms=0, watchdog_ms=PERIOD_MS) as made:
        made.ready()
        assert made.download(pattern_blob(FULL, passes=1), 1) == 0
        yield made


def test_node_that_hangs_with_the_gate_open_jets_until_the_watchdog_bites_and_not_longer(bench: NodeBench) -> None:
    """Nine lines in 900 ms: one in 100 ms. The last kick comes with the tick in which the jets begin."""
    assert bench.raw(bench.routine(Routine.PASS, 1, option=b"\xff")) == b"\x7f\x31\x78"
    bench.tick(10)
    bench.clock += 3000
    bench.tick()
    state = bench.state()
    assert (state.state, state.cause, state.unknown, state.boots) == ("SAFE", Fault.PASS_UNKNOWN, 1, 2)
    assert state.by_watchdog
    assert bench.journal()[-2:] == [(INTENT, 4, 0), (WATCHDOG, 0, 0)]
    jetted = np.flatnonzero(bench.surface.max(axis=1) > 1e-6)
    assert jetted.tolist() == [0, 1, 2]
    bench.tick(100)
    assert bench.clear() == -Nrc.CONDITIONS, "a person has to look"
    assert bench.clear(HEAD, 1) == DONE
    bench.power_up()
    assert not bench.state().by_watchdog, "the next one has another cause"
    assert bench.state().boots == 3


def test_head_without_power_has_its_gate_closed(bench: NodeBench) -> None:
    """By its spring: before the node is there again."""
    cure = bench.routine(Routine.CURE, 1, option=b"\x01\x00")
    assert bench.raw(bench.routine(Routine.PASS, 1, option=b"\xff")) == b"\x7f\x31\x78"
    bench.tick()
    assert bench.raw(cure, CURE) == bytes((0x7F, 0x31, Nrc.CONDITIONS))
    bench.c.bench_power_off(bench.bench, HEAD)
    assert bench.raw(cure, CURE) == b"\x7f\x31\x78"


@pytest.mark.parametrize("one_node", [0, 1])
def test_lamp_without_power_is_dark(one_node: int) -> None:
    node = HEAD if one_node else CURE
    with NodeBench(one_node=one_node) as bench:
        if one_node:
            assert bench.ready().download(pattern_blob(FULL, passes=1), 1) == 0
            assert bench.jet(1, colour=255) == DONE
        else:
            bench.ready()
        assert bench.raw(bench.routine(Routine.CURE, 1, option=b"\x01\x00"), node) == b"\x7f\x31\x78"
        bench.tick()

        def irradiance() -> int:
            frame = bench.measured(CURE, ctypes.create_string_buffer(64), bench.clock)
            assert frame
            return int.from_bytes(frame.data[:2], "little")

        assert irradiance() > 0
        bench.c.bench_power_off(bench.bench, node)
        assert irradiance() == 0


def test_node_that_finds_itself_unwell_does_not_kick(bench: NodeBench) -> None:
    """It ticks on, but drives something without a step."""
    bench.c.probe_drive_gate(bench.bench, HEAD)
    bench.tick(PERIOD_MS - 5)
    assert bench.state().boots == 1
    bench.tick(5)
    assert (bench.state().state, bench.state().boots, bench.state().by_watchdog) == ("SAFE", 2, True)
    assert bench.journal()[-1][0] == WATCHDOG
    assert [bench.state(node).boots for node in range(1, 4)] == [1, 1, 1]
    bench.tick(2 * PERIOD_MS)
    assert bench.state().boots == 2, "after the power-up it is well"


def test_node_that_ticks_is_never_reset_even_where_the_clock_wraps() -> None:
    with NodeBench(clock=2**32 - 1000, watchdog_ms=50) as bench:
        bench.ready().print_layer(FULL, 1)
        bench.tick(2000)
        assert [bench.state(node).boots for node in range(4)] == [1] * 4
        bench.power_up()
        assert bench.journal()[-1][0] == BOOT
        assert not bench.state().by_watchdog


def test_node_that_drives_lamp_and_gate_at_once_does_not_kick() -> None:
    """Although no line shows it: the lamp takes no current, and the gate is driven by a flipped bit alone."""
    with NodeBench(watchdog_ms=PERIOD_MS) as bench:
        bench.ready().broken(Broken.LAMP_STAYS_OFF)
        assert bench.raw(bench.routine(Routine.CURE, 1, option=b"\x13\x88"), CURE) == b"\x7f\x31\x78"
        bench.tick(PERIOD_MS + 50)
        assert (bench.state(CURE).state, bench.state(CURE).boots) == ("CURING", 1)
        bench.c.probe_drive_gate(bench.bench, CURE)
        bench.tick(PERIOD_MS)
        assert (bench.state(CURE).boots, bench.state(CURE).by_watchdog) == (2, True)


def test_watchdog_of_a_bench_that_says_nothing_of_it_bites_after_300_ms() -> None:
    with NodeBench() as bench:
        bench.ready()
        for passed, boots in ((299, 1), (300, 2)):
            bench.clock += passed - 5
            bench.tick(5)
            assert [bench.state(node).boots for node in range(4)] == [boots] * 4
