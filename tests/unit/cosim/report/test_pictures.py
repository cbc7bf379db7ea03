"""Pictures of a run: each line, bar and label against its figures; an error is target minus height, red is too high."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, Mock

import numpy as np
import pytest
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import AsinhNorm, Normalize, same_color
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates

from inkloop.report import pictures, plot, solid_picture, surface_picture
from inkloop.report.layer_curves import cross_section, divergence, layers
from inkloop.report.model_difference import LayerDifference, ModelDifference
from inkloop.report.pictures import comparison, error_map, hardware_against_model
from inkloop.report.solid_picture import FRAME, LIGHT, SMOOTHING_VOXELS, SOLID_UPRIGHT, materials, solids, view
from inkloop.report.surface_picture import surfaces
from inkloop.results.metrics import masked_error
from inkloop.results.result import Result
from inkloop.results.solid import ink_error, voxels
from support.toys import toy_result

PITCH, NX, NY = 100e-6, 7, 5
SIGN = "too low +, too high -"


def run_of(mask: Any, heights: Any, target: Any, **more: Any) -> xr.Dataset:
    """A run with these heights (layers, x, y)."""
    errors = [masked_error(height, target, mask) for height in heights]
    axes = {name: np.arange(count) * PITCH for name, count in zip("xy", mask.shape, strict=True)}
    return xr.Dataset(
        {
            "height": (("layer", "x", "y"), np.stack(heights)),
            "target_height": (("x", "y"), target),
            "mask": (("x", "y"), mask),
            "mean_error": ("layer", [error.mean_error for error in errors]),
            "std": ("layer", [error.std for error in errors]),
            **more,
        },
        coords={"layer": np.arange(len(heights)), **axes},
        attrs={"pitch": PITCH},
    )


def printed(lack_um: float = 2.0, count: int = 4) -> xr.Dataset:
    """A part 20 um high of 4 x 3 cells, neither square nor in the middle of the grid, after `count` layers.

    It lacks `lack_um`; the cell (2, 3) is 5 um higher. Layer n has n droplets.
    """
    mask = np.zeros((NX, NY), np.bool_)
    mask[1:5, 1:4] = True
    heights = [np.where(mask, (20.0 - lack_um) * 1e-6 * layer / count, 0.0) for layer in range(count + 1)]
    heights[-1][2, 3] += 5e-6
    pattern = np.zeros((count + 1, NX, NY), np.int32)
    for layer in range(1, count + 1):
        pattern[layer, 1 : 1 + layer, 2] = 1 + layer % 2
    return run_of(mask, heights, np.where(mask, 20e-6, 0.0), pattern=(("layer", "x", "y"), pattern))


def slab(nx: int, ny: int) -> xr.Dataset:
    """A slab 50 um high on all cells but two rows at the rim, 3 um too low."""
    mask = np.zeros((nx, ny), np.bool_)
    mask[2:-2, 2:-2] = True
    return run_of(mask, [np.zeros((nx, ny)), np.where(mask, 47e-6, 0.0)], np.where(mask, 50e-6, 0.0))


def in_two_inks() -> xr.Dataset:
    """A print of layers of A and B, 20 um each, where A is wanted up to 24 um."""
    flat = slab(12, 8)
    height = np.cumsum([np.zeros((12, 8)), *[np.where(flat.mask, 20e-6, 0.0)] * 2], axis=0)
    ink = np.broadcast_to(np.array([0, 1, 2], np.int8)[:, None, None], height.shape)
    bounds = np.broadcast_to(np.array([0.0, 24e-6])[:, None, None, None], (2, 1, 12, 8))
    run = run_of(flat.mask.values, list(height), flat.target_height.values, mismatch=0.2)
    run = run.assign(ink=(("layer", "x", "y"), ink), pattern=(("layer", "x", "y"), ink.astype(np.int32)))
    return run.assign(
        {n: (("interval", "x", "y"), b) for n, b in zip(("region_bottom", "region_top"), bounds, strict=True)}
    )


def difference(count: int = 3, shape: tuple[int, int] = (12, 8)) -> ModelDifference:
    """The hardware is one um a layer too high."""
    rows = (LayerDifference(n, 1e-6 * n, 2e-6 * n, 3e-6 * n, -4e-6 * n, (2, 3)) for n in range(count))
    return ModelDifference("shadow's model", np.stack([np.full(shape, n * 1e-6) for n in range(count)]), tuple(rows))


def values(line: Any) -> Any:
    """x and y of the points of a line, (2, K)."""
    return np.array(line.get_data(), np.float64)


def labelled(axes: Any) -> dict[Any, Any]:
    """Label -> line, of those with a label."""
    return {line.get_label(): line for line in axes.lines if not line.get_label().startswith("_")}


def image_of(axes: Any) -> tuple[Any, Any]:
    """The one image of axes, and its values with NaN."""
    (image,) = axes.get_images()
    return image, np.ma.filled(np.ma.asarray(image.get_array()), np.nan)


def legend_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_error_map_has_places_in_millimetres_and_counts_every_cell() -> None:
    run = printed()
    figure = error_map(run, "closed loop")
    plane, counts, scale = figure.axes
    assert figure.get_suptitle() == f"closed loop: mean error {run.mean_error[-1] * 1e6:.2f}, std {1.38:.2f} µm"
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("x [mm]", "y [mm]")
    image, shown = image_of(plane)
    extent = pytest.approx((-0.05, 0.65, -0.05, 0.45), rel=1e-9, abs=0.0)
    assert image.get_extent() == [*plane.get_xlim(), *plane.get_ylim()] == extent
    assert (shown.shape, image.origin) == ((NY, NX), "lower")  # rows along y, from below
    assert shown[3, 2] == pytest.approx(-3.0, rel=1e-9, abs=0.0)
    assert np.isfinite(shown).sum() == 12
    assert np.nanmean(shown) == pytest.approx(float(run.mean_error[-1]) * 1e6, rel=1e-9, abs=0.0)
    red, _, blue, _ = image.to_rgba(np.ma.asarray(image.get_array()))[3, 2]
    assert red > blue  # too high
    patches: Any = counts.patches
    heights = {round(patch.get_x() + patch.get_width() / 2, 3): patch.get_height() for patch in patches}
    assert {x: n for x, n in heights.items() if n} == {-2.927: 1.0, 2.049: 11.0}
    assert patches[0].get_x() == pytest.approx(-3.0, rel=1e-9, abs=0.0)
    assert (counts.get_ylabel(), counts.get_xlabel()) == ("cells", f"error [µm] ({SIGN})")
    assert [text.get_text() for text in scale.texts] == ["too low", "too high\n(dots)"]
    assert image.norm.vmax == -image.norm.vmin == pytest.approx(3.0, rel=0.05, abs=0.0)


def test_comparison_has_one_scale_and_the_figures_of_each_run_above_its_map() -> None:
    runs = {"closed": printed(0.5), "open": printed(8.0)}
    first, second, _, mean, spread, droplets = comparison(runs).axes
    for axes, (name, run) in zip((first, second), runs.items(), strict=True):
        mean_um, std_um = (float(run[each][-1]) * 1e6 for each in ("mean_error", "std"))
        assert axes.get_title() == f"{name}\nmean error {mean_um:.2f}\nstd {std_um:.2f} µm"
        assert np.nanmean(image_of(axes)[1]) == pytest.approx(mean_um, rel=1e-9, abs=0.0)
    norms = [image_of(axes)[0].norm for axes in (first, second)]
    assert norms[0] is norms[1]
    assert isinstance(norms[0], AsinhNorm)
    assert (first.get_ylabel(), second.get_ylabel(), second.get_xlabel()) == ("y [mm]", "", "x [mm]")
    titles = [f"mean error [µm]\n({SIGN})", "std over the part [µm]", "droplets of the layer"]
    assert [axes.get_title() for axes in (mean, spread, droplets)] == titles
    assert [axes.get_xlabel() for axes in (mean, spread, droplets)] == ["layer"] * 3
    assert list(labelled(mean)) == ["closed", "open"]


def test_dots_tell_too_high_from_too_low_in_grey_print() -> None:
    """One dot in the middle of each cell that is clearly red, whatever the map; on fine grids one for a block."""
    run = printed(1.0)
    for figure in (error_map(run, "a"), comparison({"a": run})):
        (axes,) = [axes for axes in figure.axes if axes.get_images()]
        (dots,) = axes.collections
        place = [[run.x[2] * 1e3, run.y[3] * 1e3]]
        np.testing.assert_allclose(np.asarray(dots.get_offsets()), place, rtol=1e-9, atol=1e-12)
    fine = np.full((4 * plot.DOTS, plot.DOTS), np.nan)
    fine[8:16, :8] = -1.0
    fine[20:24, :8] = 1.0
    axes = Figure().subplots()
    plot.draw_error(axes, fine, (0.0, 4.0, 0.0, 1.0), plot.error_norm([fine]))
    found = np.asarray(axes.collections[0].get_offsets()) * plot.DOTS
    assert found.tolist() == [[10.0, 2.0], [10.0, 6.0], [14.0, 2.0], [14.0, 6.0]]


def test_scale_reaches_the_largest_error_and_tells_the_smallest() -> None:
    one = plot.error_norm([np.array([[-4.0, 1.0], [np.nan, 2.0]])])
    assert (one.vmin, one.vmax) == (pytest.approx(-4.0, rel=0.05, abs=0.0), pytest.approx(4.0, rel=0.05, abs=0.0))
    assert type(one) is Normalize
    both = plot.error_norm([np.full((3, 3), 0.4), np.full((3, 3), -20.0)])
    assert isinstance(both, AsinhNorm)
    assert (both.vmin, both.vmax, both.linear_width) == pytest.approx((-20.0, 20.0, 0.2), rel=1e-9, abs=0.0)
    assert plot.error_norm([np.zeros((2, 2))]).vmax == 1e-3
    exact = plot.error_norm([np.zeros((3, 3)), np.full((3, 3), 0.3), np.full((3, 3), 12.0)])
    assert 2 * exact(0.3) - 1 < 0.5  # an exact run leaves 0.3 of 12 µm pale
    every = np.arange(100.0).reshape(10, 10)
    np.testing.assert_array_equal(plot.thinned(every, 4)[:, 0], [11.0, 41.0, 71.0])


@pytest.mark.parametrize(
    ("scales", "shown"),
    [
        ((0.3, 0.6), [-0.5, 0.0, 0.5]),
        ((0.4, 26.0), [-10.0, -1.0, 0.0, 1.0, 10.0]),  # 20 is too near to 10
        ((0.4, 60.0), [-50.0, -10.0, -1.0, 0.0, 1.0, 10.0, 50.0]),
        ((150.0, 260.0), [-200.0, -100.0, 0.0, 100.0, 200.0]),
    ],
)
def test_scale_has_ticks_besides_zero_and_says_its_ends_and_its_label(scales: Any, shown: list[float]) -> None:
    figure, numbers = Figure(), np.random.default_rng(2)
    norm = plot.error_norm([numbers.uniform(-scale, scale, (30, 30)) for scale in scales])
    plot.add_scale(figure, ScalarMappable(norm, plot.ERROR_COLOURS), ax=figure.subplots())
    bar: Any = figure.axes[1]
    assert bar.get_yticks().tolist() == pytest.approx(shown, rel=1e-9, abs=0.0)
    assert bar.get_ylabel() == "error [µm]"
    assert [(text.get_text(), text.xy) for text in bar.texts] == [("too low", (0.5, 1.0)), ("too high", (0.5, 0.0))]


def test_cut_shows_layers_target_and_error_along_the_middle_of_the_part() -> None:
    figure = cross_section({"closed": printed(2.0), "open": printed(-3.0)})
    whole, top = figure.axes
    x = np.arange(NX) * 0.1
    target, high = ([0.0, *[um] * 4, 0.0, 0.0] for um in (20.0, 23.0))
    grey = [line for line in whole.lines if same_color(line.get_color(), "0.75")]
    assert [float(values(line)[1, 2]) for line in grey] == pytest.approx([0.0, 4.5, 9.0, 13.5], rel=1e-9, abs=1e-12)
    np.testing.assert_allclose(values(labelled(whole)["target"]), np.stack([x, target]), atol=1e-9)
    np.testing.assert_allclose(values(labelled(whole)["open"]), np.stack([x, high]), atol=1e-9)
    assert list(labelled(whole)) == ["closed, every layer", "target", "closed", "open"] == legend_of(figure)
    assert whole.get_title() == "cut at y = 0.20 mm"
    assert (whole.get_ylabel(), top.get_ylabel()) == ("height [µm]", f"error [µm]\n({SIGN})")
    assert (top.get_xlabel(), whole.get_ylim()[0]) == ("x [mm]", 0.0)
    np.testing.assert_allclose(values(top.lines[0]), np.stack([x[1:5], [2.0] * 4]), rtol=1e-9)  # the part alone
    np.testing.assert_allclose(values(top.lines[1]), np.stack([x[1:5], [-3.0] * 4]), rtol=1e-9)
    many = cross_section({"a": printed(count=25)}).axes[0]
    grey = [line for line in many.lines if same_color(line.get_color(), "0.75")]
    assert [round(float(values(line)[1, 2]) / 18.0 * 25) for line in grey] == list(range(0, 25, 2))
    assert grey[0].get_label() == "a, every 2 layers"


@pytest.mark.parametrize(
    ("lacks", "limit", "words"),
    [
        ((2.0, -3.0), 3.6, ""),
        ((2.0, 15.0), 2.4, "run 1: 15 µm too low, outside the frame"),
        ((0.2, -30.0), 0.24, "run 1: 30 µm too high, outside the frame"),
        ((15.0,), 18.0, ""),
        ((0.0,), 0.1, ""),
    ],
)
def test_frame_of_the_cut_is_that_of_the_runs_that_are_near(lacks: Any, limit: float, words: str) -> None:
    _, top = cross_section({f"run {k}": printed(lack) for k, lack in enumerate(lacks)}).axes
    assert top.get_ylim() == pytest.approx((-limit, limit), rel=1e-9, abs=0.0)
    assert top.get_title(loc="left") == words
    assert np.unique(np.asarray(top.lines[-1].get_ydata())).tolist() == [0.0]  # the line of no error


def test_layers_are_numbered_and_their_figures_are_those_of_the_table() -> None:
    runs = {"closed": printed(0.5), "open": printed(-130.0)}
    figure = layers(runs)
    mean, spread, droplets = figure.axes
    assert legend_of(figure) == ["closed", "open"]
    assert mean.get_ylabel() == f"mean error [µm]\n({SIGN})"
    assert [axes.get_ylabel() for axes in (spread, droplets)] == ["std over the part [µm]", "droplets"]
    assert droplets.get_xlabel() == "layer"
    np.testing.assert_allclose(
        values(labelled(mean)["closed"]), np.stack([np.arange(5), runs["closed"].mean_error * 1e6])
    )
    np.testing.assert_allclose(
        values(spread.lines[0]), np.stack([np.arange(1, 5), runs["closed"]["std"][1:] * 1e6]), rtol=1e-9
    )
    np.testing.assert_array_equal(values(droplets.lines[0]), [[1, 2, 3, 4], [1, 2, 3, 4]])
    assert droplets.get_ylim()[0] == 0.0
    assert (mean.get_yscale(), spread.get_yscale()) == ("symlog", "log")
    assert mean.get_yticks().tolist() == [-1000.0, -100.0, -10.0, -1.0, 0.0, 1.0, 10.0, 100.0]  # of 20 to -130 um
    for axes in figure.axes:
        low, high = axes.get_xlim()
        assert -0.5 < low < 0.0 < 4.0 < high < 4.5
        assert all(tick == round(tick) for tick in axes.get_xticks())
    nothing = printed(count=1)
    nothing["std"] = nothing["std"] * 0.0
    assert layers({"a": nothing.drop_vars("pattern")}).axes[1].get_yscale() == "linear"


def test_divergence_is_that_of_the_shadow_and_its_alarms_are_ringed() -> None:
    run = printed()
    run["growth_divergence"] = ("layer", [np.nan, 1e-6, 4e-6, 2e-6, 1e-6])
    run["surface_divergence"] = ("layer", [np.nan, 1e-6, 5e-6, 6e-6, 7e-6])
    run["shadow_status"] = ("layer", [0, 0, 4, 3, 0])
    growth, surface = divergence({"bare": printed(), "shadowed": run}).axes
    np.testing.assert_allclose(values(labelled(growth)["shadowed"])[1], [np.nan, 1, 4, 2, 1], rtol=1e-9)
    assert "bare" not in labelled(growth)
    np.testing.assert_allclose(values(surface.lines[0]), np.stack([np.arange(5.0), [np.nan, 1, 5, 6, 7]]), rtol=1e-9)
    (rings,) = [line for line in growth.lines if line.get_markersize() == 9]
    np.testing.assert_allclose(values(rings), [[2, 3], [4, 2]], rtol=1e-9)
    assert (growth.get_ylabel(), surface.get_ylabel()) == ("of the layer [µm]", "of the surface [µm]")
    assert growth.get_title() == "rms over the part of scan minus the shadow's model"
    assert (surface.get_xlabel(), growth.get_ylim()[0], surface.get_ylim()[0]) == ("layer", 0.0, 0.0)


def test_surfaces_are_named_with_their_figures_and_on_one_height() -> None:
    high, low = printed(-3.0), printed(8.0)
    alone = surfaces({"a": high})
    single: Any = alone.axes[0]
    assert single.get_zlabel() == "height [µm]"
    assert single.get_zlim() == pytest.approx((0.0, 28.0 * 1.02), rel=0.03, abs=0.0)
    title = f"a\nmean error {float(high.mean_error[-1]) * 1e6:.2f}, std {float(high['std'][-1]) * 1e6:.2f} µm"
    assert [text.get_text() for text in alone.texts] == [title, "heights in µm, stretched x 11"]  # 0.45 * 700 / 28
    assert [text.get_text() for text in alone.axes[-1].texts] == ["too low", "too high"]
    pair = surfaces({"low": low, "high": high, "b": low, "fourth": low})
    assert [text.get_text().partition("\n")[0] for text in pair.texts[:-1]] == ["low", "high", "b"]
    panels: list[Any] = pair.axes[:3]
    assert {axes.get_zlim() for axes in panels} == {single.get_zlim()}
    assert {axes.get_zlabel() for axes in panels} == {""}
    boxes = [axes.get_position() for axes in panels]
    assert np.diff([*(box.x0 for box in boxes), pair.axes[3].get_position().x0]).min() > 0.25  # side by side
    middles = [box.x0 + box.width / 2 for box in boxes]
    assert [text.get_position()[0] for text in pair.texts[:3]] == pytest.approx(middles, rel=1e-6, abs=0.0)
    assert [(axes.get_xlabel(), axes.get_ylabel()) for axes in panels] == [("x [mm]", "y [mm]")] * 3
    (solid,) = [
        each
        for axes in surfaces({"a": printed(1.0)}).axes
        for each in axes.collections
        if isinstance(each, PolyCollection) and len(each.get_facecolor()) > 35
    ]
    redder = np.asarray(solid.get_facecolor())[:, 0] - np.asarray(solid.get_facecolor())[:, 2]
    assert ((redder > 0.2).sum(), (redder < -0.01).sum()) == (1, 11)  # too high, too low


@pytest.mark.parametrize(("nx", "ny"), [(40, 12), (250, 60), (60, 401)])
def test_surface_of_any_grid_has_its_shape_and_coloured_tops_only(
    nx: int, ny: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    painted = Mock()

    def plot_surface(axes: Any, *corners: Any, rstride: int, cstride: int, **_: Any) -> Mock:
        assert (rstride, cstride) == (1, 1)  # every face, whatever the size
        drawn.append((axes, corners))
        return painted

    monkeypatch.setattr(Axes3D, "plot_surface", plot_surface)
    surfaces({"a": slab(nx, ny)})
    ((axes, (x, y, z)),) = drawn
    ((flat,), _) = painted.set_facecolor.call_args
    colours = flat.reshape(z.shape[0] - 1, z.shape[1] - 1, 4)
    assert (painted.set_edgecolor.call_args[0][0] == flat).all()  # else there are seams
    width, depth, _ = axes._box_aspect
    assert depth / width == pytest.approx(ny / nx, rel=1e-12, abs=0.0)
    assert (np.ptp(x), np.ptp(y)) == pytest.approx((nx * PITCH * 1e3, ny * PITCH * 1e3), rel=1e-12, abs=0.0)
    corners = np.stack([z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]])
    is_top = np.zeros(colours.shape[:2], np.bool_)
    is_top[::2, ::2] = True  # plates and walls alternate
    assert (np.ptp(corners, axis=0)[is_top] == 0.0).all()
    is_blue = colours[..., 2] - colours[..., 0] > 0.2
    assert is_blue[is_top & (corners[0] > 46.9)].all()
    assert not is_blue[~is_top].any()
    assert max(colours.shape[:2]) < 2 * surface_picture.PLATES


def test_hardware_is_compared_with_the_model_layer_by_layer() -> None:
    found = difference(10, (NX, NY))
    figure = hardware_against_model(printed(count=9), found, "bench")
    *shown, curves, _ = sorted(figure.axes, key=lambda axes: axes.get_label() == "<colorbar>")
    assert [axes.get_title() for axes in shown] == ["layer 1", "layer 4", "layer 6", "layer 9"]
    for axes in shown:
        layer = int(axes.get_title().split()[1])
        image, error = image_of(axes)
        np.testing.assert_allclose(error, layer, rtol=1e-9)
        red, _, blue, _ = image.to_rgba(np.array(1.0 * layer))
        assert red > blue  # hardware is higher
        assert len(np.asarray(axes.collections[0].get_offsets())) == (NX * NY if layer > 3 else 0)
    lines = {name: values(line)[1, 5] for name, line in labelled(curves).items()}
    row = found.rows[5]
    expected = {"mean": row.mean, "rms": row.rms, "rms of the layer's growth": row.growth, "worst cell": row.worst}
    assert lines == pytest.approx({name: 1e6 * value for name, value in expected.items()}, rel=1e-9, abs=0.0)
    np.testing.assert_array_equal(values(labelled(curves)["mean"])[0], np.arange(10))
    assert curves.get_ylabel() == "hardware minus model [µm]\n(hardware higher +, lower -)"
    assert curves.get_xlabel() == "layer"
    assert figure.subfigs[0].get_suptitle() == "bench: hardware minus shadow's model"


def test_cut_in_two_inks_has_the_colour_of_each_ink_between_its_bounds() -> None:
    run = printed(0.0, count=2)
    run["height"] = (("layer", "x", "y"), np.array([0.0, 10e-6, 20e-6])[:, None, None] * run.mask.values)
    ink = np.zeros((3, NX, NY), np.int8)
    ink[1, 1:3], ink[1, 3:5], ink[2] = 1, 2, 2
    run["ink"] = (("layer", "x", "y"), ink)
    for name, bound in (("region_bottom", 0.0), ("region_top", 12e-6)):
        run[name] = (("interval", "x", "y"), np.full((1, NX, NY), bound))
    figure = materials(run, "print")
    (axes,) = figure.axes
    image, _ = image_of(axes)
    colours = image.to_rgba(np.ma.asarray(image.get_array()))
    level = 5 * colours.shape[0] // 21  # 5 um
    legend = {patch.get_label(): patch for patch in figure.legends[0].get_patches()}
    assert legend_of(figure) == ["ink A", "ink B", "bounds of ink A\nin the part"]
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


@pytest.fixture
def coarse_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solids are seen in fewer pixels than in print."""
    monkeypatch.setattr(solid_picture, "PIXELS", 60)
    monkeypatch.setattr(solid_picture, "STEPS", 60)


