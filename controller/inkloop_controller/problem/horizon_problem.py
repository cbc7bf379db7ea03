"""The layer problem over a horizon: permitted droplets of the coming layers, and the objective of plans."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from math import inf
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Ink
from inkloop_controller.problem.arrays import error_of_array, first_cell

IntMap: TypeAlias = NDArray[np.int32]
"""(nx, ny): a pattern, 0 none, 1 + k a droplet of kind k."""
IntPlan: TypeAlias = NDArray[np.int32]
"""(layers, nx, ny): a plan, one pattern for each layer of the horizon."""
ChoiceMaps: TypeAlias = NDArray[np.uint16]
"""(layers, nx, ny): bit k is set where a droplet of kind k may fall."""

HORIZON_MAX = 5
KINDS_MAX = 16
HEIGHT_MAX = 0.5  # [m] above that heights leave the lattice of controller/core/model/lattice.h


@dataclass(frozen=True, eq=False)
class HorizonProblem:
    """Which droplets to jet in the coming layers, so that the surface after the last of them comes close to the target.

    height, target: (nx, ny) [m]; part: cells whose standard deviation counts; choices: (layers, nx, ny), bit k is set
    where a droplet of kinds[k] may fall in that layer; alpha: weight of the mean error against the standard deviation
    (Lu, Zheng, Mishra 2015, eq. 8); weight: (nx, ny) of each cell's error (None: 1 in the part, 0 outside);
    overshoot: what a metre above the target costs when a metre below costs 1; ceiling: (nx, ny) [m], a metre above it
    costs ceiling_cost in addition (None: no ceiling); droplet_std: standard deviation of a droplet's volume, as a share
    of it: what the last droplets leave to chance counts in the objective (0: the prediction alone); colours: of each
    layer, in the order jetted, the four colours 2 (i % 2) + j % 2 of its passes, each on the surface that the last one
    left (empty: layers of one pass).
    Raises ValueError, all errors in one sentence, for invalid values.
    """

    height: FloatMap
    target: FloatMap
    part: BoolMap
    choices: ChoiceMaps
    kinds: tuple[Ink, ...]
    alpha: float
    weight: FloatMap | None = None
    overshoot: float = 1.0
    ceiling: FloatMap | None = None
    ceiling_cost: float = 0.0
    droplet_std: float = 0.0
    colours: tuple[tuple[int, ...], ...] = ()

    def __post_init__(self) -> None:
        shape = np.shape(self.height)
        if len(shape) != 2 or 0 in shape:
            raise ValueError(f"height has shape {shape}; a layer problem needs (nx, ny) with at least one cell")
        errors = [*self._errors_of_arrays(shape), *self._errors_of_values()]
        if not errors:
            errors = [*self._errors_of_choices(), *self._errors_of_heights()]
        if errors:
            raise ValueError("; ".join(errors))
        for name in ("height", "target", "part", "choices", "weight", "ceiling"):
            array = getattr(self, name)
            object.__setattr__(self, name, None if array is None else np.ascontiguousarray(array))

    @property
    def layers(self) -> int:
        """Length of the horizon."""
        return len(self.choices)

    @property
    def passes(self) -> int:
        """Of each layer: 1 or 4."""
        return 4 if self.colours else 1

    @property
    def weights(self) -> FloatMap:
        """(nx, ny) weight of each cell's error."""
        return np.asarray(self.part, np.float64) if self.weight is None else self.weight

    def to_casadi(self) -> Any:
        """A `casadi.Function` of droplets and of the values of this problem, for a solver of your own.

        inkloop_controller.program.layer_function describes its inputs and outputs.
        """
        return import_module("inkloop_controller.program.layer_function").layer_function(self)

    def casadi_values(self) -> dict[str, Any]:
        """The values of this problem by the names of the inputs of `to_casadi`; all but the droplets."""
        return dict(import_module("inkloop_controller.program.layer_function").layer_values(self))

    def write(self, path: str | Path) -> None:
        """Writes the problem as a mixed-integer program, for a solver of your own.

        path: ends in .mps (one layer in one pass with alpha = 1 and droplet_std = 0, which is linear) or in .nl (any
        problem). inkloop_controller.program.program_file describes variables and units. Raises ValueError for a
        problem that the format does not hold.
        """
        import_module("inkloop_controller.program.program_file").write_program(self, Path(path))

    def _errors_of_arrays(self, shape: tuple[int, ...]) -> list[str]:
        layers = len(self.choices) if np.ndim(self.choices) == 3 else 1
        wanted: list[tuple[str, Any, str, tuple[int, ...]]] = [
            ("height", self.height, "f8", shape),
            ("target", self.target, "f8", shape),
            ("part", self.part, "?", shape),
            ("choices", self.choices, "u2", (layers, *shape)),
            ("weight", self.weight, "f8", shape),
            ("ceiling", self.ceiling, "f8", shape),
        ]
        return [error for entry in wanted if entry[1] is not None and (error := error_of_array(*entry))]

    def _errors_of_values(self) -> list[str]:
        errors = []
        if not 1 <= len(self.kinds) <= KINDS_MAX:
            errors.append(f"kinds holds {len(self.kinds)} kinds of droplets; needs 1 to {KINDS_MAX}")
        errors += [
            f"kind {k} is {kind}; needs h1 > 0 and neither h2 nor h3 below 0 [m]"
            for k, kind in enumerate(self.kinds)
            if not (0.0 < kind.h1 < inf and 0.0 <= kind.h2 < inf and 0.0 <= kind.h3 < inf)
        ]
        if not 0.0 <= self.alpha <= 1.0:
            errors.append(f"alpha is {self.alpha}; needs a weight between 0 and 1")
        if not 0.0 < self.overshoot < inf:
            errors.append(f"overshoot is {self.overshoot}; needs a cost above 0")
        if not 0.0 <= self.ceiling_cost < inf:
            errors.append(f"ceiling_cost is {self.ceiling_cost}; needs a cost of at least 0")
        if not 0.0 <= self.droplet_std < inf:
            errors.append(f"droplet_std is {self.droplet_std}; needs a share of a droplet of at least 0")
        if self.colours and [sorted(order) for order in self.colours] != [[0, 1, 2, 3]] * len(self.choices):
            errors.append(
                f"colours is {self.colours}; needs for each of {len(self.choices)} layers the colours 0 to 3 once"
            )
        return errors

    def _errors_of_choices(self) -> list[str]:
        errors = []
        if not 1 <= self.layers <= HORIZON_MAX:
            errors.append(f"choices holds {self.layers} layers; needs a horizon of 1 to {HORIZON_MAX}")
        elif (self.choices >> len(self.kinds)).any():
            found = first_cell(self.choices >> len(self.kinds) > 0)
            errors.append(
                f"choices of layer {found[0]} is {self.choices[found]} at cell {found[1:]}; "
                f"needs bits of the {len(self.kinds)} kinds given"
            )
        if not self.part.any():
            errors.append("part marks no cell; an objective over no cell means nothing")
        if self.weight is not None and (self.weight < 0.0).any():
            cell = first_cell(self.weight < 0.0)
            errors.append(f"weight is {self.weight[cell]} at cell {cell}; needs weights of at least 0")
        return errors

    def _errors_of_heights(self) -> list[str]:
        tallest = max(kind.layer_height for kind in self.kinds)
        room = HEIGHT_MAX - 2.0 * self.layers * tallest  # a cell gets at most its own layers and its neighbours' spill
        maps = {"height": self.height, "target": self.target, "ceiling": self.ceiling}
        return [
            f"{name} reaches {np.abs(array).max():.3g} m with {self.layers} layers to come; "
            f"needs heights within {room:.3g} m: count them from a surface near by"
            for name, array in maps.items()
            if array is not None and np.abs(array).max() >= room
        ]


