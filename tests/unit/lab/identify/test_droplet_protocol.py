"""Invariants of what single droplets show: the protocol of Lu et al. and the coefficients of Wu and Chiu."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop_lab.identify import designs
from inkloop_lab.identify.command import _share
from inkloop_lab.identify.droplet_protocol import identify_by_protocol, motif_centres
from inkloop_lab.identify.print_record import IdentificationError, noise_of
from inkloop_lab.identify.volume_area_coefficients import (
    TWO_PRIOR,
    DropSample,
    _ratio,
    _relative_rms,
    drop_samples,
    height_differences,
    identify_volume_area,
)
from inkloop_lab.models import LayerDeposition, VolumeAreaDeposition
from inkloop_lab.reproduce.wu_chiu import NOISE, PIXELS, experiments, liquid
from support.logged_print import made_up
from support.numpy import wu_chiu_numpy

TRUE = (4.4e-6, 0.6e-6, 0.2e-6)
GAINS = {"mv_plus": 6700.0, "mv_minus": -20100.0, "ma_plus": 0.0, "ma_minus": -63400.0}


def motif_print(model, samples, noise=0.0, seed=0):
    side = designs.droplets_side(samples)
    return made_up(model, designs.droplets(side, side, seed), noise, seed)


def test_motifs_stand_alone_and_are_as_many_as_asked_for() -> None:
    first, second = designs.droplets(designs.droplets_side(30), designs.droplets_side(30))
    counts = {name: np.count_nonzero(centres) for name, centres in motif_centres(first).items()}
    assert counts["side"] >= 30
    assert counts["single"] >= 60  # and the prior droplet of the second layer's "1 prior"
    record = motif_print(LayerDeposition(), 30)
    samples = drop_samples([record], 0.0)
    assert len(samples) == np.count_nonzero(second)
    assert sorted({sample.prior for sample in samples}) == ["0", "1", TWO_PRIOR, "3", "4", "6", "7", "8"]


def test_protocol_gives_the_ink_of_exact_scans() -> None:
    found = identify_by_protocol([motif_print(LayerDeposition(), 4)], 0.0)
    assert found.heights == pytest.approx(TRUE, rel=1e-9, abs=0.0)
    assert max(found.half_widths) < 1e-12


def test_intervals_of_the_protocol_hold_the_ink() -> None:
    found = [identify_by_protocol([motif_print(LayerDeposition(), 40, 1e-6, seed)], 1e-6) for seed in range(10)]
    inside = [np.abs(np.subtract(one.heights, TRUE)) <= one.half_widths for one in found]
    assert np.mean(inside) >= 0.8
    assert np.mean([one.heights for one in found], axis=0) == pytest.approx(TRUE, abs=0.15e-6)


def test_protocol_without_its_motifs_is_refused_with_a_message() -> None:
    with pytest.raises(IdentificationError, match=r"0 side.*needs 3 of each"):
        identify_by_protocol([made_up(LayerDeposition(), [np.ones((9, 9), np.int32)])], 0.0)


def test_height_differences_are_those_of_the_reference_model() -> None:
    heights = np.random.default_rng(1).uniform(0.0, 9.0, (3, 3))
    assert height_differences(heights) == pytest.approx(wu_chiu_numpy.differences(heights), rel=1e-9, abs=0.0)


def test_drops_give_the_coefficients_of_the_model_they_were_made_with() -> None:
    found = identify_volume_area([motif_print(VolumeAreaDeposition(), 9)], 0.0)
    assert {name: found.coefficients[name] for name in GAINS} == pytest.approx(GAINS, rel=1e-9, abs=1e-6)
    assert found.coefficients["height_scale"] == pytest.approx(7.0751e-6, rel=1e-9, abs=0.0)
    assert set(found.rms) == set(found.counts)
    assert max(error for error, _ in found.rms.values()) < 1e-9


def test_finer_noise_gives_the_coefficients_with_their_spread() -> None:
    """2 nm of a cell's mean is what some hundred pixels of a profilometer of 0.04 um leave."""
    found = identify_volume_area([motif_print(VolumeAreaDeposition(), 75, 2e-9)], 2e-9)
    for name, true in GAINS.items():
        assert found.coefficients[name] == pytest.approx(true, abs=max(3.0 * found.half_widths[name], 60.0))
    assert found.half_widths["mv_minus"] < 300.0


