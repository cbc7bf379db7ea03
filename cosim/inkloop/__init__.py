"""Closed-loop ink-jet 3D printing as a co-simulation of FMUs, a layer controller and hardware.

    import inkloop

    result = inkloop.run("scenarios/cuboid.toml", seed=7)               # print a scenario, with keys changed
    result.metrics()["std"]                                             # roughness of the part [m]
    result.dataset["height"]                                            # layer x nx x ny, labelled, SI (xarray)
    inkloop.run("scenarios/cuboid.toml", {"components.controller.alpha": 0.5}, out="runs/mine")
    inkloop.load("runs/mine")                                           # a Result; of a .toml file, a Scenario

`run`, `load`, `Scenario` and `Result` print and read. A class of your own needs `Component`, `Port`, `Job`, `Ink`
and `Status` to take part. `FmuComponent`, `describe`, `find_fmu` and `export_fmu` handle FMUs. All errors derive from
`InkloopError`. These names are public (`inkloop.__all__`); so are, for packages that build on inkloop, the modules of
its floor and every name in the `__all__` of a module. Anything else may change. The controller is in
`inkloop_controller`, studies in `inkloop_lab`. docs/reference/api.md lists all public names.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from inkloop.component import Component, Ink, Job, Port, Status
    from inkloop.errors import (
        ComponentError,
        FmuError,
        GeometryError,
        HeightMapError,
        InkloopError,
        ResultError,
        ScenarioError,
    )
    from inkloop.fmu.component import FmuComponent
    from inkloop.fmu.reading import describe
    from inkloop.fmu_writer.export import export_fmu, find_fmu
    from inkloop.printing.api import load, run
    from inkloop.results.result import Result
    from inkloop.scenario.file import Scenario

    __version__: str

_MODULES = {
    "inkloop.printing.api": ("run", "load"),
    "inkloop.scenario.file": ("Scenario",),
    "inkloop.results.result": ("Result",),
    "inkloop.component": ("Component", "Port", "Job", "Ink", "Status"),
    "inkloop.fmu.component": ("FmuComponent",),
    "inkloop.fmu.reading": ("describe",),
    "inkloop.fmu_writer.export": ("find_fmu", "export_fmu"),
    "inkloop.errors": (
        *("InkloopError", "ScenarioError", "FmuError", "ComponentError"),
        *("GeometryError", "HeightMapError", "ResultError"),
    ),
}
"""Module -> public names that are imported from it when they are first used."""

__all__ = [
    "Component",
    "ComponentError",
    "FmuComponent",
    "FmuError",
    "GeometryError",
    "HeightMapError",
    "Ink",
    "InkloopError",
    "Job",
    "Port",
    "Result",
    "ResultError",
    "Scenario",
    "ScenarioError",
    "Status",
    "describe",
    "export_fmu",
    "find_fmu",
    "load",
    "run",
]


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("inkloop")
    except PackageNotFoundError:  # the build runs parts of the package before it is installed
        return "0"


if not TYPE_CHECKING:  # for mypy the names are those above, and nothing else is there

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            value = _version()
        else:
            module = next((module for module, names in _MODULES.items() if name in names), None)
            if module is None:
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
            value = getattr(import_module(module), name)
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__, "__version__"})
