"""Descriptions of a small model in every form: each attribute that an importer goes by."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any

import pytest

from inkloop.fmu_writer import FORMS, definition, description
from inkloop.fmu_writer.description import PLAIN, Baked, Release

SMALL = """model = "It"
description = "About it"
step_size = 0.5
stop_time = 8.0
[types.Mode]
description = "Modes"
items = { off = 0, slow = 7 }
[variables]
time = { causality = "independent", unit = "s", description = "t" }
nx = { causality = "structural", type = "count", start = 9, min = 1, description = "x" }
ny = { causality = "structural", type = "count", start = 9, min = 1, description = "y" }
dose = { causality = "input", type = "integer", shape = "grid", start = 1, min = 0, max = 2, description = "d" }
height = { causality = "output", shape = "grid", unit = "m", initial_from = "begin", description = "h" }
mean = { causality = "output", unit = "m", initial_from = "begin", description = "a" }
steps = { causality = "output", type = "integer", description = "n" }
begin = { causality = "parameter", shape = "grid", unit = "m", start = 0.25, min = -1.0, description = "b" }
gain = { causality = "parameter", unit = "1/m", start = 2, min = 0.5, max = 4, is_tunable = true, description = "g" }
mode = { causality = "parameter", type = "enumeration", declared = "Mode", start = 7, description = "m" }
is_on = { causality = "parameter", type = "boolean", start = 1, description = "o" }
kept = { causality = "state", shape = "grid" }
"""
EVENTS = """tick = { causality = "output", type = "clock", description = "c" }
data = { causality = "output", type = "binary", max = 9, clock = "tick", mime_type = "it/it", description = "e" }
"""
TEXTS = """name = { causality = "parameter", type = "string", max = 9, description = "s" }
"""
SIZES = {"nx": 2, "ny": 3}
OUTPUT = {"causality": "output", "variability": "discrete", "initial": "calculated"}


def written(form: str, text: str = SMALL, baked: Baked = PLAIN, sizes: Mapping[str, int] = SIZES) -> ET.Element:
    model = definition.load(text, "it.toml")
    return ET.fromstring(description.write(model, form, sizes, ["a.c", "b.c"], Release("1.2", "2026-01-31"), baked))


def rest(element: ET.Element) -> dict[str, str]:
    """Attributes but name, reference and description."""
    return {
        name: text for name, text in element.attrib.items() if name not in ("name", "valueReference", "description")
    }


def variables(root: ET.Element) -> dict[str, ET.Element]:
    return {each.attrib["name"]: each for each in root.iterfind("ModelVariables/*")}


@pytest.mark.parametrize("form", FORMS)
def test_head_of_a_description_is_that_of_the_model_or_of_what_is_baked_in(form: str) -> None:
    root, model = written(form), definition.load(SMALL, "it.toml")
    token = f"It-{model.fingerprint}-2x3" + ("-resizable" if form == "fmi3" else "")
    assert root.get("guid" if form == "fmi2" else "instantiationToken") == token
    assert [root.get(name) for name in ("fmiVersion", "modelName", "description", "version", "generationTool")] == [
        "2.0" if form == "fmi2" else "3.0", "It", "About it", "1.2", "inkloop 1.2",
    ]  # fmt: skip
    assert [root.get(name) for name in ("license", "variableNamingConvention", "generationDateAndTime")] == [
        "BSD-3-Clause", "structured", "2026-01-31",
    ]  # fmt: skip
    experiment: Any = root.find("DefaultExperiment")
    assert experiment.attrib == {"startTime": "0.0", "stopTime": "8.0", "stepSize": "0.5"}
    interface: Any = root.find("CoSimulation")
    assert interface.get("canNotUseMemoryManagementFunctions") == ("true" if form == "fmi2" else None)
    assert interface.get("hasEventMode") == (None if form == "fmi2" else "false")
    units = {each.attrib["name"]: [inner.attrib for inner in each] for each in root.iterfind("UnitDefinitions/Unit")}
    assert units["m"] == [{"m": "1"}, {"name": "um", "factor": "1000000"}]
    assert units["1/m"] == [{"m": "-1"}, {"name": "1/um", "factor": "1e-06"}]
    assert units["s"] == [{"s": "1"}, {"name": "ms", "factor": "1000"}]
    baked = Baked({"gain": 3.0}, mark="abc", description="Baked", step_size=0.25, stop_time=4.0)
    root = written(form, baked=baked)
    experiment = root.find("DefaultExperiment")
    assert (experiment.get("stopTime"), experiment.get("stepSize"), root.get("description")) == ("4.0", "0.25", "Baked")
    marked = root.get("guid" if form == "fmi2" else "instantiationToken")
    assert marked == (token if form == "fmi3" else f"{token}-abc")
    gain = variables(root)["gain"]
    assert (gain[0] if form == "fmi2" else gain).get("start") == "3.0"


def test_variables_of_fmi_3_have_roles_limits_start_values_and_dimensions() -> None:
    found, fixed = variables(written("fmi3")), variables(written("fmi3-fixed"))
    assert [each.get("valueReference") for each in found.values()] == [str(n) for n in range(11)]
    assert "kept" not in found
    real = {"unit": "m", "displayUnit": "um", "nominal": "1e-6"}
    assert {name: (each.tag, rest(each)) for name, each in found.items()} == {
        "time": ("Float64", {"causality": "independent", "variability": "continuous", "unit": "s",
                             "displayUnit": "ms"}),
        **{name: ("UInt64", {"causality": "structuralParameter", "variability": "fixed", "min": "1", "start": start})
           for name, start in (("nx", "2"), ("ny", "3"))},
        "dose": ("Int32", {"causality": "input", "variability": "discrete", "min": "0", "max": "2",
                           "start": "1 1 1 1 1 1"}),
        "height": ("Float64", {**OUTPUT, **real}),
        "mean": ("Float64", {**OUTPUT, **real}),
        "steps": ("Int32", OUTPUT),
        "begin": ("Float64", {"causality": "parameter", "variability": "fixed", **real, "min": "-1.0",
                              "start": " ".join(["0.25"] * 6)}),
        "gain": ("Float64", {"causality": "parameter", "variability": "tunable", "unit": "1/m", "displayUnit": "1/um",
                             "nominal": "1e4", "min": "0.5", "max": "4.0", "start": "2.0"}),
        "mode": ("Enumeration", {"causality": "parameter", "variability": "fixed", "declaredType": "Mode",
                                 "start": "7"}),
        "is_on": ("Boolean", {"causality": "parameter", "variability": "fixed", "start": "true"}),
    }  # fmt: skip
    assert [each.attrib for each in found["height"]] == [{"valueReference": "1"}, {"valueReference": "2"}]
    assert [each.attrib for each in fixed["height"]] == [{"start": "2"}, {"start": "3"}]
    sized = {"causality": "local", "variability": "constant", "initial": "exact", "min": "1", "start": "2"}
    assert rest(fixed["nx"]) == sized


def test_variables_of_fmi_2_are_scalars_in_the_order_of_their_cells() -> None:
    found = variables(written("fmi2"))
    assert list(found)[:8] == ["nx", "ny", *(f"dose[{i},{j}]" for i in (1, 2) for j in (1, 2, 3))]
    assert [int(each.attrib["valueReference"]) for each in found.values()] == list(range(1, 26))
    assert rest(found["nx"]) == {"causality": "local", "variability": "constant", "initial": "exact"}
    assert (found["nx"][0].tag, found["nx"][0].attrib) == ("Integer", {"min": "1", "start": "2"})
    assert found["begin[2,3]"][0].attrib == {
        "unit": "m", "displayUnit": "um", "nominal": "1e-6", "min": "-1.0", "start": "0.25",
    }  # fmt: skip
    assert rest(found["gain"]) == {"causality": "parameter", "variability": "tunable"}
    files = [each.attrib for each in written("fmi2").iterfind("CoSimulation/SourceFiles/File")]
    assert files == [{"name": "a.c"}, {"name": "b.c"}]


def test_values_at_the_start_depend_on_what_they_begin_from() -> None:
    """A map cell by cell, a number on all cells; later values depend on no input at once."""
    root = written("fmi2")
    structure = {tag: {each.get("index"): each.get("dependencies") for each in root.iterfind(f"ModelStructure/{tag}/*")}
                 for tag in ("Outputs", "InitialUnknowns")}  # fmt: skip
    outputs = [str(index) for index in range(9, 17)]  # six cells of height, mean and steps
    begins = [str(index) for index in range(17, 23)]
    assert structure["Outputs"] == dict.fromkeys(outputs, "")
    assert structure["InitialUnknowns"] == dict(zip(outputs, [*begins, " ".join(begins), ""], strict=True))
    found = {(each.tag, each.get("valueReference")): each.get("dependencies") for each in
             written("fmi3").iterfind("ModelStructure/*")}  # fmt: skip
    assert found == {
        **{("Output", reference): "" for reference in "456"},
        ("InitialUnknown", "4"): "7", ("InitialUnknown", "5"): "7", ("InitialUnknown", "6"): "",
    }  # fmt: skip


def test_clocks_texts_and_binaries_of_fmi_3_are_declared() -> None:
    text = SMALL.replace("begin = {", EVENTS + "begin = {", 1).replace("kept = {", TEXTS + "kept = {", 1)
    root = written("fmi3-fixed", text, Baked(texts={"name": "loss"}, starts={"begin": [1, 2, 3, 4, 5, 6]}))
    interface: Any = root.find("CoSimulation")
    assert interface.get("hasEventMode") == "true"
    found = variables(root)
    assert (found["tick"].tag, rest(found["tick"])) == (
        "Clock", {"causality": "output", "intervalVariability": "triggered"}
    )  # fmt: skip
    assert rest(found["data"]) == {**OUTPUT, "clocks": "7", "mimeType": "it/it", "maxSize": "9"}
    assert len(found["data"]) == 0
    assert (found["name"].tag, [each.attrib for each in found["name"]]) == ("String", [{"value": "loss"}])
    assert found["begin"].get("start") == "1.0 2.0 3.0 4.0 5.0 6.0"
    unknown = [each.get("valueReference") for each in root.iterfind("ModelStructure/InitialUnknown")]
    assert unknown == ["4", "5", "6", "7"]  # not what ticks with a clock
