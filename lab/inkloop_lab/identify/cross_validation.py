"""Cross validation of models: prediction errors on stripes along x, one left out of the fit at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inkloop_lab.errors import IdentificationError
from inkloop_lab.identify.candidates import Candidate
from inkloop_lab.identify.one_step import Marks, Model, Score, predictions, score
from inkloop_lab.identify.print_record import PrintRecord, first_guess

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
