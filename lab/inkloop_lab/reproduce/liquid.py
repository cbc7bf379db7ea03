"""Properties of a jetted liquid: its time scales and numbers, and whether a droplet is at rest before the next one
comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from inkloop.units import US_PER_S

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
