"""The plane of the first scan where its cells carry no plane."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.estimation.loop_trust import UntrustedReason
from support.closed_loop import block

JOB = block(20, 18, height=60e-6)


@pytest.mark.parametrize("along", [0, 1])
def test_ground_of_a_line_of_cells_is_its_mean_height(along: int) -> None:
    seen = np.zeros((JOB.nx, JOB.ny), np.bool_)
    seen[:, 4] = True
    if along:
        seen = np.zeros_like(seen)
        seen[4] = True
    scan = 8e-6 + 1e-6 * (np.indices(seen.shape).sum(axis=0) % 2)
    trust = HeightEstimator(JOB, flat_ground=True).first(np.where(seen, scan, 0.0), seen, 0).trust
    assert trust.ground_offset == pytest.approx(8.5e-6, rel=1e-9, abs=0.0)
    assert (trust.ground_rise_x, trust.ground_rise_y) == (0.0, 0.0)
    assert trust.reasons & UntrustedReason.GROUND
