"""The page in an FMU has the readme of its model and every variable."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

from inkloop.fmu_writer import definition, documentation
from inkloop.fmu_writer.archive import read_definition
from inkloop.fmu_writer.export import find_fmu

README = """# Sensor

Reads `height` where a < b.

## Limits

- one
- two,
  over two lines

    first = 1
      second = 2
"""
BODY = """<h1>Sensor</h1>
<p>Reads <code>height</code> where a &lt; b.</p>
<h2>Limits</h2>
<ul><li>one</li><li>two,
  over two lines</li></ul>
<pre>first = 1
  second = 2</pre>
<h2>Variables</h2>"""
MODEL = read_definition(find_fmu("ProfileSensor"))


def rows(page: str) -> dict[str, list[str]]:
    cells = [row.split("</td><td>") for row in page.split("<tr><td>")[1:]]
    return {name: [*rest, last.partition("</td>")[0]] for name, *rest, last in cells}


def test_markdown_of_a_readme_becomes_html() -> None:
    page = documentation.index_html(MODEL, README).decode()
    assert page.partition("<body>\n")[2].startswith(BODY)
    assert "<title>ProfileSensor</title>" in page


def test_table_states_type_unit_start_and_limits_of_each_variable() -> None:
    found = rows(documentation.index_html(MODEL, "").decode())
    assert list(found) == [variable.name for variable in MODEL.exposed]
    assert found["measured_height"][:4] == ["output", "real (nx, ny)", "m", ""]
    causality, type_, unit, start, about = found["noise_std"]
    assert (causality, type_, unit, float(start)) == ("parameter", "real", "m", 0.0)
    assert about.endswith("(at least 0.0)")


def test_section_comes_before_the_table_which_is_written_again() -> None:
    page = documentation.index_html(MODEL, README)
    shorter = replace(MODEL, variables=MODEL.variables[:-1])
    found = documentation.with_section(page, "<h2>Own</h2>", shorter).decode()
    assert BODY.replace("<h2>Variables</h2>", "<h2>Own</h2>\n<h2>Variables</h2>") in found
    assert list(rows(found)) == [variable.name for variable in shorter.exposed]
    assert found.endswith("</table>\n</body>\n</html>\n")


SMALL = """model = "It"
description = "It"
step_size = 1.0
stop_time = 2.0
[types.Mode]
description = "Modes"
items = { off = 0, slow = 7 }
[terminals]
scan = "What is seen"
[buses]
bench = "A bus"
[variables]
time = { causality = "independent", description = "t" }
nx = { causality = "structural", type = "count", start = 9, description = "x" }
ny = { causality = "structural", type = "count", start = 9, description = "y" }
tick = { causality = "input", type = "clock", terminal = "bench", description = "c" }
seen = { causality = "output", type = "boolean", shape = "grid", terminal = "scan", description = "s < t" }
mode = { causality = "parameter", type = "enumeration", declared = "Mode", start = 7, description = "m" }
gain = { causality = "parameter", unit = "m", min = -1.0, max = 4.0, start = 0.5, description = "g" }
share = { causality = "parameter", max = 1.0, description = "h" }
kept = { causality = "state", description = "k" }
"""


def test_enumerations_and_limits_are_stated() -> None:
    found = rows(documentation.index_html(definition.load(SMALL, "it.toml"), "").decode())
    assert found["seen"] == ["output", "boolean (nx, ny)", "1", "", "s &lt; t"]
    assert found["mode"] == ["parameter", "0 off, 7 slow", "1", "7", "m"]
    assert found["gain"] == ["parameter", "real", "m", "0.5", "g (at least -1.0, at most 4.0)"]
    assert found["share"][-1] == "h (at most 1.0)"
    assert "kept" not in found


def test_terminals_have_their_own_members_and_a_bus_has_its_kind() -> None:
    root = ET.fromstring(documentation.terminals_xml(definition.load(SMALL, "it.toml")))
    found = {each.attrib["name"]: each for each in root.iter("Terminal")}
    assert {name: [m.get("variableName") for m in each] for name, each in found.items()} == {
        "scan": ["seen"],
        "bench": ["tick"],
    }
    assert [m.attrib for m in found["scan"]] == [
        {"variableName": "seen", "memberName": "seen", "variableKind": "signal"}
    ]
    attributes = ("matchingRule", "terminalKind", "description")
    assert [found["scan"].get(name) for name in attributes] == ["bus", None, "What is seen"]
    assert [found["bench"].get(name) for name in attributes] == [
        "org.fmi-ls-bus.transceiver",
        "org.fmi-ls-bus.network-terminal",
        "A bus",
    ]


def test_sources_and_standards_of_an_fmu_are_declared() -> None:
    built = ET.fromstring(documentation.build_description_xml(definition.load(SMALL, "it.toml"), ["a.c", "b.c"]))
    (configuration,) = built
    (files,) = configuration
    assert (configuration.attrib, files.attrib) == ({"modelIdentifier": "It"}, {"language": "C11"})
    assert [file.attrib for file in files] == [{"name": "a.c"}, {"name": "b.c"}]
    manifest = ET.fromstring(documentation.manifest_xml())
    space = "{http://fmi-standard.org/fmi-ls-manifest}"
    assert [manifest.get(f"{space}fmi-ls-{name}") for name in ("name", "version")] == [
        "org.fmi-standard.fmi-ls-bus",
        "1.0.0",
    ]
    assert manifest.get("isBusSimulationFMU") == "false"
