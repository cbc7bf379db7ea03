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

SMALL = (26.1, 0.5)  # least significance, and most that may be left of the unexplained variance
LARGE = (1000.0, 0.97)  # the same of displacements above FAR
FAR = 0.2  # [cells]: droplets of no other kind look so far displaced (largest seen 0.15, lines that coalesce)
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
        starts.append(replace(none, terms=np.concatenate([shift, none.terms[2:]])))
    try:
        plain = identify_ink([record], noise_std)
        fits = [identify_ink([record], noise_std, geometries=[start], fit_geometry=True) for start in starts]
    except IdentificationError as error:  # together with other prints it may do
        return replace(as_they_are, note=f"geometry of the scans of {record.name}: {error}")
    fit = min(fits, key=lambda one: one.droplet_std)
    if not _explains(fit, plain):
        return as_they_are
    (geometry,) = fit.geometries
    steps = innovations(record, fit.heights, noise_std, fit.droplet_std**2, geometry)
    start, _ = first_surface(record.measured[0], noise_std, geometry)
    surfaces = np.stack([start, *(step.surface for step in steps)])
    measured = np.where(np.isfinite(record.measured), surfaces, np.nan)
    return Registered(record, geometry, replace(record, measured=measured))


def _explains(fit: InkEstimate, plain: InkEstimate) -> bool:
    """Whether a geometry is believed."""
    (geometry,) = fit.geometries
    terms = geometry.terms
    significance = float(terms @ np.linalg.pinv(fit.geometry_covariance) @ terms)  # chi-square: 26.1 by chance in 0.1 %
    left = (fit.droplet_std / plain.droplet_std) ** 2 if plain.droplet_std > 0.0 else np.inf
    limits = (SMALL, LARGE) if geometry.farthest > FAR else (SMALL,)
    return any(significance > least and left < most for least, most in limits)
