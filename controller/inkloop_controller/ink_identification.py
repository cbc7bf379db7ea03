"""How much a droplet of each ink really adds, learnt from the layers of the print itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop_controller.criterion import beside
from inkloop_controller.droplet_increments import DropletIncrements, ink_table
from inkloop_controller.horizon_problem import IntMap

InkModel: TypeAlias = Literal["scale", "full", "off"]
"""What is learnt of each ink: its droplet volume; h1, h2 and h3 as far as the patterns tell them apart; nothing."""

PRIOR_STD = 0.5  # of a learnt share about 1, the nominal ink; 0.2 pulls h3 to it for twenty layers (by trial)
FORGETTING = 0.8  # weight of a layer against the next: the last 5 layers count (by trial: 0.95 lags behind a drift)
LEAST_DROPLETS = 20  # fewer say more about single droplets than about the ink (assumed)
LEAST_INCREMENT = 0.1  # of a full layer, mean over the cells: below it droplets go where scans read low (by trial)
STRANGE = 0.6  # growth that is off by more than this share of what was expected is no ink: a dead nozzle (assumed)
STRANGE_NOISE = 3.0  # ... and by more than so many standard deviations
SHARE_RANGE = (0.25, 4.0)  # beyond it something else is wrong than the ink (assumed)


@dataclass(frozen=True)
class InkEvidence:
    """Sums over the layers, recent ones more, per learnt share: instrument times what a share adds (n, n) [m^2],
    instrument times growth beyond the nominal (n,) [m^2], covariance of the latter (n, n) [m^4].
    """

    response: NDArray[np.float64]
    surplus: NDArray[np.float64]
    covariance: NDArray[np.float64]

    @classmethod
    def none(cls, shares: int) -> InkEvidence:
        """Nothing learnt yet."""
        return cls.of_sums(np.zeros((2 * shares + 1, shares)))

    def sums(self) -> NDArray[np.float64]:
        """All of it in one array (2 n + 1, n)."""
        return np.vstack([self.response, self.covariance, self.surplus])

    @classmethod
    def of_sums(cls, sums: NDArray[np.float64]) -> InkEvidence:
        """What `sums` gave, bit by bit."""
        n = sums.shape[1]
        return cls(response=sums[:n], surplus=sums[-1], covariance=sums[n:-1])


class InkIdentification:
    """Recursive estimation of the ink by instrumental variables, with the nominal ink as prior.

    The growth of a cell is linear in the heights of the inks but its rates come from a surface that is known with an
    error; regressed on themselves they would blame the ink for it. The instrument is what the same droplets add on a
    flat surface, which no measurement enters; for the volume alone, that they add anything. Where the patterns do not
    tell h1, h2 and h3 apart (full layers on a flat surface) the prior keeps their proportion. Cells that grew far from
    what is usual - the first time the median, then what was learnt - are left out with their neighbours: a dead nozzle
    lowers no volume. What is left of the error of the surface: flow saturates, so that noise on a flat surface still
    lowers h1 in "full", by 4 % at 0.3 um after one layer; it fades as the surface becomes known.
    """

    def __init__(self, job: Job, model: InkModel) -> None:
        self._nominal, self._part, self._model = job.inks, job.mask, model
        inks = len(job.inks)
        shares = np.eye(3 * inks) if model == "full" else np.repeat(np.eye(inks), 3, axis=1)
        self._directions = shares.reshape(-1, inks, 3) * ink_table(job.inks)

    def start(self) -> InkEvidence:
        """Nothing learnt."""
        return InkEvidence.none(len(self._directions))

    def inks(self, evidence: InkEvidence) -> tuple[Ink, ...]:
        """The inks that are likeliest after the evidence."""
        scatter = evidence.covariance
        if self._model == "off" or not scatter.any():
            return self._nominal
        precision = np.linalg.pinv(scatter, rcond=1e-9, hermitian=True)
        information = evidence.response.T @ precision @ evidence.response + np.eye(len(scatter)) / PRIOR_STD**2
        shares = 1.0 + np.linalg.solve(information, evidence.response.T @ precision @ evidence.surplus)
        table = np.tensordot(np.clip(shares, *SHARE_RANGE), self._directions, 1)
        return tuple(Ink(*(float(value) for value in row)) for row in table)

    def after(
        self,
        evidence: InkEvidence,
        pattern: IntMap,
        increments: DropletIncrements,
        flat: DropletIncrements,
        growth: FloatMap,
        variance: FloatMap,
        seen: BoolMap,
    ) -> InkEvidence:
        """The evidence with one more layer.

        pattern: (nx, ny); increments: of its droplets on the surface before, and on a `flat` one; growth: (nx, ny) that
        was measured [m], with its variance [m^2], where `seen`.
        """
        cells = self._part & seen
        expected = increments.added(self.inks(evidence))
        enough = LEAST_INCREMENT * sum(ink.layer_height for ink in self._nominal) / len(self._nominal)
        if self._model == "off" or np.count_nonzero(pattern[cells]) < LEAST_DROPLETS or expected[cells].mean() < enough:
            return evidence
        hit = cells & (pattern > 0)
        usual = 1.0 if evidence.response.any() else float(np.median(growth[hit] / expected[hit]))
        cells &= ~_strange(hit, usual * expected, growth, variance)
        if not cells.any():
            return evidence
        adds = np.tensordot(self._directions, increments.rates[:, :, cells], 2)
        instrument = np.tensordot(self._directions, flat.rates[:, :, cells], 2)
        if self._model == "scale":  # all cells that an ink reaches alike: what flows from one to the other cancels
            instrument = np.where(instrument > 0.0, instrument.mean(), 0.0)
        surplus = growth[cells] - np.tensordot(ink_table(self._nominal), increments.rates[:, :, cells])
        return InkEvidence(
            FORGETTING * evidence.response + instrument @ adds.T,
            FORGETTING * evidence.surplus + instrument @ surplus,
            FORGETTING**2 * evidence.covariance + instrument * variance[cells] @ instrument.T,
        )


def _strange(hit: BoolMap, usual: FloatMap, growth: FloatMap, variance: FloatMap) -> BoolMap:
    """(nx, ny) cells that were `hit` and did not grow as is usual, with their neighbours."""
    limit = np.maximum(STRANGE * np.abs(usual), STRANGE_NOISE * np.sqrt(variance))
    strange = hit & (np.abs(growth - usual) > limit)
    return np.asarray(strange | beside(strange), np.bool_)
