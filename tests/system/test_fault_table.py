"""Every failure a bench may have, between real processes: what the nodes do, what the master reports, what is printed.

Other files: adapters in test_adapter_faults.py, a master that hangs or dies in test_rig.py, resumed runs in
test_exactly_once.py, what the journal of a head is compared with in tests/unit/hardware/devices/test_devices.py.
"""

from __future__ import annotations

import logging
import zlib
from contextlib import ExitStack

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.readiness import NotReady, make_ready
from inkloop_hardware.errors import (
    AnotherMaster,
    HardwareError,
    LinkTimeout,
    NodeLost,
    NodeRefused,
    NodeStopped,
    StopRequested,
    TransferError,
)
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Flags, Happening, Step
from inkloop_hardware.protocol.records import Fault, Node, Source, State, StopRequest, pack
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from inkloop_hardware.protocol.transfer_bytes import read_map
from support.benches import failures, node_bench
from support.benches.fault_run import (
    BLOB,
    JOB,
    LIMIT_S,
    PATTERN,
    SILENCE_S,
    FaultRun,
    faulty,
    looked_at,
    printed,
    settings_of,
    wait_for_fault,
    wait_until,
)
from support.page_tables import rows_of

ALL = (0, 1, 2, 3)


def is_disturbed(rig: Rig) -> bool:
    try:
        rig.check_alone()
    except (AnotherMaster, StopRequested):
        return True
    return False


RECOVERED = [
    "corruption:id=0x640,step=download,byte=6",
    "duplication:id=0x641,probability=0.3",
    "malformed-line:probability=0.02",
    "late-answer:node=head,service=0x36",
    "short-map:node=profiler",
    "bad-check:id=0x20,count=1",
    "loss:probability=0.005,seed=4",
    "transmit-order:node=head,probability=0.2",
    "slow-erase:node=head,step=pass,pass=1",
]
RECOVERED_TOO = [
    "loss:id=0x641,step=pass,pass=2",
    "burst:id=0x640,step=download,count=3",
    "loss:id=0x644,step=pass,pass=1",
    "duplication:id=0x640,probability=0.3",
    "swap:id=0x640,probability=0.1",
    "delay:id=0x641,probability=0.1,frames=3",
    "flow-control:node=head",
    "flow-control:node=profiler",
    "late-answer:node=head,service=0x31,step=pass,pass=1",
    "repeated-answer:count=1000",
    "stuck-counter:node=cure,count=1",
    *(f"loss:probability=0.01,seed={seed}" for seed in range(3)),
]


@pytest.mark.parametrize(
    "fault", [*RECOVERED, *(pytest.param(fault, marks=pytest.mark.long) for fault in RECOVERED_TOO)]
)
def test_what_can_be_mended_changes_nothing_of_the_part(fault: str) -> None:
    """Requests are repeated with their keys: four gate pulses, the whole pattern, the heights of four passes."""
    with faulty(fault) as run:
        run.print_layer()
        found = run.scan()
        state = run.state()
        assert (state.done, state.unknown, state.gate_pulses) == (0b1111, 0, 4)
        np.testing.assert_allclose(found, printed(ALL), atol=1e-12)


@pytest.mark.parametrize("side", [100, pytest.param(283, marks=pytest.mark.long)])
def test_layer_comes_whole_through_a_bus_that_loses_one_frame_in_a_thousand(side: int) -> None:
    """Either way; 283 x 283 cells of two inks are a pattern of 20 kB and a map of 170 kB."""
    pattern = np.random.default_rng(side).integers(0, 3, (side, side)).astype(np.uint8)
    blob = node_bench.pattern_blob(pattern)
    with faulty("loss:probability=1e-3,seed=1", nx=side, ny=side) as run:
        run.rig.link(Node.HEAD).download(1, blob)
        for number in ALL:
            assert run.jet(number) is Outcome.DONE
        run.rig.link(Node.PROFILER).routine(Routine.SCAN, Key(JOB, 1), limit_s=LIMIT_S)
        _, valid = read_map(run.rig.link(Node.PROFILER).upload(1), side, side)
        assert valid.all()
        assert (run.state().gate_pulses, run.state().pattern_crc) == (4, zlib.crc32(blob))
        assert run.rig.link(Node.PROFILER).counts.repeated > 0


