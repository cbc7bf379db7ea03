"""The estimate after a layer that was begun and given up, nobody knows where: the scan counts, nothing is learnt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop_controller.height_estimator import Estimate, HeightEstimator
from inkloop_controller.horizon_problem import IntMap
from inkloop_controller.layer_model import LayerModel


def after_unknown(
    estimator: HeightEstimator,
    job: Job,
    before: Estimate,
    pattern: IntMap,
    layer: int,
    measured: FloatMap,
    valid: BoolMap,
    factor: FloatMap | None = None,
) -> Estimate:
    """What is known after the scan of layer number `layer`; arguments as those of `HeightEstimator.next`.

    Each cell grew by anything from nothing to what the whole pattern brings: the mean of the two with the variance of a
    uniform distribution is what the scan corrects. Inks and dead cells stay as they were known.
    """
    whole = replace(LayerModel.of(job), inks=before.inks).layer(before.height, pattern, layer, factor) - before.height
    unseen = before.unseen
    if before.scans == 1:  # else the variance would be that of the first scan, and these are not its heights any more
        unseen = np.where(whole != 0.0, np.maximum(unseen, 1), unseen).astype(np.int32)
    begun = replace(
        before,
        height=before.height + 0.5 * whole,
        height_variance=before.height_variance + whole**2 / 12.0,
        unseen=unseen,
    )
    found = estimator.next(begun, np.zeros_like(pattern), layer, measured, valid)
    return replace(
        found,
        inks=before.inks,
        ink_scale=before.ink_scale,
        dead_evidence=before.dead_evidence,
        evidence=before.evidence,
    )
