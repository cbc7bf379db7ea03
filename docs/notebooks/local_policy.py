"""A policy with five numbers: a cell is jetted if a weighted sum of what it and its neighbours lack is above zero."""

from __future__ import annotations

import numpy as np

LEARNT = (1.107, 0.07, -0.078, -0.548, -0.101)
"""Weights that the notebook learn-a-policy.ipynb found: cell, sides, corners, constant, chequerboard."""


class Local:
    """Jets where weights @ features > 0. Lengths are in full layers, so that the weights fit any part and ink."""

    def __init__(self, job, *, weights: tuple[float, ...] = LEARNT) -> None:
        self.layer_height, self.weights = job.inks[0].layer_height, np.asarray(weights, float)
        i, j = np.indices((job.nx, job.ny))
        self.colour = np.where((i + j) % 2 == 0, 1.0, -1.0)
        self.layer = 0

    def act(self, observation):
        mask = observation["mask"] > 0
        lacking = np.where(mask, observation["target"] - observation["measured_height"], 0.0) / self.layer_height
        sides, corners = around(lacking)
        colour = self.colour * (-1) ** self.layer
        cell, side, corner, constant, board = self.weights
        self.layer += 1
        near = np.clip(lacking, -2.0, 2.0)
        score = cell * near + side * np.clip(sides, -2.0, 2.0) + corner * np.clip(corners, -2.0, 2.0) + constant
        return (score + board * colour > 0.0) & mask


def around(values):
    """Mean of the four sides and of the four corners of each cell; 0 beyond the grid."""
    padded = np.pad(values, 1)
    nx, ny = values.shape
    near = {(i, j): padded[1 + i : 1 + i + nx, 1 + j : 1 + j + ny] for i in (-1, 0, 1) for j in (-1, 0, 1)}
    sides = sum(near[place] for place in ((-1, 0), (1, 0), (0, -1), (0, 1))) / 4.0
    corners = sum(near[place] for place in ((-1, -1), (-1, 1), (1, -1), (1, 1))) / 4.0
    return sides, corners
