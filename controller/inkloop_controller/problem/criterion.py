"""The criterion: weights and limits of the layer objective; and limits of the work on a layer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf
from numbers import Real
from time import perf_counter
from typing import Annotated, Any, Literal, TypeAlias

from inkloop.limits import usable_cores
from inkloop_controller.problem.options import declared, default, errors_of, options, refuse

AlphaSchedule: TypeAlias = float | Sequence[tuple[int, float]]
"""One weight for the whole print, or (layer, weight) pairs: from the layer of that number (counted from 1) on."""

ALPHA = declared("alpha", form=float | list[tuple[int, float]])
THREADS = declared("threads", form=int | Literal["auto"])


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

    alpha: Annotated[AlphaSchedule, ALPHA] = default("alpha")
    overshoot: Annotated[float | None, declared("overshoot")] = default("overshoot")
    overshoot_limit: Annotated[float, declared("overshoot_limit")] = default("overshoot_limit")
    chance_margin: Annotated[float, declared("chance_margin")] = default("chance_margin")
    fringe_weight: Annotated[float, declared("fringe_weight")] = default("fringe_weight")
    droplet_std: Annotated[float | None, declared("droplet_std")] = default("droplet_std")
    layer_worth: Annotated[float | None, declared("layer_worth")] = default("layer_worth")

    def __post_init__(self) -> None:
        if not isinstance(self.alpha, Real):
            object.__setattr__(self, "alpha", _sorted(self.alpha))
        errors = [error for _, weight in self._schedule() for error in errors_of(alpha=weight)]
        refuse(errors + errors_of(**{name: value for name, value in vars(self).items() if name != "alpha"}))

    def alpha_of(self, layer: int) -> float:
        """The weight for layer number `layer`, counted from 1."""
        schedule = self._schedule()
        return next((weight for start, weight in reversed(schedule) if start <= layer), schedule[0][1])

    def _schedule(self) -> Sequence[tuple[int, float]]:
        return self.alpha if isinstance(self.alpha, Sequence) else [(1, float(self.alpha))]


def _sorted(alpha: Any) -> tuple[tuple[int, float], ...]:
    pairs = _pairs(alpha)
    starts = [layer for layer, _ in pairs]
    if not pairs or min(starts) < 1 or starts != sorted(set(starts)):
        raise ValueError(f"alpha is {alpha!r}; needs a number, or (layer, weight) pairs with rising layers from 1 on")
    return pairs


def _pairs(alpha: Any) -> tuple[tuple[int, float], ...]:
    """The (layer, weight) pairs of alpha; none where a layer is no whole number, or a weight no number."""
    try:
        pairs = [(layer, float(weight)) for layer, weight in alpha]
    except (TypeError, ValueError):
        return ()
    is_whole = all(isinstance(layer, Real) and float(layer).is_integer() for layer, _ in pairs)
    return tuple((int(layer), weight) for layer, weight in pairs) if is_whole else ()


PLAIN = Criterion()
"""The paper's objective, with the weight of this project."""


@dataclass(frozen=True)
class Work:
    """Budgets of one layer, in work so that the same bits come out everywhere.

    sweeps: of the repair of one start; annealing_sweeps: of one more start that is annealed first (None: 50 for
    a single layer, up to 200 for a small plan of several, none for a large one), with it every start;
    iterations: of the relaxation; threads: at most, "auto": one a core; time_limit: guard by the clock [s],
    from the scan on.
    Raises ValueError, all errors in one sentence, for invalid budgets.
    """

    sweeps: Annotated[int, declared("sweeps_max")] = default("sweeps_max")
    annealing_sweeps: Annotated[int | None, declared("annealing_sweeps")] = default("annealing_sweeps")
    iterations: Annotated[int, declared("iterations")] = default("iterations")
    threads: Annotated[int | Literal["auto"], THREADS] = "auto"
    time_limit: Annotated[float, declared("time_limit")] = default("time_limit")

    def __post_init__(self) -> None:
        given = {name: value for name, value in vars(self).items() if name != "sweeps"}
        given["threads"] = self.cores if self.threads == "auto" else self.threads
        refuse(options()["sweeps_max"].errors(self.sweeps, "sweeps") + errors_of(**given))

    @property
    def cores(self) -> int:
        """Threads at most."""
        return usable_cores() if isinstance(self.threads, str) else self.threads


DEFAULT_WORK = Work()


class Stopwatch:
    """Runs from its making; limit [s]."""

    def __init__(self, limit: float = inf) -> None:
        self._end = perf_counter() + limit
        self.seconds: dict[str, float] = {}

    @property
    def remaining(self) -> float:
        """Remaining time [s], at least 0."""
        return max(0.0, self._end - perf_counter())

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count the time of the block for the phase `name`."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - begin