def test_interval_of_equal_differences_is_that_of_a_mean() -> None:
    """Of 1 and 3: standard error 1, and 12.706 for one degree of freedom in any table of Student's t."""
    ratio, half_width = _ratio(np.array([1.0, 3.0]), np.ones(2))
    assert ratio == pytest.approx(2.0, rel=1e-12, abs=0.0)
    assert half_width == pytest.approx(12.706, rel=1e-4, abs=0.0)


def test_small_differences_do_not_carry_the_coefficients_away() -> None:
    """0.04 um on each cell's mean makes single ratios of (17) large, and their means 20 to 40 % too large."""
    found = identify_volume_area([motif_print(VolumeAreaDeposition(), 75, 0.04e-6)], 0.04e-6)
    for name in ("mv_plus", "mv_minus", "ma_minus"):
        assert found.coefficients[name] == pytest.approx(GAINS[name], rel=0.1, abs=0.0)
        assert found.half_widths[name] < 0.15 * abs(GAINS[name])


def test_neighbours_that_gain_unequally_count_all() -> None:
    """Drops under surface tension leave nothing to corners: a median would take 0 for all neighbours."""
    found = identify_volume_area(list(experiments(liquid(), 12)), NOISE / PIXELS)
    assert -1700.0 < found.coefficients["mv_minus"] < -900.0
    assert max(error for error, _ in found.rms.values()) < 0.1


def test_differences_hidden_by_noise_are_refused_with_a_message() -> None:
    with pytest.raises(IdentificationError, match=r"mv_plus and .* differ by more than 24 µm .*; needs less noise"):
        identify_volume_area([motif_print(VolumeAreaDeposition(), 9)], 8e-6)


@pytest.mark.filterwarnings("error")
def test_error_of_drops_that_left_nothing_is_no_share() -> None:
    nothing = DropSample(TWO_PRIOR, *(np.zeros((3, 3)) for _ in range(4)))
    assert np.isnan(_relative_rms(nothing, VolumeAreaDeposition(), area_known=True))
    assert _share(float("nan")) == "-"
    assert _share(0.125) == "12.5%"


def test_layers_leave_three_empty_cells_around_them() -> None:
    for pattern in designs.layers(20, 12, 7):
        framed = np.pad(pattern[3:-3, 3:-3], 3)
        np.testing.assert_array_equal(pattern, framed)
    assert all(pattern[3].any() and pattern[:, -4].any() for pattern in designs.layers(20, 12, 3)[1:])
    record = made_up(LayerDeposition(), designs.layers(20, 12, 3), 0.3e-6)
    assert noise_of([record]) == pytest.approx(0.3e-6, rel=0.3, abs=0.0)
    with pytest.raises(ValueError, match="more than 6 cells each way"):
        designs.layers(6, 20, 1)


def test_without_areas_cells_with_ink_count_as_covered() -> None:
    found = identify_volume_area([motif_print(LayerDeposition(), 9)], 0.0)
    assert not found.area_known
    assert found.coefficients["ma_minus"] == VolumeAreaDeposition.ma_minus
    assert found.coefficients["height_scale"] == pytest.approx(7.6e-6, rel=1e-9, abs=0.0)


def test_drops_that_never_fell_alone_are_refused_with_a_message() -> None:
    full = np.ones((9, 9), np.int32)
    with pytest.raises(IdentificationError, match="0 drops fell alone between two prior drops"):
        identify_volume_area([made_up(VolumeAreaDeposition(), [full, full])], 0.0)
