"""A print in one block prints the layers of inkloop run, bit by bit, in any master and with any step."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import cycle
from typing import Any

import pytest

from inkloop.components.catalog import FMU_MODELS
from inkloop.errors import ScenarioError
from support.fmus.fmu_driver import DISCARD, ERROR, OK, Driver
from support.fmus.layer_jobs import CUBOID, DONE, block, finish, printed
from support.long_proofs import rest_is_long
from support.places import SCENARIOS
from support.prints import scenario

FORMS = ("fmi2", "fmi3-fixed")
EVERY_FORM = pytest.mark.parametrize("form", FORMS)
SECOND_FORM_IS_LONG = pytest.mark.parametrize("form", rest_is_long(FORMS, 1))
"""Both share all but their adapter, which the other tests see."""
IDLE, PRINTING, UNTRUSTED = 0, 1, 4
OF_THE_PRINTER = ("droplets_a", "droplets_b", "volume_lost", "height_mean")
OF_THE_CONTROLLER = (
    *("objective", "volume_scale", "dead_cells", "untrusted_cells", "capped_cells", "untrusted_reasons"),
    *("scan_shift_x", "scan_shift_y", "scan_spot_radius"),
)
CASES: dict[str, Any] = {
    "four passes": ("four-passes", ("run.layers_max", 6)),
    "two materials": ("two-materials", ("run.layers_max", 14)),
    "noisy sensor with delays": ("noisy-sensor", ("components.printer.layer_duration_s", 2.5), ("run.layers_max", 20)),
    "three heights learnt, lines of liquid": ("surface-tension", ("run.layers_max", 3)),
    "grey head": ("grey-head", ("run.layers_max", 6)),
    "cylinder": ("cylinder", ("part.height_um", 60.0)),
    "droplet after droplet": ("wu-chiu-plant", ("run.layers_max", 6)),
    "caps": ("no-flow", ("run.layers_max", 6)),
    "uneven start": ("uneven-start", ("run.layers_max", 6)),
}


def assert_like_run(fmu: Driver, run, layer: int) -> None:
    """The state holds the surface of the layer as it is in the run, and the outputs are its figures."""
    assert run.height.values[layer].tobytes() in fmu.save()
    for name in ("mean_error", "mae", "std"):
        assert fmu.get(name) == pytest.approx(float(run[name][layer]), rel=1e-9, abs=1e-15), name
    for name in OF_THE_PRINTER if layer > 0 else ():
        assert fmu.get(name) == run[name].values[layer], name


@pytest.mark.system
@pytest.mark.parametrize(("case", "form"), rest_is_long(zip(CASES, cycle(FORMS), strict=False), 3))
def test_layers_are_those_of_a_run_bit_by_bit(case, form) -> None:
    run = printed(*CASES[case])
    with block(form, *CASES[case]) as fmu:
        assert_like_run(fmu.start(), run, 0)
        period, number = float(fmu.get("layer_period")), 0
        while fmu.get("status") != DONE:
            assert fmu.step(number * period, period) == OK, fmu.messages
            number += 1
            assert_like_run(fmu, run, int(fmu.get("layers_printed")))
            for name in OF_THE_CONTROLLER if fmu.get("status") != DONE else ():
                assert fmu.get(name) == run[name].values[number], name
        assert fmu.get("layers_printed") == run.sizes["layer"] - 1
        assert fmu.get("layers_scanned") == run.sizes["layer"] - 1


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(path.stem for path in SCENARIOS.glob("*.toml")))
def test_every_scenario_prints_its_layers_or_is_refused_with_a_message(name) -> None:
    case = (name, ("run.layers_max", 12))
    tables = scenario(name, case[1:]).tables
    kinds = {table.kind for table in tables.components.values()}
    is_core = tables.components["controller"].options.get("relaxation", "gradient") == "gradient"
    if tables.events or not kinds <= {"LayerMpc", *FMU_MODELS} or not is_core:
        with pytest.raises(ScenarioError, match="; "):
            block("fmi2", *case)
        return
    with block("fmi2", *case) as fmu:
        fmu.start()
        finish(fmu, 3.0 * float(fmu.get("layer_period")))
        assert_like_run(fmu, printed(*case), printed(*case).sizes["layer"] - 1)


@pytest.mark.system
@pytest.mark.parametrize("periods", rest_is_long([0.3, 7.0, 1.0], 2))
@SECOND_FORM_IS_LONG
def test_steps_change_neither_layers_nor_times(form, periods) -> None:
    case = CASES["noisy sensor with delays"]
    run = printed(*case)
    with block(form, *case) as fmu:
        fmu.start()
        assert fmu.get("layer_period") == 8.5
        step, number = periods * 8.5, 0
        while fmu.get("status") != DONE:
            assert fmu.step(number * step, step) == OK, fmu.messages
            number += 1
            layer = int(fmu.get("layers_printed"))
            assert layer == min(20, int(((number * step) - 2.5 + 1e-5) / 8.5))
            assert_like_run(fmu, run, layer)
        assert layer == 20


@pytest.mark.system
@EVERY_FORM
def test_print_continues_in_another_instance(form) -> None:
    case = CASES["noisy sensor with delays"]
    with block(form, *case) as first, block(form, *case) as second:
        first.start()
        for number in range(37):  # in the midst of a layer
            assert first.step(number * 2.0, 2.0) == OK
        saved = first.save()
        assert second.restore(saved) == OK
        assert second.save() == saved
        for fmu, step in ((first, 85.0), (second, 17.0)):
            end = finish(fmu, step, at=74.0)
            assert fmu.step(end, 1000.0 - end) == OK
        assert first.save() == second.save()
        assert_like_run(first, printed(*case), 20)


@pytest.mark.system
@SECOND_FORM_IS_LONG
def test_instances_side_by_side_do_not_disturb_each_other(form) -> None:
    """FMPy lets go of Python's lock while a step is under way."""
    with ExitStack() as stack, ThreadPoolExecutor(4) as threads:
        fmus = [stack.enter_context(block(form, "cuboid", *CUBOID)).start() for _ in range(4)]
        list(threads.map(lambda fmu: finish(fmu, 1.0), fmus))
        assert len({fmu.save() for fmu in fmus}) == 1


