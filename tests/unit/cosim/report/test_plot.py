"""Pictures show an error as tables do: target minus height, red where the part is too high, which every label says."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from inkloop.report import plot, solid_picture, surface_picture
from inkloop.report.error_maps import comparison, error_map, hardware_against_model
from inkloop.report.layer_curves import cross_section, layers
from inkloop.report.model_difference import LayerDifference, ModelDifference
from inkloop.report.pictures import pictures
from inkloop.report.solid_picture import SOLID_UPRIGHT, solids, view
from inkloop.report.surface_picture import surfaces
from inkloop.results.metrics import masked_error
from inkloop.results.result import Result
from inkloop.results.solid import ink_error, voxels

PITCH = 100e-6
SIGN = "too low +, too high -"
ENDS = (("too low", "too high"), ("missing", "too much"), ("hardware\nhigher", "hardware\nlower"))


def printed(error_um: float, high_cell: tuple[int, int] | None = None) -> xr.Dataset:
    """A part of 4 x 3 cells in 7 x 5, off its middle, that lacks `error_um`, and ends 9 um too high in one cell."""
    mask = np.zeros((7, 5), np.bool_)
    mask[1:5, 1:4] = True
    target = np.where(mask, 50e-6, 0.0)
    height = np.where(mask, target - error_um * 1e-6, 0.0)
    if high_cell is not None:
        height[high_cell] = target[high_cell] + 9e-6
    errors = [masked_error(surface, target, mask) for surface in (np.zeros_like(height), height)]
    x, y = (np.arange(count) * PITCH for count in mask.shape)
    return xr.Dataset(
        {
            "height": (("layer", "x", "y"), np.stack([np.zeros_like(height), height])),
            "target_height": (("x", "y"), target),
            "mask": (("x", "y"), mask),
            "mean_error": ("layer", [error.mean_error for error in errors]),
            "std": ("layer", [error.std for error in errors]),
        },
        coords={"layer": [0, 1], "x": x, "y": y},
        attrs={"pitch": PITCH},
    )


def texts(figure: Figure) -> list[str]:
    return [
        text.get_text()
        for axes in figure.axes
        for text in (axes.xaxis.label, axes.yaxis.label, axes.title, *axes.texts)
    ]


def without_sign(figure: Figure) -> list[str]:
    """Labels of axes and colour bars that are an error or a difference, and do not say what its sign means.

    An axis says it in brackets, a colour bar at its ends.
    """
    found = []
    for axes in figure.axes:
        around = " ".join(text.get_text() for text in axes.texts)
        for text in (axes.get_xlabel(), axes.get_ylabel(), axes.get_title()):
            if "[µm]" in text and ("error" in text or "minus" in text):
                found += [text] if " +, " not in text and not any(a in around and b in around for a, b in ENDS) else []
    return found


@pytest.mark.parametrize("error_um", [-3.0, 4.0])
def test_maps_have_the_mean_error_of_the_table(error_um: float) -> None:
    run = printed(error_um, high_cell=(2, 3))
    reported = float(run.mean_error[-1]) * 1e6
    for figure in (error_map(run, "a"), comparison({"a": run})):
        (image,) = [image for axes in figure.axes for image in axes.get_images()]
        assert np.nanmean(np.ma.filled(np.ma.asarray(image.get_array()), np.nan)) == pytest.approx(
            reported, rel=1e-9, abs=0.0
        )
        assert not without_sign(figure)
        assert any(SIGN in text for text in texts(figure))


def test_too_high_is_red_on_every_map() -> None:
    run = printed(1.0, high_cell=(2, 3))
    for figure in (error_map(run, "a"), comparison({"a": run})):
        (image,) = [image for axes in figure.axes for image in axes.get_images()]
        red, _, blue, _ = image.to_rgba(np.ma.asarray(image.get_array()))[3, 2]
        assert red > blue
    (solid,) = [
        each
        for axes in surfaces({"a": run}).axes
        for each in axes.collections
        if isinstance(each, PolyCollection) and len(each.get_facecolor()) > 35
    ]
    colours: Any = solid.get_facecolor()
    redder = colours[:, 0] - colours[:, 2]
    assert (redder > 0.2).sum() == 1
    assert (redder < -0.01).sum() == 11


def test_dots_tell_too_high_from_too_low_in_grey_print() -> None:
    """One dot in the middle of each cell that is clearly red, whatever the map; on fine grids one for a block."""
    run = printed(1.0, high_cell=(2, 3))
    for figure in (error_map(run, "a"), comparison({"a": run})):
        (axes,) = [axes for axes in figure.axes if axes.get_images()]
        (dots,) = axes.collections
        np.testing.assert_allclose(
            np.asarray(dots.get_offsets()), [[run.x[2] * 1e3, run.y[3] * 1e3]], rtol=1e-9, atol=1e-12
        )
        assert any("(dots)" in text for text in texts(figure))
    hardware = hardware_against_model(in_two_inks(), difference(), "a")
    for axes in hardware.axes:
        if axes.get_images():
            (dots,) = axes.collections
            assert len(np.asarray(dots.get_offsets())) == 12 * 8
    fine = np.full((4 * plot.DOTS, plot.DOTS), np.nan)
    fine[8:16, :8] = -1.0
    fine[20:24, :8] = 1.0
    axes = Figure().subplots()
    plot.draw_error(axes, fine, (0.0, 4.0, 0.0, 1.0), plot.error_norm([fine]))
    found = np.asarray(axes.collections[0].get_offsets()) * plot.DOTS
    assert found.tolist() == [[10.0, 2.0], [10.0, 6.0], [14.0, 2.0], [14.0, 6.0]]


def test_cut_has_the_mean_error_of_the_table() -> None:
    run = printed(4.0)
    figure = cross_section({"a": run})
    top = figure.axes[1]
    assert np.nanmean(np.asarray(top.lines[0].get_ydata())) == pytest.approx(
        float(run.mean_error[-1]) * 1e6, rel=1e-9, abs=0.0
    )
    assert top.get_ylabel() == f"error [µm]\n({SIGN})"
    words = [text.get_text() for text in surfaces({"a": run}).axes[-1].texts]
    assert words == ["too low", "too high"]  # at the upper and the lower end
    (above,) = [line for line in figure.axes[0].lines if line.get_label() == "a"]
    np.testing.assert_allclose(np.asarray(above.get_ydata()), run.height[-1, :, 2] * 1e6, rtol=1e-12)


def test_layers_show_mean_and_unevenness_of_the_table() -> None:
    run = printed(-4.0, high_cell=(2, 3))
    run["pattern"] = (("layer", "x", "y"), np.ones((2, 7, 5), np.int32))
    mean, spread, droplets = layers({"a": run}).axes
    np.testing.assert_allclose(np.asarray(mean.lines[0].get_ydata()), run.mean_error * 1e6, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(spread.lines[0].get_ydata()), run["std"][1:] * 1e6, rtol=1e-12)
    np.testing.assert_array_equal(np.asarray(droplets.lines[0].get_ydata()), [35])


def slab(nx: int, ny: int) -> xr.Dataset:
    """A slab 50 um high on all cells but two rows at the rim, 3 um too low."""
    mask = np.zeros((nx, ny), np.bool_)
    mask[2:-2, 2:-2] = True
    target = np.where(mask, 50e-6, 0.0)
    height = np.where(mask, 47e-6, 0.0)
    errors = [masked_error(surface, target, mask) for surface in (np.zeros_like(height), height)]
    return xr.Dataset(
        {
            "height": (("layer", "x", "y"), np.stack([np.zeros_like(height), height])),
            "target_height": (("x", "y"), target),
            "mask": (("x", "y"), mask),
            "mean_error": ("layer", [error.mean_error for error in errors]),
            "std": ("layer", [error.std for error in errors]),
        },
        coords={"layer": [0, 1], "x": np.arange(nx) * PITCH, "y": np.arange(ny) * PITCH},
        attrs={"pitch": PITCH},
    )


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
    figure = surfaces({"a": slab(nx, ny)})
    ((axes, (x, y, z)),) = drawn
    ((flat,), _) = painted.set_facecolor.call_args
    colours = flat.reshape(z.shape[0] - 1, z.shape[1] - 1, 4)
    assert (painted.set_edgecolor.call_args[0][0] == flat).all()  # else there are seams
    width, depth, _ = axes._box_aspect
    assert depth / width == pytest.approx(ny / nx, rel=1e-12, abs=0.0)
    assert np.ptp(x) == pytest.approx(nx * PITCH * 1e3, rel=1e-12, abs=0.0)
    assert np.ptp(y) == pytest.approx(ny * PITCH * 1e3, rel=1e-12, abs=0.0)
    corners = np.stack([z[:-1, :-1], z[1:, :-1], z[:-1, 1:], z[1:, 1:]])
    is_top = np.zeros(colours.shape[:2], np.bool_)
    is_top[::2, ::2] = True  # plates and walls alternate
    assert (np.ptp(corners, axis=0)[is_top] == 0.0).all()
    is_blue = colours[..., 2] - colours[..., 0] > 0.2
    assert is_blue[is_top & (corners[0] > 46.9)].all()
    assert not is_blue[~is_top].any()
    assert max(colours.shape[:2]) < 2 * surface_picture.PLATES
    assert figure.texts[-1].get_text().startswith("heights in µm, stretched x ")


def in_two_inks() -> xr.Dataset:
    """A print of layers of A and B, 20 um each, where A is wanted up to 24 um."""
    run = slab(12, 8)
    height = np.cumsum([np.zeros((12, 8)), *[np.where(run.mask, 20e-6, 0.0)] * 2], axis=0)
    ink = np.broadcast_to(np.array([0, 1, 2], np.int8)[:, None, None], height.shape)
    bounds = np.broadcast_to(np.array([0.0, 24e-6])[:, None, None, None], (2, 1, 12, 8))
    arrays = {"height": height, "ink": ink, "pattern": ink.astype(np.int32)}
    run = run.drop_dims("layer").assign({name: (("layer", "x", "y"), values) for name, values in arrays.items()})
    regions = dict(zip(("region_bottom", "region_top"), bounds, strict=True))
    run = run.assign({name: (("interval", "x", "y"), values) for name, values in regions.items()})
    figures = {"mean_error": [50e-6, 30e-6, 10e-6], "std": [0.0, 0.0, 1e-6]}
    run = run.assign({name: ("layer", values) for name, values in figures.items()})
    return run.assign(mismatch=0.2).assign_coords(layer=[0, 1, 2])


def difference() -> ModelDifference:
    rows = tuple(LayerDifference(layer, 1e-6, 2e-6, 1e-6, 3e-6, (3, 3)) for layer in range(3))
    return ModelDifference("model", np.full((3, 12, 8), 1e-6), rows)


@pytest.fixture
def coarse_view(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solids are seen in fewer pixels than in print."""
    monkeypatch.setattr("inkloop.report.solid_picture.PIXELS", 60)
    monkeypatch.setattr("inkloop.report.solid_picture.STEPS", 60)


