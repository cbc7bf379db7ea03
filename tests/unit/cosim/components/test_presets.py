"""A preset gives what the table of a component leaves out."""

from __future__ import annotations

import pytest

from inkloop.components import catalog, fmu_parameters
from inkloop.components.fmu_parameters import PRESETS
from inkloop.fmu import describe
from inkloop.fmu_writer.export import find_fmu
from support.toys import toy_job


def test_parameters_of_every_preset_are_parameters_of_its_model() -> None:
    for model, presets in PRESETS.items():
        known = describe(find_fmu(model, "fmi3")).parameters
        for values in presets.values():
            assert set(values) <= set(known)


def test_preset_gives_its_values_and_the_table_wins_over_them() -> None:
    options = {"preset": "laser", "noise_std_um": 3.0}
    parameters = fmu_parameters.parse_model("ProfileSensor", toy_job(), options).parameters
    assert parameters["noise_std"] == pytest.approx(3e-6, rel=1e-9, abs=0.0)
    assert parameters["resolution"] == PRESETS["ProfileSensor"]["laser"]["resolution"]


@pytest.mark.parametrize(
    ("kind", "preset", "message"),
    [
        ("ProfileSensor", "lasr", "preset is 'lasr'; expected one of laser, zeta-20, exact"),
        ("ProfileSensor", 3, "preset is 3; expected one of laser, zeta-20, exact"),
        ("LayerDeposition", "laser", "preset is 'laser'; LayerDeposition has no presets"),
    ],
)
def test_preset_that_there_is_not_is_an_error(kind: str, preset: object, message: str) -> None:
    assert catalog.check(kind, toy_job(), {"preset": preset}).errors == [message]