@pytest.mark.usefixtures("coarse_view")
def test_solid_shows_how_long_its_sides_are_and_its_error_where_it_is_seen() -> None:
    run = in_two_inks()
    figure, levels = solids({"a": run}), voxels(run).shape[2]
    assert any("error of ink A" in axes.get_ylabel() for axes in figure.axes)
    assert [text.get_text() for text in figure.axes[0].texts] == ["0.2 mm", "0.2 mm", "10 µm"]  # of 1.2 mm, 48 um
    bars = [np.ptp(np.array(line.get_data()), axis=1) for line in figure.axes[0].lines]
    assert bars[2][0] == pytest.approx(0.0, abs=1e-9)  # upright
    share = np.hypot(*bars[2]) / (view(np.ones((12, 8, levels), np.bool_), SOLID_UPRIGHT).axes[2, 1] * SOLID_UPRIGHT)
    assert share == pytest.approx(10.0 / levels, rel=1e-6, abs=0.0)
    seen = view(voxels(run) == 1, SOLID_UPRIGHT)
    found, expected = solid_picture._seen_error(run, seen), ink_error(run) * 1e6
    np.testing.assert_array_equal(np.isnan(found), np.isnan(seen.brightness))
    assert 1.0 < np.abs(expected).max() < 1000.0
    for row, column in np.argwhere(~np.isnan(seen.brightness))[::97]:
        i, j, k = seen.voxel[row, column]
        assert found[row, column] == pytest.approx(expected[i, j, k], rel=1e-9, abs=0.0)


