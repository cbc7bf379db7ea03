from __future__ import annotations

import ctypes
import re
import zipfile
from collections import deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, call
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from inkloop.component import Component, Values
from inkloop.errors import ComponentError, FmuError
from inkloop.fmu import FmuComponent, describe
from inkloop.fmu.binding import Binding
from inkloop.fmu_writer.export import find_fmu
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


@BOTH
def test_outputs_of_an_earlier_step_stay_as_they_were(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    kept = [part.do_step(k * SECOND, SECOND, inputs(k, k, k)) for k in range(4)]
    assert [values["y"].tolist() for values in kept] == [[2.0 * k] * 3 for k in range(4)]
    part.terminate()


def test_structural_parameter_resizes_every_array_that_it_rules(folder: Path) -> None:
    part = FmuComponent(build(folder, 3), structural={"n": 5})
    assert [port.shape for port in part.outputs if port.name in ("y", "high")] == [(5,), (5,)]
    part.initialize(0, {})
    np.testing.assert_array_equal(part.do_step(0, SECOND, inputs(1, 2, 3, 4, 5))["y"], [2, 4, 6, 8, 10])
    part.terminate()


@BOTH
def test_refused_value_gives_the_message_of_the_fmu_and_the_instance_continues(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    with pytest.raises(ComponentError, match=r"^x: fmi\dSet\w+ returned discard: x is negative"):
        part.do_step(0, SECOND, inputs(1, -1, 1))
    np.testing.assert_array_equal(part.do_step(0, SECOND, inputs(1, 1, 1))["y"], [2, 2, 2])
    part.terminate()


def test_message_of_an_fmi_2_logger_is_formatted(folder: Path) -> None:
    part, other = FmuComponent(build(folder, 2)), FmuComponent(build(folder, 2))
    part.initialize(0, {})
    other.initialize(0, {})
    with pytest.raises(ComponentError, match=r"x is negative \(3 cells\)$"):
        part.do_step(0, SECOND, inputs(-1, 1, 1))
    part.terminate()
    other.terminate()


@BOTH
def test_step_that_is_discarded_is_no_request_to_end(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    with pytest.raises(ComponentError, match=r"^fmi\dDoStep returned discard: step is too difficult"):
        part.do_step(0, SECOND, inputs(100, 1, 1))
    part.terminate()


@BOTH
def test_fmu_that_ends_the_simulation_says_so(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    with pytest.raises(ComponentError, match=r"^the FMU asks to end the simulation"):
        part.do_step(0, 500 * SECOND, inputs(1, 1, 1))
    part.terminate()


def test_step_that_returns_early_is_completed(folder: Path) -> None:
    part = FmuComponent(build(folder, 3))
    part.initialize(0, {})
    assert int(part.do_step(0, 300 * SECOND, inputs(1, 1, 1))["count"]) == 2
    part.terminate()


def test_structural_switch_is_set_in_configuration_mode(folder: Path) -> None:
    part = FmuComponent(build(folder, 3), parameters={"half": True}, structural={"n": 2})
    part.initialize(0, {})
    assert part.do_step(0, SECOND, inputs(1, 2))["y"].tolist() == [1.0, 2.0]
    part.terminate()
    with pytest.raises(FmuError, match="half is 1; expected true or false"):
        FmuComponent(build(folder, 3), parameters={"half": 1})


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
@pytest.mark.parametrize(("seconds", "message"), [(2_000, "an error"), (2_000_000, "a fatal error")])
def test_failed_step_is_reported_and_everything_is_removed(folder: Path, fmi: int, seconds: int, message: str) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    files = part._folder
    with pytest.raises(ComponentError, match=rf"DoStep returned {message}: step is too long"):
        part.do_step(0, seconds * SECOND, {})
    assert files.exists()
    part.terminate()
    assert not files.exists()


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


@BOTH
def test_array_of_another_shape_is_refused(folder: Path, fmi: int) -> None:
    part = FmuComponent(build(folder, fmi))
    part.initialize(0, {})
    with pytest.raises(ComponentError, match="x takes 3, found 2"):
        part.do_step(0, SECOND, inputs(1, 2))
    part.terminate()


def test_use_before_initialization_is_refused(folder: Path) -> None:
    part = FmuComponent(build(folder, 3))
    with pytest.raises(ComponentError, match="before it was initialized"):
        part.do_step(0, SECOND, {})
    part.terminate()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gian": 1.0}, "gian is no parameter; did you mean gain?"),
        ({"gain": 11.0}, r"gain is 11.0; expected a number in 0 .. 10"),
        ({"gain": "high"}, "gain is 'high'; expected a number"),
        ({"gain": float("nan")}, "gain is nan; expected a number"),
        ({"gain": [1.0, 2.0]}, "gain is 2 values from 1.0 to 2.0; expected a number"),
        ({"mode": "cubed"}, r"mode is 'cubed'; expected one of 'plain' \(1\), 'squared' \(2\)"),
        ({"mode": 3}, r"mode is 3; expected one of 'plain' \(1\), 'squared' \(2\)"),
        ({"x": 1.0}, "x is no parameter"),
    ],
)
@BOTH
def test_wrong_parameter_is_refused_before_anything_starts(
    folder: Path, fmi: int, parameters: dict[str, object], message: str
) -> None:
    with pytest.raises(FmuError, match=message):
        FmuComponent(build(folder, fmi), parameters=parameters)


def test_unknown_structural_parameter_is_refused(folder: Path) -> None:
    with pytest.raises(FmuError, match="m is no structural parameter of Amplifier; known: n"):
        FmuComponent(build(folder, 3), structural={"m": 4})
    with pytest.raises(FmuError, match="n is no structural parameter of Amplifier; it has none"):
        FmuComponent(build(folder, 2), structural={"n": 4})


def test_damaged_binary_is_reported_when_it_is_unpacked(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "damaged.fmu"
    content = bytearray(build(folder, 2).read_bytes())
    content[content.index(b"\x7fELF") + 40] ^= 0xFF
    path.write_bytes(bytes(content))
    with pytest.raises(FmuError, match=r"damaged\.fmu: cannot be unpacked, it is damaged: Bad CRC"):
        FmuComponent(path)


def test_elements_counted_from_0_make_the_same_array(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "from0.fmu"
    with zipfile.ZipFile(build(folder, 2)) as ours, zipfile.ZipFile(path, "w") as theirs:
        text = ours.read("modelDescription.xml").decode()
        theirs.writestr("modelDescription.xml", re.sub(r"\[(\d)\]", lambda match: f"[{int(match[1]) - 1}]", text))
    x = describe(path).variables["x"]
    assert x.references == describe(build(folder, 2)).variables["x"].references
    assert x.elements == ("x[0]", "x[1]", "x[2]")


@pytest.mark.parametrize(
    ("change", "note"),
    [
        (('"x[2]"', '"other"'), "x[2] is missing"),
        (('"x[2]"', '"x[2,1]"'), "they have different numbers of indices"),
        (('"y[2]"', '"x"'), "there is a variable x"),
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


def test_fmu_for_another_machine_is_refused_with_a_message(folder: Path) -> None:
    with pytest.raises(FmuError, match="holds binaries for riscv64-plan9, this machine needs"):
        FmuComponent(build(folder, 3, platform="riscv64-plan9"))


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


def test_file_that_is_no_fmu_is_reported(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match="cannot be read: No such file"):
        describe(tmp_path / "missing.fmu")
    (tmp_path / "text.fmu").write_text("no archive")
    with pytest.raises(FmuError, match="is not a readable FMU"):
        describe(tmp_path / "text.fmu")


def test_model_exchange_only_is_reported(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "me.fmu"
    with zipfile.ZipFile(build(folder, 3)) as source, zipfile.ZipFile(path, "w") as target:
        text = source.read("modelDescription.xml").decode()
        start, end = text.index("<CoSimulation"), text.index("<TypeDefinitions")
        target.writestr(
            "modelDescription.xml", text[:start] + '<ModelExchange modelIdentifier="amplifier"/>' + text[end:]
        )
    with pytest.raises(FmuError, match="offers model exchange only; export it for co-simulation"):
        describe(path)


@BOTH
def test_fmu_that_gives_its_state_but_cannot_serialize_it_is_not_resumed(
    folder: Path, tmp_path: Path, fmi: int
) -> None:
    path = tmp_path / "it.fmu"
    with zipfile.ZipFile(build(folder, fmi)) as source, zipfile.ZipFile(path, "w") as target:
        text, count = re.subn(r'canSerializeFMU[sS]tate="true"', "", source.read("modelDescription.xml").decode())
        for name in source.namelist():
            target.writestr(name, text if name == "modelDescription.xml" else source.read(name))
    assert count == 1
    assert (describe(build(folder, fmi)).can_serialize, describe(path).can_serialize) == (True, False)


@BOTH
def test_description_for_a_person_names_every_variable(folder: Path, fmi: int) -> None:
    text = "\n".join(describe(build(folder, fmi)).lines())
    assert text.startswith(f"Amplifier  FMI {fmi} co-simulation")
    for name in ("on", "x", "y", "count", "high", "gain", "mode"):
        assert f"\n  {name} " in text
    real, size = ("Real", "3") if fmi == 2 else ("Float64", "n")
    for line in (
        "  on  Boolean = true",
        f"  x   {real} ({size}) [m] = 0",
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
        found[limit] = {**part.do_step(0, SECOND, values), "state": np.frombuffer(part.save(), np.uint8)}
        part.terminate()
    for name in found[1]:
        np.testing.assert_array_equal(found[1][name], found[1 << 20][name], err_msg=name)
    assert found[1]["height"][1, 0] > found[1]["height"][0, 0]


def test_description_for_a_person_lists_variables_below_their_causality() -> None:
    path = find_fmu("ProfileSensor")
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    kinds = {"inputs": ["input"], "outputs": ["output"], "parameters": ["structuralParameter", "parameter"]}
    variables = root.find("ModelVariables")
    assert variables is not None
    expected = {
        title: [each.attrib["name"] for each in variables if each.attrib["causality"] in causalities]
        for title, causalities in kinds.items()
    }
    lines = list(describe(path).lines())
    found: dict[str, list[str]] = {}
    for line in lines[lines.index("inputs") :]:
        if line.startswith("  "):
            found[next(reversed(found))].append(line.split()[0])
        else:
            found[line] = []
    assert found == expected
    assert lines[0].startswith("ProfileSensor  FMI 3 co-simulation")
    assert f"  file       {path}" in lines
    assert "  grid       9 x 9 cells (any size: structural parameters nx, ny)" in lines
    assert "  state      can be saved and restored" in lines
    assert "  step size  any" in lines
    assert [line for line in lines if line.startswith("  licence    ")] == ["  licence    BSD-3-Clause"]


def test_start_values_that_differ_are_not_shown_as_one(folder: Path, tmp_path: Path) -> None:
    fmu = altered(build(folder, 3), tmp_path / "starts.fmu", *STARTS[3])
    assert "  x   Float64 (n) [m]" in list(describe(fmu).lines())


@pytest.mark.parametrize("member", ["getFMUState", "fmi3SerializedFMUStateSize", "fmi3SerializeFMUState"])
def test_state_is_freed_once_also_where_it_cannot_be_saved(member: str) -> None:
    def refuse(*_: object) -> None:
        raise FMICallException(member, 3)

    fmu = MagicMock()
    setattr(fmu, member, refuse)
    with pytest.raises(ComponentError, match=f"{member} returned an error"):
        bound(fmu).save()
    freed = [] if member == "getFMUState" else [call(fmu.getFMUState.return_value)]
    assert fmu.freeFMUState.mock_calls == freed


@pytest.mark.parametrize("fails", [False, True])
def test_state_is_freed_once_also_where_it_cannot_be_restored(fails: bool) -> None:
    fmu = MagicMock()
    if fails:
        fmu.setFMUState.side_effect = FMICallException("fmi3SetFMUState", 3)
        with pytest.raises(ComponentError, match="fmi3SetFMUState returned an error"):
            bound(fmu).restore(b"state")
    else:
        bound(fmu).restore(b"state")
    ((component, pointer, size, made),) = (each.args for each in fmu.fmi3DeserializeFMUState.mock_calls)
    assert component is fmu.component
    assert ctypes.string_at(pointer, size) == b"state"
    fmu.setFMUState.assert_called_once_with(made._obj)
    assert fmu.freeFMUState.mock_calls == [call(made._obj)]


def bound(fmu: Any) -> Binding:
    """The binding of an FMU that a test states."""
    binding: Any = object.__new__(Binding)
    binding._fmi, binding._messages, binding._fmu = 3, deque(), fmu
    binding._grouped, binding.worst = {}, 0
    return binding


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
