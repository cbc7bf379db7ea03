"""A rule for patterns controls the print behind the handshake of the layer contract."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest
from numpy.typing import ArrayLike

from inkloop.component import FloatMap, Job, Status
from inkloop.components import catalog
from inkloop.course.layer_course import LayerCourse
from inkloop.course.wiring import contract_connections
from inkloop.errors import ComponentError, ScenarioError
from inkloop.master.master import Master
from inkloop.testing import RESUMABLE_CONTRACT_CHECKS, ContractCheck, job
from support.toys import DROPLET, ToyPrinter, ToyProfiler, toy_job

SECOND = 1_000_000_000


class Missing:
    """Jets wherever more than `least_m` are missing."""

    def __init__(self, job: Job, *, least_m: float = DROPLET / 2) -> None:
        self.job, self.least_m = job, least_m

    def pattern(self, height: FloatMap, layer: int) -> ArrayLike:
        return self.job.target_height - height > self.least_m


@pytest.fixture(autouse=True)
def workshop(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    module = types.ModuleType("workshop")
    module.Missing = Missing  # type: ignore[attr-defined]
    module.Nothing = type("Nothing", (), {"__init__": lambda self, job: None})  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "workshop", module)
    return module


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
def test_controller_of_a_rule_keeps(check: ContractCheck) -> None:
    check(lambda: catalog.make("workshop:Missing", job(), {"least_m": 3e-6}))


def test_rule_prints_until_it_wants_nothing() -> None:
    wanted = toy_job(layers=3)
    parts = {
        "controller": catalog.make("workshop:Missing", wanted, {}),
        "printer": ToyPrinter(wanted),
        "profiler": ToyProfiler(wanted),
    }
    master = Master(parts, contract_connections(parts), step_ns=SECOND, course=LayerCourse(parts, layers_max=10))
    assert master.run() == "done"
    outputs = parts["printer"].do_step(0, SECOND, {"layer_command": np.asarray(3), "pattern": np.zeros((4, 3))})
    np.testing.assert_allclose(outputs["height"], wanted.target_height)
    assert int(outputs["layers_printed"]) == 3


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        (np.ones((3, 3), int), r"the pattern for layer 1 has shape \(3, 3\); needs \(4, 3\)"),
        (np.full((4, 3), 0.5), "the pattern for layer 1 is float64; needs whole numbers or booleans"),
        (np.full((4, 3), 2), r"the pattern for layer 1 is 2 in cell \(0, 0\); needs 0 .. 1, the number of inks"),
    ],
)
def test_what_is_no_pattern_is_refused(
    workshop: types.ModuleType, pattern: ArrayLike, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Missing, "pattern", lambda self, height, layer: pattern)
    part = catalog.make("workshop:Missing", toy_job(), {})
    inputs = {port.name: port.start_value() for port in part.inputs}
    assert int(part.initialize(0, inputs)["status"]) == Status.IDLE
    with pytest.raises(ComponentError, match=message):
        part.do_step(0, SECOND, {**inputs, "layers_scanned": np.asarray(0), "valid": np.ones((4, 3), bool)})


def test_class_that_is_neither_component_nor_rule_is_refused_with_what_it_lacks() -> None:
    with pytest.raises(ScenarioError, match="workshop:Nothing', which has no inputs, outputs, initialize, do_step"):
        catalog.make("workshop:Nothing", toy_job(), {})
