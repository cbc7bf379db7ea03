"""The layer controller of inkloop: prediction model, layer problem, estimator, baselines.

`LayerMpc` plans the coming layers by model predictive control and answers with a `LayerPlan`, whose `PlanStatus` says
how far it can be trusted; `Criterion`, `Work` and `DropletChoices` configure it. `HeightEstimator` makes an `Estimate`
of scans, `LayerModel` predicts a layer. `LayerController` puts a planner and an estimator into a loop, as a component.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
    from inkloop_controller.layer_controller import LayerController
    from inkloop_controller.model import DropletChoices, LayerModel
    from inkloop_controller.planning.layer_mpc import LayerMpc
    from inkloop_controller.planning.layer_plan import LayerPlan, PlanStatus
    from inkloop_controller.problem.criterion import Criterion, Work

_MODULES = {
    "inkloop_controller.estimation.height_estimator": ("Estimate", "HeightEstimator"),
    "inkloop_controller.layer_controller": ("LayerController",),
    "inkloop_controller.model": ("DropletChoices", "LayerModel"),
    "inkloop_controller.planning.layer_mpc": ("LayerMpc",),
    "inkloop_controller.planning.layer_plan": ("LayerPlan", "PlanStatus"),
    "inkloop_controller.problem.criterion": ("Criterion", "Work"),
}
"""Module -> public names that are imported from it when they are first used."""

__all__ = [
    "Criterion",
    "DropletChoices",
    "Estimate",
    "HeightEstimator",
    "LayerController",
    "LayerModel",
    "LayerMpc",
    "LayerPlan",
    "PlanStatus",
    "Work",
]

if not TYPE_CHECKING:  # for mypy the names are those above, and nothing else is there

    def __getattr__(name: str) -> Any:
        module = next((module for module, names in _MODULES.items() if name in names), None)
        if module is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = getattr(import_module(module), name)
        return globals()[name]

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
