"""A replay that differs from its run is reported with the layer and the cell."""

from __future__ import annotations

import numpy as np
import xarray as xr

from inkloop.bench.replay import differences
from inkloop.results.result import Result


def run(layers: int = 3) -> Result:
    """A run with a cell that was never measured."""
    height = np.arange(layers * 6, dtype=np.float64).reshape(layers, 2, 3)
    height[:, 1, 2] = np.nan
    dims = ("layer", "x", "y")
    return Result(
        xr.Dataset({"pattern": (dims, np.ones((layers, 2, 3), np.int32)), "measured_height": (dims, height)}), {}
    )


def test_same_arrays_do_not_differ_where_nothing_was_measured() -> None:
    assert differences(run(), run()) == []


def test_first_differing_layer_and_cell_are_named() -> None:
    again = run()
    again.dataset["pattern"].values[1:, 0, 1] = 2
    again.dataset["pattern"].values[2, 1, 0] = 0
    (found,) = differences(run(), again)
    assert "from layer 1 on: 1 cells, the first is (0, 1), 1 in the run and 2 in the replay" in found


def test_value_in_place_of_none_differs() -> None:
    again = run()
    again.dataset["measured_height"].values[2, 1, 2] = 1.0
    (found,) = differences(run(), again)
    assert "from layer 2 on: 1 cells, the first is (1, 2), nan in the run and 1 in the replay" in found


def test_replay_that_ends_too_early_is_reported() -> None:
    assert differences(run(3), run(2)) == ["the replay has 1 layer, the run 2 layers"]
    assert differences(run(2), run(3)) == []
