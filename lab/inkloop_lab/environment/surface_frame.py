"""A picture of a surface while it is printed, by NumPy alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Job

SIDE = 256
"""Least number of pixels along a panel's longer side."""
SPAN_LAYERS = 2.0
"""Range of the colours in full layers above and below the mean error."""
LOW, LEVEL, HIGH = (33, 102, 172), (247, 247, 247), (178, 24, 43)
EMPTY, INKS = (230, 230, 230), ((40, 40, 40), (200, 120, 20))


def frame(height: FloatMap, pattern: NDArray[np.int32], job: Job) -> NDArray[np.uint8]:
    """Height minus target about its mean over the part, and beside it a pattern, as RGB (rows, columns, 3).

    Blue is low, red is high; x runs to the right, y upwards.
    """
    excess = height - job.target_height
    excess = (excess - excess[job.mask].mean()) / (SPAN_LAYERS * job.inks[0].layer_height)
    left = _diverging(np.clip(excess, -1.0, 1.0))
    left[~job.mask] = EMPTY
    right = np.full((*job.mask.shape, 3), EMPTY, np.uint8)
    right[job.mask] = LEVEL
    for number, colour in enumerate(INKS[: len(job.inks)], 1):
        right[pattern == number] = colour
    zoom = max(1, -(-SIDE // max(job.mask.shape)))
    gap = np.full((1, job.ny, 3), 255, np.uint8)
    both = np.concatenate([left, gap, right]).repeat(zoom, 0).repeat(zoom, 1)
    return np.ascontiguousarray(both.transpose(1, 0, 2)[::-1])


def _diverging(values: FloatMap) -> NDArray[np.uint8]:
    """Colours of values from -1 to 1."""
    end = np.where(values[..., None] < 0.0, np.array(LOW), np.array(HIGH))
    share = np.abs(values)[..., None]
    return np.asarray(np.round((1.0 - share) * np.array(LEVEL) + share * end), np.uint8)
