"""The readings of the profile sensor, with matrices and NumPy's own gradient."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from support.numpy.philox_numpy import normal, normal_map, uniform_map


def spot_matrix(count: int, pitch: float, radius: float) -> Any:
    """Weights of a Gaussian spot along one axis, each row summing to 1."""
    if radius == 0.0:
        return np.eye(count)
    distance = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    weights = np.where(distance <= np.floor(4.0 * radius / pitch), np.exp(-((distance * pitch / radius) ** 2) / 2), 0)
    return weights / weights.sum(axis=1, keepdims=True)


def slope(surface: Any, pitch: float) -> Any:
    """Length of the gradient."""
    parts = [np.gradient(surface, pitch, axis=axis) if surface.shape[axis] > 1 else 0.0 for axis in (0, 1)]
    return np.hypot(*np.broadcast_arrays(*parts)) * np.ones(surface.shape)


def scan(
    height: Any,
    number: int,
    *,
    seed: int = 0,
    pitch: float = 263.256e-6,
    noise_std: float = 0.0,
    noise_correlation: float = 0.0,
    resolution: float = 0.0,
    bias: float = 0.0,
    drift_rate: float = 0.0,
    tilt_x: float = 0.0,
    tilt_y: float = 0.0,
    shift_x: float = 0.0,
    shift_y: float = 0.0,
    shift_std: float = 0.0,
    spot_radius: float = 0.0,
    slope_bias: float = 0.0,
    dropout_slope: float = 0.0,
    dropout_rate: float = 0.0,
) -> tuple[Any, Any]:
    """(reading of every cell, valid) of scan `number`, counted from 0."""
    nx, ny = height.shape
    z = spot_matrix(nx, pitch, spot_radius) @ height @ spot_matrix(ny, pitch, spot_radius).T
    shift = [x + shift_std * normal(seed, 8, axis, number) for axis, x in enumerate((shift_x, shift_y))]
    places = np.indices(z.shape) + np.reshape(shift, (2, 1, 1)) / pitch
    z = map_coordinates(z, places, order=1, mode="nearest")
    steepness = slope(z, pitch)
    z = z + slope_bias * np.sin(2.0 * np.arctan(steepness))
    white, common = normal_map(seed, 5, z.shape, number), normal(seed, 6, 0, number)
    z = z + noise_std * (np.sqrt(noise_correlation) * common + np.sqrt(1.0 - noise_correlation) * white)
    valid = uniform_map(seed, 7, z.shape, number) >= dropout_rate
    if dropout_slope > 0.0:
        valid &= steepness <= dropout_slope
    x, y = ((np.arange(n) - (n - 1) / 2) * pitch for n in (nx, ny))
    z = z + tilt_x * x[:, None] + tilt_y * y[None, :] + bias + drift_rate * number
    return (np.round(z / resolution) * resolution if resolution > 0.0 else z), valid
