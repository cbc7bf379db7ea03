"""The coefficients of Wu and Chiu (2024) from drops that fall alone onto uneven ground: equations 14 to 16 in groups of
three samples, (17) with weights, and their prediction error for each pattern of prior drops (21).

The paper takes means of ratios of gains to height differences. Where a difference is small, noise makes its ratio
large, and the mean follows it. Here each ratio has its difference as weight: the sum of the gains over the sum of
the differences. (A median fails where neighbours at sides and corners gain unequally: it takes one kind for all.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.special import stdtrit

from inkloop.units import UM_PER_M
from inkloop_lab.identify.one_step import rms
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.surface_filter import start_surface
from inkloop_lab.models import VolumeAreaDeposition

NAMES = ("mv_plus", "mv_minus", "ma_plus", "ma_minus")
GROUP = 3  # samples averaged together (Wu, Chiu 2024, section IV)
TWO_PRIOR = "2 on the sides"  # Fig. 3(b), from which the paper takes the coefficients
LEVEL = 0.01  # share of a drop's mean height: smaller differences have no sign, as below 3 noise_std (assumed)
COVERED = 0.1  # the same: above it a cell without a measured area counts as covered (assumed)
LEAST_GROUPS = 2
_WINDOW = np.ones((5, 5), int)
_OFF_CENTRE = np.array([[True, True, True], [True, False, True], [True, True, True]])


@dataclass(frozen=True, eq=False)
class DropSample:
    """The 3 x 3 cells around a drop that fell alone: mean heights over the substrate [m] and covered shares, before and
    after; prior: text, the drops around it.
    """

    prior: str
    height: NDArray[np.float64]
    height_after: NDArray[np.float64]
    area: NDArray[np.float64]
    area_after: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VolumeAreaEstimate:
    """coefficients: by name [1/m], height_scale c [m]; half_widths: of the 95 % confidence intervals, from the spread
    of the groups; rms: by pattern of prior drops the error (21) of the model's prediction of the mean sample, and its
    standard deviation over the groups; counts: samples by pattern; area_known: whether areas were measured.
    """

    coefficients: Mapping[str, float]
    half_widths: Mapping[str, float]
    rms: Mapping[str, tuple[float, float]]
    counts: Mapping[str, int]
    area_known: bool

    def model(self, pitch: float) -> VolumeAreaDeposition:
        """The deposition model with these coefficients, kept in bounds as for use as a plant."""
        return _model(pitch, self.coefficients, tamed=True)


def identify_volume_area(records: Sequence[PrintRecord], noise_std: float, seed: int = 0) -> VolumeAreaEstimate:
    """From every drop that fell alone on uneven ground; groups are drawn from the seed. Raises IdentificationError."""
    samples = drop_samples(records, noise_std)
    scale = float(np.mean([np.sum(s.height_after - s.height) for s in samples])) if samples else 0.0
    known = all(record.area is not None for record in records)
    by_pattern: dict[str, list[DropSample]] = {}
    for sample in samples:
        by_pattern.setdefault(sample.prior, []).append(_covered(sample, scale) if not known else sample)
    generator = np.random.default_rng(seed)
    groups = {prior: _groups(members, generator) for prior, members in sorted(by_pattern.items())}
    chosen = groups.get(TWO_PRIOR, [])
    if len(chosen) < LEAST_GROUPS or scale <= 0.0:
        raise IdentificationError(
            f"{len(by_pattern.get(TWO_PRIOR, []))} drops fell alone between two prior drops on either side; the "
            f"coefficients of Wu and Chiu need {GROUP * LEAST_GROUPS}, each alone in its layer within two cells"
        )
    level = max(LEVEL * scale, 3.0 * noise_std)
    ratios = {name: _ratio(*sums) for name, sums in _sums(chosen, scale, level).items()}
    coefficients = {name: value for name, (value, _) in ratios.items()}
    widths = {name: width for name, (_, width) in ratios.items()}
    growths = np.array([np.sum(s.height_after - s.height) for s in samples])
    widths["height_scale"] = 1.96 * float(growths.std(ddof=1)) / np.sqrt(growths.size)
    if not known:
        coefficients |= {name: getattr(VolumeAreaDeposition, name) for name in ("ma_plus", "ma_minus")}
        widths |= {"ma_plus": np.nan, "ma_minus": np.nan}
    coefficients["height_scale"] = scale
    model = _model(records[0].pitch, coefficients)
    errors = {prior: _errors(members, model, known) for prior, members in groups.items() if members}
    return VolumeAreaEstimate(coefficients, widths, errors, {p: len(m) for p, m in sorted(by_pattern.items())}, known)


def _model(pitch: float, of: Mapping[str, float], tamed: bool = False) -> VolumeAreaDeposition:
    gains = (of["mv_plus"], of["mv_minus"], of["ma_plus"], of["ma_minus"])
    return VolumeAreaDeposition(pitch, of["height_scale"], *gains, guard=tamed, limit_gains=tamed)


def drop_samples(records: Sequence[PrintRecord], noise_std: float) -> list[DropSample]:
    """Every drop from the second layer on that has no other one of its layer within two cells, fully measured."""
    found = []
    for record in records:
        start, _ = start_surface(record.measured[0], noise_std)
        rise = record.measured - start
        areas = record.area if record.area is not None else np.ones_like(rise)
        for k in range(1, len(record.pattern)):
            hit, earlier = record.pattern[k] > 0, (record.pattern[:k] > 0).sum(axis=0)
            alone = hit & (convolve(hit.astype(int), _WINDOW, mode="constant") == 1)
            alone[[0, -1]] = alone[:, [0, -1]] = False
            for i, j in np.argwhere(alone):
                roi = np.s_[i - 1 : i + 2, j - 1 : j + 2]
                prior = earlier[roi]
                sample = DropSample(_words(prior), *(m[(index, *roi)] for m in (rise, areas) for index in (k, k + 1)))
                if prior.max() <= 1 and prior[1, 1] == 0 and np.isfinite([sample.height, sample.height_after]).all():
                    found.append(sample)
    return found


def height_differences(height: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3): each height less the mean of the cells that touch it inside (equations 7 to 9)."""
    around = convolve(height, np.ones((3, 3)), mode="constant") - height
    return np.asarray(height - around / (convolve(np.ones((3, 3)), np.ones((3, 3)), mode="constant") - 1.0))