@pytest.mark.usefixtures("coarse_view")
def test_every_label_of_an_error_says_what_its_sign_means() -> None:
    run = in_two_inks()
    figures = pictures({"a": Result(run, {}), "b": Result(run, {})})
    assert {"error-map", "layers", "cross-section", "surface", "materials", "solid"} < set(figures)
    figures |= {"comparison": comparison({"a": run}), "hardware": hardware_against_model(run, difference(), "a")}
    assert {name: found for name, figure in figures.items() if (found := without_sign(figure))} == {}
    assert any("error of ink A" in text for text in texts(figures["solid"]))
    bare = error_map(run, "a")
    bare.axes[1].set_xlabel("error [µm]")
    assert without_sign(bare) == ["error [µm]"]


@pytest.mark.usefixtures("coarse_view")
def test_solid_shows_how_long_its_sides_are() -> None:
    run = in_two_inks()
    figure, levels = solids({"a": run}), voxels(run).shape[2]
    words = [text.get_text() for text in figure.axes[0].texts]
    assert words == ["0.2 mm", "0.2 mm", "10 µm"]  # 12 cells of 0.1 mm, 48 um
    bars = [np.ptp(np.array(line.get_data()), axis=1) for line in figure.axes[0].lines]
    assert bars[2][0] == pytest.approx(0.0, abs=1e-9)  # upright
    share = np.hypot(*bars[2]) / (view(np.ones((12, 8, levels), np.bool_), SOLID_UPRIGHT).axes[2, 1] * SOLID_UPRIGHT)
    assert share == pytest.approx(10.0 / levels, rel=1e-6, abs=0.0)


