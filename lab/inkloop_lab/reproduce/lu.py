"""L. Lu, J. Zheng, S. Mishra, "A layer-to-layer model and feedback control of ink-jet 3-D printing" (2015)."""

from __future__ import annotations

from inkloop_lab.reproduce import cuboids, cylinders, droplet_spacing, layer_growth, pipes, recovery
from inkloop_lab.reproduce.comparison import Paper, Step

PAPER = Paper(
    "lu",
    "L. Lu, J. Zheng, S. Mishra, A layer-to-layer model and feedback control of ink-jet 3-D printing, IEEE/ASME "
    "Transactions on Mechatronics 20 (2015) 1056-1068",
    (
        Step("edges and domes", layer_growth.find),
        Step("spacing of droplets", droplet_spacing.find),
        Step("recoverability", recovery.find),
        *cylinders.STEPS,
        Step("cuboids of Table II", cuboids.find),
        Step("pipe junction", pipes.find),
    ),
)