@pytest.mark.parametrize(("error_um", "is_of_a_layer"), [(0.5, True), (500.0, False)])
def test_error_below_a_layer_is_not_darkest_in_a_solid(
    error_um: float, is_of_a_layer: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the tip of a part that is right to a droplet looks as wrong as can be."""
    run = in_two_inks()
    monkeypatch.setattr(solid_picture, "_seen_error", lambda _, seen: np.full(seen.brightness.shape, error_um))
    bars: list[Any] = []
    monkeypatch.setattr(solid_picture, "add_scale", lambda _, colours, *words, **place: bars.append(colours.norm.vmax))
    solid_picture.solids({"a": run})
    layer = float(np.ptp(run.height[:2].values, axis=0).max()) * 1e6
    assert 1.0 < layer < 100.0
    assert bars == [pytest.approx(layer if is_of_a_layer else error_um, rel=1e-9, abs=0.0)]


def test_run_has_the_pictures_that_it_has_data_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: dict[str, Any] = {}
    for name in ("surfaces", "cross_section", "error_map", "layers", "divergence", "hardware_against_model"):
        monkeypatch.setattr(pictures, name, lambda *what, name=name: drawn.setdefault(str(what), Figure((1, 1))))
    run = Result(printed(), {})
    shadowed = Result(printed().assign(growth_divergence=("layer", np.zeros(5))), {})
    alone = {"surface", "cross-section", "error-map", "layers"}
    assert set(pictures.pictures({"a": run})) == alone
    assert set(pictures.pictures({"a": run, "b": run})) == alone | {"open-against-closed"}
    assert set(pictures.pictures({"a": shadowed})) == alone | {"divergence"}
    pictures.draw(tmp_path, {"costs 3 $ and 4 $": run}, difference(), ("svg",))
    assert {path.name for path in tmp_path.iterdir()} == {f"{name}.svg" for name in alone | {"hardware-against-model"}}
    assert any(r"costs 3 \\$ and 4 \\$" in what for what in drawn)  # no formula


def test_lines_that_coincide_are_told_apart_by_their_marks() -> None:
    axes = Figure().subplots()
    for number in range(len(plot.MARKS)):
        plot.draw_line(axes, number, np.arange(60), np.ones(60), "run")
    lines, ends = axes.lines[::2], axes.lines[1::2]
    assert len({line.get_marker() for line in lines}) == len({line.get_color() for line in lines}) == len(lines)
    places = [place for line in lines for place in np.atleast_1d(np.asarray(line.get_markevery()))]
    assert len(places) == len(set(places)) > len(plot.MARKS)
    for line, end in zip(lines, ends, strict=True):  # the last point is full, the marks are hollow
        assert values(end).tolist() == [[59.0], [1.0]]
        assert (line.get_label(), line.get_markerfacecolor(), end.get_marker()) == ("run", "white", line.get_marker())
        assert same_color(end.get_markerfacecolor(), line.get_color())
    plot.draw_line(axes, 0, [1, 2], [1.0, 2.0], ends=False)
    assert len(axes.lines) == 2 * len(plot.MARKS) + 1


def test_scales_are_round_although_values_are_rounded() -> None:
    assert [plot.round_below(value) for value in (0.7 - 0.2, 0.49, 1.99, 2.0)] == pytest.approx(
        [0.5, 0.2, 1.0, 2.0], rel=1e-9, abs=0.0
    )


@pytest.mark.parametrize("label", ["closed loop, a long label", f"closed loop{', a label' * 6}"])
@pytest.mark.parametrize("count", [1, 5, 9])
def test_legend_fits_into_the_width_of_its_figure(count: int, label: str) -> None:
    figure = plot.new_figure(2.0)
    axes = figure.subplots()
    lines = [axes.plot([0, 1], label=f"{label} of run {k}")[0] for k in range(count)]
    plot.outside_legend(figure, lines, [str(line.get_label()) for line in lines])
    [legend] = figure.legends
    assert legend.get_window_extent().width <= figure.bbox.width
    assert len(legend.get_texts()) == count


def test_picture_is_written_in_each_format_with_the_same_bytes_each_time(tmp_path: Path) -> None:
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        found = plot.save(Figure((2.0, 1.0)), tmp_path / folder / "cut.png", ["svg", "pdf", "png"])
        assert found == [tmp_path / folder / f"cut.{form}" for form in ("svg", "pdf", "png")]
    for name, magic in {"cut.pdf": b"%PDF", "cut.png": b"\x89PNG", "cut.svg": b"<?xml"}.items():
        content = (tmp_path / "first" / name).read_bytes()
        assert content.startswith(magic)
        assert content == (tmp_path / "second" / name).read_bytes()
    with Image.open(tmp_path / "first" / "cut.png") as image:
        assert image.size == (400, 200)  # 200 dots per inch
    assert plot.save(Figure((1.0, 1.0)), tmp_path / "run.2", ("png",)) == [tmp_path / "run.2.png"]


def test_saved_picture_has_room_for_its_labels_and_is_drawn_once_a_format(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figure, drawn = plot.new_figure(2.0), []
    label = figure.subplots().set_ylabel("height", fontsize=40)
    assert label.get_window_extent().x0 < 0.0
    draw = label.draw
    monkeypatch.setattr(label, "draw", lambda renderer: (drawn.append(renderer), draw(renderer)))
    plot.save(figure, tmp_path / "cut", ["pdf", "png"])
    assert label.get_window_extent().x0 > 0.0
    assert len(drawn) == 2


def test_pdf_has_summary_pictures_and_scenario_on_its_pages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture, pdf = Figure((1.0, 1.0)), MagicMock()
    pdf.side_effect = lambda path, **_: path.write_bytes(b"%PDF") and pdf.return_value
    monkeypatch.setattr(pictures, "PdfPages", pdf)
    monkeypatch.setattr(pictures, "pictures", lambda runs: {"surface": picture})
    run, other = toy_result(), Result(toy_result().dataset.assign_attrs(scenario="another"), {})
    summary = "\n".join(["a" * 130, *[f"line {n}" for n in range(90)]])
    pictures.write_pdf(tmp_path / "report.pdf", {"main": run, "other": other}, summary)
    pages = [call.args[0] for call in pdf.return_value.__enter__.return_value.savefig.call_args_list]
    texts = [figure.texts[0].get_text() if figure.texts else "" for figure in pages]
    assert len(pages) == 4
    assert pages[2] is picture
    assert texts[0].split("\n")[:3] == ["a" * 120, "a" * 10, "line 0"]
    assert len(texts[0].split("\n")) == 88
    assert texts[1].split("\n") == [f"line {n}" for n in range(86, 90)]
    assert texts[3].strip() == run.scenario_text.strip()
    assert [path.name for path in tmp_path.iterdir()] == ["report.pdf"]


RANDOM = gaussian_filter(np.random.default_rng(0).random((9, 7, 24)), (1.0, 1.0, 3.0)) > 0.5
SOLIDS = {"block": np.ones((12, 8, 24), np.bool_), "random": RANDOM, "nothing": np.zeros((6, 6, 8), np.bool_)}


@pytest.mark.parametrize(("azimuth", "elevation"), [(-60.0, 32.0), (120.0, 5.0), (0.0, 90.0), (90.0, 0.0)])
@pytest.mark.parametrize("name", SOLIDS)
def test_every_pixel_is_that_of_a_ray_marched_through_the_whole_box(
    name: str, azimuth: float, elevation: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(solid_picture, "PIXELS", 40)
    monkeypatch.setattr(solid_picture, "STEPS", 60)
    solid = SOLIDS[name]
    seen = view(solid, 0.4, azimuth_deg=azimuth, elevation_deg=elevation)
    density = gaussian_filter(np.pad(solid, FRAME).astype(np.float32), SMOOTHING_VOXELS)
    size = np.array([*(np.array(solid.shape[:2]) / max(solid.shape[:2])), 0.4])
    a, e, half = np.radians(azimuth), np.radians(elevation), 0.5 * np.linalg.norm(size)
    camera = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    side, depth = np.linspace(-half, half, 40), np.linspace(half, -half, 60)
    rows, columns, depths = np.meshgrid(side, side, depth, indexing="ij")
    points = size / 2 + columns[..., None] * right + rows[..., None] * np.cross(camera, right)
    points = (points + depths[..., None] * camera) * ((np.array(density.shape) - 1) / size)
    inside = map_coordinates(density, np.moveaxis(points, -1, 0), order=1, cval=0.0) > 0.5
    first = inside.argmax(axis=-1)
    found = np.take_along_axis(points, first[..., None, None], axis=2)[:, :, 0].round() - FRAME
    expected = np.where(inside.any(axis=-1)[..., None], found, 0).clip(0, np.array(solid.shape) - 1)
    np.testing.assert_array_equal(np.isfinite(seen.brightness), inside.any(axis=-1))
    np.testing.assert_array_equal(seen.voxel, expected)


@pytest.mark.parametrize("rise", [1, 2])
def test_brightness_of_a_slope_is_that_of_its_angle_in_the_part_not_in_voxels(rise: int) -> None:
    """Of a plane that rises by so many voxels with each cell, seen from above."""
    cells, upright = 32, 0.4
    i, _, k = np.indices((cells, cells, (rise + 1) * cells))
    solid = k < cells // 2 + rise * i
    x, _, z = (np.array(solid.shape) + 2 * FRAME - 1) / (1.0, 1.0, upright)
    normal = np.array([-rise * x / z, 0.0, 1.0])
    light = np.array(LIGHT)
    expected = 0.3 + 0.7 * normal @ light / np.linalg.norm(normal) / np.linalg.norm(light)
    middle = slice(solid_picture.PIXELS * 2 // 5, solid_picture.PIXELS * 3 // 5)
    seen = view(solid, upright, azimuth_deg=0.0, elevation_deg=90.0).brightness[middle, middle]
    assert seen.mean() == pytest.approx(expected, rel=0.01, abs=0.0)
