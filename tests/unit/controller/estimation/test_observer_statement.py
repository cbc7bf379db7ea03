"""The observer in C and its statement in NumPy estimate the same, layer by layer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from support.numpy import lu_numpy
from support.numpy.observer_numpy import Observer
from support.numpy.observer_setup import Setup, State, blurred, near, sampling

PITCH, HEIGHT = 263.256e-6, 60e-6
A, B = Ink(4.4e-6, 0.6e-6, 0.2e-6), Ink(3.9e-6, 0.7e-6, 0.25e-6)
LAYER = 7.6e-6  # nominal height of a layer of A [m]
TOLERANCE = 1e-9
NEXT_TO_NOTHING = 1e-26  # [m^2]: an exact reading leaves 1e-20, the difference of two sums of 1e-13
NOISE = 2e-7  # of a reading [m]


@dataclass(frozen=True)
class Case:
    """A printer and a profiler on a small grid.

    inks: A alone or A and B; row: of droplets that never come, from layer 2 on; heap: what the cells heaped get besides
    [m]; around: what cells next to droplets get besides [m], in
    layers from around_from on; unknown: a layer that was abandoned; shift, its
    scatter [cells], rotation [rad], spot [cells]: of the scans; level: standard deviation of the six terms of a datum,
    anew for each scan [m]; jitter: of lines of readings with the same i, and with the same j [m]; spikes, missing:
    shares of the readings; frozen: the last scan that is a new one; looked_at: the layer after which a person has
    looked, and scans are new again; rough: the start surface; resolution: step of the readings [m], is_step_known: to
    the observer, too; drop_levels: most drops of a droplet; cancels: tolerance of variances, where 1e-13 is left of
    1e-6: after a person has looked.
    """

    nx: int = 13
    ny: int = 15
    layers: int = 8
    inks: tuple[Ink, ...] = (A,)
    passes: int = 1
    volume: float = 1.0
    row: int | None = None
    heap: float = 0.0
    heaped: tuple[tuple[int, int], ...] = ((5, 6),)
    around: float = 0.0
    around_from: int = 0
    unknown: int | None = None
    noise: float = NOISE
    shift: tuple[float, float] = (0.0, 0.0)
    scatter: float = 0.0
    rotation: float = 0.0
    spot: float = 0.0
    level: float = 0.0
    jitter: tuple[float, float] = (0.0, 0.0)
    spikes: float = 0.0
    missing: float = 0.0
    frozen: int | None = None
    looked_at: int | None = None
    is_turned: bool = False
    rough: float = 0.0
    model: Any = "scale"
    sensor_noise: float | None = None
    registered: bool = True
    resolution: float = 0.0
    is_step_known: bool = True
    drop_levels: int = 1
    cancels: float = TOLERANCE

    def job(self) -> Job:
        """A part near a corner of the grid, with a hole: no transform of the grid brings it to itself."""
        mask = np.zeros((self.nx, self.ny), np.bool_)
        mask[2:-4, 1:-5] = True
        mask[3:5, 2] = False
        target = np.where(mask, HEIGHT, 0.0)
        return Job(self.nx, self.ny, PITCH, target, mask, inks=self.inks, passes=self.passes)


CASES = {
    "in register, exact": Case(noise=0.0),
    "in register, exact as is known": Case(15, 13, noise=0.0, sensor_noise=0.0),
    "in register, noisy": Case(noise=5e-7),
    "in register, noise known": Case(15, 13, sensor_noise=NOISE),
    "9 x 9 cells, no ground": Case(9, 9, layers=12),
    "shifted by +x": Case(15, 13, shift=(0.5, 0.0)),
    "shifted by -x": Case(shift=(-1.3, 0.0)),
    "shifted by +y": Case(shift=(0.0, 0.7)),
    "shifted by -y": Case(15, 13, shift=(0.0, -2.0)),
    "shifted, exact": Case(noise=0.0, shift=(0.4, 0.3)),
    "shift that scatters": Case(15, 13, layers=12, shift=(0.5, 0.0), scatter=0.6),
    "frozen scan, shift that scatters": Case(15, 13, layers=12, frozen=9, shift=(0.5, 0.0), scatter=0.6),
    "rotated": Case(rotation=0.05),
    "rotated back": Case(15, 13, rotation=-0.05),
    "spot": Case(15, 13, spot=0.8),
    "levelled anew": Case(level=2e-6),
    "lines along y jitter": Case(jitter=(1e-6, 0.0)),
    "lines along x jitter": Case(15, 13, jitter=(0.0, 1e-6)),
    "lines jitter, exact": Case(15, 13, noise=0.0, jitter=(5e-7, 0.0)),
    "lines jitter, shifted": Case(jitter=(0.0, 1e-6), shift=(-0.3, 0.6)),
    "lines jitter, scans as they are": Case(layers=4, jitter=(1e-6, 0.0), registered=False),
    "lines jitter, readings rounded": Case(15, 13, layers=4, noise=1e-7, jitter=(1e-6, 0.0), resolution=5e-7),
    "lines jitter, readings missing": Case(layers=12, jitter=(1e-6, 0.0), missing=0.2, rough=2e-6, cancels=1e-8),
    "spikes and drop-outs": Case(15, 13, layers=12, spikes=0.03, missing=0.1),
    "spikes and drop-outs, shifted": Case(layers=12, spikes=0.03, missing=0.1, shift=(0.5, -0.5)),
    "two inks": Case(inks=(A, B)),
    "two inks, shifted": Case(inks=(A, B), shift=(0.4, 0.0)),
    "full": Case(model="full"),
    "full, two inks, shifted": Case(inks=(A, B), model="full", shift=(0.4, 0.0)),
    "ink not learnt": Case(model="off"),
    "four passes": Case(12, 15, passes=4),
    "foreign droplets": Case(around=5e-7),
    "droplets a little foreign": Case(around=2.5e-7, registered=False),
    "foreign droplets, two inks": Case(15, 13, layers=5, inks=(A, B), model="full", around=5e-7, registered=False),
    "frozen scan, rough start surface": Case(15, 13, layers=4, frozen=1, rough=2e-6, cancels=1e-8),
    "full, four passes": Case(12, 15, layers=4, model="full", passes=4),
    "foreign droplets, too weak": Case(volume=0.45, around=1e-6, registered=False),
    "foreign droplets, exact": Case(15, 13, noise=0.0, around=5e-7, cancels=1e-8),
    "foreign droplets, shifted by +x": Case(around=1e-6, shift=(0.4, 0.0)),
    "foreign droplets, shifted by -y": Case(15, 13, around=1e-6, shift=(0.0, -0.5)),
    "foreign droplets later on, shifted": Case(layers=10, around=2e-6, around_from=5, shift=(0.4, 0.0)),
    "one cell heaps up": Case(heap=9e-6, registered=False),
    "cells at the edge of the part and beside it heap up": Case(heap=9e-6, heaped=((2, 1), (9, 6)), registered=False),
    "one cell heaps up under drops of three levels": Case(heap=8e-6, drop_levels=3, layers=4, registered=False),
    "dead row, scans as they are": Case(layers=12, row=4, registered=False),
    "dead row, shifted": Case(15, 15, layers=12, row=4, shift=(0.6, -0.7)),
    "unknown layer": Case(unknown=4),
    "unknown layer, shifted": Case(15, 13, unknown=5, shift=(0.4, 0.3)),
    "frozen scan": Case(layers=9, frozen=4),
    "frozen scan, noisy": Case(15, 13, noise=3e-6, frozen=3),
    "first scan again, exact": Case(15, 13, frozen=0, rough=2e-6, cancels=1e-8),
    "frozen scan, looked at": Case(15, 13, layers=12, frozen=4, looked_at=7, cancels=1e-7),
    "transposed scans": Case(13, 13, is_turned=True),
    "rough start surface": Case(rough=2e-6),
    "weak droplets": Case(15, 13, volume=0.55),
    "hardly any ink": Case(volume=0.3),
    "droplets too weak": Case(15, 13, volume=0.45),
    "droplets too weak, looked at": Case(15, 13, volume=0.45, looked_at=4, cancels=1e-7),
    "drops of three levels": Case(drop_levels=3),
    "readings rounded": Case(15, 13, noise=1e-7, resolution=5e-7),
    "readings rounded, noise known": Case(noise=1e-7, resolution=5e-7, sensor_noise=1e-7),
    "readings rounded, step not known": Case(15, 13, noise=1e-7, resolution=5e-7, is_step_known=False),
    "exact readings rounded, step not known": Case(noise=0.0, resolution=5e-7, is_step_known=False),
    "half of the readings missing": Case(layers=10, missing=0.6),
    "most readings missing": Case(layers=8, missing=0.995),
}


def datum(case: Case, rng: np.random.Generator) -> Any:
    u, w = np.meshgrid(np.linspace(-1.0, 1.0, case.nx), np.linspace(-1.0, 1.0, case.ny), indexing="ij")
    return np.tensordot(case.level * rng.standard_normal(6), np.stack([u**0, u, w, u**2, u * w, w**2]), 1)


def scan_of(case: Case, height: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """(readings [m], whether they are valid) of a surface."""
    i, j = np.indices(height.shape)
    middle = np.subtract(height.shape, 1) / 2.0
    turn = np.array([[np.cos(case.rotation), -np.sin(case.rotation)], [np.sin(case.rotation), np.cos(case.rotation)]])
    x, y = np.tensordot(turn, np.stack([i - middle[0], j - middle[1]]), 1)
    shift = np.add(case.shift, case.scatter * rng.standard_normal(2) if case.scatter > 0.0 else 0.0)
    reading = np.array(
        sampling(height.shape, x + middle[0] + shift[0], y + middle[1] + shift[1])
        @ blurred(height, case.spot**2).ravel()
    ).reshape(height.shape)
    reading += datum(case, rng) + case.noise * rng.standard_normal(height.shape)
    if any(case.jitter):
        along = [std * rng.standard_normal(count) for std, count in zip(case.jitter, height.shape, strict=True)]
        reading += along[0][:, None] + along[1]
    reading += 20e-6 * (rng.random(height.shape) < case.spikes) * rng.choice([-1.0, 1.0], height.shape)
    if case.resolution > 0.0:
        reading = case.resolution * np.round(reading / case.resolution)
    return reading, rng.random(height.shape) >= case.missing


def jetted(case: Case, job: Job, layer: int, rng: np.random.Generator) -> Any:
    """A tenth of the cells gets nothing."""
    pattern = np.where(job.mask, 1, 0).astype(np.int32)
    if len(case.inks) == 2:
        pattern[job.mask & (np.indices(pattern.shape).sum(axis=0) % 3 == layer % 3)] = 2
    pattern[rng.random(pattern.shape) < 0.1] = 0
    return pattern


def grown(case: Case, height: Any, pattern: Any, drops: Any, layer: int, rng: np.random.Generator) -> Any:
    volume = drops * case.volume * (1.0 - 0.2 * rng.random(height.shape))
    if case.row is not None and layer >= 2:
        volume[:, case.row] = 1e-9
    inks = tuple((ink.h1, ink.h2, ink.h3) for ink in (case.inks[0], case.inks[-1]))
    height = lu_numpy.layer(height, pattern, inks, volume, case.passes)[0]
    for cell in case.heaped:
        height[cell] += case.heap
    return height + case.around * (near(pattern > 0) & (pattern == 0) & (layer >= case.around_from))


def agree(found: Estimate, stated: State, figures: Any, cancels: float, where: str) -> None:
    maps = found.state
    for name, value in (("height", stated.height), ("ledger", stated.ledger), ("surprise", stated.surprise)):
        np.testing.assert_allclose(maps[name], value, rtol=0.0, atol=TOLERANCE * LAYER, err_msg=f"{name} {where}")
    variance = np.asarray(stated.variance)
    np.testing.assert_allclose(maps["height_variance"], variance, cancels, NEXT_TO_NOTHING, err_msg=f"variance {where}")
    np.testing.assert_allclose(maps["dead_evidence"], stated.dead, TOLERANCE, TOLERANCE, err_msg=f"dead {where}")
    for name, counted in (("unseen", stated.unseen), ("surprised", stated.surprised), ("capped", stated.capped)):
        np.testing.assert_array_equal(maps[name], counted, err_msg=f"{name} {where}")
    inks = [(ink.h1, ink.h2, ink.h3) for ink in found.inks]
    np.testing.assert_allclose(inks, figures.pop("inks"), TOLERANCE, err_msg=f"inks {where}")
    for name, value in figures.items():
        message = f"{name} {where}"
        np.testing.assert_allclose(getattr(found.figures, name), value, TOLERANCE, TOLERANCE, err_msg=message)


def compare(case: Case) -> tuple[Estimate, State]:
    """Print and scan a part layer by layer; both estimates agree after each."""
    job, rng = case.job(), np.random.default_rng(1)
    is_flat, step = case.rough == 0.0, case.resolution * case.is_step_known
    core = HeightEstimator(
        job,
        adapt_ink=case.model,
        sensor_noise_std=case.sensor_noise,
        sensor_resolution=step,
        register_scans=case.registered,
        flat_ground=is_flat,
        drop_levels=case.drop_levels,
    )
    steps = step**2 / 12.0
    noise = None if case.sensor_noise is None else case.sensor_noise**2 + steps
    setup = Setup(
        job, noise, case.model, registered=case.registered, flat=is_flat, steps=steps, drop_levels=case.drop_levels
    )
    statement = Observer(setup)
    height = case.rough * rng.random(job.mask.shape)
    scan, valid = scan_of(case, height, rng)
    valid |= case.missing > 0.9  # or it is no first scan
    found, stated = core.first(scan, valid), statement.first(scan, valid)
    for layer in range(1, case.layers + 1):
        pattern = jetted(case, job, layer, rng)
        drops = rng.integers(1, case.drop_levels, height.shape, endpoint=True).astype(np.float64)
        height = grown(case, height, pattern, drops, layer, rng)
        is_new = case.frozen is None or layer <= case.frozen
        if is_new or (case.looked_at is not None and layer > case.looked_at):
            scan, valid = scan_of(case, height, rng)
        if case.is_turned:
            scan, valid = np.ascontiguousarray(scan.T), np.ascontiguousarray(valid.T)
        is_unknown = layer == case.unknown
        found = core.next(found, pattern, layer, scan, valid, drops, is_unknown=is_unknown)
        stated = statement.next(stated, pattern, layer, scan, valid, is_unknown, drops)
        figures = {**statement.figures(stated), "inks": statement.setup.inks(stated.share)}
        agree(found, stated, figures, case.cancels, f"after layer {layer}")
        if layer == case.looked_at:
            found, stated = core.trust_again(found), statement.trust_again(stated)
    return found, stated


@pytest.mark.parametrize("name", CASES)
def test_observer_in_c_estimates_what_is_stated(name: str) -> None:
    compare(CASES[name])


def test_cases_show_what_they_are_for() -> None:
    """Displacement, spot, dead cells, stops: each in a case that has it."""
    shifted, _ = compare(CASES["shifted by +x"])
    assert shifted.figures.is_displaced
    assert shifted.figures.shift_x == pytest.approx(0.5, rel=0.0, abs=0.05)
    for name, shift in (("shifted by +x", (0.4, 0.0)), ("shifted by -y", (0.0, -0.5))):
        alone = compare(CASES[f"foreign droplets, {name}"])[0].figures
        assert (alone.is_foreign, alone.is_displaced, alone.magnification, alone.rotation) == (True, True, 0.0, 0.0)
        assert (alone.shift_x, alone.shift_y) == pytest.approx(shift, rel=0.0, abs=0.15)
    assert not compare(CASES["foreign droplets later on, shifted"])[0].figures.is_displaced
    dead_row, _ = compare(CASES["dead row, shifted"])
    assert dead_row.figures.is_displaced
    assert dead_row.dead.any()
    assert compare(CASES["dead row, scans as they are"])[0].dead.any()
    assert compare(CASES["frozen scan"])[0].figures.stop == UntrustedReason.SAME_SCAN
    assert compare(CASES["droplets too weak"])[0].figures.stop == UntrustedReason.VOLUME
    assert compare(CASES["transposed scans"])[0].figures.transform == 5
