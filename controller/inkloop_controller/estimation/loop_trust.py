"""What makes a print doubtful although it continues (controller/core/estimator/loop_trust.h)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from inkloop_controller.core.library import library
from inkloop_controller.core.structs import LoopTrustStruct


class UntrustedReason(IntFlag):
    """Why the status is untrusted."""

    UNSEEN = 1  # cells of the part have lived on prediction for too many layers
    BLIND = 2  # most of the part was not measured in the last scan
    GROUND = 4  # the first scan shows an offset or a tilt of ground that is called flat
    RESIDUALS = 8  # scans differ from predictions by more than droplets and sensor explain
    INK = 16  # cells are capped: they ask for more ink than an open loop would give them
    HIGH = 32  # cells stand higher than they are to


@dataclass(frozen=True)
class LoopTrust:
    """What was seen that makes a print doubtful.

    ground_offset, ground_rise_x, ground_rise_y: of the first scan on ground called flat: height of its middle, its rise
    over the grid [m]; early, residual: mean square of the residuals until the part is half built, and of all with
    recent ones counting more [variances]; volume: of the droplets of the last layer, as a share of the learnt one [1];
    usual: of layers over most of the part, as a share of the nominal one [1]; blind_share: of the part that the last
    scan did not measure; excess: the most that a cell is higher by its droplets than by its scan [m], at number
    excess_cell in C order; rise: the most that a cell stands above its target and what its droplets explain [m], at
    rise_cell; layers: that count in the residuals; capped_cells, unseen_cells, high_cells: their numbers;
    ground_wrong: whether the ground is not the flat one; spill: mean square of the residuals of cells that only
    neighbours' droplets reached, recent ones counting more [variances].
    """

    ground_offset: float
    ground_rise_x: float
    ground_rise_y: float
    early: float
    residual: float
    volume: float
    usual: float
    blind_share: float
    excess: float
    rise: float
    excess_cell: int
    rise_cell: int
    layers: int
    capped_cells: int
    ground_wrong: bool
    unseen_cells: int
    high_cells: int
    spill: float

    @classmethod
    def full(cls) -> LoopTrust:
        """Before the first scan."""
        return cls(0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0, 0, 0, 0, False, 0, 0, 1.0)

    @property
    def reasons(self) -> UntrustedReason:
        """The reasons why the loop is not trusted."""
        return UntrustedReason(library().inkloop_untrusted_reasons(self.struct()))

    @property
    def surprise(self) -> float:
        """By how much scans differ from predictions, in standard deviations."""
        return float(np.sqrt(self.residual))

    @property
    def is_plant_foreign(self) -> bool:
        """Whether droplets spill onto their neighbours in another way than the model's: plans look less far ahead."""
        return bool(library().inkloop_is_plant_foreign(self.struct()))

    @property
    def droplet_std(self) -> float:
        """Standard deviation of a droplet's volume, as a share of it, as the residuals show; 0 before there are any."""
        return float(library().inkloop_droplet_std(self.struct()))

    def sums(self) -> NDArray[np.float64]:
        """All of it in one array."""
        return np.array([float(value) for value in vars(self).values()])

    @classmethod
    def of_sums(cls, sums: NDArray[np.float64]) -> LoopTrust:
        """Restore the result of `sums`, bit by bit; earlier versions had no `spill`."""
        full = list(vars(cls.full()).values())
        values = [*sums, full[-1]] if len(sums) == len(full) - 1 else list(sums)
        return cls(*(type(known)(value) for known, value in zip(full, values, strict=True)))

    def struct(self) -> LoopTrustStruct:
        """The same for C."""
        ground, *rest = (self.ground_offset, self.ground_rise_x, self.ground_rise_y), *list(vars(self).values())[3:]
        return LoopTrustStruct(ground, *rest)

    @classmethod
    def of_struct(cls, struct: LoopTrustStruct) -> LoopTrust:
        """What C has made of it."""
        offset, rise_x, rise_y = struct.ground
        return cls(
            offset,
            rise_x,
            rise_y,
            struct.early,
            struct.residual,
            struct.volume,
            struct.usual,
            struct.blind_share,
            struct.excess,
            struct.rise,
            struct.excess_cell,
            struct.rise_cell,
            struct.layers,
            struct.capped_cells,
            bool(struct.ground_wrong),
            struct.unseen_cells,
            struct.high_cells,
            struct.spill,
        )
