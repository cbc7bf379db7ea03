"""Registry of component kinds: inkloop's FMUs, any FMU file, devices, Python classes.

A third party's class is named by an entry point of the group "inkloop.components", or as "package.module:Class". As
"NAME:package.module:Class" an adapter, the entry point NAME of the group "inkloop.adapters", makes the component of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from inkloop.component import Component, Job
from inkloop.components import devices, plain_plant
from inkloop.components.fmu_kind import FmuFile, FmuModel
from inkloop.components.fmu_parameters import CONTROLLER
from inkloop.components.kind import Bench, Checked, Kind
from inkloop.components.plain_plant import PlainPlantKind
from inkloop.components.python_class import ADAPTERS, PythonClass
from inkloop.components.shadow_kind import KIND as SHADOW
from inkloop.components.shadow_kind import ShadowKind
from inkloop.errors import FmuError, nearest

__all__ = ["DEPOSITION_MODELS", "MAPPED", "MAP_FOLDER", "PLAIN_PLANT", "kinds", "make"]

GROUP = "inkloop.components"
DEPOSITION_MODELS = ("LayerDeposition", "SuperpositionDeposition", "VolumeAreaDeposition", "YoungLaplaceDeposition")
FMU_MODELS = (*DEPOSITION_MODELS, "ProfileSensor", CONTROLLER)
MAP_FOLDER = "MapFolder"
"""The kind of a profiler whose maps come as files in a `folder`."""
PLAIN_PLANT = plain_plant.KIND
"""The kind of a plant without the handshake; `plant` is the kind of the plant itself."""
MAPPED = "hardware.mapped"
"""The kind of a rig that `mapping`, a file relative to the scenario, binds to the contract's ports."""


def check(kind: str, job: Job, options: Mapping[str, object]) -> Checked:
    """Check the options of a kind for a job; errors where the kind is unknown or its FMU cannot be read."""
    try:
        found = find_kind(kind)
    except KeyError:
        return Checked(kind, [f"kind is {kind!r}; {nearest(kind, kinds())}"])
    try:
        return found.check(job, options)
    except FmuError as error:
        return Checked(kind, [f"kind is {kind!r}: {error}"])


def make(kind: str, job: Job, options: Mapping[str, object], bench: Bench | None = None) -> Component:
    """A component of a kind; bench: of all devices of its loop. Raises ScenarioError with all errors, FmuError."""
    return check(kind, job, options).make(bench or Bench())


def resolve_paths(kind: str, options: Mapping[str, object], folder: Path) -> dict[str, Any]:
    """The options with the path that they name relative to `folder`, where the scenario stands, as found from here."""
    try:
        key = find_kind(kind).path_option
    except KeyError:
        return dict(options)
    name = options.get(key) if key is not None else None
    return {**options, key: str(folder / name)} if key is not None and isinstance(name, str) else dict(options)


def find_kind(name: str) -> Kind:
    """The kind of a name. Raises KeyError."""
    if name in KINDS:
        return KINDS[name]
    prefix, _, place = name.partition(":")
    if ":" in place:
        for adapter in entry_points(group=ADAPTERS, name=prefix):
            return PythonClass(EntryPoint(name, place, GROUP), adapter=adapter)
        raise KeyError(name)
    if place:
        return PythonClass(EntryPoint(name, name, GROUP))
    for point in entry_points(group=GROUP, name=name):
        return PythonClass(point)
    raise KeyError(name)


def kinds() -> list[str]:
    """All names of kinds that are known here and now, but for those of "package.module:Class"."""
    return sorted({*KINDS, *(point.name for point in entry_points(group=GROUP))})


def is_foreign_fmu(kind: str, options: Mapping[str, object]) -> bool:
    """Whether a component of this kind runs native code of a third-party FMU."""
    plant = options.get("plant", "Fmu" if kind == PLAIN_PLANT else None)
    return kind == "Fmu" or (kind in (PLAIN_PLANT, SHADOW) and plant == "Fmu")


def _python(kind: str, place: str, path_option: str | None = None) -> PythonClass:
    return PythonClass(EntryPoint(kind, place, GROUP), path_option)


PYTHON_KINDS: Mapping[str, PythonClass] = {
    python.entry.name: python
    for python in (
        _python("LayerMpc", "inkloop_controller.controllers:LayerMpcController"),
        _python("OpenLoop", "inkloop_controller.controllers:OpenLoopController"),
        _python("CohenLipson", "inkloop_controller.controllers:CohenLipsonController"),
        _python("ErrorDiffusion", "inkloop_controller.controllers:ErrorDiffusionController"),
        _python("StochasticGreedy", "inkloop_controller.controllers:StochasticGreedyController"),
        _python(MAP_FOLDER, "inkloop.metrology.map_folder:MapFolder", "folder"),
    )
}
KINDS: Mapping[str, Kind] = {
    **{model: FmuModel(model) for model in FMU_MODELS},
    "Fmu": FmuFile(),
    PLAIN_PLANT: PlainPlantKind(check),
    SHADOW: ShadowKind(check),
    **devices.KINDS,
    MAPPED: _python(MAPPED, "inkloop_hardware.mapped.mapped:Mapped", "mapping"),
    **PYTHON_KINDS,
}
"""Every kind but third parties' classes."""
