"""Shrinkage of edges layer by layer: section III-C, and the domes of Fig. 8, 21 and 22 (Lu, Zheng, Mishra 2015)."""

from __future__ import annotations

import numpy as np

from inkloop.component import FloatMap
from inkloop.units import UM_PER_M
from inkloop_lab.models import LayerDeposition, SuperpositionDeposition
from inkloop_lab.reproduce import pictures
from inkloop_lab.reproduce.comparison import Part, Row

H1, H2 = 4.4, 0.6
R = H1 * H2 / (H1 + H2)
LINE, LAYERS = 21, 6
DOME = (27.343, 29.592, 30.273, 30.391, 30.4)
"""Middle row of the cuboid from its edge inwards [µm], from an independent reading of the equations (the paper: a
picture).
"""
EXPRESSIONS = "the paper prints expressions; printed are their values for h1 and h2 of Table I, r = h1 h2 / (h1 + h2)"
LAYER_COUNT = "the caption says six layers, the text ten; ten are shown"
ADDITIVE = "the traditional model: sum of caps 413 µm wide and 4.4 µm high; the paper says constant height everywhere"


def find(quick: bool) -> Part:
    """All comparisons; they take a moment, quick or not."""
    line = _layers(
        LayerDeposition(heights=((H1 / UM_PER_M, H2 / UM_PER_M, 0.0),)), np.ones((LINE, 1), dtype=np.int32), LAYERS
    )
    rows = _line_rows([surface[:, 0] for surface in line])
    cuboid = np.pad(np.ones((9, 9), dtype=np.int32), 2)
    model, caps = LayerDeposition(), SuperpositionDeposition()
    dome, added = _layers(model, cuboid, 4)[-1], _layers(caps, cuboid, 4)[-1]
    inside = (slice(3, 10), slice(3, 10))
    spread, spread_added = (float(np.ptp(surface[inside])) for surface in (dome, added))
    where = "Fig. 21, 22: cuboid, 4 layers"
    rows += [Row(where, f"middle row, droplet {k + 1}", "µm", None, float(dome[2 + k, 6])) for k in range(5)]
    rows += [
        Row(where, "corner droplet", "µm", None, float(dome[2, 2])),
        Row(where, "highest less lowest, inner 7 x 7", "µm", None, spread),
        Row(where, "the same, traditional model", "µm", None, spread_added, remark=ADDITIVE),
    ]
    i, j = np.indices((35, 35))
    disc = ((i - 17) ** 2 + (j - 17) ** 2 <= 225).astype(np.int32)
    tower = _layers(model, disc, 10)
    where = "Fig. 8: cylinder"
    for n in (6, 10):
        rise = float(tower[n - 1][17, 17] - tower[n - 1][2, 17])
        rows.append(Row(where, f"centre less edge, {n} layers", "µm", None, rise, remark=LAYER_COUNT))
    figure = pictures.growth([surface[:, 0] for surface in line], dome[2:11, 6], added[2:11, 6], tower[-1][:, 17])
    return Part(rows, {"edges-shrink": figure})


def _line_rows(line: list[FloatMap]) -> list[Row]:
    first, second = line[0], line[1]
    expected = {
        "layer 1, edge: h1 + h2": (H1 + H2, first[0]),
        "layer 1, others: h1 + 2 h2": (H1 + 2 * H2, first[LINE // 2]),
        "layer 2, edge: 2 h1 + 3 h2 - r": (2 * H1 + 3 * H2 - R, second[0]),
        "layer 2, next: 2 h1 + 3 h2 + r": (2 * H1 + 3 * H2 + R, second[1]),
        "layer 2, others: 2 h1 + 4 h2": (2 * H1 + 4 * H2, second[LINE // 2]),
    }
    rows = [
        Row("III-C, Fig. 7: line", name, "µm", printed, float(ours), 1e-9, EXPRESSIONS)
        for name, (printed, ours) in expected.items()
    ]
    for layers, surface in enumerate(line, start=1):
        flat = layers * (H1 + 2 * H2)
        shrunk = int(np.count_nonzero(np.abs(surface[: LINE // 2] - flat) > 1e-9))
        rows.append(
            Row(
                "III-C: points that shrink",
                f"after {layers} layer{'s' if layers > 1 else ''}",
                "1",
                float(layers),
                float(shrunk),
                0.0,
            )
        )
    return rows


def _layers(
    model: LayerDeposition | SuperpositionDeposition,
    pattern: np.ndarray[tuple[int, ...], np.dtype[np.int32]],
    count: int,
) -> list[FloatMap]:
    """Surfaces after each of `count` layers of one pattern [µm]."""
    surface, found = model.start(np.zeros(pattern.shape)), []
    for layer in range(count):
        surface = model.layer(surface, pattern, layer + 1)
        found.append(surface.height * UM_PER_M)
    return found
