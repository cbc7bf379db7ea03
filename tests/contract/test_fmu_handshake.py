"""The layer contract as the FMUs keep it: refusals change nothing, and steps of any size print the same layers."""

from __future__ import annotations

import numpy as np
import pytest

from support.fmus.fmu_driver import (
    DEPOSITION_MODELS,
    DISCARD,
    ERROR,
    EVERY_FORM,
    MODELS,
    OK,
    Driver,
    equal,
)

EVERY_MODEL = pytest.mark.parametrize("model", MODELS)
EVERY_DEPOSITION = pytest.mark.parametrize("model", DEPOSITION_MODELS)


def refused_step(form: str) -> int:
    """Status of a refused step: FMI 3 discards, FMI 2 has only the error."""
    return ERROR if form == "fmi2" else DISCARD


@EVERY_FORM
@EVERY_DEPOSITION
@pytest.mark.parametrize("command", [0, 4, 7, 2**31 - 1])
def test_command_that_is_not_the_next_is_refused_and_changes_nothing(model, form, command) -> None:
    with Driver(model, form).start({"layer_command": 4, "variation": 0.2}) as fmu:
        fmu.print_layer()
        assert fmu.set("layer_command", command) == OK
        before = fmu.save()
        assert fmu.step(1.0) == refused_step(form)
        assert f"layer_command is {command}; expected 5 (nothing to do) or 6 (print the next layer)" in fmu.messages[-1]
        assert fmu.save() == before
        assert fmu.set("layer_command", 5) == OK
        assert fmu.step(1.0) == OK
        assert fmu.get("layers_printed") == 5
        fmu.print_layer()


@EVERY_FORM
@EVERY_DEPOSITION
def test_command_while_busy_is_refused_and_the_layer_is_still_printed(model, form) -> None:
    with Driver(model, form).start({"layer_duration": 3.0}) as fmu:
        assert max(fmu.set("layer_command", 1), fmu.step(0.0)) == OK
        assert fmu.set("layer_command", 2) == OK
        before = fmu.save()
        assert fmu.step(1.0) == refused_step(form)
        assert "is 2 while layer 1 is being printed; wait until layers_printed is 1" in fmu.messages[-1]
        assert fmu.save() == before
        assert max(fmu.set("layer_command", 1), fmu.step(1.0), fmu.step(2.0)) == OK
        assert (fmu.get("layers_printed"), fmu.get("status")) == (1, 0)


@EVERY_FORM
@EVERY_DEPOSITION
def test_repeated_command_changes_nothing(model, form) -> None:
    with Driver(model, form).start({"variation": 0.2}) as fmu:
        surface = fmu.print_layer()
        assert max(fmu.set("pattern", 2), fmu.step(1.0), fmu.step(2.0, 100.0)) == OK
        assert np.array_equal(fmu.get("height"), surface)
        assert fmu.get("layers_printed") == 1


@EVERY_FORM
@EVERY_DEPOSITION
def test_layer_is_complete_a_duration_after_its_command(model, form) -> None:
    with Driver(model, form).start({"layer_duration": 0.3}, start=2.0) as fmu:
        assert fmu.set("layer_command", 1) == OK
        seen = []
        for k in range(5):
            assert fmu.step(2.0 + k * 0.1, 0.1) == OK
            seen.append((int(fmu.get("layers_printed")), int(fmu.get("status"))))
        assert seen == [(0, 1), (0, 1), (1, 0), (1, 0), (1, 0)]
        assert fmu.set("layer_command", 2) == OK
        assert max(fmu.step(5.0, 0.1), fmu.step(5.1, 0.1)) == OK  # it begins with the step that takes the command
        assert fmu.get("layers_printed") == 1
        assert fmu.step(5.2, 0.1) == OK
        assert fmu.get("layers_printed") == 2


@EVERY_FORM
@EVERY_DEPOSITION
def test_pattern_and_volume_factor_are_taken_when_the_command_is_accepted(model, form) -> None:
    heights = []
    for later in (0, 1):
        with Driver(model, form).start({"layer_duration": 2.0, "pattern": 1, "volume_factor": 0.5}) as fmu:
            assert max(fmu.set("layer_command", 1), fmu.step(0.0)) == OK
            assert max(fmu.set("pattern", later), fmu.set("volume_factor", 0.5 + later), fmu.step(1.0)) == OK
            assert fmu.get("droplets_a") == 81
            heights.append(fmu.get("height"))
    assert np.array_equal(*heights)


