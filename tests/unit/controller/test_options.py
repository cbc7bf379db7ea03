"""Options of LayerMpc in a scenario: variables.toml declares them, for Python as for LayerController.fmu."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import inf, nan
from typing import Annotated, Any

import numpy as np
import pytest
from benchmarks import use_one_thread

from inkloop.component import Job
from inkloop.components import catalog
from inkloop.components.fmu_parameters import options_of_controller_fmu
from inkloop.testing import job
from inkloop_controller import Criterion, DropletChoices, HeightEstimator, LayerMpc, Work
from inkloop_controller.controllers import LayerMpcController, OpenLoopController, on_doubt_option
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.problem.options import (
    Keyword,
    Option,
    Variable,
    arguments,
    declared,
    default,
    errors_of,
    keywords,
    options,
    variables,
)
from support.closed_loop import block, print_part
from support.long_proofs import rest_is_long

CLASSES = (LayerMpc, Criterion, DropletChoices, Work, HeightEstimator, on_doubt_option)
OF_THE_JOB = {
    *("pitch", "target_height", "mask", "inks", "has_region", "region_bottom", "region_top", "seed"),
    *("h1_a", "h2_a", "h3_a", "h1_b", "h2_b", "h3_b", "passes", "pass_order", "pass_rotation"),
}
OF_THE_FMU = {"jettable", "is_timed"}  # dead_nozzles in Python; the time is always given
KEYWORDS = [keyword for each in CLASSES for keyword in keywords(each)]


def variable_of(keyword: Keyword) -> Variable:
    (name,) = options_of_controller_fmu({keyword.argument: None})
    return options()[name]


def test_every_parameter_is_an_option_in_python_or_describes_the_job() -> None:
    found = {variable_of(keyword).name for keyword in KEYWORDS}
    parameters = {name for name, each in variables().items() if each.causality == "parameter"}
    assert parameters - found == OF_THE_JOB | OF_THE_FMU
    assert found - parameters == options().keys() - variables().keys()


@pytest.mark.parametrize("keyword", KEYWORDS, ids=lambda keyword: keyword.argument)
def test_option_has_default_unit_and_meaning_of_its_variable(keyword: Keyword) -> None:
    variable = variable_of(keyword)
    assert keyword.option.meaning == (variable.scenario or variable.description)
    assert keyword.key == keyword.argument + {"m": "_um", "s": "_s", "1": ""}[variable.unit]
    if variable.name == "dead_nozzles":
        assert keyword.default == ()
    elif variable.name == "threads":
        assert keyword.default == "auto"
    elif keyword.default is None:
        assert variable.number(variable.default) == variable.start
        assert keyword.option.absent == variable.absent
    else:
        assert variable.number(keyword.value(keyword.default)) == variable.start


def outside() -> Iterator[Any]:
    """Values next to the limits of every option, which are not allowed."""
    for keyword in KEYWORDS:
        variable = variable_of(keyword)
        if variable.items:
            yield pytest.param(keyword, "other", id=f"{keyword.argument} other")
        elif variable.type != "boolean" and variable.name != "dead_nozzles":
            below = variable.least - (1 if variable.type == "integer" else 0 if variable.is_above_least else 1e-3)
            yield pytest.param(keyword, below, id=f"{keyword.argument} below")
            if variable.max < inf and not variable.unlimited and variable.type == "real":
                yield pytest.param(keyword, 1.001 * variable.max, id=f"{keyword.argument} above")


@pytest.mark.parametrize(("keyword", "value"), list(outside()))
def test_value_outside_the_limits_is_refused_by_the_key_and_no_other_one(keyword: Keyword, value: Any) -> None:
    written = value if isinstance(value, str) or not keyword.option.unit else value / keyword.value(1.0)
    errors = catalog.check("LayerMpc", job(), {keyword.key: written}).errors
    assert len(errors) == 1
    assert keyword.argument in errors[0]


ONE_TO_FIVE = "a whole number of 1 to 5"


@pytest.mark.parametrize(
    ("variable", "value", "error"),
    [
        (Variable("x", "", start=0.5, min=0.0, max=1.0), nan, "x is nan; needs a value of 0 to 1"),
        (Variable("x", "", start=0.5, min=0.0, max=1.0), 0.0, ""),
        (Variable("x", "", start=0.5, min=0.0), inf, "x is inf; needs at least 0"),
        (Variable("x", "", start=0.0, min=0.0, max=9.0, absent="none"), 0.0, "x is 0.0; needs a value of 0 to 9"),
        (Variable("x", "", start=0.0, min=0.0, max=9.0, absent="none"), None, ""),
        (Variable("x", "", start=-1.0, min=-1.0, max=9.0, absent="none"), 0.0, ""),
        (Variable("x", "", start=-1.0, min=-1.0, max=9.0, absent="none"), -0.5, "x is -0.5; needs a value of 0 to 9"),
        (Variable("x", "", type="integer", start=0, min=0, max=5, absent="none"), 0, f"x is 0; needs {ONE_TO_FIVE}"),
        (Variable("x", "", type="integer", start=1, min=1, max=5), 2.5, f"x is 2.5; needs {ONE_TO_FIVE}"),
        (Variable("x", "", type="count", start=1, min=1, max=5), np.int64(5), ""),
        (Variable("x", "", type="integer", start=1, min=1), "3", "x is '3'; needs a whole number of at least 1"),
        (Variable("x", "", start=1, min=0, max=9), "3", "x is '3'; needs a value of 0 to 9"),
        (Variable("x", "", start=1, min=0, max=9), np.float32(3.0), ""),
        (Variable("x", "", start=1, min=0, max=9), [3.0], "x is [3.0]; needs a value of 0 to 9"),
        (Variable("x", "", type="boolean"), "fixed", "x is 'fixed'; needs True or False"),
        (Variable("x", "", type="boolean"), np.True_, ""),
        (Variable("x", "", items={"a": 1, "b": 2}), ["a"], 'x is [\'a\']; needs "a" or "b"'),
        (Variable("x", "", start=1.0, min=0.0, max=1.0, absent="none", unlimited=True), inf, ""),
        (Variable("x", "", needs="a few", start=1, min=1), 0, "x is 0; needs a few"),
        (Variable("x", "", items={"a": 1, "b": 2, "c": 3}), "d", 'x is \'d\'; needs "a", "b" or "c"'),
    ],
)
def test_error_says_what_was_found_and_what_is_needed(variable: Variable, value: Any, error: str) -> None:
    assert variable.errors(value) == ([error] if error else [])


@pytest.mark.parametrize(
    ("make", "given", "error"),
    [
        (Criterion, {"alpha": "x"}, "alpha is 'x'; needs a number, or (layer, weight) pairs"),
        (Criterion, {"alpha": [1, 2]}, "alpha is [1, 2]; needs a number, or (layer, weight) pairs"),
        (Criterion, {"alpha": None}, "alpha is None; needs a number, or (layer, weight) pairs"),
        (Work, {"threads": "many"}, "threads is 'many'; needs a number of at least 1, or \"auto\""),
        (Criterion, {"alpha": [(np.inf, 0.5)]}, "alpha is [(inf, 0.5)]; needs a number, or (layer, weight) pairs"),
        (Criterion, {"alpha": [(1.5, 0.5)]}, "alpha is [(1.5, 0.5)]; needs a number, or (layer, weight) pairs"),
        (Work, {"time_limit": None}, "time_limit is None; needs a time above 0 s"),
        (HeightEstimator, {"untrusted_layers": 2**40}, "untrusted_layers is 1099511627776; needs a number of layers"),
        (LayerMpc, {"horizon": True}, "horizon is True; needs 1 to 5 layers ahead"),
        (DropletChoices, {"dead_nozzles": [False, True]}, "dead_nozzles is [False, True]; needs numbers of nozzles"),
        (Work, {"sweeps": "3"}, "sweeps is '3'; needs a whole number of at least 1"),
        (HeightEstimator, {"drop_levels": "2"}, "drop_levels is '2'; needs a whole number of 1 to 16"),
        (HeightEstimator, {"register_scans": "fixed"}, "register_scans is 'fixed'; needs True or False"),
        (DropletChoices, {"drop_levels": 1.5}, "drop_levels is 1.5; needs a whole number of 1 to 16"),
        (DropletChoices, {"dead_nozzles": 5}, "dead_nozzles is 5; needs numbers of nozzles"),
        (DropletChoices, {"dead_nozzles": ["a"]}, "dead_nozzles is ['a']; needs numbers of nozzles"),
        (DropletChoices, {"nozzle_pitch": "x"}, "nozzle_pitch is 'x'; needs a number of nozzles"),
        (LayerMpc, {"finish": None}, "finish is None; needs one of even, fast"),
        (LayerMpc, {"horizon": [3]}, "horizon is [3]; needs 1 to 5 layers ahead"),
    ],
)
def test_argument_of_a_wrong_type_is_refused_by_its_name(
    make: Callable[..., object], given: dict[str, Any], error: str
) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(error)}"):
        make(*[] if make in (Criterion, Work) else [block()], **given)


def test_weight_and_sizes_may_be_numbers_of_numpy() -> None:
    half: Any = np.float32(0.5)
    given: dict[str, Any] = {"dead_nozzles": (np.int32(n) for n in [1]), "drop_levels": np.int64(2)}
    assert Criterion(alpha=half).alpha_of(1) == 0.5
    choices = DropletChoices(block(), **given)
    assert choices.drop_levels == 2
    assert not choices.jettable[:, 1].any()
    assert choices.jettable[:, 3].any()


def test_all_errors_are_named_at_once_by_the_argument() -> None:
    assert errors_of(alpha=2.0, threads=0) == [
        "alpha is 2.0; needs a weight between 0 (evenness only) and 1 (height only)",
        'threads is 0; needs a number of at least 1, or "auto"',
    ]
    assert variables()["sweeps_max"].errors(0, "sweeps") == ["sweeps is 0; needs a whole number of at least 1"]


@pytest.mark.parametrize(("limit", "cores"), [("0", 1), ("3", 3), ("1000", 6), ("abc", 6), ("", 6)])
def test_auto_takes_the_cores_there_are_and_benchmarks_one(
    limit: str, cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(6), raising=False)
    monkeypatch.setenv("OMP_NUM_THREADS", limit)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    assert (Work().cores, Work(threads=2).cores) == (cores, 2)
    use_one_thread()
    assert Work().cores == 1


def test_option_of_a_class_is_written_in_the_unit_of_its_key() -> None:
    def part(*, limit: Annotated[float, declared("overshoot_limit")] = default("overshoot_limit")) -> None: ...
    def other(*, threshold: Annotated[float, Option("um")] = 2e-6) -> None: ...

    (limit,), (threshold,) = keywords(part), keywords(other)
    assert (limit.key, limit.default, limit.value(3.0)) == ("limit_um", None, pytest.approx(3e-6, rel=1e-12, abs=0.0))
    assert (threshold.key, threshold.default) == ("threshold_um", pytest.approx(2.0, rel=1e-12, abs=0.0))


def test_number_of_a_scenario_goes_to_the_class_in_si() -> None:
    written = {"overshoot_limit_um": 2.0, "layer_worth": 0.1, "time_limit_s": 3.0, "sensor_resolution_um": None}
    assert arguments(Criterion, written) == {"overshoot_limit": 2e-6, "layer_worth": 0.1}
    assert arguments(Work, written) == {"time_limit": 3.0}
    assert arguments(HeightEstimator, written) == {}
    (limit,) = (keyword for keyword in keywords(Work) if keyword.argument == "time_limit")
    assert (Work().time_limit, limit.key, limit.default) == (inf, "time_limit_s", None)


@pytest.mark.parametrize("make", [LayerMpcController, OpenLoopController])
def test_unknown_option_is_refused_by_its_name(make: type) -> None:
    for option in ("hroizon", "criterion", "after_sweep"):
        with pytest.raises(TypeError, match=option):
            make(job(), **{option: 1})


def test_schedule_of_alpha_holds_from_its_layer_on() -> None:
    criterion = Criterion(alpha=[(1, 0.5), (10, 0.9)])
    assert [criterion.alpha_of(layer) for layer in (1, 9, 10, 99)] == [0.5, 0.5, 0.9, 0.9]
    assert Criterion(alpha=0.3).alpha_of(7) == 0.3
    assert Criterion(alpha=[(3, 0.5), (5, 0.9)]).alpha_of(1) == 0.5


def test_ceiling_is_lower_where_the_prediction_is_less_sure() -> None:
    """Of the height now, and of what a full layer of droplets that vary by 10 % adds."""
    target = np.full((1, 2), 100e-6)
    part = np.ones(target.shape, np.bool_)
    job = Job(1, 2, 254e-6, target, part)
    exact, deviation = Estimate.exact(np.zeros((1, 2)), job.inks), np.array([[0.0, 2e-6]])
    estimate = replace(exact, height_variance=deviation**2)
    ceiling = LayerMpc(job, criterion=Criterion(overshoot_limit=5e-6, chance_margin=2.0)).problem(estimate, 0).ceiling
    (ink,) = job.inks
    layer = 0.1 * np.sqrt(ink.h1**2 + 4.0 * ink.h2**2 + 4.0 * ink.h3**2)
    assert ceiling == pytest.approx(105e-6 - 2.0 * np.hypot(deviation, layer), rel=1e-9, abs=0.0)
    assert LayerMpc(job).problem(estimate, 0).ceiling is None


@pytest.mark.system
@pytest.mark.parametrize("prints", rest_is_long([2, 12], 1))
def test_chance_margin_of_two_keeps_the_limit_on_all_but_a_few_cells(prints: int) -> None:
    """A normal prediction is exceeded by 2.3 % of the cells at the limit at two standard deviations, by half of them at
    none."""
    job = block(16, 16)

    def share_above(margin: float) -> float:
        controller = LayerMpcController(job, overshoot_limit_um=0.0, chance_margin=margin, annealing_sweeps=0)
        printed = [print_part(controller, job, variation=0.2, seed=seed) for seed in range(prints)]
        return float(np.mean([(one.height > job.target_height)[job.mask].mean() for one in printed]))

    with_margin, without = share_above(2.0), share_above(0.0)
    assert with_margin < 0.023
    assert without > 0.01 + 2.0 * with_margin


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"alpha": 1.5}, "alpha is 1.5"),
        ({"alpha": nan}, "alpha is nan"),
        ({"alpha": [(1, 0.5), (3, -0.5)]}, "alpha is -0.5"),
        ({"alpha": [(3, 0.5), (1, 0.5)]}, "rising layers"),
        ({"alpha": [(0, 0.5)]}, "rising layers from 1 on"),
        ({"alpha": [(2, 0.5), (2, 0.6)]}, "rising layers"),
        ({"alpha": []}, "rising layers"),
        ({"overshoot": 0.0}, "overshoot is 0.0"),
        ({"overshoot_limit": -1e-6}, "overshoot_limit is -1e-06"),
        ({"chance_margin": nan}, "chance_margin is nan"),
        ({"droplet_std": -0.1}, "droplet_std is -0.1"),
        ({"layer_worth": -0.1}, "layer_worth is -0.1"),
        ({"fringe_weight": 2.0}, "fringe_weight is 2.0"),
    ],
)
def test_impossible_options_are_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Criterion(**options)


def test_all_errors_are_named_at_once() -> None:
    with pytest.raises(ValueError, match=r"alpha is 2.*overshoot is -1.*fringe_weight is -1"):
        Criterion(alpha=2.0, overshoot=-1.0, fringe_weight=-1.0)
