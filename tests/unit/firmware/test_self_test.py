"""A node's self test of gate and lamp: confirmed by the lines, everything off afterwards, no layer knows of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from inkloop_hardware.protocol.services import Routine
from inkloop_hardware.protocol.vocabulary import Fault
from support.benches.node_bench import CURE, DONE, HEAD, Broken, NodeBench, Nrc, pattern_blob

FULL = np.ones((9, 8), np.uint8)
OF_THE_GATE, OF_THE_LAMP = b"\x00\x00", b"\x00\x64"


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made.ready()


def assert_off(bench: NodeBench, node: int) -> None:
    times = bench.times(node)
    assert times.lamp_off >= times.lamp_on
    assert times.gate_closed >= times.gate_opened


def test_gate_goes_to_both_ends_and_the_lamp_lights_with_it_closed(bench: NodeBench) -> None:
    before = bench.surface.copy()
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_GATE) == DONE
    assert bench.run(Routine.SELF_TEST, CURE, option=OF_THE_LAMP) == DONE
    assert bench.gate_openings == 1
    assert bench.lamp_pulses == 1
    assert bench.lamp_with_gate == 0
    times = bench.times(CURE)
    assert 100 <= times.lamp_off - times.lamp_on < 110
    np.testing.assert_array_equal(bench.surface, before)


def test_layer_under_way_and_journals_do_not_know_of_it(bench: NodeBench) -> None:
    assert bench.download(pattern_blob(FULL), 1) == 0
    assert bench.jet(1) == DONE
    before = [(bench.journal(node), bench.state(node).done, bench.state(node).state) for node in (HEAD, CURE)]
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_GATE) == DONE
    assert bench.run(Routine.SELF_TEST, CURE, option=OF_THE_LAMP) == DONE
    assert [(bench.journal(n), bench.state(n).done, bench.state(n).state) for n in (HEAD, CURE)] == before
    assert bench.cure(1) == DONE
    assert bench.jet(1, 1) == DONE


@pytest.mark.parametrize(
    ("broken", "node", "option", "cause"),
    [
        (Broken.GATE_STAYS_CLOSED, HEAD, OF_THE_GATE, Fault.GATE_NOT_CONFIRMED),
        (Broken.GATE_STAYS_OPEN, HEAD, OF_THE_GATE, Fault.GATE_NOT_CONFIRMED),
        (Broken.LAMP_STAYS_ON, CURE, OF_THE_LAMP, Fault.LAMP_TIME),
        (Broken.LAMP_STAYS_OFF, CURE, OF_THE_LAMP, Fault.LAMP_TIME),
    ],
)
def test_what_is_not_confirmed_is_a_fault_with_everything_off(
    broken: int, node: int, option: bytes, cause: int, bench: NodeBench
) -> None:
    assert bench.raw(bench.routine(Routine.SELF_TEST, option=option), node)[2] == 0x78
    bench.broken(broken)
    bench.tick(1500)
    assert bench.late(node)[:3] == bytes((0x7F, 0x31, Nrc.FAILED))
    state = bench.state(node)
    assert (state.state, state.cause, state.needs_operator) == ("FAULT", cause, True)
    assert_off(bench, node)


def test_what_a_node_does_not_have_it_does_not_test(bench: NodeBench) -> None:
    assert bench.run(Routine.SELF_TEST, CURE, option=OF_THE_GATE) == -Nrc.RANGE
    assert bench.run(Routine.SELF_TEST, HEAD, option=OF_THE_LAMP) == -Nrc.RANGE
