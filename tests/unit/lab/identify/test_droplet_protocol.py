"""Invariants of what single droplets show: the protocol of Lu et al. and the coefficients of Wu and Chiu."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from inkloop_lab.identify import designs
from inkloop_lab.identify.command import _share
from inkloop_lab.identify.droplet_protocol import identify_by_protocol, motif_centres
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, noise_of
from inkloop_lab.identify.volume_area_coefficients import (
    TWO_PRIOR,
    DropSample,
    _covered,
    _errors,
    _groups,
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
    with pytest.raises(IdentificationError, match=r"mv_plus and .* differ by more than 24 µm .*; needs less noise$"):
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


def first_layer(rises: Mapping[str, Sequence[float]], side: int = 40) -> PrintRecord:
    """Motifs that stand alone, with these rises of their centres; the rest of the scan after the layer is level."""
    pattern, measured = np.zeros((1, side, side), np.int32), np.zeros((2, side, side))
    places = ((i, j) for i in range(3, side - 3, 6) for j in range(3, side - 3, 6))
    for name, values in rises.items():
        for value, (i, j) in zip(values, places, strict=False):
            pattern[0, i - 1 : i + 2, j - 1 : j + 2] = designs.motif(designs.DROPLET_MOTIFS[name])
            measured[1, i, j] = value
            if name == "corner":  # each of its two droplets is a centre
                measured[1, i - 1, j - 1] = value
    return PrintRecord("it", 1e-4, pattern, measured)


RISES = {"single": [4e-6, 5e-6, 6e-6], "side": [8e-6, 9e-6, 9e-6, 10e-6], "corner": [5e-6, 5e-6, 5.5e-6, 6e-6, 6e-6]}


def test_heights_of_the_protocol_have_the_errors_of_their_means() -> None:
    """By hand: h2 = (side - single) / 4, h3 = corner - single; 4.303 for two degrees of freedom of three samples."""
    found = identify_by_protocol([first_layer(RISES)], 0.0)
    assert found.counts == {"single": 3, "side": 4, "corner": 10}
    assert found.heights == pytest.approx((5e-6, 1e-6, 0.5e-6), rel=1e-9, abs=0.0)
    single, side, corner = 1.0 / 3, (2.0 / 3) / 4, (2.0 / 9) / 10
    errors = np.sqrt([single, (single + side) / 16, single + corner])
    np.testing.assert_allclose(found.half_widths, 4.302653 * 1e-6 * errors, rtol=1e-6)


def test_protocol_leaves_out_cells_not_seen_and_prints_in_two_inks_and_needs_three_samples() -> None:
    record, two = first_layer(RISES), first_layer({name: [1e-6] * 9 for name in RISES})
    two.pattern[0, 0, 0] = 2
    record.measured[1, 0, 0] = np.nan  # no centre
    assert identify_by_protocol([record, two], 0.0).counts == {"single": 3, "side": 4, "corner": 10}
    empty = PrintRecord("no layer", 1e-4, np.zeros((0, 40, 40), np.int32), np.zeros((1, 40, 40)))
    assert identify_by_protocol([record, empty], 0.0).counts["side"] == 4
    i, j = np.argwhere(record.measured[1] == 8e-6)[0]
    record.measured[1, i, j] = np.nan
    assert identify_by_protocol([record], 0.0).counts["side"] == 3
    i, j = np.argwhere(record.measured[1] == 4e-6)[0]
    record.measured[1, i, j] = np.nan
    with pytest.raises(IdentificationError, match="hold 2 single, 3 side, 10 corner motifs that stand alone"):
        identify_by_protocol([record], 0.0)


def test_start_surface_is_a_plane_where_its_scan_is_as_even_as_its_noise() -> None:
    record = first_layer(RISES)
    record.measured[0] = np.random.default_rng(1).normal(0.0, 1e-6, record.shape)
    assert identify_by_protocol([record], 1e-6).heights[0] == pytest.approx(5e-6, abs=0.2e-6)
    centres = np.argwhere(record.measured[1] > 0.0)[:3]
    taken_off = 5e-6 - np.mean([record.measured[0][tuple(cell)] for cell in centres])
    assert abs(taken_off - 5e-6) > 0.21e-6  # what single readings of the start would make of it


def test_motifs_are_as_many_on_oblong_grids_with_a_margin_of_a_tile() -> None:
    for nx, ny in ((25, 70), (70, 25)):
        first, second = designs.droplets(nx, ny, 3)
        counts = {name: np.count_nonzero(centres) for name, centres in motif_centres(first).items()}
        # 3 x 12 tiles for eleven motifs: the first three of them come once more
        assert (counts["side"], counts["corner"]) == (4, 8)  # each droplet of a corner is a centre
        assert np.count_nonzero(second) == 36 - 3 * 4
        framed = np.pad((first + second)[5:-5, 5:-5], 5)
        np.testing.assert_array_equal(first + second, framed)
        assert first[:, -10:].any()
        assert first[-10:].any()


@pytest.mark.parametrize(("nx", "ny"), [(20, 12), (12, 20)])
def test_first_layer_is_a_checkerboard_and_stripes_and_others_are_as_dense_as_told(nx: int, ny: int) -> None:
    first = designs.layers(nx, ny, 1, margin=1)[0][1:-1, 1:-1]
    i, j = np.indices((nx - 2, ny - 2)) + 1
    np.testing.assert_array_equal(first, np.where(i < nx // 2, (i + j) % 2, j % 2))
    dense = [pattern.mean() for pattern in designs.layers(90, 80, 5, margin=0)[1:]]
    assert dense == pytest.approx([0.5, 0.75, 0.25, 0.5], abs=0.02)
    assert not designs.layers(7, 7, 1)[0][[0, 1, 2, 4, 5, 6]].any()  # one cell is inside
    with pytest.raises(ValueError, match="the grid is 6 x 9; needs more than 6 cells each way around a margin of 3"):
        designs.layers(6, 9, 1)


def lone_drops(*layers: Sequence[tuple[int, int]], shape: tuple[int, int] = (9, 12)) -> PrintRecord:
    """A print with droplets on these cells; each adds 1 um to its cell, and a layer its number in nm everywhere."""
    pattern = np.zeros((len(layers), *shape), np.int32)
    for number, cells in enumerate(layers):
        for cell in cells:
            pattern[number, cell[0], cell[1]] = 1
    grown = np.cumsum(pattern * 1e-6 + 1e-9 * np.arange(1, 1 + len(layers))[:, None, None], axis=0)
    return PrintRecord("it", 1e-4, pattern, np.concatenate([np.zeros((1, *shape)), grown]))


@pytest.mark.parametrize(
    ("prior", "name"),
    [
        ([(3, 4), (5, 4)], TWO_PRIOR),
        ([(4, 3), (4, 5)], TWO_PRIOR),
        ([(3, 4), (4, 3)], "2"),
        ([(3, 3), (5, 5)], "2"),
        ([(3, 4), (5, 4), (4, 3)], "3"),
        ([], "0"),
    ],
)
def test_drop_is_known_by_the_drops_around_it(prior: list[tuple[int, int]], name: str) -> None:
    (sample,) = drop_samples([lone_drops(prior, [(4, 4)])], 0.0)
    assert sample.prior == name
    record = lone_drops(prior, [(4, 4)])
    np.testing.assert_allclose(sample.height, record.measured[1, 3:6, 3:6], rtol=1e-12)
    np.testing.assert_allclose(sample.height_after, record.measured[2, 3:6, 3:6], rtol=1e-12)


def test_drops_that_touch_others_the_edge_or_their_own_place_are_no_samples() -> None:
    def count(*layers: Sequence[tuple[int, int]]) -> int:
        return len(drop_samples([lone_drops(*layers)], 0.0))

    assert count([(4, 4)]) == 0  # the first layer falls on nothing
    assert count([], [(4, 4), (4, 6)]) == 0  # within two cells
    assert count([], [(4, 4), (4, 7)]) == 2
    for cell in ((0, 4), (8, 4), (4, 0), (4, 11)):
        assert count([], [cell]) == 0
    assert [count([], [cell]) for cell in ((1, 4), (7, 4), (4, 1), (4, 10))] == [1] * 4
    assert count([(4, 4)], [(4, 4)]) == 0  # onto a drop
    assert count([(4, 3)], [(4, 3)], [(4, 4)]) == 0  # beside two, one on the other
    assert count([], [(4, 4)], [(4, 8)]) == 2  # of all later layers
    record = lone_drops([], [(4, 4)], [(4, 8)])
    record.measured[3, 4, 9] = np.nan
    assert len(drop_samples([record], 0.0)) == 1


def test_estimate_of_drops_without_areas_says_so_and_is_kept_in_bounds() -> None:
    records = [
        motif_print(VolumeAreaDeposition(), 9, 5e-9),
        replace(motif_print(VolumeAreaDeposition(), 9, 5e-9, seed=1), area=None),
    ]
    found = identify_volume_area(records, 5e-9)
    assert not found.area_known
    assert np.isnan([found.half_widths["ma_plus"], found.half_widths["ma_minus"]]).all()
    model = found.model(80e-6)
    assert (model.guard, model.limit_gains, model.pitch) == (True, True, 80e-6)
    samples = drop_samples(records, 5e-9)
    grown = np.array([(sample.height_after - sample.height).sum() for sample in samples])
    expected = 1.96 * np.std(grown, ddof=1) / np.sqrt(grown.size)
    assert found.half_widths["height_scale"] == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert found.counts["0"] == sum(sample.prior == "0" for sample in samples)


def test_cells_with_more_than_a_tenth_of_a_drop_count_as_covered() -> None:
    height = np.array([[0.0, 0.9, 1.1], [0.0, 5.0, 0.0], [0.0, 0.0, 2.0]]) * 1e-6
    found = _covered(DropSample("0", height, 3.0 * height, height, height), 10e-6)
    np.testing.assert_array_equal(found.area, height > 1e-6)
    np.testing.assert_array_equal(found.area_after, height > 0.5e-6)
    np.testing.assert_array_equal(found.height_after, 3.0 * height)


def test_groups_are_of_three_samples_and_a_rest_is_left_out() -> None:
    samples = [DropSample("1", *(np.full((3, 3), 4.0**k) for _ in range(4))) for k in range(8)]
    groups = _groups(samples, np.random.default_rng(1))
    sums = [3.0 * group.area_after[0, 0] for group in groups]
    assert len(groups) == 2
    digits = [[int(value) // 4**k % 4 for k in range(8)] for value in np.round(sums)]
    assert [sum(each) for each in digits] == [3, 3]
    assert max(np.sum(digits, axis=0)) == 1  # none is in two groups
    assert _groups(samples[:2], np.random.default_rng(1)) == []


def test_error_of_a_single_group_has_no_spread() -> None:
    sample = drop_samples([lone_drops([(4, 3)], [(4, 4)])], 0.0)
    error, spread = _errors(sample, VolumeAreaDeposition(), area_known=False)
    assert np.isnan(spread)
    assert error == _relative_rms(sample[0], VolumeAreaDeposition(), area_known=False)
    _, spread = _errors(
        [
            *sample,
            DropSample("1", sample[0].height, 2.0 * sample[0].height_after, sample[0].area, sample[0].area_after),
        ],
        VolumeAreaDeposition(),
        area_known=False,
    )
    other = DropSample("1", sample[0].height, 2.0 * sample[0].height_after, sample[0].area, sample[0].area_after)
    each = [_relative_rms(one, VolumeAreaDeposition(), area_known=False) for one in (sample[0], other)]
    assert spread == pytest.approx(abs(each[0] - each[1]) / 2.0**0.5, rel=1e-9, abs=0.0)


def test_error_counts_cells_with_ink_by_mean_heights_where_areas_are_unknown() -> None:
    """By hand, without gains a drop stays on its cell: c there, nothing else changes."""
    model = VolumeAreaDeposition(
        height_scale=10e-6, mv_plus=0.0, mv_minus=0.0, ma_plus=0.0, ma_minus=0.0, cap_radius=1e-6
    )
    height, area = np.zeros((3, 3)), np.zeros((3, 3))
    height[0, 1], area[0, 1] = 4e-6, 0.5
    after, area_after = height.copy(), area.copy()
    after[0, 1], after[1, 1], area_after[1, 1] = 5e-6, 8e-6, 0.4
    sample = DropSample("1", height, after, area, area_after)
    by_mean = np.sqrt((((5.0 - 4.0) / 5.0) ** 2 + ((8.0 - 10.0) / 8.0) ** 2) / 2.0)
    assert _relative_rms(sample, model, area_known=False) == pytest.approx(by_mean, rel=1e-6, abs=0.0)
    by_covered = np.sqrt((((10.0 - 8.0) / 10.0) ** 2 + ((20.0 - 10.0) / 20.0) ** 2) / 2.0)
    assert _relative_rms(sample, model, area_known=True) == pytest.approx(by_covered, rel=1e-6, abs=0.0)
