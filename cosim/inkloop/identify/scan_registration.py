"""Register the scans of a log: their geometry where the log shows one, and the surfaces that it stands for.

The geometry is fitted with the ink (`ink_regression`) and believed only if it explains. A true displacement leaves
noise and what droplets vary by; droplets of another kind look displaced by a few hundredths of a cell, and leave what
they left before. So a geometry that explains less than half and moves no reading far is taken for none, and the
scans stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inkloop.errors import IdentificationError
from inkloop.identify.ink_regression import InkEstimate, identify_ink
from inkloop.identify.print_record import PrintRecord
from inkloop.identify.scan_geometry import ScanGeometry
from inkloop.identify.scan_hypotheses import first_shift
from inkloop.identify.surface_filter import first_surface, innovations

SIGNIFICANT = 26.1  # chi-square of the eight terms; by chance in 0.1 %
EXPLAINED = 0.5  # most that is left of the unexplained variance; of foreign droplets 0.6 and more was seen
DOUBTFUL = (1000.0, 0.2)  # significance and [cells] of a geometry that is reported though it is not believed (assumed)
LINEAR_MOST = 0.06  # of the linear part; more is a wide spot, which mixes neighbours as a magnification does (assumed)
DOUBT = "stays unexplained, as with droplets of another kind or a wide spot: not corrected; check the profiler"
FAR_START = 0.4  # [cells] of a first shift: the fit begins from none, too


@dataclass(frozen=True, eq=False)
class Registered:
    """recorded: the print as it is logged; geometry: of its scans; record: the print with the surfaces that the scans
    show in their place; note: why there may be a geometry that was not looked for.
    """

    recorded: PrintRecord
    geometry: ScanGeometry
    record: PrintRecord
    note: str = ""


def register(record: PrintRecord, noise_std: float) -> Registered:
    """The scans of a print whose noise is known [m] in register with its droplets.

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
    except IdentificationError as error:  # together with other prints it may do
        return replace(as_they_are, note=f"geometry of the scans of {record.name}: {error}")
    fit = min(fits, key=lambda one: one.droplet_std)
    geometry = fit.geometry
    assert geometry is not None, "it was asked for"
    if not _explains(fit, plain):
        if _significance(fit) <= DOUBTFUL[0] or geometry.farthest <= DOUBTFUL[1]:
            return as_they_are
        doubt = f"the scans of {record.name} look as if they {geometry.describe()}, but most of what droplets leave "
        return replace(as_they_are, note=f"{doubt}{DOUBT}")
    steps = innovations(record, fit.heights, noise_std, fit.droplet_std**2, geometry, fit.place_std**2)
    start, _ = first_surface(record.measured[0], noise_std, geometry)
    surfaces = np.stack([start, *(step.surface for step in steps)])
    measured = np.where(np.isfinite(record.measured), surfaces, np.nan)
    return Registered(record, geometry, replace(record, measured=measured))


def _explains(fit: InkEstimate, plain: InkEstimate) -> bool:
    """Whether the geometry of a fit is believed."""
    if fit.geometry is None or np.abs(fit.geometry.linear).max() > LINEAR_MOST:
        return False
    left = fit.unexplained / plain.unexplained if plain.unexplained > 0.0 else 1.0
    return _significance(fit) > SIGNIFICANT and left < EXPLAINED


def _significance(fit: InkEstimate) -> float:
    """How far the terms of its geometry are off zero, as chi-square of eight degrees of freedom."""
    if fit.geometry is None or fit.geometry_covariance is None:
        return 0.0
    return float(fit.geometry.terms @ np.linalg.pinv(fit.geometry_covariance) @ fit.geometry.terms)
