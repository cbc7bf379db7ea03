"""Picture of the residuals: its map, densities and means are those of the errors that it is drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inkloop.component import Ink
from inkloop.report.plot import LINES
from inkloop_lab.identify.identification import Comparison, Identification
from inkloop_lab.identify.ink_regression import InkEstimate
from inkloop_lab.identify.one_step import Score
from inkloop_lab.identify.picture import residuals
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.models import LayerDeposition

SHAPE = (3, 34, 22)
"""Layers, cells along x and along y."""
NOISE_UM = 0.2


def compared(name: str, rms_um: float | None, *errors_um: NDArray[np.float64]) -> Comparison:
    score = None if rms_um is None else Score(rms_um * 1e-6, 0.1)
    return Comparison(name, LayerDeposition.of([Ink()]), score, tuple(error * 1e-6 for error in errors_um))


def drawn(
    measured_um: NDArray[np.float64], *comparisons: Comparison, noise_um: float = NOISE_UM, others: Any = ()
) -> Any:
    """The picture of a print, or of others too, by their scans [um]."""
    records = tuple(
        PrintRecord("it", 1e-4, np.ones((len(scans) - 1, *scans.shape[1:]), np.int32), scans * 1e-6)
        for scans in (*others, measured_um)
    )
    ink = InkEstimate(np.full((1, 3), 1e-6), np.eye(3), 5, noise_um * 1e-6, 0.0, 1)
    return residuals(Identification(records, records, noise_um * 1e-6, ink, None, None, comparisons, ()))


def errors(seed: int, shape: tuple[int, int, int] = SHAPE) -> NDArray[np.float64]:
    return np.random.default_rng(seed).normal(0.0, 1.0 + seed, shape)


FLAT = np.zeros((SHAPE[0] + 1, *SHAPE[1:]))


def test_map_has_the_rms_of_the_best_model_on_the_largest_print() -> None:
    small, large = errors(1, (3, 5, 4)), errors(2)
    large[0, 3, 7] = np.nan  # one layer of the cell was seen no less
    large[:, 5, 2] = np.nan
    worse, best = compared("worse", 0.9, small, 7.0 * large), compared("best", 0.4, small, large)
    by_cell, *_ = drawn(FLAT, worse, best, others=[np.zeros((4, 5, 4))]).axes
    image = by_cell.get_images()[0]
    expected = np.sqrt(np.nanmean(np.where(np.isnan(large).all(axis=0), 0.0, large) ** 2, axis=0))
    expected[5, 2] = np.nan
    np.testing.assert_allclose(np.ma.filled(image.get_array(), np.nan), expected.T, rtol=1e-9)
    assert image.origin == "lower"
    assert image.get_clim()[0] == 0.0
    assert (by_cell.get_title(), by_cell.get_xlabel()) == ("best", "cell along x")


def test_densities_are_of_the_four_best_models_over_the_range_of_all_but_a_hundredth() -> None:
    models = [compared(f"model {k}", 1.0 + k, errors(k)) for k in (3, 0, 4, 1, 2)]
    refused = compared("refused", None)
    _, densities, *_ = drawn(FLAT, refused, *models).axes
    names = [patch.get_label() for patch in densities.patches]
    assert names == ["model 0", "model 1", "model 2", "model 3"]
    limit = np.quantile(np.abs(errors(3)), 0.99)  # of the widest one that is shown
    for k, patch in enumerate(densities.patches):
        values, edges, _ = patch.get_data()
        assert (edges[0], edges[-1], len(values)) == (
            pytest.approx(-limit, rel=1e-9, abs=0.0),
            pytest.approx(limit, rel=1e-9, abs=0.0),
            60,
        )
        count, _ = np.histogram(errors(k).ravel(), edges)
        np.testing.assert_allclose(values * np.diff(edges) * count.sum(), count, rtol=1e-9, atol=1e-9)


def test_noise_of_two_scans_is_the_normal_density_of_their_difference() -> None:
    _, densities, *_ = drawn(FLAT, compared("one", 1.0, errors(0))).axes
    x, y = densities.lines[0].get_data()
    spread = NOISE_UM * 2.0**0.5
    np.testing.assert_allclose(y, np.exp(-0.5 * (x / spread) ** 2) / (spread * np.sqrt(2.0 * np.pi)), rtol=1e-9)
    assert densities.lines[0].get_label() == "noise of two scans"
    _, exact, *_ = drawn(FLAT, compared("one", 1.0, errors(0)), noise_um=0.0).axes
    assert not exact.lines


def test_means_are_by_the_predicted_step_of_the_cell_one_layer_before() -> None:
    """The error of a layer is 0.1 um and half of the step that was predicted for the layer before it."""
    predicted = np.random.default_rng(7).uniform(0.0, 9.0, SHAPE)
    error = np.zeros(SHAPE)
    rise = np.full(SHAPE, np.nan)
    for k, i, j in np.ndindex(SHAPE):
        if 0 < i < SHAPE[1] - 1 and 0 < j < SHAPE[2] - 1:
            sides = predicted[k, i - 1, j] + predicted[k, i + 1, j] + predicted[k, i, j - 1] + predicted[k, i, j + 1]
            rise[k, i, j] = predicted[k, i, j] - sides / 4.0
    error[1:] = 0.1 + 0.5 * np.nan_to_num(rise[:-1])
    measured = np.concatenate([np.zeros((1, *SHAPE[1:])), predicted + error])
    *_, by_rise = (axes for axes in drawn(measured, compared("one", 1.0, error)).axes if axes.get_title())
    x, y = by_rise.lines[0].get_data()
    assert len(x) == 16
    np.testing.assert_allclose(y, 0.1 + 0.5 * x, rtol=1e-9, atol=1e-9)
    known = np.sort(rise[:-1][np.isfinite(rise[:-1])])
    np.testing.assert_allclose(x[[0, -1]], [known[:80].mean(), known[-80:].mean()], rtol=1e-2)
    assert by_rise.lines[0].get_color() == LINES[0]["color"]


def test_steps_that_few_cells_have_are_no_mean() -> None:
    """Of 5 x 4 inner cells in one layer, no group has thirty; a print of one layer has no steps at all."""
    shape = (2, 7, 6)
    by_rise = drawn(np.cumsum(errors(1, (3, 7, 6)), axis=0), compared("one", 1.0, errors(2, shape))).axes[2]
    assert not len(by_rise.lines[0].get_xdata())
    figure = drawn(np.zeros((2, 7, 6)), compared("one", 1.0, errors(2, (1, 7, 6))))
    assert not figure.axes[2].axison
