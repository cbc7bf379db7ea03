from __future__ import annotations

import ctypes
import re
import shutil
import zipfile
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, call

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from inkloop.component import Component, Port, Values
from inkloop.errors import ComponentError, FmuError
from inkloop.fmu import FmuComponent, describe
from inkloop.fmu.binding import ERROR, WARNING, Binding
from inkloop.fmu.value_group import Accessor, ValueGroup, is_large
from inkloop.fmu_writer.export import find_fmu
from inkloop.units import defined_unit, unit_conversion
from support.fmus.amplifier import altered, build

pytestmark = pytest.mark.compiled

SECOND = 1_000_000_000
BOTH = pytest.mark.parametrize("fmi", [2, 3])
_X = 'valueReference="{}" causality="input"><Real unit="m" start="{}"'
STARTS = {
    2: [(_X.format(99 + n, 0), _X.format(99 + n, n)) for n in (1, 2, 3)],
    3: [('unit="m" start="0"', 'unit="m" start="1 2 3"')],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("amplifier")


def inputs(*x: float) -> Values:
    return {"x": np.array(x), "on": np.array(True)}


@BOTH
def test_ports_are_the_same_in_fmi_2_and_fmi_3(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    assert isinstance(part, Component)
    assert {port.name: (port.unit, port.shape, port.dtype, port.start) for port in (*part.inputs, *part.outputs)} == {
        "on": ("1", (), "bool", 1.0),
        "x": ("m", (3,), "float64", 0.0),
        "y": ("m", (3,), "float64", 0.0),
        "count": ("1", (), "int32", 0.0),
        "high": ("1", (3,), "bool", 0.0),
    }
    part.terminate()


@BOTH
def test_values_travel_unchanged_in_every_type(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi), parameters={"gain": 3, "mode": "squared"})
    part.initialize(0, inputs(0.0, 0.0, 0.0))
    first = part.do_step(0, SECOND, inputs(0.1, 1.0, 0.3))
    second = part.do_step(SECOND, SECOND, {"on": np.array(False)})
    np.testing.assert_array_equal(first["y"], np.square(3 * np.array([0.1, 1.0, 0.3])))
    assert first["high"].tolist() == [False, True, False]
    assert second["y"].tolist() == [0.0, 0.0, 0.0]
    assert [int(values["count"]) for values in (first, second)] == [1, 2]
    assert [first[name].dtype.name for name in ("y", "high", "count")] == ["float64", "bool", "int32"]
    part.terminate()


@BOTH
def test_outputs_that_stay_are_given_again_and_nothing_can_change_them(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    first, same, other = (
        part.do_step(k * SECOND, SECOND, inputs(x, 0.2, -0.0)) for k, x in enumerate((0.1, 0.1, -0.0))
    )
    assert same["y"] is first["y"]
    assert same["count"] is not first["count"]
    assert [values["y"].tolist() for values in (first, other)] == [[0.2, 0.4, 0.0], [0.0, 0.4, 0.0]]
    for value in (*first.values(), *other.values()):
        with pytest.raises(ValueError, match="read-only"):
            value[...] = 1
        with pytest.raises(ValueError, match="WRITEABLE"):
            value.flags.writeable = True
    part.terminate()


@pytest.mark.parametrize(("fmi", "cells"), [(2, 3), (3, 3), (3, 2)])
def test_start_values_of_an_array_stay_apart(folder: Path, tmp_path: Path, fmi: int, cells: int) -> None:
    """StateSpace of the Reference FMUs has an input that starts as 1 2 3; FMI 2 gives each element its own start."""
    fmu = altered(build(folder, fmi), tmp_path / "starts.fmu", *STARTS[fmi])
    part = FmuComponent(fmu, structural={"n": cells} if fmi == 3 else {})
    start = {port.name: port for port in part.inputs}["x"].start_value()
    assert start.tolist() == ([1.0, 2.0, 3.0] if cells == 3 else [0.0, 0.0])  # a resized array has no known start
    start[0] = 7.0
    assert {port.name: port for port in part.inputs}["x"].start_value()[0] != 7.0
    part.terminate()


@BOTH
def test_restored_state_replays_the_same_bits(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    part.do_step(0, SECOND, inputs(0.1, 0.2, 0.3))
    state = part.save()
    expected = part.do_step(SECOND, SECOND, {})
    other = FmuComponent(build(folder, fmi))
    other.initialize(0, {})
    other.restore(state)
    found = other.do_step(SECOND, SECOND, {})
    assert all(np.array_equal(found[name], expected[name]) for name in expected)
    part.terminate()
    other.terminate()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gian": 1.0}, "gian is no parameter; did you mean gain?"),
        ({"gain": 11.0}, r"gain is 11.0; expected a number in 0 .. 10"),
        ({"x": 1.0}, "x is no parameter"),
    ],
)
@BOTH
def test_wrong_parameter_is_refused_before_anything_starts(
    folder: Path, fmi: int, parameters: dict[str, object], message: str
) -> None:
    with pytest.raises(FmuError, match=message):
        FmuComponent(build(folder, fmi), parameters=parameters)


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (('"x[2]"', '"other"'), "x[2] is missing"),
        (('"x[2]"', '"x[2,1]"'), "they have different numbers of indices"),
        (('"x[2]"', '"x[99999999999999999999]"'), "x[2] is missing"),
        (('"x[2]"', '"x[-1]"'), "they have indices below 0"),
        (('"y[2]"', '"x"'), "there is a variable x"),
        (('valueReference="101" causality="input"', 'valueReference="101" causality="local"'),
         "x[3] has causality input, x[2] has causality local"),
        (('valueReference="101" causality="input"><Real', 'valueReference="101" causality="input"><Real min="1"'),
         "x[3] has minimum none, x[2] has minimum 1"),
        (('valueReference="101" causality="input"><Real unit="m"', 'valueReference="101" causality="input"><Real'),
         "x[3] has unit m, x[2] has unit 1"),
        (('valueReference="101" causality="input"', 'valueReference="101" causality="output"'),
         "x[3] has causality input, x[2] has causality output"),
        (('valueReference="101" causality="input"><Real unit="m" start="0"/>',
          'valueReference="101" causality="input"><Integer start="0"/>'), "x[3] has type Real, x[2] has type Integer"),
        (('valueReference="101" causality="input"><Real', 'valueReference="101" causality="input"><Real max="1"'),
         "x[3] has maximum none, x[2] has maximum 1"),
        (('valueReference="101" causality="input"', 'valueReference="101" causality="input" variability="discrete"'),
         "x[3] has variability continuous, x[2] has variability discrete"),
    ],
)  # fmt: skip
def test_elements_that_are_no_array_stay_single_and_info_says_why(
    folder: Path, tmp_path: Path, change: tuple[str, str], note: str
) -> None:
    found = describe(altered(build(folder, 2), tmp_path / "it.fmu", change))
    assert {"x[1]", "x[3]"} <= found.variables.keys()
    assert found.variables["x[3]"].dimensions == ()
    assert found.variables["high"].dimensions == (3,)
    assert f"note: the elements of x stay single variables: {note}" in list(found.lines())


