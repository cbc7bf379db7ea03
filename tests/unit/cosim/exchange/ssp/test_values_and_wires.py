"""Values and wires of an .ssp in both directions: units, Booleans, arrays, prefixes; FMUs are descriptions alone."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Job, Port
from inkloop.errors import ScenarioError
from inkloop.exchange.ssp import contents, ssd, wires
from inkloop.exchange.ssp.folder import CONFIGURATION, MULTI_MODEL, _begun, maestro_tables, osp_structure
from inkloop.exchange.ssp.reading import _grid_errors
from inkloop.exchange.ssp.structure import Structure
from inkloop.exchange.ssp.system import Part, System, Wire, _stop_s, _wires, _with_values
from inkloop.fmu import FmuDescription, Variable
from inkloop.master.wiring import Connection, Transfer
from inkloop.tables.schema import RunTable
from inkloop.units import defined_unit
from support.toys import FunctionComponent

NAMES = " ".join(
    f'xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{long}"'
    for short, long in (
        ("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"), ("ssm", "ParameterMapping")
    )
)  # fmt: skip
ITEMS = {"plain": 1, "squared": 2}


def variable(name: str, kind: str = "Float64", causality: str = "parameter", **more: Any) -> Variable:
    return Variable(name, kind, causality, "fixed" if causality == "parameter" else "discrete", (1,), **more)


def scattered(name: str, causality: str, shape: tuple[int, ...], **more: Any) -> Variable:
    """A variable of FMI 2 with a scalar for each element."""
    elements = tuple(f"{name}[{','.join(str(i + 1) for i in index)}]" for index in np.ndindex(shape))
    return variable(name, "Real", causality, dimensions=shape, elements=elements, **more)


def described(fmi: int, *variables: Variable) -> FmuDescription:
    named = {each.name: each for each in variables}
    return FmuDescription(Path("it.fmu"), "It", fmi, "it", "token", named, (), True, True)


PARAMETERS = (
    variable("length", unit="m"),
    variable("is_on", "Boolean"),
    variable("mode", "Enumeration", items=ITEMS),
    variable("modes", "Enumeration", items=ITEMS, dimensions=(2,)),
    variable("label", "String"),
    variable("count", "Int32"),
    variable("map", unit="m", dimensions=(2, 3)),
    scattered("start", "parameter", (2, 2), start=("1", "2", "3", "4")),
    scattered("bare", "parameter", (2, 2), start=("7",)),
)
KNOWN = {"a": described(2, *PARAMETERS)}
ROOT_UNITS = {"celsius": defined_unit("celsius", {"K": 1}, 1.0, 273.15)}


def bound(*entries: str, prefix: str = "", units: str = "", mapping: str = "") -> str:
    """A binding of parameters that stand in the structure itself."""
    return f"""<ssd:ParameterBinding prefix="{prefix}"><ssd:ParameterValues><ssv:ParameterSet><ssv:Parameters>
{"".join(entries)}</ssv:Parameters>{units}</ssv:ParameterSet></ssd:ParameterValues>{mapping}</ssd:ParameterBinding>"""


def read(
    *entries: str, prefix: str = "", files: dict[str, str] | None = None, more: str = "", inner: str = ""
) -> tuple[Any, list[str]]:
    """The parameters of a component, and the errors; inner: bindings of the component itself."""
    system = f"""<ssd:System {NAMES}>
<ssd:ParameterBindings>{bound(*entries, prefix=prefix)}{more}</ssd:ParameterBindings>
<ssd:Elements><ssd:Component name="a"><ssd:ParameterBindings>{inner}</ssd:ParameterBindings></ssd:Component>
</ssd:Elements></ssd:System>"""
    found, errors = parameters(system, files)
    return found.get("a", {}), errors


def parameters(system: str, files: dict[str, str] | None = None, known: Any = None) -> tuple[Any, list[str]]:
    """The parameters by component, and the errors."""
    content, errors = io.BytesIO(), list[str]()
    with zipfile.ZipFile(content, "w") as archive:
        for name, text in (files or {}).items():
            archive.writestr(name, text)
        structure = Structure.of(ET.fromstring(system), errors)
        return contents.parameters(structure, ROOT_UNITS, archive, known or KNOWN, errors), errors


def entry(name: str, value: str, kind: str = "Real", unit: str = "") -> str:
    of_unit = f' unit="{unit}"' if unit else ""
    return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}"{of_unit}/></ssv:Parameter>'


@pytest.mark.parametrize(
    ("name", "text", "unit", "value"),
    [
        ("length", "250", "um", 250e-6),
        ("length", "0.5", "", 0.5),
        ("is_on", "true", "", True),
        ("is_on", "1", "", True),
        ("is_on", "false", "", False),
        ("is_on", "0", "", False),
        ("mode", "squared", "", "squared"),
        ("mode", "2", "", 2),
        ("count", "-3", "", -3),
        ("map", "1 2 3 4 5 6", "mm", [[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]]),
        ("map", "1 2", "", [1.0, 2.0]),  # of another size, which the scenario refuses
    ],
)
def test_value_is_read_in_the_unit_and_shape_of_the_fmu(name: str, text: str, unit: str, value: Any) -> None:
    found, errors = read(entry(f"a.{name}", text, unit=unit))
    assert not errors
    assert type(found[name]) is type(value)
    np.testing.assert_array_equal(np.shape(found[name]), np.shape(value))
    if isinstance(value, float | list):
        np.testing.assert_allclose(found[name], value, rtol=1e-12)
    else:
        assert found[name] == value


def test_texts_and_enumerations_may_be_elements() -> None:
    """SSP 2.0 has them for arrays, and allows one."""
    for name, kind, texts, value in (("modes", "Enumeration", ("squared", "plain"), [2, 1]),
                                     ("label", "String", ("a b",), "a b")):  # fmt: skip
        inner = "".join(f'<ssv:Value value="{text}"/>' for text in texts)
        found, errors = read(f'<ssv:Parameter name="a.{name}"><ssv:{kind}>{inner}</ssv:{kind}></ssv:Parameter>')
        assert (found[name], errors) == (value, [])


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [("is_on", "yes", "Boolean"), ("count", "1 2", "Int32"), ("start[1,1]", "1 2", "Real"), ("map", "", "Float64"),
     ("mode", "cubed", "Enumeration")],
)  # fmt: skip
def test_value_that_is_none_is_reported(name: str, text: str, kind: str) -> None:
    assert read(entry(f"a.{name}", text))[1] == [f"parameter a.{name} is {text!r}; expected {kind}"]


def test_elements_that_no_set_names_keep_their_start_value() -> None:
    assert read(entry("length", "2"), prefix="a.") == ({"length": 2.0}, [])
    found, errors = read(entry("a.start[2,1]", "9"), entry("a.bare[1,2]", "5"))
    assert not errors
    assert found == {"start": [[1.0, 2.0], [9.0, 4.0]], "bare": [[0.0, 5.0], [0.0, 0.0]]}


def test_outer_system_overrides_its_parts() -> None:
    """As in SSP 1.0 and 2.0: what stands higher up comes from who put the parts together."""
    assert read(entry("a.length", "2"), inner=bound(entry("length", "1"), entry("count", "7"))) == (
        {"length": 2.0, "count": 7},
        [],
    )
    sub = bound(entry("deep.length", "3"), entry("deep.count", "4"))
    system = f"""<ssd:System {NAMES}>
