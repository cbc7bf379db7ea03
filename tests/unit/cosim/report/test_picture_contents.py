"""Content of the pictures of a run: each line, bar and label against its figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.colors import AsinhNorm, Normalize, same_color
from matplotlib.figure import Figure

from inkloop.report import pictures as run_pictures
from inkloop.report import plot
from inkloop.report.error_maps import comparison, error_map, hardware_against_model
from inkloop.report.layer_curves import cross_section, divergence, layers
from inkloop.report.model_difference import LayerDifference, ModelDifference
from inkloop.report.solid_picture import materials
from inkloop.report.surface_picture import surfaces
from inkloop.results.metrics import masked_error
from inkloop.results.result import Result

PITCH, NX, NY = 100e-6, 7, 5
PART = (slice(1, 5), slice(1, 4))
"""Of the grid: neither square nor in its middle."""


def printed(lack_um: float = 2.0, count: int = 4, pitch: float = PITCH) -> xr.Dataset:
    """A part 20 um high of 4 x 3 cells after `count` layers, which lacks `lack_um`; one cell is 5 um higher."""
    mask = np.zeros((NX, NY), np.bool_)
    mask[PART] = True
    target = np.where(mask, 20e-6, 0.0)
    heights = [np.where(mask, (20.0 - lack_um) * 1e-6 * layer / count, 0.0) for layer in range(count + 1)]
    heights[-1][2, 3] += 5e-6
    errors = [masked_error(height, target, mask) for height in heights]
    pattern = np.zeros((count + 1, NX, NY), np.int32)
    for layer in range(1, count + 1):
        pattern[layer, 1 : 1 + layer, 2] = 1 + layer % 2
    maps = {"height": np.stack(heights), "pattern": pattern}
    return xr.Dataset(
        {
            **{name: (("layer", "x", "y"), values) for name, values in maps.items()},
            "target_height": (("x", "y"), target),
            "mask": (("x", "y"), mask),
            "mean_error": ("layer", [error.mean_error for error in errors]),
            "std": ("layer", [error.std for error in errors]),
        },
        coords={"layer": np.arange(count + 1), "x": np.arange(NX) * pitch, "y": np.arange(NY) * pitch},
        attrs={"pitch": pitch},
    )


def values(line: Any) -> Any:
    """x and y of the points of a line, (2, K)."""
    return np.array(line.get_data(), np.float64)


def labelled(axes: Any) -> dict[Any, Any]:
    """Label -> line, of those with a label."""
    return {line.get_label(): line for line in axes.lines if not line.get_label().startswith("_")}


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_error_map_has_places_in_millimetres_and_counts_every_cell() -> None:
    run = printed()
    figure = error_map(run, "closed loop")
    plane, counts, scale = figure.axes
    assert figure.get_suptitle() == f"closed loop: mean error {run.mean_error[-1] * 1e6:.2f}, std {1.38:.2f} µm"
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("x [mm]", "y [mm]")
    (image,) = plane.get_images()
    assert image.get_extent() == pytest.approx((-0.05, 0.65, -0.05, 0.45), rel=1e-9, abs=0.0)
    assert (plane.get_xlim(), plane.get_ylim()) == (
        pytest.approx((-0.05, 0.65), rel=1e-9, abs=0.0), pytest.approx((-0.05, 0.45), rel=1e-9, abs=0.0),
    )  # fmt: skip
    shown: Any = np.ma.filled(np.ma.asarray(image.get_array()), np.nan)
    assert shown.shape == (NY, NX)  # rows along y, from below
    assert image.origin == "lower"
    assert shown[3, 2] == pytest.approx(-3.0, rel=1e-9, abs=0.0)
    assert np.isfinite(shown).sum() == 12
    patches: Any = counts.patches
    edges = [patch.get_x() for patch in patches]
    heights = {round(patch.get_x() + patch.get_width() / 2, 3): patch.get_height() for patch in patches}
    assert {x: n for x, n in heights.items() if n} == {-2.927: 1.0, 2.049: 11.0}
    assert edges[0] == pytest.approx(-3.0, rel=1e-9, abs=0.0)
    assert (counts.get_ylabel(), counts.get_xlabel()) == ("cells", "error [µm] (too low +, too high -)")
    assert [text.get_text() for text in scale.texts] == ["too low", "too high\n(dots)"]
    norm: Any = image.norm
    assert norm.vmax == -norm.vmin == pytest.approx(3.0, rel=0.05, abs=0.0)


def test_comparison_has_one_scale_and_the_figures_of_each_run_above_its_map() -> None:
    runs = {"closed": printed(0.5), "open": printed(8.0)}
    figure = comparison(runs)
    first, second, _, mean, spread, droplets = figure.axes
    for axes, (name, run) in zip((first, second), runs.items(), strict=True):
        mean_um, std_um = (float(run[each][-1]) * 1e6 for each in ("mean_error", "std"))
        assert axes.get_title() == f"{name}\nmean error {mean_um:.2f}\nstd {std_um:.2f} µm"
        (image,) = axes.get_images()
        assert np.nanmean(np.ma.filled(np.ma.asarray(image.get_array()), np.nan)) == pytest.approx(
            mean_um, rel=1e-9, abs=0.0
        )
    norms = [axes.get_images()[0].norm for axes in (first, second)]
    assert norms[0] is norms[1]
    assert isinstance(norms[0], AsinhNorm)
    assert (first.get_ylabel(), second.get_ylabel(), second.get_xlabel()) == ("y [mm]", "", "x [mm]")
    assert mean.get_title() == "mean error [µm]\n(too low +, too high -)"
    assert (spread.get_title(), droplets.get_title()) == ("std over the part [µm]", "droplets of the layer")
    assert [axes.get_xlabel() for axes in (mean, spread, droplets)] == ["layer"] * 3
    assert list(labelled(mean)) == ["closed", "open"]


def test_scale_reaches_the_largest_error_and_tells_the_smallest() -> None:
    one = plot.error_norm([np.array([[-4.0, 1.0], [np.nan, 2.0]])])
    assert (one.vmin, one.vmax) == (pytest.approx(-4.0, rel=0.05, abs=0.0), pytest.approx(4.0, rel=0.05, abs=0.0))
    assert type(one) is Normalize
    both = plot.error_norm([np.full((3, 3), 0.4), np.full((3, 3), -20.0)])
    assert isinstance(both, AsinhNorm)
    assert (both.vmin, both.vmax, both.linear_width) == pytest.approx((-20.0, 20.0, 0.2), rel=1e-9, abs=0.0)
    assert plot.error_norm([np.zeros((2, 2))]).vmax == 1e-3


def test_cut_shows_layers_target_and_error_along_the_middle_of_the_part() -> None:
    runs = {"closed": printed(2.0), "open": printed(-3.0)}
    figure = cross_section(runs)
    whole, top = figure.axes
    x = np.arange(NX) * 0.1
    target, high = ([0.0, *[um] * 4, 0.0, 0.0] for um in (20.0, 23.0))
    grey = [line for line in whole.lines if same_color(line.get_color(), "0.75")]
    assert [float(values(line)[1, 2]) for line in grey] == pytest.approx([0.0, 4.5, 9.0, 13.5], rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(values(labelled(whole)["target"]), np.stack([x, target]), atol=1e-9)
    np.testing.assert_allclose(values(labelled(whole)["open"]), np.stack([x, high]), atol=1e-9)
    assert list(labelled(whole)) == ["closed, every layer", "target", "closed", "open"] == legend_of(figure)
    assert whole.get_title() == "cut at y = 0.20 mm"
    assert (whole.get_ylabel(), top.get_xlabel()) == ("height [µm]", "x [mm]")
    assert whole.get_ylim()[0] == 0.0
    np.testing.assert_allclose(values(top.lines[0]), np.stack([x[1:5], [2.0] * 4]), rtol=1e-9)  # the part alone
    np.testing.assert_allclose(values(top.lines[1]), np.stack([x[1:5], [-3.0] * 4]), rtol=1e-9)
    assert top.get_ylim() == pytest.approx((-3.6, 3.6), rel=1e-9, abs=0.0)


def test_cut_of_many_layers_shows_about_ten() -> None:
    figure = cross_section({"a": printed(count=25)})
    whole = figure.axes[0]
    grey = [line for line in whole.lines if same_color(line.get_color(), "0.75")]
    assert [round(float(values(line)[1, 2]) / 18.0 * 25) for line in grey] == list(range(0, 25, 2))
    assert grey[0].get_label() == "a, every 2 layers"


def test_frame_of_the_cut_is_that_of_the_runs_that_are_near() -> None:
    _, top = cross_section({"closed": printed(2.0), "open": printed(15.0)}).axes
    assert top.get_ylim() == pytest.approx((-2.4, 2.4), rel=1e-9, abs=0.0)
    assert top.get_title(loc="left") == "open: 15 µm too low, outside the frame"
    _, alone = cross_section({"open": printed(15.0)}).axes
    assert alone.get_ylim() == pytest.approx((-18.0, 18.0), rel=1e-9, abs=0.0)
    _, exact = cross_section({"exact": printed(0.0)}).axes
    assert exact.get_ylim() == pytest.approx((-0.1, 0.1), rel=1e-9, abs=0.0)


def test_layers_are_numbered_and_their_droplets_counted() -> None:
    runs = {"closed": printed(0.5), "open": printed(-130.0)}
    figure = layers(runs)
    mean, spread, droplets = figure.axes
    assert legend_of(figure) == ["closed", "open"]
    assert mean.get_ylabel() == "mean error [µm]\n(too low +, too high -)"
    assert [axes.get_ylabel() for axes in (spread, droplets)] == ["std over the part [µm]", "droplets"]
    assert droplets.get_xlabel() == "layer"
    np.testing.assert_array_equal(values(labelled(mean)["closed"])[0], np.arange(5))
    np.testing.assert_array_equal(values(spread.lines[0])[0], np.arange(1, 5))
    np.testing.assert_array_equal(values(droplets.lines[0]), [[1, 2, 3, 4], [1, 2, 3, 4]])
    assert droplets.get_ylim()[0] == 0.0
    assert (mean.get_yscale(), spread.get_yscale()) == ("symlog", "log")
    assert mean.get_yticks().tolist() == [-1000.0, -100.0, -10.0, -1.0, 0.0, 1.0, 10.0, 100.0]  # of 20 to -130 um
    for axes in figure.axes:
        low, high = axes.get_xlim()
        assert -0.5 < low < 0.0
        assert 4.0 < high < 4.5
        assert all(tick == round(tick) for tick in axes.get_xticks())


def test_nothing_printed_has_curves_all_the_same() -> None:
    run = printed(count=1)
    run["std"] = run["std"] * 0.0
    _, spread, _ = layers({"a": run.drop_vars("pattern")}).axes
    assert spread.get_yscale() == "linear"


def test_divergence_is_that_of_the_shadow_and_its_alarms_are_ringed() -> None:
    run = printed()
    run["growth_divergence"] = ("layer", [np.nan, 1e-6, 4e-6, 2e-6, 1e-6])
    run["surface_divergence"] = ("layer", [np.nan, 1e-6, 5e-6, 6e-6, 7e-6])
    run["shadow_status"] = ("layer", [0, 0, 4, 3, 0])
    figure = divergence({"bare": printed(), "shadowed": run})
    growth, surface = figure.axes
    np.testing.assert_allclose(values(labelled(growth)["shadowed"])[1], [np.nan, 1, 4, 2, 1], rtol=1e-9)
    assert "bare" not in labelled(growth)
    np.testing.assert_allclose(values(surface.lines[0]), np.stack([np.arange(5.0), [np.nan, 1, 5, 6, 7]]), rtol=1e-9)
    (rings,) = [line for line in growth.lines if line.get_markersize() == 9]
    np.testing.assert_allclose(values(rings), [[2, 3], [4, 2]], rtol=1e-9)
    assert same_color(rings.get_markeredgecolor(), "black")
    assert (growth.get_ylabel(), surface.get_ylabel()) == ("of the layer [µm]", "of the surface [µm]")
    assert growth.get_title() == "rms over the part of scan minus the shadow's model"
    assert (surface.get_xlabel(), growth.get_ylim()[0], surface.get_ylim()[0]) == ("layer", 0.0, 0.0)


def test_surfaces_are_named_with_their_figures_and_on_one_height() -> None:
    high, low = printed(-3.0), printed(8.0)
    alone = surfaces({"a": high})
    assert alone.axes[0].get_zlabel() == "height [µm]"  # type: ignore[attr-defined]
    assert alone.axes[0].get_zlim() == pytest.approx((0.0, 28.0 * 1.02), rel=0.03, abs=0.0)  # type: ignore[attr-defined]
    title = f"a\nmean error {float(high.mean_error[-1]) * 1e6:.2f}, std {float(high['std'][-1]) * 1e6:.2f} µm"
    assert [text.get_text() for text in alone.texts] == [title, "heights in µm, stretched x 11"]  # 0.45 * 700 / 28
    pair = surfaces({"low": low, "high": high, "b": low, "fourth": low})
    assert [text.get_text().partition("\n")[0] for text in pair.texts[:-1]] == ["low", "high", "b"]
    panels: list[Any] = pair.axes[:3]
    assert {axes.get_zlim() for axes in panels} == {alone.axes[0].get_zlim()}  # type: ignore[attr-defined]
    assert {axes.get_zlabel() for axes in panels} == {""}
    lefts = [axes.get_position().x0 for axes in panels]
    assert lefts == sorted(lefts)
    assert np.diff([*lefts, pair.axes[3].get_position().x0]).min() > 0.25  # side by side, then the scale
    for axes, text in zip(panels, pair.texts, strict=False):
        assert text.get_position()[0] == pytest.approx(
            axes.get_position().x0 + axes.get_position().width / 2, rel=1e-6, abs=0.0
        )
    assert [(axes.get_xlabel(), axes.get_ylabel()) for axes in panels] == [("x [mm]", "y [mm]")] * 3


def test_hardware_is_compared_with_the_model_layer_by_layer() -> None:
    run = printed(count=9)
    maps = np.stack([np.full((NX, NY), layer * 1e-6) for layer in range(10)])
    rows = tuple(
        LayerDifference(layer, 1e-6 * layer, 2e-6 * layer, 3e-6 * layer, -4e-6 * layer, (2, 3)) for layer in range(10)
    )
    figure = hardware_against_model(run, ModelDifference("shadow's model", maps, rows), "bench")
    *shown, curves, _ = sorted(figure.axes, key=lambda axes: axes.get_label() == "<colorbar>")
    assert [axes.get_title() for axes in shown] == ["layer 1", "layer 4", "layer 6", "layer 9"]
    for axes in shown:
        layer = int(axes.get_title().split()[1])
        (image,) = axes.get_images()
        np.testing.assert_allclose(np.asarray(image.get_array()), layer, rtol=1e-9)
        red, _, blue, _ = image.to_rgba(np.array(1.0 * layer))
        assert red > blue  # hardware is higher
    lines = {name: values(line)[1, 5] for name, line in labelled(curves).items()}
    found = rows[5]
    expected = {
        "mean": found.mean,
        "rms": found.rms,
        "rms of the layer's growth": found.growth,
        "worst cell": found.worst,
    }
    assert lines == pytest.approx({name: 1e6 * value for name, value in expected.items()}, rel=1e-9, abs=0.0)
    np.testing.assert_array_equal(values(labelled(curves)["mean"])[0], np.arange(10))
    assert curves.get_ylabel() == "hardware minus model [µm]\n(hardware higher +, lower -)"
    assert curves.get_xlabel() == "layer"
    titles = [sub.get_suptitle() for sub in figure.subfigs]
    assert titles[0] == "bench: hardware minus shadow's model"


def test_cut_in_two_inks_has_the_colour_of_each_ink_between_its_bounds() -> None:
    run = printed(0.0, count=2)
    heights = np.array([0.0, 10e-6, 20e-6])[:, None, None] * run.mask.values
    run["height"] = (("layer", "x", "y"), heights)
    ink = np.zeros((3, NX, NY), np.int8)
    ink[1, 1:3], ink[1, 3:5], ink[2] = 1, 2, 2
    run["ink"] = (("layer", "x", "y"), ink)
    for name, bound in (("region_bottom", 0.0), ("region_top", 12e-6)):
        run[name] = (("interval", "x", "y"), np.full((1, NX, NY), bound))
    figure = materials(run, "print")
    (axes,) = figure.axes
    (image,) = axes.get_images()
    colours = image.to_rgba(np.ma.asarray(image.get_array()))
    level = 5 * colours.shape[0] // 21  # 5 um
    (box,) = figure.legends
    legend = {patch.get_label(): patch for patch in box.get_patches()}
    assert [text.get_text() for text in box.get_texts()] == ["ink A", "ink B", "bounds of ink A\nin the part"]
    assert list(legend) == ["ink A", "ink B"]
    assert same_color(colours[level, 2], legend["ink A"].get_facecolor())
    assert same_color(colours[level, 3], legend["ink B"].get_facecolor())
    assert same_color(colours[3 * level, 2], legend["ink B"].get_facecolor())
    assert colours[level, 0, 3] == colours[level, 5, 3] == 0.0  # nothing there
    assert image.get_extent() == pytest.approx((-0.05, 0.65, 0.0, 21.0), rel=1e-9, abs=0.0)  # as whole steps
    bottom, top = (values(line)[1] for line in axes.lines)
    np.testing.assert_allclose(bottom, [np.nan, 0, 0, 0, 0, np.nan, np.nan], atol=1e-12)
    np.testing.assert_allclose(top, [np.nan, 12, 12, 12, 12, np.nan, np.nan], rtol=1e-9)
    assert axes.get_title() == "print: cut at y = 0.20 mm"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [mm]", "height [µm]")
    assert axes.get_ylim() == pytest.approx((0.0, 1.04 * 21.0), rel=1e-9, abs=0.0)


def test_run_has_the_pictures_that_it_has_data_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: dict[str, Any] = {}
    for name in ("surfaces", "cross_section", "error_map", "layers", "divergence", "hardware_against_model"):
        monkeypatch.setattr(run_pictures, name, lambda *what, name=name: drawn.setdefault(str(what), Figure((1, 1))))
    run = Result(printed(), {})
    shadowed = Result(printed().assign(growth_divergence=("layer", np.zeros(5))), {})
    alone = {"surface", "cross-section", "error-map", "layers"}
    assert set(run_pictures.pictures({"a": run})) == alone
    assert set(run_pictures.pictures({"a": run, "b": run})) == alone | {"open-against-closed"}
    assert set(run_pictures.pictures({"a": shadowed})) == alone | {"divergence"}
    difference = ModelDifference("model", np.zeros((1, NX, NY)), ())
    run_pictures.draw(tmp_path, {"costs 3 $ and 4 $": run}, difference, ("svg",))
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.svg" for name in alone | {"hardware-against-model"}}
    assert any(r"costs 3 \\$ and 4 \\$" in what for what in drawn)  # no formula


def test_maps_are_thinned_in_their_middle() -> None:
    every = np.arange(100.0).reshape(10, 10)
    assert plot.thinned(every, 10) is not None
    assert plot.thinned(every, 10).shape == (10, 10)
    np.testing.assert_array_equal(plot.thinned(every, 4)[:, 0], [11.0, 41.0, 71.0])


def test_scale_says_its_ends_and_its_label() -> None:
    figure = Figure()
    plot.add_scale(figure, ScalarMappable(Normalize(-1.0, 1.0), plot.ERROR_COLOURS), ax=figure.subplots())
    bar: Any = figure.axes[1]
    assert bar.get_ylabel() == "error [µm]"
    high, low = bar.texts
    assert (high.get_text(), high.xy) == ("too low", (0.5, 1.0))
    assert (low.get_text(), low.xy) == ("too high", (0.5, 0.0))


def test_last_point_of_a_line_is_full_and_its_marks_are_hollow() -> None:
    axes = Figure().subplots()
    plot.draw_line(axes, 1, [1, 2, 3], [4.0, 5.0, 6.0], "run")
    line, end = axes.lines
    assert values(end).tolist() == [[3.0], [6.0]]
    assert (line.get_label(), line.get_markerfacecolor()) == ("run", "white")
    assert same_color(end.get_markerfacecolor(), line.get_color())
    assert end.get_marker() == line.get_marker() != plot.MARKS[0]
    plot.draw_line(axes, 0, [1, 2], [1.0, 2.0], ends=False)
    assert len(axes.lines) == 3
