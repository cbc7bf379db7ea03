"""Pictures show an error as tables do: target minus height, red where the part is too high."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D

from inkloop.report import plot
from inkloop.results.metrics import masked_error

PITCH = 100e-6
SIGN = "target - height [µm]"


def printed(error_um: float, high_cell: tuple[int, int] | None = None) -> xr.Dataset:
    """A part of 3 x 3 cells in 5 x 5 that lacks `error_um` everywhere, and ends 9 um too high in one cell."""
    mask = np.zeros((5, 5), np.bool_)
    mask[1:4, 1:4] = True
    target = np.where(mask, 50e-6, 0.0)
    height = np.where(mask, target - error_um * 1e-6, 0.0)
    if high_cell is not None:
        height[high_cell] = target[high_cell] + 9e-6
    errors = [masked_error(surface, target, mask) for surface in (np.zeros_like(height), height)]
    axis = np.arange(5) * PITCH
    return xr.Dataset(
        {
            "height": (("layer", "x", "y"), np.stack([np.zeros_like(height), height])),
            "target_height": (("x", "y"), target),
            "mask": (("x", "y"), mask),
            "mean_error": ("layer", [error.mean_error for error in errors]),
            "std": ("layer", [error.std for error in errors]),
        },
        coords={"layer": [0, 1], "x": axis, "y": axis},
        attrs={"pitch": PITCH},
    )


def labels(figure: Figure) -> list[str]:
    return [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if "target - h" in text]


@pytest.mark.parametrize("error_um", [-3.0, 4.0])
def test_maps_have_the_mean_error_of_the_table(error_um: float) -> None:
    run = printed(error_um, high_cell=(2, 3))
    reported = float(run.mean_error[-1]) * 1e6
    for figure in (plot.error_map(run, "a"), plot.comparison({"a": run})):
        (image,) = [image for axes in figure.axes for image in axes.get_images()]
        assert np.nanmean(np.ma.filled(np.ma.asarray(image.get_array()), np.nan)) == pytest.approx(
            reported, rel=1e-9, abs=0.0
        )
        assert SIGN in labels(figure)


def test_too_high_is_red_on_every_map() -> None:
    run = printed(1.0, high_cell=(2, 3))
    for figure in (plot.error_map(run, "a"), plot.comparison({"a": run})):
        (image,) = [image for axes in figure.axes for image in axes.get_images()]
        red, _, blue, _ = image.to_rgba(np.ma.asarray(image.get_array()))[3, 2]
        assert red > blue
    (solid,) = [
        each
        for axes in plot.surfaces({"a": run}).axes
        for each in axes.collections
        if isinstance(each, PolyCollection) and len(each.get_facecolor()) > 25
    ]
    colours: Any = solid.get_facecolor()
    redder = colours[:, 0] - colours[:, 2]
    assert (redder > 0.2).sum() == 1
    assert (redder < -0.01).sum() == 8


def test_cut_has_the_mean_error_of_the_table() -> None:
    run = printed(4.0)
    figure = plot.cross_section({"a": run})
    top = figure.axes[1]
    assert np.nanmean(np.asarray(top.lines[0].get_ydata())) == pytest.approx(
        float(run.mean_error[-1]) * 1e6, rel=1e-9, abs=0.0
    )
    assert labels(figure) == [SIGN]
    assert SIGN in labels(plot.surfaces({"a": run}))
    (above,) = [line for line in figure.axes[0].lines if line.get_label() == "a"]
    np.testing.assert_allclose(np.asarray(above.get_ydata()), run.height[-1, :, 2] * 1e6, rtol=1e-12)


def test_layers_show_mean_and_unevenness_of_the_table() -> None:
    run = printed(-4.0, high_cell=(2, 3))
    run["pattern"] = (("layer", "x", "y"), np.ones((2, 5, 5), np.int32))
    mean, spread, droplets = plot.layers({"a": run}).axes
    np.testing.assert_allclose(np.asarray(mean.lines[0].get_ydata()), np.abs(run.mean_error) * 1e6, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(spread.lines[0].get_ydata()), run["std"][1:] * 1e6, rtol=1e-12)
    np.testing.assert_array_equal(np.asarray(droplets.lines[0].get_ydata()), [25])


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

    def plot_surface(axes: Any, *corners: Any, facecolors: Any, rstride: int, cstride: int, **_: Any) -> None:
        assert (rstride, cstride) == (1, 1)  # every face, whatever the size
        drawn.append((axes, corners, facecolors))

    monkeypatch.setattr(Axes3D, "plot_surface", plot_surface)
    figure = plot.surfaces({"a": slab(nx, ny)})
    ((axes, (x, y, z), colours),) = drawn
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
    assert max(colours.shape[:2]) < 2 * plot.PLATES
    assert figure.texts[-1].get_text().startswith("heights in µm, stretched x ")