def counts(fmu: Driver) -> tuple[int, int]:
    return int(fmu.get("layers_printed")), int(fmu.get("layers_scanned"))


@EVERY_FORM
def test_layers_are_complete_and_scanned_after_their_durations(form) -> None:
    with block(form, "cuboid", *CUBOID) as fmu:
        fmu.start({"layer_period": 10.0, "layer_duration": 2.0, "scan_duration": 3.0}, start=100.0)
        seen = {}
        for number in range(60):
            assert fmu.step(100.0 + number * 0.5, 0.5) == OK
            seen[(number + 1) * 0.5] = counts(fmu)
        assert (seen[2.5], seen[3.0]) == ((0, -1), (0, 0))
        assert (seen[11.5], seen[12.0], seen[14.5], seen[15.0]) == ((0, 0), (1, 0), (1, 0), (1, 1))
        assert (seen[21.5], seen[22.0]) == ((1, 1), (2, 1))


@EVERY_FORM
@pytest.mark.parametrize(
    ("period", "durations", "step", "ends"), [(4.0, (2.0, 3.0), 1.0, [6, 14, 22]), (0.3, (0.1, 0.2), 0.1, [4, 7, 10])]
)
def test_layer_begins_in_the_first_period_after_the_last_scan(form, period, durations, step, ends) -> None:
    """In every second period where one is too short; in each where it is just long enough, but for rounding."""
    with block(form, "cuboid", *CUBOID) as fmu:
        fmu.start({"layer_period": period, "layer_duration": durations[0], "scan_duration": durations[1]})
        found = []
        for number in range(ends[-1] + 2):
            assert fmu.step(number * step, step) == OK
            found.append(counts(fmu)[0])
        assert [found.index(layer) + 1 for layer in (1, 2, 3)] == ends


@SECOND_FORM_IS_LONG
def test_nothing_begins_before_start_nor_in_a_pause(form) -> None:
    with block(form, "cuboid", *CUBOID) as fmu:
        fmu.start({"start": False, "scan_duration": 0.25, "layer_duration": 0.25})
        assert fmu.step(0.0, 5.5) == OK
        assert (*counts(fmu), fmu.get("status")) == (0, -1, IDLE)
        assert fmu.set("start", True) == OK
        assert fmu.step(5.5, 1.1) == OK
        assert (*counts(fmu), fmu.get("status")) == (0, 0, PRINTING)  # the first layer has begun at 6.5 s
        assert fmu.set("start", False) == OK
        assert fmu.step(6.6, 10.0) == OK
        assert (*counts(fmu), fmu.get("status")) == (1, 1, IDLE)
        assert fmu.set("start", True) == OK
        assert fmu.step(16.6, 0.8) == OK
        assert counts(fmu) == (1, 1)  # none of the periods that passed is made up for
        assert fmu.step(17.4, 0.4) == OK
        assert counts(fmu) == (2, 1)
        finish(fmu, 1.0, at=17.8)
        assert_like_run(fmu, printed("cuboid", *CUBOID), printed("cuboid", *CUBOID).sizes["layer"] - 1)


