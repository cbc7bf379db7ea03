"""Values at the start: no loop among them in a system of our FMUs, and they depend on what the description says."""

from __future__ import annotations

import zipfile
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import pytest

from inkloop.fmu_writer.export import find_fmu
from support.fmus.fmu_driver import DEPOSITION_MODELS, EVERY_FORM, OK, Driver

SYSTEM = ("LayerController", "ProfileSensor")
"""Models connected to a deposition model; outputs and inputs of one name are connected."""


def dependencies(path: Path) -> dict[str, set[str]]:
    """Each output -> the variables that its value at the start depends on; of maps in FMI 2 the name of the whole."""
    with zipfile.ZipFile(path) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
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
def test_command_follows_the_layers_printed_from_the_end_of_initialisation_on(form: str) -> None:
    """As the description says: while initialising no input changes the command."""
    with Driver("LayerController", form) as fmu:
        assert fmu.set("mask", 1) == OK
        assert fmu.enter() == OK
        before = fmu.get("layer_command")
        assert fmu.set("layers_printed", 12) == OK
        assert fmu.get("layer_command") == before == 0
        assert fmu.exit() == OK
        assert fmu.get("layer_command") == 12
