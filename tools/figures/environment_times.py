"""Times of `LayerEnv`, and the policy of the notebook on plants of the score board, for learn-a-policy.md."""

from __future__ import annotations

from statistics import median
from time import process_time

import numpy as np
from tools.figures.pages import DOCS, ROOT, Texts, read_json, table, write_json

import inkloop_lab
from inkloop.scenario.class_path import classes_from
from inkloop.units import MS_PER_S
from inkloop_lab.score.board import OPEN_LOOP, OURS, PAPERS, Entry, prints

PAGE = DOCS / "how-to" / "learn-a-policy.md"
RECORD = PAGE.with_suffix(".json")
EPISODES, LAYERS = 9, 40
PLANTS, SEED = ("lu", "lu-wide", "caps", "lu-dropout"), 1
LEARNT = Entry("five learned weights", "env:local_policy:Local")
ENTRIES = (OPEN_LOOP, PAPERS, LEARNT, OURS)


def run() -> None:
    """Print layers with random droplets on the cylinder, the medians over episodes; then the plants."""
    env, rng = inkloop_lab.LayerEnv(ROOT / "scenarios" / "cylinder.toml"), np.random.default_rng(0)
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
    times = {"layer_ms": median(layers) * MS_PER_S, "reset_ms": median(resets) * MS_PER_S}
    with classes_from(DOCS / "notebooks"):
        rms = {entry.name: [prints(entry, plant, [SEED]).mean("rms") for plant in PLANTS] for entry in ENTRIES}
    write_json(RECORD, {**times, "rms_um": rms})


def texts() -> Texts:
    """The times in milliseconds, the errors in micrometres."""
    record = read_json(RECORD)
    layer, reset = record["layer_ms"], record["reset_ms"]
    return {
        PAGE: {
            "layer": f"{layer:.2g} ms",
            "layers a second": f"{round(MS_PER_S / layer, -2):,.0f}",
            "reset": f"{reset:.0f} ms",
            "layers of a reset": f"{reset / layer:.0f}",
            "plants": table(
                ("rms [µm]", *PLANTS),
                [(name, *(f"{each:.2f}" for each in rms)) for name, rms in record["rms_um"].items()],
            ),
        }
    }