@dataclass(frozen=True)
class Objective:
    """The objective of a plan [m]: value = alpha * (error + over_ceiling) + (1 - alpha) * deviation, over the part.

    error: mean of what lies below the target and `overshoot` times what lies above; over_ceiling: mean of what lies
    above the ceiling, times its cost; deviation: population standard deviation of the surface after the last layer.
    """

    value: float
    error: float
    over_ceiling: float
    deviation: float


@dataclass(frozen=True)
class SearchProgress:
    """Progress of a search: value of the plan [m], and the work done."""

    value: float
    sweeps: int
    evaluations: int
    flips: int
    swaps: int
    shifts: int


def no_droplets(problem: HorizonProblem) -> IntPlan:
    """Nothing in any layer."""
    return np.zeros(problem.choices.shape, np.int32)


def full_layers(problem: HorizonProblem) -> IntPlan:
    """Wherever a droplet may fall, one of the first kind that may."""
    choices = problem.choices.astype(np.int32)
    lowest = choices & -choices
    return np.where(choices > 0, np.round(np.log2(np.maximum(lowest, 1))) + 1, 0).astype(np.int32)


def even_droplets(problem: HorizonProblem) -> FloatMap:
    """The missing height of each cell in equal shares of the layers: droplets of any size (layers, nx, ny), 0 to 1."""
    lacking = (problem.target - problem.height) / (problem.layers * problem.kinds[0].layer_height)
    return np.where(problem.choices > 0, np.clip(lacking, 0.0, 1.0), 0.0)
