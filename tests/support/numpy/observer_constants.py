"""Constants of the observer, stated again; their meaning and origin stand in controller/core/observer."""

from __future__ import annotations

import numpy as np

DROPLET_STD, DEAD, NOISELESS = 0.1, 15.0, 1e-20  # of a volume [1]; evidence; variance [m^2]
NU, MEDIAN_SQUARE, MAD = 4.0, 0.4549, 1.4826  # t distribution; of normal variables
SHARE_STD, SHARE_STEP, SHARE_RANGE = {"scale": 0.15, "full": 0.3}, {"scale": 0.01, "full": 0.02}, (0.3, 2.0)
DATUM_STD, DATUM_KEPT, LEAST_SPREAD, SURELY = np.array([1.3, 0.8, 0.8, 0.4, 0.4, 0.4]), 0.8, 1e-17, 1e-30
NOISE_KEPT, KNOWN_GROUND, GROUND_TOLERANCE, LEAST_SEEN, LINES_TELL, LEVELLED = 0.7, 1e-18, 3.0, 0.02, 0.5, 0.5
FOREIGN, USUAL, STEEP, LEAST_CELLS, LEAST_DROPLETS, LEAST_GROUND = 4.0, 2.0, 0.8, 12, 20, 20
SHIFT_STD, SPREAD_STD, ROTATION_STD, MAGNIFICATION_STD, SHEAR_STD = 1.0, 0.5, 0.03, 0.02, 0.004
FIRST_STEP, LINEAR_STEP, SPREAD_STEP, LEAST_STEP, STEP_GAIN = 0.1, 5e-4, 0.01, 0.01, 0.3
FIRST_ODDS, TEMPER, PRICE, ODDS_RANGE, DECIDED = -3.0, 0.5, 0.7, (-6.0, 40.0), 3.0
WALL, SLOPE_STEP, SPOT_STEP, SAME_SPREAD, NARROW, TAPS, OF_SLOPE, OF_SPOT = 0.1, 0.3, 0.1, 0.02, 0.36, 5, 0.004, 0.03
ROUNDS, COLD, CONVERGED, LONGEST_MOVE, LARGEST_SPREAD, UNKNOWN_SHIFT, TRIED = 30, 2, 1e-3, 0.7, 4.0, 0.3, 3
SHORT_STEP, SHORTER, SAME_SHARE, POINT, BORDER = 0.05, 0.7, 1e-3, 1e-9, 4.0
SURPRISE, CERTAIN, SAME, SPIKY, LEAST_VARIANCE, LEAST_ERROR, LEAST_WEIGHT = 4.5, 0.9, 0.4, 0.008, 1e-21, 1e-24, 1e-9
LASTING, FEW_LAST = 2.0, 2e-4
WEAK, LAYER_EVIDENCE, WHOLE_HEAD, NOT_SEEN, NO_VOLUME, UNSURE = 0.3, 5.0, 0.5, 1e-6, 1e-12, 1e-6
KEPT, LEAST_VARIATION, LARGEST_FOUND, LARGEST_VARIATION = 0.8, 0.01, 9.0, 2.0
FIRST_EVIDENCE, EVIDENCE_MAX, OF_A_MEDIAN, EARLY = 10.0, 500.0, 0.37, 12
SUSPICIOUS, OUTLIER, FAR_BETTER, DOUBT_KEPT, BELIEVED, LEAST_SHARE, SMOOTH = 2.5, 100.0, 0.4, 0.5, 1.2, 0.05, 2e-4
STUCK, STUCK_NOISE, UNKNOWN_HEIGHT, LEAST_STEP_READ, SAME_STEP = 0.05, 8.0, 0.3, 0.02, 0.01
LEAST_EVEN, LEAST_READINGS, LEAST_LEVELS, NOISY, VOLUME_STD, RESERVE, HIGH, RISEN = (
    40,
    64,
    6,
    1e-16,
    0.05,
    1.0,
    0.4,
    0.9,
)
BLIND, BLIND_LAYERS, RESIDUALS_MAX = 0.5, 5, 9.0
UNIFORM_MEDIAN_SQUARE, MODEL_MAX, DEVIATION_MAX, OTHER_DROPLETS, SPILL_MAX = 0.75, 0.3, 0.15, 5.0, 6.0
NO_GROWTH, SAME_SCAN, LATE, TURNED, VOLUME = 64, 128, 256, 512, 1024
TURNS = (
    lambda m: m[::-1], lambda m: m[:, ::-1], lambda m: m[::-1, ::-1], lambda m: m.T, lambda m: np.rot90(m, 1),
    lambda m: np.rot90(m, 3), lambda m: np.rot90(m, 2).T,
)  # fmt: skip
"""What the scan would be if it were mirrored or turned; the last four on square grids."""
SPREAD = 6  # of the unknowns: variance of the spot