def test_runs_that_coincide_are_told_apart_by_their_marks() -> None:
    axes = Figure().subplots()
    for number in range(len(plot.MARKS)):
        plot.draw_line(axes, number, np.arange(60), np.ones(60))
    lines, ends = axes.lines[::2], axes.lines[1::2]
    assert len({line.get_marker() for line in lines}) == len({line.get_color() for line in lines}) == len(lines)
    places = [place for line in lines for place in np.atleast_1d(np.asarray(line.get_markevery()))]
    assert len(places) == len(set(places)) > len(plot.MARKS)
    assert [np.asarray(end.get_xdata()).tolist() for end in ends] == [[59]] * len(plot.MARKS)


def test_picture_is_written_in_each_format_with_the_same_bytes_each_time(tmp_path: Path) -> None:
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        plot.save(Figure((1.0, 1.0)), tmp_path / folder / "cut", ["svg", "pdf", "png"])
    files = sorted(path.name for path in (tmp_path / "first").iterdir())
    assert files == ["cut.pdf", "cut.png", "cut.svg"]
    for name, magic in zip(files, (b"%PDF", b"\x89PNG", b"<?xml"), strict=True):
        content = (tmp_path / "first" / name).read_bytes()
        assert content.startswith(magic)
        assert content == (tmp_path / "second" / name).read_bytes()


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


