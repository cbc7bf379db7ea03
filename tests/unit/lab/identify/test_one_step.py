"""Predictions of the next scan, their errors, and the cells that a model was not fitted to; models are doubles."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomlkit

from inkloop_lab.identify.candidates import conserving
from inkloop_lab.identify.identification import Comparison, Identification, compare
from inkloop_lab.identify.ink_regression import InkEstimate
from inkloop_lab.identify.ink_writer import write_ink
from inkloop_lab.identify.one_step import Score, _ink_surface, near_droplets, predictions, rms, score
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.models import LayerDeposition, SuperpositionDeposition, VolumeAreaDeposition, YoungLaplaceDeposition
from support.logged_print import made_up

NAN = float("nan")


class Stack:
    """A droplet is a layer of 1, whatever it falls on; the number of the layer is added to cell (0, 0)."""

    def start(self, height: Any) -> Any:
        return height

    def layer(self, surface: Any, pattern: Any, number: int) -> Any:
        after = surface + (pattern > 0)
        after[0, 0] += 100 * number
        return SimpleNamespace(height=after)


STACK: Any = Stack()


def record(measured: Any, pattern: Any) -> PrintRecord:
    return PrintRecord("it", 1e-4, np.asarray(pattern, np.int32), np.asarray(measured, np.float64))


def test_layer_is_predicted_from_the_scan_before_it_and_from_the_prediction_where_that_saw_nothing() -> None:
    pattern = np.ones((3, 2, 3))
    measured = np.zeros((4, 2, 3)) + 10.0 * np.arange(4)[:, None, None]
    measured[1, 1, 2] = measured[2, 1, 2] = NAN
    found = predictions(STACK, record(measured, pattern))
    expected = np.array([1.0, 11.0, 21.0])[:, None, None] * np.ones((2, 3))
    expected[:, 0, 0] += [100, 200, 300]
    expected[:, 1, 2] = [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(found, expected)


def test_measured_areas_are_the_ones_that_the_next_layer_begins_with() -> None:
    """Of a model whose drops spread by what is covered, another area is another layer."""
    pattern = np.zeros((2, 5, 5), np.int32)
    pattern[0, 2, 1:4:2], pattern[1, 2, 2] = 1, 1
    model = VolumeAreaDeposition()
    whole = made_up(model, list(pattern))
    assert whole.area is not None
    measured = predictions(model, whole)
    np.testing.assert_allclose(measured[0], whole.measured[1], rtol=1e-9, atol=1e-15)
    np.testing.assert_array_equal(predictions(model, replace(whole, area=None)), measured)  # the model's own area
    for area, is_same in ((np.minimum(1.5 * whole.area, 0.9), False), (whole.area, True)):
        found = predictions(model, replace(whole, area=area))
        np.testing.assert_array_equal(found[0], measured[0])
        assert np.array_equal(found[1], measured[1]) == is_same


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_cell_that_the_first_scan_did_not_see_begins_on_the_plane_of_the_others(noise: float) -> None:
    i, j = np.indices((4, 5))
    start = 2.0 * i - 1.0 * j
    scans = np.stack([start + noise * (-1.0) ** (i + j)] * 2)
    scans[0, 2, 1] = NAN
    found = predictions(STACK, record(scans, np.zeros((1, 4, 5))), noise)[0]
    expected = scans[1].copy()
    expected[0, 0] += 100
    expected[2, 1] = found[2, 1]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
    assert found[2, 1] == pytest.approx(start[2, 1], rel=0.0, abs=0.2 * noise + 1e-9)


def test_noise_of_the_first_scan_is_no_ground_of_volumes() -> None:
    """It is even within its noise of 0.1 um, so that the ground is a plane, below which there is no ink."""
    i, j = np.indices((8, 8))
    scans = np.stack([0.1e-6 * (-1.0) ** (i + j)] * 2)
    found = predictions(VolumeAreaDeposition(), record(scans, np.zeros((1, 8, 8))), 0.1e-6)[0]
    np.testing.assert_allclose(found, np.maximum(scans[0], 0.0), rtol=0.0, atol=0.02e-6)


def test_measured_surface_holds_no_negative_ink_and_none_higher_than_its_highest_cell() -> None:
    ground = np.full((1, 4), 2.0)
    height, area = np.array([[1.5, 2.0, 3.0, 6.0]]), np.array([[0.3, 0.0, 0.1, 0.9]])
    found = _ink_surface(ground, height, area)
    np.testing.assert_allclose(found.height, [[2.0, 2.0, 3.0, 6.0]])
    np.testing.assert_allclose(found.area, [[0.3, 0.0, 0.25, 1.0]])
    np.testing.assert_allclose(found.substrate, ground)
    np.testing.assert_array_equal(_ink_surface(ground, ground, area).area, area)  # nothing is printed yet


def test_measured_area_beyond_a_whole_cell_is_a_whole_cell() -> None:
    model, pattern = VolumeAreaDeposition(), np.zeros((2, 5, 5), np.int32)
    pattern[0, 2, 1:4:2], pattern[1, 2, 2] = 1, 1
    whole = made_up(model, list(pattern))
    assert whole.area is not None
    covered = np.where(whole.area > 0.0, 1.0, 0.0)
    once, more = (predictions(model, replace(whole, area=area)) for area in (covered, 1.5 * covered))
    np.testing.assert_array_equal(once, more)


def test_relative_error_counts_cells_near_droplets_that_stand_a_tenth_of_a_layer_above_the_start() -> None:
    start = 5.0 + np.zeros((1, 6, 4))
    rise = np.zeros((6, 4))
    rise[1, 1], rise[2, 1], rise[5, 3], rise[0, 2] = 2.0, 0.5, 4.0, 0.05  # the third lies far, the last one is low
    pattern = np.zeros((1, 6, 4))
    pattern[0, 1, 1] = 1
    after = np.concatenate([start, start + rise])
    predicted = start + rise - 0.1
    found = score([record(after, pattern)], [predicted], [np.ones((6, 4), np.bool_)], 1.0, 0.0)
    assert found.rms == pytest.approx(0.1, rel=1e-9, abs=0.0)
    assert found.relative == pytest.approx(np.sqrt((0.05**2 + 0.2**2) / 2.0), rel=1e-9, abs=0.0)
    inside = np.zeros((6, 4), np.bool_)
    inside[1, 1] = True
    after[1, 2, 2] = NAN
    found = score([record(after, pattern)], [predicted], [inside], 1.0, 0.0)
    assert found.relative == pytest.approx(0.05, rel=1e-9, abs=0.0)
    assert np.isnan(rms(np.zeros(0)))


def test_near_is_within_one_cell_each_way() -> None:
    pattern = np.zeros((2, 5, 4), np.int32)
    pattern[0, 1, 2], pattern[1, 4, 0] = 2, 1
    expected = np.zeros((2, 5, 4), np.bool_)
    expected[0, 0:3, 1:4] = expected[1, 3:5, 0:2] = True
    np.testing.assert_array_equal(near_droplets(pattern), expected)


class Candidate:
    """Adds what its cells were: it predicts a cell right only if it had it for its fit."""

    def __init__(self, name: str = "double") -> None:
        self.name, self.fits = name, list[Any]()

    def fit(self, records: Sequence[PrintRecord], cells: Sequence[Any]) -> Any:
        self.fits.append(cells[0].copy())
        if self.name == "bad":
            raise IdentificationError("too few drops")
        return SimpleNamespace(
            start=lambda height: height,
            layer=lambda before, pattern, number: SimpleNamespace(height=before + np.where(cells[0], 1.0, 3.0)),
        )


def test_every_cell_is_predicted_by_a_fit_that_has_not_seen_its_stripe_along_x() -> None:
    pattern = np.ones((2, 13, 5))
    measured = np.ones((3, 13, 5)) * np.arange(3.0)[:, None, None]
    candidate, bad, progress = Candidate(), Candidate("bad"), list[Any]()
    found, refused = compare([candidate, bad], [record(measured, pattern)], 0.0, lambda *step: progress.append(step))  # type: ignore[list-item]
    assert len(candidate.fits) == 5
    assert candidate.fits[-1].all()
    np.testing.assert_array_equal(sum(~fit for fit in candidate.fits[:4]), np.ones((13, 5)))  # each left out once
    assert [int((~fit).any(axis=1).sum()) for fit in candidate.fits[:4]] == [4, 3, 3, 3]
    np.testing.assert_array_equal(found.errors[0], np.full((2, 13, 5), -2.0))
    assert found.score is not None
    assert found.score.rms == pytest.approx(2.0, rel=1e-12, abs=0.0)
    assert (refused.name, refused.model, refused.score, refused.refusal) == ("bad", None, None, "too few drops")
    assert progress == [("double", n, 10) for n in range(5)] + [("bad", 5, 10)]


def test_twelve_cells_along_x_are_enough_to_compare_models() -> None:
    pattern, measured = np.ones((1, 12, 1)), np.arange(2.0)[:, None, None] * np.ones((2, 12, 1))
    assert compare([Candidate()], [record(measured, pattern)], 0.0)[0].score is not None  # type: ignore[list-item]
    few = record(measured[:, :11], pattern[:, :11])
    with pytest.raises(IdentificationError, match="it: 11 cells along x; comparing models needs 12"):
        compare([Candidate()], [few], 0.0)  # type: ignore[list-item]


HEIGHTS = np.array([[4.4e-6, 0.6e-6, -0.1e-6], [3.0e-6, 0.5e-6, 0.3e-6]])
FAR = (4e-6, 0.6e-6, 0.2e-6, 0.15e-6, 0.1e-6, 0.05e-6)
LIQUID = YoungLaplaceDeposition(42.3e-6, 30e-15, math.radians(55.0), "linear", 4)
CAPS = SuperpositionDeposition(((60e-6, 8e-6),), 90e-6)
WORSE, BETTER = VolumeAreaDeposition(90e-6, 7e-6), VolumeAreaDeposition(90e-6, 6e-6, 6700.0, -20100.0, 1.0, -2.0, 50e-6)


def compared(name: str, model: Any, rms_um: float) -> Comparison:
    return Comparison(name, model, Score(rms_um * 1e-6, 0.1), ())


def written(folder: Path, *comparisons: Comparison, reach: int = 1) -> tuple[str, dict[str, Any]]:
    """The text of a file, and its tables."""
    record = PrintRecord("first", 90e-6, np.zeros((1, 4, 3), np.int32), np.zeros((2, 4, 3)))
    ink = InkEstimate(HEIGHTS, np.diag(np.arange(1.0, 7.0) ** 2 * 1e-16), 5, 0.3e-6, 0.125, 321)
    found = Identification((record, record), (record,), 0.25e-6, ink, None, None, comparisons, (), reach)
    write_ink(found, folder / "ink.toml", date(2026, 3, 9))
    text = (folder / "ink.toml").read_text(encoding="utf-8")
    return text, tomlkit.parse(text).unwrap()


def test_heights_stand_in_micrometres_with_their_intervals(tmp_path: Path) -> None:
    text, tables = written(tmp_path)
    assert tables["a"] == {"h1_um": 4.4, "h2_um": 0.6, "h3_um": 0.0}  # nothing below 0
    assert tables["b"] == {"h1_um": 3.0, "h2_um": 0.5, "h3_um": 0.3}
    widths = [float(width) for width in re.findall(r"\+- (\S+) \(95 %\)", text)]
    np.testing.assert_allclose(widths, 2.5706 * 0.01 * np.arange(1, 7), rtol=0.04)  # two digits
    assert "on 2026-03-09 from first, first." in text
    assert '[ink]  file = "ink.toml"' in text
    with pytest.raises(IdentificationError, match=r"ink\.toml: is there already and is not overwritten"):
        written(tmp_path)


def test_file_says_where_the_numbers_are_from(tmp_path: Path) -> None:
    _, tables = written(tmp_path, compared("one", CAPS, 0.5), Comparison("none", None, None, (), "no"))
    assert {**tables["identified"], "method": ""} == {
        "method": "", "prints": ["first", "first"], "pitch_um": pytest.approx(90.0, rel=1e-12, abs=0.0),
        "noise_um": 0.25, "droplet_std": 0.125, "growths": 321, "one_step_rms_um": {"one": 0.5},
    }  # fmt: skip


def test_models_have_their_options_in_the_units_of_their_keys(tmp_path: Path) -> None:
    plant = Comparison(conserving(2), LayerDeposition((FAR,)), None, ())
    models = (compared("worse", WORSE, 0.5), compared("better", BETTER, 0.2), compared("caps", CAPS, 0.3))
    _, tables = written(tmp_path, *models, compared("liquid", LIQUID, 0.4), plant, reach=2)
    found = tables["models"]
    heights = {f"h{k}_a_um": pytest.approx(height * 1e6, rel=1e-5, abs=0.0) for k, height in enumerate(FAR, start=1)}
    assert found["LayerDeposition"] == {"reach": 2, **heights}
    caps = {f"cap_{what}_{ink}_um": value for ink in "ab" for what, value in (("radius", 60.0), ("height", 8.0))}
    assert found["SuperpositionDeposition"] == caps
    assert found["YoungLaplaceDeposition"] == {"droplet_volume_pl": 30.0, "contact_angle_deg": 55.0}
    gains = {"mv_plus_per_um": 6.7e-3, "mv_minus_per_um": -0.0201, "ma_plus_per_um": 1e-6, "ma_minus_per_um": -2e-6}
    volume_area = found["VolumeAreaDeposition"]  # the better one of the two
    assert {name: volume_area[name] for name in gains} == gains
    assert (volume_area["height_scale_um"], volume_area["guard"], volume_area["limit_gains"]) == (6.0, True, True)
    assert volume_area["cap_radius_um"] == 50.0
    (tmp_path / "ink.toml").unlink()
    _, tables = written(tmp_path, compared("worse", WORSE, 0.5))  # on flat ground the usual one
    assert "cap_radius_um" not in tables["models"]["VolumeAreaDeposition"]
