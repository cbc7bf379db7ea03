"""Options of LayerMpc in a scenario: variables.toml declares them, for Python as for LayerController.fmu."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, nan
from typing import Annotated, Any

import pytest

from inkloop.components import catalog
from inkloop.components.fmu_parameters import options_of_controller_fmu
from inkloop.testing import job
from inkloop_controller import Criterion, DropletChoices, HeightEstimator, LayerMpc, Work
from inkloop_controller.controllers import LayerMpcController, OpenLoopController, on_doubt_option
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


@pytest.mark.parametrize(("keyword", "value"), outside())
def test_value_outside_the_limits_is_refused_by_the_key_and_no_other_one(keyword: Keyword, value: Any) -> None:
    written = value if isinstance(value, str) or not keyword.option.unit else value / keyword.value(1.0)
    errors = catalog.check("LayerMpc", job(), {keyword.key: written}).errors
    assert len(errors) == 1
    assert keyword.argument in errors[0]


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
        (Variable("x", "", type="integer", start=0, min=0, max=5, absent="none"), 0, "x is 0; needs a value of 1 to 5"),
        (Variable("x", "", start=1.0, min=0.0, max=1.0, absent="none", unlimited=True), inf, ""),
        (Variable("x", "", needs="a few", start=1, min=1), 0, "x is 0; needs a few"),
        (Variable("x", "", items={"a": 1, "b": 2, "c": 3}), "d", 'x is \'d\'; needs "a", "b" or "c"'),
    ],
)
def test_error_says_what_was_found_and_what_is_needed(variable: Variable, value: Any, error: str) -> None:
    assert variable.errors(value) == ([error] if error else [])


def test_all_errors_are_named_at_once_by_the_argument() -> None:
    assert errors_of(alpha=2.0, threads=0) == [
        "alpha is 2.0; needs a weight between 0 (evenness only) and 1 (height only)",
        "threads is 0; needs at least 1",
    ]
    assert variables()["sweeps_max"].errors(0, "sweeps") == ["sweeps is 0; needs at least 1"]


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
