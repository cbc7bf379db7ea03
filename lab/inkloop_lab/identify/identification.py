"""Identification of one ink from its prints: its heights by each method, and a comparison of all models."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from inkloop.component import Ink
from inkloop.units import UM_PER_M
from inkloop_lab.errors import IdentificationError
from inkloop_lab.identify.candidates import candidates, conserving
from inkloop_lab.identify.cross_validation import Comparison, compare
from inkloop_lab.identify.droplet_protocol import ProtocolEstimate, identify_by_protocol
from inkloop_lab.identify.ink_regression import InkEstimate, identify_ink
from inkloop_lab.identify.print_record import PrintRecord, noise_of
from inkloop_lab.identify.scan_geometry import ScanGeometry
from inkloop_lab.identify.scan_registration import Registered, register
from inkloop_lab.identify.volume_area_coefficients import VolumeAreaEstimate, identify_volume_area
from inkloop_lab.models import LayerDeposition

DENSE = 0.15  # share of touched cells hit by a layer on average; below it is a print of motifs (assumed)

GROWTHS_COMPARED = 12_000  # growths of cells: more separate models no better, but take longer (assumed)


@dataclass(frozen=True, eq=False)
class Identification:
    """records: in register; noise_std: of a reading [m]; ink: by regression over layers; protocol, volume_area: None,
    with the reason in `notes`, if the prints lack the drops for it; comparisons: of all models over `compared`; reach:
    of the plant asked for, 1 for none; geometries: of the scans of each record as it was logged.
    """

    records: tuple[PrintRecord, ...]
    compared: tuple[PrintRecord, ...]
    noise_std: float
    ink: InkEstimate
    protocol: ProtocolEstimate | None
    volume_area: VolumeAreaEstimate | None
    comparisons: tuple[Comparison, ...]
    notes: tuple[str, ...]
    reach: int = 1
    geometries: tuple[ScanGeometry, ...] = ()

    @property
    def displaced(self) -> list[str]:
        """A sentence for each print whose scans are not in register."""
        pairs = zip(self.records, self.geometries, strict=False)
        return [f"the scans of {record.name} {place.describe()}" for record, place in pairs if not place.is_none]

    @property
    def plant(self) -> LayerDeposition | None:
        """The layer-to-layer model of the reach asked for, whose heights add up to the volume of a droplet."""
        found = [one.model for one in self.comparisons if one.name == conserving(self.reach)]
        return found[0] if found and isinstance(found[0], LayerDeposition) else None

    @property
    def best(self) -> Comparison:
        """The model with the least cross-validated error."""
        return min((c for c in self.comparisons if c.score), key=lambda c: c.score.rms if c.score else np.inf)


def identify(
    records: Sequence[PrintRecord],
    nominal: Sequence[Ink] = (Ink(),),
    noise_std: float | None = None,
    seed: int = 0,
    on_fit: Callable[[str, int, int], None] | None = None,
    reach: int = 1,
) -> Identification:
    """The ink of prints on one grid spacing; on_fit: called with the current fit, fits done and all fits.

    reach: 2 or 3 also fits a plant whose droplets reach that many cells far. noise_std: of a reading [m], by default
    from cells that no droplet reached. Layers of many droplets give the ink that is written, if there are any: single
    droplets of motifs behave differently on a real plant. Displaced scans are corrected. Raises IdentificationError,
    also where scans do not show the patterns of their print.
    """
    _check(records)
    noise = noise_of(list(records)) if noise_std is None else noise_std
    if noise is None:
        raise IdentificationError(
            "too few cells lie apart from all droplets to show the noise of the scans; give it (--noise-um), or leave "
            "a margin of three empty cells"
        )
    placed = _registered(records, noise, on_fit)
    farthest = max(each.geometry.farthest for each in placed)
    if noise_std is None and farthest > 1.0:  # readings of cells that droplets reach are among those for the noise
        noise = noise_of(list(records), 2 + math.ceil(farthest)) or noise
    chosen = [each for each in placed if _density(each.record) >= DENSE] or placed
    records, dense = [each.record for each in placed], tuple(each.record for each in chosen)
    notes = [each.note for each in placed if each.note]
    protocol: ProtocolEstimate | None = None
    volume_area: VolumeAreaEstimate | None = None
    try:
        protocol = identify_by_protocol(records, noise)
    except IdentificationError as error:
        notes.append(f"droplet protocol: {error}")
    try:
        volume_area = identify_volume_area(records, noise, seed)
    except IdentificationError as error:
        notes.append(f"Wu and Chiu's coefficients: {error}")
    ink = identify_ink([each.recorded for each in chosen], noise, geometries=[each.geometry for each in chosen])
    compared = tuple(record.first(_layers_compared(dense)) for record in dense)
    if any(len(record.pattern) < len(whole.pattern) for record, whole in zip(compared, dense, strict=True)):
        notes.append(f"models are compared over the first {_layers_compared(dense)} layers of each print")
    models = candidates(nominal, noise, None if protocol is None else protocol.heights, volume_area, reach)
    comparisons = tuple(compare(models, compared, noise, on_fit))
    notes += [f"{c.name}: {c.refusal}" for c in comparisons if c.refusal]
    found = tuple(records), compared, noise, ink, protocol, volume_area, comparisons, tuple(notes)
    return Identification(*found, reach, tuple(each.geometry for each in placed))


def _registered(
    records: Sequence[PrintRecord], noise_std: float, on_fit: Callable[[str, int, int], None] | None
) -> list[Registered]:
    """All prints in register. Raises IdentificationError with all prints whose scans do not show their patterns."""
    found: list[Registered] = []
    errors: list[str] = []
    for number, record in enumerate(records):
        if on_fit:
            on_fit("geometry of the scans", number, len(records))
        try:
            found.append(register(record, noise_std))
        except IdentificationError as error:
            errors.append(str(error))
    if errors:
        raise IdentificationError("\n".join(errors))
    return found


def _check(records: Sequence[PrintRecord]) -> None:
    """Raises IdentificationError if prints do not belong together."""
    if not records:
        raise IdentificationError("no print was given")
    first = records[0]
    errors = [
        f"{record.name}: {what} {value}, {first.name}: {expected}; identify prints of one pitch and process together"
        for record in records[1:]
        for what, value, expected in (
            ("pitch_um", f"{record.pitch * UM_PER_M:g}", f"{first.pitch * UM_PER_M:g}"),
            ("passes", record.passes, first.passes),
            ("pass_order", record.pass_order, first.pass_order),
            ("pass_rotation", record.pass_rotation, first.pass_rotation),
        )
        if value != expected
    ]
    if errors:
        raise IdentificationError("\n".join(errors))


def _layers_compared(records: Sequence[PrintRecord]) -> int:
    """Layers of each print over which models are compared, which takes time for each of them."""
    return max(2, GROWTHS_COMPARED // sum(record.shape[0] * record.shape[1] for record in records))


def _density(record: PrintRecord) -> float:
    touched = ~record.untouched(1)
    return float((record.pattern > 0).mean(axis=0)[touched].mean()) if touched.any() else 0.0
