"""From scans to what the planner starts from: the surface, and how much ink a droplet really brings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop_controller.core import IntMap
from inkloop_controller.layer_model import LayerModel
from inkloop_controller.regions import nominal_layer_height

PRIOR_DROPLETS = 100.0  # the nominal ink counts as so many droplets that were measured (assumed)
FORGETTING = 0.98  # weight of a layer against the next: about the last 50 layers count (assumed)
LEAST_DROPLETS = 20  # fewer say more about single droplets than about the ink (assumed)
LEAST_INCREMENT = 0.02  # of a full layer, mean over the cells seen: below it a scan shows noise, not ink (assumed)
INK_SCALE_RANGE = (0.25, 4.0)  # beyond it something else is wrong than the ink (assumed)


@dataclass(frozen=True)
class Estimate:
    """height: (nx, ny) [m]; ink_scale: droplet volume as a share of the nominal one [1].

    measured, expected: height sums [m] over the layers so far, recent ones more; the ink scale is their ratio.
    """

    height: FloatMap
    ink_scale: float
    measured: float
    expected: float


class HeightEstimator:
    """Takes measured cells as they are and predicts the invalid ones; follows the ink from layer to layer.

    adapt_ink: False keeps the nominal ink. The ink scale stays where it is when too little is printed to tell.
    """

    def __init__(self, job: Job, *, adapt_ink: bool = True) -> None:
        self._model, self._part, self._adapt_ink = LayerModel.of(job), job.mask, adapt_ink
        self._layer_height = nominal_layer_height(job)

    def first(self, measured: FloatMap, valid: BoolMap) -> Estimate:
        """The start surface; a cell that was not measured counts as bare substrate, height 0."""
        prior = PRIOR_DROPLETS * self._layer_height
        return Estimate(np.where(valid, measured, 0.0), 1.0, prior, prior)

    def next(self, before: Estimate, pattern: IntMap, layer: int, measured: FloatMap, valid: BoolMap) -> Estimate:
        """Layer number `layer` (from 1) was printed as `pattern` and scanned: measured (nx, ny) [m], where valid."""
        predicted = self._model.scaled(before.ink_scale).layer(before.height, pattern, layer)
        height = np.where(valid, measured, predicted)
        seen = self._part & valid
        nominal = float((self._model.layer(before.height, pattern, layer) - before.height)[seen].sum())
        enough = nominal >= LEAST_INCREMENT * self._layer_height * np.count_nonzero(seen)
        if not self._adapt_ink or np.count_nonzero(pattern[seen]) < LEAST_DROPLETS or not enough:
            return Estimate(height, before.ink_scale, before.measured, before.expected)
        prior = PRIOR_DROPLETS * self._layer_height * (1.0 - FORGETTING)  # the prior is not forgotten
        total = FORGETTING * before.measured + prior + float((height - before.height)[seen].sum())
        expected = FORGETTING * before.expected + prior + nominal
        return Estimate(height, float(np.clip(total / expected, *INK_SCALE_RANGE)), total, expected)
