"""Logs whose scans do not show their patterns are refused by name; right ones, of whatever plant, are not."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.metrology.registration import Registration
from inkloop_lab.identify import designs
from inkloop_lab.identify.log_folder import read_log
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.scan_hypotheses import LAGS, TURNS, _added, _explained, _growths, first_shift
from support.logged_print import CELL, PITCH, log
from support.lying_scans import profiler as rig
from support.lying_scans.log import logged
from support.lying_scans.plant import CAP, WIDE, Plant
from support.lying_scans.profiler import Profiler

NOISY = Profiler(noise=1.0)
BACK = {
    "mirrored in x": "mirrored in x",
    "mirrored in y": "mirrored in y",
    "transposed": "transposed",
    "turned by 90": "turned by 270 degrees",
    "turned by 180": "turned by 180 degrees",
    "turned by 270": "turned by 90 degrees",
    "transposed and turned": "transposed and turned by 180 degrees",
}
"""Transforms of the scans by the profiler of the rig, and their inverses."""
OBLONG = ("mirrored in x", "mirrored in y", "turned by 180")
PLANTS = {
    "no flow": Plant(flows=False),
    "caps": Plant(CAP, flows=False),
    "wide": Plant(WIDE),
    "bleeding": Plant(bleeding=0.15),
    "satellites": Plant(satellites=0.03),
    "volume falls": Plant(volume_loss=0.3),
    "right half": Plant(volume_right=0.15),
    "shrinks": Plant(kept=0.97),
    "dead row": Plant(dry_rows=(12, 12), dry_from=3),
    "misplaced": Plant(placement=(-0.5, 0.2)),
    "retracting": Plant(contraction=(0.04, 0.0)),
    "varied": Plant(variation=0.4),
}


def layers(nx: int = 26, ny: int = 22, count: int = 5, seed: int = 2) -> list[Any]:
    return designs.layers(nx, ny, count, seed, margin=4)


def refusal(record: PrintRecord) -> str:
    with pytest.raises(IdentificationError) as caught:
        first_shift(record)
    return str(caught.value)


@pytest.mark.parametrize("shape", [(26, 22), (22, 26), (24, 24)])
@pytest.mark.parametrize("turn", BACK)
def test_turned_scans_are_named_with_what_brings_them_back(shape: tuple[int, int], turn: str) -> None:
    if shape[0] != shape[1] and turn not in OBLONG:
        return
    message = refusal(logged(replace(NOISY, turned=turn), layers(*shape)))
    assert f"log: the scans are {BACK[turn]}: so the droplets explain 6" in message
    assert "as recorded" in message
    assert TURNS[BACK[turn]][1] in message


@pytest.mark.parametrize("turn", BACK)
def test_remedy_for_turned_scans_brings_them_back(turn: str, tmp_path: Path) -> None:
    """As in print.toml: mirror, then rotation, then the offsets that bring the corner back."""
    surface = np.random.default_rng(3).random((5, 5))
    record = PrintRecord("it", PITCH, np.ones((1, 5, 5), np.int32), np.stack([surface, surface + 1.0]) * 1e-6)
    turned = replace(record, measured=np.stack([rig.TURNS[turn](scan) for scan in record.measured]))
    remedy = TURNS[BACK[turn]][1]
    mirror = next((axis for axis in "xy" if f'mirror = "{axis}"' in remedy), "none")
    angle = next((degrees for degrees in (270, 180, 90) if f"add {degrees} to" in remedy), 0)
    corners = np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * 4 * PITCH
    placed = Registration(0.0, 0.0, math.radians(angle), mirror=mirror).matrix @ corners.T  # type: ignore[arg-type]
    x, y = -placed.min(axis=1) * 1e6
    text = f'{CELL}mirror = "{mirror}"\nrotation_deg = {angle}.0\noffset_x_um = {x}\noffset_y_um = {y}\n'
    read = read_log(log(tmp_path / "log", turned, text))
    np.testing.assert_allclose(read.measured, record.measured, atol=1e-12)


def test_scans_a_layer_late_or_early_are_named() -> None:
    late = refusal(logged(replace(NOISY, late=1), layers()))
    assert "the scans come one layer late: so the droplets explain 6" in late
    assert LAGS["one layer late"][1] in late
    whole = logged(NOISY, layers(count=6))
    early = refusal(replace(whole, measured=whole.measured[1:], pattern=whole.pattern[:-1]))
    assert "the scans come one layer early" in early
    assert LAGS["one layer early"][1] in early


@pytest.mark.parametrize("count", [1, 2, 5])
def test_patterns_of_another_print_are_refused(count: int) -> None:
    """Of the same region; the first of the designed layers, which all prints have, is left out."""
    record = logged(NOISY, layers(count=count + 1)[1:])
    other = np.stack(layers(count=count + 1, seed=9)[1:])
    assert "its patterns explain" in refusal(replace(record, pattern=other))
    first_shift(record)


def test_scans_of_anything_else_are_refused() -> None:
    record, rng = logged(NOISY, layers()), np.random.default_rng(5)
    still = [rng.normal(0.0, 5e-6, record.measured.shape) for _ in range(8)]
    for surfaces in (*still, 8e-6 * rng.random(record.measured.shape).cumsum(0)):
        assert "its patterns explain" in refusal(replace(record, measured=surfaces))


def test_scans_that_do_not_grow_are_named_with_their_layers() -> None:
    assert "the scans do not grow in layer 3, 4, 5:" in refusal(logged(Profiler(frozen_from=3), layers()))
    assert "the scans do not grow in layer 5:" in refusal(logged(Profiler(frozen_from=5), layers()))
    record, noise = logged(NOISY, layers()), np.random.default_rng(1)
    again = record.measured[:3][[0, 1, 2, 2, 2, 2]] + noise.normal(0.0, 1e-6, record.measured.shape)
    assert "the scans do not grow in layer 3, 4, 5:" in refusal(replace(record, measured=again))
    assert "layer 3, 4, 5, 6, 7, ...:" in refusal(logged(Profiler(frozen_from=3), layers(count=9)))
    record = logged(Profiler(), layers(count=6))
    growth = np.diff(record.measured, axis=0) * np.reshape([1.0, 0.12, 1.0, 1.0, 0.0, 1.0], (6, 1, 1))
    slow = record.measured[0] + np.concatenate([np.zeros((1, *record.shape)), growth.cumsum(axis=0)])
    found = refusal(replace(record, measured=slow))
    assert re.search(r"do not grow in layer 2, 5: the droplets of layer 2 show 1[12]% of what those of other", found)
    for profiler in (Profiler(frozen_from=1), Profiler(zero=True)):
        assert "all scans are the same" in refusal(logged(profiler, layers()))


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("plant", PLANTS)
def test_right_log_of_any_plant_is_accepted(plant: str, noise: float) -> None:
    misplaced = np.array(PLANTS[plant].placement)
    shift = first_shift(logged(Profiler(noise=noise), layers(), 3, PLANTS[plant]))
    np.testing.assert_allclose(shift, -misplaced, atol=0.15)  # of the droplets, which nothing tells from one of scans


@pytest.mark.parametrize(
    "profiler",
    [Profiler(noise=10.0), Profiler(spot=1.0, noise=0.3), Profiler(offset=10.0, tilt=10.0, bow=5.0, noise=1.0),
     Profiler(dropouts=0.1, missing_every=3, noise=1.0), Profiler(rotation=2.0, magnification=-0.03, noise=1.0)],
    ids=["noisy", "wide spot", "levelled anew", "drop-outs", "displaced"],
)  # fmt: skip
def test_right_log_of_a_poor_profiler_is_accepted(profiler: Profiler) -> None:
    assert np.abs(first_shift(logged(profiler, layers(count=6)))).max() < 0.5


def test_right_logs_of_few_full_grey_and_two_inked_layers_are_accepted() -> None:
    full = np.pad(np.ones((18, 14)), 4)
    rng = np.random.default_rng(8)
    for drops in (layers(count=1), [full] * 4, [full * rng.integers(1, 5, full.shape) for _ in range(3)]):
        for profiler in (Profiler(), NOISY):
            first_shift(logged(profiler, drops))
    record = logged(NOISY, layers())
    first_shift(replace(record, pattern=record.pattern * rng.integers(1, 3, record.pattern.shape).astype(np.int32)))


@pytest.mark.parametrize("shape", [(26, 22), (22, 26)])
@pytest.mark.parametrize("shift", [(1.0, 0.0), (-1.0, 0.0), (0.0, 2.0), (0.0, -2.0), (0.25, -0.25), (-0.25, 0.25)])
def test_shift_is_found_to_a_tenth(shape: tuple[int, int], shift: tuple[float, float]) -> None:
    found = first_shift(logged(replace(NOISY, shift=shift), layers(*shape)))
    np.testing.assert_allclose(found, shift, atol=0.12)


def test_log_of_too_few_readings_or_no_droplets_is_not_judged() -> None:
    record = logged(NOISY, layers())
    assert not first_shift(replace(record, pattern=np.zeros_like(record.pattern))).any()
    few = np.where(np.random.default_rng(1).random(record.measured.shape) < 0.1, record.measured, np.nan)
    assert not first_shift(replace(record, measured=few)).any()


def numbered(layers: int, shape: tuple[int, int]) -> PrintRecord:
    """A print that grows by noise, with droplets on half of the cells."""
    rng = np.random.default_rng(4)
    pattern = (rng.random((layers, *shape)) < 0.5).astype(np.int32)
    return PrintRecord("it", PITCH, pattern, rng.normal(0.0, 1e-6, (layers + 1, *shape)).cumsum(axis=0))


@pytest.mark.parametrize(("layers", "used"), [(39, range(1, 40)), (40, range(1, 41, 2)), (100, range(1, 101, 3))])
def test_layers_of_a_long_print_are_judged_at_even_distances(layers: int, used: range) -> None:
    record = numbered(layers, (6, 5))
    assert [number for number, *_ in _growths(record, record.measured)] == list(used)


def test_late_and_early_layers_are_those_that_have_a_scan() -> None:
    record = numbered(5, (6, 5))
    assert [number for number, *_ in _growths(record, record.measured, 1)] == [2, 3, 4, 5]
    assert [number for number, *_ in _growths(record, record.measured, -1)] == [1, 2, 3, 4]


def test_cells_of_a_large_grid_are_taken_at_even_distances() -> None:
    record = numbered(1, (150, 134))  # 20,100 cells
    ((_, own, grown),) = _growths(record, record.measured)
    assert own.shape == (10050, 49)
    growth = (record.measured[1] - record.measured[0]).ravel()[::2]
    i, j = np.divmod(np.arange(0, 20100, 2), 134)
    u, w = 2.0 * i / 149 - 1.0, 2.0 * j / 133 - 1.0
    terms = np.stack([np.ones(u.size), u, w, u * u, u * w, w * w], axis=1)
    expected = growth - terms @ np.linalg.lstsq(terms, growth, rcond=None)[0]
    np.testing.assert_allclose(grown, expected, atol=1e-18)


@pytest.mark.parametrize(("missing", "is_judged"), [(0, True), (1, False)])
def test_hypothesis_needs_twice_as_many_readings_as_it_has_weights(missing: int, is_judged: bool) -> None:
    """49 weights of one ink, and six terms of the datum of each scan: 8 x 13 cells are just enough."""
    record = numbered(1, (8, 13))
    record.measured[0, 0, :missing] = np.nan
    assert (_explained(record, record.measured) is not None) == is_judged


def test_scan_with_fewer_readings_than_its_datum_takes_is_left_out() -> None:
    record = numbered(2, (6, 5))
    record.measured[2].ravel()[12:] = np.nan
    assert [number for number, *_ in _growths(record, record.measured)] == [1, 2]
    record.measured[2].ravel()[11] = np.nan
    assert [number for number, *_ in _growths(record, record.measured)] == [1]


def test_droplets_of_both_inks_share_what_the_scans_grew_in_all() -> None:
    """8 um, summed over cells and layers, are 2 um of each of four droplets; its own cell keeps 4.4 / 7.6 of them."""
    pattern = np.zeros((2, 9, 8), np.int32)
    pattern[0, 2, 2], pattern[0, 6, 5], pattern[1, 2, 5], pattern[1, 6, 2] = 1, 2, 2, 2
    measured = np.zeros((3, 9, 8))
    measured[1:, 4, 4] = 5e-6
    measured[2, 0, 0] = 3e-6
    found = _added(PrintRecord("it", PITCH, pattern, measured))
    np.testing.assert_allclose(found.sum(axis=(1, 2)), 4e-6, rtol=1e-9)
    np.testing.assert_allclose(found[pattern > 0], 2e-6 * 4.4 / 7.6, rtol=1e-9)
    assert not _added(PrintRecord("it", PITCH, pattern, -measured)).any()


def test_shift_is_the_centre_of_the_nine_heights_about_the_largest() -> None:
    """Of what both inks add; a satellite three cells away counts no more than what is taken away."""
    rng = np.random.default_rng(6)
    pattern = rng.integers(0, 3, (4, 24, 22)).astype(np.int32)
    pattern[:, :4] = pattern[:, -4:] = pattern[:, :, :4] = pattern[:, :, -4:] = 0
    growth = np.zeros(pattern.shape)
    for ink, weights in ((1, {(1, 0): 3.0, (1, 1): 1.0, (-2, 0): 1.5}), (2, {(1, 0): 3.0, (2, 0): 1.0, (0, -1): -0.5})):
        for (di, dj), weight in weights.items():
            growth += weight * 1e-6 * np.roll(pattern == ink, (di, dj), (1, 2))
    record = PrintRecord("it", PITCH, pattern, np.concatenate([np.zeros((1, 24, 22)), growth.cumsum(axis=0)]))
    np.testing.assert_allclose(first_shift(record), [-(6.0 + 1.0 + 2.0) / 8.0, -1.0 / 8.0], atol=0.01)
