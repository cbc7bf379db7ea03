"""The layer contract as the FMUs keep it: refusals change nothing, and steps of any size print the same layers."""

from __future__ import annotations

import numpy as np
import pytest

from support.fmus.fmu_driver import (
    DEPOSITION_MODELS,
    DISCARD,
    ERROR,
    EVERY_FORM,
    FIXED_REALS,
    MODELS,
    OK,
    Driver,
    equal,
    random_patterns,
)

EVERY_MODEL = pytest.mark.parametrize("model", MODELS)
EVERY_DEPOSITION = pytest.mark.parametrize("model", DEPOSITION_MODELS)


def refused_step(form: str) -> int:
    """Status of a refused step: FMI 3 discards, FMI 2 has only the error."""
    return ERROR if form == "fmi2" else DISCARD


@EVERY_FORM
@EVERY_DEPOSITION
@pytest.mark.parametrize("command", [0, 3, 4, 7, 8, 2**31 - 1])
def test_command_that_is_not_the_next_is_refused_and_changes_nothing(model, form, command) -> None:
    with Driver(model, form).start({"layer_command": 4, "variation": 0.2}) as fmu:
        fmu.print_layer()
        assert fmu.set("layer_command", command) == OK
        before = fmu.save()
        assert fmu.step(1.0) == refused_step(form)
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
        assert fmu.save() == before
        assert max(fmu.set("layer_command", 1), fmu.step(1.0), fmu.step(2.0)) == OK
        assert (fmu.get("layers_printed"), fmu.get("status")) == (1, 0)


def test_refusal_states_what_was_found_and_expected() -> None:
    with Driver("LayerDeposition").start() as fmu:
        fmu.set("layer_command", 5)
        fmu.step(0.0)
        assert fmu.messages == [
            "fmi3DoStep: layer_command is 5; expected 0 (nothing to do) or 1 (print the next layer)"
        ]


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


@EVERY_DEPOSITION
def test_duration_counts_from_the_beginning_of_the_step_that_takes_the_command(model) -> None:
    """Which may be later than the end of the step before."""
    with Driver(model).start({"layer_duration": 3.0}) as fmu:
        assert fmu.set("layer_command", 1) == OK
        seen = []
        for start in (5.0, 6.0, 7.0):
            assert fmu.step(start) == OK
            seen.append(int(fmu.get("layers_printed")))
        assert seen == [0, 0, 1]


@EVERY_FORM
@EVERY_DEPOSITION
def test_pattern_is_taken_when_the_command_is_accepted(model, form) -> None:
    with Driver(model, form).start({"layer_duration": 2.0, "pattern": 1}) as fmu:
        assert max(fmu.set("layer_command", 1), fmu.step(0.0), fmu.set("pattern", 0), fmu.step(1.0)) == OK
        assert fmu.get("droplets_a") == 81


@EVERY_FORM
def test_volume_factor_is_taken_when_the_command_is_accepted(form) -> None:
    with Driver("LayerDeposition", form).start(
        {"layer_duration": 2.0, "volume_factor": 0.5, "h2_a": 0.0, "h3_a": 0.0, "h1_a": 4e-6}
    ) as fmu:
        assert max(fmu.set("layer_command", 1), fmu.step(0.0), fmu.set("volume_factor", 3.0), fmu.step(1.0)) == OK
        assert fmu.get("height") == pytest.approx(np.full((9, 9), 2e-6), rel=1e-12, abs=0.0)


@EVERY_FORM
@EVERY_DEPOSITION
def test_step_longer_than_the_duration_prints_only_the_commanded_layer(model, form) -> None:
    with Driver(model, form).start({"layer_duration": 1.0}) as fmu:
        assert max(fmu.set("layer_command", 1), fmu.step(0.0, 1000.0)) == OK
        assert fmu.get("layers_printed") == 1


@EVERY_FORM
@EVERY_DEPOSITION
@pytest.mark.parametrize("size", [0.05, 0.1, 0.3, 1.0, 2.5])
def test_steps_of_any_size_print_the_same_layers(model, form, size) -> None:
    patterns = random_patterns(5, 4, 4)
    with Driver(model, form, 5, 4).start({"variation": 0.3, "layer_duration": 0.7}) as fmu:
        time = 0.0
        for number, pattern in enumerate(patterns, start=1):
            assert max(fmu.set("pattern", pattern), fmu.set("layer_command", number)) == OK
            while fmu.get("layers_printed") < number:
                assert fmu.step(time, size) == OK
                time += size
        found = fmu.get("height")
    with Driver(model, form, 5, 4).start({"variation": 0.3}) as fmu:
        for pattern in patterns:
            fmu.print_layer(pattern)
        assert np.array_equal(fmu.get("height"), found)


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
        assert fmu.save() == before