<ssd:ParameterBindings>{bound(entry("sub.deep.count", "5"))}</ssd:ParameterBindings>
<ssd:Elements><ssd:System name="sub"><ssd:ParameterBindings>{sub}</ssd:ParameterBindings>
<ssd:Elements><ssd:Component name="deep"><ssd:ParameterBindings>
{bound(entry("length", "1"), entry("count", "1"), entry("is_on", "true"))}</ssd:ParameterBindings></ssd:Component>
</ssd:Elements></ssd:System></ssd:Elements></ssd:System>"""
    found, errors = parameters(system, known={"sub_deep": KNOWN["a"]})
    assert not errors
    assert found == {"sub_deep": {"length": 3.0, "count": 5, "is_on": True}}


def test_unit_is_the_one_that_the_file_defines() -> None:
    units = """<ssv:Units><ssc:Unit name="millimetre"><ssc:BaseUnit m="1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="um"><ssc:BaseUnit m="1" factor="1.0"/></ssc:Unit></ssv:Units>"""
    more = bound(entry("a.length", "250", unit="millimetre"), units=units)
    assert read(more=more) == ({"length": pytest.approx(0.25, rel=1e-12, abs=0.0)}, [])
    assert read(more=bound(entry("a.length", "3", unit="um"), units=units)) == ({"length": 3.0}, [])
    warm = {"a": described(2, variable("bed", unit="K"))}
    system = f"""<ssd:System {NAMES}><ssd:ParameterBindings>{bound(entry("a.bed", "60", unit="celsius"))}
</ssd:ParameterBindings><ssd:Elements><ssd:Component name="a"/></ssd:Elements></ssd:System>"""
    assert parameters(system, known=warm) == ({"a": {"bed": 333.15}}, [])
    own = '<ssv:Units><ssc:Unit name="celsius"><ssc:BaseUnit K="1" factor="2"/></ssc:Unit></ssv:Units>'
    assert parameters(system.replace("</ssv:Parameters>", f"</ssv:Parameters>{own}"), known=warm) == (
        {"a": {"bed": 120.0}},
        [],
    )
    pieces = '<ssv:Units><ssc:Unit name="pieces"><ssc:BaseUnit/></ssc:Unit></ssv:Units>'
    assert read(more=bound(entry("a.bare[1,1]", "5", unit="pieces"), units=pieces)) == (
        {"bare": [[5.0, 0.0], [0.0, 0.0]]},
        [],
    )


@pytest.mark.parametrize("in_file", [False, True])
def test_mapping_gives_a_parameter_the_names_of_the_parts(in_file: bool) -> None:
    entries = """<ssm:MappingEntry source="size" target="a.length"><ssc:LinearTransformation factor="2" offset="1"/>
</ssm:MappingEntry><ssm:MappingEntry source="n" target="a.count"/>"""
    inside = f"<ssm:ParameterMapping {NAMES}>{entries}</ssm:ParameterMapping>"
    mapping = (
        '<ssd:ParameterMapping source="names.ssm"/>'
        if in_file
        else f"<ssd:ParameterMapping>{inside}</ssd:ParameterMapping>"
    )
    more = bound(entry("size", "500", unit="mm"), entry("n", "3"), entry("a.is_on", "true"), mapping=mapping)
    assert read(more=more, files={"names.ssm": inside}) == (
        {"length": 2.0, "count": 3},
        [],
    )  # what no entry names stays
    _, errors = read(more=bound(entry("sise", "3"), mapping=mapping.replace('offset="1"', 'offset="x"')),
                     files={"names.ssm": inside.replace('offset="1"', 'offset="x"')})  # fmt: skip
    assert errors == [
        "the mapping of size to a.length: factor '2', offset 'x'; expected numbers",
        "the mapping of size to a.length: its parameter set has no size; did you mean sise?",
        "the mapping of n to a.count: its parameter set has no n; known: sise",
    ]


