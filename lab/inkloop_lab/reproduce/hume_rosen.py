"""C. A. Hume, D. W. Rosen, "Low cost numerical modeling of material jetting-based additive manufacturing" (2018)."""

from __future__ import annotations

from inkloop.units import US_PER_S
from inkloop_lab.reproduce import line_on_a_step, single_droplet, square
from inkloop_lab.reproduce.comparison import Paper, Part, Row, Step
from inkloop_lab.reproduce.liquid import Liquid

GIVEN = "t_dep is a given value, not a result"


def time_scales(quick: bool) -> Part:
    """Table 1, and the dimensionless numbers in the text."""
    ink = Liquid()
    where, text = "Table 1", "the paper calls it small and gives no number"
    return Part(
        [
            Row(where, "t_spread", "us", 10.0, ink.spreading * US_PER_S, 0.5),
            Row(where, "t_osc", "us", 50.0, ink.oscillation * US_PER_S, 1.0),
            Row(where, "t_visc", "us", 160.0, ink.damping * US_PER_S, 0.5),
            Row(where, "t_relax", "us", 80.0, ink.relaxation * US_PER_S, 0.5),
            Row(where, "t_dep, at 8 kHz", "us", 125.0, ink.interval * US_PER_S, remark=GIVEN),
            Row("Theory", "Bond number", "1", None, ink.bond, remark=text),
            Row("Theory", "Ohnesorge number", "1", None, ink.ohnesorge, remark=text),
            Row("Theory", "objections to the quasi-static model", "1", None, float(len(ink.objections()))),
        ]
    )


PAPER = Paper(
    "hume-rosen",
    "C. A. Hume, D. W. Rosen, Low cost numerical modeling of material jetting-based additive manufacturing, "
    "Solid Freeform Fabrication Symposium 2018",
    (
        Step("time scales of the ink", time_scales),
        Step("one droplet, Table 2", single_droplet.find),
        Step("five droplets at the edge of a layer", line_on_a_step.find),
        Step("square of 6250 droplets", square.find),
    ),
)