def test_elements_of_two_enumerations_are_no_array(folder: Path, tmp_path: Path) -> None:
    other = '<SimpleType name="Other"><Enumeration><Item name="low" value="1"/></Enumeration></SimpleType>'
    kind = '<Enumeration declaredType="{}" start="1"/>'
    (note,) = describe(
        altered(
            build(folder, 2),
            tmp_path / "it.fmu",
            ("</TypeDefinitions>", f"{other}</TypeDefinitions>"),
            ('<Real unit="m" start="0"/>', kind.format("Mode")),
            (f'"101" causality="input">{kind.format("Mode")}', f'"101" causality="input">{kind.format("Other")}'),
        )
    ).notes
    assert note.endswith("x[3] has items plain, squared, x[2] has items low")


def test_first_missing_element_of_a_matrix_is_named(folder: Path, tmp_path: Path) -> None:
    """Of two rows of three, whose second index is the faster one."""
    places = [(f'"y[{n}]"', f'"y[{place}]"') for n, place in ((1, "1,1"), (2, "1,2"), (3, "2,3"))]
    (note,) = describe(altered(build(folder, 2), tmp_path / "it.fmu", *places)).notes
    assert note.endswith("y[1,3] is missing")
    (note,) = describe(altered(build(folder, 2), tmp_path / "later.fmu", ('"y[1]"', '"y[4]"'))).notes
    assert note.endswith("y[1] is missing")


def test_element_without_a_start_value_starts_at_0(folder: Path, tmp_path: Path) -> None:
    of_x2 = 'valueReference="101" causality="input"><Real unit="m" start="{}"'
    starts = [*STARTS[2][:1], *STARTS[2][2:], (of_x2.format(0), of_x2.removesuffix(' start="{}"'))]
    found = describe(altered(build(folder, 2), tmp_path / "it.fmu", *starts)).variables
    assert (found["x"].start, found["y"].start) == (("1", "0", "3"), ())