@EVERY_FORM
@EVERY_DEPOSITION
def test_period_shorter_than_the_duration_is_refused_at_the_end_of_initialisation(model, form) -> None:
    with Driver(model, form) as fmu:
        assert max(fmu.set("layer_period", 0.5), fmu.set("layer_duration", 0.6), fmu.enter()) == OK
        assert fmu.exit() == ERROR
        assert max(fmu.set("layer_duration", 0.5), fmu.exit()) == OK
        assert fmu.step(0.0, 10.0) == OK
        assert fmu.get("layers_printed") == 19


@EVERY_FORM
@EVERY_DEPOSITION
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("pattern", 3),
        ("pattern", -1),
        ("drop_level", -1),
        ("drop_level", 256),
        ("height_start", np.nan),
        ("variation", np.nan),
        ("variation", -0.1),
        ("seed", -1),
        ("layer_duration", np.inf),
        ("nozzle_pitch", 0),
        ("variation_kind", 0),
        ("layer_command", -1),
    ],
)
def test_value_that_the_model_does_not_take_is_refused_whole(model, form, name, value) -> None:
    with Driver(model, form, 4, 3) as fmu:
        before = fmu.save()
        values = np.full(fmu.shape(name), fmu.get(name))
        if values.ndim:
            values = values.astype(float if isinstance(value, float) else int)
            values[2, 1] = value
        assert fmu.set(name, values if values.ndim else value) == DISCARD
        assert fmu.save() == before


@EVERY_FORM
@pytest.mark.parametrize("model", [model for model in DEPOSITION_MODELS if model != "SuperpositionDeposition"])
@pytest.mark.parametrize("passes", [0, 2, 3, 5])
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
@EVERY_MODEL
def test_outputs_and_constants_cannot_be_set(model, form) -> None:
    with Driver(model, form) as fmu:
        for mode in (lambda: OK, fmu.enter, fmu.exit):
            assert mode() == OK
            for name, role in fmu.roles.items():
                if role not in ("parameter", "input"):
                    assert fmu.set(name, fmu.get(name)) == ERROR, name


@EVERY_FORM
@EVERY_MODEL
def test_calls_out_of_order_are_errors_and_change_nothing(model, form) -> None:
    with Driver(model, form) as fmu:

        def refuses(*names: str) -> bool:
            before = fmu.save()
            calls = {
                "step": lambda: fmu.step(0.0),
                "exit": fmu.exit,
                "enter": fmu.enter,
                "terminate": lambda: fmu.call("terminate"),
                "fixed": lambda: fmu.set(FIXED_REALS[model], 1e-4),
            }
            return all(calls[name]() == ERROR for name in names) and fmu.save() == before

        assert refuses("step", "exit", "terminate")
        assert fmu.enter() == OK
        assert refuses("step", "enter", "terminate")
        assert fmu.exit() == OK
        assert refuses("exit", "enter", "fixed")
        assert fmu.call("terminate") == OK
        assert refuses("step", "exit", "enter", "terminate", "fixed")
        assert fmu.call("reset") == OK
        assert max(fmu.enter(), fmu.exit(), fmu.step(0.0)) == OK


@EVERY_FORM
@EVERY_DEPOSITION
@pytest.mark.parametrize(
    ("time", "size"), [(5.0, 0.0), (5.0, -1.0), (5.0, np.nan), (np.nan, 1.0), (5.0, np.inf), (4.0, 1.0)]
)
def test_step_that_leads_nowhere_or_back_is_refused(model, form, time, size) -> None:
    with Driver(model, form).start(start=5.0) as fmu:
        fmu.set("layer_command", 1)
        before = fmu.save()
        assert fmu.step(time, size) == refused_step(form)
        assert fmu.save() == before


@EVERY_FORM
@EVERY_MODEL
def test_unknown_references_and_wrong_types_are_errors(model, form) -> None:
    real, integer = ("Real", "Integer") if form == "fmi2" else ("Float64", "Int32")
    with Driver(model, form) as fmu:
        length = fmu.get(FIXED_REALS[model])
        assert fmu.call(f"set{integer}", fmu.references[FIXED_REALS[model]], [1]) == ERROR
        assert fmu.get(FIXED_REALS[model]) == length
    with Driver(model, form).start() as fmu:
        assert fmu.call(f"get{real}", [10**6]) == ERROR
        assert fmu.call(f"get{integer}", fmu.references[FIXED_REALS[model]]) == ERROR
        assert fmu.call(f"set{real}", fmu.references["status"], [0.0]) == ERROR
        assert fmu.call(f"set{real}", fmu.references[FIXED_REALS[model]], [1e-4]) == ERROR


def test_call_with_one_bad_value_sets_none_of_the_others() -> None:
    with Driver("LayerDeposition") as fmu:
        references = fmu.references["h1_a"] + fmu.references["variation"]
        assert fmu.call("setFloat64", references, [1e-6, 2.0]) == DISCARD
        assert fmu.get("h1_a") == 4.4e-6


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


@pytest.mark.parametrize("form", ["fmi3-fixed"])
def test_fixed_grid_has_no_configuration_mode(form) -> None:
    with Driver("LayerDeposition", form) as fmu:
        assert fmu.call("enterConfigurationMode") == ERROR
        assert "9 x 9" in fmu.messages[-1]
