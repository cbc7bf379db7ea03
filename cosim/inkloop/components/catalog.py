"""From the `kind` in a scenario to a component: our FMUs by name, any FMU file, Python classes, third parties.

A Python class takes part as `Class(job, *, option: type = default, ...)`: its options are checked against these
annotations. It is named in the table below, by an entry point of the group "inkloop.components", or as
"package.module:Class". It is a component, or has a method `pattern` and becomes a controller that goes by it; a class
with a parameter `rig` is given the bus of `[bench]`. The options of an FMU are its parameters, with a unit in the key
where they have one.
"""

from __future__ import annotations

import importlib
import inspect
import typing
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from inkloop.component import MEMBERS, Component, Job
from inkloop.components import devices, fmu_parameters, python_class
from inkloop.components.devices import Bench
from inkloop.components.plain_plant import PlainPlant
from inkloop.components.shadow import options as shadow_options
from inkloop.errors import FmuError, ScenarioError
from inkloop.suggest import nearest
from inkloop.tables.messages import sentence

GROUP = "inkloop.components"
DEPOSITION_MODELS = ("LayerDeposition", "SuperpositionDeposition", "VolumeAreaDeposition", "YoungLaplaceDeposition")
FMU_MODELS = (*DEPOSITION_MODELS, "ProfileSensor", fmu_parameters.CONTROLLER)
MAP_FOLDER = "MapFolder"
"""The kind of a profiler whose maps come as files in a `folder`."""
PYTHON_KINDS: Mapping[str, tuple[str, str]] = {
    "LayerMpc": ("inkloop_controller.controllers", "LayerMpcController"),
    "OpenLoop": ("inkloop_controller.controllers", "OpenLoopController"),
    "CohenLipson": ("inkloop_controller.controllers", "CohenLipsonController"),
    "ErrorDiffusion": ("inkloop_controller.controllers", "ErrorDiffusionController"),
    "StochasticGreedy": ("inkloop_controller.controllers", "StochasticGreedyController"),
    MAP_FOLDER: ("inkloop.metrology.map_folder", "MapFolder"),
}
PLAIN_PLANT = "PlainPlant"
"""The kind of a plant without the handshake; `plant` is the kind of the plant itself."""
SHADOW = shadow_options.KIND
MAPPED = "hardware.mapped"
"""The kind of a rig that `mapping`, a file beside the scenario, binds to the contract's ports."""
BESIDE_SCENARIO: Mapping[str, str] = {
    **dict.fromkeys(("Fmu", PLAIN_PLANT, SHADOW), "file"),
    MAPPED: "mapping",
    MAP_FOLDER: "folder",
}
"""Kind -> its option that names a file or folder, which stands beside the scenario."""
_RULE_CONTROLLER = ("inkloop_controller.pattern_rule", "rule_controller")
_PORT_OPTIONS = ("pattern_input", "height_output")


def make(kind: str, job: Job, options: Mapping[str, object], bench: Bench | None = None) -> Component:
    """The component of a kind, made for a job; bench: of all devices of its loop.

    Raises ScenarioError with everything wrong, FmuError.
    """
    if not _goes_by_parameters(kind):
        component, found = _make_other(kind, job, options, bench)
        if component is not None:
            return component
        raise ScenarioError(kind, found)
    found = faults(kind, job, options)
    if found:
        raise ScenarioError(kind, found)
    if kind in devices.KINDS:
        return devices.make(kind, job, options, bench or Bench())
    return (
        fmu_parameters.make_from_file(job, options) if kind == "Fmu" else fmu_parameters.make_model(kind, job, options)
    )


def faults(kind: str, job: Job, options: Mapping[str, object]) -> list[str]:
    """Everything wrong with the options of a kind, one sentence each, each beginning with the key; starts nothing."""
    if not _goes_by_parameters(kind):
        component, found = _make_other(kind, job, options, None)
        if component is not None:
            component.terminate()
        return found
    try:
        if kind == "Fmu":
            return fmu_parameters.faults_of_file(job, options)
        if kind in devices.KINDS:
            return devices.faults(kind, job, options)
        return fmu_parameters.faults_of_model(kind, job, options)
    except FmuError as error:
        return [f"kind is {kind!r}: {error}"]


def beside(kind: str, options: Mapping[str, object], folder: Path) -> dict[str, Any]:
    """The options, what they name beside the scenario as it is found from here; folder: where the scenario stands."""
    key = BESIDE_SCENARIO.get(kind)
    name = options.get(key) if key is not None else None
    return {**options, key: str(folder / name)} if key is not None and isinstance(name, str) else dict(options)


def _goes_by_parameters(kind: str) -> bool:
    """Whether the options of a kind are the parameters of an FMU."""
    return kind == "Fmu" or kind in FMU_MODELS or kind in devices.KINDS


def _make_other(
    kind: str, job: Job, options: Mapping[str, object], bench: Bench | None
) -> tuple[Component | None, list[str]]:
    """A component that is no FMU by itself, or what is wrong."""
    if kind == PLAIN_PLANT:
        return _make_plain(job, options)
    if kind == SHADOW:
        try:
            return shadow_options.make_shadow(job, options, make)
        except ScenarioError as error:
            return None, list(error.faults)
    return _make_python(kind, job, options, bench)