def test_mapping_may_suppress_the_conversion_of_units() -> None:
    """One parameter goes to two: as it is, and converted."""
    entries = """<ssm:MappingEntry source="size" target="a.length" suppressUnitConversion="true">
<ssc:LinearTransformation factor="2" offset="1"/></ssm:MappingEntry>
<ssm:MappingEntry source="size" target="a.start[1,1]"/>"""
    mapping = f"<ssd:ParameterMapping><ssm:ParameterMapping>{entries}</ssm:ParameterMapping></ssd:ParameterMapping>"
    known = {"a": described(2, variable("length", unit="m"), scattered("start", "parameter", (1, 1), unit="m"))}
    system = f"""<ssd:System {NAMES}><ssd:ParameterBindings>{bound(entry("size", "20", unit="mm"), mapping=mapping)}
</ssd:ParameterBindings><ssd:Elements><ssd:Component name="a"/></ssd:Elements></ssd:System>"""
    assert parameters(system, known=known) == ({"a": {"length": 41.0, "start": [[0.02]]}}, [])


@pytest.mark.parametrize("base", ['m="1.0"', 'm="1" factor="0"', 'm="1" offset="x"'])
def test_unit_that_is_none_is_an_error(base: str) -> None:
    units = f'<ssv:Units><ssc:Unit name="odd"><ssc:BaseUnit {base}/></ssc:Unit></ssv:Units>'
    _, errors = read(more=bound(entry("a.length", "2"), units=units))
    assert len(errors) == 1
    assert errors[0].startswith("unit 'odd' is no unit: ")


def test_transformation_of_a_whole_number_is_refused() -> None:
    mapping = """<ssd:ParameterMapping><ssm:ParameterMapping><ssm:MappingEntry source="n" target="a.count">
<ssc:LinearTransformation factor="2"/></ssm:MappingEntry></ssm:ParameterMapping></ssd:ParameterMapping>"""
    _, errors = read(more=bound(entry("n", "3"), mapping=mapping))
    assert errors == ["parameter a.count is Int32; a unit or a transformation needs a real number"]


def test_element_that_is_refused_is_one_error() -> None:
    system = f"""<ssd:System {NAMES}><ssd:ParameterBindings>{bound(entry("bus.length", "3"))}</ssd:ParameterBindings>
<ssd:Elements><ssd:Component name="a"/><ssd:SignalDictionaryReference name="bus"/></ssd:Elements>
<ssd:Connections><ssd:Connection startElement="a" startConnector="y" endElement="bus" endConnector="y"/>
<ssd:Connection startElement="bus" startConnector="z" endElement="a" endConnector="x"/></ssd:Connections>
</ssd:System>"""
    found, errors = parameters(system)
    structure = Structure.of(ET.fromstring(system), [])
    known = {"a": described(3, variable("y", "Float64", "output"), variable("x", "Float64", "input"))}
    assert wires.connections(structure, {}, known, errors) == []
    assert found == {}
    assert errors == ["bus is a SignalDictionaryReference; inkloop takes components and systems"]


def nested(*connections: str, connectors: str = "") -> tuple[Any, list[str]]:
    """A plant in an inner system, a source and a sink outside of it."""
    system = f"""<ssd:System {NAMES}><ssd:Elements><ssd:Component name="a"/><ssd:Component name="b"/>
<ssd:System name="sub"><ssd:Connectors>{connectors}</ssd:Connectors><ssd:Elements><ssd:Component name="c"/>
</ssd:Elements><ssd:Connections>{"".join(connections[2:])}</ssd:Connections></ssd:System></ssd:Elements>
<ssd:Connections>{"".join(connections[:2])}</ssd:Connections></ssd:System>"""
    known = {
        "a": described(3, variable("y", "Float64", "output", unit="mm")),
        "b": described(3, variable("x", "Float64", "input", unit="m")),
        "sub_c": described(
            3,
            variable("x", "Float64", "input", unit="m"),
            variable("y", "Float64", "output", unit="m"),
            variable("p", unit="m"),
        ),
    }
    errors: list[str] = []
    structure = Structure.of(ET.fromstring(system), errors)
    return wires.connections(structure, {}, known, errors), errors


def joint(start: str, end: str, inside: str = "") -> str:
    """A connection between two "element.connector", without an element for the system itself."""
    ends = ""
    for which, place in (("start", start), ("end", end)):
        element, _, connector = place.rpartition(".")
        ends += (f'{which}Element="{element}" ' if element else "") + f'{which}Connector="{connector}" '
    return f"<ssd:Connection {ends}>{inside}</ssd:Connection>"


@pytest.mark.parametrize("turned", [False, True])
def test_wire_passes_the_connectors_of_an_inner_system(turned: bool) -> None:
    """Units on the way are converted, transformations come in order: (2 (y mm) in um + 500) 3 m."""
    connectors = """<ssd:Connector name="in" kind="input"><ssc:Real unit="um"/></ssd:Connector>
<ssd:Connector name="out" kind="output"/>"""
    ends = [("a.y", "sub.in"), ("sub.out", "b.x"), ("in", "c.x"), ("c.y", "out")]
    lines = [line('factor="2" offset="500"'), "", line('factor="3"'), ""]
    tables, errors = nested(
        *(joint(*(end[::-1] if turned else end), inside) for end, inside in zip(ends, lines, strict=True)),
        connectors=connectors,
    )
    assert not errors
    first, second = sorted(tables, key=lambda table: str(table["source"]))
    assert (first["source"], first["target"]) == ("a.y", "sub_c.x")
    assert first["gain"] == pytest.approx(6.0, rel=1e-12, abs=0.0)
    assert first["offset_um"] == pytest.approx(1500.0, rel=1e-12, abs=0.0)
    assert second == {"source": "sub_c.y", "target": "b.x"}


def test_connector_of_another_quantity_on_the_way_is_an_error() -> None:
    ends = joint("a.y", "sub.in"), "", joint("in", "c.x")
    _, errors = nested(*ends, connectors='<ssd:Connector name="in" kind="input"><ssc:Real unit="s"/></ssd:Connector>')
    assert [error.partition(";")[0] for error in errors] == [
        "the connection from a.y to sub.in goes from [mm] to [s]",
        "the connection from sub.in to sub.c.x goes from [s] to [m]",
    ]


