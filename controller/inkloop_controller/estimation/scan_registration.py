"""Estimate where the sensor really looks: shift of its scans against the printer and width of its spot."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from inkloop_controller.core.library import library
from inkloop_controller.core.structs import RegistrationStruct, ScanDisplacementStruct

DISPLACEMENTS = 3  # shift along x and y [cells], variance of the spot's weights [cells^2]


@dataclass(frozen=True)
class ScanDisplacement:
    """Where the sensor looks [cells].

    shift_x, shift_y: the last scan's reading of cell (i, j) is of the plant at (i + shift_x, j + shift_y); shift_std:
    standard deviation of their errors, the larger one; spot_radius: standard deviation of the Gaussian spot, 0 while it
    cannot be distinguished from a point; spot_std: standard deviation of its error.
    """

    shift_x: float
    shift_y: float
    shift_std: float
    spot_radius: float
    spot_std: float


@dataclass(frozen=True, eq=False)
class Registration:
    """The displacement of the last scan, as far as the scans show it (controller/core/estimator/scan_registration.h).

    estimate: (3,) shift along x and y [cells] and variance of the spot's weights over the cells [cells^2]; covariance:
    (3, 3) of its error; applied: (3,) what the heights stand corrected for, 0 before the evidence is beyond doubt;
    steps_variance: of the shift from scan to scan [cells^2]; misfit: variance of a reading per squared curvature of the
    surface [1]; far_product, far_information: what readings beyond the reach of droplets show of a spot; scans: so far;
    has_shift, has_wide_spot: whether scans are corrected for them.
    """

    estimate: NDArray[np.float64]
    covariance: NDArray[np.float64]
    applied: NDArray[np.float64]
    steps_variance: float
    misfit: float
    far_product: float
    far_information: float
    scans: int
    has_shift: bool
    has_wide_spot: bool

    @classmethod
    def none(cls) -> Registration:
        """Before the first scan."""
        struct = RegistrationStruct()
        library().inkloop_no_registration(struct)
        return cls.of_struct(struct)

    @property
    def is_applied(self) -> bool:
        """Whether scans are corrected."""
        return self.has_shift or self.has_wide_spot

    @property
    def displacement(self) -> ScanDisplacement:
        """What is reported of it."""
        struct = ScanDisplacementStruct()
        library().inkloop_displacement(self.struct(), struct)
        return ScanDisplacement(*(float(getattr(struct, field.name)) for field in fields(ScanDisplacement)))

    def sums(self) -> NDArray[np.float64]:
        """All of it in one array."""
        learnt = [self.steps_variance, self.misfit, self.far_product, self.far_information]
        flags = [self.scans, self.has_shift, self.has_wide_spot]
        return np.concatenate([self.estimate, self.covariance.ravel(), self.applied, learnt, flags])

    @classmethod
    def of_sums(cls, sums: NDArray[np.float64]) -> Registration:
        """Restore the result of `sums`, bit by bit."""
        estimate, covariance, applied, learnt, flags = np.split(sums, [3, 12, 15, 19])
        scans, has_shift, has_wide_spot = (int(value) for value in flags)
        steps, misfit, product, information = (float(value) for value in learnt)
        square, both = covariance.reshape(3, 3), (bool(has_shift), bool(has_wide_spot))
        return cls(estimate, square, applied, steps, misfit, product, information, scans, *both)

    def struct(self) -> RegistrationStruct:
        """The same for C."""
        rows = (tuple(self.estimate), tuple(self.covariance.ravel()), tuple(self.applied))
        learnt = (self.steps_variance, self.misfit, self.far_product, self.far_information)
        return RegistrationStruct(*rows, *learnt, self.scans, self.has_shift, self.has_wide_spot)

    @classmethod
    def of_struct(cls, struct: RegistrationStruct) -> Registration:
        """What C has made of it."""
        sums = np.frombuffer(memoryview(struct), count=15).copy()
        return cls(
            sums[:3],
            sums[3:12].reshape(3, 3),
            sums[12:],
            struct.steps_variance,
            struct.misfit,
            struct.far_product,
            struct.far_information,
            struct.scans,
            bool(struct.has_shift),
            bool(struct.has_wide_spot),
        )
