"""Identification of one ink from its prints: its heights by each method, and all models compared by cross validation:
prediction errors on stripes along x, one left out of the fit at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Ink
from inkloop.units import UM_PER_M
from inkloop_lab.identify.candidates import Candidate, candidates, conserving
from inkloop_lab.identify.droplet_protocol import ProtocolEstimate, identify_by_protocol
from inkloop_lab.identify.ink_regression import InkEstimate, identify_ink
from inkloop_lab.identify.one_step import Marks, Model, Score, predictions, score
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, first_guess, noise_of
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


FOLDS = 4
CELLS_MIN = 3  # cells along x of a stripe, so that it holds more than borders


@dataclass(frozen=True, eq=False)
class Comparison:
    """One model. model: fitted to everything; score: of cells left out of its fit; errors: by print (layers, nx, ny)
    scan less prediction of those [m]. Where it could not be fitted, `refusal` is the reason, the others are None.
    """

    name: str
    model: Model | None
    score: Score | None
    errors: tuple[NDArray[np.float64], ...]
    refusal: str = ""


def compare(
    candidates: Sequence[Candidate],
    records: Sequence[PrintRecord],
    noise_std: float,
    on_fit: Callable[[str, int, int], None] | None = None,
) -> list[Comparison]:
    """All models over the same prints; on_fit: gets model, fits done, all fits. Raises IdentificationError."""
    stripes = [_stripes(record) for record in records]
    total, found = len(candidates) * (FOLDS + 1), []
    for place, candidate in enumerate(candidates):

        def done(fold: int, name: str = candidate.name, first: int = place * (FOLDS + 1)) -> None:
            if on_fit:
                on_fit(name, first + fold, total)

        try:
            found.append(_validated(candidate, records, stripes, noise_std, done))
        except (IdentificationError, ValueError) as error:
            found.append(Comparison(candidate.name, None, None, (), str(error)))
    return found


def _stripes(record: PrintRecord) -> NDArray[np.int64]:
    """(nx, ny): number of each cell's stripe. Raises IdentificationError for a grid that is too small."""
    nx, ny = record.shape
    if nx < FOLDS * CELLS_MIN:
        raise IdentificationError(
            f"{record.name}: {nx} cells along x; comparing models needs {FOLDS * CELLS_MIN}, a print with more cells"
        )
    return np.repeat((np.arange(nx) * FOLDS // nx)[:, None], ny, axis=1)


def _validated(
    candidate: Candidate,
    records: Sequence[PrintRecord],
    stripes: Sequence[NDArray[np.int64]],
    noise_std: float,
    done: Callable[[int], None],
) -> Comparison:
    predicted = [np.full(record.pattern.shape, np.nan) for record in records]
    for fold in range(FOLDS):
        done(fold)
        model = candidate.fit(records, [stripe != fold for stripe in stripes])
        for record, stripe, kept in zip(records, stripes, predicted, strict=True):
            kept[:, stripe == fold] = predictions(model, record, noise_std)[:, stripe == fold]
    done(FOLDS)
    everywhere: list[Marks] = [np.ones(record.shape, np.bool_) for record in records]
    whole = candidate.fit(records, everywhere)
    errors = tuple(record.measured[1:] - after for record, after in zip(records, predicted, strict=True))
    return Comparison(
        candidate.name, whole, score(records, predicted, everywhere, first_guess(records), noise_std), errors
    )