@pytest.mark.parametrize(
    ("unit", "inside", "gain"), [("1", "", 1e3), ("s", '<ssc:LinearTransformation factor="2"/>', 4e3)]
)
def test_number_passes_a_connector_without_a_unit_or_by_a_transformation(unit: str, inside: str, gain: float) -> None:
    """The number of mm is then taken for one of m."""
    connectors = f'<ssd:Connector name="in" kind="input"><ssc:Real unit="{unit}"/></ssd:Connector>'
    (table,), errors = nested(joint("a.y", "sub.in", inside), "", joint("in", "c.x", inside), connectors=connectors)
    assert errors == []
    assert table == {"source": "a.y", "target": "sub_c.x", "gain": pytest.approx(gain, rel=1e-12, abs=0.0)}


def test_outputs_that_meet_at_a_connector_feed_inputs_alone() -> None:
    ends = joint("a.y", "sub.in"), "", joint("c.y", "in"), joint("in", "c.x")
    tables, errors = nested(*ends, connectors='<ssd:Connector name="in" kind="input"/>')
    assert errors == []
    assert sorted((table["source"], table["target"]) for table in tables) == [
        ("a.y", "sub_c.x"),
        ("sub_c.y", "sub_c.x"),
    ]


def test_connector_of_a_system_may_lead_to_a_parameter() -> None:
    ends = joint("a.y", "sub.in"), "", joint("in", "c.p"), joint("in", "c.x")
    tables, errors = nested(*ends, connectors='<ssd:Connector name="in" kind="input"/>')
    assert errors == []
    assert [(table["source"], table["target"]) for table in tables] == [("a.y", "sub_c.x")]


def test_unknown_component_is_answered_with_those_of_its_system() -> None:
    assert nested(joint("x.y", "b.x"), "")[1] == ["a connection names component 'x'; known: a, b, sub"]
    assert nested("", "", joint("x.y", "c.x"))[1] == ["a connection names component 'x'; known: c"]


def test_unit_of_a_connector_is_by_its_name_the_one_that_arrives() -> None:
    """A file need not define again what the FMUs define."""
    kelvin = defined_unit("K", {"K": 1}, 1.0, 0.0)
    warm = {
        "a": described(3, variable("y", "Float64", "output", unit=ROOT_UNITS["celsius"])),
        "sub_c": described(3, variable("x", "Float64", "input", unit=kelvin)),
    }
    system = f"""<ssd:System {NAMES}><ssd:Elements><ssd:Component name="a"/><ssd:System name="sub"><ssd:Connectors>
<ssd:Connector name="in" kind="input"><ssc:Real unit="celsius"/></ssd:Connector></ssd:Connectors><ssd:Elements>
<ssd:Component name="c"/></ssd:Elements><ssd:Connections>{joint("in", "c.x")}</ssd:Connections></ssd:System>
</ssd:Elements><ssd:Connections>{joint("a.y", "sub.in")}</ssd:Connections></ssd:System>"""
    errors: list[str] = []
    structure = Structure.of(ET.fromstring(system), errors)
    found = wires.connections(structure, {}, warm, errors)
    assert (found, errors) == ([{"source": "a.y", "target": "sub_c.x"}], [])


def test_input_that_an_output_feeds_by_two_ways_is_an_error() -> None:
    twice = joint("a.y", "sub.in", line('factor="2"')), joint("a.y", "sub.in", line('factor="3"')), joint("in", "c.x")
    _, errors = nested(*twice, connectors='<ssd:Connector name="in" kind="input"/>')
    assert errors == ["a.y feeds sub.in by two ways; keep one connection"]


def test_component_without_a_name_is_refused() -> None:
    errors: list[str] = []
    system = f"<ssd:System {NAMES}><ssd:Elements><ssd:Component/></ssd:Elements></ssd:System>"
    Structure.of(ET.fromstring(system), errors)
    assert len(errors) == 1
    assert "without a name" in errors[0]


def test_connector_that_an_inner_system_lacks_is_named() -> None:
    _, errors = nested(joint("a.y", "sub.inn"), "", connectors='<ssd:Connector name="in" kind="input"/>')
    assert errors == ["a connection names sub.inn; did you mean in?"]


def test_two_components_of_one_name_are_refused() -> None:
    system = f"""<ssd:System {NAMES}><ssd:Elements><ssd:Component name="sub_c"/><ssd:System name="sub"><ssd:Elements>
<ssd:Component name="c"/></ssd:Elements></ssd:System></ssd:Elements></ssd:System>"""
    errors: list[str] = []
    Structure.of(ET.fromstring(system), errors)
    assert errors == ["sub.c would have the name sub_c of sub_c in a scenario; rename one"]


def test_file_that_is_no_parameter_set_is_reported() -> None:
    other = f"<x {NAMES}><ssv:Parameters>{entry('a.length', '3')}</ssv:Parameters></x>"
    files = {"a b.ssv": other, "good.ssv": f"<ssv:ParameterSet {NAMES}><ssv:Parameters>{entry('a.count', '4')}"
             "</ssv:Parameters></ssv:ParameterSet>"}  # fmt: skip
    more = '<ssd:ParameterBinding source="a%20b.ssv"/><ssd:ParameterBinding source="./good.ssv"/>'
    found, errors = read(files=files, more=more)
    assert errors == ["parameters 'a%20b.ssv' are no ParameterSet of SSP, but <x>"]
    assert found == {"count": 4}


