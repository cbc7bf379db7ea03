"""Curves, facts and devices of the page against the figures that they show."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.report.page.content import state
from inkloop.report.page.curves import by_layer, distribution
from inkloop.report.page.devices import LOG_LINES, devices
from inkloop.report.page.maps import block_for, step_um
from inkloop.results.result import Result


def printed(*errors_um: float, layers: int = 3, mean_um: float = -2.0, std_um: float = 4.0) -> xr.Dataset:
    """A part of so many cells and one beside it; `errors_um` at its end. Each layer has one droplet more."""
    cells = len(errors_um) + 1
    mask = np.arange(cells)[:, None] > 0
    target = np.where(mask, 50e-6, 0.0)
    height = np.zeros((layers + 1, cells, 1))
    height[-1, 1:, 0] = 50e-6 - np.array(errors_um) * 1e-6
    pattern = np.zeros(height.shape, np.int32)
    for layer in range(1, layers + 1):
        pattern[layer, :layer] = 2
    means, stds = np.linspace(50e-6, mean_um * 1e-6, layers + 1), np.linspace(0.0, std_um * 1e-6, layers + 1)
    maps = {name: (("layer", "x", "y"), values) for name, values in {"height": height, "pattern": pattern}.items()}
    figures = {"mean_error": ("layer", means), "std": ("layer", stds)}
    return xr.Dataset(
        {**maps, **figures, "target_height": (("x", "y"), target), "mask": (("x", "y"), mask)},
        {"layer": np.arange(layers + 1)},
        {"pitch": 1e-4},
    )


def test_curves_by_layer_are_distance_unevenness_and_droplets_under_their_headings() -> None:
    figure = by_layer({"closed": printed(1.0, 2.0, 3.0), "open <b>": printed(1.0, 2.0, 3.0)})
    mean, std, droplets = figure["data"][:3]
    assert (mean["x"], mean["yaxis"]) == ([0, 1, 2, 3], "y")
    assert mean["y"] == pytest.approx([50.0, 98 / 3, 46 / 3, 2.0], rel=1e-9, abs=0.0)  # a distance has no sign
    assert (std["x"], std["yaxis"]) == ([1, 2, 3], "y2")
    assert std["y"] == pytest.approx([4 / 3, 8 / 3, 4.0], rel=1e-9, abs=0.0)
    assert (droplets["x"], droplets["y"], droplets["yaxis"]) == ([1, 2, 3], [1, 2, 3], "y3")
    assert [trace["name"] for trace in figure["data"]] == ["closed"] * 3 + ["open &lt;b&gt;"] * 3
    assert [trace.get("showlegend", True) for trace in figure["data"]] == [True, False, False] * 2
    lines = [trace["line"] for trace in figure["data"]]
    assert lines[0] == lines[1] != lines[3] == lines[4]
    assert (lines[0]["dash"], lines[2]["shape"]) == ("solid", "hvh")
    assert len({(line["color"], line["dash"]) for line in lines}) == 2
    layout = figure["layout"]
    headings = [each["text"] for each in layout["annotations"]]
    assert [heading.partition(" [")[0] for heading in headings] == [
        "distance of the mean from the target", "standard deviation over the part", "droplets of the layer",
    ]  # fmt: skip
    for axis, heading in zip(("yaxis", "yaxis2", "yaxis3"), layout["annotations"], strict=True):
        assert layout[axis]["domain"][1] == heading["y"]  # each stands above its own curves
    domains = [layout[axis]["domain"] for axis in ("yaxis3", "yaxis2", "yaxis")]
    assert [low < high for low, high in domains] == [True] * 3
    assert domains[0][1] < domains[1][0]
    assert domains[1][1] < domains[2][0]
    assert (layout["yaxis"]["type"], layout["yaxis2"]["type"]) == ("log", "log")
    assert "type" not in layout["yaxis3"]
    assert layout["xaxis"]["title"]["text"] == "layer"
    assert layout["xaxis"]["dtick"] == 1  # a tick for each of few layers
    assert "dtick" not in by_layer({"a": printed(1.0, layers=12)})["layout"]["xaxis"]


def test_line_has_gaps_where_a_logarithm_has_none() -> None:
    run = printed(1.0, 2.0)
    run["mean_error"] = ("layer", [0.0, np.nan, -1e-6, 2e-6])
    assert by_layer({"a": run})["data"][0]["y"] == [
        None,
        None,
        pytest.approx(1.0, rel=1e-9, abs=0.0),
        pytest.approx(2.0, rel=1e-9, abs=0.0),
    ]
    blank = by_layer({"a": printed(1.0, std_um=0.0).drop_vars("pattern")})
    assert len(blank["data"]) == 2
    assert "type" not in blank["layout"]["yaxis"]


@pytest.mark.parametrize(("layers", "digits"), [(290, (1, 2, 5)), (310, (1,))])
def test_axis_of_few_decades_has_ticks_between_them(layers: int, digits: tuple[int, ...]) -> None:
    """The unevenness grows from a share of its last value to all of it."""
    axis = by_layer({"a": printed(1.0, layers=layers)})["layout"]["yaxis2"]
    expected = sorted(float(f"{digit}e{power}") for power in range(-4, 5) for digit in digits)
    assert sorted(axis["tickvals"]) == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert [float(text) for text in axis["ticktext"]] == pytest.approx(axis["tickvals"], rel=1e-9, abs=0.0)


def test_distribution_counts_the_cells_of_the_part() -> None:
    errors = [-1.0] * 3 + [0.5] * 5 + [2.0] * 2
    figure = distribution({"a": printed(*errors), "b": printed(*[1.0] * 9)})
    first, second = figure["data"]
    assert sum(first["y"]) == pytest.approx(100.0, rel=1e-9, abs=0.0)
    x, y = np.array(first["x"]), np.array(first["y"])
    mean = float(x @ y) / 100.0
    assert mean == pytest.approx(float(np.mean(errors)), abs=0.05)
    assert sorted(y[y > 0]) == pytest.approx([20.0, 30.0, 50.0], rel=1e-9, abs=0.0)
    assert y[np.abs(x + 1.0) < 0.05].sum() == pytest.approx(30.0, rel=1e-9, abs=0.0)
    assert second["x"][int(np.argmax(second["y"]))] == pytest.approx(1.0, abs=0.05)
    assert max(second["y"]) == pytest.approx(100.0, rel=1e-9, abs=0.0)
    assert (first.get("fill"), second.get("fill")) == ("tozeroy", None)
    title = figure["layout"]["xaxis"]["title"]["text"]
    assert title == "target - height [µm]<br>- too high, + too low"
    assert figure["layout"]["yaxis"]["title"]["text"] == "cells of the part [%]"


def test_run_that_is_far_off_is_named_and_does_not_widen_the_distribution() -> None:
    near, far = printed(*np.linspace(-1.0, 1.0, 30)), printed(*np.linspace(20.0, 40.0, 30))
    figure = distribution({"near": near, "open": far})
    assert [trace["name"] for trace in figure["data"]] == ["near"]
    assert max(map(abs, figure["data"][0]["x"])) < 2.0
    assert figure["layout"]["xaxis"]["title"]["text"].endswith("<br>outside: open: +30 µm")


@pytest.mark.parametrize(
    ("reason", "layers", "sentence"),
    [
        ("done", 3, "The controller ended the print: 3 layers."),
        ("layers_max", 1, "The print ended at `layers_max` of the scenario: 1 layer."),
        ("time_max", 2, "The print ended at `time_max_s` of the scenario: 2 layers."),
        ("interrupted", 2, "The print was interrupted: 2 layers."),
        ("stopped", 2, "The controller stopped the print, as the scans do not show what was printed: 2 layers."),
        ("failed", 2, "A component failed: 2 layers."),
        ("fault", 2, "The print ended with a fault: 2 layers."),
        ("running", 2, "The print has not ended: 2 layers."),
    ],
)
def test_state_says_how_the_print_ended(reason: str, layers: int, sentence: str) -> None:
    assert state(Result(printed(1.0, layers=layers).assign_attrs(stop_reason=reason), {})) == sentence


def test_last_message_of_each_node_is_shown_with_its_level(tmp_path: Path) -> None:
    log = tmp_path / "bench.log"
    assert devices(log) is None
    old = [f"2026-01-01 10:00:{n % 60:02d} INFO stage: line {n}" for n in range(50)]
    lines = [
        *old,
        "2026-01-01 11:00:00 WARNING lamp: warm: 3 A",
        "2026-01-01 11:00:01 INFO stage: at rest",
        "2026-01-01 11:00:02 ERROR not a node: words",
    ]
    log.write_text("\n".join(lines), encoding="utf-8")
    found: Any = devices(log)
    assert found["nodes"] == [
        ["stage", "2026-01-01 11:00:01", "", "at rest"],
        ["lamp", "2026-01-01 11:00:00", "warning", "warm: 3 A"],
    ]
    assert found["log"] == lines[-LOG_LINES:]
    assert len(found["log"]) == LOG_LINES


def test_heights_of_tall_parts_have_coarser_steps_and_large_maps_larger_blocks() -> None:
    run = printed(1.0)
    assert step_um(run) == 0.01
    tall = run.copy(deep=True)
    tall["target_height"] = tall["target_height"] * 1e4
    assert step_um(tall) > 0.01
    assert 0.5e6 / step_um(tall) < 2**31  # a height of half a metre fits
    grid = xr.Dataset({"height": (("layer", "x", "y"), np.zeros((1, 10, 7)))})
    assert [block_for(grid, cells) for cells in (70, 69, 20, 0.5)] == [1, 2, 2, 10]
