"""The bus process asks for priority, so that other work on the machine does not delay the heartbeat."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import pytest

from inkloop_hardware.bus.connection import BusConnection
from inkloop_hardware.bus.heartbeat import NICE, NONE, raise_priority
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor import adapter_check
from inkloop_hardware.doctor.adapter_check import heartbeat_priority
from inkloop_hardware.doctor.findings import Grade

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="real-time scheduling of Linux")
REFUSED = PermissionError(1, "Operation not permitted")


@pytest.mark.parametrize(
    ("refused", "granted", "calls"),
    [
        ((), "real-time priority", ["real time"]),
        (("real time",), f"nice {NICE}; real-time priority: Operation not permitted", ["real time", "nice"]),
        (("real time", "nice"), f"{NONE}: Operation not permitted", ["real time", "nice"]),
    ],
)
def test_real_time_is_asked_for_then_a_lower_nice_value(
    refused: tuple[str, ...], granted: str, calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[str, Any]] = []

    def ask(name: str, wanted: object) -> None:
        asked.append((name, wanted))
        if name in refused:
            raise REFUSED

    monkeypatch.setattr(
        os, "sched_setscheduler", lambda pid, policy, param: ask("real time", (pid, policy, param.sched_priority))
    )
    monkeypatch.setattr(os, "setpriority", lambda which, who, value: ask("nice", (which, who, value)))
    assert raise_priority() == granted
    wanted = {"real time": (0, os.SCHED_FIFO, 1), "nice": (os.PRIO_PROCESS, 0, NICE)}
    assert asked == [(name, wanted[name]) for name in calls]


def test_bus_process_has_the_priority_that_it_reports() -> None:
    with closing(BusConnection(BusSettings("virtual", "priority"), 1, 7, [])) as bus:
        is_real_time = os.sched_getscheduler(bus.process_id) == os.SCHED_FIFO
        is_nice = os.getpriority(os.PRIO_PROCESS, bus.process_id) == NICE
        assert bus.priority.startswith(("real-time priority", f"nice {NICE};", NONE))
        assert is_real_time == bus.priority.startswith("real-time priority")
        assert is_nice == bus.priority.startswith(f"nice {NICE};")


@pytest.mark.parametrize(("words", "grade"), [("real-time priority", Grade.OK), (f"{NONE}: no", Grade.WARNING)])
def test_doctor_reports_what_is_granted(words: str, grade: Grade, monkeypatch: pytest.MonkeyPatch) -> None:
    tried = SimpleNamespace(run=lambda *_, **__: subprocess.CompletedProcess([], 0, words + "\n"))
    monkeypatch.setattr(adapter_check, "subprocess", tried)
    finding = heartbeat_priority()
    assert (finding.grade, words in finding.found) == (grade, True)
