"""C. A. Hume, D. W. Rosen, "Low cost numerical modeling of material jetting-based additive manufacturing" (2018).

Time scales of the ink, and five droplets at the edge of a layer: the example that the paper explains its method with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from inkloop.units import UM_PER_M, US_PER_S
from inkloop_lab.models import YoungLaplaceDeposition
from inkloop_lab.models.young_laplace_deposition import FineSurface
from inkloop_lab.reproduce import liquid_bodies, pictures
from inkloop_lab.reproduce.comparison import Paper, Part, Row, Step

CELLS, EDGE = 11, 6
"""The layer below covers the cells with j < EDGE."""


def line_on_a_step(quick: bool) -> Part:
    """Along the edge and across it; the paper prints a picture and no number."""
    per_pitch = 8 if quick else 16
    rows, shown = [], {}
    for name, sites in {
        "along the edge": [(i, EDGE - 1) for i in range(3, 8)],
        "across the edge": [(5, j) for j in range(3, 8)],
    }.items():
        for form in ("nonlinear", "linear"):
            model = YoungLaplaceDeposition(form=form, cells_per_pitch=per_pitch)
            below, after = _printed(model, sites)
            added = (after.over_grid - below.over_grid) * UM_PER_M
            kept = 100.0 * float(added.sum()) * (after.spacing * UM_PER_M) ** 2 / (5 * 30e3)
            beyond = added[:, EDGE * per_pitch :].sum() / added.sum()
            where = f"Fig. 3 to 5, {name}, {form}"
            rows += [
                Row(where, "highest point over the plate", "µm", None, float(after.over_grid.max()) * UM_PER_M),
                Row(where, "thickest place of the line", "µm", None, float(added.max())),
                Row(where, "volume beyond the edge", "%", None, 100.0 * float(beyond)),
                Row(where, "volume kept, of five droplets", "%", None, kept),
            ]
            shown[f"{name}, {form}"] = (below, after)
    return Part(rows, {"line-on-a-step": pictures.lines_on_a_step(shown)})


def _printed(model: YoungLaplaceDeposition, sites: list[tuple[int, int]]) -> tuple[FineSurface, FineSurface]:
    """Surface of one full layer up to the edge, and with the five droplets on it.

    Across the edge the grid is turned, because lines lie along x.
    """
    layer, line = np.zeros((CELLS, CELLS), dtype=np.int32), np.zeros((CELLS, CELLS), dtype=np.int32)
    layer[1:-1, 1:EDGE] = 1
    line[tuple(np.transpose(sites))] = 1
    turned = len({i for i, _ in sites}) == 1
    if turned:
        layer, line = layer.T.copy(), line.T.copy()
    below = model.layer(model.start(np.zeros((CELLS, CELLS))), layer)
    after = model.layer(below, line, 2)
    if not turned:
        return below, after
    back = [FineSurface(s.height.T, s.fine.T, s.spacing, s.rim, s.fallbacks, s.lost) for s in (below, after)]
    return back[0], back[1]


GRAVITY = 9.81


@dataclass(frozen=True)
class Liquid:
    """density [kg/m3], viscosity [Pa s], surface_tension [N/m]; a droplet of `diameter` [m] that hits with `speed`
    [m/s], every `interval` [s]. Defaults: Hume, Rosen 2018, Table 1.
    """

    density: float = 1000.0
    viscosity: float = 0.010
    surface_tension: float = 0.025
    diameter: float = 40e-6
    speed: float = 4.0
    interval: float = 125e-6

    def __post_init__(self) -> None:
        wrong = [
            f"{name} is {value!r}; needs a number above 0"
            for name, value in vars(self).items()
            if not 0.0 < value < math.inf
        ]
        if wrong:
            raise ValueError("; ".join(wrong))

    @property
    def spreading(self) -> float:
        """t_spread = D / U [s] (eq. 1)."""
        return self.diameter / self.speed

    @property
    def oscillation(self) -> float:
        """t_osc = sqrt(rho D^3 / sigma) [s] (eq. 1)."""
        return math.sqrt(self.density * self.diameter**3 / self.surface_tension)

    @property
    def damping(self) -> float:
        """t_visc = rho D^2 / mu [s] (eq. 1)."""
        return self.density * self.diameter**2 / self.viscosity

    @property
    def relaxation(self) -> float:
        """t_relax, half of t_visc [s]: from then on surface tension alone shapes the droplet."""
        return self.damping / 2.0

    @property
    def bond(self) -> float:
        """rho g D^2 / sigma: weight over surface tension."""
        return self.density * GRAVITY * self.diameter**2 / self.surface_tension

    @property
    def ohnesorge(self) -> float:
        """mu / sqrt(rho sigma D): viscosity over inertia and surface tension."""
        return self.viscosity / math.sqrt(self.density * self.surface_tension * self.diameter)

    def objections(self) -> list[str]:
        """Reasons why the quasi-static model does not hold for this liquid, a sentence each; none if it does.

        The limits, a tenth for Bond and 1 for Ohnesorge, are assumed; the paper asks for "much smaller than 1" and
        "low".
        """
        found = []
        if self.relaxation > self.interval:
            found.append(
                f"a droplet needs {self.relaxation * US_PER_S:.0f} us to come to rest, the next one comes "
                f"after {self.interval * US_PER_S:.0f} us; jet more slowly or use a more viscous "
                "ink"
            )
        if self.bond > 0.1:
            found.append(f"Bond number {self.bond:.2g}; the model leaves out weight and needs at most 0.1")
        if self.ohnesorge > 1.0:
            found.append(f"Ohnesorge number {self.ohnesorge:.2g}: viscosity holds the droplet back; needs at most 1")
        return found


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
        Step("one droplet, Table 2", liquid_bodies.single_droplet),
        Step("five droplets at the edge of a layer", line_on_a_step),
        Step("square of 6250 droplets", liquid_bodies.square),
    ),
)
