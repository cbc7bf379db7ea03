"""Recovery of a pattern from the surface that it made (Lu, Zheng, Mishra 2015, IV-C)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap, Job
from inkloop.components import catalog
from inkloop.contract import LAYER_COMMAND, LAYERS_PRINTED, LAYERS_SCANNED, MEASURED_HEIGHT, PATTERN, VALID
from inkloop.units import NS_PER_S
from inkloop_lab.models import LayerDeposition
from inkloop_lab.reproduce.comparison import Part, Row

SIDE, COUNT, ROUGHNESS = 20, 50, 8e-6
FOUND = 1e-15
SURFACES = "start surfaces are uniform over 0 to 8 µm, a layer height; the paper only says that they are random"
PAPERS_OWN = "paper's search"
CONTROLLERS: Mapping[str, tuple[str, dict[str, object]]] = {
    PAPERS_OWN: ("StochasticGreedy", {"alpha": 1.0}),
    "LayerMpc, one layer ahead": ("LayerMpc", {"alpha": 1.0, "horizon": 1, "adapt_ink": "off", "flat_ground": False}),
}


def find(quick: bool) -> Part:
    """Number of patterns that each controller recovers, of 50 (quick: 10) random ones."""
    count = 10 if quick else COUNT
    rows = []
    for name, (kind, options) in CONTROLLERS.items():
        found = sum(_finds_again(kind, options, seed) for seed in range(count))
        printed = float(count) if name == PAPERS_OWN else None
        rows.append(Row("IV-C: recoverability", name, f"of {count}", printed, float(found), 0.0, SURFACES))
    return Part(rows)


def _finds_again(kind: str, options: dict[str, object], seed: int) -> bool:
    """Whether the layer that is commanded makes the target surface."""
    rng, model = np.random.default_rng(seed), LayerDeposition()
    start = rng.uniform(0.0, ROUGHNESS, (SIDE, SIDE))
    target = model.layer(model.start(start), rng.integers(0, 2, (SIDE, SIDE), dtype=np.int32)).height
    job = Job(SIDE, SIDE, 263.256e-6, target, np.ones((SIDE, SIDE), dtype=np.bool_), seed=seed)
    pattern = first_pattern(kind, job, options, start)
    return bool(np.abs(model.layer(model.start(start), pattern).height - target).max() <= FOUND)


def first_pattern(kind: str, job: Job, options: dict[str, object], height: FloatMap) -> NDArray[np.int32]:
    """First pattern that a controller commands on a surface; no droplet if it considers the print done."""
    controller = catalog.make(kind, job, options)
    scan = {
        MEASURED_HEIGHT: height,
        VALID: np.ones(height.shape, dtype=np.bool_),
        LAYERS_SCANNED: np.asarray(0, dtype=np.int32),
        LAYERS_PRINTED: np.asarray(0, dtype=np.int32),
    }
    try:
        controller.initialize(0, scan)
        outputs = controller.do_step(0, NS_PER_S, scan)
    finally:
        controller.terminate()
    pattern = np.asarray(outputs[PATTERN], dtype=np.int32)
    return pattern if int(outputs[LAYER_COMMAND]) == 1 else np.zeros_like(pattern)
