"""The junction of two pipes in two inks, Fig. 13 and 14 (Lu, Zheng, Mishra 2015)."""

from __future__ import annotations

from inkloop.report.solid_picture import solids
from inkloop.units import UM_PER_M
from inkloop_lab.reproduce import prints
from inkloop_lab.reproduce.comparison import Part, Row

WHERE = "Fig. 13, 14: pipe junction"
BY_EYE = 'the paper shows pictures: "visible deformation near the edge" open loop, "no visible deformation" closed loop'


def find(quick: bool) -> Part:
    """One print by each controller; the paper's search only when there is time."""
    runs = prints.by_controller("pipe-junction", [1], without=["paper's search"] if quick else [])
    rows = []
    for label, (result,) in runs.items():
        metrics = result.metrics()
        rows += [
            Row(WHERE, f"{label}: geometry mismatch", "%", None, 100.0 * metrics["mismatch"], remark=BY_EYE),
            Row(WHERE, f"{label}: mean absolute error of the top", "µm", None, metrics["mae"] * UM_PER_M),
        ]
    return Part(rows, {"pipe-junction": solids({label: result.dataset for label, (result,) in runs.items()})})
