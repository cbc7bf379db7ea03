"""Deposition models that are fitted to the same prints, each by the method of its source."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar

from inkloop.component import Ink
from inkloop.units import PL_PER_M3, UM_PER_M
from inkloop_lab.identify.ink_regression import identify_ink
from inkloop_lab.identify.one_step import Marks, Model, predictions
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord, first_guess
from inkloop_lab.identify.volume_area_coefficients import VolumeAreaEstimate
from inkloop_lab.models import (
    LayerDeposition,
    SuperpositionDeposition,
    VolumeAreaDeposition,
    YoungLaplaceDeposition,
)

Records: TypeAlias = Sequence[PrintRecord]
Cells: TypeAlias = Sequence[Marks]
Fit: TypeAlias = Callable[[Records, Cells], Model]
ANGLES = (np.radians(15.0), np.radians(80.0))
EVALUATIONS = 40  # evaluations of the prints in a fit; more change the errors by less than their noise (by trial)


@dataclass(frozen=True)
class Candidate:
    """A model and its fit to the cells (nx, ny) of prints; `fit` raises IdentificationError or ValueError."""

    name: str
    fit: Fit


def candidates(
    nominal: Sequence[Ink],
    noise_std: float,
    protocol: Sequence[float] | None = None,
    volume_area: VolumeAreaEstimate | None = None,
    reach: int = 1,
) -> list[Candidate]:
    """All models; protocol: h1, h2, h3 [m] by single droplets, volume_area: coefficients by drops that fell alone, if
    there are: these two are not fitted to the prints at hand. reach: above 1 also `conserving` of that reach, whose
    volume is that of the whole prints, also where its fit sees a part of their cells.
    """

    def regression(reach: int = 1, correct: bool = True, conserve: bool = False) -> Fit:
        def fit(records: Records, cells: Cells) -> Model:
            found = identify_ink(records, noise_std, reach=reach, correct=correct, conserve=conserve, cells=cells)
            return _layers(records, [tuple(float(h) for h in ink) for ink in found.heights])

        return fit

    given = [(ink.h1, ink.h2, ink.h3) for ink in nominal]
    found = [Candidate("Lu, nominal ink", lambda records, cells: _layers(records, given))]
    if protocol is not None:
        known = tuple(max(0.0, h) for h in protocol)
        found.append(Candidate("Lu, droplet protocol", lambda records, cells: _layers(records, [known])))
    if volume_area is not None:
        found.append(Candidate("Wu, Chiu by (17)", lambda records, cells: volume_area.model(records[0].pitch)))
    return [
        *found,
        Candidate("Lu, plain regression", regression(correct=False)),
        Candidate("Lu, regression", regression()),
        Candidate("Lu, regression, reach 2", regression(reach=2)),
        *([Candidate(conserving(reach), regression(reach=reach, conserve=True))] if reach > 1 else []),
        Candidate("spherical caps", _fit_caps),
        Candidate("Wu, Chiu, fitted", _fit_volume_area),
        Candidate("Young-Laplace", _fit_young_laplace),
    ]


def conserving(reach: int) -> str:
    """Name of the candidate of that reach whose heights add up to the measured volume of a droplet."""
    return f"Lu, reach {reach}, volume kept"


def words(model: Model) -> str:
    """The coefficients of a model for people."""
    if isinstance(model, LayerDeposition):
        return " | ".join(" ".join(f"{h * UM_PER_M:.3g}" for h in ink) for ink in model.heights) + " µm"
    if isinstance(model, SuperpositionDeposition):
        radius, height = model.caps[0]
        return f"r {radius * UM_PER_M:.4g}, a {height * UM_PER_M:.3g} µm"
    if isinstance(model, VolumeAreaDeposition):
        gains = " ".join(
            f"{gain / UM_PER_M:.3g}" for gain in (model.mv_plus, model.mv_minus, model.ma_plus, model.ma_minus)
        )
        return f"c {model.height_scale * UM_PER_M:.3g} µm, {gains} /µm"
    return f"{model.droplet_volume * PL_PER_M3:.4g} pl, {np.degrees(model.contact_angle):.0f} degrees"


def _layers(records: Records, heights: Sequence[tuple[float, ...]]) -> LayerDeposition:
    materials = max(record.materials for record in records)
    filled = [*heights, *[heights[-1]] * (materials - len(heights))]
    first = records[0]
    return LayerDeposition(tuple(filled[:2]), first.passes, first.pass_order, first.pass_rotation)


def _one_liquid(records: Records) -> None:
    """Raises IdentificationError where material B was jetted too."""
    if any(record.materials > 1 for record in records):
        raise IdentificationError("fitted to prints in one material only")


def _errors(model: Model, records: Records, cells: Cells) -> NDArray[np.float64]:
    """Scan less prediction over the cells of all prints [m]."""
    found = []
    for record, mask in zip(records, cells, strict=True):
        error = record.measured[1:] - predictions(model, record)
        found.append(error[np.isfinite(error) & mask])
    return np.concatenate(found)


def _fit_caps(records: Records, cells: Cells) -> Model:
    _one_liquid(records)
    pitch, layer = records[0].pitch, first_guess(records)

    def model(x: NDArray[np.float64]) -> SuperpositionDeposition:
        return SuperpositionDeposition(((float(x[0]) * pitch, float(x[1]) * layer),), pitch)

    def relative(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return _errors(model(x), records, cells) / layer

    found = least_squares(
        relative, [0.8, 1.0], bounds=([0.2, 0.05], [4.0, 20.0]), diff_step=[1e-3] * 2, max_nfev=EVALUATIONS
    )
    return model(found.x)


def _fit_volume_area(records: Records, cells: Cells) -> Model:
    """Coefficients with the least one-step error; `guard` and `limit_gains` keep the model in bounds."""
    _one_liquid(records)
    first, layer = records[0], first_guess(records)
    usual = VolumeAreaDeposition()
    gains = np.array([usual.mv_plus, usual.mv_minus, usual.ma_minus]) * usual.height_scale / layer

    def model(x: NDArray[np.float64]) -> VolumeAreaDeposition:
        mv_plus, mv_minus, ma_minus = (float(g) for g in gains * x[1:4])
        scale, radius = float(x[0]) * layer, float(x[4]) * first.pitch
        passes = first.passes, first.pass_order, first.pass_rotation
        return VolumeAreaDeposition(
            first.pitch, scale, mv_plus, mv_minus, 0.0, ma_minus, radius, True, True, 1, *passes
        )

    def relative(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return _errors(model(x), records, cells) / layer

    found = least_squares(
        relative,
        [1.0, 1.0, 1.0, 1.0, 0.6],
        bounds=([0.3, -5.0, 0.0, 0.0, 0.3], [3.0, 5.0, 10.0, 10.0, 1.4]),
        diff_step=[1e-2] * 5,
        max_nfev=EVALUATIONS // 4,
    )
    return model(found.x)


def _fit_young_laplace(records: Records, cells: Cells) -> Model:
    """The volume that the prints hold, and the contact angle with the least one-step error; small slopes. Four passes
    of lines, as the paper prints, whatever passes the prints state.
    """
    pitch = records[0].pitch
    volume = first_guess(records) * pitch**2

    def model(angle: float) -> YoungLaplaceDeposition:
        return YoungLaplaceDeposition(pitch, volume, angle, "linear", 4)

    def rms(angle: float) -> float:
        return float(np.sqrt(np.mean(_errors(model(angle), records, cells) ** 2)))

    lowest = _least_angle(model)
    found = minimize_scalar(rms, bounds=(lowest, ANGLES[1]), method="bounded", options={"xatol": 0.03, "maxiter": 8})
    return model(float(found.x))


def _least_angle(model: Callable[[float], YoungLaplaceDeposition]) -> float:
    """The flattest droplet that the model accepts on this pitch. Raises ValueError if there is none."""
    for angle in np.linspace(ANGLES[0], ANGLES[1], 14)[:-1]:
        try:
            model(float(angle))
        except ValueError:
            continue
        return float(angle)
    return float(ANGLES[1])
