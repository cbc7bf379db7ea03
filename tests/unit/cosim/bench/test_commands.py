"""Arguments of the actions on a bench; without a bus."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any
from unittest.mock import Mock

import pytest

from inkloop.bench import commands
from inkloop.component import Job
from inkloop.scenario.file import Scenario
from inkloop_hardware.devices import commands as actions
from support.places import SCENARIOS


def test_dry_run_takes_the_passes_of_the_printer_and_the_light_of_the_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    """They may stand in the table of the printer alone."""
    given: list[tuple[Job, int]] = []

    def dry_run(rig: Any, job: Job, *, cure_ms: int) -> list[str]:
        given.append((job, cure_ms))
        return ["done"]

    monkeypatch.setattr(actions, "dry_run", dry_run)
    monkeypatch.setattr(commands, "Bench", lambda table: Mock(rig=nullcontext()))
    monkeypatch.setattr(commands, "check_listening", Mock())
    monkeypatch.setattr(commands, "live_words", lambda *_: nullcontext())
    options = {"passes": 4, "pass_order": "diagonal", "pass_rotation": 1}
    overrides = {f"components.printer.{name}": value for name, value in options.items()}
    scenario = Scenario.load(SCENARIOS / "bench.toml", {**overrides, "bench.cure_ms": 70})
    commands.act(scenario, "dry-run", Mock())
    ((job, cure_ms),) = given
    assert (job.passes, job.pass_order, job.pass_rotation, cure_ms) == (4, 2, 1, 70)
