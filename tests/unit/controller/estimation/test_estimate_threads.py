"""The estimate after a scan has the same bits on any number of threads."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.core import bindings
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator, InkModel

NX, NY = 301, 517  # enough cells for three threads; neither bands nor chunks of rows end together
LAYERS, NOISE_M, SHIFT = 3, 0.3e-6, 0.4


def estimates(threads: int, adapt_ink: InkModel, passes: int, shift: float) -> list[Estimate]:
    """After each of a few layers with gaps, on scans with holes that are shifted by so many cells."""
    rng = np.random.default_rng(5)
    part = np.zeros((NX, NY), np.bool_)
    part[3:-3, 2:-2] = True
    job = Job(NX, NY, 1e-4, np.where(part, 1e-4, 0.0), part, (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), passes=passes)
    estimator, height = HeightEstimator(job, adapt_ink=adapt_ink, threads=threads), np.zeros((NX, NY))
    found = [estimator.first(NOISE_M * rng.standard_normal(height.shape), np.ones((NX, NY), np.bool_))]
    for layer in range(1, 1 + LAYERS):
        pattern = np.where(part & (rng.random((NX, NY)) < 0.8), rng.integers(1, 3, (NX, NY)), 0).astype(np.int32)
        order = (0, 1, 2, 3) if passes == 4 else ()
        height = bindings.layer(height, pattern, job.inks, order, factor=1.0 - 0.2 * rng.random((NX, NY)))
        read = (1.0 - shift) * height + shift * np.roll(height, -1, axis=0)
        scan = read + NOISE_M * rng.standard_normal(height.shape)
        found.append(estimator.next(found[-1], pattern, layer, scan, rng.random((NX, NY)) < 0.98))
    return found


@pytest.mark.parametrize(("adapt_ink", "passes", "shift"), [("scale", 1, 0.0), ("full", 4, 0.0), ("scale", 1, SHIFT)])
def test_threads_change_no_bit_of_an_estimate(adapt_ink: InkModel, passes: int, shift: float) -> None:
    alone, together = (estimates(threads, adapt_ink, passes, shift) for threads in (1, 3))
    assert shift == 0.0 or alone[-1].figures.is_displaced
    for one, other in zip(alone, together, strict=True):
        assert one.figures == other.figures
        for name, value in one.state.items():
            assert value.tobytes() == other.state[name].tobytes(), name