@BOTH
def test_what_a_variable_does_not_state_is_that_of_its_type(folder: Path, tmp_path: Path, fmi: int) -> None:
    stated = 'min="-1" max="4" unit="degC" relativeQuantity="true"'
    types = {2: f'<SimpleType name="Share"><Real {stated}/></SimpleType>', 3: f'<Float64Type name="Share" {stated}/>'}
    units = '<UnitDefinitions><Unit name="degC"><BaseUnit K="1" offset="273.15"/></Unit></UnitDefinitions>'
    defined = ("<TypeDefinitions>", f"{units}<TypeDefinitions>{types[fmi]}")
    for own, limits in ((' max="3"', ("-1", "3")), (' min="0"', ("0", "4"))):
        of_type = (' start="2" min="0" max="10"', f' start="2"{own} declaredType="Share"')
        path = altered(build(folder, fmi), tmp_path / f"{limits[0]}.fmu", defined, of_type)
        found = describe(path).variables["gain"]
        assert (found.minimum, found.maximum, found.unit) == (*limits, "degC")
        assert unit_conversion(found.unit, defined_unit("K", {"K": 1}, 1.0, 0.0)) == (1.0, 0.0)


def test_size_may_stand_behind_what_it_sizes_and_one_of_nothing_without_a_start(folder: Path, tmp_path: Path) -> None:
    behind = altered(build(folder, 3), tmp_path / "it.fmu", (_N, ""), ("</ModelVariables>", f"{_N}</ModelVariables>"))
    assert describe(behind).grid is None
    assert [port.shape for port in describe(behind).ports("output", {"n": 4})] == [(), (4,), (4,)]
    bare = _N.replace(' start="3"', "").replace('"n" valueReference="1"', '"m" valueReference="8"')
    assert describe(altered(build(folder, 3), tmp_path / "bare.fmu", (_N, _N + bare))).default_sizes == {"n": 3}


def test_platform_is_a_folder_with_a_file(folder: Path, tmp_path: Path) -> None:
    path = shutil.copyfile(build(folder, 3), tmp_path / "it.fmu")
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("binaries/readme.txt", "")
        archive.writestr("binaries/aarch64-linux/amplifier.so", "")
    assert describe(path).platforms == tuple(sorted(["aarch64-linux", fmpy.platform_tuple]))


def test_first_map_of_the_inputs_is_the_grid(folder: Path, tmp_path: Path) -> None:
    """An output of another form counts where no input is a map."""
    maps = [(f'"{name}[{n}]"', f'"{name}[{place}]"') for name, places in (("y", "n,1"), ("x", "1,n")) for n in (1, 2, 3)
            for place in [places.replace("n", str(n))]]  # fmt: skip
    assert describe(altered(build(folder, 2), tmp_path / "both.fmu", *maps)).grid == (1, 3)
    assert describe(altered(build(folder, 2), tmp_path / "one.fmu", *maps[:3])).grid == (3, 1)


def test_variables_that_differ_in_numbers_alone_share_a_row_from_nine_on(folder: Path, tmp_path: Path) -> None:
    def info(count: int) -> list[str]:
        more = "".join(f'<Float64 name="s{n}" valueReference="{500 + n}" causality="input"/>' for n in range(count))
        path = tmp_path / f"{count}.fmu"
        found = describe(altered(build(folder, 3), path, ("</ModelVariables>", f"{more}</ModelVariables>")))
        return [line for line in found.lines() if line.startswith("  s") and line.endswith("  Float64")]

    assert [line.split()[0] for line in info(8)] == [f"s{n}" for n in range(8)]
    assert info(9) == ["  s0 to s8 (9)  Float64"]