@pytest.mark.parametrize(
    ("scales", "shown"),
    [
        ((0.3, 0.6), [-0.5, 0.0, 0.5]),
        ((0.4, 26.0), [-10.0, -1.0, 0.0, 1.0, 10.0]),  # 20 is too near to 10
        ((0.4, 60.0), [-50.0, -10.0, -1.0, 0.0, 1.0, 10.0, 50.0]),
        ((150.0, 260.0), [-200.0, -100.0, 0.0, 100.0, 200.0]),
    ],
)
def test_scale_of_errors_of_several_sizes_has_ticks_besides_zero(scales: tuple[float, ...], shown: list[float]) -> None:
    figure, numbers = Figure(), np.random.default_rng(2)
    norm = plot.error_norm([numbers.uniform(-scale, scale, (30, 30)) for scale in scales])
    axes = figure.subplots()
    plot.add_scale(figure, ScalarMappable(norm, plot.ERROR_COLOURS), ax=axes)
    assert figure.axes[1].get_yticks().tolist() == pytest.approx(shown, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(
    ("error_um", "words"),
    [
        (0.2, ""),
        (40.0, "open loop: 40 µm too low, outside the frame"),
        (-30.0, "open loop: 30 µm too high, outside the frame"),
    ],
)
def test_curve_outside_the_frame_is_named_above_it(error_um: float, words: str) -> None:
    _, error = cross_section({"closed loop": printed(0.2), "open loop": printed(error_um)}).axes
    assert error.get_title(loc="left") == words
    assert not error.texts


@pytest.mark.parametrize("count", [1, 5, 9])
def test_legend_fits_into_the_width_of_its_figure(count: int) -> None:
    figure = plot.new_figure(2.0)
    axes = figure.subplots()
    lines = [axes.plot([0, 1], label=f"closed loop, a long label of run {k}")[0] for k in range(count)]
    plot.outside_legend(figure, lines, [str(line.get_label()) for line in lines])
    [legend] = figure.legends
    assert legend.get_window_extent().width <= figure.bbox.width
    assert len(legend.get_texts()) == count


def test_lines_of_no_error_are_drawn() -> None:
    run = printed(4.0)
    for axes in (cross_section({"a": run}).axes[1], layers({"a": run}).axes[0]):
        dashed = [line for line in axes.lines if line.get_linestyle() == "--"]
        assert [list(np.unique(np.asarray(line.get_ydata()))) for line in dashed] == [[0.0]]


def test_error_of_a_solid_is_in_micrometres_where_it_is_seen() -> None:
    run = in_two_inks()
    seen = view(voxels(run) == 1, SOLID_UPRIGHT)
    found = solid_picture._seen_error(run, seen)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(seen.brightness))
    expected = ink_error(run) * 1e6
    assert 1.0 < np.abs(expected).max() < 1000.0
    for row, column in np.argwhere(~np.isnan(seen.brightness))[::97]:
        i, j, k = seen.voxel[row, column]
        assert found[row, column] == pytest.approx(expected[i, j, k], rel=1e-9, abs=0.0)
