"""The criterion: weights and limits of the layer objective."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, TypeAlias

from inkloop_controller.problem.options import NotNegative, Option

AlphaSchedule: TypeAlias = float | Sequence[tuple[int, float]]
"""One weight for the whole print, or (layer, weight) pairs: from the layer of that number (counted from 1) on."""

ALPHA = Option(
    meaning="weight of the mean error against the standard deviation, 0 to 1, or a schedule: `[[1, 0.5], [40, 1.0]]` "
    "is 0.5 from layer 1 and 1.0 from layer 40 on. Below about 0.1 a print may never begin or never end",
    form=float | list[tuple[int, float]],
)
LAYER_WORTH = Option(
    meaning="what each layer must gain to be printed, whatever `finish` says, as a share of the height of a full layer "
    "of the smallest drops; 0: every layer that gains anything",
    absent="by `finish`",
)
DROPLET_STD = Option(
    meaning="standard deviation of a droplet's volume, as a share of it: what the last droplets leave to chance "
    "counts; 0: plans go by the predicted surface alone",
    absent="as learnt",
)
OVERSHOOT = Option(
    meaning="cost of a height above the target relative to the same height below it: jetted ink cannot be removed",
    absent="1 + 1.2 `droplet_std`",
)
OVERSHOOT_LIMIT = Option("um", "height above the target that the part must not exceed", form=NotNegative)


@dataclass(frozen=True)
class Criterion:
    """alpha * mean error + (1 - alpha) * standard deviation (Lu, Zheng, Mishra 2015, eq. 8), and what it may not do.

    overshoot: what a metre above the target costs when a metre below costs 1 (what was jetted stays; None: the more,
    the less sure the droplets are, 1 + 1.2 droplet_std);
    overshoot_limit: height above the target that is not to be exceeded [m], kept with a probability of `chance_margin`
    standard deviations of the predicted height (0: by the prediction itself);
    droplet_std: standard deviation of a droplet's volume, as a share of it: what the last droplets leave to chance
    counts (None: as learnt from the scans; 0: plans go by the predicted surface alone, as where a bound is asked for);
    fringe_weight: weight, 0 to 1, of the ring of cells around the part: what spills there counts against target_height;
    layer_worth: what each layer must gain to be printed, as a share of the height of a full layer of the smallest drops
    (None: as `finish` of LayerMpc has it; 0: every layer that gains anything).
    Raises ValueError, all errors in one sentence, for invalid values.
    """

    alpha: Annotated[AlphaSchedule, ALPHA] = 0.8
    overshoot: Annotated[float | None, OVERSHOOT] = None
    overshoot_limit: Annotated[float, OVERSHOOT_LIMIT] = inf
    chance_margin: Annotated[float, Option()] = 0.0
    fringe_weight: Annotated[float, Option()] = 0.0
    droplet_std: Annotated[float | None, DROPLET_STD] = None
    layer_worth: Annotated[float | None, LAYER_WORTH] = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", self.alpha if _is_number(self.alpha) else _sorted(self.alpha))
        errors = [
            f"alpha is {weight}; needs a weight between 0 (evenness only) and 1 (height only)"
            for weight in self._weights()
            if not 0.0 <= weight <= 1.0
        ]
        if self.overshoot is not None and not 0.0 < self.overshoot < inf:
            errors.append(f"overshoot is {self.overshoot}; needs a cost above 0 (1: like what is lacking)")
        errors += [
            f"{name} is {getattr(self, name)}; needs a value of at least 0"
            for name in ("overshoot_limit", "chance_margin", "layer_worth", "droplet_std")
            if (value := getattr(self, name)) is not None and not value >= 0.0
        ]
        if not 0.0 <= self.fringe_weight <= 1.0:
            errors.append(f"fringe_weight is {self.fringe_weight}; needs a weight between 0 and 1")
        if errors:
            raise ValueError("; ".join(errors))

    def alpha_of(self, layer: int) -> float:
        """The weight for layer number `layer`, counted from 1."""
        if isinstance(self.alpha, int | float):
            return float(self.alpha)
        return next((weight for start, weight in reversed(self.alpha) if start <= layer), self.alpha[0][1])

    def _weights(self) -> list[float]:
        if isinstance(self.alpha, int | float):
            return [float(self.alpha)]
        return [weight for _, weight in self.alpha]


def _is_number(alpha: AlphaSchedule) -> bool:
    return isinstance(alpha, int | float)


def _sorted(alpha: AlphaSchedule) -> tuple[tuple[int, float], ...]:
    pairs = tuple((int(layer), float(weight)) for layer, weight in alpha)  # type: ignore[union-attr]
    starts = [layer for layer, _ in pairs]
    if not pairs or min(starts) < 1 or starts != sorted(set(starts)):
        raise ValueError(f"alpha is {alpha!r}; needs a number, or (layer, weight) pairs with rising layers from 1 on")
    return pairs


PLAIN = Criterion()
"""The paper's objective, with the weight of this project."""