def test_fmu_begins_at_the_time_of_the_master(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    part, binding = FmuComponent(build(folder, 3)), MagicMock()
    monkeypatch.setattr(part, "_start", lambda: binding)
    part.initialize(5 * SECOND // 2, {})
    binding.enter_initialization.assert_called_once_with(2.5)
    part.terminate()


def test_values_that_are_no_inputs_are_left_alone(folder: Path) -> None:
    with begun(folder, 3) as part:
        found = part.do_step(0, SECOND, {"on": np.array(False), "gain": np.array(5.0)})
        assert found["y"].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("true", ["true", "1"])
def test_differences_and_levels_are_no_array(folder: Path, tmp_path: Path, true: str) -> None:
    units = '<UnitDefinitions><Unit name="m"><BaseUnit m="1" offset="2"/></Unit></UnitDefinitions><TypeDefinitions>'
    of_x2 = 'valueReference="101" causality="input"><Real'
    changes = ("<TypeDefinitions>", units), (of_x2, of_x2 + f' relativeQuantity="{true}"')
    (note,) = describe(altered(build(folder, 2), tmp_path / "it.fmu", *changes)).notes
    assert note.endswith("one of x[3] and x[2] is a difference (relativeQuantity)")


_N = '<UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed" start="3"/>'


@pytest.mark.parametrize(
    ("fmi", "change", "fault"),
    [
        (2, ('unit="m" start="0"', 'unit="m" start="1,5"'), "x has the start value '1,5'; expected Real"),
        (2, ('name="x[2]"', 'name="x[1]"'), "two variables are called"),
        (2, ('name="x[2]"', 'name=""'), "a variable has no name"),
        (2, ('min="0"', 'min="a"'), "gain has the limit 'a'; expected Real"),
        (3, ('causality="input" start="true"', 'causality="input" start="yes"'),
         "on has the start value 'yes'; expected Boolean"),
        (3, ('start="0">', 'start="1 2">'), "x has 2 start values for 3"),
        (3, ('<Int32 name="count"',
             '<UInt8 name="c" valueReference="9" causality="input" start="256"/><Int32 name="count"'),
         "c has the start value '256'; expected UInt8"),
        (3, (_N, _N.replace("structuralParameter", "parameter")), "x has the dimension 'n', which is no constant"),
        (3, ('"input" unit="m" start="0"><Dimension valueReference="1"/>',
             '"input" unit="m" start="0"><Dimension start="9999999999"/><Dimension start="9999999999"/>'),
         "x of 9999999999 x 9999999999 values needs about"),
        (3, ('"input" unit="m" start="0"><Dimension valueReference="1"/>',
             '"input" unit="m" start="0"><Dimension start="-3"/>'), "x has the dimensions -3"),
        (3, ('<Dimension valueReference="1"/>', '<Dimension valueReference="77"/>'),
         "no variable has the valueReference 77"),
        (3, ("<TypeDefinitions>", '<UnitDefinitions><Unit name="m"><BaseUnit m="1" factor="0"/></Unit>'
             "</UnitDefinitions><TypeDefinitions>"), "unit 'm' has factor 0.0"),
    ],
)  # fmt: skip
def test_description_that_contradicts_itself_is_refused(
    folder: Path, tmp_path: Path, fmi: int, change: tuple[str, str], fault: str
) -> None:
    with pytest.raises(FmuError, match=f"^{re.escape(str(tmp_path))}.*{re.escape(fault)}"):
        describe(altered(build(folder, fmi), tmp_path / "it.fmu", change))


def test_constant_is_the_length_of_a_dimension(folder: Path, tmp_path: Path) -> None:
    constant = _N.replace("structuralParameter", "local").replace("fixed", "constant")
    found = describe(altered(build(folder, 3), tmp_path / "it.fmu", (_N, constant)))
    assert found.variables["x"].dimensions == (3,)


def test_matrix_of_others_is_no_grid_that_must_fit(folder: Path, tmp_path: Path) -> None:
    matrix = [(f'"y[{n}]"', f'"y[{n},1]"') for n in (1, 2, 3)]
    path = altered(build(folder, 2), tmp_path / "it.fmu", *matrix)
    assert describe(path).grid == (3, 1)
    assert describe(path).sizes({"nx": 9, "ny": 9}) == {}


def test_names_without_a_convention_are_not_joined(folder: Path, tmp_path: Path) -> None:
    flat = altered(build(folder, 2), tmp_path / "flat.fmu", (' variableNamingConvention="structured"', ""))
    found = describe(flat)
    assert {"x[1]", "x[2]", "x[3]"} <= found.variables.keys()
    assert not found.notes


def test_time_of_a_whole_second_is_whole(folder: Path) -> None:
    part = FmuComponent(build(folder, 3))
    part._binding = binding = MagicMock()
    for second in range(2000):
        part.do_step(second * SECOND, SECOND // 10, {})
    assert [each.args for each in binding.do_step.mock_calls] == [(float(second), 0.1) for second in range(2000)]
    part.terminate()


@BOTH
def test_instance_has_the_name_of_its_component_and_a_text_reaches_it(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi), name="left", parameters={"label": "Grüße, zwei Worte"})
    part.initialize(0, inputs(100.0, 0.0, 0.0))
    with pytest.raises(ComponentError, match=r"too difficult for left \(Grüße, zwei Worte\)"):
        part.do_step(0, SECOND, {})
    part.terminate()
    with pytest.raises(FmuError, match="label is 5; expected a text"):
        FmuComponent(build(folder, fmi), parameters={"label": 5})


@BOTH
def test_what_the_master_cannot_use_is_shown(folder: Path, tmp_path: Path, fmi: int) -> None:
    flags = ('modelIdentifier="amplifier"', 'modelIdentifier="amplifier" canBeInstantiatedOnlyOncePerProcess="true" '
             'needsExecutionTool="true"')  # fmt: skip
    texts = {
        2: ('name="label" valueReference="7" causality="parameter" variability="fixed"',
            'name="label" valueReference="7" causality="output" variability="discrete"'),
        3: ('<Float64 name="gain"', '<Clock name="tick" valueReference="8" causality="input" '
            'intervalVariability="triggered"/><Binary name="frame" valueReference="9" causality="output" clocks="8"/>'
            '<Float64 name="at_tick" valueReference="10" causality="output" clocks="8"/><Float64 name="gain"'),
    }  # fmt: skip
    found = describe(altered(build(folder, fmi), tmp_path / "it.fmu", flags, texts[fmi]))
    lines = list(found.lines())
    assert "  instances  one in a process" in lines
    assert "  needs      the tool that made it, on this machine" in lines
    shown = {
        2: ["  label  String output"],
        3: ["  tick     Clock input", "  frame    Binary output, at ticks of tick",
            "  at_tick  Float64 output, at ticks of tick"],
    }[fmi]  # fmt: skip
    assert lines[-len(shown) :] == shown
    assert not {"tick", "frame", "at_tick"} & found.variables.keys()


def test_binary_that_cannot_be_loaded_is_reported(folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.fmu"
    with zipfile.ZipFile(build(folder, 3)) as good, zipfile.ZipFile(broken, "w") as bad:
        for name in good.namelist():
            bad.writestr(name, good.read(name) if name.endswith(".xml") else b"not a library")
    part = FmuComponent(broken)
    here = Path.cwd()
    with pytest.raises(FmuError, match="the binary cannot be loaded"):
        part.initialize(0, {})
    assert Path.cwd() == here
    part.terminate()


@BOTH
def test_description_for_a_person_names_every_variable(folder: Path, fmi: int) -> None:
    text = "\n".join(describe(build(folder, fmi)).lines())
    assert text.startswith(f"Amplifier  FMI {fmi} co-simulation")
    for name in ("on", "x", "y", "count", "high", "gain", "mode"):
        assert f"\n  {name} " in text
    sections = re.findall(r"^(inputs|outputs|parameters)\n((?:  .*\n?)+)", text, re.MULTILINE)
    below = {title: {line.split()[0] for line in lines.splitlines()} for title, lines in sections}
    assert (below["inputs"], below["outputs"]) == ({"on", "x"}, {"y", "count", "high"})
    assert below["parameters"] >= {"gain", "mode"}
    real, size = ("Real", "3") if fmi == 2 else ("Float64", "n")
    for line in (
        "  on  Boolean = true",
        f"  x   {real} ({size}) [m] = 0",
        f"  y      {real} ({size}) [m]",
        "  state      can be saved and restored",
        "  licence    none",
        f"  count  {'Integer' if fmi == 2 else 'Int32'}",
        f"  gain   {real} = 2",
        "  mode   Enumeration = 1 {1 plain, 2 squared}",
        "  Foreign FMU",
        "  grid       none",
        f"  platforms  {'linux64' if fmi == 2 else 'x86_64-linux'}",
        "  step size  fixed",
        "  made by    gcc",
    ):
        assert f"\n{line}\n" in f"{text}\n"


@BOTH
def test_input_that_stays_is_handed_over_again_after_others_and_after_a_restored_state(folder: Path, fmi: int) -> None:
    """An input is not set again while the FMU has it; what it has changes with part of the inputs, and with a state."""
    part = FmuComponent(build(folder, fmi), parameters={"gain": 1})
    part.initialize(0, inputs(0.0, 0.0, 0.0))
    state = part.save()
    steps = [inputs(1.0, 2.0, 3.0), {"on": np.array(False)}, inputs(1.0, 2.0, 3.0), None, inputs(1.0, 2.0, 3.0)]
    found = []
    for number, values in enumerate(steps):
        if values is None:
            part.restore(state)
        else:
            found.append(part.do_step(number * SECOND, SECOND, values)["y"].tolist())
    assert found == [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]
    part.terminate()


def test_small_values_and_large_maps_arrive_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """A large map goes by its own pointer, a small one through a record."""
    pattern = (np.arange(81).reshape(9, 9) % 3).astype(np.int32)
    found = {}
    for limit in (1, 1 << 20):
        monkeypatch.setattr("inkloop.fmu.value_group.LARGE_BYTES", limit)
        part = FmuComponent(find_fmu("LayerDeposition"), parameters={"h1_b": 1e-5, "height_start": pattern * 1e-6})
        values = {port.name: port.start_value() for port in part.inputs}
        part.initialize(0, values)
        values |= {"pattern": pattern.T.astype(np.int32), "layer_command": np.int32(1)}
        outputs = part.do_step(0, SECOND, values)
        assert not any(value.flags.writeable for value in outputs.values())
        found[limit] = {**outputs, "state": np.frombuffer(part.save(), np.uint8)}
        part.terminate()
    for name in found[1]:
        np.testing.assert_array_equal(found[1][name], found[1 << 20][name], err_msg=name)
    assert found[1]["height"][1, 0] > found[1]["height"][0, 0]


def bound(fmu: Any) -> Binding:
    """The binding of an FMU that a test states."""
    binding: Any = object.__new__(Binding)
    binding._fmi, binding._messages, binding._fmu = 3, deque(), fmu
    binding._grouped, binding.worst = {}, 0
    return binding


def test_warnings_of_an_fmu_are_logged_and_what_stops_it_is_in_the_error(caplog: pytest.LogCaptureFixture) -> None:
    binding = bound(MagicMock(instanceName="lamp"))
    for status, text in ((0, b"fine"), (WARNING, b" warm\n"), (ERROR, b"hot")):
        binding._hear(status, text)
    assert [record.getMessage() for record in caplog.records] == ["lamp: warm"]
    assert binding._recent_messages() == ": hot"


def test_step_that_returns_early_ends_where_it_was_to_end() -> None:
    """An FMU that stops at 100 s and at 250 s on the way to 300 s."""
    asked, stops = list[tuple[float, float]](), iter([100.0, 250.0])

    def step(time: float, length: float) -> tuple[bool, bool, bool, float]:
        asked.append((time, length))
        reached = next(stops, time + length)
        return False, False, reached < 300.0, reached

    binding: Any = object.__new__(Binding)
    binding._fmi, binding._messages, binding._fmu = 3, deque(), SimpleNamespace(doStep=step)
    binding.do_step(0.0, 300.0)
    assert asked == [(0.0, 300.0), (100.0, 200.0), (250.0, 50.0)]


def test_step_that_stays_where_it_began_is_an_error_and_one_that_is_over_early_by_its_own_words_is_not() -> None:
    reached = iter([(False, False, True, 300.0), (False, False, True, 0.0)])
    binding: Any = object.__new__(Binding)
    binding._fmi, binding._messages = 3, deque()
    binding._fmu = SimpleNamespace(doStep=lambda time, length: next(reached))
    assert binding.do_step(0.0, 300.0) is False
    with pytest.raises(ComponentError, match="fmi3DoStep returned early at 0 s, where the step began"):
        binding.do_step(0.0, 300.0)


@pytest.mark.parametrize(("statuses", "calls"), [((2,), "tf"), ((3,), "f"), ((4,), ""), ((3, 2), "f"), ((4, 3), "")])
def test_instance_is_ended_and_freed_as_far_as_its_worst_answer_allows(statuses: tuple[int, ...], calls: str) -> None:
    """After an error the standard forbids to terminate it, after a fatal one to free it."""
    fmu = MagicMock()
    binding = bound(fmu)
    for status in statuses:
        binding._error(status, None, "fmi3DoStep")
    binding.terminate()
    binding.free()
    assert (fmu.terminate.call_count, fmu.fmi3FreeInstance.call_count) == ("t" in calls, "f" in calls)


def test_messages_of_a_step_are_those_since_it_began() -> None:
    binding = bound(MagicMock(doStep=MagicMock(side_effect=FMICallException("fmi3DoStep", 3))))
    binding._hear(0, b"of the start")
    with pytest.raises(ComponentError, match=r"^fmi3DoStep returned an error without a message$"):
        binding.do_step(0.0, 1.0)
    for status, text in ((0, b"fmi3DoStep: cold"), (WARNING, b"warm")):
        binding._hear(status, text)
    assert binding._recent_messages("fmi3DoStep") == ": cold; warm"
    assert binding._recent_messages() == " without a message"


def test_values_that_were_not_taken_without_a_word_are_set_again() -> None:
    """Refused ones may have been taken in part; those with a warning may be other ones in the FMU."""
    statuses, given = iter([0, 2, 0, 1, 0]), list[float]()

    def setter(component: int, references: object, count: int, values: int) -> int:
        given.append(ctypes.c_double.from_address(values).value)
        return next(statuses)

    def getter(component: int, references: object, count: int, values: int) -> int:
        ctypes.c_double.from_address(values).value = 1.0
        return 0

    group = ValueGroup([Port("x")], "float64", [1], Accessor("fmi2SetReal", setter), Accessor("fmi2GetReal", getter))
    set_to = [1.0, -1.0, 1.0, 1.0, 4.0, 4.0, 4.0]
    assert [group.set(0, {"x": np.array(value)}) for value in set_to] == [0, 2, 0, 0, 1, 0, 0]
    assert given == [1.0, -1.0, 1.0, 4.0, 4.0]
    assert float(group.get(0)[1]["x"]) == 1.0
    statuses = iter([0])
    group.set(0, {"x": np.array(4.0)})
    assert given == [1.0, -1.0, 1.0, 4.0, 4.0, 4.0]


@pytest.mark.parametrize(("cells", "large"), [((1 << 17) - 1, False), (1 << 17, True)])
def test_map_of_a_mebibyte_forms_a_group_of_its_own(cells: int, large: bool) -> None:
    assert is_large(Port("height", "m", (cells, 1))) is large


@contextmanager
def begun(folder: Path, fmi: int, **options: Any) -> Iterator[FmuComponent]:
    part = FmuComponent(build(folder, fmi), **options)
    part.initialize(0, {})
    try:
        yield part
    finally:
        part.terminate()


def test_structural_parameters_resize_arrays_and_switch_the_form_of_the_model(folder: Path) -> None:
    with begun(folder, 3, structural={"n": 5}) as part:
        assert [port.shape for port in part.outputs if port.name in ("y", "high")] == [(5,), (5,)]
        np.testing.assert_array_equal(part.do_step(0, SECOND, inputs(1, 2, 3, 4, 5))["y"], [2, 4, 6, 8, 10])
    with begun(folder, 3, parameters={"half": True}, structural={"n": 2}) as part:
        assert part.do_step(0, SECOND, inputs(1, 2))["y"].tolist() == [1.0, 2.0]
    with pytest.raises(FmuError, match="half is 1; expected true or false"):
        FmuComponent(build(folder, 3), parameters={"half": 1})
    with pytest.raises(FmuError, match="m is no structural parameter of Amplifier; known: n"):
        FmuComponent(build(folder, 3), structural={"m": 4})
    with pytest.raises(FmuError, match="n is no structural parameter of Amplifier; it has none"):
        FmuComponent(build(folder, 2), structural={"n": 4})


@BOTH
@pytest.mark.parametrize(
    ("seconds", "x", "message"),
    [
        (
            1,
            (-1, -1, 1),
            r"^x: fmi\dSet\w+ returned discard: x is negative( \(3 cells\))?$",
        ),  # the text of FMI 2 is filled
        (1, (100, 1, 1), r"^fmi\dDoStep returned discard: step is too difficult"),
        (1, (1, 2), r"x takes 3, found 2"),
        (500, (1, 1, 1), r"^the FMU asks to end the simulation"),
        (2_000, (1, 1, 1), r"DoStep returned an error: step is too long"),
        (2_000_000, (1, 1, 1), r"DoStep returned a fatal error: step is too long"),
    ],
)
def test_refusal_is_reported_and_everything_is_removed(
    folder: Path, fmi: int, seconds: int, x: tuple[float, ...], message: str
) -> None:
    with begun(folder, fmi) as part, begun(folder, fmi):
        files = part._folder
        with pytest.raises(ComponentError, match=message):
            part.do_step(0, seconds * SECOND, inputs(*x))
        if "Set" in message:  # the instance continues
            np.testing.assert_array_equal(part.do_step(0, SECOND, inputs(1, 1, 1))["y"], [2, 2, 2])
        assert files.exists()
    assert not files.exists()
    with pytest.raises(ComponentError, match=r"before it was initialized or after its end"):
        part.do_step(0, SECOND, {})


def test_step_that_returns_early_is_completed(folder: Path) -> None:
    with begun(folder, 3) as part:
        assert int(part.do_step(0, 300 * SECOND, inputs(1, 1, 1))["count"]) == 2


def rewritten(fmu: Path, path: Path, change: Callable[[str], str]) -> Path:
    """A copy of an FMU with another description."""
    with zipfile.ZipFile(fmu) as ours, zipfile.ZipFile(path, "w") as theirs:
        for name in ours.namelist():
            content = ours.read(name)
            theirs.writestr(name, change(content.decode()) if name == "modelDescription.xml" else content)
    return path


def test_elements_make_an_array_counted_from_1_or_0(folder: Path, tmp_path: Path) -> None:
    def from_0(text: str) -> str:
        return re.sub(r"\[(\d)\]", lambda match: f"[{int(match[1]) - 1}]", text)

    x = describe(rewritten(build(folder, 2), tmp_path / "from0.fmu", from_0)).variables["x"]
    assert x.references == describe(build(folder, 2)).variables["x"].references
    assert x.elements == ("x[0]", "x[1]", "x[2]")


def test_archive_packed_with_backslashes_is_refused(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "windows.fmu"
    with zipfile.ZipFile(build(folder, 2)) as ours, zipfile.ZipFile(path, "w") as theirs:
        for name in ours.namelist():
            theirs.writestr(zipfile.ZipInfo(name.replace("/", "\\")), ours.read(name))
    with pytest.raises(FmuError, match="its members are named with backslashes; pack it again"):
        describe(path)


@pytest.mark.parametrize("name", ["../../../amplifier", "", "a/b", "1a", "größe"])
def test_library_lies_in_the_archive(name: str, folder: Path, tmp_path: Path) -> None:
    elsewhere = ('modelIdentifier="amplifier"', f'modelIdentifier="{name}"')
    with pytest.raises(FmuError, match=f"its modelIdentifier is '{name}'; FMI takes letters, digits and _"):
        describe(altered(build(folder, 3), tmp_path / "it.fmu", elsewhere))


def test_model_exchange_only_is_reported(folder: Path, tmp_path: Path) -> None:
    def without(text: str) -> str:
        start, end = text.index("<CoSimulation"), text.index("<TypeDefinitions")
        return text[:start] + '<ModelExchange modelIdentifier="amplifier"/>' + text[end:]

    with pytest.raises(FmuError, match="offers model exchange only; export it for co-simulation"):
        describe(rewritten(build(folder, 3), tmp_path / "me.fmu", without))


@BOTH
def test_description_says_whether_a_state_can_be_saved_and_shows_one_start_value(
    folder: Path, tmp_path: Path, fmi: int
) -> None:
    def without(text: str) -> str:
        return re.sub(r'canSerializeFMU[sS]tate="true"', "", text)

    other = rewritten(build(folder, fmi), tmp_path / "it.fmu", without)
    assert (describe(build(folder, fmi)).can_serialize, describe(other).can_serialize) == (True, False)
    assert "  state      cannot be saved" in list(describe(other).lines())
    started = altered(build(folder, 3), tmp_path / "starts.fmu", *STARTS[3])
    assert "  x   Float64 (n) [m]" in list(describe(started).lines())


@pytest.mark.parametrize(
    ("fails", "freed"),
    [("getFMUState", 0), ("fmi3SerializedFMUStateSize", 1), ("fmi3SerializeFMUState", 1), ("setFMUState", 1), ("", 1)],
)
def test_state_is_freed_once_also_where_it_cannot_be_saved_or_restored(fails: str, freed: int) -> None:
    fmu = MagicMock()
    if fails:
        getattr(fmu, fails).side_effect = FMICallException(fails, 3)
    with pytest.raises(ComponentError, match=f"{fails} returned an error") if fails else nullcontext():
        bound(fmu).restore(b"state") if fails in ("setFMUState", "") else bound(fmu).save()
    assert fmu.freeFMUState.call_count == freed
    for each in fmu.fmi3DeserializeFMUState.mock_calls:
        component, pointer, size, made = each.args
        assert component is fmu.component
        assert ctypes.string_at(pointer, size) == b"state"
        fmu.setFMUState.assert_called_once_with(made._obj)
        assert fmu.freeFMUState.mock_calls == [call(made._obj)]