def _make_python(
    kind: str, job: Job, options: Mapping[str, object], bench: Bench | None
) -> tuple[Component | None, list[str]]:
    """A Python component, or what is wrong; a ValueError of its constructor is a fault of the file."""
    try:
        factory = _load(kind)
        chosen = python_class.validated(factory, options)
        if "rig" in inspect.signature(factory).parameters:
            chosen["rig"] = (bench or Bench()).rig
        component = _component(kind, job, factory(job, **chosen))
    except ValidationError as error:
        told = [sentence(detail, python_class.options_table(factory)) for detail in error.errors()]
        return None, told + _further_faults(kind, job, options, error)
    except ScenarioError as error:  # faults of a file that an option names
        key = next((key for key, value in options.items() if value == error.source), "kind")
        return None, [f"{key}: {Path(error.source).name}: {fault}" for fault in error.faults]
    except ValueError as error:
        return None, [str(error)]
    except LookupError:
        return None, [f"kind is {kind!r}; {nearest(kind, kinds())}"]
    except (ImportError, AttributeError) as error:
        return None, [f"kind is {kind!r}, which cannot be loaded: {error}"]
    except TypeError as error:
        return None, [f"kind is {kind!r}: its options are not what a scenario file can hold: {error}"]
    return component, []


def _further_faults(kind: str, job: Job, options: Mapping[str, object], error: ValidationError) -> list[str]:
    """What is wrong with the values beside those that `error` names."""
    left = python_class.as_meant(python_options(kind), options, error)
    if left is None:
        return []
    component, found = _make_python(kind, job, left, None)
    if component is not None:
        component.terminate()
    return found


def _make_plain(job: Job, options: Mapping[str, object]) -> tuple[Component | None, list[str]]:
    """A plant without the handshake in its adapter, or what is wrong."""
    ports = {name: options[name] for name in _PORT_OPTIONS if name in options}
    found = [
        f"{name} is {value!r}; expected the name of a port"
        for name, value in ports.items()
        if not isinstance(value, str)
    ]
    kind = options.get("plant", "Fmu")
    if not isinstance(kind, str) or kind == PLAIN_PLANT:
        return None, [*found, f"plant is {kind!r}; expected a kind, such as 'Fmu' or 'package.module:Class'"]
    inner = {name: value for name, value in options.items() if name not in ("plant", *_PORT_OPTIONS)}
    if found := found + faults(kind, job, inner):
        return None, found
    try:
        plant = make(kind, job, inner)
    except FmuError as error:
        return None, [f"plant is {kind!r}: {error}"]
    try:
        return PlainPlant(job, plant, **{name: str(value) for name, value in ports.items()}), []
    except ValueError as error:
        plant.terminate()
        return None, [str(error)]


def _component(kind: str, job: Job, made: Any) -> Component:
    """What a class made, as a component. Raises ValueError if it is neither one nor a rule for patterns."""
    if isinstance(made, Component):
        return made
    if callable(getattr(made, "pattern", None)):
        module, name = _RULE_CONTROLLER
        return typing.cast(Component, getattr(importlib.import_module(module), name)(job, made))
    missing = [name for name in MEMBERS if not hasattr(made, name)]
    raise ValueError(f"kind is {kind!r}, which has no {', '.join(missing)}; needs those, or a method pattern")


def python_options(kind: str) -> type[BaseModel]:
    """The options of a Python kind as a table. Raises LookupError, ImportError and AttributeError from loading."""
    return python_class.options_table(_load(kind))


def is_foreign_fmu(kind: str, options: Mapping[str, object]) -> bool:
    """A component of this kind runs the native code of an FMU that is none of ours."""
    plant = options.get("plant", "Fmu" if kind == PLAIN_PLANT else None)
    return kind == "Fmu" or (kind in (PLAIN_PLANT, SHADOW) and plant == "Fmu")


def kinds() -> list[str]:
    """All kinds that can be named here and now, but for "package.module:Class"."""
    return sorted(
        {
            *FMU_MODELS,
            *devices.KINDS,
            "Fmu",
            PLAIN_PLANT,
            SHADOW,
            MAPPED,
            *PYTHON_KINDS,
            *(point.name for point in entry_points(group=GROUP)),
        }
    )


def _load(kind: str) -> Callable[..., Any]:
    """The class of a kind. Raises LookupError if the kind is unknown, ImportError and AttributeError from loading."""
    if kind in PYTHON_KINDS or kind == MAPPED:
        module, name = PYTHON_KINDS.get(kind, ("inkloop_hardware.mapped.mapped", "Mapped"))
        return typing.cast(Callable[..., Any], getattr(importlib.import_module(module), name))
    if ":" in kind:
        return typing.cast(Callable[..., Any], EntryPoint(kind, kind, GROUP).load())
    points = entry_points(group=GROUP, name=kind)
    if not points:
        raise LookupError(kind)
    return typing.cast(Callable[..., Any], next(iter(points)).load())
