"""Assignment of inks to cells, as in the problems of a controller."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices, RegionTest
from inkloop_controller.planning.layer_mpc import LayerMpc


def ink_choices(job: Job, test: RegionTest, height: FloatMap, layers: int) -> Any:
    """(layers, nx, ny): 1 where ink A belongs in the layers on a surface `height` [m], 2 where B, 3 where either."""
    everywhere = replace(job, mask=np.ones(job.mask.shape, np.bool_))
    mpc = LayerMpc(everywhere, horizon=layers, choices=DropletChoices(everywhere, region_test=test))
    return mpc.problem(Estimate.exact(height, job.inks), 0).choices
