"""Values and wires of an .ssp in both directions: units, Booleans, arrays, prefixes; FMUs are descriptions alone."""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.exchange.ssp import contents, ssd
from inkloop.exchange.ssp.folder import _begun
from inkloop.exchange.ssp.system import Part, System, Wire
from inkloop.fmu import FmuDescription, Variable
from inkloop.master.wiring import Transfer

NAMES = " ".join(
    f'xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{long}"'
    for short, long in (("ssd", "Description"), ("ssc", "Common"), ("ssv", "ParameterValues"))
)
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
    variable("count", "Int32"),
    variable("map", unit="m", dimensions=(2, 3)),
    scattered("start", "parameter", (2, 2), start=("1", "2", "3", "4")),
    scattered("bare", "parameter", (2, 2), start=("7",)),
)
KNOWN = {"a": described(2, *PARAMETERS)}


def read(*entries: str, prefix: str = "", files: dict[str, str] | None = None, more: str = "") -> tuple[Any, list[str]]:
    """The parameters of a component, and the errors."""
    bound = f"""<ssd:ParameterBinding prefix="{prefix}"><ssd:ParameterValues><ssv:ParameterSet><ssv:Parameters>
{"".join(entries)}</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>{more}"""
    system = ET.fromstring(f"<ssd:System {NAMES}><ssd:ParameterBindings>{bound}</ssd:ParameterBindings></ssd:System>")
    content, errors = io.BytesIO(), list[str]()
    with zipfile.ZipFile(content, "w") as archive:
        for name, text in (files or {}).items():
            archive.writestr(name, text)
        found = contents.parameters(system, archive, KNOWN, errors)
    return found.get("a", {}), errors


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


def test_file_that_is_no_parameter_set_is_reported() -> None:
    other = f"<x {NAMES}><ssv:Parameters>{entry('a.length', '3')}</ssv:Parameters></x>"
    files = {"a b.ssv": other, "good.ssv": f"<ssv:ParameterSet {NAMES}><ssv:Parameters>{entry('a.count', '4')}"
             "</ssv:Parameters></ssv:ParameterSet>"}  # fmt: skip
    more = '<ssd:ParameterBinding source="a%20b.ssv"/><ssd:ParameterBinding source="./good.ssv"/>'
    found, errors = read(files=files, more=more)
    assert errors == ["parameters 'a%20b.ssv' are no parameter set of SSP, but <x>"]
    assert found == {"count": 4}


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
    system = ET.fromstring(f"<ssd:System {NAMES}><ssd:Connections>{elements}{outside}</ssd:Connections></ssd:System>")
    errors: list[str] = []
    return contents.connections(system, ports or PORTS, errors), errors


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
        (BOTH, {"inside": line('factor="x"')}, "from a.y to b.x: factor 'x', offset None; expected numbers"),
    ],
)
def test_wire_that_no_scenario_has_is_reported(connections: Any, options: Any, message: str) -> None:
    _, errors = wired(*connections, **options)
    assert message in errors[0]


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
        "h": ("output", "mm"), "steps": ("output", None), "strange": ("output", None), "mode": ("output",),
        "x": ("input", "m"),
    }  # fmt: skip
    units = {each.attrib["name"]: each[0].attrib for each in root.iterfind("{*}Units/{*}Unit")}
    assert units["mm"] == {"m": "1", "factor": "0.001"}
    assert units["m"] == {"m": "1", "factor": "1.0"}
    (moved, plain) = root.iterfind(".//{*}Connection")
    assert [each.attrib for each in moved] == [{"factor": "1.0", "offset": "2.5"}]
    assert len(plain) == 0
    assert plain.attrib == {"startConnector": "steps", "endElement": "a", "endConnector": "x"}


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
        "b.mode": ("Enumeration", {"value": "squared"}),
        "b.count": ("Int32", {"value": "3"}),
        "b.g": ("Float64", {"value": "2.5", "unit": "um"}),
        "b.map": ("Float64", {"value": "0.0 1.0 2.0 3.0 4.0 5.0", "unit": "m"}),
    }
    assert [each.attrib["size"] for each in root[0][-1][1:]] == ["2", "3"]
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
