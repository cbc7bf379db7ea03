"""Figures of the page against the numbers that they show: curves, distribution, scales and colours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.report.page import charts
from inkloop.report.page.charts import ErrorScale
from inkloop.report.page.curves import by_layer, distribution, final_error


def printed(*errors_um: float, layers: int = 3, mean_um: float = -2.0, std_um: float = 4.0) -> xr.Dataset:
    """A part of so many cells and one beside it; `errors_um` at its end. Each layer has one droplet more."""
    cells = len(errors_um) + 1
    mask = np.arange(cells)[:, None] > 0
    height = np.zeros((layers + 1, cells, 1))
    height[-1, 1:, 0] = 50e-6 - np.array(errors_um) * 1e-6
    pattern = np.zeros(height.shape, np.int32)
    for layer in range(1, layers + 1):
        pattern[layer, :layer] = 2
    means, stds = np.linspace(50e-6, mean_um * 1e-6, layers + 1), np.linspace(0.0, std_um * 1e-6, layers + 1)
    maps = {name: (("layer", "x", "y"), values) for name, values in {"height": height, "pattern": pattern}.items()}
    flat = {"target_height": (("x", "y"), np.where(mask, 50e-6, 0.0)), "mask": (("x", "y"), mask)}
    figures = {"mean_error": ("layer", means), "std": ("layer", stds)}
    return xr.Dataset({**maps, **flat, **figures}, {"layer": np.arange(layers + 1)}, {"pitch": 1e-4})


def test_curves_by_layer_are_distance_unevenness_and_droplets_under_their_headings() -> None:
    figure = by_layer({"closed": printed(1.0, 2.0, 3.0), "open <b>": printed(1.0, 2.0, 3.0)})
    mean, std, droplets = figure.data[:3]
    np.testing.assert_array_equal(mean.x, [0, 1, 2, 3])
    np.testing.assert_allclose(mean.y, [50.0, 98 / 3, 46 / 3, 2.0], rtol=1e-9)  # a distance has no sign
    np.testing.assert_array_equal(std.x, [1, 2, 3])
    np.testing.assert_allclose(std.y, [4 / 3, 8 / 3, 4.0], rtol=1e-9)
    np.testing.assert_array_equal([droplets.x, droplets.y], [[1, 2, 3], [1, 2, 3]])
    assert [trace.name for trace in figure.data] == ["closed"] * 3 + ["open &lt;b&gt;"] * 3
    assert [trace.showlegend for trace in figure.data] == [True, False, False] * 2
    lines = [trace.line for trace in figure.data]
    assert lines[0] == lines[1] != lines[3] == lines[4]
    assert (lines[0].dash, lines[2].shape) == ("solid", "hvh")
    layout, axes = figure.layout, ("y", "y2", "y3")
    assert [trace.yaxis for trace in figure.data[:3]] == list(axes)
    for axis, heading in zip(("yaxis", "yaxis2", "yaxis3"), layout.annotations, strict=True):
        assert layout[axis].domain[1] == heading.y  # each stands above its own curves
    assert [heading.text.partition(" ")[0] for heading in layout.annotations] == ["distance", "standard", "droplets"]
    assert (layout.yaxis.type, layout.yaxis2.type, layout.yaxis3.type) == ("log", "log", None)
    assert (layout.xaxis3.title.text, layout.xaxis3.dtick) == ("layer", 1)  # a tick for each of few layers
    assert by_layer({"a": printed(1.0, layers=12)}).layout.xaxis3.dtick is None


def test_run_without_patterns_and_unevenness_has_two_curves_on_linear_axes() -> None:
    figure = by_layer({"a": printed(1.0, std_um=0.0).drop_vars("pattern")})
    assert len(figure.data) == 2
    assert figure.layout.yaxis2.type is None


def test_distribution_counts_the_cells_of_the_part() -> None:
    errors = [-1.0] * 3 + [0.5] * 5 + [2.0] * 2
    figure = distribution({"a": final_error(printed(*errors)), "b": final_error(printed(*[1.0] * 9))})
    first, second = figure.data
    assert sum(first.y) == pytest.approx(100.0, rel=1e-9, abs=0.0)
    assert float(first.x @ first.y) / 100.0 == pytest.approx(float(np.mean(errors)), abs=0.05)
    assert sorted(first.y[first.y > 0]) == pytest.approx([20.0, 30.0, 50.0], rel=1e-9, abs=0.0)
    assert first.y[np.abs(first.x + 1.0) < 0.05].sum() == pytest.approx(30.0, rel=1e-9, abs=0.0)
    assert second.x[int(np.argmax(second.y))] == pytest.approx(1.0, abs=0.05)
    assert (first.fill, second.fill) == ("tozeroy", "none")
    assert figure.layout.xaxis.title.text == "target - height [µm]<br>- too high, + too low"


def test_run_that_is_far_off_is_named_and_does_not_widen_the_distribution() -> None:
    near, far = np.linspace(-1.0, 1.0, 30), np.linspace(20.0, 40.0, 30)
    figure = distribution({"near": near, "open": far, "empty": np.zeros(0)})
    assert [trace.name for trace in figure.data] == ["near"]
    assert max(abs(figure.data[0].x)) < 2.0
    assert figure.layout.xaxis.title.text.endswith("<br>outside: open: +30 µm")


def test_scale_of_errors_is_that_of_all_runs_with_round_numbers_on_both_sides() -> None:
    fine, coarse = np.linspace(-1.0, 1.0, 1001), np.linspace(-40.0, 10.0, 1001)
    scale = ErrorScale.of([fine, coarse])
    far = [np.quantile(np.abs(errors), 0.99) for errors in (fine, coarse)]
    assert (scale.width, scale.limit) == pytest.approx((far[0] / 2.0, far[1]), rel=1e-9, abs=0.0)
    axis = ErrorScale(0.7, 30.0).coloraxis
    texts = axis["colorbar"]["ticktext"]
    assert texts == ["-20", "-5", "-1", "0", "1", "5", "20"]
    np.testing.assert_allclose(axis["colorbar"]["tickvals"], np.arcsinh(np.array(texts, float) / 0.7), rtol=1e-12)
    np.testing.assert_allclose([axis["cmin"], axis["cmax"]], np.arcsinh([-30 / 0.7, 30 / 0.7]), rtol=1e-12)
    assert (axis["colorscale"][0], axis["colorscale"][-1]) == ("#67001f", "#053061")
    assert ErrorScale.of([np.zeros(0)]).limit > 0.0


@pytest.mark.parametrize(
    ("inks", "words", "ends"),
    [(1, ["none", "droplet"], (-0.5, 1.5)), (2, ["none", "ink A", "ink B"], (-0.5, 2.5)), (0, None, (0, 100))],
)
def test_droplets_are_shown_by_ink_or_as_a_share_of_their_block(inks: int, words: Any, ends: Any) -> None:
    colours = charts.droplets(inks).layout.coloraxis
    assert (colours.cmin, colours.cmax) == ends
    assert colours.colorbar.ticktext == (tuple(words) if words else None)
    shares = [0.0, *(at / len(words) for at in range(1, len(words)) for _ in "ab"), 1.0] if words else [0.0, 1.0]
    assert [at for at, _ in colours.colorscale] == pytest.approx(shares, rel=1e-12, abs=0.0)


def test_solid_is_as_long_as_the_grid_and_says_how_much_heights_are_stretched() -> None:
    edges = [[-0.05, 0.95, 1.95], [-0.05, 0.45, 0.95]]  # 2 mm x 1 mm
    figure = charts.solid(ErrorScale(0.1, 1.0), (0.0, 50.0), edges)
    scene = figure.layout.scene
    assert scene.aspectratio.x == pytest.approx(2.0 * scene.aspectratio.y, rel=1e-9, abs=0.0)
    assert (scene.xaxis.range, scene.yaxis.range, scene.zaxis.range) == ((-0.05, 1.95), (-0.05, 0.95), (0.0, 50.0))
    stretch = scene.aspectratio.z / 50e-6 / (scene.aspectratio.x / 2e-3)
    assert figure.layout.title.text == f"Surface in 3D, heights \u00d7 {stretch:.2g}"


def test_markup_in_a_label_stays_text() -> None:
    assert charts.error("<b> & </b>", ErrorScale(0.1, 1.0)).layout.title.text == "&lt;b&gt; &amp; &lt;/b&gt;"