def _words(prior: NDArray[np.int64]) -> str:
    if int(prior.sum()) == 2 and ((prior[0, 1] and prior[2, 1]) or (prior[1, 0] and prior[1, 2])):
        return TWO_PRIOR
    return f"{int(prior.sum())}"


def _covered(sample: DropSample, scale: float) -> DropSample:
    """Without a measured area: cells with ink count as covered."""
    areas = ((height > COVERED * scale).astype(float) for height in (sample.height, sample.height_after))
    return DropSample(sample.prior, sample.height, sample.height_after, *areas)


def _groups(samples: list[DropSample], generator: np.random.Generator) -> list[DropSample]:
    """Means over random groups of three; a rest of one or two is left out."""
    order = generator.permutation(len(samples))
    groups = [[samples[k] for k in order[n : n + GROUP]] for n in range(0, len(samples) - GROUP + 1, GROUP)]
    return [_mean(group) for group in groups]


def _mean(samples: Sequence[DropSample]) -> DropSample:
    names = ("height", "height_after", "area", "area_after")
    return DropSample(samples[0].prior, *(np.mean([getattr(s, name) for s in samples], axis=0) for name in names))


def _height(sample: DropSample, after: bool = False) -> NDArray[np.float64]:
    """h of the paper (16): of the covered part, 0 on bare cells [m]."""
    height, area = (sample.height_after, sample.area_after) if after else (sample.height, sample.area)
    return np.divide(height, area, out=np.zeros_like(height), where=area > 0.0)


def _sums(
    groups: Sequence[DropSample], scale: float, level: float
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Of equation 17, by coefficient: gains and height differences, summed over the cells of each group."""
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in NAMES}
    for sample in groups:
        difference = height_differences(_height(sample))
        volume, area = (sample.height_after - sample.height) / scale, sample.area_after - sample.area
        higher, lower = _OFF_CENTRE & (difference > level), _OFF_CENTRE & (difference < -level)
        pairs = [(gain, cells) for gain in (volume, area) for cells in (higher, lower)]
        for name, (gain, cells) in zip(NAMES, pairs, strict=True):
            if cells.any():
                found[name].append((float(gain[cells].sum()), float(difference[cells].sum())))
    lacking = [name for name, sums in found.items() if len(sums) < LEAST_GROUPS]
    if lacking:
        raise IdentificationError(
            f"{' and '.join(lacking)}: next to two prior drops, fewer than {LEAST_GROUPS} groups of {GROUP} drops have "
            f"cells that differ by more than {level * UM_PER_M:.3g} µm from those around them; needs less noise"
        )
    return {name: (np.array(sums)[:, 0], np.array(sums)[:, 1]) for name, sums in found.items()}


def _ratio(gains: NDArray[np.float64], differences: NDArray[np.float64]) -> tuple[float, float]:
    """Sum over sum, and half the width of its 95 % confidence interval, from the residuals of the groups."""
    ratio, count = float(gains.sum() / differences.sum()), gains.size
    off = float(np.sum((gains - ratio * differences) ** 2)) * count / (count - 1)
    return ratio, float(stdtrit(count - 1, 0.975)) * math.sqrt(off) / abs(float(differences.sum()))


def _errors(groups: Sequence[DropSample], model: VolumeAreaDeposition, area_known: bool) -> tuple[float, float]:
    """(21) of the mean of all samples, and its standard deviation over the groups."""
    each = [_relative_rms(group, model, area_known) for group in groups]
    return _relative_rms(_mean(groups), model, area_known), float(np.std(each, ddof=1)) if len(each) > 1 else float(
        "nan"
    )


def _relative_rms(sample: DropSample, model: VolumeAreaDeposition, area_known: bool) -> float:
    """Equation 21 over the region of interest, of cells that hold ink after the drop; without areas of mean heights.

    NaN where no cell holds ink.
    """
    drop = np.zeros((3, 3), np.int32)
    drop[1, 1] = 1
    after = model.layer(model.start(np.maximum(sample.height, 0.0), np.clip(sample.area, 0.0, 1.0)), drop)
    measured = _height(sample, after=True) if area_known else sample.height_after
    predicted = after.covered_height if area_known else after.height
    counted = measured > COVERED * model.height_scale
    return rms((measured - predicted)[counted] / measured[counted])
