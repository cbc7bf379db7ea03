"""Values at the start: no loop among them in a system of our FMUs, and they depend on what the description says."""

from __future__ import annotations

import zipfile
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest

from inkloop.fmu_writer.export import find_fmu
from support.fmus import layer_jobs
from support.fmus.fmu_driver import DEPOSITION_MODELS, EVERY_FORM, MODELS, OK, Driver, equal

SYSTEM = ("LayerController", "ProfileSensor")
"""Models connected to a deposition model; outputs and inputs of one name are connected."""


def dependencies(path: Path) -> dict[str, set[str]]:
    """Each output -> the variables that its value at the start depends on; of maps in FMI 2 the name of the whole."""
    folder = path if path.is_dir() else zipfile.Path(path)
    root = ET.fromstring((folder / "modelDescription.xml").read_text("utf-8"))
    variables = list(root.iterfind("ModelVariables/*"))
    is_fmi2 = root.get("fmiVersion") == "2.0"
    names = {
        str(number) if is_fmi2 else v.get("valueReference", ""): v.get("name", "").partition("[")[0]
        for number, v in enumerate(variables, 1)
    }
    tag, key = ("InitialUnknowns/Unknown", "index") if is_fmi2 else ("InitialUnknown", "valueReference")
    found: dict[str, set[str]] = {}
    for unknown in root.iterfind(f"ModelStructure/{tag}"):
        assert unknown.get("dependencies") is not None  # left out, it means all inputs
        known = {names[word] for word in unknown.get("dependencies", "").split()}
        found.setdefault(names[unknown.get(key, "")], set()).update(known)
    return found


def order(system: dict[str, dict[str, set[str]]], inputs: dict[str, set[str]]) -> list[tuple[str, str]]:
    """An order in which outputs can be calculated. Raises CycleError."""
    givers = {name: model for model, outputs in system.items() for name in outputs}
    graph = {}
    for model, outputs in system.items():
        for output, known in outputs.items():
            wired = {name for name in known & inputs[model] if name in givers}
            graph[model, output] = {(givers[name], name) for name in wired}
    return list(TopologicalSorter(graph).static_order())


def inputs_of(path: Path) -> set[str]:
    variables = fmpy.read_model_description(str(path), validate=False).modelVariables
    return {v.name.partition("[")[0] for v in variables if v.causality == "input"}


@EVERY_FORM
@pytest.mark.parametrize("plant", DEPOSITION_MODELS)
def test_outputs_of_a_system_can_be_calculated_one_after_another(plant: str, form: str) -> None:
    """Masters such as OMSimulator solve loops of reals only; sequence numbers are integers."""
    paths = {model: find_fmu(model, form) for model in (*SYSTEM, plant)}
    system = {model: dependencies(path) for model, path in paths.items()}
    inputs = {model: inputs_of(path) for model, path in paths.items()}
    ordered = order(system, inputs)
    assert ordered.index(("LayerController", "layer_command")) < ordered.index((plant, "layers_printed"))
    looped = {**system, "LayerController": {**system["LayerController"], "layer_command": {"layers_printed"}}}
    with pytest.raises(CycleError):
        order(looped, inputs)


@EVERY_FORM
@pytest.mark.parametrize("model", [*MODELS, layer_jobs.MODEL])
def test_outputs_at_the_start_depend_on_what_the_description_says_and_stay(model: str, form: str) -> None:
    """While initialising, each output answers to what it lists and to nothing else; the end of it changes none."""
    job = None
    if model == layer_jobs.MODEL:
        form = "fmi2" if form == "fmi2" else "fmi3-fixed"
        job = layer_jobs.unpacked(form, "cuboid", *layer_jobs.CUBOID)
    with Driver(model, form, 3, 2, job) as fmu:
        assert fmu.enter() == OK
        names = [name for name, role in fmu.roles.items() if role in ("input", "parameter")]
        found: dict[str, set[str]] = {name: set() for name, role in fmu.roles.items() if role == "output"}
        before = {name: fmu.get(name) for name in found}
        for name in names:
            start = fmu.get(name)
            change(fmu, name)
            for output, value in before.items():
                if not np.array_equal(fmu.get(output), value):
                    found[output].add(name)
            assert fmu.set(name, start) == OK
        assert found == dependencies(job or find_fmu(model, form))
        for name in names:
            change(fmu, name)
        shown = {name: fmu.get(name) for name in found}
        assert fmu.exit() == OK, fmu.messages
        assert equal({name: fmu.get(name) for name in found}, shown)


def change(fmu: Driver, name: str) -> None:
    """Set another value; of a map in its first cell, so that a mask still marks some."""
    present = np.atleast_1d(fmu.get(name))
    for other in (present / 2, present + 1e-6, present + 1, present - 1, present + 3, present - 3):
        value = present.copy()
        value.flat[0] = not present.flat[0] if present.dtype == bool else other.flat[0]
        if value.flat[0] != present.flat[0] and fmu.set(name, value.reshape(fmu.shape(name))) == OK:
            return
    raise AssertionError(f"{name} takes no other value: {fmu.messages[-1]}")


@EVERY_FORM
def test_command_follows_the_layers_printed_from_the_first_step_on(form: str) -> None:
    """As the description says: while initialising no input changes the command."""
    with Driver("LayerController", form).start({"layers_printed": 12}) as fmu:
        assert fmu.get("layer_command") == 0
        assert fmu.step(0.0) == OK
        assert fmu.get("layer_command") == 12
