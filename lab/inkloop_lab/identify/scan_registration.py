"""Register the scans of a log: estimate their geometry, if the log shows one, and correct the surfaces by it.

The geometry is fitted with the ink (`ink_regression`) and accepted only if it reduces the residuals. A true
displacement leaves noise and the variation of droplets; droplets unlike the model's also look displaced by some
hundredths of a cell, but their residuals remain. So a geometry that explains less than half of the unexplained variance
is rejected, and the scans are not changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inkloop_lab.identify.ink_regression import InkEstimate, identify_ink
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, first_guess
from inkloop_lab.identify.scan_geometry import ScanGeometry
from inkloop_lab.identify.scan_hypotheses import first_shift
from inkloop_lab.identify.surface_filter import first_surface, innovations

SIGNIFICANT = 40.0  # chi-square of the eight terms: exceeded by chance in 3 of a million logs
EXPLAINED = 0.45  # largest remaining share of the unexplained variance; droplets unlike the model's left 0.5 and more
LITTLE = 0.025  # share of a droplet's volume over a cell: smaller residuals need no geometry (assumed)
NEAR = 0.04  # [cells]: a smaller displacement changes no height by more than 3 %
DOUBTFUL = (1000.0, 0.2)  # significance and [cells] above which a rejected geometry is reported (assumed)
LINEAR_MOST = 0.06  # a larger linear part is a wide spot, which mixes neighbours as a magnification does (assumed)
DOUBT = "stays unexplained, as with droplets of another kind or a wide spot: not corrected; check the profiler"
FAR_START = 0.4  # first shift [cells] above which the fit is also tried from 0


@dataclass(frozen=True, eq=False)
class Registered:
    """recorded: the print as logged; geometry: of its scans; record: the print with corrected surfaces; note: reason to
    suspect a geometry that was not corrected.
    """

    recorded: PrintRecord
    geometry: ScanGeometry
    record: PrintRecord
    note: str = ""


def register(record: PrintRecord, noise_std: float) -> Registered:
    """The scans of a print in register with its droplets; noise_std: of a reading [m].

    Raises IdentificationError if the scans do not show the patterns, in any orientation or order.
    """
    shift = first_shift(record)
    none = ScanGeometry.in_register(record.shape, len(record.pattern))
    as_they_are = Registered(record, none, record)
    starts = [none]
    if np.abs(shift).max() > FAR_START:
        starts.append(none.moved(np.concatenate([shift, none.terms[2:]])))
    try:
        plain = identify_ink([record], noise_std)
        fits = [identify_ink([record], noise_std, geometries=[start], fit_geometry=True) for start in starts]
    except IdentificationError as error:  # together with other prints the fit may succeed
        return replace(as_they_are, note=f"geometry of the scans of {record.name}: {error}")
    fit = min(fits, key=lambda one: one.unexplained)
    geometry = fit.geometry
    assert geometry is not None, "it was asked for"
    if not _explains(fit, plain, first_guess([record])):
        if _significance(fit) <= DOUBTFUL[0] or geometry.farthest <= DOUBTFUL[1]:
            return as_they_are
        doubt = f"the scans of {record.name} look as if they {geometry.describe()}, but most of what droplets leave "
        return replace(as_they_are, note=f"{doubt}{DOUBT}")
    steps = innovations(record, fit.heights, noise_std, fit.droplet_std**2, geometry, fit.place_std**2)
    start, _ = first_surface(record.measured[0], noise_std, geometry)
    surfaces = np.stack([start, *(step.surface for step in steps)])
    measured = np.where(np.isfinite(record.measured), surfaces, np.nan)
    return Registered(record, geometry, replace(record, measured=measured))


def _explains(fit: InkEstimate, plain: InkEstimate, layer: float) -> bool:
    """Whether the geometry of a fit is accepted; layer: height that a droplet adds over a cell [m]."""
    geometry = fit.geometry
    if geometry is None or geometry.farthest < NEAR or np.abs(geometry.linear).max() > LINEAR_MOST:
        return False
    if plain.unexplained < (LITTLE * layer) ** 2:
        return False
    return _significance(fit) > SIGNIFICANT and fit.unexplained < EXPLAINED * plain.unexplained


def _significance(fit: InkEstimate) -> float:
    """Significance of its geometry, as chi-square of eight degrees of freedom."""
    if fit.geometry is None or fit.geometry_covariance is None:
        return 0.0
    return float(fit.geometry.terms @ np.linalg.pinv(fit.geometry_covariance) @ fit.geometry.terms)