@pytest.mark.parametrize("encoding", ["klingon", "utf-7", "cp932"])
def test_encoding_that_cannot_be_read_is_an_error(encoding: str) -> None:
    files = {"odd.ssv": f'<?xml version="1.0" encoding="{encoding}"?><a/>'}
    (error,) = read(files=files, more='<ssd:ParameterBinding source="odd.ssv"/>')[1]
    assert error.startswith("parameters 'odd.ssv' cannot be read: the file is no XML: ")


PORTS = {
    "a": described(2, scattered("y", "output", (2,), unit="mm"), variable("n", "Integer", "output")),
    "b": described(2, scattered("x", "input", (2,), unit="m"), variable("m", "Integer", "input")),
}


def wired(
    *connections: tuple[str, str], inside: str = "", more: str = "", other: str = "", ports: Any = None
) -> tuple[Any, list[str]]:
    """Tables of connections between these connectors, and the errors. other: inside of all but the first one."""
    elements = "".join(
        f'<ssd:Connection startElement="{source.split(".")[0]}" startConnector="{source.split(".")[1]}" '
        f'endElement="{target.split(".")[0]}" endConnector="{target.split(".")[1]}" {more}>'
        f"{other if other and number else inside}</ssd:Connection>"
        for number, (source, target) in enumerate(connections)
    )
    outside = '<ssd:Connection startConnector="free" endElement="b" endConnector="m"/>'
    known = ports or PORTS
    parts = "".join(f'<ssd:Component name="{name}"/>' for name in known)
    system = f"""<ssd:System {NAMES}><ssd:Elements>{parts}</ssd:Elements>
<ssd:Connections>{elements}{outside}</ssd:Connections></ssd:System>"""
    errors: list[str] = []
    return wires.connections(Structure.of(ET.fromstring(system), errors), {}, known, errors), errors


BOTH = ("a.y[1]", "b.x[1]"), ("a.y[2]", "b.x[2]")
PLAIN = {"source": "a.y", "target": "b.x"}


def line(text: str) -> str:
    return f"<ssc:LinearTransformation {text}/>"


