"""Options of LayerMpc in a scenario: made from the classes, and the same as those of LayerController.fmu."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import get_args

import pytest

from inkloop.components import catalog
from inkloop.components.fmu_parameters import options_of_controller_fmu
from inkloop.fmu_writer import definition
from inkloop.fmu_writer.definition import VariableDefinition
from inkloop.testing import job
from inkloop_controller import Criterion, DropletChoices, HeightEstimator, LayerMpc, Work
from inkloop_controller.controllers import LayerMpcController, OpenLoopController
from inkloop_controller.problem.options import Keyword, arguments, keywords
from support.places import ROOT

CLASSES = (LayerMpc, Criterion, DropletChoices, Work, HeightEstimator)
OF_PYTHON = {"relaxation", "certified", "dead_nozzles", "nozzle_pitch", "threads"}
DEFINITION = ROOT / "fmus" / "layer_controller" / "variables.toml"
MODEL = definition.load(DEFINITION.read_text(encoding="utf-8"), DEFINITION)
NO_VALUE = {
    "horizon": 0,
    "layer_worth": -1.0,
    "droplet_std": -1.0,
    "overshoot": 0.0,
    "overshoot_limit": 1.0,
    "annealing_sweeps": -1,
    "time_limit": 0.0,
    "sensor_noise_std": -1.0,
    "flat_ground": False,
}
"""Numbers of the FMU for None and infinity in Python."""


def pairs() -> Iterator[tuple[Keyword, VariableDefinition]]:
    """Every option of LayerMpc that the FMU has too."""
    variables = {variable.name: variable for variable in MODEL.variables}
    for keyword in (keyword for each in CLASSES for keyword in keywords(each)):
        (name,) = options_of_controller_fmu({keyword.argument: None})
        if keyword.argument not in OF_PYTHON:
            yield keyword, variables[name]


@pytest.mark.parametrize(("keyword", "variable"), list(pairs()), ids=lambda each: getattr(each, "name", ""))
def test_fmu_has_the_default_of_the_class(keyword: Keyword, variable: VariableDefinition) -> None:
    expected = NO_VALUE.get(keyword.argument) if keyword.default is None else keyword.value(keyword.default)
    if variable.declared is None:
        assert variable.start == expected
    else:
        assert MODEL.types[variable.declared].items[str(expected)] == variable.start


@pytest.mark.parametrize(("keyword", "variable"), list(pairs()), ids=lambda each: getattr(each, "name", ""))
def test_class_has_the_lower_limit_or_the_items_of_the_fmu(keyword: Keyword, variable: VariableDefinition) -> None:
    if variable.declared is not None:
        assert list(get_args(get_args(keyword.annotation)[0])) == list(MODEL.types[variable.declared].items)
        return
    if variable.type == "boolean":
        assert get_args(keyword.annotation)[0] is bool
        return
    least = 0 if keyword.argument in NO_VALUE else variable.min
    assert least is not None
    below = least - 1 if variable.type == "integer" else least - 1e-3
    errors = catalog.check("LayerMpc", job(), {keyword.key: below}).errors
    assert len(errors) == 1
    assert keyword.argument in errors[0]


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