@EVERY_FORM
@EVERY_DEPOSITION
@pytest.mark.parametrize("size", [0.1, 0.25, 1.0, 3.0, 7.0])
def test_self_commanding_counts_periods_not_steps(model, form, size) -> None:
    """0.1 cannot be added up exactly: the layer at k periods must neither be missed nor come twice."""
    with Driver(model, form).start({"layer_period": 0.5, "pattern": 0}, start=10.0) as fmu:
        time = 10.0
        for k in range(1, 22):
            assert fmu.step(time, size) == OK
            time += size
            assert fmu.get("layers_printed") == int(k * size / 0.5 + 1e-6)


@EVERY_FORM
@EVERY_DEPOSITION
def test_self_commanding_refuses_commands(model, form) -> None:
    with Driver(model, form).start({"layer_period": 0.5, "layer_command": 2}) as fmu:
        assert fmu.step(0.0) == OK
        assert fmu.get("layers_printed") == 4
        assert fmu.set("layer_command", 3) == OK
        before = fmu.save()
        assert fmu.step(1.0) == refused_step(form)
        assert "layer_command changed from 2 to 3, but layer_period is 0.5 s" in fmu.messages[-1]
        assert fmu.save() == before


@EVERY_FORM
@EVERY_DEPOSITION
def test_period_shorter_than_the_duration_is_refused_and_changes_nothing(model, form) -> None:
    with Driver(model, form) as fmu:
        assert max(fmu.set("layer_period", 0.5), fmu.set("layer_duration", 0.6), fmu.enter()) == OK
        before = fmu.save()
        assert fmu.exit() == ERROR
        assert "layer_period is 0.5 s; expected 0 or at least layer_duration, which is 0.6 s" in fmu.messages[-1]
        assert fmu.save() == before
        assert max(fmu.set("layer_duration", 0.5), fmu.exit()) == OK
        assert fmu.step(0.0, 10.0) == OK
        assert fmu.get("layers_printed") == 19


@EVERY_FORM
@pytest.mark.parametrize("model", [model for model in DEPOSITION_MODELS if model != "SuperpositionDeposition"])
@pytest.mark.parametrize("passes", [2, 3])
def test_passes_other_than_one_and_four_are_refused(model, form, passes) -> None:
    with Driver(model, form) as fmu:
        before = fmu.get("passes")
        assert fmu.set("passes", passes) == DISCARD
        assert fmu.get("passes") == before
        assert max(fmu.set("passes", 4), fmu.set("passes", 1)) == OK


@EVERY_FORM
@EVERY_MODEL
def test_every_parameter_accepts_its_own_default(model, form) -> None:
    with Driver(model, form) as fmu:
        before = fmu.save()
        roles = fmu.roles
        settable = [name for name, role in roles.items() if role in ("parameter", "input")]
        assert len(settable) > 10
        for name in settable:
            assert fmu.set(name, fmu.get(name)) == OK, name
        assert fmu.save() == before


@EVERY_FORM
@EVERY_DEPOSITION
def test_outputs_during_initialisation_follow_the_start_values(model, form) -> None:
    with Driver(model, form, 4, 3) as fmu:
        assert fmu.enter() == OK
        surface = np.arange(12.0).reshape(4, 3) * 1e-6
        assert max(fmu.set("height_start", surface), fmu.set("layer_command", 7)) == OK
        assert np.array_equal(fmu.get("height"), surface)
        assert fmu.get("layers_printed") == 7
        assert fmu.get("height_mean") == pytest.approx(5.5e-6, rel=1e-9, abs=0.0)


@EVERY_FORM
def test_beginning_of_a_step_may_be_off_by_the_rounding_of_its_length_and_of_the_time(form) -> None:
    """By 1e-6 of the step, and by 1e-12 of the time."""
    for start, size, allowed in ((0.0, 1.0, 1e-6), (1e6, 1e-3, 1e-6)):
        with Driver("LayerDeposition", form, 3, 2).start(start=start) as fmu:
            assert fmu.step(start, size) == OK
            assert fmu.step(fmu.now - 2.0 * allowed, size) == refused_step(form)
            assert f"s, but the instance is at {fmu.now:.17g} s already; restore a saved state" in fmu.messages[-1]
            assert fmu.step(fmu.now - 0.5 * allowed, size) == OK


def test_new_size_keeps_what_was_set_before() -> None:
    with Driver("LayerDeposition") as fmu:
        assert fmu.set("variation", 0.25) == OK
        assert fmu.resize(4, 6) == OK
        fmu.nx, fmu.ny = 4, 6
        assert fmu.get("variation") == 0.25
        assert fmu.get("height_start").shape == (4, 6)
        with Driver("LayerDeposition", nx=4, ny=6) as other:
            assert other.set("variation", 0.25) == OK
            assert equal(other.outputs(), fmu.outputs())
