"""The prediction model of a layer: the surface after a pattern, the droplets that each cell permits (ink of the region,
drop sizes of the head, dead nozzles), and the decision problems of the layers that follow a scan.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop.contract import PassOrder, pass_colours
from inkloop.geometry import Columns
from inkloop_controller.core import bindings
from inkloop_controller.core.layer_step import LayerStep
from inkloop_controller.core.library import ProblemMapsStruct, ProblemStruct, SurfaceStruct, ink_pair, library
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.problem.arrays import checked, pointer
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.horizon_problem import (
    HORIZON_MAX,
    KINDS_MAX,
    ChoiceMaps,
    HorizonProblem,
    IntMap,
)
from inkloop_controller.problem.options import declared, default, errors_of, refuse

if TYPE_CHECKING:
    from inkloop_controller.program.statement import Symbolic


@dataclass(frozen=True)
class LayerModel:
    """Layer-to-layer map of the inks, in one pass or four (Lu, Zheng, Mishra 2015, III and V-D).

    passes, pass_order, pass_rotation as in LayerDeposition: layer n starts pass_rotation * n positions later.
    Raises ValueError for passes and orders that there are not.
    """

    inks: tuple[Ink, ...]
    passes: int = 1
    pass_order: int = 1
    pass_rotation: int = 0

    def __post_init__(self) -> None:
        if self.passes not in (1, 4) or self.pass_order not in tuple(PassOrder):
            raise ValueError(
                f"passes is {self.passes} and pass_order {self.pass_order}; "
                "needs 1 or 4 passes in order 1 (raster) or 2 (diagonal)"
            )

    @classmethod
    def of(cls, job: Job) -> LayerModel:
        """The model that the job describes."""
        return cls(job.inks, job.passes, job.pass_order, job.pass_rotation)

    def scaled(self, ink_scale: float) -> LayerModel:
        """The model for droplets of `ink_scale` times the nominal volume [1]."""
        inks = tuple(Ink(ink_scale * ink.h1, ink_scale * ink.h2, ink_scale * ink.h3) for ink in self.inks)
        return replace(self, inks=inks)

    def layer(self, height: FloatMap, pattern: IntMap, number: int = 1, factor: FloatMap | None = None) -> FloatMap:
        """Surface [m] after layer `number` (counted from 1).

        height: (nx, ny) [m]; pattern: (nx, ny), 0 none, 1 material A, 2 material B; factor: (nx, ny), volume of each
        droplet as a share of the nominal one [1].
        """
        return bindings.layer(height, pattern, self.inks, self.colours(number), factor)

    def symbolic(self, H: Symbolic, U: Symbolic, material: IntMap | None = None) -> Symbolic:
        """The same map in CasADi for one pass: H (nx, ny) [m], U (nx, ny) relaxed to 0..1, material of each cell."""
        from inkloop_controller.program.statement import symbolic_layer

        if self.passes != 1:
            raise ValueError(f"passes is {self.passes}; the symbolic map is written for one pass")
        chosen = np.zeros(H.shape, np.int32) if material is None else material
        return symbolic_layer(H, U, *ink_maps(self.inks, chosen))

    def colours(self, number: int) -> tuple[int, ...]:
        """Colours in the order in which layer `number` jets them; none in one pass."""
        return pass_colours(self.passes, self.pass_order, self.pass_rotation, number)


def ink_maps(inks: tuple[Ink, ...], material: IntMap) -> tuple[FloatMap, FloatMap, FloatMap]:
    """h1, h2, h3 [m] of a droplet on each cell, (nx, ny) each."""
    table = np.array([[ink.h1, ink.h2, ink.h3] for ink in inks])
    h1, h2, h3 = np.moveaxis(table[material], -1, 0)
    return h1, h2, h3


RegionTest: TypeAlias = Literal["middle", "surface", "either"]
"""Where a cell is asked for its ink: half a layer above the surface; on it, as the paper has it; or at both ends of the
layer, either ink being right where they differ. The middle halves the error of the printed geometry."""
_INK_B = 2  # choices where ink B alone may fall, in single drops


class DropletChoices:
    """Which droplets may fall on a cell: of the ink of its region, in the sizes of the head, from nozzles that jet.

    drop_levels: largest level; dead_nozzles: nozzles that jet nothing, of nozzle_pitch in all: cell (i, j) is jetted by
    nozzle j modulo nozzle_pitch (0: as many nozzles as the grid has columns).
    Raises ValueError, all errors in one sentence, for invalid values.
    """

    def __init__(
        self,
        job: Job,
        *,
        region_test: Annotated[RegionTest, declared("region_test")] = default("region_test"),
        drop_levels: Annotated[int, declared("drop_levels")] = default("drop_levels"),
        dead_nozzles: Annotated[Sequence[int], declared("dead_nozzles")] = (),
        nozzle_pitch: Annotated[int, declared("nozzle_pitch")] = default("nozzle_pitch"),
    ) -> None:
        errors = errors_of(region_test=region_test, nozzle_pitch=nozzle_pitch)
        if not isinstance(drop_levels, Integral):
            errors += errors_of(drop_levels=drop_levels)
        dead = tuple(dead_nozzles) if isinstance(dead_nozzles, Iterable) else ("none",)
        if not all(isinstance(each, Integral) and not isinstance(each, bool) for each in dead):
            errors.append(f"dead_nozzles is {dead_nozzles!r}; needs numbers of nozzles")
        refuse(errors)
        nozzles = nozzle_pitch or job.ny
        if not 1 <= drop_levels * len(job.inks) <= KINDS_MAX:
            errors.append(
                f"drop_levels is {drop_levels} with {len(job.inks)} inks; needs 1 to {KINDS_MAX // len(job.inks)}"
            )
        errors += [
            f"dead_nozzles has {nozzle}; needs nozzles 0 to {nozzles - 1}"
            for nozzle in dead
            if not 0 <= nozzle < nozzles
        ]
        refuse(errors)
        alive = ~np.isin(np.arange(job.ny) % nozzles, dead)
        self.region_test, self.drop_levels = region_test, drop_levels
        self.jettable: BoolMap = job.mask & alive


class LayerProblems:
    """Problems as controller/core/step/step_problem.h builds them.

    step: that of the core, with the options; options: further ones by the names of variables.toml.
    """

    def __init__(self, job: Job, criterion: Criterion, choices: DropletChoices, **options: Any) -> None:
        self._job, self._criterion = job, criterion
        columns = None if job.region is None else Columns.of_shape(job.region, job.nx, job.ny, job.pitch)
        weights = {name: value for name, value in vars(criterion).items() if name != "alpha"}
        chosen: dict[str, Any] = {"region_test": choices.region_test, "drop_levels": choices.drop_levels}
        self.step = LayerStep(job, jettable=choices.jettable, columns=columns, **weights, **chosen, **options)

    def materials(self, height: FloatMap) -> IntMap:
        """(nx, ny) index of the ink that belongs on each cell of the part, on a surface `height` [m]: 0 A, 1 B."""
        *_, choices = self._filled(Estimate.exact(height, self._job.inks), 0)
        return np.asarray(choices[0] == _INK_B, np.int32)

    def problem(self, estimate: Estimate, layer: int) -> HorizonProblem:
        """The problem of the layers that follow layer number `layer`. Raises ValueError for what cannot be one."""
        found, ceiling, weight, choices = self._filled(estimate, layer)
        return HorizonProblem(
            height=estimate.height,
            target=self._job.target_height,
            part=self._job.mask,
            choices=choices,
            kinds=tuple(Ink(kind.h1, kind.h2, kind.h3) for kind in found.kind[: found.kinds]),
            alpha=found.alpha,
            weight=weight if found.weight else None,
            overshoot=found.overshoot,
            ceiling=ceiling if found.ceiling else None,
            ceiling_cost=found.ceiling_cost,
            droplet_std=found.droplet_std,
            colours=tuple(tuple(order) for order in found.colours[: found.layers]) if found.passes > 1 else (),
        )

    def _filled(self, estimate: Estimate, layer: int) -> tuple[Any, FloatMap, FloatMap, ChoiceMaps]:
        """The problem of C, and its maps of ceiling, weight and choices; what it does not need is not filled."""
        shape = self.step.shape
        maps = (("height", "f8"), ("height_variance", "f8"), ("dead", "?"), ("capped", "?"))
        given = [checked(name, getattr(estimate, name), dtype, shape) for name, dtype in maps]
        self.step.set("alpha", self._criterion.alpha_of(layer + 1))
        figures, inks = estimate.figures, ink_pair(estimate.inks)
        surface = SurfaceStruct(*map(pointer, given), inks, figures.droplet_std, figures.is_foreign)
        ceiling, weight = np.empty(shape), np.empty(shape)
        choices, found = np.empty((HORIZON_MAX, *shape), np.uint16), ProblemStruct()
        room = ProblemMapsStruct(pointer(ceiling), pointer(weight), pointer(choices))
        library().inkloop_layer_problem(self.step.struct, surface, layer, room, found)
        return found, ceiling, weight, choices[: found.layers]
