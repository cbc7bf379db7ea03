from __future__ import annotations

import numpy as np
import pytest

from inkloop.component import Port
from inkloop.master.master import Master
from inkloop.master.pacing import Pacing, sentence
from inkloop.results.checkpoint import Checkpoint
from support.toys import FunctionComponent, Resumable

MS = 1_000_000


class FakeClock:
    """A clock that only runs while a component sleeps or works."""

    def __init__(self) -> None:
        self.now_ns = 12_345
        self.naps: list[float] = []

    def __call__(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.naps.append(seconds)
        self.now_ns += round(seconds * 1e9)


def paced(clock: FakeClock, work_ms: list[int], factor: float = 1.0) -> Pacing:
    """Points every 100 ms of simulated time, the step to each of which takes so much of the clock."""
    pacing = Pacing(factor, clock=clock, sleep=clock.sleep)
    pacing.start(0)
    for point, work in enumerate(work_ms, start=1):
        clock.now_ns += work * MS
        pacing.wait(point * 100 * MS)
    return pacing


def test_late_point_is_counted_and_caught_up_with() -> None:
    clock = FakeClock()
    begin = clock.now_ns
    statistics = paced(clock, [10, 250, 10, 10]).statistics
    assert (statistics["steps"], statistics["missed"]) == (4, 2)
    assert statistics["worst_s"] == pytest.approx(0.15, rel=1e-9, abs=0.0)
    # 0, 0, 60 and 150 ms late: the 99th percentile lies between the two worst
    assert statistics["p99_s"] == pytest.approx(0.06 + 0.97 * 0.09, rel=1e-9, abs=0.0)
    assert clock.now_ns - begin == 400 * MS


def test_long_wait_is_given_up_when_cancelled() -> None:
    clock = FakeClock()
    pacing = Pacing(clock=clock, sleep=clock.sleep)
    pacing.start(0)
    pacing.wait(3_600_000 * MS, lambda: len(clock.naps) >= 2)
    assert len(clock.naps) == 2
    assert max(clock.naps) <= 0.1


def test_master_steps_by_the_clock_and_reports_how_long_it_waited() -> None:
    clock = FakeClock()
    begin = clock.now_ns
    pacing = Pacing(clock=clock, sleep=clock.sleep)
    part = FunctionComponent(outputs=[Port("y")])
    master = Master({"a": part}, [], step_ns=20 * MS, pacing=pacing)
    assert master.run(time_max_ns=100 * MS) == "time_max"
    assert clock.now_ns - begin == 100 * MS
    assert pacing.statistics["steps"] == 5
    assert set(master.wall_s) == {"a", "observers", "waiting", "master", "total"}


def test_resumed_master_waits_for_what_is_left() -> None:
    clock = FakeClock()
    begin = clock.now_ns
    pacing = Pacing(2.0, clock=clock, sleep=clock.sleep)
    point = Checkpoint(600 * MS, 0, {"a": {"y": np.asarray(0.0)}}, {"a": b""})
    master = Master({"a": Resumable(outputs=[Port("y")])}, [], step_ns=20 * MS, pacing=pacing)
    assert master.run(time_max_ns=1000 * MS, resume=point) == "time_max"
    assert clock.now_ns - begin == 200 * MS


def test_interrupt_ends_the_wait_of_a_paced_master() -> None:
    clock = FakeClock()
    pacing = Pacing(clock=clock, sleep=clock.sleep)
    master = Master({"a": FunctionComponent(outputs=[Port("y")])}, [], step_ns=3_600_000 * MS, pacing=pacing)
    list(master.turns(time_max_ns=3_600_000 * MS, interrupted=lambda: len(clock.naps) >= 2))
    assert len(clock.naps) == 2


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_points_are_reached_at_their_time_by_the_clock_counted_from_where_the_run_stands(factor: float) -> None:
    clock = FakeClock()
    begin = clock.now_ns
    pacing = Pacing(factor, clock=clock, sleep=clock.sleep)
    assert pacing.statistics == {"real_time_factor": factor, "steps": 0, "missed": 0, "worst_s": 0.0, "p99_s": 0.0}
    pacing.start(1000 * MS)
    for point in (1100, 1200):
        clock.now_ns += 7 * MS
        pacing.wait(point * MS)
    assert clock.now_ns - begin == pytest.approx(200 * MS / factor, abs=1)
    assert sentence(pacing.statistics).startswith(f"real time x {factor:g}: 0 of 2 steps late, worst 0 ms")


def test_account_of_the_deadlines_is_told_in_milliseconds() -> None:
    figures = {"real_time_factor": 2.0, "steps": 9, "missed": 4, "worst_s": 0.25, "p99_s": 0.0125}
    assert sentence(figures) == "real time x 2: 4 of 9 steps late, worst 250 ms, 99 % within 12.5 ms"