@pytest.mark.system
@SECOND_FORM_IS_LONG
def test_disturbance_of_the_volume_is_learnt_and_made_up_for(form) -> None:
    case = ("cylinder", ("part.height_um", 100.0), ("components.controller.horizon", 3))
    with block(form, *case) as fmu, block(form, *case) as disturbed:
        finish(fmu.start(), 7.0)
        assert disturbed.start({"volume_factor": 0.8}).step(0.0, 10.0) == OK
        finish(disturbed, 7.0, at=10.0)
        assert disturbed.get("volume_scale") == pytest.approx(0.8 * fmu.get("volume_scale"), rel=0.01, abs=0.0)
        assert disturbed.get("layers_printed") > 1.2 * fmu.get("layers_printed")
        assert disturbed.get("std") < 0.6e-6


@EVERY_FORM
def test_alpha_that_changes_between_steps_counts_for_the_next_layer(form) -> None:
    with block(form, "cuboid", *CUBOID) as fmu, block(form, "cuboid", *CUBOID) as other:
        for instance in (fmu.start(), other.start()):
            assert instance.step(0.0, 2.0) == OK
        assert other.set("alpha", 0.1) == OK
        for instance in (fmu, other):
            assert instance.step(2.0, 1.0) == OK
        assert fmu.get("droplets_a") != other.get("droplets_a")
        assert fmu.set("layer_period", 2.0) != OK


@SECOND_FORM_IS_LONG
def test_time_limit_that_changes_between_steps_counts_for_the_next_layers(form) -> None:
    """Plans that have no time are worse as soon as the first cells are full."""
    with block(form, "cuboid", *CUBOID) as fmu, block(form, "cuboid", *CUBOID) as other:
        for instance in (fmu.start(), other.start()):
            assert instance.step(0.0, 2.0) == OK
        assert other.set("time_limit", 1e-9) == OK
        for instance in (fmu, other):
            assert instance.step(2.0, 5.0) == OK
        assert fmu.get("objective") < other.get("objective")


@pytest.mark.system
@EVERY_FORM
def test_refused_step_changes_nothing(form) -> None:
    """The third layer of a step of three asks for a droplet that spreads too far."""
    case = CASES["three heights learnt, lines of liquid"]
    refused = ERROR if form == "fmi2" else DISCARD
    with block(form, *case) as fmu:
        assert fmu.start().step(0.0, 1.5) == OK
        assert fmu.set("volume_factor", 1e6) == OK
        before = fmu.save()
        assert fmu.step(1.5, 3.0) == refused
        assert "printer: the largest droplet of the pattern spreads" in fmu.messages[-1]
        assert fmu.save() == before
        assert fmu.set("volume_factor", 1.0) == OK
        finish(fmu, 3.0, at=1.5)
        assert_like_run(fmu, printed(*case), 3)


@pytest.mark.system
@EVERY_FORM
def test_step_that_never_ends_is_refused(form) -> None:
    """Without volume no layer brings the print nearer to its end."""
    going_on = ("components.controller.on_doubt", "continue")
    with block(form, "cuboid", *CUBOID, ("run.layers_max", 1000000000), going_on) as fmu:
        fmu.start({"volume_factor": 0.0, "layer_period": 1e-6}, start=100.0)
        before = fmu.save()
        assert fmu.step(100.0, 1.0) != OK
        assert "the step has 1e+06 layers to print" in fmu.messages[-1]
        assert fmu.save() == before
        assert fmu.step(100.0, 1e-5) == OK
        assert counts(fmu) == (10, 10)
        assert (fmu.get("status"), fmu.get("untrusted_reasons")) == (UNTRUSTED, 64), "nothing grows"
        assert max(fmu.set("start", False), fmu.step(fmu.now, 1.0)) == OK, "no layer is due in a pause"
        assert max(fmu.set("start", True), fmu.step(fmu.now, 5.5e-6)) == OK, "none of it is made up for"
        assert counts(fmu)[0] in (15, 16)
    with block(form, "cuboid", *CUBOID, ("run.layers_max", 1000000000), going_on) as fmu:
        assert fmu.start({"volume_factor": 0.0, "layers_max": 6}).step(0.0, 100.0) == OK
        assert (fmu.get("status"), fmu.get("untrusted_reasons")) == (DONE, 64)


@pytest.mark.system
@SECOND_FORM_IS_LONG
def test_step_may_last_far_beyond_the_end_of_the_print(form) -> None:
    with block(form, "cuboid", *CUBOID) as fmu:
        assert fmu.start({"layers_max": 2, "layer_period": 1.0}).step(0.0, 1e6) == OK, fmu.messages
        assert (fmu.get("status"), *counts(fmu)) == (DONE, 2, 2)
