"""Invariants of the regression that finds h1, h2, h3 from noisy layers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from inkloop_lab.identify import designs
from inkloop_lab.identify.droplet_volume import Freedom, improved_heights
from inkloop_lab.identify.expected_increments import expected_rates, expected_share
from inkloop_lab.identify.ink_regression import InkEstimate, _blocks, _Errors, _Variances, identify_ink
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, noise_of, record_of
from inkloop_lab.identify.scan_geometry import ScanGeometry
from inkloop_lab.identify.surface_filter import innovations, start_surface
from inkloop_lab.models import LayerDeposition, YoungLaplaceDeposition
from inkloop_lab.models.layer_deposition import CELLS_OF_HEIGHTS, HEIGHTS_BY_REACH
from support.logged_print import made_up, random_layers
from support.places import SCENARIOS
from support.prints import LITTLE_WORK

TRUE = np.array([4.4, 0.6, 0.2])
FAR = (4.4e-6, 0.6e-6, 0.2e-6, 0.15e-6, 0.1e-6, 0.05e-6)
FARTHEST = (*FAR, 0.04e-6, 0.03e-6, 0.02e-6, 0.01e-6)
TWO = ((4.4e-6, 0.6e-6, 0.2e-6), (3.0e-6, 0.5e-6, 0.3e-6))
LU = LayerDeposition()


def relative_errors(prints, noise, **options):
    """(prints, 3): found over true heights, less 1."""
    return np.array([identify_ink([one], noise, **options).heights[0] * 1e6 / TRUE - 1.0 for one in prints])


def test_mean_share_is_the_mean_over_normal_rises() -> None:
    rises = np.random.default_rng(5).normal(-1e-6, 2e-6, 200_000)
    sampled = np.clip(1.0 + rises / 5e-6, 0.0, 1.0).mean()
    found = expected_share(np.array([-1e-6]), np.array([4e-12]), np.array([5e-6]))
    assert found[0] == pytest.approx(sampled, abs=2e-3)


@pytest.mark.parametrize(
    "heights",
    [((4.4e-6, 0.6e-6, 0.2e-6),), TWO, (FAR,), (FARTHEST,)],
    ids=["reach 1", "two inks", "reach 2", "reach 3"],
)
@pytest.mark.parametrize("passes", [1, 4])
def test_rates_of_a_known_surface_are_the_layer_map(heights, passes) -> None:
    generator = np.random.default_rng(3)
    height, pattern = generator.uniform(0.0, 9e-6, (8, 7)), generator.integers(0, len(heights) + 1, (8, 7))
    colours = (0, 1, 2, 3) if passes == 4 else ()
    rates, _ = expected_rates(height, np.zeros((8, 7)), pattern.astype(np.int32), np.array(heights), colours)
    model = LayerDeposition(heights, passes)
    after = model.layer(model.start(height), pattern.astype(np.int32)).height
    assert height + np.tensordot(np.array(heights), rates) == pytest.approx(after, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    "model",
    [LayerDeposition(passes=4, pass_order=2, pass_rotation=1), LayerDeposition((FAR,))],
    ids=["four passes", "reach 2"],
)
def test_exact_scans_give_the_ink_of_other_forms(model) -> None:
    found = identify_ink([made_up(model, random_layers(16, 14, 4, 1))], 0.0, reach=model.reach)
    assert found.heights[0] == pytest.approx(model.heights[0], rel=1e-5, abs=0.0)


@pytest.mark.parametrize(
    "model", [LU, LayerDeposition((FAR,)), LayerDeposition(TWO)], ids=["Lu", "reach 2", "two inks"]
)
def test_conserved_volume_leaves_exact_inks_as_they_are(model) -> None:
    """Two inks in one print: what each adds is told apart by the counts of their droplets."""
    patterns = random_layers(16, 14, 5, 1, margin=3)
    if len(model.heights) == 2:
        patterns = [pattern * (1 + (k % 3 > 0)) for k, pattern in enumerate(patterns)]
    found = identify_ink([made_up(model, patterns)], 0.0, reach=model.reach, conserve=True)
    assert found.heights == pytest.approx(np.array(model.heights), rel=1e-5, abs=0.0)


def test_conserved_volume_is_that_of_the_droplets_of_a_plant_of_another_kind() -> None:
    """Left free, the heights take 3 % more ink from each droplet of this plant than it has."""
    plant = YoungLaplaceDeposition(42.3e-6, 30e-15, np.radians(45.0), "linear", 4)
    record, own = made_up(plant, random_layers(16, 16, 3, 0, margin=3)), 30e-15 / 42.3e-6**2
    kept, free = (identify_ink([record], 0.0, correct=False, reach=2, conserve=conserve) for conserve in (True, False))
    cells = np.array(CELLS_OF_HEIGHTS[: HEIGHTS_BY_REACH[2]])
    assert cells @ kept.heights[0] == pytest.approx(own, rel=1e-3, abs=0.0)
    assert cells @ free.heights[0] > 1.01 * own
    assert cells @ kept.covariance @ cells == pytest.approx(0.0, abs=1e-9 * np.trace(kept.covariance))
    assert kept.half_widths[0][0] > 0.0


def test_volume_that_scans_do_not_show_is_refused_with_a_message() -> None:
    with pytest.raises(IdentificationError, match=r"within 2 cells of the edge .*leave 2 empty cells"):
        identify_ink([made_up(LU, random_layers(12, 12, 2, 0, margin=1))], 0.0, reach=2, conserve=True)
    for cell in ((6, 1), (6, 10), (1, 6), (10, 6)):
        pattern = np.zeros((12, 12), np.int32)
        pattern[cell] = pattern[6, 6] = 1
        with pytest.raises(IdentificationError, match="within 2 cells of the edge"):
            identify_ink([made_up(LU, [pattern])], 0.0, reach=2, conserve=True)
    record = made_up(LU, random_layers(14, 14, 3, 0, margin=3))
    record.measured[0, 7, 7] = np.nan
    with pytest.raises(IdentificationError, match="takes scans of all cells that droplets reach"):
        identify_ink([record], 0.0, conserve=True)


@pytest.mark.system
def test_closed_loop_with_exact_scans_identifies_its_ink() -> None:
    """Droplets lack 10 % on average; a few nearly exact growths must not outweigh all others."""
    size = {"grid": {"nx": 18, "ny": 18}, "part": {"radius_um": 1600.0, "height_um": 150.0}, **dict(LITTLE_WORK)}
    result = print_part(Scenario.load(SCENARIOS / "cylinder.toml", size))
    found = identify_ink([record_of(result, "cylinder")], 0.0).heights[0] * 1e6
    assert found == pytest.approx(0.9 * TRUE, rel=0.03, abs=0.0)


def test_two_inks_are_distinguished() -> None:
    patterns = [np.random.default_rng(k).integers(0, 3, (20, 20)).astype(np.int32) for k in range(4)]
    found = identify_ink([made_up(LayerDeposition(TWO), patterns, 0.1e-6)], 0.1e-6)
    assert found.heights * 1e6 == pytest.approx(np.array(TWO) * 1e6, abs=0.02)


@pytest.mark.system
def test_one_small_layer_of_the_laser_at_its_best_gives_2_3_and_10_percent() -> None:
    """20 x 20 cells, 0.3 um noise; the pattern is the first of the designed layers, over the whole grid."""
    patterns = designs.layers(20, 20, 1, margin=1)
    errors = relative_errors([made_up(LU, patterns, 0.3e-6, seed) for seed in range(20)], 0.3e-6)
    assert (np.abs(errors).max(axis=0) < [0.02, 0.03, 0.10]).all()


@pytest.mark.long
def test_noise_of_the_scans_biases_plain_regression_but_not_ours() -> None:
    prints = [made_up(LU, random_layers(30, 30, 5, seed), 1e-6, seed) for seed in range(6)]
    plain = relative_errors(prints, 1e-6, correct=False).mean(axis=0)
    ours = relative_errors(prints, 1e-6).mean(axis=0)
    assert plain[0] < -0.06
    assert plain[2] > 0.2
    assert (np.abs(ours) < [0.006, 0.02, 0.05]).all()


@pytest.mark.system
def test_varied_droplets_give_the_mean_ink_with_intervals_that_hold() -> None:
    prints = [made_up(LU, random_layers(24, 24, 4, seed), 0.5e-6, seed, variation=0.4) for seed in range(8)]
    found = [identify_ink([one], 0.5e-6) for one in prints]
    inside = [np.abs(one.heights[0] * 1e6 - 0.8 * TRUE) <= one.half_widths[0] * 1e6 for one in found]
    assert np.mean(inside) >= 0.8
    assert np.mean([one.heights[0] for one in found], axis=0) * 1e6 == pytest.approx(0.8 * TRUE, rel=0.03, abs=0.0)
    spread = 0.4 / np.sqrt(12.0) / 0.8
    assert np.mean([one.droplet_std for one in found]) == pytest.approx(spread, rel=0.35, abs=0.0)


def test_half_width_is_that_of_a_95_percent_interval_of_student() -> None:
    found = InkEstimate(np.array([[4e-6, 1e-6, 0.0]]), np.diag([1e-18, 4e-18, 9e-18]), 5, 0.0, 0.0, 1)
    np.testing.assert_allclose(found.half_widths[0], 2.5705818 * np.array([1e-9, 2e-9, 3e-9]), rtol=1e-6)


def test_errors_depend_on_each_other_within_blocks_of_one_print() -> None:
    """16 x 12 cells are 12 blocks of 4 x 4; the same print again is 12 more, which halve the variance."""
    record = made_up(LU, random_layers(16, 12, 3, 4), 0.3e-6, variation=0.2)
    one, both = identify_ink([record], 0.3e-6), identify_ink([record, record], 0.3e-6)
    assert (one.degrees, both.degrees) == (12 - 3, 24 - 3)
    np.testing.assert_allclose(both.heights, one.heights, rtol=1e-6)
    ratio = 0.5 * (24 / 21) / (12 / 9)
    np.testing.assert_allclose(np.diag(both.covariance), ratio * np.diag(one.covariance), rtol=1e-6)


@pytest.mark.parametrize("shape", [(9, 17), (17, 9)])
def test_blocks_are_squares_of_four_cells(shape: tuple[int, int]) -> None:
    found = _blocks(shape)
    i, j = np.indices(shape) // 4
    assert len({*zip(i.ravel().tolist(), j.ravel().tolist(), found.ravel().tolist(), strict=True)}) == 15
    assert len(np.unique(found)) == 15


def errors_of(**values: list[float]) -> _Errors:
    """Errors of three readings on even ground and three at walls."""
    zero = np.zeros(6)
    known = {"error": zero, "variance": zero, "squares": zero, "steepness": zero, "block": np.zeros(6, np.int64)}
    arrays = {name: np.array(value) for name, value in values.items()}
    return _Errors(**{**known, **arrays}, sensitivity=np.zeros((0, 6)))


def test_droplets_are_judged_on_even_ground_and_places_at_walls() -> None:
    """A reading is at a wall where its place makes more than half of its variance; changes are damped by their root."""
    sides = {"squares": [1.0, 1.0, 2.0, 1.0, 1.0, 1.0], "steepness": [0.0, 0.0, 4.9, 5.1, 10.0, 20.0]}
    found = _Variances(0.5, 0.01).improved(errors_of(variance=[0.1] * 6, error=[0.3, 0.3, 0.5, 0.5, 0.6, 0.7], **sides))
    droplets = 0.5 + (0.09 + 0.09 + 0.25 - 0.3) / 4.0
    place = 0.01 + (0.25 + 0.36 + 0.49 - 0.3) / 35.1
    assert found.droplets == pytest.approx(np.sqrt(0.5 * droplets), rel=1e-9, abs=0.0)
    assert found.place == pytest.approx(np.sqrt(0.01 * place), rel=1e-9, abs=0.0)


def test_variances_change_tenfold_at_most_and_places_are_never_exact() -> None:
    sides = {"squares": [1.0, 1.0, 1.0, 0.0, 0.0, 0.0], "steepness": [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]}
    large, none = errors_of(error=[9.0] * 6, **sides), errors_of(variance=[1e-9] * 6, **sides)
    found = _Variances(0.09, 2e-5).improved(large)
    assert (found.droplets, found.place) == pytest.approx((0.09 * 10**0.5, 2e-5 * 10**0.5), rel=1e-9, abs=0.0)
    found = _Variances(0.09, 2e-5).improved(none)
    assert found.droplets == pytest.approx(0.09, rel=1e-6, abs=0.0)
    small = errors_of(variance=[1.0] * 3 + [1e-5] * 3, **sides)
    found = _Variances(0.09, 2e-5).improved(small)
    assert found.droplets == pytest.approx(0.09 / 10**0.5, rel=1e-9, abs=0.0)
    assert found.place == pytest.approx(0.004**2, rel=1e-9, abs=0.0)
    flat = errors_of(error=[1.0] * 6)
    assert _Variances(0.09, 2e-5).improved(flat) == _Variances(0.09, 2e-5)


def test_unexplained_variance_is_of_cells_that_droplets_reach_beyond_the_noise() -> None:
    """The median of a squared normal number is 0.455; a margin holds cells without any droplet."""
    record = made_up(LU, random_layers(18, 15, 3, 2, margin=4), 0.4e-6, variation=0.5)
    found = identify_ink([record], 0.4e-6)
    geometry = ScanGeometry.in_register(record.shape, 3)
    steps = list(innovations(record, found.heights, 0.4e-6, found.droplet_std**2, geometry))
    left = np.concatenate([step.error[step.squares > 0.0] for step in steps])
    assert left.size < 0.8 * sum(step.error.size for step in steps)
    expected = np.median(left**2) / 0.4549364 - 0.16e-12
    assert expected > 0.16e-12
    assert found.unexplained == pytest.approx(expected, rel=0.01, abs=0.0)


def test_droplet_that_adds_less_in_its_middle_than_its_neighbours_get_is_refused() -> None:
    growth, pattern = np.zeros((15, 15)), np.zeros((15, 15), np.int32)
    for i in (3, 7, 11):
        for j in (3, 7, 11):
            pattern[i, j] = 1
            growth[i - 1 : i + 2, j - 1 : j + 2] += 1e-6
            growth[i, j] = -1.5e-6
    record = PrintRecord("ring", 1e-4, pattern[None], np.stack([np.zeros((15, 15)), growth]))
    with pytest.raises(IdentificationError, match="add less than their neighbours get at a reach of 1; fit reach 1"):
        identify_ink([record], 0.0, conserve=True)
    assert identify_ink([record], 0.0).heights[0][0] >= 0.0  # left free, none is below 0


@pytest.mark.parametrize("last", [0.5, -0.5])
@pytest.mark.parametrize("conserve", [False, True])
def test_heights_are_the_least_squares_of_at_least_0_from_any_first_guess(conserve: bool, last: float) -> None:
    """Of a linear problem, by another solver; in a conserved volume of 9 the first height is what the others leave."""
    rng = np.random.default_rng(5)
    sensitivity, weight = rng.normal(size=(3, 40)), rng.uniform(0.1, 2.0, 40)
    guess, true = np.array([[6.0, 3.0, 1.0]]), np.array([4.0, 1.0, last])
    error = sensitivity.T @ (true - guess[0]) + 0.3 * rng.normal(size=40)
    freedom = Freedom.of((1, 3), np.array([9.0]) if conserve else None)
    found = improved_heights(sensitivity, weight, error, guess, freedom)
    basis = np.array([[-4.0, -4.0], [1.0, 0.0], [0.0, 1.0]]) if conserve else np.eye(3)
    offset, root = np.array([9.0 * conserve, 0.0, 0.0]), np.sqrt(weight)
    wanted = root * (error + sensitivity.T @ (guess[0] - offset))
    free = lsq_linear(root[:, None] * (sensitivity.T @ basis), wanted, (0.0, np.inf), method="bvls").x
    np.testing.assert_allclose(found[0], offset + basis @ free, rtol=1e-6, atol=1e-9)


def test_material_and_heights_that_patterns_do_not_separate_are_named() -> None:
    """Material B is jetted in one full layer on flat ground only."""
    patterns = [np.full((16, 16), 2, np.int32), *random_layers(16, 16, 2, 3)]
    middle = np.pad(np.ones((10, 10), bool), 3)
    with pytest.raises(IdentificationError) as caught:
        identify_ink([made_up(LayerDeposition(TWO), patterns)], 0.0, cells=[middle])
    assert str(caught.value).startswith(
        "the patterns do not separate h1 of material B, h2 of material B, h3 of material B from the others; print"
    )


@pytest.mark.long
def test_95_percent_intervals_cover_the_true_heights_that_often() -> None:
    """60 prints of three heights; 95 % with a standard error of some 2 %."""
    found = [
        identify_ink([made_up(LU, random_layers(20, 20, 4, seed), 0.5e-6, seed, variation=0.2)], 0.5e-6)
        for seed in range(60)
    ]
    inside = [np.abs(one.heights[0] * 1e6 - 0.9 * TRUE) <= one.half_widths[0] * 1e6 for one in found]
    assert 0.9 <= np.mean(inside) <= 0.995


def test_rough_start_surface_is_no_obstacle() -> None:
    start = np.random.default_rng(9).normal(0.0, 2e-6, (30, 30))
    found = identify_ink([made_up(LU, random_layers(30, 30, 3, 4), 0.4e-6, 4, start=start)], 0.4e-6)
    assert (np.abs(found.heights[0] * 1e6 / TRUE - 1.0) < [0.02, 0.04, 0.1]).all()


def test_plane_start_surface_is_known_better_than_a_scan() -> None:
    i, j = np.indices((20, 20))
    plane = 1e-7 * i + 2e-7 * j
    mean, variance = start_surface(plane + np.random.default_rng(2).normal(0.0, 1e-6, (20, 20)), 1e-6)
    assert np.sqrt(np.mean((mean - plane) ** 2)) < 0.2e-6
    assert variance.max() < 0.05e-12


def test_rough_start_surface_is_that_of_its_statement() -> None:
    """Of few cells, of which one was not seen: three terms of the plane are no evidence of roughness."""
    scan = np.random.default_rng(5).normal(0.0, 3e-6, (3, 4))
    scan[1, 2] = np.nan
    seen, noise = np.isfinite(scan), 1e-12
    i, j = np.repeat(np.arange(3), 4).reshape(3, 4), np.tile(np.arange(4), (3, 1))
    terms = np.stack([np.ones(11), i[seen], j[seen]])
    plane = np.tensordot(np.linalg.solve(terms @ terms.T, terms @ scan[seen]), [np.ones((3, 4)), i, j], axes=1)
    rough = ((scan - plane)[seen] ** 2).sum() / (11 - 3) - noise
    gain = rough / (rough + noise)
    mean, variance = start_surface(scan, 1e-6)
    np.testing.assert_allclose(mean[seen], (plane + gain * (scan - plane))[seen], rtol=1e-9)
    np.testing.assert_allclose(mean[1, 2], plane[1, 2], rtol=1e-9)
    np.testing.assert_allclose(variance, np.where(seen, gain * noise, np.inf), rtol=1e-9)


def test_cells_that_were_not_measured_are_left_out() -> None:
    record = made_up(LU, random_layers(20, 20, 3, 2), 0.0)
    record.measured[np.random.default_rng(1).random(record.measured.shape) < 0.1] = np.nan
    found = identify_ink([record], 1e-10)
    assert found.heights[0] * 1e6 == pytest.approx(TRUE, rel=0.01, abs=0.0)
    assert found.used < 0.95 * 3 * 400


def test_noise_is_read_from_untouched_cells() -> None:
    record = made_up(LU, random_layers(40, 40, 4, 2, margin=5), 0.7e-6)
    assert noise_of([record]) == pytest.approx(0.7e-6, rel=0.05, abs=0.0)
    assert noise_of([made_up(LU, random_layers(10, 10, 1, 2))]) is None
    few = PrintRecord("few", 1e-4, np.zeros((1, 5, 4), np.int32), np.stack([np.zeros((5, 4)), np.full((5, 4), 2e-6)]))
    assert noise_of([few]) == pytest.approx(2e-6 / 2.0**0.5, rel=1e-9, abs=0.0)  # twenty differences
    few.measured[1, 2, 2] = np.nan
    assert noise_of([few]) is None
    few.pattern[0, 2, 2] = 2
    assert few.untouched(1).sum() == 20 - 9
    spilt = replace(few, pattern=few.pattern.repeat(2, 1).repeat(2, 2), measured=np.zeros((2, 10, 8)))
    spilt.measured[1, 2, 2:4] = 1e-6  # within two cells of the droplets, not within one
    assert noise_of([spilt]) == 0.0


def test_patterns_that_separate_nothing_are_refused_with_a_message() -> None:
    """In the middle of a full layer on flat ground every cell grows by h1 + 4 h2 + 4 h3."""
    record, middle = made_up(LU, [np.ones((12, 12), np.int32)]), np.pad(np.ones((8, 8), bool), 2)
    with pytest.raises(IdentificationError, match=r"do not separate .*h3 of material A.*stripes"):
        identify_ink([record], 0.0, cells=[middle])


def test_surface_that_sinks_and_patterns_without_droplets_are_refused_with_a_message() -> None:
    record = made_up(LU, random_layers(8, 8, 2, 0))
    record.measured[:] = -record.measured
    with pytest.raises(IdentificationError, match=r"the surface sank by \d\.\d+ µm per droplet"):
        identify_ink([record], 0.0)
    with pytest.raises(IdentificationError, match="no layer has a droplet"):
        identify_ink([made_up(LU, [np.zeros((8, 8), np.int32)])], 0.0)
