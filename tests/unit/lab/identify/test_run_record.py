"""Data of a run for identification: its scans, or the surfaces of a run without a profiler, from one layer on."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray

from inkloop_lab.identify.print_record import IdentificationError, record_of

PROCESS = '[process]\npasses = 4\npass_order = "diagonal"\npass_rotation = 3\n'
SHAPE = ("layer", "x", "y")


def result(layers: int, **maps: Any) -> Any:
    rng = np.random.default_rng(2)
    drawn = {
        "pattern": rng.integers(0, 3, (layers, 4, 3)).astype(np.int8),
        "measured_height": rng.random((layers, 4, 3)).astype(np.float32),
        "valid": rng.random((layers, 4, 3)) < 0.5,
        "height": rng.random((layers, 4, 3)),
    } | maps
    arrays = {name: (SHAPE, values) for name, values in drawn.items() if values is not None}
    return SimpleNamespace(dataset=xarray.Dataset(arrays, attrs={"pitch": 2e-4}), scenario_text=PROCESS)


def test_scans_count_where_they_are_valid_and_patterns_from_the_first_layer_on() -> None:
    run = result(3)
    found, data = record_of(run, "it"), run.dataset
    assert (found.name, found.pitch, found.passes, found.pass_order, found.pass_rotation) == ("it", 2e-4, 4, 2, 3)
    np.testing.assert_array_equal(found.pattern, data["pattern"].values[1:])
    np.testing.assert_array_equal(np.isnan(found.measured), ~data["valid"].values)
    seen = data["valid"].values
    np.testing.assert_array_equal(found.measured[seen], data["measured_height"].values[seen].astype(np.float64))
    assert found.area is None


def test_surfaces_count_where_nothing_was_scanned() -> None:
    run = result(2, measured_height=None, area=np.ones((2, 4, 3)))
    found = record_of(run, "it")
    np.testing.assert_array_equal(found.measured, run.dataset["height"].values)
    np.testing.assert_array_equal(found.area, 1.0)


@pytest.mark.parametrize(
    ("layers", "maps", "message"),
    [
        (1, {}, "of 0 layers; needs pattern and measured_height of at least one layer"),
        (3, {"pattern": None}, "it: holds measured_height, valid, height of 2 layers; needs pattern"),
        (3, {"measured_height": None, "height": None}, "it: holds pattern, valid of 2 layers; needs"),
    ],
)
def test_run_that_tells_nothing_is_refused(layers: int, maps: dict[str, None], message: str) -> None:
    with pytest.raises(IdentificationError, match=message):
        record_of(result(layers, **maps), "it")
    record_of(result(2), "it")