def test_repeats_are_counted_and_late_answers_dropped(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    with faulty("late-answer:node=head,service=0x36", "repeated-answer:node=cure,count=100") as run:
        run.print_layer(2)
        head, cure = run.rig.link(Node.HEAD).counts, run.rig.link(Node.CURE).counts
    assert head.repeated >= 1
    assert head.stray >= 1
    assert cure.stray >= 1
    assert any("requests sent again" in words and words.startswith("head") for words in caplog.messages)


def test_node_that_never_answers_is_named_and_left_safe() -> None:
    """Its status frames come in; the step is given up, and with the master's end the node de-energises itself."""
    with faulty("loss:id=0x641,step=pass,count=1000000") as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        with pytest.raises(LinkTimeout, match=r"head \(0x641 .*has not ended in time: pass of layer 1, pass 0; ask"):
            run.jet(0, limit_s=1.2)
        assert run.rig.status(Node.HEAD) is not None
        wait_until(lambda: run.rig.keep_alive() is None and run.rig.status(Node.CURE).state is State.IDLE)
        run.rig.detach()
        wait_for_fault(run.bench, Node.HEAD, Fault.MASTER_LOST)
        run.rig.attach()


def test_wait_is_extended_while_the_node_is_busy_and_bounded_by_the_step() -> None:
    with faulty(pass_ms=1500) as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        assert run.jet(0) is Outcome.DONE
        with pytest.raises(LinkTimeout, match="has not ended in time"):
            run.jet(1, limit_s=1.1)
        wait_until(lambda: run.state().state is State.SAFE)
        assert (run.state().cause, run.state().unknown) == (Fault.ENABLE_DROPPED, 0b10)


def test_pattern_that_is_altered_again_and_again_is_never_printed() -> None:
    with faulty("corruption:id=0x640,step=download,byte=6,count=1000000") as run:
        with pytest.raises((TransferError, LinkTimeout, NodeRefused)):
            run.rig.link(Node.HEAD).download(1, BLOB)
        with looked_at(run) as after:
            assert after.state().gate_pulses == 0
            assert after.state().passes == 0


def test_node_that_dies_in_a_pass_is_lost_and_its_pass_unknown() -> None:
    """Power comes back after a while: at most the pass that was begun is on the part, and it is not jetted again."""
    fault = "death:node=head,step=pass,pass=1,nth=2,frames=40"
    with faulty(fault, pass_ms=500) as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        run.jet(0)
        run.cure(0)
        with pytest.raises(NodeLost, match=rf"the head has been silent for {SILENCE_S:.0f}\.\d s; is it powered"):
            run.jet(1)
        with pytest.raises(NodeLost, match="head has been silent"):
            run.rig.supervision.check([Node.HEAD])
        wait_until(lambda: run.rig.keep_alive() is None and run.rig.status(Node.HEAD).boot_count == 2)
        state = run.state()
        assert (state.state, state.cause) == (State.SAFE, Fault.PASS_UNKNOWN)
        assert (state.done, state.unknown) == (0b01, 0b10)
        assert Flags.NEEDS_OPERATOR in state.flags
        assert [(one.kind, one.step) for one in run.rig.link(Node.HEAD).journal()[:2]] == [
            (Happening.BOOT, Step.NONE),
            (Happening.INTENT, Step.PASS),
        ]
        with pytest.raises(NodeRefused, match="person"):
            run.clear()
        run.clear(1)
        for number in (1, 2):
            with pytest.raises(NodeRefused) as refused:
                run.jet(number)
            assert refused.value.code == 0x24
        run.cure(1)
        found = run.scan()
        assert np.all(found >= printed((0,)) - 1e-12)
        assert np.all(found <= printed((0, 1)) + 1e-12)


@pytest.mark.parametrize("fault", ["stuck-counter:node=cure,count=1000", "bad-check:node=cure,count=1000"])
def test_node_that_is_not_to_be_believed_counts_as_lost(fault: str) -> None:
    with faulty(f"{fault},step=download") as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        wait_until(lambda: run.rig.keep_alive() is None and not run.rig.supervision.watch(Node.CURE).monitor.trusted)
        with pytest.raises(NodeLost, match=r"cure cannot be trusted: .*(damaged|repeated)"):
            run.cure(0)


@pytest.mark.parametrize("fault", ["stuck-counter:id=0x20,count=1000", "bad-check:id=0x20,count=1000"])
def test_master_that_is_not_to_be_believed_makes_every_node_safe(fault: str) -> None:
    with faulty(f"{fault},step=pass,pass=1", pass_ms=1000) as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        run.jet(0)
        with pytest.raises((NodeRefused, NodeStopped), match="supervision"):
            run.jet(1)
        for node in Node:
            state = run.state(node)
            assert (state.state, state.cause) == (State.SAFE, Fault.SUPERVISION)
        assert run.state().unknown == 0b10


def test_node_that_restarts_is_reported_and_continues_by_its_journal(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    with faulty("reboot:node=head,step=cure,pass=1") as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        for number in (0, 1):
            run.jet(number)
            run.cure(number)
        with pytest.raises(NodeRefused, match=r"0x22.*it is SAFE"):
            run.jet(2)
        wait_until(lambda: run.rig.keep_alive() is None and "head: restarted" in caplog.messages)
        state = run.state()
        assert (state.boots, state.done, state.unknown) == (2, 0b11, 0)
        run.clear()
        assert [run.rig.link(Node.HEAD).ask(Routine.PASS, Key(JOB, 1, n)) for n in ALL] == [
            *(Outcome.DONE_BEFORE, Outcome.DONE_BEFORE, Outcome.NEVER, Outcome.NEVER)
        ]
        run.rig.link(Node.HEAD).download(1, BLOB)
        for number in (0, 1, 2, 3):
            assert run.jet(number) is (Outcome.DONE if number > 1 else Outcome.DONE_BEFORE)
            run.cure(number)
        assert run.state().gate_pulses == 2
        np.testing.assert_allclose(run.scan(), printed(ALL), atol=1e-12)


def test_node_that_is_off_the_bus_goes_safe_by_itself_and_is_heard_again() -> None:
    with faulty("bus-off:node=cure,step=download,frames=15") as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        wait_until(lambda: run.rig.keep_alive() is None and run.rig.status(Node.CURE).fault is Fault.MASTER_LOST)
        assert (run.state(Node.CURE).cause, run.state(Node.CURE).boots) == (Fault.MASTER_LOST, 1)
        assert run.state(Node.HEAD).state is State.VERIFIED


def test_records_that_cannot_be_read_ask_a_person_and_end_the_job() -> None:
    with faulty(failures.UNREADABLE, f"reboot:{failures.SECOND}", pass_ms=500) as run:
        with pytest.raises((NodeLost, NodeRefused, NodeStopped)):
            failures.in_second_pass(run)
        wait_until(lambda: run.rig.keep_alive() is None and run.state().cause is Fault.JOURNAL_UNREADABLE)
        with pytest.raises(
            NotReady, match=r"head: its journal could not be read .*; switch it off and on; .*--give-up"
        ):
            make_ready(run.rig, tuple(Node))
        assert run.rig.link(Node.HEAD).ask(Routine.PASS, Key(JOB, 1, 1)) is Outcome.UNKNOWN
        with pytest.raises(NodeRefused, match="journal unreadable"):
            run.clear(1)
        run.clear(3)
        with pytest.raises(NodeRefused) as refused:
            run.rig.link(Node.HEAD).download(1, BLOB)
        assert refused.value.code == 0x24
        run.rig.job = JOB + 1
        wait_until(lambda: _is_accepted(run))
        assert run.state().unknown == 0


def _is_accepted(run: FaultRun) -> bool:
    """Whether the head takes the first pattern of the job, which its master has just begun."""
    try:
        run.rig.link(Node.HEAD).download(1, BLOB)
    except NodeRefused:
        return False
    return True


def test_new_master_reads_the_journal_and_repeats_nothing() -> None:
    with faulty() as run:
        run.print_layer(2)
        with looked_at(run) as new:
            assert new.rig.session != run.rig.session
            assert [record.kind for record in new.rig.link(Node.HEAD).journal()[:2]] == [
                *(Happening.DONE, Happening.INTENT)
            ]
            new.clear()
            assert new.jet(0) is Outcome.DONE_BEFORE
            new.rig.link(Node.HEAD).download(1, BLOB)
            with pytest.raises(NodeRefused) as refused:
                new.rig.link(Node.HEAD).download(1, BLOB)
            assert refused.value.code == 0x24
            for number in (2, 3):
                assert new.jet(number) is Outcome.DONE
                new.cure(number)
            assert new.state().gate_pulses == 4
            np.testing.assert_allclose(new.scan(), printed(ALL), atol=1e-12)


def test_second_master_makes_the_nodes_safe_and_both_get_an_error(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    with faulty(pass_ms=1000) as run, ExitStack() as stack:
        other = Rig(settings_of(run.bench))
        monkeypatch.setattr(other.supervision, "_listen", lambda: None)
        stack.enter_context(other)
        other.wait_for(Node, LIMIT_S)
        for rig, session in ((run.rig, other.session), (other, run.rig.session)):
            wait_until(lambda rig=rig: rig.keep_alive() is None and is_disturbed(rig))  # type: ignore[misc]
            with pytest.raises(AnotherMaster, match=f"another master is active on this bus, session {session}"):
                rig.check_alone()
            with pytest.raises(AnotherMaster), rig.enabled(gate=True):
                pytest.fail("nothing may be enabled")
        for node in Node:
            state = run.state(node)
            assert (state.state, state.cause) == (State.SAFE, Fault.TWO_MASTERS)
    assert caplog.text.count("another master is active on the bus") == 2


def test_second_master_in_a_pass_ends_it_with_a_message() -> None:
    with faulty("second-master:step=pass,pass=1", pass_ms=1000) as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        run.jet(0)
        with pytest.raises((NodeRefused, NodeStopped), match="two masters"):
            run.jet(1)
        assert (run.state().unknown, run.state().cause) == (0b10, Fault.TWO_MASTERS)


def test_stop_request_is_latched_until_it_is_released_and_a_person_clears(caplog: pytest.LogCaptureFixture) -> None:
    codec, counter = Codec(), 0
    with faulty() as run:
        button = Adapter(settings_of(run.bench))

        def press(active: bool) -> None:
            nonlocal counter
            button.send(pack(codec, StopRequest(active, Source.OPERATOR), counter))
            counter = (counter + 1) % 15

        run.rig.link(Node.HEAD).download(1, BLOB)
        press(True)
        wait_until(lambda: run.state().state is State.SAFE)
        assert run.state().cause is Fault.STOP_REQUEST
        press(True)
        wait_until(lambda: run.rig.keep_alive() is None and is_disturbed(run.rig))
        with pytest.raises(StopRequested, match="a stop request of the operator is active: look"), run.rig.enabled():
            pytest.fail("nothing may be enabled")
        for option in (0, 1):
            with pytest.raises(NodeRefused, match="stop request"):
                run.clear(option)
        press(False)
        with pytest.raises(NodeRefused, match="stop request"):
            run.clear(1)
        press(False)
        with pytest.raises(NodeRefused, match="person"):
            run.clear()
        run.clear(1)
        assert run.state().state is State.IDLE
        button.close()
    assert "a stop request of the operator" in caplog.messages


def test_map_that_stays_short_is_scanned_again_and_nothing_is_printed_again() -> None:
    job = Job(9, 9, 1e-4, np.zeros((9, 9)), np.ones((9, 9), np.bool_), inks=(Ink(), Ink()), passes=4)
    with faulty("short-map:count=1000000", cleared=False) as run:
        steps = LayerSteps(run.rig, job, make_ready(run.rig, tuple(Node)), cure_ms=10)
        steps.print_layer(1, PATTERN)
        with pytest.raises(TransferError, match="map of layer 1"):
            steps.scan(1)
        scans = [one for one in run.rig.link(Node.PROFILER).journal() if one.step is Step.SCAN]
        assert [(one.kind, one.key.attempt) for one in scans] == [
            *((Happening.DONE, 2), (Happening.INTENT, 2), (Happening.DONE, 1), (Happening.INTENT, 1))
        ]
        assert run.state().gate_pulses == 4


def test_layer_that_was_begun_with_another_pattern_is_not_resumed() -> None:
    job = Job(9, 9, 1e-4, np.zeros((9, 9)), np.ones((9, 9), np.bool_), inks=(Ink(), Ink()), passes=4)
    with faulty() as run:
        run.print_layer(1)
        steps = LayerSteps(run.rig, job, make_ready(run.rig, tuple(Node)), cure_ms=10)
        with pytest.raises(HardwareError, match=r"layer 1 was begun with another pattern .*was the scenario changed"):
            steps.print_layer(1, 2 - PATTERN.astype(np.int32))
        assert run.state().gate_pulses == 1


def test_malformed_lines_are_counted_and_reported(caplog: pytest.LogCaptureFixture) -> None:
    with faulty("malformed-line:id=0x101,step=download") as run:
        run.rig.link(Node.HEAD).download(1, BLOB)
        wait_until(lambda: run.rig.keep_alive() is None and "1 malformed lines of the adapter so far" in caplog.text)


@pytest.mark.long
def test_nodes_record_what_the_page_of_the_faults_shows() -> None:
    """The error of the master may differ: a refusal, or the loss of the node, whichever comes first."""
    shown = rows_of("reference/bench-faults.md", failures.HEADS)
    assert [(row[0], row[-1]) for row in failures.rows()] == [(row[0], row[-1]) for row in shown]