@pytest.mark.parametrize(
    ("inside", "more", "expected"),
    [
        ("", "", {}),
        (line('factor="2"'), "", {"gain": 2.0}),
        (line('offset="0.5"'), "", {"offset_um": 0.5e6}),
        (line('factor="2" offset="-3"'), "", {"gain": 2.0, "offset_um": -3e6}),
        ("", 'suppressUnitConversion="true"', {"gain": 1000.0}),  # the number of mm taken for one of m
        ("", 'suppressUnitConversion="1"', {"gain": 1000.0}),
        (line('factor="1.000001"'), "", {"gain": 1.000001}),
        (line('factor="2"'), 'suppressUnitConversion="false"', {"gain": 2.0}),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_transformation_becomes_gain_and_offset(inside: str, more: str, expected: Any, turned: bool) -> None:
    """An input may stand at the start of a connection: start and end have no direction."""
    pairs: Sequence[Any] = [pair[::-1] for pair in BOTH] if turned else BOTH
    found, errors = wired(*pairs, inside=inside, more=more)
    assert not errors
    (table,) = found
    assert set(table) == {*PLAIN, *expected}
    assert {name: table[name] for name in PLAIN} == PLAIN
    for name, value in expected.items():
        assert table[name] == pytest.approx(value, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("connections", "options", "message"),
    [
        (BOTH, {"other": line('factor="3"')}, "a.y to b.x: elements have different transformations"),
        ((("a.y[1]", "b.x[2]"), ("a.y[2]", "b.x[1]")), {}, "a.y to b.x: 2 of 2 elements are connected, or not each"),
        (BOTH, {"inside": line('factor="x"')}, "from a.y to b.x: factor 'x', offset '0'; expected numbers"),
    ],
)
def test_wire_that_no_scenario_has_is_reported(connections: Any, options: Any, message: str) -> None:
    _, errors = wired(*connections, **options)
    assert message in errors[0]
    assert len(errors) == 1


OUT = described(
    3,
    variable("h", "Float64", "output", unit="mm", dimensions=(3, 2)),
    variable("steps", "Int32", "output", unit="s"),
    variable("strange", "Float64", "output", unit="furlong"),
    variable("mode", "Enumeration", "output", items=ITEMS),
    variable("free", "Float64", "input", unit="m"),
    variable("x", "Float64", "input", unit="m"),
)
SET = (variable("is_on", "Boolean"), variable("mode", "Enumeration", items=ITEMS), variable("count", "Int32", unit="s"),
       variable("g", unit="um"), variable("map", unit="m", dimensions=(2, 3)))  # fmt: skip


def system(values: Any = None, wires: Sequence[Wire] = ()) -> System:
    parts = [
        Part("a", Path("a.fmu"), OUT, {}),
        Part("b", Path("b.fmu"), described(3, *SET), {name: np.asarray(each) for name, each in (values or {}).items()}),
    ]
    return System("it", "It", parts, wires, {}, 0.5, 9.0, "")


def test_connectors_carry_units_of_lengths_only() -> None:
    """A whole number has no unit in SSP; a unit that nothing defines would be an error there."""
    wires = [Wire(("a", "h"), ("a", "x"), 1.0, 2.5, Transfer()), Wire(("", "steps"), ("a", "x"), 1.0, 0.0, Transfer())]
    root = ET.fromstring(ssd.description(system(wires=wires), "2.0"))
    (of_a,) = (each for each in root.iterfind(".//{*}Component") if each.attrib["name"] == "a")
    found = {
        each.attrib["name"]: (
            each.attrib["kind"],
            *(inner.get("unit") for inner in each if inner.tag[-9:] != "Dimension"),
        )
        for each in of_a.iterfind("{*}Connectors/{*}Connector")
    }
    assert found == {
        "h": ("output", "mm"), "steps": ("output", None), "strange": ("output", None), "mode": ("output", None),
        "x": ("input", "m"),
    }  # fmt: skip
    units = {each.attrib["name"]: each[0].attrib for each in root.iterfind("{*}Units/{*}Unit")}
    assert units["mm"] == {"m": "1", "factor": "0.001"}
    assert units["m"] == {"m": "1", "factor": "1.0"}
    (experiment,) = root.iterfind("{*}DefaultExperiment")
    assert experiment.attrib == {"startTime": "0.0", "stopTime": "9.0"}
    (moved, plain) = root.iterfind(".//{*}Connection")
    assert [each.attrib for each in moved] == [{"factor": "1.0", "offset": "2.5"}]
    assert len(plain) == 0
    assert plain.attrib == {"startConnector": "steps", "endElement": "a", "endConnector": "x"}


@pytest.mark.parametrize("suppressed", [False, True])
def test_transformation_beside_units_with_an_offset_is_explained(suppressed: bool) -> None:
    ports = {
        "a": described(3, variable("t", causality="output", unit=ROOT_UNITS["celsius"])),
        "b": described(3, variable("m", causality="input", unit=defined_unit("K", {"K": 1}, 1.0, 0.0))),
    }
    more = 'suppressUnitConversion="true"' if suppressed else ""
    found, errors = wired(("a.t", "b.m"), inside=line('offset="273.15"'), more=more, ports=ports)
    assert found == ([{"source": "a.t", "target": "b.m"}] if suppressed else [])
    assert [error.partition(";")[0] for error in errors] == (
        [] if suppressed else ["a.t to b.m: inkloop converts [celsius] to [K] and takes no transformation on top"]
    )


def test_parameters_behind_connectors_are_named() -> None:
    system = f"""<ssd:System {NAMES}><ssd:ParameterBindings>{bound(entry("size", "3"))}</ssd:ParameterBindings>
<ssd:Connectors><ssd:Connector name="size" kind="parameter"/></ssd:Connectors>
<ssd:Elements><ssd:Component name="a"/><ssd:Component name="b"/><ssd:System name="sub"><ssd:Connectors>
<ssd:Connector name="size" kind="parameter"/></ssd:Connectors><ssd:Elements><ssd:Component name="c"/></ssd:Elements>
<ssd:Connections><ssd:Connection startConnector="size" endElement="c" endConnector="length"/></ssd:Connections>
</ssd:System></ssd:Elements><ssd:Connections>
<ssd:Connection startConnector="size" endElement="a" endConnector="length"/>
<ssd:Connection startElement="sub" startConnector="size" endElement="a" endConnector="count"/>
<ssd:Connection startElement="b" startConnector="y" endElement="a" endConnector="length"/>
</ssd:Connections></ssd:System>"""
    known = {**KNOWN, "b": described(2, variable("y", "Real", "calculatedParameter"))}
    found, errors = parameters(system, known=known)
    assert wires.connections(Structure.of(ET.fromstring(system), []), {}, known, errors) == []
    assert found == {}
    assert errors == [
        "parameter size: size is a connector of a system; inkloop takes values for parameters of components: name "
        "a.length in the parameter set",
        "a connection joins b.y and a.length; inkloop feeds inputs, give parameters a value in a parameter set",
    ]


@pytest.mark.parametrize(
    ("limits", "waits", "stop_s"),
    [
        ({}, {}, 0.5 * (3 * 20 + 1)),
        ({}, {"layer_duration": 2.0, "scan_duration": 6.0}, 0.5 * (3 * 20 + 1) + 8.0 * 20),
        ({"layers_max": 7}, {"scan_duration": 6.0}, 0.5 * (3 * 7 + 1) + 6.0 * 7),
        ({"time_max_s": 50.0}, {"layer_duration": 2.0}, 50.0),
    ],
)
def test_print_should_be_over_after_thrice_its_layers_and_five(
    limits: dict[str, Any], waits: dict[str, float], stop_s: float
) -> None:
    """Of 40 um in full layers of 7.6 um, five; each in three steps and the waits of all parts."""
    job = Job(2, 3, 1e-4, np.array([[0.0, 40e-6, 8e-6]] * 2), np.ones((2, 3), np.bool_))
    tables = SimpleNamespace(run=RunTable(step_s=0.5, **limits))
    scenario: Any = SimpleNamespace(tables=tables, job=lambda: job)
    of = {name: np.asarray(value) for name, value in waits.items()}
    parts = [
        Part("a", Path("a.fmu"), OUT, dict(list(of.items())[:1])),
        Part("b", Path("b.fmu"), OUT, dict(list(of.items())[1:])),
    ]
    assert _stop_s(scenario, {part.name: part for part in parts}) == pytest.approx(stop_s, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("grids", "wanted", "errors"),
    [
        ({"a": (4, 6)}, {"nx": 4, "ny": 6}, []),
        ({"a": (4, 6), "b": None}, {"nx": 4, "ny": 5}, ["a: of a grid of 4 x 6 cells, the scenario in it of 4 x 5"]),
        ({"a": (4, 6), "b": (6, 4), "c": (4, 6)}, {"nx": 4, "ny": 4},
         ["a, c: of a grid of 4 x 6 cells, the scenario in it of 4 x 4",
          "b: of a grid of 6 x 4 cells, the scenario in it of 4 x 4"]),
        ({"a": (4, 6)}, {"nx": 0, "ny": 6}, []),
    ],
)  # fmt: skip
def test_fmus_of_another_grid_than_the_print_are_named(
    grids: dict[str, Any], wanted: dict[str, int], errors: list[str]
) -> None:
    known: Any = {name: SimpleNamespace(fixed_grid=grid) for name, grid in grids.items()}
    text = "[grid]\nnx = {nx}\nny = {ny}\n"
    for found in (
        _grid_errors(known, text.format(**wanted), {}, None),
        _grid_errors(known, text.format(nx=9, ny=9), {f"grid.{edge}": count for edge, count in wanted.items()}, None),
    ):
        assert [error.partition("; ")[0].removesuffix(" cells") for error in found] == [
            error.removesuffix(" cells") for error in errors
        ]


def test_scalars_of_a_wire_to_the_outside_have_the_name_of_its_signal() -> None:
    parts = [Part(name, Path(f"{name}.fmu"), description, {}) for name, description in PORTS.items()]
    both = System("it", "It", parts, (), {}, 0.5, 9.0, "")
    found = [
        list(both.pairs(Wire(source, target, 1.0, 0.0, Transfer())))
        for source, target in ((("a", "y"), ("b", "x")), (("a", "y"), ("", "seen")), (("", "given"), ("b", "x")))
    ]
    assert found == [
        [("y[1]", "x[1]"), ("y[2]", "x[2]")],
        [("y[1]", "seen[1]"), ("y[2]", "seen[2]")],
        [("given[1]", "x[1]"), ("given[2]", "x[2]")],
    ]


def test_parameters_are_written_as_their_types_have_them() -> None:
    values = {"is_on": True, "mode": 2, "count": 3, "g": 2.5, "map": np.arange(6.0).reshape(2, 3)}
    root = ET.fromstring(ssd.parameters(system(values), "2.0"))
    found = {each.attrib["name"]: (each[0].tag.partition("}")[2], dict(each[0].attrib)) for each in root[0]}
    assert found == {
        "b.is_on": ("Boolean", {"value": "true"}),
        "b.mode": ("Enumeration", {"value": "squared", "name": "b.mode"}),
        "b.count": ("Integer", {"value": "3"}),
        "b.g": ("Real", {"value": "2.5", "unit": "um"}),
        "b.map": ("Real", {"value": "0.0 1.0 2.0 3.0 4.0 5.0", "unit": "m"}),
    }
    assert [each.attrib["size"] for each in root[0][-1][1:]] == ["2", "3"]
    (enumeration,) = root[1]
    assert (enumeration.get("name"), {each.get("name"): int(each.get("value", "")) for each in enumeration}) == (
        "b.mode",
        ITEMS,
    )
    assert ssd._text(SET[0], False) == "false"


def test_start_values_replace_those_of_the_description() -> None:
    description = b"""<fmiModelDescription><ModelVariables>
<ScalarVariable name="p"><Real start="1"/></ScalarVariable>
<ScalarVariable name="q"><Boolean start="true"/></ScalarVariable>
<ScalarVariable name="r"><Enumeration declaredType="T" start="1"/></ScalarVariable>
</ModelVariables></fmiModelDescription>"""
    for enumerations in (True, False):
        root = ET.fromstring(_begun(description, {"p": "2.5", "r": "2"}, enumerations))
        p, q, r = (each[0] for each in root.iterfind("ModelVariables/ScalarVariable"))
        assert (p.tag, p.attrib, q.tag, q.attrib) == ("Real", {"start": "2.5"}, "Boolean", {"start": "true"})
        kind, declared = ("Enumeration", {"declaredType": "T"}) if enumerations else ("Integer", {})
        assert (r.tag, r.attrib) == (kind, {**declared, "start": "2"})


GIVER = described(
    2,
    scattered("y", "output", (2,), unit="mm"),
    scattered("seen", "output", (2,)),
    variable("n", "Integer", "output"),
    variable("free", "Integer", "output"),
)
TAKER = described(
    2,
    scattered("x", "input", (2,), unit="m"),
    variable("m", "Integer", "input"),
    variable("on", "Boolean"),
    variable("mode", "Enumeration", items=ITEMS),
    scattered("start", "parameter", (2,)),
)
VALUES = {"on": np.asarray(True), "mode": np.asarray(2), "start": np.array([1.5, 2.0])}
COUNT = Wire(("a", "n"), ("b", "m"), 1.0, 0.0, Transfer(dtype="int32"))
FROM_OUTSIDE = Wire(("", "given"), ("b", "x"), 1.0, 0.0, Transfer())
TO_OUTSIDE = Wire(("a", "y"), ("", "y"), 1.0, 0.0, Transfer())


def joined(*wires: Wire, names: tuple[str, str] = ("a", "b")) -> System:
    """A giver and a taker of scalars, stepped every half second for nine."""
    parts = [Part(names[0], Path("a.fmu"), GIVER, {}), Part(names[1], Path("b.fmu"), TAKER, VALUES)]
    return System("it", "It", parts, wires, {}, 0.5, 9.0, "")


def heights(gain: float, offset: float, factor: float) -> Wire:
    return Wire(("a", "y"), ("b", "x"), gain, offset, Transfer(factor, offset))


def test_maestro_gets_what_its_files_can_say() -> None:
    """It records the outputs that are scalars or connected; enumerations begin in their FMU."""
    tables = maestro_tables(joined(COUNT, FROM_OUTSIDE, TO_OUTSIDE))
    assert tables[MULTI_MODEL] == {
        "fmus": {"{a}": "a.fmu", "{b}": "b.fmu"},
        "connections": {"{a}.a.n": ["{b}.b.m"]},
        "parameters": {"{b}.b.on": True, "{b}.b.start[1]": 1.5, "{b}.b.start[2]": 2.0},
    }
    run = tables[CONFIGURATION]
    assert (run["startTime"], run["endTime"], run["algorithm"]) == (0.0, 9.0, {"type": "fixed-step", "size": 0.5})
    assert run["logVariables"] == {"{a}.a": ["y[1]", "y[2]", "n", "free"], "{b}.b": []}


def test_every_wire_and_name_that_maestro_does_not_know_is_an_error() -> None:
    wires = [heights(*line) for line in ((2.0, 0.0, 2.0), (1.0, 0.5, 1.0), (1.0, 0.0, 1e-3), (1.0, 0.0, 1.0))]
    with pytest.raises(ScenarioError) as caught:
        maestro_tables(joined(*wires))
    assert [error.partition(",")[0] for error in caught.value.errors] == ["a.y to b.x has a gain"] * 3
    with pytest.raises(ScenarioError, match=r"components\.b-2: Maestro takes letters, digits and _ in names") as caught:
        maestro_tables(joined(names=("a_1", "b-2")))
    assert len(caught.value.errors) == 1


def test_libcosim_gets_start_values_steps_and_functions() -> None:
    """A function for each element whose number changes, by the units too; its files know no enumerations."""
    root = ET.fromstring(osp_structure(joined(COUNT, FROM_OUTSIDE, TO_OUTSIDE, heights(2.0, 0.5, 2e-3))))
    texts = [root.findtext(f"{{*}}{name}") for name in ("StartTime", "BaseStepSize", "Algorithm")]
    assert texts == ["0.0", "0.5", "fixedStep"]
    first, second = root.iterfind(".//{*}Simulator")
    assert first.attrib == {"name": "a", "source": "a.fmu", "stepSize": "0.5"}
    assert len(first) == 0
    values = {each.get("variable"): each[0] for each in second.iterfind("{*}InitialValues/{*}InitialValue")}
    assert {name: (value.tag.partition("}")[2], value.get("value")) for name, value in values.items()} == {
        "on": ("Boolean", "true"), "start[1]": ("Real", "1.5"), "start[2]": ("Real", "2.0")
    }  # fmt: skip
    lines = [each.attrib for each in root.iterfind("{*}Functions/{*}LinearTransformation")]
    assert [(line["factor"], line["offset"]) for line in lines] == [("0.002", "0.5")] * 2
    (plain,) = root.iterfind("{*}Connections/{*}VariableConnection")
    assert [each.attrib for each in plain] == [{"simulator": "a", "name": "n"}, {"simulator": "b", "name": "m"}]
    assert len(root.findall("{*}Connections/{*}SignalConnection")) == 4
    assert ET.fromstring(osp_structure(joined(COUNT))).find("{*}Functions") is None


def test_signal_of_the_outside_has_one_connector_however_many_take_it() -> None:
    wires = [FROM_OUTSIDE, Wire(("", "given"), ("c", "x"), 1.0, 0.0, Transfer()), TO_OUTSIDE]
    both = joined(*wires)
    more = replace(both, parts=[*both.parts, Part("c", Path("c.fmu"), TAKER, {})])
    root = ET.fromstring(ssd.description(more, "1.0"))
    found = [(each.get("name"), each.get("kind")) for each in root.iterfind("{*}System/{*}Connectors/{*}Connector")]
    assert found == [("given[1]", "input"), ("given[2]", "input"), ("y[1]", "output"), ("y[2]", "output")]
    assert len(root.findall(".//{*}Connection")) == 6


def test_enumerations_of_an_array_are_written_one_by_one_and_real_numbers_of_32_bits_with_their_unit() -> None:
    known = described(
        3, variable("modes", "Enumeration", items=ITEMS, dimensions=(2,)), variable("f", "Float32", unit="um")
    )
    values = {"modes": np.array([2, 1]), "f": np.asarray(2.5)}
    one = System("it", "It", [Part("b", Path("b.fmu"), known, values)], (), {}, 0.5, 9.0, "")
    root = ET.fromstring(ssd.parameters(one, "2.0"))
    modes, single = root[0]
    assert [each.get("value") for each in modes[0]] == ["squared", "plain"]
    assert modes[0].attrib == {"name": "b.modes"}
    assert (single[0].tag.partition("}")[2], single[0].attrib) == ("Float32", {"value": "2.5", "unit": "um"})


def test_signal_for_the_outside_leaves_as_it_is_and_once() -> None:
    """Whoever takes it there decides; what comes from there is converted here."""
    both = FunctionComponent([Port("u", "mm")], [Port("y", "m")])
    outside = FunctionComponent([Port("x", "mm"), Port("w", "m")], [Port("z", "m")])
    connections = [
        Connection("a.y", "c.x", 2.0, 5.0),
        Connection("c.z", "a.u", 3.0, 1.0),
        Connection("a.y", "c.w"),
        Connection("c.z", "c.w"),
    ]
    found = _wires(connections, {"a": both, "c": outside}, {"a": Part("a", Path("a.fmu"), GIVER, {})})
    assert found == [
        Wire(("a", "y"), ("", "y"), 1.0, 0.0, Transfer()),
        Wire(("", "z"), ("a", "u"), 3.0, 1.0, Transfer(3e3, 1.0)),
    ]


@pytest.mark.parametrize(
    ("of", "value", "changed"),
    [
        (variable("v", start=("2",), dimensions=(2,)), [2.0, 2.0], False),
        (variable("v", start=("2",), dimensions=(2,)), [2.0, 3.0], True),
        (variable("v", start=("1", "2"), dimensions=(2,)), [1.0, 2.0], False),
        (variable("v", start=("1", "2"), dimensions=(2,)), [2.0, 1.0], True),
        (variable("v", start=("1", "2"), dimensions=(3,)), [1.0, 2.0, 3.0], True),
        (variable("v"), 0.0, True),
        (variable("v", "Boolean", start=("true",)), True, False),
        (variable("v", "String", start=("a b",)), "a b", False),
        (variable("v", "String", start=("a b",)), "a", True),
    ],
)
def test_parameters_are_written_where_they_differ_from_the_start_values(
    of: Variable, value: Any, changed: bool
) -> None:
    part = Part("a", Path("a.fmu"), described(3, of), {"v": np.asarray(value)})
    assert ("v" in _with_values(part).values) is changed
