"""Identify the height that a droplet of each ink adds, during the print (controller/core)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Ink
from inkloop_controller.core.structs import SHARES_MAX, InkEvidenceStruct, InkKnowledgeStruct

InkModel: TypeAlias = Literal["scale", "full", "off"]
"""What is learnt of each ink: its droplet volume; h1, h2 and h3 as far as the patterns separate them; nothing."""

INK_MODELS: Mapping[InkModel, int] = {"scale": 1, "full": 2, "off": 3}
"""Their numbers in ink_identification.h."""


@dataclass(frozen=True, eq=False)
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
        """Restore the result of `sums`, bit by bit."""
        n = sums.shape[1]
        return cls(response=sums[:n], surplus=sums[-1], covariance=sums[n:-1])

    def struct(self) -> InkEvidenceStruct:
        """The same for C."""
        sums, square = np.zeros(2 * SHARES_MAX**2 + SHARES_MAX), SHARES_MAX**2
        for values, first in ((self.response, 0), (self.covariance, square), (self.surplus, 2 * square)):
            sums[first : first + values.size] = values.ravel()
        return InkEvidenceStruct.from_buffer_copy(sums.data)

    @classmethod
    def of_struct(cls, struct: InkEvidenceStruct, shares: int) -> InkEvidence:
        """What C has made of it."""
        sums, square = np.frombuffer(memoryview(struct)).copy(), SHARES_MAX**2
        response, covariance = (sums[first : first + shares**2] for first in (0, square))
        return cls(
            response=response.reshape(shares, shares),
            surplus=sums[2 * square :][:shares],
            covariance=covariance.reshape(shares, shares),
        )


@dataclass(frozen=True, eq=False)
class InkKnowledge:
    """What the inks are concluded from (controller/core/estimator/ink_learning.h).

    evidence: for the model of the estimator; volumes: for droplet volumes alone, while that model is "full"; errors:
    (2,) sums of the squares that the inks of the two predicted wrong, recent layers more [m^2].
    """

    evidence: InkEvidence
    volumes: InkEvidence
    errors: NDArray[np.float64]

    @classmethod
    def none(cls, shares: int, inks: int) -> InkKnowledge:
        """Nothing learnt yet."""
        return cls(InkEvidence.none(shares), InkEvidence.none(inks), np.zeros(2))

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """All of it by name."""
        return {"evidence": self.evidence.sums(), "volumes": self.volumes.sums(), "ink_errors": self.errors}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[np.float64]]) -> InkKnowledge:
        """Restore the result of `arrays`, bit by bit."""
        evidence, volumes = (InkEvidence.of_sums(arrays[name]) for name in ("evidence", "volumes"))
        return cls(evidence, volumes, np.asarray(arrays["ink_errors"]))

    def struct(self) -> InkKnowledgeStruct:
        """The same for C."""
        return InkKnowledgeStruct(self.evidence.struct(), self.volumes.struct(), tuple(self.errors))

    @classmethod
    def of_struct(cls, struct: InkKnowledgeStruct, shares: int, inks: int) -> InkKnowledge:
        """What C has made of it."""
        evidence, volumes = InkEvidence.of_struct(struct.evidence, shares), InkEvidence.of_struct(struct.volumes, inks)
        return cls(evidence, volumes, np.array(struct.errors))


def ink_table(inks: Sequence[Ink]) -> NDArray[np.float64]:
    """(inks, 3): h1, h2, h3 of each [m]."""
    return np.array([[ink.h1, ink.h2, ink.h3] for ink in inks])
