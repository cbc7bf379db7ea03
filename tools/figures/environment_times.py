"""Processor time of a layer and of a reset in `LayerEnv`, for learn-a-policy.md."""

from __future__ import annotations

from statistics import median
from time import process_time

import numpy as np
from tools.figures.pages import DOCS, ROOT, Texts, read_json, write_json

import inkloop
from inkloop.units import MS_PER_S

PAGE = DOCS / "how-to" / "learn-a-policy.md"
RECORD = PAGE.with_suffix(".json")
EPISODES, LAYERS = 9, 40


def run() -> None:
    """Print layers with random droplets on the cylinder; the medians over episodes."""
    env, rng = inkloop.LayerEnv(ROOT / "scenarios" / "cylinder.toml"), np.random.default_rng(0)
    mask, layers, resets = env.job.mask, [], []
    patterns = [(rng.random(mask.shape) < 0.8) & mask for _ in range(LAYERS)]
    for seed in range(EPISODES):
        begin = process_time()
        env.reset(seed=seed)
        resets.append(process_time() - begin)
        begin = process_time()
        for pattern in patterns:
            env.step(pattern)
        layers.append((process_time() - begin) / LAYERS)
    env.close()
    write_json(RECORD, {"layer_ms": median(layers) * MS_PER_S, "reset_ms": median(resets) * MS_PER_S})


def texts() -> Texts:
    """Both times, in milliseconds."""
    record = read_json(RECORD)
    layer, reset = record["layer_ms"], record["reset_ms"]
    return {
        PAGE: {
            "layer": f"{layer:.2g} ms",
            "layers a second": f"{round(MS_PER_S / layer, -2):,.0f}",
            "reset": f"{reset:.0f} ms",
            "layers of a reset": f"{reset / layer:.0f}",
        }
    }
