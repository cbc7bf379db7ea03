"""A print whose scans do not show what was printed is stopped, and goes on once a person has looked at it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import FloatMap, Status
from inkloop.components import catalog
from inkloop_controller.model import LayerModel
from support.closed_loop import SECOND, cylinder, inputs_of

KINDS = ("LayerMpc", "LayerController")
_I, _J = np.indices((35, 35))
JOB = replace(cylinder(120e-6), mask=cylinder().mask & ((_I > 17) | (_J > 17)))  # no symmetry but one
NOISE = 0.1e-6
Fault = Callable[[list[FloatMap], int], FloatMap]


def frozen(scans: list[FloatMap], layer: int) -> FloatMap:
    """Scans from layer 10 on are that of layer 9."""
    return scans[min(layer, 9)]


def mirrored(scans: list[FloatMap], layer: int) -> FloatMap:
    """Turned against the patterns."""
    return scans[layer][::-1].copy()


class Loop:
    """A print by the layer contract, step by step; the printer varies its droplets by 20 %."""

    def __init__(self, kind: str, fault: Fault, **options: Any) -> None:
        self.controller = catalog.make(kind, JOB, {"horizon": 2, **options})
        self._fault, self._rng, self._plant = fault, np.random.default_rng(4), LayerModel.of(JOB)
        self.height, self.layer, self._scans = np.zeros((JOB.nx, JOB.ny)), 0, list[FloatMap]()
        self.is_repaired, self.steps = False, 0
        self.controller.initialize(0, inputs_of(JOB, self.height, 0))
        self._scan()

    def answer(self, is_looked_at: bool = False) -> dict[str, Any]:
        """Outputs of the controller after the last scan."""
        inputs = inputs_of(JOB, self._shown, self.layer) | {"looked_at": np.asarray(is_looked_at)}
        self.steps += 1
        return dict(self.controller.do_step(self.steps * SECOND, SECOND, inputs))

    def print_layer(self, outputs: dict[str, Any]) -> None:
        """Print and scan the layer commanded."""
        assert outputs["layer_command"] == self.layer + 1
        self.layer += 1
        factor = 1.0 - 0.2 * self._rng.random(self.height.shape)
        self.height = self._plant.layer(self.height, outputs["pattern"], self.layer, factor)
        self._scan()

    def run(self, is_looked_at: bool = False) -> dict[str, Any]:
        """Print until the controller is done or has stopped; its last outputs."""
        for _ in range(100):
            outputs = self.answer(is_looked_at)
            is_looked_at = False
            if outputs["status"] == Status.DONE or outputs["stop_reason"]:
                return outputs
            self.print_layer(outputs)
        raise AssertionError("neither done nor stopped after 100 layers")

    @property
    def highest_um(self) -> float:
        """The most that the part stands above its target."""
        return float((self.height - JOB.target_height)[JOB.mask].max() * 1e6)

    def _scan(self) -> None:
        self._scans.append(self.height + NOISE * np.random.default_rng(self.layer).standard_normal(self.height.shape))
        self._shown = self._scans[-1] if self.is_repaired else self._fault(self._scans, self.layer)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("fault", "layers"), [(frozen, 2), (mirrored, 3)])
def test_print_whose_scans_still_lie_soon_stops_again(kind: str, fault: Fault, layers: int) -> None:
    """A mirrored scan tells by what a layer adds: after two layers or three, by the seed of the droplets."""
    loop = Loop(kind, fault)
    first = loop.run()
    before = loop.layer
    assert first["stop_reason"] in (128, 512)
    for again in (first, loop.answer()):  # it commands nothing however often it is asked
        assert (again["layer_command"], again["status"]) == (before, Status.UNTRUSTED)
        assert not again["pattern"].any()
    outputs = loop.run(is_looked_at=True)
    assert outputs["stop_reason"] > 0 or outputs["status"] == Status.DONE
    assert loop.layer <= before + layers
    assert loop.highest_um < 6.0
    loop.controller.terminate()


def test_controllers_go_on_alike() -> None:
    one, other = (Loop(kind, frozen) for kind in KINDS)
    for is_looked_at in (False, True):
        found, expected = (loop.run(is_looked_at) for loop in (other, one))
        for name in ("stop_reason", "stop_layer", "stop_figure", "estimated_height", "pattern", "untrusted_reasons"):
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
        one.is_repaired = other.is_repaired = True
    other.controller.terminate()


@pytest.mark.parametrize("kind", KINDS)
def test_looking_at_a_print_that_is_not_stopped_changes_nothing(kind: str) -> None:
    loop, other = Loop(kind, frozen), Loop(kind, frozen)
    for _ in range(3):
        outputs, expected = loop.answer(is_looked_at=True), other.answer()
        np.testing.assert_array_equal(outputs["pattern"], expected["pattern"])
        loop.print_layer(outputs)
        other.print_layer(expected)
    loop.controller.terminate()
    other.controller.terminate()
