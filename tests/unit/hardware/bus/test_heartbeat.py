"""The heartbeat follows the control loop, not the other way round."""

from __future__ import annotations

from itertools import pairwise

import pytest

from inkloop_hardware.bus.heartbeat import Enables, Heartbeat, after
from inkloop_hardware.link.node_watch import E2eMonitor, Verdict
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import MasterAlive, unpack

CODEC = Codec()
ALL = Enables.LAMP | Enables.GATE | Enables.MOTION
STEP = 0.01


class Loop:
    """A heartbeat and what it sent, by an injected clock; `words` are the enables of a loop that lives, None hangs."""

    def __init__(self) -> None:
        self.heartbeat = Heartbeat(CODEC, session=3, job=9, grace=0.5, loop_timeout=120.0)
        self.now = 1.0
        self.sent: list[tuple[float, MasterAlive]] = []
        self.monitor = E2eMonitor()
        self.silences: list[float] = []

    def run(self, seconds: float, word: Enables | None) -> list[MasterAlive]:
        """Frames sent meanwhile."""
        before = len(self.sent)
        until = self.now + seconds
        while self.now < until - STEP / 2:
            self.now = round(self.now + STEP, 6)
            if word is not None:
                self.heartbeat.keep_alive(self.now, word)
            silent = self.heartbeat.silence(self.now)
            if silent is not None:
                self.silences.append(silent)
                self._note(self.heartbeat.end())
            self._note(self.heartbeat.frames(self.now))
        return [alive for _, alive in self.sent[before:]]

    def _note(self, frames: list[Frame]) -> None:
        for frame in frames:
            reading = CODEC.decode(frame)
            assert self.monitor.take(reading.intact, reading.counter or 0) in (Verdict.FIRST, Verdict.GOOD)
            alive = unpack(CODEC, reading)
            assert isinstance(alive, MasterAlive)
            self.sent.append((self.now, alive))


def enables(alive: MasterAlive) -> Enables:
    found = Enables.LAMP * alive.lamp_enable | Enables.GATE * alive.gate_enable | Enables.MOTION * alive.motion_enable
    return Enables(found)


def test_nothing_is_sent_before_the_first_keep_alive() -> None:
    assert Loop().run(5.0, None) == []


def test_master_alive_comes_every_100_ms_while_the_loop_lives() -> None:
    loop = Loop()
    loop.run(10.0, Enables.NONE)
    times = [at for at, _ in loop.sent]
    assert max(after - before for before, after in pairwise(times)) <= 0.1 + STEP
    assert 98 <= len(times) <= 102
    assert {(alive.session, alive.job, enables(alive)) for _, alive in loop.sent} == {(3, 9, Enables.NONE)}


def test_another_job_is_sent_at_once_and_twice() -> None:
    """A pattern for it may be the next thing on the bus."""
    loop = Loop()
    loop.run(1.0, Enables.NONE)
    loop.heartbeat.change_job(loop.now, 10)
    assert [alive.job for alive in loop.run(0.05, Enables.NONE)] == [10, 10]


@pytest.mark.parametrize("step", [Enables.LAMP, Enables.GATE | Enables.MOTION, ALL])
def test_change_of_enables_is_sent_at_once_and_twice(step: Enables) -> None:
    """A single lost frame must neither delay a step nor keep it enabled."""
    loop = Loop()
    loop.run(1.0, Enables.NONE)
    for wanted in (step, Enables.NONE):
        assert [enables(alive) for alive in loop.run(STEP, wanted)] == [wanted]
        assert [enables(alive) for alive in loop.run(0.04, wanted)] == [wanted]


def test_silence_with_something_enabled_drops_it_after_the_grace() -> None:
    loop = Loop()
    loop.run(1.0, ALL)
    hung = loop.now
    loop.run(5.0, None)
    assert loop.silences == [pytest.approx(0.5, abs=2 * STEP)]
    assert loop.sent[-1][0] - hung <= 0.5 + 2 * STEP
    assert enables(loop.sent[-1][1]) is Enables.NONE
    assert all(enables(alive) == ALL for _, alive in loop.sent[:-1])


def test_plan_may_last_as_long_as_nothing_is_enabled() -> None:
    loop = Loop()
    loop.run(0.5, Enables.NONE)
    assert len(loop.run(119.0, None)) == pytest.approx(1190, abs=10)
    loop.run(2.0, None)
    assert loop.silences == [pytest.approx(120.0, abs=2 * STEP)]
    assert loop.run(50.0, None) == []


def test_loop_that_comes_back_enables_nothing_before_it_has_let_go() -> None:
    """The step that hung is over, whatever the loop believes."""
    loop = Loop()
    loop.run(1.0, Enables.LAMP)
    loop.run(2.0, None)
    assert {enables(alive) for alive in loop.run(1.0, Enables.LAMP)} == {Enables.NONE}
    loop.run(STEP, Enables.NONE)
    assert {enables(alive) for alive in loop.run(1.0, Enables.LAMP)} == {Enables.LAMP}


def test_end_sends_that_nothing_is_enabled_and_then_nothing() -> None:
    loop = Loop()
    loop.run(1.0, ALL)
    last = [unpack(CODEC, CODEC.decode(frame)) for frame in loop.heartbeat.end()]
    assert [enables(alive) for alive in last if isinstance(alive, MasterAlive)] == [Enables.NONE]
    assert loop.heartbeat.end() == []
    assert loop.run(1.0, None) == []


def test_loop_that_had_enabled_nothing_may_enable_as_soon_as_it_is_back() -> None:
    loop = Loop()
    loop.run(STEP, Enables.NONE)
    loop.now += 120.0
    loop.run(STEP, None)
    assert len(loop.silences) == 1
    assert {enables(alive) for alive in loop.run(0.05, Enables.GATE)} == {Enables.GATE}


def test_loop_that_is_back_is_heard_at_once_and_missed_frames_are_not_made_up_for() -> None:
    heartbeat = Loop().heartbeat
    heartbeat.keep_alive(1.0, Enables.GATE)
    assert [heartbeat.silence(now) for now in (1.5, 1.75)] == [None, 0.75], "beyond the grace"
    assert [len(heartbeat.frames(now)) for now in (1.0, 1.03, 1.05)] == [1, 1, 0]
    assert len(heartbeat.end()) == 1
    assert heartbeat.frames(1.05) == []
    heartbeat.keep_alive(1.05, Enables.NONE)
    assert len(heartbeat.frames(1.05)) == 1
    assert [after(1.0, 0.25, now) for now in (1.0, 1.25, 9.0)] == [1.25, 1.5, 9.25]
